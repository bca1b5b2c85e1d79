"""The constants that a bundle's numbers depend on and that were assumed, not declared."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sysid.blocks.numbers import number
from sysid.io.channels import SIDES
from sysid.io.rig import Rig
from sysid.parameters.table import DELAYS, table_of

if TYPE_CHECKING:
    from sysid.parameters.bundle import Bundle

_FRICTION, _FLOWS, _MEANS = "friction", "flows", "surfaces"
"""The numbers of a bundle by what they are computed from: efforts, dP/dt, means over pulses."""
FROM_LOG = "from_log"
"""Among a fit's options: the constants of the rig that bare logs showed, as dotted keys."""
_UNUSED = "no number here depends on it"


@dataclass(frozen=True)
class Assumption:
    """Constants that were assumed together, and what they do to the numbers.

    `keys` of the rig file, dotted; `text` with their values; `does`: their influence on the numbers
    at the dotted paths `numbers` of the bundle, empty if no number depends on them.
    """

    keys: tuple[str, ...]
    text: str
    does: str
    numbers: tuple[str, ...]

    @property
    def line(self) -> str:
        """ "assumed: chamber A 0.034 l (reference rig): flows scale with it"."""
        return f"assumed: {self.text} (reference rig): {self.does}"

    def to_json(self) -> dict[str, Any]:
        """The entry as `sysid fit --json` prints it."""
        return {
            "keys": list(self.keys),
            "text": self.text,
            "does": self.does,
            "numbers": list(self.numbers),
        }


@dataclass(frozen=True)
class _Group:
    """Keys listed together; their influence on friction, flows and means over pulses."""

    keys: tuple[str, ...]
    friction: str = ""
    flows: str = ""
    surfaces: str = ""
    side: str = ""

    def does(self) -> Mapping[str, str]:
        """Its influence, by the numbers that it affects."""
        said = {_FRICTION: self.friction, _FLOWS: self.flows, _MEANS: self.surfaces}
        return {numbers: text for numbers, text in said.items() if text}


_GROUPS = (
    _Group(
        ("rig.orientation",),
        friction="the efforts exclude gravity; where it acts, friction and offset include it",
    ),
    *(
        _Group(
            (f"cylinder.area_{side}_m2", f"cylinder.offset_{side}_m"),
            friction="friction is the motor's effort less the chamber's, which scales "
            "with the piston area",
            flows="flows scale with it",
            surfaces="flows scale with it",
            side=side,
        )
        for side in SIDES
    ),
    _Group(
        ("cylinder.stroke_m", "cylinder.pitch_radius_m"),
        friction="the chambers' effort in friction scales with it",
        flows="the chamber's volume where the piston is held, and flows with it, follow from it",
        surfaces="the chamber's volume where the piston is held, and flows with it, follow from it",
    ),
    _Group(
        ("air.gas_constant_j_per_kg_k", "air.heat_capacity_ratio", "air.temperature_k"),
        flows="flows scale with 1/(k R T)",
        surfaces="flows scale with 1/(k R T)",
    ),
    _Group(
        ("air.atmospheric_pressure_pa",),
        friction="the chambers' effort in friction counts from it",
        flows="the unchoked coefficients count from it",
        surfaces="flows are fitted from it to the supply",
    ),
    _Group(
        ("air.supply_pressure_pa",),
        flows="filling flows hold at it",
        surfaces="flows are fitted from the atmosphere to it",
    ),
    _Group(
        ("inertia.equivalent_kg_m2", "inertia.mass_kg"),
        friction="acceleration takes its share of the effort: Coulomb and viscous friction "
        "of tests with unsteady speed depend on it",
    ),
    _Group(("motor.max_torque_nm", "motor.max_force_n")),
    _Group(("pwm.period_s",), surfaces="mean flows are means over it"),
    _Group(
        ("valves.on_delay_s", "valves.off_delay_s"),
        surfaces="how long the valve is open at a duty follows from them",
    ),
    _Group(("sampling.period_s",)),
    _Group(
        ("sensors.encoder_counts_per_rev", "sensors.encoder_counts_per_m"),
        friction="positions and speeds are counts over it: viscous friction scales with it",
        flows="the place where the piston is held follows from it",
        surfaces="the place where the piston is held follows from it",
    ),
)


def assumptions(bundle: Bundle) -> tuple[Assumption, ...]:
    """The assumed constants of a bundle's rig, and what they do to the numbers that it holds."""
    rig = bundle.rig
    found: list[Assumption] = []
    idle: list[tuple[tuple[str, ...], str]] = []
    for group in (*_GROUPS, *_others(rig.assumed)):
        keys = tuple(key for key in group.keys if key in rig.assumed)
        if not keys:
            continue
        said: list[str] = []
        rests: list[str] = []
        for kind, text in group.does().items():
            names = tuple(_numbers(bundle, kind, group.side))
            said += [text] if names and text not in said else []
            rests += names
        text = _text(rig, keys, group.side, with_area=bundle.friction is not None)
        if rests and not _gives_way(bundle, keys):
            found.append(Assumption(keys, text, "; ".join(said), tuple(rests)))
        else:
            idle.append((keys, text))
    if idle:
        keys = tuple(key for own, _ in idle for key in own)
        found.append(Assumption(keys, ", ".join(text for _, text in idle), _UNUSED, ()))
    return tuple(found)


