"""A tank that a pump fills and a valve or an open port empties: how its pressure falls.

The law is the thesis' exhaust, c_dis (P0 - P) below the choked boundary (3.6.10), out of a
chamber of constant volume whose gas obeys 3.3.6. The discharge is simulated in open loop
through the ports of the model, so that an effect acts here as it does in an actuator.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid import signals
from sysid.diagnosis.bench.component import Component, Law, law_held, rmse, smallest_probe, usable
from sysid.errors import NotIdentifiedError, input_error
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import Parameter
from sysid.estimation.quality import FitQuality
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parameters import Bundle, DiscreteLaw, FittedValves, Parts, Valve
from sysid.parameters.quality import quality_field
from sysid.plant import base, plant
from sysid.plant.base import Array, Parameters
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model, Point, stack_models
from sysid.plant.sensors import before_sensors
from sysid.plant.steps import heun
from sysid.types import FloatArray

KIND = "tank"
_FLOW_UNIT = "kg/s"
_COEFFICIENT_UNIT = "kg/(s Pa)"
_PUMPS = ("pump_volts", "valve_a")
# Times in units of the tank's own, in which its pressure falls by 1 - 1/e of all that it falls.
# Residuals are means over a bin; steps of the simulation are short while the gas cools and is
# warmed again, and longer later.
_BIN = 0.01
_LONGEST_STEP_BINS = 5.0
_GROWTH = 1.03
# A parabola through this time of the discharge gives the pressure at its start: the first
# samples still contain the pulses of the pump. A slow logger's first rows may reach farther.
_START = 0.05
_LATEST_START = 0.5
_FEWEST_IN_START = 4
# What lies later says nothing on how the tank empties.
_LONGEST = 50.0
_FEWEST_BINS = 10
# Of the atmosphere's pressure, which is known to about as much.
_LEAST_FALL = 0.01
# Share of the largest fall that an effect must change at its probing size to count as acting.
_ACTS = 1e-7


@dataclass(frozen=True)
class Discharge:
    """One test from the stop of the pump on: means over bins of `bin_s`.

    `time` (n,) s since the stop, `pressure` (n,) Pa absolute, `start` the pressure at 0, `noise`
    what the sensor's noise leaves of a mean, Pa.
    """

    label: str
    time: FloatArray
    pressure: FloatArray
    start: float
    bin_s: float
    noise: float = math.nan


@dataclass(frozen=True)
class TankComponent(Component):
    """A tank of `parameters`' chamber A and its discharges. Residuals are pressures, Pa."""

    base_parameters: Parameters
    discharges: tuple[Discharge, ...]
    left_out: tuple[str, ...] = ()

    channel = "pressure_a_pa"
    unit = "Pa"

    @property
    def tests(self) -> tuple[str, ...]:
        return tuple(d.label for d in self.discharges)

    @property
    def _boundary(self) -> float:
        """Pressure from which on the exhaust is choked, Pa."""
        return float(base.exhaust_boundary(self.base_parameters.atmosphere))

    @property
    def _reaches_choking(self) -> bool:
        return max(d.start for d in self.discharges) > self._boundary

    def parameters(self) -> list[Parameter]:
        p = self.base_parameters
        rates = []
        for d in self.discharges:
            excess = d.pressure - p.atmosphere
            width = np.diff(d.time, prepend=0.0)
            rates.append((d.start - d.pressure[-1]) / float(excess @ width))
        per_rate = p.offset_a * p.area_a
        per_rate /= p.heat_capacity_ratio * p.gas_constant * p.temperature
        start = float(np.median(rates)) * per_rate
        own = [Parameter("c_dis", start, _COEFFICIENT_UNIT, 0.0)]
        if self._reaches_choking:
            choked = start * (self._boundary - p.atmosphere)
            own.append(Parameter("choked_flow_dis_kg_s", choked, _FLOW_UNIT, 0.0))
        return own

    def effects(
        self, catalogue: Mapping[str, type[CatalogueEffect]]
    ) -> tuple[type[CatalogueEffect], ...]:
        """Those that change a simulated pressure, each tried at its usual size.

        One that acts faster than the simulation's steps is not among them: a discharge of
        many seconds does not show it.
        """
        law = Law({p.name: p.value for p in self.parameters()})
        tests = range(len(self.discharges))
        without = np.concatenate(self.residuals(law, tests))
        least = _ACTS * max(float(np.ptp(d.pressure)) for d in self.discharges)
        found = []
        for kind in catalogue.values():
            probe = Law(law.values, (smallest_probe(kind, self.side()),))
            with np.errstate(all="ignore"):
                change = np.concatenate(self.residuals(probe, tests)) - without
            if np.isfinite(change).all() and np.abs(change).max() > least:
                found.append(kind)
        return tuple(found)

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        return self.residuals_of([law], tests)[0]

    def residuals_of(self, laws: Sequence[Law], tests: Sequence[int]) -> list[list[FloatArray]]:
        """All laws on all tests in one simulation, whose steps cost the same for one or many."""
        chosen = [self.discharges[t] for t in tests]
        models = [Model(self._with_law(law), law.effects) for law in laws]
        shown = [{self.channel: d.start} for d in chosen]
        starts = np.array([before_sensors(s, m)[self.channel] for m in models for s in shown])
        together = stack_models([m for m in models for _ in chosen]) if models[1:] else models[0]
        end, first = max(d.time[-1] for d in chosen), min(d.bin_s for d in chosen)
        times, *found = _simulated(starts, _grid(float(end), first), together)
        runs = zip(*(np.split(values, len(models), axis=1) for values in found), strict=True)
        return [
            self._left(chosen, model, times, *run) for model, run in zip(models, runs, strict=True)
        ]

    def measured(self, tests: Sequence[int]) -> list[FloatArray]:
        return [self.discharges[t].pressure for t in tests]

    def _left(
        self, chosen: Sequence[Discharge], model: Model, times: FloatArray, *run: FloatArray
    ) -> list[FloatArray]:
        """Measured pressure less what the sensor would show of pressures and their rates."""
        found = []
        for i, d in enumerate(chosen):
            true = _between(d.time, times, *(values[:, i] for values in run))
            channels: dict[str, Array] = {self.channel: true}
            for effect in model.effects:
                channels = effect.measure(channels, d.time)
            found.append(np.asarray(d.pressure - channels[self.channel]))
        return found

    def _with_law(self, law: Law) -> Parameters:
        """Where no test chokes, the choked flow is the other law's value there."""
        c_dis = law.values["c_dis"]
        reach = self._boundary - self.base_parameters.atmosphere
        choked = law.values.get("choked_flow_dis_kg_s", c_dis * reach)
        return self.base_parameters.replace(c_dis_a=c_dis, choked_dis_a=choked)

    def regressors(self, tests: Sequence[int]) -> dict[str, FloatArray]:
        chosen = [self.discharges[t] for t in tests]
        return {
            "time since the pump's stop (s)": np.concatenate([d.time for d in chosen]),
            "pressure_a_pa": np.concatenate([d.pressure for d in chosen]),
        }

    def noise_floor(self, law: Law) -> float:
        """Of the pressure as logged, in the means of bins."""
        return rmse([np.full(len(d.time), d.noise) for d in self.discharges])

    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        unasked = Estimate.unidentified(
            "", "a tank's discharge has no flow through an open valve from a supply"
        )
        unreached = Estimate.unidentified(
            _FLOW_UNIT,
            f"no discharge starts above the choked boundary ({self._boundary:.4g} Pa); one from "
            "above it would identify it",
        )
        law: dict[str, Any] = {
            "c_fill": unasked,
            "c_dis": estimates["c_dis"],
            "choked_flow_fill_kg_s": unasked,
            "choked_flow_dis_kg_s": estimates.get("choked_flow_dis_kg_s", unreached),
            **quality_field(quality, "discharge"),
        }
        return Parts(valves=FittedValves(a=Valve(discrete=DiscreteLaw.model_validate(law))))

    def law_of(self, bundle: Bundle) -> Law:
        names = [p.name for p in self.parameters()]
        discrete = bundle.valve("a").discrete
        return law_held("valves.a.discrete", discrete, names, f"{KIND} tests")


