"""Files for a controller."""

from __future__ import annotations

from pathlib import Path

from sysid.errors import input_error
from sysid.exporters import DEFAULT_PREFIX, FORMATS, export_bundle
from sysid.parameters import Bundle
from sysid.parameters.assembled_model import effects_from_bundle
from sysid.plant.effects.catalogue import EffectSource, catalogue_from

_FORMAT_OF = {".h": "c", ".mat": "mat", ".json": "json"}


def export(
    bundle: Bundle,
    path: str | Path,
    *,
    format: str | None = None,
    prefix: str = DEFAULT_PREFIX,
    effects: EffectSource = None,
    accept_assumed: bool = False,
) -> tuple[str, ...]:
    """Write files for a controller: a C header, a MATLAB file or flat JSON.

    `format` "c", "mat" or "json"; None: by the suffix of `path` (.h, .mat, .json). Names in the
    header begin with `prefix`; `effects` are those of the bundle that the catalogue lacks.
    Controllers that use a constant that nobody declared are written only with `accept_assumed`.
    Returns notices: missing parameters, effects whose law the header does not contain. Raises
    InputError for an unknown format or a file that cannot be written.

    >>> notices = si.export(bundle, "model.h")
    """
    chosen = format or _FORMAT_OF.get(Path(path).suffix.lower())
    if chosen is None:
        known = ", ".join(FORMATS)
        raise input_error(path, "has no suffix that gives the format", f"pass format, of {known}")
    catalogue = catalogue_from(effects)
    effects_from_bundle(bundle, catalogue)
    return tuple(
        export_bundle(
            bundle,
            Path(path),
            chosen,
            prefix=prefix,
            catalogue=catalogue,
            accept_assumed=accept_assumed,
        )
    )


__all__ = ["export"]
