"""What a library function is about is an object: a path in its place is said, with where one is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from export_bundles import as_bundle, whole_content

import sysid as si

FILE: Any = "it.json"
BUNDLED = Path(__file__).resolve().parent.parent / "datasets" / "bundled"


@pytest.mark.parametrize(
    ("request_one", "said"),
    [
        (lambda c, b: si.fit(FILE), "campaign: str is no campaign; si.read_campaign reads"),
        (lambda c, b: si.diagnose(FILE, b), "campaign: str is no campaign"),
        (lambda c, b: si.diagnose(c, FILE), "bundle: str is no bundle; si.fit finds one"),
        (lambda c, b: si.refine(b, c), "campaign: Bundle is no campaign"),
        (lambda c, b: si.validate(c, Path(FILE)), "bundle: PosixPath is no bundle"),
        (lambda c, b: si.advise(c, FILE), "bundle: str is no bundle"),
        (lambda c, b: si.control(FILE, "pva"), "bundle: str is no bundle"),
        (lambda c, b: si.export(FILE, "out"), "bundle: str is no bundle"),
        (lambda c, b: si.compare(b, FILE), "bundles: str is no bundle"),
        (lambda c, b: si.write_bundle(FILE, b), "bundle: str is no bundle"),
        (lambda c, b: si.report("out.html", FILE, b), "campaign: str is no campaign"),
        (
            lambda c, b: si.report("out.html", c, FILE),
            "found: str is no diagnosis or bundle",
        ),
        (lambda c, b: si.simulate(_log(c), FILE), "model: str is no model or bundle"),
        (lambda c, b: si.monitor(_log(c), FILE), "bundle: str is no bundle"),
        (lambda c, b: si.fit_friction(_log(c), rig=FILE), "rig: str is no rig; si.read_rig reads"),
    ],
)
def test_a_path_in_place_of_what_it_holds_is_said(
    request_one: Callable[[Any, Any], Any], said: str, rig_text: str
) -> None:
    campaign = si.read_campaign(BUNDLED / "campaign.toml")
    with pytest.raises(si.InputError, match=said):
        request_one(campaign, as_bundle(whole_content(rig_text)))


def _log(campaign: si.Campaign) -> si.Log:
    return si.read_log(BUNDLED / "motion_motor_2.csv", campaign.rig)
