"""The bundle as an object: the rig, what was fitted, the effects, and where it all comes from."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from pydantic import ConfigDict, Field, JsonValue, PrivateAttr

from sysid import __version__
from sysid.bundle.base import Absent, Part
from sysid.bundle.effects import EffectEntry
from sysid.bundle.friction import Friction
from sysid.bundle.provenance import Provenance, family, records
from sysid.bundle.validation import Validation
from sysid.bundle.valves import Valve, Valves
from sysid.errors import input_error
from sysid.io.logs import Log
from sysid.io.rig import Rig, rig_from_content
from sysid.io.source import Source

if TYPE_CHECKING:
    from sysid.model.effects.entry import Catalogue
    from sysid.model.ports import Model

SCHEMA: Literal["sysid-bundle/1"] = "sysid-bundle/1"


@dataclass(frozen=True)
class Parts:
    """What the fits of a campaign give: friction, valves, either, or nothing."""

    friction: Friction | None = None
    valves: Valves | None = None

    def __bool__(self) -> bool:
        return self.friction is not None or self.valves is not None

    def merged(self, other: Parts) -> Parts:
        """With the parts of `other`; friction is replaced whole, valves by law."""
        valves = other.valves or self.valves
        if self.valves is not None and other.valves is not None:
            valves = self.valves.merged(other.valves)
        return Parts(other.friction or self.friction, valves)


class Bundle(Part):
    """Everything that was fitted of a rig (`spec/bundle.md`), as read from or written to JSON.

    `rig_content` is the rig file's tables as used; `rig` the rig that they describe. `source`
    names the file that it was read from, in messages.
    """

    model_config = ConfigDict(
        title="Parameter bundle of a pneumatic or hybrid pneumatic-electric actuator",
        populate_by_name=True,
    )

    schema_id: Literal["sysid-bundle/1"] = Field(alias="schema")
    created: str
    sysid_version: str
    rig_content: dict[str, JsonValue] = Field(alias="rig", json_schema_extra={"required": ["rig"]})
    friction: Absent[Friction] = None
    valves: Absent[Valves] = None
    effects: list[EffectEntry]
    validation: Absent[Validation] = None
    provenance: Provenance

    _source: str = PrivateAttr("bundle")

    @classmethod
    def new(
        cls,
        rig: Rig,
        parts: Parts,
        sources: Iterable[Source],
        *,
        seeds: Mapping[str, int] | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> Bundle:
        """A bundle of these parts, made now."""
        fields: dict[str, Any] = {
            "schema": SCHEMA,
            "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "sysid_version": __version__,
            "rig": rig.content,
        }
        fields |= {k: v for k, v in vars(parts).items() if v is not None}
        provenance = Provenance(
            logs=records(sources), seeds=dict(seeds or {}), options=dict(options or {})
        )
        return cls(**fields, effects=[], provenance=provenance)

    @property
    def source(self) -> str:
        """The file that the bundle was read from, for messages."""
        return self._source

    def named(self, source: str) -> Bundle:
        """The same bundle under another name in messages."""
        made = self.model_copy()
        made._source = source
        return made

    @property
    def rig(self) -> Rig:
        """The rig that the bundle was fitted for. Raises InputError."""
        return rig_from_content(self.rig_content, f"{self.source}, rig")

    @property
    def is_linear(self) -> bool:
        """Whether its rig is declared linear."""
        head = self.rig_content.get("rig")
        return isinstance(head, dict) and head.get("motion") == "linear"

    def valve(self, side: str) -> Valve:
        """What is known of the valve of a side ("a" or "b")."""
        return Valve() if self.valves is None else self.valves.side(side)

    def model(self, rig: Rig | None = None, catalogue: Catalogue | None = None) -> Model:
        """The model that can be simulated: the base model's parameters, and the effects.

        `rig` (None: the bundle's) says what the tests are run with; `catalogue` knows the
        effects (None: the project's own). Raises InputError for what contradicts itself,
        NotIdentifiedError where the bundle has no friction.
        """
        from sysid.bundle.assembled_model import model_from_bundle

        return model_from_bundle(self, rig or self.rig, catalogue)

    def with_effects(self, effects: Iterable[EffectEntry]) -> Bundle:
        """With these effects after those that it holds; its validation no longer holds."""
        return self.replaced(effects=[*self.effects, *effects], validation=None)

    def with_sources(self, sources: Iterable[Source]) -> Bundle:
        """With these logs in its provenance too."""
        return self.replaced(provenance=self.provenance.with_logs(records(sources)))

    def merged(self, other: Bundle) -> Bundle:
        """With the parts of `other` added; a part that both hold is replaced.

        The validation of what there was goes with it. Raises InputError where the two were
        fitted for different rigs.
        """
        mine, others = self.rig_content, other.rig_content
        for section in sorted(set(mine) | set(others)):
            if mine.get(section) != others.get(section):
                raise input_error(
                    self.source,
                    f"was fitted with another rig file ([{section}] differs)",
                    "fit both with the same rig file, or write a new bundle with -o",
                )
        fields = {key: getattr(other, _field(key)) for key in other.given() if key != "effects"}
        if self.valves is not None and other.valves is not None:
            fields["valves"] = self.valves.merged(other.valves)
        return self.replaced(
            **{_field(key): value for key, value in fields.items()}
            | {
                "effects": other.effects or self.effects,
                "validation": None,
                "provenance": self.provenance.merged(
                    other.provenance, other_has_friction=other.friction is not None
                ),
            }
        )

    def check_log_unchanged(self, log: Log, kind: str) -> None:
        """InputError where a log of `kind` has changed since the bundle was fitted on it.

        Logs of several folders may share a name: the bundle has to know one that is like it.
        """
        logs = self.provenance.logs
        fitted = any(
            e.use == "fit" and e.file == log.path.name and e.family == family(kind) for e in logs
        )
        if fitted and all(e.sha256 != log.sha256 for e in logs):
            raise input_error(
                self.source,
                f"{log.path.name} has changed since this bundle was fitted on it (SHA-256)",
                "fit again, or bring the old log back",
            )

    def check_not_fitted(self, log: Log) -> None:
        """InputError where a log that the campaign holds out is one that it was fitted on."""
        for entry in self.provenance.logs:
            if entry.use == "fit" and entry.sha256 == log.sha256:
                raise input_error(
                    log.path,
                    f"is held out in the campaign, but {self.source} was fitted on it "
                    f"({entry.file})",
                    'fit without it, or give it use = "fit"',
                )


def _field(key: str) -> str:
    """The field of a key of the file."""
    return {"schema": "schema_id", "rig": "rig_content"}.get(key, key)


__all__ = ["SCHEMA", "Bundle", "Parts"]
