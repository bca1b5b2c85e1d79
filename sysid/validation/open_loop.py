"""Open-loop simulation of the motion logs compared with the measurements.

Every test of every motion log is simulated from an estimated start state, given only its
commands, by each valve model that applies: the discrete law under the real pulses and, for
tests under PWM, the mean flow of the averaged law and of the two surfaces (thesis 3.8). The
residual is judged per channel: against the channel's own noise, for structure
(`residual_tests`), and for how it grows with the horizon, as an open-loop position drifts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sysid.errors import (
    Failure,
    InputError,
    NotIdentifiedError,
    SimulationError,
    error_of,
    input_error,
    on_its_own,
)
from sysid.io.campaign import MOTION_KINDS, SIMULATED_KINDS, Campaign, CampaignLog
from sysid.io.logs import Log
from sysid.io.rig import Rig
from sysid.parameters import Bundle
from sysid.parameters.assembled_model import (
    DISCRETE,
    MEAN_FLOW_MODELS,
    VALVE_MODELS,
    assumed_parameters,
    fitted_inertia,
    surfaces_from_bundle,
)
from sysid.parameters.fitted_logs import check_log
from sysid.plant.effects.entry import Catalogue
from sysid.plant.ports import Model, has_discrete_law
from sysid.recording.motion_tests import MotionTest, prepare_all
from sysid.recording.simulation import NOT_FINITE, simulate_segments
from sysid.types import Progress
from sysid.validation.judging import judged
from sysid.validation.results import (
    HORIZONS_S,
    LogResult,
    TestResult,
    ValidationResult,
    pooled_channels,
)

_OFFSET_EFFECT = "torque-offset"
_ALONE = "; a cylinder without valves is judged by `sysid diagnose`, on its held-out tests"
_NO_VALVES = "fit valve-discrete tests of {}{} into the bundle"


@dataclass(frozen=True)
class _Case:
    """One test of one log, prepared; `name` is the log's in its campaign."""

    name: str
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
    bundle: Bundle,
    *,
    kinds: Iterable[str] = SIMULATED_KINDS,
    catalogue: Catalogue | None = None,
    progress: Progress | None = None,
) -> ValidationResult:
    """Simulate every motion log of a campaign open loop with a bundle's parameters.

    The rig is the campaign's: it describes the tests' conditions (payload, supply).
    `catalogue` holds the bundle's effects (None: the project's own); `progress` receives a line for
    each step. A log that cannot be validated (missing channels, gaps, a start in motion), and a
    valve model that cannot be simulated, is skipped with a notice. Raises InputError if no log can
    be validated, if a log has changed since it was fitted, or is held out although it was fitted,
    and for an unknown effect; NotIdentifiedError if the bundle holds no valve model that applies,
    or none can be simulated.
    """
    tell = progress or (lambda line: None)
    rig = campaign.rig
    notices = [*bundle.other_rig(rig), *_offset(bundle, rig), *assumed_parameters(bundle, rig)]
    rig.require_motion()
    entries = campaign.select(tuple(kinds), use=None)
    if not entries:
        raise input_error(
            campaign.path,
            "holds no motion log",
            f"add a [[log]] of kind {', '.join(MOTION_KINDS)} to validate on",
        )
    model = bundle.model(rig, catalogue)
    valve_models = _valve_models(bundle, rig, model, entries, notices)
    cases: list[_Case] = []
    failed: list[Failure] = []
    for entry in entries:
        tell(f"reading {entry.file}")
        own = _read(campaign, entry, bundle, notices)
        if isinstance(own, Failure):
            failed.append(own)
        else:
            cases += own
    if failed and not cases:
        raise _none_usable(failed)
    notices += [f"excluded: {why.reason}" for why in failed]
    logs: list[LogResult] = []
    failed = []
    for valves in valve_models:
        chosen = [c for c in cases if valves.applies(c.entry.kind)]
        tell(f"simulating {len(chosen)} tests, {valves.name} valve model")
        results = on_its_own(partial(_simulated, chosen, rig, model, valves))
        if isinstance(results, Failure):
            failed.append(results)
            notices.append(f"the {valves.name} valve model is excluded: {results.reason}")
        else:
            logs += _logs(results[0])
            notices += results[1]
    if failed and not logs:
        raise _none_usable(failed)
    return ValidationResult(tuple(_in_order(logs, campaign, entries)), tuple(notices))


def _none_usable(failed: Sequence[Failure]) -> Exception:
    """The error where nothing can be simulated, with each reason once."""
    return error_of(failed, "; ".join(dict.fromkeys(why.reason for why in failed)))


def _in_order(
    logs: Sequence[LogResult], campaign: Campaign, entries: Sequence[CampaignLog]
) -> list[LogResult]:
    places = {(campaign.name_of(e.path), e.kind): i for i, e in reversed(list(enumerate(entries)))}
    return sorted(logs, key=lambda g: places[g.name, g.kind])


