"""A restriction on a bench: settled flow over its two pressures (an ISO 6358 test).

By ISO 6358-1, with sonic conductance C, critical ratio b and, where the readings show it, the
subsonic index m; or by the thesis' filling law (3.6.6), which is choked at 0.53 and falls with the
root of the difference of the pressures.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.diagnosis.bench.component import (
    LEAST_IN_STRETCH,
    STRETCHES,
    Component,
    Law,
    law_held,
    rmse,
    usable,
)
from sysid.errors import NotIdentifiedError, input_error
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import Parameter
from sysid.estimation.quality import FitQuality
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parameters import Bundle, DiscreteLaw, FittedValves, Parts, Valve
from sysid.parameters.quality import quality_field
from sysid.parameters.valves import AUTO, ISO6358, ISO_QUANTITIES, LAW_KEYS, THESIS
from sysid.plant import base
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.iso6358 import (
    ANR_DENSITY,
    ANR_TEMPERATURE,
    DEFAULT_INDEX,
    HIGHEST_RATIO,
    INDICES,
    iso6358_flow,
)
from sysid.types import FloatArray

UPSTREAM, DOWNSTREAM, FLOW = "upstream_pressure_pa", "downstream_pressure_pa", "flow_a_kg_s"
_COLUMNS = (UPSTREAM, DOWNSTREAM, FLOW)
# Conductance and ratio, and two more readings that show how large their error is.
_FEWEST_ROWS = 4
_UNITS = {
    "sonic_conductance": "m3/(s Pa)",
    "c_fill": "kg/(s Pa^0.5)",
    "choked_flow_fill_kg_s": "kg/s",
    "c_dis": "kg/(s Pa)",
    "choked_flow_dis_kg_s": "kg/s",
}


@dataclass(frozen=True)
class RatioStretch:
    """Readings of a test within a range of the ratio of the pressures, in its order.

    `upstream`, `downstream` (n,) Pa absolute, `flow` (n,) kg/s, `temperature` (n,) K of the air.
    """

    test: str
    upstream: FloatArray
    downstream: FloatArray
    flow: FloatArray
    temperature: FloatArray

    @property
    def ratio(self) -> FloatArray:
        """Of the pressures, (n,)."""
        return self.downstream / self.upstream


@dataclass(frozen=True)
class Restriction(Component):
    """Stretches of readings of one restriction. Residuals are flows, kg/s.

    `law` "thesis" or "iso6358"; `fits_index`: whether the subsonic index is fitted too. `way`
    "fill" or "exhaust": the direction of the valve whose law it is. `supply`: Pa at which the
    thesis' choked flow is stated.
    """

    stretches: tuple[RatioStretch, ...]
    supply: float
    way: str = "fill"
    left_out: tuple[str, ...] = ()
    law: str = ISO6358
    fits_index: bool = False

    channel = FLOW
    unit = "kg/s"
    has_constant = False
    refuses_misfit = True

    @property
    def tests(self) -> tuple[str, ...]:
        return tuple(s.test for s in self.stretches)

    @property
    def law_name(self) -> str:
        """The law, and whether its index is fitted."""
        return f"{self.law} with an index of its own" if self.fits_index else self.law

    def forms(self, law: str = AUTO) -> tuple[Restriction, ...]:
        """ISO 6358 with the standard's index and with its own, and the thesis' filling."""
        found = [] if law == ISO6358 else [dataclasses.replace(self, law=THESIS, fits_index=False)]
        if law != THESIS:
            of_iso = [
                dataclasses.replace(self, law=ISO6358, fits_index=fits) for fits in (False, True)
            ]
            # As many numbers as the thesis', and the law that such a test is made for.
            found = [of_iso[0], *found, of_iso[1]]
        return tuple(found)

    def in_form_of(self, bundle: Bundle) -> Restriction:
        held = bundle.valve("a").discrete
        if held is None or held.law_of(self._way) != ISO6358:
            return dataclasses.replace(self, law=THESIS)
        index = held.estimates().get(f"subsonic_index.{self.way}")
        return dataclasses.replace(self, fits_index=index is not None and index.has_error)

    @property
    def _way(self) -> str:
        """The direction as the model's names have it."""
        return "dis" if self.way == "exhaust" else "fill"

    def parameters(self) -> list[Parameter]:
        upstream, flow = self._pooled("upstream"), self._pooled("flow")
        if self.law == THESIS:
            difference = np.maximum(upstream - self._pooled("downstream"), 1.0)
            start = float(np.median(flow / np.sqrt(difference)))
            choked = float(np.max(flow / upstream)) * self.supply
            return [
                Parameter("c_fill", start, _UNITS["c_fill"], 0.0),
                Parameter("choked_flow_fill_kg_s", choked, "kg/s", 0.0),
            ]
        cold = np.sqrt(self._pooled("temperature") / ANR_TEMPERATURE)
        start = float(np.max(flow * cold / upstream)) / ANR_DENSITY
        own = [
            Parameter("sonic_conductance", start, _UNITS["sonic_conductance"], 0.0),
            Parameter("critical_ratio", 0.35, "-", 0.0, HIGHEST_RATIO, 1.0),
        ]
        if self.fits_index:
            own.append(Parameter("subsonic_index", DEFAULT_INDEX, "-", *INDICES))
        return own

    def _pooled(self, name: str) -> FloatArray:
        return np.concatenate([getattr(s, name) for s in self.stretches])

    def effects(
        self, catalogue: Mapping[str, type[CatalogueEffect]]
    ) -> tuple[type[CatalogueEffect], ...]:
        """None: both pressures are measured, and nothing moves, switches or is stored."""
        return ()

    def flow(self, law: Law, at: RatioStretch) -> FloatArray:
        """Modelled flow at readings' pressures, kg/s, (n,)."""
        v = law.values
        if self.law == THESIS:
            choked, c_fill = v["choked_flow_fill_kg_s"], v["c_fill"]
            return np.asarray(
                base.filling_flow(at.downstream, at.upstream, choked, c_fill, self.supply)
            )
        index = v.get("subsonic_index", DEFAULT_INDEX)
        return np.asarray(
            iso6358_flow(
                at.upstream, at.downstream, v["sonic_conductance"], v["critical_ratio"], index,
                at.temperature,
            )
        )  # fmt: skip

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        return [self.stretches[t].flow - self.flow(law, self.stretches[t]) for t in tests]

    def measured(self, tests: Sequence[int]) -> list[FloatArray]:
        return [self.stretches[t].flow for t in tests]

    def regressors(self, tests: Sequence[int]) -> dict[str, FloatArray]:
        chosen = [self.stretches[t] for t in tests]
        return {
            "ratio of the pressures": np.concatenate([s.ratio for s in chosen]),
            UPSTREAM: np.concatenate([s.upstream for s in chosen]),
        }

    def noise_floor(self, law: Law) -> float:
        """Of the flows next to one another in the ratio of the pressures, less the line between
        their neighbours: what a law lacks is smooth, and vanishes."""
        ratio = self._pooled("ratio")
        left = np.concatenate(self.residuals(law, range(len(self.stretches))))
        order = np.argsort(ratio, kind="stable")
        ratio, left = ratio[order], left[order]
        if len(left) < 3:
            return math.nan
        width = ratio[2:] - ratio[:-2]
        share = np.where(width > 0.0, (ratio[1:-1] - ratio[:-2]) / np.where(width, width, 1.0), 0.5)
        off = left[1:-1] - (1.0 - share) * left[:-2] - share * left[2:]
        return rmse([off / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)])

    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        law: dict[str, Any] = {
            key: Estimate.unidentified(_UNITS[key], self._why_not(key)) for key in LAW_KEYS.values()
        }
        if self.law == THESIS:
            law |= estimates
        else:
            assumed = Estimate(DEFAULT_INDEX, math.nan, "-", (math.nan, math.nan))
            law["law"] = {self.way: ISO6358}
            for name in ISO_QUANTITIES:
                law[name] = {self.way: estimates.get(name, assumed)}
        law |= quality_field(quality, "discharge" if self.way == "exhaust" else "fill")
        return Parts(valves=FittedValves(a=Valve(discrete=DiscreteLaw.model_validate(law))))

    def _why_not(self, key: str) -> str:
        if key.removesuffix("_kg_s").endswith(self._way) and self.law == ISO6358:
            return "the readings follow ISO 6358: sonic_conductance and critical_ratio hold its law"
        return "no flow was measured in this direction"

    def law_of(self, bundle: Bundle) -> Law:
        discrete, tests = bundle.valve("a").discrete, "valve-flow tests"
        names = [p.name for p in self.parameters()]
        if self.law == THESIS or discrete is None:
            return law_held("valves.a.discrete", discrete, names, tests)
        held = discrete.estimates()
        values = {}
        for name in names:
            found = held.get(f"{name}.{self.way}")
            if found is None or not found.identified:
                why = "the bundle does not hold it" if found is None else found.reason
                where = f"valves.a.discrete: {name} is not identified"
                raise NotIdentifiedError(f"{where} ({why}); fit {tests} into the bundle")
            values[name] = found.value
        return Law(values)


