"""The parameters of the assembled model estimated together, by the error of its simulation.

Bock's multiple shooting (Bock, Plitt 1984; Schittkowski 2002): the motion tests are cut into
segments, each with its own start state, so that a wrong parameter does not add up over a test;
where the model follows them, they are joined, up to whole tests (`lengthening`).
The residuals are modelled by the sensors' noise, quantisation, and an autoregression for the
remaining correlation. Friction varies from test to test: each test's is a random effect about the
model's. The bench tests' estimates are the prior, with the covariance of each part's errors.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from sysid.balance.imposed import effort_rmse
from sysid.blocks.numbers import ascii_text, percent
from sysid.errors import (
    Failure,
    InputError,
    NotIdentifiedError,
    OutOfBudgetError,
    SimulationError,
    error_of,
    input_error,
    on_its_own,
)
from sysid.estimation.autoregression import Autoregression
from sysid.estimation.linear import Estimate, t_quantile
from sysid.io.campaign import SIMULATED_KINDS, Campaign, CampaignLog
from sysid.io.channels import simulated_channels
from sysid.io.rig import Rig
from sysid.parameters import Bundle
from sysid.parameters.assembled_model import assumed_parameters, fitted_inertia
from sysid.parameters.declared import contradictions
from sysid.parameters.fitted_logs import check_log
from sysid.parameters.scatter import bench_scatter
from sysid.plant.effects.entry import Catalogue
from sysid.plant.ports import Model, has_discrete_law
from sysid.recording.even import recorded
from sysid.recording.motion_tests import MotionTest, prepare_all, slowness_of
from sysid.recording.simulation import NOT_FINITE
from sysid.refinement.estimation import (
    Estimated,
    FrictionScatter,
    estimate,
    with_slopes,
)
from sysid.refinement.lengthening import lengthened
from sysid.refinement.prior import BenchRows
from sysid.refinement.problem import Problem
from sysid.refinement.profiles import Profile
from sysid.refinement.profiles import profile as profile_of
from sysid.refinement.reduction import NO_INFORMATION
from sysid.refinement.result import Fit, RefinedParameter, RefineResult
from sysid.refinement.runs import LEAST_ROWS, Run, runs_of
from sysid.refinement.unknowns import (
    Unknown,
    chosen,
    model_at,
    numbers_of,
    unknowns_of,
    without_own_data,
)
from sysid.refinement.updating import updated
from sysid.refinement.whole_tests import (
    correlation,
    in_both,
    rmse,
    simulated,
    whole_residuals,
)
from sysid.types import FloatArray, Progress, no_progress

SEGMENT_S = 1.0
# A parameter is informed by motion where its error falls below this share of the bench tests'.
_INFORMED = 0.9


def refine(
    campaign: Campaign,
    bundle: Bundle,
    *,
    free: Iterable[str] = (),
    fix: Iterable[str] = (),
    prior: bool = True,
    robust: bool = False,
    profile: Iterable[str] = (),
    catalogue: Catalogue | None = None,
    progress: Progress = no_progress,
    by_differences: bool = False,
    bench: BenchRows | None = None,
) -> RefineResult:
    """Estimate a bundle's parameters, and its effects', on a campaign's training motion logs.

    `free`: constants of the rig file, and others, that are estimated too; `fix`: parameters that
    stay; without `prior` the bench tests count for the start only; `robust`: each
    segment's errors count by their own size; `profile`: parameters with a profile;
    `by_differences`: standard errors are of differences of neighbouring simulations (to some 1e-5
    the same), for which nothing is compiled, not of derivatives by forward mode; `bench`: what the
    bench tests say of the numbers together, where the bundle's are not theirs alone. Raises
    InputError for an unknown parameter or a campaign without such logs, NotIdentifiedError where
    the bundle does not hold the on/off law of both valves, or nothing can be simulated.
    """
    free, fix, profile = list(free), list(fix), list(profile)
    campaign.rig.require_motion()
    entries = campaign.select(SIMULATED_KINDS, use="fit")
    if not entries:
        raise input_error(
            campaign.path,
            "holds no training motion log",
            f'add a [[log]] of kind {", ".join(SIMULATED_KINDS)} with use = "fit"',
        )
    model = bundle.model(campaign.rig, catalogue)
    notices = [*campaign.notices, *campaign.rig.notices]
    notices += [*bundle.other_rig(campaign.rig), *assumed_parameters(bundle, campaign.rig)]
    check_on_off_law(bundle, model)
    every = without_own_data(unknowns_of(bundle, campaign.rig, model), bundle, notices)
    unknowns = tuple(chosen(every, free, fix, prior=prior))
    if not unknowns:
        raise input_error("--fix", "leaves nothing to estimate", "fix fewer parameters")
    numbers_of(unknowns, profile)  # a name that is none is refused before anything is computed
    progress("reading motion logs")
    tests = motion_tests_of(campaign, entries, bundle, model, notices)
    scatter = FrictionScatter(*bench_scatter(bundle.friction))
    problem = _problem(campaign, tests, unknowns, model, scatter, bench)
    progress(f"estimating {len(unknowns)} parameters on {len(problem.runs)} segments")
    found = _estimated(problem, scatter, tests, robust, progress, by_differences)
    if found.left_out:
        notices.append(_left_out_notice(found.left_out))
    if not (found.solution.converged or found.cut_short):
        notices.append(_stalled_notice(found))
    result = _result(found, tests, campaign, bundle, profile, notices, progress)
    options: dict[str, Any] = {"free": free, "fix": fix, "prior": prior, "robust": robust}
    made = updated(bundle, campaign, result, SIMULATED_KINDS, options)
    if made.refinement is not None:
        wrong = contradictions(made.refinement.values(), campaign.rig)
        notices += [ascii_text(line) for line in wrong]
    return dataclasses.replace(result, bundle=made, notices=tuple(notices))


def _problem(
    campaign: Campaign,
    tests: Sequence[MotionTest],
    unknowns: tuple[Unknown, ...],
    model: Model,
    scatter: FrictionScatter,
    bench: BenchRows | None,
) -> Problem:
    """The segments of these tests with the unknowns; raises NotIdentifiedError without any."""
    position = campaign.rig.position_channel
    runs = [r for i, t in enumerate(tests) for r in runs_of(i, t, model, position)]
    if not runs:
        raise NotIdentifiedError(
            f"{campaign.path}: no stretch of its motion logs can be simulated; give tests of more "
            "than a second, away from the end stops"
        )
    white = tuple(tuple(Autoregression.white(float(n) ** 2) for n in run.noise) for run in runs)
    pair = scatter.pair
    return Problem(tuple(runs), unknowns, model, position, white, pair, len(tests), bench=bench)


def _result(
    found: Estimated,
    tests: Sequence[MotionTest],
    campaign: Campaign,
    bundle: Bundle,
    profile: Iterable[str],
    notices: list[str],
    progress: Progress,
) -> RefineResult:
    """The estimates with their errors, and what whole tests, held-out ones too, say of them.

    `bundle` is the one that the estimation started from; notices are appended.
    """
    model, position = found.problem.model, found.problem.position
    parameters, matrix = _parameters(found)
    progress("simulating whole tests")
    entries = campaign.select(SIMULATED_KINDS, use="holdout")
    held_out = motion_tests_of(campaign, entries, bundle, model, notices, needed=False)
    after = _model_after(found, parameters)
    freed = [u.name for u in found.problem.unknowns if u.origin == "rig"]
    if freed:
        notices.append(_freed_notice(freed))
    uses = {use: some for use, some in (("fit", tests), ("holdout", held_out)) if some}
    result = RefineResult(
        parameters=parameters,
        correlation=matrix,
        fits={use: _fit(some, model, after, position, notices) for use, some in uses.items()},
        channels=simulated_channels(position),
        scatter=found.scatter.pair,
        evaluations=found.evaluations,
        converged=found.solution.converged,
        segments=len(found.problem.runs),
        left_out=len(found.left_out),
        longest=max(float(np.ptp(run.inputs.time)) for run in found.problem.runs),
        profiles=_profiles(found, profile, progress),
        cut_short=found.cut_short,
        misfits=found.misfits,
        bundle=bundle,
        effort={
            use: _effort(some, model, after, campaign.rig, notices)
            for use, some in uses.items()
            if campaign.rig.is_motor_alone
        },
    )
    if result.rises:
        own = _with_own_friction(found, tests)
        result = dataclasses.replace(result, with_own_friction=own)
    if result.worse and result.with_own_friction is not None:
        left = _beyond_noise(result.with_own_friction, tests) / result.fits["fit"].after
        result = dataclasses.replace(result, unexplained=left)
    if result.worse:
        notices.append(_worse_notice(result.worse))
    elif result.scatters:
        notices.append(_scatter_notice(result))
    return result


def _with_own_friction(found: Estimated, tests: Sequence[MotionTest]) -> FloatArray:
    """RMSE (3,) of whole tests, each with its own friction as it was estimated; NaN where not
    logged."""
    problem, point = found.problem, found.solution.point
    residuals = [
        own
        for i, test in enumerate(tests)
        for own in whole_residuals([test], problem.model_for(point, i), problem.position)
    ]
    return rmse(residuals)


def _beyond_noise(errors: FloatArray, tests: Sequence[MotionTest]) -> FloatArray:
    noise = np.median([test.noise.total for test in tests], axis=0)
    return np.asarray(np.sqrt(np.maximum(errors**2 - noise**2, 0.0)))


def _model_after(found: Estimated, parameters: Sequence[RefinedParameter]) -> Model:
    """The model with the estimates."""
    values = np.array([p.estimate.value for p in parameters])
    after = model_at(found.problem.model, found.problem.unknowns, values)
    static = found.problem.static_number
    if static is None or parameters[static].is_known:
        return after
    # As in the bundle's model, which then holds no static friction.
    return Model(
        after.parameters.replace(static_effort=after.parameters.coulomb_effort), after.effects
    )


def _estimated(
    problem: Problem,
    scatter: FrictionScatter,
    tests: Sequence[MotionTest],
    robust: bool,
    progress: Progress,
    by_differences: bool,
) -> Estimated:
    """Estimate from segments up to the longest runs of these tests that the data allow."""
    # Small matrices: more threads only wait for each other.
    with threadpool_limits(1, user_api="blas"):
        found = estimate(problem, scatter, robust=robust, progress=progress)
        found = lengthened(found, tests, progress)
        progress("derivatives of the solution")
        # Those of the last steps give the errors as well.
        try:
            return with_slopes(found, by_differences)
        except SimulationError:
            return found
        except OutOfBudgetError:
            return dataclasses.replace(found, cut_short=True)


def check_on_off_law(bundle: Bundle, model: Model) -> None:
    """Raises NotIdentifiedError where a bundle's model cannot simulate motion by its pulses."""
    if not has_discrete_law(model.parameters):
        raise NotIdentifiedError(
            f"{bundle.source}: holds no on/off law of {bundle.rig.all_valves}, by which motion is "
            "simulated; fit valve-discrete tests into it"
        )


