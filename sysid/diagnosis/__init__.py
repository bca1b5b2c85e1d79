"""What a fitted model lacks: residuals, twins, screening, refit, verdict."""

from sysid.diagnosis.diagnose import diagnose
from sysid.diagnosis.leftover import Unexplained
from sysid.diagnosis.result import BeforeAfter, Diagnosis, FoundEffect

__all__ = ["BeforeAfter", "Diagnosis", "FoundEffect", "Unexplained", "diagnose"]
