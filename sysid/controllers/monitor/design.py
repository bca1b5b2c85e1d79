"""What a monitor knows of its machine: the model, the noise, the scatter, the bundle's errors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from sysid.controllers.effective_law import edge_delay
from sysid.controllers.monitor.drifts import CHAMBER, COUNT, FLOWS, NAMES, SHAFT
from sysid.controllers.monitor.evidence import Pool
from sysid.controllers.monitor.observer import ShaftNumbers
from sysid.controllers.monitor.terms import Noise
from sysid.errors import NotIdentifiedError, input_error
from sysid.io.channels import SIDES
from sysid.io.motion import MotionUnits
from sysid.io.rig import END_MARGIN, Rig
from sysid.parameters.assembled_model import model_from_bundle
from sysid.parameters.base import read_number
from sysid.parameters.content import BundleContent
from sysid.parameters.declared import DECLARED_ERROR
from sysid.parameters.scatter import friction_scatter
from sysid.parameters.table import ParameterRow, table_of
from sysid.plant import valve_laws
from sysid.plant.effects.entry import Catalogue
from sysid.plant.ports import Model, has_discrete_law, overrides
from sysid.types import FloatArray

_FEW = "a monitor tells drift from the motion of two chambers and a shaft"


@dataclass(frozen=True)
class MonitorDesign:
    """A monitor's constants, of one machine; drifts in the order of `drifts.DRIFTS`.

    `scales` (p,) are the drifts' units of calculation, SI. In these: `scatter` (p, r) has a column
    for each cause that changes from cycle to cycle by one standard deviation, `errors` (p, p) is
    the covariance of the bundle's own errors, `learning` (p,) the further variances of what the
    first cycles teach. `delays`: of each valve's opening and closing, s.
    `swept`, `choked`: those of `observer.chamber_ahead` and `terms.chamber_terms`, of each chamber.
    `assumed`: drifts whose error in the bundle is not known and taken as 3 %.
    """

    model: Model
    units: MotionUnits
    noise: Noise
    shaft: ShaftNumbers
    scales: FloatArray
    scatter: FloatArray
    errors: FloatArray
    learning: FloatArray
    delays: Mapping[str, tuple[float, float]]
    swept: Mapping[str, float]
    choked: Mapping[str, tuple[float, float]]
    stroke: float
    speed: float
    assumed: tuple[str, ...]

    def chamber_scales(self, side: str) -> tuple[float, ...]:
        """The scales of a chamber's drifts."""
        return tuple(float(self.scales[k]) for k in CHAMBER[side])

    def pool(self) -> Pool:
        """The sums of a monitor that begins."""
        return Pool(self.scatter, self.errors, self.scales, self.learning)

    @property
    def shaft_scales(self) -> tuple[float, ...]:
        """The scales of the shaft's drifts."""
        return tuple(float(self.scales[k]) for k in SHAFT)

    @property
    def position_variance(self) -> float:
        """Of the position's readings."""
        return float(self.noise.position**2)

    @property
    def pressure_variance(self) -> float:
        """Of the pressures' readings."""
        return float(self.noise.pressure**2)


