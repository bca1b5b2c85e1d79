"""What a log cannot be trusted in (`sysid.io.trust`): jumps, repeats, wraps, slow rows."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from sysid.errors import NotIdentifiedError
from sysid.friction import FrictionResult, fit_friction
from sysid.io.bare_rig import read_bare_logs
from sysid.io.logs import Log, read_log
from sysid.io.rig import Rig, Sensors
from sysid.io.trust.jumps import Resolution, over_two_steps, without_jumps
from sysid.types import FloatArray

MASS, COULOMB, VISCOUS = 2.0, 8.0, 25.0
COUNT = 2e-5


def axis_frame(period: float = 1e-3, length_s: float = 12.0, count: float = COUNT) -> pd.DataFrame:
    """A linear axis driven to two sines of speed."""
    rng = np.random.default_rng(1)
    t = period * np.arange(round(length_s / period))
    w1, w2 = 2.0 * np.pi * 0.4, 2.0 * np.pi * 1.1
    v = 0.25 * np.sin(w1 * t) + 0.1 * np.sin(w2 * t + 0.3)
    a = 0.25 * w1 * np.cos(w1 * t) + 0.1 * w2 * np.cos(w2 * t + 0.3)
    x = -0.25 / w1 * np.cos(w1 * t) - 0.1 / w2 * np.cos(w2 * t + 0.3)
    f = MASS * a + COULOMB * np.tanh(v / 1e-3) + VISCOUS * v + 0.3 * rng.standard_normal(len(t))
    counts = np.round(x / count)
    return pd.DataFrame({"time_s": t, "position_m": count * counts, "motor_force_n": f})


def bare(frame: pd.DataFrame, folder: Path) -> tuple[Log, FrictionResult]:
    path = folder / "log.csv"
    frame.to_csv(path, index=False)
    logs = read_bare_logs([path], {})
    return logs.logs[0], fit_friction(logs.logs[0].trials, logs.rig)


def jumped(frame: pd.DataFrame, row: int, size: float) -> pd.DataFrame:
    return frame.assign(position_m=frame["position_m"] + size * (np.arange(len(frame)) >= row))


def stale(values: FloatArray, strides: list[int]) -> FloatArray:
    """Readings that come every `strides` rows in turn."""
    fresh = np.cumsum(np.resize(strides, len(values)))
    held = np.searchsorted(fresh, np.arange(len(values)), side="right")
    return values[np.concatenate([[0], fresh])[held].clip(0, len(values) - 1)]


def is_near(result: FrictionResult) -> None:
    """The axis' parameters, within 3 standard errors and some percent."""
    found = result.by_name()
    for name, true in (
        ("coulomb_n", COULOMB),
        ("viscous_n_s_per_m", VISCOUS),
        ("mass_kg", MASS),
    ):
        assert abs(found[name].value - true) < 3.0 * found[name].std + 0.005 * true
        assert found[name].std < 0.02 * true


# --- jumps ------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [0.0137, -0.0137, 20 * COUNT, -0.2])
def test_a_jump_is_named_and_the_log_joined_on(size: float, tmp_path: Path) -> None:
    frame = axis_frame()
    log, result = bare(jumped(frame, 5000, size), tmp_path)
    (line,) = (n for n in log.notices if "jumps by" in n)
    assert "line 5002 (5 s)" in line
    assert "index pulse or lost counts" in line
    joined = log.trials[0]["position_m"] - frame["position_m"]
    assert np.ptp(joined) < 2.1 * COUNT
    is_near(result)


def test_several_jumps_in_several_tests_are_one_notice(tmp_path: Path) -> None:
    one = axis_frame(length_s=4.0)
    frames = [
        jumped(jumped(one, 800, 0.003), 2500, -0.02).assign(test=1),
        one.assign(test=2),
        jumped(one, 1500, 0.05).assign(test=3),
    ]
    log, _ = bare(pd.concat(frames), tmp_path)
    (line,) = (n for n in log.notices if "jumps by" in n)
    assert "test 1, 0.8 s" in line
    assert "test 1, 2.5 s" in line
    assert "test 3, 1.5 s" in line
    assert "test 2" not in line


