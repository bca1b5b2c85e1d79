"""The coefficient of a flow control alone, from that of the valve alone and that of both (3.6).

Resistances add: of filling 1/C^2, of the exhaust 1/C (thesis 3.6.4, 3.6.9). The errors of the sum
are near to normal, those of the flow control's coefficient are not.
"""

from __future__ import annotations

import math

from sysid.estimation.linear import Estimate
from sysid.estimation.quality import MOST_STD

COMBINED = (
    "valve and flow control are identified in combination only: give a log of the valve without "
    "its flow control (valve-discrete; flow_control = false in the campaign file, "
    "--without-control), or declare the valve's own coefficients in the rig file (law = "
    '"thesis-series", valve_c_fill, valve_c_dis)'
)
"""Why neither is identified, and the fix."""

_POWER = {"fill": 2, "dis": 1}


def control_coefficient(
    way: str, both: Estimate, valve: Estimate, covariance: float = 0.0
) -> Estimate:
    """The flow control's own coefficient in a direction, "fill" or "dis", unit as `both`.

    `both`: the coefficient of valve and flow control in series, `valve`: that of the valve alone,
    without a standard error where it is declared; `covariance` of their errors. Not identified
    where the flow control's resistance is not above its own error.
    """
    for one in (both, valve):
        if not one.identified:
            return Estimate.unidentified(both.unit, str(one.reason))
    n = _POWER[way]
    resistance = both.value**-n - valve.value**-n
    slopes = n * both.value ** -(n + 1), n * valve.value ** -(n + 1)
    stds = [
        s * e.std if math.isfinite(e.std) else 0.0
        for s, e in zip(slopes, (both, valve), strict=True)
    ]
    shared = 2.0 * slopes[0] * slopes[1] * covariance if all(stds) else 0.0
    std = math.sqrt(max(stds[0] ** 2 + stds[1] ** 2 - shared, 0.0))
    times = _times(both)
    low, high = resistance - times * std, resistance + times * std
    share = std / (n * resistance) if resistance > 0.0 else math.inf
    if not low > 0.0 or share > MOST_STD:
        return Estimate.unidentified(
            both.unit,
            "the flow control hinders the flow by no more than the error of the valve's own "
            "coefficient: close it further, or record more tests",
        )
    value = resistance ** (-1.0 / n)
    return Estimate(value, value * share, both.unit, (high ** (-1.0 / n), low ** (-1.0 / n)))


def _times(estimate: Estimate) -> float:
    """Standard errors from an estimate to the end of its interval."""
    low, high = estimate.interval
    if not (estimate.std > 0.0 and math.isfinite(high - low)):
        return 1.96
    return 0.5 * (high - low) / estimate.std


__all__ = ["COMBINED", "control_coefficient"]
