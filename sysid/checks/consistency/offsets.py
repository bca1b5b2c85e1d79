"""The steady effort that a log's motion needs in addition to friction: 0 on a level rig.

Exchanged chambers, a load cell that was not zeroed, and a wrong area or pressure all cause one.
Exchanged chambers are recognised by the offset that remains when they are exchanged back.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.checks.consistency.levels import sliding_fit
from sysid.estimation.linear import Estimate
from sysid.estimation.quality import FEWEST_REPEATS
from sysid.identification.friction.result import FrictionResult
from sysid.io.channels import CHAMBER_PRESSURES
from sysid.io.logs import Trial
from sysid.io.rig import Rig

# Multiple of the Coulomb friction: smaller offsets are effects.
_LARGE = 2.0
# Share of an offset that may remain after exchanging the chambers back.
_LEFT = 0.2


@dataclass(frozen=True)
class OffsetReading:
    """One log's offset, N or Nm, with its Coulomb friction, and with its chambers exchanged."""

    source: str
    offset: Estimate
    coulomb: float
    exchanged: float | None


def offset_of(
    fit: FrictionResult, trials: Sequence[Trial], name: str, rig: Rig
) -> OffsetReading | None:
    """A motion log's offset by its fit; None where offset and friction are not separable."""
    found = _read(fit)
    if found is None:
        return None
    offset, coulomb = found
    other = None
    has_two = all(n in t for t in trials for n in CHAMBER_PRESSURES) and len(rig.sides) == 2
    if abs(offset.value) > _LARGE * coulomb and has_two:
        other = sliding_fit([_exchanged(t) for t in trials], "motion", rig)
    without = None if other is None else _read(other)
    return OffsetReading(name, offset, coulomb, None if without is None else without[0].value)


def offset_lines(readings: Sequence[OffsetReading], rig: Rig) -> Iterator[tuple[str, str]]:
    """Log and line of each offset that a rig cannot have in this log alone, or at all."""
    usual = 0.0
    if rig.is_vertical:
        # A weight that the rig file lacks is an offset in every log.
        if len(readings) < FEWEST_REPEATS:
            return
        usual = float(np.median([one.offset.value for one in readings]))
    coulomb = float(np.median([one.coulomb for one in readings])) if readings else 0.0
    for one in readings:
        low, high = one.offset.interval
        off = one.offset.value - usual
        if abs(off) <= _LARGE * coulomb or low <= usual <= high:
            continue
        unit = one.offset.unit
        said = (
            f"{one.source}: in addition to friction ({coulomb:.3g} {unit}) its motion needs a "
            f"steady {off:.3g} {unit}"
            + (" more than the other logs'" if rig.is_vertical else ", on a horizontal rig")
        )
        left = None if one.exchanged is None else one.exchanged - usual
        if left is not None and abs(left) < _LEFT * abs(off):
            fix = (
                f"{left:.3g} {unit} with its chambers exchanged: pressure_a_pa and pressure_b_pa "
                "are swapped in this log; exchange them in its map"
            )
        else:
            fix = (
                f"the zero of {rig.effort_channel}, or a pressure's zero, unit or area, is wrong; "
                "compare what they read at rest"
            )
        yield one.source, f"{said}: {fix}"


def _exchanged(trial: Trial) -> Trial:
    a, b = CHAMBER_PRESSURES
    return replace(trial, channels={**trial.channels, a: trial[b], b: trial[a]})


def _read(fit: FrictionResult) -> tuple[Estimate, float] | None:
    """Offset and Coulomb friction."""
    offset, coulomb = fit.parameters["offset"], fit.parameters["coulomb"]
    is_known = offset.identified and coulomb.identified and coulomb.value > 0.0
    return (offset, coulomb.value) if is_known else None


__all__ = ["OffsetReading", "offset_lines", "offset_of"]
