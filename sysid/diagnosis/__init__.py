"""What a fitted model lacks: residuals, twins, screening, refit, verdict.

`actuator/` and `bench/` diagnose, `campaign` chooses between them and extends the bundle,
`thresholds` holds what both are judged by, `looked` what a search looked at, `wording` the
verdict in words, `content` what a report shows.
"""

from sysid.diagnosis.actuator.diagnose import diagnose
from sysid.diagnosis.actuator.result import BeforeAfter, Diagnosis, FoundEffect
from sysid.diagnosis.actuator.unexplained import Unexplained

__all__ = ["BeforeAfter", "Diagnosis", "FoundEffect", "Unexplained", "diagnose"]
