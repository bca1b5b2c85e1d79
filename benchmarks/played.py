"""Tests that play themselves: what they tell against what was predicted, and their limits.

    python -m benchmarks.played --seeds 9200 9208 [--repeats 0] [--results FILE.jsonl]

For each seed a generated rig, and a bundle of its true parameters that knows each to 3 % (no motion
log yet). A valve's parameter, friction or an effect's strength is asked for, another one from seed
to seed. Of each rig:

- the standard error predicted after the designed test, within the highest speed of the standard
  campaign's motion tests, and after these at equal duration: after all of them, each for its share
  of it, and after the best one alone;
- the farthest position and highest speed on 100 plants that the design did not try, every constant
  20 % off, and on 100 that are 10 % off, over the limits; the share of plants 20 % off on which a
  standard motion test leaves 90 % of the travel;
- with `--repeats N`: the test is played N times on the generator's own plant, with friction drawn
  anew (2 %) and noise, each refined alone; the errors over the predicted standard error.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.sweeps import accumulated
from datasets.generator.campaign import SMALL, make_campaign
from datasets.generator.files import write_log
from datasets.generator.friction_tests import friction_factors
from datasets.generator.rigs import GeneratedRig, rig_toml
from datasets.generator.runs import Commands, at_atmosphere, logged, simulated
from sysid.estimation.linear import Estimate
from sysid.io.campaign import MOTION_KINDS, Campaign, read_campaign
from sysid.io.logs import read_log
from sysid.parameters import Bundle, Parts
from sysid.parameters.friction import Friction
from sysid.parameters.valves import FittedValves
from sysid.plant.base import place_at_rest
from sysid.plant.ports import Model
from sysid.plant.simulator import simulate
from sysid.recording.motion_tests import MotionTest, prepare
from sysid.refinement.advice import Beginning, begin
from sysid.refinement.candidates import inputs_of_commands, leaves_travel
from sysid.refinement.information import information_of
from sysid.refinement.lengthening import joined_runs
from sysid.refinement.options import RunsOfTests, information, problem_of, runs_of_tests
from sysid.refinement.played.design import Aim
from sysid.refinement.played.limits import extremes, off_plants
from sysid.refinement.played.proposal import PlayRequest, aimed, played_test
from sysid.refinement.played.result import PlayedTest
from sysid.refinement.probes import Probes
from sysid.refinement.refine import refine
from sysid.refinement.runs import runs_of

SHARE, SCATTER, DURATION_S = 0.03, 0.02, 10.0
ASKED = [
    f"valves.{side}.{key}"
    for key in ("c_fill", "choked_flow_dis_kg_s", "c_dis", "choked_flow_fill_kg_s")
    for side in "ab"
]
ASKED += ["friction.coulomb_nm", "piston-leakage", "friction.static_nm"]


def rig_and_bundle(seed: int, folder: Path) -> tuple[Any, Campaign, Bundle]:
    """The generated rig, a campaign with one bench log, a bundle of the truth known to 3 %."""
    made = make_campaign(seed, size=SMALL, kinds=("friction-sliding",))
    (folder / "rig.toml").write_text(rig_toml(made.rig.content))
    write_log(folder / "sliding.csv", made.logs[0].tests, made.rig)
    entry = '[[log]]\nkind = "friction-sliding"\nfile = "sliding.csv"\n'
    (folder / "campaign.toml").write_text(f'rig = "rig.toml"\n{entry}')

    def known(value: float) -> Estimate:
        return Estimate.symmetric(value, SHARE * abs(value), "SI", math.inf)

    friction = {k: known(v) for k, v in made.truth["friction"].items()}
    valves = {
        side: {"discrete": {k: known(v) for k, v in law.items()}}
        for side, law in made.truth["valves"].items()
    }
    parts = Parts(Friction.model_validate(friction), FittedValves.model_validate(valves))
    campaign = read_campaign(folder / "campaign.toml")
    return made, campaign, Bundle.new(campaign.rig, parts, [])


@dataclasses.dataclass(frozen=True)
class Standard:
    """The standard campaign's motion tests: their highest speed, rad/s or m/s, and by log their
    information (k, k) and duration, s; the tests themselves."""

    speed: float
    said: list[np.ndarray]
    seconds: list[float]
    tests: list[MotionTest]


def standard_tests(began: Beginning, probes: Probes, seed: int, folder: Path) -> Standard:
    """Those of a seed's rig."""
    setting, rig = began.setting, began.setting.rig
    problem = problem_of(runs_of_tests(setting, (), count_logs=True), probes, setting)
    speed, said, seconds, every = 0.0, [], [], []
    made = make_campaign(seed, size=SMALL, kinds=MOTION_KINDS)
    for log in made.logs:
        path = folder / f"{log.stem}.csv"
        write_log(path, log.tests, made.rig)
        trials = read_log(path, rig).trials
        prepared = [prepare(t, log.kind, rig, 1.0) for t in trials]
        own = [
            r
            for i, t in enumerate(prepared)
            for r in runs_of(i, t, setting.model, rig.position_channel)
        ]
        own = joined_runs(own, prepared, 0, setting.model, rig.position_channel)
        own = [dataclasses.replace(r, noise=setting.noise) for r in own]
        one = dataclasses.replace(
            problem,
            runs=tuple(own),
            whitening=tuple(setting.errors_of(r) for r in own),
            tests=len(prepared),
        )
        equations = one.linearised(one.first_point())
        tests = [
            information_of(one, [equations[i] for i in one.members(n)])
            for n in range(len(prepared))
        ]
        said.append(np.sum(tests, axis=0))
        seconds.append(sum(float(t.time[-1] - t.time[0]) for t in trials))
        every += prepared
        speed = max(speed, *(t.highest_speed for t in prepared))
    return Standard(speed, said, seconds, every)


