"""The job with sysid's own estimation, as `sysid refine` calls it: JOB.npz RESULT.txt."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from sysid.estimation.autoregression import Autoregression
from sysid.plant.base import PARAMETER_NAMES, Parameters
from sysid.plant.ports import Model
from sysid.plant.preparation import Inputs, ValveCommand
from sysid.refinement.estimation import FrictionScatter, estimate
from sysid.refinement.problem import Problem
from sysid.refinement.runs import Run
from sysid.refinement.unknowns import Unknown


def main() -> None:
    """Read the job, estimate, write the number of evaluations and ln(estimate over start)."""
    job = np.load(sys.argv[1])
    model = Model(Parameters(**dict(zip(PARAMETER_NAMES, job["parameters"].tolist(), strict=True))))
    noise = job["noise"]
    runs = []
    for i, test in enumerate(job["test"].astype(int)):
        duties = [ValveCommand(job[f"duty_{side}"][i], is_duty=True) for side in "ab"]
        inputs = Inputs(job["time"][i], job["motor"][i], *duties, *job["starts"][i])
        run = Run(int(test), f"log {test}", inputs, job["measured"][i], job["widths"][i], noise)
        runs.append(run)
    unknowns = []
    for name in job["names"].tolist():
        value = float(getattr(model.parameters, name))
        unknowns.append(
            Unknown(name, (0, name), value, np.nan, "", 0.0, np.inf, value, "valve", None, False)
        )
    scatter = FrictionScatter(0.02, 0.02, 5.0)
    white = (tuple(Autoregression.white(float(n) ** 2) for n in noise),) * len(runs)
    tests = int(job["test"].max()) + 1
    problem = Problem(tuple(runs), tuple(unknowns), model, "theta_rad", white, scatter.pair, tests)
    found = estimate(problem, scatter)
    values = [found.evaluations, *found.solution.point.shared]
    Path(sys.argv[2]).write_text("\n".join(repr(float(v)) for v in values) + "\n")


if __name__ == "__main__":
    main()
