"""How well the valve identifications recover the truth of generated campaigns.

    python -m benchmarks.valves discrete [--seeds 30]

`discrete`: median error and 95 % coverage of the on/off valve's parameters over random rigs,
both valves, and the round trip on the parameters that the thesis prints (Table 3.6.1).
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from datasets.generator.campaign import make_campaign
from datasets.generator.rigs import GeneratedRig, reference_rig
from datasets.generator.runs import GeneratedTest
from sysid.io.logs import Trial
from sysid.io.rig import rig_from_content
from sysid.valve_discrete import ValveDiscreteResult, fit_valve_discrete

FLOWS = ("choked_flow_fill_kg_s", "choked_flow_dis_kg_s", "c_fill", "c_dis")
DELAYS = ("on_delay_s", "off_delay_s")
RATIOS = ("critical_ratio_fill", "critical_ratio_dis")
TABLE_3_6_1_SUPPLY = {"a": 251e3, "b": 243e3}


def trial(test: GeneratedTest) -> Trial:
    """A generated test as the reader would give it."""
    channels = {k: v for k, v in test.columns.items() if k != "time_s"}
    return Trial(test.label, test.columns["time_s"], channels, f"generated, test {test.label}")


def fitted(
    seed: int, valves: Sequence[str] = "ab", rig: GeneratedRig | None = None
) -> tuple[ValveDiscreteResult, dict[str, dict[str, float]]]:
    """The fit of one seed's valve-discrete logs, and the truth by valve and parameter."""
    stems = tuple(f"valve_discrete_{v}" for v in valves)
    campaign = make_campaign(seed, rig=rig, stems=stems)
    trials = [trial(test) for log in campaign.logs for test in log.tests]
    result = fit_valve_discrete(trials, rig_from_content(campaign.rig.content, "generated"))
    truth = {v: {**campaign.truth["valves"][v], **campaign.truth["delays"]} for v in valves}
    for values in truth.values():
        values |= dict.fromkeys(RATIOS, 0.53)
    return result, truth


def recovery(seeds: int) -> None:
    """Median error, largest error and coverage of each parameter over `seeds` rigs."""
    errors, held, widths = defaultdict(list), defaultdict(list), defaultdict(list)
    started = time.perf_counter()
    seconds = 0.0
    for seed in range(seeds):
        began = time.process_time()
        result, truth = fitted(seed)
        seconds += time.process_time() - began
        for valve, fit in result.valves.items():
            for name, true in truth[valve].items():
                estimate = fit[name]
                if not estimate.identified:
                    print(f"seed {seed}, valve {valve}: {name}: {estimate.reason}")
                    continue
                scale = true if name in FLOWS else 1.0
                errors[name].append((estimate.value - true) / scale)
                held[name].append(estimate.holds(true))
                widths[name].append((estimate.interval[1] - estimate.interval[0]) / scale)
    print(f"{seeds} seeds, both valves; {time.perf_counter() - started:.0f} s in all, ", end="")
    print(f"{seconds / seeds:.2f} s of processor time a seed with its simulation")
    print(f"{'parameter':<24}{'median |error|':>16}{'largest':>12}{'interval':>12}{'holds':>12}")
    for name in (*FLOWS, *DELAYS, *RATIOS):
        unit, scale = (" %", 100.0) if name in FLOWS else (" ms", 1e3)
        unit, scale = ("", 1.0) if name in RATIOS else (unit, scale)
        e = scale * np.abs(errors[name])
        print(
            f"{name:<24}{np.median(e):>13.4f}{unit:<3}{e.max():>9.4f}{unit:<3}"
            f"{scale * np.median(widths[name]):>9.4f}{unit:<3}{100 * np.mean(held[name]):>8.1f} %"
        )
    pooled = [h for name in (*FLOWS, *DELAYS) for h in held[name]]
    print(f"all flows, coefficients and delays: {100 * np.mean(pooled):.1f} % of {len(pooled)}")


def table_3_6_1() -> None:
    """Round trip on the thesis' printed parameters, each valve at its own supply pressure."""
    print("\nTable 3.6.1, round trip (error in %)")
    for valve, supply in TABLE_3_6_1_SUPPLY.items():
        reference = reference_rig()
        air = {**reference.content["air"], "supply_pressure_pa": supply}
        rig = replace(reference, content={**reference.content, "air": air})
        result, truth = fitted(1, valve, rig)
        fit = result.valves[valve]
        cells = []
        for name in FLOWS:
            error = 100.0 * (fit[name].value / truth[valve][name] - 1.0)
            cells.append(f"{name} {fit[name].value:.4g} ({error:+.3f})")
        print(f"valve {valve.upper()}: {', '.join(cells)}")
        for name in ("jump_fill_percent", "jump_dis_percent"):
            low, high = fit[name].interval
            print(f"  {name} {fit[name].value:.2f} ({low:.2f} to {high:.2f})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("section", choices=("discrete",))
    parser.add_argument("--seeds", type=int, default=30)
    arguments = parser.parse_args()
    recovery(arguments.seeds)
    table_3_6_1()


if __name__ == "__main__":
    main()
