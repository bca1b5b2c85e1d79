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
import subprocess
import sys
import tempfile
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.true_model import SAME_LAW, held_out_errors  # noqa: E402
from datasets.generator.effects import FORMS  # noqa: E402

MOTION = "motion-motor,motion-pwm,motion-discrete"


def called(*words: str) -> str:
    """What a command says in error; empty where it went well."""
    done = subprocess.run(
        [sys.executable, "-m", *words], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    lines = done.stderr.strip().splitlines() if done.returncode else []
    return lines[-1] if lines else ""


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

        def errors(name: str, *words: str) -> dict[str, float] | str:
            place, truth = Path(folder) / name, Path(folder) / f"{name}.json"
            said = called(
                "datasets.generator", "-o", str(place), *rig, "--truth", str(truth), *words
            )
            if said:
                return said
            campaign, bundle = place / "campaign.toml", Path(folder) / "bundle.json"
            if not bundle.exists():
                called("sysid", "fit", str(campaign), "-o", str(bundle))
            return held_out_errors(campaign, bundle, truth) or {}

        bare = errors("none")
        if isinstance(bare, str):
            sys.exit(bare)
        print("none", bare)
        for form in options.forms or SAME_LAW:
            name, _, law = form.partition(":")
            if law not in FORMS.get(name, ()):
                continue
            found = errors(form.replace(":", "_"), "--kinds", MOTION, "--effect", form)
            shown = found if isinstance(found, str) else {n: e / bare[n] for n, e in found.items()}
            shown = (
                shown if isinstance(shown, str) else " ".join(f"{r:.2f}" for r in shown.values())
            )
            print(form, shown, flush=True)


if __name__ == "__main__":
    main()
