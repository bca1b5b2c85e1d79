"""A recording that a campaign holds twice: by another name, format, unit, clock or length."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import sysid as si
from sysid.pipeline.check import check_campaign

RIG = '[rig]\nname = "axis"\nmotion = "linear"\norientation = "horizontal"\n'
TIME = np.arange(1500) * 0.002


def motion(seed: int) -> pd.DataFrame:
    noise = np.random.default_rng(seed)
    speed = 0.25 * np.sin(2.5 * TIME) + 0.1 * np.sin(7.0 * TIME + 0.3)
    force = 2.0 * np.gradient(speed, 0.002) + 8.0 * np.tanh(speed / 1e-3) + 25.0 * speed
    place = np.cumsum(speed) * 0.002 + 2e-5 * noise.standard_normal(len(TIME))
    force += 0.3 * noise.standard_normal(len(TIME))
    columns = {"time_s": TIME, "position_m": np.round(place / 2e-5) * 2e-5, "motor_force_n": force}
    return pd.DataFrame(columns)


def later(log: pd.DataFrame) -> pd.DataFrame:
    return log.assign(time_s=log["time_s"] + 17.3)


COPIES = {
    "the same": lambda log: log,
    "later": later,
    "a part": lambda log: later(log.iloc[400:1200]),
    "longer": lambda log: pd.concat([motion(9), later(log)]),
    "other columns": lambda log: log.assign(supply_pressure_pa=6e5)[
        ["supply_pressure_pa", "motor_force_n", "time_s", "position_m"]
    ],
}


def notices(folder: Path, other: pd.DataFrame, use: str, form: str = "%.6g") -> tuple[str, ...]:
    motion(1).to_csv(folder / "a.csv", index=False, float_format="%.6g")
    other.to_csv(folder / "b.csv", index=False, float_format=form)
    (folder / "rig.toml").write_text(RIG)
    logs = "".join(
        f'[[log]]\nkind = "friction-motion"\nfile = "{name}.csv"\nuse = "{which}"\n'
        for name, which in (("a", "fit"), ("b", use))
    )
    (folder / "c.toml").write_text(f'rig = "rig.toml"\n{logs}')
    return check_campaign(si.read_campaign(folder / "c.toml")).contradictions


@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("form", ["%.6g", "%.9e"])
def test_a_copy_is_not_held_out(tmp_path: Path, how: str, form: str) -> None:
    found = notices(tmp_path, COPIES[how](motion(1)), "holdout", form)
    assert [line for line in found if "b.csv: holds the samples of a.csv: what is fitted" in line]


def test_a_copy_is_no_further_evidence_and_another_run_of_the_motion_is(tmp_path: Path) -> None:
    assert any("no further evidence" in line for line in notices(tmp_path, motion(1), "fit"))
    for use in ("fit", "holdout"):
        assert not any("holds the samples" in line for line in notices(tmp_path, motion(2), use))