def monitor_design(
    bundle: BundleContent, catalogue: Catalogue | None = None, period: float | None = None
) -> MonitorDesign:
    """The monitor of a bundle; `period` of its samples, s (None: the rig file's).

    Raises NotIdentifiedError, or InputError, where the bundle or its rig lacks what it needs: both
    chambers, both valves' on/off laws, friction, the sensors' noise and resolution; or where an
    effect is one that it cannot follow.
    """
    rig = bundle.rig
    if len(rig.sides) < len(SIDES) or rig.is_motor_alone or rig.bleeds:
        own = "a motor alone" if rig.is_motor_alone else "one chamber"
        raise NotIdentifiedError(
            f"{bundle.source}: {_FEW}, and the rig has {own}; fit its tests again from time to "
            "time and give the bundles to `sysid compare`"
        )
    whole = model_from_bundle(bundle, rig, catalogue)
    if not has_discrete_law(whole.parameters):
        raise NotIdentifiedError(
            f"{bundle.source}: {_FEW}, and needs both valves' on/off laws; fit valve-discrete tests"
        )
    _check_effects(bundle, whole)
    model = whole.settled()
    p = model.parameters
    noise = Noise(_pressure_noise(bundle), _position_noise(rig), period or _period(rig))
    radius = float(p.pitch_radius)
    lever = radius * math.hypot(float(p.area_a), float(p.area_b))
    inertia, breakaway = float(p.inertia), max(float(p.static_effort), float(p.coulomb_effort))
    travel = 0.5 * float(p.stroke) / radius
    gas = float(p.gas_constant) * float(p.temperature)
    areas = {"a": float(p.area_a), "b": float(p.area_b)}
    found = dict(_errors(bundle, model))
    scales = np.array([_scale(name, model, breakaway) for name in NAMES])
    std = np.array([found.get(name, (0.0, True))[0] for name in NAMES]) / scales
    errors = np.diag(std**2)
    _correlate(errors, bundle)
    return MonitorDesign(
        model=model,
        units=rig.units,
        noise=noise,
        # A step takes the mean of the pressures at its two ends.
        shaft=ShaftNumbers(
            inertia,
            float(p.viscous),
            breakaway,
            0.5 * (lever * noise.pressure / inertia) ** 2,
            (1.0 - 2.0 * END_MARGIN) * travel,
        ),
        scales=scales,
        scatter=_scatter(bundle, model, scales),
        errors=errors,
        learning=_learning(model, scales),
        delays={
            side: (edge_delay(side, True, whole, 0.0), edge_delay(side, False, whole, 0.0))
            for side in SIDES
        },
        swept={
            side: math.sqrt(2.0) * noise.position * radius * area / gas
            for side, area in areas.items()
        },
        choked={side: _choked(model, side) for side in SIDES},
        stroke=2.0 * travel,
        # A shaft that starts anew moves at most about as fast as breakaway takes it over its
        # travel: what its first readings say counts in any case.
        speed=math.sqrt(2.0 * (breakaway + lever * float(p.supply)) * travel / inertia),
        assumed=tuple(name for name, (_, known) in found.items() if not known),
    )


def _choked(model: Model, side: str) -> tuple[float, float]:
    """The pressures up to which filling and from which on the exhaust is choked, Pa."""
    p = model.parameters
    valve = p.valve(side)
    return (
        float(valve_laws.filling_boundary(valve, p.supply)),
        float(valve_laws.exhaust_boundary(valve, p.atmosphere)),
    )


def _check_effects(bundle: BundleContent, model: Model) -> None:
    for effect in model.effects:
        name = getattr(effect, "id", type(effect).__name__)
        why = ""
        if overrides(effect, "start_sensing", "sense", "measure"):
            why = "changes what a sensor shows"
        elif overrides(effect, "pulses"):
            why = "changes the valves' pulses"
        if why:
            raise input_error(
                f"{bundle.source}, effect {name}",
                f"{why}, which a monitor does not follow",
                "monitor with a bundle without it, or correct the sensor",
            )


def _period(rig: Rig) -> float:
    if rig.sampling is None:
        raise input_error(
            rig.source, "declares no sampling period, which a monitor needs", "add [sampling]"
        )
    return float(rig.sampling.period_s)


def _pressure_noise(bundle: BundleContent) -> float:
    declared = bundle.rig.sensors.pressure_noise_pa
    if declared:
        return float(declared)
    laws = (bundle.valve(side).discrete for side in SIDES)
    found = (read_number(law.noise_pa) for law in laws if law is not None)
    shown = [noise for noise in found if noise]
    if not shown:
        raise input_error(
            bundle.source,
            "neither the rig file nor a valve's tests give the pressure sensors' noise",
            "add [sensors] pressure_noise_pa to the rig file",
        )
    return max(shown)


def _position_noise(rig: Rig) -> float:
    step = rig.encoder_step
    if step is None:
        raise input_error(
            rig.source,
            "does not give the encoder's resolution, which a monitor needs",
            f"add [sensors] {rig.units.encoder_counts}",
        )
    return step / math.sqrt(12.0)


def _scale(name: str, model: Model, breakaway: float) -> float:
    """A unit of calculation for a drift: about what matters, so that no number is extreme."""
    p = model.parameters
    supply = float(p.supply)
    flow = max(abs(float(p.choked_fill_a)), abs(float(p.choked_fill_b)), 1e-6)
    if name == "coulomb" or name == "offset":
        return max(0.1 * breakaway, 1e-6)
    if name == "viscous":
        return max(0.1 * float(p.viscous), 1e-6)
    if "leak" in name:
        return 0.01 * flow / supply**2
    if "delay" in name:
        return 1e-4
    return 0.01 * supply if name == "supply" else 0.01


