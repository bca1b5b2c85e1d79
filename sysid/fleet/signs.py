"""What changes of several numbers on one date say together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sysid.fleet.trend import Trend
from sysid.io.channels import SIDES


@dataclass(frozen=True)
class LeakSign:
    """A rig whose valve tests look as a leak would make them, of chamber `side`, from `since` on.

    What leaks is missing while a chamber fills and is gained while it empties: the coefficient of
    filling falls and that of emptying rises, from one date on. It shows leaks that are too small
    for a diagnosis on one date, since both coefficients are known to a few tenths of a percent.
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
    """The chambers whose coefficients moved against each other, at most a date apart."""
    changed = {(t.rig, t.name): t for t in trends if t.is_change and t.change}
    found = []
    for rig in dict.fromkeys(t.rig for t in trends):
        for side in SIDES:
            pair = [changed.get((rig, f"valves.{side}.discrete.c_{k}")) for k in ("fill", "dis")]
            filling, emptying = pair
            if filling is None or emptying is None or not filling.change or not emptying.change:
                continue
            apart = abs(filling.change.first - emptying.change.first)
            if filling.change.size < 0.0 < emptying.change.size and apart <= 1:
                found.append(LeakSign(rig, side, min(filling.since, emptying.since)))
    return tuple(found)


__all__ = ["LeakSign", "leak_signs"]
