"""PWM valves: from constant-duty tests to surfaces of mean flow over (duty, pressure).

Thesis 3.7: the piston is held, so that the mean flow follows from dP/dt (3.5.3); its samples
over duty and pressure are fitted by a bipolynomial (3.7.3) or a network (3.7.4), for filling
and discharging separately, each tied to the other where the flow is zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from sysid.errors import (
    Failure,
    InputError,
    NotIdentifiedError,
    about,
    error_of,
    grouped,
    input_error,
    on_its_own,
)
from sysid.identification.held_volume import position_count
from sysid.identification.valve_pwm.averaged import AUTO, LAWS, average_of
from sysid.identification.valve_pwm.coverage import coverage, unseen_regimes
from sysid.identification.valve_pwm.quality import CHECK, fails, require_sign
from sysid.identification.valve_pwm.remarks import Remarks
from sysid.identification.valve_pwm.result import (
    DIRECTIONS,
    DirectionFit,
    ValveAverage,
    ValvePwmFit,
)
from sysid.identification.valve_pwm.samples import (
    FlowSamples,
    PwmTest,
    choked_boundaries,
    sample_tests,
)
from sysid.identification.valve_pwm.selection import moved_valves, select_tests
from sysid.identification.valve_pwm.supply import supply_of_surfaces
from sysid.io.channels import SIDES, SWITCHES
from sysid.io.logs import Trial, any_contradiction
from sysid.io.rig import Rig
from sysid.io.trial_kind import away_from_ends, is_active, is_held
from sysid.surfaces.bipolynomial import N_TERMS, Bipolynomial
from sysid.surfaces.comparison import (
    ResolutionStudy,
    SurfaceComparison,
    SurfaceError,
    compare_surfaces,
    duty_errors,
    obeys_averaged_law,
    resolution_study,
)
from sysid.surfaces.domain import Domain
from sysid.surfaces.holdout import group_folds
from sysid.surfaces.samples import SurfacePoints, surface_points
from sysid.surfaces.zero_flow import apart_from, tie_points

if TYPE_CHECKING:
    from sysid.surfaces.ann import DutyNetwork

SURFACES = ("bipolynomial", "ann", "both")
# The names of the surfaces in results.
_FIELDS = {"bipolynomial": "bipolynomial", "ann": "network"}
FOLDS = 4
_NO_TEST = "no usable test"
_OTHER = {"fill": "discharge", "discharge": "fill"}
# A test that stays this close to its start, as a share of the range from atmosphere to supply,
# shows no mean flow: duties differ there by less than the pressure's noise.
_LEAST_TRAVEL = 0.01
# Share of usable rows below which missing ones, not the tests' length, are what leaves few means.
_WHOLE = 0.9

Result = TypeVar("Result")


def fit_valve_pwm(
    trials: Sequence[Trial],
    rig: Rig,
    *,
    valve: str | None = None,
    surface: str = "bipolynomial",
    seed: int = 0,
    sweep: bool = False,
    law: str = AUTO,
) -> ValvePwmFit:
    """Surfaces of mean flow from `valve-pwm` tests, for every valve that moves.

    `valve` ("a" or "b") restricts the fit to one; `surface`: "bipolynomial", "ann" or "both"
    (then compared on held-out tests); `seed` starts the folds and the network's restarts;
    `sweep` tries networks of several sizes (slow); `law` of the averaged law: "thesis", "iso6358",
    or "auto", by which the tests choose. Raises InputError for missing channels or rig sections,
    NotIdentifiedError where no surface can be identified.
    """
    if law not in (AUTO, *LAWS):
        raise input_error("law", f"{law!r} is no flow law", f"write {', '.join((*LAWS, AUTO))}")
    if surface not in SURFACES:
        raise input_error("surface", f"{surface!r} is unknown", f"use {', '.join(SURFACES)}")
    if valve not in (None, "a", "b"):
        raise input_error("valve", f"{valve!r} is unknown", "use a or b")
    if valve is not None:
        rig.require_side(valve, _place(trials))
    if rig.why_no_surfaces is not None:
        raise NotIdentifiedError(f"{_place(trials)}: {rig.why_no_surfaces}")
    moved = [v for v in moved_valves(trials) if v in rig.sides]
    valves = moved if valve is None else [v for v in moved if v == valve]
    if not valves:
        names = [f"duty_{v}" for v in (rig.sides if valve is None else (valve,))]
        if trials and not any(name in t for name in names for t in trials):
            raise _no_duty(trials, names, rig)
        verb = "never leave zero" if len(names) > 1 else "never leaves zero"
        raise NotIdentifiedError(
            f"{_place(trials)}: {' and '.join(names)} {verb}: no PWM surface is identified; "
            "valve-pwm tests (piston held, one constant duty per test) would identify it"
        )
    remarks = Remarks()
    measured: dict[tuple[str, str], DirectionFit] = {}
    fits: dict[tuple[str, str], DirectionFit] = {}
    failed: dict[tuple[str, str], Failure] = {}

    def unless_missing(
        into: dict[tuple[str, str], DirectionFit],
        key: tuple[str, str],
        fit: Callable[[], DirectionFit],
    ) -> None:
        found = on_its_own(fit)
        if isinstance(found, Failure):
            failed[key] = found
        else:
            into[key] = found

    for v in valves:
        tests = on_its_own(partial(select_tests, trials, rig, v, remarks))
        if isinstance(tests, Failure):
            failed |= dict.fromkeys(((v, direction) for direction in DIRECTIONS), tests)
            continue
        for direction in DIRECTIONS:
            own = [t for t in tests if t.filling == (direction == "fill")]
            others = [t.duty for t in tests if t.filling != (direction == "fill")]
            measure = partial(_measured, own, others, rig, v, direction, remarks)
            unless_missing(measured, (v, direction), measure)
    for key, base in measured.items():
        ties = _ties(base, measured.get((key[0], _OTHER[key[1]])))
        unless_missing(
            fits, key, partial(_with_surfaces, base, ties, surface, seed, sweep, remarks)
        )
    missing = {key: f"{_title(*key)}: {why.reason}" for key, why in failed.items()}
    if not fits:
        raise _nothing(failed, remarks)
    contradicted = any_contradiction(trials)
    fits = {key: replace(one, contradicted=contradicted) for key, one in fits.items()}
    averaged, unknown = _averaged(fits, rig, seed, position_count(trials, rig), remarks, law)
    unidentified = (*missing.values(), *unknown)
    away = away_from_ends([t for t in trials if any(f"duty_{v}" in t for v in SIDES)], rig)
    notices = (*remarks.notices(), *(f"not identified: {r}" for r in unidentified))
    notices += (away,) if away else ()
    summaries = tuple(_summary(f, averaged.get(f.valve)) for f in fits.values())
    return ValvePwmFit(fits, missing, summaries, tuple(about("valve-pwm", notices)), seed, averaged)


def _title(valve: str, direction: str) -> str:
    return f"valve {valve.upper()}, {DIRECTIONS[direction]}"


def _nothing(failed: Mapping[tuple[str, str], Failure], remarks: Remarks) -> Exception:
    """The error where no surface is identified; unusable input in its own words."""
    reasons = "; ".join(dict.fromkeys(why.reason for why in failed.values()))
    error = error_of(list(failed.values()), reasons)
    if isinstance(error, InputError):
        return error
    left_out = remarks.notices()
    if left_out and all(why.reason.startswith(_NO_TEST) for why in failed.values()):
        # What keeps the tests out is the cause, and what follows from it is the same everywhere.
        return type(error)(
            f"{'; '.join(grouped(left_out))}; no usable test remains: give valve-pwm tests, one "
            "constant duty each, piston held, from the atmosphere and from the supply"
        )
    titled = (f"{_title(*key)}: {why.reason}" for key, why in failed.items())
    return type(error)("; ".join((*left_out, *titled)))


def _no_duty(trials: Sequence[Trial], names: Sequence[str], rig: Rig) -> InputError:
    """The error of a log without the commands of a PWM valve; one of on/off valves is named."""
    held = [t for t in trials if is_held(t, rig)]
    other = next((n for n in SWITCHES if any(is_active(t, n) for t in held)), None)
    what = f"column {names[0]} is missing"
    if len(names) > 1:
        what = f"columns {' and '.join(names)} are missing"
    fix = f'add a duty, or map it with --map "{names[0]}=COLUMN:%"'
    if other is not None:
        fix = f"{other} switches: use `sysid fit valve-discrete`"
    return input_error(_place(trials), what, fix)


def _averaged(
    fits: Mapping[tuple[str, str], DirectionFit],
    rig: Rig,
    seed: int,
    count: float,
    remarks: Remarks,
    law: str,
) -> tuple[dict[str, ValveAverage], list[str]]:
    """Each valve's averaged law, and why those that are not identified are not.

    `count`: the encoder's, rad or m.
    """
    found, unknown = {}, []
    for valve in dict.fromkeys(v for v, _ in fits):
        own = {direction: fit for (v, direction), fit in fits.items() if v == valve}
        average = on_its_own(partial(average_of, own, rig, FOLDS, seed, count, law))
        if isinstance(average, Failure):
            unknown.append(f"valve {valve.upper()}: {average.reason}")
            continue
        doubted = any(fit.contradicted for fit in own.values())
        quality = {k: replace(q, contradicted=doubted) for k, q in average.quality.items()}
        found[valve] = replace(average, quality=quality)
        said = [f"valve {valve.upper()}, {line}" for line in average.notices]
        remarks.lines += about(f"valves.{valve}.pwm.averaged", said)
    return found, unknown


def _place(trials: Sequence[Trial]) -> str:
    if not trials:
        return "valve-pwm"
    return trials[0].source.removesuffix(f", test {trials[0].label}")


def _ties(base: DirectionFit, other: DirectionFit | None) -> SurfacePoints | None:
    """Points of the other direction that tie the surfaces at zero flow; None without tests."""
    return None if other is None else tie_points(base.points, other.points, base.domain)


def _measured(
    tests: Sequence[PwmTest],
    other_duties: Sequence[float],
    rig: Rig,
    valve: str,
    direction: str,
    remarks: Remarks,
) -> DirectionFit:
    """One direction's samples, points and domain, without surfaces."""
    where = _title(valve, direction)
    samples = _travelled(sample_tests(tests, rig), tests, direction, rig, remarks)
    if len(samples) == 0:
        start = "the atmosphere" if direction == "fill" else "the supply"
        raise NotIdentifiedError(
            f"{_NO_TEST}; valve-pwm tests from {start}, one constant duty each, piston held, "
            "would identify the surface"
        )
    require_sign(samples, direction)
    if np.median(np.unique(samples.test, return_counts=True)[1]) < 2:
        few = "most tests are so short that they give one mean flow, at one pressure; record longer"
        if np.mean([t.usable.mean() for t in tests]) < _WHOLE:
            few = (
                "most tests give one mean flow, at one pressure: so many rows are missing or "
                "excluded that few stretches are long enough for a mean over pulses; log every row"
            )
        raise NotIdentifiedError("; ".join((few, *unseen_regimes(samples, tests, rig))))
    try:
        domain = Domain.from_samples(samples.duty, samples.pressure, samples.flow)
    except NotIdentifiedError as error:
        raise NotIdentifiedError(
            "; ".join((str(error), *unseen_regimes(samples, tests, rig)))
        ) from None
    remarks.lines += [
        f"{where}: {line}" for line in coverage(samples, domain, other_duties, tests, rig)
    ]
    air = rig.require("air", "boundaries")
    seen = float(np.median(samples.supply_of(samples.test)))
    boundaries = choked_boundaries(air, seen)
    points = surface_points(
        samples.duty,
        samples.pressure,
        samples.flow,
        samples.test,
        samples.std,
        boundaries=boundaries,
    )
    points = points.select(domain.holds_duty(points.duty))
    return DirectionFit(
        valve=valve,
        direction=direction,
        supply_pressure_pa=supply_of_surfaces(seen, float(air.supply_pressure_pa)),
        boundaries_pa=boundaries,
        pwm_period_s=float(rig.require("pwm", "period").period_s),
        samples=samples,
        points=points,
        domain=domain,
        resolution=_resolution(samples),
        off_supply=_off_supply(tests, samples, direction, rig),
    )


