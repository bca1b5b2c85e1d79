"""The provenance of a bundle: its logs with their digests, seeds and options."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import Field, JsonValue, StringConstraints

from sysid.io.source import Source
from sysid.parameters.base import Absent, Part

Digest = Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]


class ExcludedRecord(Part):
    """A test of a log, or a span of one (s since its first row), that was excluded."""

    test: str
    from_s: Absent[float] = None
    to_s: Absent[float] = None
    why: Absent[str] = None


class LogRecord(Part):
    """A log of the bundle's campaign: the name of its file alone, SHA-256, use and kind.

    `excluded`: what was not read of it; `payload_mass_kg`: what it carried, where that is not the
    rig file's payload.
    """

    file: str
    sha256: Digest
    use: Literal["fit", "holdout"]
    kind: Absent[str] = None
    excluded: Absent[list[ExcludedRecord]] = None
    payload_mass_kg: Absent[float] = None

    @property
    def family(self) -> str:
        """The part that its kind is fitted to: "friction" for every kind of friction test."""
        return family(self.kind or "")


class Provenance(Part):
    """The logs that a bundle was fitted on or that its campaign holds out; seeds, options."""

    logs: list[LogRecord]
    seeds: dict[str, JsonValue] = Field(default_factory=dict)
    options: dict[str, JsonValue] = Field(default_factory=dict)

    @property
    def fitted_on(self) -> frozenset[tuple[str, str]]:
        """Kind and SHA-256 of each training log."""
        return frozenset((log.kind or "", log.sha256) for log in self.logs if log.use == "fit")

    def with_logs(self, logs: Iterable[LogRecord]) -> Provenance:
        """The provenance with these logs too, each once."""
        known = {(e.sha256, e.kind, e.use): e for e in [*self.logs, *logs]}
        return self.replaced(logs=list(known.values()))

    def updated(self, logs: Iterable[LogRecord]) -> Provenance:
        """The provenance with the logs of a campaign as they are now.

        A held-out log whose content has changed replaces its record: nothing was fitted on it.
        """
        given = list(logs)
        now = {e.sha256 for e in given}
        held = {(e.file, e.kind) for e in given if e.use == "holdout"}
        kept = [
            e
            for e in self.logs
            if e.use != "holdout" or e.sha256 in now or (e.file, e.kind) not in held
        ]
        return self.replaced(logs=kept).with_logs(given)

    def merged(self, other: Provenance, *, other_has_friction: bool) -> Provenance:
        """The provenance of a bundle that adds parts of another.

        Friction is replaced whole, and its logs with it; valves may come one by one.
        """
        kept = [e for e in self.logs if not (other_has_friction and e.family == "friction")]
        return self.replaced(
            logs=kept,
            seeds={**self.seeds, **other.seeds},
            options={**self.options, **other.options},
        ).with_logs(other.logs)


def family(kind: str) -> str:
    """The part that a kind of log is fitted to."""
    return "friction" if kind.startswith("friction") else kind


def records(sources: Iterable[Source]) -> list[LogRecord]:
    """Logs from a campaign or a reader in the form of a bundle."""
    return [LogRecord.model_validate(s.to_json()) for s in sources]


__all__ = ["ExcludedRecord", "LogRecord", "Provenance", "family", "records"]
