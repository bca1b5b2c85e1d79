"""The assembled model fitted as a whole, by the error of its simulation."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.blocks.progress import progress_or_shown
from sysid.components.loading import component_in
from sysid.io.campaign import Campaign
from sysid.parameters import Bundle
from sysid.pipeline.request import Reported, takes
from sysid.plant.effects.catalogue import EffectSource, catalogue_from

if TYPE_CHECKING:
    from sysid.components.refinement import OwnRefinement
    from sysid.refinement.result import RefineResult

    Refined = RefineResult | OwnRefinement


@dataclass(frozen=True, kw_only=True)
class RefineOptions(Reported):
    """`free`, `fix` and `profile` name parameters; `effects`: those that the catalogue lacks."""

    free: Iterable[str] = ()
    fix: Iterable[str] = ()
    prior: bool = True
    robust: bool = False
    profile: Iterable[str] = ()
    effects: EffectSource = None


@takes(RefineOptions)
def refine(campaign: Campaign, bundle: Bundle, options: RefineOptions) -> Refined:
    """Estimate a bundle's parameters together on a campaign's training motion logs.

    A component of your own (`read_campaign(..., component=)`) is refined on its own tests.

    `free`: constants of the rig file that are estimated too, `fix`: parameters that stay; without
    `prior` the bench tests count for the start only; `robust`: each segment's errors count by
    their own size; `profile`: parameters with an interval by profile likelihood. `effects`: those
    of the bundle that are not in the catalogue, a Python file or the classes. Raises InputError
    for an unknown name or a campaign without training motion logs, NotIdentifiedError where the
    bundle does not hold the on/off law of both valves. A rig with a motor alone, without air,
    cylinder and valves, is refined on its friction-motion logs.

    >>> refined = si.refine(campaign, bundle)                           # doctest: +SKIP
    >>> si.write_bundle(refined.bundle, "refined.json")                 # doctest: +SKIP
    """
    catalogue = catalogue_from(options.effects)
    with progress_or_shown(options.progress, "refining") as tell:
        if component_in(campaign) is not None:
            from sysid.components.refinement import refine_own

            return refine_own(campaign, bundle, progress=tell)
        from sysid.refinement.refine import refine as refined  # loads jax

        return refined(
            campaign,
            bundle,
            free=options.free,
            fix=options.fix,
            prior=options.prior,
            robust=options.robust,
            profile=options.profile,
            catalogue=catalogue,
            progress=tell,
        )


def why_not_refined(campaign: Campaign, bundle: Bundle) -> str:
    """Why a bundle is not to be refined (again); empty where it is.

    A part tested alone has no motion to simulate, save an axis with a motor.
    """
    if component_in(campaign) is None:
        from sysid.diagnosis.bench.registry import AXIS, part_tested

        part = part_tested(campaign.training_kinds(), bundle)
        is_axis = part == AXIS and campaign.rig.is_motor_alone
        if campaign.rig.is_tank_alone or (part is not None and not is_axis):
            return "a part tested alone has no motion to simulate"
    return "" if bundle.refinement is None else "it is already refined"


__all__ = ["RefineOptions", "refine", "why_not_refined"]
