"""What a log cannot be trusted in, found in its own samples, and mended where it can be, as said.

In this order: a position whose counter wraps around is followed (`wraps`), channels whose readings
repeat are taken at their fresh ones (`stale`), a position that jumps within a sample is joined on
(`jumps`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sysid.io.channels import PRESSURES
from sysid.io.trust.jumps import Jump, Resolution, resolution_of, without_jumps
from sysid.io.trust.stale import Staleness, fresh_readings, staleness
from sysid.io.trust.wraps import Wraps, counter_ranges, without_wraps
from sysid.types import FloatArray

Rows = NDArray[np.int64] | slice
"""Rows of a file that are one test's."""

# Named one by one in a notice.
_NAMED = 3


@dataclass
class Samples:
    """A file's samples by tests while they are mended.

    `columns` (n,) each by name, SI; `tests`: (label, rows) of each; `position` names its channel,
    `count` is the step of its counter where the file holds one, `declared` the step that the rig
    file declares; `place` names a row of the file.
    Afterwards `notices` say what was done, without the file's name, and `strides` how many rows
    apart a channel's fresh readings are.
    """

    columns: dict[str, FloatArray]
    tests: list[tuple[str, Rows]]
    position: str
    count: float | None
    declared: float | None
    place: Callable[[int], str]
    notices: list[str] = field(default_factory=list)
    strides: dict[str, float] = field(default_factory=dict)

    def parts(self, name: str) -> list[FloatArray]:
        """A channel's samples, test by test."""
        return [self.columns[name][rows] for _, rows in self.tests]

    def put(self, name: str, parts: Sequence[FloatArray]) -> None:
        """Replace a channel's samples, test by test."""
        column = np.array(self.columns[name], dtype=float)
        for (_, rows), values in zip(self.tests, parts, strict=True):
            column[rows] = values
        self.columns[name] = column

    def where(self, test: int, row: int) -> str:
        """ "line 17 (test 2, 1.8 s)" of a row of a test."""
        label, rows = self.tests[test]
        number = (rows.start or 0) + row if isinstance(rows, slice) else int(rows[row])
        seconds = f"{self.columns['time_s'][number]:.6g} s"
        return f"{self.place(number)} ({f'test {label}, ' if label else ''}{seconds})"


@dataclass
class Fresh:
    """A test's fresh readings of a channel: rows (m,), of which the first may be before the test's
    own, times (m,) s, and values (m,)."""

    rows: FloatArray
    time: FloatArray
    values: FloatArray


def mend(samples: Samples) -> None:
    """Mend wraps, repeated readings and jumps, in `samples`.

    A file whose time does not increase, which is refused elsewhere, is left as it is.
    """
    if any(np.any(np.diff(time) <= 0.0) for time in samples.parts("time_s")):
        return
    if samples.position in samples.columns:
        _follow(samples)
    names = [n for n in (samples.position, *PRESSURES) if n in samples.columns]
    slow = {name: how for name in names if (how := staleness(samples.parts(name))) is not None}
    fresh = {name: _fresh(samples, name, how.stride) for name, how in slow.items()}
    if samples.position in samples.columns:
        _join_on(samples, fresh.get(samples.position))
    for name, how in slow.items():
        _take_fresh(samples, name, how, fresh[name])
    _end_at_fresh(samples, fresh.values())


def _follow(samples: Samples) -> None:
    """A position over the wraps of its counter."""
    name = samples.position
    count = samples.count
    if count is None:
        resolution = resolution_of(samples.columns[name])
        count = resolution.step if resolution.is_whole else None
    ranges = counter_ranges(count, is_angle=name == "theta_rad")
    parts, wraps = without_wraps(samples.parts(name), ranges)
    if wraps is None:
        return
    times = len(wraps.rows)
    samples.put(name, parts)
    samples.notices.append(
        f"{name} wraps around at {_range(wraps, count)} {times} time{'s' * (times > 1)}, first in "
        f"{samples.where(*wraps.rows[0])}: it is followed over its turns"
    )


