"""An effect tried by hand: what it changes on each test, and the bundle that holds the choice.

Nothing is fitted and nothing judged here: `diagnose` names an effect, a person may try one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.io.campaign import SIMULATED_KINDS, Campaign, CampaignLog
from sysid.io.rig import Rig
from sysid.io.samples import Trial
from sysid.parameters import Bundle
from sysid.parameters.effects import EffectEntry, entry_of
from sysid.pipeline.simulate import simulate
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model
from sysid.types import FloatArray

EXPLORATION = "exploration"
"""In a bundle's provenance: that effects were chosen by hand, and how often the held-out tests
were looked at."""


@dataclass(frozen=True, eq=False)
class ExploredTest:
    """A test and the channels (n,) that a model gives for it, SI; only measured ones."""

    entry: CampaignLog
    trial: Trial
    simulated: Mapping[str, FloatArray]

    def residual(self, channel: str) -> FloatArray:
        """Measured less simulated (n,), in the channel's unit."""
        return self.trial[channel] - self.simulated[channel]

    def rmse(self) -> dict[str, float]:
        """The error of each channel over the whole test, in its unit."""
        return {name: float(np.sqrt(np.mean(self.residual(name) ** 2))) for name in self.simulated}


def motion_tests(campaign: Campaign, use: str | None) -> list[tuple[CampaignLog, Trial]]:
    """The tests of this use (None: all) that a model can be simulated along.

    Raises InputError for a log that cannot be read.
    """
    entries = campaign.select(SIMULATED_KINDS, use)
    return [(entry, trial) for entry in entries for trial in campaign.read(entry).trials]


def explore(
    tests: Sequence[tuple[CampaignLog, Trial]],
    rig: Rig,
    bundle: Bundle,
    added: Sequence[CatalogueEffect] = (),
    effects: EffectSource = None,
) -> list[ExploredTest]:
    """Each test simulated open loop with a bundle's model and further effects.

    By the on/off law under the real pulses, from rest at the first row. `effects` as in
    `validate`. Raises NotIdentifiedError where the bundle lacks a parameter, InputError for
    commands that cannot be used and for an effect that the model holds.
    """
    model: Model = bundle.model(rig, catalogue_from(effects))
    for effect in added:
        model = model + effect
    runs = simulate([trial for _, trial in tests], model, rig=rig)
    return [
        ExploredTest(entry, trial, {n: v for n, v in run.channels.items() if n in trial})
        for (entry, trial), run in zip(tests, runs, strict=True)
    ]


def chosen_bundle(bundle: Bundle, added: Sequence[CatalogueEffect], looks: int) -> Bundle:
    """A bundle with effects that a person chose, and how often held-out tests were looked at.

    The strengths are the person's: they have no errors, until a refinement gives them some.
    """
    entries: list[EffectEntry] = [entry_of(effect).replaced(chosen_by="user") for effect in added]
    names = [effect.id for effect in added]
    made = {"chosen_by_user": names, "held_out_looks": looks}
    whole = bundle.with_effects(entries)
    options = {**whole.provenance.options, EXPLORATION: made}
    return whole.replaced(provenance=whole.provenance.replaced(options=options))


__all__ = ["EXPLORATION", "ExploredTest", "chosen_bundle", "explore", "motion_tests"]
