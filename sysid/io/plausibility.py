"""Wrong units that a log's own numbers reveal.

A reader that takes 3 (bar) for 3 Pa silently gives wrong parameters. A channel is
rejected by comparison with the rig file, never by guessing a unit: the message names the
likely unit and the `--map` entry that converts it.
"""

from __future__ import annotations

import math

import numpy as np

from sysid.errors import SysidError, input_error
from sysid.io.rig import Rig
from sysid.types import FloatArray

PRESSURE_UNITS = {
    "Pa": 1.0,
    "mbar": 1e2,
    "kPa": 1e3,
    "psi": 6894.757,
    "bar": 1e5,
    "MPa": 1e6,
}
_LEAST_SPREAD_PA = 50.0
_TIME_UNITS = {"ms": 1e-3, "us": 1e-6, "min": 60.0}
# An actuator's chamber is never evacuated far below the atmosphere.
_LOWEST_SHARE_OF_ATMOSPHERE = 0.5
_HIGHEST_SHARE_OF_SUPPLY = 4.0
_DEGREES = 180.0 / math.pi


def _mapping(target: str, column: str, unit: str) -> str:
    return f'if it is in {unit}, give --map "{target}={column}:{unit}"'


def check_pressure(where: str, target: str, column: str, values: FloatArray, rig: Rig) -> None:
    """Absolute pressure (n,) Pa against the rig's atmosphere and supply."""
    if rig.air is None:
        return
    ambient, supply = rig.air.atmospheric_pressure_pa, rig.air.supply_pressure_pa
    low, high = float(np.min(values)), float(np.max(values))
    floor = _LOWEST_SHARE_OF_ATMOSPHERE * ambient
    ceiling = _HIGHEST_SHARE_OF_SUPPLY * supply
    if low >= floor and high <= ceiling:
        return
    what = f"{target} runs from {low:.4g} to {high:.4g}, which is not plausible as absolute Pa"
    raise input_error(where, what, _pressure_mend(target, column, values, ambient, supply))


def _pressure_mend(
    target: str, column: str, values: FloatArray, ambient: float, supply: float
) -> str:
    """The unit in which the readings at rest would be the atmosphere's, as in an open chamber."""
    low, high = float(np.min(values)), float(np.max(values))
    floor, ceiling = _LOWEST_SHARE_OF_ATMOSPHERE * ambient, _HIGHEST_SHARE_OF_SUPPLY * supply
    for gauge in (False, True):
        shift = ambient if gauge else 0.0
        for unit, factor in PRESSURE_UNITS.items():
            fits = low * factor + shift >= floor and high * factor + shift <= ceiling
            rests = abs(low * factor + shift - ambient) < 0.2 * ambient
            # Every gauge unit reads zero at rest; a real sensor shows some noise there.
            lives = (high - low) * factor > _LEAST_SPREAD_PA
            if fits and rests and lives:
                kind = "a gauge pressure" if gauge else "an absolute pressure"
                name = f"{unit}(g)" if gauge else unit
                return f"it looks like {kind} in {unit}: " + _mapping(target, column, name)
    return _mapping(target, column, "kPa") + " (or bar, psi; add (g) to a gauge pressure)"


def check_position(
    where: str, target: str, column: str, values: FloatArray, step: float | None, rig: Rig
) -> None:
    """Position (n,) rad or m against the stroke and the encoder's resolution.

    `step` is the smallest change in the data, or None where it is unknown.
    """
    resolution = None
    if rig.sensors.encoder_counts_per_rev is not None and not rig.is_linear:
        resolution = 2 * math.pi / rig.sensors.encoder_counts_per_rev
    if resolution and step and abs(step / resolution / _DEGREES - 1.0) < 0.02:
        raise input_error(
            where,
            f"{target} moves in steps of {step:.3g}, {_DEGREES:.1f} times the encoder's "
            f"resolution of {resolution:.3g} rad: it looks like degrees",
            _mapping(target, column, "deg"),
        )
    if rig.travel is None:
        return
    span, reach = float(np.ptp(values)), float(np.max(np.abs(values)))
    if span <= 1.15 * rig.travel and reach <= 1.5 * rig.travel:
        return
    unit, si = ("mm", "m") if rig.is_linear else ("deg", "rad")
    raise input_error(
        where,
        f"{target} runs from {float(np.min(values)):.4g} to {float(np.max(values)):.4g} {si}, "
        f"more than the stroke of {rig.travel:.4g} {si} allows",
        _mapping(target, column, unit),
    )


def check_effort(where: str, target: str, column: str, values: FloatArray, rig: Rig) -> None:
    """Motor torque or force (n,) at the output against the rig's limit."""
    limit = rig.max_effort
    if limit is None:
        return
    highest = float(np.max(np.abs(values)))
    if highest > 20.0 * limit:
        unit = "mN" if rig.is_linear else "mN m"
        raise input_error(
            where,
            f"{target} reaches {highest:.4g}, {highest / limit:.0f} times the motor's limit of "
            f"{limit:.4g}",
            _mapping(target, column, unit) + ", or correct [motor] in the rig file",
        )


def check_fraction(where: str, target: str, column: str, values: FloatArray) -> SysidError | None:
    """Duty (n,): the error to raise where it leaves 0 to 1."""
    low, high = float(np.min(values)), float(np.max(values))
    if low >= 0.0 and high <= 1.0:
        return None
    if low >= 0.0 and 1.5 < high <= 100.0:
        mend = _mapping(target, column, "percent")
    else:
        mend = "fix the values: a duty lies between 0 and 1"
    return input_error(where, f"{target} runs from {low:.4g} to {high:.4g}, outside 0 to 1", mend)


def check_sampling(where: str, column: str, period: float, rig: Rig) -> str | None:
    """Sampling period (s) against the rig's: raises on a wrong unit, else a notice or None."""
    if rig.sampling is None:
        return None
    ratio = period / rig.sampling.period_s
    for unit, factor in _TIME_UNITS.items():
        if abs(ratio * factor - 1.0) < 0.02:
            raise input_error(
                where,
                f"time_s advances by {period:.4g} s per row, but the rig file declares "
                f"{rig.sampling.period_s:.4g} s",
                _mapping("time_s", column, unit),
            )
    if abs(ratio - 1.0) > 0.02:
        return (
            f"{where}: sampled every {period:.4g} s, the rig file declares "
            f"{rig.sampling.period_s:.4g} s; the log's is used"
        )
    return None


def check_temperature(where: str, target: str, column: str, values: FloatArray) -> None:
    """Ambient temperature (n,) K."""
    if float(np.min(values)) < 150.0 or float(np.max(values)) > 500.0:
        raise input_error(
            where,
            f"{target} runs from {float(np.min(values)):.4g} to {float(np.max(values)):.4g} K",
            _mapping(target, column, "degC"),
        )
