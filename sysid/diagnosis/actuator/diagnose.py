"""From a campaign's logs and a fitted bundle to a `Diagnosis`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np

from sysid.blocks.numbers import number
from sysid.diagnosis.actuator.equation_error import forget
from sysid.diagnosis.actuator.evidence import TwinEvidence
from sysid.diagnosis.actuator.holdout import HeldOut, motion_tests, trace
from sysid.diagnosis.actuator.loop import Loop, Memory, close_loop, loop_of
from sysid.diagnosis.actuator.search import Rival
from sysid.diagnosis.actuator.unexplained import (
    faintest,
    imitated,
    leftover,
    log_channel,
    remainders,
    repeating,
)
from sysid.diagnosis.evidence import residual
from sysid.diagnosis.lack_of_fit import MISFIT
from sysid.diagnosis.result import Diagnosis, Unexplained
from sysid.diagnosis.search import full_sentence, limit_sentence, shapes_at_limits
from sysid.diagnosis.search_record import UnexplainedReason, why_unexplained
from sysid.diagnosis.wording import regressor_name
from sysid.errors import Failure, NotIdentifiedError, SimulationError, on_its_own
from sysid.io.channels import channel_of, simulated_channels
from sysid.io.logs import Log, Trial
from sysid.io.rig import Rig
from sysid.parallel import limited, spend
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model, has_discrete_law
from sysid.types import FloatArray

# Times what a correct model with fitted numbers would show: one channel is enough. At most 2.4 on
# 27 campaigns with nothing missing.
_FAR_OFF_FITTED = 4.0
# Times the largest error of so many draws of each model; so many models where none are drawn.
_BEYOND, _MORE_DRAWS, _MODELS = 1.5, 8, 16
# Per cent of static friction that is worth saying.
_LEAST_CHANGE = 0.1
_UNKNOWN: FloatArray = np.full(len(simulated_channels("")), math.nan)
_FAR_OFF_NOTICE = (
    "the held-out tests are simulated far worse than noise, scatter and the errors of the fitted "
    "numbers explain, though no balance shows enough structure to say why (the strongest is "
    "listed): the balances leave out rest, reversals and pressures at the atmosphere, so check "
    "what happens there (breakaway, friction at standstill)"
)
_IMITATED_NOTICE = (
    "one curve over {} explains far more than the effects found, in tests that it was not fitted "
    "on, and friction's scatter between tests aside: they imitate a law that the catalogue lacks, "
    "so their names and numbers are not to be relied on"
)
_STILL_FAR_OFF_NOTICE = (
    "with the effects found every channel of the held-out tests is still simulated far worse than "
    "noise and scatter explain: together they may imitate an effect that the catalogue lacks, so "
    "their names and numbers are not to be relied on"
)


def diagnose(
    logs: Sequence[tuple[str, str, Log]],
    rig: Rig,
    model: Model,
    catalogue: Mapping[str, type[CatalogueEffect]],
    *,
    drawn: Sequence[Model] = (),
    seed: int = 0,
    quick: bool = False,
    memory: Memory | None = None,
    progress: Callable[[str], None] = lambda line: None,
) -> Diagnosis:
    """Find what a fitted model lacks, and measure what adding it gains.

    `logs` are (use, kind, log): those with use `fit` are diagnosed and fitted on, the motion
    logs among those held out are only simulated, before and after. `drawn` are models about the
    fitted one, as wrong as its numbers may be: what a right form may leave. Raises InputError for
    logs that cannot be used, NotIdentifiedError where the model or the logs do not suffice.
    Ends within the limit in force (`sysid.parallel`) with what was found by then. `memory`: see
    `close_loop`.
    """
    if not has_discrete_law(model.parameters):
        raise NotIdentifiedError(
            f"diagnosis: the bundle holds no discrete law of {rig.all_valves}; fit valve-discrete "
            f"tests of valve{'s a and b' if len(rig.sides) > 1 else ' a'} into it"
        )
    tests: list[tuple[str, str, Trial]] = [
        (log.path.name, kind, trial)
        for use, kind, log in logs
        if use == "fit"
        for trial in log.trials
    ]
    if not tests:
        raise NotIdentifiedError('diagnosis: no log has use = "fit"; give it some')
    try:
        inside, outside = _inside(logs, rig, model), _held_out(logs, rig)
        found = close_loop(
            tests,
            rig,
            model,
            catalogue.values(),
            simulated=partial(_simulated, inside),
            seed=seed,
            quick=quick,
            memory=memory,
            progress=progress,
        )
        progress("simulating the held-out logs, before and after")
        with limited():
            return _diagnosed(found, inside, outside, rig, model, drawn, seed)
    finally:
        forget()


def _diagnosed(
    found: Loop,
    inside: HeldOut,
    outside: HeldOut,
    rig: Rig,
    model: Model,
    drawn: Sequence[Model],
    seed: int,
) -> Diagnosis:
    """The diagnosis from what the loop found, and the motion tests to fit on and those held out."""
    notices = []
    if not outside.tests:
        notices.append("no held-out motion log: errors before and after are unknown")
    outside = _simulable(outside, [model, *(step.model for step in found.search.steps)])
    notices += [*outside.notices, *inside.notices]
    errors = _errors(outside, model, found)
    floor = _noise_floor(outside, found, seed)
    curves = leftover(found)
    rests = on_its_own(partial(remainders, found, rig))
    if isinstance(rests, Failure):
        notices.append(f"what the remainder consists of could not be worked out: {rests.reason}")
        rests = ()
    curves = (*curves, *repeating(found, rests, curves, rig))
    alike = on_its_own(partial(imitated, found))
    if isinstance(alike, Failure):
        notices.append(f"whether the effects imitate another law was not examined: {alike.reason}")
        alike = ()
    notices += [_IMITATED_NOTICE.format(regressor_name(c.regressor)) for c in alike]
    known = {curve.channel for curve in curves}
    curves = (*curves, *(c for c in alike if c.channel not in known))
    structured = bool(curves)
    fitted = _fitted_floor(outside, model, found, drawn, seed)
    cut_short = bool(found.record.cut_short)
    far_off = not (found.search.steps or cut_short) and is_far_off(errors[-1], floor, fitted)
    far_off = far_off and _is_beyond_draws(errors[-1], outside, model, found, drawn, seed)
    undecided = not (found.search.steps or cut_short or found.record.is_decided)
    if (far_off or undecided) and not curves:
        curves = faintest(found)
        notices += [_FAR_OFF_NOTICE] * far_off
    elif not (found.search.steps or curves):
        notices += _of_fitted_numbers(errors[-1], floor, fitted, rig)
    reason = why_unexplained(structured, far_off, undecided)
    evidence = TwinEvidence(found, rig, curves)
    by_channel = _by_channel([*errors, floor], rig)
    return Diagnosis(
        effects=evidence.found(by_channel[:-1]),
        residual=residual(by_channel[:-1], by_channel[-1]),
        unexplained=_unexplained(evidence),
        remainder=rests,
        evidence=evidence,
        reason=reason,
        seed=seed,
        notices=(
            *notices,
            *_of_static_friction(found),
            *_of_limits(found),
            *found.record.sentences(),
        ),
    )


def rivals_of(found: Diagnosis) -> tuple[Rival, ...]:
    """What motion may speak for in the place of what was found."""
    return cast(TwinEvidence, found.evidence).loop.search.rivals


def with_rival(
    found: Diagnosis,
    rival: Rival,
    memory: Memory,
    logs: Sequence[tuple[str, str, Log]],
    rig: Rig,
    model: Model,
    *,
    drawn: Sequence[Model] = (),
) -> Diagnosis:
    """The diagnosis with a rival's effects in the place of those that were found.

    `memory`: of the search that found them; the rest as for `diagnose`. Raises OutOfBudgetError.
    """
    before = cast(TwinEvidence, found.evidence).loop
    try:
        other = loop_of(rival, before, memory)
        inside, outside = _inside(logs, rig, model), _held_out(logs, rig)
        with limited():
            return _diagnosed(other, inside, outside, rig, model, drawn, found.seed)
    finally:
        forget()


def _inside(logs: Sequence[tuple[str, str, Log]], rig: Rig, model: Model) -> HeldOut:
    """The motion tests to fit on, less those that the given model does not simulate: they would
    refuse every effect."""
    tests = motion_tests(rig, [(kind, log) for use, kind, log in logs if use == "fit"])
    return _simulable(tests, [model])


def _held_out(logs: Sequence[tuple[str, str, Log]], rig: Rig) -> HeldOut:
    """The motion tests of the held-out logs, to be simulated only."""
    return motion_tests(rig, [(kind, log) for use, kind, log in logs if use == "holdout"])


def _simulable(tests: HeldOut, models: Sequence[Model]) -> HeldOut:
    """The tests that each of the models simulates to their ends; all where all do."""
    if not tests.tests:
        return tests
    try:
        for model in models:
            tests.simulated(model)
    except SimulationError:
        return tests.simulable(models)
    return tests


def _by_channel(errors: Sequence[FloatArray], rig: Rig) -> list[dict[str, float]]:
    """Errors (3,) each, by the logs' channels."""
    names = simulated_channels(rig.position_channel)
    return [dict(zip(names, map(float, one), strict=True)) for one in errors]


