"""A bundle with its refined numbers: in friction, in the valves' laws, in its effects."""

from __future__ import annotations

from collections.abc import Mapping

from sysid.bundle import Bundle
from sysid.bundle.base import Part
from sysid.bundle.refinement import Refinement
from sysid.estimation.linear import Estimate
from sysid.io.campaign import Campaign
from sysid.io.channels import SIDES
from sysid.refinement.result import RefineResult


def updated(bundle: Bundle, campaign: Campaign, result: RefineResult) -> Bundle:
    """A bundle with a refinement's estimates, its record, and its logs in the provenance.

    Constants of the rig file stay as declared: their estimates are in the record alone. The
    validation is dropped.
    """
    estimates = {p.name: p.estimate for p in result.parameters}
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
        entry.replaced(parameters={**entry.parameters, **_under(f"{entry.id}.", estimates)})
        for entry in bundle.effects
    ]
    fields["refinement"] = Refinement.model_validate(result.to_json())
    made = bundle.without("validation").replaced(**fields)
    return made.with_sources([*campaign.sources("fit"), *campaign.sources("holdout")])


def _under(prefix: str, estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
    return {n.removeprefix(prefix): e for n, e in estimates.items() if n.startswith(prefix)}


def _replaced(part: Part, estimates: Mapping[str, Estimate]) -> Part:
    return part.replaced(**estimates) if estimates else part
