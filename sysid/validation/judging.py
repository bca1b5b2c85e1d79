"""A simulated test compared with the measurement: errors, structure, growth with the horizon."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sysid.io.campaign import CampaignLog
from sysid.io.channels import simulated_channels
from sysid.io.rig import Rig
from sysid.recording.motion_tests import MotionTest
from sysid.types import FloatArray
from sysid.validation import residual_tests
from sysid.validation.results import (
    HORIZONS_S,
    ChannelResult,
    Errors,
    HorizonError,
    TestResult,
)


def judged(
    test: MotionTest,
    entry: CampaignLog,
    log: str,
    rig: Rig,
    model: str,
    whole: FloatArray,
    parts: Sequence[FloatArray],
) -> TestResult:
    """The result of a test of a log of this name, simulated with a valve model.

    `whole` (3, rows) is the simulation of the whole test: position and pressures; `parts` those
    of its segments.
    """
    names = simulated_channels(rig.position_channel)
    counted = test.counted(test.whole)
    rows = slice(test.whole.start, test.whole.stop)
    inputs = _named_inputs(test, rig, rows)
    channels, growth, logged = {}, {}, []
    for i, name in enumerate(names):
        measured = test.measured[i, rows]
        if np.isnan(measured).any():
            continue
        logged.append(i)
        residual = (measured - whole[i])[:counted]
        errors = _segment_errors(test, parts, i)
        growth[name] = _growth(errors, test)
        channels[name] = ChannelResult(
            errors=Errors.of(measured[:counted], residual),
            noise_floor=float(test.noise.total[i]),
            horizons=tuple(_horizon(errors, h, test.period) for h in HORIZONS_S),
            whiteness=residual_tests.whiteness_test(residual),
            inputs=residual_tests.cross_correlation_test(
                residual, {k: u[:counted] for k, u in inputs.items()}
            ),
        )
    return TestResult(
        log=log,
        file=entry.path.name,
        kind=entry.kind,
        use=entry.use,
        test=test.label,
        model=model,
        time=test.since_start[rows],
        measured={names[i]: test.measured[i, rows] for i in logged},
        simulated={names[i]: whole[i] for i in logged},
        counted=counted,
        channels=channels,
        growth=growth,
        initial=_finite_state(test, rig),
        initial_std=test.whole.state.std,
    )


def _finite_state(test: MotionTest, rig: Rig) -> FloatArray:
    """The start state; a chamber that is not logged starts at the atmosphere."""
    atmosphere = rig.air.atmospheric_pressure_pa if rig.air else math.nan
    return np.nan_to_num(test.whole.state.values, nan=atmosphere)


def _named_inputs(test: MotionTest, rig: Rig, rows: slice) -> dict[str, FloatArray]:
    """The commands in these rows, by name."""
    prefix = "duty" if test.pulsed else "valve"
    inputs = {rig.effort_channel: test.commanded[rows]}
    for name, command in zip(test.rig.valve_names, test.commands, strict=False):
        if command is not None:
            inputs[f"{prefix}_{name}"] = command[rows]
    return inputs


def _segment_errors(
    test: MotionTest, parts: Sequence[FloatArray], channel: int
) -> list[FloatArray]:
    """Residual of each segment over its counted rows; none for one that starts at a stop."""
    errors = []
    for segment, simulated in zip(test.segments, parts, strict=True):
        rows = test.counted(segment)
        measured = test.measured[channel, segment.start : segment.start + rows]
        errors.append(measured - simulated[channel, :rows])
    return errors


def _horizon(errors: Sequence[FloatArray], horizon: float, period: float) -> HorizonError:
    """Over segments that reach the horizon (those cut by an end stop do not)."""
    rows = round(horizon / period)
    squares = [float(np.mean(e[:rows] ** 2)) for e in errors if len(e) >= rows > 0]
    if not squares:
        return HorizonError(horizon, None, 0)
    return HorizonError(horizon, math.sqrt(float(np.mean(squares))), len(squares))


def _growth(errors: Sequence[FloatArray], test: MotionTest) -> FloatArray:
    rows = round(max(HORIZONS_S) / test.period)
    whole = [e for e in errors if len(e) >= rows]
    return np.sqrt(np.mean(np.square(whole), axis=0)) if whole else np.zeros(0)


__all__ = ["judged"]