def motion_tests_of(
    campaign: Campaign,
    entries: Sequence[CampaignLog],
    bundle: Bundle,
    model: Model,
    notices: list[str],
    *,
    needed: bool = True,
) -> list[MotionTest]:
    """The tests of these logs with their segments, by the bundle's model; the logs' notices are
    appended.

    A log that cannot be simulated is skipped with a notice. Raises the error of the logs where
    tests are `needed` and none can be, InputError for a log that has changed.
    """
    found: list[MotionTest] = []
    failed: list[Failure] = []
    slowness = slowness_of(campaign.rig, model)
    for entry in entries:
        log = campaign.read(entry)
        check_log(bundle, log, entry.kind, entry.use)
        notices += log.notices
        inertia = fitted_inertia(bundle)
        tests = on_its_own(
            partial(prepare_all, log.trials, entry.kind, campaign.rig, SEGMENT_S, inertia, slowness)
        )
        if isinstance(tests, Failure):
            failed.append(tests)
            continue
        found += tests[0]
        notices += tests[1]
    if needed and failed and not found:
        raise error_of(failed, "; ".join(dict.fromkeys(why.reason for why in failed)))
    notices += [f"excluded: {why.reason}" for why in failed]
    return [t for t in found if t.counted(t.whole) >= LEAST_ROWS]


