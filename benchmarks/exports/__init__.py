"""The export styles of `benchmarks/export_styles.py`: one truth, as many programs write it.

`record.py` holds the truth, the columns and the registry; `scopes.py`, `controllers.py`,
`labview.py`, `robots.py`, `programs.py`, `spreadsheets.py` and `arrays.py` the writers, one
function a style; `damages.py` what befalls such files.
"""

from benchmarks.exports import (
    arrays,
    controllers,
    labview,
    programs,
    robots,
    scopes,
    spreadsheets,
)
from benchmarks.exports.record import STYLES, Style

__all__ = [
    "STYLES",
    "Style",
    "arrays",
    "controllers",
    "labview",
    "programs",
    "robots",
    "scopes",
    "spreadsheets",
]
