"""The content of a bundle: the rig, the fitted parts, the effects, and the provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

from pydantic import ConfigDict, Field, JsonValue, PrivateAttr

from sysid.io.motion import MotionUnits, units_of
from sysid.io.rig import Rig, rig_from_content
from sysid.parameters.base import Absent, Part
from sysid.parameters.component import ComponentRecord
from sysid.parameters.effects import EffectEntry
from sysid.parameters.friction import Friction
from sysid.parameters.provenance import Provenance
from sysid.parameters.refinement import Refinement
from sysid.parameters.validation import Validation
from sysid.parameters.valves import FittedValves, Valve

SCHEMA: Literal["sysid-bundle/1"] = "sysid-bundle/1"


@dataclass(frozen=True)
class Parts:
    """The results of a campaign's fits: friction, valves, one of them, or nothing.

    `component` is a component of the user's own; `effects` are those that a fit was asked for.
    """

    friction: Friction | None = None
    valves: FittedValves | None = None
    component: ComponentRecord | None = None
    effects: tuple[EffectEntry, ...] = ()

    def __bool__(self) -> bool:
        return any(part not in (None, ()) for part in vars(self).values())

    def merged(self, other: Parts) -> Parts:
        """The parts merged with those of `other`; friction is replaced whole, valves law by law."""
        valves = other.valves or self.valves
        if self.valves is not None and other.valves is not None:
            valves = self.valves.merged(other.valves)
        return Parts(
            other.friction or self.friction,
            valves,
            other.component or self.component,
            other.effects or self.effects,
        )


class BundleContent(Part):
    """All fitted parameters of a rig (`docs/reference/bundle.md`), as read from or written to JSON.

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
    valves: Absent[FittedValves] = None
    component: Absent[ComponentRecord] = None
    effects: list[EffectEntry]
    validation: Absent[Validation] = None
    refinement: Absent[Refinement] = None
    provenance: Provenance

    _source: str = PrivateAttr("bundle")

    @classmethod
    def _check_form(cls, data: Mapping[str, Any]) -> None:
        super()._check_form(data)
        rig = data.get("rig")
        if isinstance(rig, Mapping) and "rig" not in rig:
            raise ValueError("rig lacks its head")

    @property
    def source(self) -> str:
        """The file that the bundle was read from, for messages."""
        return self._source

    def named(self, source: str) -> Self:
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

    @property
    def units(self) -> MotionUnits:
        """The units of its quantities, and the names of its keys."""
        return units_of(self.is_linear)

    def valve(self, side: str) -> Valve:
        """The valve of a side ("a" or "b")."""
        return Valve() if self.valves is None else self.valves.side(side)


__all__ = ["SCHEMA", "BundleContent", "Parts"]
