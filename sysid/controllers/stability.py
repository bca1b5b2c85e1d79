"""The stability conditions of backstepping with motor compensation (thesis 4.3.3.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class StabilityCheck:
    """Gains against conditions; 1/s.

    `least_k1`, `least_k2` are the printed bounds (4.3.50), and `printed` whether both hold.
    `corrected` is whether k1 (k2 + b) > a^2/4 holds, which is sufficient with the signs as
    they follow from 4.3.16: the motor's extra effort is what it gives beyond the wanted one,
    z_m = -t_PD, so that its damping b = g2 Kd / I adds to k2, where the print subtracts it;
    a = g2 (Kp - Kd k1) / I. A proof fails where a condition does not hold; the loop need not.
    """

    k1: float
    k2: float
    least_k1: float
    least_k2: float
    corrected: bool

    @property
    def printed(self) -> bool:
        """Whether both printed conditions hold."""
        return self.k1 > self.least_k1 and self.k2 > self.least_k2

    @property
    def lines(self) -> list[str]:
        """Conditions that do not hold, one line each; empty where all do."""
        found = [
            f"{name} = {value:g} 1/s does not exceed {least:.3g} 1/s (4.3.50)"
            for name, value, least in (
                ("k1", self.k1, self.least_k1),
                ("k2", self.k2, self.least_k2),
            )
            if not value > least
        ]
        if not self.corrected:
            found.append("k1 (k2 + b) does not exceed a^2/4 (4.3.50 with z_m's sign corrected)")
        return found


def check_stability(
    k1: float,
    k2: float,
    motor_p: float,
    motor_d: float,
    inertia: float,
    gammas: tuple[float, float] = (1.0, 1.0),
) -> StabilityCheck:
    """Check k1, k2 (1/s) and the motor's gains (Nm/rad, Nm s/rad) at an inertia in kg m2.

    `gammas`: weights of the Lyapunov functions, kg/s2 and kg. Raises ValueError for an
    inertia that is not positive.
    """
    if not inertia > 0.0:
        raise ValueError("inertia must be positive")
    g1, g2 = gammas
    a = g2 * (motor_p - motor_d * k1) / inertia
    b = g2 * motor_d / inertia
    return StabilityCheck(
        k1=k1,
        k2=k2,
        least_k1=g2 * motor_p / (inertia * math.sqrt(2.0 * g1) + g2 * motor_d),
        least_k2=1.0 / g2 + motor_d / inertia,
        corrected=g1 * k1 * (g2 * k2 + b) > 0.25 * (a + g1 - g2) ** 2,
    )


__all__ = ["StabilityCheck", "check_stability"]
