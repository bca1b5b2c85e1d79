"""What the thesis' stability analyses say of a controller's gains (4.3.3.2, 4.4.5), as conditions.

`error_budget.py` adds the bounds of the tracking error (4.3.36, 4.4.14).
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Condition:
    """A condition: `value` is to exceed `least`, both in `unit`; `equation` of the thesis."""

    name: str
    value: float
    least: float
    unit: str
    equation: str

    @property
    def holds(self) -> bool:
        """Whether the value exceeds what it is to exceed."""
        return self.value > self.least


@dataclass(frozen=True)
class StabilityCheck:
    """Gains against conditions; 1/s.

    `least_k1`, `least_k2` are the printed bounds (4.3.50), and `printed` whether both hold.
    `corrected` is whether k1 (k2 + b) > a^2/4 holds, which is sufficient with the signs as
    they follow from 4.3.16: the motor's extra effort is what it gives beyond the wanted one,
    z_m = -t_PD, so that its damping b = g2 Kd / I adds to k2, where the print subtracts it;
    a = g2 (Kp - Kd k1) / I. `left` and `right` are its two sides, 1/s2. A proof fails where a
    condition does not hold; the loop need not.
    """

    k1: float
    k2: float
    least_k1: float
    least_k2: float
    left: float
    right: float

    @property
    def printed(self) -> bool:
        """Whether both printed conditions hold."""
        return self.k1 > self.least_k1 and self.k2 > self.least_k2

    @property
    def corrected(self) -> bool:
        """Whether the corrected condition holds."""
        return self.left > self.right

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The printed ones, and the corrected one."""
        return (
            Condition("k1, as printed", self.k1, self.least_k1, "1/s", "4.3.50"),
            Condition("k2, as printed", self.k2, self.least_k2, "1/s", "4.3.50"),
            Condition(
                "k1 (k2 + b) against a^2/4, z_m's sign corrected",
                self.left,
                self.right,
                "1/s2",
                "4.3.47",
            ),
        )

    @property
    def lines(self) -> list[str]:
        """Conditions that do not hold, one line each; empty where all do."""
        return [
            f"{c.name}: {c.value:.3g} {c.unit} does not exceed {c.least:.3g} ({c.equation})"
            for c in self.conditions
            if not c.holds
        ]


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
        left=g1 * k1 * (g2 * k2 + b),
        right=0.25 * (a + g1 - g2) ** 2,
    )


def inverse_dynamics_conditions(stiffness: float, damping: float) -> tuple[Condition, ...]:
    """Both coefficients of the error's equation (4.4.13) positive; Nm/rad and Nm s/rad."""
    return (
        Condition("K_p of the inverse dynamics", stiffness, 0.0, "N m/rad", "4.4.13"),
        Condition("K_d of the inverse dynamics", damping, 0.0, "N m s/rad", "4.4.13"),
    )


def largest_response(inertia: float, damping: float, stiffness: float) -> float:
    """Largest |e| per largest |d| of inertia e'' + damping e' + stiffness e = d, from rest.

    The integral of the impulse response's size: 1/stiffness without overshoot, and
    coth(pi zeta / (2 sqrt(1 - zeta^2))) / stiffness with a damping ratio zeta below 1. Infinite
    where the equation is not stable. kg m2, Nm s/rad, Nm/rad in; rad/Nm out.
    """
    if not min(inertia, damping, stiffness) > 0.0:
        return math.inf
    ratio = damping / (2.0 * math.sqrt(stiffness * inertia))
    if ratio >= 1.0:
        return 1.0 / stiffness
    return 1.0 / (math.tanh(0.5 * math.pi * ratio / math.sqrt(1.0 - ratio**2)) * stiffness)


__all__ = [
    "Condition",
    "StabilityCheck",
    "check_stability",
    "inverse_dynamics_conditions",
    "largest_response",
]
