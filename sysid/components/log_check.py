"""What the logs of a component of the user's own are good for: `sysid check --component`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sysid import signals
from sysid.checks.friction import Identification
from sysid.checks.log_check import ChannelCheck, LogCheck
from sysid.components.campaign import (
    OwnTests,
    loaded_in,
    missing_column,
    out_of_range,
    training_part,
)
from sysid.components.loading import LoadedComponent
from sysid.diagnosis.bench.component import Law
from sysid.estimation.nonlinear import central_jacobian_of_all
from sysid.io.campaign import Campaign
from sysid.io.logs import Log
from sysid.types import FloatArray

_GAP_PERIODS = 1.5
_FEWEST_SAMPLES = 16
# Below this share of the most sensitive parameter's a parameter does not show.
_SILENT = 1e-8
# Smallest singular value of the Jacobian, columns of length one, at which none depends on others.
_TIED = 1e-4


def check_own(campaign: Campaign) -> list[LogCheck]:
    """Check every log of a campaign of a component of the user's own.

    A column that is missing, constant, or beyond its declared range is a line of `excitation` or of
    the notices; what the training logs identify stands with each of these. Raises InputError where
    a file cannot be read.
    """
    loaded = loaded_in(campaign)
    read = [(entry, campaign.read(entry)) for entry in campaign.logs]
    whole = [not _missing(log, loaded) for _, log in read]
    fitted = [
        trial
        for (entry, log), complete in zip(read, whole, strict=True)
        if entry.use == "fit" and complete
        for trial in log.trials
    ]
    tests = OwnTests(loaded, tuple(fitted), (), ())
    identifies = tuple(_identified(tests)) if fitted else ()
    checks = []
    for (entry, log), complete in zip(read, whole, strict=True):
        own = identifies if entry.use == "fit" and complete else ()
        checks.append(replace(_check(log, loaded), identifies=own, use=entry.use))
    return checks


def _missing(log: Log, loaded: LoadedComponent) -> list[str]:
    absent = (n for n in loaded.columns if n not in log.trials[0])
    return [str(missing_column(log, n, loaded.columns[n])) for n in absent]


def _check(log: Log, loaded: LoadedComponent) -> LogCheck:
    steps = np.concatenate([np.diff(t.time) for t in log.trials])
    period = float(np.median(steps))
    late = steps > _GAP_PERIODS * period
    missing = _missing(log, loaded)
    strange = [] if missing else out_of_range(loaded, log.trials)
    names = [n for n in loaded.columns if n in log.trials[0]]
    return LogCheck(
        file=str(log.path),
        kinds={loaded.kind: len(log.trials)},
        tests=len(log.trials),
        rows=sum(len(t) for t in log.trials),
        duration_s=float(sum(t.time[-1] - t.time[0] for t in log.trials)),
        period_s=period,
        jitter_s=float(np.std(steps[~late])),
        gaps=int(np.count_nonzero(late)),
        longest_gap_s=float(np.max(steps)) if late.any() else 0.0,
        channels=tuple(_channel(log, n, n in loaded.definition.outputs) for n in names),
        excitation=tuple(_still(log, loaded, names)),
        identifies=(),
        notices=(*log.notices, *missing, *strange),
        declared=loaded.kind,
    )


def _channel(log: Log, name: str, is_measured: bool) -> ChannelCheck:
    parts = [t[name] for t in log.trials]
    values = np.concatenate(parts)
    quantum = signals.quantum(values)
    long = [p for p in parts if len(p) >= _FEWEST_SAMPLES]
    floors = [signals.noise_floor(p, quantum).noise for p in long]
    noise = float(np.median(floors)) if floors and is_measured else None
    return ChannelCheck(name, float(values.min()), float(values.max()), quantum, noise, 0.0, 0.0)


def _still(log: Log, loaded: LoadedComponent, names: Sequence[str]) -> Iterator[str]:
    """A line for each column that does not change."""
    for name in names:
        if all(np.ptp(t[name]) == 0.0 for t in log.trials):
            role = loaded.definition.columns[name].role
            why = "it excites nothing" if role == "input" else "the sensor shows nothing"
            yield f"{name} does not change: {why}"


def _identified(tests: OwnTests) -> Iterator[Identification]:
    """Which parameters the training logs tell at their starts, from the law's derivatives."""
    part = training_part(tests)
    own = part.parameters()
    every = range(len(part.tests))
    start = np.array([p.value for p in own])
    names = [p.name for p in own]

    def residuals(points: Sequence[FloatArray]) -> list[FloatArray]:
        laws = [Law(dict(zip(names, map(float, point), strict=True))) for point in points]
        return [np.concatenate(parts) for parts in part.residuals_of(laws, every)]

    jacobian = part.jacobian(Law(dict(zip(names, start.tolist(), strict=True))), every)
    sizes = np.array([p.size for p in own])
    if jacobian is None:
        lower, upper = np.array([p.lower for p in own]), np.array([p.upper for p in own])
        jacobian = central_jacobian_of_all(residuals, start, sizes, lower, upper)
    if not np.isfinite(jacobian).all():
        for name in names:
            yield Identification(name, False, "the law is not finite at the parameters' starts")
        return
    reach = np.linalg.norm(jacobian, axis=0) * sizes
    shows = reach > _SILENT * max(float(reach.max()), 1e-300)
    tied = _tied(jacobian, shows)
    for i, name in enumerate(names):
        others = [n for k, n in enumerate(names) if k in tied and k != i]
        if not shows[i]:
            yield Identification(name, False, f"no output depends on {name} in these tests")
        elif i in tied:
            yield Identification(name, False, f"acts only together with {' and '.join(others)}")
        else:
            yield Identification(name, True, f"the training logs, about its start {start[i]:g}")


def _tied(jacobian: FloatArray, shows: FloatArray) -> set[int]:
    """Columns that depend on one another."""
    place = np.flatnonzero(shows)
    if not place.size:
        return set()
    columns = jacobian[:, place] / np.linalg.norm(jacobian[:, place], axis=0)
    _, sizes, directions = np.linalg.svd(columns, full_matrices=False)
    weak = directions[sizes < _TIED * sizes[0]]
    return {int(place[i]) for row in weak for i in np.flatnonzero(np.abs(row) > 0.1)}


__all__ = ["check_own"]
