"""The averaged law of PWM tests in place of an on/off law that no test was made for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.errors import Notice
from sysid.parameters.valves import (
    LAW_KEYS,
    AveragedRecord,
    DirectionalLaw,
    DiscreteLaw,
    LawDecision,
)

if TYPE_CHECKING:
    from sysid.parameters.bundle import Bundle

_WHY = "that of the averaged law of its PWM tests: no valve-discrete test was fitted"


def with_laws_of_pwm(bundle: Bundle) -> tuple[Bundle, tuple[str, ...]]:
    """The bundle with the flows of a valve's averaged law as its on/off law, where it has no other.

    Returned with a notice for each such valve. The delays are the rig file's, as of any on/off law.
    """
    if bundle.valves is None:
        return bundle, ()
    sides, notices = {}, []
    for side, valve in bundle.valves.sides().items():
        averaged = valve.averaged()
        if valve.discrete is None and averaged is not None:
            sides[side] = valve.replaced(discrete=_on_off(averaged))
            line = (
                f"valve {side.upper()}: no valve-discrete test was fitted: the flows are those of "
                "the averaged law of its PWM tests, the delays the rig file's"
            )
            notices.append(Notice(line, f"valves.{side}.discrete"))
    if not sides:
        return bundle, ()
    return bundle.replaced(valves=bundle.valves.replaced(**sides)), tuple(notices)


def _on_off(averaged: AveragedRecord) -> DiscreteLaw:
    """The on/off law that an averaged law is made of."""
    keys = {*LAW_KEYS.values(), *DirectionalLaw.model_fields}
    found = {key: getattr(averaged, key) for key in averaged.given() if key in keys}
    return DiscreteLaw(**found, choice=LawDecision(why=_WHY))


__all__ = ["with_laws_of_pwm"]