def _off_supply(
    tests: Sequence[PwmTest], samples: FlowSamples, direction: str, rig: Rig
) -> tuple[FlowSamples, Domain] | None:
    """The samples with those of rows at another supply than the rig file's, and their domain.

    None where these rows give no more samples.
    """
    if all(np.array_equal(t.known, t.usable) for t in tests):
        return None
    whole = [replace(t, usable=t.known) for t in tests]
    found = _travelled(sample_tests(whole, rig), whole, direction, rig, Remarks())
    if len(found) <= len(samples):
        return None
    return found, Domain.from_samples(found.duty, found.pressure, found.flow)


def _travelled(
    samples: FlowSamples, tests: Sequence[PwmTest], direction: str, rig: Rig, remarks: Remarks
) -> FlowSamples:
    """The samples of tests in which the pressure left its start."""
    air = rig.require("air", "start pressures")
    start = samples.supply_of(samples.test)
    if direction == "fill":
        start = np.full(len(samples), air.atmospheric_pressure_pa)
    way = abs(air.supply_pressure_pa - air.atmospheric_pressure_pa)
    travel = np.zeros(len(tests))
    np.maximum.at(travel, samples.test, np.abs(samples.pressure - start))
    moved = travel > _LEAST_TRAVEL * way
    for number, test in enumerate(tests):
        if moved[number]:
            continue
        if (samples.test == number).any():
            remarks.exclude(
                test,
                f"the pressure stays within {100 * _LEAST_TRAVEL:.0f} % of its start, where flow "
                "and pressure do not distinguish such duties; the domain ends before them",
            )
        else:
            why = "no interval is long enough for a mean flow"
            if test.usable.mean() < _WHOLE <= test.known.mean():
                why += " at the rig file's supply, which surfaces need"
            elif test.usable.mean() < _WHOLE:
                why += ": so many of its rows are missing or excluded"
            remarks.exclude(test, why)
    return samples.part(moved[samples.test])


