"""Which parameters a log of a part on a bench identifies: those that the fit of it returns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from sysid.checks.friction import Identification, bench_fit, is_of_one_pressure
from sysid.errors import InputError, NotIdentifiedError
from sysid.io.channels import CHAMBER_PRESSURES, VALVE_COMMANDS
from sysid.io.kinds import FRICTION_POINTS, KIND_BY_COLUMN
from sysid.io.logs import Trial
from sysid.io.rig import Rig

TANK, VALVE_TESTS = "tank", "valve-discrete"
"""Kinds of test whose columns are the same where a valve fills a tank."""

_VALVE = "valve_a"
BENCH_LAWS = tuple(KIND_BY_COLUMN.values())
"""Kinds of test that give a law of a tank or a valve."""


def bench_kind(trial: Trial, rig: Rig) -> str | None:
    """The kind of a bench test by its columns; None for any other test."""
    found = next((kind for name, kind in KIND_BY_COLUMN.items() if name in trial), None)
    if found is None and trial.is_readings:
        return FRICTION_POINTS
    return found or (TANK if _is_of_a_tank(trial, rig) else None)


def _is_of_a_tank(trial: Trial, rig: Rig) -> bool:
    """Whether a test has one pressure and no motion channel, on a rig with a tank; on one of a
    tank alone also a command without a pressure, which is then what is missing."""
    if rig.is_tank_alone and not {rig.position_channel, *CHAMBER_PRESSURES} & {*trial.channels}:
        return bool({"pump_volts", *VALVE_COMMANDS} & {*trial.channels})
    if rig.tank is None or not is_of_one_pressure(trial, rig):
        return False
    others = {rig.effort_channel}
    if not rig.is_tank_alone:
        # Of an actuator's chambers and valves, too, a log may hold one alone.
        others |= {"pressure_b_pa", *VALVE_COMMANDS}
    return not others & {*trial.channels}


def bench_identified(kind: str, trials: Sequence[Trial], rig: Rig) -> Iterator[Identification]:
    """Every parameter of the part's law in turn; one line where its tests cannot be used."""
    try:
        fitted, recordings = bench_fit(kind, trials, rig)
    except (InputError, NotIdentifiedError) as error:
        yield Identification(f"the law of {kind} tests", False, _why(kind, trials, rig, error))
        return
    tests = f"{len(set(recordings))} of {len(trials)} {kind} test{'s' * (len(trials) > 1)}"
    for name, estimate in fitted.items():
        yield Identification(name, estimate.identified, estimate.reason or tests)


def filling_of_tank(valve: Iterable[Identification]) -> Iterator[Identification]:
    """Of what a tank's tests show of its valve: the flows that fill it, and the fit of them."""
    for one in valve:
        if one.identified and "fill" in one.parameter:
            yield replace(one, reason=f"{one.reason} (by sysid fit valve-discrete)")


def _why(kind: str, trials: Sequence[Trial], rig: Rig, error: Exception) -> str:
    """Why tests give no law; of a tank without a command also what the log is."""
    commands = {"pump_volts", _VALVE}
    if kind != TANK or any(commands & {*t.channels, *t.unusable} for t in trials):
        return str(error)
    logged = [t[name] for t in trials for name in CHAMBER_PRESSURES if name in t]
    is_filled = bool(logged) and all(pressure[-1] > pressure[0] for pressure in logged)
    of = "one pressure, and a rig file with [tank]"
    if not all(is_of_one_pressure(t, rig) for t in trials):
        of = "a rig file with a [tank] alone"
    return f"this is a tank's {'filling' if is_filled else 'discharge'} ({of}): {error}"


__all__ = [
    "BENCH_LAWS",
    "TANK",
    "VALVE_TESTS",
    "bench_identified",
    "bench_kind",
    "filling_of_tank",
]
