"""Open-loop simulation of the motion logs against what was measured.

Every test of every motion log is simulated from an estimated start state with nothing but its
commands, by each valve model that applies: the discrete law under the real pulses and, for
tests under PWM, the mean flow of the two surfaces (thesis 3.8). The residual is judged per
channel: against the channel's own noise, for structure (`residual_tests`), and for how it grows
with the horizon, as an open-loop position drifts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sysid import residual_tests
from sysid.bundle import check_log_unchanged, check_not_fitted
from sysid.campaign import MOTION_KINDS, Campaign, CampaignLog
from sysid.errors import NotIdentifiedError, input_error
from sysid.logs import Log
from sysid.model.effects.serialise import Catalogue
from sysid.model.from_bundle import (
    SURFACE_KINDS,
    has_discrete_law,
    model_from_bundle,
    surfaces_from_bundle,
)
from sysid.model.ports import Model
from sysid.model.sensors import measured_channels, true_start
from sysid.motion_runs import PRESSURES, SIDES, MotionTest, Segment, prepare
from sysid.rig import Rig
from sysid.validation_results import (
    HORIZONS_S,
    ChannelResult,
    Errors,
    HorizonError,
    LogResult,
    TestResult,
    ValidationResult,
    pooled_channels,
)

if TYPE_CHECKING:
    from sysid.model.simulate import Inputs

FloatArray = NDArray[np.float64]

VALIDATED_KINDS = (*MOTION_KINDS, "friction-motion")
DISCRETE = "discrete"
OFFSET_EFFECT = "torque-offset"
VALVE_MODELS = (DISCRETE, *SURFACE_KINDS)
# Runs in one call of the simulator: one compiled shape serves every call.
_LANES = 32
_NO_VALVES = "fit valve-discrete tests of both valves, or valve-pwm tests, into the bundle"

Progress = Callable[[str], None]


@dataclass(frozen=True)
class _Case:
    """One test of one log, prepared."""

    entry: CampaignLog
    log: Log
    test: MotionTest


@dataclass(frozen=True)
class _ValveModel:
    """A model of the valves: its name, and the surfaces (none: the discrete law)."""

    name: str
    surfaces: tuple[Any, ...]

    def applies(self, kind: str) -> bool:
        return not self.surfaces or kind == "motion-pwm"


def validate(
    campaign: Campaign,
    bundle: Mapping[str, Any],
    *,
    bundle_path: Path = Path("bundle.json"),
    kinds: Iterable[str] = VALIDATED_KINDS,
    catalogue: Catalogue | None = None,
    progress: Progress | None = None,
) -> ValidationResult:
    """Simulate every motion log of a campaign open loop with a bundle's parameters.

    The rig is the campaign's: it says what the tests were run with (payload, supply).
    `bundle_path` names the bundle in messages; `catalogue` knows its effects (None: the
    project's own); `progress` is told what is being done. Raises InputError where a log cannot
    be validated (missing channels, gaps, a start in motion), has changed since it was fitted
    on, or is held out though it was fitted on, and for an effect that is not known; and
    NotIdentifiedError where the bundle holds no valve model that applies.
    """
    tell = progress or (lambda line: None)
    rig = campaign.rig
    notices = [*_other_rig(bundle, rig, bundle_path), *_offset(bundle, rig, bundle_path)]
    entries = campaign.select(tuple(kinds), use=None)
    if not entries:
        raise input_error(
            campaign.path,
            "holds no motion log",
            f"add a [[log]] of kind {', '.join(MOTION_KINDS)} to validate on",
        )
    model = model_from_bundle(bundle, rig, str(bundle_path), catalogue)
    valve_models = _valve_models(bundle, rig, model, bundle_path, entries, notices)
    cases: list[_Case] = []
    for entry in entries:
        tell(f"reading {entry.file}")
        cases += _read(campaign, entry, bundle, bundle_path, notices)
    logs: list[LogResult] = []
    for valves in valve_models:
        chosen = [c for c in cases if valves.applies(c.entry.kind)]
        tell(f"simulating {len(chosen)} tests, {valves.name} valve model")
        logs += _logs(_simulated(chosen, rig, model, valves))
    return ValidationResult(tuple(_in_order(logs, entries)), tuple(notices))


def _in_order(logs: Sequence[LogResult], entries: Sequence[CampaignLog]) -> list[LogResult]:
    places = {(e.path.name, e.kind, e.use): i for i, e in reversed(list(enumerate(entries)))}
    return sorted(logs, key=lambda g: places[g.file, g.kind, g.use])


def _other_rig(bundle: Mapping[str, Any], rig: Rig, path: Path) -> list[str]:
    sections = sorted(set(bundle["rig"]) | set(rig.content))
    other = [s for s in sections if bundle["rig"].get(s) != rig.content.get(s)]
    if not other:
        return []
    return [
        f"{path}: fitted with another rig file than {rig.source} "
        f"({', '.join(f'[{s}]' for s in other)} differ); the campaign's is used"
    ]


def _offset(bundle: Mapping[str, Any], rig: Rig, path: Path) -> list[str]:
    """A real offset that the friction fit found is an effect, and not in the base model."""
    if any(effect["id"] == OFFSET_EFFECT for effect in bundle["effects"]):
        return []
    unit = "N" if rig.is_linear else "Nm"
    offset = bundle.get("friction", {}).get(f"offset_{unit.lower()}", {})
    low, high = offset.get("interval", (None, None))
    if low is None or high is None or low <= 0.0 <= high:
        return []
    return [
        f"{path}: the friction tests show an offset of {offset['value']:.3g} {unit}, which the "
        "base model does not have: the position may drift by it"
    ]


def _valve_models(
    bundle: Mapping[str, Any],
    rig: Rig,
    model: Model,
    path: Path,
    entries: Sequence[CampaignLog],
    notices: list[str],
) -> list[_ValveModel]:
    found = []
    if has_discrete_law(model.parameters):
        found.append(_ValveModel(DISCRETE, ()))
    if any(e.kind == "motion-pwm" for e in entries):
        for kind in SURFACE_KINDS:
            surfaces = surfaces_from_bundle(bundle, rig, kind, str(path))
            if surfaces is not None:
                found.append(_ValveModel(kind, surfaces))
    missing = sorted({e.file for e in entries if not any(m.applies(e.kind) for m in found)})
    if len(missing) == len({e.file for e in entries}):
        raise NotIdentifiedError(
            f"{path}: holds no valve model of both valves to simulate {missing[0]} with; "
            f"{_NO_VALVES}"
        )
    absent = [name for name in VALVE_MODELS if name not in {m.name for m in found}]
    if any(e.kind == "motion-pwm" for e in entries) and absent:
        notices.append(f"{path}: holds no {' and no '.join(absent)} model of both valves")
    if missing:
        notices.append(f"{path}: no valve model for {', '.join(missing)}; {_NO_VALVES}")
    return found


def _read(
    campaign: Campaign,
    entry: CampaignLog,
    bundle: Mapping[str, Any],
    bundle_path: Path,
    notices: list[str],
) -> list[_Case]:
    log = campaign.read(entry)
    check_log_unchanged(bundle, log, bundle_path)
    if entry.use == "holdout":
        check_not_fitted(bundle, log, bundle_path)
    notices += log.notices
    cases = []
    for trial in log.trials:
        test = prepare(trial, entry.kind, campaign.rig, max(HORIZONS_S))
        notices += test.notices
        if test.counted(test.whole) < 2:
            notices.append(f"{test.source}: starts at an end stop and is left out")
            continue
        cases.append(_Case(entry, log, test))
    return cases


# --- simulation ------------------------------------------------------------------------


def _simulated(
    cases: Sequence[_Case], rig: Rig, model: Model, valves: _ValveModel
) -> list[tuple[_Case, TestResult]]:
    """Every case's result: whole tests and segments go through the simulator together."""
    segments = [(c.test, s) for c in cases for s in (c.test.whole, *c.test.segments)]
    runs = simulate_segments(segments, model, valves.surfaces, rig.position_channel)
    results, next_run = [], 0
    for case in cases:
        count = 1 + len(case.test.segments)
        own = runs[next_run : next_run + count]
        next_run += count
        results.append((case, _judged(case, rig, valves.name, own[0], own[1:])))
    return results


def simulate_segments(
    segments: Sequence[tuple[MotionTest, Segment]],
    model: Model | Sequence[Model],
    surfaces: tuple[Any, ...] = (),
    position: str = "theta_rad",
) -> list[FloatArray]:
    """Position and pressures (3, rows) of each segment, simulated from its own start state.

    `model` is every segment's, or one each (of the same effects). The results are as the
    sensors show them, and so is the start state, which was measured: both go through the
    `measure` ports of the model's effects, which know the position by the name `position`.
    Effects count time from the test's start.
    Raises RuntimeError where a simulation does not stay finite: never a number in silence.
    """
    from sysid.model.simulate import simulate

    models = [model] * len(segments) if isinstance(model, Model) else list(model)
    inputs = [
        true_start(_inputs(test, s), position, own)
        for (test, s), own in zip(segments, models, strict=True)
    ]
    # Runs of like length share a call: a short one would wait for the longest.
    order = sorted(range(len(inputs)), key=lambda i: len(inputs[i].time))
    found: dict[int, FloatArray] = {}
    for first in range(0, len(order), _LANES):
        group = order[first : first + _LANES]
        padded = [*group, *[group[0]] * (_LANES - len(group))]
        runs = simulate([inputs[i] for i in padded], [models[i] for i in padded], surfaces)
        for i, run in zip(group, runs, strict=False):
            shown = measured_channels(run, position, models[i], inputs[i].elapsed)
            found[i] = np.array([shown[name] for name in (position, *PRESSURES)])
            if not np.isfinite(found[i]).all():
                raise RuntimeError(f"{segments[i][0].source}: the simulation does not stay finite")
    return [found[i] for i in range(len(inputs))]


def _inputs(test: MotionTest, segment: Segment) -> Inputs:
    from sysid.model.simulate import Inputs, ValveCommand

    rows = slice(segment.start, segment.stop)
    valves = [
        None if command is None else ValveCommand(command[rows], test.pulsed, starts_on)
        for command, starts_on in zip(test.commands, segment.starts_on, strict=True)
    ]
    position, velocity, *pressures = segment.state.values
    known = [None if math.isnan(p) else float(p) for p in pressures]
    return Inputs(
        time=test.time[rows],
        motor=test.motor[rows],
        valve_a=valves[0],
        valve_b=valves[1],
        position=float(position),
        velocity=float(velocity),
        pressure_a=known[0],
        pressure_b=known[1],
        elapsed=float(test.time[segment.start] - test.time[0]),
    )


# --- judging ---------------------------------------------------------------------------


def _judged(
    case: _Case, rig: Rig, model: str, whole: FloatArray, parts: Sequence[FloatArray]
) -> TestResult:
    test = case.test
    names = (rig.position_channel, *PRESSURES)
    counted = test.counted(test.whole)
    inputs = _named_inputs(test, rig)
    channels, growth, logged = {}, {}, []
    for i, name in enumerate(names):
        measured = test.measured[i]
        if np.isnan(measured).any():
            continue
        logged.append(i)
        residual = (measured - whole[i])[:counted]
        errors = _segment_errors(test, parts, i)
        growth[name] = _growth(errors, test)
        channels[name] = ChannelResult(
            errors=Errors.of(measured[:counted], residual),
            noise_floor=float(test.noise.total[i]),
            horizons=tuple(_horizon(errors, h, test.period) for h in HORIZONS_S),
            whiteness=residual_tests.whiteness_test(residual),
            inputs=residual_tests.cross_correlation_test(
                residual, {k: u[:counted] for k, u in inputs.items()}
            ),
        )
    return TestResult(
        file=case.entry.path.name,
        kind=case.entry.kind,
        use=case.entry.use,
        test=test.label,
        model=model,
        time=test.time - test.time[0],
        measured={names[i]: test.measured[i] for i in logged},
        simulated={names[i]: whole[i] for i in logged},
        counted=counted,
        channels=channels,
        growth=growth,
        initial=_finite_state(test, rig),
        initial_std=test.whole.state.std,
    )


def _finite_state(test: MotionTest, rig: Rig) -> FloatArray:
    """The start state; a chamber that is not logged starts at the atmosphere."""
    atmosphere = rig.air.atmospheric_pressure_pa if rig.air else math.nan
    return np.nan_to_num(test.whole.state.values, nan=atmosphere)


def _named_inputs(test: MotionTest, rig: Rig) -> dict[str, FloatArray]:
    prefix = "duty" if test.pulsed else "valve"
    inputs = {rig.effort_channel: test.motor}
    for side, command in zip(SIDES, test.commands, strict=True):
        if command is not None:
            inputs[f"{prefix}_{side}"] = command
    return inputs


def _segment_errors(
    test: MotionTest, parts: Sequence[FloatArray], channel: int
) -> list[FloatArray]:
    """Residual of each segment over its counted rows; none for one that starts at a stop."""
    errors = []
    for segment, simulated in zip(test.segments, parts, strict=True):
        rows = test.counted(segment)
        measured = test.measured[channel, segment.start : segment.start + rows]
        errors.append(measured - simulated[channel, :rows])
    return errors


def _horizon(errors: Sequence[FloatArray], horizon: float, period: float) -> HorizonError:
    """Over segments that reach the horizon (those cut by an end stop do not)."""
    rows = round(horizon / period)
    squares = [float(np.mean(e[:rows] ** 2)) for e in errors if len(e) >= rows > 0]
    if not squares:
        return HorizonError(horizon, None, 0)
    return HorizonError(horizon, math.sqrt(float(np.mean(squares))), len(squares))


def _growth(errors: Sequence[FloatArray], test: MotionTest) -> FloatArray:
    rows = round(max(HORIZONS_S) / test.period)
    whole = [e for e in errors if len(e) >= rows]
    return np.sqrt(np.mean(np.square(whole), axis=0)) if whole else np.zeros(0)


def _logs(results: Sequence[tuple[_Case, TestResult]]) -> list[LogResult]:
    """Tests gathered by log, in order, with their errors pooled."""
    groups: dict[tuple[str, str], list[tuple[_Case, TestResult]]] = {}
    for case, result in results:
        groups.setdefault((str(case.entry.path), case.entry.kind), []).append((case, result))
    logs = []
    for group in groups.values():
        case, first = group[0]
        tests = tuple(result for _, result in group)
        logs.append(
            LogResult(
                file=first.file,
                sha256=case.log.sha256,
                kind=first.kind,
                use=first.use,
                model=first.model,
                channels=pooled_channels(tests),
                tests=tests,
            )
        )
    return logs


__all__ = [
    "HORIZONS_S",
    "VALIDATED_KINDS",
    "VALVE_MODELS",
    "ChannelResult",
    "Errors",
    "HorizonError",
    "LogResult",
    "TestResult",
    "ValidationResult",
    "simulate_segments",
    "validate",
]