def _parameters(found: Estimated) -> tuple[tuple[RefinedParameter, ...], FloatArray]:
    """The unknowns with their estimates, and the correlation of their errors (p, p)."""
    solution, unknowns = found.solution, found.problem.unknowns
    p = len(unknowns)
    covariance = found.error_covariance()[:p, :p]
    std = np.sqrt(np.diag(covariance))
    freedom = found.degrees_of_freedom()
    parameters = []
    for i, unknown in enumerate(unknowns):
        at, dof = float(solution.point.shared[i]), float(freedom[i])
        if unknown.varies_by_test:
            # The friction of a test is one draw, so each test is one degree of freedom.
            dof = max(found.scatter.tests - 1.0, 1.0)
        if not std[i] > NO_INFORMATION:
            # Neither the residuals nor a prior depend on it: it stays as it was.
            former = Estimate.symmetric(unknown.value, unknown.std, unknown.unit, math.inf)
            former = former.within(unknown.lower, unknown.upper)
            parameters.append(RefinedParameter(unknown, former, informed=False))
            continue
        # Symmetric where the parameter has no bounds: a positive one has a positive interval.
        half = t_quantile(dof) * float(std[i])
        interval = (unknown.at(at - half), unknown.at(at + half))
        own_std = abs(unknown.slope(at)) * float(std[i])
        estimate = Estimate(unknown.at(at), own_std, unknown.unit, interval)
        informed = not (unknown.has_prior and estimate.std > _INFORMED * unknown.std)
        parameters.append(RefinedParameter(unknown, estimate, informed))
    known = np.where(std > NO_INFORMATION, std, 1.0)
    return tuple(parameters), covariance / np.outer(known, known)


