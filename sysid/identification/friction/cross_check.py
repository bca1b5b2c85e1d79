"""Where constant-effort tests and general motion disagree on a friction parameter."""

from __future__ import annotations

import math

from sysid.estimation.linear import Estimate
from sysid.estimation.quality import DISAGREE

SLIDING_FIRST = (
    "Coulomb and viscous friction are those of the constant-effort tests; friction from "
    "motion is reported in addition as a cross-check"
)


def disagreement(key: str, mine: Estimate, check: Estimate) -> str | None:
    """A notice where two values are more than `DISAGREE` standard errors apart; else None.

    `key` is the bundle's; `mine` of the constant-effort tests, `check` of motion.
    """
    if not (mine.identified and check.identified):
        return None
    error = math.hypot(mine.std, check.std)
    if abs(mine.value - check.value) <= DISAGREE * error:
        return None
    return (
        f"{key}: constant-effort tests give {mine.value:.4g} {mine.unit}, motion "
        f"{check.value:.4g}, apart by {abs(mine.value - check.value) / error:.1f} standard "
        "errors: Coulomb and viscous friction alone do not describe both"
    )


__all__ = ["SLIDING_FIRST", "disagreement"]
