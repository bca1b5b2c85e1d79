"""Valves on a bench: their effects, the two components, verdicts on synthetic and measured data."""

from __future__ import annotations

import dataclasses
import itertools
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.rigs import REFERENCE, random_runs
from sysid.diagnosis.bench.component import Component, Law, rmse
from sysid.diagnosis.bench.selection import Selection, select
from sysid.diagnosis.bench.valve_flow import PARAMETER, ValveFlow, valve_flow
from sysid.diagnosis.bench.valve_time import PARAMETERS, ValveTime, open_share, valve_time
from sysid.errors import InputError, NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.io.conversion import convert
from sysid.io.foreign.recipe import kept_rows
from sysid.io.logs import Trial, read_log
from sysid.io.rig import Rig, read_rig
from sysid.parameters import Bundle, Parts
from sysid.parameters.files import shipped_schema
from sysid.plant.effects import bench, catalogue
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.valve import DutyDeadZone, ValveDelay
from sysid.plant.ports import Model, Point, join, split
from sysid.plant.simulator import simulate

SETS = Path(__file__).resolve().parent.parent / "datasets" / "measured"
BENCH = Rig("bench", "horizontal", "linear")
IDS = [effect.id for effect in bench.EFFECTS]
PARTIAL = bench.PartialOpening(9.0, 3.5, 1.4, 3.6e-3)
DEAD_BAND = bench.ValveDeadBand(0.3, 1.0)
LINE = bench.SeriesRestriction(1.0)
DUTIES = np.linspace(0.2, 1.0, 17)
PERIODS = (0.005, 0.01)


def forms(effect: type[CatalogueEffect]) -> list[CatalogueEffect]:
    names = [q.name for q in effect.shapes()]
    rows = itertools.product(*(q.grid for q in effect.shapes()))
    return [effect.neutral(**dict(zip(names, row, strict=True))) for row in rows]


def point_at(share: Any, **extra: Any) -> Point:
    """The valve of side A open for a share of the time; a PWM period of 5 ms."""
    u = np.asarray(share, dtype=float)
    zero = np.zeros_like(u)
    p = REFERENCE.replace(pwm_period=0.005)
    return Point(zero, zero, zero, zero + 2e5, zero + 2e5, zero, u, u, zero, p, extra)


def passed(effect: CatalogueEffect, flow: Any, point: Point, port: str) -> Any:
    return getattr(effect, port)(flow, "a", point)


# --- the effects -----------------------------------------------------------------------


@pytest.mark.parametrize("effect", bench.EFFECTS, ids=IDS)
def test_the_entry_is_whole(effect: type[CatalogueEffect]) -> None:
    fields: dict[str, Any] = {f.name: f.default for f in dataclasses.fields(effect)}  # type: ignore[arg-type]
    assert {q.name for q in effect.quantities} == fields.keys() and effect.strengths()
    for q in effect.quantities:
        assert fields[q.name] == (0.0 if q.is_strength else q.typical)
        assert q.lower <= fields[q.name] <= q.upper and q.lower <= q.typical <= q.upper
        assert all(q.lower <= g <= q.upper for g in q.grid)
        assert q.is_strength or len(q.grid) >= 3
    assert effect.title and effect.signature and effect.source
    assert bool(effect.rivals) == bool(effect.tie_breaker)
    assert set(effect.rivals) < catalogue().keys() - {effect.id}


@pytest.mark.parametrize("effect", bench.EFFECTS, ids=IDS)
@pytest.mark.parametrize("port", ["filling_flow", "exhaust_flow"])
def test_neutral_ports_change_no_bit(effect: type[CatalogueEffect], port: str) -> None:
    rng = np.random.default_rng(3)
    share = np.concatenate((rng.uniform(0, 1, 400), [0.0, 1.0, 1e-12]))
    point = point_at(share, duty_direction_a=rng.choice([-1.0, 0.0, 1.0], len(share)))
    flow = rng.normal(0.0, 1e-3, len(share))
    for form in forms(effect):
        np.testing.assert_array_equal(passed(form, flow, point, port), flow)


