"""The job by lmfit's least_squares, simulated with numba: JOB.npz RESULT.txt."""

from __future__ import annotations

import contextlib
import sys
from typing import Any

import lmfit
import numpy as np
from plant import simulate
from shooting import DESCENT, Job


def descend(job: Job) -> Any:
    """As `scipy_job`, through lmfit's parameters."""
    parameters = lmfit.Parameters()
    for i in np.flatnonzero(job.free):
        parameters.add(f"x{i}", value=job.x[i])

    def residual(given: Any) -> Any:
        return job.residual(np.array(list(given.valuesdict().values())))

    # It counts the differences too.
    fitter = lmfit.Minimizer(residual, parameters, max_nfev=64 * 16)
    # lmfit 1.3 multiplies a sparse Jacobian, to a covariance, as if it were a matrix of numpy's.
    with contextlib.suppress(ValueError):
        fitter.least_squares(jac_sparsity=job.sparsity(), **DESCENT)
    return fitter.result.x


if __name__ == "__main__":
    Job(sys.argv[1], simulate).solve(descend, sys.argv[2])
