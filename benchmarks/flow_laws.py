"""Flow laws of on/off valves: numbers of ISO 6358, and which law the tests choose.

    python -m benchmarks.flow_laws iso [--first 1000] [--count 24] [--index]
    python -m benchmarks.flow_laws thesis [--first 1000] [--count 24]

`iso`: drawn valves of ISO 6358 (`benchmarks.iso_bench`), each with one to four tests, half
of them with 1 % of scatter from test to test: errors of C, b and the delays, their 95 % intervals,
and the law that was chosen; `--index`: each with a subsonic index of its own, from 0.4 to 0.75.
`thesis`: drawn rigs of the thesis' law (`datasets.generator`), their
on/off valves A: the law that was chosen.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchmarks.iso_bench import IsoBench
from benchmarks.valves import trial
from datasets.generator.campaign import make_campaign
from sysid.estimation.linear import Estimate
from sysid.identification.valve_discrete.law_choice import LawChoice
from sysid.identification.valve_discrete.result import DiscreteFit
from sysid.io.rig import rig_from_content
from sysid.plant.iso6358 import DEFAULT_INDEX
from sysid.valve_discrete import fit_valve_discrete

SCATTER = 0.01


def fitted_iso(seed: int, draws_index: bool) -> tuple[IsoBench, DiscreteFit, float]:
    """A drawn valve, its fit, and the scatter of its tests."""
    bench = IsoBench.drawn(seed)
    if draws_index:
        index = float(np.random.default_rng([6359, seed]).uniform(0.4, 0.75))
        bench = replace(bench, index=index)
    scatter = SCATTER if seed % 2 else 0.0
    trials = bench.trials(seed, 2 + seed % 3 if scatter else 1 + seed % 4, scatter)
    return bench, fit_valve_discrete(trials, bench.rig(), find_ratio=False)["a"], scatter


def called(choice: LawChoice | None) -> str:
    """The law that was chosen, or that the tests do not distinguish them."""
    assert choice is not None
    if choice.undecided:
        return "indistinguishable"
    return "iso6358" if "iso6358" in choice.laws.values() else "thesis"


def _pairs(bench: IsoBench, fit: DiscreteFit) -> Iterator[tuple[str, float, Estimate, float]]:
    """Quantity, error (a share of C; b; s), estimate and truth."""
    for way, (conductance, ratio) in (("fill", bench.fill), ("dis", bench.exhaust)):
        c, b = (fit.estimates.get(f"{q}_{way}") for q in ("sonic_conductance", "critical_ratio"))
        if c is not None and c.identified:
            yield "C", c.value / conductance - 1.0, c, conductance
        if b is not None and b.identified:
            yield "b", b.value - ratio, b, ratio
        m = fit.estimates.get(f"subsonic_index_{way}")
        if m is not None and (m.std > 0.0 or bench.index != DEFAULT_INDEX):
            yield "m", m.value - bench.index, m, bench.index
    for name, truth in (("on_delay_s", bench.on_delay), ("off_delay_s", bench.off_delay)):
        if (delay := fit.estimates[name]).identified:
            yield name, delay.value - truth, delay, truth


def iso(first: int, count: int, draws_index: bool) -> None:
    """Errors, intervals and choices over drawn valves of ISO 6358."""
    errors, held = defaultdict(list), defaultdict(list)
    laws: Counter[str] = Counter()
    began = time.process_time()
    for seed in range(first, first + count):
        bench, fit, scatter = fitted_iso(seed, draws_index)
        law = called(fit.choice)
        laws[law] += 1
        worst = []
        for name, error, estimate, truth in _pairs(bench, fit):
            errors[name].append(abs(error))
            # With scatter the truth of a test is not the mean's: intervals are of the mean.
            held[name].append(estimate.holds(truth))
            worst.append(f"{name} {error:+.2g}{'' if held[name][-1] else '*'}")
        noise = f"noise {bench.noise:.0f} Pa: {', '.join(worst)}"
        print(f"{seed}: {law}, scatter {scatter:g}, {noise}", flush=True)
    print(
        f"laws: {dict(laws)}; {(time.process_time() - began) / count:.1f} s of processor time each"
    )
    for name, values in errors.items():
        inside = held[name]
        print(
            f"{name}: median error {np.median(values):.3g}, largest {max(values):.3g}; "
            f"95 % intervals hold in {sum(inside)} of {len(inside)}"
        )


def thesis(first: int, count: int, _: bool) -> None:
    """Choices over drawn rigs of the thesis' law."""
    laws: Counter[str] = Counter()
    for seed in range(first, first + count):
        campaign = make_campaign(seed, stems=("valve_discrete_a",))
        trials = [trial(test) for log in campaign.logs for test in log.tests]
        rig = rig_from_content(campaign.rig.content, "generated")
        choice = fit_valve_discrete(trials, rig, find_ratio=False)["a"].choice
        laws[called(choice)] += 1
        assert choice is not None
        shown = ", ".join(f"{way} {value:+.0f}" for way, value in choice.evidence.items())
        print(f"{seed}: {called(choice)} ({shown})")
    print(f"laws: {dict(laws)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["iso", "thesis"])
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--index", action="store_true")
    asked = parser.parse_args()
    {"iso": iso, "thesis": thesis}[asked.what](asked.first, asked.count, asked.index)


if __name__ == "__main__":
    main()