@pytest.mark.parametrize("rows", [1, 2, 3, 8])
def test_a_position_that_jumps_there_and_back(rows: int, tmp_path: Path) -> None:
    """A misread sample or a few, inside the range of the motion."""
    frame = axis_frame()
    log, result = bare(jumped(jumped(frame, 5000, 0.02), 5000 + rows, -0.02), tmp_path)
    (line,) = (n for n in log.notices if "jumps by" in n)
    assert f"line {5000 + 2} " in line and f"line {5000 + rows + 2} " in line
    assert np.ptp(log.trials[0]["position_m"] - frame["position_m"]) < 2.1 * COUNT
    is_near(result)


def test_a_shaft_at_rest_jumps_by_counts_of_a_declared_encoder() -> None:
    time, held = 1e-3 * np.arange(4000.0), np.full(4000, 0.3)
    held[1700:] += 12 * 7.85e-5
    joined, (jump,) = without_jumps(time, held, Resolution(7.85e-5, False))
    assert jump.row == 1700
    assert jump.usual_speed == 0.0
    assert np.ptp(joined) < 1e-12


@pytest.mark.parametrize("period", [0.0005, 0.002, 0.01])
def test_an_impact_is_no_jump(period: float) -> None:
    """A speed that turns round within a sample, at every bounce."""
    t = period * np.arange(round(4.0 / period))
    bounces = 0.1 * np.abs(np.mod(3.0 * t, 2.0) - 1.0)
    position = COUNT * np.round(bounces / COUNT)
    assert without_jumps(t, position, Resolution(COUNT, True))[1] == []


@pytest.mark.parametrize("period", [0.001, 0.005, 0.05])
@pytest.mark.parametrize("count", [1e-6, 1e-4])
def test_stick_slip_is_no_jump(period: float, count: float) -> None:
    """Slips of 10 ms once in 0.2 s, resolved or not."""
    t = period * np.arange(round(8.0 / period))
    done = np.floor(t / 0.2 + 1e-9)
    phase = np.clip((t - 0.2 * done) / 0.01, 0.0, 1.0)
    slips = 0.002 * (done + 0.5 - 0.5 * np.cos(np.pi * phase))
    position = count * np.round(slips / count)
    assert without_jumps(t, position, Resolution(count, True))[1] == []
    assert over_two_steps(t, position, Resolution(count, True)) == []


def test_a_held_position_is_not_searched_for_jumps(monkeypatch: pytest.MonkeyPatch) -> None:
    """As every test of a valve is: hundreds in a log."""
    monkeypatch.setattr("sysid.io.trust.jumps._around", None)
    t, position = 1e-3 * np.arange(500), np.full(500, 0.3)
    assert without_jumps(t, position, Resolution(COUNT, True))[1] == []
    assert over_two_steps(t, position, Resolution(COUNT, True)) == []


@pytest.mark.parametrize("first", [0.5, 0.2])
def test_a_jump_over_two_rows_is_named_and_nothing_is_changed(first: float, tmp_path: Path) -> None:
    frame = jumped(jumped(axis_frame(), 5000, first * 0.0137), 5001, (1 - first) * 0.0137)
    log, _ = bare(frame, tmp_path)
    (line,) = (n for n in log.notices if "jumps by" in n)
    assert "in line 5002 (5 s)" in line and "nothing is changed" in line
    size = float(line.split("jumps by ")[1].split()[0])
    assert size == pytest.approx(13.7, abs=4e3 * COUNT)
    assert np.ptp(log.trials[0]["position_m"] - frame["position_m"]) < 1e-9


def test_a_clock_that_jitters_or_loses_rows_is_no_jump() -> None:
    rng = np.random.default_rng(3)
    frame = axis_frame()
    t, x = frame["time_s"].to_numpy(), frame["position_m"].to_numpy()
    true = t + 2e-4 * rng.standard_normal(len(t))
    jittered = COUNT * np.round(np.interp(true, t, x) / COUNT)
    assert without_jumps(t, jittered, Resolution(COUNT, True))[1] == []
    kept = rng.random(len(t)) > 0.01
    assert without_jumps(t[kept], x[kept], Resolution(COUNT, True))[1] == []


