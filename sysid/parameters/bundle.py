"""The bundle as an object: created, merged and extended, and the model that it describes."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from sysid import __version__
from sysid.blocks.quality import quality_table
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, estimate_records, estimate_table
from sysid.errors import input_error
from sysid.estimation.covariance import JointCovariance
from sysid.estimation.linear import Estimate
from sysid.io.channels import SIDES
from sysid.io.rig import Rig, differing_sections
from sysid.io.source import Source
from sysid.parameters.base import Part
from sysid.parameters.content import SCHEMA, BundleContent, Parts
from sysid.parameters.correlation import CorrelatedPart, Correlation
from sysid.parameters.effects import EffectEntry
from sysid.parameters.provenance import Provenance, records
from sysid.parameters.quality import QualityRecord, qualities_in
from sysid.parameters.table import ParameterTable, effect_names, table_of

if TYPE_CHECKING:
    from sysid.plant.effects.entry import Catalogue
    from sysid.plant.ports import Model


# Results that depend on the parts: they are dropped when a part changes.
_JUDGED = ("validation", "refinement")
# Parts that merging does not copy unchanged.
_OWN = ("effects", *_JUDGED)
_Fitted = TypeVar("_Fitted", bound=CorrelatedPart)


class Bundle(Shown, BundleContent):
    """All fitted parameters of a rig (`docs/reference/bundle.md`), as read from or written to JSON.

    >>> bundle.friction.coulomb_nm.unit, bundle.valve("a").discrete.on_delay_s.unit
    ('Nm', 's')
    >>> bundle.rig.name == campaign.rig.name
    True
    >>> model = bundle.model()
    """

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
        fields["effects"] = list(parts.effects)
        provenance = Provenance(
            logs=records(sources), seeds=dict(seeds or {}), options=dict(options or {})
        )
        return cls(**fields, provenance=provenance)

    def headline(self) -> str:
        """The rig, and the bundle's content."""
        effects = [effect.id for effect in self.effects]
        held = ", ".join([*self._parts(), *(f"effect {name}" for name in effects)])
        return f"bundle of {self.rig.name}: {held or 'nothing fitted'}"

    def records(self) -> list[dict[str, Any]]:
        """One record per estimate: its part, value, std, limits and unit."""
        return [
            record
            for name, part in self._shown_parts()
            for record in estimate_records(part.estimates, part=name)
        ]

    def tables(self) -> Iterable[Table]:
        """The estimates, one table per part, and how well the laws follow their tests."""
        yield from (estimate_table(name, part.estimates) for name, part in self._shown_parts())
        yield quality_table(self.qualities())

    def qualities(self) -> dict[str, QualityRecord]:
        """How well each fitted law follows its tests, by its place in the bundle."""
        parts = (
            ("friction", self.friction),
            ("valves", self.valves),
            ("component", self.component),
        )
        return {k: q for name, part in parts for k, q in qualities_in(part, name)}

    def _parts(self) -> dict[str, Part]:
        """Friction and every valve law, by their keys in the file."""
        found: dict[str, Part] = {} if self.friction is None else {"friction": self.friction}
        for side in SIDES:
            valve = self.valve(side)
            laws = ((name, getattr(valve, name)) for name in valve.given())
            found |= {f"valves.{side}.{n}": law for n, law in laws if isinstance(law, Part)}
        if self.component is not None:
            found[self.component.kind] = self.component
        return found

    @property
    def parameters(self) -> ParameterTable:
        """Every number of it, with its error and what it is."""
        return table_of(self)

    def _shown_parts(self) -> Iterator[tuple[str, ParameterTable]]:
        """The numbers of each part by what it is called; a component's own by its kind."""
        shown = self.parameters.where(lambda row: row.status != "alternative")
        kind = "" if self.component is None else self.component.kind
        for place, part in shown.parts().items():
            yield kind if part.rows[0].origin == "component" else place, part

    def model(
        self, rig: Rig | None = None, catalogue: Catalogue | None = None, *, held: bool = False
    ) -> Model:
        """The model that can be simulated: the base model's parameters, and the effects.

        `rig` (None: the bundle's) is the rig that is simulated; `catalogue` holds the effects
        (None: the project's own); `held`: the shaft is fixed, which needs no friction. Raises
        InputError for contradictory content, NotIdentifiedError where the bundle has no friction.
        """
        from sysid.parameters.assembled_model import model_from_bundle

        return model_from_bundle(self, rig or self.rig, catalogue, held)

    def with_effects(self, effects: Iterable[EffectEntry]) -> Bundle:
        """The bundle with these effects after its own; validation and refinement are dropped."""
        return self.without(*_JUDGED).replaced(effects=[*self.effects, *effects])

    def with_estimates(
        self, estimates: Mapping[str, Estimate], joint: JointCovariance | None = None
    ) -> Bundle:
        """The bundle with these numbers, by alias, in place of its own.

        The correlation of replaced numbers is that of `joint`, by alias too.
        """
        fields: dict[str, Any] = {}
        if self.friction is not None:
            renewed = _renewed(self.friction, "friction.", estimates, joint)
            fields["friction"] = renewed.with_sum_of(self.friction)
        if self.valves is not None:
            sides = {
                side: valve.replaced(
                    discrete=_renewed(valve.discrete, f"valves.{side}.", estimates, joint)
                )
                for side, valve in self.valves.sides().items()
                if valve.discrete is not None
            }
            fields["valves"] = self.valves.replaced(**sides)
        fields["effects"] = [
            entry.replaced(parameters={**entry.parameters, **_under(f"{name}.", estimates)})
            for name, entry in zip(effect_names(self.effects), self.effects, strict=True)
        ]
        return self.replaced(**fields)

    def with_sources(self, sources: Iterable[Source]) -> Bundle:
        """The bundle with these logs of a campaign in its provenance, as they are now."""
        return self.replaced(provenance=self.provenance.updated(records(sources)))

    def merged(self, other: Bundle) -> Bundle:
        """The bundle with the parts of `other` added; a part that both hold is replaced.

        The existing validation and refinement are dropped. Raises InputError where the two were
        fitted for different rigs.
        """
        if differ := differing_sections(self.rig_content, other.rig_content):
            raise input_error(
                self.source,
                f"was fitted with another rig file ([{differ[0]}] differs)",
                "fit both with the same rig file, or write a new bundle with -o",
            )
        fields = {key: getattr(other, _field(key)) for key in other.given() if key not in _OWN}
        if self.valves is not None and other.valves is not None:
            fields["valves"] = self.valves.merged(other.valves)
        return self.without(*_JUDGED).replaced(
            **{_field(key): value for key, value in fields.items()}
            | {
                "effects": other.effects or self.effects,
                "provenance": self.provenance.merged(
                    other.provenance, other_has_friction=other.friction is not None
                ),
            }
        )

    def other_sections(self, rig: Rig) -> list[str]:
        """The sections in which a rig file differs from the one that it was fitted with."""
        return differing_sections(self.rig_content, rig.content)

    def other_rig(self, rig: Rig) -> list[str]:
        """A notice where the rig file in use is not the one that the bundle was fitted with."""
        other = self.other_sections(rig)
        if not other:
            return []
        from sysid.parameters.assembled_model import fitted_inertia

        payload = (
            ", but for the fitted inertia, to which what the payloads differ by is added"
            if "inertia" in other and fitted_inertia(self) is not None
            else ""
        )
        return [
            f"{self.source}: fitted with another rig file than {rig.source} "
            f"({', '.join(f'[{s}]' for s in other)} differ); the campaign's is used{payload}"
        ]


def _under(prefix: str, estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
    return {n.removeprefix(prefix): e for n, e in estimates.items() if n.startswith(prefix)}


def _renewed(
    part: _Fitted, prefix: str, estimates: Mapping[str, Estimate], joint: JointCovariance | None
) -> _Fitted:
    """The part with the estimates whose aliases begin so, and the correlation of their errors."""
    own = _under(prefix, estimates)
    if joint is not None:
        keys = {n: n.removeprefix(prefix) for n in joint.names if n.startswith(prefix)}
        if (found := Correlation.of(joint, keys, keys)) is not None:
            return part.replaced(**own, correlation=found)
    return part.replaced(**own) if own else part


def _field(key: str) -> str:
    """The field of a key of the file."""
    return {"schema": "schema_id", "rig": "rig_content"}.get(key, key)


__all__ = ["Bundle"]