def with_errors_after_judged(found: Diagnosis) -> Diagnosis:
    """`unexplained` where with the effects found every held-out channel is still far off.

    Effects that imitate another one together explain the balances, and simulate badly. Numbers a
    little off move the position alone: the position and every chamber have to be known.
    """
    if found.verdict != "effects-found":
        return found
    evidence = cast(TwinEvidence, found.evidence)
    if len(found.residual) != 1 + len(evidence.rig.pressure_channels):
        return found
    after, floor = (
        np.array([getattr(errors, name) for errors in found.residual.values()], dtype=float)
        for name in ("after", "noise_floor")
    )
    if not is_far_off(after, floor):
        return found
    evidence = replace(evidence, left=faintest(evidence.loop))
    reason: UnexplainedReason = "held-out errors"
    return replace(
        found,
        reason=reason,
        unexplained=_unexplained(evidence),
        evidence=evidence,
        notices=(*found.notices, _STILL_FAR_OFF_NOTICE),
    )


def _unexplained(evidence: TwinEvidence) -> tuple[Unexplained, ...]:
    return tuple(
        Unexplained(log_channel(c.channel, evidence.rig), c.regressor, c.share)
        for c in evidence.left
    )


def open_loop_errors(
    logs: Sequence[tuple[str, str, Log]], rig: Rig, model: Model
) -> dict[str, float]:
    """RMSE of a model by channel, in its unit, on the motion logs held out; NaN without one."""
    outside = _simulable(_held_out(logs, rig), [model])
    errors = _rmse(outside, model) if outside.tests else _UNKNOWN
    return _by_channel([errors], rig)[0]


