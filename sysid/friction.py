"""Friction from logs: breakaway ramps, constant-effort trials, and any motion (thesis 3.4)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from sysid.errors import (
    Failure,
    Notice,
    NotIdentifiedError,
    about,
    error_of,
    input_error,
    on_its_own,
)
from sysid.estimation.combinations import (
    Combination,
    Separation,
    Sums,
    combined,
    mean_friction,
    unidentified,
)
from sysid.estimation.linear import UNKNOWN, Estimate, Variance
from sysid.estimation.quality import LEAST_EXPLAINED, SCATTER_TIMES
from sysid.identification.friction.clusters import Clusters, cluster_test
from sysid.identification.friction.cross_check import SLIDING_FIRST, disagreement
from sysid.identification.friction.effort import (
    TrialUse,
    against_motion,
    by_reason,
    pushed_along,
    titles,
)
from sysid.identification.friction.load import fit_load, is_clear
from sysid.identification.friction.motion import (
    HARDLY_MOVES,
    MotionFriction,
    common_cutoff,
    effort_rmse,
    fit_motion,
    moving_samples,
    usable_motion,
    usual_cutoff,
)
from sysid.identification.friction.rests import static_of_rests
from sysid.identification.friction.result import FrictionResult, doubtful, too_heavy
from sysid.identification.friction.sliding import (
    ANOTHER_LEVEL,
    SlidingFriction,
    SlidingPoints,
    fit_sliding,
)
from sysid.identification.friction.static import (
    PositionMean,
    StaticFriction,
    fit_static,
    static_summary,
)
from sysid.identification.friction.steady_stretch import levels_of_tests, sliding_points
from sysid.io.channels import CHAMBER_PRESSURES
from sysid.io.effort_timing import effort_is_read, readings_line, with_commands
from sysid.io.logs import Trial, any_contradiction, with_channels
from sysid.io.motion import LOADS, MotionUnits
from sysid.io.rig import Rig
from sysid.recording.even import pause_line, recorded
from sysid.recording.friction_kind import KINDS, MOTION, SLIDING, STATIC, classify, classify_trial
from sysid.recording.recording import Recording

__all__ = [
    "KINDS",
    "Clusters",
    "FrictionResult",
    "MotionFriction",
    "PositionMean",
    "SlidingFriction",
    "SlidingPoints",
    "StaticFriction",
    "TrialUse",
    "classify_trial",
    "cluster_test",
    "fit_friction",
    "fit_sliding",
    "friction_rmse",
    "static_summary",
]


_WANTED = {
    STATIC: "no friction-static test: give slow ramps of the motor's effort from zero",
    SLIDING: f"no usable friction-sliding test: {ANOTHER_LEVEL}, or a friction-motion test",
    MOTION: "no friction-motion test: give a motion that accelerates and reverses",
}

# The lowest cut-off that is tried for motion whose acceleration is mostly noise.
_LOWEST_HZ = 1.0

Result = TypeVar("Result")


@dataclass
class _Fit:
    """A fit in progress: the trials by kind, the notices, and the reasons for failures."""

    rig: Rig
    units: MotionUnits
    by_kind: dict[str, list[Recording]]
    uses: list[TrialUse] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)
    failures: dict[str, Failure] = field(default_factory=dict)
    sums: Sums = field(default_factory=Sums)
    contradicted: bool = False
    is_forced: bool = False
    cutoff_hz: float = math.nan  # known once all trials are read

    def attempt(self, kind: str, fit: Callable[[], Result | None]) -> Result | None:
        """The fit of one kind of test; None, with the reason kept, where it gives nothing."""
        if not self.by_kind[kind]:
            return None
        found = on_its_own(fit)
        if not isinstance(found, Failure):
            return found
        self.failures[kind] = found
        if kind != SLIDING or not self.sums:
            for use in self.uses:
                if use.kind == kind and use.used:
                    use.exclude(found.reason)
        return None

    def wanted(self, kind: str) -> str:
        """The test that is missing, one that the rig can do."""
        if not self.rig.has_air_alone:
            return _WANTED[kind]
        return f"give {self.rig.friction_tests['static' if kind == STATIC else 'coulomb']}"

    @property
    def reasons(self) -> dict[str, str]:
        """Why a kind of test gives nothing."""
        return {kind: why.reason for kind, why in self.failures.items()}


def fit_friction(
    trials: Sequence[Trial],
    rig: Rig,
    *,
    kind: str | Sequence[str | None] | None = None,
    estimate_inertia: bool = False,
    cutoff_hz: float | None = None,
    load: str | None = None,
) -> FrictionResult:
    """Static, Coulomb and viscous friction (and offset and inertia) from a rig's friction tests.

    `kind` (`static`, `sliding`, `motion`, or with `friction-` in front) overrides
    each trial's content; one for all, or one per trial. The inertia is estimated from motion
    where the rig file gives none or an assumed one, or on demand. `cutoff_hz` None: 50 Hz, or
    lower as the sampling and the noise of the motion require. `load` "motor" or "transmitted":
    with a part that grows with that effort; all moving tests are used as motion then. Raises
    InputError where a channel is missing, NotIdentifiedError where the tests identify none of the
    parameters.
    """
    fit = _prepared(trials, rig, kind, cutoff_hz)
    if load is not None:
        return _with_load(fit, estimate_inertia, load)
    try:
        found = _of(fit, estimate_inertia)
    except NotIdentifiedError:
        turned = against_motion(fit.uses)
        line = _reversed(trials, rig, kind, estimate_inertia, cutoff_hz) if turned else ""
        line = line or _another_time(trials, rig, kind, cutoff_hz)
        if not line:
            raise
        raise NotIdentifiedError(f"friction: {line}") from None
    if found.is_negative or found.impossible or against_motion(found.trials):
        line = _reversed(trials, rig, kind, estimate_inertia, cutoff_hz, found)
        if not line and found.impossible:
            line = _reversed_in_one(trials, rig, kind, estimate_inertia, cutoff_hz)
        found = replace(found, reversed_sign=line)
    moving = found.quality.get(MOTION)
    if moving is not None and moving.verdict != "good" and not found.reversed_sign:
        line = found.wrong_time or _another_time(trials, rig, kind, cutoff_hz)
        found = replace(found, wrong_time=line)
    return found


def _another_time(
    trials: Sequence[Trial],
    rig: Rig,
    kind: str | Sequence[str | None] | None,
    cutoff_hz: float | None,
) -> str:
    """That time_s is in another unit by the rig file's inertia, or empty."""
    if not rig.has_declared_inertia:
        return ""
    free = on_its_own(partial(_whole, trials, rig, kind, True, cutoff_hz))
    return "" if isinstance(free, Failure) else free.another_time(rig)


