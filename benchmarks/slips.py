"""Slips of unit, column, time and sign in well-formed logs: which are caught.

    python benchmarks/slips.py [--healthy 20]

Each slip is made in the bundled campaign's logs and put through `sysid fit`. Caught is exit 2 or
3, or a notice that names that very slip. The same notices on healthy recordings (the bundled
campaign, generated rigs of seeds 3000, 3001, ..., and the sample campaigns) are false alarms.
"""

from __future__ import annotations

import argparse
import contextlib
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.slip_changes import (  # noqa: E402
    FrameChange,
    only_time,
    scaled,
    spiked,
    swapped,
)
from datasets.generator.campaign import make_friction_tests  # noqa: E402
from sysid.errors import SysidError  # noqa: E402
from sysid.friction import fit_friction  # noqa: E402
from sysid.io.campaign import FRICTION_KINDS, MOTION_KINDS, read_campaign  # noqa: E402
from sysid.io.logs import Trial  # noqa: E402
from sysid.io.rig import rig_from_content  # noqa: E402

BUNDLED = REPOSITORY / "datasets" / "bundled"
SAMPLES = REPOSITORY.parent / "shared" / "samples"


@dataclass(frozen=True)
class Slip:
    """One slip: the log, the change, and the notice that names it (a regular expression).

    `inertia` multiplies the rig file's.
    """

    name: str
    log: str
    change: FrameChange
    notice: str
    inertia: float = 1.0


def wrapped(frame: pd.DataFrame) -> pd.DataFrame:
    angle = 4.0 * frame["theta_rad"] if "theta_rad" in frame else None
    return frame.assign(theta_rad=np.mod(angle, 2.0 * np.pi))


FRICTION = ("friction_sliding", "friction_motion")
PRESSURES = ("pressure_a_pa", "pressure_b_pa")
BEYOND, VOLTS = "end stops", "motor_volts"
TIME, SPIKE, REST, SWAP = "sampled every|per row", "single sample", "twice", "swapped"


def slips() -> list[Slip]:
    found = []
    for log in (*FRICTION, "friction_static"):
        found += [
            Slip(f"time x {x:g}", log, scaled("time_s", x), TIME) for x in (1.5, 2, 10, 1e3, 1e6)
        ]
        found += [
            Slip("every channel but the time held", log, only_time, "-"),
            Slip("angle shifted by 0.5 rad", log, scaled("theta_rad", 1.0, 0.5), BEYOND),
            Slip("angle x 3", log, scaled("theta_rad", 3.0), BEYOND),
            Slip("angle in degrees", log, scaled("theta_rad", 180.0 / np.pi), "-"),
            Slip("angle in revolutions", log, scaled("theta_rad", 0.5 / np.pi), "-"),
            Slip("angle in thousandths", log, scaled("theta_rad", 1e3), "-"),
            Slip("angle reversed", log, scaled("theta_rad", -1.0), SWAP),
            Slip("effort zero", log, scaled("motor_torque_nm", 0.0), "-"),
            Slip("effort reversed", log, scaled("motor_torque_nm", -1.0), "-"),
            Slip("volts as Nm", log, scaled("motor_torque_nm", 1.0 / 0.078), VOLTS),
            Slip("mNm as Nm", log, scaled("motor_torque_nm", 1e3), "-"),
        ]
        if log != "friction_static":
            found += [
                Slip("chambers swapped", log, swapped(*PRESSURES), SWAP),
                Slip("one sample of 1.2 MPa", log, spiked("pressure_a_pa", 1.2e6), SPIKE),
                Slip(
                    "atmosphere twice",
                    log,
                    lambda f: f.assign(**{p: f[p] + 100200.0 for p in PRESSURES}),
                    REST,
                ),
                Slip("pressures in kPa", log, scaled(PRESSURES[0], 1e-3), "-"),
                Slip("gauge", log, scaled(PRESSURES[0], 1.0, -100200.0), "-"),
                Slip("inertia x 1000", log, lambda f: f, "-", inertia=1e3),
            ]
    found.append(Slip("angle wraps", "friction_motion", wrapped, "wraps around"))
    for log in ("valve_pwm_a", "valve_discrete_a"):
        found += [Slip(f"time x {x:g}", log, scaled("time_s", x), TIME) for x in (1.5, 2, 10, 1e3)]
        found += [
            Slip("one sample of 1.2 MPa", log, spiked("pressure_a_pa", 1.2e6), SPIKE),
            Slip("pressures in kPa", log, scaled("pressure_a_pa", 1e-3), "-"),
            Slip("gauge", log, scaled("pressure_a_pa", 1.0, -100200.0), "-"),
            Slip("pressure in psi", log, scaled("pressure_a_pa", 1.0 / 6894.757), "-"),
        ]
        if log == "valve_pwm_a":
            found.append(Slip("duty in percent", log, scaled("duty_a", 100.0), "-"))
    return found


