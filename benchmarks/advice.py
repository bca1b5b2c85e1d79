"""Whether `sysid advise` foretells the standard errors that the refinement then finds.

    python benchmarks/advice.py [--seeds 9100 9106] [--size small] [--results FILE.jsonl]

For each seed: a generated campaign (2 % scatter of friction, quantisation), its fit, and the
advice. The motion test that it names first is then really made: its commands on the generator's
own plant, with friction drawn anew, and noise. The logs to fit on and that
test are refined together, and the predicted standard error of each parameter is divided by the one
that the refinement gives. The refined value's distance from the truth is printed in units of
both. One line of JSON per rig is appended to the results, and all of them are summed up.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.sweeps import accumulated  # noqa: E402
from datasets.generator.campaign import make_campaign, size_of  # noqa: E402
from datasets.generator.files import write_log  # noqa: E402
from datasets.generator.friction_tests import friction_factors  # noqa: E402
from datasets.generator.rigs import GeneratedRig  # noqa: E402
from datasets.generator.runs import Commands, at_atmosphere, logged, simulated  # noqa: E402
from sysid.io.campaign import MOTION_KINDS, read_campaign  # noqa: E402
from sysid.pipeline.fit import fit_campaign  # noqa: E402
from sysid.refinement.advice import advise  # noqa: E402
from sysid.refinement.candidates import CandidateMotion  # noqa: E402
from sysid.refinement.refine import refine  # noqa: E402

SCATTER = 0.02
# Surfaces under PWM have no part in it.
KINDS = ("friction-static", "friction-sliding", "valve-discrete", *MOTION_KINDS)
_TRUTH = {"static": "static_friction", "coulomb": "coulomb_friction", "viscous": "viscous_friction"}
WITHIN = (0.8, 1.25)


def true_value(rig: GeneratedRig, name: str) -> float:
    """What a parameter of the refinement should be."""
    *place, key = name.split(".")
    if place[0] == "friction":
        return float(getattr(rig.truth, _TRUTH[key.split("_")[0]]))
    return float(getattr(getattr(rig.truth, f"valve_{place[1]}"), key))


def really_made(
    folder: Path, rig: GeneratedRig, motion: CandidateMotion, rng: np.random.Generator
) -> None:
    """The test on the generator's plant, as a further log of the campaign."""
    valves = {}
    if motion.valves is not None:
        prefix = "duty" if motion.kind == "motion-pwm" else "valve"
        valves = {f"{prefix}_{side}": v for side, v in zip("ab", motion.valves, strict=True)}
    commands = Commands(motion.motor, **valves)
    plant = rig.plant(*friction_factors(rng, SCATTER))
    states = simulated(rig, plant, commands, at_atmosphere(rig, 0.0))
    test = logged("1", rig, commands, states, rig.truth.pressure_noise_pa, rng, {})
    write_log(folder / "advised.csv", [test], rig)
    entry = f'\n[[log]]\nkind = "{motion.kind}"\nfile = "advised.csv"\nuse = "fit"\n'
    path = folder / "campaign.toml"
    path.write_text(path.read_text() + entry)


def one_rig(seed: int, size: str) -> dict[str, Any]:
    """The seed's parameters: predicted and found standard errors, and the errors themselves."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        words = [
            "-o",
            name,
            "--seed",
            str(seed),
            "--size",
            size,
            "--parquet",
            "--kinds",
            ",".join(KINDS),
        ]
        subprocess.run(
            [sys.executable, "-m", "datasets.generator", *words], cwd=REPOSITORY, check=True
        )
        campaign = read_campaign(folder / "campaign.toml")
        bundle = fit_campaign(campaign, surface="bipolynomial").bundle
        advice = advise(campaign, bundle, threshold=1.0, catalogue={})
        test = next(c for c in advice.candidates if c.motion is not None)
        rig = make_campaign(seed, size=size_of(size), kinds=()).rig
        assert test.motion is not None
        really_made(folder, rig, test.motion, np.random.default_rng([seed, 77]))
        found = refine(read_campaign(folder / "campaign.toml"), bundle)
    rows = {}
    for i, (unknown, p) in enumerate(zip(advice.parameters, found.parameters, strict=True)):
        assert unknown.name == p.name
        rows[p.name] = {
            "now": float(advice.now[i]),
            "predicted": float(test.std[i]),
            "found": p.estimate.std,
            "error": p.estimate.value - true_value(rig, p.name),
        }
    return {"seed": seed, "size": size, "test": test.name, "parameters": rows}


def summed_up(results: list[dict[str, Any]]) -> None:
    """Predicted over found, by parameter and together; the errors in both units."""
    names = results[0]["parameters"]
    print("| parameter | predicted / found, median (range) | error / predicted, RMS | / found |")
    print("| --- | --- | --- | --- |")
    ratios, scores = [], []
    for name in names:
        rows = [r["parameters"][name] for r in results]
        ratio = np.array([r["predicted"] / r["found"] for r in rows])
        score = np.array([(r["error"] / r["predicted"], r["error"] / r["found"]) for r in rows])
        rms = np.sqrt(np.mean(score**2, axis=0))
        spread = f"{np.median(ratio):.2f} ({ratio.min():.2f} to {ratio.max():.2f})"
        print(f"| `{name}` | {spread} | {rms[0]:.2f} | {rms[1]:.2f} |")
        ratios.append(ratio)
        scores.append(score)
    every, errors = np.concatenate(ratios), np.concatenate(scores)
    share = np.mean((every >= WITHIN[0]) & (every <= WITHIN[1]))
    print(
        f"{len(results)} rigs, {len(every)} ratios: {100 * share:.0f} % in {WITHIN[0]} to "
        f"{WITHIN[1]}; median {np.median(every):.2f}; within 1.96 predicted errors of the truth "
        f"{100 * np.mean(np.abs(errors[:, 0]) < 1.96):.0f} %, found errors "
        f"{100 * np.mean(np.abs(errors[:, 1]) < 1.96):.0f} %"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(9100, 9106), help="first, end")
    parser.add_argument("--size", default="small", help="of the campaigns, as the generator's")
    parser.add_argument("--results", type=Path, default=Path("advice.jsonl"))
    options = parser.parse_args()
    results = accumulated(options.results, options.seeds, lambda seed: one_rig(seed, options.size))
    summed_up(results)


if __name__ == "__main__":
    main()
