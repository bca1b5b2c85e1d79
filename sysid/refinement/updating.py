"""A bundle with its refined numbers: in friction, in the valves' laws, in its effects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeVar

import numpy as np
from pydantic import JsonValue

from sysid.estimation.covariance import JointCovariance
from sysid.estimation.linear import Estimate
from sysid.io.campaign import Campaign
from sysid.io.channels import SIDES
from sysid.parameters import Bundle, Correlation
from sysid.parameters.correlation import CorrelatedPart
from sysid.parameters.refinement import Refinement
from sysid.refinement.result import RefineResult
from sysid.refinement.unknowns import effect_names

_Fitted = TypeVar("_Fitted", bound=CorrelatedPart)
# A parameter that nothing was said of has no correlation, not even with itself.
_NOTHING = 0.5


def updated(
    bundle: Bundle,
    campaign: Campaign,
    result: RefineResult,
    kinds: Iterable[str],
    options: Mapping[str, JsonValue],
) -> Bundle:
    """A bundle with a refinement's estimates, its record, and in the provenance its logs, which
    are of these kinds, and its options.

    Each part's numbers come with the correlation of their errors; those across parts are in the
    record alone, as are the estimates of the rig file's constants, which stay as declared. The
    validation is dropped.
    """
    estimates = _known(result)
    fields: dict[str, object] = {}
    if bundle.friction is not None:
        fields["friction"] = _replaced(bundle.friction, "friction.", result)
    if bundle.valves is not None:
        sides = {
            side: valve.replaced(discrete=_replaced(valve.discrete, f"valves.{side}.", result))
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


def _known(result: RefineResult) -> dict[str, Estimate]:
    """The estimates by name; what neither the bench tests nor motion told stays unidentified."""
    return {p.name: p.estimate for p in result.parameters if p.is_known}


def _under(prefix: str, estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
    return {n.removeprefix(prefix): e for n, e in estimates.items() if n.startswith(prefix)}


def _replaced(part: _Fitted, prefix: str, result: RefineResult) -> _Fitted:
    """The part with the estimates whose names begin so, and the correlation of their errors."""
    estimates = _under(prefix, _known(result))
    found = _correlation(prefix, result)
    if found is not None:
        return part.replaced(**estimates, correlation=found)
    return part.replaced(**estimates) if estimates else part


def _correlation(prefix: str, result: RefineResult) -> Correlation | None:
    """Of those that something was said of; None where these are not two."""
    said = np.diag(result.correlation) > _NOTHING
    pairs = zip(result.parameters, said, strict=True)
    names = [p.name if s and p.is_known else "" for p, s in pairs]
    places = [i for i, name in enumerate(names) if name.startswith(prefix)]
    own = tuple(names[i].removeprefix(prefix) for i in places)
    return Correlation.of(JointCovariance(own, result.correlation[np.ix_(places, places)]), own)
