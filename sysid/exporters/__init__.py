"""A bundle for a controller: as a C header, a MAT file or flat JSON; its plant as an FMU.

The first three hold the same content, computed once in `flat.py`. MAT and JSON list the effects as
data; the C header holds their laws, and its constants include the effects that change them.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from sysid.errors import InputError, input_error
from sysid.exporters.c_text import DEFAULT_PREFIX
from sysid.exporters.flat import Flat, flatten
from sysid.exporters.simulators import (
    FMI_VERSIONS,
    NO_CONTROLLERS,
    controllers_file,
    write_fmu,
    write_mjcf,
)
from sysid.io.files import need_folder_of, write_atomic
from sysid.parameters import Bundle, EffectEntry, bundle_text
from sysid.parameters.effects import effect_from_entry
from sysid.plant.effects.catalogue import catalogue_with
from sysid.plant.effects.entry import SIDE_CHOICES, Catalogue, CatalogueEffect
from sysid.plant.effects.linear import for_rig

FORMATS = ("c", "mat", "json", "fmu", "mjcf")

__all__ = [
    "DEFAULT_PREFIX",
    "FMI_VERSIONS",
    "FORMATS",
    "NO_CONTROLLERS",
    "Flat",
    "check_folder",
    "controllers_file",
    "export_bundle",
    "flatten",
    "listed_effects",
]


def check_folder(header: Path) -> Path:
    """The folder next to a C header that checks it: `model_check` next to `model.h`."""
    return header.with_name(f"{header.stem}_check")


def export_bundle(
    bundle: Bundle,
    path: Path,
    fmt: str,
    *,
    prefix: str = DEFAULT_PREFIX,
    sha256: str | None = None,
    catalogue: Catalogue | None = None,
    check: bool = True,
    accept_assumed: bool = False,
    fmi: str = FMI_VERSIONS[0],
) -> list[str]:
    """Write a checked bundle for a controller or a simulator, whole or not at all; returns notices.

    fmt: "c" (one C99 header whose names begin with `prefix`, and with `check` a folder next to it
    that replays Python's numbers through it: `check_folder`), "mat" (MAT 5, a struct
    `sysid`), "json", "fmu" (the plant for co-simulation, by FMI's version `fmi`, and the
    controllers next to it: `controllers_file`), or "mjcf" (the joint for MuJoCo). `sha256` is
    the bundle file's, by default that of the file which `sysid.parameters.write_bundle` makes of
    it. `catalogue` maps ids to the effects' classes, whose laws the C header and the FMU hold;
    None is the project's own. Controllers that use an assumed constant are in the header only with
    `accept_assumed`, and without it no plant that does is written. Notices name every parameter
    that is absent, and effects whose laws the C header does not hold.
    Raises InputError for an unknown format or prefix, for content that contradicts itself
    (units, PWM period), for an effect that an FMU cannot hold, and where `path` cannot be written;
    NotIdentifiedError where a plant lacks what its simulation needs.
    """
    if fmt not in FORMATS:
        raise input_error("--format", f"{fmt!r} is unknown", f"use one of {', '.join(FORMATS)}")
    need_folder_of(path)
    if fmt == "fmu":
        return write_fmu(bundle, path, catalogue, fmi, accept_assumed)
    if fmt == "mjcf":
        return write_mjcf(bundle, path, catalogue, accept_assumed)
    if sha256 is None:
        sha256 = _digest(bundle)
    flat = flatten(bundle, sha256)
    data: bytes | str
    if fmt == "c":
        from sysid.exporters.c_header import render
        from sysid.exporters.check_files import check_texts, write_check

        listed = listed_effects(bundle, catalogue)
        made = render(
            flat, prefix, listed, bundle, accept_assumed=accept_assumed, catalogue=catalogue
        )
        write_atomic(path, made.text)
        if check:
            write_check(check_folder(path), check_texts(flat, made, prefix, f"../{path.name}"))
        return [*flat.notices, *made.notices]
    if fmt == "mat":
        from sysid.exporters.matlab import encode

        data, notices = encode(flat), flat.absences("NaN")
    else:
        from sysid.exporters.json_file import render as render_json

        data, notices = render_json(flat), flat.absences("null")
    write_atomic(path, data)
    return [*flat.notices, *notices]


def listed_effects(
    bundle: Bundle, catalogue: Catalogue | None = None
) -> list[CatalogueEffect | None]:
    """The effects that a bundle lists, in its order; None for an invalid entry."""
    known = for_rig(catalogue_with(None) if catalogue is None else catalogue, bundle.is_linear)
    return [_effect(entry, bundle.source, known) for entry in bundle.effects]


def _effect(entry: EffectEntry, where: str, catalogue: Catalogue) -> CatalogueEffect | None:
    try:
        found: CatalogueEffect = effect_from_entry(entry, where, catalogue)
    except InputError:
        return None
    return found if getattr(found, "side", "both") in SIDE_CHOICES else None


def _digest(bundle: Bundle) -> str:
    """SHA-256 of the file that `sysid.parameters.write_bundle` makes of a bundle."""
    return hashlib.sha256(bundle_text(bundle).encode("utf-8", "surrogatepass")).hexdigest()
