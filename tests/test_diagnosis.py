"""The diagnosis' parts: traces, equation errors, whitening, twins, screening, search."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from datasets.generator.campaign import LAB, GeneratedCampaign, Size, drawn_effects, make_campaign
from datasets.generator.one_chamber import scaled
from sysid.diagnosis.actuator import equation_error as equation_errors
from sysid.diagnosis.actuator import finder as finder_module
from sysid.diagnosis.actuator import samples
from sysid.diagnosis.actuator.choked_boundaries import near_boundaries
from sysid.diagnosis.actuator.columns import Proposal
from sysid.diagnosis.actuator.diagnose import (
    _is_beyond_draws,
    _of_fitted_numbers,
    is_far_off,
    with_errors_after_judged,
)
from sysid.diagnosis.actuator.equation_error import (
    BALANCES,
    BREAKAWAY,
    CHANNELS,
    EFFORT,
    FLOW_PARAMETERS,
    _as_shown,
    channels_of,
    equation_error,
)
from sysid.diagnosis.actuator.evidence import TwinEvidence
from sysid.diagnosis.actuator.finder import Finder
from sysid.diagnosis.actuator.fitted_set import (
    FittedSet,
    _log_volume,
    _prior_cost,
    fit_set,
)
from sysid.diagnosis.actuator.holdout import HeldOut
from sysid.diagnosis.actuator.logged_supply import logged_supply
from sysid.diagnosis.actuator.loop import Loop, Memory, close_loop, loop_of
from sysid.diagnosis.actuator.misfit import ResidualChannel
from sysid.diagnosis.actuator.moving_boundaries import moving_boundaries
from sysid.diagnosis.actuator.null_distribution import Null
from sysid.diagnosis.actuator.projection import Projected, channel_squares, projected
from sysid.diagnosis.actuator.refit import Refit, own_columns, refit, with_base_refitted
from sysid.diagnosis.actuator.samples import Rows, Traces, prepare, window_width, windows
from sysid.diagnosis.actuator.screened import Screening, screened
from sysid.diagnosis.actuator.search import search, search_of
from sysid.diagnosis.actuator.signatures import Candidate, Signatures, candidates
from sysid.diagnosis.actuator.starting_friction import with_sliding_friction
from sysid.diagnosis.actuator.states import point_of
from sysid.diagnosis.actuator.twins import (
    Scatter,
    SensorNoise,
    retraced,
    sensor_noise,
    simulate_twins,
)
from sysid.diagnosis.actuator.unexplained import (
    curves,
    faintest,
    imitated,
    leftover,
    remainders,
    repeating,
)
from sysid.diagnosis.actuator.whitening import (
    Frame,
    ResidualNoise,
    build_frame,
    build_windows,
    friction_scatter,
    noise_of,
)
from sysid.diagnosis.evidence import residual
from sysid.diagnosis.result import Diagnosis
from sysid.diagnosis.search_record import Recorder
from sysid.estimation.linear import chi_squared_quantile
from sysid.io.channels import VALVE_COMMANDS
from sysid.io.logs import Trial
from sysid.io.rig import Rig, rig_from_content
from sysid.plant import base as base_law
from sysid.plant.base import ValveParameters, parameters_from_rig
from sysid.plant.effects import catalogue, class_of
from sysid.plant.effects.chamber import (
    AtmosphereLeakage,
    PistonLeakage,
    ThresholdLeakage,
    TubeLag,
    WallHeatTransfer,
)
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.friction import (
    PowerLawFriction,
    QuadraticDrag,
    SealFriction,
    StribeckFriction,
)
from sysid.plant.effects.linkage import InertiaMismatch, LinkFlexibility
from sysid.plant.effects.motor import AmplifierLag, TorqueConstantError, TorqueOffset
from sysid.plant.effects.sensor import PressureLag, PressureOffset, TimeSkew
from sysid.plant.effects.supply import (
    ExhaustBackPressure,
    SupplyDroop,
    SupplyPulsation,
    times_the_usual_flow,
)
from sysid.plant.effects.valve import DutyDeadZone, SubsonicFlowShape, ValveDelay
from sysid.plant.ports import Model
from sysid.recording.motion_tests import prepare_all
from sysid.signals import quantum
from sysid.types import FloatArray, no_progress

SEED = 900
STEMS = (
    "friction_sliding",
    "valve_discrete_a",
    "valve_discrete_b",
    "motion_motor",
    "motion_pwm",
    "motion_discrete",
)
# Two tests of each kind to fit on: enough for an effect of usual size.
TWO_EACH = Size(2, 0, 2, 0.04, (2, 1), (2, 1), (2, 1), slidings=8)
SILENT = SensorNoise((np.zeros(1), np.zeros(1), np.zeros(1)), np.zeros(3))
Tests = list[tuple[str, str, Trial]]


@lru_cache(maxsize=2)
def made(
    *effects: tuple[str, str, float],
    scatter: float = 0.0,
    seed: int = SEED,
    size: Size = LAB,
    stems: tuple[str, ...] = STEMS,
    slower: float = 1.0,
) -> tuple[Tests, Rig, Model]:
    """Tests to fit on of a generated rig, the rig as declared, and its true base model.

    `slower`: everything takes so many times as long. Whoever calls it leaves them as they are: the
    next one has the same.
    """
    campaign: GeneratedCampaign = make_campaign(
        seed, size=size, stems=stems, scatter=scatter, effects=drawn_effects(seed, effects)
    )
    if slower != 1.0:
        campaign = scaled(campaign, time=slower)
    rig = rig_from_content(campaign.rig.content, "rig.toml")
    truth = campaign.truth
    valves = {
        side: ValveParameters(
            choked_fill=v["choked_flow_fill_kg_s"],
            choked_dis=v["choked_flow_dis_kg_s"],
            c_fill=v["c_fill"],
            c_dis=v["c_dis"],
        )
        for side, v in truth["valves"].items()
    }
    friction = truth["friction"]
    parameters = parameters_from_rig(
        rig,
        static_effort=friction["static_nm"],
        coulomb_effort=friction["coulomb_nm"],
        viscous=friction["viscous_nm_s_per_rad"],
        valve_a=valves["a"],
        valve_b=valves["b"],
    )
    tests = [
        (log.stem, log.kind, Trial(t.label, t.columns["time_s"], t.columns, log.stem))
        for log in campaign.logs
        if log.use == "fit"
        for t in log.tests
    ]
    return tests, rig, Model(parameters)


@pytest.fixture(scope="module")
def healthy() -> tuple[Tests, Rig, Model]:
    return made(scatter=0.02)


@pytest.fixture(scope="module")
def traces(healthy: tuple[Tests, Rig, Model]) -> Traces:
    tests, rig, model = healthy
    return prepare(tests, rig, model)


@pytest.fixture(scope="module")
def frame(traces: Traces, healthy: tuple[Tests, Rig, Model]) -> Frame:
    model = healthy[2]
    return build_frame(traces, model, noise_of(traces, model), 0.02)


def test_the_true_model_leaves_noise_only(frame: Frame, healthy: Any) -> None:
    white = frame.residual(healthy[2])
    for name in BALANCES:
        own = white[frame.rows(name)]
        assert len(own) > 1000
        assert np.median(own**2) / 0.455 == pytest.approx(1.0, abs=0.35)
        assert abs(own.mean()) < 0.1


def test_windows_average_the_pulses_out_wherever_a_stretch_begins(moving: Traces) -> None:
    period = 0.005
    ripple = np.cos(2.0 * np.pi * moving.time / period + 0.7)
    rng = np.random.default_rng(4)
    usable = np.ones(len(moving), dtype=bool)
    for run in moving.runs:
        usable[run.rows.start : run.rows.start + int(rng.integers(20, 300))] = False
    whole, cut = windows(moving, usable | True, period), windows(moving, usable, period)
    assert 1000 < len(cut) < len(whole)
    assert np.isin(cut.centre, whole.centre).all()
    assert np.abs(cut.average(ripple)).max() < 1e-9
    # A width that is not a multiple of the period lets the ripple through.
    assert np.abs(windows(moving, usable, 0.0061).average(ripple)).max() > 1e-3


@pytest.mark.parametrize(("period", "width"), [(0.005, 0.02), (1 / 300, 0.02), (0.008, 0.016)])
def test_a_window_is_whole_periods_wide(period: float, width: float) -> None:
    assert window_width(period) == pytest.approx(width)
    assert window_width(0.016) == window_width(1.0) == 0.02
    # Its halves are whole rows: two periods of seven, not three.
    assert window_width(0.007, row=0.001) == pytest.approx(0.014)


@pytest.mark.parametrize(("one", "other"), [(3.0, 30.0), (0.4, 0.04)])
def test_balances_of_a_slow_rig_and_of_a_fast_one_are_alike(one: float, other: float) -> None:
    """Windows of the same rows, and the same residuals in units of their noise."""
    frames, residuals = [], []
    for slower in (one, other):
        tests, rig, model = made(scatter=0.02, size=TWO_EACH, slower=slower)
        own = prepare(tests, rig, model)
        frames.append(build_frame(own, model, noise_of(own, model), 0.02))
        residuals.append(frames[-1].residual(model))
    for name in CHANNELS:
        # What is next to a threshold is rounded to either side of it.
        centres = [frame.windows[name].centre for frame in frames]
        shared, *places = np.intersect1d(*centres, return_indices=True)
        assert len(shared) > 0.999 * max(map(len, centres)) > 0.0
        white, like = (
            residual[frame.rows(name)][place]
            for frame, residual, place in zip(frames, residuals, places, strict=True)
        )
        assert np.corrcoef(white, like)[0, 1] > 0.999
        assert np.mean(like**2) == pytest.approx(np.mean(white**2), rel=0.01)


def test_twins_that_tell_nothing_of_a_channel_leave_what_is_expected_of_it(frame: Frame) -> None:
    """Given an effect's friction a twin may break away where nothing can be read."""
    none = np.zeros(0, dtype=np.intp)
    view = frame.windows[BREAKAWAY]
    unread = replace(
        view, matrix=view.matrix[:0], run=none, stretch=none, centre=none, used=Rows(none)
    )
    bare = replace(frame, windows={**frame.windows, BREAKAWAY: unread})
    rest = np.ones(sum(map(len, frame.windows.values())))
    base, twin = (SimpleNamespace(frame=own, rest=rest[: len(own.tests)]) for own in (frame, bare))
    null: Any = Null([base], {}, lambda of: [twin])  # type: ignore[list-item]
    found = null.given(base).expected(base)
    assert len(view) > 0 and (found[frame.rows(BREAKAWAY)] == 1.0).all()


