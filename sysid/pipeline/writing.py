"""The report, and files for a controller."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sysid.blocks.progress import progress_or_shown
from sysid.checks.log_check import LogCheck
from sysid.document import write_report
from sysid.errors import input_error
from sysid.exporters import DEFAULT_PREFIX, FORMATS, export_bundle
from sysid.io.campaign import Campaign
from sysid.parameters import Bundle
from sysid.parameters.assembled_model import effects_from_bundle
from sysid.pipeline.diagnosing import CampaignDiagnosis
from sysid.pipeline.subject import subject_of
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.types import Progress
from sysid.validation.results import ValidationResult

_FORMAT_OF = {".h": "c", ".mat": "mat", ".json": "json"}


def report(
    path: str | Path,
    campaign: Campaign,
    found: CampaignDiagnosis | Bundle,
    checked: ValidationResult | None = None,
    *,
    checks: Sequence[LogCheck] | None = None,
    progress: Progress | None = None,
) -> None:
    """Write one self-contained HTML page about a campaign, whole or not at all.

    `found`: a diagnosis, or a bundle where none was made; `checked` a validation. Sections
    without content are missing, and the page says so. `checks` None: every log is checked
    anew. Raises InputError where a log cannot be read or the file not be written, and for the
    bundle of a linear rig with a rotary one's campaign, or the reverse; where another rig file
    differs in less, the page says so.

    >>> si.report("out.html", campaign, bundle, checked)
    """
    diagnosis = None if isinstance(found, Bundle) else found.content()
    with progress_or_shown(progress, "writing the report") as tell:
        if checks is None:
            checks = subject_of(campaign).checks()
        write_report(
            Path(path),
            campaign=campaign,
            bundle=found if isinstance(found, Bundle) else found.bundle,
            validation=checked,
            checks=checks,
            diagnosis=diagnosis,
            progress=tell,
        )


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


__all__ = ["export", "report"]
