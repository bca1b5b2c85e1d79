"""EMPS, a motor axis without valves: simulated position of the validation file, before and after.

    python benchmarks/emps.py --data ../shared/data/emps [--segment 1]

Before: `sysid fit` on the estimation file (Coulomb and viscous friction, offset, mass, by the error
of the equation of motion). After: the same four and static friction by the error of simulation on
segments of that file, through `sysid.refinement`, from those numbers and without a prior. Both
simulate the validation file open loop, as a whole from rest and in segments; the force error is
that of the equation of motion there. `sysid refine` itself takes rigs with valves only: this
script puts the runs together by hand.
"""

from __future__ import annotations

import argparse
import math
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

import sysid as si  # noqa: E402
from sysid import signals  # noqa: E402
from sysid.identification.friction.effort import even_trial  # noqa: E402
from sysid.identification.friction.motion import effort_rmse  # noqa: E402
from sysid.io.rig import Rig  # noqa: E402
from sysid.model.base import bare_parameters  # noqa: E402
from sysid.model.ports import Model  # noqa: E402
from sysid.model.preparation import Inputs  # noqa: E402
from sysid.model.simulator import simulate  # noqa: E402
from sysid.refinement.estimation import FrictionScatter, estimate  # noqa: E402
from sysid.refinement.problem import Problem  # noqa: E402
from sysid.refinement.runs import Run  # noqa: E402
from sysid.refinement.unknowns import Unknown  # noqa: E402
from sysid.refinement.whitening import Whitening  # noqa: E402

SET = REPOSITORY / "datasets" / "measured" / "emps"
FILES = {"estimation": "DATA_EMPS.mat", "pulses": "DATA_EMPS_PULSES.mat"}
# Rows on either side of a start that its position and speed are fitted on.
HALF = 10
# Of the filter that the equation of motion is judged through.
CUTOFF_HZ = 20.0
NAMES = ("coulomb_effort", "viscous", "inertia", "offset")


def logs_of(data: Path, folder: Path) -> tuple[Any, dict[str, Any]]:
    """The fitted bundle and both logs, by the ordinary commands."""
    for path in SET.glob("*.toml"):
        shutil.copy(path, folder)
    for name, source in FILES.items():
        command = [sys.executable, "-m", "sysid", "convert", str(data / source)]
        command += ["--spec", "recipe.toml", "-o", f"{name}.csv"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
    campaign = si.read_campaign(folder / "campaign.toml")
    logs = {n: si.read_log(folder / f"{n}.csv", campaign.rig) for n in FILES}
    return si.fit(campaign), logs


def fitted(bundle: Any, rig: Rig) -> Model:
    """The axis as `sysid fit` found it; breakaway at Coulomb friction, which is all it knows."""
    f = bundle.friction
    return Model(
        bare_parameters(rig).replace(
            static_effort=f.coulomb_n.value,
            coulomb_effort=f.coulomb_n.value,
            viscous=f.viscous_n_s_per_m.value,
            inertia=f.mass_kg.value,
            offset=-f.offset_n.value,
        )
    )


def segments(log: Any, model: Model, seconds: float) -> list[Run]:
    """A log as runs of so many seconds, each from its position and speed there."""
    (trial,) = log.trials
    time, position, force = trial.time, trial["position_m"], trial["motor_force_n"]
    rows = round(seconds / float(np.median(np.diff(time))))
    noise = np.array([signals.noise_floor(position).total, 1.0, 1.0])
    atmosphere = float(model.parameters.atmosphere)
    found = []
    for start in range(HALF, len(time) - rows, rows):
        near = slice(start - HALF, start + HALF + 1)
        fit, covariance = np.polyfit(time[near] - time[start], position[near], 2, cov="unscaled")
        std = noise[0] * np.sqrt(np.diag(covariance))
        part = slice(start, start + rows + 1)
        rests = float(np.ptp(position[near])) <= 4.0 * noise[0]
        inputs = Inputs(
            time[part],
            force[part],
            position=float(fit[2]),
            velocity=0.0 if rests else float(fit[1]),
            pressure_a=atmosphere,
            pressure_b=atmosphere,
            elapsed=float(time[start] - time[0]),
        )
        measured = np.full((3, rows + 1), math.nan)
        measured[0] = position[part]
        width = np.array([10 * std[2], 1e-9 if rests else 10 * std[1], 1e-3, 1e-3])
        found.append(Run(0, f"{inputs.elapsed:.1f} s", inputs, measured, width, noise))
    return found


def refined(model: Model, runs: list[Run]) -> tuple[Model, Any]:
    """The model with the numbers that simulate the runs best, and how they were found."""
    unknowns = []
    for name in ("static_effort", *NAMES):
        value = float(getattr(model.parameters, name))
        lower, scale = (-math.inf, 1.0) if name == "offset" else (0.0, value)
        unknowns.append(
            Unknown(
                name, (0, name), value, math.nan, "", lower, math.inf, scale, "axis", None, False
            )
        )
    scatter = FrictionScatter(0.02, 0.02, 5.0)
    white = tuple(tuple(Whitening.white(float(n)) for n in run.noise) for run in runs)
    problem = Problem(tuple(runs), tuple(unknowns), model, "position_m", white, scatter.pair, 1)
    found = estimate(problem, scatter, robust=True)
    point = found.solution.point
    values = {u.name: u.at(float(c)) for u, c in zip(unknowns, point.shared, strict=True)}
    # One log: its own friction is that of the axis.
    own = found.problem.model_for(point, 0).parameters
    values |= {n: float(getattr(own, n)) for n in ("static_effort", "coulomb_effort", "viscous")}
    return Model(model.parameters.replace(**values)), found


def position_error(log: Any, model: Model, seconds: float) -> tuple[float, float]:
    """RMSE of the position, m: of the whole log from rest, and of segments."""
    (trial,) = log.trials
    whole = Inputs(trial.time, trial["motor_force_n"], position=float(trial["position_m"][0]))
    runs = segments(log, model, seconds)
    found = simulate([whole, *(r.inputs for r in runs)], [model] * (1 + len(runs)))
    parts = [f.position - r.measured[0] for f, r in zip(found[1:], runs, strict=True)]
    return rms(found[0].position - trial["position_m"]), rms(np.concatenate(parts))


def rms(values: Any) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    """Print the numbers and the errors, before and after."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--segment", type=float, default=1.0, help="s")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        bundle, logs = logs_of(options.data.resolve(), Path(folder))
    rig = logs["estimation"].rig
    before = fitted(bundle, rig)
    runs = segments(logs["estimation"], before, options.segment)
    after, found = refined(before, runs)
    print(
        f"{len(found.problem.runs)} of {len(runs)} segments, {found.evaluations} simulations, "
        f"converged: {found.solution.converged}"
    )
    for title, model in (("before", before), ("after", after)):
        p = model.parameters
        numbers = ", ".join(f"{n} {getattr(p, n):.5g}" for n in ("static_effort", *NAMES))
        held_out = [even_trial(trial, rig, []) for trial in logs["pulses"].trials]
        law = (p.coulomb_effort, p.viscous, -p.offset, p.inertia)
        force = effort_rmse(held_out, *law, CUTOFF_HZ)
        for use, log in logs.items():
            whole, parts = position_error(log, model, options.segment)
            print(f"{title}, {use}: position RMSE {whole:.3g} m whole, {parts:.3g} m in segments")
        print(f"{title}: {numbers}; force RMSE of the validation file {force:.3f} N")


if __name__ == "__main__":
    main()
