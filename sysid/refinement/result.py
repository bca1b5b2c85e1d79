"""The result of a refinement: parameters and simulation errors, before and after."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table
from sysid.estimation.linear import Estimate, finite_or_none
from sysid.estimation.quality import GOOD_SHARE
from sysid.parameters import Bundle
from sysid.parameters.refinement import Refinement
from sysid.refinement.shown import before_and_after_table, effort_table, errors_table
from sysid.refinement.whole_tests import much_worse
from sysid.types import FloatArray

if TYPE_CHECKING:
    from sysid.refinement.profiles import Profile
    from sysid.refinement.unknowns import Unknown


@dataclass(frozen=True)
class RefinedParameter:
    """One parameter: its value by the bench tests or the rig file, and its refined value.

    `movement` is the change over the standard error of the former value, NaN without one.
    `informed` whether the motion tests added information on it.
    """

    unknown: Unknown
    estimate: Estimate
    informed: bool

    @property
    def name(self) -> str:
        return self.unknown.name

    @property
    def movement(self) -> float:
        std = self.unknown.std
        return (self.estimate.value - self.unknown.value) / std if std > 0.0 else math.nan

    @property
    def is_known(self) -> bool:
        """Whether the bench tests or motion identified it."""
        return math.isfinite(self.estimate.std)

    def to_json(self) -> dict[str, Any]:
        """The parameter as `sysid refine --json` and the bundle hold it."""
        moved = self.movement
        return {
            "name": self.name,
            "origin": self.unknown.origin,
            "before": self.unknown.value,
            "before_std": finite_or_none(self.unknown.std),
            "after": self.estimate.to_json(),
            "movement": finite_or_none(moved),
            "informed_by_motion": self.informed,
        }


@dataclass(frozen=True)
class Fit:
    """Simulation errors of one use of the tests: RMSE (3,) by channel before and after.

    Position in rad or m, pressures in Pa; NaN where not logged. `correlation_before`,
    `correlation_after` (3,): the residual's autocorrelation from one sample to the next.
    """

    before: FloatArray
    after: FloatArray
    correlation_before: FloatArray
    correlation_after: FloatArray


@dataclass(frozen=True, repr=False)
class RefineResult(Shown):
    """A bundle refined on motion logs.

    `correlation` (p, p) of the parameters' errors, in their order; `fits` by use ("fit",
    "holdout"); `scatter` relative standard deviation of sliding and static friction from test
    to test; `longest` segment, s; `evaluations` of the simulation with its derivatives;
    `profiles` by parameter, as asked. `effort`: where a motor alone drives, RMSE of the equation
    of motion along the measured motion before and after, by use and channel (Nm or N).
    `cut_short`: the budget in force ended before the estimation did. `with_own_friction`: where an
    error of the training tests rises, RMSE (3,) of these, each with the friction of its own;
    `unexplained`: where they are simulated much worse, how much of it is beyond noise, over that
    after. `misfits` (segments, 3): RMSE over the noise by channel, of every segment on its own,
    those that were left out as well.
    """

    parameters: tuple[RefinedParameter, ...]
    correlation: FloatArray
    fits: Mapping[str, Fit]
    channels: tuple[str, ...]
    scatter: tuple[float, float]
    evaluations: int
    converged: bool
    segments: int
    left_out: int
    longest: float
    bundle: Bundle
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    notices: tuple[str, ...] = ()
    cut_short: bool = False
    effort: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)
    with_own_friction: FloatArray | None = None
    unexplained: FloatArray | None = None
    misfits: FloatArray = field(default_factory=lambda: np.empty((0, 3)))

    @property
    def rises(self) -> bool:
        """Whether an error of the training tests rises, not only as friction differs from test to
        test."""
        errors, own = self.fits["fit"], self.with_own_friction
        return bool(np.any((errors.after if own is None else own) > errors.before))

    @property
    def worse(self) -> str:
        """How much worse the training tests are simulated, in words; empty if they are not, or only
        as friction differs from test to test."""
        return "" if self.scatters else self._worse

    @property
    def scatters(self) -> str:
        """The same where the friction that each test has of its own is why: it explains their
        errors as a good fit explains a signal, so that little is left that a model could lack."""
        left = self.unexplained
        explains = left is not None and bool(np.nanmax(left) <= GOOD_SHARE)
        return self._worse if explains else ""

    @property
    def _worse(self) -> str:
        return much_worse(self.fits["fit"].before, self.fits["fit"].after)

    def headline(self) -> str:
        state = "converged" if self.converged else "not converged"
        return (
            f"{len(self.parameters)} parameters from {self.segments} segments of motion (up to "
            f"{self.longest:.1f} s), {state} after {self.evaluations} simulations"
        )

    def records(self) -> Sequence[Mapping[str, Any]]:
        return [
            {
                "parameter": p.name,
                "before": p.unknown.value,
                "before_std": p.unknown.std,
                "after": p.estimate.value,
                "after_std": p.estimate.std,
                "unit": p.unknown.unit,
                "movement": p.movement,
                "informed": p.informed,
            }
            for p in self.parameters
        ]

    def tables(self) -> Iterable[Table]:
        """Parameters, and simulation errors by use and channel."""
        found = Refinement.model_validate(self.to_json())
        yield before_and_after_table(found.values())
        yield errors_table(found)
        yield effort_table(found)

    def to_json(self) -> dict[str, Any]:
        """The object that `sysid refine --json` prints and a bundle's `refinement` holds."""
        content = {
            "converged": self.converged,
            "evaluations": self.evaluations,
            "segments": self.segments,
            "segments_left_out": self.left_out,
            "longest_segment_s": self.longest,
            "friction_scatter": {"sliding": self.scatter[0], "static": self.scatter[1]},
            "parameters": [p.to_json() for p in self.parameters],
            "profiles": {
                name: {
                    "values": [float(v) for v in p.values],
                    "rise": [float(r) for r in p.rise],
                    "interval": [finite_or_none(limit) for limit in p.interval],
                }
                for name, p in self.profiles.items()
            },
            "correlation": [[float(c) for c in row] for row in self.correlation],
            "rmse": {
                use: {
                    name: {
                        "before": finite_or_none(float(fit.before[i])),
                        "after": finite_or_none(float(fit.after[i])),
                    }
                    for i, name in enumerate(self.channels)
                    if np.isfinite(fit.before[i])
                }
                for use, fit in self.fits.items()
            },
            "residual_autocorrelation": {
                use: {
                    name: {
                        "before": finite_or_none(float(fit.correlation_before[i])),
                        "after": finite_or_none(float(fit.correlation_after[i])),
                    }
                    for i, name in enumerate(self.channels)
                    if np.isfinite(fit.before[i])
                }
                for use, fit in self.fits.items()
            },
        }
        if self.effort:
            content["effort_rmse"] = {
                use: {
                    name: {"before": finite_or_none(before), "after": finite_or_none(after)}
                    for name, (before, after) in channels.items()
                }
                for use, channels in self.effort.items()
            }
        return content


__all__ = ["Fit", "RefineResult", "RefinedParameter"]