def is_over_pressures(trial: Trial) -> bool:
    """Whether a test has the flow over two pressures, and no duty that is swept."""
    duty = trial.channels.get("duty_a")
    swept = duty is not None and float(np.ptp(duty)) > 0.0
    named = {*trial.channels, *trial.unusable}
    return not swept and bool({UPSTREAM, DOWNSTREAM} & named)


def restriction(trials: Sequence[Trial], rig: Rig) -> Restriction:
    """The restriction whose readings `trials` hold: upstream and downstream pressure and flow.

    A settled reading a row; `temperature_k`, else the rig file's, is that of the air. With a
    `valve_a` that is 0 throughout it is the valve's exhaust, else its filling. Raises InputError
    for a column that is missing or impossible, NotIdentifiedError for too few readings.
    """
    air = rig.air
    room = ANR_TEMPERATURE if air is None else air.temperature_k
    found, left_out = usable(trials, lambda trial: _readings(trial, room))
    highest = max(float(np.max(s.upstream)) for own in found for s in own)
    off = [t for t in trials if "valve_a" in t and not np.any(t["valve_a"])]
    return Restriction(
        tuple(s for own in found for s in own),
        highest if air is None else air.supply_pressure_pa,
        "exhaust" if trials and len(off) == len(trials) else "fill",
        tuple(left_out),
    )