def _offset(bundle: Bundle, rig: Rig) -> list[str]:
    """A significant offset in the friction fit is an effect, which the base model lacks."""
    if rig.is_motor_alone or any(effect.id == _OFFSET_EFFECT for effect in bundle.effects):
        return []
    friction = bundle.friction
    if friction is None:
        return []
    unit, offset = rig.units.effort, friction.offset
    if offset is None or not all(map(math.isfinite, offset.interval)) or offset.holds(0.0):
        return []
    return [
        f"{bundle.source}: the friction tests show an offset of {offset.value:.3g} {unit}, which "
        "the base model does not have: the position may drift because of it"
    ]


def _valve_models(
    bundle: Bundle,
    rig: Rig,
    model: Model,
    entries: Sequence[CampaignLog],
    notices: list[str],
) -> list[_ValveModel]:
    found = []
    if has_discrete_law(model.parameters):
        found.append(_ValveModel(DISCRETE, ()))
    if rig.pwm and any(e.kind == "motion-pwm" for e in entries):
        for kind in MEAN_FLOW_MODELS:
            try:
                surfaces = surfaces_from_bundle(bundle, rig, kind)
            except InputError as error:
                if not found:
                    raise
                notices.append(f"{error}; the {kind} model is excluded")
                continue
            if surfaces is not None:
                found.append(_ValveModel(kind, surfaces))
    missing = sorted({e.file for e in entries if not any(m.applies(e.kind) for m in found)})
    or_pwm = ", or valve-pwm tests," if rig.has_pwm_surfaces else ""
    lacking = _NO_VALVES.format(rig.all_valves, or_pwm)
    if len(missing) == len({e.file for e in entries}):
        raise NotIdentifiedError(
            f"{bundle.source}: holds no valve model of {rig.all_valves} to simulate {missing[0]} "
            f"with; {lacking}{'' if rig.valves else _ALONE}"
        )
    absent = [name for name in VALVE_MODELS if name not in {m.name for m in found}]
    if any(e.kind == "motion-pwm" for e in entries) and absent and rig.has_pwm_surfaces:
        notices.append(
            f"{bundle.source}: holds no {' and no '.join(absent)} model of {rig.all_valves}"
        )
    if missing:
        notices.append(f"{bundle.source}: no valve model for {', '.join(missing)}; {lacking}")
    return found


def _read(
    campaign: Campaign,
    entry: CampaignLog,
    bundle: Bundle,
    notices: list[str],
) -> list[_Case] | Failure:
    """The tests of a log that can be simulated; why none can. Raises InputError for a log that
    has changed."""
    log = campaign.read(entry)
    check_log(bundle, log, entry.kind, entry.use)
    notices += log.notices
    cases = []
    inertia = fitted_inertia(bundle)
    horizon = max(HORIZONS_S)
    tests = on_its_own(partial(prepare_all, log.trials, entry.kind, campaign.rig, horizon, inertia))
    if isinstance(tests, Failure):
        return tests
    notices += tests[1]
    for test in tests[0]:
        notices += test.notices
        if test.counted(test.whole) < 2:
            notices.append(f"{test.source}: starts at an end stop and is excluded")
            continue
        cases.append(_Case(campaign.name_of(entry.path), entry, log, test))
    return cases


def _simulated(
    cases: Sequence[_Case], rig: Rig, model: Model, valves: _ValveModel
) -> tuple[list[tuple[_Case, TestResult]], list[str]]:
    """Every case's result: whole tests and segments go through the simulator together.

    A test or a segment whose simulation switches without end, or does not stay finite, is left out
    with a notice. Raises SimulationError where no test is left.
    """
    segments = [(c.test, s) for c in cases for s in (c.test.whole, *c.test.segments)]
    position = rig.position_channel
    runs = simulate_segments(segments, model, valves.surfaces, position, nan_if_endless=True)
    results, notices, next_run = [], [], 0
    for case in cases:
        count = 1 + len(case.test.segments)
        whole, *parts = runs[next_run : next_run + count]
        next_run += count
        if not np.isfinite(whole).all():
            notices.append(
                f"{case.test.source}: left out of the {valves.name} valve model: {NOT_FINITE}"
            )
            continue
        known = [i for i, part in enumerate(parts) if np.isfinite(part).all()]
        if len(known) < len(parts):
            notices.append(
                f"{case.test.source}: {len(parts) - len(known)} of {len(parts)} segments are left "
                f"out of the {valves.name} valve model: {NOT_FINITE}"
            )
        test = replace(case.test, segments=tuple(case.test.segments[i] for i in known))
        own = [parts[i] for i in known]
        found = judged(test, case.entry, case.name, rig, valves.name, whole, own)
        results.append((case, found))
    if cases and not results:
        raise SimulationError("; ".join(notices))
    return results, notices


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
                name=first.log,
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


__all__ = ["VALVE_MODELS", "validate"]
