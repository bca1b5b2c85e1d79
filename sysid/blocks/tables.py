"""Display of results: as text, as HTML in a notebook, as a DataFrame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

from sysid.blocks.numbers import ascii_text, estimate_cells, number
from sysid.estimation.linear import Estimate

if TYPE_CHECKING:
    import pandas as pd

_GAP = "  "
_DIGITS = 4


@dataclass(frozen=True)
class ShownTable:
    """A table for reading: a title, the names of the columns, and cells of text."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def text(self) -> str:
        """Columns aligned by blanks, the title and the names of the columns above; in ASCII."""
        lines = [tuple(map(ascii_text, line)) for line in (self.columns, *self.rows)]
        widths = [max(len(line[i]) for line in lines) for i in range(len(self.columns))]
        aligned = (
            _GAP.join(c.ljust(w) for c, w in zip(line, widths, strict=True)).rstrip()
            for line in lines
        )
        return "\n".join((self.title, *aligned) if self.title else aligned)

    def html(self) -> str:
        """A `<table>`; the content of the cells is escaped."""
        caption = f"<caption>{escape(self.title)}</caption>" if self.title else ""
        head = "".join(f"<th>{escape(c)}</th>" for c in self.columns)
        rows = ("".join(f"<td>{escape(c)}</td>" for c in row) for row in self.rows)
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


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

    def tables(self) -> Iterable[ShownTable]:
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
        tables = [table.text() for table in self.tables() if table.rows]
        blocks = (ascii_text(self.headline()), *tables, "\n".join(self.footnotes()))
        return "\n\n".join(block for block in blocks if block)

    def _repr_html_(self) -> str:
        tables = "".join(table.html() for table in self.tables() if table.rows)
        notes = "".join(f"<li>{escape(line)}</li>" for line in self.footnotes())
        listed = f"<ul>{notes}</ul>" if notes else ""
        return f"<div><p>{escape(self.headline())}</p>{tables}{listed}</div>"


def cell(value: Any) -> str:
    """A plain value as text: numbers with four significant digits, None as a dash."""
    if value is None or isinstance(value, float):
        return number(value, _DIGITS)
    return str(value)


def record_table(title: str, records: Sequence[Mapping[str, Any]]) -> ShownTable:
    """Records as a table; a record that lacks a column has an empty cell there."""
    columns = tuple(dict.fromkeys(name for record in records for name in record))
    rows = tuple(
        tuple(cell(record[c]) if c in record else "" for c in columns) for record in records
    )
    return ShownTable(title, columns, rows)


def estimate_table(title: str, estimates: Mapping[str, Estimate]) -> ShownTable:
    """One row per estimate: value, standard error, unit and 95 % interval."""
    rows = []
    for name, estimate in estimates.items():
        value, std, interval, unit = estimate_cells(estimate)
        rows.append((name, value, std, unit, interval))
    columns = ("parameter", "value", "std. error", "unit", "95 % interval")
    return ShownTable(title, columns, tuple(rows))


def estimate_records(estimates: Mapping[str, Estimate], **labels: Any) -> list[dict[str, Any]]:
    """One record per estimate, after `labels`: value, std, limits `low` and `high`, unit."""
    return [
        {
            **labels,
            "parameter": name,
            "value": e.value,
            "std": e.std,
            "low": e.interval[0],
            "high": e.interval[1],
            "unit": e.unit,
            "reason": e.reason or "",
        }
        for name, e in estimates.items()
    ]


__all__ = ["Shown", "ShownTable", "cell", "estimate_records", "estimate_table", "record_table"]
