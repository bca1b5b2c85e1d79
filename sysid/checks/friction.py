"""Which friction parameters a log identifies: those that the fit of the same tests returns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from sysid.errors import InputError, NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.friction import FrictionResult, fit_friction
from sysid.io.campaign import FRICTION_KINDS, FRICTION_POINTS, MOTION_KINDS
from sysid.io.channels import CHAMBER_PRESSURES
from sysid.io.logs import Trial
from sysid.io.motion import MotionUnits
from sysid.io.rig import Rig
from sysid.recording.friction_kind import MOTION, SLIDING, STATIC, balances

_MOVING = "needs friction-sliding or friction-motion tests in both directions"
_NO_TEST = "the campaign declares no friction or motion test of it"


@dataclass(frozen=True)
class Identification:
    """Whether a log identifies a parameter, and why, or which test would identify it."""

    parameter: str
    identified: bool
    reason: str


def friction_identified(
    trials: Sequence[Trial], rig: Rig, declared: str | None = None
) -> Iterator[Identification]:
    """Static, Coulomb and viscous friction, offset and inertia in turn.

    `declared` is the kind that a campaign gives the log, whose fit then takes it so; the inertia is
    what a fit would give that estimates it.
    """
    u = rig.units
    unbalanced = not any(
        rig.effort_channel in t or rig.air_alone_drives(t.channels) for t in trials
    )
    if trials and unbalanced and declared is None:
        why = (
            f"column {rig.effort_channel} is missing: map it, if the log has it under another "
            f"name; of a motor that is off or not connected, --set {rig.effort_channel}=0"
            if rig.cylinder is None or rig.has_declared_motor
            else f"column {rig.effort_channel} is missing, and so is a chamber pressure: map what "
            "drives the shaft, an effort or both pressures"
        )
        if all(is_of_one_pressure(t, rig) for t in trials):
            why += "; one pressure and no position is a tank's test, where the rig file has [tank]"
        for parameter in (*_names(u), "inertia"):
            yield Identification(parameter, False, why)
        return
    yield from _each(rig, declared, partial(_fitted, trials, rig, declared))


def is_of_one_pressure(trial: Trial, rig: Rig) -> bool:
    """Whether a test may be one of a vessel, by its columns."""
    return (
        rig.position_channel not in trial and sum(name in trial for name in CHAMBER_PRESSURES) == 1
    )


def friction_together(
    trials: Sequence[Trial], kinds: Sequence[str] | str, rig: Rig
) -> Iterator[Identification]:
    """The same for the tests of several logs, fitted together; `kinds` of each trial, or
    `FRICTION_POINTS`."""
    if kinds == FRICTION_POINTS:
        yield from _each(rig, FRICTION_POINTS, lambda **_: _of_points(trials, rig))
    elif trials:
        yield from _each(rig, None, partial(_of_tests, trials, rig, kinds))
    else:
        yield from _each(rig, None, lambda **_: ({}, _NO_TEST))


def _each(
    rig: Rig, declared: str | None, fitted: Callable[..., tuple[dict[str, Estimate], str]]
) -> Iterator[Identification]:
    """What the fits with and without an estimated inertia give for each parameter."""
    u = rig.units
    found, why = fitted(estimate_inertia=False)
    for parameter, name in _names(u).items():
        if declared != FRICTION_POINTS or name in found or not found:
            yield _identification(parameter, found, name, why)
    if declared == FRICTION_POINTS:
        return  # Readings of a steady motion, or of breakaway, are of nothing else.
    if rig.total_inertia() is not None:
        found, why = fitted(estimate_inertia=True)
    yield _identification("inertia", found, "inertia", why)


def _names(u: MotionUnits) -> dict[str, str]:
    return {
        "static friction": "static",
        "Coulomb friction": "coulomb",
        "viscous friction": "viscous",
        f"{u.word} offset": "offset",
    }


def _identification(
    parameter: str, found: Mapping[str, Estimate], name: str, why: str
) -> Identification:
    """`why`: the tests behind `found`, or why nothing was found."""
    estimate = found.get(name)
    if estimate is None:
        return Identification(parameter, False, _MOVING if found else why)
    return Identification(parameter, estimate.identified, estimate.reason or why)


def _fitted(
    trials: Sequence[Trial], rig: Rig, declared: str | None, *, estimate_inertia: bool
) -> tuple[dict[str, Estimate], str]:
    """The estimates of the fit by name, with the tests used, or why there are none."""
    if declared == FRICTION_POINTS:
        return _of_points(trials, rig)
    kind = MOTION if declared in MOTION_KINDS else declared
    if kind is not None and kind not in FRICTION_KINDS:
        return {}, _NO_TEST
    if declared in MOTION_KINDS:
        trials = [t for t in trials if balances(t, rig)]
    return _of_tests(
        trials, rig, kind, estimate_inertia=estimate_inertia, be_possible=declared is None
    )


def _of_tests(
    trials: Sequence[Trial],
    rig: Rig,
    kind: Sequence[str] | str | None,
    *,
    estimate_inertia: bool,
    be_possible: bool = False,
) -> tuple[dict[str, Estimate], str]:
    try:
        result = fit_friction(trials, rig, kind=kind, estimate_inertia=estimate_inertia)
        if be_possible:
            result.require_possible()
    except (InputError, NotIdentifiedError) as error:
        return {}, str(error)
    return result.parameters, _tests(result)


def _tests(result: FrictionResult) -> str:
    """ "14 of 14 friction-sliding tests"; those of motion are of any kind of log."""
    parts = []
    for kind in (STATIC, SLIDING, MOTION):
        own = [use for use in result.trials if use.kind == kind]
        if own:
            word = "motion" if kind == MOTION else kind
            parts.append(f"{sum(use.used for use in own)} of {len(own)} {word} tests")
    return ", ".join(parts)


def _of_points(trials: Sequence[Trial], rig: Rig) -> tuple[dict[str, Estimate], str]:
    """Readings taken by hand: the law of `sysid.diagnosis.bench`."""
    try:
        fitted, tests = bench_fit(FRICTION_POINTS, trials, rig)
    except (InputError, NotIdentifiedError) as error:
        return {}, str(error)
    by_name = zip(rig.units.named(fitted), fitted.values(), strict=True)
    return dict(by_name), f"{len(tests)} readings"


def bench_fit(
    kind: str, trials: Sequence[Trial], rig: Rig
) -> tuple[Mapping[str, Estimate], Sequence[str]]:
    """The law that tests of a part on a bench give, without effects, by the keys of a bundle, and
    the recording of each of its tests."""
    from sysid.diagnosis.bench.law_choice import chosen_law
    from sysid.diagnosis.bench.registry import component_of

    component = component_of(kind, trials, rig)
    choice = chosen_law(component)
    return choice.fitted.component.identified(choice.estimates), component.tests


__all__ = ["Identification", "bench_fit", "friction_identified", "friction_together"]
