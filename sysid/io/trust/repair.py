"""Faults of a log, found in its own samples, and fixed where possible, with a notice.

In this order: a position whose counter wraps around is followed (`wraps`), channels whose readings
repeat are taken at their fresh ones (`stale`), a position that jumps within a sample is joined on
(`jumps`). Rows too far apart for what they sample (`slow`) are said.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sysid.io.channels import CHAMBER_PRESSURES, PRESSURES, SIDES
from sysid.io.motion import LINEAR, units_of
from sysid.io.trust.jumps import (
    Jump,
    Resolution,
    over_two_steps,
    resolution_of,
    runs_into_stop,
    without_jumps,
)
from sysid.io.trust.slow import RESOLVED_STEP, WANTED_ROWS, largest_step, rows_per_reversal
from sysid.io.trust.stale import Staleness, fresh_readings, staleness
from sysid.io.trust.wraps import counter_ranges, shown_range, without_wraps
from sysid.types import FloatArray

Rows = NDArray[np.int64] | slice
"""Rows of a file that are one test's."""

_JOINED = "an index pulse or lost counts; what follows is shifted to continue the motion"
_DOUBTFUL = (
    "over two rows, as an index pulse or lost counts do in a log that was resampled, or a slip; "
    "nothing is changed: exclude these rows if nothing slips there"
)
# Named one by one in a notice.
_NAMED = 3


def row_of(rows: Rows, index: int) -> int:
    """The row of the file that is a test's row `index`."""
    return (rows.start or 0) + index if isinstance(rows, slice) else int(rows[index])


@dataclass
class RepairedFile:
    """A file's samples by tests while their faults are fixed.

    `columns` (n,) each by name, SI; `tests`: (label, rows) of those that have all of them;
    `position` names its channel, `count` is the step of its counter where the file holds one,
    `declared` the step that the rig file declares; `place` names a row of the file.
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

    def samples(self, name: str) -> FloatArray:
        """A channel's samples of all tests, one after the other."""
        return np.concatenate(self.parts(name))

    def put(self, name: str, parts: Sequence[FloatArray]) -> None:
        """Replace a channel's samples, test by test."""
        column = np.array(self.columns[name], dtype=float)
        for (_, rows), values in zip(self.tests, parts, strict=True):
            column[rows] = values
        self.columns[name] = column

    def where(self, test: int, row: int) -> str:
        """ "line 17 (test 2, 1.8 s)" of a row of a test."""
        label, rows = self.tests[test]
        number = row_of(rows, row)
        seconds = f"{self.columns['time_s'][number]:.6g} s"
        return f"{self.place(number)} ({f'test {label}, ' if label else ''}{seconds})"


@dataclass
class Fresh:
    """A test's fresh readings of a channel: rows (m,), of which the first may be before the test's
    own, times (m,) s, and values (m,)."""

    rows: FloatArray
    time: FloatArray
    values: FloatArray


def repair(file: RepairedFile) -> None:
    """Fix wraps, repeated readings and jumps, in place; report rows that are too far apart.

    A file whose time does not increase, which is refused elsewhere, is left as it is.
    """
    if any(np.any(np.diff(time) <= 0.0) for time in file.parts("time_s")):
        return
    if file.position in file.columns:
        _follow(file)
    names = [n for n in (file.position, *PRESSURES) if n in file.columns]
    slow = {name: how for name in names if (how := staleness(file.parts(name))) is not None}
    fresh = {name: _fresh(file, name, how.stride) for name, how in slow.items()}
    if file.position in file.columns:
        _join_on(file, fresh.get(file.position))
    for name, how in slow.items():
        _take_fresh(file, name, how, fresh[name])
    _end_at_fresh(file, fresh.values())
    file.notices += _too_slow(file)


