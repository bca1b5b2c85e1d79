"""Which law of a valve's mean flow to use, from the errors in duty that a bundle holds."""

from __future__ import annotations

from sysid.parameters import PwmSurfaces, Valve
from sysid.parameters.valves import AVERAGED, DIRECTIONS, DutyErrors, SurfaceChoice
from sysid.surfaces.comparison import obeys_averaged_law


def choice_of(held: PwmSurfaces) -> SurfaceChoice | None:
    """Both surfaces of a direction next to each other, where both were fitted."""
    made = held.comparison
    return made if isinstance(made, SurfaceChoice) else None


def rivals(valve: Valve, direction: str) -> tuple[DutyErrors, DutyErrors] | None:
    """Held-out errors of the averaged law and of the network; None without both."""
    law, held = valve.averaged(), valve.surfaces(direction)
    network = None if held is None else held.surface("ann")
    if law is None or network is None:
        return None
    errors = law.errors(direction, "held_out"), network.errors("held_out")
    return None if errors[0] is None or errors[1] is None else (errors[0], errors[1])


def is_averaged(valve: Valve, direction: str) -> bool:
    """Whether both are there, and the averaged law follows as well as the network."""
    found, held = rivals(valve, direction), valve.surfaces(direction)
    if found is None or held is None:
        return False
    choice = choice_of(held)
    noise = None if choice is None or choice.noise_rmse is None else float(choice.noise_rmse)
    return obeys_averaged_law(float(found[0].rmse), float(found[1].rmse), noise)


def recommended(valve: Valve, direction: str) -> str | None:
    """The kind to use: the averaged law where it is obeyed, else the better surface.

    None where nothing was compared.
    """
    held = valve.surfaces(direction)
    if held is None:
        return None
    if is_averaged(valve, direction):
        return AVERAGED
    choice = choice_of(held)
    return None if choice is None else choice.recommended


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


__all__ = ["choice_of", "is_averaged", "not_recommended", "recommended", "rivals"]