def _reversed(
    trials: Sequence[Trial],
    rig: Rig,
    kind: str | Sequence[str | None] | None,
    estimate_inertia: bool,
    cutoff_hz: float | None,
    as_it_is: FrictionResult | None = None,
) -> str:
    """Which channel's sign is reversed and how to map it, if a fit with the other sign is good;
    empty where none is.

    Pressures that are swapped show in what a fit misses, where there is one of the log `as_it_is`.
    """

    fitting = (rig, kind, estimate_inertia, cutoff_hz)
    found: dict[str, FrictionResult] = {}
    for channel in (rig.effort_channel, rig.position_channel):
        turned = [with_channels(t, **{channel: -t[channel]}) for t in trials if channel in t]
        if (fit := _good(turned, *fitting)) is not None:
            found[channel] = fit
    a, b = CHAMBER_PRESSURES
    swap = f'--map "{a}={b}" --map "{b}={a}"'
    swapped = None
    if all(a in t and b in t for t in trials):
        crossed = [with_channels(t, **{a: t[b], b: t[a]}) for t in trials]
        swapped = _good(crossed, *fitting)
    if swapped is not None and as_it_is is not None:
        swapped = swapped if SCATTER_TIMES * swapped.misses < as_it_is.misses else None
    if not found:
        said = f"{a} and {b} are swapped: the other way round the fit is good; give {swap}"
        return "" if swapped is None else said
    # In a log with pressures, the sign of the position is not that of the effort.
    ranked = sorted(found, key=lambda n: (-len(found[n].of_sliding()), found[n].misses))
    name, best = ranked[0], found[ranked[0]]
    likely = [n for n in ranked if _alike(found[n], best)]
    fix = next(t.reversed_map(name) for t in trials if name in t)
    sliding = rig.units.keyed(best.of_sliding())
    sliding = sliding or {c.expression: c.estimate for c in best.combinations}
    numbers = ", ".join(f"{n} = {e.value:.3g} {e.unit}" for n, e in sliding.items())
    shown = f" ({numbers})" if numbers else ""
    # Two chambers alike push as far one way as the other.
    instead = swapped is not None and _alike(swapped, best)
    or_swapped, or_swap = (f", or {a} and {b} are swapped", f", or {swap}") if instead else ("", "")
    return (
        f"the sign of {' or of '.join(likely)} is reversed{or_swapped}: with the other sign the "
        f'fit is good{shown}; give --map "{fix}"{or_swap}'
    )