def test_a_lag_shorter_than_a_slow_rigs_rows_is_followed() -> None:
    """Its states are integrated in steps that the lag allows, however slow the rig."""
    tests, rig, model = made(scatter=0.02, size=TWO_EACH, slower=10.0)
    own = prepare([test for test in tests if test[1] == "motion-discrete"], rig, model)
    assert own.runs[0].period == pytest.approx(0.01) and own.runs[0].time_scale > 5.0
    without = equation_error(own, model, ("rate_a",)).rate_a
    change = equation_error(own, model + TubeLag(1e-3), ("rate_a",)).rate_a - without
    assert 0.0 < np.std(change) < 0.2 * np.std(own.rate_a)


def test_a_fast_rigs_windows_hold_enough_rows() -> None:
    """Valves that fill it so many times as fast do not make its encoder finer."""
    tests, rig, model = made(scatter=0.02, size=TWO_EACH)
    p = model.parameters
    flows = [n for n in FLOW_PARAMETERS if getattr(p, n) is not None]
    fast = Model(p.replace(**{name: 50.0 * getattr(p, name) for name in flows}))
    usual, own = (prepare(tests, rig, one) for one in (model, fast))
    np.testing.assert_allclose(own.velocity, usual.velocity, atol=1e-6)


@pytest.fixture(scope="module")
def moving(healthy: tuple[Tests, Rig, Model]) -> Traces:
    """Traces of eight tests that move: one block of runs, which is compiled once an effect."""
    tests, rig, model = healthy
    wanted = {"friction_sliding": 2, "motion_motor": 1, "motion_pwm": 3, "motion_discrete": 2}
    some = [test for stem, n in wanted.items() for test in [t for t in tests if t[0] == stem][:n]]
    assert len(some) == 8
    return prepare(some, rig, model)


@pytest.fixture(scope="module")
def plain(moving: Traces, healthy: tuple[Tests, Rig, Model]) -> Traces:
    """Their twin of a model without any effect."""
    return twin_of(healthy[2], moving, healthy[1])