def _with_surfaces(
    base: DirectionFit,
    ties: SurfacePoints | None,
    surface: str,
    seed: int,
    sweep: bool,
    remarks: Remarks,
) -> DirectionFit:
    """The fit with the requested surfaces, and their errors on the direction's own points.

    Surfaces, and the comparisons that judge them, are independent: one that fails gives a notice.
    Raises NotIdentifiedError, or the surfaces' own error, where none remains.
    """
    points, samples, own_domain = base.points, base.samples, base.domain
    where = _title(base.valve, base.direction)
    tied = points.joined(ties)
    domain = own_domain
    if ties is not None:
        domain = own_domain.with_points(ties.duty, ties.pressure, ties.flow)
    content = {name: getattr(base, name) for name in base.__dataclass_fields__}
    errors: dict[str, dict[str, SurfaceError]] = {}
    failed: dict[str, Failure] = {}

    def judged(what: str, job: Callable[[], Result]) -> Result | None:
        found = on_its_own(job)
        if not isinstance(found, Failure):
            return found
        remarks.lines.append(f"{where}: {what}: {found.reason}")
        return None

    comparison: SurfaceComparison | None = None
    if surface == "both":
        compare = partial(
            compare_surfaces, samples.duty, samples.pressure, samples.flow, samples.test,
            samples.std, FOLDS, _network(domain, seed), ties, base.boundaries_pa,
        )  # fmt: skip
        content["comparison"] = comparison = judged("the surfaces are not compared", compare)
    for name in _FIELDS if surface == "both" else (surface,):
        fitted = on_its_own(partial(_surface, name, tied, points, domain, seed))
        if isinstance(fitted, Failure):
            failed[name] = fitted
            continue
        content[_FIELDS[name]], error = fitted
        errors[name] = {"fitted": error}
        if comparison is not None:
            errors[name]["held_out"] = getattr(comparison, _FIELDS[name])
        elif name == "bipolynomial":
            hold_out = partial(_held_out_bipolynomial, points, ties, domain, seed)
            held_out = judged("the bipolynomial is not judged on held-out tests", hold_out)
            errors[name] |= {} if held_out is None else {"held_out": held_out}
    if not errors:
        reasons = dict.fromkeys(why.reason for why in failed.values())
        raise error_of(list(failed.values()), "; ".join(reasons))
    remarks.lines += [f"not identified: {where}, {n}: {why.reason}" for n, why in failed.items()]
    if sweep:
        from sysid.surfaces.ann import sweep_hidden_size

        columns = points.flow, points.pressure, points.duty, points.test
        sizes = partial(sweep_hidden_size, *columns, domain=own_domain, seed=seed)
        content["sweep"] = judged("no network sizes are tried", sizes)
    content["errors"] = errors
    return _without_failures(DirectionFit(**content), remarks)


