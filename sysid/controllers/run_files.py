"""A run as files in our own formats: log, reference, rig and campaign, next to each other.

The log is as the rig would have recorded it: encoder, pressure sensors and commands, not the
true states; so `sysid check`, `validate` and `diagnose` read it like a measured one.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.controllers.cases import ClosedLoopRun
from sysid.controllers.modes import Mode
from sysid.io.channels import SIDES
from sysid.io.files import make_folder, write_atomic
from sysid.io.rig import RIG_FILE_NAME, Rig
from sysid.io.tables import write_table
from sysid.io.toml_text import toml_text

if TYPE_CHECKING:
    import pandas as pd

LOG_NAME = "run.csv"
REFERENCE_NAME = "reference.csv"
CAMPAIGN_NAME = "campaign.toml"


def log_frame(run: ClosedLoopRun, mode: Mode, rig: Rig) -> pd.DataFrame:
    """The columns of the log format: time, measured signals, the commands of the mode; SI."""
    import pandas as pd

    columns = {
        "time_s": np.round(run.time, 9),
        rig.position_channel: run.measured,
        "pressure_a_pa": run.measured_a,
        "pressure_b_pa": run.measured_b,
    }
    for side, command in zip(SIDES, (run.command_a, run.command_b), strict=True):
        if run.is_duty:
            columns[f"duty_{side}"] = np.clip(command, 0.0, 1.0)
        else:
            columns[f"valve_{side}"] = (command > 0.5).astype(int)
    if mode.uses_motor:
        limit = np.inf if rig.max_effort is None else rig.max_effort
        columns[rig.effort_channel] = np.clip(run.motor, -limit, limit)
    return pd.DataFrame(columns)


def reference_frame(run: ClosedLoopRun) -> pd.DataFrame:
    """The reference and its first two derivatives, and what no log holds: the true position."""
    import pandas as pd

    position, velocity, acceleration = run.reference.T[:3]
    return pd.DataFrame(
        {
            "time_s": np.round(run.time, 9),
            "reference_rad": position,
            "reference_rad_per_s": velocity,
            "reference_rad_per_s2": acceleration,
            "true_theta_rad": run.position,
            "payload_estimate_kg": run.payload_kg,
        }
    ).dropna(axis="columns")


def kind_of(run: ClosedLoopRun, mode: Mode) -> str:
    """The kind of test that the log holds, as a campaign names it."""
    if mode is Mode.MOTOR:
        return "motion-motor"
    return "motion-pwm" if run.is_duty else "motion-discrete"


def write_run(
    folder: Path, run: ClosedLoopRun, mode: Mode, rig: Rig, comments: tuple[str, ...] = ()
) -> list[Path]:
    """Write the log, the reference, the rig file and a campaign that holds the log.

    The campaign's entry is for `fit`, so that `sysid diagnose` can use it too. The folder is
    created. Raises InputError where it cannot be written.
    """
    make_folder(folder)
    campaign = {
        "rig": RIG_FILE_NAME,
        "log": [{"kind": kind_of(run, mode), "file": LOG_NAME, "use": "fit"}],
    }
    write_table(log_frame(run, mode, rig), folder / LOG_NAME, comments)
    write_table(reference_frame(run), folder / REFERENCE_NAME, comments)
    write_atomic(folder / RIG_FILE_NAME, toml_text(rig.content))
    write_atomic(folder / CAMPAIGN_NAME, toml_text(campaign))
    return [folder / n for n in (LOG_NAME, REFERENCE_NAME, RIG_FILE_NAME, CAMPAIGN_NAME)]


__all__ = ["kind_of", "log_frame", "reference_frame", "write_run"]
