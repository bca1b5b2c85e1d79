"""Numbers that cannot be, tests that show sums alone, and runs without end: each costs itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sysid.balance.samples import MotionSamples
from sysid.commands.app import main
from sysid.diagnosis.actuator.holdout import HeldOut
from sysid.diagnosis.actuator.twins import Scatter, _take_logs_own
from sysid.diagnosis.bench.axis import Axis, axis
from sysid.diagnosis.bench.component import Law
from sysid.diagnosis.bench.diagnose import diagnose_component
from sysid.diagnosis.bench.registry import AXIS as KIND
from sysid.diagnosis.bench.selection import preferred, select
from sysid.diagnosis.search import (
    MOST_EFFECTS,
    full_sentence,
    limit_sentence,
    shapes_at_limits,
)
from sysid.errors import InputError, NotIdentifiedError, SimulationError
from sysid.estimation.linear import Estimate, Variance
from sysid.friction import fit_friction
from sysid.identification.friction.motion import fit_motion
from sysid.io.logs import Trial
from sysid.io.motion import ROTARY
from sysid.io.rig import Rig, rig_from_content
from sysid.parameters import Bundle, Friction, read_bundle
from sysid.parameters.assembled_model import (
    assumed_parameters,
    fitted_inertia,
    parameters_from_bundle,
)
from sysid.parameters.effects import effect_from_entry, entry_of
from sysid.plant import simulator
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.friction import PowerLawFriction, SealFriction
from sysid.plant.effects.linear import for_rig
from sysid.plant.effects.supply import SupplyDroop
from sysid.plant.simulator import ENDLESS
from sysid.recording.motion_tests import prepare
from sysid.recording.simulation import NOT_FINITE, simulate_segments
from sysid.refinement import refine
from sysid.refinement.whole_tests import in_both, simulated, times_worse
from sysid.types import FloatArray
from sysid.validation import open_loop

HEAD = {"rig": {"name": "axis", "orientation": "horizontal", "motion": "linear"}}
RIG = rig_from_content(HEAD, "rig.toml")
DECLARED = rig_from_content({**HEAD, "inertia": {"mass_kg": 5.0}}, "rig.toml")
CATALOGUE = for_rig(catalogue(), is_linear=True)
FEW = {name: CATALOGUE[name] for name in ("stribeck-friction", "quadratic-drag", "cable-spring")}
MASS, COULOMB, VISCOUS, PEAK, KNEE = 5.0, 5.0, 35.0, 15.0, 0.07

Friction1 = Callable[[FloatArray], FloatArray]


def stribeck(speed: FloatArray) -> FloatArray:
    peak = PEAK * np.exp(-((speed / KNEE) ** 2))
    return np.asarray(np.sign(speed) * (COULOMB + peak) + VISCOUS * speed)


def plain(speed: FloatArray) -> FloatArray:
    return np.asarray(COULOMB * np.sign(speed) + VISCOUS * speed)


def led(label: str, speed: FloatArray, friction: Friction1, period: float = 0.004) -> Trial:
    """An axis led at this speed (n,) by a stiff drive, whose force is logged."""
    rng = np.random.default_rng(len(label) + int(1e3 * abs(float(speed.max()))))
    time = period * np.arange(len(speed))
    force = MASS * np.gradient(speed, period) + friction(speed)
    force = force + 0.2 * rng.standard_normal(len(speed))
    steps = 0.5 * period * (speed[1:] + speed[:-1])
    channels = {"position_m": np.concatenate([[0.0], np.cumsum(steps)]), "motor_force_n": force}
    return Trial(label, time, channels, label)


def forward(number: int, friction: Friction1 = stribeck) -> Trial:
    """A spindle that only ever runs one way, at changing speeds, for 8 s."""
    time = 0.004 * np.arange(2000)
    swing = 1.0 - np.cos(2.0 * np.pi * (0.1 + 0.06 * number) * time)
    return led(f"run {number}", 0.01 + 0.45 * swing * (0.5 + 0.15 * number), friction)


def fitted(trials: Sequence[Trial], rig: Rig = RIG) -> Bundle:
    return Bundle.new(rig, fit_friction(list(trials), rig).part(), [])


def friction_of(bundle: Bundle) -> Friction:
    assert bundle.friction is not None
    return bundle.friction


# --- sums in place of their parts ---------------------------------------------------------


@pytest.fixture(scope="module")
def one_way() -> Bundle:
    return fitted([forward(1), forward(2)])


def test_a_model_takes_the_sum_that_one_direction_identifies(one_way: Bundle) -> None:
    friction = friction_of(one_way)
    assert friction.coulomb is not None and not friction.coulomb.identified
    held = friction.sum_in_motion
    assert held is not None and held.of == ["coulomb_n", "offset_n"]
    p = parameters_from_bundle(one_way, RIG)
    assert p.coulomb_effort == p.static_effort == held.estimate.value
    assert p.offset == 0.0
    (said,) = [n for n in assumed_parameters(one_way) if "only coulomb_n + offset_n is" in n]
    assert "the model takes it for coulomb_n" in said and "both directions" in said


def test_an_estimate_of_the_sum_stays_one(one_way: Bundle) -> None:
    new = Estimate.symmetric(4.5, 0.1, "N", 20.0)
    friction = friction_of(one_way.with_estimates({"friction.coulomb_n": new}))
    assert friction.coulomb is not None and not friction.coulomb.identified
    assert friction.sum_in_motion is not None
    assert friction.sum_in_motion.estimate == new
    assert friction.in_motion("coulomb") == new


def test_one_direction_is_diagnosed(one_way: Bundle) -> None:
    """The peak is there whichever way the machine runs, and lies beyond the reference rig's."""
    found = diagnose_component(
        KIND, [forward(1), forward(2)], [forward(3)], RIG, one_way, FEW, quick=True
    )
    assert [e.id for e in found.effects] == ["stribeck-friction"]
    estimates = found.effects[0].estimates
    assert estimates["stribeck_torque_nm"].value == pytest.approx(PEAK, rel=0.1)
    assert estimates["stribeck_velocity_rad_per_s"].value == pytest.approx(KNEE, rel=0.1)
    error = found.residual["motor_force_n"]
    assert error.after is not None and error.before is not None
    assert error.after < 0.1 * error.before
    extended = found.evidence.with_base(one_way)
    held = friction_of(extended).sum_in_motion
    assert held is not None and held.estimate.value == pytest.approx(COULOMB, rel=0.05)