def _reversed_in_one(
    trials: Sequence[Trial],
    rig: Rig,
    kind: str | Sequence[str | None] | None,
    estimate_inertia: bool,
    cutoff_hz: float | None,
) -> str:
    """Which channel's sign is reversed in one of several logs, if with the other sign there the fit
    of them all is good; empty where none is."""
    files: dict[str, list[Trial]] = {}
    for trial in trials:
        files.setdefault(trial.source.removesuffix(f", test {trial.label}"), []).append(trial)
    if len(files) < 2:
        return ""
    for channel in (rig.effort_channel, rig.position_channel):
        for file, log in files.items():
            own = {t.source for t in log if channel in t}
            turned = [
                with_channels(t, **{channel: -t[channel]}) if t.source in own else t for t in trials
            ]
            fit = _good(turned, rig, kind, estimate_inertia, cutoff_hz) if own else None
            # A fit that leaves the turned log out says nothing of its sign.
            if fit is not None and any(use.used and use.source in own for use in fit.trials):
                first = next(t for t in log if channel in t)
                return (
                    f"the sign of {rig.effort_channel} or of {rig.position_channel} is reversed in "
                    f"{Path(file).name}: with the other sign there the fit of all logs is good; "
                    f'convert that log with --map "{first.reversed_map(channel)}"'
                )
    return ""


def _good(
    trials: Sequence[Trial],
    rig: Rig,
    kind: str | Sequence[str | None] | None,
    estimate_inertia: bool,
    cutoff_hz: float | None,
) -> FrictionResult | None:
    """The fit of trials as they are, if there is one that is beyond doubt."""
    fit = on_its_own(partial(_whole, trials, rig, kind, estimate_inertia, cutoff_hz))
    return None if isinstance(fit, Failure) or not fit.is_beyond_doubt else fit


def _alike(one: FrictionResult, best: FrictionResult) -> bool:
    """Whether a fit is as good as the best: the two signs are then indistinguishable."""
    same = len(one.of_sliding()) == len(best.of_sliding())
    return same and one.misses <= SCATTER_TIMES * best.misses


def _whole(
    trials: Sequence[Trial],
    rig: Rig,
    kind: str | Sequence[str | None] | None,
    estimate_inertia: bool,
    cutoff_hz: float | None,
) -> FrictionResult:
    """The fit of trials as they are."""
    return _of(_prepared(trials, rig, kind, cutoff_hz), estimate_inertia)


def _of(fit: _Fit, estimate_inertia: bool) -> FrictionResult:
    """The fit of the trials by kind. Raises NotIdentifiedError where none gives anything."""
    rig = fit.rig
    static = fit.attempt(STATIC, lambda: _static(fit)) or _static_without_ramps(fit)
    inertia = rig.total_inertia()
    declared = inertia if rig.has_declared_inertia else None
    repeats = UNKNOWN if static is None else static.repeats
    free = None if estimate_inertia else declared
    motion = fit.attempt(MOTION, lambda: _motion(fit, free, repeats))
    # An inertia below zero is none: what is assumed, if anything, is nearer.
    if declared is None and motion is not None and motion.inertia is not None:
        inertia = motion.inertia.value if motion.inertia.value > 0.0 else inertia
    said = len(fit.notices)
    sliding = fit.attempt(SLIDING, lambda: _sliding(fit.by_kind[SLIDING], fit, inertia))
    lacking = motion is None or not motion.viscous.identified
    if sliding is None and lacking and fit.by_kind[SLIDING] and not fit.is_forced:
        whole = _as_motion(fit, free, said, repeats)
        motion = whole or motion
        sliding = None if whole else _by_levels(fit, inertia, said)
    if sliding is not None and motion is not None and _refutes(motion, sliding):
        _set_aside(fit, sliding)
        sliding = None
    if static is not None and motion is not None:
        static = static.with_scatter(motion.repeats)
    if static is None and sliding is None and motion is None and not fit.sums:
        raise error_of(list(fit.failures.values()), _nothing(fit))
    return _result(fit, static, sliding, motion, estimate_inertia)


