"""Tests in, parameters with intervals out: one part of the model, or a campaign's bundle."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from sysid import friction, valve_discrete, valve_pwm
from sysid.blocks.progress import progress_or_shown
from sysid.identification.friction.result import FrictionResult
from sysid.identification.valve_discrete.result import ValveDiscreteResult
from sysid.identification.valve_pwm.result import ValvePwmFit
from sysid.io.campaign import Campaign
from sysid.io.rig import Rig
from sysid.parameters import Bundle
from sysid.pipeline.given_tests import Tests, rig_of, trials_of
from sysid.pipeline.subject import subject_of
from sysid.types import Progress

_LOGGER = logging.getLogger("sysid")


def fit(
    campaign: Campaign,
    *,
    surface: str = "both",
    seed: int = 0,
    progress: Progress | None = None,
) -> Bundle:
    """Every part that a campaign's training logs can identify, in one bundle.

    `surface`: which PWM surfaces, "bipolynomial", "ann" or "both"; `seed` of their folds and
    restarts. Parts not fitted, and logs that contradict one another, are reported as warnings of
    the logger `sysid`. Raises InputError for a log that cannot be used, NotIdentifiedError where
    nothing can be fitted.

    >>> bundle = si.fit(campaign)
    >>> bundle.model().parameters.coulomb_effort > 0
    True
    """
    with progress_or_shown(progress, "fitting") as tell:
        subject = subject_of(campaign)
        bundle, notices = subject.fit(surface, seed, tell)
    for line in dict.fromkeys((*subject.contradictions(), *notices)):
        _LOGGER.warning("%s", line)
    return bundle


def fit_friction(
    tests: Tests,
    rig: Rig | None = None,
    *,
    kind: str | Sequence[str | None] | None = None,
    estimate_inertia: bool = False,
    cutoff_hz: float | None = None,
) -> FrictionResult:
    """Static, Coulomb and viscous friction from a log, several, or single tests.

    The result gives each estimate by its name in a bundle, `coulomb_nm` (a linear rig:
    `coulomb_n`), with `value`, `std`, `interval` (95 %) and `unit`. `rig` None: that of the logs.
    `kind` ("static", "sliding", "motion"; one, or one per test) overrides a test's content;
    `estimate_inertia` even if the rig file gives one; `cutoff_hz` of the zero-phase filter.
    Raises InputError where a channel is missing, NotIdentifiedError where nothing is identified or
    what is found cannot be friction.

    >>> friction = si.fit_friction(log)
    >>> low, high = friction.coulomb_nm.interval
    >>> low < friction.coulomb_nm.value < high, friction.coulomb_nm.unit
    (True, 'Nm')
    """
    found = friction.fit_friction(
        trials_of(tests),
        rig_of(tests, rig),
        kind=kind,
        estimate_inertia=estimate_inertia,
        cutoff_hz=cutoff_hz,
    )
    found.require_possible()
    return found


def fit_valve_discrete(
    tests: Tests, rig: Rig | None = None, *, valve: str | None = None, find_ratio: bool = True
) -> ValveDiscreteResult:
    """Flows (kg/s), coefficients and delays (s) of on/off valves, piston held.

    `rig` None: that of the logs. `valve` ("a" or "b") keeps one; `find_ratio` estimates the
    critical pressure ratio too, the slowest step. Raises InputError where a channel is
    missing, NotIdentifiedError where nothing is identified.

    >>> valves = si.fit_valve_discrete(si.read_log("valve_discrete_a.parquet"), find_ratio=False)
    >>> valves["a"].choked_flow_fill_kg_s.unit
    'kg/s'
    """
    return valve_discrete.fit_valve_discrete(
        trials_of(tests), rig_of(tests, rig), valve=valve, find_ratio=find_ratio
    )


def fit_valve_pwm(
    tests: Tests,
    rig: Rig | None = None,
    *,
    valve: str | None = None,
    surface: str = "both",
    seed: int = 0,
    sweep: bool = False,
) -> ValvePwmFit:
    """Mean flow (kg/s) under PWM over duty (0 to 1) and pressure (Pa), piston held.

    `rig` None: that of the logs. `valve` ("a" or "b") keeps one; `surface`: "bipolynomial", "ann"
    or "both" (compared on held-out tests); `seed` of folds and restarts; `sweep` tries networks
    of several sizes (slow). Raises InputError where a channel is missing, NotIdentifiedError
    where no surface is identified.

    >>> pwm = si.fit_valve_pwm(si.read_log("valve_pwm_a.parquet"), surface="bipolynomial")
    >>> flow, flags = pwm.fits["a", "fill"].bipolynomial.flow(0.5, 2e5)
    >>> bool(flow > 0)
    True
    """
    return valve_pwm.fit_valve_pwm(
        trials_of(tests), rig_of(tests, rig), valve=valve, surface=surface, seed=seed, sweep=sweep
    )


__all__ = ["fit", "fit_friction", "fit_valve_discrete", "fit_valve_pwm"]
