"""The logs of a campaign compared with one another and with the rig file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from sysid.checks.consistency.comparison import Contradiction, disagreements
from sysid.checks.consistency.drive import CYLINDER, MOTOR, Gain, gains, takes_energy_out
from sysid.checks.consistency.flow import filling_flows
from sysid.checks.consistency.kinds import other_kind
from sysid.checks.consistency.levels import (
    LEAST_OF_PRESSURE,
    breakaway,
    filled_pressures,
    interval_of,
    rest_pressures,
    sliding_fit,
    sliding_friction,
)
from sysid.checks.consistency.offsets import OffsetReading, offset_lines, offset_of
from sysid.checks.consistency.quantities import RIG, Reading, SharedQuantity
from sysid.errors import Failure, SysidError, on_its_own
from sysid.identification.friction.result import FrictionResult
from sysid.io.campaign import SIMULATED_KINDS, Campaign
from sysid.io.channels import SIDES
from sysid.io.logs import Log, Trial
from sysid.io.rig import Rig
from sysid.recording.even import recorded
from sysid.recording.recording import Recording

_STATIC = "static friction"
_COULOMB = "Coulomb friction"
# A slow start of a ramp is found early, so that static friction comes out a little low.
_LEAST_STATIC = 0.9
_BY = {MOTOR: "its motor", CYLINDER: "its chambers"}
# Half an interval over its value: a single test's friction, which differs from test to test.
_WIDEST_OF_FRICTION = 0.3
# Repeats within one log do not show what changes from log to log.
_LEAST_OF_FLOW = 0.1


@dataclass(frozen=True)
class LogReadings:
    """What one log contributes to the comparison, and what is wrong within it."""

    readings: tuple[Reading, ...] = ()
    offset: OffsetReading | None = None
    notices: tuple[Contradiction, ...] = ()


def check_consistency(campaign: Campaign, use: str | None = None) -> tuple[str, ...]:
    """Notices of logs that contradict one another or the rig file, one line each.

    `use` keeps the logs of that use. Raises InputError for a log that cannot be used.
    """
    logs = [e for e in campaign.logs if use in (None, e.use)]
    found = [readings_of(campaign.read(e), e.kind, campaign.rig, e.file) for e in logs]
    return contradictions(found, campaign.rig)


def contradictions(logs: Iterable[LogReadings], rig: Rig) -> tuple[str, ...]:
    """The notices of `check_consistency` from what each log contributes."""
    return tuple(found.line for found in located_contradictions(logs, rig))


def located_contradictions(logs: Iterable[LogReadings], rig: Rig) -> tuple[Contradiction, ...]:
    """`contradictions`, each with the log or rig file that its line begins with."""
    by_quantity: dict[str, list[Reading]] = {}
    found: list[Contradiction] = []
    logs = list(logs)
    for one in logs:
        found += one.notices
        for reading in one.readings:
            by_quantity.setdefault(reading.quantity.name, []).append(reading)
    for readings in by_quantity.values():
        found += disagreements([*readings, *_of_the_rig(readings[0].quantity, rig)])
    offsets = [one.offset for one in logs if one.offset is not None]
    found += [Contradiction(*located) for located in offset_lines(offsets, rig)]
    found += _below_coulomb(by_quantity.get(_STATIC, []), by_quantity.get(_COULOMB, []))
    return tuple(dict.fromkeys(found))


def readings_of(log: Log, kind: str, rig: Rig, where: str = "") -> LogReadings:
    """The readings of a log of this kind, named `where` (else by its file name).

    Where they cannot be computed, it contributes a notice that says why.
    """
    name = where or log.path.name
    found = on_its_own(partial(_readings_of, log, kind, rig, name))
    if not isinstance(found, Failure):
        return found
    said = Contradiction(name, f"{name}: not compared with the other logs: {found.reason}")
    return LogReadings(notices=(said,))


def _readings_of(log: Log, kind: str, rig: Rig, name: str) -> LogReadings:
    readings: list[Reading] = []
    notices: list[Contradiction] = []
    other = other_kind(log.trials, kind, name, rig)
    if other is not None:
        notices.append(Contradiction(name, other))
    offset = None
    if kind in SIMULATED_KINDS:
        even = [e for e in (_even(t, rig) for t in log.trials) if e is not None]
        if takes_energy_out(even):
            notices.append(Contradiction(name, _energy(name, rig)))
        carried = rig.carrying(log.trials[0].payload_kg)
        known = rig.total_inertia() is not None or not rig.is_vertical
        for gain in gains(even, carried.total_inertia() or 1.0) if known else ():
            _take_gain(gain, name, rig, readings, notices)
    if kind == "friction-static":
        readings += _breakaway(log.trials, name, rig)
    if kind in ("friction-sliding", "friction-motion", "motion-motor"):
        fit_kind = "sliding" if kind == "friction-sliding" else "motion"
        fit = sliding_fit(log.trials, fit_kind, rig)
        readings += _friction(fit, name, rig)
        if fit is not None and fit_kind == "motion":
            offset = offset_of(fit, log.trials, name, rig)
    if rig.air is not None and rig.cylinder is not None:
        readings += _air(log.trials, name, rig)
    return LogReadings(tuple(readings), offset, tuple(notices))


def quantities(rig: Rig) -> tuple[SharedQuantity, ...]:
    """Everything that a rig's logs are compared by."""
    friction = (_friction_quantity(part, rig) for part in ("coulomb", "viscous"))
    air = (*_FLOWS.values(), *_RESTS.values(), *_FILLED.values())
    return (_inertia(rig), _static_quantity(rig), *friction, *air)