def _with_load(fit: _Fit, estimate_inertia: bool, of: str) -> FrictionResult:
    """The fit with a part of friction that grows with an effort. Raises NotIdentifiedError."""
    if of not in LOADS:
        raise input_error("load", f"{of!r} is unknown", f"use {' or '.join(LOADS)}")
    trials = [*fit.by_kind[MOTION], *fit.by_kind[SLIDING]]
    fit.by_kind[MOTION], fit.by_kind[SLIDING] = trials, []
    declared = fit.rig.total_inertia() if fit.rig.has_declared_inertia else None
    inertia = None if estimate_inertia else declared
    fit.cutoff_hz = common_cutoff(trials, fit.cutoff_hz)
    said: list[str] = []
    samples, uses = usable_motion(trials, fit.cutoff_hz, said)
    while not is_clear(samples, inertia) and fit.cutoff_hz > _LOWEST_HZ:
        fit.cutoff_hz *= 0.5
        said.clear()
        samples, uses = usable_motion(trials, fit.cutoff_hz, said)
    fit.notices += said
    fit.uses += uses
    motion, load = fit_load(samples, inertia, fit.units, of)
    fit.notices += motion.notices
    fit.notices += [] if load.is_shown else [load.notice]
    static = fit.attempt(STATIC, lambda: _static(fit))
    found = _result(fit, static, None, motion, estimate_inertia)
    return replace(found, load=load if load.is_shown else None)


def _refutes(motion: MotionFriction, sliding: SlidingFriction) -> bool:
    """Whether constant-effort tests give an impossible friction, and motion a possible one.

    A force that changes along the stroke (a spring, a cushion, a tilt) is confounded with the speed
    in a test in one direction; motion to and fro separates it from friction.
    """
    if not any(e.identified and e.interval[1] < 0.0 for e in (sliding.coulomb, sliding.viscous)):
        return False
    if not motion.both_ways or motion.explained < LEAST_EXPLAINED:
        return False
    own = (motion.coulomb, motion.viscous)
    if all(e.identified for e in own):
        return own[0].interval[0] > 0.0 and own[1].interval[1] > 0.0
    # Only their sum is known; with the offset it may have either sign.
    sums = (c.estimate for c in motion.combinations if "coulomb" in c.terms)
    return any(e.interval[0] > 0.0 for e in sums)


def _set_aside(fit: _Fit, sliding: SlidingFriction) -> None:
    """Constant-effort tests that are excluded because of their own law."""
    named = fit.units.keyed({"coulomb": sliding.coulomb, "viscous": sliding.viscous})
    wrong = " and ".join(
        f"{name} = {e.value:.3g} {e.unit}"
        for name, e in named.items()
        if e.identified and e.interval[1] < 0.0
    )
    why = (
        f"they give {wrong}, which cannot be friction, while motion in both directions does not: "
        "an effort that changes along the stroke or with the direction acts in them"
    )
    fit.failures[SLIDING] = Failure(why)
    fit.sums = Sums()
    for use in fit.uses:
        if use.kind == SLIDING and use.used:
            use.exclude(why)


