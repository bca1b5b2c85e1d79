"""How well laws follow their tests, as a table: one row a fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from sysid.blocks.numbers import MISSING, number, unit
from sysid.blocks.tables import NotedCell, Table, table
from sysid.blocks.titles import capital
from sysid.estimation.quality import lack_of_fit_text

_COLUMNS = ("Fit", "RMSE", "Unit", "Of the spread, %", "R²", "Lack of fit", "Verdict")
_WORDS = {
    "valves": "",
    "a": "valve A",
    "b": "valve B",
    "friction-static": "breakaway",
    "friction-sliding": "constant effort",
    "friction-motion": "motion",
    "friction-points": "readings",
    "discrete": "on/off",
    "pwm": "PWM",
    "fill": "filling",
    "discharge": "discharging",
    "ann": "network",
    "averaged": "averaged law",
    "steady": "settled flow",
    "timing": "time to a pressure",
}


def quality_name(place: str) -> str:
    """A fit's name for reading, from its place in a bundle ("valves.a.discrete, fill")."""
    words = [_WORDS.get(w, w) for w in place.replace(", ", ".").split(".")]
    text = ", ".join(filter(None, words))
    return capital(text)


ShownIn = Callable[[str], tuple[str, float]]


class Judged(Protocol):
    """How well a law follows its tests: as it was fitted, or as a bundle holds it."""

    def to_json(self) -> dict[str, Any]:
        """The bundle's object."""


def _cells(judged: Judged, shown_in: ShownIn) -> tuple[str, ...]:
    """The cells after the first."""
    found = judged.to_json()
    share, r2 = found["rmse_share"], found["r2"]
    rmse = found["rmse"]
    # Duties as the comparison of surfaces has them.
    of_duty = found["unit"] == "of duty"
    name, scale = ("points of duty", 100.0) if of_duty else shown_in(found["unit"])
    return (
        NotedCell(number(scale * rmse), plain=number(rmse)),
        NotedCell(name, plain=found["unit"]),
        MISSING if share is None else number(100.0 * share, 2),
        MISSING if r2 is None else f"{r2:.4f}",
        lack_of_fit_text(found["lack_of_fit"]),
        found["verdict"],
    )


def quality_table(
    found: Mapping[str, Judged],
    caption: str = "How well the laws follow their tests",
    shown_in: ShownIn = lambda name: (unit(name), 1.0),
) -> Table:
    """One row per judgement, by its place in a bundle.

    `shown_in`: the unit in which a page shows errors of a unit in SI, and the scale to it.
    """
    rows = [(quality_name(place), *_cells(one, shown_in)) for place, one in found.items()]
    return table(caption, _COLUMNS, rows, text=(2, 5, 6))


__all__ = ["Judged", "quality_name", "quality_table"]
