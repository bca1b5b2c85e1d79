"""The expected errors of a refinement, as the campaign's own motion logs show them.

A refinement's residuals contain the model's error as well as the sensors' noise, and whether the
model follows whole tests determines how much information a test carries. So the logs are refined
as `sysid refine` does it, and the next test is assumed to behave alike.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from sysid.recording.motion_tests import MotionTest
from sysid.refinement.estimation import FrictionScatter, estimate
from sysid.refinement.lengthening import lengthened
from sysid.refinement.options import AdviceSetting, plain_problem
from sysid.refinement.runs import runs_of
from sysid.types import Progress, no_progress


def with_expected_errors(
    setting: AdviceSetting,
    logged: Sequence[MotionTest],
    scatter: FrictionScatter,
    progress: Progress = no_progress,
) -> AdviceSetting:
    """The setting with the logged tests refined; as it is, with white noise, without such tests."""
    position = setting.rig.position_channel
    runs = [r for i, test in enumerate(logged) for r in runs_of(i, test, setting.model, position)]
    if not runs:
        return setting
    problem = plain_problem(runs, len(logged), setting)
    found = lengthened(estimate(problem, scatter, progress=progress), logged, progress)
    return dataclasses.replace(setting, scatter=found.scatter.pair, refined=found)


__all__ = ["with_expected_errors"]