def open_loop_trace(
    logs: Sequence[tuple[str, str, Log]],
    rig: Rig,
    before: Model,
    after: Model,
    scatter: float = 0.0,
) -> dict[str, Any] | None:
    """A held-out test as `holdout.trace` has it; None where nothing is held out."""
    outside = _simulable(_held_out(logs, rig), [before, after])
    with limited():
        return trace(outside, before, after, scatter) if outside.tests else None


def is_far_off(errors: FloatArray, floor: FloatArray, fitted: FloatArray | None = None) -> bool:
    """Whether the errors of the held-out tests, (3,), are far above a correct model's.

    Of any channel, above what a correct model with `fitted` numbers would show, (3,); of every one,
    above the `floor` of noise and scatter, where that is not known.
    """
    known = ~np.isnan(errors) & ~np.isnan(floor)
    if fitted is None:
        return bool(known.any() and np.all(errors[known] > MISFIT * floor[known]))
    return bool(np.any(errors[known] > _FAR_OFF_FITTED * fitted[known]))


def _of_fitted_numbers(
    errors: FloatArray, floor: FloatArray, fitted: FloatArray | None, rig: Rig
) -> Iterator[str]:
    """Says which errors are of the fitted numbers, where they are far above noise and scatter."""
    for i, name in enumerate(simulated_channels(rig.position_channel)):
        if fitted is not None and errors[i] > MISFIT * floor[i]:
            channel = channel_of(name)
            own, may = (number(channel.residual(float(e[i])), 3) for e in (errors, fitted))
            yield (
                f"{channel.title.lower()}: {own} {channel.residual_unit} on held-out tests may be "
                f"the fitted numbers' own errors ({may} {channel.residual_unit} by their standard "
                "errors and friction's scatter): refine estimates them from motion"
            )


