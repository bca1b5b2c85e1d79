"""Files for a controller or another simulator."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from sysid.errors import input_error
from sysid.exporters import (
    DEFAULT_PREFIX,
    FMI_VERSIONS,
    FORMATS,
    NO_CONTROLLERS,
    check_folder,
    controllers_file,
    export_bundle,
)
from sysid.io.tables import read_bytes
from sysid.parameters import Bundle, read_bundle
from sysid.parameters.assembled_model import effects_from_bundle
from sysid.pipeline.request import Options, takes
from sysid.plant.effects.catalogue import EffectSource, catalogue_from

SUFFIXES = {".h": "c", ".mat": "mat", ".json": "json", ".fmu": "fmu", ".xml": "mjcf"}
"""The format of a file by its suffix."""


@dataclass(frozen=True, kw_only=True)
class ExportOptions(Options):
    """The files' format (None: by the path's suffix), names and content, and FMI's version."""

    format: str | None = None
    prefix: str = DEFAULT_PREFIX
    effects: EffectSource = None
    accept_assumed: bool = False
    fmi: str = FMI_VERSIONS[0]


@takes(ExportOptions)
def export(bundle: Bundle, path: str | Path, options: ExportOptions) -> tuple[str, ...]:
    """Write files for a controller (a C header, MATLAB, flat JSON) or a simulator (FMU, MJCF).

    `format` "c", "mat", "json", "fmu" or "mjcf"; None: by the suffix of `path` (.h, .mat, .json,
    .fmu, .xml).
    Names in the header begin with `prefix`; `effects` are those of the bundle that the catalogue
    lacks; `fmi` is the FMU's version, "3" or "2". Controllers, and a plant, that use an assumed
    constant are written only with `accept_assumed`.
    Returns notices: missing parameters, effects whose law the header does not contain. Raises
    InputError for an unknown format or a file that cannot be written.

    >>> notices = si.export(bundle, "model.h")
    """
    return _exported(bundle, path, options)


@takes(ExportOptions)
def export_file(source: Path, path: Path, options: ExportOptions) -> tuple[str, ...]:
    """`export` of the bundle in the file `source`, with that file's own SHA-256.

    InputError for a bad bundle too, and for effects that neither the catalogue nor
    `options.effects` holds.
    """
    bundle = read_bundle(source)
    digest = hashlib.sha256(read_bytes(source, "a bundle", is_bundle=True)).hexdigest()
    return _exported(bundle, path, options, digest)


def _exported(
    bundle: Bundle, path: str | Path, options: ExportOptions, sha256: str | None = None
) -> tuple[str, ...]:
    chosen = options.format or SUFFIXES.get(Path(path).suffix.lower())
    if chosen is None:
        known = ", ".join(FORMATS)
        raise input_error(path, "has no suffix that gives the format", f"pass format, of {known}")
    catalogue = catalogue_from(options.effects)
    effects_from_bundle(bundle, catalogue)
    return tuple(
        export_bundle(
            bundle,
            Path(path),
            chosen,
            prefix=options.prefix,
            sha256=sha256,
            catalogue=catalogue,
            accept_assumed=options.accept_assumed,
            fmi=options.fmi,
        )
    )


__all__ = [
    "FMI_VERSIONS",
    "FORMATS",
    "NO_CONTROLLERS",
    "SUFFIXES",
    "ExportOptions",
    "check_folder",
    "controllers_file",
    "export",
    "export_file",
]