def test_one_direction_has_no_offset_of_its_own() -> None:
    part = axis([forward(k) for k in (1, 2, 3)], RIG)
    assert part.only_way == 1.0
    assert [p.name for p in part.parameters()] == ["coulomb_n", "viscous_n_s_per_m", "mass_kg"]
    both = Bundle.new(RIG, known(coulomb_n=4.0, offset_n=1.0), [])
    assert part.law_of(both).values["coulomb_n"] == 5.0


def known(**values: float) -> Any:
    """Friction of a bundle that identifies everything."""
    units = {"mass_kg": "kg", "viscous_n_s_per_m": "N s/m"}
    every = {"static_n": 6.0, "coulomb_n": 5.0, "viscous_n_s_per_m": 35.0, "mass_kg": 5.0} | values
    estimates = {k: Estimate.symmetric(v, 0.1, units.get(k, "N"), 20.0) for k, v in every.items()}
    return SimpleNamespace(friction=Friction.model_validate(estimates), valves=None, effects=())


def test_a_single_recording_is_diagnosed_without_a_hold_out() -> None:
    only = forward(2)
    found = diagnose_component(KIND, [only], [], RIG, fitted([only]), FEW, quick=True)
    assert [e.id for e in found.effects] == ["stribeck-friction"]
    assert any("no held-out log" in n for n in found.notices)


