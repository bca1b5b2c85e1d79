"""A bundle's valves: the on/off law, PWM surfaces, and the laws of a valve on a bench."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, JsonValue, model_validator

from sysid.estimation.linear import Estimate
from sysid.parameters.base import Absent, Lenient, Number, Part, Unread
from sysid.parameters.correlation import CorrelatedPart
from sysid.parameters.quality import Quality, QualityByName
from sysid.parameters.series import control_coefficient
from sysid.plant.iso6358 import DEFAULT_INDEX
from sysid.surfaces.kinds import SURFACES

Range = Annotated[list[Number], Field(min_length=2, max_length=2)]
DIRECTIONS = ("fill", "discharge")
SURFACE_KINDS = tuple(SURFACES)
AVERAGED = "averaged"
# The flow parameters of a valve's law: the model's names, and the bundle's keys.
LAW_KEYS = {
    "choked_fill": "choked_flow_fill_kg_s",
    "choked_dis": "choked_flow_dis_kg_s",
    "c_fill": "c_fill",
    "c_dis": "c_dis",
}
LAW_UNITS = {
    "choked_flow_fill_kg_s": "kg/s",
    "c_fill": "kg/(s Pa^0.5)",
    "choked_flow_dis_kg_s": "kg/s",
    "c_dis": "kg/(s Pa)",
}
"""Of the thesis' flow law, by its keys in a bundle."""


# The numbers of a direction that obeys ISO 6358, likewise: keys within keys.
THESIS, ISO6358, SERIES, AUTO = "thesis", "iso6358", "thesis-series", "auto"
LAWS = (THESIS, ISO6358, SERIES)
LAW_NAMES = {THESIS: "the thesis' law", ISO6358: "ISO 6358", SERIES: "a flow control in series"}
"""As a sentence names them."""
WAYS = {"fill": "fill", "dis": "exhaust"}
"""The directions of a valve: the model's names, and the bundle's."""
ISO_QUANTITIES = ("sonic_conductance", "critical_ratio", "subsonic_index")
ISO_KEYS = {
    f"{quantity}_{way}": f"{quantity}.{key}"
    for way, key in WAYS.items()
    for quantity in ISO_QUANTITIES
}
# With a flow control in series (thesis 3.6): the coefficient of the valve alone, and that of the
# flow control alone. The law needs the first, and that of both, `c_fill` or `c_dis`.
VALVE_ALONE = {way: f"valve_c_{way}" for way in WAYS}
FLOW_CONTROL = {way: f"control_c_{way}" for way in WAYS}

BY_ISO = "the direction obeys ISO 6358: sonic_conductance and critical_ratio are its law"


class ByDirection(Part):
    """A number of each direction of a valve: while it fills, and while it exhausts."""

    fill: Absent[Estimate] = None
    exhaust: Absent[Estimate] = None


LawName = Literal["thesis", "iso6358", "thesis-series"]


class LawNames(Part):
    """The flow law of each direction of a valve: "thesis", "iso6358" or "thesis-series"."""

    fill: Absent[LawName] = None
    exhaust: Absent[LawName] = None


def by_direction(estimates: Mapping[str, Estimate], laws: Mapping[str, str]) -> dict[str, Any]:
    """Estimates by the model's names as `DiscreteLaw` holds them: those of ISO 6358 by direction.

    `laws` names the law of each direction, "fill" and "dis".
    """
    iso = [way for way in WAYS if laws.get(way) == ISO6358]
    index = Estimate(DEFAULT_INDEX, 0.0, "-", (DEFAULT_INDEX, DEFAULT_INDEX))
    estimates = {**{f"subsonic_index_{way}": index for way in iso}, **estimates}
    unused = [key for name, key in LAW_KEYS.items() if _way(name) in iso]
    estimates = {**dict.fromkeys(unused, Estimate.unidentified("", BY_ISO)), **estimates}
    own = {f"{quantity}_{way}" for quantity in ISO_QUANTITIES for way in iso}
    found: dict[str, Any] = {name: e for name, e in estimates.items() if name not in own}
    if any(laws.get(way, THESIS) != THESIS for way in WAYS):
        found["law"] = {key: laws.get(way, THESIS) for way, key in WAYS.items()}
    for quantity in ISO_QUANTITIES if iso else ():
        found[quantity] = {WAYS[way]: estimates[f"{quantity}_{way}"] for way in iso}
    return found


