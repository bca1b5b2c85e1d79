"""The page of the measured sets, of canned results."""

from __future__ import annotations

import re
from html.parser import HTMLParser

from measured_samples import campaign, canned, diagnosis, effect

from datasets.measured.figures import scaled, shown_in, title_of
from datasets.measured.findings import remains_text
from datasets.measured.page import render_page


class Parsed(HTMLParser):
    """Tags that stay open, ids, and the text outside scripts and styles."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "link", "br"):
            self.open.append(tag)
        named = dict(attrs)
        self.ids += [named["id"] or ""] if "id" in named else []
        self.links += [named["href"] or ""] if tag == "a" else []

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.ids += [dict(attrs)["id"] or ""] if "id" in dict(attrs) else []

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += "" if "style" in self.open else data


def test_the_page_holds_what_was_found() -> None:
    curve = {
        "channel": "motor_force_n",
        "regressor": "velocity",
        "unit": "N",  # of the channel, as the diagnosis writes it
        "centres": [-0.1, 0.0, 0.1],
        "before": [-3.0, None, 3.0],
        "after": [-0.1, 0.0, 0.1],
    }
    found = {**diagnosis(effect("stribeck-friction")), "curves": [curve]}
    repeats = [
        campaign("repeat_1.toml", diagnosis(effect("stribeck-friction")), "campaign.toml"),
        campaign("repeat_2.toml", None, "campaign.toml"),
    ]
    page = render_page(canned(campaign("campaign.toml", found), *repeats))
    parsed = Parsed(page)
    assert parsed.open == [] and len(set(parsed.ids)) == len(parsed.ids)
    assert all(link[1:] in parsed.ids for link in parsed.links)
    for said in (
        "question of axis",
        "source of axis",
        "licence of axis",
        "stribeck_force_n",
        "13.40 to 15.00",
        "75 %",
        "stribeck-friction, is named by 1 of 2 repeats",
        "1 gave no verdict",
        "or in the campaign's, counts as the same",
    ):
        assert said in parsed.text, said
    assert page.count("<svg ") == 2
    assert "Velocity (mm/s)" in page and "Mean residual (N)" in page
    assert not re.search(r"<script|(?:src|href)=\"https?:", page)


def test_the_page_escapes_what_files_say() -> None:
    wicked = "<script>alert(1)</script>"
    results = canned(campaign("campaign.toml", diagnosis(effect(f"x{wicked}"))))
    results["sets"][0] |= {"title": wicked, "question": wicked, "notices": [wicked]}
    results["sets"].append({"name": wicked, "title": "", "problem": wicked, "campaigns": []})
    page = render_page(results)
    assert "<script" not in page and page.count("&lt;script&gt;") >= 5


def test_channels_are_named_in_words() -> None:
    """By the names, and in the units, that reports have."""
    assert title_of("motor_force_n") == "force"
    assert title_of("velocity_rad_per_s") == "speed" and title_of("pressure_a_pa") == "pressure A"
    assert title_of("log_time_to_pressure") == "logarithm of the time"
    assert shown_in("motor_torque_nm", [0.05]) == ("mN·m", 1e3)
    assert shown_in("pressure_a_pa", [151.0]) == ("Pa", 1.0)
    assert shown_in("motor_force_n", [0.05, -0.1]) == ("mN", 1e3)
    assert shown_in("log_time_filling", [0.2]) == ("", 1.0)
    left = {"channel": "motor_force_n", "regressor": "angle times direction", "share": 0.59}
    said = remains_text({"unexplained": [left]})
    assert said == "force over position times direction (59 %)"
    assert scaled("Pa", [250.0, 1300.0]) == ("kPa", 1e-3)
    assert scaled("Nm", [1300.0]) == ("Nm", 1.0)
