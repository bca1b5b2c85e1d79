"""A supply that was logged: what it says of effects of the supply, whatever the chambers show.

To the chambers' balances a supply that droops is much like another law of the valves, or a leak;
the log of the supply tells them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid import signals
from sysid.diagnosis.actuator.misfit import ResidualChannel
from sysid.diagnosis.actuator.samples import Traces, Windows, windows
from sysid.diagnosis.actuator.states import point_of
from sysid.diagnosis.binning import about_means
from sysid.io.channels import SIDES
from sysid.plant import plant
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Effect, Model, overrides
from sysid.types import FloatArray


def acts_on_supply(effect: Effect | type[CatalogueEffect]) -> bool:
    """Whether an effect changes the pressure that the valves draw from."""
    return overrides(effect, "supply_pressure")


@dataclass(frozen=True)
class LoggedSupply:
    """The means of the logged supply's windows, (windows,) in Pa, and how noisy they are.

    `given`: the model without the effects that are looked for.
    """

    traces: Traces
    view: Windows
    means: FloatArray
    channel: ResidualChannel
    given: Model

    def gain(self, effects: Sequence[CatalogueEffect]) -> float:
        """By how much effects lower minus twice the log likelihood of what was logged.

        A sensor upstream of what the supply loses sees a share of it, from none to all.
        """
        if not any(map(acts_on_supply, effects)):
            return 0.0
        model = Model(self.given.parameters, (*self.given.effects, *effects))
        change = self._off(model) - self._off_given
        power, own = float(change @ change), float(change @ self.means)
        share = min(max(own / power, 0.0), 1.0) if power > 0.0 else 0.0
        left = self.channel.origin - 2.0 * share * own + share**2 * power
        return float(self.channel.cost(self.channel.origin) - self.channel.cost(left))

    @cached_property
    def _off_given(self) -> FloatArray:
        return self._off(self.given)

    def _off(self, model: Model) -> FloatArray:
        """By how much a model's supply is off the mean of each test, in the windows' means, Pa.

        The supply of a chamber is asked as if it filled: it counts for as long as its valve is
        open. Where the valves draw from lines of their own, the one further from rest is taken.
        """
        used = self.traces
        point = point_of(used, model)
        line = point.parameters.supply
        # With both chambers at the line's own pressure nothing is drawn.
        undrawn = replace(point, pressure_a=line, pressure_b=line)
        idle = plant.supply_pressure("a", undrawn, model)
        losses = [
            used.is_open(side) * (plant.supply_pressure(side, point, model) - idle)
            for side in SIDES
        ]
        lost = np.where(np.abs(losses[0]) > np.abs(losses[1]), *losses)
        return _about_tests(self.view.matrix @ (idle - line + lost), self.view)


def logged_supply(traces: Traces, model: Model) -> LoggedSupply | None:
    """The logged supply of some tests, about each one's mean; None where none logs it.

    Or where no noise shows in it: a column of one number says nothing.
    """
    view = windows(traces, np.isfinite(traces.logged_supply), float(model.parameters.pwm_period))
    if not len(view):
        return None
    used, supplies = traces.at(view.used), [traces.logged_supply[run.rows] for run in traces.runs]
    logged = [own[np.isfinite(own)] for own in supplies]
    known = [own for own in logged if len(own) >= signals.FEWEST_FOR_NOISE]
    error = np.median([signals.noise_floor(own).total for own in known]) if known else 0.0
    if error == 0.0:
        return None
    means = _about_tests(view.matrix @ used.logged_supply, view)
    # As much of a sample's variance as a mean of so many keeps.
    kept = float(np.mean(view.matrix.power(2).sum(axis=1)))
    tests = len(np.unique(view.run))
    square = kept * float(error) ** 2
    channel = ResidualChannel(len(means), float(tests), square, float(means @ means))
    return LoggedSupply(used, view, means, channel, model)


def _about_tests(means: FloatArray, view: Windows) -> FloatArray:
    """Windows' means (windows,) less their test's mean: each has a line pressure of its own."""
    return about_means(np.unique(view.run, return_inverse=True)[1], means)


__all__ = ["LoggedSupply", "acts_on_supply", "logged_supply"]