def _way(name: str) -> str:
    """The direction of one of the model's names, "fill" or "dis"."""
    return name.rsplit("_", 1)[1]


class DirectionalLaw(Part):
    """A valve's flow by the law of each direction: the thesis' numbers, or those of ISO 6358.

    `law` names it; a direction that obeys ISO 6358 has `sonic_conductance` in m3/(s Pa) at ANR,
    `critical_ratio` and `subsonic_index`, and its numbers of the thesis' law are not identified.
    `estimates` has them by dotted keys. With a flow control in series ("thesis-series"), `c_fill`
    and `c_dis` are the coefficients of both, `valve_c_fill` and `control_c_fill` (or `_dis`) those
    of the valve and of the flow control alone, in the same units.
    """

    law: Absent[LawNames] = None
    valve_c_fill: Absent[Estimate] = None
    valve_c_dis: Absent[Estimate] = None
    control_c_fill: Absent[Estimate] = None
    control_c_dis: Absent[Estimate] = None
    sonic_conductance: Absent[ByDirection] = None
    critical_ratio: Absent[ByDirection] = None
    subsonic_index: Absent[ByDirection] = None

    @model_validator(mode="after")
    def _has_its_law(self) -> Self:
        for way, key in WAYS.items():
            lacks = [q for q in ISO_QUANTITIES if self._iso(q, key) is None]
            if self.law_of(way) == ISO6358 and lacks:
                raise ValueError(f"law.{key} is iso6358, but {lacks[0]}.{key} is missing")
        return self

    def law_of(self, way: str) -> str:
        """The law of a direction, "fill" or "dis", one of LAWS."""
        return (None if self.law is None else getattr(self.law, WAYS[way])) or THESIS

    def _iso(self, quantity: str, key: str) -> Estimate | None:
        held = getattr(self, quantity)
        return None if held is None else getattr(held, key)

    def flow_keys(self) -> dict[str, str]:
        """The numbers of its law in force: the model's names, and their keys in `estimates`."""
        return {**self.thesis_keys(), **self.iso_keys(), **self.series_keys()}

    def thesis_keys(self) -> dict[str, str]:
        """Those of the directions that obey the thesis' law, with a flow control or without."""
        return {n: k for n, k in LAW_KEYS.items() if self.law_of(_way(n)) != ISO6358}

    def series_keys(self) -> dict[str, str]:
        """The coefficients of the valve alone, where they are known, of directions with a flow
        control: without one the choked boundary is that of the chamber's pressure."""
        held = {way: getattr(self, name) for way, name in VALVE_ALONE.items()}
        return {
            VALVE_ALONE[way]: VALVE_ALONE[way]
            for way, own in held.items()
            if self.law_of(way) == SERIES and own is not None and own.identified
        }

    def iso_keys(self) -> dict[str, str]:
        """Those of the directions that obey ISO 6358."""
        return {n: k for n, k in ISO_KEYS.items() if self.law_of(_way(n)) == ISO6358}

    def estimates(self) -> dict[str, Estimate]:
        """The numbers of its law by key; those of a direction as `sonic_conductance.fill`."""
        unused = set(LAW_KEYS.values()) - set(self.thesis_keys().values())
        found = {key: e for key, e in super().estimates().items() if key not in unused}
        for quantity in ISO_QUANTITIES:
            held = getattr(self, quantity)
            if held is not None:
                found |= {f"{quantity}.{key}": e for key, e in held.estimates().items()}
        return found

    def replaced(self, **fields: Any) -> Self:
        """A copy with other values; a number of a direction by its dotted key."""
        nested: dict[str, dict[str, Any]] = {}
        for dotted in [key for key in fields if "." in key]:
            quantity, key = dotted.split(".")
            nested.setdefault(quantity, {})[key] = fields[dotted]
        plain = {key: value for key, value in fields.items() if "." not in key}
        for quantity, values in nested.items():
            plain[quantity] = (getattr(self, quantity) or ByDirection()).replaced(**values)
        return super().replaced(**plain, **self._flow_controls(plain))

    def _flow_controls(self, fields: Mapping[str, Any]) -> dict[str, Estimate]:
        """The flow controls' own coefficients where what they follow from is replaced."""
        found = {}
        for way, key in FLOW_CONTROL.items():
            names = f"c_{way}", VALVE_ALONE[way]
            both, own = (fields.get(name, getattr(self, name, None)) for name in names)
            renewed = key not in fields and not fields.keys().isdisjoint(names)
            if renewed and getattr(self, key) is not None and both and own:
                found[key] = control_coefficient(way, both, own)
        return found


