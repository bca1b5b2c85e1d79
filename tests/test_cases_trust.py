"""The inputs of `../shared/cases` of what a log cannot be trusted in."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from sysid.friction import fit_friction
from sysid.io.bare_rig import read_bare_logs
from sysid.io.logs import read_log
from sysid.io.rig import read_rig

CASES = Path(__file__).resolve().parents[2] / "shared" / "cases"
TRUE = {"coulomb_n": 8.0, "viscous_n_s_per_m": 25.0, "mass_kg": 2.0}

pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason="no ../shared/cases")


@pytest.mark.parametrize("with_rig", [True, False])
def test_an_encoder_that_jumps_is_said_and_its_log_is_joined_on(
    with_rig: bool, tmp_path: Path
) -> None:
    case = CASES / "encoder_index_jump"
    for name in ("jump.csv", "rig.toml"):
        shutil.copy(case / name, tmp_path)
    path = tmp_path / "jump.csv"
    if with_rig:
        rig = read_rig(tmp_path / "rig.toml")
        log = read_log(path, rig)
    else:
        bare = read_bare_logs([path], {})
        rig, (log,) = bare.rig, bare.logs
    (line,) = (n for n in log.notices if "jumps by" in n)
    assert "13.68 mm in line 3602 (7.2 s)" in line
    found = fit_friction(log.trials, rig).by_name()
    for name, true in TRUE.items():
        low, high = found[name].interval
        assert low <= true <= high
