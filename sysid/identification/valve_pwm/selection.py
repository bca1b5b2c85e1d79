"""Which tests of a log identify a pulsed valve's mean flow, and why the others do not.

A test that cannot be trusted is excluded with a notice that says why; data are never corrected.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid import signals
from sysid.identification.held_volume import volume_count
from sysid.identification.valve_pwm.pulse_line import deviating_period
from sysid.identification.valve_pwm.remarks import Remarks
from sysid.identification.valve_pwm.samples import PwmTest, pulse_block, settled_after
from sysid.identification.valve_pwm.supply import (
    consistent_supply,
    start_pressure,
    with_seen_supply,
)
from sysid.io.channels import SIDES
from sysid.io.logs import Trial
from sysid.io.rig import HELD_SHARE, Rig
from sysid.io.trial_kind import is_one_duty
from sysid.plant.base import chamber_volume
from sysid.surfaces.domain import SAME_SUPPLY
from sysid.types import BoolArray, FloatArray

# Start of a test: within this share of the range from atmosphere to supply from either end.
_START_TOLERANCE = 0.25
_FEWEST_PERIODS = 4
# Change of pressure in one block next to a clipped interval, as a share of the limit.
_CLIP_TRAVEL = 2e-3


def moved_valves(trials: Sequence[Trial]) -> list[str]:
    """The valves whose duty is ever other than zero."""
    return [
        v
        for v in SIDES
        if any(f"duty_{v}" in t and bool(np.any(t[f"duty_{v}"] != 0.0)) for t in trials)
    ]


def select_tests(trials: Sequence[Trial], rig: Rig, valve: str, remarks: Remarks) -> list[PwmTest]:
    """The usable constant-duty tests of one valve, filling and discharging.

    Raises InputError where a channel that the flow needs is missing.
    """
    tests = []
    for trial in trials:
        duty = trial.channels.get(f"duty_{valve}")
        if duty is None or not duty.any():
            continue
        test = _prepared(trial, duty, rig, valve, remarks)
        if test is not None:
            tests.append(test)
    tests = consistent_supply(_without_clipped(tests, rig, remarks), rig, remarks)
    remarks.lines += deviating_period(tests, _pwm_period(rig))
    return with_seen_supply(tests, rig, remarks)


def _prepared(
    trial: Trial, duty: FloatArray, rig: Rig, valve: str, remarks: Remarks
) -> PwmTest | None:
    """The trial as a test, or None with a remark."""
    air = rig.require("air", "which the flow from dP/dt needs")
    name = f"pressure_{valve}_pa"
    trial.require([name], f"which the flow of valve {valve.upper()} is computed from")
    trial.require([rig.position_channel], "which the chamber's volume follows from")
    volume = _volume(trial[rig.position_channel], rig, valve)
    reason = _unusable(trial, duty, volume, rig, valve)
    if reason is not None:
        remarks.exclude(trial, reason)
        return None
    declared = float(air.supply_pressure_pa)
    period, pressure, usable, supply = _on_grid(trial, name, declared, _pwm_period(rig))
    if not usable.all():
        remarks.about(trial, "lost samples; no flow is taken across the gaps")
    start = start_pressure(pressure, float(duty[0]), period, rig)
    share = (start - air.atmospheric_pressure_pa) / (declared - air.atmospheric_pressure_pa)
    # A clipping sensor shows the supply too low, but as its highest value.
    clipped = bool(np.all(pressure[:8] == pressure.max()))
    if min(abs(share), abs(share - 1.0)) > _START_TOLERANCE and not clipped:
        remarks.exclude(
            trial,
            f"{name} starts neither at the atmosphere (filling) nor at the supply (discharging)",
        )
        return None
    # A surface holds means over the pulses, which draw on the line once a period.
    line = _over_pulses(supply, pulse_block(_pwm_period(rig), period))
    sagged = np.abs(line - declared) > SAME_SUPPLY * declared
    if sagged.any():
        remarks.about(
            trial,
            "rows excluded: supply_pressure_pa deviates by more than "
            f"{100 * SAME_SUPPLY:.0f} % from the rig file's {declared:.0f} Pa, the only "
            "supply that the surface is valid for; steady it, with a vessel next to the valve",
        )
    kept = usable & ~sagged
    mean = float(supply[kept].mean()) if kept.any() else declared
    temperature = trial.channels.get("temperature_k")
    return PwmTest(
        label=trial.label,
        source=trial.source,
        valve=valve,
        filling=share < 0.5 and not clipped,
        duty=float(duty[0]),
        period=period,
        pressure=pressure,
        usable=kept,
        volume=float(volume.mean()),
        temperature=air.temperature_k if temperature is None else float(temperature.mean()),
        supply=mean,
        supply_at_start=start_pressure(supply, float(duty[0]), period, rig),
        supply_logged="supply_pressure_pa" in trial,
        line=supply - mean,
        known=usable,
    )


def _over_pulses(values: FloatArray, block: int) -> FloatArray:
    """Moving mean (n,) of values (n,) over `block` rows around each; fewer at the ends."""
    total = np.concatenate(([0.0], np.cumsum(values - values[0])))
    row = np.arange(len(values))
    begin = np.clip(row - block // 2, 0, max(len(values) - block, 0))
    end = np.minimum(begin + block, len(values))
    return np.asarray(values[0] + (total[end] - total[begin]) / (end - begin))


def _unusable(
    trial: Trial, duty: FloatArray, volume: FloatArray, rig: Rig, valve: str
) -> str | None:
    """Why the trial is not a constant-duty test with the piston held; None where it is one."""
    if not trial.has_its_start:
        return "its start is excluded, which shows whether it fills or discharges, and from where"
    if not is_one_duty(duty):
        return f"duty_{valve} is not constant, but a sample has only one duty"
    if signals.travel(volume, volume_count(rig, valve)) > HELD_SHARE * float(volume.mean()):
        return "the piston moved, but the flow is identified only with the piston held"
    least = settled_after(rig) + _FEWEST_PERIODS * _pwm_period(rig)
    if trial.time[-1] - trial.time[0] < least:
        return f"it is shorter than {_FEWEST_PERIODS} PWM periods"
    return None


def _volume(position: FloatArray, rig: Rig, valve: str) -> FloatArray:
    """Volume of the valve's chamber, (n,) m3."""
    cylinder = rig.require("cylinder", "which the chamber's volume follows from")
    return np.asarray(chamber_volume(position, cylinder, valve), dtype=float)


