"""The surfaces' part of the C header: their numbers, and one function per use."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import resources

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from sysid.exporters.c_text import Names, array, literal
from sysid.exporters.flat import DIRECTIONS, Flat
from sysid.exporters.surface_tables import ExportedSurface, domain_arrays
from sysid.surfaces.ann import DutyNetwork
from sysid.surfaces.bipolynomial import Bipolynomial
from sysid.surfaces.domain import Domain

# Kind of the bundle -> name in C.
KINDS = {"bipolynomial": "bipolynomial", "ann": "network"}


def slots(flat: Flat) -> Iterable[tuple[str, str, ExportedSurface | None]]:
    """Each surface that a bundle can hold: its C name (`pwm_a_fill`), kind, and itself."""
    for side, valve in flat.valves.items():
        for direction in DIRECTIONS:
            for kind in KINDS:
                yield f"pwm_{side}_{direction}", kind, getattr(valve.pwm[direction], kind)


def macro(name: str, kind: str) -> str:
    """Feature macro of a surface, without prefix."""
    return f"HAS_{name}_{KINDS[kind]}".upper()


def surfaces(flat: Flat, names: Names) -> str:
    """Types and helpers, then every surface that the bundle holds; empty without any."""
    held = [(name, kind, surface) for name, kind, surface in slots(flat) if surface is not None]
    if not held:
        return ""
    fixed = resources.files("sysid.exporters").joinpath("surfaces.h.in").read_text("utf-8")
    parts = [fixed.replace("@p@", names.lower).replace("@P@", names.upper)]
    for name, _, surface in held:
        if isinstance(surface.model, Bipolynomial):
            parts.append(_bipolynomial(surface.model, name, names))
        else:
            parts.append(_network(surface.model, name, names))
    return "\n".join(parts)


def _domain(domain: Domain, name: str, names: Names) -> str:
    p = names.lower
    nodes = domain_arrays(domain)
    lines = [array(f"{p}{name}_{key}", values, names) for key, values in nodes.items()]
    duty, pressure = (_row(r, names) for r in (domain.duty_range, domain.pressure_range))
    pointers = ", ".join(f"{p}{name}_{key}" for key in nodes)
    lines += [
        f"static const {p}domain {p}{name}_domain = {{",
        f"    {duty}, {pressure}, {len(domain.pressure)},",
        *_wrapped(pointers.split(", ")),
        "};",
    ]
    return "\n".join(lines)


def _bipolynomial(model: Bipolynomial, slot: str, names: Names) -> str:
    p, name = names.lower, f"{slot}_bipolynomial"
    centre, half = model.scaling_[1]
    rows = [
        _matrix(model.scaled_coefficients_.reshape(3, 3), names),
        _matrix(_duty_powers(*model.scaling_[0]), names),
        f"{literal(centre, names)}, {literal(half, names)}",
        _matrix(model.coefficients_.reshape(3, 3), names),
        f"&{p}{name}_domain",
    ]
    table = ",\n    ".join(rows)
    return f"""\
{_domain(model.domain_, name, names)}
static const {p}bipolynomial {p}{name} = {{
    {table}
}};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa (3.7.1); flags may be NULL. */
static inline {p}real {p}{slot}_flow({p}real duty, {p}real pressure_pa, unsigned *flags)
{{
    return {p}bipolynomial_flow(&{p}{name}, duty, pressure_pa, flags);
}}

/* Its inverse: duty for a wanted mean flow, kg/s, at a chamber pressure, Pa (3.7.3). */
static inline {p}real {p}{slot}_duty({p}real flow_kg_s, {p}real pressure_pa, unsigned *flags)
{{
    return {p}bipolynomial_duty(&{p}{name}, flow_kg_s, pressure_pa, flags);
}}
"""


def _network(model: DutyNetwork, slot: str, names: Names) -> str:
    p, name = names.lower, f"{slot}_network"
    weights = {
        "w1": model.hidden_weights_.ravel(),
        "b1": model.hidden_bias_,
        "w2": model.output_weights_,
    }
    arrays = "\n".join(array(f"{p}{name}_{key}", values, names) for key, values in weights.items())
    pointers = ", ".join(f"{p}{name}_{key}" for key in weights)
    scaling = ", ".join(_row(pair, names) for pair in model.scaling_)
    return f"""\
{_domain(model.domain_, name, names)}
{arrays}
static const {p}network {p}{name} = {{
    {len(model.hidden_bias_)}, {pointers},
    {literal(model.output_bias_, names)},
    {scaling},
    &{p}{name}_domain
}};

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa, by the network (3.7.4). */
static inline {p}real {p}{slot}_network_duty(
    {p}real flow_kg_s, {p}real pressure_pa, unsigned *flags)
{{
    return {p}network_duty(&{p}{name}, flow_kg_s, pressure_pa, flags);
}}

/* Mean flow, kg/s, that the network maps to this duty: its forward map. */
static inline {p}real {p}{slot}_network_flow(
    {p}real duty, {p}real pressure_pa, unsigned *flags)
{{
    return {p}network_flow(&{p}{name}, duty, pressure_pa, flags);
}}
"""


def _duty_powers(centre: float, half: float) -> NDArray[np.float64]:
    """(3, 3): row i holds T_i((u - centre)/half) in powers of u."""
    scaled = np.polynomial.Polynomial([-centre / half, 1.0 / half])
    rows = np.zeros((3, 3))
    for order in range(3):
        powers = np.polynomial.Polynomial(chebyshev.cheb2poly([0.0] * order + [1.0]))(scaled)
        rows[order, : order + 1] = powers.coef
    return rows


def _row(values: Iterable[float], names: Names) -> str:
    return "{" + ", ".join(literal(value, names) for value in values) + "}"


def _matrix(values: NDArray[np.float64], names: Names) -> str:
    rows = (_row(row, names) for row in values)
    return "{" + ",\n     ".join(rows) + "}"


def _wrapped(items: list[str]) -> list[str]:
    """Initialisers, one per line."""
    return [f"    {item}," for item in items[:-1]] + [f"    {items[-1]}"]
