"""The valve tests: the piston held where the chamber is largest (thesis 3.5.2, 3.7.2)."""

from __future__ import annotations

import numpy as np

from datasets.generator.rigs import GeneratedRig
from datasets.generator.runs import Commands, GeneratedTest, Start, logged, simulated
from datasets.generator.sensors import rounded_duty

DISCRETE_S, ON_S, OFF_S = 6.0, 1.0, 4.0
BETWEEN_S = 0.2  # in which two valves keep a chamber shut
PWM_SHORTEST_S, PWM_LONGEST_S = 1.0, 1.2


def held_start(rig: GeneratedRig, valve: str, filled: bool) -> Start:
    """The piston clamped at the end where the valve's chamber is largest.

    `filled`: that chamber is at supply pressure and its valve on, as before a discharging test.
    """
    air = rig.content["air"]
    atmosphere, supply = rig.atmosphere, float(air["supply_pressure_pa"])
    on = int(filled)
    pressure = supply if filled else atmosphere
    if valve == "a":
        return Start(rig.half_travel, pressure, atmosphere, (on, 0), held=True)
    return Start(-rig.half_travel, atmosphere, pressure, (0, on), held=True)


def discrete_test(
    rig: GeneratedRig, label: str, valve: str, noise_pa: float, rng: np.random.Generator
) -> GeneratedTest:
    """On at about 1 s, off at about 4 s, 6 s in all (thesis 3.5.2)."""
    n = round(DISCRETE_S / rig.row_period)
    on, off = (round((s + rng.uniform(-0.02, 0.02)) / rig.row_period) for s in (ON_S, OFF_S))
    command, idle = np.zeros(n), np.zeros(n)
    command[on:off] = 1.0
    a, b = (command, idle) if valve == "a" else (idle, command)
    bleed = None
    if rig.bleeds:  # shut for a while, then emptied by the other valve
        bleed = np.zeros(n)
        bleed[off + round(BETWEEN_S / rig.row_period) :] = 1.0
    commands = Commands(np.zeros(n), valve_a=a, valve_b=b, log_motor=False, bleed=bleed)
    states = simulated(rig, rig.plant(), commands, held_start(rig, valve, False))
    return logged(label, rig, commands, states, noise_pa, rng, {"on_row": on, "off_row": off})


def pwm_test(
    rig: GeneratedRig,
    label: str,
    valve: str,
    duty: float,
    filling: bool,
    noise_pa: float,
    rng: np.random.Generator,
) -> GeneratedTest:
    """Constant duty, from the atmosphere (filling) or from the supply (discharging)."""
    duration = round(rng.uniform(PWM_SHORTEST_S, PWM_LONGEST_S), 1)
    n = round(duration / rig.row_period)
    command, idle = rounded_duty(np.full(n, duty)), np.zeros(n)
    a, b = (command, idle) if valve == "a" else (idle, command)
    commands = Commands(np.zeros(n), duty_a=a, duty_b=b, log_motor=False)
    states = simulated(rig, rig.plant(), commands, held_start(rig, valve, not filling))
    return logged(label, rig, commands, states, noise_pa, rng, {"duty": duty, "filling": filling})


def duties(step: float) -> list[float]:
    """Duties from 0.02 to 0.98 in steps of about `step`, both ends included."""
    count = max(2, round(0.96 / step) + 1)
    return [float(d) for d in np.round(np.linspace(0.02, 0.98, count), 4)]
