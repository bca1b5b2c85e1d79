"""The catalogue's laws against the generator's: how far the true model is off, law by law.

    python benchmarks/laws.py [--seed 1830] [--orientation vertical] [--motion linear] [FORM ...]

For each form that is a law of the catalogue (`true_model.SAME_LAW`), or for those given, the rig of
a seed with that effect and without scatter is generated, its held-out motion is simulated with the
true numbers, and each channel's RMSE is printed over that of the same rig without an effect: 1
where both have the same law. What is far above is a law that differs, which a diagnosis would fit
with wrong numbers or call another effect.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.attribution import call  # noqa: E402
from benchmarks.true_model import SAME_LAW, held_out_errors  # noqa: E402
from datasets.generator.effects import FORMS  # noqa: E402

MOTION = "motion-motor,motion-pwm,motion-discrete"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("forms", nargs="*")
    parser.add_argument("--seed", type=int, default=1830)
    parser.add_argument("--orientation", default="horizontal")
    parser.add_argument("--motion", default="rotary")
    options = parser.parse_args()
    rig = ["--seed", str(options.seed), "--size", "lab", "--scatter", "0", "--parquet"]
    rig += ["--orientation", options.orientation, "--motion", options.motion]
    with tempfile.TemporaryDirectory() as folder:
        bundle = Path(folder) / "bundle.json"

        def errors(name: str, *words: str) -> dict[str, float]:
            """By channel. ValueError for a rig that the generator cannot move so."""
            place, truth = Path(folder) / name, Path(folder) / f"{name}.json"
            given = ["-o", str(place), *rig, "--truth", str(truth), *words]
            made = call("datasets.generator", *given)
            if made.returncode != 0:
                raise ValueError(made.stderr.strip().splitlines()[-1])
            campaign = place / "campaign.toml"
            if not bundle.exists():
                call("sysid", "fit", str(campaign), "-o", str(bundle))
            return held_out_errors(campaign, bundle, truth) or {}

        bare = errors("none")
        print("none", bare)
        known = (form for form in SAME_LAW if form.split(":")[0] in FORMS)
        for form in options.forms or known:
            try:
                found = errors(form.replace(":", "_"), "--kinds", MOTION, "--effect", form)
            except ValueError as error:
                print(form, error, flush=True)
                continue
            print(form, *(f"{e / bare[n]:.2f}" for n, e in found.items()), flush=True)


if __name__ == "__main__":
    main()
