"""What twins say of an actuator, as a diagnosis' evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.diagnosis.actuator.equation_error import EFFORT
from sysid.diagnosis.actuator.figures import influences, residual_curves, rounds_shown, shown_curve
from sysid.diagnosis.actuator.loop import Loop
from sysid.diagnosis.actuator.refit import friction_given_effects
from sysid.diagnosis.actuator.search import RefittedStep
from sysid.diagnosis.actuator.signatures import base_parameters, channel_of
from sysid.diagnosis.actuator.unexplained import ResidualCurve, log_channel
from sysid.diagnosis.evidence import ComponentEvidence
from sysid.diagnosis.search import Round
from sysid.diagnosis.search_record import SearchRecord
from sysid.diagnosis.wording import ACTUATOR
from sysid.estimation.law_evidence import ODDS
from sysid.estimation.linear import Estimate
from sysid.io.campaign import SIMULATED_KINDS
from sysid.io.rig import Rig
from sysid.parameters import Bundle
from sysid.parameters.valves import ISO_KEYS, LAW_KEYS
from sysid.plant.effects.entry import CatalogueEffect, Quantity

if TYPE_CHECKING:
    from sysid.refinement.prior import BenchRows

_REFITTED = ("coulomb", "viscous", *LAW_KEYS, *ISO_KEYS)


@dataclass(frozen=True)
class TwinEvidence(ComponentEvidence):
    """A loop over an actuator's training logs; `left`: curves of what no effect explains."""

    loop: Loop
    rig: Rig
    left: tuple[ResidualCurve, ...]

    component = ACTUATOR

    @property
    def steps(self) -> Sequence[RefittedStep]:
        return self.loop.search.steps

    @property
    def rounds(self) -> tuple[Round, ...]:
        return self.loop.search.rounds

    @property
    def record(self) -> SearchRecord:
        return self.loop.record

    @property
    def is_linear(self) -> bool:
        return self.rig.is_linear

    @property
    def effects(self) -> Sequence[CatalogueEffect]:
        joint = self.loop.search.joint
        return () if joint is None else joint.effects

    def estimates(self, place: int) -> dict[str, Estimate]:
        return self.loop.search.estimates(place)

    def plain(self, place: int) -> tuple[Quantity, ...]:
        return self.loop.search.plain(place)

    def unseen(self, effects: Sequence[CatalogueEffect]) -> list[int]:
        """The places of effects that, with these numbers, explain nothing of the balances that they
        were found in, the least first: too little for odds of 20 to 1."""
        gains = self.loop.search.gains(effects)
        return [int(i) for i in np.argsort(gains) if gains[i] < ODDS]

    def rounds_shown(self) -> list[dict[str, Any]]:
        """See `sysid.diagnosis.actuator.figures.rounds_shown`."""
        return rounds_shown(self.loop.search, self.record)

    def figures(self) -> dict[str, Any]:
        """`excess`, `curves`, `shows` and `leftover`.

        `excess`: by residual (`effort`, `rate_a`, `rate_b`, `breakaway`) the whitened sum of
        squares beyond the twins', before and after. `curves`: mean residual over a regressor before
        and after (`centres`, `before`, `after` with their standard errors; Nm or N for `effort`,
        Pa/s for the rates, over the regressor's SI unit; `fine`: up to where bins are narrow, None
        for bins of equal count). `shows`: what each effect adds to a balance. `leftover`: the curve
        of each unexplained channel. `refitted`: the base parameters from what to what, in SI units.
        """
        search, null = self.loop.search, self.loop.null
        before, after = null.excess(search.first), null.excess(search.last)
        return {
            "excess": {name: {"before": before[name], "after": after[name]} for name in before},
            "curves": residual_curves(search),
            "shows": influences(search),
            "refitted": self._refitted(),
            "leftover": [
                {"channel": log_channel(curve.channel, self.rig), **shown_curve(curve)}
                for curve in self.left
            ],
        }

    def _refitted(self) -> list[dict[str, Any]]:
        """Base parameters estimated again together with the effects: `name`, before and after."""
        search = self.loop.search
        if not search.steps:
            return []
        before, after = (m.parameters for m in (search.first.model, search.model))
        return [
            {
                "name": name,
                "before": float(getattr(before, name)),
                "after": float(getattr(after, name)),
                "std": float(std),
                "unit": "",
            }
            for name, std in search.base_std.items()
        ]

    def with_base(self, bundle: Bundle) -> Bundle:
        """The refitted base parameters in place of the original ones; PWM surfaces stay."""
        search = self.loop.search
        was, now = (float(m.parameters.static_effort) for m in (search.first.model, search.model))
        found = {}
        for row in bundle.parameters.fitted().rows:
            old, std = row.estimate, search.base_std.get(row.field)
            if row.name in _REFITTED and std is not None:
                value = float(getattr(search.model.parameters, row.field))
                # The old intervals no longer apply.
                found[row.alias] = Estimate.symmetric(value, std, old.unit, search.base_dof)
            elif row.name == "static" and old.identified and now != was:
                # As the bench read it, with the motor's effects.
                found[row.alias] = old.times(now / was)
        return bundle.with_estimates(found)

    def bench_rows(self) -> BenchRows | None:
        """What the effort balance of the bench tests says of friction, given the effects.

        Of the effects themselves motion says more, without the bias of the balances.
        """
        from sysid.refinement.prior import BenchRows

        model, frame = self.loop.search.model, self.loop.search.last.frame
        frame = replace(frame, scatter=self.loop.scatter_after.sliding)
        is_bench = np.array([run.kind not in SIMULATED_KINDS for run in frame.traces.runs])
        rows = is_bench[frame.tests] & frame.belongs((EFFORT,))
        names = [n for n in base_parameters(model) if channel_of(n) == EFFORT]
        if not (rows.any() and names):
            return None
        return BenchRows(*friction_given_effects(frame, model, names, rows))

    def to_json(self) -> dict[str, Any]:
        """Friction's scatter from test to test, one relative standard deviation."""
        return {"friction_scatter": self.loop.scatter.sliding}


__all__ = ["TwinEvidence"]
