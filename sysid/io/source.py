"""What identifies a log that a result was made from: its name, digest and use."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from sysid.io.logs import Log


@dataclass(frozen=True)
class Source:
    """A log that a bundle was fitted on, or that its campaign has for another use.

    `file` is its name alone, so that a bundle can be shared; `excluded` is what was not read of it,
    each as `sysid.io.exclusion.Exclusion.to_json`; `payload_kg` what it carried in place of the
    rig file's payload; `flow_control`: whether the valve's flow control was in place.
    """

    file: str
    sha256: str
    use: str
    kind: str
    excluded: tuple[dict[str, Any], ...] = ()
    payload_kg: float | None = None
    flow_control: bool = True

    @classmethod
    def of(cls, log: Log, use: str, kind: str) -> Source:
        """A log as it was read."""
        excluded = tuple(one.exclusion.to_json() for one in log.excluded)
        in_place = all(trial.flow_control for trial in log.trials)
        return cls(log.path.name, log.sha256, use, kind, excluded, flow_control=in_place)

    def to_json(self) -> dict[str, Any]:
        """The log's entry in `provenance.logs`."""
        entry = asdict(self)
        excluded = list(entry.pop("excluded"))
        payload, in_place = entry.pop("payload_kg"), entry.pop("flow_control")
        return {
            **entry,
            **({"excluded": excluded} if excluded else {}),
            **({} if payload is None else {"payload_mass_kg": payload}),
            **({} if in_place else {"flow_control": False}),
        }
