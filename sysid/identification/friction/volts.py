"""Friction of a motor whose command was logged in volts, where no torque constant is declared."""

from __future__ import annotations

from typing import Any

from sysid.estimation.linear import Estimate
from sysid.parameters import Friction, Parts

_PER = {"viscous": "V s/{position}", "inertia": "V s2/{position}"}


def friction_in_volts(parts: Parts, *, has_pressures: bool) -> Parts:
    """Friction fitted in volts as the unit of effort, in the form that a bundle may hold.

    Volts are not torque: no parameter is identified, and the reason gives the value in volts. Where
    the chambers' pressures were logged, their effort, which has no volts, acted as soon as the
    shaft moved: then static friction alone has a number.
    """
    friction = parts.friction
    assert friction is not None
    units = friction.units
    fix = f"volts were logged, and [motor] {units.effort_per_volt} is not declared"
    found: dict[str, Any] = {"source": friction.source}
    for key, estimate in friction.estimates().items():
        if not estimate.identified:
            found[key] = estimate
            continue
        (name,), (low, high) = units.named([key]), estimate.interval
        per = _PER.get(name, "V").format(position=units.position)
        said = f"{estimate.value:.4g} ({low:.4g} to {high:.4g}) {per}"
        if has_pressures and name != "static":
            said = f"the chambers' {units.word} in motion has no volts"
        found[key] = Estimate.unidentified(estimate.unit, f"{said}; {fix}")
    return Parts(friction=Friction(**found))


__all__ = ["friction_in_volts"]
