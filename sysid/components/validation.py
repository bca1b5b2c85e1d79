"""A component of the user's own on whole tests, open loop: how well it predicts each output."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sysid.components.definition import DynamicComponent
from sysid.components.own_tests import law_in, tests_of
from sysid.components.parts import OwnPart
from sysid.diagnosis.bench.component import Law
from sysid.io.campaign import Campaign
from sysid.io.logs import Log, Trial
from sysid.parameters import Bundle
from sysid.types import FloatArray, Progress, no_progress
from sysid.validation.results import (
    HORIZONS_S,
    ChannelResult,
    Errors,
    HorizonError,
    LogResult,
    TestResult,
    ValidationResult,
    pooled_channels,
)

_NONE = np.zeros(0)


def validate_own(
    campaign: Campaign, bundle: Bundle, *, progress: Progress = no_progress
) -> ValidationResult:
    """Simulate (a static component: predict) every test of a campaign as a whole, and compare.

    Each from its own measured start. The valve model's place holds the component's name. Raises
    InputError for logs, code or effects that cannot be used, NotIdentifiedError where the bundle
    lacks the law.
    """
    tests = tests_of(campaign, bundle)
    part, law = law_in(tests, bundle)
    noise = {name: part.noise_of(name, law) for name in part.definition.outputs}
    logs = []
    for use, log in tests.logs:
        progress(f"simulating {log.path.name}")
        logs.append(_log(part, law, log, campaign.name_of(log.path), use, noise))
    return ValidationResult(tuple(logs), tests.notices)


def _log(
    part: OwnPart, law: Law, log: Log, name: str, use: str, noise: dict[str, float]
) -> LogResult:
    pieces = [(trial, 0, len(trial)) for trial in log.trials]
    found = part.open_loop(law, pieces)
    tests = tuple(
        _test(part, law, (name, log.path), use, trial, shown, noise)
        for trial, shown in zip(log.trials, found, strict=True)
    )
    return LogResult(
        name=name,
        file=log.path.name,
        sha256=log.sha256,
        kind=part.loaded.kind,
        use=use,
        model=part.loaded.name,
        channels=pooled_channels(tests),
        tests=tests,
    )


def _test(
    part: OwnPart,
    law: Law,
    log: tuple[str, Path],
    use: str,
    trial: Trial,
    shown: dict[str, FloatArray],
    noise: dict[str, float],
) -> TestResult:
    horizons = {h: _horizon(part, law, trial, h) for h in HORIZONS_S}
    channels = {
        name: ChannelResult(
            errors=Errors.of(trial[name], trial[name] - values),
            noise_floor=noise[name],
            horizons=tuple(horizons[h][name] for h in HORIZONS_S),
        )
        for name, values in shown.items()
    }
    return TestResult(
        log=log[0],
        file=log[1].name,
        kind=part.loaded.kind,
        use=use,
        test=trial.label,
        model=part.loaded.name,
        time=trial.since_start,
        measured={name: trial[name] for name in shown},
        simulated=shown,
        counted=len(trial),
        channels=channels,
        growth={},
        initial=_NONE,
        initial_std=_NONE,
    )


def _horizon(part: OwnPart, law: Law, trial: Trial, horizon: float) -> dict[str, HorizonError]:
    """Errors of simulations over so many seconds, each from its own start; a law has no start."""
    outputs = part.definition.outputs
    rows = round(horizon / trial.period)
    starts: Sequence[int] = range(0, len(trial) - rows, max(rows, 1))
    dynamic = isinstance(part.definition, DynamicComponent)
    if not dynamic or rows < 2 or not starts:
        return {name: HorizonError(horizon, None, 0) for name in outputs}
    pieces = [(trial, k, k + rows) for k in starts]
    found = part.open_loop(law, pieces)
    return {
        name: HorizonError(
            horizon,
            float(
                np.sqrt(
                    np.mean(
                        [
                            np.mean((trial[name][k : k + rows] - one[name]) ** 2)
                            for k, one in zip(starts, found, strict=True)
                        ]
                    )
                )
            ),
            len(pieces),
        )
        for name in outputs
    }


__all__ = ["validate_own"]
