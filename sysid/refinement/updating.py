"""A bundle with its refined numbers: in friction, in the valves' laws, in its effects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from pydantic import JsonValue

from sysid.bundle import Bundle
from sysid.bundle.base import Part
from sysid.bundle.refinement import Refinement
from sysid.estimation.linear import Estimate
from sysid.io.campaign import Campaign
from sysid.io.channels import SIDES
from sysid.refinement.result import RefineResult
from sysid.refinement.unknowns import effect_names


def updated(
    bundle: Bundle,
    campaign: Campaign,
    result: RefineResult,
    kinds: Iterable[str],
    options: Mapping[str, JsonValue],
) -> Bundle:
    """A bundle with a refinement's estimates, its record, and in the provenance its logs, which
    are of these kinds, and its options.

    Constants of the rig file stay as declared: their estimates are in the record alone. The
    validation is dropped.
    """
    # What neither the bench tests nor motion told stays unidentified.
    estimates = {p.name: p.estimate for p in result.parameters if p.is_known}
    fields: dict[str, object] = {}
    if bundle.friction is not None:
        fields["friction"] = _replaced(bundle.friction, _under("friction.", estimates))
    if bundle.valves is not None:
        sides = {
            side: valve.replaced(
                discrete=_replaced(valve.discrete, _under(f"valves.{side}.", estimates))
            )
            for side in SIDES
            if (valve := bundle.valves.sides().get(side)) is not None and valve.discrete is not None
        }
        fields["valves"] = bundle.valves.replaced(**sides)
    fields["effects"] = [
        entry.replaced(parameters={**entry.parameters, **_under(f"{name}.", estimates)})
        for name, entry in zip(effect_names(bundle), bundle.effects, strict=True)
    ]
    fields["refinement"] = Refinement.model_validate(result.to_json())
    made = bundle.without("validation").replaced(**fields)
    wanted = set(kinds)
    made = made.with_sources([s for s in campaign.sources() if s.kind in wanted])
    every = {**made.provenance.options, "refinement": dict(options)}
    return made.replaced(provenance=made.provenance.replaced(options=every))


def _under(prefix: str, estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
    return {n.removeprefix(prefix): e for n, e in estimates.items() if n.startswith(prefix)}


def _replaced(part: Part, estimates: Mapping[str, Estimate]) -> Part:
    return part.replaced(**estimates) if estimates else part
