"""How often the 95 % intervals of a fit hold the truth: by encoder, sampling, and kind of rig.

    python benchmarks/coverage.py [discrete] [pwm] [friction] [--rigs 40] [--first 7000]
        [--counts 500 2000 80000] [--periods 0.01 0.001 0.0002] [--forms rotary ...] [--fresh]
        [--json FILE]

Random rigs of the generator (seeds `--first`, `--first` + 1, ...), each recorded by an encoder of
so many counts a revolution (a linear rig: as many over the stroke of a rotary one's revolution) and
one row every period. Forms: rotary, linear, vertical, vertical-linear, short (one test of each
kind, a coarse step of duty), one-valve (tests of valve A alone). Printed: of each number that the
bundle holds, how many intervals there are, the share that holds the truth (asked: 92 to 98 %), the
mean and the spread of the error over its standard error, and the median interval in percent of the
truth. One pooled share of 300 has a standard error of 1.3 % where the errors are independent. In
all cases of one form a seed has the same rig, whose friction scatters alike from test to test:
`--fresh` gives each case seeds of its own, for a share over all.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from datasets.generator.campaign import STANDARD, Size, make_campaign, stream
from datasets.generator.rigs import REFERENCE_RADIUS_M, GeneratedRig, random_rig
from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.friction import fit_friction
from sysid.io.logs import Trial
from sysid.io.rig import Rig, rig_from_content
from sysid.valve_discrete import fit_valve_discrete
from sysid.valve_pwm import fit_valve_pwm

ASKED = (0.92, 0.98)
COUNTS = (500, 2000, 80000)
PERIODS = (0.01, 0.001, 0.0002)
# Orientation and motion of each form; the others are rotary and horizontal.
FORMS = {
    "rotary": ("horizontal", "rotary"),
    "linear": ("horizontal", "linear"),
    "vertical": ("vertical", "rotary"),
    "vertical-linear": ("vertical", "linear"),
    "short": ("horizontal", "rotary"),
    "one-valve": ("horizontal", "rotary"),
}
SHORT = replace(STANDARD, repeats=1, discrete_trials=1, duty_step=0.08)
FITTED = replace(STANDARD, duty_step=0.04)
FRICTION = ("friction_static", "friction_sliding", "friction_motion")
RATIO, RATIOS = 0.53, ("critical_ratio_fill", "critical_ratio_dis")
FINE = 1e-3

Number = tuple[str, Estimate, float]  # name, what was fitted, the truth


def rig_of(seed: int, form: str, counts: int, period: float) -> GeneratedRig:
    """A random rig with another encoder and sampling; constants depend on seed and form alone."""
    orientation, motion = FORMS[form]
    rig = random_rig(stream(seed, "rig"), orientation, motion)
    sensors = {**rig.content["sensors"]}
    if rig.is_linear:
        sensors["encoder_counts_per_m"] = round(counts / (2.0 * np.pi * REFERENCE_RADIUS_M))
    else:
        sensors["encoder_counts_per_rev"] = counts
    content = {**rig.content, "sensors": sensors, "sampling": {"period_s": period}}
    return replace(rig, content=content)


def trials_of(rig: GeneratedRig, seed: int, size: Size, stems: tuple[str, ...]) -> list[Trial]:
    """The tests of these logs, as a reader would give them."""
    campaign = make_campaign(seed, rig=rig, size=size, stems=stems)
    return [
        Trial(
            test.label,
            test.columns["time_s"],
            {k: v for k, v in test.columns.items() if k != "time_s"},
            f"{log.stem}, test {test.label}",
        )
        for log in campaign.logs
        for test in log.tests
    ]


def valves_of(form: str) -> str:
    return "a" if form == "one-valve" else "ab"


def discrete(made: GeneratedRig, rig: Rig, seed: int, form: str) -> Iterator[Number]:
    """Of each on/off valve: flows, coefficients, delays, critical ratios, jumps."""
    size = SHORT if form == "short" else FITTED
    for valve in valves_of(form):
        trials = trials_of(made, seed, size, (f"valve_discrete_{valve}",))
        # The encoder's counts are in no critical ratio, which takes most of the time.
        finds = (rig.encoder_step or 0.0) < FINE * (rig.travel or 0.0)
        fit = fit_valve_discrete(trials, rig, find_ratio=finds)[valve]
        truth = made.truth_content()
        known = {**truth["valves"][valve], **truth["delays"]}
        known |= dict.fromkeys(RATIOS, RATIO) if finds else {}
        yield from ((name, fit[name], true) for name, true in known.items())


def pwm(made: GeneratedRig, rig: Rig, seed: int, form: str) -> Iterator[Number]:
    """Of each PWM valve: the averaged law's flows, coefficients and difference of delays."""
    size = SHORT if form == "short" else FITTED
    for valve in valves_of(form):
        trials = trials_of(made, seed, size, (f"valve_pwm_{valve}",))
        fit = fit_valve_pwm(trials, rig)
        truth = made.truth_content()
        delays = truth["delays"]
        known = {**truth["valves"][valve]}
        known["delay_difference_s"] = delays["off_delay_s"] - delays["on_delay_s"]
        if valve in fit.averaged:
            own = fit.averaged[valve].estimates
            yield from ((name, own[name], true) for name, true in known.items())