def test_neutral_to_the_bit_and_alike_at_typical_size_in_jax() -> None:
    from sysid.plant.jax_setup import jax

    share = np.random.default_rng(4).uniform(0, 1, 200)
    flow = 1e-3 * share

    def both(effects: Any, u: Any, q: Any, way: Any) -> list[Any]:
        at = dataclasses.replace(point_at(share), open_a=u, extra={"duty_direction_a": way})
        return [
            passed(e, q, at, port) for e in effects for port in ("filling_flow", "exhaust_flow")
        ]

    for made in ("neutral", "typical"):
        effects = tuple(getattr(effect, made)() for effect in bench.EFFECTS)
        structure, numbers = split(effects)
        compiled = jax.jit(lambda n, u, q, w, s=structure: both(join(s, n), u, q, w))
        found = compiled(numbers, share, flow, np.sign(share - 0.5))
        wanted = both(effects, share, flow, np.sign(share - 0.5))
        for a, b in zip(found, wanted, strict=True):
            if made == "neutral":
                np.testing.assert_array_equal(np.asarray(a), flow)
            np.testing.assert_allclose(a, b, rtol=1e-11)


def test_a_valve_that_is_on_or_off_simulates_as_without_them() -> None:
    inputs, models = random_runs(seed=5, count=1, seconds=0.4)
    model = Model(models[0].parameters)
    for effect in bench.EFFECTS:
        model = model + effect.typical()
    with_them = simulate(inputs[:1], [model])[0]
    bare = simulate(inputs[:1], [Model(models[0].parameters)])[0]
    for name in ("position", "velocity", "pressure_a", "pressure_b"):
        np.testing.assert_array_equal(getattr(with_them, name), getattr(bare, name), err_msg=name)


def test_closed_forms() -> None:
    half = point_at(0.5)
    alone = bench.PartialOpening(2.0, 3.0, 0.0, 5e-3)
    assert passed(alone, 8.0, half, "filling_flow") == pytest.approx(2.0)  # (2.5 / 5)^2
    assert passed(alone, -8.0, half, "exhaust_flow") == pytest.approx(-1.0)
    assert passed(alone, 8.0, point_at(1.0), "filling_flow") == 8.0
    band = bench.ValveDeadBand(0.2, 1.0)
    assert passed(band, 5.0, half, "filling_flow") == pytest.approx(10.0 * (0.3 / 0.8) ** 2)
    assert passed(band, 1.0, point_at(0.1), "filling_flow") == 0.0
    # Conductances in series: the valve's 2, the line's 1, and the valve's halved.
    whole = 1.0 / np.sqrt(0.25 + 1.0)
    line = bench.SeriesRestriction(np.log(2.0 / whole))
    full = float(REFERENCE.choked_fill_a)
    found = passed(line, 0.5 * full, half, "filling_flow") / full
    assert found == pytest.approx((1.0 / np.sqrt(1.0 + 1.0)) / whole)
    loop = bench.ValveHysteresis(0.1)
    rising, falling = (point_at(0.5, duty_direction_a=way) for way in (1.0, -1.0))
    assert passed(loop, 0.5 * full, rising, "filling_flow") == pytest.approx(0.475 * full)
    assert passed(loop, 0.5 * full, falling, "filling_flow") == pytest.approx(0.525 * full)
    assert passed(loop, 0.5 * full, half, "filling_flow") == 0.5 * full


# --- the on/off valve under PWM --------------------------------------------------------


def test_pulses_open_for_their_length_less_the_delay() -> None:
    p = REFERENCE.replace(pwm_period=0.01, on_delay_a=0.0, off_delay_a=0.0)
    duty = np.array([0.05, 0.2, 0.5, 0.95, 1.0])
    np.testing.assert_array_equal(open_share(duty, Model(p)), duty)
    late = open_share(duty, Model(p) + ValveDelay(2e-3, 1e-3))
    np.testing.assert_allclose(late, [0.0, 0.1, 0.4, 0.85, 1.0], atol=1e-12)
    long = open_share(duty, Model(p) + ValveDelay(1e-3, 2e-3))
    np.testing.assert_allclose(long, [0.15, 0.3, 0.6, 1.0, 1.0], atol=1e-12)
    both = open_share(duty, Model(p) + ValveDelay(1.0, 1.001))
    np.testing.assert_allclose(both, long, atol=1e-9)
    dead = open_share(duty, Model(p) + DutyDeadZone(1e-3))
    np.testing.assert_allclose(dead, [0.0, 0.2, 0.5, 1.0, 1.0], atol=1e-12)


def sweep(period: float, fills: bool, effects: Sequence[Any], seed: int, noise: float) -> Trial:
    """A sweep of the duty with times from the law and scatter of its logarithm."""
    ones = np.ones_like(DUTIES)
    channels = {
        "duty_a": DUTIES,
        "time_to_pressure_s": ones,
        "pwm_period_s": period * ones,
        "valve_a": float(fills) * ones,
    }
    trial = Trial(
        f"{period:g} {fills}", np.arange(len(DUTIES), dtype=np.float64), channels, "made.csv"
    )
    law = Law(dict(zip(PARAMETERS, (3.0, 2.0), strict=True)), tuple(effects))
    times = valve_time([trial], BENCH).times(law, 0)
    scatter = np.exp(noise * np.random.default_rng(seed).normal(size=len(times)))
    return dataclasses.replace(trial, channels={**channels, "time_to_pressure_s": times * scatter})


