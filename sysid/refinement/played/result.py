"""A designed test: what it is expected to tell, its commands, and the file that a rig plays."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.numbers import number
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, table
from sysid.estimation.linear import finite_or_none
from sysid.io.played_header import PlayedHeader
from sysid.io.rig import Rig
from sysid.io.tables import write_table
from sysid.refinement.candidates import CandidateMotion
from sysid.refinement.played.limits import OFF, MotionLimits

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Expected:
    """What is asked, its value, and its standard error `now` and `after` the test, in `unit`."""

    name: str
    value: float
    unit: str
    now: float
    after: float


@dataclass(frozen=True)
class Reached:
    """The farthest `position` from the middle and the highest `speed` on the plants that the test
    was checked on, and the largest `effort`; rad or m, rad/s or m/s, Nm or N."""

    position: float
    speed: float
    effort: float


@dataclass(frozen=True, repr=False)
class PlayedTest(Shown):
    """A test that a rig can play: short tests of one `kind`, each from rest where it says.

    `motions` hold the commands; `expected` the standard errors of what was asked; `limits` are kept
    on the model and on `plants` plants whose constants are off by 20 %, which reach `reached`.
    """

    rig: Rig
    kind: str
    motions: tuple[CandidateMotion, ...]
    expected: tuple[Expected, ...]
    limits: MotionLimits
    reached: Reached
    plants: int
    notices: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """Duration of all its tests together, s."""
        return sum(m.duration for m in self.motions)

    def headline(self) -> str:
        """What is played, and for what."""
        names = [e.name for e in self.expected]
        what = names[0] if len(names) == 1 else f"{len(names)} parameters"
        less = 100.0 * (1.0 - math.exp(self.gain))
        return (
            f"{self.kind}, {len(self.motions)} tests of {self.motions[0].duration:g} s for {what}: "
            f"standard error {less:.0f} % smaller"
        )

    @property
    def gain(self) -> float:
        """Mean over what was asked of log(standard error after / now)."""
        ratios = [e.after / e.now if math.isfinite(e.now) else 0.0 for e in self.expected]
        return float(np.mean(np.log(np.maximum(ratios, np.finfo(float).tiny))))

    def records(self) -> list[dict[str, Any]]:
        """One record for each thing asked: its standard errors now and after."""
        return [
            {
                "parameter": e.name,
                "value": e.value,
                "std_now": finite_or_none(e.now),
                "std_after": finite_or_none(e.after),
                "unit": e.unit,
            }
            for e in self.expected
        ]

    def tables(self) -> Iterable[Table]:
        """What it is expected to tell; how near it comes to the limits."""
        rows = [
            (e.name, number(e.value, 4), number(e.now, 2), number(e.after, 2), e.unit)
            for e in self.expected
        ]
        yield table(
            "Expected of the test", ("parameter", "value", "std. error now", "after", "unit"), rows
        )
        units, r, most = self.rig.units, self.reached, self.limits
        off = f"largest, on {self.plants} plants {100 * OFF:.0f} % off"
        bounds = [
            ("from the middle", number(r.position), number(most.position), units.position),
            ("speed", number(r.speed), number(most.speed), units.speed),
            (f"motor {units.word}", number(r.effort), number(most.effort), units.effort),
        ]
        yield table("Limits", ("quantity", off, "limit", "unit"), bounds)

    @property
    def frame(self) -> pd.DataFrame:
        """A new DataFrame of the commands: `test`, `time_s`, and a column for each."""
        import pandas as pd

        parts = []
        for label, motion in enumerate(self.motions, start=1):
            columns = {"test": label, "time_s": np.round(motion.time, 9)}
            if self.rig.motor is not None:
                columns[self.rig.effort_channel] = np.round(motion.motor, 6)
            valves = motion.valve_columns(self.rig)
            whole = int if self.kind == "motion-discrete" else float
            columns |= {name: values.astype(whole) for name, values in valves.items()}
            parts.append(pd.DataFrame(columns))
        return pd.concat(parts, ignore_index=True)

    def comments(self) -> Sequence[str]:
        """The lines above the file's columns: what it is, and what to expect of it."""
        units, most, r = self.rig.units, self.limits, self.reached
        speed = f", speed {most.speed:.4g} {units.speed}" if math.isfinite(most.speed) else ""
        effort = f", {units.word} {most.effort:.4g} {units.effort}" if r.effort else ""
        spring = self.rig.spring is not None
        where = "where the spring holds it" if spring else "in the middle of the travel"
        starts = {str(k): float(m.channels[0, 0]) for k, m in enumerate(self.motions, 1) if m.start}
        if starts:
            where += " or at the place given"
        valves = self.rig.all_valves
        emptied = " and the chamber emptied" if self.rig.bleeds else ""
        header = PlayedHeader(
            self.kind,
            tuple((e.name, e.now, e.after, e.unit) for e in self.expected),
            starts,
            units.position,
        )
        return [
            *header.lines(),
            f"rig {self.rig.name}: {len(self.motions)} tests of {self.motions[0].duration:g} s, "
            f"each from rest {where} with {valves} off{emptied}",
            f"limits: {most.position:.4g} {units.position} from the middle{speed}{effort}; on "
            f"{self.plants} plants whose constants are {100 * OFF:.0f} % off it reaches "
            f"{r.position:.4g} {units.position} and {r.speed:.4g} {units.speed}",
            f'in the campaign: [[log]] kind = "{self.kind}"',
        ]

    def write(self, path: str | Path) -> Path:
        """Write the commands in the log format, CSV or Parquet. Raises InputError."""
        write_table(self.frame, Path(path), self.comments())
        return Path(path)

    def to_json(self) -> dict[str, Any]:
        """The object `test` that `sysid advise -o --json` prints."""
        most, r = self.limits, self.reached
        return {
            "kind": self.kind,
            "tests": len(self.motions),
            "duration_s": self.duration,
            "content": [m.text for m in self.motions],
            "starts": [m.start for m in self.motions],
            "expected": self.records(),
            "limits": {
                "position": most.position,
                "speed": finite_or_none(most.speed),
                "effort": finite_or_none(most.effort),
            },
            "reached": {"position": r.position, "speed": r.speed, "effort": r.effort},
            "plants": self.plants,
            "off": OFF,
        }


__all__ = ["Expected", "PlayedTest", "Reached"]
