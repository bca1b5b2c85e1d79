"""Which test to run next: standard errors predicted from the sensitivities of the simulation.

The Fisher information of a test is that of its linearised equations with the errors that the motion
logs show (the sensors' noise without such logs); its start states and its friction are nuisance
parameters (optimal design of experiments, Atkinson, Donev, Tobias 2007). Information is additive:
that of the bench tests, from the bundle's standard errors, of the training motion logs, and of
each candidate test.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from sysid.errors import input_error
from sysid.io.campaign import SIMULATED_KINDS, Campaign
from sysid.parameters import Bundle
from sysid.parameters.scatter import bench_scatter
from sysid.plant.effects.catalogue import catalogue as own_catalogue
from sysid.plant.effects.entry import Catalogue
from sysid.plant.effects.linear import possible_on
from sysid.recording.motion_tests import MotionTest
from sysid.refinement.advice_result import AdviceResult, CandidateTest, Tie
from sysid.refinement.candidates import CandidateMotion, candidate_motions
from sysid.refinement.detectable_effects import effect_sizes
from sysid.refinement.estimation import FrictionScatter
from sysid.refinement.expected_errors import with_expected_errors
from sysid.refinement.information import covariance
from sysid.refinement.options import (
    AdviceSetting,
    Option,
    bench_options,
    information,
    motion_information,
    noise_of,
    problem_of,
    runs_of_tests,
)
from sysid.refinement.probes import Probes, probes_of
from sysid.refinement.refine import check_on_off_law, motion_tests_of
from sysid.refinement.shown import HIGHLY_CORRELATED
from sysid.refinement.unknowns import Unknown, chosen, unknowns_of, without_own_data
from sysid.types import FloatArray, Progress, no_progress

# A test that lowers a pair's correlation by less is not reported as separating the pair.
_BREAKS = 0.98
# A parameter is unknown from this standard error on, in its coordinate, which is of order one.
_UNKNOWN = 1e3


@dataclass(frozen=True)
class Beginning:
    """What all advice on a campaign and a bundle starts from.

    `logged`: the training motion tests; `counts_logs`: whether their information adds to the
    bundle's.
    """

    campaign: Campaign
    bundle: Bundle
    setting: AdviceSetting
    logged: tuple[MotionTest, ...]
    counts_logs: bool
    notices: tuple[str, ...]


def begin(
    campaign: Campaign,
    bundle: Bundle,
    catalogue: Catalogue | None = None,
    progress: Progress = no_progress,
) -> Beginning:
    """The unknowns, and the errors that the motion logs show when refined.

    Raises InputError for logs or a rig file that cannot be used, NotIdentifiedError where the
    bundle does not hold the on/off law of both valves.
    """
    rig = campaign.rig
    if rig.is_motor_alone:
        raise input_error(
            rig.source,
            "declares a motor alone",
            "the tests that can be proposed are those of a rig with a cylinder and valves",
        )
    model = bundle.model(rig, catalogue)
    check_on_off_law(bundle, model)
    notices: list[str] = []
    progress("reading motion logs")
    entries = campaign.select(SIMULATED_KINDS, use="fit")
    logged = motion_tests_of(campaign, entries, bundle, model, notices, needed=False)
    unknowns = tuple(_known_without(bundle, chosen(unknowns_of(bundle, rig, model))))
    scatter = FrictionScatter(*bench_scatter(bundle.friction))
    drives = rig.motor is not None or any(rig.effort_channel in t.trial for t in logged)
    setting = AdviceSetting(rig, model, unknowns, noise_of(logged, rig), scatter.pair, drives)
    progress("refining the motion logs")
    with threadpool_limits(1, user_api="blas"):
        setting = with_expected_errors(setting, logged, scatter, progress)
    # If it records what was known before its motion logs, these count as the logs of any bundle do.
    holds_logs = bundle.refinement is not None and not bundle.refinement.values()
    if holds_logs:
        notices.append(_REFINED.format(bundle.source))
    return Beginning(campaign, bundle, setting, tuple(logged), not holds_logs, tuple(notices))


def advise(
    campaign: Campaign,
    bundle: Bundle,
    *,
    threshold: float,
    catalogue: Catalogue | None = None,
    progress: Progress = no_progress,
    beginning: Beginning | None = None,
    sizes: bool = True,
) -> AdviceResult:
    """Predict every parameter's standard error now, and after each of a list of tests.

    `catalogue`: the effects whose smallest sizes are found (none where it is empty). `threshold`:
    how many standard errors an effect's strength must reach to be detected. `beginning`: `begin` of
    the same, None: made here; `sizes`: whether to find these sizes. Raises as `begin` does.
    """
    began = beginning or begin(campaign, bundle, catalogue, progress)
    setting, unknowns = began.setting, began.setting.unknowns
    rig, model = setting.rig, setting.model
    progress("drawing tests that the rig can do")
    motions = candidate_motions(rig, model, setting.has_motor)
    tests = runs_of_tests(setting, motions, count_logs=began.counts_logs)
    known = possible_on(own_catalogue() if catalogue is None else catalogue, rig)
    rivals = _rivals(bundle, known)
    probes = probes_of(model, [known[r] for own in rivals.values() for r in own])
    problem = problem_of(tests, probes, setting)
    progress(f"simulating {len(tests.runs)} segments with derivatives")
    now, options = information(problem, tests, setting)
    options += bench_options(problem, setting)
    p = len(unknowns)
    options.sort(key=lambda o: -_reduction(now, o, p))
    shown = motion_information(problem, now, options)
    candidates = tuple(_candidate(now, o, unknowns, tests.motions, shown) for o in options)
    best = [i for i, o in enumerate(options) if o.motion is not None][:3]
    sought = known.values() if sizes else ()
    found, skipped = effect_sizes(
        tests, [options[i] for i in best], setting, sought, threshold, progress
    )
    return AdviceResult(
        parameters=unknowns,
        now=_std(now, unknowns),
        candidates=candidates,
        ties=_ties(now, options, candidates, unknowns, probes, rivals),
        sizes=found,
        size_tests=tuple(candidates[i].name for i in best),
        skipped=skipped,
        threshold=threshold,
        notices=began.notices,
    )


_REFINED = (
    "{} is refined: its standard errors, with their correlation, already include its motion logs, "
    "which are not counted again"
)


def _known_without(bundle: Bundle, unknowns: Sequence[Unknown]) -> list[Unknown]:
    """The unknowns with their prior information, without that of the motion logs that count.

    For a refined bundle these are the errors before the refinement. If it does not record them, its
    present errors include the logs, and then no log is counted.
    """
    if bundle.refinement is None:
        return without_own_data(unknowns, bundle, [])
    held = bundle.refinement.values()
    if not held:
        return [
            replace(u, has_prior=True) if u.origin == "effect" and u.std > 0.0 else u
            for u in unknowns
        ]
    bench = {v.name: v.before_std for v in held if v.origin != "effect" and v.before_std}
    known = [
        replace(u, std=bench.get(u.name, math.nan), correlations=(), has_prior=u.name in bench)
        for u in unknowns
    ]
    return without_own_data(known, bundle.replaced(refinement=None), [])


# --- standard errors -------------------------------------------------------------------


def _coordinate_std(found: FloatArray, count: int) -> FloatArray:
    """Standard errors (count,) of the first unknowns, all others known."""
    std = np.sqrt(np.diag(covariance(found[:count, :count])))
    return np.where(std > _UNKNOWN, np.inf, std)


def _std(found: FloatArray, unknowns: Sequence[Unknown]) -> FloatArray:
    """Standard errors (p,) in the parameters' units; infinite where nothing is known.

    As in a refinement, at least the accuracy of the integration.
    """
    slopes = np.array([abs(u.slope(u.start)) for u in unknowns])
    least = np.array([u.integration_error(u.start) for u in unknowns])
    return np.asarray(slopes * np.hypot(_coordinate_std(found, len(unknowns)), least))


def _reduction(now: FloatArray, option: Option, count: int) -> float:
    """Mean over the parameters of log(standard error now / after)."""
    before = np.minimum(_coordinate_std(now, count), _UNKNOWN)
    after = np.minimum(_coordinate_std(now + option.information, count), _UNKNOWN)
    return float(np.mean(np.log(before / after)))


def _candidate(
    now: FloatArray,
    option: Option,
    unknowns: Sequence[Unknown],
    motions: Sequence[CandidateMotion],
    shown: FloatArray,
) -> CandidateTest:
    std = _std(now + option.information, unknowns)
    gain = _reduction(now, option, len(unknowns))
    motion = None if option.motion is None else motions[option.motion]
    moved = _motion_gain(now, option, shown, len(unknowns))
    return CandidateTest(option.kind, option.text, option.duration, std, gain, motion, moved)


def _motion_gain(now: FloatArray, option: Option, shown: FloatArray, count: int) -> float | None:
    """Log of how much less the parameters' errors move what motion tests show, after a test.

    Their information `shown` (k, k) weighs the covariance: its trace is the sum of squares by which
    the simulation is off, in units of the noise.
    """
    p = slice(count)
    moved = [
        float(np.sum(shown[p, p] * covariance(found[p, p])))
        for found in (now, now + option.information)
    ]
    return 0.5 * math.log(moved[0] / moved[1]) if min(moved) > 0.0 else None


# --- ties ------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Pair:
    """Two of the columns, by their index in `columns`: the unknowns that are estimated."""

    one: str
    other: str
    columns: tuple[int, ...]
    i: int
    j: int

    def correlation(self, found: FloatArray) -> float:
        c = covariance(found[np.ix_(self.columns, self.columns)])
        return float(c[self.i, self.j] / math.sqrt(c[self.i, self.i] * c[self.j, self.j]))


def _rivals(bundle: Bundle, known: Catalogue) -> dict[str, list[str]]:
    """Effects that the data cannot distinguish from those in the bundle, each listed once."""
    taken = {entry.id for entry in bundle.effects}
    found: dict[str, list[str]] = {}
    for entry in bundle.effects:
        own = [r for r in entry.ambiguous_with if r in known and r not in taken]
        taken.update(own)
        found[entry.id] = [r for r in own if not known[r].averaged_only]
    return found


def _ties(
    now: FloatArray,
    options: Sequence[Option],
    candidates: Sequence[CandidateTest],
    unknowns: Sequence[Unknown],
    probes: Probes,
    rivals: Mapping[str, Sequence[str]],
) -> tuple[Tie, ...]:
    pairs = [*_correlated(now, unknowns), *_indistinct(unknowns, probes, rivals)]
    found = [_tie(now, options, candidates, pair) for pair in pairs]
    return tuple(sorted(found, key=lambda tie: -abs(tie.now)))


def _correlated(now: FloatArray, unknowns: Sequence[Unknown]) -> Iterator[_Pair]:
    """Pairs of parameters whose errors are highly correlated."""
    p = len(unknowns)
    for i in range(p):
        for j in range(i):
            pair = _Pair(unknowns[j].name, unknowns[i].name, tuple(range(p)), j, i)
            if abs(pair.correlation(now)) > HIGHLY_CORRELATED:
                yield pair


def _indistinct(
    unknowns: Sequence[Unknown], probes: Probes, rivals: Mapping[str, Sequence[str]]
) -> Iterator[_Pair]:
    """Pairs of an effect of the bundle and a rival that could replace it: their strengths."""
    p, places = len(unknowns), probes.places()
    for effect, own in rivals.items():
        at = next((i for i, u in enumerate(unknowns) if u.name.startswith(f"{effect}.")), None)
        for rival in own if at is not None else ():
            yield _Pair(effect, rival, (*range(p), p + places[rival][0]), at or 0, p)


def _tie(
    now: FloatArray, options: Sequence[Option], candidates: Sequence[CandidateTest], pair: _Pair
) -> Tie:
    """The pair's correlation, and the candidate that lowers it most."""
    before = pair.correlation(now)
    after = [pair.correlation(now + o.information) for o in options]
    best = min(range(len(after)), key=lambda i: abs(after[i]), default=None)
    if best is None or abs(after[best]) > _BREAKS * abs(before):
        return Tie(pair.one, pair.other, before, None, before)
    return Tie(pair.one, pair.other, before, candidates[best].name, after[best])


__all__ = ["Beginning", "advise", "begin"]
