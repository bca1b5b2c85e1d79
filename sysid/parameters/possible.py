"""Fitted numbers that physics rules out: inertia, friction and flows below zero.

A model holds such a number at what physics allows (`assembled_model`); the notices here say so,
with the number, its interval, and what would give it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from sysid.blocks.numbers import si_cells
from sysid.estimation.linear import Estimate
from sysid.io.motion import FRICTION
from sysid.io.plausibility import give_map
from sysid.io.rig import GRAVITY_M_PER_S2, Rig
from sysid.io.unit_text import TAKEN_FOR_SI
from sysid.parameters.content import BundleContent

# Of a carried body's weight: machines are levelled to some 10 um/m at best.
_LEAST_OF_WEIGHT = 1e-5


def is_possible(estimate: Estimate | None) -> bool:
    """Whether a number that cannot be negative is identified and is not."""
    return estimate is not None and estimate.identified and estimate.value >= 0.0


def stated(key: str, estimate: Estimate) -> str:
    """A number with its interval: "inertia_kg_m2 is -65.6 (-293 to 162) kg m2"."""
    value, interval, unit = si_cells(estimate)
    around = f" ({interval})" if interval else ""
    return f"{key} is {value}{around} {unit}"


def doubtful_inertia(inertia: Estimate | None, rig: Rig) -> Iterator[str]:
    """Says of a fitted inertia that it cannot be, or that zero is as likely: the fix is the same.

    A motion that hardly accelerates leaves it to the errors of the other numbers.
    """
    if inertia is None or not inertia.identified:
        return
    u, what = rig.units, "a mass" if rig.is_linear else "an inertia"
    fix = (
        f"declare [inertia] {u.rig_inertia} in the rig file and fit again, or give motion that "
        "accelerates more"
    )
    said = stated(u.key("inertia"), inertia)
    if not inertia.value > 0.0:
        held = "no motion is simulated with it"
        if rig.total_inertia() is not None:
            held = f"the model uses {rig.total_inertia():.3g} {u.inertia_unit}, as the rig file has"
        yield f"{said}, but {what} is above zero: {held}; {fix}"
    elif inertia.interval[0] <= 0.0:
        yield f"{said}: these tests hardly show it, and what is simulated rests on it; {fix}"


def weighs_too_much(estimates: Mapping[str, Estimate | None], rig: Rig) -> str:
    """Says that a fitted mass is too heavy for what carries it; empty where it is not.

    Whatever a guide carries loads it by its weight, of which friction is a share, and the offset
    what the guide is out of level by. `estimates` by "inertia", "coulomb" and "offset"; an inertia
    is a mass at the pitch radius. Neither share depends on the unit of the effort, and a time that
    is f times too long makes both f^2 times too small.
    """
    radius = 1.0 if rig.is_linear else rig.cylinder.pitch_radius_m if rig.cylinder else None
    inertia, coulomb, offset = (estimates.get(name) for name in ("inertia", "coulomb", "offset"))
    if radius is None or inertia is None or coulomb is None:
        return ""
    if not (inertia.identified and coulomb.identified and inertia.interval[0] > 0.0):
        return ""
    held = max(map(abs, coulomb.interval))
    if offset is not None and offset.identified:
        held += max(map(abs, offset.interval))
    weight = GRAVITY_M_PER_S2 * inertia.interval[0] / radius
    share = held / weight
    if share > _LEAST_OF_WEIGHT:
        return ""
    units = {unit: share / factor**2 for unit, factor in TAKEN_FOR_SI["s"].items()}
    unit = min(units, key=lambda name: abs(math.log(units[name])))
    own = inertia.value * TAKEN_FOR_SI["s"][unit] ** 2
    u = rig.units
    return (
        f"{stated(u.key('inertia'), inertia)}: friction and offset would be {share:.1g} of its "
        f"weight, and no guide is so smooth or so level: time_s is not in s (in {unit} it would be "
        f"{own:.3g} {u.inertia_unit}: {give_map('time_s', 'time_s', unit)}), or "
        f"{rig.position_channel} not in {u.position}"
    )


def negative_friction(estimates: Mapping[str, Estimate | None], rig: Rig) -> Iterator[str]:
    """Says of friction below zero, by its keys in a bundle, that models set it to 0."""
    for key in map(rig.units.key, FRICTION):
        estimate = estimates.get(key)
        if estimate is None or not estimate.identified or estimate.value >= 0.0:
            continue
        why = "the friction tests show an effect that it lacks"
        if estimate.interval[1] >= 0.0:
            why = "these tests hardly show it; give motion at more speeds, or faster motion"
        yield f"{stated(key, estimate)}, but friction cannot be negative: the model uses 0; {why}"


def impossible(bundle: BundleContent, rig: Rig) -> list[str]:
    """Notices of a bundle's mechanics that physics rules out, and what its model has instead."""
    friction = bundle.friction
    if friction is None:
        return []
    estimates = {key: getattr(friction, key) for key in map(rig.units.key, FRICTION)}
    lines = [*negative_friction(estimates, rig), *doubtful_inertia(friction.inertia, rig)]
    return [f"{bundle.source}: {line}" for line in lines]


__all__ = [
    "doubtful_inertia",
    "impossible",
    "is_possible",
    "negative_friction",
    "stated",
    "weighs_too_much",
]
