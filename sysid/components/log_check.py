"""What the logs of a component of the user's own are good for: `sysid check --component`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid import signals
from sysid.checks.campaign_check import CampaignCheck, merged
from sysid.checks.friction import Identification
from sysid.checks.log_check import ChannelCheck, LogCheck
from sysid.components.loading import LoadedComponent
from sysid.components.own_tests import loaded_in, missing_column, out_of_range, part_of
from sysid.components.parts import OwnPart, scales_of
from sysid.diagnosis.bench.component import Law
from sysid.estimation.linear import NORMAL
from sysid.estimation.nonlinear import Parameter, central_jacobian_of_all
from sysid.io.campaign import Campaign
from sysid.io.logs import Log, Trial
from sysid.types import FloatArray

# Below this share of the most sensitive parameter's a parameter does not show.
_SILENT = 1e-8
# Smallest singular value of the Jacobian, columns of length one, at which none depends on others.
_TIED = 1e-4


def check_own(campaign: Campaign) -> CampaignCheck:
    """Check every log of a campaign of a component of the user's own, and all training logs.

    A column that is missing, constant, or beyond its declared range is a line of `excitation` or of
    the notices; each log says what it identifies by itself. Raises InputError where a file cannot
    be read.
    """
    loaded = loaded_in(campaign)
    read = [(entry, campaign.read(entry)) for entry in campaign.logs]
    checks = [replace(_check(log, loaded), use=entry.use) for entry, log in read]
    complete = [k for k, (_, log) in enumerate(read) if not _missing(log, loaded)]
    fitted = [k for k in complete if read[k][0].use == "fit"]
    groups = [[k] for k in complete] + ([fitted] if fitted else [])
    noise = {n: _noise_of(n, [checks[k] for k in complete]) for n in loaded.definition.outputs}
    found = _identified(loaded, [log.trials for _, log in read], groups, fitted or complete, noise)
    for k, own in zip(complete, found, strict=False):
        checks[k] = replace(checks[k], identifies=own)
    entries = [campaign.logs[k] for k in fitted]
    alone = [checks[k].identifies for k in fitted]
    joint = {item.parameter: item for item in found[-1]} if fitted else {}
    answers = tuple(merged(entries, alone, joint))
    return CampaignCheck(str(campaign.path), campaign.logs, tuple(checks), answers)


def _noise_of(name: str, checks: Sequence[LogCheck]) -> float:
    """The median error of one sample of an output, in its unit; 0 where no log shows any."""
    own = [c.sample_std for check in checks for c in check.channels if c.name == name]
    known = [std for std in own if std is not None]
    return float(np.median(known)) if known else 0.0


def _missing(log: Log, loaded: LoadedComponent) -> list[str]:
    absent = (n for n in loaded.columns if n not in log.trials[0])
    return [str(missing_column(log, n, loaded.columns[n])) for n in absent]


def _check(log: Log, loaded: LoadedComponent) -> LogCheck:
    steps = np.concatenate([np.diff(t.time) for t in log.trials])
    period = float(np.median(steps))
    late = steps > signals.SAMPLE_MISSING * period
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
        excluded=log.excluded,
    )


def _channel(log: Log, name: str, is_measured: bool) -> ChannelCheck:
    parts = [t[name] for t in log.trials]
    values = np.concatenate(parts)
    quantum = signals.quantum(values)
    long = [p for p in parts if len(p) >= signals.FEWEST_FOR_NOISE]
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


def _identified(
    loaded: LoadedComponent,
    trials: Sequence[Sequence[Trial]],
    groups: Sequence[Sequence[int]],
    scaled_by: Sequence[int],
    noise: Mapping[str, float],
) -> list[tuple[Identification, ...]]:
    """Which parameters each group of logs identifies at their starts, from the law's derivatives.

    `trials` are those of each log, `groups` places among them; `scaled_by` the logs whose outputs'
    spreads are the scales, `noise` the error of one sample of each output.
    """
    if not groups:
        return []
    used = sorted({k for group in groups for k in group})
    # A log is cut into stretches or taken whole as it is in a fit of all.
    part = part_of(
        loaded,
        [trial for k in used for trial in trials[k]],
        scales_of(loaded, [trial for k in scaled_by for trial in trials[k]]),
    )
    own = part.parameters()
    jacobian = _jacobian(part)
    names = loaded.definition.outputs
    errors = [noise[n] / scale for n, scale in zip(names, part.scales, strict=True)]
    log_of = {id(trial): k for k in used for trial in trials[k]}
    logs, weights = [], []
    for stretch, one in zip(part.stretches, part.shown(range(len(part.tests))), strict=True):
        for name, error in zip(names, errors, strict=True):
            logs.append(np.full(len(one[name]), log_of[id(stretch.trial)]))
            weights.append(np.full(len(one[name]), 1.0 / error if error else np.nan))
    rows, weight = np.concatenate(logs), np.concatenate(weights)
    return [
        tuple(_told(own, jacobian[inside], weight[inside]))
        for inside in (np.isin(rows, list(group)) for group in groups)
    ]


def _jacobian(part: OwnPart) -> FloatArray:
    """Derivatives of the residuals by the parameters at their starts, (n, p)."""
    own, every = part.parameters(), range(len(part.tests))
    names, start = [p.name for p in own], np.array([p.value for p in own])

    def residuals(points: Sequence[FloatArray]) -> list[FloatArray]:
        laws = [Law(dict(zip(names, map(float, point), strict=True))) for point in points]
        return [np.concatenate(parts) for parts in part.residuals_of(laws, every)]

    found = part.jacobian(Law(dict(zip(names, start.tolist(), strict=True))), every)
    if found is not None:
        return found
    sizes = np.array([p.size for p in own])
    lower, upper = np.array([p.lower for p in own]), np.array([p.upper for p in own])
    return central_jacobian_of_all(residuals, start, sizes, lower, upper)


def _told(
    own: Sequence[Parameter], jacobian: FloatArray, weight: FloatArray
) -> Iterator[Identification]:
    """Each parameter by derivatives (n, p) and one over the errors of the rows (n,), NaN where
    these are not known."""
    names, sizes = [p.name for p in own], np.array([p.size for p in own])
    if not np.isfinite(jacobian).all():
        for name in names:
            yield Identification(name, False, "the law is not finite at the parameters' starts")
        return
    reach = np.linalg.norm(jacobian, axis=0) * sizes
    shows = reach > _SILENT * max(float(reach.max()), 1e-300)
    tied = _tied(jacobian, shows)
    stds = _expected(jacobian * weight[:, None], [i for i in range(len(own)) if shows[i]])
    for i, p in enumerate(own):
        others = [n for k, n in enumerate(names) if k in tied and k != i]
        if not shows[i]:
            yield Identification(p.name, False, f"no output depends on {p.name} in these tests")
        elif i in tied:
            yield Identification(p.name, False, f"is indistinguishable from {' and '.join(others)}")
        else:
            yield _by_error(p, stds.get(i))


def _by_error(p: Parameter, std: float | None) -> Identification:
    """A parameter that shows by itself, by the standard error that the sensors' noise leaves."""
    at = f"about its start {p.value:g} {p.unit}".rstrip()
    if std is None:
        return Identification(p.name, True, at)
    size = f"expected standard error {std:.2g} {p.unit}".rstrip()
    return Identification(p.name, NORMAL * std < p.size, f"{size}, {at}")


def _expected(weighted: FloatArray, places: Sequence[int]) -> dict[int, float]:
    """Standard errors from the information of weighted derivatives (n, p), those of `places`.

    By the Cramer-Rao bound for white noise; empty where a weight is not known.
    """
    if not places or not np.isfinite(weighted).all():
        return {}
    columns = weighted[:, list(places)]
    norms = np.linalg.norm(columns, axis=0)
    inverse = np.linalg.pinv(columns / norms)
    return {i: float(np.linalg.norm(inverse[k]) / norms[k]) for k, i in enumerate(places)}


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
