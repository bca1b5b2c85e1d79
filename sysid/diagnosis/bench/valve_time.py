"""An on/off valve under PWM on a bench: the time to reach a pressure over the duty.

Without effects that time is inverse to the duty: a chamber fills, or empties, while the
valve is open. The pulse train of every reading goes through the ports of the model (pulses,
delays, flow), so that an effect acts here as it does in an actuator. Filling and emptying
have a passage each, which is open in the pulses of its own duty.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.diagnosis.bench.component import (
    Component,
    Law,
    bends,
    law_held,
    probes,
    rmse,
    usable,
    valve_alone,
)
from sysid.diagnosis.thresholds import ACTS
from sysid.errors import NotIdentifiedError, input_error
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import Parameter
from sysid.estimation.quality import FitQuality
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parameters import Bundle, FittedValves, Parts, Valve
from sysid.parameters.quality import quality_field
from sysid.parameters.valves import TimingLaw
from sysid.plant.base import Parameters
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Effect, Model, Point, overrides
from sysid.plant.valve_timing import TIME_TOLERANCE, delayed
from sysid.types import FloatArray

KIND = "valve-time"
PARAMETERS = ("filling_time_s", "emptying_time_s")
_COLUMNS = ("duty_a", "time_to_pressure_s", "pwm_period_s", "valve_a")
_SIDE = "a"
# Periods of a reading's pulse train, and those that are evaluated: by then the valve has
# settled, whatever its initial state.
_TRAIN, _FIRST, _LAST = 12, 6, 9
# A valve that never opens still leaks: no time is longer than this many times the shortest.
_LEAST_SHARE = 1e-3
# Not part of this law: one needs the time since the valve was switched on, which no reading
# holds, the other a spool with positions between shut and open.
_NOT_HERE = ("coil-heating", "valve-dead-band")


@dataclass(frozen=True)
class Sweep:
    """One test: readings of one PWM period and direction.

    `duty` (n,) 0 to 1, `seconds` (n,) to the pressure, `period` s, `fills` whether the
    chamber fills.
    """

    label: str
    duty: FloatArray
    seconds: FloatArray
    period: float
    fills: bool


@dataclass(frozen=True)
class ValveTime(Component):
    """Sweeps of the duty. Residuals are logarithms of time, measured less modelled."""

    base_parameters: Parameters
    sweeps: tuple[Sweep, ...]
    left_out: tuple[str, ...] = ()

    channel = "log_time_to_pressure"
    unit = "-"

    @property
    def tests(self) -> tuple[str, ...]:
        return tuple(s.label for s in self.sweeps)

    def parameters(self) -> list[Parameter]:
        own = []
        for name, fills in zip(PARAMETERS, (True, False), strict=True):
            logs = [np.log(s.seconds * s.duty) for s in self.sweeps if s.fills == fills]
            if logs:
                start = math.exp(float(np.mean(np.concatenate(logs))))
                own.append(Parameter(name, start, "s", 1e-9))
        return own

    def effects(
        self, catalogue: Mapping[str, type[CatalogueEffect]]
    ) -> tuple[type[CatalogueEffect], ...]:
        """Those that change a time other than by a factor, each tried at its usual size."""
        law = Law({p.name: p.value for p in self.parameters()})
        without = self._flows(law)
        return tuple(
            kind
            for kind in catalogue.values()
            if kind.id not in _NOT_HERE
            and any(self._acts(law, probe, without) for probe in probes(kind, _SIDE))
        )

    def _acts(self, law: Law, probe: CatalogueEffect, without: Sequence[FloatArray]) -> bool:
        with np.errstate(all="ignore"):
            flows = self._flows(Law(law.values, (probe,)))
            change = [np.log(b / a) for a, b in zip(without, flows, strict=True)]
        if not all(np.isfinite(part).all() for part in change):
            return False
        return any(
            float(np.ptp(np.concatenate(parts))) > ACTS
            for parts in (
                [c for c, s in zip(change, self.sweeps, strict=True) if s.fills == fills]
                for fills in {s.fills for s in self.sweeps}
            )
        )

    def _flows(self, law: Law) -> list[FloatArray]:
        return [self._relative_flow(sweep, law.effects) for sweep in self.sweeps]

    def _relative_flow(self, sweep: Sweep, effects: Sequence[Effect]) -> FloatArray:
        """Mean flow at each duty (n,) over that of the permanently open valve."""
        model = Model(self.base_parameters.replace(pwm_period=sweep.period), tuple(effects))
        share = open_share(sweep.duty, model)
        p, zero = model.parameters, np.zeros_like(share)
        if sweep.fills:
            point = Point.at_rest(p, zero, open_a=share)
            flow = model.through("filling_flow", share, _SIDE, point)
        else:
            point = Point.at_rest(p, zero, pressure_a=zero + p.supply, open_a=1.0 - share)
            flow = -model.through("exhaust_flow", -share, _SIDE, point)
        return np.asarray(np.maximum(flow, _LEAST_SHARE))

    def times(self, law: Law, test: int) -> FloatArray:
        """Modelled time to the pressure, s, (n,) of a test's readings."""
        sweep = self.sweeps[test]
        name = PARAMETERS[0] if sweep.fills else PARAMETERS[1]
        if name not in law.values:
            way = "filling" if sweep.fills else "emptying"
            raise NotIdentifiedError(
                f"{name} is not identified: readings to predict are of {way}, none of the fitted "
                f"ones is; fit a sweep of {way} too"
            )
        return law.values[name] / self._relative_flow(sweep, law.effects)

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        return [np.log(self.sweeps[t].seconds) - np.log(self.times(law, t)) for t in tests]

    def measured(self, tests: Sequence[int]) -> list[FloatArray]:
        return [np.log(self.sweeps[t].seconds) for t in tests]

    def regressors(self, tests: Sequence[int]) -> dict[str, FloatArray]:
        chosen = [self.sweeps[t] for t in tests]
        return {
            "duty_a": np.concatenate([s.duty for s in chosen]),
            "length of the pulse (s)": np.concatenate([s.duty * s.period for s in chosen]),
            "length of the pause (s)": np.concatenate([(1.0 - s.duty) * s.period for s in chosen]),
        }

    def noise_floor(self, law: Law) -> float:
        """From second differences of the readings along the duty: a smooth law is not noise.

        Of the time times the duty, which a valve that follows its pulses has in common.
        """
        return rmse([bends(np.log(s.seconds * s.duty)) for s in self.sweeps])

    def further_errors(self, law: Law) -> dict[str, tuple[float, float]]:
        """Of the logarithm, for filling and for emptying separately."""
        floor = self.noise_floor(law)
        found = {}
        for name, fills in (("log_time_filling", True), ("log_time_emptying", False)):
            tests = [t for t, s in enumerate(self.sweeps) if s.fills == fills]
            if tests:
                found[name] = rmse(self.residuals(law, tests)), floor
        return found

    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        absent = Estimate.unidentified(
            "s", f"no {KIND} test in this direction; a sweep of its duty would identify it"
        )
        times = {name: estimates.get(name, absent) for name in PARAMETERS}
        law = TimingLaw.model_validate({**times, **quality_field(quality)})
        return Parts(valves=FittedValves(a=Valve(timing=law)))

    def law_of(self, bundle: Bundle) -> Law:
        timing = bundle.valve("a").timing
        names = [p.name for p in self.parameters()]
        return law_held("valves.a.timing", timing, names, f"{KIND} tests in that direction")


