"""Files for other simulators: the plant, and its controllers, as FMUs; its joint for MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.controllers.design_model import require_declared
from sysid.errors import input_error
from sysid.io.files import write_atomic
from sysid.parameters import Bundle
from sysid.parameters.assembled_model import assumed_parameters
from sysid.plant.effects.entry import Catalogue, CatalogueEffect
from sysid.plant.ports import Effect

if TYPE_CHECKING:  # sympy is loaded where a file is written
    from sysid.exporters.fmu import FmuContent

FMI_VERSIONS = ("3", "2")
NO_CONTROLLERS = "no FMU of controllers"
"""How the notice begins that says why there is none."""


def controllers_file(plant: Path) -> Path:
    """The FMU of the controllers next to that of the plant: `arm_controllers.fmu` of `arm.fmu`."""
    return plant.with_name(f"{plant.stem}_controllers{plant.suffix}")


def write_fmu(
    bundle: Bundle, path: Path, catalogue: Catalogue | None, fmi: str, accept_assumed: bool
) -> list[str]:
    """Write a bundle's plant as an FMU of FMI `fmi`, and its controllers next to it.

    Returns notices, on why there are no controllers among them. Raises InputError for an unknown
    version, an effect that C cannot hold, assumed constants that are not accepted, and where
    `path` cannot be written; NotIdentifiedError where the bundle lacks what a simulation needs.
    """
    if fmi not in FMI_VERSIONS:
        raise input_error("--fmi", f"{fmi!r} is unknown", f"use {' or '.join(FMI_VERSIONS)}")
    from sysid.exporters.fmu import fmu_bytes
    from sysid.exporters.fmu_plant import plant_fmu

    require_declared(bundle, accept_assumed, "plant")
    model = bundle.model(None, catalogue)
    effects = _of_catalogue(bundle, model.effects)
    data, notices = fmu_bytes(plant_fmu(bundle, effects, model), fmi)
    files = {path: data}
    controllers = _controllers(bundle, effects, accept_assumed)
    if isinstance(controllers, str):
        notices.append(f"{NO_CONTROLLERS}: {controllers}")
    else:
        files[controllers_file(path)] = fmu_bytes(controllers, fmi)[0]
    for place, content in files.items():
        write_atomic(place, content)
    return [*assumed_parameters(bundle), *notices]


def write_mjcf(
    bundle: Bundle, path: Path, catalogue: Catalogue | None, accept_assumed: bool
) -> list[str]:
    """Write a bundle's moving part for MuJoCo, whole or not at all.

    Returns notices: what MuJoCo's joint does not hold. Raises InputError for assumed constants that
    are not accepted, and where `path` cannot be written; NotIdentifiedError where the bundle has no
    friction.
    """
    from sysid.exporters.mjcf import joint_of, mjcf_text

    require_declared(bundle, accept_assumed, "plant")
    model = bundle.model(None, catalogue)
    joint = joint_of(bundle.rig, model, _of_catalogue(bundle, model.effects))
    write_atomic(path, mjcf_text(bundle, joint))
    return [
        *assumed_parameters(bundle),
        *(f"MuJoCo's joint does not hold {line}" for line in joint.not_held),
    ]


def _controllers(
    bundle: Bundle, effects: Sequence[CatalogueEffect], accept_assumed: bool
) -> FmuContent | str:
    """The controllers' content, or why there is none."""
    from sysid.exporters.c_header import render
    from sysid.exporters.c_text import DEFAULT_PREFIX
    from sysid.exporters.flat import flatten
    from sysid.exporters.fmu_controllers import controllers_fmu

    flat = flatten(bundle, "")
    made = render(
        flat, DEFAULT_PREFIX, effects, bundle, accept_assumed=accept_assumed, monitor=False
    )
    if made.control is None:
        return made.why_no_control
    return controllers_fmu(bundle, flat, made, made.control)


def _of_catalogue(bundle: Bundle, effects: Sequence[Effect]) -> tuple[CatalogueEffect, ...]:
    found = tuple(effect for effect in effects if isinstance(effect, CatalogueEffect))
    assert len(found) == len(bundle.effects)  # a bundle's effects are those of a catalogue
    return found


__all__ = ["FMI_VERSIONS", "NO_CONTROLLERS", "controllers_file", "write_fmu", "write_mjcf"]