def _readings(trial: Trial, room: float) -> list[RatioStretch]:
    trial.require(_COLUMNS, "which a valve-flow test over two pressures needs")
    upstream, downstream, flow = (trial[name] for name in _COLUMNS)
    for name in (UPSTREAM, DOWNSTREAM):
        least = float(np.min(trial[name]))
        if not least > 0.0:
            raise input_error(
                trial.source,
                f"{name} = {least:g} is not above 0 Pa: pressures are absolute",
                f'add the atmosphere, or map it as gauge: --map "{name}=COLUMN:Pa(g)"',
            )
    if len(flow) < _FEWEST_ROWS or not np.any(flow > 0.0):
        raise NotIdentifiedError(
            f"{trial.source}: sonic_conductance is not identified: {len(flow)} readings, of which "
            f"{int(np.count_nonzero(flow > 0.0))} have a flow; {_FEWEST_ROWS} at several ratios of "
            "the pressures would identify it"
        )
    temperature = trial["temperature_k"] if "temperature_k" in trial else np.full(len(flow), room)
    order = np.argsort(downstream / upstream, kind="stable")
    count = max(1, min(STRETCHES, len(flow) // LEAST_IN_STRETCH))
    return [
        RatioStretch(
            trial.title, *(v[np.sort(rows)] for v in (upstream, downstream, flow, temperature))
        )
        for rows in np.array_split(order, count)
    ]


__all__ = [
    "DOWNSTREAM",
    "UPSTREAM",
    "RatioStretch",
    "Restriction",
    "is_over_pressures",
    "restriction",
]