def leaving(tests: list[MotionTest], plants: list[Model], limit: float) -> float:
    """The share of plants on which a test of the standard campaign leaves the limit, rad or m."""
    left = []
    for test in tests:
        kind = "motion-pwm" if test.pulsed else "motion-discrete"
        a, b = test.commands
        valves = None if a is None or b is None else np.array([a, b])
        inputs = inputs_of_commands(
            kind, test.trial.time, test.commanded, valves, float(test.position[0])
        )
        runs = simulate([inputs] * len(plants), plants, nan_if_endless=True)
        rests = [place_at_rest(p.parameters) for p in plants]
        left += [
            bool(leaves_travel(run.position, limit, rest).any())
            for run, rest in zip(runs, rests, strict=True)
        ]
    return float(np.mean(left))


def after_standard(
    began: Beginning, probes: Probes, aim: Aim, tests: Standard
) -> tuple[float, list[float]]:
    """The standard error of what is asked after all tests, and after each, at equal duration."""
    setting = began.setting
    none = runs_of_tests(setting, (), count_logs=True)
    problem = problem_of(none, probes, setting)
    now, _ = information(problem, RunsOfTests(none.runs, none.logged, ()), setting)
    known = problem.unknowns[aim.columns[0]]
    scale = abs(known.slope(known.start))

    def std(said: np.ndarray, seconds: float) -> float:
        return scale * float(aim.std(now + said * (DURATION_S / seconds))[0])

    every = std(np.sum(tests.said, axis=0), sum(tests.seconds))
    return every, [std(*one) for one in zip(tests.said, tests.seconds, strict=True)]


