"""Validation: a bundle's model simulated open loop against the motion logs.

`open_loop` goes through a campaign, `judging` compares a simulated test with the measured one
(`residual_tests`), `results` is what comes out, `shown_tests`, `shown_residuals` and `shown_own`
its blocks.
"""

from sysid.validation.results import (
    HORIZONS_S,
    ChannelResult,
    Errors,
    HorizonError,
    LogResult,
    TestResult,
    ValidationResult,
)

__all__ = [
    "HORIZONS_S",
    "ChannelResult",
    "Errors",
    "HorizonError",
    "LogResult",
    "TestResult",
    "ValidationResult",
]
