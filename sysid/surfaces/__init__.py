"""Mean flow of a valve under PWM as a surface over (duty, pressure), and its inverse.

Two estimators with scikit-learn's interface, for one valve and one direction (filling or
discharging) each: `Bipolynomial` (thesis 3.7.3) and `DutyNetwork` (thesis 3.7.4). Nothing
heavy is imported here: a name loads its module when it is first used, torch only when a
network is trained, and scikit-learn never.
"""

from __future__ import annotations

import importlib
import math
from typing import TYPE_CHECKING, Any

from sysid.errors import InputError, input_error
from sysid.surfaces.kinds import SURFACES

if TYPE_CHECKING:
    from sysid.surfaces.ann import DutyNetwork, SizeSweep, sweep_hidden_size
    from sysid.surfaces.bipolynomial import Bipolynomial
    from sysid.surfaces.comparison import (
        ResolutionStudy,
        SurfaceComparison,
        SurfaceError,
        compare_surfaces,
        duty_errors,
        resolution_study,
    )
    from sysid.surfaces.domain import Domain
    from sysid.surfaces.hull import Saturation
    from sysid.surfaces.samples import SurfacePoints, surface_points, thin_samples

_MODULES = {
    "Bipolynomial": "bipolynomial",
    "Domain": "domain",
    "DutyNetwork": "ann",
    "ResolutionStudy": "comparison",
    "Saturation": "hull",
    "SizeSweep": "ann",
    "SurfaceComparison": "comparison",
    "SurfaceError": "comparison",
    "SurfacePoints": "samples",
    "compare_surfaces": "comparison",
    "duty_errors": "comparison",
    "resolution_study": "comparison",
    "surface_points": "samples",
    "sweep_hidden_size": "ann",
    "thin_samples": "samples",
}

__all__ = [
    "Bipolynomial",
    "Domain",
    "DutyNetwork",
    "ResolutionStudy",
    "Saturation",
    "SizeSweep",
    "SurfaceComparison",
    "SurfaceError",
    "SurfacePoints",
    "compare_surfaces",
    "duty_errors",
    "resolution_study",
    "surface_from_dict",
    "surface_points",
    "sweep_hidden_size",
    "thin_samples",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def surface_from_dict(
    content: dict[str, Any], where: str = "PWM surface"
) -> Bipolynomial | DutyNetwork:
    """The surface that `to_dict` of either estimator wrote; needs only numpy.

    Raises InputError, which begins with `where`, for content that neither estimator wrote.
    """
    kind = content.get("kind")
    if not isinstance(kind, str) or kind not in SURFACES:
        known = " or ".join(SURFACES)
        raise input_error(where, f"kind = {kind!r} is unknown", f"use {known}")
    try:
        found: Bipolynomial | DutyNetwork = SURFACES[kind].load().from_dict(content)
        _check_scaling(found)
        return found
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    except (TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise input_error(
            where, f"is not a surface ({error})", "fit valve-pwm tests again"
        ) from None


def _check_scaling(surface: Bipolynomial | DutyNetwork) -> None:
    """ValueError for an invalid scaling, such as text in a file ("NaN") gives."""
    scaling = surface.scaling_
    if scaling.shape[1:] != (2,) or not all(map(math.isfinite, scaling.ravel().tolist())):
        raise ValueError("its scaling is not finite pairs of centre and half range")
