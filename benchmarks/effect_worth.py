"""What a found effect is worth to a controller: base, diagnosed and true bundle in closed loop.

    python benchmarks/effect_worth.py prepare FOLDER [--first 7000]
    python benchmarks/effect_worth.py loops FOLDER
    python benchmarks/effect_worth.py table FOLDER

`prepare` makes for each effect a campaign of the thesis' rig in which it acts undeclared, at its
usual size, and runs `sysid fit` and `sysid diagnose` on it, as a user would; what FOLDER holds
already is kept. `loops` runs the closed loops: the plant is the model with the true parameters
and effect, the controllers read the base bundle, the diagnosed one, or are told the truth.
Backstepping with both compensations and DVMPC (N_p = 35, predicted delays, trapezoidal), pneumatic
and hybrid, trajectories 1 to 4: 16 cells, 6 seeds of the noise, the geometric mean of their RMSE.
With the rig's sensors, and without encoder counts and the 50 Hz filter, whose lag of 5 ms is an
error of its own. The share of the gap is ln(base/diagnosed) over ln(base/true).
`table` prints what `loops` found. Nothing was tuned on these campaigns.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.true_model import true_model  # noqa: E402
from sysid.controllers.backstepping import BacksteppingController  # noqa: E402
from sysid.controllers.design_model import (  # noqa: E402
    DesignModel,
    design_from_bundle,
    design_model,
)
from sysid.controllers.dvmpc import DvmpcController  # noqa: E402
from sysid.controllers.interface import Controller  # noqa: E402
from sysid.controllers.loop import Case, closed_loop  # noqa: E402
from sysid.controllers.modes import Mode  # noqa: E402
from sysid.controllers.sensing import SensorSuite  # noqa: E402
from sysid.controllers.task import MOTOR_SHARE  # noqa: E402
from sysid.controllers.trajectories import thesis_trajectory  # noqa: E402
from sysid.parameters import read_bundle  # noqa: E402

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

BUNDLES = ("base", "diagnosed", "true")
CELLS = [
    (name, mode, n)
    for name in ("backstepping", "dvmpc")
    for mode in (Mode.PNEUMATIC, Mode.HYBRID)
    for n in (1, 2, 3, 4)
]
SEEDS = 6
# Below this, in ln(base/true), there is no gap.
LEAST_GAP = 0.02


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


def designs(place: Path) -> tuple[Any, dict[str, DesignModel], Any]:
    """The plant, what controllers know by base, diagnosed and true bundle, and the rig."""
    base, found = (read_bundle(place / f"{name}.json") for name in ("base", "diagnosed"))
    truth = json.loads((place / "truth.json").read_text(encoding="utf-8"))
    rig = base.rig
    true = true_model(truth, base.model(rig))
    known = {
        "base": design_from_bundle(base),
        "diagnosed": design_from_bundle(found),
        "true": design_model(true, rig=rig),
    }
    return true, known, rig


def controllers(design: DesignModel, mode: Mode) -> dict[str, Controller]:
    """The controllers that use the model."""
    portion = MOTOR_SHARE if mode.uses_motor else 0.0
    return {
        "backstepping": BacksteppingController(design, portion=portion),
        "dvmpc": DvmpcController(design, horizon=35, predicts_delays=True, trapezoidal=True),
    }


def looped(place: Path) -> dict[str, Any]:
    """RMSE, rad, by sensors and by bundle: (cells, seeds), in the order of `CELLS`."""
    plant, known, rig = designs(place)
    own = SensorSuite.of(rig)
    suites = {"rig": own, "unfiltered": SensorSuite(0.0, own.pressure_noise, 0.0, np.inf)}
    cases = [
        Case(controllers(design, mode)[name], plant, thesis_trajectory(n), mode, suite, seed=seed)
        for suite in suites.values()
        for design in known.values()
        for name, mode, n in CELLS
        for seed in range(SEEDS)
    ]
    found = np.array([run.metrics.rmse for run in closed_loop(cases)])
    shape = (len(suites), len(known), len(CELLS), SEEDS)
    rows = found.reshape(shape)
    return {
        s: dict(zip(known, row.tolist(), strict=True)) for s, row in zip(suites, rows, strict=True)
    }


def loops(folder: Path) -> None:
    """`worth.json` of every effect that is prepared; kept where it is."""
    for form in EFFECTS:
        place = place_of(folder, form)
        if (place / "diagnosed.json").exists() and not (place / "worth.json").exists():
            (place / "worth.json").write_text(json.dumps(looped(place)), encoding="utf-8")
            print(form, row_of(place), flush=True)


def row_of(place: Path) -> str:
    """What was found, and for each set of sensors RMSE by bundle (mrad) and the share."""
    content = json.loads((place / "diagnosed.json").read_text(encoding="utf-8"))
    names = ", ".join(f"`{e['id']}`" for e in content["effects"]) or "none"
    cells = [names]
    for figures in json.loads((place / "worth.json").read_text(encoding="utf-8")).values():
        # (bundles, seeds): each seed is a repetition of its own.
        logs = np.array([np.mean(np.log(figures[k]), axis=0) for k in BUNDLES])
        rmse = ", ".join(f"{1e3 * np.exp(x):.3g}" for x in logs.mean(axis=1))
        cells += [rmse, said(*logs)]
    return " | ".join(cells)


def said(base: np.ndarray, found: np.ndarray, true: np.ndarray) -> str:
    """The share of the gap that the diagnosed bundle recovers, from ln RMSE of every seed.

    Nothing to gain: a gap below 2 %, or one that is within twice its standard error.
    """
    gap = float(np.mean(base - true))
    error = float(np.std(base - true, ddof=1)) / np.sqrt(len(base))
    if abs(gap) < max(LEAST_GAP, 2.0 * error):
        return "nothing to gain"
    return f"{np.mean(base - found) / gap:.0%}" if gap > 0.0 else "the truth does not help"


def table(folder: Path) -> None:
    """Print the figures as Markdown."""
    print("| effect | found | rig's sensors: base, diagnosed, true, mrad | share | ", end="")
    print("unfiltered: base, diagnosed, true, mrad | share |\n" + "| --- " * 6 + "|")
    for form in EFFECTS:
        if (place_of(folder, form) / "worth.json").exists():
            print(f"| `{form}` | {row_of(place_of(folder, form))} |")


def main() -> None:
    """Prepare, run the loops, or print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", choices=("prepare", "loops", "table"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=7000, help="seed of the first campaign")
    options = parser.parse_args()
    if options.action == "prepare":
        prepare(options.folder, options.first)
    else:
        {"loops": loops, "table": table}[options.action](options.folder)


if __name__ == "__main__":
    main()