def timed(effects: Sequence[Any], periods: Sequence[float], noise: float = 0.08) -> ValveTime:
    ways = [(p, f) for p in periods for f in (True, False)]
    trials = [sweep(p, f, effects, seed, noise) for seed, (p, f) in enumerate(ways)]
    return valve_time(trials, BENCH)


def found(selection: Selection) -> list[str]:
    return [addition.id for addition in selection.additions]


def held_out(component: Component, law: Law) -> float:
    return rmse(component.residuals(law, range(len(component.tests))))


def test_the_time_is_inverse_to_the_duty_where_nothing_is_missing() -> None:
    selection = select(timed((), PERIODS), catalogue())
    assert found(selection) == []
    assert selection.base.law.values == pytest.approx(
        {"filling_time_s": 3.0, "emptying_time_s": 2.0}, rel=0.1
    )


def test_partial_opening_is_found_and_predicts_a_period_not_fitted() -> None:
    selection = select(timed((PARTIAL,), PERIODS), catalogue())
    assert found(selection) == ["partial-opening"]
    addition = selection.additions[0]
    for name, estimate in addition.fitted.estimates(addition.effect).items():
        assert abs(estimate.value - getattr(PARTIAL, name)) < 4.0 * estimate.std, name
    third = timed((PARTIAL,), (0.015,))
    assert held_out(third, selection.base.law) > 0.3
    assert held_out(third, selection.final.law) < 0.15


def test_effects_that_act_on_a_pulsed_valve() -> None:
    acting = {kind.id for kind in timed((), PERIODS).effects(catalogue())}
    assert {"valve-delay", "duty-dead-zone", "partial-opening", "series-restriction"} <= acting
    assert not acting & {"coil-heating", "valve-hysteresis", "backlash", "supply-droop"}


# --- the proportional valve ------------------------------------------------------------


def swept(effects: Sequence[Any], noise: float = 1e-5, rows: int = 101) -> ValveFlow:
    up = np.linspace(0.0, 1.0, rows)
    law = Law({PARAMETER: 2.7e-3}, tuple(effects))
    trials = []
    for seed, (label, duty) in enumerate((("up", up), ("down", up[::-1]))):
        trial = Trial(
            label, np.arange(rows, dtype=np.float64), {"duty_a": duty, "flow_a_kg_s": duty}, "m.csv"
        )
        way = 1.0 if label == "up" else -1.0
        flow = valve_flow([trial], BENCH).flow(law, duty, way)
        flow = flow + noise * np.random.default_rng(seed).normal(size=rows)
        trials.append(dataclasses.replace(trial, channels={"duty_a": duty, "flow_a_kg_s": flow}))
    return valve_flow(trials, BENCH)


@pytest.mark.parametrize(
    "effects",
    [(), (bench.ValveDeadBand(0.3, 0.3),), (DEAD_BAND, LINE), (bench.ValveHysteresis(0.1),)],
    ids=["nothing", "dead band", "dead band and line", "hysteresis"],
)
def test_what_is_missing_is_found_and_nothing_else(effects: tuple[Any, ...]) -> None:
    selection = select(swept(effects), catalogue())
    assert sorted(found(selection)) == sorted(effect.id for effect in effects)
    by_id = {effect.id: effect for effect in effects}
    for effect in selection.final.law.effects:
        for name, estimate in selection.final.estimates(effect).items():
            true = getattr(by_id[effect.id], name)
            assert abs(estimate.value - true) < 5.0 * estimate.std, (effect.id, name)
    assert held_out(swept(effects, rows=40), selection.final.law) < 1.5e-5


@pytest.mark.parametrize("effects", [(), (DEAD_BAND, LINE), (bench.ValveHysteresis(0.1),)])
@pytest.mark.parametrize("direction", [-1.0, 0.0, 1.0])
def test_the_inverse_gives_the_duty_back(effects: tuple[Any, ...], direction: float) -> None:
    component, law = swept(effects), Law({PARAMETER: 2.7e-3}, effects)
    duty = np.array([0.31, 0.4, 0.55, 0.8, 0.999])
    flow = component.flow(law, duty, direction)
    np.testing.assert_allclose(component.duty(law, flow, direction), duty, atol=1e-9)
    assert np.isnan(component.duty(law, [-1e-4, 3e-3], direction)).all()
    if effects and effects[0] is DEAD_BAND:
        assert component.duty(law, 0.0)[0] == pytest.approx(0.3, abs=1e-6)