def test_one_speed_is_diagnosed_by_the_law_at_that_speed() -> None:
    """Its one number is all friction there, and what changes along the way is found beside it."""
    trials = []
    for number in (1, 2, 3):
        legs = [np.full(500, way * 0.2) for way in (1.0, -1.0) * 3]
        speed = np.convolve(np.concatenate(legs), np.ones(40) / 40.0, mode="same")
        trial = led(f"to and fro {number}", speed, plain)
        place = trial["position_m"] - 0.2
        force = trial["motor_force_n"] + 20.0 * place
        trials.append(replace(trial, channels={"position_m": place, "motor_force_n": force}))
    bundle = fitted(trials[:2])
    friction = friction_of(bundle)
    assert friction.viscous is not None and not friction.viscous.identified
    found = diagnose_component(KIND, trials[:2], trials[2:], RIG, bundle, FEW, quick=True)
    assert "cable-spring" in [e.id for e in found.effects]
    held = friction_of(found.evidence.with_base(bundle)).sum_in_motion
    assert held is not None
    assert held.estimate.value == pytest.approx(COULOMB + 0.2 * VISCOUS, rel=0.1)


# --- numbers that cannot be ---------------------------------------------------------------


def lagging(folder: Path) -> Path:
    """A joint of hardly any inertia, whose friction lags its motion: the fit's is negative."""
    for number in (1, 2, 3):
        rng = np.random.default_rng(number)
        time = 0.004 * np.arange(2000)
        first, second = rng.uniform(0.0, 2.0 * np.pi, 2)

        def speed(t: FloatArray, a: float = first, b: float = second) -> FloatArray:
            return np.asarray(3.0 * np.sin(0.8 * np.pi * t + a) + 1.5 * np.sin(2.2 * np.pi * t + b))

        late = speed(time - 0.02)
        torque = 0.1 * np.tanh(late / 0.05) + 0.02 * late + 0.002 * rng.standard_normal(2000)
        angle = 0.004 * np.cumsum(speed(time)) + 1e-4 * rng.standard_normal(2000)
        table = np.column_stack([time, angle, torque])
        header = "time_s,theta_rad,motor_torque_nm"
        path = folder / f"run_{number}.csv"
        np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.8g")
    (folder / "rig.toml").write_text('[rig]\nname = "joint"\norientation = "horizontal"\n')
    logs = [
        f'[[log]]\nkind = "friction-motion"\nfile = "run_{n}.csv"\nuse = "{use}"\n'
        for n, use in ((1, "fit"), (2, "fit"), (3, "holdout"))
    ]
    path = folder / "campaign.toml"
    path.write_text('rig = "rig.toml"\n' + "".join(logs))
    return path