def _prepared(
    trials: Sequence[Trial],
    rig: Rig,
    kind: str | Sequence[str | None] | None,
    cutoff_hz: float | None,
) -> _Fit:
    if cutoff_hz is not None and not 0.0 < cutoff_hz < math.inf:
        raise input_error(
            "--cutoff",
            f"{cutoff_hz:g} Hz is not a cut-off frequency",
            "give a frequency above 0, or omit it",
        )
    fit = _Fit(rig, rig.units, {name: [] for name in KINDS})
    fit.is_forced = isinstance(kind, str)
    fit.contradicted = any_contradiction(trials)
    declared = [kind] * len(trials) if kind is None or isinstance(kind, str) else list(kind)
    moving: list[Trial] = []
    pauses: dict[str, list[TrialUse]] = {}
    for trial, name in zip(trials, declared, strict=True):
        if len(trial) < 2:
            use = TrialUse(trial.label, trial.source, _kind(name) if name else MOTION)
            use.exclude("a test needs at least two samples")
            fit.uses.append(use)
            fit.notices.append(f"{use.title}: excluded, {use.reason}")
            continue
        even = recorded(trial, rig, fit.notices)
        full = _kind(name) if name else classify(even)
        if full == STATIC and not trial.has_its_start:
            use = TrialUse(trial.label, trial.source, full)
            use.exclude("its start is excluded, and a ramp has to start at rest")
            fit.uses.append(use)
            continue
        paused = pause_line(trial)
        if paused:
            use = TrialUse(trial.label, trial.source, full)
            pauses.setdefault(paused, []).append(use)
            if full == STATIC:
                # Which effort the breakaway took may lie in it.
                use.exclude("its recording pauses")
                fit.uses.append(use)
                continue
        fit.by_kind[full].append(even)
        if full == MOTION:
            moving.append(trial)
    fit.notices += [f"{titles(own)}: {said}" for said, own in pauses.items()]
    if effort_is_read(moving, rig):
        commanded = with_commands(moving, rig)
        fit.by_kind[MOTION] = [recorded(trial, rig, fit.notices) for trial in commanded]
        fit.notices.append(readings_line(rig))
    fit.by_kind = {name: _distinguished(own) for name, own in fit.by_kind.items()}
    pushed = pushed_along([e for kind in (SLIDING, MOTION) for e in fit.by_kind[kind]])
    if pushed:
        fit.notices.append(pushed)
    moved = fit.by_kind[MOTION]
    fit.cutoff_hz = usual_cutoff(moved, fit.notices) if cutoff_hz is None else cutoff_hz
    return fit


def _distinguished(trials: Sequence[Recording]) -> list[Recording]:
    """The trials of one kind; where their files number them alike, the file is in the label."""
    count = Counter(trial.label for trial in trials)
    return [
        trial.named(f"{trial.label} of {Path(_file(trial)).name}")
        if trial.label and count[trial.label] > 1
        else trial
        for trial in trials
    ]


def _file(trial: Recording) -> str:
    return trial.source.removesuffix(f", test {trial.label}")


def _kind(name: str) -> str:
    full = name if name.startswith("friction-") else f"friction-{name}"
    if full not in KINDS:
        short = ", ".join(k.removeprefix("friction-") for k in KINDS)
        raise input_error(f"kind {name!r}", "is not a kind of friction test", f"use one of {short}")
    return full


def _reasons(uses: Sequence[TrialUse]) -> str:
    """Why tests were excluded, each reason once with its tests."""
    return "; ".join(f"{titles(own)}: {why}" for why, own in by_reason(uses).items())


def _static(fit: _Fit) -> StaticFriction | None:
    result, uses = fit_static(fit.by_kind[STATIC], fit.units, fit.notices)
    fit.uses += uses
    if result is None:
        raise NotIdentifiedError(
            f"static friction: no ramp is usable ({_reasons(uses)}); {fit.wanted(STATIC)}"
        )
    fit.notices += result.notices
    return result


def _static_without_ramps(fit: _Fit) -> StaticFriction | None:
    """Static friction of a rig without a motor, from the rests of its motions; None where these
    are too few."""
    moving = fit.by_kind[MOTION]
    if not fit.rig.has_air_alone or fit.by_kind[STATIC] or any(t.has_motor for t in moving):
        return None
    found = on_its_own(partial(static_of_rests, moving, fit.units, fit.notices))
    if isinstance(found, Failure):
        fit.failures[STATIC] = found
        return None
    return found


