"""Campaign files: what is fitted and what is held out never mix."""

from __future__ import annotations

import hashlib
import re
import tomllib
from pathlib import Path

import jsonschema
import pytest

from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io.campaign import (
    BENCH_KINDS,
    FRICTION_KINDS,
    KINDS,
    MOTION_KINDS,
    USES,
    CampaignFile,
    LogEntry,
    read_campaign,
)

TEXT = """\
rig = "rig.toml"

[map]
time_s = "t:ms"

[[log]]
kind = "friction-static"
file = "a.csv"

[[log]]
kind = "motion-motor"
file = "b.csv"
use = "holdout"
map = { theta_rad = "angle:deg" }
"""


@pytest.fixture
def campaign_file(tmp_path: Path, rig_text: str) -> Path:
    (tmp_path / "rig.toml").write_text(rig_text)
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("time_s\n0\n")
    path = tmp_path / "campaign.toml"
    path.write_text(TEXT)
    return path


def test_defaults_paths_and_maps(campaign_file: Path) -> None:
    campaign = read_campaign(campaign_file)
    first, second = campaign.logs
    assert (first.use, second.use) == ("fit", "holdout")
    assert first.path == campaign_file.parent / "a.csv"
    assert (set(first.shared), set(first.mapping)) == ({"time_s"}, set())
    assert (set(second.shared), set(second.mapping)) == ({"time_s"}, {"theta_rad"})
    assert campaign.select(MOTION_KINDS, "fit") == ()
    assert campaign.select(MOTION_KINDS, None) == (second,)


def test_a_shared_map_serves_the_logs_that_have_its_columns(campaign_file: Path) -> None:
    """A log's own map names columns that it must have."""
    folder = campaign_file.parent
    (folder / "a.csv").write_text("t,M\n0,0.1\n1,0.2\n2,0.3\n")
    (folder / "b.csv").write_text("t,angle\n0,1\n1,2\n2,3\n")
    shared = '[map]\ntime_s = "t:ms"\nmotor_torque_nm = "M:Nm"\n'
    campaign_file.write_text(TEXT.replace('[map]\ntime_s = "t:ms"\n', shared))
    campaign = read_campaign(campaign_file)
    first, second = (campaign.read(entry).trials[0] for entry in campaign.logs)
    assert set(first.channels) == {"motor_torque_nm"} and set(second.channels) == {"theta_rad"}
    (folder / "b.csv").write_text("t,M\n0,1\n1,2\n2,3\n")
    with pytest.raises(InputError, match="has no column 'angle'"):
        campaign.read(campaign.logs[1])


def test_every_log_is_a_source_with_its_use(campaign_file: Path) -> None:
    sources = read_campaign(campaign_file).sources()
    assert [(s.file, s.use, s.kind) for s in sources] == [
        ("a.csv", "fit", "friction-static"),
        ("b.csv", "holdout", "motion-motor"),
    ]
    content = (campaign_file.parent / "a.csv").read_bytes()
    assert sources[0].sha256 == hashlib.sha256(content).hexdigest()


def test_the_same_file_under_another_name_is_not_both(campaign_file: Path) -> None:
    (campaign_file.parent / "c.csv").symlink_to("a.csv")
    text = TEXT.replace('"b.csv"', '"c.csv"')
    campaign_file.write_text(text)
    with pytest.raises(InputError, match="both fit and holdout"):
        read_campaign(campaign_file)


def test_no_log_counts_twice(campaign_file: Path) -> None:
    campaign_file.write_text(TEXT + '[[log]]\nkind = "friction-static"\nfile = "a.csv"\n')
    with pytest.raises(InputError, match=r"a\.csv is given twice as friction-static"):
        read_campaign(campaign_file)


@pytest.mark.parametrize("name", ["a.csv", "rig.toml"])
def test_a_file_without_a_name_is_missing(campaign_file: Path, name: str) -> None:
    campaign_file.write_text(TEXT.replace(f'"{name}"', '""'))
    with pytest.raises(InputError, match=r"campaign\.toml.*is missing"):
        read_campaign(campaign_file)


