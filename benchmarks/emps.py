"""EMPS, a motor axis without valves: simulated position of the validation file, before and after.

    python benchmarks/emps.py --data ../shared/data/emps

`sysid fit` on the estimation file, then `si.refine`; once with the fitted bundle, once with that of
`sysid diagnose`, which holds effects. All numbers are from the estimation file. The position
is simulated open loop, as a whole (from the velocity that the first samples show, and from rest as
other work does: the files begin some 7 ms after the axis) and in segments of 1 s from their own
start states; the force error is that of the equation of motion along the measured motion.
"""

from __future__ import annotations

import argparse
import math
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

import sysid as si  # noqa: E402
from sysid.balance.imposed import effort_rmse  # noqa: E402
from sysid.io.campaign import Campaign  # noqa: E402
from sysid.plant.ports import Model  # noqa: E402
from sysid.recording.even import recorded  # noqa: E402
from sysid.recording.motion_tests import MotionTest, Segment  # noqa: E402
from sysid.recording.simulation import simulate_segments  # noqa: E402
from sysid.refinement.refine import motion_tests_of  # noqa: E402

SET = REPOSITORY / "datasets" / "measured" / "emps"
FILES = {"estimation": "DATA_EMPS.mat", "pulses": "DATA_EMPS_PULSES.mat"}
KIND = "friction-motion"


def campaign_of(data: Path, folder: Path) -> Campaign:
    """The campaign of both files, converted by the ordinary command."""
    for path in SET.glob("*.toml"):
        shutil.copy(path, folder)
    for name, source in FILES.items():
        command = [sys.executable, "-m", "sysid", "convert", str(data / source)]
        command += ["--spec", "recipe.toml", "-o", f"{name}.csv"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return si.read_campaign(folder / "campaign.toml")


def from_rest(test: MotionTest) -> Segment:
    """The whole test, with the first row's position and no velocity."""
    start = test.whole.state
    values = np.where(np.arange(4) == 1, 0.0, start.values)
    values[0] = test.measured[0, 0]
    return Segment(0, len(test.time), type(start)(values, start.std, start.samples))


def errors(campaign: Campaign, bundle: Any, model: Model, use: str) -> dict[str, float]:
    """RMSE of a file: position in mm by how it is simulated, force in N."""
    entries = campaign.select([KIND], use=use)
    (test,) = motion_tests_of(campaign, entries, bundle, model, [])
    found = {}
    for name, parts in (
        ("whole", [test.whole]),
        ("from rest", [from_rest(test)]),
        ("segments", list(test.segments)),
    ):
        runs = simulate_segments([(test, p) for p in parts], model, (), "position_m")
        squares = [
            np.square(run[0] - test.measured[0, p.start : p.stop])
            for run, p in zip(runs, parts, strict=True)
        ]
        found[name] = 1e3 * math.sqrt(float(np.mean(np.concatenate(squares))))
    trials = (trial for entry in entries for trial in campaign.read(entry).trials)
    recordings = [recorded(trial, campaign.rig, []) for trial in trials]
    return found | {"force": effort_rmse(recordings, model)}


def show(title: str, campaign: Campaign, bundle: Any) -> None:
    """One bundle's errors on both files."""
    model = bundle.model(campaign.rig)
    for use in ("fit", "holdout"):
        e = errors(campaign, bundle, model, use)
        print(
            f"{title}, {use}: position {e['whole']:.2f} mm whole, {e['from rest']:.2f} mm from "
            f"rest, {e['segments']:.3f} mm in segments of 1 s; force {e['force']:.3f} N"
        )


def refined(title: str, campaign: Campaign, bundle: Any) -> None:
    """Refine a bundle, with its errors before and after."""
    start = time.perf_counter()
    result = si.refine(campaign, bundle, progress=lambda line: None)
    seconds = time.perf_counter() - start
    print(f"\n{title}: {result.headline()}, {result.left_out} left out, {seconds:.0f} s")
    for p in result.parameters:
        print(
            f"  {p.name}: {p.unknown.value:.5g} -> {p.estimate.value:.5g} +- {p.estimate.std:.2g}"
        )
    show("before", campaign, bundle)
    show("after", campaign, result.bundle)


def main() -> None:
    """Print the numbers and the errors, before and after, without effects and with them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--data", type=Path, required=True)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        campaign = campaign_of(options.data.resolve(), Path(folder))
        bundle = si.fit(campaign, progress=lambda line: None)
        refined("fitted", campaign, bundle)
        quiet: Any = lambda line: None  # noqa: E731
        found = si.diagnose(campaign, bundle, refine=False, progress=quiet)
        names = ", ".join(entry.id for entry in found.bundle.effects)
        refined(f"diagnosed ({names})", campaign, found.bundle)


if __name__ == "__main__":
    main()
