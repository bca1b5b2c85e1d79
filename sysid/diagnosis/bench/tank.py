"""A tank that a pump fills and a valve or an open port empties: how its pressure falls.

By the thesis' exhaust, c_dis (P0 - P) below the choked boundary (3.6.10), out of a chamber of
constant volume whose gas obeys 3.3.6, or by ISO 6358, whose choked flow is proportional to the
tank's pressure, out of gas with a temperature of its own (`tank_gas`). The discharge is simulated
in open loop through the ports of the model, so that an effect acts here as it does in an actuator.
The pressure at its start is each test's own number: what its residual says of it is taken out.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.diagnosis.bench import tank_gas
from sysid.diagnosis.bench.component import (
    Component,
    Law,
    law_held,
    rmse,
    smallest_probe,
)
from sysid.diagnosis.bench.tank_gas import Iso6358
from sysid.diagnosis.bench.tank_logs import Discharge, discharges
from sysid.diagnosis.bench.tank_wall import WallRange, once_through, wall_ranges
from sysid.errors import Notice, NotIdentifiedError
from sysid.estimation.linear import NORMAL, Estimate
from sysid.estimation.nonlinear import Parameter
from sysid.estimation.quality import FitQuality
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parameters import Bundle, DiscreteLaw, FittedValves, Parts, Valve
from sysid.parameters.quality import quality_field
from sysid.parameters.valves import AUTO, ISO6358, THESIS
from sysid.plant import base
from sysid.plant.base import Array, Parameters
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.iso6358 import ANR_DENSITY, DEFAULT_INDEX, HIGHEST_RATIO, INDICES
from sysid.plant.ports import Model, stack_models
from sysid.plant.sensors import before_sensors
from sysid.types import FloatArray

KIND = "tank"
_FLOW_UNIT = "kg/s"
_COEFFICIENT_UNIT = "kg/(s Pa)"
_CONDUCTANCE_UNIT = "m3/(s Pa)"
# Ratios of a law that has a subsonic part, and indices of anything between a sharp corner and a
# laminar passage (ISO 6358-1 has 1/2, tubes have up to 0.6).
# First guesses; the sizes of what the steepest fall would be by isothermal choked flow.
_GRID_SIZES = (0.5, 0.56, 0.63, 0.71, 0.8, 0.9, 1.0)
_GRID_RATIOS, _GRID_INDICES = (0.1, 0.3, 0.5), (0.5, 1.0)
_GRID_SHARES = (3e-3, 0.1, 0.5, 0.97)
# For the thesis' flow out of gas with a temperature: times the coefficients by 3.3.6, and how many
# times the wall warms the gas through while the tank empties; at last it keeps it as warm as it is.
_SIZES = (1.0, 1.1, 1.2, 1.3, 1.4, 1.55)
_WARMED = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, math.inf)
# Gauss-Newton steps from the best of each share and ratio, and how many are kept after them; the
# differences of the steps, and the damping that is tried.
_ROUNDS = ((4, 6), (4, 1))
_STEP, _DAMPING = 1e-4, (1e-3, 0.1, 10.0)
# Below it the gas is as warm as the wall to a thousandth of what it would cool by.
_ISOTHERMAL = 1e-3
# Steps of the simulation, in bins of a hundredth of the tank's own time, are short while the gas
# cools and is warmed again, and longer later; gas as warm as its wall allows the longest. By ISO
# 6358 it arrives at the atmosphere all at once. Of a discharge from 6 bar the thesis' flow is
# simulated to 0.04 Pa, with gas that has a temperature to 0.02 Pa. By the law, and whether the gas
# has a temperature.
_LONGEST_STEP_BINS = {(THESIS, False): 12.0, (THESIS, True): 6.0, (ISO6358, True): 3.0}
_GROWTH = 1.12
# Share of the largest fall that an effect must change at its probing size to count as acting.
_ACTS = 1e-7
# Of the excess pressure at the start: the difference by which its influence is taken.
_START_STEP = 1e-3
# Likewise: what a tank that keeps its pressure loses by a first guess, within its record.
_LEAST_SHARE = 1e-3
# Beyond a wall that conducts nothing: noise and the means of bins want a little more, which must
# not pass for a number that the tests leave open.
_MOST_ADIABATIC = 1.05
# The law has a temperature of the gas, and choked flow proportional to the pressure, of its own.
_OF_GAS = ("wall-heat-transfer",)
_IN_ISO6358 = (*_OF_GAS, "choked-exhaust-scaling", "subsonic-flow-shape")


@dataclass(frozen=True)
class _Guess:
    """What a first guess is of: the numbers' names, which are free, which have a size of their own,
    and their bounds (p,)."""

    names: tuple[str, ...]
    free: tuple[int, ...]
    sized: tuple[int, ...]
    lower: FloatArray
    upper: FloatArray


def _share(value: float) -> Parameter:
    """The share of the expansion that the wall leaves adiabatic, starting from `value`."""
    return Parameter("adiabatic_share", value, "-", 0.0, _MOST_ADIABATIC, 1.0)


@dataclass(frozen=True)
class TankComponent(Component):
    """A tank of `parameters`' chamber A and its discharges. Residuals are pressures, Pa.

    `law` "thesis" or "iso6358"; `fits_index`: whether ISO 6358's subsonic index is fitted too;
    `has_temperature`: whether the thesis' flow is that of gas with a temperature, of whose
    expansion the wall leaves a share adiabatic: a number of the law, or `adiabatic`.
    """

    base_parameters: Parameters
    discharges: tuple[Discharge, ...]
    left_out: tuple[str, ...] = ()
    law: str = THESIS
    fits_index: bool = False
    has_temperature: bool = False
    adiabatic: float | None = None

    channel = "pressure_a_pa"
    unit = "Pa"
    takes_laws_at_once = True
    refuses_misfit = True
    # Gas as warm as its wall, and a wall that takes no part.
    attained = frozenset({"adiabatic_share"})

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

    @property
    def _volume(self) -> float:
        return float(self.base_parameters.offset_a) * float(self.base_parameters.area_a)

    def forms(self, law: str = AUTO) -> tuple[TankComponent, ...]:
        """The laws that these tests may follow, the simplest first, on what all of them describe:
        until the tank is empty."""
        emptying = self._emptying
        found = [] if law == ISO6358 else [dataclasses.replace(self, discharges=emptying)]
        if law == AUTO:
            found.append(dataclasses.replace(found[0], has_temperature=True))
        if law != THESIS:
            found += [
                dataclasses.replace(self, discharges=emptying, law=ISO6358, fits_index=fits)
                for fits in (False, True)
            ]
        return tuple(found)

    @functools.cached_property
    def _emptying(self) -> tuple[Discharge, ...]:
        """The discharges until the tank is empty."""
        atmosphere = float(self.base_parameters.atmosphere)
        return tuple(d.until_empty(atmosphere) for d in self.discharges)

    def judged(self) -> TankComponent:
        """Until the tank is empty: what comes after is no flow's."""
        return dataclasses.replace(self, discharges=self._emptying)

    def settled_as(self, form: Component) -> Component:
        """By the thesis the empty tank counts too: its pressure is the atmosphere's."""
        if not isinstance(form, TankComponent) or form.law != THESIS:
            return form
        return dataclasses.replace(self, has_temperature=True) if form.has_temperature else self

    def in_form_of(self, bundle: Bundle) -> TankComponent:
        held = bundle.valve("a").discrete
        if held is None:
            return self
        if held.law_of("dis") != ISO6358:
            own = held.wall_conductance_w_per_k is not None
            return dataclasses.replace(self, has_temperature=own)
        index = held.estimates().get("subsonic_index.exhaust")
        fixed, free = self.forms(ISO6358)
        return free if index is not None and index.has_error else fixed

    @property
    def law_name(self) -> str:
        """The law, and whether its index is fitted, or the thesis' gas has a temperature."""
        if self.has_temperature:
            return f"{self.law} with gas that cools and is warmed"
        return f"{self.law} with an index of its own" if self.fits_index else self.law

    def parameters(self) -> list[Parameter]:
        if self.law == ISO6358:
            return self._of_iso6358()
        return self._with_temperature if self.has_temperature else self._of_thesis()

    def _of_thesis(self) -> list[Parameter]:
        p = self.base_parameters
        rates = []
        for d in self.discharges:
            excess = d.pressure - p.atmosphere
            width = np.diff(d.time, prepend=0.0)
            # A tank that keeps its pressure starts from the least leak that a search can move.
            least = _LEAST_SHARE * (d.start - p.atmosphere) / float(excess @ width)
            rates.append(max((d.start - d.pressure[-1]) / float(excess @ width), least))
        per_rate = self._volume / (p.heat_capacity_ratio * p.gas_constant * p.temperature)
        start = float(np.median(rates)) * per_rate
        own = [Parameter("c_dis", start, _COEFFICIENT_UNIT, 0.0)]
        if self._reaches_choking:
            choked = start * (self._boundary - p.atmosphere)
            own.append(Parameter("choked_flow_dis_kg_s", choked, _FLOW_UNIT, 0.0))
        return own

    @functools.cached_property
    def _with_temperature(self) -> list[Parameter]:
        """By 3.3.6, whose coefficients a temperature makes up to 1.4 times larger; with little heat
        from the wall and with much, as each leads to a minimum of its own."""
        own = self._of_thesis()
        full = once_through(self.base_parameters, self._volume, self.discharges[0].scale_s)
        odds = (1.0 - full) / full
        values = [p.value for p in own]
        grid = [
            [(1.0 / (1.0 + times * odds), *(size * value for value in values)) for size in _SIZES]
            for times in _WARMED
        ]
        least, most = 1e-3 * np.array(values), 1e3 * np.array(values)
        guess = _Guess(
            ("adiabatic_share", *(p.name for p in own)),
            tuple(range(1 + len(own))),
            tuple(range(1, 1 + len(own))),
            np.array([0.0, *least]),
            np.array([1.0, *most]),
        )
        best = self._best_of(guess, grid)
        share = _share(best["adiabatic_share"])
        return [*(dataclasses.replace(p, value=best[p.name]) for p in own), share]

    def _of_iso6358(self) -> list[Parameter]:
        found = self._first_guess
        own = [
            Parameter("sonic_conductance", found["sonic_conductance"], _CONDUCTANCE_UNIT, 0.0),
            Parameter("critical_ratio", found["critical_ratio"], "-", 0.0, HIGHEST_RATIO, 1.0),
            _share(found["adiabatic_share"]),
        ]
        if self.fits_index:
            own.append(Parameter("subsonic_index", found["subsonic_index"], "-", *INDICES))
        return own

    @functools.cached_property
    def _first_guess(self) -> Mapping[str, float]:
        """The best of a coarse grid, once what is best at each wall share and critical ratio has
        been improved: from afar a warm wall, a large conductance and a small ratio look alike, and
        each leads to a minimum of its own."""
        p = self.base_parameters
        steepest = max(
            max(
                float(np.max(np.log(d.start / d.pressure[1:]) / d.time[1:])),
                _LEAST_SHARE / float(d.time[-1]),
            )
            for d in self.discharges
        )
        most = self._volume / (p.gas_constant * p.temperature * ANR_DENSITY) * steepest
        indices = _GRID_INDICES if self.fits_index else (DEFAULT_INDEX,)
        sizes = [most * share for share in _GRID_SIZES]
        places = itertools.product(_GRID_SHARES, _GRID_RATIOS)
        grid = [
            [(share, size, ratio, index) for size in sizes for index in indices]
            for share, ratio in places
        ]
        upper = [1.0, 1e3 * max(sizes), HIGHEST_RATIO, INDICES[1]]
        guess = _Guess(
            ("adiabatic_share", "sonic_conductance", "critical_ratio", "subsonic_index"),
            (0, 1, 2, *([3] if self.fits_index else [])),
            (1,),
            np.array([0.0, 1e-3 * min(sizes), 0.0, INDICES[0]]),
            np.array(upper),
        )
        return self._best_of(guess, grid)

    def _best_of(
        self, guess: _Guess, grid: Sequence[Sequence[tuple[float, ...]]]
    ) -> Mapping[str, float]:
        """The best of a grid's rows once the best of each has been improved, by name."""
        squares = self._squares_at(guess, np.vstack(grid)).reshape(len(grid), -1)
        points = np.array([own[i] for own, i in zip(grid, squares.argmin(axis=1), strict=True)])
        for rounds, kept in _ROUNDS:
            points = self._improved(guess, points, rounds)
            points = points[np.argsort(self._squares_at(guess, points))[:kept]]
        return dict(zip(guess.names, points[0].tolist(), strict=True))

    def _squares_at(self, guess: _Guess, points: FloatArray) -> FloatArray:
        """Sums of squares (k,) of the laws at `points` (k, p); infinite where one is no number."""
        found = np.array([float(left @ left) for left in self._left_at(guess, points)])
        return np.where(np.isfinite(found), found, np.inf)

    def _left_at(self, guess: _Guess, points: FloatArray) -> list[FloatArray]:
        """The residuals (n,) of each of the laws at `points` (k, p)."""
        laws = [Law(dict(zip(guess.names, point.tolist(), strict=True))) for point in points]
        found = self.residuals_of(laws, range(len(self.discharges)))
        return [np.concatenate(parts) for parts in found]

    def _improved(self, guess: _Guess, points: FloatArray, rounds: int) -> FloatArray:
        """Points (k, p) after some damped Gauss-Newton steps, all of them in one simulation."""
        free, sized = list(guess.free), list(guess.sized)
        for _ in range(rounds):
            # What has a unit by its own size, and the others as they are.
            sizes = np.ones(points.shape)
            sizes[:, sized] = points[:, sized]
            moved = []
            for i in free:
                beyond = points[:, i] + _STEP * sizes[:, i] > guess.upper[i]
                inward = np.where(beyond, -_STEP, _STEP)
                moved.append(points.copy())
                moved[-1][:, i] += inward * sizes[:, i]
            left = np.reshape(
                self._left_at(guess, np.vstack([points, *moved])),
                (1 + len(free), len(points), -1),
            )
            tried = []
            for k, point in enumerate(points):
                steps = [moved[j][k, i] - point[i] for j, i in enumerate(free)]
                slopes = ((left[1:, k] - left[0, k]).T / steps) * sizes[k, free]
                normal, fall = slopes.T @ slopes, slopes.T @ left[0, k]
                for damping in _DAMPING:
                    damped = normal + damping * np.diag(np.diag(normal) + 1e-300)
                    there = point.copy()
                    there[free] -= np.linalg.lstsq(damped, fall, rcond=None)[0] * sizes[k, free]
                    tried.append(np.clip(there, guess.lower, guess.upper))
            here = (left[0] ** 2).sum(axis=1)
            squares = self._squares_at(guess, np.array(tried)).reshape(len(points), -1)
            for k in range(len(points)):
                if squares[k].min() < here[k]:
                    points[k] = tried[k * len(_DAMPING) + int(squares[k].argmin())]
        return points

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
        largest = max(float(np.ptp(d.pressure)) for d in self.discharges)
        found = []
        for kind in catalogue.values():
            if self.law == ISO6358 and kind.id in _IN_ISO6358:
                continue
            if self.has_temperature and kind.id in _OF_GAS:
                continue
            probe = Law(law.values, (smallest_probe(kind, self.side()),))
            with np.errstate(all="ignore"):
                change = np.concatenate(self.residuals(probe, tests)) - without
            if np.isfinite(change).all() and np.abs(change).max() > _ACTS * largest:
                found.append(kind)
        return tuple(found)

    def taken_out(self, tests: Sequence[int]) -> int:
        """Of each test the pressure at its start."""
        return len(tests)

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        return self.residuals_of([law], tests)[0]

    def residuals_of(self, laws: Sequence[Law], tests: Sequence[int]) -> list[list[FloatArray]]:
        """All laws on all tests in one simulation, whose steps cost the same for one or many."""
        chosen = [self.discharges[t] for t in tests]
        models = [Model(self._with_law(law), law.effects) for law in laws]
        # Each test twice: from its first guess of a start, and from a little higher.
        atmosphere = float(self.base_parameters.atmosphere)
        steps = [_START_STEP * (d.start - atmosphere) for d in chosen]
        shown = [d.start for d in chosen] + [
            d.start + s for d, s in zip(chosen, steps, strict=True)
        ]
        starts = np.array(
            [before_sensors({self.channel: s}, m)[self.channel] for m in models for s in shown]
        )
        lanes = [m for m in models for _ in shown]
        together = stack_models(lanes) if models[1:] else models[0]
        iso = self._iso6358([law for law in laws for _ in shown])
        end, first = max(d.time[-1] for d in chosen), min(d.bin_s for d in chosen)
        warm = self._adiabatic(laws, len(shown))
        cools = self.law == ISO6358 or warm is not None
        longest = _LONGEST_STEP_BINS[self.law, cools] * first
        times = tank_gas.grid(float(end), first, longest, _GROWTH)
        found = tank_gas.simulated(starts, times, together, iso, warm)
        runs = np.split(np.arange(len(lanes)), len(models))
        return [
            self._left(chosen, steps, model, found.of(own.tolist()))
            for model, own in zip(models, runs, strict=True)
        ]

    def _adiabatic(self, laws: Sequence[Law], times: int) -> Array | None:
        """The share of the expansion that the wall leaves adiabatic, of each law so many times;
        None by 3.3.6, and by ISO 6358, which has its own."""
        if not self.has_temperature:
            return self.adiabatic
        return np.repeat([law.values["adiabatic_share"] for law in laws], times)

    def _iso6358(self, laws: Sequence[Law]) -> Iso6358 | None:
        """The numbers of ISO 6358, (runs,) each; None where the law is the thesis'."""
        if self.law == THESIS:
            return None
        index = {"subsonic_index": DEFAULT_INDEX}
        names = ("sonic_conductance", "critical_ratio", "subsonic_index", "adiabatic_share")
        return Iso6358(*(np.array([(index | {**w.values})[name] for w in laws]) for name in names))

    def measured(self, tests: Sequence[int]) -> list[FloatArray]:
        return [self.discharges[t].pressure for t in tests]

    def _left(
        self,
        chosen: Sequence[Discharge],
        steps: Sequence[float],
        model: Model,
        course: tank_gas.Course,
    ) -> list[FloatArray]:
        """Measured pressure less what the sensor would show of the simulated ones, from the start
        that suits each test best."""
        found = []
        for i, (d, step) in enumerate(zip(chosen, steps, strict=True)):
            true = course.of([i, i + len(chosen)]).at(d.time)
            seen = []
            for one in true.T:
                channels: dict[str, Array] = {self.channel: one}
                for effect in model.effects:
                    channels = effect.measure(channels, d.time)
                seen.append(np.asarray(channels[self.channel]))
            left, slope = d.pressure - seen[0], (seen[1] - seen[0]) / step
            square = float(slope @ slope)
            found.append(left - slope * (float(slope @ left) / square) if square > 0.0 else left)
        return found

    def _with_law(self, law: Law) -> Parameters:
        """Where no test chokes, the choked flow is the other law's value there."""
        if self.law == ISO6358:
            return self.base_parameters
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
        return rmse([np.full(len(d), d.noise) for d in self.discharges])

    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        unasked = Estimate.unidentified(
            "",
            "a tank's discharge has no flow through an open valve from a supply; a valve-discrete "
            "test has",
        )
        law: dict[str, Any] = {"c_fill": unasked, "choked_flow_fill_kg_s": unasked}
        law |= self._section(estimates)
        law |= quality_field(quality, "discharge")
        return Parts(valves=FittedValves(a=Valve(discrete=DiscreteLaw.model_validate(law))))

    @functools.cached_property
    def wall_ranges(self) -> Mapping[str, WallRange]:
        """What the thesis' coefficients are times with gas that has a temperature, by name."""
        full = once_through(self.base_parameters, self._volume, self.discharges[0].scale_s)
        return wall_ranges(self, lambda share: dataclasses.replace(self, adiabatic=share), full)

    def said_of(self, estimates: Mapping[str, Estimate]) -> tuple[str, ...]:
        if self.law != THESIS or self.has_temperature:
            return ()
        # No leak is none, however warm the gas is.
        flows = [n for n in ("c_dis", "choked_flow_dis_kg_s") if _is_a_flow(estimates.get(n))]
        if not flows:
            return ()
        times = [f"{name} {self.wall_ranges[name].text}" for name in flows]
        own = self.wall_ranges[flows[0]]
        is_open = own.reaches_none and own.reaches_all
        line = (
            "by its law the gas neither cools nor takes heat from the wall (3.3.6); of gas that "
            f"does, {' and '.join(times)} as large would be right, by how well the wall warms it, "
            f"{'which' if is_open else 'as far as'} these tests {'do not ' if is_open else ''}show"
        )
        return (Notice(line, "valves.a.discrete"),)

    def _section(self, estimates: Mapping[str, Estimate]) -> dict[str, Any]:
        """The law's own numbers as a bundle holds them."""
        if self.law == THESIS:
            unreached = Estimate.unidentified(
                _FLOW_UNIT,
                f"no discharge starts above the choked boundary ({self._boundary:.4g} Pa); one "
                "from above it would identify it",
            )
            choked = estimates.get("choked_flow_dis_kg_s", unreached)
            own = {"c_dis": estimates["c_dis"], "choked_flow_dis_kg_s": choked}
            if self.has_temperature:
                own["wall_conductance_w_per_k"] = self._wall(estimates["adiabatic_share"])
            return own
        other = "the tests follow ISO 6358: sonic_conductance and critical_ratio hold its law"
        assumed = Estimate(DEFAULT_INDEX, math.nan, "-", (math.nan, math.nan))
        return {
            "c_dis": Estimate.unidentified(_COEFFICIENT_UNIT, other),
            "choked_flow_dis_kg_s": Estimate.unidentified(_FLOW_UNIT, other),
            "law": {"exhaust": ISO6358},
            "sonic_conductance": {"exhaust": estimates["sonic_conductance"]},
            "critical_ratio": {"exhaust": estimates["critical_ratio"]},
            "subsonic_index": {"exhaust": estimates.get("subsonic_index", assumed)},
            "wall_conductance_w_per_k": self._wall(estimates["adiabatic_share"]),
        }

    def _wall(self, share: Estimate) -> Estimate:
        """The conductance of the tank's wall, W/K, with its interval."""
        if not share.identified:
            return Estimate.unidentified("W/K", str(share.reason))
        if share.value > 1.0:  # no wall takes heat from gas that it warms
            low = min(share.interval[0], 1.0 - NORMAL * share.std)
            share = dataclasses.replace(share, value=1.0, interval=(low, 1.0))
        low, high = share.within(0.0, 1.0).interval
        most, least = (
            float(tank_gas.wall_conductance(limit, self._volume)) if limit > 0.0 else math.inf
            for limit in (low, high)
        )
        if not share.value > _ISOTHERMAL:
            return Estimate.unidentified(
                "W/K",
                f"the gas keeps the room's temperature: its wall conducts more than {least:.2g} "
                "W/K, and how much more does not show",
            )
        value = float(tank_gas.wall_conductance(share.value, self._volume))
        std = tank_gas.wall_scale(self._volume) * share.std / share.value**2
        return Estimate(value, std, "W/K", (least, most))

    def law_of(self, bundle: Bundle) -> Law:
        discrete, tests = bundle.valve("a").discrete, f"{KIND} tests"
        if self.law == THESIS or discrete is None:
            names = [p.name for p in self.parameters() if p.name != "adiabatic_share"]
            law = law_held("valves.a.discrete", discrete, names, tests)
            if not self.has_temperature or discrete is None:
                return law
            return Law({**law.values, "adiabatic_share": self._share_held(discrete)})
        held = {
            key.removesuffix(".exhaust"): estimate
            for key, estimate in discrete.estimates().items()
            if key.endswith(".exhaust")
        }
        values: dict[str, float] = {}
        for key in ("sonic_conductance", "critical_ratio"):
            if key not in held or not held[key].identified:
                why = held[key].reason if key in held else "the bundle does not hold it"
                where = f"valves.a.discrete: {key} is not identified"
                raise NotIdentifiedError(f"{where} ({why}); fit {tests} into the bundle")
            values[key] = held[key].value
        share = self._share_held(discrete)
        index = held.get("subsonic_index")
        more = {"subsonic_index": index.value} if self.fits_index and index is not None else {}
        return Law({**values, "adiabatic_share": share, **more})

    def _share_held(self, discrete: DiscreteLaw) -> float:
        """The share that a bundle's wall leaves adiabatic, 0 where it conducts all that shows."""
        wall = discrete.wall_conductance_w_per_k
        if not isinstance(wall, Estimate) or not wall.identified:
            return 0.0
        return tank_gas.adiabatic_share(wall.value, self._volume)


def _is_a_flow(estimate: Estimate | None) -> bool:
    """Whether a number is known to be one, and not 0."""
    return estimate is not None and estimate.has_interval and estimate.interval[0] > 0.0


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
    found, left_out = discharges(trials, air.atmospheric_pressure_pa)
    return TankComponent(fixed, found, left_out)


__all__ = ["KIND", "TankComponent", "tank"]