def open_share(duty: FloatArray, model: Model) -> FloatArray:
    """Share of a PWM period in which a passage is open, (n,), of readings at `duty` (n,).

    Every reading is a train of pulses of `model.parameters.pwm_period`, with a pause before
    the next one. The pulses pass through the effects, the edges come with their delays.
    """
    p = model.parameters
    delays = float(p.on_delay_a), float(p.off_delay_a)
    ports = {name for e in model.effects for name in ("pulses", "delays") if overrides(e, name)}
    if not ports and delays == (0.0, 0.0):
        return duty
    period = float(p.pwm_period)
    reading: FloatArray = 3.0 * _TRAIN * period * np.arange(len(duty), dtype=np.float64)
    starts = (reading[:, None] + period * np.arange(_TRAIN)).ravel()
    ends = starts + period * np.repeat(duty, _TRAIN)
    pulse = ends - starts > TIME_TOLERANCE
    on, off = starts[pulse], ends[pulse]
    gap = on[1:] - off[:-1] > TIME_TOLERANCE
    on = on[np.concatenate(([True], gap))[: len(on)]]
    off = off[np.concatenate((gap, [True]))[: len(off)]]
    for effect in model.effects:
        on, off = effect.pulses(on, off, _SIDE)

    def port(values: FloatArray, times: FloatArray, opening: bool) -> FloatArray:
        found: FloatArray = model.through("delays", values, times, opening, _SIDE)
        return found

    intervals = delayed(on, off, *delays, port)
    # An equal delay of both edges shifts the pulses unchanged; the evaluated window shifts too.
    every = [port(np.full(len(e), d), e, e is on) for e, d in zip((on, off), delays, strict=True)]
    shift = float(np.concatenate(every).min()) if len(on) else 0.0
    begin, end = reading + shift + _FIRST * period, reading + shift + _LAST * period
    return intervals.open_fraction(begin, end)


def valve_time(trials: Sequence[Trial], rig: Rig) -> ValveTime:
    """The sweeps that `trials` show; readings without a pulse (duty 0) are left out.

    Trials hold `duty_a`, `time_to_pressure_s`, `pwm_period_s` and `valve_a` (1 while the
    chamber fills), the last two constant. `[air]` and `[valves]` of the rig file are used
    where present. Raises InputError for a column that is missing or impossible, and
    NotIdentifiedError without a test.
    """
    if not trials:
        raise NotIdentifiedError(f"no {KIND} test to fit; give a sweep of the duty")
    fixed = valve_alone(rig).replace(
        choked_fill_a=1.0,
        choked_dis_a=1.0,
        on_delay_a=rig.valves.on_delay_s if rig.valves else 0.0,
        off_delay_a=rig.valves.off_delay_s if rig.valves else 0.0,
    )
    found, left_out = usable(trials, _sweep)
    return ValveTime(fixed, tuple(found), tuple(left_out))


def _sweep(trial: Trial) -> Sweep:
    trial.require(_COLUMNS, f"which a {KIND} test needs")
    for name in ("pwm_period_s", "valve_a"):
        if float(np.ptp(trial[name])) != 0.0:
            raise input_error(
                trial.source,
                f"{name} changes within the test",
                "label each value separately in the column `test`",
            )
    seconds, period = trial["time_to_pressure_s"], float(trial["pwm_period_s"][0])
    for name, least in (("time_to_pressure_s", float(np.min(seconds))), ("pwm_period_s", period)):
        if not least > 0.0:
            raise input_error(
                trial.source, f"{name} = {least:g} is not positive", "delete or correct the row"
            )
    used = trial["duty_a"] * period > TIME_TOLERANCE
    if not used.any():
        raise NotIdentifiedError(f"{trial.source}: no reading with a duty above 0")
    fills = bool(trial["valve_a"][0] > 0.5)
    return Sweep(trial.title, trial["duty_a"][used], seconds[used], period, fills)


__all__ = ["KIND", "Sweep", "ValveTime", "open_share", "valve_time"]
