"""What a controller knows of its rig, and the one place that reads it from a bundle."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.controllers.duty_inverse import DutyInverse, bipolynomial_inverse
from sysid.controllers.effective_law import averaged_law
from sysid.errors import NotIdentifiedError, input_error
from sysid.io.channels import SIDES
from sysid.io.rig import Rig
from sysid.parameters.assembled_model import model_from_bundle, surfaces_for
from sysid.parameters.content import BundleContent
from sysid.parameters.valves import DIRECTIONS
from sysid.plant.base import Array, Parameters
from sysid.plant.effects.entry import Catalogue
from sysid.plant.ports import Model
from sysid.surfaces.hull import ValveLaw
from sysid.surfaces.kinds import SURFACES

INVERSES = ("averaged", *SURFACES)
# Constants of a rig that no controller uses.
_NOT_USED = ("cylinder.stroke_m", "sampling.period_s")


@dataclass(frozen=True)
class DesignModel:
    """A controller's model: floats, or (lanes,) arrays.

    `inverse_a`, `inverse_b`: duty by flow and pressure (`DutyInverse`). `payload_mass` kg is
    the payload that `model`'s inertia and gravity contain, `payload_length` m its lever;
    `gravity` 1 in the vertical, else 0: the payload's weight acts on the position.
    `is_measured`: the inverses are of measured mean flows, which contain a chamber's leaks.
    """

    model: Model
    inverse_a: DutyInverse
    inverse_b: DutyInverse
    payload_mass: Array = 0.0
    payload_length: Array = 0.0
    gravity: Array = 0.0
    is_measured: bool = False

    @property
    def parameters(self) -> Parameters:
        """The base model's parameters."""
        return self.model.parameters


def design_model(
    model: Model,
    *,
    inverses: tuple[DutyInverse, DutyInverse] | None = None,
    rig: Rig | None = None,
) -> DesignModel:
    """A controller's model; without `inverses` those of the averaged law with its effects.

    The payload's mass and lever are the rig's, if it is given.
    """
    a, b = inverses or (averaged_law(model, "a"), averaged_law(model, "b"))
    inertia = rig.inertia if rig else None
    return DesignModel(
        model=model,
        inverse_a=a,
        inverse_b=b,
        payload_mass=inertia.payload_mass_kg if inertia else 0.0,
        payload_length=inertia.payload_length_m if inertia else 0.0,
        gravity=1.0 if rig and rig.is_vertical and not rig.is_linear else 0.0,
    )


def design_from_bundle(
    bundle: BundleContent,
    rig: Rig | None = None,
    inverse: str = "averaged",
    catalogue: Catalogue | None = None,
) -> DesignModel:
    """The model and inverses that a bundle holds; `inverse` is one of INVERSES.

    `rig` (None: the bundle's own) says what the controller is to drive; `catalogue` maps ids to
    effects (None: the project's own). Raises InputError or
    NotIdentifiedError, which name the missing key, where the bundle lacks the friction, a
    valve's on/off law, or the surfaces that the inverse needs.
    """
    rig = rig or bundle.rig
    if inverse not in INVERSES:
        raise input_error(f"inverse {inverse!r}", "is unknown", f"use {', '.join(INVERSES)}")
    _require_discrete_laws(bundle, rig)
    model = model_from_bundle(bundle, rig, catalogue)
    if inverse == "averaged":
        return design_model(model, rig=rig)
    surfaces_for(bundle, rig, inverse)  # refuses what is missing or of another period
    a, b = (_surface_inverse(bundle, side, inverse) for side in SIDES)
    made = design_model(model, inverses=(a, b), rig=rig)
    return dataclasses.replace(made, is_measured=True)


def with_bipolynomials(design: DesignModel) -> DesignModel:
    """The same with the thesis' inverse: bipolynomials fitted to the averaged law (3.7.3)."""
    p = design.parameters
    span = float(p.atmosphere), float(p.supply)
    a, b = (bipolynomial_inverse(averaged_law(design.model, side), span) for side in SIDES)
    return dataclasses.replace(design, inverse_a=a, inverse_b=b)


def assumed_constants(rig: Rig) -> tuple[str, ...]:
    """The assumed constants that a rig's controllers use, as dotted keys."""
    return tuple(key for key in rig.assumed if key not in _NOT_USED)


def require_declared(
    bundle: BundleContent, accept_assumed: bool, users: str = "controllers"
) -> None:
    """InputError for a bundle whose `users` use assumed constants, without `accept_assumed`."""
    assumed = assumed_constants(bundle.rig)
    if assumed and not accept_assumed:
        raise input_error(
            bundle.source,
            f"its {users} would use undeclared constants: {', '.join(assumed)}",
            "declare them in a rig file and fit again, or accept them with --accept-assumed",
        )


def _require_discrete_laws(bundle: BundleContent, rig: Rig) -> None:
    """Refuse a bundle without both on/off laws: every controller's model has them."""
    if len(rig.sides) < len(SIDES):
        raise NotIdentifiedError(
            f"{bundle.source}: the rig has one chamber, and these controllers steer two: pva, "
            "backstepping and dvmpc need chambers A and B; give the bundle of such a rig"
        )
    if bundle.rig.is_motor_alone:
        raise NotIdentifiedError(
            f"{bundle.source}: the rig is a motor alone, and a closed loop needs a cylinder "
            "with two valves; give the bundle of such a rig"
        )
    for side in SIDES:
        if bundle.valve(side).discrete is None:
            raise NotIdentifiedError(
                f"{bundle.source}: valves.{side}.discrete is missing, which a controller needs; "
                f"fit valve-discrete tests of valve {side} into it"
            )


def _surface_inverse(bundle: BundleContent, side: str, kind: str) -> ValveLaw:
    place = f"{bundle.source}, valves.{side}.pwm"
    laws = [_surface(bundle, side, direction, kind, place).law for direction in DIRECTIONS]
    filling, emptying = laws
    if not np.min(emptying.flow_low) < 0.0 < np.max(filling.flow_high):
        raise input_error(place, "the surfaces hold flow of one sign only", "fit them again")
    return ValveLaw(filling, emptying)


def _surface(bundle: BundleContent, side: str, direction: str, kind: str, where: str) -> Any:
    """The surface of a direction, which `surfaces_for` has found there."""
    part = bundle.valve(side).surfaces(direction)
    held = None if part is None else part.surface(kind)
    assert held is not None
    return held.model(f"{where}.{direction}.{kind}")


__all__ = [
    "INVERSES",
    "DesignModel",
    "assumed_constants",
    "design_from_bundle",
    "design_model",
    "require_declared",
    "with_bipolynomials",
]
