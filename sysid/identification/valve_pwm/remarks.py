"""Notices about a log's tests, gathered by reason."""

from __future__ import annotations

from dataclasses import dataclass, field

from sysid.identification.valve_pwm.samples import PwmTest
from sysid.io.logs import Trial


@dataclass
class Remarks:
    """Notices by reason, so that fifty tests with one fault give one line."""

    tests: dict[tuple[str, str], list[str]] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)

    def exclude(self, trial: Trial | PwmTest, reason: str) -> None:
        """Note that a test is excluded for this reason."""
        self.about(trial, f"excluded: {reason}")

    def about(self, trial: Trial | PwmTest, what: str) -> None:
        """Note something about a test."""
        place = trial.source.removesuffix(f", test {trial.label}")
        self.tests.setdefault((place, what), []).append(trial.label)

    def notices(self, most: int = 8) -> tuple[str, ...]:
        """One line per reason, with `most` of the tests that it applies to."""
        lines = []
        for (place, what), labels in self.tests.items():
            if labels == [""]:
                lines.append(f"{place}: {what}")
                continue
            shown = ", ".join(labels[:most])
            if len(labels) > most:
                shown += f" and {len(labels) - most} more"
            lines.append(f"{place}, test{'s' if len(labels) > 1 else ''} {shown}: {what}")
        return (*lines, *self.lines)