def _surface(
    name: str, tied: SurfacePoints, points: SurfacePoints, domain: Domain, seed: int
) -> tuple[Bipolynomial | DutyNetwork, SurfaceError]:
    """A surface by its name, fitted to `tied`, and its error at a direction's own `points`."""
    if name == "bipolynomial":
        polynomial = fit_bipolynomial(tied, domain)
        return polynomial, _error(polynomial, points, N_TERMS)
    network = _network(domain, seed)
    network.fit(np.column_stack((tied.flow, tied.pressure)), tied.duty, groups=tied.test)
    return network, _error(network, points, network.n_parameters_)


def _without_failures(fit: DirectionFit, remarks: Remarks) -> DirectionFit:
    """Without surfaces that explain too little; NotIdentifiedError where none remains."""
    failed = {
        name: short
        for name, errors in fit.errors.items()
        if (short := fails(errors, fit.points.duty, fit.noise_rmse)) is not None
    }
    if failed and len(failed) == len(fit.errors):
        said = "; ".join(f"{name}: {short}" for name, short in failed.items())
        raise NotIdentifiedError(f"{said}; {CHECK}")
    where = _title(fit.valve, fit.direction)
    remarks.lines += [f"not identified: {where}, {name}: {short}" for name, short in failed.items()]
    errors = {name: own for name, own in fit.errors.items() if name not in failed}
    comparison = fit.comparison
    if comparison is not None and comparison.recommended not in errors:
        (left,) = errors
        reason = f"the {comparison.recommended} is not identified"
        comparison = replace(comparison, recommended=left, reason=reason)
    return replace(
        fit,
        errors=errors,
        comparison=comparison,
        bipolynomial=None if "bipolynomial" in failed else fit.bipolynomial,
        network=None if "ann" in failed else fit.network,
    )


