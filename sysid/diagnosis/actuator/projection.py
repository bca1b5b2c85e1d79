"""A residual without what the model's own parameters explain of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid.diagnosis.actuator.equation_error import CHANNELS
from sysid.diagnosis.actuator.signatures import base_jacobian, base_parameters
from sysid.diagnosis.actuator.whitening import Frame, friction_scatter
from sysid.plant.ports import Model
from sysid.types import FloatArray


@dataclass(frozen=True)
class Projected:
    """A residual after projecting out everything that the model's own parameters explain.

    `residual` (rows,) is unprojected, `rest` (rows,) the remainder, `basis` (rows, m)
    orthonormal; `extra` (rows, k), also orthonormal, are its columns that do not belong to the
    base parameters. `reach` (p,): length of each base parameter's column.
    """

    frame: Frame
    model: Model
    residual: FloatArray
    basis: FloatArray
    rest: FloatArray
    extra: FloatArray
    reach: FloatArray

    def without_extra(self, values: FloatArray) -> FloatArray:
        """`values` (rows,) or (rows, k) with `extra` projected out."""
        return values - self.extra @ (self.extra.T @ values)

    def project(self, values: FloatArray) -> FloatArray:
        """`values` (rows,) or (rows, k) with the basis projected out."""
        return values - self.basis @ (self.basis.T @ values)


def projected(frame: Frame, model: Model, extra: FloatArray | None = None) -> Projected:
    """The residual of a model, its base parameters (and `extra` columns) projected out."""
    residual = frame.residual(model)
    jacobian = base_jacobian(frame, model, residual, base_parameters(model))
    reach = np.linalg.norm(jacobian, axis=0)
    own = np.zeros((len(residual), 0))
    if extra is not None and extra.size:
        own = _orthonormal(extra)
        jacobian = np.hstack([jacobian, extra])
    basis = _orthonormal(jacobian)
    rest = residual - basis @ (basis.T @ residual)
    return Projected(frame, model, residual, basis, rest, own, reach)


def friction_scatter_of(frame: Frame, model: Model) -> float:
    """Relative spread of friction from test to test that a model leaves, one standard deviation."""
    plain = replace(frame, scatter=0.0)
    return friction_scatter(plain, projected(plain, model).rest)


def _orthonormal(columns: FloatArray) -> FloatArray:
    """An orthonormal basis of the columns' span, (rows, rank)."""
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    if not scaled.size:
        return np.asarray(scaled)
    u, s, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(u[:, s > 1e-9 * s[0]])


def channel_squares(base: Projected, rest: FloatArray) -> FloatArray:
    """The sum of squares of each channel, (channels,)."""
    return np.array([float(np.sum(rest[base.frame.rows(name)] ** 2)) for name in CHANNELS])


__all__ = ["Projected", "channel_squares", "friction_scatter_of", "projected"]