def _profiles(found: Estimated, names: Iterable[str], progress: Progress) -> dict[str, Profile]:
    std = np.sqrt(np.diag(found.error_covariance()))
    profiles = {}
    for number in numbers_of(found.problem.unknowns, names):
        name = found.problem.unknowns[number].name
        progress(f"profile of {name}")
        profiles[name] = profile_of(found, number, float(std[number]))
    return profiles


def _fit(
    tests: Sequence[MotionTest], before: Model, after: Model, position: str, notices: list[str]
) -> Fit:
    """Whole tests simulated open loop, from rest, with both models: of those that both simulate.

    NaN of a model that simulates none.
    """
    found = [whole_residuals(tests, model, position) for model in (before, after)]
    for own, numbers in zip(found, ("the bundle's", "the refined"), strict=True):
        for test, known in zip(tests, simulated(own), strict=True):
            if not known:
                notices.append(
                    f"{test.source}: is not simulated with {numbers} numbers, and left out of the "
                    f"errors of whole tests: {NOT_FINITE}"
                )
    pair = in_both(*found)
    return Fit(*map(rmse, pair), *map(correlation, pair))


def _effort(
    tests: Sequence[MotionTest], before: Model, after: Model, rig: Rig, notices: list[str]
) -> dict[str, tuple[float, float]]:
    """RMSE by channel of both models' residual effort along the measured motion; NaN for tests that
    cannot be brought onto even time."""
    effort = rig.effort_channel
    try:
        even = [recorded(test.trial, rig, []) for test in tests]
        return {effort: (effort_rmse(even, before), effort_rmse(even, after))}
    except InputError as error:
        notices.append(f"errors of the equation of motion are not known: {error}")
        return {effort: (math.nan, math.nan)}


def _stalled_notice(found: Estimated) -> str:
    steps = found.solution.at.shared_step(found.problem)
    worst = int(np.argmax(steps))
    return (
        f"the estimation stalled after {found.evaluations} simulations: no step lowers the errors, "
        f"though {found.problem.unknowns[worst].name} is {steps[worst]:.2g} standard errors from "
        "the minimum of the linearised errors; --fix it, or diagnose what the model lacks first"
    )


def _worse_notice(worse: str) -> str:
    return (
        f"with these numbers whole training tests are simulated {worse}: they compensate "
        "for what the model lacks; run diagnose first, or keep the previous bundle"
    )


def _scatter_notice(result: RefineResult) -> str:
    sliding, static = (percent(100.0 * share, 2) for share in result.scatter)
    return (
        f"with these numbers whole training tests are simulated {result.scatters}, as friction "
        f"differs from test to test (sliding by {sliding}, static by {static}), which an open-loop "
        "simulation adds up: with the friction of its own, each is simulated as it should be"
    )


def _freed_notice(names: Sequence[str]) -> str:
    return (
        f"{', '.join(names)}: estimated together with the others, whose values hold with this "
        "estimate; the bundle keeps the rig file's value, so enter the estimate there "
        "before using the bundle"
    )


def _left_out_notice(runs: Sequence[Run]) -> str:
    places = [r.name for r in runs[:5]]
    more = f" and {len(runs) - 5} more" if len(runs) > 5 else ""
    many = len(runs) > 1
    return (
        f"{len(runs)} segment{'s are' if many else ' is'} excluded, as the model does not follow "
        f"{'them' if many else 'it'} from any start state: {', '.join(places)}{more}"
    )


__all__ = ["check_on_off_law", "motion_tests_of", "refine"]