def friction(made: GeneratedRig, rig: Rig, seed: int, form: str) -> Iterator[Number]:
    """Static, Coulomb and viscous friction of all friction tests together."""
    size = SHORT if form == "short" else FITTED
    fit = fit_friction(trials_of(made, seed, size, FRICTION), rig)
    known = made.truth_content()["friction"]
    yield from ((name, fit[name], true) for name, true in known.items())


FITS = {"discrete": discrete, "pwm": pwm, "friction": friction}


def swept(
    fit: str, form: str, counts: int, period: float, seeds: range
) -> dict[str, dict[str, float]]:
    """Each number's row: n, held, mean and spread of z, median width in percent."""
    found: dict[str, list[tuple[Estimate, float]]] = defaultdict(list)
    missing = 0
    for seed in seeds:
        made = rig_of(seed, form, counts, period)
        try:
            rig = rig_from_content(made.content, "generated")
            for name, estimate, true in FITS[fit](made, rig, seed, form):
                if estimate.identified:
                    found[name].append((estimate, true))
                else:
                    missing += 1
        except (NotIdentifiedError, ValueError) as error:
            print(f"   {form} {counts} {period:g}, seed {seed}: {error}"[:160], file=sys.stderr)
    rows = {}
    for name, pairs in found.items():
        z = np.array([(e.value - t) / e.std for e, t in pairs if e.has_error])
        widths = [(e.interval[1] - e.interval[0]) / abs(t) for e, t in pairs]
        rows[name] = {
            "n": len(pairs),
            "held": sum(e.holds(t) for e, t in pairs),
            "z": float(np.mean(z)),
            "spread": float(np.std(z)),
            "width_percent": 100.0 * float(np.median(widths)),
        }
    if missing:
        print(f"   {form} {counts} {period:g}: {missing} not identified", file=sys.stderr)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("fits", nargs="*", choices=[*FITS, []], default=[])
    parser.add_argument("--rigs", type=int, default=40)
    parser.add_argument("--first", type=int, default=7000)
    parser.add_argument("--counts", type=int, nargs="+", default=COUNTS)
    parser.add_argument("--periods", type=float, nargs="+", default=PERIODS)
    parser.add_argument("--forms", nargs="+", choices=[*FORMS], default=["rotary"])
    parser.add_argument("--fresh", action="store_true", help="no two cases have the same rigs")
    parser.add_argument("--json", type=Path)
    o = parser.parse_args()
    seeds, results, began = range(o.first, o.first + o.rigs), [], time.perf_counter()
    for fit in o.fits or FITS:
        pooled = np.zeros(2)
        for form in o.forms:
            for period in o.periods:
                for counts in o.counts:
                    rows = swept(fit, form, counts, period, seeds)
                    seeds = range(seeds.stop, seeds.stop + o.rigs) if o.fresh else seeds
                    total = np.array([sum(r[k] for r in rows.values()) for k in ("held", "n")])
                    pooled += total
                    print(f"{fit}, {form}, {counts} counts, {1.0 / period:g} Hz: {share(*total)}")
                    for name, r in rows.items():
                        print(
                            f"   {name:<24}{share(r['held'], r['n']):<24} z {r['z']:+.2f}, spread "
                            f"{r['spread']:.2f}, interval {r['width_percent']:.3g} %",
                            flush=True,
                        )
                    case = {"fit": fit, "form": form, "counts": counts, "period_s": period}
                    results.append({**case, "numbers": rows})
        print(f"{fit}, all: {share(*pooled)}")
    print(f"{time.perf_counter() - began:.0f} s")
    if o.json:
        o.json.write_text(json.dumps(results, indent=1) + "\n")


def share(held: float, count: float) -> str:
    """ "120 of 128 (93.8 %)", a star outside what is asked."""
    part = held / count if count else float("nan")
    star = "" if ASKED[0] <= part <= ASKED[1] else "*"
    return f"{held:.0f} of {count:.0f} ({100.0 * part:.1f} %{star})"


if __name__ == "__main__":
    main()
