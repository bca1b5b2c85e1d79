"""One number of one rig over its dates, and its most likely change."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.blocks.numbers import number, percent, unit
from sysid.estimation.multiple_tests import SIGNIFICANCE
from sysid.fleet.changes import Change
from sysid.fleet.rows import Family
from sysid.types import FloatArray


@dataclass(frozen=True)
class Trend:
    """One number of one rig over its dates: values and standard errors (n,), in `unit`.

    `change` is the most likely one, None with too few dates; `p_adjusted` among the whole fleet.
    """

    rig: str
    family: Family
    name: str
    unit: str
    dates: tuple[str, ...]
    days: FloatArray
    values: FloatArray
    std: FloatArray
    change: Change | None
    p_adjusted: float = math.nan

    @property
    def is_change(self) -> bool:
        """Whether the number changed, the fleet's false discovery rate being 5 %."""
        return self.p_adjusted < SIGNIFICANCE

    @property
    def since(self) -> str:
        """The first date on which the change shows; empty without one."""
        return self.dates[self.change.first] if self.change and self.is_change else ""

    @property
    def has_level(self) -> bool:
        """Whether the level before the change is not 0 within its error."""
        return self.change is not None and abs(self.change.before) > float(np.median(self.std))

    def sentence(self, title: str = "", shown: tuple[float, str] | None = None) -> str:
        """The change in words, of a number called `title`; `shown`: its scale and unit there."""
        title = title or self.name
        if self.change is None or not self.is_change:
            return f"{title} does not change"
        scale, name = shown or (1.0, unit(self.unit))
        c, size = self.change, f"{number(scale * abs(self.change.size))} {name}"
        course = "at once" if c.shape == "step" else "growing with time"
        what = f"appears with {size}"
        if self.has_level:
            verb = "falls" if c.size < 0.0 else "rises"
            what = f"{verb} by {size} ({percent(100.0 * abs(c.size / c.before))})"
        p = number(self.p_adjusted, 2)
        return f"{title} {what} from {self.since} on, {course} (p = {p})"

    def to_json(self) -> dict[str, Any]:
        """In JSON types."""
        return {
            "rig": self.rig,
            "family": self.family,
            "name": self.name,
            "unit": self.unit,
            "dates": list(self.dates),
            "values": [float(v) for v in self.values],
            "std": [float(s) for s in self.std],
            "change": self.change and self.change.to_json(),
            "p_adjusted": None if math.isnan(self.p_adjusted) else self.p_adjusted,
            "since": self.since or None,
        }


__all__ = ["Trend"]