# --- readings that repeat ---------------------------------------------------------------------


@pytest.mark.parametrize(("strides", "share"), [([10], "90%"), ([4, 5], "78%"), ([2, 3], "60%")])
def test_a_slow_position_is_taken_at_its_fresh_readings(
    strides: list[int], share: str, tmp_path: Path
) -> None:
    frame = axis_frame()
    held = frame.assign(position_m=stale(frame["position_m"].to_numpy(), strides))
    log, result = bare(held, tmp_path)
    (line,) = (n for n in log.notices if "repeats" in n)
    assert f"position_m repeats: {share} of its rows" in line
    (trial,) = log.trials
    assert trial.row_period == pytest.approx(1e-3 * np.mean(strides), rel=0.02)
    assert trial.stride_of("position_m") == math.ceil(np.mean(strides))
    assert trial.stride_of("motor_force_n") == 1
    late = trial["position_m"] - frame["position_m"][: len(trial)]
    assert np.max(np.abs(late)) < 3 * COUNT
    is_near(result)


def test_a_slow_position_that_jumps_is_both(tmp_path: Path) -> None:
    frame = jumped(axis_frame(), 6003, 0.01)
    held = frame.assign(position_m=stale(frame["position_m"].to_numpy(), [10]))
    log, result = bare(held, tmp_path)
    assert any("repeats" in n for n in log.notices)
    assert any("jumps by" in n for n in log.notices)
    is_near(result)


def test_a_coarse_encoder_a_held_command_and_a_rest_repeat_rightly(tmp_path: Path) -> None:
    frame = axis_frame(count=0.002)
    frame["motor_force_n"] = stale(frame["motor_force_n"].to_numpy(), [10])
    frame["pressure_a_pa"] = 1e5 + 26.0 * np.round(np.random.default_rng(2).normal(0, 0.3, 12000))
    log, _ = bare(frame, tmp_path)
    assert not any("repeats" in n for n in log.notices)
    assert log.trials[0].row_period is None


# --- counters that wrap -----------------------------------------------------------------------


@pytest.mark.parametrize("bits", [16, 32])
def test_a_counter_that_wraps_is_followed(bits: int, tmp_path: Path) -> None:
    frame = axis_frame(length_s=4.0)
    rig = Rig("axis", "horizontal", "linear", sensors=Sensors(encoder_counts_per_m=1.0 / COUNT))
    counts = np.round(frame["position_m"] / COUNT).to_numpy()
    wrapped = frame.drop(columns="position_m").assign(encoder_counts=np.mod(counts, 2.0**bits))
    wrapped.to_csv(tmp_path / "log.csv", index=False)
    log = read_log(tmp_path / "log.csv", rig)
    (line,) = (n for n in log.notices if "wraps around" in n)
    assert f"2^{bits} counts" in line
    assert not any("jumps by" in n for n in log.notices)
    np.testing.assert_allclose(log.trials[0]["position_m"], frame["position_m"], atol=1e-9)


def test_the_tests_of_a_counter_that_wraps_are_on_one_side(tmp_path: Path) -> None:
    """A test that lies beyond the wrap as a whole shows none of its own."""
    frame = axis_frame(length_s=4.0)
    rig = Rig("axis", "horizontal", "linear", sensors=Sensors(encoder_counts_per_m=1.0 / COUNT))
    below = frame.assign(position_m=frame["position_m"] - 0.2)
    parts = [frame.assign(test=1), below.assign(test=2)]
    both = pd.concat(parts)
    counts = np.mod(np.round(both["position_m"] / COUNT), 2.0**16)
    both.drop(columns="position_m").assign(encoder_counts=counts).to_csv(
        tmp_path / "log.csv", index=False
    )
    log = read_log(tmp_path / "log.csv", rig)
    for trial, part in zip(log.trials, parts, strict=True):
        np.testing.assert_allclose(trial["position_m"], part["position_m"], atol=1e-9)


