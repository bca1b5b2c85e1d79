"""What a found effect is worth to a controller: base, diagnosed and true bundle in closed loop.

    python benchmarks/effect_worth.py prepare FOLDER [--first 7000]
    python benchmarks/effect_worth.py table FOLDER

`prepare` makes for each effect a campaign of the thesis' rig in which it acts undeclared, at its
usual size, and runs `sysid fit` and `sysid diagnose` on it, as a user would; what FOLDER holds
already is kept. `table` runs the closed loops: the plant is the model with the true parameters
and effect, the controllers read the base bundle, the diagnosed one, or are told the truth. The
RMSE is over trajectories 1 to 4 and the seeds of the sensors' noise. Seeds 100 to 199 were for
development, 7000 on are for the report.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

EFFECTS = {
    "stribeck-friction:gaussian": "friction",
    "seal-friction:sum": "friction",
    "asymmetric-coulomb-friction:constant": "friction",
    "valve-delay:both": "timing",
    "duty-dead-zone:vanish": "timing",
    "supply-droop:coupled": "supply",
    "piston-leakage:quadratic": "leakage",
    "atmosphere-leakage:quadratic": "leakage",
    "pressure-offset:constant": "sensor",
    "pressure-lag:first-order": "sensor",
    "inertia-mismatch:balanced": "payload",
    "torque-constant-error:gain": "motor",
}
"""Forms that the catalogue holds as laws, by family; each is made with the seed of its place."""


def place_of(folder: Path, form: str) -> Path:
    """Where an effect's campaign and bundles are."""
    return folder / form.replace(":", "-")


def call(*words: str) -> None:
    """A command in the repository, as a user would call it; SystemExit if it fails."""
    command = [sys.executable, "-m", *words]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(words)}: {done.stderr.strip()[-500:]}")


def prepare(folder: Path, first: int) -> None:
    """Campaign, truth, base bundle and diagnosed bundle of every effect."""
    for i, form in enumerate(EFFECTS):
        place = place_of(folder, form)
        if (place / "diagnosed.json").exists():
            continue
        place.mkdir(parents=True, exist_ok=True)
        rig, truth, base = place / "rig", place / "truth.json", place / "base.json"
        options = ["--rig", "reference", "--size", "lab", "--parquet", "--effect", form]
        seed = str(first + i)
        call("datasets.generator", "-o", str(rig), "--seed", seed, "--truth", str(truth), *options)
        campaign = str(rig / "campaign.toml")
        call("sysid", "fit", campaign, "-o", str(base))
        found = str(place / "diagnosed.json")
        call("sysid", "diagnose", campaign, "--bundle", str(base), "-o", found)
        print(form, [e["id"] for e in json.loads(Path(found).read_text())["effects"]], flush=True)


def main() -> None:
    """Prepare, or print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", choices=("prepare", "table"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=7000, help="seed of the first campaign")
    options = parser.parse_args()
    if options.action == "prepare":
        prepare(options.folder, options.first)


if __name__ == "__main__":
    main()
