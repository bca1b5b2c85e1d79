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
# kg/m3, of what turns, over the ball that it turns in: a pole of several metres has this little.
_LEAST_DENSITY = 1.0
# Factor by which a declared inertia is wrong at most, but for a slip.
_INERTIA_KNOWN_TO = 1.6


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
    is a mass at the pitch radius, or without one at the widest that it may have. Neither share
    depends on the unit of the effort, and a time that is f times too long makes both f^2 times too
    small.
    """
    inertia, coulomb, offset = (estimates.get(name) for name in ("inertia", "coulomb", "offset"))
    if inertia is None or coulomb is None:
        return ""
    if not (inertia.identified and coulomb.identified and inertia.interval[0] > 0.0):
        return ""
    radius = 1.0
    if not rig.is_linear:
        # Of what fills a ball of this radius r, J is some density times r^5.
        widest = (inertia.interval[0] / _LEAST_DENSITY) ** 0.2
        radius = rig.cylinder.pitch_radius_m if rig.cylinder else widest
    held = max(map(abs, coulomb.interval))
    if offset is not None and offset.identified:
        held += max(map(abs, offset.interval))
    weight = GRAVITY_M_PER_S2 * inertia.interval[0] / radius
    share = held / weight
    if share > _LEAST_OF_WEIGHT:
        return ""
    units = {unit: share / factor**2 for unit, factor in TAKEN_FOR_SI["s"].items()}
    unit = min(units, key=lambda name: abs(math.log(units[name])))
    return (
        f"{stated(rig.units.key('inertia'), inertia)}: friction and offset would be {share:.1g} of "
        f"its weight, and no guide is so smooth or so level: {_not_in_s(inertia, unit, rig)}, or "
        f"{rig.position_channel} not in {rig.units.position}"
    )


def another_time(inertia: Estimate, rig: Rig) -> str:
    """Says that time_s is in another unit where the rig file's inertia tells; empty where not.

    A time that is f times too long makes an inertia f^2 times too large, and nothing else that a
    rig file declares.
    """
    declared = rig.total_inertia()
    if declared is None or not (inertia.identified and inertia.interval[0] > 0.0):
        return ""
    for unit, factor in TAKEN_FOR_SI["s"].items():
        low, high = (edge * factor**2 / declared for edge in inertia.interval)
        if low < _INERTIA_KNOWN_TO and high > 1.0 / _INERTIA_KNOWN_TO:
            return (
                f"the motion is that of {inertia.value:.3g} {rig.units.inertia_unit}, and the rig "
                f"file's inertia is {declared:.3g}: {_not_in_s(inertia, unit, rig)}, or [inertia] "
                "is wrong"
            )
    return ""


def _not_in_s(inertia: Estimate, unit: str, rig: Rig) -> str:
    """That the time is in this unit, with what a fitted inertia would then be."""
    own = inertia.value * TAKEN_FOR_SI["s"][unit] ** 2
    return (
        f"time_s is not in s (in {unit} it would be {own:.3g} {rig.units.inertia_unit}: "
        f"{give_map('time_s', 'time_s', unit)})"
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
    "another_time",
    "doubtful_inertia",
    "impossible",
    "is_possible",
    "negative_friction",
    "stated",
    "weighs_too_much",
]
