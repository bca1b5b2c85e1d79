"""What identifies a log that a result was made from: its name, digest and use."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from sysid.io.logs import Log


@dataclass(frozen=True)
class Source:
    """A log that a bundle was fitted on, or that its campaign has for another use.

    `file` is its name alone, so that a bundle can be shared.
    """

    file: str
    sha256: str
    use: str
    kind: str

    @classmethod
    def of(cls, log: Log, use: str, kind: str) -> Source:
        """A log as it was read."""
        return cls(log.path.name, log.sha256, use, kind)

    def to_json(self) -> dict[str, str]:
        """The log's entry in `provenance.logs`."""
        return asdict(self)