def _sliding(trials: Sequence[Recording], fit: _Fit, inertia: float | None) -> SlidingFriction:
    points, uses = sliding_points(trials, inertia, fit.units, fit.notices)
    fit.uses += uses
    if points is None:
        raise NotIdentifiedError(
            "Coulomb and viscous friction: no constant-effort trial is usable "
            f"({_reasons(uses)}); {fit.wanted(SLIDING)}"
        )
    try:
        result = fit_sliding(points, fit.units)
    except NotIdentifiedError:
        way = points.direction
        fit.sums = mean_friction(points.friction, points.speed, way, fit.units)
        raise
    if not result.offset.identified:
        one_way = Separation(False, True, float(points.direction[0]))
        fit.sums = combined([result.coulomb], (0.0, 0.0), one_way, fit.units)
    fit.notices += result.notices
    return result


def _by_levels(fit: _Fit, inertia: float | None, before: int) -> SlidingFriction | None:
    """Friction from each level of constant-effort tests that hold several. It replaces the notices
    from the number `before` on. None, and nothing is changed, where that does not identify it."""
    levels = levels_of_tests(fit.by_kind[SLIDING])
    if len(levels) == len(fit.by_kind[SLIDING]):
        return None
    kept = fit.sums, fit.notices, fit.uses
    fit.sums, fit.notices = Sums(), fit.notices[:before]
    fit.uses = [use for use in fit.uses if use.kind != SLIDING]
    found = on_its_own(partial(_sliding, levels, fit, inertia))
    if isinstance(found, Failure):
        fit.sums, fit.notices, fit.uses = kept
        return None
    fit.notices.append(
        f"{len(levels)} levels of {len(fit.by_kind[SLIDING])} {SLIDING} tests are used"
    )
    del fit.failures[SLIDING]
    return found


def _as_motion(
    fit: _Fit, inertia: float | None, before: int, repeats: Variance
) -> MotionFriction | None:
    """Friction from constant-effort tests by all of their motion, where one number a test does not
    identify it: a test may hold several levels, and speeds on the way to each. It replaces the
    notices from the number `before` on. None where that does not identify it either; then nothing
    is changed."""
    trials = [*fit.by_kind[MOTION], *fit.by_kind[SLIDING]]
    said: list[str] = []

    def whole() -> tuple[MotionFriction, list[TrialUse], float]:
        usual = common_cutoff(trials, fit.cutoff_hz)
        samples, uses, cutoff = moving_samples(trials, usual, inertia, said)
        return fit_motion(samples, inertia, fit.units, repeats), uses, cutoff

    found = on_its_own(whole)
    if isinstance(found, Failure):
        return None
    result, uses, cutoff = found
    # Under a constant effort all that changes the speed is the inertia.
    inert = result.inertia is None or result.inertia.identified
    if not (result.viscous.identified and inert):
        return None
    fit.cutoff_hz, fit.sums = cutoff, Sums()
    fit.by_kind[MOTION], fit.by_kind[SLIDING] = trials, []
    fit.uses = [use for use in fit.uses if use.kind not in (MOTION, SLIDING)] + uses
    fit.notices[before:] = [
        f"one speed of each {SLIDING} test does not separate Coulomb from viscous friction: they "
        f"are used as {MOTION} tests, with all their speeds",
        *said,
        *result.notices,
    ]
    fit.failures = {k: why for k, why in fit.failures.items() if k not in (MOTION, SLIDING)}
    return result


def _motion(fit: _Fit, inertia: float | None, repeats: Variance) -> MotionFriction | None:
    samples, uses, fit.cutoff_hz = moving_samples(
        fit.by_kind[MOTION], fit.cutoff_hz, inertia, fit.notices
    )
    fit.uses += uses
    if not samples:
        others = [use for use in uses if use.reason != HARDLY_MOVES]
        why = f"Coulomb and viscous friction: {_reasons(others)}" if others else _why_still(fit)
        raise NotIdentifiedError(why)
    result = fit_motion(samples, inertia, fit.units, repeats)
    fit.notices += result.notices
    return result


