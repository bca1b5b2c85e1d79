"""Half a count of a held piston's position in the intervals of every flow of its chamber."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_valve_discrete import DELAYS, FLOWS, VALVE_A, Bench, changed, make_rig, random_valve

from datasets.generator.campaign import SMALL, make_campaign
from sysid.estimation.covariance import JointCovariance
from sysid.estimation.linear import Estimate
from sysid.identification.held_volume import VolumeError, position_count
from sysid.io.logs import Trial
from sysid.io.rig import Rig, rig_from_content
from sysid.valve_discrete import DiscreteFit, fit_valve_discrete
from sysid.valve_pwm import fit_valve_pwm

COUNT = 2.0 * np.pi / 500.0
SHORT = Bench(on=0.3, off=1.6, end=2.8)


def counting(rig_text: str, counts: int | None) -> Rig:
    line = "encoder_counts_per_rev = 80000\n"
    assert line in rig_text
    return make_rig(rig_text.replace(line, f"encoder_counts_per_rev = {counts}\n" * bool(counts)))


def fit_of(trials: list[Trial], rig: Rig) -> DiscreteFit:
    return fit_valve_discrete(trials, rig, find_ratio=False).valves["a"]


def held_at(trial: Trial, off: float) -> Trial:
    """The test with its position logged wrong by so many counts of 500."""
    return changed(trial, theta_rad=trial["theta_rad"] + off * COUNT)


@pytest.mark.parametrize("std, reach, dof", [(1, 1, np.inf), (1, 8, np.inf), (1, 2, 4), (0, 1, 9)])
def test_interval_of_a_sum_with_a_uniform_error(std: float, reach: float, dof: float) -> None:
    rng = np.random.default_rng(1)
    plain = Estimate.symmetric(3.0, std, "-", dof)
    found = plain.with_uniform_error(reach)
    noise = rng.standard_normal(400_000) if np.isinf(dof) else rng.standard_t(dof, 400_000)
    error = std * noise + rng.uniform(-reach, reach, 400_000)
    assert found.value == 3.0 and found.std == pytest.approx(np.hypot(std, reach / np.sqrt(3.0)))
    assert np.mean(np.abs(error) <= found.interval[1] - 3.0) == pytest.approx(0.95, abs=0.002)
    assert found.interval[0] == pytest.approx(6.0 - found.interval[1])
    assert found.interval[1] - 3.0 <= plain.interval[1] - 3.0 + reach


def test_a_small_uniform_error_changes_nothing() -> None:
    plain = Estimate.symmetric(3.0, 1.0, "-", 5.0)
    found = plain.with_uniform_error(1e-3)
    assert found.interval == pytest.approx(plain.interval, rel=1e-6)
    assert plain.with_uniform_error(0.0) is plain
    nothing = Estimate.unidentified("-", "no test")
    assert nothing.with_uniform_error(1.0) is nothing


def test_intervals_at_500_counts_hold(rig_text: str) -> None:
    """Off by up to half a count: 0.17 % of the volume, several times the noise's share."""
    rng = np.random.default_rng(5)
    rig, held, missed = counting(rig_text, 500), [], []
    for seed, off in enumerate(np.linspace(-0.45, 0.45, 5)):
        valve = random_valve(rng, VALVE_A)
        bench = dataclasses.replace(SHORT, valve=valve)
        fit = fit_of([held_at(t, off) for t in bench.trials(seed, 2)], rig)
        held += [fit[name].holds(getattr(valve, name)) for name in FLOWS]
        errors = [abs(fit[n].value / getattr(valve, n) - 1.0) for n in FLOWS]
        missed.append(max(errors))
    assert np.mean(held) >= 0.9, held
    assert max(missed) > 0.001  # which the noise alone does not explain


