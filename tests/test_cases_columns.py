"""The small inputs in ../shared/cases on which columns fell short."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import SHARED
from own_components import done

CASES = SHARED / "cases"


@pytest.fixture
def case(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    folder = CASES / request.param
    if not folder.is_dir():
        pytest.skip("../shared/cases is absent")
    for path in folder.iterdir():
        shutil.copyfile(path, tmp_path / path.name)
    return tmp_path


@pytest.mark.parametrize("case", ["sensor_offset"], indirect=True)
def test_a_transducer_of_half_a_volt_at_its_zero(case: Path) -> None:
    done("convert", case / "volts.csv", "-o", case / "p.csv", "--map", "time_s=time", "--map",
         "pressure_a_pa=V:0.5..4.5 -> 0..100 psi(g)", "--atmosphere", 101325)  # fmt: skip
    pressure = pd.read_csv(case / "p.csv", comment="#")["pressure_a_pa"]
    volts = pd.read_csv(case / "volts.csv")["V"]
    np.testing.assert_allclose(
        pressure, 101325 + 25 * 6894.757293168361 * (volts - 0.5), rtol=1e-12
    )


@pytest.mark.parametrize("case", ["component_convert"], indirect=True)
def test_a_component_s_columns_are_converted(case: Path) -> None:
    done("convert", case / "raw.csv", "-o", case / "r.csv", "--component", case / "pump.py",
         "--map", "time_s=t", "--map", "duty=u", "--map", "pressure_pa=P:kPa")  # fmt: skip
    found = pd.read_csv(case / "r.csv", comment="#")
    assert found.to_numpy().tolist() == [
        [0.0, 0.1, 1000.0],
        [0.05, 0.2, 1100.0],
        [0.1, 0.3, 1300.0],
    ]


@pytest.mark.parametrize("ratio", ["0.00392157", "1/255", "0.392157 percent"])
@pytest.mark.parametrize("case", ["component_ratio_map"], indirect=True)
def test_a_component_s_ratio_is_a_ratio(case: Path, ratio: str) -> None:
    path = case / "campaign.toml"
    path.write_text(path.read_text("utf-8").replace("0.00392157", ratio), "utf-8")
    found = done("check", path, "-v", "--component", case / "pump.py")
    assert "duty" in found.out and "outside" not in found.out + found.err
