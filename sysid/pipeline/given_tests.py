"""The input of fits and simulations: logs or single tests, and the rig that they belong to."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from sysid.errors import input_error
from sysid.io.rig import Rig
from sysid.io.samples import Log, Trial
from sysid.pipeline.request import require

Tests = Log | Trial | Iterable[Log | Trial]
"""A log, a test of one, or several of either."""


def trials_of(tests: Tests) -> list[Trial]:
    """All single tests, in order."""
    return [trial for part in _parts(tests) for trial in _trials(part)]


def rig_of(tests: Tests, rig: Rig | None) -> Rig:
    """The given rig, else that of the logs. Raises InputError where the logs' rigs differ."""
    if rig is not None:
        require(rig, "rig", "Rig")
        return rig
    known = [part.rig for part in _parts(tests) if isinstance(part, Log) and part.rig is not None]
    if not known:
        raise input_error("rig", "is missing, and single tests carry no rig", "pass a rig")
    if any(other.content != known[0].content for other in known):
        names = " and ".join(sorted({r.source for r in known}))
        raise input_error(names, "the logs belong to different rigs", "pass the intended rig")
    return known[0]


def _parts(tests: Tests) -> list[Log | Trial]:
    """Raises InputError for anything but a log or a test: a DataFrame, a path."""
    given: Any = tests
    is_one = isinstance(given, Log | Trial | str) or not isinstance(given, Iterable)
    parts = [given] if is_one else list(given)
    if not all(isinstance(part, Log | Trial) for part in parts):
        raise input_error(
            "tests",
            f"{type(tests).__name__} is neither a log nor tests of one",
            "pass what si.read_log gives, or trials of it",
        )
    return parts


def _trials(part: Log | Trial) -> tuple[Trial, ...]:
    return part.trials if isinstance(part, Log) else (part,)


__all__ = ["Tests", "rig_of", "trials_of"]
