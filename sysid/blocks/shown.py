"""Results that display themselves: `print`, a notebook, a DataFrame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sysid.blocks.notebook import result_html
from sysid.blocks.plain_text import result_text
from sysid.blocks.tables import Table, record_table

if TYPE_CHECKING:
    import pandas as pd


class Shown(ABC):
    """A result with a display: `print`, a notebook, `to_frame()`.

    A class gives its content in one line (`headline`) and as rows of plain values (`records`);
    `tables` and `footnotes` may add to it. Dataclasses derive with `repr=False`, so that their
    `repr` stays one line.
    """

    @abstractmethod
    def headline(self) -> str:
        """The result in a few words without a line break."""

    @abstractmethod
    def records(self) -> Sequence[Mapping[str, Any]]:
        """The rows of `to_frame()`: plain values by column, units in the names."""

    def tables(self) -> Iterable[Table]:
        """The tables displayed; by default the records."""
        yield record_table("", self.records())

    def footnotes(self) -> Iterable[str]:
        """Lines below the tables; by default the notices, where there are any."""
        return tuple(f"notice: {line}" for line in getattr(self, "notices", ()))

    def to_frame(self) -> pd.DataFrame:
        """The records as a DataFrame of numbers, one row per record."""
        import pandas as pd

        return pd.DataFrame.from_records([dict(record) for record in self.records()])

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.headline()}>"

    def __str__(self) -> str:
        return result_text(self.headline(), self.tables(), self.footnotes())

    def _repr_html_(self) -> str:
        return result_html(self.headline(), self.tables(), self.footnotes())


__all__ = ["Shown"]
