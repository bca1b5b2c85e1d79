"""The campaign that comes with the project, for `sysid demo`."""

from __future__ import annotations

from pathlib import Path

from sysid.errors import input_error

_PACKAGE = Path(__file__).resolve().parent.parent


def bundled_campaign() -> Path:
    """Its campaign file: inside an installed package, or in the project's `datasets/`."""
    for folder in (_PACKAGE / "_bundled", _PACKAGE.parent / "datasets" / "bundled"):
        if (folder / "campaign.toml").is_file():
            return folder / "campaign.toml"
    raise input_error(_PACKAGE, "the bundled campaign is missing", "reinstall sysid")