def _follow(file: RepairedFile) -> None:
    """A position over the wraps of its counter."""
    name = file.position
    counts, before = _counts(file), file.parts(name)
    ranges = counter_ranges(counts, is_angle=name == "theta_rad")
    parts, wraps = without_wraps(before, ranges)
    if wraps is None:
        ranges = shown_range(before, counts, units_of(name == LINEAR.position_channel).position)
        parts, wraps = without_wraps(before, ranges)
    if wraps is None:
        return
    times = len(wraps.rows)
    file.put(name, parts)
    file.notices.append(
        f"{name} wraps around at {ranges[wraps.range]} {times} time{'s' * (times > 1)}, first in "
        f"{file.where(*wraps.rows[0])}: it is unwrapped"
    )


def _counts(file: RepairedFile) -> list[float]:
    """Candidates for one count of the position."""
    if file.count is not None:
        return [file.count]
    shown = resolution_of(file.samples(file.position))
    found = [shown.step] if shown.is_whole else []
    return found if file.declared is None else [*found, file.declared]


def _fresh(file: RepairedFile, name: str, stride: float) -> list[Fresh]:
    """A channel's fresh readings, test by test."""
    found = []
    for time, values in zip(file.parts("time_s"), file.parts(name), strict=True):
        rows, readings = fresh_readings(values, stride)
        times = np.interp(rows, np.arange(len(time)), time)
        times += np.minimum(rows, 0.0) * np.median(np.diff(time))
        found.append(Fresh(rows, times, readings))
    return found


def _join_on(file: RepairedFile, fresh: list[Fresh] | None) -> None:
    """A position after its jumps; of a slow sensor its fresh readings, in place."""
    name = file.position
    parts = file.parts(name)
    resolution = _resolution(file)
    count = resolution.step if math.isfinite(resolution.step) else 0.0
    ends = min(float(p.min()) for p in parts), max(float(p.max()) for p in parts)
    found: list[tuple[int, Jump]] = []
    doubtful: list[tuple[int, Jump]] = []
    for test, (time, values) in enumerate(zip(file.parts("time_s"), parts, strict=True)):
        if fresh is None:
            parts[test], jumps = without_jumps(time, values, resolution)
            two = over_two_steps(time, parts[test], resolution)
            doubtful += [
                (test, jump) for jump in two if not runs_into_stop(parts[test], jump, ends, count)
            ]
        else:
            own = fresh[test]
            own.values, jumps = without_jumps(own.time, own.values, resolution)
            jumps = [replace(jump, row=max(0, int(own.rows[jump.row]))) for jump in jumps]
        found += [(test, jump) for jump in jumps]
    if found:
        file.put(name, parts)
        file.notices.append(_jumps_line(file, found, _JOINED))
    if doubtful:
        file.notices.append(_jumps_line(file, doubtful, _DOUBTFUL))


def _resolution(file: RepairedFile) -> Resolution:
    if file.count is not None:
        return Resolution(file.count, True)
    return resolution_of(file.samples(file.position), file.declared)


def _jumps_line(file: RepairedFile, found: Sequence[tuple[int, Jump]], what: str) -> str:
    """The notice on all jumps of a file; `what` they are taken for."""
    si = units_of(file.position == LINEAR.position_channel).position
    small = f"m{si}"
    lines = []
    for test, jump in found[:_NAMED]:
        usual = f"{jump.usual_speed:.3g} {si}/s" if jump.usual_speed else "rests"
        verb = "the motion around it has " if jump.usual_speed else "the motion around it "
        lines.append(
            f"by {1e3 * jump.size:.4g} {small} in {file.where(test, jump.row)}: "
            f"{jump.speed:.3g} {si}/s, where {verb}{usual}"
        )
    more = f", and {len(found) - _NAMED} more times" if len(found) > _NAMED else ""
    return f"{file.position} jumps {'; '.join(lines)}{more}: {what}"