def _of_static_friction(found: Loop) -> Iterator[str]:
    """Says that static friction was read through a motor that the effects correct."""
    before, after = (
        m.parameters.static_effort for m in (found.search.first.model, found.search.model)
    )
    change = 100.0 * (float(after) / float(before) - 1.0) if float(before) else 0.0
    if abs(change) >= _LEAST_CHANGE:
        size = f"{number(abs(change), 2)} % {'more' if change > 0.0 else 'less'}"
        yield (
            "static friction was read in the effort that the motor was told to give: with the "
            f"effects found the same readings are {size}"
        )


def _of_limits(found: Loop) -> Iterator[str]:
    """Says which shapes ended at a limit of their range, and that no more effects may be added."""
    steps, joint = found.search.steps, found.search.joint
    for step, effect in zip(steps, () if joint is None else joint.effects, strict=False):
        assert joint is not None
        limits = shapes_at_limits(effect, joint.fit.diagnosis.at_bound)
        if said := limit_sentence(step.id, limits, step.ambiguous):
            yield said
    if said := full_sentence(steps):
        yield said


def _simulated(tests: HeldOut, model: Model) -> float:
    """Minus twice the log likelihood of motion tests simulated with a model: units do not count.

    A test is off as a whole, by as much as is unknown: so many draws as tests, whose variance is
    each channel's mean square. 0 without tests. Raises SimulationError, OutOfBudgetError.
    """
    spend()
    if not tests.tests:
        return 0.0
    errors = tests.rmse(model)
    logged = errors[~np.isnan(errors)]
    return float(2.0 * len(tests.tests) * np.sum(np.log(logged)))


def _errors(outside: HeldOut, model: Model, found: Loop) -> list[FloatArray]:
    """RMSE (3,) of the given model, and after each step."""
    if not outside.tests:
        return [_UNKNOWN] * (len(found.search.steps) + 1)
    return [_rmse(outside, model), *(_rmse(outside, step.model) for step in found.search.steps)]


def _rmse(outside: HeldOut, model: Model) -> FloatArray:
    """RMSE (3,), NaN where the model's equations cannot be simulated."""
    try:
        return outside.rmse(model)
    except SimulationError:
        return _UNKNOWN


def _noise_floor(outside: HeldOut, found: Loop, seed: int) -> FloatArray:
    """(3,), NaN where there are no tests, or the model's equations cannot be simulated."""
    if not outside.tests:
        return _UNKNOWN
    try:
        return outside.noise_floor(found.search.model, found.noise, found.scatter_after, seed)
    except SimulationError:
        return _UNKNOWN


def _fitted_floor(
    outside: HeldOut, model: Model, found: Loop, drawn: Sequence[Model], seed: int
) -> FloatArray | None:
    """RMSE (3,) of the given model, if it is correct but for its fitted numbers' own errors.

    None where it is not known, and not asked for as effects were found.
    """
    if not outside.tests or not drawn or found.search.steps:
        return None
    try:
        return outside.fitted_floor(drawn, model, found.noise, found.scatter_after, seed)
    except SimulationError:
        return None


def _is_beyond_draws(
    errors: FloatArray,
    outside: HeldOut,
    model: Model,
    found: Loop,
    drawn: Sequence[Model],
    seed: int,
) -> bool:
    """Whether errors (3,) are beyond those that any of many draws shows of a correct model.

    Friction a little off may send a whole test elsewhere: a few draws seldom show it.
    """
    many = [*(drawn or [model] * _MODELS)] * _MORE_DRAWS
    try:
        draws = outside.draws(many, model, found.noise, found.scatter_after, seed + 1)
    except SimulationError:
        return True
    known = ~np.isnan(errors)
    return bool(np.any(errors[known] > _BEYOND * np.max(draws, axis=0)[known]))


__all__ = [
    "diagnose",
    "is_far_off",
    "open_loop_errors",
    "open_loop_trace",
    "rivals_of",
    "with_errors_after_judged",
    "with_rival",
]