def test_the_error_is_common_to_the_flows_and_in_nothing_else(rig_text: str) -> None:
    trials = SHORT.trials(1, 3)
    coarse, fine = (fit_of(trials, counting(rig_text, n)) for n in (500, 80000))
    exact = fit_of(trials, counting(rig_text, None))
    share = 0.5 * COUNT * 0.0375 / (0.075 + 0.127 / 2.0) / np.sqrt(3.0)
    for name in FLOWS:
        added = np.sqrt(coarse[name].std ** 2 - exact[name].std ** 2) / exact[name].value
        assert added == pytest.approx(share, rel=0.01)
        assert fine[name].std == pytest.approx(exact[name].std, rel=0.01)
    for name in (*DELAYS, "jump_fill_percent", "jump_dis_percent"):
        assert coarse[name] == exact[name]
    assert coarse.joint is not None and exact.joint is not None
    names, matrix = coarse.joint.correlation(FLOWS)
    _, before = exact.joint.correlation(FLOWS)
    assert np.all(matrix >= before - 1e-12)
    i, k = names.index("c_fill"), names.index("c_dis")
    assert matrix[i, k] > 0.9 > before[i, k]


def test_a_count_that_the_logs_show(rig_text: str) -> None:
    """None is declared, but another test of the log moves by single counts."""
    rig = counting(rig_text, None)
    trials = SHORT.trials(2, 1)
    assert position_count(trials, rig) == 0.0
    steps = COUNT * np.round(np.linspace(0.0, 40.0, len(trials[0])))
    moved = changed(trials[0], theta_rad=steps)
    assert position_count([*trials, moved], rig) == pytest.approx(COUNT)
    assert position_count([*trials, moved], counting(rig_text, 2000)) == pytest.approx(COUNT / 4)


def test_tests_that_were_held_at_several_positions(rig_text: str) -> None:
    rig = counting(rig_text, 500)
    per_count = rig.require("cylinder", "").area_a_m2 * 0.0375 * COUNT
    one, two, each = (
        VolumeError.of([(160 + p) * per_count for p in places], "a", rig, COUNT)
        for places in ([0, 0, 0, 0], [0, 0, 2, 2], [0, 1, 2, 3])
    )
    assert two.variance == pytest.approx(one.variance / 2.0, rel=0.02)
    assert each.variance == pytest.approx(one.variance / 4.0, rel=0.03)
    flow = Estimate.symmetric(1.0, 1e-6, "kg/s", np.inf)
    # What the scatter of the tests shows already is not counted twice.
    assert each.in_estimate(flow, shows_scatter=True).std < 0.01 * one.in_estimate(flow).std
    assert one.in_estimate(flow, shows_scatter=True) == one.in_estimate(flow)
    none = VolumeError.of([1.0], "a", rig, 0.0)
    assert none.in_estimate(flow) is flow and none.variance == 0.0
    joint = JointCovariance(("c_fill", "delay"), np.eye(2))
    assert np.array_equal(none.in_joint(joint, {"c_fill": 2.0}).matrix, np.eye(2))
    expected = np.diag([1.0 + 4.0 * one.variance, 1.0])
    assert one.in_joint(joint, {"c_fill": 2.0}).matrix == pytest.approx(expected)


def test_flows_of_the_averaged_law() -> None:
    size = dataclasses.replace(SMALL, duty_step=0.12)
    made = make_campaign(6, size=size, stems=("valve_pwm_a",))
    trials = [
        Trial(t.label, t.columns["time_s"], {**t.columns}, f"made, test {t.label}")
        for t in made.logs[0].tests
    ]
    content = made.rig.content
    coarse = {**content, "sensors": {**content["sensors"], "encoder_counts_per_rev": 500}}
    wide, fine = (
        fit_valve_pwm(trials, rig_from_content(c, "generated")).averaged["a"].estimates
        for c in (coarse, content)
    )
    for name in FLOWS:
        assert (
            0.0005 < np.sqrt(wide[name].std ** 2 - fine[name].std ** 2) / fine[name].value < 0.002
        )
    assert wide["delay_difference_s"] == fine["delay_difference_s"]
