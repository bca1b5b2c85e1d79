"""Which test to run next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from scipy.special import ndtri

from sysid.blocks.progress import progress_or_shown
from sysid.diagnosis.thresholds import SIGNIFICANCE
from sysid.io.campaign import Campaign
from sysid.parameters import Bundle
from sysid.parameters.titles import title_of
from sysid.pipeline.request import Reported, takes
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.plant.effects.catalogue import catalogue as own_catalogue
from sysid.plant.effects.entry import Catalogue
from sysid.plant.effects.linear import possible_on
from sysid.refinement.advice_result import AdviceResult

if TYPE_CHECKING:
    from sysid.refinement.played.result import PlayedTest


@dataclass(frozen=True, kw_only=True)
class AdviseOptions(Reported):
    """`effects`: those of the bundle that the catalogue lacks; `sizes`: whether to find, too, the
    smallest size of each effect that would show, which takes most of the time."""

    effects: EffectSource = None
    sizes: bool = True


@takes(AdviseOptions)
def advise(campaign: Campaign, bundle: Bundle, options: AdviseOptions) -> AdviceResult:
    """Standard errors that each of a list of tests would lead to, the best test first.

    Of every parameter of the bundle and strength of its effects, in their units, `now` (bench
    tests and training motion logs) and after each test that the rig can do; the tests that
    distinguish tied parameters and effects; the smallest detectable size of each effect.
    `effects` as in `validate`. Raises InputError for logs that cannot be used, NotIdentifiedError
    where the bundle does not hold the on/off law of both valves.

    >>> advice = si.advise(campaign, bundle, sizes=False)
    >>> best = advice.candidates[0]
    >>> best.gain > 0 and bool((best.std <= advice.now * 1.001).all())
    True
    """
    from sysid.refinement import advice

    catalogue = catalogue_from(options.effects)
    with progress_or_shown(options.progress, "advising") as tell:
        return advice.advise(
            campaign,
            bundle,
            threshold=_threshold(catalogue),
            catalogue=catalogue,
            progress=tell,
            sizes=options.sizes,
        )


def _threshold(catalogue: Catalogue | None) -> float:
    """As in a diagnosis: an effect is detected where chance among all of them is excluded."""
    return -float(ndtri(SIGNIFICANCE / len(catalogue or own_catalogue())))


@dataclass(frozen=True, kw_only=True)
class PlayOptions(AdviseOptions):
    """What a test to play is for, how long it takes, what it may not exceed.

    `asked`: parameters or effects by name (none: all parameters); `duration_s` of all its parts
    (None: 10 s, on a rig slower than the reference rig as many times longer);
    `max_speed` rad/s or m/s (None: the fastest motion of the training logs), `max_effort` Nm or N
    (None: 95 % of the rig file's).
    """

    asked: Sequence[str] = ()
    duration_s: float | None = None
    max_speed: float | None = None
    max_effort: float | None = None


def may_ask(
    campaign: Campaign, bundle: Bundle, effects: EffectSource = None
) -> dict[str, tuple[str, str]]:
    """What a test to play may be for: by its name, whether "Parameters" or "Effects", and a title.

    Raises InputError for a rig file that the bundle's model does not fit.
    """
    from sysid.refinement.unknowns import chosen, unknowns_of

    own, rig = catalogue_from(effects), campaign.rig
    numbers = chosen(unknowns_of(bundle, rig, bundle.model(rig, own)))
    held = {entry.id for entry in bundle.effects}
    known = possible_on(own_catalogue() if own is None else own, rig)
    return {
        **{one.name: ("Parameters", title_of(one.name)) for one in numbers},
        **{id: ("Effects", effect.title) for id, effect in known.items() if id not in held},
    }


@takes(PlayOptions)
def design_test(campaign: Campaign, bundle: Bundle, options: PlayOptions) -> PlayedTest:
    """The test that says most about what is asked, as commands that the rig can play.

    Short tests of one kind, each from rest where friction holds the arm: multisines and steps of
    motor, duties or valves, that stay within travel, speed and effort on the model and on plants
    whose constants are 20 % off. `write` gives the file. Raises InputError for an unknown name,
    NotIdentifiedError where no safe test says anything about it.
    """
    return _both(campaign, bundle, options, only_test=True)[1]


def advise_and_design(
    campaign: Campaign, bundle: Bundle, options: PlayOptions
) -> tuple[AdviceResult, PlayedTest]:
    """`advise` and `design_test`, with the motion logs refined once."""
    found, test = _both(campaign, bundle, options)
    assert found is not None
    return found, test


def _both(
    campaign: Campaign, bundle: Bundle, options: PlayOptions, *, only_test: bool = False
) -> tuple[AdviceResult | None, PlayedTest]:
    from sysid.refinement import advice
    from sysid.refinement.played.proposal import PlayRequest, played_test

    catalogue = catalogue_from(options.effects)
    asked = PlayRequest(
        tuple(options.asked), options.duration_s, options.max_speed, options.max_effort
    )
    with progress_or_shown(options.progress, "advising") as tell:
        began = advice.begin(campaign, bundle, catalogue, tell)
        test = played_test(began, asked, catalogue, tell)
        if only_test:
            return None, test
        found = advice.advise(
            campaign,
            bundle,
            threshold=_threshold(catalogue),
            catalogue=catalogue,
            progress=tell,
            beginning=began,
            sizes=options.sizes,
        )
    return found, test


__all__ = ["AdviseOptions", "PlayOptions", "advise", "advise_and_design", "design_test", "may_ask"]
