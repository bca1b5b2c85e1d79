"""Which law of a valve's mean flow to use, from the errors in duty that a bundle holds."""

from __future__ import annotations

from sysid.parameters import PwmSurfaces, Valve
from sysid.parameters.valves import AVERAGED, DIRECTIONS, DutyErrors, SurfaceChoice
from sysid.surfaces.comparison import obeys_averaged_law


def choice_of(held: PwmSurfaces) -> SurfaceChoice | None:
    """Both surfaces of a direction next to each other, where both were fitted."""
    made = held.comparison
    return made if isinstance(made, SurfaceChoice) else None


def best_surface(held: PwmSurfaces) -> str | None:
    """The better surface of a direction: the only one, else as compared; None where unknown."""
    kinds = list(held.surfaces())
    if len(kinds) == 1:
        return kinds[0]
    choice = choice_of(held)
    return None if choice is None else choice.recommended


def rival(valve: Valve, direction: str) -> str | None:
    """The surface that the averaged law is compared with: the network, else the only surface."""
    held = valve.surfaces(direction)
    if held is None:
        return None
    return "ann" if held.surface("ann") is not None else best_surface(held)


def rivals(valve: Valve, direction: str) -> tuple[DutyErrors, DutyErrors] | None:
    """Held-out errors of the averaged law and of its rival; None without both."""
    law, held, kind = valve.averaged(), valve.surfaces(direction), rival(valve, direction)
    surface = None if held is None or kind is None else held.surface(kind)
    if law is None or surface is None:
        return None
    errors = law.errors(direction, "held_out"), surface.errors("held_out")
    return None if errors[0] is None or errors[1] is None else (errors[0], errors[1])


def is_averaged(valve: Valve, direction: str) -> bool:
    """Whether both are there, and the averaged law follows as well as its rival."""
    found, held = rivals(valve, direction), valve.surfaces(direction)
    if found is None or held is None:
        return False
    choice = choice_of(held)
    noise = None if choice is None or choice.noise_rmse is None else float(choice.noise_rmse)
    return obeys_averaged_law(float(found[0].rmse), float(found[1].rmse), noise)


def recommended(valve: Valve, direction: str) -> str | None:
    """The kind to use: the averaged law where it is obeyed, else the better surface.

    None where several were fitted and none was compared.
    """
    held = valve.surfaces(direction)
    if held is None:
        return None
    return AVERAGED if is_averaged(valve, direction) else best_surface(held)


def not_recommended(valve: Valve, side: str) -> set[str]:
    """The places in a bundle of the valve's PWM laws that are not the ones to use."""
    found = set()
    for direction in DIRECTIONS:
        best, held = recommended(valve, direction), valve.surfaces(direction)
        if best is None or held is None:
            continue
        place = f"valves.{side}.pwm"
        found |= {f"{place}.{direction}.{kind}" for kind in held.surfaces() if kind != best}
        if best != AVERAGED:
            found.add(f"{place}.averaged, {direction}")
    return found


__all__ = [
    "best_surface",
    "choice_of",
    "is_averaged",
    "not_recommended",
    "recommended",
    "rival",
    "rivals",
]
