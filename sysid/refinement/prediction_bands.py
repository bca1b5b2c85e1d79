"""Bands on open-loop motion: where a test's samples are expected, by all that is not known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.blocks.tables import Table, table
from sysid.errors import input_error
from sysid.io.campaign import SIMULATED_KINDS, Campaign
from sysid.io.channels import LOG_COLUMNS, simulated_channels
from sysid.io.rig import Rig
from sysid.io.samples import Trial
from sysid.parameters import Bundle
from sysid.plant.ports import Model
from sysid.plant.sensors import measured_channels, true_start
from sysid.plant.trials import inputs_from_trial, starts_on_supply
from sysid.recording.motion_tests import prepare_all
from sysid.refinement.draws import PosteriorDraws, posterior_draws, with_test_scatter
from sysid.refinement.refine import SEGMENT_S
from sysid.types import FloatArray, Progress, no_progress

SHARE = 0.9
"""Share of the samples that a band is meant to hold."""


@dataclass(frozen=True)
class MotionBand:
    """`low` and `high` (n,) of a channel: a sample lies between them with a probability of 90 %."""

    low: FloatArray
    high: FloatArray

    def holds(self, values: FloatArray) -> FloatArray:
        """(n,): whether each of these samples lies in it."""
        return np.asarray((values >= self.low) & (values <= self.high))


def open_loop_bands(
    bundle: Bundle,
    rig: Rig,
    drawn: PosteriorDraws,
    trials: Sequence[Trial],
    seed: int,
    progress: Progress = no_progress,
) -> list[Mapping[str, MotionBand]]:
    """The bands of each test's channels, from simulations of the drawn models.

    A band holds the errors of the bundle's numbers, friction's scatter from test to test, and the
    noise and resolution of the sensors that the rig file declares; its ends are quantiles for a
    further draw (`numpy.quantile`, "weibull"). Position and pressures as a log has them.
    """
    found = []
    for number, trial in enumerate(trials):
        progress(f"drawing test {trial.label or number + 1} of {len(trials)}")
        models = with_test_scatter(bundle, drawn.models, seed + number)
        found.append(_bands(trial, rig, models, np.random.default_rng([seed, number, 2])))
    return found


def _bands(
    trial: Trial, rig: Rig, models: Sequence[Model], rng: np.random.Generator
) -> Mapping[str, MotionBand]:
    from sysid.plant.simulator import simulate

    start = inputs_from_trial(trial, rig, starts_on_supply(trial, rig))
    inputs = [true_start(start, rig.position_channel, model) for model in models]
    # A draw whose run has no end is not counted; NaN in it.
    runs = simulate(inputs, models, nan_if_endless=True)
    shown = [
        measured_channels(run, rig.position_channel, model)
        for run, model in zip(runs, models, strict=True)
    ]
    names = [n for n in simulated_channels(rig.position_channel) if n in shown[0]]
    return {name: _band(np.array([s[name] for s in shown]), name, rig, rng) for name in names}


def _band(values: FloatArray, name: str, rig: Rig, rng: np.random.Generator) -> MotionBand:
    """The band of simulated values (draws, n) with a sensor's noise and resolution."""
    step, noise = rig.encoder_step, rig.sensors.pressure_noise_pa
    if name == rig.position_channel and step is not None:
        values = values + step * rng.uniform(-0.5, 0.5, values.shape)
    elif LOG_COLUMNS[name].is_pressure and noise is not None:
        values = values + noise * rng.standard_normal(values.shape)
    ended = values[np.isfinite(values).all(axis=1)]
    tail = 0.5 * (1.0 - SHARE)
    low, high = np.quantile(ended, [tail, 1.0 - tail], axis=0, method="weibull")
    return MotionBand(low, high)


@dataclass(frozen=True)
class LogCoverage:
    """A log's `share` of samples within the bands, by channel, and its `use`."""

    file: str
    use: str
    share: Mapping[str, float]


@dataclass(frozen=True)
class BandCoverage:
    """How much of the motion logs lies in the bands of `draws` drawn models."""

    draws: int
    logs: tuple[LogCoverage, ...]
    notices: tuple[str, ...]

    def table(self) -> Table:
        """One row per log, in percent."""
        names = tuple(self.logs[0].share)
        rows = [
            (log.file, log.use, *(f"{100.0 * log.share[n]:.0f}" for n in names))
            for log in self.logs
        ]
        title = f"Samples in the {100 * SHARE:.0f} % band of {self.draws} draws, %"
        return table(title, ("log", "use", *names), rows)

    def to_json(self) -> dict[str, Any]:
        """The object `bands` that `sysid validate --draws --json` prints."""
        logs = [{"file": g.file, "use": g.use, "in_band": dict(g.share)} for g in self.logs]
        return {"draws": self.draws, "share": SHARE, "logs": logs}


def band_coverage(
    campaign: Campaign,
    bundle: Bundle,
    model: Model,
    draws: int,
    seed: int,
    progress: Progress = no_progress,
) -> BandCoverage:
    """The share of each motion log's samples in the bands about the bundle's model.

    Samples count until the arm comes near an end stop. Raises InputError without a motion log,
    NotIdentifiedError where nothing can be drawn.
    """
    rig = campaign.rig
    drawn = posterior_draws(bundle, rig, model, draws, seed)
    found, notices = [], list(drawn.notices())
    for entry in campaign.select(SIMULATED_KINDS, use=None):
        log = campaign.read(entry)
        tests, said = prepare_all(log.trials, entry.kind, rig, SEGMENT_S)
        notices += said
        bands = open_loop_bands(bundle, rig, drawn, [t.trial for t in tests], seed, progress)
        inside: dict[str, list[FloatArray]] = {}
        for test, own in zip(tests, bands, strict=True):
            for name in own.keys() & test.trial.channels.keys():
                held = own[name].holds(test.trial[name])
                inside.setdefault(name, []).append(held[: test.counted(test.whole)])
        share = {n: float(np.concatenate(inside[n]).mean()) for n in bands[0] if n in inside}
        found.append(LogCoverage(entry.file, entry.use, share))
    if not found:
        raise input_error(
            campaign.path, "lists no motion log to compare with bands", "add one, or omit --draws"
        )
    return BandCoverage(draws, tuple(found), tuple(dict.fromkeys(notices)))


__all__ = ["SHARE", "BandCoverage", "LogCoverage", "MotionBand", "band_coverage", "open_loop_bands"]
