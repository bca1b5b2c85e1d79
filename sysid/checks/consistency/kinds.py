"""Logs of another kind than the campaign declares, as the commands of their tests show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.errors import InputError
from sysid.io.channels import DUTIES, SWITCHES
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.io.trial_kind import is_active
from sysid.recording.even import recorded
from sysid.recording.friction_kind import SLIDING, STATIC, classify, constant_run
from sysid.recording.recording import Recording

# Share of a log's tests: single ones may resemble the other kind.
_OTHER_KIND_SHARE = 0.8
# Share of a test: a kick may start the motion before a constant effort, and a ramp may end in one.
_SHORT_SHARE = 0.1
_COMMANDS = {
    "valve-pwm": DUTIES,
    "motion-pwm": DUTIES,
    "valve-discrete": SWITCHES,
    "motion-discrete": SWITCHES,
}
_SHAPES = {
    STATIC: (SLIDING, "the motor's effort is constant in its tests, where it has to grow slowly"),
    SLIDING: (STATIC, "the motor's effort grows slowly in its tests, where it has to be constant"),
}


def other_kind(trials: Sequence[Trial], kind: str, name: str, rig: Rig) -> str | None:
    """One line where the tests of a log, called `name`, are not of the declared `kind`."""
    commands = (rig.effort_channel,) if kind == "motion-motor" else _COMMANDS.get(kind, ())
    if commands and not any(is_active(t, *commands) for t in trials):
        return (
            f"{name}: declared {kind}, but none of its tests commands {' or '.join(commands)}: "
            "correct its kind in the campaign, or map the column that holds the command"
        )
    if kind in _SHAPES:
        other, why = _SHAPES[kind]
        looks_other = [_shape(t, rig) == other for t in trials]
        if looks_other and sum(looks_other) >= _OTHER_KIND_SHARE * len(looks_other):
            return (
                f"{name}: declared {kind}, but {why}: that is {other}; correct its kind in the "
                "campaign (the two may be exchanged)"
            )
    return None


def _shape(trial: Trial, rig: Rig) -> str:
    """The kind of a friction test by its effort; empty where that is not clear."""
    try:
        even = recorded(trial, rig, [])
    except InputError:
        return ""
    kind = classify(even)
    return "" if kind == SLIDING and _begins_as_ramp(even) else kind


def _begins_as_ramp(trial: Recording) -> bool:
    """Whether the effort grows for a while, without falling back, before it is constant."""
    start, _ = constant_run(trial.motor)
    before = np.abs(trial.motor[: start + 1])
    growing = before[int(np.argmax(before > _SHORT_SHARE * before.max())) :]
    falls = float(np.sum(np.maximum(-np.diff(growing), 0.0)))
    return len(growing) > _SHORT_SHARE * len(trial.motor) and falls < _SHORT_SHARE * float(
        before.max()
    )


__all__ = ["other_kind"]
