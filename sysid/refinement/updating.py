"""A bundle with its refined numbers: in friction, in the valves' laws, in its effects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from pydantic import JsonValue

from sysid.estimation.covariance import JointCovariance
from sysid.estimation.linear import Estimate
from sysid.io.campaign import Campaign
from sysid.parameters import Bundle
from sysid.parameters.refinement import Refinement
from sysid.refinement.result import RefineResult

# A parameter that was not identified has no correlation, not even with itself.
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
    made = bundle.without("validation").with_estimates(*_found(result))
    made = made.replaced(refinement=Refinement.model_validate(result.to_json()))
    wanted = set(kinds)
    made = made.with_sources([s for s in campaign.sources() if s.kind in wanted])
    every = {**made.provenance.options, "refinement": dict(options)}
    return made.replaced(provenance=made.provenance.replaced(options=every))


def _found(result: RefineResult) -> tuple[dict[str, Estimate], JointCovariance]:
    """The estimates by alias, and the correlation of the errors of those that were identified;
    what neither the bench tests nor motion identified stays so."""
    known = [i for i, p in enumerate(result.parameters) if p.is_known]
    estimates = {result.parameters[i].name: result.parameters[i].estimate for i in known}
    said = [i for i in known if result.correlation[i, i] > _NOTHING]
    names = tuple(result.parameters[i].name for i in said)
    return estimates, JointCovariance(names, result.correlation[np.ix_(said, said)])