def test_a_stretch_is_left_out_of_both_sweeps_and_knows_its_direction() -> None:
    component = swept(())
    assert len(component.tests) == 24
    for up, down in zip(component.stretches[:12], component.stretches[12:], strict=True):
        assert sorted(up.duty) == pytest.approx(sorted(down.duty))
        assert (up.direction == 1.0).all() and (down.direction == -1.0).all()
        assert up.sweep == "m.csv, test up" and down.sweep == "m.csv, test down"
    acting = {kind.id for kind in component.effects(catalogue())}
    assert acting == {"valve-dead-band", "series-restriction", "valve-hysteresis"}


@pytest.mark.parametrize("rows", [5, 11, 23])
def test_a_data_sheets_few_duties_are_a_sweep(rows: int) -> None:
    component = swept((DEAD_BAND,), rows=rows)
    assert len(component.tests) == 2 * (rows // 2)
    selection = select(component, catalogue())
    assert found(selection) == [DEAD_BAND.id]
    assert selection.final.law.values[PARAMETER] == pytest.approx(2.7e-3, rel=0.02)


# --- bundle and bad input --------------------------------------------------------------


@pytest.mark.parametrize(
    ("component", "section"), [(timed((), PERIODS), "timing"), (swept(()), "steady")]
)
def test_the_part_is_in_the_schema_and_gives_the_law_back(
    component: Component, section: str
) -> None:
    import jsonschema

    values = {p.name: p.value for p in component.parameters()}
    estimates = {n: Estimate(v, 0.1 * v, "s", (0.8 * v, 1.2 * v)) for n, v in values.items()}
    part = component.part(estimates)
    assert part.valves is not None
    whole = shipped_schema()
    schema = {"$defs": whole["$defs"], **whole["properties"]["valves"]}
    jsonschema.validate(part.valves.to_json(), schema)
    broken = {"a": {section: dict.fromkeys(values, 1.0)}}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(broken, schema)
    assert component.law_of(Bundle.new(BENCH, part, [])).values == pytest.approx(values)
    with pytest.raises(NotIdentifiedError, match=f"valves.a.{section}.*fit valve-"):
        component.law_of(Bundle.new(BENCH, Parts(), []))


def test_a_direction_without_a_test_is_said_to_be_unidentified() -> None:
    component = valve_time([sweep(0.005, True, (), 0, 0.0)], BENCH)
    assert [p.name for p in component.parameters()] == ["filling_time_s"]
    part = component.part({"filling_time_s": Estimate(3.0, 0.1, "s", (2.8, 3.2))})
    assert part.valves is not None
    timing = part.valves.side("a").timing
    assert timing is not None and not timing.emptying_time_s.identified
    assert "sweep of its duty" in str(timing.emptying_time_s.reason)


def test_a_direction_that_was_not_fitted_is_not_predicted() -> None:
    emptying = valve_time([sweep(0.005, False, (), 0, 0.0)], BENCH)
    with pytest.raises(NotIdentifiedError, match="emptying_time_s is not identified"):
        emptying.times(Law({"filling_time_s": 3.0}), 0)


def changed(trial: Trial, **channels: Any) -> Trial:
    return dataclasses.replace(trial, channels={**trial.channels, **channels})


@pytest.mark.parametrize(
    ("change", "error", "said"),
    [
        ({"pwm_period_s": np.linspace(0.005, 0.01, 17)}, InputError, "pwm_period_s changes"),
        (
            {"time_to_pressure_s": np.zeros(17)},
            InputError,
            "time_to_pressure_s = 0 is not positive",
        ),
        ({"duty_a": np.zeros(17)}, NotIdentifiedError, "no reading with a duty above 0"),
    ],
)
def test_bad_sweeps_are_refused(
    change: Mapping[str, Any], error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        valve_time([changed(sweep(0.005, True, (), 0, 0.0), **change)], BENCH)


def test_missing_columns_and_sweeps_are_refused() -> None:
    for make in (valve_flow, valve_time):
        with pytest.raises(NotIdentifiedError, match="give a sweep of the duty"):
            make([], BENCH)
        with pytest.raises(InputError, match=r"column .* is missing"):
            make([Trial("x", np.arange(30.0), {"duty_a": np.linspace(0, 1, 30)}, "x.csv")], BENCH)
    still = {"duty_a": np.full(30, 0.5), "flow_a_kg_s": np.full(30, 1e-3)}
    with pytest.raises(NotIdentifiedError, match=f"{PARAMETER} is not identified"):
        valve_flow([Trial("x", np.arange(30.0), still, "x.csv")], BENCH)


# --- rows of a recipe ------------------------------------------------------------------


def converted(folder: Path, rows: str) -> list[tuple[float, float]]:
    source, spec, out = folder / "raw.csv", folder / "recipe.toml", folder / "log.csv"
    source.write_text("".join(f"{k / 10},{k}\n" for k in range(10)))
    spec.write_text(
        '[map]\nduty_a = "#1"\nflow_a_kg_s = "#2:g/s"\n[constants]\ntest = "x"\n'
        f'[options]\nheader = false\nsampling_period_s = 1.0\nrows = "{rows}"\n'
    )
    convert(source, out, spec_file=spec)
    trial = read_log(out, BENCH).trials[0]
    return list(zip(trial.time, 1e3 * trial["flow_a_kg_s"], strict=True))


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ("0::3", [(0, 0), (3, 3), (6, 6), (9, 9)]),
        ("1::3, 0:2", [(0, 0), (1, 1), (4, 4), (7, 7)]),
        ("-2:", [(8, 8), (9, 9)]),
        ("9::-4", [(0, 9), (4, 5), (8, 1)]),
    ],
)
def test_a_recipe_keeps_rows(tmp_path: Path, rows: str, expected: list[Any]) -> None:
    np.testing.assert_allclose(converted(tmp_path, rows), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("3", "'3' is not a slice"),
        ("0::0", "is not a slice"),
        ("0::2, 9::-1", "runs in both directions"),
        ("20:", "keeps none of its 10 rows"),
    ],
)
def test_rows_that_make_no_sense_are_refused(tmp_path: Path, rows: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        converted(tmp_path, rows)


def test_every_row_is_kept_once() -> None:
    assert kept_rows((slice(0, 4), slice(2, 6)), 5) == [0, 1, 2, 3, 4]


# --- measured --------------------------------------------------------------------------


def measured(
    name: str, campaign: str, data: Path, work: Path, make: Callable[[list[Trial], Rig], Any]
) -> tuple[Any, Any]:
    """The parts that a set's campaign fits and holds out, converted by its own recipes."""
    folder = SETS / name
    rig = read_rig(folder / "rig.toml")
    content = tomllib.loads((folder / "set.toml").read_text())
    by_log = {entry["log"]: entry for entry in content["convert"]}
    parts: dict[str, list[Trial]] = {"fit": [], "holdout": []}
    for entry in tomllib.loads((folder / campaign).read_text())["log"]:
        log = by_log[entry["file"]]
        source = data / content["folder"] / log["source"]
        convert(
            source, work / entry["file"], spec_file=folder / log["recipe"], rows=log.get("rows")
        )
        parts[entry["use"]] += read_log(work / entry["file"], rig).trials
    return make(parts["fit"], rig), make(parts["holdout"], rig)


@pytest.mark.parametrize(
    ("campaign", "base"),
    [
        ("campaign.toml", (0.55, 0.55)),
        ("repeat_1.toml", (1.1, 0.8)),
        ("repeat_2.toml", (0.55, 0.38)),
    ],
)
def test_one_timing_explains_three_pwm_periods(
    shared_data: Path, tmp_path: Path, campaign: str, base: tuple[float, float]
) -> None:
    fitted, other = measured("valve_pwm", campaign, shared_data, tmp_path, valve_time)
    selection = select(fitted, catalogue())
    assert found(selection) == ["partial-opening"]
    before = other.further_errors(selection.base.law)
    after = other.further_errors(selection.final.law)
    for channel, least in zip(("log_time_filling", "log_time_emptying"), base, strict=True):
        assert before[channel][0] > least
        assert after[channel][0] < 0.5
    effect: Any = selection.additions[0].effect
    assert 3.3e-3 < effect.opening_time_s < 4.1e-3


@pytest.mark.parametrize("campaign", ["campaign.toml", "repeat_1.toml"])
def test_dead_band_and_line_explain_the_proportional_valve(
    shared_data: Path, tmp_path: Path, campaign: str
) -> None:
    fitted, other = measured("valve_surface", campaign, shared_data, tmp_path, valve_flow)
    selection = select(fitted, catalogue())
    assert found(selection) == ["valve-dead-band", "series-restriction"]
    before, after = (held_out(other, s.law) for s in (selection.base, selection.final))
    assert after < 0.1 * before
    law = selection.final.law
    duty = np.linspace(0.45, 0.99, 30)
    np.testing.assert_allclose(fitted.duty(law, fitted.flow(law, duty)), duty, atol=1e-9)