def repeated(
    made: Any, campaign: Campaign, bundle: Bundle, played: PlayedTest, repeats: int, folder: Path
) -> list[float]:
    """The errors of what was asked over the predicted standard error, by repeat."""
    rig: GeneratedRig = made.rig
    asked = played.expected[0]
    errors = []
    for repeat in range(repeats):
        rng = np.random.default_rng([repeat, 5])
        tests = []
        for label, motion in enumerate(played.motions, start=1):
            valves = {}
            if motion.valves is not None:
                prefix = "duty" if motion.kind == "motion-pwm" else "valve"
                pair = zip("ab", motion.valves, strict=True)
                valves = {f"{prefix}_{side}": v for side, v in pair}
            commands = Commands(motion.motor, **valves)
            plant = rig.plant(*friction_factors(rng, SCATTER))
            states = simulated(rig, plant, commands, at_atmosphere(rig, motion.start))
            noise = rig.truth.pressure_noise_pa
            tests.append(logged(str(label), rig, commands, states, noise, rng, {}))
        write_log(folder / "played.csv", tests, rig)
        text = (folder / "campaign.toml").read_text().split('\n[[log]]\nkind = "motion')[0]
        entry = f'\n[[log]]\nkind = "{played.kind}"\nfile = "played.csv"\nuse = "fit"\n'
        (folder / "campaign.toml").write_text(text + entry)
        found = refine(read_campaign(folder / "campaign.toml"), bundle)
        (own,) = [p for p in found.parameters if p.name == asked.name]
        errors.append((own.estimate.value - asked.value) / asked.after)
    return errors


def one_rig(seed: int, repeats: int) -> dict[str, Any]:
    """A seed's figures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made, campaign, bundle = rig_and_bundle(seed, folder)
        began = begin(campaign, bundle)
        asked = ASKED[seed % len(ASKED)]
        probes, aim = aimed(began, (asked,), None)
        tests = standard_tests(began, probes, seed, folder)
        played = played_test(began, PlayRequest((asked,), DURATION_S, speed=tests.speed))
        model = began.setting.model
        worst = [0.0, 0.0]
        for off in (0.2, 0.1):
            plants = off_plants(bundle, campaign.rig, model, 100, seed + 40_000, off)
            reached = extremes(played.motions, plants)
            ratio = reached[0] / played.limits.position, reached[1] / played.limits.speed
            worst = [max(w, r) for w, r in zip(worst, ratio, strict=True)]
        others = off_plants(bundle, campaign.rig, model, 40, seed + 50_000)
        left = leaving(tests.tests, others, played.limits.position)
        every, after = after_standard(began, probes, aim, tests)
        errors = repeated(made, campaign, bundle, played, repeats, folder)
    expected = played.expected[0]
    # Of an effect that is not there, the strength itself.
    value = abs(expected.value) or 1.0
    return {
        "seed": seed,
        "asked": asked,
        "kind": played.kind,
        "now": expected.now / value,
        "played": expected.after / value,
        "campaign": every / value,
        "standard": [s / value for s in after],
        "standard_leaves": left,
        "position_over_limit": worst[0],
        "speed_over_limit": worst[1],
        "errors": errors,
    }


def summed_up(results: list[dict[str, Any]]) -> None:
    """The figures over all rigs."""
    best = np.array([r["played"] / min(r["standard"]) for r in results])
    every = np.array([r["played"] / r["campaign"] for r in results])
    print(
        f"{len(results)} rigs: played over all standard tests, median {np.median(every):.2f} "
        f"({every.min():.2f} to {every.max():.2f}); over the best one {np.median(best):.2f} "
        f"({best.min():.2f} to {best.max():.2f})"
    )
    for name in ("position_over_limit", "speed_over_limit"):
        ratio = np.array([r[name] for r in results])
        print(f"{name}: largest {ratio.max():.2f}, above 1 in {int((ratio > 1).sum())}")
    left = np.array([r["standard_leaves"] for r in results])
    print(
        f"a standard test leaves 90 % of the travel on {100 * np.median(left):.0f} % of plants "
        f"20 % off (median; {100 * left.min():.0f} to {100 * left.max():.0f} %)"
    )
    errors = np.array([e for r in results for e in r["errors"]])
    if len(errors):
        print(
            f"{len(errors)} repeats: error over predicted standard error, RMS "
            f"{np.sqrt(np.mean(errors**2)):.2f}; within 1.96 of them "
            f"{100 * np.mean(np.abs(errors) < 1.96):.0f} %"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(9200, 9208), help="first, end")
    parser.add_argument("--repeats", type=int, default=0)
    parser.add_argument("--results", type=Path, default=Path("played.jsonl"))
    options = parser.parse_args()
    results = accumulated(
        options.results, options.seeds, lambda seed: one_rig(seed, options.repeats)
    )
    summed_up(results)


if __name__ == "__main__":
    main()