def test_samples(shared_samples: Path) -> None:
    campaign = read_campaign(shared_samples / "rig-1" / "campaign.toml")
    assert len(campaign.logs) == 12
    assert [e.use for e in campaign.logs].count("holdout") == 3
    assert len(campaign.read(campaign.logs[0]).trials) == 18


def test_kinds_and_uses_of_the_schema_are_those_that_are_read(campaign_file: Path) -> None:
    keys = LogEntry.model_json_schema()["properties"]
    assert keys["kind"]["enum"] == list(KINDS) and keys["use"]["enum"] == list(USES)
    assert {*FRICTION_KINDS, *MOTION_KINDS, *BENCH_KINDS} < set(KINDS)
    for kind in keys["kind"]["enum"]:
        campaign_file.write_text(TEXT.replace("friction-static", kind))
        assert read_campaign(campaign_file).logs[0].kind == kind
    campaign_file.write_text(TEXT.replace("friction-static", "friction"))
    with pytest.raises(InputError, match="kind = 'friction'; write one of friction-static, "):
        read_campaign(campaign_file)


def test_a_campaign_file_fits_the_schema_and_every_key_is_described(shared_samples: Path) -> None:
    schema = CampaignFile.model_json_schema()
    for properties in (schema["properties"], schema["$defs"]["LogEntry"]["properties"]):
        assert all(key["description"].endswith(".") for key in properties.values())
    jsonschema.validate(tomllib.loads(TEXT), schema)
    path = shared_samples / "rig-1" / "campaign.toml"
    jsonschema.validate(tomllib.loads(path.read_text("utf-8")), schema)
    with pytest.raises(jsonschema.ValidationError, match="holdout"):
        jsonschema.validate(tomllib.loads(TEXT.replace("holdout", "held")), schema)


# --- the template --------------------------------------------------------------------------


@pytest.mark.parametrize("whole", [False, True])
def test_the_template_is_read_back(whole: bool, tmp_path: Path, rig_text: str) -> None:
    """As written, and with what is commented out."""
    path = tmp_path / "campaign.toml"
    assert main(["init", str(path)]) == 0
    if whole:
        text = re.sub(r"^# (?=\[\[|\w+ = )", "", path.read_text(), flags=re.MULTILINE)
        path.write_text(text)
    (tmp_path / "rig.toml").write_text(rig_text)
    for entry in tomllib.loads(path.read_text())["log"]:
        (tmp_path / entry["file"]).write_text(entry["file"])
    campaign = read_campaign(path)
    assert not campaign.notices
    assert {e.kind for e in campaign.logs} == (
        set(KINDS) if whole else {*KINDS[:2], *KINDS[3:5], *MOTION_KINDS}
    )
    assert {e.valve for e in campaign.logs} == {"a", "b", None}
    assert {e.kind for e in campaign.logs if e.use == "holdout"} == set(MOTION_KINDS)
    assert all(bool(e.shared) == whole for e in campaign.logs)


def test_which_template_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "arm.toml"
    assert main(["init", str(path), "--kind", "campaign"]) == 0
    assert "[[log]]" in path.read_text() and "name your logs" in capsys.readouterr().out
    assert main(["init", str(path), "--kind", "campaign"]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["init", str(path), "--kind", "campaign", "--force", "--linear"]) == 2
    assert "--linear is for a rig file" in capsys.readouterr().err
    assert main(["init", str(tmp_path / "campaign.toml"), "--kind", "rig"]) == 0
    assert "[cylinder]" in (tmp_path / "campaign.toml").read_text()


@pytest.mark.parametrize(
    ("words", "what", "fix"),
    [
        (["fit", "a.csv", "-o", "b.json"], "a.csv: is a log, not a campaign file", "fit friction"),
        (["check", "rig.toml"], "rig.toml: is a rig file, not a campaign", "sysid init"),
        (["fit", "friction", "c.toml", "-o", "b.json"], "c.toml: is a TOML file", "fit CAMPAIGN"),
    ],
)
def test_a_file_of_another_kind_is_named(
    words: list[str],
    what: str,
    fix: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("time_s,theta_rad\n0,0\n0.1,0\n")
    Path("c.toml").write_text('rig = "rig.toml"\n')
    Path("rig.toml").write_text('[rig]\nname = "r"\norientation = "horizontal"\n')
    assert main(words) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert what in line and fix in line
