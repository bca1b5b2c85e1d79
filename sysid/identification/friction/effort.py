"""How the friction fits use their tests, and what drives the motion in them.

"Effort" is torque (Nm) on a rotary rig and force (N) on a linear one; "position" is rad
or m accordingly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.estimation.quality import ExcludedData, root_mean_square
from sysid.recording.recording import Recording
from sysid.types import FloatArray

BLOCK_S = 0.05  # blocks over which speeds are averaged
_PUSHED = 0.3  # correlation of speed and push


@dataclass
class TrialUse:
    """The outcome of one trial: used, or excluded with the reason, and the values read from it.

    `has_stopped`: a ramp's effort had stopped growing before the shaft moved.
    """

    label: str
    source: str
    kind: str
    used: bool = True
    reason: str = ""
    values: dict[str, float] = field(default_factory=dict)
    has_stopped: bool = False

    @property
    def title(self) -> str:
        """ "test 3", or the file of a test without a label."""
        return f"test {self.label}" if self.label else Path(self.source).name

    def exclude(self, reason: str) -> None:
        self.used, self.reason = False, reason

    def to_json(self) -> dict[str, Any]:
        name = self.label or Path(self.source).name
        table: dict[str, Any] = {"test": name, "kind": self.kind, "used": self.used}
        if self.reason:
            table["reason"] = self.reason
        return table | self.values


def exclusion_lines(uses: Sequence[TrialUse]) -> list[str]:
    """Each reason for excluding tests, once, with their number and names."""
    left_out = by_reason([use for use in uses if not use.used])
    return [f"{len(own)} excluded ({titles(own)}): {why}" for why, own in left_out.items()]


def excluded_tests(uses: Sequence[TrialUse], asked: tuple[FloatArray, FloatArray]) -> ExcludedData:
    """The tests that a fit excluded; `asked`: the measured values and the law's residuals of all
    tests (n,) that the law predicts, used or not."""
    measured, left = asked
    used = sum(use.used for use in uses)
    unasked = len(uses) - max(len(measured), used)
    out = ExcludedData("tests", len(uses) - used, len(uses), unasked)
    if len(measured) <= used:
        return out
    size = root_mean_square(measured)
    return replace(out, rmse=root_mean_square(left), spread=size)


def against_motion(uses: Sequence[TrialUse]) -> bool:
    """Whether the effort works against the motion in most of the tests that show it."""
    works = [work for use in uses if (work := _work(use.values)) is not None]
    return 2 * sum(work < 0.0 for work in works) > len(works)


def _work(values: Mapping[str, float]) -> float | None:
    """Work done by friction, or by the effort of a ramp; negative where that is impossible."""
    if "breakaway" in values:
        return values["breakaway"] * values["direction"]
    return values["friction"] * values["speed"] if "friction" in values else None


def by_reason(uses: Sequence[TrialUse]) -> dict[str, list[TrialUse]]:
    """The tests by the reason for excluding them, in the order of the first of each."""
    groups: dict[str, list[TrialUse]] = {}
    for use in uses:
        groups.setdefault(use.reason, []).append(use)
    return groups


def titles(uses: Sequence[TrialUse]) -> str:
    """ "tests 1, 2, 3"; those without a label by their files."""
    labels = [use.label for use in uses if use.label]
    files = [use.title for use in uses if not use.label]
    named = [f"test{'s' * (len(labels) > 1)} {', '.join(labels)}"] if labels else []
    return ", ".join([*named, *files])


def pushed_along(trials: Sequence[Recording]) -> str | None:
    """A notice where the chambers' air drives the motion although only the motor should.

    Air flowing through open exhausts resists motion: its effort and the speed have opposite signs
    in the mean over all trials. None where they do, or where the trials do not show it.
    """
    pairs = [_blocks(t) for t in trials if not t.valves_move and np.any(t.motor)]
    pairs = [(v, c) for v, c in pairs if np.any(c)]
    if not pairs:
        return None
    speed, push = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    size = math.sqrt(float(speed @ speed) * float(push @ push))
    if size == 0.0 or float(speed @ push) < _PUSHED * size:
        return None
    if len(trials[0].rig.sides) == 1:
        return (
            "the chamber's pressure drives the motion although only the motor should: is the "
            "position's sign reversed?"
        )
    return (
        "the chambers' pressures drive the motion although only the motor should: are "
        "pressure_a_pa and pressure_b_pa swapped, or is the position's sign reversed?"
    )


def _blocks(trial: Recording) -> tuple[FloatArray, FloatArray]:
    """Mean speed and mean effort of the cylinder over blocks of 50 ms, (m,) each."""
    size = max(1, round(BLOCK_S / trial.period))
    count = (len(trial) - 1) // size
    marks = size * np.arange(count + 1)
    push = trial.cylinder[: count * size].reshape(count, size).mean(axis=1)
    return np.diff(trial.position[marks]) / (size * trial.period), push
