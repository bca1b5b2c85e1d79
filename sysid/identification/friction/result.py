"""The result of a friction fit: parameters by name, and the evidence for them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.bundle import Friction, Parts
from sysid.display.plots import legend, one_axes
from sysid.display.tables import Shown, ShownTable, estimate_records, estimate_table
from sysid.estimation.linear import Estimate, FTest
from sysid.estimation.named import NamedEstimates
from sysid.identification.friction.effort import KINDS, MOTION, SLIDING, STATIC, TrialUse, Units
from sysid.identification.friction.motion import RULE, MotionFriction
from sysid.identification.friction.sliding import SlidingFriction
from sysid.identification.friction.static import CRITERION, StaticFriction

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, repr=False)
class FrictionResult(NamedEstimates, Shown):
    """Friction parameters by their names in the bundle, and the evidence for them.

    `parameters` holds `static_nm`, `coulomb_nm`, `viscous_nm_s_per_rad`, `offset_nm` and,
    where estimated, `inertia_kg_m2` (linear: `static_n`, `coulomb_n`, `viscous_n_s_per_m`,
    `offset_n`, `mass_kg`); one that the tests do not identify gives the reason. Coulomb and
    viscous friction come from `source` (the constant-effort tests where these identify them);
    `cross_check` holds the estimates of the other kind of test. `trials` gives the outcome of
    every test.
    """

    units: Units
    parameters: dict[str, Estimate]
    source: str
    static: StaticFriction | None
    sliding: SlidingFriction | None
    motion: MotionFriction | None
    cross_check: dict[str, Estimate]
    trials: tuple[TrialUse, ...]
    notices: tuple[str, ...]
    cutoff_hz: float

    @property
    def rmse(self) -> dict[str, float]:
        """RMSE of each fit, in units of effort; of static friction, its repeatability."""
        found = {
            STATIC: None if self.static is None else self.static.repeatability,
            SLIDING: None if self.sliding is None else self.sliding.rmse,
            MOTION: None if self.motion is None else self.motion.rmse,
        }
        return {k: v for k, v in found.items() if v is not None and math.isfinite(v)}

    @property
    def remarks(self) -> tuple[str, ...]:
        """The remarks of a summary in addition to the numbers, one line each."""
        lines = []
        for kind in KINDS:
            uses = [use for use in self.trials if use.kind == kind]
            if uses:
                used = sum(use.used for use in uses)
                lines.append(f"{kind}: {used} of {len(uses)} tests used")
        if self.static is not None:
            lines += [*self.static.remarks, f"breakaway: {CRITERION}"]
        if self.sliding is not None:
            lines.append(
                f"sliding friction scatters by {100.0 * self.sliding.scatter:.2g} % from trial "
                "to trial"
            )
        if self.motion is not None:
            lines.append(f"friction from motion: {RULE}")
        for name, estimate in self.cross_check.items():
            if estimate.identified:
                lines.append(
                    f"cross-check, from motion: {name} {estimate.value:.4g} +- "
                    f"{estimate.std:.2g} {estimate.unit}"
                )
        lines += [f"RMSE of the fit of {k}: {v:.3g} {self.units.effort}" for k, v in self._rmse()]
        return tuple(lines)

    @property
    def why_no_sliding(self) -> str:
        """Why Coulomb or viscous friction is not identified; empty where both are."""
        own = (self.parameters[name] for name in (self.units.coulomb, self.units.viscous))
        return next((e.reason or "" for e in own if not e.identified), "")

    @property
    def has_sliding(self) -> bool:
        """Whether Coulomb and viscous friction are both identified."""
        return not self.why_no_sliding

    def _rmse(self) -> list[tuple[str, float]]:
        return [(k, v) for k, v in self.rmse.items() if k != STATIC]

    def part(self) -> Parts:
        """The bundle's `friction` (`spec/bundle.md`), with the supporting tables."""
        table: dict[str, Any] = dict(self.parameters)
        table["source"] = self.source
        table[f"rmse_{self.units.effort.lower()}"] = self.rmse
        table["cross_check"] = dict(self.cross_check)
        table["trials"] = [use.to_json() for use in self.trials]
        if self.static is not None:
            table["static_by_position"] = [p.to_json() for p in self.static.by_position]
            table["static_tests"] = {k: _test(t) for k, t in self.static.tests.items()}
            table["static_criterion"] = CRITERION
        if self.sliding is not None:
            table["clusters"] = [c.to_json() for c in self.sliding.clusters]
            table["offset_p_value"] = self.sliding.offset_p_value
            curved = self.sliding.lack_of_fit
            table["sliding_lack_of_fit"] = None if curved is None else _test(curved)
        if self.motion is not None:
            table["motion_rule"] = RULE
            table["cutoff_hz"] = self.cutoff_hz
        return Parts(friction=Friction(**table))

    def by_name(self) -> dict[str, Estimate]:
        """The parameters."""
        return self.parameters

    def headline(self) -> str:
        """The number of tests."""
        used = sum(use.used for use in self.trials)
        return f"friction from {used} of {len(self.trials)} tests"

    def records(self) -> list[dict[str, Any]]:
        """One record per parameter: value, std, limits of the 95 % interval, unit."""
        return estimate_records(self.parameters)

    def tables(self) -> Iterable[ShownTable]:
        """The parameters, and their estimates from motion where both kinds of test were made."""
        yield estimate_table("", self.parameters)
        yield estimate_table("Cross-check, from motion", self.cross_check)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Friction over speed: one point per constant-effort test, one fitted line per direction.

        Without such tests the parameters with their 95 % intervals, side by side.
        """
        ax = one_axes(ax)
        points = [u for u in self.trials if u.used and u.kind == SLIDING]
        if self.sliding is None or not points:
            return self._plot_parameters(ax)
        speed = np.array([u.values["speed"] for u in points])
        effort = np.array([u.values["friction"] for u in points])
        u = self.units
        for way, name in ((1.0, "forwards"), (-1.0, "backwards")):
            rows = np.sign(speed) == way
            if rows.any():
                (line,) = ax.plot(np.abs(speed[rows]), np.abs(effort[rows]), "o", label=name)
                grid = np.linspace(0.0, float(np.abs(speed).max()))
                law = self[u.coulomb].value + self[u.viscous].value * grid
                ax.plot(grid, law + way * self._offset(), color=line.get_color())
        ax.set_xlabel(f"speed ({'m/s' if u.effort == 'N' else 'rad/s'})")
        ax.set_ylabel(f"friction ({u.effort})")
        legend(ax)
        return ax

    def _offset(self) -> float:
        """The offset of the constant-effort tests, 0 where there is none."""
        offset = self.parameters.get(self.units.offset)
        return offset.value if offset is not None and offset.identified else 0.0

    def _plot_parameters(self, ax: Axes) -> Axes:
        known = [(name, e) for name, e in self.parameters.items() if e.identified]
        for place, (_, e) in enumerate(known):
            below, above = e.value - e.interval[0], e.interval[1] - e.value
            limits = [[x if math.isfinite(x) else 0.0] for x in (below, above)]
            ax.errorbar([place], [e.value], yerr=limits, fmt="o", capsize=4)
        ax.set_xticks(range(len(known)), [f"{name}\n({e.unit})" for name, e in known])
        return ax


def _test(test: FTest) -> dict[str, float]:
    return {
        "f": test.statistic,
        "dof_numerator": test.dof_numerator,
        "dof_denominator": test.dof_denominator,
        "p_value": test.p_value,
    }


__all__ = ["FrictionResult"]
