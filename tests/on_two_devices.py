"""Run by test_placement.py: jax with two devices, the second one standing for an accelerator.

Prints as JSON, by what was run, on which devices an array of jax lay whenever a function returned.
"""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

PROCESSOR, ACCELERATOR = jax.devices("cpu")
PACKAGE = str(Path(__file__).resolve().parent.parent / "sysid")


def main() -> None:
    """One part after the other, with the user's own computation before and after each."""
    jax.config.update("jax_default_device", ACCELERATOR)
    parts: list[Callable[[], Any]] = [simulation, refinement, loop, histories, component]
    found = {part.__name__: watched(part) for part in parts}
    found["afterwards"] = [str(jax.config.jax_default_device), *devices_of(jnp.ones(3) + 1.0)]
    print(json.dumps({"processor": str(PROCESSOR), "accelerator": str(ACCELERATOR), **found}))


def watched(part: Callable[[], Any]) -> dict[str, list[str]]:
    """The devices that the package's arrays lie on, and those of the user's own about it."""
    run = part()
    own = jnp.arange(3.0) * 2.0
    before = jax.live_arrays()  # held, so that none of the package's has the identity of one
    known, seen = {id(array) for array in before}, set[str]()

    def look(frame: FrameType, event: str, _: Any) -> None:
        if event == "return" and frame.f_code.co_filename.startswith(PACKAGE):
            for array in jax.live_arrays():
                if id(array) not in known:
                    seen.update(devices_of(array))

    threading.setprofile(look)
    sys.setprofile(look)
    try:
        run()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # type: ignore[arg-type]
    return {"package": sorted(seen), "user": devices_of(own, jnp.arange(3.0) + own)}


def devices_of(*arrays: Any) -> list[str]:
    return sorted({str(device) for array in arrays for device in array.devices()})


def simulation() -> Callable[[], Any]:
    """Single runs and wide blocks, in threads; runs that flow through surfaces have no more."""
    from benchmarks.rigs import random_runs
    from sysid.plant.simulator import simulate

    inputs, models = random_runs(5, 4, 0.2)
    return lambda: (simulate(inputs, models), simulate(inputs[:1], models[:1]))


def refinement() -> Callable[[], Any]:
    """The solver's steps over tangents."""
    from test_refinement import LOGS, problem_of

    from benchmarks.refinement import rig_runs
    from sysid.refinement.solver import solve

    problem = problem_of(*rig_runs(12, LOGS, 2.5))
    return lambda: solve(problem, problem.first_point(), 2, 1e-3)


def loop() -> Callable[[], Any]:
    """A controller that is compiled with the plant, and the same called from Python."""
    from datasets.thesis.reference_rig import plant
    from sysid.controllers.loop import Case, closed_loop
    from sysid.controllers.pva import PvaController
    from sysid.controllers.trajectories import thesis_trajectory

    case = Case(PvaController(), plant(), thesis_trajectory(3))
    return lambda: [closed_loop([case], 0.02, compiled=compiled) for compiled in (True, False)]


def histories() -> Callable[[], Any]:
    """An effect's state along measured traces."""
    from test_diagnosis import made

    from sysid.diagnosis.actuator.samples import prepare
    from sysid.diagnosis.actuator.states import integrate_states
    from sysid.plant.effects.sensor import PressureLag

    tests, rig, model = made()
    file, kind, trial = next(test for test in tests if test[1] == "motion-discrete")
    short = {name: values[:500] for name, values in trial.channels.items()}
    traces = prepare(
        [(file, kind, replace(trial, time=trial.time[:500], channels=short))], rig, model
    )
    return lambda: integrate_states(traces, model + PressureLag.typical(), True)


def component() -> Callable[[], Any]:
    """A user's file, tried out and simulated."""
    from own_components import MOTOR

    from sysid.components.loading import _offered
    from sysid.components.simulation import Runs, simulated, slopes, with_starts

    def run() -> None:
        made: Any = next(one.definition for one in _offered(MOTOR) if one.kind == "servo")
        time = np.arange(20)[None] * 1e-3
        first = np.zeros((1, len(made.columns)))
        runs = Runs(time, np.ones((1, 20, len(made.inputs))), first, first, (20,))
        law = np.array(
            [
                *(p.value for p in made.parameters),
                *(q.typical for t in made.terms for q in t.quantities),
            ]
        )
        starts = np.zeros((1, len(made.states)))
        simulated(made, law[None], runs)
        with_starts(made, law, starts, runs)
        slopes(made, law, starts, runs, np.eye(len(law) + len(made.states)))

    return run


if __name__ == "__main__":
    main()
