"""Four recordings of a linear axis, as its data logger exports them.

A motor drives a carriage of 12 kg along a rail, under a position controller. The carriage
drags a cable chain that pulls it back to the middle; nobody will tell the program.
"""

import numpy as np

MASS, COULOMB, VISCOUS = 12.0, 15.0, 40.0  # kg, N, N s/m
CABLE = 60.0  # N/m, not in any file that the program reads
FORCE_PER_VOLT = 12.5  # N/V
PERIOD, DURATION = 0.005, 8.0  # s


def reference(time, amplitude, frequency):
    """A sweep, m: so many metres to each side, the frequency (Hz) doubling over the run."""
    return amplitude * np.sin(2 * np.pi * frequency * time * (1 + 0.5 * time / DURATION))


def record(amplitude, frequency, seed, substeps=25):
    """Time in ms, position in mm, command in V: one row every 5 ms."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, DURATION, PERIOD)
    x = v = 0.0
    rows = []
    for t in time:
        target = reference(t, amplitude, frequency)
        ahead = reference(t + PERIOD, amplitude, frequency)
        force = 4000.0 * (target - x) + 300.0 * ((ahead - target) / PERIOD - v)
        volts = float(np.clip(force / FORCE_PER_VOLT, -10.0, 10.0))
        rows.append((1e3 * t, 1e3 * round(x / 2e-5) * 2e-5, volts))  # an encoder of 20 um
        coulomb = COULOMB * (1.0 + 0.01 * rng.standard_normal())
        for _ in range(substeps):
            push = FORCE_PER_VOLT * volts - VISCOUS * v - CABLE * x
            step = PERIOD / substeps
            slower = max(abs(v + push / MASS * step) - coulomb / MASS * step, 0.0)
            v = np.sign(v + push / MASS * step) * slower  # stops where friction holds it
            x += v * step
    return rows


RUNS = {
    "sweep_1": (0.12, 0.5),
    "sweep_2": (0.08, 0.8),
    "sweep_3": (0.15, 0.4),
    "sweep_4": (0.1, 0.6),
}
for number, (name, (amplitude, frequency)) in enumerate(RUNS.items()):
    with open(f"{name}.csv", "w") as file:
        file.write("t;x;u\n")
        for row in record(amplitude, frequency, seed=number):
            # As a European data logger writes: semicolons, decimal commas.
            file.write(";".join(f"{value:.4f}" for value in row).replace(".", ",") + "\n")