class RejectedLaw(Part):
    """A flow law that the tests do not follow as well, as it was fitted to them.

    `numbers` by the keys of `DiscreteLaw` with the direction behind, SI; `rmse_pa` over all tests.
    """

    law: LawName
    numbers: dict[str, Number]
    rmse_pa: Number


class LawDecision(Part):
    """Why a valve has its flow law, and the laws that were fitted and not chosen."""

    why: str
    rejected: list[RejectedLaw] = Field(default_factory=list)


class OpenLaw(Part):
    """A flow law that tests do not rule out, with what they say of its `numbers`, by key."""

    law: str
    numbers: dict[str, Estimate]


class DiscreteLaw(DirectionalLaw, CorrelatedPart):
    """The on/off law of one valve (thesis 3.6.6, 3.6.10) with its delays.

    `c_fill` in kg/(s Pa^0.5), `c_dis` in kg/(s Pa). The critical ratios and the jumps at the
    choked boundaries are checks. `noise_pa`, `rmse_pa` and `fit_percent` refer to the curves,
    `quality` to those of one direction ("fill", "discharge"); `correlation` to the errors of
    flows, coefficients and delays. `declared` lists the numbers that are a data sheet's.
    `wall_conductance_w_per_k` is that of a tank's wall, from which its gas is warmed. `choice` says
    why the tests have this law, with the laws that they do not have; `by_law` has the laws that the
    tests of a part alone do not distinguish, each with its own errors.
    """

    c_fill: Estimate
    c_dis: Estimate
    choked_flow_fill_kg_s: Estimate
    choked_flow_dis_kg_s: Estimate
    on_delay_s: Lenient[Estimate | None] = None
    off_delay_s: Lenient[Estimate | None] = None
    critical_ratio_fill: Lenient[Estimate | None] = None
    critical_ratio_dis: Lenient[Estimate | None] = None
    jump_fill_percent: Lenient[Estimate | None] = None
    jump_dis_percent: Lenient[Estimate | None] = None
    supply_pressure_pa: Lenient[Number | None] = None
    rmse_pa: Lenient[Number | None] = None
    noise_pa: Lenient[Number | None] = None
    fit_percent: Lenient[Number | None] = None
    quality: QualityByName = None
    tests: Lenient[list[str] | None] = None
    wall_conductance_w_per_k: Lenient[Estimate | None] = None
    declared: Lenient[list[str] | None] = None
    choice: Lenient[LawDecision | None] = None
    by_law: Lenient[list[OpenLaw] | None] = None

    def replaced(self, **fields: Any) -> Self:
        """As `DirectionalLaw.replaced`; a number replaced loses what a fit said with it."""
        made = super().replaced(**fields)
        renewed = not fields.keys().isdisjoint(self.estimates())
        stale = "correlation" not in fields and not fields.keys().isdisjoint(self._correlated())
        if renewed and "by_law" not in fields and made.by_law is not None:
            made = made.without("by_law")
        return made.without("correlation") if stale and made.correlation is not None else made


class DomainRecord(Part):
    """Where a surface is valid: duty and pressure (Pa) ranges, and limits at nodes of pressure."""

    duty: Range
    pressure_pa: Range
    nodes: dict[str, list[Number]]


class DutyErrors(Part):
    """Errors of a surface's inverse, in duty, and the number of points."""

    rmse: Number
    max_relative_error_percent: Number
    max_error_points: Number
    p95_error_points: Number
    n_parameters: int
    n_points: int