def _errors(bundle: BundleContent, model: Model) -> Iterator[tuple[str, tuple[float, bool]]]:
    """Each drift's standard error in the bundle, SI, and whether it is known.

    Of a leak: what the valve's tests cannot distinguish from its exhaust, the flow of one standard
    error of the choked exhaust out of a chamber at the supply pressure.
    """
    p = model.parameters
    squares, leaks = abs(float(p.supply) ** 2 - float(p.atmosphere) ** 2), list[float]()
    rows = [row for row in table_of(bundle).rows if row.status in ("fitted", "declared")]
    for name, value in (("coulomb", p.coulomb_effort), ("viscous", p.viscous)):
        own = [row for row in rows if row.origin == "friction" and row.name == name]
        yield name, _std(own, float(value), 0.0)
    for side in SIDES:
        valve = [r for r in rows if r.side == side and r.part == f"valves.{side}.discrete"]
        for name in FLOWS:
            known = [share for r in valve if r.name in _of_flow(name) for share in _relative(r)]
            error = (math.hypot(*known), True) if known else (DECLARED_ERROR, False)
            yield f"{name}_{side}", error
            if name == "choked_dis":
                leak = error[0] * float(p.choked_dis_a if side == "a" else p.choked_dis_b) / squares
                leaks.append(leak)
                yield f"leak_{side}", (leak, error[1])
        for edge in ("on", "off"):
            own = [row for row in valve if row.name == f"{edge}_delay"]
            used = float(getattr(p, f"{edge}_delay_{side}"))
            off = [row.estimate.value - used for row in own if row.estimate.identified]
            yield f"{edge}_delay_{side}", _std(own, used, off[0] if off else 0.0)
    yield "piston_leak", (max(leaks), True)
    yield "supply", _supply_error(bundle, float(p.supply))


def _of_flow(name: str) -> tuple[str, ...]:
    """The numbers of a valve's law on which one of its flows depends, in either law."""
    _, _, way = name.partition("_")
    own = (name, f"sonic_conductance_{way}")
    return own if name.startswith("choked") else (*own, f"critical_ratio_{way}")


def _relative(row: ParameterRow) -> Iterator[float]:
    known = row.estimate
    if known.has_error and known.value:
        yield abs(float(known.std) / float(known.value))


def _std(rows: list[ParameterRow], value: float, off: float) -> tuple[float, bool]:
    """A standard error, with what the model uses otherwise than estimated."""
    known = [float(row.estimate.std) for row in rows if row.estimate.has_error]
    if not known:
        return math.hypot(DECLARED_ERROR * abs(value), off), False
    return math.hypot(known[0], off), True


def _supply_error(bundle: BundleContent, supply: float) -> tuple[float, bool]:
    """How far the pressure at which the chambers settled, open to the supply, is from it."""
    laws = (bundle.valve(side).discrete for side in SIDES)
    found = (read_number(law.supply_pressure_pa) for law in laws if law is not None)
    seen = [level for level in found if level]
    if not seen:
        return DECLARED_ERROR * supply, False
    noise = _pressure_noise(bundle)
    return math.hypot(max(abs(level - supply) for level in seen), noise), True


def _correlate(errors: FloatArray, bundle: BundleContent) -> None:
    """Enter the correlation of the errors of Coulomb and viscous friction."""
    parts = table_of(bundle).parts()
    friction = parts.get("friction")
    if friction is None:
        return
    names = [row.name for row in friction.rows]
    if "coulomb" not in names or "viscous" not in names:
        return
    shared = float(friction.correlation[names.index("coulomb"), names.index("viscous")])
    c, v = NAMES.index("coulomb"), NAMES.index("viscous")
    errors[c, v] = errors[v, c] = shared * math.sqrt(errors[c, c] * errors[v, v])


def _scatter(bundle: BundleContent, model: Model, scales: FloatArray) -> FloatArray:
    """(p, 4): friction's scatter from test to test; a load's effort and inertia, which are free.

    Coulomb and viscous friction scatter each by itself: by one factor of both, what changes the
    law's shape from cycle to cycle would count as drift. A load may be whatever it is from one
    cycle to the next: up to what the shaft would just hold, and as heavy as the machine itself.
    """
    p = model.parameters
    share, _ = friction_scatter(bundle)
    found = np.zeros((COUNT, 4))
    found[NAMES.index("coulomb"), 0] = share * float(p.coulomb_effort)
    found[NAMES.index("viscous"), 1] = share * float(p.viscous)
    found[NAMES.index("offset"), 2] = max(float(p.static_effort), float(p.coulomb_effort))
    found[NAMES.index("inertia"), 3] = 1.0
    return np.asarray(found / scales[:, None])


def _learning(model: Model, scales: FloatArray) -> FloatArray:
    """(p,): as much friction as there is, of both kinds, may be what the observer makes of it."""
    found = np.zeros(COUNT)
    found[NAMES.index("coulomb")] = float(model.parameters.coulomb_effort)
    found[NAMES.index("viscous")] = float(model.parameters.viscous)
    return np.square(found / scales)


__all__ = ["MonitorDesign", "monitor_design"]