def tank(trials: Sequence[Trial], rig: Rig) -> TankComponent:
    """The tank that `trials` show: one discharge each, from the pump's last row on.

    Trials hold `pressure_a_pa`, and `pump_volts` or `valve_a`, which is not 0 while the tank
    is filled. Raises InputError where a section of the rig file or a column is missing, and
    NotIdentifiedError where no trial shows a discharge; others are left out, and say why.
    """
    air = rig.require("air", "which a tank's discharge needs")
    volume = rig.require("tank", "which a tank's discharge needs").volume_m3
    zero = dict.fromkeys(base.PARAMETER_NAMES, 0.0)
    # A cube: what counts is the volume alone.
    fixed = Parameters(**zero).replace(
        area_a=volume ** (2.0 / 3.0),
        offset_a=volume ** (1.0 / 3.0),
        area_b=volume ** (2.0 / 3.0),
        offset_b=volume ** (1.0 / 3.0),
        pitch_radius=1.0,
        inertia=1.0,
        pwm_period=1.0,
        max_effort=math.inf,
        gas_constant=air.gas_constant_j_per_kg_k,
        heat_capacity_ratio=air.heat_capacity_ratio,
        temperature=air.temperature_k,
        atmosphere=air.atmospheric_pressure_pa,
        supply=air.supply_pressure_pa,
        supply_reference=air.supply_pressure_pa,
    )
    if not trials:
        raise NotIdentifiedError("no tank test to fit; give a fill and its discharge")
    ambient = air.atmospheric_pressure_pa
    read, left_out = usable(trials, lambda trial: _discharge(trial, ambient))
    bin_s = _round(_BIN * float(np.median([one.scale_s for one in read])))
    found, short = usable(read, lambda one: _binned(one, bin_s))
    late = [one.late for one in read if one.late]
    return TankComponent(fixed, tuple(found), (*left_out, *short, *late))