def test_a_negative_inertia_is_named_and_the_search_ends(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign, bundle = lagging(tmp_path), tmp_path / "b.json"
    assert main(["fit", str(campaign), "-o", str(bundle)]) == 0
    said = capsys.readouterr().err
    fitted = friction_of(read_bundle(bundle))
    inertia = fitted.inertia
    assert inertia is not None and not inertia.identified
    assert fitted.coulomb is not None and fitted.coulomb.value == pytest.approx(0.1, rel=0.02)
    left_free = "left free, inertia_kg_m2 is -4.11e-04 (-4.38e-04 to -3.84e-04)"
    for part in (left_free, "held at 0", "channels' times"):
        assert part in said, part
    assert main(["diagnose", str(campaign), "--bundle", str(bundle), "--quick"]) == 0
    found = capsys.readouterr()
    assert "errors on held-out tests: torque" in found.out
    assert "not simulated" in found.err


def rows_of_motion(inertia: float, number: int, noise: float) -> MotionSamples:
    """Rows of a balance with Coulomb friction 1 and viscous friction 0.2."""
    rng = np.random.default_rng(number)
    time = np.linspace(0.0, 20.0, 400)
    speed, acceleration = 3.0 * np.sin(time), 3.0 * np.cos(time)
    x = np.column_stack([np.sign(speed), speed, np.ones(400), acceleration])
    effort = x @ np.array([1.0, 0.2, 0.0, inertia]) + noise * rng.standard_normal(400)
    none, far = np.zeros((400, 2)), np.full(400, np.inf)
    return MotionSamples(x, effort, np.zeros(4), 0.0, np.zeros(400), far, far, none, none, 0.0)


def test_an_inertia_below_zero_within_its_error_is_none() -> None:
    """Its value is the bound, its interval what the motion still allows."""
    found = fit_motion([rows_of_motion(-1e-3, k, 0.1) for k in (1, 2, 3, 4)], None, ROTARY)
    held = fit_motion([rows_of_motion(-1e-3, k, 0.1) for k in (1, 2, 3, 4)], 0.0, ROTARY)
    assert found.inertia is not None and found.inertia.value == 0.0
    assert found.inertia.interval[0] == 0.0 < found.inertia.interval[1] < 0.02
    assert found.coulomb == held.coulomb and found.viscous == held.viscous
    assert any("left free" in line and "held at 0" in line for line in found.notices)


def test_two_motions_show_that_friction_differs_from_test_to_test() -> None:
    """Its variance is known to one degree of freedom, and to more with that of ramps."""
    rows = rows_of_motion(0.0, 1, 0.01)
    pair = [replace(rows, effort=factor * rows.effort) for factor in (0.97, 1.03)]
    for ramps, half in ((Variance(), 12.7 * 0.03), (Variance(0.02**2, 10.0), 2.2 * 0.0163)):
        found = fit_motion(pair, 0.0, ROTARY, ramps)
        assert np.ptp(found.coulomb.interval) / 2.0 == pytest.approx(half, rel=0.1)
        assert not found.notices
    assert any("hold for this test" in line for line in fit_motion(pair[:1], 0.0, ROTARY).notices)


def test_an_inertia_that_may_be_zero_is_said() -> None:
    doubtful = known()
    wide = Estimate.symmetric(23.0, 60.0, "kg", 20.0)
    bundle = Bundle.new(RIG, SimpleNamespace(**vars(doubtful)), [])
    bundle = bundle.replaced(friction=friction_of(bundle).replaced(mass_kg=wide))
    (said,) = [n for n in assumed_parameters(bundle) if "mass_kg" in n]
    assert "mass_kg is 23 (-102" in said and "declare [inertia] mass_kg" in said
    assert fitted_inertia(bundle) == 23.0


def test_an_impossible_inertia_gives_way_to_a_declared_one() -> None:
    bundle = Bundle.new(RIG, known(mass_kg=-3.0), [])
    assert fitted_inertia(bundle) is None
    with pytest.raises(NotIdentifiedError, match="mass is -3 kg, which is impossible"):
        parameters_from_bundle(bundle, RIG)
    assert parameters_from_bundle(bundle, DECLARED).inertia == 5.0
    (said,) = [n for n in assumed_parameters(bundle, DECLARED) if "mass_kg" in n]
    assert "the model uses 5 kg, as the rig file has" in said


def test_friction_below_zero_is_held_at_zero_and_said_with_its_interval() -> None:
    bundle = Bundle.new(RIG, known(viscous_n_s_per_m=-0.05), [])
    assert parameters_from_bundle(bundle, RIG).viscous == 0.0
    (said,) = [n for n in assumed_parameters(bundle) if "viscous_n_s_per_m" in n]
    assert "-0.05 (-0.26 to 0.16)" in said and "uses 0" in said and "more speeds" in said
    part = axis([forward(k) for k in (1, 2, 3)], RIG)
    assert part.law_of(bundle).values["viscous_n_s_per_m"] == 0.0


# --- runs without end ---------------------------------------------------------------------


def but_one(trial: Trial) -> Callable[..., Any]:
    """The simulator, that finds no end of one trial."""
    simulate = simulator.simulate

    def simulated(inputs: Any, models: Any, *args: Any, **options: Any) -> Any:
        runs = simulate(inputs, models, *args, **options)
        own = [np.shares_memory(one.time, trial.time) for one in inputs]
        return [
            replace(run, position=np.full(len(run.time), np.nan)) if lost else run
            for run, lost in zip(runs, own, strict=True)
        ]

    return simulated


def test_a_test_without_end_costs_that_test(monkeypatch: pytest.MonkeyPatch) -> None:
    part = axis([forward(k, plain) for k in (1, 2, 3)], RIG)
    law = Law({"coulomb_n": COULOMB, "viscous_n_s_per_m": VISCOUS, "mass_kg": MASS})
    none = Law({**law.values, "mass_kg": 0.0})
    whole, said = part.further_errors_of([law])
    assert not said and whole[0]["position_m"][0] > 0.0
    monkeypatch.setattr(simulator, "simulate", but_one(part.trials[1]))
    found, said = part.further_errors_of([none, law])
    assert found[0] == {} and found[1]["position_m"][0] > 0.0
    others = Axis(RIG, part.cases, (part.trials[0], part.trials[2]), part.has_speeds, 1.0)
    assert found[1] == others.further_errors_of([law])[0][0]
    assert said[0].startswith("held-out tests are not simulated: the law: the fitted mass is 0 kg")
    (lost,) = said[1:]
    assert part.trials[1].title in lost and ENDLESS in lost and "other held-out tests" in lost


def test_a_segment_without_end_is_nan_or_named(monkeypatch: pytest.MonkeyPatch) -> None:
    trials = [forward(1, plain), forward(2, plain)]
    tests = [prepare(trial, "friction-motion", RIG, 1.0, MASS) for trial in trials]
    model = Bundle.new(RIG, known(), []).model(RIG)
    runs = [(test, test.whole) for test in tests]
    whole = simulate_segments(runs, model, (), "position_m")
    monkeypatch.setattr(simulator, "simulate", but_one(trials[1]))
    with pytest.raises(SimulationError, match="run 2: the simulation switches without end"):
        simulate_segments(runs, model, (), "position_m")
    found = simulate_segments(runs, model, (), "position_m", nan_if_endless=True)
    assert np.array_equal(found[0], whole[0]) and np.isnan(found[1]).all()


ENDS = np.ones((3, 4))
NONE = np.full((3, 4), np.nan)


def test_whole_tests_are_compared_where_both_models_simulate_them() -> None:
    worse = 1.5 * ENDS
    assert simulated([ENDS, NONE]).tolist() == [True, False]
    before, after = in_both([ENDS, NONE, ENDS], [worse, worse, NONE])
    assert len(before) == len(after) == 1 and after[0] is worse
    assert times_worse([ENDS, NONE], [worse, worse]) == pytest.approx(1.5)
    assert times_worse([ENDS, ENDS], [worse, NONE]) == np.inf
    assert times_worse([NONE], [ENDS]) == 0.0 and times_worse([NONE], [NONE]) == np.inf


def test_a_refinement_gives_the_errors_of_the_tests_that_have_an_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    of = {"before": [ENDS, ENDS], "after": [0.5 * ENDS, NONE]}
    monkeypatch.setattr(refine, "whole_residuals", lambda tests, model, position: of[model])
    tests: Any = [SimpleNamespace(source="run 1"), SimpleNamespace(source="run 2")]
    notices: list[str] = []
    fit = refine._fit(tests, "before", "after", "theta_rad", notices)  # type: ignore[arg-type]
    assert fit.before.tolist() == [1.0] * 3 and fit.after.tolist() == [0.5] * 3
    (said,) = notices
    assert said.startswith("run 2: is not simulated with the refined numbers")


def test_a_validation_leaves_out_the_test_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    tests = [
        prepare(forward(number, plain), "friction-motion", RIG, 1.0, MASS) for number in (1, 2)
    ]
    cases: Any = [SimpleNamespace(test=test, entry=None, name="log") for test in tests]
    counts = [1 + len(test.segments) for test in tests]
    runs = [ENDS] * sum(counts)
    runs[2] = runs[counts[0]] = NONE
    monkeypatch.setattr(open_loop, "simulate_segments", lambda *args, **options: runs)
    seen: list[Any] = []
    monkeypatch.setattr(open_loop, "judged", lambda *args: seen.append(args))
    discrete: Any = SimpleNamespace(name="discrete", surfaces=())
    results, notices = open_loop._simulated(cases, RIG, None, discrete)  # type: ignore[arg-type]
    assert [case for case, _ in results] == cases[:1]
    assert len(seen[0][0].segments) == len(seen[0][-1]) == counts[0] - 2
    assert "run 1: 1 of" in notices[0] and "run 2: left out of the discrete" in notices[1]
    runs[0] = NONE
    with pytest.raises(SimulationError, match="run 1: left out"):
        open_loop._simulated(cases, RIG, None, discrete)  # type: ignore[arg-type]


def held_out(monkeypatch: pytest.MonkeyPatch, runs: dict[str, list[FloatArray]]) -> HeldOut:
    """Two held-out tests of four rows, simulated so by each model."""

    def simulated(
        self: HeldOut, model: Any, times: int = 1, *, nan_if_endless: bool = False
    ) -> list[FloatArray]:
        models = [model] * len(self.tests) if isinstance(model, str) else model
        numbers = [int(test.source[-1]) for test in self.tests] * times
        found = [runs[m][n] for m, n in zip(models, numbers, strict=True)]
        if not nan_if_endless and not all(np.isfinite(run).all() for run in found):
            raise SimulationError(NOT_FINITE)
        return found

    def of(number: int) -> Any:
        return SimpleNamespace(
            source=f"test {number}",
            whole=None,
            counted=lambda segment: 4,
            measured_in=lambda segment: np.zeros((3, 4)),
            residual_of=lambda segment, run: -run,
        )

    monkeypatch.setattr(HeldOut, "simulated", simulated)
    return HeldOut(RIG, (of(0), of(1)))


def test_a_held_out_test_without_end_costs_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    outside: Any = held_out(
        monkeypatch, {"given": [ENDS, NONE], "better": [0.5 * ENDS, ENDS], "none": [NONE, NONE]}
    )
    with pytest.raises(SimulationError):
        outside.rmse("given")
    found = outside.simulable(["given", "better", "none"])
    assert [test.source for test in found.tests] == ["test 0"]
    assert found.notices == (f"test 1: is not simulated, and left out of the errors: {NOT_FINITE}",)
    assert found.rmse("given").tolist() == [1.0] * 3 and found.rmse("better").tolist() == [0.5] * 3
    assert outside.simulable(["none"]).tests == outside.tests


def test_a_draw_without_end_costs_that_test_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    outside: Any = held_out(
        monkeypatch,
        {"given": [ENDS, ENDS], "drawn": [3.0 * ENDS, NONE], "none": [NONE, NONE]},
    )
    monkeypatch.setattr("sysid.diagnosis.actuator.holdout.scattered", lambda model, *rest: model)
    noise: Any = SimpleNamespace(total=np.zeros(3))
    draws = outside.draws(["drawn", "none", "given"], "given", noise, Scatter(), 0)
    assert draws.tolist() == [[2.0] * 3, [0.0] * 3]
    with pytest.raises(SimulationError):
        outside.draws(["none"], "given", noise, Scatter(), 0)


def test_a_twins_test_without_end_is_the_logs_own() -> None:
    channels = np.arange(8.0)
    runs = [
        SimpleNamespace(file="a.csv", label="1", rows=slice(0, 4)),
        SimpleNamespace(file="b.csv", label="", rows=slice(4, 8)),
    ]
    traces: Any = SimpleNamespace(
        runs=runs, position=channels, pressure_a=channels, pressure_b=channels
    )
    twin = np.full((3, 8), 100.0)
    twin[0, 1] = np.nan
    assert _take_logs_own(twin, traces) == ["a.csv, test 1"]
    assert np.array_equal(twin[:, :4], np.tile(channels[:4], (3, 1))) and (twin[:, 4:] == 100).all()
    twin[:, [1, 5]] = np.nan
    with pytest.raises(SimulationError):
        _take_logs_own(twin, traces)


# --- how many, and which ------------------------------------------------------------------


def attempt(name: str, gain: float, limits: tuple[str, ...], squares: float = 1.0) -> Any:
    fit = SimpleNamespace(values=np.zeros(5), sum_of_squares=squares)
    fitted = SimpleNamespace(fit=fit, independent_samples=200.0, limits=limits)
    return SimpleNamespace(id=name, reduction=gain), fitted


@pytest.mark.parametrize(
    ("rival", "limits", "chosen"),
    [
        (0.78, (), "stroke-dependent-area"),  # explains about as much, within its range
        (0.60, (), "torque-ripple"),  # explains less
        (0.78, ("area_wave",), "torque-ripple"),  # is at a limit itself
    ],
)
def test_a_shape_at_a_limit_gives_way_to_one_within_its_range(
    rival: float, limits: tuple[str, ...], chosen: str
) -> None:
    passing = [
        attempt("torque-ripple", 0.8, ("ripple_wave_per_m",)),
        attempt("stroke-dependent-area", rival, limits, 1.1),
    ]
    assert preferred(passing)[0].id == chosen


@pytest.mark.parametrize(
    ("effect", "shape", "is_limit"),
    [
        # A line that is wholly shared, and a seal that sees the sum alone.
        (SupplyDroop(1e7, 1.0), "common_share", False),
        (SealFriction(1e-7, 0.0), "difference_share", False),
        (PowerLawFriction(0.1, 0.1), "power_law_exponent", True),
    ],
)
def test_a_limit_that_is_a_form_of_its_own_is_a_value(
    effect: CatalogueEffect, shape: str, is_limit: bool
) -> None:
    assert bool(shapes_at_limits(effect, [f"{effect.id}/{shape}"])) is is_limit


def test_a_shape_at_a_limit_is_said() -> None:
    assert limit_sentence("torque-ripple", (), ("cable-spring",)) == ""
    said = limit_sentence("torque-ripple", ("ripple_wave_per_m",), ("cable-spring",))
    assert "torque-ripple: ripple_wave_per_m ended at a limit" in said and "cable-spring" in said
    spring = led("spring", 0.1 * np.sin(1.5 * np.arange(3000) * 0.004), plain)
    force = spring["motor_force_n"] + 300.0 * spring["position_m"]
    bent = replace(spring, channels={**spring.channels, "motor_force_n": force})
    found = select(axis([bent], RIG), {"torque-ripple": CATALOGUE["torque-ripple"]}, quick=True)
    for one in found.additions:  # less than a period fits a slope only at the longest wave
        assert one.limit_sentence


def test_the_limit_on_effects_is_said() -> None:
    steps: list[Any] = [object()] * MOST_EFFECTS
    assert full_sentence(steps[:-1]) == ""
    assert f"at most {MOST_EFFECTS} effects" in full_sentence(steps)


def test_an_effect_beyond_the_reference_rigs_range_is_read_again() -> None:
    """As a diagnosis of a larger axis, or of a finer ripple, writes it; an absurd one is not."""
    mesh = catalogue()["gear-mesh-ripple"]
    wave = next(q for q in mesh.shapes() if q.is_wave)
    fine = mesh.typical(**{wave.name: 50.0 * wave.upper})
    assert effect_from_entry(entry_of(fine), "e.json", catalogue()) == fine
    strong = CATALOGUE["stribeck-friction"].typical(stribeck_torque_nm=500.0)
    assert effect_from_entry(entry_of(strong), "e.json", CATALOGUE) == strong
    absurd = mesh.typical(**{wave.name: 1e9 * wave.upper})
    with pytest.raises(InputError, match="out of its bounds"):
        effect_from_entry(entry_of(absurd), "e.json", catalogue())


def test_a_speed_that_shapes_an_effect_is_one_of_the_axis() -> None:
    knee = next(q for q in CATALOGUE["stribeck-friction"].shapes() if q.unit == "m/s")
    fast, alike = knee.at_speeds(2.0), knee.at_speeds(0.5 * knee.upper)
    assert fast.upper == 2.0 and max(fast.grid) == 0.8 and fast.lower == knee.lower
    assert alike.upper == knee.upper
    assert knee.at_speeds(1e-3).lower == 1e-5
