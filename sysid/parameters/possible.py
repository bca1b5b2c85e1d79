"""Fitted numbers that physics rules out: inertia, friction and flows below zero.

A model holds such a number at what physics allows (`assembled_model`); the notices here say so,
with the number, its interval, and what would give it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from sysid.blocks.numbers import si_cells
from sysid.estimation.linear import Estimate
from sysid.io.motion import FRICTION
from sysid.io.rig import Rig
from sysid.parameters.content import BundleContent


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


__all__ = ["doubtful_inertia", "impossible", "is_possible", "negative_friction", "stated"]