def _on_grid(
    trial: Trial, name: str, declared: float, pwm_period: float
) -> tuple[float, FloatArray, BoolArray, FloatArray]:
    """Sampling period, pressure, usable and supply (declared where not logged) on a grid."""
    time, pressure = trial.time, trial[name]
    supply = trial.channels.get("supply_pressure_pa")
    steps = np.diff(time)
    median = float(np.median(steps))
    if float(np.max(np.abs(steps - median))) < signals.JITTER_IGNORED * median:
        period = float(time[-1] - time[0]) / (len(time) - 1)
        logged = np.full(len(time), declared) if supply is None else supply
        return period, pressure, np.ones(len(time), dtype=bool), logged
    count = max(1, round(float(time[-1] - time[0]) / median))
    grid = time[0] + median * np.arange(count + 1)
    row = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
    # Where a PWM period has many rows, a gap of less than half of it does not hide a pulse, if it
    # is not so long that the spline through the rows gives it up.
    bridged = min(signals.PAUSE * median, 0.5 * pwm_period)
    usable = steps[row - 1] < max(signals.SAMPLE_MISSING * median, bridged)
    level = signals.resample(time, pressure, grid)
    logged = np.full(len(grid), declared) if supply is None else np.interp(grid, time, supply)
    return median, level, usable, logged


# --- a clipped sensor --------------------------------------------------------------------


def _without_clipped(tests: Sequence[PwmTest], rig: Rig, remarks: Remarks) -> list[PwmTest]:
    """The tests with samples at a clipped sensor's limits marked unusable."""
    if not tests:
        return []
    blocks = [pulse_block(_pwm_period(rig), t.period) for t in tests]
    shown = [_sample_noise(t.pressure, b) for t, b in zip(tests, blocks, strict=True)]
    noisy = [n for n in shown if n > 0.0]
    noise = float(np.median(noisy)) if noisy else 0.0
    count = signals.quantum(tests[0].pressure)
    upper, lower = math.inf, -math.inf
    for test, block in zip(tests, blocks, strict=True):
        upper = min(upper, _clip_level(test.pressure, block, noise, count))
        lower = max(lower, -_clip_level(-test.pressure, block, noise, count))
    limits = [f"{level:.0f} Pa" for level in (lower, upper) if math.isfinite(level)]
    if not limits:
        return list(tests)
    cleaned = []
    for test, block in zip(tests, blocks, strict=True):
        clipped = (test.pressure >= upper) | (test.pressure <= lower)
        if clipped.any():
            remarks.about(
                test,
                f"rows excluded: pressure_{test.valve}_pa is saturated at {' and '.join(limits)}; "
                "the flow beyond cannot be identified, and the surface's domain ends there",
            )
            # With noise, single samples reach the limit earlier and later than the rest.
            rows = np.flatnonzero(clipped)
            clipped[max(rows[0] - block, 0) : rows[-1] + block] = True
        cleaned.append(replace(test, usable=test.usable & ~clipped, known=test.known & ~clipped))
    return cleaned


def _sample_noise(pressure: FloatArray, block: int) -> float:
    """Noise of a sample, Pa, from third differences over whole PWM periods."""
    third = np.diff(pressure[::block], 3)
    return signals.deviation_by_median(third) / math.sqrt(20.0) if len(third) else 0.0


def _pwm_period(rig: Rig) -> float:
    return float(rig.require("pwm", "which the mean over pulses needs").period_s)


def _clip_level(values: FloatArray, block: int, noise: float, count: float) -> float:
    """The value that a sensor cannot exceed, if this test shows it; else infinity.

    It shows in at least two blocks of samples of exactly the highest value, where either noise
    of more than a count would have interrupted the run, or the pressure reached (or left) it at
    full speed: an equilibrium is approached slowly.
    """
    top = float(values.max())
    at_top = values == top
    if at_top.all():  # clipped or at rest: indistinguishable
        return math.inf
    needed = max(2 * block, 8)
    if np.count_nonzero(at_top) < needed:
        return math.inf
    edges = np.flatnonzero(np.diff(np.concatenate(([0], at_top.astype(np.int8), [0]))))
    begin, end = edges[::2], edges[1::2]
    longest = int(np.argmax(end - begin))
    first, last = int(begin[longest]), int(end[longest])
    if last - first < needed:
        return math.inf
    if noise > max(count, 1e-6 * abs(top)):
        return top
    around = [i for i in (first - block, last + block - 1) if 0 <= i < len(values)]
    travel = max((top - float(values[i]) for i in around), default=0.0)
    return top if travel > max(6.0 * (count + noise), _CLIP_TRAVEL * abs(top)) else math.inf