def _network(domain: Domain, seed: int) -> DutyNetwork:
    from sysid.surfaces.ann import DutyNetwork

    return DutyNetwork(domain=domain, seed=seed)


def fit_bipolynomial(points: SurfacePoints, domain: Domain) -> Bipolynomial:
    """Weighted least squares on the measured surface.

    Nine terms do not describe the valve exactly: the points' errors are their noise and the
    model error of the surface. With weights of 1/std^2 alone the few points at rest would
    dominate, so the variance of the model error, from a first unweighted fit, is added.
    """
    X = np.column_stack((points.duty, points.pressure))
    first = Bipolynomial(domain).fit(X, points.flow, groups=points.test)
    known = np.where(np.isfinite(points.std), points.std, np.nanmax(points.std, initial=0.0))
    lack_of_fit = max(first.rmse_flow_**2 - float(np.mean(known**2)), 1e-4 * first.rmse_flow_**2)
    weight = lack_of_fit / (lack_of_fit + known**2) if lack_of_fit > 0.0 else np.ones_like(known)
    return Bipolynomial(domain).fit(X, points.flow, weight, groups=points.test)


def _error(
    surface: Bipolynomial | DutyNetwork, points: SurfacePoints, n_parameters: int
) -> SurfaceError:
    fitted = surface.duty(points.flow, points.pressure)[0]
    return duty_errors(fitted, points.duty, points.pressure, points.flow, n_parameters)


def _held_out_bipolynomial(
    points: SurfacePoints, ties: SurfacePoints | None, domain: Domain, seed: int
) -> SurfaceError | None:
    """Error in duty on held-out tests, each held out once; None for too few tests."""
    if len(np.unique(points.test)) < FOLDS + 4:
        return None
    fitted = np.full(len(points.duty), math.nan)
    for held in group_folds(points.test, points.duty, FOLDS, seed):
        apart = None if ties is None else ties.select(apart_from(ties, points.duty[held]))
        polynomial = fit_bipolynomial(points.select(~held).joined(apart), domain)
        fitted[held] = polynomial.duty(points.flow[held], points.pressure[held])[0]
    judged = np.isfinite(fitted)
    seen = points.select(judged)
    return duty_errors(fitted[judged], seen.duty, seen.pressure, seen.flow, N_TERMS)


def _resolution(samples: FlowSamples) -> ResolutionStudy | None:
    # The study needs at least two samples in a bin; each of these is already a mean over a
    # window.
    duty, pressure, flow = (np.repeat(c, 2) for c in (samples.duty, samples.pressure, samples.flow))
    found = on_its_own(partial(resolution_study, duty, pressure, flow))
    return None if isinstance(found, Failure) else found


def _summary(fit: DirectionFit, average: ValveAverage | None) -> str:
    """Which law of a direction to use, as the report recommends it; or each error."""
    where = _title(fit.valve, fit.direction)
    if fit.comparison is not None:
        made = fit.comparison
        own = {} if average is None else average.errors.get(fit.direction, {})
        law = own.get("held_out")
        if law is not None and obeys_averaged_law(law.rmse, made.network.rmse, made.noise_rmse):
            return (
                f"{where}: use the averaged law: RMSE on held-out tests {100.0 * law.rmse:.2f} "
                f"points of duty; of the two surfaces {made.recommended}: {made.reason}"
            )
        return f"{where}: use {made.recommended}: {made.reason}"
    parts = []
    for name, errors in fit.errors.items():
        use, error = ("held-out", errors["held_out"]) if "held_out" in errors else (
            "fitted", errors["fitted"]
        )  # fmt: skip
        parts.append(f"{name}: RMSE {error.rmse:.4f} in duty on {use} tests")
    return f"{where}: {'; '.join(parts)}"
