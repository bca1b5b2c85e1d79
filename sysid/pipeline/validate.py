"""How well a model predicts the motion logs."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.blocks.progress import progress_or_shown
from sysid.components.loading import component_in
from sysid.errors import input_error
from sysid.io.campaign import MOTION_KINDS, SIMULATED_KINDS, Campaign
from sysid.parameters import Bundle
from sysid.pipeline.request import Reported, takes
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.refinement.prediction_bands import BandCoverage, band_coverage
from sysid.validation.results import ValidationResult


@dataclass(frozen=True, kw_only=True)
class ValidateOptions(Reported):
    """`effects`: those of the bundle that the catalogue lacks."""

    effects: EffectSource = None


@takes(ValidateOptions)
def validate(campaign: Campaign, bundle: Bundle, options: ValidateOptions) -> ValidationResult:
    """Simulate a campaign's motion logs open loop with a bundle's model, and compare.

    By each valve model that applies. `effects`: those of the bundle that are not in the
    catalogue, a Python file or the classes. Errors are in each channel's unit, the fit in
    percent. Raises InputError for logs that cannot be validated on or have changed since the
    fit, NotIdentifiedError where the bundle holds no valve model that applies.

    >>> checked = si.validate(campaign, bundle)
    >>> bool(checked.fit_percent.loc[:, "theta_rad"].max() > 50)
    True
    """
    catalogue = catalogue_from(options.effects)
    with progress_or_shown(options.progress, "validating") as tell:
        if component_in(campaign) is not None:
            from sysid.components.validation import validate_own

            return validate_own(campaign, bundle, progress=tell)
        from sysid.validation.open_loop import validate as simulated

        return simulated(campaign, bundle, catalogue=catalogue, progress=tell)


def is_validated(campaign: Campaign, bundle: Bundle) -> bool:
    """Whether a bundle is simulated against whole tests.

    An actuator's where there are motion logs; an axis' tested alone where its motion is held out.
    """
    if component_in(campaign) is not None:
        return True
    from sysid.diagnosis.bench.registry import AXIS, part_tested

    part = part_tested(campaign.training_kinds(), bundle)
    is_whole = part is None or (part == AXIS and campaign.select(MOTION_KINDS, "holdout"))
    return bool(is_whole and campaign.select(SIMULATED_KINDS, None))


def coverage(
    campaign: Campaign, bundle: Bundle, draws: int, seed: int, options: ValidateOptions
) -> BandCoverage:
    """The share of each motion log's samples within 90 % bands by `draws` drawn models.

    Raises InputError for a component of the user's own, or a campaign without motion logs.
    """
    if component_in(campaign) is not None:
        raise input_error(
            campaign.path,
            "is of a component of your own",
            "bands are drawn of actuators: omit --draws",
        )
    model = bundle.model(campaign.rig, catalogue_from(options.effects))
    return band_coverage(campaign, bundle, model, draws, seed, options.tell)


__all__ = ["BandCoverage", "ValidateOptions", "coverage", "is_validated", "validate"]
