"""Derivatives of the simulation against central differences of the same simulation, as measured.

    python benchmarks/tangents.py [--rigs 20] [--seconds 2] [--seed 11]

Random rigs under PWM, with choking, sticking and breakaway; twelve numbers of the model, among
them delays that move the valves' edges. A column is the change of position, velocity and pressures
over a whole run with one number. A difference is taken over 1e-5 and over 1e-4 of a number, and
the nearer of the two counts: an event that jumps over a sample in one of them says nothing about
a derivative.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.rigs import random_runs  # noqa: E402
from sysid.plant.differences import simulate_differences  # noqa: E402
from sysid.plant.ports import Model  # noqa: E402
from sysid.plant.preparation import Inputs  # noqa: E402
from sysid.plant.simulator import simulate  # noqa: E402
from sysid.plant.tangents import Tangents, simulate_tangents  # noqa: E402

# A typical size of each, where its value may be 0; otherwise the value itself.
NUMBERS: dict[str, float | None] = {
    "coulomb_effort": None,
    "viscous": None,
    "static_effort": None,
    "inertia": None,
    "offset": 0.3,
    "supply": None,
    "choked_fill_a": None,
    "choked_dis_a": None,
    "c_fill_a": None,
    "c_dis_a": None,
    "on_delay_a": 2e-3,
    "off_delay_b": 2e-3,
}
STEPS = (1e-5, 1e-4)
SIZES = np.array([[1.0], [10.0], [1e5], [1e5]])


def difference(inputs: list[Inputs], models: list[Model], name: str, step: float) -> list[Any]:
    """Central differences of every run's states, (4, n) each, by one number."""
    sizes = [NUMBERS[name] or float(getattr(m.parameters, name)) for m in models]

    def moved(sign: float) -> list[Any]:
        other = [
            Model(
                m.parameters.replace(**{name: float(getattr(m.parameters, name)) + sign * step * s})
            )
            for m, s in zip(models, sizes, strict=True)
        ]
        found = simulate(inputs, other)
        return [np.array([r.position, r.velocity, r.pressure_a, r.pressure_b]) for r in found]

    pairs = zip(moved(1.0), moved(-1.0), sizes, strict=True)
    return [(high - low) / (2.0 * step * size) for high, low, size in pairs]


def column_errors(inputs: list[Inputs], models: list[Model]) -> dict[str, list[float]]:
    """By number: each run's relative error of the column."""
    found = with_tangents(inputs, models)
    errors: dict[str, list[float]] = {}
    for j, name in enumerate(NUMBERS):
        sides = [difference(inputs, models, name, step) for step in STEPS]
        own = [run.slopes[4 + j] / SIZES for run in found]
        errors[name] = []
        for i, slope in enumerate(own):
            far = [float(np.linalg.norm(s[i] / SIZES - slope)) for s in sides]
            reference = sides[int(np.argmin(far))][i] / SIZES
            errors[name].append(min(far) / max(float(np.linalg.norm(reference)), 1e-300))
    return errors


def with_tangents(inputs: list[Inputs], models: list[Model]) -> list[Tangents]:
    """Every run with its tangents by each number."""
    return simulate_tangents(inputs, models, [(0, n) for n in NUMBERS])


def of_neighbours(inputs: list[Inputs], models: list[Model]) -> list[Tangents]:
    """As `simulate_tangents`, by differences of neighbours (`sysid.plant.differences`)."""
    sizes = [size or float(getattr(models[0].parameters, n)) for n, size in NUMBERS.items()]
    return simulate_differences(inputs, models, [(0, n) for n in NUMBERS], sizes)


def neighbour_errors(inputs: list[Inputs], models: list[Model]) -> list[float]:
    """Relative error of each run's column by differences of neighbours, against the tangents."""
    exact = with_tangents(inputs, models)
    return [
        float(np.linalg.norm((a - b) / SIZES)) / max(float(np.linalg.norm(b / SIZES)), 1e-300)
        for own, other in zip(of_neighbours(inputs, models), exact, strict=True)
        for a, b in zip(own.slopes[4:], other.slopes[4:], strict=True)
    ]


def main() -> None:
    """Print the errors by number, over all, and the cost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=11)
    options = parser.parse_args()
    inputs, models = random_runs(options.seed, options.rigs, options.seconds)
    errors = column_errors(inputs, models)
    for name, own in errors.items():
        print(f"{name:16} median {statistics.median(own):.1e}, largest {max(own):.1e}")
    every = np.concatenate(list(errors.values()))
    print(f"all: median {np.median(every):.1e}, 95th percentile {np.quantile(every, 0.95):.1e}")
    near = neighbour_errors(inputs, models)
    low, high = np.quantile(near, (0.5, 0.95))
    print(f"differences of neighbours: median {low:.1e}, 95th percentile {high:.1e}")
    ways: tuple[Callable[..., object], ...] = (simulate, with_tangents, of_neighbours)
    costs: list[list[float]] = []
    for _ in range(3):
        ends = [time.perf_counter()]
        for way in ways:
            way(inputs, models)
            ends.append(time.perf_counter())
        once, *own = np.diff(ends).tolist()
        costs.append([o / once for o in own])
    tangents, differences = np.median(np.array(costs), axis=0)
    print(f"cost of a run with {4 + len(NUMBERS)} tangents: {tangents:.1f} runs")
    print(f"by differences: {differences:.1f} runs")


if __name__ == "__main__":
    main()