def _gives_way(bundle: Bundle, keys: Collection[str]) -> bool:
    """Whether the fit used its own estimate: an assumed inertia is replaced by that of motion."""
    fitted = None if bundle.friction is None else bundle.friction.inertia
    is_inertia = all(key.startswith("inertia.") for key in keys)
    return is_inertia and fitted is not None and fitted.identified


def shown_by_logs(bundle: Bundle) -> str:
    """The constants that a fit took from its bare logs, with their values; empty without any."""
    found: dict[str, None] = {}
    for options in bundle.provenance.options.values():
        keys = options.get(FROM_LOG) if isinstance(options, dict) else None
        found |= dict.fromkeys(str(key) for key in keys) if isinstance(keys, list) else {}
    rig = bundle.rig
    return ", ".join(_one(rig, key) for key in found if rig.constant(key) is not None)


def _others(assumed: Collection[str]) -> Iterator[_Group]:
    """Assumed keys of no group, as a user's own rig file may list them."""
    known = {key for group in _GROUPS for key in group.keys}
    everything = "numbers may depend on it"
    for key in assumed:
        if key not in known:
            yield _Group((key,), everything, everything, everything)


def _numbers(bundle: Bundle, kind: str, side: str) -> Iterator[str]:
    """Dotted paths of the bundle's numbers of a kind; of one valve where a `side` is given."""
    for row in table_of(bundle).rows:
        if kind == _FRICTION == row.part and row.estimate.identified:
            yield row.path
        flows = row.part.endswith(".discrete") and row.name not in DELAYS
        if kind == _FLOWS and flows and side in ("", row.side):
            yield row.path
    for own in SIDES if not side else (side,):
        pwm = bundle.valve(own).pwm
        if kind == _MEANS and pwm is not None:
            yield from (f"valves.{own}.pwm.{name}" for name in pwm.given())


def _text(rig: Rig, keys: Collection[str], side: str, *, with_area: bool) -> str:
    """The constants of a group with their values, in units that a person reads."""
    if side and f"cylinder.offset_{side}_m" in keys and f"cylinder.area_{side}_m2" in keys:
        c = rig.cylinder
        assert c is not None
        volume = getattr(c, f"area_{side}_m2") * getattr(c, f"offset_{side}_m")
        area = f"{_one(rig, f'cylinder.area_{side}_m2')}, " if with_area else ""
        return f"{area}chamber {side.upper()} {number(1e3 * volume, 2)} l"
    if "cylinder.pitch_radius_m" in keys:  # with the logged angle it gives the stroke
        keys = [key for key in keys if key != "cylinder.stroke_m"]
    return ", ".join(_one(rig, key) for key in keys)


_NAMES: Mapping[str, tuple[str, float, str]] = {
    "air.gas_constant_j_per_kg_k": ("air R", 1.0, "J/(kg K)"),
    "air.heat_capacity_ratio": ("k", 1.0, ""),
    "air.temperature_k": ("temperature", 1.0, "K"),
    "air.atmospheric_pressure_pa": ("atmosphere", 1e-3, "kPa"),
    "air.supply_pressure_pa": ("supply", 1e-3, "kPa"),
    "cylinder.area_a_m2": ("piston area A", 1e6, "mm2"),
    "cylinder.area_b_m2": ("piston area B", 1e6, "mm2"),
    "cylinder.offset_a_m": ("offset A", 1e3, "mm"),
    "cylinder.offset_b_m": ("offset B", 1e3, "mm"),
    "cylinder.stroke_m": ("stroke", 1e3, "mm"),
    "cylinder.pitch_radius_m": ("pitch radius", 1e3, "mm"),
    "inertia.equivalent_kg_m2": ("inertia", 1.0, "kg m2"),
    "inertia.mass_kg": ("mass", 1.0, "kg"),
    "motor.max_torque_nm": ("motor's limit", 1.0, "Nm"),
    "motor.max_force_n": ("motor's limit", 1.0, "N"),
    "pwm.period_s": ("PWM period", 1e3, "ms"),
    "valves.on_delay_s": ("valves' on-delay", 1e3, "ms"),
    "valves.off_delay_s": ("off-delay", 1e3, "ms"),
    "sampling.period_s": ("sampling period", 1e3, "ms"),
    "sensors.encoder_counts_per_rev": ("encoder", 1.0, "counts a revolution"),
    "sensors.encoder_counts_per_m": ("encoder", 1.0, "counts a metre"),
}


def _one(rig: Rig, key: str) -> str:
    value = rig.constant(key)
    if isinstance(value, str):
        return value
    words, scale, unit = _NAMES.get(key, (key, 1.0, ""))
    return f"{words} {scale * value:.6g} {unit}".rstrip()


__all__ = ["FROM_LOG", "Assumption", "assumptions", "shown_by_logs"]