# --- inertia ------------------------------------------------------------------------------


def _even(trial: Trial, rig: Rig) -> Recording | None:
    if rig.cylinder is not None and not all(n in trial for n in rig.pressure_channels):
        return None
    try:
        return recorded(trial, rig, [])
    except SysidError:
        return None


def _take_gain(
    gain: Gain, name: str, rig: Rig, readings: list[Reading], notices: list[Contradiction]
) -> None:
    """A gain below zero is a sign; any other is the inertia that its drive moves."""
    if gain.high < 0.0:
        notices.append(Contradiction(name, _sign(gain.drive, name, rig)))
    elif gain.low > 0.0:
        inertia = rig.total_inertia() or 1.0
        limits = (inertia / gain.high, inertia / gain.low)
        value, slips = inertia / gain.value, _drive_slips(gain.drive, rig)
        readings.append(Reading(_inertia(rig), name, value, *limits, _BY[gain.drive], slips))


def _drive_slips(drive: str, rig: Rig) -> str:
    if drive == MOTOR:
        return f"the unit or gain of {rig.effort_channel} wrong by {{ratio}}"
    dimensions = "areas" if rig.is_linear else "areas or pitch radius (a diameter?)"
    return f"the pressures' unit, or the rig file's {dimensions}, wrong by {{ratio}}"


def _sign(drive: str, name: str, rig: Rig) -> str:
    if drive == MOTOR:
        return (
            f"{name}: {rig.effort_channel} brakes what it should drive: the sign of "
            f"{rig.effort_channel} or of {rig.position_channel} is reversed; map it with a factor "
            "of -1"
        )
    if len(rig.sides) == 1:
        return (
            f"{name}: the chamber brakes what it should drive: the sign of {rig.position_channel} "
            "is reversed"
        )
    return (
        f"{name}: the chambers brake what they should drive: pressure_a_pa and pressure_b_pa are "
        f"swapped, or the sign of {rig.position_channel} is reversed"
    )


def _energy(name: str, rig: Rig) -> str:
    return (
        f"{name}: the efforts only take energy out of the motion, so nothing drives it: the sign "
        f"of {rig.effort_channel} or of {rig.position_channel} is reversed, or pressure_a_pa and "
        "pressure_b_pa are swapped"
    )


def _inertia(rig: Rig) -> SharedQuantity:
    return SharedQuantity(
        "the inertia that is moved",
        rig.units.inertia_unit,
        1.6,
        f"the log's time base wrong by {{time}}, as where rows are missing; the unit of "
        f"{rig.position_channel} wrong by {{inverse}}",
        "inertia-mismatch, torque-constant-error, area-error",
        power=2.0,
    )


# --- friction -----------------------------------------------------------------------------


def _friction(fit: FrictionResult | None, name: str, rig: Rig) -> Iterator[Reading]:
    for part, estimate in sliding_friction(fit).items():
        low, high = estimate.interval
        if high - low > 2.0 * _WIDEST_OF_FRICTION * abs(estimate.value):
            continue
        yield Reading(_friction_quantity(part, rig), name, estimate.value, low, high)


def _breakaway(trials: Sequence[Trial], name: str, rig: Rig) -> Iterator[Reading]:
    estimate = breakaway(trials, rig)
    if estimate is not None:
        low, high = estimate.interval
        yield Reading(_static_quantity(rig), name, estimate.value, low, high)


