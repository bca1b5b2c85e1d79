"""Training the duty network compared with scikit-learn's MLPRegressor, in one run.

Both get the same 5,000 samples of filling tests at 96 duties (valve A of Table 3.6.1, 200 Hz,
filtered as logs are, without noise so that its floor hides nothing), 10 tanh neurons and 20
restarts; both run on one thread. The network keeps a fifth of the tests for early stopping,
MLPRegressor trains on all samples. RMSE is over all 5,000.
Target: at most half the RMSE in duty in at most a quarter of the time.

    python benchmarks/network_training.py [--mlp-iterations 200]
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import warnings
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from pwm_campaign import VALVE_A, campaign

RESTARTS, HIDDEN = 20, 10


def filling_samples() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """5,000 samples spread evenly over the filling surface: duty, pressure, mean flow."""
    from sysid.surfaces import Domain, thin_samples

    samples = campaign(VALVE_A, "fill", step=0.01, noise=0.0)
    duty, pressure, flow = samples.duty, samples.pressure, samples.flow
    inside = Domain.from_samples(duty, pressure, flow).holds_duty(duty)
    duty, pressure, flow = duty[inside], pressure[inside], flow[inside]
    rows = thin_samples(duty, pressure, flow, 5000, seed=0)
    return duty[rows], pressure[rows], flow[rows]


def clocks() -> np.ndarray:
    """Wall and processor time, s; on a machine with other work only the second is reliable."""
    return np.array([time.perf_counter(), time.process_time()])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--mlp-iterations", type=int, default=200, help="lbfgs max_iter (its default, 200)"
    )
    iterations = parser.parse_args().mlp_iterations

    import torch
    from sklearn.neural_network import MLPRegressor

    from sysid.surfaces import DutyNetwork

    torch.set_num_threads(1)
    duty, pressure, flow = filling_samples()
    DutyNetwork(restarts=2, max_iter=2).fit(  # first calls load libraries
        np.column_stack((flow, pressure)), duty
    )
    X = np.column_stack((flow, pressure))

    start = clocks()
    network = DutyNetwork(hidden=HIDDEN, restarts=RESTARTS, seed=0).fit(X, duty)
    ours = clocks() - start
    our_rmse = float(np.sqrt(np.mean((network.network(flow, pressure) - duty) ** 2)))

    scaled = (X - X.mean(axis=0)) / X.std(axis=0)
    target = (duty - duty.mean()) / duty.std()
    start = clocks()
    errors = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # lbfgs says that it stopped at max_iter
        for seed in range(RESTARTS):
            other = MLPRegressor(
                hidden_layer_sizes=(HIDDEN,),
                activation="tanh",
                solver="lbfgs",
                alpha=0.0,
                max_iter=iterations,
                max_fun=20 * iterations,
                random_state=seed,
            ).fit(scaled, target)
            errors.append(np.sqrt(np.mean((other.predict(scaled) - target) ** 2)))
    theirs = clocks() - start
    their_rmse = float(min(errors) * duty.std())

    print(f"{len(duty)} points, {RESTARTS} restarts, {HIDDEN} hidden, one thread")
    for name, rmse, (wall, cpu) in (
        ("sysid Levenberg-Marquardt", our_rmse, ours),
        (f"MLPRegressor lbfgs, {iterations}", their_rmse, theirs),
    ):
        print(f"{name:26s} RMSE {rmse:.5f} in duty  wall {wall:6.2f} s  processor {cpu:6.2f} s")
    wall, cpu = ours / theirs
    print(f"ratio: RMSE {our_rmse / their_rmse:.2f} (target 0.50)")
    print(f"ratio: wall {wall:.3f}, processor {cpu:.3f} (target 0.25)")


if __name__ == "__main__":
    main()
