"""The job by scipy's least_squares on solve_ivp with events: JOB.npz RESULT.txt.

The plant is `benchmarks/reference_plant.py`, with relative tolerance 1e-6 by RK45.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from shooting import PLACES, Job

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.reference_plant import integrate
from sysid.plant.base import PARAMETER_NAMES, Parameters
from sysid.plant.preparation import Inputs, ValveCommand

RTOL, METHOD = 1e-6, "RK45"
# Times the noise.
FAR = 1e8


class Reference:
    """The job's segments by `integrate`."""

    def __init__(self, path: str) -> None:
        self.job = Job(path, self.simulate)
        values = self.job.data["parameters"].tolist()
        self.base = Parameters(**dict(zip(PARAMETER_NAMES, values, strict=True)))
        order = np.argsort(PLACES)
        self.names = self.job.data["names"][order].tolist()

    def simulate(self, plants: Any, starts: Any, *_: Any) -> Any:
        """As `plant.simulate`."""
        d = self.job.data
        out = np.empty_like(d["measured"])
        for i, plant in enumerate(plants):
            duties = [ValveCommand(d[f"duty_{side}"][i], is_duty=True) for side in "ab"]
            inputs = Inputs(d["time"][i], d["motor"][i], *duties, *starts[i])
            own = dict(zip(self.names, plant[np.sort(PLACES)].tolist(), strict=True))
            try:
                out[i] = integrate(inputs, self.base.replace(**own), RTOL, METHOD)[[0, 2, 3]]
            except RuntimeError:  # events without end: counts as far off
                out[i] = d["measured"][i] + FAR * d["noise"][:, None]
        return out


if __name__ == "__main__":
    from scipy_job import descend

    Reference(sys.argv[1]).job.solve(descend, sys.argv[2])