@dataclass(frozen=True)
class _Fall:
    """A test's rows from the stop of the pump on: `time` (n,) s since then, `pressure` (n,) Pa.

    `start` is the pressure at 0, `scale_s` the time in which it falls by 1 - 1/e of its whole
    fall; `late` says which rows are not used, where some are not.
    """

    trial: Trial
    time: FloatArray
    pressure: FloatArray
    start: float
    scale_s: float
    late: str = ""


def _discharge(trial: Trial, atmosphere: float) -> _Fall:
    """The discharge that a trial holds. Raises as `tank` does."""
    command = _command(trial)
    on = np.flatnonzero(trial[command] != 0.0)
    # Off in every row: the test begins with its discharge.
    first = int(on[-1]) + 1 if len(on) else 0
    if len(trial) - first < _FEWEST_BINS:
        raise NotIdentifiedError(
            f"{trial.source}: c_dis is not identified: {command} is never switched off for good, "
            f"as {_FEWEST_BINS} rows or more would show; a test that goes on after the pump has "
            "stopped, or its valve is off, would do"
        )
    time = trial.time[first:] - trial.time[first]
    pressure = trial["pressure_a_pa"][first:]
    scale = _scale(time, pressure)
    early = time <= max(_START * scale, float(time[_FEWEST_IN_START - 1]))
    start = float(np.polynomial.Polynomial.fit(time[early], pressure[early], 2)(0.0))
    if start - atmosphere < _LEAST_FALL * atmosphere:
        raise NotIdentifiedError(
            f"{trial.source}: c_dis is not identified: the discharge starts only "
            f"{start - atmosphere:.3g} Pa above the atmosphere; a stronger fill would do"
        )
    if time[early][-1] > _LATEST_START * scale:
        raise NotIdentifiedError(
            f"{trial.source}: c_dis is not identified: the pressure falls by 1 - 1/e of its whole "
            f"fall in {scale:.3g} s, within which only {int(np.count_nonzero(time <= scale))} rows "
            f"lie; sample every {scale / 20.0:.2g} s or faster, or discharge a larger tank"
        )
    used = time <= _LONGEST * scale
    late = ""
    if not used.all():
        late = (
            f"{trial.source}: rows later than {_LONGEST * scale:.3g} s after {command} is 0 are "
            "not used: the tank is empty long before"
        )
    return _Fall(trial, time[used], pressure[used], start, scale, late)


def _command(trial: Trial) -> str:
    """The channel that is 0 from the start of the discharge on. Raises InputError without one."""
    used = [name for name in _PUMPS if name in trial.unusable]
    trial.require(("pressure_a_pa", *used), "which a tank test needs")
    command = next((name for name in _PUMPS if name in trial), None)
    if command is None:
        raise input_error(
            trial.source,
            "column pump_volts is missing, which shows when the tank is filled (valve_a would do "
            "as well)",
            'add it (or valve_a), or name it with --map "pump_volts=COLUMN:V"',
        )
    return command