@pytest.mark.parametrize(
    ("whole", "count", "name"),
    [
        (2**14 * 3e-6, 3e-6, "2^14 counts"),  # more wraps than jumps that are joined on
        (6000 * 1e-5, 1e-5, "0.06 m"),  # a lead of 60 mm
        (0.8, 1e-9, "0.8 m"),  # steps of so many counts that none shows the count
    ],
)
def test_a_counter_of_any_range_is_followed(
    whole: float, count: float, name: str, tmp_path: Path
) -> None:
    """From the range's end at the start, so that the first rows wrap."""
    frame = axis_frame(count=count)
    start = float(frame["position_m"].iloc[0])
    wrapped = np.mod(frame["position_m"] - start - 3.0 * count, whole)
    log, result = bare(frame.assign(position_m=wrapped), tmp_path)
    (line,) = (n for n in log.notices if "wraps around" in n)
    assert f"wraps around at {name} " in line
    assert not any("jumps" in n for n in log.notices)
    apart = log.trials[0]["position_m"] - frame["position_m"]
    assert np.ptp(apart) < 2e-3 * whole
    is_near(result)


@pytest.mark.parametrize("row", [1, 2, 3])
def test_a_jump_in_the_first_rows_is_joined_on(row: int, tmp_path: Path) -> None:
    """Of a counter that begins at its range's end and wraps once: friction had been 20 N."""
    frame = axis_frame(length_s=4.0)
    log, result = bare(jumped(frame, row, -3.1), tmp_path)
    (line,) = (n for n in log.notices if "position_m" in n)
    assert "jumps by -3100 mm" in line or "single samples far outside" in line
    assert np.ptp(log.trials[0]["position_m"] - frame["position_m"]) < 5.0 * COUNT
    is_near(result)


def test_a_fast_start_or_end_is_no_jump(tmp_path: Path) -> None:
    """A piston that runs to its end in the first rows and settles, a brake, a breakaway at the
    end, a rest of one count."""
    time = 1e-3 * np.arange(400)
    runs = np.where(time > 1e-3, 5000.0 + 40.0 * (1.0 - np.exp(-time / 5e-3)), 0.0)
    slowing = 2000.0 * (1.0 - np.exp(-time / 1e-3)) + 500.0 * np.sin(9.0 * time)
    breaking = 400.0 * np.maximum(0.0, time - time[-3]) ** 2 / 1e-6
    for counts in (runs, slowing, breaking, (time > 1e-3).astype(float)):
        position = COUNT * np.round(counts)
        frame = pd.DataFrame({"time_s": time, "position_m": position, "motor_force_n": 1.0})
        frame.to_csv(tmp_path / "log.csv", index=False)
        log = read_bare_logs([tmp_path / "log.csv"], {}).logs[0]
        assert not any("jumps" in n for n in log.notices), counts


def test_a_slip_from_end_to_end_is_no_wrap(tmp_path: Path) -> None:
    """A piston that rests at its ends, with noise, and is slower than a row in none of its ways."""
    rng = np.random.default_rng(3)
    time = 1e-2 * np.arange(1200)
    ends = np.where(time % 1.0 < 0.5, 0.0, 0.2)
    position = ends + 1e-5 * rng.standard_normal(len(time))
    frame = pd.DataFrame({"time_s": time, "position_m": position, "motor_force_n": 1.0})
    frame.to_csv(tmp_path / "log.csv", index=False)
    log = read_bare_logs([tmp_path / "log.csv"], {}).logs[0]
    assert not any("wraps" in n for n in log.notices)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_stop_that_a_motion_runs_into_is_no_jump(way: float, tmp_path: Path) -> None:
    """Two fast rows and a rest at the end of the travel: an impact, not lost counts."""
    steps = [-3, -3, -2, -1, 1, 2, 6, 8, 2, *[0] * 400]
    time = 1e-3 * np.arange(700)
    start = np.round(800.0 * np.sin(2.0 * np.pi * time / 0.6))[:291]
    counts = np.concatenate([start - start[-1], np.cumsum(steps)])
    counts = np.concatenate([counts, np.full(700 - len(counts), counts[-1])])
    counts = np.minimum(counts, counts[-1])
    frame = pd.DataFrame({"time_s": time, "position_m": way * 1e-5 * counts})
    frame = frame.assign(motor_force_n=1.0)

    def jumps(held: pd.DataFrame) -> list[str]:
        held.to_csv(tmp_path / "log.csv", index=False)
        read = read_bare_logs([tmp_path / "log.csv"], {}).logs[0].notices
        return [n for n in read if "position_m jumps" in n]

    assert jumps(frame) == []
    beyond = pd.concat([frame, frame.assign(time_s=0.7 + time, position_m=way * 5e-3)])
    assert any("over two rows" in n for n in jumps(beyond))


