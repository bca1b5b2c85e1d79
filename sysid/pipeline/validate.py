"""How well a model predicts the motion logs."""

from __future__ import annotations

from sysid.blocks.progress import progress_or_shown
from sysid.io.campaign import Campaign
from sysid.parameters import Bundle
from sysid.pipeline.subject import subject_of
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.types import Progress
from sysid.validation.results import ValidationResult


def validate(
    campaign: Campaign,
    bundle: Bundle,
    *,
    effects: EffectSource = None,
    progress: Progress | None = None,
) -> ValidationResult:
    """Simulate a campaign's motion logs open loop with a bundle's model, and compare.

    By each valve model that applies. `effects`: those of the bundle that are not in the
    catalogue, a Python file or the classes. Errors are in each channel's unit, the fit in
    percent. Raises InputError for logs that cannot be validated on or have changed since the
    fit, NotIdentifiedError where the bundle holds no valve model that applies.

    >>> checked = si.validate(campaign, bundle)
    >>> bool(checked.fit_percent.loc[:, "theta_rad"].max() > 50)
    True
    """
    with progress_or_shown(progress, "validating") as tell:
        return subject_of(campaign).validate(bundle, catalogue_from(effects), tell)


__all__ = ["validate"]
