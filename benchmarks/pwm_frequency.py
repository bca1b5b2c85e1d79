"""The choice of a PWM frequency (thesis 3.7.2) from generated logs at 200, 250 and 300 Hz.

    python -m benchmarks.pwm_frequency [--first 3720] [--count 12] [--drawn]

Valve A of the thesis' machine, with its delays, at duties of 0.0001 to 0.9501 in steps of 0.05, as
the thesis tested; filling, and discharging of every second seed. `--drawn`: other machines and
delays, and frequencies of 1, 1.25 and 1.5 times one that is drawn. Printed: the periods that the
logs' ripple shows, the linear ranges found and true (those of the delays), and the choice.
"""

from __future__ import annotations

import argparse
import copy
from collections import Counter
from dataclasses import replace

import numpy as np

from benchmarks.valves import trial
from datasets.generator.rigs import GeneratedRig, random_rig, reference_rig
from datasets.generator.valve_tests import pwm_test
from sysid.identification.valve_pwm.frequency import FrequencyChoice, choose_frequency
from sysid.io.log_constants import pwm_period
from sysid.io.logs import Trial
from sysid.io.rig import rig_from_content

FREQUENCIES_HZ = (200.0, 250.0, 300.0)
DUTIES = tuple(float(d) for d in np.round(0.0001 + 0.05 * np.arange(20), 4))


def at_period(rig: GeneratedRig, period: float) -> GeneratedRig:
    """The machine under another PWM period, s."""
    content = copy.deepcopy(rig.content)
    content["pwm"]["period_s"] = period
    return replace(rig, content=content)


def logs_of(
    rig: GeneratedRig, periods: tuple[float, ...], seed: int, noise_pa: float, both: bool
) -> list[tuple[float, str, list[Trial]]]:
    """Constant-duty tests of valve A at each period."""
    rng = np.random.default_rng([372, seed])
    found = []
    for period in periods:
        own = at_period(rig, period)
        tests = [
            trial(pwm_test(own, f"{way}{i}", "a", duty, way == "f", noise_pa, rng))
            for way in ("f", "d")[: 1 + both]
            for i, duty in enumerate(DUTIES)
        ]
        found.append((period, f"log {1.0 / period:.0f} Hz", tests))
    return found


def true_range(rig: GeneratedRig, period: float) -> tuple[float, float]:
    """The duties between which the share of time that the valve is open follows the duty."""
    valves = rig.content["valves"]
    longer = (valves["off_delay_s"] - valves["on_delay_s"]) / period
    return max(0.0, -longer), min(1.0, 1.0 - longer)


def chosen(seed: int, drawn: bool) -> tuple[FrequencyChoice, GeneratedRig, list[float | None]]:
    """The choice from one seed's logs, its machine, and the periods that the logs show."""
    rng = np.random.default_rng([37, seed])
    rig = random_rig(seed) if drawn else reference_rig()
    first = float(rng.uniform(80.0, 250.0)) if drawn else FREQUENCIES_HZ[0]
    hertz = (first, 1.25 * first, 1.5 * first) if drawn else FREQUENCIES_HZ
    noise = float(rng.uniform(60.0, 250.0))
    logs = logs_of(rig, tuple(1.0 / f for f in hertz), seed, noise, seed % 2 == 1)
    seen = [pwm_period(trials) for _, _, trials in logs]
    at_first = at_period(rig, logs[0][0])
    return choose_frequency(logs, rig_from_content(at_first.content, "generated")), rig, seen


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=3720)
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--drawn", action="store_true")
    asked = parser.parse_args()
    choices: Counter[int] = Counter()
    for seed in range(asked.first, asked.first + asked.count):
        found, rig, seen = chosen(seed, asked.drawn)
        periods = [r.period_s for r in found.responses]
        choices[periods.index(found.chosen_s)] += 1
        said = []
        for r, shown in zip(found.responses, seen, strict=True):
            low, high = true_range(rig, r.period_s)
            low, high = max(low, DUTIES[0]), min(high, DUTIES[-1])
            said.append(
                f"{r.frequency_hz:.0f} Hz {r.linear.first:.4f} to {r.linear.last:.4f} "
                f"(true {low:.4f} to {high:.4f}, +-{2 * r.linear.std:.4f}, "
                f"ripple {'-' if shown is None else f'{1 / shown:.1f}'})"
            )
        print(f"{seed}: {1.0 / found.chosen_s:.0f} Hz; {'; '.join(said)}")
        print("   ", found.why)
    print(f"choice by place (0: the lowest frequency): {dict(choices)}")


if __name__ == "__main__":
    main()