# --- rows too far apart -----------------------------------------------------------------------


def test_rows_too_far_apart_for_the_motion_are_said(tmp_path: Path) -> None:
    frame = axis_frame(length_s=11.0)
    path = tmp_path / "slow.csv"
    frame[::200].to_csv(path, index=False)
    logs = read_bare_logs([path], {})
    assert any("position_m reverses every" in n for n in logs.logs[0].notices)
    with pytest.raises(NotIdentifiedError, match="it moves, but is sampled too slowly"):
        fit_friction(logs.logs[0].trials, logs.rig)
    log, _ = bare(frame, tmp_path)
    assert not any("reverses every" in n for n in log.notices)


@pytest.mark.parametrize("noise_m", [1e-6, 2e-5, 1e-3])
def test_a_held_piston_s_potentiometer_is_not_called_sampled_too_slowly(
    noise_m: float, tmp_path: Path
) -> None:
    """Its converter shows readings that scatter over many of its steps."""
    readings = 0.05 + noise_m * np.random.default_rng(3).standard_normal(2000)
    frame = pd.DataFrame({"time_s": 2e-3 * np.arange(2000), "position_m": readings})
    frame = frame.assign(valve_a=0, pressure_a_pa=1e5)
    path = tmp_path / "held.csv"
    frame.round({"position_m": 7}).to_csv(path, index=False)
    assert not any("reverses every" in n for n in read_bare_logs([path], {}).logs[0].notices)


def test_a_shaft_that_rests_is_not_called_sampled_too_slowly(tmp_path: Path) -> None:
    frame = axis_frame(period=0.01)
    frame["position_m"] = COUNT * np.round(np.random.default_rng(4).normal(0, 0.4, len(frame)))
    frame.to_csv(tmp_path / "rest.csv", index=False)
    logs = read_bare_logs([tmp_path / "rest.csv"], {})
    with pytest.raises(NotIdentifiedError, match="position_m hardly changes"):
        fit_friction(logs.logs[0].trials, logs.rig, kind="motion")


@pytest.mark.parametrize(("every", "is_said"), [(1, False), (100, True)])
def test_a_chamber_that_fills_within_a_row_is_said(
    every: int, is_said: bool, tmp_path: Path
) -> None:
    t = 1e-3 * np.arange(6000)
    on = ((t > 1.0) & (t < 4.0)).astype(int)
    level = np.where(
        t < 4.0, 1.0 - np.exp(-np.clip(t - 1.0, 0, 9) / 0.05), np.exp(-(t - 4.0) / 0.05)
    )
    noise = 250.0 * np.random.default_rng(5).standard_normal((2, len(t)))
    frame = pd.DataFrame(
        {
            "time_s": t,
            "position_m": 0.05,
            "valve_a": on,
            "valve_b": 0,
            "pressure_a_pa": np.round(1e5 + 2e5 * level + noise[0]),
            "pressure_b_pa": np.round(1e5 + noise[1]),
        }
    )
    frame[::every].to_csv(tmp_path / "v.csv", index=False)
    (log,) = read_bare_logs([tmp_path / "v.csv"], {}).logs
    lines = [n for n in log.notices if "of its range from one reading" in n]
    assert [("pressure_a_pa" in n) for n in lines] == [True] * is_said


def test_a_pause_of_the_logger_is_no_slow_sampling(tmp_path: Path) -> None:
    t = 1e-3 * np.arange(3000)
    one = np.exp(-np.clip(t - 0.5, 0.0, 9.0) / 0.3)
    frame = pd.DataFrame(
        {
            "time_s": np.concatenate([t, t + 60.0]),
            "position_m": 0.05,
            "valve_a": np.tile((t < 0.5).astype(int), 2),
            "valve_b": 0,
            "pressure_a_pa": np.round(1e5 + 2e5 * np.tile(one, 2)),
            "pressure_b_pa": 1e5,
        }
    )
    frame.to_csv(tmp_path / "v.csv", index=False)
    (log,) = read_bare_logs([tmp_path / "v.csv"], {}).logs
    assert not any("of its range from one reading" in notice for notice in log.notices)


