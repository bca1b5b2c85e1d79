"""What comes with the project: a campaign for `sysid demo`, the thesis' tables and rig."""

from __future__ import annotations

from pathlib import Path

from sysid.errors import input_error

REFERENCE_BUNDLE = "reference_bundle.json"
_PACKAGE = Path(__file__).resolve().parent.parent


def bundled_campaign() -> Path:
    """Its campaign file: inside an installed package, or in the project's `datasets/`."""
    for folder in (_PACKAGE / "_bundled", _PACKAGE.parent / "datasets" / "bundled"):
        if (folder / "campaign.toml").is_file():
            return folder / "campaign.toml"
    raise input_error(_PACKAGE, "the bundled campaign is missing", "reinstall sysid")


def thesis_folder() -> Path:
    """The printed tables of simulated controllers, and the bundle of the thesis' rig."""
    for folder in (_PACKAGE / "_thesis", _PACKAGE.parent / "datasets" / "thesis"):
        if (folder / REFERENCE_BUNDLE).is_file():
            return folder
    raise input_error(_PACKAGE, "the thesis' tables are missing", "reinstall sysid")