def _why_still(fit: _Fit) -> str:
    """Why no motion test gives a sample: what the logs show instead."""
    trials, rig = fit.by_kind[MOTION], fit.rig
    files = ", ".join(dict.fromkeys(_file(trial) for trial in trials))
    if any(trial.valves_on for trial in trials):
        return (
            f"{files}: valves are on while the shaft is held, which shows no friction; use `sysid "
            "fit valve-discrete` or `sysid fit valve-pwm`"
        )
    still = f"{rig.position_channel} hardly changes"
    if not any(np.any(trial.motor) for trial in trials):
        has_motor = any(trial.has_motor for trial in trials)
        lacking = f"{rig.effort_channel} stays zero" if has_motor else "nothing drives the shaft"
        fix = "give tests" if has_motor else f"map {rig.effort_channel}, or give tests"
        return (
            f"{files}: {lacking} and {still}; {fix} in which the motor moves the shaft, for its "
            "friction"
        )
    return (
        f"{files}: {still}; Coulomb and viscous friction need motion tests that cross the stroke "
        "in both directions"
    )


def _nothing(fit: _Fit) -> str:
    if fit.reasons:
        return "; ".join(fit.reasons.values())
    return "static, Coulomb and viscous friction: no friction test is given; " + fit.wanted(STATIC)


@dataclass(frozen=True)
class _Moving:
    """Friction from one kind of moving test: the fit, the sums that it does not separate, and an
    offset that it does."""

    kind: str
    fit: SlidingFriction | MotionFriction | None
    sums: tuple[Combination, ...] = ()
    offset: Estimate | None = None

    def parameters(self, u: MotionUnits, reason: str = "") -> dict[str, Estimate]:
        """Coulomb and viscous friction, and the offset where the tests identify it."""
        names = ("coulomb", "viscous", "offset")
        own = {} if self.fit is None else {name: getattr(self.fit, name) for name in names}
        own |= {} if self.offset is None else {"offset": self.offset}
        in_sums = {name for c in self.sums for name in c.terms}
        return {
            name: unidentified(name, u.unit(name), self.sums, reason)
            if name in in_sums or name not in own
            else own[name]
            for name in names
            if name != "offset" or name in own or name in in_sums
        }

    def found(self, u: MotionUnits) -> int:
        """How many of Coulomb and viscous friction are identified."""
        own = self.parameters(u)
        return sum(own[name].identified for name in ("coulomb", "viscous"))

    def apart(self, u: MotionUnits) -> int:
        """How many sums, and an offset next to them, are known."""
        offset = self.parameters(u).get("offset")
        return len(self.sums) + bool(self.sums and offset is not None and offset.identified)


def _chosen(fit: _Fit, sliding: SlidingFriction | None, motion: MotionFriction | None) -> _Moving:
    """The constant-effort tests, unless motion identifies more parameters, or more sums."""
    kinds = []
    if sliding is not None or fit.sums:
        kinds.append(_Moving(SLIDING, sliding, fit.sums.rows, fit.sums.offset))
    if motion is not None:
        kinds.append(_Moving(MOTION, motion, motion.combinations))
    return max(
        kinds, key=lambda k: (k.found(fit.units), k.apart(fit.units)), default=_Moving(STATIC, None)
    )


def _result(
    fit: _Fit,
    static: StaticFriction | None,
    sliding: SlidingFriction | None,
    motion: MotionFriction | None,
    estimate_inertia: bool,
) -> FrictionResult:
    u = fit.units
    chosen = _chosen(fit, sliding, motion)
    reason = fit.reasons.get(SLIDING) or fit.reasons.get(MOTION) or fit.wanted(SLIDING)
    parameters = {
        "static": Estimate.unidentified(u.effort, fit.reasons.get(STATIC, fit.wanted(STATIC)))
        if static is None
        else static.estimate
    }
    parameters |= chosen.parameters(u, reason)
    if motion is not None and motion.inertia is not None:
        parameters["inertia"] = motion.inertia
    elif estimate_inertia:
        reason = fit.reasons.get(MOTION, fit.wanted(MOTION))
        parameters["inertia"] = Estimate.unidentified(u.inertia_unit, reason)
    checked = chosen.kind == SLIDING and motion is not None
    cross_check = _Moving(MOTION, motion).parameters(u) if checked else {}
    _say_what_lacks(fit, chosen)
    fit.notices += doubtful(parameters, fit.rig)
    _compare(parameters, cross_check, u, fit.notices)
    _order(parameters, u, fit.notices)
    return FrictionResult(
        units=u,
        parameters=parameters,
        source=chosen.kind,
        static=static,
        sliding=sliding,
        motion=motion,
        cross_check=cross_check,
        trials=tuple(fit.uses),
        notices=tuple(about("friction", fit.notices)),
        cutoff_hz=fit.cutoff_hz,
        combinations=chosen.sums,
        most_effort=_most_effort(fit.rig),
        motor_limit=math.inf if fit.rig.max_effort is None else fit.rig.max_effort,
        contradicted=fit.contradicted,
        wrong_time=too_heavy(parameters, fit.rig),
    )


