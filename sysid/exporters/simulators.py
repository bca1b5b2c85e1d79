"""Files for other simulators: the plant as an FMU."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sysid.errors import input_error
from sysid.io.files import write_atomic
from sysid.parameters import Bundle
from sysid.parameters.assembled_model import assumed_parameters
from sysid.plant.effects.entry import Catalogue, CatalogueEffect
from sysid.plant.ports import Effect

FMI_VERSIONS = ("3", "2")


def write_fmu(
    bundle: Bundle, path: Path, catalogue: Catalogue | None, fmi: str, accept_assumed: bool
) -> list[str]:
    """Write a bundle's plant as an FMU of FMI `fmi`, whole or not at all; returns notices.

    Raises InputError for an unknown version, an effect that C cannot hold, assumed constants that
    are not accepted, and where `path` cannot be written; NotIdentifiedError where the bundle lacks
    what a simulation needs.
    """
    if fmi not in FMI_VERSIONS:
        raise input_error("--fmi", f"{fmi!r} is unknown", f"use {' or '.join(FMI_VERSIONS)}")
    from sysid.exporters.fmu import fmu_bytes
    from sysid.exporters.fmu_plant import plant_fmu

    model = bundle.model(None, catalogue)
    effects = _of_catalogue(bundle, model.effects)
    data, notices = fmu_bytes(plant_fmu(bundle, effects, model, accept_assumed), fmi)
    write_atomic(path, data)
    return [*assumed_parameters(bundle), *notices]


def _of_catalogue(bundle: Bundle, effects: Sequence[Effect]) -> tuple[CatalogueEffect, ...]:
    found = tuple(effect for effect in effects if isinstance(effect, CatalogueEffect))
    assert len(found) == len(bundle.effects)  # a bundle's effects are those of a catalogue
    return found


__all__ = ["FMI_VERSIONS", "write_fmu"]
