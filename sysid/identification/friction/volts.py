"""Friction of a motor whose command was logged in volts, where no torque constant is declared."""

from __future__ import annotations

from typing import Any

from sysid.estimation.linear import Estimate
from sysid.parameters import Friction, Parts

_STATIC = ("static_nm", "static_n")
_PER = {
    "viscous_nm_s_per_rad": "V s/rad",
    "viscous_n_s_per_m": "V s/m",
    "inertia_kg_m2": "V s2/rad",
    "mass_kg": "V s2/m",
}


def friction_in_volts(parts: Parts, *, has_pressures: bool) -> Parts:
    """Friction that was fitted with a volt for a unit of effort, as a bundle may hold it.

    Volts are no torque: no parameter is identified, and the reason gives the number in volts. Where
    the chambers' pressures were logged, their effort, which has no volts, acted as soon as the
    shaft moved: then static friction alone has a number.
    """
    friction = parts.friction
    assert friction is not None
    key = "force_per_volt_n" if friction.is_linear else "torque_per_volt_nm"
    effort = "force" if friction.is_linear else "torque"
    fix = f"volts were logged, and [motor] {key} is not declared"
    found: dict[str, Any] = {"source": friction.source}
    for name, estimate in friction.estimates().items():
        if not estimate.identified:
            found[name] = estimate
            continue
        low, high = estimate.interval
        said = f"{estimate.value:.4g} ({low:.4g} to {high:.4g}) {_PER.get(name, 'V')}"
        if has_pressures and name not in _STATIC:
            said = f"the chambers' {effort} in motion has no volts"
        found[name] = Estimate.unidentified(estimate.unit, f"{said}; {fix}")
    return Parts(friction=Friction(**found))


__all__ = ["friction_in_volts"]