def _scale(time: FloatArray, pressure: FloatArray) -> float:
    """The time, s, in which a pressure falls by 1 - 1/e of its whole fall; (n,) each."""
    some = max(1, min(_FEWEST_IN_START, len(time) // 4))
    first, last = float(np.mean(pressure[:some])), float(np.mean(pressure[-some:]))
    fallen = np.flatnonzero(pressure <= first - (1.0 - math.exp(-1.0)) * (first - last))
    place = max(int(fallen[0]) if len(fallen) else len(time) - 1, 1)
    return float(time[place])


def _round(value: float) -> float:
    """The nearest of 1, 2, 5 and their decades."""
    decade = 10.0 ** math.floor(math.log10(value))
    return decade * min((1.0, 2.0, 5.0, 10.0), key=lambda d: abs(math.log(d * decade / value)))


def _binned(fall: _Fall, bin_s: float) -> Discharge:
    """Its means over bins of `bin_s`; NotIdentifiedError where too few rows give any."""
    place = (fall.time / bin_s).astype(int)
    # The last bin ends after the last row.
    count = max(int(place[-1]), 1)
    inside = place < count
    rows = np.bincount(place[inside], minlength=count)
    filled = rows > 0
    means = [
        np.bincount(place[inside], values[inside], count)[filled] / rows[filled]
        for values in (fall.time, fall.pressure)
    ]
    if len(means[0]) < _FEWEST_BINS:
        raise NotIdentifiedError(
            f"{fall.trial.source}: c_dis is not identified: the discharge is logged for "
            f"{fall.time[-1]:.3g} s only; a longer one, or a faster logger, would do"
        )
    sensor = signals.noise_floor(fall.pressure, stride=fall.trial.stride_of("pressure_a_pa"))
    noise = sensor.after(float(np.mean(1.0 / rows[filled])))
    return Discharge(fall.trial.title, means[0], means[1], fall.start, bin_s, noise)


def _point(time: float, pressure: FloatArray, extra: dict[str, Array], model: Model) -> Point:
    zero = np.zeros(len(pressure))
    # Without a chamber B its pressure is A's, so that nothing flows between the two.
    return Point(
        time, zero, zero, pressure, pressure, zero, zero, zero, zero, model.at(time), extra
    )


def _rates(
    time: float, pressure: FloatArray, extra: dict[str, Array], model: Model
) -> tuple[FloatArray, dict[str, Array]]:
    point = _point(time, pressure, extra, model)
    # As plant.discrete_flow has it, without the filling, which takes half the time.
    valve = point.parameters.valve("a")
    outside = plant.exhaust_pressure("a", point, model)
    flow = base.exhaust_flow(
        pressure,
        outside,
        valve.choked_dis,
        valve.c_dis,
        pressure >= plant.exhaust_boundary("a", point, model),
    )
    flow = model.through("exhaust_flow", flow, "a", point)
    flow = model.through("chamber_flow", flow, "a", point)
    rate = plant.pressure_rate("a", flow, point, model)
    states = plant.state_rates(point, {"a": flow, "b": 0.0 * flow}, model) if extra else {}
    return rate, states


def _simulated(
    starts: FloatArray, times: FloatArray, model: Model
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times (m,) s, pressures (m, tests) Pa and their rates, by Heun's steps."""
    pressures, rates = np.empty((2, len(times), len(starts)))
    extra = plant.initial_states(_point(0.0, starts, {}, model), model)
    state: tuple[Array, ...] = (starts, *extra.values())

    def slopes_at(time: float, state: Sequence[Array]) -> tuple[Array, ...]:
        pressure, *others = state
        rate, own = _rates(time, pressure, dict(zip(extra, others, strict=True)), model)
        return (rate, *(own[name] for name in extra))

    for k, t in enumerate(times.tolist()):
        slopes = slopes_at(t, state)
        pressures[k], rates[k] = state[0], slopes[0]
        if k == len(times) - 1:
            break
        step = float(times[k + 1]) - t
        state = heun(state, slopes, functools.partial(slopes_at, t + step), step)
    return times, pressures, rates


def _grid(end: float, first: float) -> FloatArray:
    """Times of the steps (m,) s from 0 to `end` or just beyond, the `first` of so many s."""
    times, step = [0.0], first
    while times[-1] < end:
        times.append(times[-1] + step)
        step = min(step * _GROWTH, _LONGEST_STEP_BINS * first)
    return np.array(times)


def _between(
    at: FloatArray, times: FloatArray, values: FloatArray, rates: FloatArray
) -> FloatArray:
    """Cubic Hermite interpolation at times (n,) of values (m,) with their rates."""
    k = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    step = times[k + 1] - times[k]
    s = (at - times[k]) / step
    bend = (3.0 - 2.0 * s) * s * s
    slope = step * s * (1.0 - s) * ((1.0 - s) * rates[k] - s * rates[k + 1])
    return np.asarray(values[k] + bend * (values[k + 1] - values[k]) + slope)


__all__ = ["KIND", "Discharge", "TankComponent", "tank"]
