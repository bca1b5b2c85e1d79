"""Where a cycle ends: a stroke there and back."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sysid.types import FloatArray

SHARE = 0.1
"""A stroke is a movement of at least this share of the travel, in one direction."""


@dataclass
class Strokes:
    """Counts strokes; `least` is the shortest, rad or m."""

    least: float
    way: int = 0
    extreme: float = math.nan
    low: float = math.nan
    turns: int = 0

    def ends(self, position: float) -> bool:
        """Whether a cycle ends with this position: the second time that a stroke turns."""
        if math.isnan(self.extreme):
            self.extreme = self.low = position
            return False
        if self.way == 0:
            self.extreme, self.low = max(self.extreme, position), min(self.low, position)
            if self.extreme - self.low >= self.least:
                self.way = 1 if position == self.extreme else -1
                self.extreme = position
            return False
        if self.way * (position - self.extreme) > 0.0:
            self.extreme = position
            return False
        if self.way * (self.extreme - position) < self.least:
            return False
        self.way, self.extreme = -self.way, position
        self.turns += 1
        return self.turns % 2 == 0


def cycle_ends(positions: FloatArray, least: float) -> list[int]:
    """The rows of positions (n,) at which a cycle ends; those that are not finite are skipped."""
    strokes = Strokes(least)
    rows = ((k, float(x)) for k, x in enumerate(positions))
    return [k for k, x in rows if math.isfinite(x) and strokes.ends(x)]


__all__ = ["SHARE", "Strokes", "cycle_ends"]
