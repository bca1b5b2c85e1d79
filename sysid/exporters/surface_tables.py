"""A PWM surface of a bundle, checked and in the arrays that every export format writes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.errors import input_error
from sysid.parameters import Surface, Unread
from sysid.surfaces.ann import DutyNetwork
from sysid.surfaces.bipolynomial import EXPONENTS, Bipolynomial
from sysid.surfaces.domain import Domain
from sysid.types import FloatArray

DOMAIN_UNITS = {
    "pressure_pa": "Pa",
    "duty_low": "1",
    "duty_high": "1",
    "flow_low_kg_s": "kg/s",
    "flow_high_kg_s": "kg/s",
}
_AGAIN = "fit the surface again"
_ERRORS = {
    "rmse_duty": "1",
    "max_relative_error_duty_percent": "%",
    "rmse_flow_kg_s": "kg/s",
}


@dataclass(frozen=True)
class ExportedSurface:
    """A fitted surface and the errors that the bundle reports for it (name -> value, unit)."""

    model: Bipolynomial | DutyNetwork
    errors: dict[str, tuple[float, str]]


def read_surface(surface: Surface | Unread, where: str) -> ExportedSurface:
    """A surface of a bundle, checked. Raises InputError for one that cannot be evaluated."""
    if isinstance(surface, Unread):
        raise input_error(where, "is not a surface", _AGAIN)
    terms = surface.coefficients
    if terms is not None:
        names = [t.get("term") if isinstance(t, dict) else None for t in _items(terms)]
        if names != [f"u^{i} P^{j}" for i, j in EXPONENTS]:
            raise input_error(where, "coefficients are not in the thesis' order", _AGAIN)
    if surface.activation not in (None, "tanh"):
        name = str(surface.activation)[:40]
        raise input_error(where, f"activation {name!r} is unknown", _AGAIN)
    try:
        model = surface.model()
    except (TypeError, ValueError, AttributeError, IndexError, np.linalg.LinAlgError) as error:
        raise input_error(where, f"cannot be read ({error})", _AGAIN) from None
    _check_numbers(model, where)
    errors = {
        name: (float(getattr(surface, name)), unit)
        for name, unit in _ERRORS.items()
        if isinstance(getattr(surface, name), int | float)
    }
    if not np.isfinite([value for value, _ in errors.values()]).all():
        raise input_error(where, "an error is not finite", _AGAIN)
    return ExportedSurface(model, errors)


def _items(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _check_numbers(model: Bipolynomial | DutyNetwork, where: str) -> None:
    domain = model.domain_
    numbers = [model.scaling_, *domain_arrays(domain).values()]
    numbers += [np.array(domain.duty_range), np.array(domain.pressure_range)]
    numbers += [np.asarray(part.values, dtype=float) for part in model.exported()]
    if not all(np.isfinite(array).all() for array in numbers):
        raise input_error(where, "holds a number that is not finite", _AGAIN)
    if model.scaling_.shape[1] != 2 or not (model.scaling_[:, 1] > 0.0).all():
        raise input_error(where, "scaling is not (centre, positive half range)", _AGAIN)
    nodes = domain.pressure
    if len(nodes) < 2 or not (np.diff(nodes) > 0.0).all():
        raise input_error(where, "domain nodes do not rise in pressure", _AGAIN)
    for low, high in (
        domain.duty_range,
        domain.pressure_range,
        (domain.duty_low, domain.duty_high),
        (domain.flow_low, domain.flow_high),
    ):
        if (np.asarray(low) > np.asarray(high)).any():
            raise input_error(where, "a lower limit of the domain is above the upper", _AGAIN)


def domain_arrays(domain: Domain) -> dict[str, FloatArray]:
    """The domain's nodes by exported name, (G,) each; units in `DOMAIN_UNITS`."""
    return {
        "pressure_pa": domain.pressure,
        "duty_low": domain.duty_low,
        "duty_high": domain.duty_high,
        "flow_low_kg_s": domain.flow_low,
        "flow_high_kg_s": domain.flow_high,
    }
