"""Bands on open-loop motion: where a test's samples are expected, by all that is not known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.io.channels import CHAMBER_PRESSURES
from sysid.io.rig import Rig
from sysid.io.samples import Trial
from sysid.parameters import Bundle
from sysid.plant.ports import Model
from sysid.plant.sensors import measured_channels, true_start
from sysid.plant.trials import inputs_from_trial, starts_on_supply
from sysid.refinement.draws import PosteriorDraws, with_test_scatter
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
    names = [n for n in (rig.position_channel, *CHAMBER_PRESSURES) if n in shown[0]]
    return {name: _band(np.array([s[name] for s in shown]), name, rig, rng) for name in names}


def _band(values: FloatArray, name: str, rig: Rig, rng: np.random.Generator) -> MotionBand:
    """The band of simulated values (draws, n) with a sensor's noise and resolution."""
    step, noise = rig.encoder_step, rig.sensors.pressure_noise_pa
    if name == rig.position_channel and step is not None:
        values = values + step * rng.uniform(-0.5, 0.5, values.shape)
    elif name != rig.position_channel and noise is not None:
        values = values + noise * rng.standard_normal(values.shape)
    ended = values[np.isfinite(values).all(axis=1)]
    tail = 0.5 * (1.0 - SHARE)
    low, high = np.quantile(ended, [tail, 1.0 - tail], axis=0, method="weibull")
    return MotionBand(low, high)


__all__ = ["SHARE", "MotionBand", "open_loop_bands"]
