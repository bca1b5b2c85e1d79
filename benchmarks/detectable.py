"""The smallest size at which each effect of the catalogue would be seen.

    python benchmarks/detectable.py [--seed 4000]

On a generated campaign of a lab's size with nothing missing: the size at which an effect's
gain passes the twins' test, from the length of its signature with the base parameters
projected out and from what the twins gain (gains go with the square of the size). Beside it
the usual size on such a rig. Effects whose strengths come with a grid (thresholds) are
given at the form that shows most.
"""

from __future__ import annotations

import argparse
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.stats import norm

from sysid.bundle import read_bundle
from sysid.campaign import KINDS, read_campaign
from sysid.diagnosis.calibration import MARGIN
from sysid.diagnosis.loop import close_loop
from sysid.diagnosis.search import CLEAR_RATIO, SIGNIFICANCE
from sysid.diagnosis.signatures import Signatures, candidates
from sysid.model.effects import catalogue
from sysid.model.from_bundle import model_from_bundle

REPOSITORY = Path(__file__).resolve().parent.parent


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=4000)
    seed = parser.parse_args().seed
    with tempfile.TemporaryDirectory() as folder:
        made = ["-m", "datasets.generator", "-o", folder, "--seed", str(seed), "--size", "lab"]
        fitted = Path(folder) / "bundle.json"
        campaign_path = Path(folder) / "campaign.toml"
        fit = ["-m", "sysid", "fit", str(campaign_path), "-o", str(fitted)]
        for command in ([*made, "--parquet"], fit):
            subprocess.run(
                [sys.executable, *command], cwd=REPOSITORY, check=True, capture_output=True
            )
        campaign = read_campaign(campaign_path)
        model = model_from_bundle(read_bundle(fitted), campaign.rig)
        tests = [
            (entry.file, entry.kind, trial)
            for entry in campaign.select(KINDS)
            for trial in campaign.read(entry).trials
        ]
    effects = {name: e for name, e in catalogue().items() if not e.averaged_only}
    found = close_loop(
        tests, campaign.rig, model, effects.values(), simulation_error=lambda model: 0.0
    )
    null, base = found.null, found.search.first
    null.calibrate(dict.fromkeys(effects, math.inf), 0.0)
    signatures = Signatures(base.frame, base.model, base.residual)
    distance = float(norm.isf(SIGNIFICANCE / null.family))
    print("| effect | strength | usual size | smallest size seen | usual / smallest |")
    print("| --- | --- | --- | --- | --- |")
    for name, effect in effects.items():
        gains = null.gains(name)
        spread = max(1.0, float(np.std(np.sqrt(gains), ddof=1)))
        passing = (
            MARGIN * float(np.mean(np.sqrt(np.maximum(gains, 1.0)))) + distance * spread
        ) ** 2
        passing = max(passing, CLEAR_RATIO * max(float(gains.max()), 10.0))
        best = math.inf, "", 0.0
        for form in candidates([effect]):
            length = np.linalg.norm(base.project(signatures(form)), axis=0)
            for (strength, step), size in zip(form.steps, length, strict=True):
                usual = next(q.typical for q in effect.quantities if q.name == strength)
                smallest = abs(step) * math.sqrt(passing) / max(float(size), 1e-12)
                best = min(best, (smallest / abs(usual), strength, abs(usual)))
        ratio, strength, usual = best
        unit = next(q.unit for q in effect.quantities if q.name == strength)
        print(
            f"| `{name}` | {strength} | {usual:.3g} {unit} | {ratio * usual:.2g} {unit} "
            f"| {1.0 / ratio:.2g} |"
        )


if __name__ == "__main__":
    main()