def _take_fresh(file: RepairedFile, name: str, how: Staleness, fresh: Sequence[Fresh]) -> None:
    """A channel on the curve through its fresh readings.

    A position has a speed that changes steadily: a spline, where lines would round off what
    accelerates it. A pressure turns within a sample where a valve switches: lines.
    """
    times = file.parts("time_s")
    is_smooth = name == file.position
    between = _on_spline if is_smooth else _on_lines
    file.put(name, [between(t, own) for t, own in zip(times, fresh, strict=True)])
    file.strides[name] = how.stride
    period = how.stride * float(np.median(np.concatenate([np.diff(time) for time in times])))
    file.notices.append(
        f"{name} repeats: {how.share:.0%} of its rows hold the reading before, a fresh one comes "
        f"every {period:.4g} s: only the fresh ones are used, with "
        f"{'a spline through' if is_smooth else 'lines between'} them"
    )


def _on_lines(time: FloatArray, fresh: Fresh) -> FloatArray:
    """At `time` (n,) s on the lines between fresh readings; the last one holds."""
    return np.asarray(np.interp(time, fresh.time, fresh.values))


def _on_spline(time: FloatArray, fresh: Fresh) -> FloatArray:
    """At `time` (n,) s on the cubic spline through fresh readings; the last one holds."""
    if len(fresh.time) < 2:
        return _on_lines(time, fresh)
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(fresh.time, fresh.values)(np.minimum(time, fresh.time[-1])))


def _end_at_fresh(file: RepairedFile, fresh: Iterable[Sequence[Fresh]]) -> None:
    """Tests without the rows after the last fresh reading of a slow channel: what it would be
    there is unknown."""
    for readings in fresh:
        for test, own in enumerate(readings):
            label, rows = file.tests[test]
            kept = int(own.rows[-1]) + 1
            if isinstance(rows, slice):
                stop = min(rows.stop, (rows.start or 0) + kept)
                file.tests[test] = (label, slice(rows.start, stop))
            else:
                file.tests[test] = (label, rows[:kept])


def _too_slow(file: RepairedFile) -> Iterator[str]:
    """Notices on what rows too far apart, or readings of a slow sensor, do not resolve."""
    times = file.parts("time_s")
    period = float(np.median(np.concatenate([np.diff(time) for time in times])))
    name = file.position
    if name in file.columns:
        apart = max(1, round(file.strides.get(name, 1.0)))
        count = _resolution(file).step
        rows = rows_per_reversal([part[::apart] for part in file.parts(name)], count)
        if rows is not None:
            inertia = "mass" if name == "position_m" else "inertia"
            yield (
                f"{name} reverses every {rows:.2g} readings, {apart * period:.3g} s apart: too "
                f"few for this motion: friction and {inertia} from it are biased by "
                f"what happens in between; "
                f"log every {_rounded(rows * apart * period / WANTED_ROWS)} s"
            )
    for side, name in zip(SIDES, CHAMBER_PRESSURES, strict=True):
        if name not in file.columns:
            continue
        apart = max(1, round(file.strides.get(name, 1.0)))
        valves = [v for v in file.columns if v.startswith((f"valve_{side}", f"duty_{side}"))]
        active = {i for v in valves for i, on in enumerate(file.parts(v)) if np.any(on)}
        parts = [p[::apart] for i, p in enumerate(file.parts(name)) if i in active]
        share = largest_step(parts, [t[::apart] for i, t in enumerate(times) if i in active])
        if share is not None:
            yield (
                f"{name} changes by {share:.0%} of its range from one reading to the next, "
                f"{apart * period:.3g} s apart: too few to resolve how the chamber fills and "
                "empties, so flows and delays of its valve are biased; log at least "
                f"{math.ceil(share / RESOLVED_STEP)} times as often"
            )


def _rounded(period: float) -> str:
    """A period (s) to one digit, downwards."""
    scale = 10.0 ** math.floor(math.log10(period))
    return f"{math.floor(period / scale) * scale:.1g}"


__all__ = ["RepairedFile", "Rows", "repair", "row_of"]