def _static_quantity(rig: Rig) -> SharedQuantity:
    return SharedQuantity(
        _STATIC,
        rig.units.effort,
        1.6,
        f"the unit or gain of {rig.effort_channel}, wrong by {{ratio}}",
        "position-dependent-friction, friction that grows at rest",
    )


def _below_coulomb(
    static: Sequence[Reading], coulomb: Sequence[Reading]
) -> Iterator[Contradiction]:
    """Breakaway below Coulomb friction, which is impossible."""
    for one in static:
        other = min(coulomb, key=lambda c: c.low, default=None)
        if other is not None and one.high < _LEAST_STATIC * other.low:
            yield Contradiction(
                one.source,
                f"{one.source}: {_STATIC} is {one.shown}, below the Coulomb friction of "
                f"{other.shown} that {other.source} gives: the unit or gain of the motor's effort "
                "differs between the two; check its column in both",
            )


def _friction_quantity(part: str, rig: Rig) -> SharedQuantity:
    if part == "coulomb":
        return SharedQuantity(
            _COULOMB,
            rig.units.effort,
            1.6,
            f"the unit or gain of {rig.effort_channel}, wrong by {{ratio}}",
            "stribeck-friction, position-dependent-friction, presliding"
            + (", seal-friction" if rig.cylinder is not None else ""),
        )
    return SharedQuantity(
        "viscous friction",
        rig.units.viscous_unit,
        3.0,
        f"its time base wrong by {{time}}, as where rows are missing; the unit of "
        f"{rig.position_channel} by {{inverse}} or of {rig.effort_channel} by {{ratio}}",
        "stribeck-friction, quadratic-drag, position-dependent-friction",
    )


# --- air ----------------------------------------------------------------------------------


def _air(trials: Sequence[Trial], name: str, rig: Rig) -> Iterator[Reading]:
    for side in rig.sides:
        flows = [f for t in trials for f in filling_flows(t, side, rig)]
        if flows:
            yield Reading(_FLOWS[side], name, *interval_of(flows, _LEAST_OF_FLOW))
        vents = rig.valves is not None and not rig.bleeds
        # Without valves that vent it, a chamber may be under a regulator's pressure.
        rests = rest_pressures(trials, side, rig) if vents else []
        if rests:
            yield Reading(_RESTS[side], name, *interval_of(rests, LEAST_OF_PRESSURE))
        filled = filled_pressures(trials, side, rig)
        if filled:
            yield Reading(_FILLED[side], name, *interval_of(filled, LEAST_OF_PRESSURE))


_FLOWS = {
    side: SharedQuantity(
        f"the choked filling flow of valve {side.upper()}",
        "kg/s",
        1.4,
        "its time base wrong by {time}, as where rows are missing; the position at which the "
        "piston is held, or its unit; the unit of the pressure; swapped or inverted valve commands",
        "dead-volume-error, polytropic-exponent, wall-heat-transfer",
        power=-1.0,
    )
    for side in SIDES
}
_RESTS = {
    side: SharedQuantity(
        f"the pressure of chamber {side.upper()} at rest",
        "Pa",
        1.15,
        f"a gauge pressure in pressure_{side}_pa, the atmosphere added twice, or another sensor's "
        "column",
        "pressure-offset, ambient-pressure-error",
    )
    for side in SIDES
}
_FILLED = {
    side: SharedQuantity(
        f"the pressure of chamber {side.upper()} filled from the supply",
        "Pa",
        1.15,
        f"a gauge pressure in pressure_{side}_pa or in the rig file's supply_pressure_pa, or a "
        "wrong unit",
        "pressure-gain, supply-droop",
    )
    for side in SIDES
}


def _of_the_rig(quantity: SharedQuantity, rig: Rig) -> Iterator[Reading]:
    """The value of a quantity that the rig file declares."""
    value: float | None = None
    if quantity == _inertia(rig):
        value = rig.total_inertia()
    elif rig.air is not None and quantity in _RESTS.values():
        value = rig.air.atmospheric_pressure_pa
    elif rig.air is not None and quantity in _FILLED.values():
        value = rig.air.supply_pressure_pa
    if value is not None and math.isfinite(value):
        slips = (
            "the inertia or payload under [inertia] wrong by {ratio}, or in every log the time "
            "base or the unit of the position"
        )
        own = slips if quantity == _inertia(rig) else ""
        yield Reading(quantity, RIG, value, value, value, slips=own)


__all__ = [
    "LogReadings",
    "check_consistency",
    "contradictions",
    "located_contradictions",
    "quantities",
    "readings_of",
]