def _say_what_lacks(fit: _Fit, chosen: _Moving) -> None:
    """Notices of what is not identified, none of which names a parameter that is."""
    found = chosen.found(fit.units)
    for kind, reason in fit.reasons.items():
        if kind == STATIC or not (found or chosen.sums):
            fit.notices.append(f"not identified: {reason}")
        elif kind != chosen.kind:
            fit.notices.append(f"{kind} tests alone do not suffice: {reason}")
    fit.notices += [c.notice for c in chosen.sums]
    if chosen.kind == MOTION and fit.by_kind[SLIDING]:
        fit.notices.append("Coulomb and viscous friction are those of the friction-motion tests")
        for use in fit.uses:
            if use.kind == SLIDING and use.used:
                use.exclude("such tests identify less than the friction-motion tests here")


def _most_effort(rig: Rig) -> float:
    """What motor, cylinder and gravity can give together, N or Nm; infinite if not declared."""
    if rig.max_effort is None:
        return math.inf
    c, air, pushed = rig.cylinder, rig.air, 0.0
    if c is not None and air is not None:
        gauge = abs(air.supply_pressure_pa - air.atmospheric_pressure_pa)
        pushed = gauge * max(c.area_a_m2, c.area_b_m2) * c.pitch_radius_m
    return rig.max_effort + pushed + abs(rig.gravity_moment())


def _compare(
    parameters: dict[str, Estimate],
    cross_check: dict[str, Estimate],
    u: MotionUnits,
    notices: list[str],
) -> None:
    """Add notices of which tests give the value, and where the others disagree."""
    if not cross_check:
        return
    notices.append(SLIDING_FIRST)
    for name, check in cross_check.items():
        said = disagreement(u.key(name), parameters[name], check)
        notices += [] if said is None else about(f"friction.{u.key(name)}", [said])


def _order(parameters: dict[str, Estimate], u: MotionUnits, notices: list[str]) -> None:
    static, coulomb = parameters["static"], parameters["coulomb"]
    apart = static.interval[1] < coulomb.interval[0]
    if static.identified and coulomb.identified and apart:
        line = (
            f"static friction ({static.value:.4g} {u.effort}) is below Coulomb friction "
            f"({coulomb.value:.4g} {u.effort}), which is not physical: check the ramps"
        )
        notices.append(Notice(line, f"friction.{u.key('static')}"))


def friction_rmse(result: FrictionResult, trials: Sequence[Trial], rig: Rig) -> float:
    """RMSE (N or Nm) of the motor's effort that `result` predicts, on held-out motion trials.

    Both sides filtered as in the fit. Raises NotIdentifiedError where the result lacks
    Coulomb, viscous friction or an inertia (its own, or the rig file's).
    """
    own = result.parameters
    inertia = own["inertia"].value if "inertia" in own else rig.total_inertia()
    coulomb, viscous = own["coulomb"], own["viscous"]
    if inertia is None or not (coulomb.identified and viscous.identified):
        raise NotIdentifiedError(f"the effort in motion: {_WANTED[MOTION]}")
    offset = own.get("offset")
    constant = offset.value if offset is not None and offset.identified else 0.0
    even = [recorded(trial, rig, []) for trial in trials]
    load = result.load
    share = (0.0, 0) if load is None else (load.share.value, LOADS.index(load.of))
    return effort_rmse(
        even, coulomb.value, viscous.value, constant, inertia, result.cutoff_hz, share
    )
