"""The choice of a PWM frequency from constant-duty logs at several (thesis 3.7.2)."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import sysid as si
from benchmarks.pwm_frequency import at_period, true_range
from benchmarks.valves import trial
from datasets.generator.rigs import reference_rig, rig_toml
from datasets.generator.valve_tests import pwm_test
from sysid.commands.app import main
from sysid.errors import InputError, NotIdentifiedError
from sysid.identification.valve_pwm.frequency import (
    DutyResponse,
    LinearRange,
    choose_frequency,
    linear_range,
)
from sysid.io.logs import Trial
from sysid.io.rig import Rig, rig_from_content
from sysid.pipeline.fit import FitOptions, fit_campaign
from sysid.pipeline.pwm_frequency import campaign_section, campaign_tests, period_of

HERTZ = (200.0, 250.0, 300.0)
DUTIES = (0.0001, 0.0501, 0.2001, 0.4001, 0.6001, 0.7501, 0.8501, 0.9001, 0.9501)


@cache
def logged() -> tuple[tuple[float, str, tuple[Trial, ...]], ...]:
    """Filling tests of the thesis' valve A at each frequency."""
    rng = np.random.default_rng(372)
    found = []
    for hertz in HERTZ:
        rig = at_period(reference_rig(), 1.0 / hertz)
        tests = (
            trial(pwm_test(rig, str(i + 1), "a", duty, True, 150.0, rng))
            for i, duty in enumerate(DUTIES)
        )
        found.append((1.0 / hertz, f"log{hertz:.0f}.csv", tuple(tests)))
    return tuple(found)


def rig() -> Rig:
    return rig_from_content(reference_rig().content, "rig.toml")


def test_the_thesis_choice_with_why() -> None:
    found = choose_frequency(logged(), rig())
    assert found.chosen_s == pytest.approx(0.005)
    assert "linear over the widest range" in found.why and "300 Hz" in found.why
    for response in found.responses:
        low, high = true_range(reference_rig(), response.period_s)
        assert response.linear.first == pytest.approx(max(low, DUTIES[0]), abs=0.005)
        assert response.linear.last == pytest.approx(high, abs=0.008)
        assert response.unevenness < 0.01
    assert found.responses[-1].overlapping[-1] == pytest.approx((0.9001, 0.9501))
    assert [record["is_chosen"] for record in found.records()] == [True, False, False]


def test_a_least_range_asks_for_the_highest_frequency_that_has_it() -> None:
    assert choose_frequency(logged(), rig(), least_range=0.9).chosen_s == pytest.approx(1 / 300)
    with pytest.raises(NotIdentifiedError, match=r"no frequency has a linear range of 0\.99"):
        choose_frequency(logged(), rig(), least_range=0.99)


def test_one_frequency_is_no_choice() -> None:
    with pytest.raises(InputError, match="all logs have one PWM period"):
        choose_frequency(logged()[:1], rig())


@pytest.mark.parametrize("ends", [(0.12, 0.81), (0.03, 0.93), (0.0, 0.7)])
def test_the_line_with_two_ends(ends: tuple[float, float]) -> None:
    rng = np.random.default_rng(5)
    duty = np.linspace(0.0, 1.0, 21)
    held, errors = [], []
    for _ in range(25):
        true = np.clip((duty - ends[0]) / (ends[1] - ends[0]), 0.0, 1.0)
        found = linear_range(duty, true + 0.004 * rng.standard_normal(21))
        errors.append(found.width - (ends[1] - ends[0]))
        held.append(abs(errors[-1]) < 2.1 * found.std)
    assert abs(np.median(errors)) < 0.004
    assert np.mean(held) > 0.8


def test_overlapping_duties() -> None:
    duty = np.linspace(0.0, 1.0, 11)
    opening = np.clip(duty / 0.77, 0.0, 1.0)
    one = DutyResponse("a", 0.005, "log", duty, opening, 0.001, LinearRange(0.0, 0.77, 0.001))
    assert [pair[0] for pair in one.overlapping] == pytest.approx([0.8, 0.9])
    assert replace(one, opening=duty, linear=LinearRange(0.0, 1.0, 0.0)).overlapping == []


def written(folder: Path, *which: int) -> list[str]:
    """The logs of these frequencies as files, and their rig file; their paths."""
    (folder / "rig.toml").write_text(rig_toml(reference_rig().content), "utf-8")
    paths = []
    for _, name, trials in (logged()[i] for i in which):
        columns = ["time_s", "test", *trials[0].channels]
        rows = [
            np.column_stack([t.time, np.full(len(t), int(t.label)), *t.channels.values()])
            for t in trials
        ]
        path = folder / name
        head = ",".join(columns)
        np.savetxt(path, np.concatenate(rows), "%.9g", ",", header=head, comments="")
        paths.append(str(path))
    return paths


def test_the_command_its_page_and_its_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = written(tmp_path, 0, 2)
    page, asked = tmp_path / "page.html", ["pwm-frequency", *paths, "--hz", "200"]
    assert main([*asked, "--hz", "300", "--json", "--report", str(page)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["frequency_hz"] == pytest.approx(200.0)
    assert [round(one["frequency_hz"]) for one in found["frequencies"]] == [200, 300]
    assert "opening over duty" in page.read_text("utf-8")
    assert main(asked) == 2
    assert "1 frequencies for 2 logs" in capsys.readouterr().err
    quiet = replace(logged()[0][2][0], channels={}, source="quiet.csv")
    with pytest.raises(InputError, match=r"no ripple of pulses.*--hz"):
        period_of([quiet], Path("quiet.csv"))


def test_a_campaign_with_logs_at_several(tmp_path: Path) -> None:
    names = [Path(path).name for path in written(tmp_path, 0, 1)]
    log = '[[log]]\nkind = "valve-pwm"\nfile = "{}"\n'
    lines = [
        'rig = "rig.toml"',
        log.format(names[0]),
        f"{log.format(names[1])}pwm_period_s = 0.004",
    ]
    path = tmp_path / "campaign.toml"
    path.write_text("\n".join(lines), "utf-8")
    campaign = si.read_campaign(path)
    found = si.pwm_frequency(campaign)
    assert [r.frequency_hz for r in found.responses] == pytest.approx([200.0, 250.0])
    assert found.chosen_s == pytest.approx(0.005)
    section = campaign_section(campaign_tests(campaign), campaign.rig)
    assert section is not None and "200 Hz" in str(section.blocks[0])
    # The surface is that of the rig file's period.
    fitted = fit_campaign(campaign, FitOptions(surface="bipolynomial"))
    assert any("log250.csv: its pulses have another" in line for line in fitted.notices)
    fill = fitted.bundle.valve("a").surfaces("fill")
    assert fill is not None and fill.n_tests == len(DUTIES)
