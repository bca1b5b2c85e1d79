"""The bundled campaign with only as many of its logs as a diagnosis needs to find its effect."""

from __future__ import annotations

import shutil
from pathlib import Path

from sysid.io.bundled import bundled_campaign

KINDS = ("friction-static", "friction-sliding", "valve-discrete", "motion-discrete")


def write_small(folder: Path) -> Path:
    """A copy in a folder, with all logs beside it; its campaign file, which names the few."""
    shutil.copytree(bundled_campaign().parent, folder, dirs_exist_ok=True)
    path = folder / "campaign.toml"
    head, *entries = path.read_text("utf-8").split("[[log]]")
    kept = [entry for entry in entries if any(f'"{kind}"' in entry for kind in KINDS)]
    path.write_text("[[log]]".join([head, *kept]), "utf-8")
    return path
