"""The assembled model fitted as a whole, by the error of its simulation."""

from __future__ import annotations

from collections.abc import Iterable

from sysid.blocks.progress import progress_or_shown
from sysid.components.refinement import OwnRefinement
from sysid.io.campaign import Campaign
from sysid.parameters import Bundle
from sysid.pipeline.subject import subject_of
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.refinement.result import RefineResult
from sysid.types import Progress


def refine(
    campaign: Campaign,
    bundle: Bundle,
    *,
    free: Iterable[str] = (),
    fix: Iterable[str] = (),
    prior: bool = True,
    robust: bool = False,
    profile: Iterable[str] = (),
    effects: EffectSource = None,
    progress: Progress | None = None,
) -> RefineResult | OwnRefinement:
    """Estimate a bundle's parameters together on a campaign's motion logs to fit on.

    A component of your own (`read_campaign(..., component=)`) is refined on its own tests.

    `free`: constants of the rig file that are estimated too, `fix`: parameters that stay; without
    `prior` the bench tests count for the start only; `robust`: each segment's errors count by
    their own size; `profile`: parameters with an interval by profile likelihood. `effects`: those
    of the bundle that are not in the catalogue, a Python file or the classes. Raises InputError
    for an unknown name or a campaign without motion logs to fit on, NotIdentifiedError where the
    bundle does not hold the on/off law of both valves. A rig with a motor alone, without air,
    cylinder and valves, is refined on its friction-motion logs.

    >>> refined = si.refine(campaign, bundle)                           # doctest: +SKIP
    >>> si.write_bundle(refined.bundle, "refined.json")                 # doctest: +SKIP
    """
    with progress_or_shown(progress, "refining") as tell:
        options = {"free": free, "fix": fix, "prior": prior, "robust": robust, "profile": profile}
        catalogue = catalogue_from(effects)
        return subject_of(campaign).refine(bundle, tell, {**options, "catalogue": catalogue})


__all__ = ["refine"]
