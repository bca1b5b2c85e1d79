"""Campaign files: what is fitted and what is held out never mix."""

from __future__ import annotations

from pathlib import Path

import pytest

from sysid.campaign import MOTION_KINDS, read_campaign
from sysid.errors import InputError

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
    assert set(first.mapping) == {"time_s"}
    assert set(second.mapping) == {"time_s", "theta_rad"}
    assert campaign.select(MOTION_KINDS, "fit") == ()
    assert campaign.select(MOTION_KINDS, None) == (second,)


def test_the_same_file_under_another_name_is_not_both(campaign_file: Path) -> None:
    (campaign_file.parent / "c.csv").symlink_to("a.csv")
    text = TEXT.replace('"b.csv"', '"c.csv"')
    campaign_file.write_text(text)
    with pytest.raises(InputError, match="both fit and holdout"):
        read_campaign(campaign_file)


def test_samples(shared_samples: Path) -> None:
    campaign = read_campaign(shared_samples / "rig-1" / "campaign.toml")
    assert len(campaign.logs) == 12
    assert [e.use for e in campaign.logs].count("holdout") == 3
    assert len(campaign.read(campaign.logs[0]).trials) == 18
