"""What changes of several numbers on one date say together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sysid.fleet.trend import Trend
from sysid.io.channels import SIDES

_FILLING = ("c_fill", "choked_flow_fill_kg_s")
_EMPTYING = ("c_dis", "choked_flow_dis_kg_s")


@dataclass(frozen=True)
class LeakSign:
    """A rig whose valve tests show signs of a leak, of chamber `side`, from `since` on.

    A leak slows the filling of a chamber and speeds up its emptying: a parameter of filling falls
    and one of emptying rises, from one date on. This reveals leaks that are too small for a
    diagnosis on one date, as these parameters are known to a tenth of a percent.
    """

    rig: str
    side: str
    since: str

    def sentence(self) -> str:
        """The sign in words."""
        return (
            f"Valve {self.side.upper()} fills less and empties more from {self.since} on, as with "
            f"a leak of chamber {self.side.upper()}; plug its port and watch its pressure to "
            "confirm it"
        )


def leak_signs(trends: Sequence[Trend]) -> tuple[LeakSign, ...]:
    """The chambers that fill less and empty more, choked or not, from dates at most one apart."""
    changed = {(t.rig, t.name): t for t in trends if t.is_change}
    found = []
    for rig in dict.fromkeys(t.rig for t in trends):
        dates = sorted({date for t in trends if t.rig == rig for date in t.dates})
        for side in SIDES:
            law = f"valves.{side}.discrete."
            filling = [changed.get((rig, f"{law}{key}")) for key in _FILLING]
            emptying = [changed.get((rig, f"{law}{key}")) for key in _EMPTYING]
            since = _together(filling, emptying, dates)
            if since:
                found.append(LeakSign(rig, side, since))
    return tuple(found)


def _together(
    filling: Sequence[Trend | None], emptying: Sequence[Trend | None], dates: Sequence[str]
) -> str:
    """The first date of a fall of the one and a rise of the other; empty without both.

    `dates` are those of the rig: a number may be missing on some of them.
    """
    place = {date: number for number, date in enumerate(dates)}
    falls = [t for t in filling if t and t.change and t.change.size < 0.0]
    rises = [t for t in emptying if t and t.change and t.change.size > 0.0]
    found = [
        min(fall.since, rise.since)
        for fall in falls
        for rise in rises
        if abs(place[fall.since] - place[rise.since]) <= 1
    ]
    return min(found, default="")


__all__ = ["LeakSign", "leak_signs"]