@pytest.mark.parametrize("stride", [8, 12, 16])
def test_a_slow_position_keeps_its_acceleration(stride: int, tmp_path: Path) -> None:
    """On lines between readings the motion's fast part is rounded off, and friction takes it."""
    rng = np.random.default_rng(1)
    count, t = 2e-6, 1e-3 * np.arange(12000)
    w1, w2 = 2.0 * np.pi * 0.4, 2.0 * np.pi * 4.0
    v = 0.25 * np.sin(w1 * t) + 0.1 * np.sin(w2 * t + 0.3)
    a = 0.25 * w1 * np.cos(w1 * t) + 0.1 * w2 * np.cos(w2 * t + 0.3)
    x = -0.25 / w1 * np.cos(w1 * t) - 0.1 / w2 * np.cos(w2 * t + 0.3)
    force = MASS * a + COULOMB * np.tanh(v / 1e-3) + VISCOUS * v + 0.3 * rng.standard_normal(len(t))
    position = stale(count * np.round(x / count), [stride])
    frame = pd.DataFrame({"time_s": t, "position_m": position, "motor_force_n": force})
    log, result = bare(frame, tmp_path)
    assert any("with a spline through them" in line for line in log.notices)
    found = result.by_name()
    assert found["viscous_n_s_per_m"].value == pytest.approx(VISCOUS, rel=5e-3)
    assert found["coulomb_n"].value == pytest.approx(COULOMB, rel=3e-3)
    assert found["mass_kg"].value == pytest.approx(MASS, rel=3e-3)


def test_a_column_that_one_test_lacks_is_mended_in_the_others(tmp_path: Path) -> None:
    frame = axis_frame(length_s=6.0)
    slow = frame.assign(position_m=stale(frame["position_m"].to_numpy(), [8]), test="slow")
    lacks = frame.assign(position_m=math.nan, test="lacks")
    path = tmp_path / "log.csv"
    pd.concat([slow, lacks]).to_csv(path, index=False)
    log = read_bare_logs([path], {}).logs[0]
    assert any("position_m repeats: 88% of its rows" in line for line in log.notices)
    assert "position_m" not in log["lacks"] and log["lacks"].row_period is None
    held = log["slow"]
    assert held.slow["position_m"] == pytest.approx(8e-3, rel=0.02)
    assert len(np.unique(held["position_m"])) > 0.9 * len(held)


def test_at_one_speed_friction_on_the_way_to_it_is_not_taken_for_inertia(tmp_path: Path) -> None:
    """At the low cut-offs of slow sensors the reversals' friction is spread over its neighbours."""
    period, inner, speed, place, rows = 1e-3, 20, 0.0, 0.0, []
    for time in period * np.arange(8000):
        force = 20.0 * np.sign(np.sin(2.0 * np.pi * time / 1.6 + 0.1))
        rows.append((time, COUNT * round(place / COUNT), force))
        for _ in range(inner):
            friction = COULOMB * math.tanh(speed / 1e-4) + 40.0 * speed
            speed += (force - friction) / MASS * period / inner
            place += speed * period / inner
    path = tmp_path / "log.csv"
    pd.DataFrame(rows, columns=["time_s", "position_m", "motor_force_n"]).to_csv(path, index=False)
    logs = read_bare_logs([path], {})
    for cutoff in (None, 10.0):
        found = fit_friction(
            logs.logs[0].trials, logs.rig, kind="motion", estimate_inertia=True, cutoff_hz=cutoff
        )
        mass, (friction,) = found.by_name()["mass_kg"], found.combinations
        assert "viscous_n_s_per_m" in friction.of
        assert abs(mass.value - MASS) < 2.0 * mass.std < 0.5
        true = COULOMB + 40.0 * friction.coefficients[1]
        assert friction.estimate.value == pytest.approx(true, rel=0.01)