class Surface(Part):
    """Mean flow over duty and pressure, or its inverse, as fitted; `model` evaluates it.

    `rmse_duty` and `max_relative_error_duty_percent` refer to held-out tests where there are
    any, `errors_duty` to training and held-out tests. A bipolynomial holds `coefficients`, a
    network its weights and biases.
    """

    kind: Absent[str] = None
    coefficients: JsonValue = None
    activation: JsonValue = None
    hidden_weights: JsonValue = None
    hidden_bias: JsonValue = None
    output_weights: JsonValue = None
    output_bias: JsonValue = None
    scaling: JsonValue = None
    domain: Lenient[DomainRecord | None] = None
    rmse_duty: Lenient[Number | None] = None
    max_relative_error_duty_percent: Lenient[Number | None] = None
    rmse_flow_kg_s: Lenient[Number | None] = None
    held_out_rmse_duty: Lenient[Number | None] = None
    n_samples: Lenient[int | None] = None
    constrained: Lenient[bool | None] = None
    training: JsonValue = None
    errors_duty: Lenient[dict[str, DutyErrors]] = Field(default_factory=dict)
    quality: Quality = None

    def errors(self, use: str) -> DutyErrors | None:
        """Its errors in duty on tests that were "fitted" or "held_out"; None where unknown."""
        known = self.errors_duty
        return None if isinstance(known, Unread) else known.get(use)

    def model(self, where: str = "PWM surface") -> Any:
        """The `Bipolynomial` or `DutyNetwork`. Raises InputError, naming `where`, for a bad one."""
        from sysid.surfaces import surface_from_dict

        return surface_from_dict(self.to_json(), where)


class SurfaceChoice(Part):
    """Comparison of the two surfaces on the same held-out tests, in duty."""

    bipolynomial: DutyErrors
    network: DutyErrors
    noise_rmse: Number | None
    recommended: str
    reason: str
    n_tests: int
    folds: int
    seed: int
    ratio: Number | None = None


class ResolutionRecord(Part):
    """Error in flow, as a share, by the step of duty between tests."""

    steps: list[Number]
    max_flow: list[Number | None]
    tests: list[int]
    coarsest: Number | None = None


class PwmSurfaces(Part):
    """The surfaces of one valve in one direction, at one PWM period and supply pressure.

    A direction that the tests do not identify has `identified` false and a `reason`.
    """

    supply_pressure_pa: Lenient[Number | None] = None
    pwm_period_s: Lenient[Number | None] = None
    n_tests: Lenient[int | None] = None
    n_samples: Lenient[int | None] = None
    bipolynomial: Lenient[Surface | None] = None
    ann: Lenient[Surface | None] = None
    comparison: Lenient[SurfaceChoice | None] = None
    resolution_study: Lenient[ResolutionRecord | None] = None
    hidden_size_sweep: JsonValue = None
    identified: Lenient[Literal[False] | None] = None
    reason: Lenient[str | None] = None

    def surface(self, kind: str) -> Surface | None:
        """The surface of one of SURFACE_KINDS; None without a readable one."""
        found = getattr(self, kind)
        return found if isinstance(found, Surface) else None

    def surfaces(self) -> dict[str, Surface]:
        """The surfaces by kind."""
        found = {kind: self.surface(kind) for kind in SURFACE_KINDS}
        return {kind: surface for kind, surface in found.items() if surface is not None}


class AveragedRecord(DirectionalLaw):
    """The averaged law of one valve, fitted to its mean flows in both directions.

    `c_fill` in kg/(s Pa^0.5), `c_dis` in kg/(s Pa); `delay_difference_s` is how much later
    the valve closes than it opens. `errors_duty` by direction, of held-out tests ("held_out") and
    of all ("fitted").
    """

    c_fill: Estimate
    c_dis: Estimate
    choked_flow_fill_kg_s: Estimate
    choked_flow_dis_kg_s: Estimate
    delay_difference_s: Estimate
    supply_pressure_pa: Lenient[Number | None] = None
    pwm_period_s: Lenient[Number | None] = None
    rmse_flow_kg_s: Lenient[Number | None] = None
    n_tests: Lenient[int | None] = None
    n_samples: Lenient[int | None] = None
    errors_duty: Lenient[dict[str, dict[str, DutyErrors]]] = Field(default_factory=dict)
    quality: QualityByName = None

    def errors(self, direction: str, use: str) -> DutyErrors | None:
        """Its errors in duty in a direction, on "fitted" or "held_out" tests; None if unknown."""
        known = self.errors_duty
        return None if isinstance(known, Unread) else known.get(direction, {}).get(use)