@pytest.mark.parametrize(
    "effect",
    [
        SealFriction(2e-7),
        SealFriction(2e-7, 0.0, 0.85, 1.0, 1.0),
        TorqueConstantError(0.05),
        AmplifierLag(0.003),
        PressureLag(0.002),
        # Slower than an inverse by iteration would follow.
        PressureLag(0.0045, "both", 1.0),
        TimeSkew(0.0045),
        PressureOffset(1500.0, side="a"),
        TubeLag(0.002, side="b"),
        WallHeatTransfer(0.4, side="b"),
        # These replace a law, or move where it chokes.
        SubsonicFlowShape(1.0, 1.0, 0.3, 0.5),
        SupplyDroop(1e7),
        ExhaustBackPressure(1.4e7, 0.0),
    ],
    ids=lambda e: e.id,
)
def test_a_model_with_the_effect_explains_a_twin_that_has_it(
    effect: Any, moving: Traces, plain: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    _, rig, model = healthy
    twin = twin_of(model + effect, moving, rig)
    colour = noise_of(plain, model)
    own = build_frame(twin, model, colour, 0.0)
    without, beside = own.residual(model), own.residual(model + effect)
    healthy_sum = float(np.mean(build_frame(plain, model, colour, 0.0).residual(model) ** 2))
    excess = np.mean(without**2) - healthy_sum
    assert excess > 0.05 * healthy_sum
    assert np.mean(beside**2) - healthy_sum < 0.1 * excess


def test_neutral_effects_change_nothing(frame: Frame, healthy: Any) -> None:
    model = healthy[2]
    before = frame.residual(model)
    for effect in (SealFriction, AmplifierLag, PressureLag):
        np.testing.assert_allclose(frame.residual(model + effect.neutral()), before, atol=1e-8)


def test_whitening_takes_the_colour_out(frame: Frame) -> None:
    rng = np.random.default_rng(0)
    view = frame.windows[EFFORT]
    coloured = np.empty(len(view))
    for stretch in np.unique(view.stretch):
        rows = view.stretch == stretch
        coloured[rows] = lfilter([1.0], [1.0, -0.6], rng.standard_normal(rows.sum() + 200))[200:]
    lags = np.arange(7)
    covariance = np.asarray(0.6**lags / (1.0 - 0.36), dtype=np.float64)
    noise = ResidualNoise(dict.fromkeys(CHANNELS, covariance), {})
    from sysid.diagnosis.actuator.whitening import _whitening

    white = _whitening(noise.covariance[EFFORT], view) @ coloured
    assert np.var(white) == pytest.approx(1.0, abs=0.06)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.04


def test_a_tone_of_the_sensors_is_noise_in_the_stretch_that_has_it(frame: Frame) -> None:
    """Counts of an encoder that beat against the sampling at one test's steady speed."""
    from sysid.diagnosis.actuator.whitening import _whitening

    rng, view = np.random.default_rng(3), frame.windows[EFFORT]
    counts = np.bincount(view.stretch)
    toned = view.stretch == int(np.argmax(counts))
    assert toned.sum() > 100

    def noise() -> FloatArray:
        """White, of unit variance, beside a tone of ten times its power in one stretch."""
        phase = 2.0 * np.pi * rng.uniform() + 2.1 * np.arange(len(view))
        return rng.standard_normal(len(view)) + np.where(toned, np.sqrt(20.0) * np.cos(phase), 0.0)

    covariance, left = np.eye(7)[0], noise()
    white = _whitening(covariance, view, noise()) @ left
    assert np.mean((_whitening(covariance, view) @ left)[toned] ** 2) > 8.0
    assert np.mean(white[toned] ** 2) < 2.0
    # What another stretch weighs does not depend on it, nor is any weighed more for a tone.
    assert np.mean(white[~toned] ** 2) == pytest.approx(1.0, abs=0.15)
    step = np.where(toned, 1.0, 0.0)
    plain = np.linalg.norm(_whitening(covariance, view) @ step)
    assert np.linalg.norm(_whitening(covariance, view, noise()) @ step) < 1.1 * plain


def test_windows_never_span_two_tests(traces: Traces, healthy: Any) -> None:
    for view in build_windows(traces, healthy[2]).values():
        first = np.array([run.rows.start for run in traces.runs])[view.run]
        last = np.array([run.rows.stop for run in traces.runs])[view.run]
        assert (view.centre >= first).all() and (view.centre < last).all()
        ones = view.average(np.ones(len(traces)))
        np.testing.assert_allclose(ones, 1.0)


def test_the_scatter_of_friction_is_measured(traces: Traces, healthy: Any) -> None:
    _, rig, model = healthy
    noise = SensorNoise((np.array([1e-5]), np.array([150.0]), np.array([150.0])), np.zeros(3))
    found = []
    for twin in simulate_twins(traces, model, noise, Scatter(0.04, 0.04), 4, 1, rig):
        bare = projected(build_frame(twin, model, noise_of(twin, model), 0.0), model)
        found.append(friction_scatter(bare.frame, bare.rest))
    assert np.mean(found) == pytest.approx(0.04, rel=0.4)


def test_twins_are_the_same_for_a_seed(traces: Traces, healthy: Any) -> None:
    _, rig, model = healthy
    first, second = (
        next(simulate_twins(traces, model, SILENT, Scatter(0.02, 0.02), 1, 5, rig)).position
        for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


def test_sensor_noise_of_coloured_noise(healthy: tuple[Tests, Rig, Model]) -> None:
    tests, rig, _ = healthy
    rng = np.random.default_rng(0)
    white = rng.standard_normal(20_001)
    coloured = 200.0 * (white[1:] + 0.5 * white[:-1]) / np.sqrt(1.25)
    file, kind, trial = tests[0]
    channels = {**trial.channels, "pressure_a_pa": 1e5 + coloured[: len(trial)]}
    long = replace(trial, channels=channels)
    noise = sensor_noise([(file, kind, long)], rig)
    assert noise.total[1] == pytest.approx(200.0, rel=0.08)
    kernel = noise.kernels[1]
    lag_one = float(kernel[1:] @ kernel[:-1]) / float(kernel @ kernel)
    assert lag_one == pytest.approx(0.4, abs=0.08)


def test_an_encoder_has_one_count_however_fast_its_tests_are(
    healthy: tuple[Tests, Rig, Model],
) -> None:
    """Motions that skip counts show none, and pistons that are held no error at all: half a count
    was the mean of both."""
    tests, rig, _ = healthy
    file, kind, trial = tests[0]
    count, rows = 8e-5, np.arange(3000)
    angles = [1e-3 * rows + 1e-7 * rows**2 + 1e-4 * k for k in range(3)]
    angles += [1e-5 * rows, np.zeros(3000), np.zeros(3000), np.zeros(3000)]
    logged = [
        replace(
            trial, time=1e-3 * rows, channels={rig.position_channel: count * np.round(a / count)}
        )
        for a in angles
    ]
    assert [quantum(own[rig.position_channel]) for own in logged] == pytest.approx(
        [0.0, 0.0, 0.0, count, 0.0, 0.0, 0.0]
    )
    noise = sensor_noise([(file, kind, own) for own in logged], rig)
    assert noise.quantum[0] == pytest.approx(count)


def test_position_noise_of_an_interpolated_log_is_correlated(
    healthy: tuple[Tests, Rig, Model],
) -> None:
    """White noise between whose rows two more were put, as `convert --resample` does."""
    tests, rig, _ = healthy
    file, kind, trial = tests[0]
    rows = np.arange(0, len(trial), 3)
    white = 1e-4 * np.random.default_rng(0).standard_normal(len(rows))
    angle = np.interp(np.arange(len(trial)), rows, white)
    channels = {**trial.channels, rig.position_channel: angle}
    between = replace(trial, channels=channels, row_period=3.0 * trial.period)
    (kernel, *_) = sensor_noise([(file, kind, between)], rig).kernels
    lag_one = float(kernel[1:] @ kernel[:-1]) / float(kernel @ kernel)
    assert np.sqrt(kernel @ kernel) == pytest.approx(float(np.std(angle)), rel=0.15)
    # Mean squares at and between rows are 1, 5/9, 5/9; products of neighbours 2/3, 4/9, 2/3.
    assert lag_one == pytest.approx((2 / 3 + 4 / 9 + 2 / 3) / (1 + 5 / 9 + 5 / 9), abs=0.1)


def test_twins_of_an_uneven_log_err_at_its_own_rows(healthy: tuple[Tests, Rig, Model]) -> None:
    tests, rig, model = healthy
    file, kind, trial = tests[0]
    share = 1.0 + 0.25 * np.sin(np.arange(len(trial)) / 50.0)
    stamps = np.cumsum(share) * trial.period
    stamps = trial.time[0] + (stamps - stamps[0]) * np.ptp(trial.time) / np.ptp(stamps)
    rows = np.clip(np.searchsorted(trial.time, stamps + 1e-9) - 1, 0, None)
    channels = {
        name: values[rows] if name in VALVE_COMMANDS else np.interp(stamps, trial.time, values)
        for name, values in trial.channels.items()
    }
    uneven = prepare([(file, kind, replace(trial, time=stamps, channels=channels))], rig, model)
    even = prepare([(file, kind, trial)], rig, model)
    assert even.runs[0].stamps is None and uneven.runs[0].stamps is not None
    noise = SensorNoise((np.array([1e-3]), np.zeros(1), np.zeros(1)), np.zeros(3))
    twins = [
        next(simulate_twins(uneven, model, sensors, Scatter(), 1, 3, rig)).position
        for sensors in (noise, noise, SILENT)
    ]
    np.testing.assert_array_equal(twins[0], twins[1])
    assert 1e-5 < float(np.std(twins[0] - twins[2])) < 1e-3


@pytest.fixture(scope="module")
def nothing_tried(healthy: tuple[Tests, Rig, Model]) -> Loop:
    """A search for no effect where none is missing."""
    return close_loop(*healthy, [], simulated=lambda trial: 0.0)


def explained(base: Projected, found: Refit) -> float:
    """By how much a refit lowers the whitened squares."""
    return float(base.rest @ base.rest - found.rest @ found.rest)


def test_a_refit_finds_the_number(traces: Traces, healthy: tuple[Tests, Rig, Model]) -> None:
    _, rig, model = healthy
    noise = SensorNoise((np.array([1e-5]), np.array([150.0]), np.array([150.0])), np.zeros(3))
    twin = next(simulate_twins(traces, model + AmplifierLag(0.003), noise, Scatter(), 1, 3, rig))
    base = projected(build_frame(twin, model, noise_of(twin, model), 0.0), model)
    found = refit(base, [AmplifierLag(0.001)])
    assert found.fit["amplifier-lag/amplifier_lag_s"] == pytest.approx(0.003, rel=0.05)
    assert explained(base, found) > 100.0


def test_a_number_that_shows_nothing_stays(
    traces: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """As gravity on a level rig: a solver would take it anywhere, and its prior with it."""
    _, rig, model = healthy
    twin = twin_of(model + InertiaMismatch(0.003), traces, rig)
    base = projected(build_frame(twin, model, noise_of(twin, model), 0.0), model)
    (found,) = refit(base, [InertiaMismatch(0.001)]).effects
    assert isinstance(found, InertiaMismatch) and found.gravity_change == 0.0
    assert found.inertia_change_kg_m2 == pytest.approx(0.003, rel=0.1)


def test_an_encoder_behind_the_link_is_told_from_one_on_the_shaft(
    moving: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """In the balances, which a position that swings on its spring enters; a choice stays."""
    _, rig, model = healthy
    true = LinkFlexibility(0.3, 25.0, 0.05, 1.0)
    twin = twin_of(model + true, moving, rig)
    base = projected(build_frame(twin, model, noise_of(twin, model), 0.0), model)
    start = best_form(base, [LinkFlexibility])
    found = refit(base, [start])
    (link,) = found.effects
    assert isinstance(start, LinkFlexibility) and isinstance(link, LinkFlexibility)
    assert start.encoder_on_link == link.encoder_on_link == 1.0
    # The balances show the resonance of the free shaft; share and frequency apart motion does.
    free, expected = (
        one.link_frequency_hz / np.sqrt(1.0 - one.flexible_share) for one in (link, true)
    )
    assert free == pytest.approx(expected, rel=0.02)
    assert found.rest @ found.rest < 0.2 * (base.rest @ base.rest)
    columns = own_columns(base.frame, model + link)
    assert not columns[:, 3].any() and columns[:, :3].any(axis=0).all()


def twin_of(model: Model, traces: Traces, rig: Rig, seed: int = 3) -> Traces:
    """A twin with the usual noise."""
    noise = SensorNoise((np.array([1e-5]), np.array([150.0]), np.array([150.0])), np.zeros(3))
    return next(simulate_twins(traces, model, noise, Scatter(), 1, seed, rig))


def seen_in(
    traces: Traces, true: Model, model: Model, rig: Rig, seed: int = 3, scatter: float = 0.0
) -> Projected:
    """The residual of a model along a twin of another, in the noise of a twin of its own."""
    colour = noise_of(twin_of(model, traces, rig, 20), model)
    return projected(build_frame(twin_of(true, traces, rig, seed), model, colour, scatter), model)


def null_of(traces: Traces, model: Model, rig: Rig) -> Null:
    """What two twins of a model leave."""
    return Null([seen_in(traces, model, model, rig, seed) for seed in (11, 12)], {})


# Effects that are tried beside others: of few, what is not explained lies in few directions.
OTHERS = (
    "mounting-tilt",
    "cable-spring",
    "torque-constant-error",
    "area-error",
    "dead-volume-error",
    "piston-leakage",
    "choked-exhaust-scaling",
    "inertia-mismatch",
)


def finder_of(first: Projected, null: Null, kinds: Sequence[type[CatalogueEffect]]) -> Finder:
    """A search for these effects and a few others."""
    others = [catalogue()[name] for name in OTHERS if name not in {kind.id for kind in kinds}]
    return Finder(first, candidates([*kinds, *others]), null, Recorder(), no_progress)


def one(some: Screening, name: str) -> int:
    """The number of a form of an effect."""
    return next(f for f, form in enumerate(some.forms) if form.id == name)


def squares_alone(
    base: Projected, kinds: Sequence[type[CatalogueEffect]]
) -> tuple[Screening, list[Proposal]]:
    """Each form alone, by its squares: as if all that is left were noise."""
    channels = tuple(
        ResidualChannel(len(base.frame.windows[name]), 1e9, 1.0, float(len(base.rest)))
        for name in CHANNELS
    )
    some = screened(base, candidates(kinds), channels, Recorder())
    return some, some.columns.proposals([(f,) for f in range(len(some.forms))])


def best_form(base: Projected, kinds: Sequence[type[CatalogueEffect]]) -> CatalogueEffect:
    """The form that explains most as it is screened, at its strengths."""
    some, alone = squares_alone(base, kinds)
    (effect,) = some.effects(min(alone, key=lambda one: float(np.sum(one.squares))))
    return effect


def test_a_law_is_found_beside_base_parameters_that_were_fitted_without_it(
    traces: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    _, rig, model = healthy
    twin = twin_of(model + SubsonicFlowShape(1.0, 1.0, 0.3, 0.5), traces, rig)
    p = model.parameters
    off = {f"c_fill_{side}": 1.5 * getattr(p, f"c_fill_{side}") for side in "ab"}
    off |= {f"choked_fill_{side}": 0.93 * getattr(p, f"choked_fill_{side}") for side in "ab"}
    wrong = Model(p.replace(**off))
    base = projected(build_frame(twin, wrong, noise_of(twin, wrong), 0.0), wrong)
    found = refit(base, [SubsonicFlowShape(1.0, 1.0, 0.4, 0.6)])
    (shape,) = found.effects
    assert isinstance(shape, SubsonicFlowShape)
    assert shape.critical_ratio == pytest.approx(0.3, abs=0.04)
    assert shape.exhaust_blend == pytest.approx(1.0, abs=0.05)


def test_what_an_error_of_the_base_parameters_leaves_is_no_structure(
    healthy: tuple[Tests, Rig, Model], nothing_tried: Loop
) -> None:
    """It repeats from test to test, as structure does: the fit's own error is taken out first."""
    tests, rig, model = healthy
    p = model.parameters
    wrong = Model(p.replace(viscous=0.6 * p.viscous, coulomb_effort=1.1 * p.coulomb_effort))
    without = close_loop(tests, rig, wrong, [], simulated=lambda trial: 0.0)
    right, found = (remainders(one, rig)[0] for one in (nothing_tried, without))
    assert found.repeatable <= right.repeatable + 0.05 * right.rmse
    assert found.rmse == pytest.approx(right.rmse, rel=0.05)


def test_slopes_of_the_base_parameters_are_kept_while_they_predict(
    traces: Traces, healthy: tuple[Tests, Rig, Model], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The numbers are those of slopes that are computed at every step."""
    _, rig, model = healthy
    twin = twin_of(model + AtmosphereLeakage(4e-16), traces, rig)
    base = projected(build_frame(twin, model, noise_of(twin, model), 0.0), model)
    counted: list[Model] = []
    original = Frame.residual

    def counting(self: Frame, tried: Model, *channels: Any) -> FloatArray:
        counted.append(tried)
        return original(self, tried, *channels)

    monkeypatch.setattr(Frame, "residual", counting)
    kept = refit(base, [AtmosphereLeakage(1e-16)])
    few = len(counted)
    monkeypatch.setattr("sysid.diagnosis.actuator.refit._PREDICTED", 0.0)
    fresh = refit(base, [AtmosphereLeakage(1e-16)])
    assert few < 0.8 * (len(counted) - few)
    np.testing.assert_allclose(kept.fit.values, fresh.fit.values, rtol=1e-3)
    assert explained(base, kept) == pytest.approx(explained(base, fresh), rel=1e-4)
    assert kept.fit.next_fall() < 1e-4


def test_a_threshold_explains_many_tests_alike(
    traces: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    _, rig, model = healthy
    twin = twin_of(model + DutyDeadZone(8e-4), traces, rig)
    base = projected(build_frame(twin, model, noise_of(twin, model), 0.0), model)
    found = refit(base, [DutyDeadZone(7e-4)])
    gains = np.bincount(base.frame.tests, weights=base.rest**2 - found.rest**2)
    assert found.fit["duty-dead-zone/dead_time_s"] == pytest.approx(8e-4, rel=0.1)
    # A test in which its form is a little off loses next to nothing.
    assert np.all(gains > -1e-3 * gains.max())
    assert np.count_nonzero(gains > 20.0) > 16


def test_counts_that_beat_against_the_sampling_are_no_structure(
    traces: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """What the sensors add along the logs' own motion is expected, though no twin shows it."""
    _, _, model = healthy
    frame = build_frame(traces, model, noise_of(traces, model), 0.0)
    base = projected(frame, model)
    square = float(np.mean(base.rest[frame.rows("effort")] ** 2))
    sensors = {"effort": 2.0 * square}
    plain, known = (Null([base], given).excess(base) for given in ({}, sensors))
    rows = len(base.rest[frame.rows("effort")])
    assert plain["effort"] == pytest.approx(0.0, abs=1e-6)
    assert known["effort"] == pytest.approx(-rows * square)
    assert known["rate_a"] == plain["rate_a"]

    exact = SensorNoise((np.zeros(1), np.zeros(1), np.zeros(1)), np.zeros(3))
    path, shown = retraced(traces, exact, 0)
    np.testing.assert_array_equal(path.acceleration, shown.acceleration)
    counts = replace(exact, quantum=np.array([1e-3, 0.0, 0.0]))
    assert np.std(retraced(traces, counts, 0)[1].acceleration - path.acceleration) > 0.0


def test_beside_an_effect_its_own_twins_say_what_is_expected(
    traces: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """Those of the model without it leave more; how much twins differ is what it was."""
    _, _, model = healthy
    base = projected(build_frame(traces, model, noise_of(traces, model), 0.0), model)
    rough = replace(base, rest=2.0 * base.rest)
    asked: list[Projected] = []

    def twins_of(own: Projected) -> list[Projected]:
        asked.append(own)
        return [base]

    given = Null([rough, replace(base, rest=1.9 * base.rest)], {}, twins_of)
    beside = given.given(base)
    assert asked == [base]
    rows = base.frame.rows("effort")
    assert given.excess(base)["effort"] == pytest.approx(-3.0 * float(np.sum(base.rest[rows] ** 2)))
    assert beside.excess(base)["effort"] == pytest.approx(0.0, abs=1e-6)
    assert beside.spread(base, "effort") == given.spread(base, "effort")
    for none in (lambda own: [], None):
        kept = Null([rough], {}, none)
        assert kept.given(base) is kept


def test_friction_is_weighed_by_the_scatter_that_an_effect_leaves(
    traces: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """A torque's offset looks like scatter: friction would hardly be known beside it."""
    _, rig, model = healthy
    plain = seen_in(traces, model + TorqueOffset(0.03), model, rig)
    spread = friction_scatter(plain.frame, plain.rest)
    assert spread > 0.03
    first = projected(replace(plain.frame, scatter=spread), model)

    def narrowed(start: CatalogueEffect) -> Finder:
        finder, own = finder_of(first, Null([first], {}), ()), frozenset({start.id})
        finder.sets[own] = fit_set(first, finder.channels, [start], finder.none)
        finder._narrow(own)
        # What was fitted in the other frame is not known in this one.
        assert list(finder.sets) == [own]
        return finder

    # What explains nothing of it leaves it as it is.
    assert narrowed(ValveDelay(5e-4, 5e-4, "a")).first is first
    finder = narrowed(TorqueOffset(0.01))
    assert finder.first.frame.scatter < 0.1 * spread
    found = finder.sets[frozenset({"torque-offset"})]
    assert found.refit.fit["torque-offset/offset_nm"] == pytest.approx(0.03, rel=0.01)
    assert len(found.refit.rest) == len(finder.first.rest)
    extended = with_base_refitted(finder.first, finder.model(found.names))
    assert extended.parameters.coulomb_effort == pytest.approx(
        model.parameters.coulomb_effort, rel=0.01
    )


def test_a_search_without_an_effect_does_not_work_out_what_is_known(
    moving: Traces, healthy: tuple[Tests, Rig, Model], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was screened and fitted before is not again, and the same is found."""
    _, rig, model = healthy
    true = model + SealFriction(1e-7) + StribeckFriction(0.12, 0.06, 1.0)
    first, null = seen_in(moving, true, model, rig), null_of(moving, model, rig)
    asked: list[frozenset[str]] = []
    fitted: list[frozenset[str]] = []
    screened_before, fit_before = finder_module.screened, finder_module.fit_set

    def screen(base: Projected, forms: Sequence[Candidate], *others: Any) -> Screening:
        asked.append(frozenset(f.id for f in forms))
        return screened_before(base, forms, *others)

    def fit(base: Projected, channels: Any, starts: Sequence[Any], *others: Any) -> FittedSet:
        fitted.append(frozenset(e.id for e in starts))
        return fit_before(base, channels, starts, *others)

    monkeypatch.setattr(finder_module, "screened", screen)
    monkeypatch.setattr(finder_module, "fit_set", fit)
    kinds = [QuadraticDrag, SealFriction, StribeckFriction]
    finder = finder_of(first, null, kinds)
    before = search(finder, lambda trial: 0.0)
    assert {s.id for s in before.steps} == {"seal-friction", "stribeck-friction"}
    assert asked[0] == {kind.id for kind in kinds} | set(OTHERS) and fitted
    last = before.steps[-1].id
    recorder, rest = Recorder(), [kind for kind in kinds if kind.id != last]
    known = list(fitted)
    asked.clear()
    fitted.clear()
    finder.bar({last}, recorder)
    again = search(finder, lambda trial: 0.0)
    assert set(recorder.screened) == {kind.id for kind in rest} | set(OTHERS)
    assert not any(last in names for names in [*asked, *fitted])
    assert asked[:1] != [{kind.id for kind in rest} | set(OTHERS)] and not set(fitted) & set(known)
    afresh = search(finder_of(first, null, rest), lambda trial: 0.0)
    assert [s.id for s in again.steps] == [s.id for s in afresh.steps]
    for mine, own in zip(again.steps, afresh.steps, strict=True):
        for q in type(mine.effect).quantities:
            assert getattr(mine.effect, q.name) == pytest.approx(getattr(own.effect, q.name))
    assert again.steps[0].id == before.steps[0].id


def test_what_motion_spoke_for_next_to_a_barred_effect_stays_a_rival(
    moving: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """Though the balances prefer another set by far, or had never fitted it alone."""
    _, rig, model = healthy
    true = model + SealFriction(1e-7) + StribeckFriction(0.12, 0.06, 1.0)
    first, null = seen_in(moving, true, model, rig), null_of(moving, model, rig)
    finder = finder_of(first, null, [SealFriction, StribeckFriction])
    both = frozenset({"seal-friction", "stribeck-friction"})
    found = search(finder, lambda trial: 0.0)
    assert {step.id for step in found.steps} == both
    assert all(both < rival.names for rival in found.rivals)
    fewer = frozenset({"stribeck-friction"})
    rival, *_ = search(finder, lambda trial: 0.0, fewer).rivals
    assert rival.names == fewer and rival.behind > 10.0  # not one that is near
    del finder.sets[fewer]
    finder.bar({"seal-friction"}, Recorder(), both)
    assert fewer in finder.sets and not any("seal-friction" in own for own in finder.sets)
    (step,) = search_of(finder, rival).steps
    assert step.id == "stribeck-friction"


def test_an_effect_that_a_later_one_makes_superfluous_is_removed(
    traces: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """Drag was added where seals rub; beside them the tests do not agree on any."""
    _, rig, model = healthy
    first = seen_in(traces, model + SealFriction(3e-7), model, rig)
    finder = finder_of(first, null_of(traces, model, rig), [QuadraticDrag, SealFriction])
    seals, drag = frozenset({"seal-friction"}), frozenset({"quadratic-drag"})
    assert finder.run() == seals
    some = finder._screened[frozenset()]
    (pair,) = some.columns.proposals([tuple(one(some, name) for name in sorted(drag | seals))])
    finder.sets = {}
    finder._fit(None, some, finder.bias, [pair])
    assert list(finder.sets) == [drag | seals]
    finder._without_superfluous(drag | seals)
    assert finder.best() == seals
    left = finder.sets[seals]
    assert left.refit.fit["seal-friction/seal_torque_nm_per_pa"] == pytest.approx(3e-7, rel=0.05)
    assert finder.evidence(seals) > max(finder.evidence(drag), finder.evidence(drag | seals))


@pytest.mark.parametrize("better", ["torque-offset", "asymmetric-coulomb-friction"])
def test_of_rivals_the_one_that_simulates_better_is_named(
    better: str, moving: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """What the balances see of either is nearly the same; one that explains less is no rival."""
    _, rig, model = healthy
    first = seen_in(moving, model + TorqueOffset(0.02), model, rig)
    names = ["torque-offset", "asymmetric-coulomb-friction", "quadratic-drag"]
    finder = finder_of(first, null_of(moving, model, rig), [catalogue()[name] for name in names])
    found = search(finder, lambda trial: -100.0 * ([e.id for e in trial.effects] == [better]))
    evidence = [finder.evidence(frozenset({name})) for name in names[:2]]
    assert evidence[0] == pytest.approx(evidence[1], abs=4.0) and min(evidence) > 20.0
    assert [step.id for step in found.steps] == [better]
    assert set(names[:2]) - {better} <= set(found.steps[0].ambiguous)
    # For which motion with refined numbers may speak all the same.
    rival = search_of(finder, found.rivals[0])
    assert {step.id for step in rival.steps} == found.rivals[0].names == set(names[:2]) - {better}
    own = [finder.evidence(frozenset({one.steps[0].id})) for one in (found, rival)]
    assert rival.behind == pytest.approx(own[0] - own[1])
    weak = search(finder, lambda trial: -1e6 * ([e.id for e in trial.effects] == names[2:]))
    assert weak.steps[0].id in names[:2]


def test_of_effects_that_explain_as_much_one_of_usual_size_is_likeliest(
    moving: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """A tiny number that explains it has to be known far more closely before."""
    _, rig, model = healthy
    first = seen_in(moving, model + AtmosphereLeakage(4e-16), model, rig)
    finder = finder_of(first, null_of(moving, model, rig), [AtmosphereLeakage, ThresholdLeakage])
    finder.run()
    leak = finder.sets[frozenset({"atmosphere-leakage"})]
    (effect,) = leak.effects
    (strength,) = type(effect).strengths()
    fit = leak.refit.fit

    def of_size(share: float) -> float:
        """Its complexity, were its number this share of the usual one and explained as much."""
        ratio = share * abs(strength.typical) / float(getattr(effect, strength.name))
        jacobian = fit.jacobian.copy()
        jacobian[:, 0] /= ratio
        moved = replace(effect, **{strength.name: share * strength.typical})  # type: ignore[type-var]
        own = replace(leak.refit, effects=(moved,), fit=replace(fit, jacobian=jacobian))
        return _prior_cost(own.effects) + _log_volume(own, own.own_slopes())

    assert of_size(1.0) < of_size(0.1) < of_size(0.01)
    assert of_size(10.0) > of_size(1.0) + 50.0
    own = float(getattr(effect, strength.name)) / abs(strength.typical)
    assert of_size(own) == pytest.approx(leak.complexity, rel=1e-6)


@pytest.mark.parametrize(("exponent", "is_bent"), [(1.0, False), (0.7, True)])
def test_a_shape_is_bent_where_the_data_ask_for_it(
    exponent: float, is_bent: bool, moving: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """An effect in its plain form is as likely as one that has no such shapes."""
    _, rig, model = healthy
    first = seen_in(moving, model + SealFriction(4e-7, 0.0, exponent), model, rig)
    finder = finder_of(first, null_of(moving, model, rig), [SealFriction])
    found = fit_set(first, finder.channels, [SealFriction(3e-7)], finder.none)
    (seal,) = found.effects
    free = dict(zip((q.name for q in type(seal).quantities), found.refit.free, strict=True))
    assert not free["breakaway_share"]  # no balance shows it: nothing moves it
    assert free["pressure_exponent"] == is_bent
    assert seal.pressure_exponent == pytest.approx(exponent, abs=0.05 * is_bent)
    strength, difference = type(seal).quantities[:2]
    own = found.refit.own_slopes()[:, :2] * [strength.usual_size, 0.5 * difference.upper]
    plain = float(np.linalg.slogdet(np.eye(2) + own.T @ own)[1])
    volume = _log_volume(found.refit, found.refit.own_slopes())
    assert volume > plain + 0.1 if is_bent else volume == pytest.approx(plain)


@pytest.mark.slow
def test_a_threshold_is_found_between_the_sizes_that_were_screened(
    traces: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """A fit from a shape and size far off ends between the steps."""
    _, rig, model = healthy
    first = seen_in(traces, model + DutyDeadZone(8e-4), model, rig)
    far = refit(first, [DutyDeadZone(2e-4, "both", 1.8, 0.0)])
    finder = finder_of(first, null_of(traces, model, rig), [DutyDeadZone, QuadraticDrag])
    assert finder.run() == {"duty-dead-zone"}
    near = finder.sets[frozenset({"duty-dead-zone"})]
    (found,) = near.effects
    assert isinstance(found, DutyDeadZone) and found.side == "both"
    chambers = [place for place, name in enumerate(CHANNELS) if name.startswith("rate")]
    left = channel_squares(first, far.rest)
    assert np.sum(left[chambers]) > 3.0 * np.sum(near.squares[chambers])
    assert found.dead_time_s == pytest.approx(8e-4, rel=0.08)
    assert found.whole_ratio == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_pulses_are_lost_on_both_sides_where_a_fit_began_with_one_and_shortened_them(
    traces: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """Beside a delay that pulses of every length show, a minimum of its own."""
    _, rig, model = healthy
    true = (ValveDelay(4e-4, 0.0), DutyDeadZone(6e-4, "both", 1.0, 0.0))
    first = seen_in(traces, Model(model.parameters, true), model, rig)
    finder = finder_of(first, null_of(traces, model, rig), [DutyDeadZone, ValveDelay])
    starts = (ValveDelay(1e-4, -3e-4), DutyDeadZone(4e-4, "b", 1.8, 1.0))
    delay, found = fit_set(first, finder.channels, starts, finder.none).effects
    assert isinstance(delay, ValveDelay) and isinstance(found, DutyDeadZone)
    assert found.side == "both"
    # Few pauses lie next to the dead time: what it does to them hardly shows.
    assert found.pause_ratio == pytest.approx(0.0, abs=0.4)
    assert found.whole_ratio == pytest.approx(1.0, abs=0.1)
    assert found.dead_time_s == pytest.approx(6e-4, rel=0.08)
    assert delay.on_delay_s == pytest.approx(4e-4, rel=0.1)


def test_a_threshold_counts_in_a_test_by_all_that_it_changes_there(
    traces: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """The slope of a dead time is that of the few pulses next to it: by it tests would disagree."""
    _, rig, model = healthy
    true = DutyDeadZone(6e-4, "both", 1.0, 0.0)
    first = seen_in(traces, model + true, model, rig)
    lost = refit(first, [true])
    (effect,), count = lost.effects, len(DutyDeadZone.quantities)
    np.testing.assert_array_equal(lost.chords[:, 1:], lost.fit.jacobian[:, 1:])
    kept = lost.fit.values[count:]
    names = lost.fit.names[count:]
    changes = {n: getattr(model.parameters, n) * f for n, f in zip(names, kept, strict=True)}
    base = Model(model.parameters.replace(**changes), ())
    present, absent = (first.frame.residual(m) for m in (base + effect, base))
    changed = first.without_extra((present - absent)[:, None])[:, 0]
    touched = first.frame.belongs(channels_of(effect))
    found = lost.chords[:, 0] * effect.dead_time_s
    np.testing.assert_allclose(found[touched], changed[touched], rtol=1e-6, atol=1e-9)
    assert not np.allclose(lost.chords[:, 0], lost.fit.jacobian[:, 0])


def test_an_effect_of_one_side_leaves_the_other_rate_alone() -> None:
    assert channels_of(AtmosphereLeakage(1e-17, side="a")) == ("rate_a",)
    assert channels_of(AtmosphereLeakage(1e-17)) == ("rate_a", "rate_b")
    assert channels_of(PressureOffset(1e3, side="b")) == ("effort", "rate_b")
    assert channels_of(SealFriction(2e-7)) == ("effort",)


def test_an_effect_that_couples_the_sides_passes_the_other_on(frame: Frame, healthy: Any) -> None:
    model, offset = healthy[2], PressureOffset(1500.0, side="b")
    rows = frame.rows("rate_a")
    alone = frame.residual(model + offset)[rows]
    np.testing.assert_array_equal(alone, frame.residual(model)[rows])
    coupled = model + PistonLeakage(5e-17)
    assert not np.array_equal(frame.residual(coupled + offset)[rows], frame.residual(coupled)[rows])
    assert "rate_a" in channels_of(offset, coupled.effects)


def test_no_window_holds_a_chamber_that_rests_on_the_atmosphere(
    traces: Traces, healthy: Any
) -> None:
    # A law with a root in it, such as ISO 6358's, makes flow of the noise there.
    atmosphere = healthy[2].parameters.atmosphere
    for side in "ab":
        used = build_windows(traces, healthy[2])[f"rate_{side}"].used.index
        near = np.abs(traces.pressure(side)[used] - atmosphere) < 0.009 * atmosphere
        exhausts = getattr(traces, f"open_{side}")[used] < 1.0
        assert len(used) > 1000 and not np.any(near & exhausts)


def test_rows_that_windows_use_give_what_all_rows_give(frame: Frame, healthy: Any) -> None:
    for effect in (PressureLag(0.002), AmplifierLag(0.003), ValveDelay(5e-4, 2e-4)):
        model = healthy[2] + effect
        whole = equation_error(frame.traces, model)
        some = equation_error(frame.traces, model, CHANNELS, frame.rows_used)
        for name in BALANCES:
            np.testing.assert_array_equal(some[name], whole[name][frame.rows_used[name].index])


def test_a_change_of_one_valve_s_times_leaves_the_other_s(
    traces: Traces, healthy: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def counted(runs: Any, model: Model, side: str) -> Any:
        asked.append(side)
        return samples.opening(runs, model, side)

    monkeypatch.setattr(equation_errors, "opening", counted)
    equation_errors.forget()
    late = [
        equation_error(traces, healthy[2] + ValveDelay(d, d, side="a")) for d in (1e-4, 2e-4, 3e-4)
    ]
    assert asked == ["a", "b", "a", "a"]
    np.testing.assert_array_equal(late[0].rate_b, late[2].rate_b)
    assert np.any(late[0].rate_a != late[2].rate_a)


def test_effects_of_averaged_flows_are_not_tried(healthy: tuple[Tests, Rig, Model]) -> None:
    effects = [catalogue()["valve-dead-band"], catalogue()["torque-offset"]]
    found = close_loop(*healthy, effects, simulated=lambda trial: 0.0)
    assert found.record.screened == ("torque-offset",)


def test_strengths_stay_within_their_bounds(frame: Frame, healthy: Any) -> None:
    base = projected(frame, healthy[2])
    form = next(c for c in candidates([SealFriction]))
    column = Signatures(frame, healthy[2], base.residual)(form)
    pushed = replace(base, rest=base.project(base.rest + 5.0 * column[:, 0]))
    # That residual asks for less than no seal friction at all.
    some, alone = squares_alone(pushed, [SealFriction])
    place = some.forms.index(form)
    assert np.all(alone[place].strengths[0] == 0.0) and alone[place].evidence == -np.inf
    np.testing.assert_array_equal(alone[place].squares, some.columns.squares)


def test_both_sides_are_the_sum_of_either(frame: Frame, healthy: Any) -> None:
    forms = {dict(c.shape)["side"]: c for c in candidates([PressureOffset])}
    signatures = Signatures(frame, healthy[2], frame.residual(healthy[2]))
    both = signatures(forms["both"])
    np.testing.assert_allclose(both, signatures(forms["a"]) + signatures(forms["b"]))


def test_every_effect_has_forms() -> None:
    forms = candidates(catalogue().values())
    assert {c.id for c in forms} == set(catalogue())
    assert all(isinstance(c, Candidate) and c.neutral() is not None for c in forms)


# --- the whole loop ----------------------------------------------------------------------

FEW = ("seal-friction", "stribeck-friction", "torque-constant-error", "torque-offset")


def loop(tests: Tests, rig: Rig, model: Model) -> Loop:
    effects = [catalogue()[name] for name in (*FEW, "inertia-mismatch", "piston-leakage")]
    return close_loop(tests, rig, model, effects, simulated=lambda trial: 0.0)


SEALS = ("seal-friction", "sum", 1.0)


@lru_cache(maxsize=2)
def looped(effect: tuple[str, str, float]) -> Loop:
    """What is found where an effect is missing. Whoever calls it leaves it as it is."""
    return loop(*made(effect, scatter=0.02, size=TWO_EACH))


@pytest.mark.parametrize("effect", [PressureLag(2e-3), TimeSkew(1.7e-3), PressureOffset(1e3)])
def test_sensors_show_tests_end_to_end_as_one_by_one(
    traces: Traces, effect: CatalogueEffect, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_once = _as_shown(traces, "a", traces.rate_a, (effect,))
    monkeypatch.setattr(type(effect), "forgets_in_gaps", False)
    one_by_one = _as_shown(traces, "a", traces.rate_a, (effect,))
    assert at_once.any()
    np.testing.assert_allclose(at_once, one_by_one, atol=1e-5 * np.abs(one_by_one).max())


@pytest.mark.parametrize(
    ("effect", "form", "slower", "expected"),
    [
        pytest.param(
            "wall-heat-transfer",
            "mass-state",
            10.0,
            {"wall_conductance_w_per_k": 0.4 / 10.0},
            marks=pytest.mark.slow,
        ),
        # In so few tests its numbers make up for one another, at any speed.
        ("stribeck-friction", "gaussian", 1.0 / 3.0, {}),
    ],
)
def test_an_effect_of_a_slow_rig_or_a_fast_one_is_found(
    effect: str, form: str, slower: float, expected: Mapping[str, float]
) -> None:
    """By its name, its numbers in the ratio of their units: with windows and filters of the
    reference rig neither was."""
    tests = made((effect, form, 1.0), scatter=0.02, size=TWO_EACH, slower=slower)
    suspects = [catalogue()[name] for name in ("wall-heat-transfer", "stribeck-friction")]
    (found,) = close_loop(*tests, suspects, simulated=lambda trial: 0.0).search.last.model.effects
    assert isinstance(found, catalogue()[effect])
    for name, value in expected.items():
        assert float(getattr(found, name)) == pytest.approx(value, rel=0.1), name


def test_nothing_is_found_where_nothing_is_missing(healthy: tuple[Tests, Rig, Model]) -> None:
    found = loop(*healthy)
    assert found.search.steps == ()
    assert leftover(found) == ()
    rests = remainders(found, healthy[1])
    assert repeating(found, rests, (), healthy[1]) == ()
    (entry,) = faintest(found)
    last = found.search.last
    error = equation_error(last.frame.traces, last.model)
    shares = [c.share for name in BALANCES for c in curves(last.frame, error, name)]
    assert entry.share == max(shares)


def test_a_model_whose_every_channel_is_far_off_is_not_adequate() -> None:
    """What happens at rest and at reversals shows in no balance, but in the simulation."""
    floor = np.array([5e-3, 250.0, 250.0])
    assert is_far_off(np.array([0.09, 1480.0, 1120.0]), floor)
    assert is_far_off(np.array([0.09, np.nan, np.nan]), floor)
    assert is_far_off(np.array([np.inf, 1480.0, 1120.0]), floor)
    assert not is_far_off(np.array([0.09, 1480.0, 300.0]), floor)
    assert not is_far_off(np.full(3, np.nan), floor)


def test_numbers_of_another_size_explain_nothing_of_the_balances() -> None:
    evidence = TwinEvidence(looped(SEALS), made(SEALS, scatter=0.02, size=TWO_EACH)[1], ())
    (seal,) = evidence.effects
    assert isinstance(seal, SealFriction)
    found = evidence.loop.search.gains([seal])
    assert found.shape == (1,) and found[0] > 100.0
    assert evidence.unseen([seal]) == []
    strong = replace(seal, seal_torque_nm_per_pa=2.5 * float(seal.seal_torque_nm_per_pa))
    assert evidence.unseen([strong]) == [0]


def test_bench_tests_say_friction_next_to_the_effects_found() -> None:
    """Their balance holds the true friction with the true effect, and no friction that is off."""
    seals = made(SEALS, scatter=0.02, size=TWO_EACH)
    evidence = TwinEvidence(looped(SEALS), seals[1], ())
    rows = evidence.bench_rows()
    assert rows is not None
    assert rows.directions[:2] == ((0, "coulomb_effort"), (0, "viscous"))
    assert {direction[0] for direction in rows.directions} == {0, 1}
    assert rows.left.shape == (2,)
    true = np.array([getattr(seals[2].parameters, name) for _, name in rows.directions[:2]])

    def squares(friction: FloatArray) -> float:
        return float(np.sum((rows.left + rows.slopes[:, :2] @ (friction - rows.values[:2])) ** 2))

    assert squares(true) < chi_squared_quantile(2, 0.999)
    assert squares(1.2 * true) > 100.0
    # With other effects the same tests say another friction.
    assert rows.slopes[:, 2:].any()


def test_effects_that_leave_every_channel_far_off_do_not_explain() -> None:
    """As an exhaust that ices was imitated by three effects; without pressures nothing is said."""
    evidence = TwinEvidence(looped(SEALS), made(SEALS, scatter=0.02, size=TWO_EACH)[1], ())
    errors = [{"theta_rad": 0.21, "pressure_a_pa": 2678.0, "pressure_b_pa": 2508.0}]
    errors += [{"theta_rad": 0.051, "pressure_a_pa": 924.0, "pressure_b_pa": 963.0}]
    floor = {"theta_rad": 0.0074, "pressure_a_pa": 217.0, "pressure_b_pa": 222.0}
    effects = evidence.found(errors)
    found = Diagnosis(effects, residual(errors, floor), (), (), evidence)
    judged = with_errors_after_judged(found)
    assert judged.verdict == "unexplained" and judged.reason == "held-out errors"
    assert [e.id for e in judged.effects] == ["seal-friction"]
    assert len(judged.unexplained) == 1 and "imitate an effect" in judged.notices[-1]
    assert with_errors_after_judged(judged) is judged
    near = residual([errors[0], errors[1] | {"pressure_b_pa": 600.0}], floor)
    position = {"theta_rad": found.residual["theta_rad"]}
    for other in (replace(found, residual=near), replace(found, residual=position)):
        assert with_errors_after_judged(other) is other


def test_one_channel_above_what_fitted_numbers_may_leave_is_far_off() -> None:
    """Below it, the numbers' own errors are said to be what they may be."""
    floor, fitted = np.array([2e-5, 163.0, 162.0]), np.array([2.35e-2, 220.0, 180.0])
    errors = np.array([4.2e-2, 321.0, 216.0])
    rig = make_campaign(SEED, size=LAB, stems=()).rig
    declared = rig_from_content(rig.content, "rig.toml")
    assert not is_far_off(errors, floor, fitted)
    assert is_far_off(errors, floor, fitted / 20.0)
    assert is_far_off(np.array([4.2e-2, np.nan, np.nan]), floor, fitted / 20.0)
    assert not is_far_off(np.full(3, np.nan), floor, fitted)
    (line,) = _of_fitted_numbers(errors, floor, fitted, declared)
    assert line.startswith("position: 42.0 mrad") and "(23.5 mrad by" in line
    assert list(_of_fitted_numbers(errors, floor, None, declared)) == []
    assert list(_of_fitted_numbers(floor, floor, fitted, declared)) == []


def test_the_floor_of_fitted_numbers_is_that_of_their_errors(
    healthy: tuple[Tests, Rig, Model],
) -> None:
    """Viscous friction one per cent up and down: as far as the simulations are from the middle."""
    tests, rig, model = healthy
    motion = [t for stem, kind, t in tests if kind == "motion-motor"]
    own = HeldOut(rig, tuple(prepare_all(motion, "motion-motor", rig, 1.0)[0]))
    p = model.parameters
    drawn = [Model(p.replace(viscous=p.viscous * f)) for f in (0.99, 1.01)]
    floor = own.fitted_floor(drawn, model, SILENT, Scatter(), 0)
    nominal = own.simulated(model)
    counts = [t.counted(t.whole) for t in own.tests]
    squares = [
        np.sum((run - here)[:, :n] ** 2, axis=1)
        for one in drawn
        for run, here, n in zip(own.simulated(one), nominal, counts, strict=True)
    ]
    assert floor == pytest.approx(np.sqrt(np.sum(squares, axis=0) / (2 * sum(counts))))
    assert floor[0] > 1e-4
    assert own.fitted_floor([model], model, SILENT, Scatter(), 0) == pytest.approx(np.zeros(3))
    draws = own.draws(drawn, model, SILENT, Scatter(), 0)
    single = [own.fitted_floor([one], model, SILENT, Scatter(), 0) for one in drawn]
    np.testing.assert_allclose(draws, single)


def test_an_error_that_one_of_many_draws_shows_is_no_structure(
    healthy: tuple[Tests, Rig, Model],
) -> None:
    """Friction that scatters may send one test elsewhere, seldom, and far."""
    tests, rig, model = healthy
    motion = [t for stem, kind, t in tests if kind == "motion-motor"]
    own = HeldOut(rig, tuple(prepare_all(motion, "motion-motor", rig, 1.0)[0]))
    loop: Any = SimpleNamespace(noise=SILENT, scatter_after=Scatter(0.02, 0.02))
    draws = own.draws([model] * 128, model, SILENT, loop.scatter_after, 1)
    largest = draws.max(axis=0)
    assert not _is_beyond_draws(1.4 * largest, own, model, loop, [], 0)
    assert not _is_beyond_draws(1.4 * largest, own, model, loop, [model] * 16, 0)
    assert _is_beyond_draws(1.6 * largest, own, model, loop, [], 0)
    assert _is_beyond_draws(np.array([np.nan, 1.6 * largest[1], np.nan]), own, model, loop, [], 0)


def added(campaign: tuple[Tests, Rig, Model], names: Sequence[str], rises: float) -> list[str]:
    """Ids of what the loop adds of these effects, each of which makes motion so much less likely.

    Twice the logarithm of how much.
    """
    effects = [catalogue()[name] for name in names]
    found = close_loop(*campaign, effects, simulated=lambda trial: rises * len(trial.effects))
    return [step.id for step in found.search.steps]


def test_a_rival_that_the_balances_do_not_tell_apart_is_found_too() -> None:
    """An offset of the torque is an asymmetry of friction wherever the shaft moves."""
    offsets = (("torque-offset", "constant", 1.0), ("pressure-offset", "constant", 1.0))
    campaign = made(*offsets, size=TWO_EACH)
    names = ["torque-offset", "asymmetric-coulomb-friction", "pressure-offset"]
    effects = [catalogue()[name] for name in names]
    memory = Memory()
    found = close_loop(*campaign, effects, simulated=lambda trial: 0.0, memory=memory)
    (other,) = found.search.rivals
    rival_loop = loop_of(other, found, memory)
    assert rival_loop.scatter == found.scatter and rival_loop.record == found.record
    rival = rival_loop.search
    pairs = list(zip(found.search.steps, rival.steps, strict=True))
    (named,) = [pair for pair in pairs if pair[0].id != pair[1].id]
    assert {step.id for step in named} == set(names[:2])
    assert named[0].id in named[1].ambiguous and named[1].id not in named[1].ambiguous
    assert named[1].id in named[0].ambiguous and named[0].id not in named[0].ambiguous
    assert rival.joint and found.search.joint
    assert [e.id for e in rival.joint.effects] == [step.id for step in rival.steps]
    assert [r.added.id for r in rival.rounds if r.added] == [step.id for step in rival.steps]
    first = found.search.first
    gains = [explained(first, one.joint) for one in (rival, found.search) if one.joint]
    assert gains[0] == pytest.approx(gains[1], rel=1e-3)
    assert all(s.model.effects for s in rival.steps)
    assert {e.id for e in rival.model.effects} == {step.id for step in rival.steps}


@pytest.mark.parametrize(
    ("size", "tests", "rises", "count"),
    [
        (0.005, LAB, 0.0, 0),
        (0.005, LAB, -100.0, 0),
        (1.0, TWO_EACH, 0.0, 1),
        (1.0, TWO_EACH, 100.0, 1),
    ],
)
def test_motion_adds_no_effect_that_the_balances_do_not_show(
    size: float, tests: Size, rises: float, count: int
) -> None:
    """What they show of a tiny effect may be another misfit; of a usual one they are sure."""
    campaign = made(("torque-offset", "constant", size), size=tests)
    assert len(added(campaign, ["torque-offset"], rises)) == count


@pytest.mark.parametrize(
    ("effect", "is_right"),
    [
        (SEALS, lambda step: step.id == "seal-friction"),
        (
            ("torque-offset", "constant", 1.0),
            lambda step: class_of("torque-offset") - {step.id} == set(step.ambiguous),
        ),
    ],
)
def test_an_effect_is_found_and_named(
    effect: tuple[str, str, float], is_right: Callable[[Any], bool]
) -> None:
    found = looped(effect)
    assert len(found.search.steps) == 1
    assert is_right(found.search.steps[0])
    assert leftover(found) == ()


@pytest.mark.slow
def test_the_log_of_the_supply_tells_what_acts_on_it_from_its_rivals() -> None:
    tests, rig, model = made(("supply-droop", "coupled", 1.0), size=TWO_EACH)
    tried = [catalogue()[name] for name in ("supply-droop", "choked-exhaust-scaling")]

    def rivals(own: Tests) -> tuple[str, ...]:
        found = close_loop(own, rig, model, tried, simulated=lambda trial: 0.0)
        # A line that droops is as much noise to a twin as any other.
        assert all(max(found.null.sums[name]) < 2.0 for name in BALANCES)
        (step,) = found.search.steps
        assert step.id == "supply-droop"
        return tuple(step.ambiguous)

    unlogged = [
        (file, kind, replace(trial, channels=_without(trial.channels, "supply_pressure_pa")))
        for file, kind, trial in tests
    ]
    assert rivals(unlogged) == (
        "atmosphere-leakage",
        "choked-exhaust-scaling",
        "subsonic-flow-shape",
    )
    assert rivals(tests) == ()


def _without(channels: Mapping[str, FloatArray], name: str) -> dict[str, FloatArray]:
    return {key: values for key, values in channels.items() if key != name}


def test_a_sensor_upstream_of_what_the_supply_loses_says_nothing(
    traces: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """A steady log does not contradict a droop behind it."""
    log = logged_supply(traces, healthy[2])
    assert log is not None
    assert abs(log.gain([SupplyDroop(1.3e7)])) < 3.0
    assert log.gain([SealFriction(1e-7)]) == 0.0
    for silent in (np.nan, 3e5):
        column = np.full(len(traces), silent)
        assert logged_supply(replace(traces, logged_supply=column), healthy[2]) is None


@pytest.mark.parametrize(
    ("second", "names"),
    [
        (("piston-leakage", "quadratic", 1.0), {"seal-friction", "piston-leakage"}),
        (("piston-leakage", "quadratic", 1e-9), {"seal-friction"}),
    ],
)
def test_a_second_effect_is_added_only_where_there_is_evidence_for_it(
    second: tuple[str, str, float], names: set[str]
) -> None:
    campaign = made(("seal-friction", "sum", 1.0), second, size=TWO_EACH)
    tried = ["seal-friction", "torque-offset", "piston-leakage"]
    assert set(added(campaign, tried, 0.0)) == names


def test_what_no_effect_explains_is_said() -> None:
    tests, rig, model = made(("friction-warm-up", "decay", 1.0), size=TWO_EACH)
    found = loop(tests, rig, model)
    entries = leftover(found)
    assert [entry.channel for entry in entries] == ["effort"]
    assert 0.0 < entries[0].share <= 1.0
    assert len(entries[0].centres) == len(entries[0].means) > 3
    assert repeating(found, remainders(found, rig), entries, rig) == ()


def test_effects_that_imitate_a_law_of_one_quantity_explain_nothing() -> None:
    """An eddy brake's torque falls again above a speed: no friction of the catalogue does."""
    campaign = made(("eddy-brake", "peak", 4.0), size=TWO_EACH)
    found = close_loop(*campaign, [], simulated=lambda trial: 0.0)
    first = found.search.first
    steps: Any = (QuadraticDrag(0.004), PowerLawFriction(0.25, 0.1))
    model = Model(first.model.parameters, steps)
    last = projected(first.frame, model)
    other = replace(found, search=replace(found.search, steps=steps, model=model, last=last))
    (curve,) = imitated(other)
    assert (curve.channel, curve.regressor) == ("effort", "velocity")
    assert 0.2 < curve.share < 1.0
    assert imitated(found) == ()
    assert imitated(looped(SEALS)) == ()


@pytest.mark.parametrize(
    ("effect", "named"),
    [
        (("mains-hum", "sine", 1.0), []),
        # A misfit of which hum explains nearly all counts as few draws.
        (("mains-hum", "sine", 4.0), []),
        pytest.param(
            ("link-flexibility", "arm", 1.0), ["link-flexibility"], marks=pytest.mark.slow
        ),
    ],
)
def test_hum_is_no_resonance(effect: tuple[str, str, float], named: list[str]) -> None:
    """It goes on whatever the motion does; a link rings with it."""
    tests, rig, model = made(effect, scatter=0.02, size=TWO_EACH)
    link = catalogue()["link-flexibility"]
    found = close_loop(tests, rig, model, [link], simulated=lambda trial: 0.0)
    assert [step.id for step in found.search.steps] == named
    notes = found.record.sentences()
    assert [line.startswith("not link-flexibility") for line in notes] == [True] * (not named)
    assert all(" 50.0 Hz" in line for line in notes)
    assert [entry.channel for entry in leftover(found)] == ["effort"] * (not named)


def test_what_repeats_is_structure_where_it_is_large(
    healthy: tuple[Tests, Rig, Model], nothing_tried: Loop
) -> None:
    """More than the noise and than a tenth of what there was, of a new channel."""
    rig, found = healthy[1], nothing_tried
    effort, *rates = remainders(found, rig)
    twice = replace(effort, repeatable=2.0 * effort.rmse, noise=effort.rmse, agreeing=effort.tests)
    (curve,) = repeating(found, [twice, *rates], (), rig)
    assert curve.channel == EFFORT
    assert repeating(found, [twice, *rates], (curve,), rig) == ()
    small = replace(twice, repeatable=0.05 * effort.rmse, noise=0.0)
    assert repeating(found, [small], (), rig) == ()


def test_effects_that_the_bundle_holds_stay_in_the_model() -> None:
    injected = (("seal-friction", "sum", 1.0), ("torque-constant-error", "gain", 1.0))
    tests, rig, model = made(*injected, size=TWO_EACH)
    given = SealFriction(2e-7)
    effects = [catalogue()[name] for name in ("torque-constant-error", "torque-offset")]
    found = close_loop(tests, rig, model + given, effects, simulated=lambda trial: 0.0)
    assert [step.id for step in found.search.steps] == ["torque-constant-error"]
    assert found.search.model.effects[0] == given
    assert [e.id for e in found.search.model.effects] == ["seal-friction", "torque-constant-error"]


def test_friction_that_the_bench_has_far_off_is_begun_with_as_motion_shows_it(
    moving: Traces, healthy: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Below 0 by an effect, and so 0 in the model: a power law would be found in its place."""
    model = healthy[2]
    p = model.parameters
    assert with_sliding_friction(moving, model) is model
    without = Model(p.replace(viscous=0.0, coulomb_effort=1.8 * p.coulomb_effort))
    found = with_sliding_friction(moving, without).parameters
    assert found.viscous == pytest.approx(p.viscous, rel=0.1)
    assert found.coulomb_effort == without.parameters.coulomb_effort
    far = with_sliding_friction(moving, Model(p.replace(coulomb_effort=4.0 * p.coulomb_effort)))
    assert far.parameters.coulomb_effort == pytest.approx(p.coulomb_effort, rel=0.1)
    # Where an effect hides it from motion too, it begins where a refit reaches what it may be.
    hidden = Model(p.replace(viscous=0.0), (QuadraticDrag(0.1),))
    begun = with_sliding_friction(moving, hidden)
    assert begun.effects == hidden.effects
    assert 0.2 * p.viscous < float(begun.parameters.viscous) < 5.0 * p.viscous
    given = ("sysid.diagnosis.actuator.starting_friction._VISCOUS_SHARE", 0.6)
    monkeypatch.setattr(*given)
    more = with_sliding_friction(moving, hidden)
    assert float(more.parameters.viscous) == pytest.approx(2.0 * float(begun.parameters.viscous))


@pytest.mark.slow
def test_an_effect_that_imitates_two_gives_way_to_them() -> None:
    """Valves that close sooner and do not follow short pulses: one that sticks explains more than
    either alone."""
    campaign = made(("valve-delay", "off", 1.0), ("duty-dead-zone", "partial", 1.0), seed=1023)
    tried = ["sticking-valve", "valve-delay", "duty-dead-zone"]
    assert set(added(campaign, tried, 0.0)) == {"valve-delay", "duty-dead-zone"}


def test_what_may_move_a_choked_boundary_leaves_out_what_is_between(
    moving: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    """At the boundary the base law jumps: a droop that moves it is found only without that."""
    _, rig, model = healthy
    droop = SupplyDroop(1.3e7, 0.0)
    twin = twin_of(model + droop, moving, rig)
    plain = near_boundaries(twin, model, "a", ())
    wide = near_boundaries(twin, model, "a", (SupplyDroop(3e7, 0.0),))
    fill = base_law.filling_boundary(twin.supply)
    lost = np.asarray(drooped_filling_flow_at(twin, model, 3e7)) * 3e7
    between = (twin.pressure_a > base_law.filling_boundary(twin.supply - lost)) & (
        twin.pressure_a < fill
    )
    assert np.all(wide[between & (twin.open_a > 0.0)])
    assert np.all(wide[plain]) and 0 < np.count_nonzero(wide & ~plain) < 0.2 * len(wide)

    forms = candidates([SupplyDroop, ExhaustBackPressure, SupplyPulsation])
    found = may_move(twin, model, forms)
    assert "supply-droop" in [e.id for e in found]
    assert all(isinstance(e, SupplyDroop | ExhaustBackPressure) for e in found)
    (largest,) = (e.droop_pa_s_per_kg for e in found if isinstance(e, SupplyDroop))
    assert 1.3e7 < largest < 6e7
    assert may_move(twin_of(model, moving, rig), model, forms) == ()
    # However much the other chamber's balance lacks.
    leaking = twin_of(
        model + SupplyDroop(1.3e7, 0.0) + AtmosphereLeakage(1e-13, side="a"), moving, rig
    )
    assert "supply-droop" in [e.id for e in may_move(leaking, model, forms)]


def test_what_is_tried_of_a_back_pressure_follows_the_rigs_flow(
    healthy: tuple[Tests, Rig, Model],
) -> None:
    """Per flow or its square: a rig with ten times the flow has as much at a tenth, a hundredth."""
    own = healthy[2].parameters

    def tried(times: float) -> FloatArray:
        grown = {
            n: times * getattr(own, n) for s in "ab" for n in (f"choked_dis_{s}", f"c_dis_{s}")
        }
        flows = times_the_usual_flow(replace(own, **grown))
        assert flows == pytest.approx(times * times_the_usual_flow(own))
        forms = candidates([ExhaustBackPressure], flows=flows)
        return np.unique([step for form in forms for _, step in form.steps])

    usual = tried(1.0)
    assert 1.0 / 1.5 < times_the_usual_flow(own) < 1.5 and len(usual) == 3
    times = 10.0 * times_the_usual_flow(own)
    assert tried(10.0) == pytest.approx(np.sort(np.concatenate([usual / times, usual / times**2])))


def test_a_wave_may_move_a_choked_boundary_to_either_side_at_any_time(
    moving: Traces, healthy: tuple[Tests, Rig, Model]
) -> None:
    _, rig, model = healthy
    wave = SupplyPulsation(9e3, -6e3, 1.3)
    twin = twin_of(model + wave, moving, rig)
    forms = candidates([SupplyDroop, ExhaustBackPressure, SupplyPulsation])
    found = [e for e in may_move(twin, model, forms) if isinstance(e, SupplyPulsation)]
    assert len(found) == 4
    point: Any = point_of(twin, model)
    supplies = [e.supply_pressure(twin.supply, "a", point) for e in found]  # type: ignore[arg-type]
    true = np.asarray(wave.supply_pressure(twin.supply, "a", point))  # type: ignore[arg-type]
    moved = np.abs(true - twin.supply)
    assert np.all(np.max(supplies, axis=0) > twin.supply + moved)
    assert np.all(np.min(supplies, axis=0) < twin.supply - moved)
    low, high = np.sort(base_law.filling_boundary(np.array([twin.supply, true])), axis=0)
    between = (twin.pressure_a > low) & (twin.pressure_a < high)
    wide = near_boundaries(twin, model, "a", found)
    assert np.any(between) and np.all(wide[between & (twin.open_a > 0.0)])


def may_move(twin: Traces, model: Model, forms: Sequence[Candidate]) -> tuple[CatalogueEffect, ...]:
    """What may move a choked boundary in a twin of the logs."""
    colour = noise_of(twin, model)

    def away(moving: Sequence[CatalogueEffect]) -> Projected:
        return projected(build_frame(twin, model, colour, 0.0, tuple(moving)), model)

    return moving_boundaries(away(()), forms, away)


def drooped_filling_flow_at(traces: Traces, model: Model, droop: float) -> FloatArray:
    """Choked flow of valve A at a drooped supply, kg/s (n,)."""
    p = model.parameters
    return np.asarray(
        p.choked_fill_a * traces.supply / (p.supply_reference + droop * p.choked_fill_a)
    )