def _range(wraps: Wraps, count: float | None) -> str:
    if count is None or math.isclose(wraps.range, 2.0 * math.pi):
        return "2 pi"
    return f"2^{round(math.log2(wraps.range / count))} counts"


def _fresh(samples: Samples, name: str, stride: float) -> list[Fresh]:
    """A channel's fresh readings, test by test."""
    found = []
    for time, values in zip(samples.parts("time_s"), samples.parts(name), strict=True):
        rows, readings = fresh_readings(values, stride)
        times = np.interp(rows, np.arange(len(time)), time)
        times += np.minimum(rows, 0.0) * np.median(np.diff(time))
        found.append(Fresh(rows, times, readings))
    return found


def _join_on(samples: Samples, fresh: list[Fresh] | None) -> None:
    """A position after its jumps; of a slow sensor its fresh readings, in place."""
    name = samples.position
    parts = samples.parts(name)
    resolution = _resolution(samples)
    found: list[tuple[int, Jump]] = []
    for test, (time, values) in enumerate(zip(samples.parts("time_s"), parts, strict=True)):
        if fresh is None:
            parts[test], jumps = without_jumps(time, values, resolution)
        else:
            own = fresh[test]
            own.values, jumps = without_jumps(own.time, own.values, resolution)
            jumps = [replace(jump, row=max(0, int(own.rows[jump.row]))) for jump in jumps]
        found += [(test, jump) for jump in jumps]
    if found:
        samples.put(name, parts)
        samples.notices.append(_jumps_line(samples, found))


def _resolution(samples: Samples) -> Resolution:
    if samples.count is not None:
        return Resolution(samples.count, True)
    return resolution_of(samples.columns[samples.position], samples.declared)


def _jumps_line(samples: Samples, found: Sequence[tuple[int, Jump]]) -> str:
    """What a notice says of all jumps of a file."""
    is_linear = samples.position == "position_m"
    si, small = ("m", "mm") if is_linear else ("rad", "mrad")
    lines = []
    for test, jump in found[:_NAMED]:
        usual = f"{jump.usual_speed:.3g} {si}/s" if jump.usual_speed else "rests"
        verb = "the motion around it has " if jump.usual_speed else "the motion around it "
        lines.append(
            f"by {1e3 * jump.size:.4g} {small} in {samples.where(test, jump.row)}: "
            f"{jump.speed:.3g} {si}/s, where {verb}{usual}"
        )
    more = f", and {len(found) - _NAMED} more times" if len(found) > _NAMED else ""
    return (
        f"{samples.position} jumps {'; '.join(lines)}{more}: an index pulse or lost counts; what "
        "follows is joined on where the motion would have been"
    )


def _take_fresh(samples: Samples, name: str, how: Staleness, fresh: Sequence[Fresh]) -> None:
    """A channel on the line between its fresh readings."""
    times = samples.parts("time_s")
    samples.put(
        name,
        [np.interp(time, own.time, own.values) for time, own in zip(times, fresh, strict=True)],
    )
    samples.strides[name] = how.stride
    period = how.stride * float(np.median(np.concatenate([np.diff(time) for time in times])))
    samples.notices.append(
        f"{name} repeats: {how.share:.0%} of its rows hold the reading before, a fresh one comes "
        f"every {period:.4g} s: only the fresh ones are used, with lines between them"
    )


def _end_at_fresh(samples: Samples, fresh: Iterable[Sequence[Fresh]]) -> None:
    """Tests without the rows after the last fresh reading of a slow channel: what it would be
    there is unknown."""
    for readings in fresh:
        for test, own in enumerate(readings):
            label, rows = samples.tests[test]
            kept = int(own.rows[-1]) + 1
            if isinstance(rows, slice):
                stop = min(rows.stop, (rows.start or 0) + kept)
                samples.tests[test] = (label, slice(rows.start, stop))
            else:
                samples.tests[test] = (label, rows[:kept])


__all__ = ["Samples", "mend"]