class PwmDirections(Part):
    """The PWM surfaces of one valve by direction, and the averaged law of both."""

    fill: Absent[PwmSurfaces] = None
    discharge: Absent[PwmSurfaces] = None
    averaged: Lenient[AveragedRecord | None] = None

    def directions(self) -> dict[str, PwmSurfaces]:
        """The directions present, "fill" and "discharge", in the file's order."""
        return {key: getattr(self, key) for key in self.given() if key in DIRECTIONS}


class SteadyLaw(Part):
    """A valve on a bench whose settled flow was measured over duty."""

    full_flow_kg_s: Estimate
    quality: Quality = None


class TimingLaw(Part):
    """A valve on a bench whose time to a pressure was measured over duty."""

    filling_time_s: Estimate
    emptying_time_s: Estimate
    quality: Quality = None


class Valve(Part):
    """All fitted laws of one valve."""

    discrete: Absent[DiscreteLaw] = None
    pwm: Absent[PwmDirections] = None
    steady: Absent[SteadyLaw] = None
    timing: Absent[TimingLaw] = None

    def surfaces(self, direction: str) -> PwmSurfaces | None:
        """The PWM surfaces of a direction; None without any."""
        return None if self.pwm is None else self.pwm.directions().get(direction)

    def averaged(self) -> AveragedRecord | None:
        """The averaged law that was fitted to PWM tests; None without one that can be read."""
        found = None if self.pwm is None else self.pwm.averaged
        return found if isinstance(found, AveragedRecord) else None

    def merged(self, other: Valve) -> Valve:
        """The valve with the laws of `other`; PWM surfaces are merged by direction."""
        fields = {key: getattr(other, key) for key in other.given()}
        if self.pwm is not None and other.pwm is not None:
            directions = {key: getattr(other.pwm, key) for key in other.pwm.given()}
            fields["pwm"] = self.pwm.replaced(**directions)
        return self.replaced(**fields)


class FittedValves(Part):
    """Valves A and B."""

    model_config = ConfigDict(extra="forbid")

    a: Absent[Valve] = None
    b: Absent[Valve] = None

    def side(self, side: str) -> Valve:
        """The valve of a side, "a" or "b"; an empty one where nothing was fitted."""
        found = self.a if side == "a" else self.b
        return Valve() if found is None else found

    def sides(self) -> dict[str, Valve]:
        """The valves with a fitted law, in the file's order."""
        return {key: getattr(self, key) for key in self.given()}

    def discrete_laws(self) -> dict[str, DiscreteLaw]:
        """The on/off laws by side."""
        laws = {side: valve.discrete for side, valve in sorted(self.sides().items())}
        return {side: law for side, law in laws.items() if law is not None}

    def merged(self, other: FittedValves) -> FittedValves:
        """The valves with the laws of `other` for each; PWM surfaces are merged by direction."""
        known = self.sides()
        return self.replaced(
            **{k: known[k].merged(v) if k in known else v for k, v in other.sides().items()}
        )


__all__ = [
    "AUTO",
    "AVERAGED",
    "BY_ISO",
    "DIRECTIONS",
    "FLOW_CONTROL",
    "ISO6358",
    "ISO_KEYS",
    "ISO_QUANTITIES",
    "LAWS",
    "LAW_KEYS",
    "LAW_NAMES",
    "LAW_UNITS",
    "SERIES",
    "SURFACE_KINDS",
    "THESIS",
    "VALVE_ALONE",
    "WAYS",
    "AveragedRecord",
    "ByDirection",
    "DirectionalLaw",
    "DiscreteLaw",
    "DomainRecord",
    "DutyErrors",
    "FittedValves",
    "LawDecision",
    "LawName",
    "LawNames",
    "OpenLaw",
    "PwmDirections",
    "PwmSurfaces",
    "RejectedLaw",
    "ResolutionRecord",
    "SteadyLaw",
    "Surface",
    "SurfaceChoice",
    "TimingLaw",
    "Valve",
    "by_direction",
]
