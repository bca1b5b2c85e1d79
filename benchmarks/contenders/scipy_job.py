"""The job by scipy's least_squares, simulated with numba: JOB.npz RESULT.txt."""

from __future__ import annotations

import sys
from typing import Any

from scipy.optimize import least_squares
from shooting import DESCENT, Job


def descend(job: Job) -> Any:
    """Trust region with differences, in groups of unknowns that share no residual."""
    return least_squares(
        job.residual,
        job.x[job.free],
        jac_sparsity=job.sparsity(),
        max_nfev=64,
        **DESCENT,
    ).x


if __name__ == "__main__":
    from plant import simulate

    Job(sys.argv[1], simulate).solve(descend, sys.argv[2])