COMMANDS = {"friction": "friction", "valve_pwm": "valve-pwm", "valve_discrete": "valve-discrete"}


def run(slip: Slip, folder: Path) -> tuple[int, str]:
    """Exit status and standard error of the fit of the changed log."""
    rig = (BUNDLED / "rig.toml").read_text()
    found = re.search(r"equivalent_kg_m2 = ([\d.e-]+)", rig)
    assert found is not None
    inertia = slip.inertia * float(found.group(1))
    rig = rig.replace(found.group(0), f"equivalent_kg_m2 = {inertia:g}")
    (folder / "rig.toml").write_text(rig)
    frame = slip.change(pd.read_parquet(BUNDLED / f"{slip.log}.parquet"))
    frame.to_parquet(folder / "log.parquet")
    kind = next(v for k, v in COMMANDS.items() if slip.log.startswith(k))
    words = ["fit", kind, "log.parquet"]
    if kind == "valve-pwm":
        words += ["--surface", "bipolynomial"]
    words = [sys.executable, "-m", "sysid", *words]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, done.stderr


def healthy(count: int) -> None:
    """Notices of slips on recordings without one."""
    named = re.compile("|".join((BEYOND, VOLTS, SPIKE, REST, SWAP, "per row")))
    false, logs = [], 0
    for seed in range(3000, 3000 + count):
        orientation = "vertical" if seed % 3 == 0 else "horizontal"
        tests = make_friction_tests(seed, orientation=orientation)
        rig = rig_from_content(tests.rig, "generated")
        trials = [
            Trial(t.label, t.columns["time_s"], t.columns, f"{seed}")
            for group in tests.kinds.values()
            for t in group
        ]
        logs += 1
        result = fit_friction(trials, rig)
        false += [f"{seed}: {n}" for n in (*result.notices, *result.impossible) if named.search(n)]
        false += [f"{seed}: {line}" for line in result.impossible]
    for file in [BUNDLED / "campaign.toml", *sorted(SAMPLES.glob("*/campaign.toml"))]:
        campaign = read_campaign(file)
        for entry in campaign.logs:
            logs += 1
            log = campaign.read(entry)
            notices = list(log.notices)
            if entry.kind in (*FRICTION_KINDS, *MOTION_KINDS):
                with contextlib.suppress(SysidError):
                    found = fit_friction(log.trials, campaign.rig)
                    notices += [*found.notices, *found.impossible]
            false += [f"{entry.path.name}: {n}" for n in notices if named.search(n)]
    print(f"healthy: {len(false)} false alarms in {logs} recordings")
    for line in false:
        print(f"   {line}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--healthy", type=int, default=20, help="generated rigs")
    options = parser.parse_args()
    missed = []
    wanted = slips()
    for slip in wanted:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            status, errors = run(slip, folder)
        caught = status in (2, 3) or (slip.notice != "-" and re.search(slip.notice, errors))
        if not caught:
            missed.append(f"{slip.log}: {slip.name} (exit {status})")
    share = 100.0 * (1.0 - len(missed) / len(wanted))
    print(f"slips: {len(wanted) - len(missed)} of {len(wanted)} caught ({share:.0f} %)")
    for line in missed:
        print(f"   not caught: {line}")
    healthy(options.healthy)


if __name__ == "__main__":
    main()
