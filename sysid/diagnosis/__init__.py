"""What a fitted model lacks: residuals, twins, screening, refit, verdict."""

from sysid.diagnosis.actuator.diagnose import diagnose
from sysid.diagnosis.actuator.result import BeforeAfter, Diagnosis, FoundEffect
from sysid.diagnosis.actuator.unexplained import Unexplained

__all__ = ["BeforeAfter", "Diagnosis", "FoundEffect", "Unexplained", "diagnose"]
