"""The thesis' tables of controllers computed anew, on its rig or on that of any bundle.

`index.py` declares each table in a line, by its number; `tracking.py` (4.5, 5.2, 5.3),
`payload.py` (5.4), `valve.py` (5.5) and `experiments.py` (4.4.3, chapter 6, appendices A to D)
turn the line and the printed cells, a CSV file of `datasets/thesis`, into closed loops in words
(`declaration.py`); `rig.py` makes them cases on a rig, and `computed.py` runs a whole table as one
batch.
"""

from sysid.thesis.computed import (
    LOST_RAD,
    Agreement,
    TableRow,
    ThesisTable,
    thesis_table,
    thesis_tables,
)
from sysid.thesis.declaration import (
    Cell,
    Column,
    Declaration,
    TableLoop,
    printed,
)
from sysid.thesis.index import TABLES, batches, declared
from sysid.thesis.rig import TRAJECTORIES, TableRig

__all__ = [
    "LOST_RAD",
    "TABLES",
    "TRAJECTORIES",
    "Agreement",
    "Cell",
    "Column",
    "Declaration",
    "TableLoop",
    "TableRig",
    "TableRow",
    "ThesisTable",
    "batches",
    "declared",
    "printed",
    "thesis_table",
    "thesis_tables",
]
