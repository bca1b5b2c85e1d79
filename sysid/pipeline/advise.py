"""Which test to run next."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.special import ndtri

from sysid.blocks.progress import progress_or_shown
from sysid.diagnosis.thresholds import SIGNIFICANCE
from sysid.io.campaign import Campaign
from sysid.parameters import Bundle
from sysid.pipeline.request import Reported, takes
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.plant.effects.catalogue import catalogue as own_catalogue
from sysid.refinement.advice_result import AdviceResult


@dataclass(frozen=True, kw_only=True)
class AdviseOptions(Reported):
    """`effects`: those of the bundle that the catalogue lacks."""

    effects: EffectSource = None


@takes(AdviseOptions)
def advise(campaign: Campaign, bundle: Bundle, options: AdviseOptions) -> AdviceResult:
    """Standard errors that each of a list of tests would lead to, the best test first.

    Of every parameter of the bundle and strength of its effects, in their units, `now` (bench
    tests and training motion logs) and after each test that the rig can do; the tests that
    distinguish tied parameters and effects; the smallest detectable size of each effect.
    `effects` as in `validate`. Raises InputError for logs that cannot be used, NotIdentifiedError
    where the bundle does not hold the on/off law of both valves.

    >>> advice = si.advise(campaign, bundle)
    >>> best = advice.candidates[0]
    >>> best.gain > 0 and bool((best.std <= advice.now * 1.001).all())
    True
    """
    from sysid.refinement import advice

    catalogue = catalogue_from(options.effects)
    # As in a diagnosis: an effect is detected where chance among all of them is excluded.
    threshold = -float(ndtri(SIGNIFICANCE / len(catalogue or own_catalogue())))
    with progress_or_shown(options.progress, "advising") as tell:
        return advice.advise(
            campaign, bundle, threshold=threshold, catalogue=catalogue, progress=tell
        )


__all__ = ["AdviseOptions", "advise"]
