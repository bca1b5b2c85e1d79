"""A bundle's refinement: its parameters after a fit of the simulation error on motion logs."""

from __future__ import annotations

from pydantic import Field

from sysid.estimation.linear import Estimate
from sysid.parameters.base import Absent, Lenient, Number, Part


class RefinedValue(Part):
    """One parameter before and after, by its place in the bundle or in the rig file.

    `origin` is the part that it belongs to ("friction", "valve", "effect", "rig"); `movement` its
    change over `before_std`; `informed_by_motion` whether the motion tests added information to
    that of the bench tests.
    """

    name: str
    origin: str
    before: Number
    before_std: Number | None
    after: Estimate
    movement: Number | None
    informed_by_motion: bool


class BeforeAndAfter(Part):
    """A figure of the bundle that was refined, and of the refined one."""

    before: Number | None
    after: Number | None


class ProfileRecord(Part):
    """The rise of the cost over a parameter's values, 3.84 at the limits of its 95 % interval."""

    values: list[Number]
    rise: list[Number]
    interval: list[Number | None]


class ScatterOfFriction(Part):
    """Relative standard deviation of friction from test to test."""

    sliding: Number
    static: Number


FiguresByUse = dict[str, dict[str, BeforeAndAfter]]
"""By use ("fit", "holdout") and channel."""


class Refinement(Part):
    """The record of `sysid refine`.

    `evaluations` simulations of `segments` stretches of motion, up to `longest_segment_s`, without
    those that the model does not follow; `correlation` of the parameters' errors in their order;
    `rmse` of whole tests simulated open loop, in the channel's unit, and the residual's
    autocorrelation from one sample to the next. `effort_rmse`: where a motor alone drives, that of
    the equation of motion along the measured motion.
    """

    converged: Lenient[bool | None] = None
    evaluations: Lenient[int | None] = None
    segments: Lenient[int | None] = None
    segments_left_out: Lenient[int | None] = None
    longest_segment_s: Absent[Lenient[Number | None]] = None
    friction_scatter: Lenient[ScatterOfFriction | None] = None
    parameters: Lenient[list[RefinedValue]] = Field(default_factory=list)
    profiles: Lenient[dict[str, ProfileRecord]] = Field(default_factory=dict)
    correlation: Lenient[list[list[Number]]] = Field(default_factory=list)
    rmse: Lenient[FiguresByUse] = Field(default_factory=dict)
    residual_autocorrelation: Lenient[FiguresByUse] = Field(default_factory=dict)
    effort_rmse: Absent[Lenient[FiguresByUse | None]] = None

    def values(self) -> list[RefinedValue]:
        """The parameters; none where they have another form than sysid's."""
        return self.parameters if isinstance(self.parameters, list) else []

    def profiled(self) -> dict[str, ProfileRecord]:
        """The profiles by parameter."""
        return self.profiles if isinstance(self.profiles, dict) else {}

    def correlations(self) -> list[list[float]]:
        """The correlation matrix; none where it does not fit the parameters."""
        rows, count = self.correlation, len(self.values())
        if not isinstance(rows, list) or [len(row) for row in rows] != [count] * count:
            return []
        return [[float(c) for c in row] for row in rows]

    def errors(self) -> FiguresByUse:
        """RMSE of whole tests."""
        return self.rmse if isinstance(self.rmse, dict) else {}

    def effort_errors(self) -> FiguresByUse:
        """RMSE of the equation of motion; none where pressures act."""
        return self.effort_rmse if isinstance(self.effort_rmse, dict) else {}

    def autocorrelations(self) -> FiguresByUse:
        """The residual's autocorrelation."""
        found = self.residual_autocorrelation
        return found if isinstance(found, dict) else {}


__all__ = ["BeforeAndAfter", "ProfileRecord", "RefinedValue", "Refinement", "ScatterOfFriction"]
