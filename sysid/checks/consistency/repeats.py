"""A recording that a campaign holds twice: under another name, in another format, cut or shifted.

Two recordings of one motion differ by their sensors' noise. Where all channels that two tests share
agree row by row, one is a copy of the other: it is no further evidence, and what is fitted to the
one is not held out in the other.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from sysid.checks.consistency.comparison import Contradiction
from sysid.io.campaign import CampaignLog
from sysid.io.channels import PRESSURES
from sysid.io.logs import Log, Trial
from sysid.io.rig import Rig
from sysid.types import FloatArray

# Rows that are looked up in the other test; fewer rows agree by chance.
_MATCHED_ROWS = 32
# Rounding of a file's digits and of its units, as a share of a channel's range.
_ROUNDED = 1e-5
# Share of the shorter test's rows that the other one holds.
_SHARED = 0.5


@dataclass(frozen=True)
class _Test:
    """A test, and the campaign's log that holds it."""

    entry: CampaignLog
    trial: Trial

    @property
    def name(self) -> str:
        return self.entry.file + (f", test {self.trial.label}" if self.trial.label else "")


def repeated_tests(logs: Sequence[tuple[CampaignLog, Log]], rig: Rig) -> Iterator[Contradiction]:
    """A notice for each log whose tests another log of the campaign holds too."""
    measured = (rig.position_channel, *PRESSURES)
    tests = [_Test(entry, trial) for entry, log in logs for trial in log.trials]
    found: dict[tuple[str, str], list[tuple[_Test, _Test]]] = {}
    for one, other in itertools.combinations(tests, 2):
        if one.entry.path == other.entry.path:
            continue
        # Of logs of one use, which may hold hundreds of tests, only whole copies.
        whole = one.entry.use == other.entry.use
        if _are_copies(one.trial, other.trial, measured, whole=whole):
            found.setdefault((one.entry.file, other.entry.file), []).append((one, other))
    for pairs in found.values():
        one, other = pairs[0]
        more = f" (and {len(pairs) - 1} more of its tests)" if len(pairs) > 1 else ""
        held = one.entry.use != other.entry.use
        yield Contradiction(
            other.entry.file,
            f"{other.name}: holds the samples of {one.name}{more}: "
            + ("what is fitted is not held out; " if held else "a copy is no further evidence; ")
            + "delete one of the [[log]]s",
        )


def _are_copies(one: Trial, other: Trial, measured: Sequence[str], *, whole: bool) -> bool:
    """Whether a test holds the samples of another; `whole`: from the first to the last."""
    if whole and len(one) != len(other):
        return False
    short, long = sorted((one, other), key=len)
    if short.is_readings or long.is_readings or len(short) < _MATCHED_ROWS:
        return False
    shared = [name for name in short.channels if name in long.channels]
    clearest = max(
        (name for name in shared if name in measured),
        key=lambda name: len(np.unique(short[name][: 8 * _MATCHED_ROWS])),
        default=None,
    )
    if clearest is None:
        return False
    return any(
        all(_agree(short[name], long[name], shift) for name in shared)
        for shift in ([0] if whole else _shifts(short[clearest], long[clearest]))
    )


def _shifts(short: FloatArray, long: FloatArray) -> list[int]:
    """By how many rows `long` (m,) may be ahead of `short` (n,): where it holds rows of its middle
    and of its quarters, in which it moves most. At most a few."""
    found: list[int] = []
    for part in np.array_split(np.arange(len(short) - _MATCHED_ROWS + 1), 3):
        if not part.size:
            continue
        windows = sliding_window_view(short, _MATCHED_ROWS)[part]
        at = int(part[np.argmax(np.ptp(windows, axis=1))])
        window = short[at : at + _MATCHED_ROWS]
        if np.ptp(window) == 0.0:
            continue
        limit = _ROUNDED * max(np.ptp(short), np.max(np.abs(window)))
        ends = np.abs(long[: len(long) - _MATCHED_ROWS + 1] - window[0]) <= limit
        ends &= np.abs(long[_MATCHED_ROWS - 1 :] - window[-1]) <= limit
        found += [int(row) - at for row in np.flatnonzero(ends)[:50]]
    return sorted(set(found))


def _agree(short: FloatArray, long: FloatArray, shift: int) -> bool:
    """Whether the rows that two channels share under a shift are the same."""
    first, last = max(0, -shift), min(len(short), len(long) - shift)
    if last - first < max(_MATCHED_ROWS, _SHARED * len(short)):
        return False
    own, others = short[first:last], long[first + shift : last + shift]
    limit = _ROUNDED * max(float(np.ptp(own)), float(np.max(np.abs(own))))
    return bool(np.max(np.abs(own - others)) <= limit)


__all__ = ["repeated_tests"]
