"""Whole campaigns in memory, each test with its own seed, so that any part can be made alone."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from datasets.generator import friction_tests, motion_tests, valve_tests
from datasets.generator.effects import Injected, typical
from datasets.generator.rigs import Content, GeneratedRig, random_rig
from datasets.generator.runs import GeneratedTest

FRICTION_KINDS = ("friction-static", "friction-sliding", "friction-motion")
VALVE_KINDS = ("valve-discrete", "valve-pwm")
MOTION_KINDS = ("motion-motor", "motion-pwm", "motion-discrete")
KINDS = FRICTION_KINDS + VALVE_KINDS + MOTION_KINDS
POSITIONS = (-0.65, 0.0, 0.65)  # half travels at which breakaway is measured

# A log's place in this list is part of its seed: append, never reorder.
_STREAMS = (
    "rig",
    "friction-static",
    "friction-sliding",
    "friction-motion",
    "valve-discrete-a",
    "valve-discrete-b",
    "valve-pwm-a",
    "valve-pwm-b",
    "motion-motor-fit",
    "motion-motor-holdout",
    "motion-pwm-fit",
    "motion-pwm-holdout",
    "motion-discrete-fit",
    "motion-discrete-holdout",
    "effects",
)


@dataclass(frozen=True)
class Size:
    """The size of a campaign: trials, tests and the step between duties."""

    repeats: int  # friction trials per position (or level) and direction
    friction_motions: int
    discrete_trials: int
    duty_step: float
    motor_motions: tuple[int, int]  # tests in the fit log and in the holdout log
    pwm_motions: tuple[int, int]
    discrete_motions: tuple[int, int]
    slidings: int | None = None  # sliding trials in all, in place of `repeats` at each level


SMALL = Size(2, 2, 2, 0.04, (2, 1), (3, 2), (2, 1))
STANDARD = Size(3, 3, 3, 0.02, (3, 1), (4, 2), (3, 1))
LARGE = Size(6, 6, 6, 0.01, (6, 2), (8, 4), (6, 2))
# The size of a lab's usual campaign: the friction motions are left to the motion logs.
LAB = Size(3, 0, 3, 0.04, (3, 1), (4, 2), (3, 1), slidings=14)
_SIZES = {"small": SMALL, "standard": STANDARD, "lab": LAB, "large": LARGE}


def size_of(text: str | float) -> Size:
    """A size by name, or the standard one times a factor. Raises ValueError for anything else."""
    if isinstance(text, str) and text in _SIZES:
        return _SIZES[text]
    factor = float(text)
    if not math.isfinite(factor) or factor <= 0.0:
        raise ValueError(f"size {text!r} is neither {', '.join(_SIZES)} nor a positive factor")

    def times(count: int) -> int:
        return max(1, round(count * factor))

    s = STANDARD
    return Size(
        times(s.repeats),
        times(s.friction_motions),
        times(s.discrete_trials),
        s.duty_step / factor,
        (times(s.motor_motions[0]), times(s.motor_motions[1])),
        (times(s.pwm_motions[0]), times(s.pwm_motions[1])),
        (times(s.discrete_motions[0]), times(s.discrete_motions[1])),
    )


@dataclass(frozen=True)
class GeneratedTests:
    """Tests of one rig in memory.

    `rig` is the rig file's content (`sysid.io.rig.rig_from_content(tests.rig, "generated")`
    reads it), `truth` what the fits should find, `kinds` the tests by the campaign file's kind.
    """

    rig: Content
    truth: dict[str, Any]
    kinds: dict[str, list[GeneratedTest]]
    generated_rig: GeneratedRig = field(repr=False)


@dataclass(frozen=True)
class GeneratedLog:
    """One `[[log]]` of a campaign: its file's stem, kind, use, valve and tests."""

    stem: str
    kind: str
    use: str
    tests: list[GeneratedTest] = field(repr=False)
    valve: str | None = None


@dataclass(frozen=True)
class GeneratedCampaign:
    """A rig's tests together, in the order of the campaign file, and the truth behind them."""

    rig: GeneratedRig
    logs: list[GeneratedLog]
    truth: dict[str, Any]

    def log(self, stem: str) -> GeneratedLog:
        """The log of that stem, as `motion_pwm_2`."""
        return next(log for log in self.logs if log.stem == stem)


@dataclass(frozen=True)
class _Maker:
    """What every test of a campaign shares."""

    rig: GeneratedRig
    seed: int
    scatter: float
    noise: float

    def rngs(self, name: str, count: int) -> list[np.random.Generator]:
        return [stream(self.seed, name, i) for i in range(count)]

    def static(self, repeats: int) -> list[GeneratedTest]:
        plan = [(p, d) for p in POSITIONS for _ in range(repeats) for d in (1, -1)]
        rngs = self.rngs("friction-static", len(plan))
        return [
            friction_tests.static_test(self.rig, str(i + 1), *plan[i], self.scatter, self.noise, r)
            for i, r in enumerate(rngs)
        ]

    def sliding(self, repeats: int, count: int | None) -> list[GeneratedTest]:
        """All levels in both directions, `repeats` times, or `count` trials in a cycle."""
        speeds = friction_tests.SPEEDS
        plan = [(s, d) for s in speeds for d in (1, -1) for _ in range(repeats)]
        if count is not None:
            plan = [(s, d) for _ in range(repeats) for s in speeds for d in (1, -1)][:count]
        rngs = self.rngs("friction-sliding", len(plan))
        return [
            friction_tests.sliding_test(self.rig, str(i + 1), *plan[i], self.scatter, self.noise, r)
            for i, r in enumerate(rngs)
        ]

    def sliding_to_rest(self, repeats: int) -> list[GeneratedTest]:
        """All levels in both directions, `repeats` times, each from rest to rest."""
        speeds = friction_tests.SPEEDS
        plan = [(s, d) for s in speeds for d in (1, -1) for _ in range(repeats)]
        rngs = self.rngs("friction-sliding", len(plan))
        return [
            friction_tests.rest_test(self.rig, str(i + 1), *plan[i], self.scatter, self.noise, r)
            for i, r in enumerate(rngs)
        ]

    def friction_motion(self, count: int) -> list[GeneratedTest]:
        return [
            friction_tests.motion_test(self.rig, str(i + 1), 8.0, self.scatter, self.noise, r)
            for i, r in enumerate(self.rngs("friction-motion", count))
        ]

    def valve_discrete(self, valve: str, trials: int) -> list[GeneratedTest]:
        return [
            valve_tests.discrete_test(self.rig, str(i + 1), valve, self.noise, r)
            for i, r in enumerate(self.rngs(f"valve-discrete-{valve}", trials))
        ]

    def valve_pwm(self, valve: str, step: float) -> list[GeneratedTest]:
        duties = valve_tests.duties(step)
        plan = [(duty, filling) for filling in (True, False) for duty in duties]
        rngs = self.rngs(f"valve-pwm-{valve}", len(plan))
        return [
            valve_tests.pwm_test(self.rig, str(i + 1), valve, *plan[i], self.noise, r)
            for i, r in enumerate(rngs)
        ]

    def motions(self, kind: str, use: str, count: int) -> list[GeneratedTest]:
        """Motion tests of one log; every other one of the valve motions runs the motor too."""
        tests = []
        for i, rng in enumerate(self.rngs(f"{kind}-{use}", count)):
            label, common = str(i + 1), (self.scatter, self.noise, rng)
            if kind == "motion-motor":
                duration = 8.0 if use == "fit" else 6.0
                tests.append(motion_tests.motor_test(self.rig, label, duration, *common))
            elif kind == "motion-pwm":
                duration = round(rng.uniform(6.5, 8.0), 3)
                tests.append(motion_tests.pwm_test(self.rig, label, duration, i % 2 == 1, *common))
            else:
                with_motor = i % 2 == 1
                tests.append(motion_tests.discrete_test(self.rig, label, 6.0, with_motor, *common))
        return tests


def stream(seed: int, name: str, *index: int) -> np.random.Generator:
    """The random numbers of one part of a campaign."""
    return np.random.default_rng(np.random.SeedSequence([seed, _STREAMS.index(name), *index]))


def drawn_effects(seed: int, wanted: Sequence[tuple[str, str, float]]) -> tuple[Injected, ...]:
    """Effects of typical size for `make_campaign`, from ids, forms and scales. ValueError."""
    return tuple(
        typical(id, form, stream(seed, "effects", i), scale)
        for i, (id, form, scale) in enumerate(wanted)
    )


def _maker(
    seed: int,
    scatter: float,
    orientation: str,
    motion: str,
    noise_pa: float | None,
    rig: GeneratedRig | None,
) -> _Maker:
    if rig is None:
        rig = random_rig(stream(seed, "rig"), orientation, motion)
    noise = rig.truth.pressure_noise_pa if noise_pa is None else noise_pa
    return _Maker(rig, seed, scatter, noise)


def _truth(maker: _Maker) -> dict[str, Any]:
    truth = maker.rig.truth_content()
    truth["pressure_noise_pa"] = maker.noise
    return truth | {"seed": maker.seed, "scatter": maker.scatter}


def make_friction_tests(
    seed: int,
    *,
    scatter: float = 0.02,
    orientation: str = "horizontal",
    motion: str = "rotary",
    noise_pa: float | None = None,
    repeats: int = 3,
    rig: GeneratedRig | None = None,
    kinds: tuple[str, ...] = FRICTION_KINDS,
    to_rest: bool = False,
    effects: tuple[Injected, ...] = (),
) -> GeneratedTests:
    """The three friction kinds for a random rig (or the one given).

    `scatter`: each trial's static friction, and its Coulomb and viscous friction together, are the
    rig's times (1 + scatter N(0, 1)). `noise_pa`: pressure noise in place of the rig's own.
    `repeats`: trials per position and direction (static) or level and direction (sliding).
    `to_rest`: the sliding trials run without a kick, from rest to rest. `effects` as in
    `make_campaign`.
    """
    maker = _maker(seed, scatter, orientation, motion, noise_pa, rig)
    if effects:
        maker = dataclasses.replace(
            maker,
            rig=dataclasses.replace(maker.rig, effects=(*maker.rig.effects, *effects)),
        )
    makers: dict[str, Callable[[], list[GeneratedTest]]] = {
        "friction-static": lambda: maker.static(repeats),
        "friction-sliding": lambda: (
            maker.sliding_to_rest(repeats) if to_rest else maker.sliding(repeats, None)
        ),
        "friction-motion": lambda: maker.friction_motion(3),
    }
    tests = {kind: make() for kind, make in makers.items() if kind in kinds}
    return GeneratedTests(maker.rig.content, _truth(maker), tests, maker.rig)


def with_pwm_frequency(rig: GeneratedRig, frequency: float) -> GeneratedRig:
    """The same rig with its valves pulsed at another frequency, Hz."""
    content = {**rig.content, "pwm": {"period_s": round(1.0 / frequency, 12)}}
    return dataclasses.replace(rig, content=content)


def make_campaign(
    seed: int,
    *,
    size: Size = STANDARD,
    scatter: float = 0.02,
    orientation: str = "horizontal",
    motion: str = "rotary",
    noise_pa: float | None = None,
    pwm_frequency: float = 200.0,
    rig: GeneratedRig | None = None,
    kinds: tuple[str, ...] = KINDS,
    stems: tuple[str, ...] | None = None,
    effects: tuple[Injected, ...] = (),
) -> GeneratedCampaign:
    """A whole campaign for a random rig (or the one given).

    `kinds` keeps only those kinds, `stems` only those files; what is kept does not depend on what
    is left out. `effects` act in the plant and its sensors and stand in the truth; the rig's own
    are kept before them, and the rig file declares none. Other arguments as in
    `make_friction_tests`. Raises ValueError where a rig can make no test of a kind (a motor too
    weak to move it), and for effects that do not go together.
    """
    maker = _maker(seed, scatter, orientation, motion, noise_pa, rig)
    maker = dataclasses.replace(maker, rig=with_pwm_frequency(maker.rig, pwm_frequency))
    if effects:
        own = (*maker.rig.effects, *effects)
        maker = dataclasses.replace(maker, rig=dataclasses.replace(maker.rig, effects=own))
    logs = []
    for stem, kind, use, valve, make in _plan(maker, size):
        if kind in kinds and (stems is None or stem in stems):
            tests = make()
            if tests:
                logs.append(GeneratedLog(stem, kind, use, tests, valve))
    truth = _truth(maker)
    truth["tests"] = {log.stem: {test.label: test.truth for test in log.tests} for log in logs}
    return GeneratedCampaign(maker.rig, logs, truth)


_Planned = tuple[str, str, str, str | None, Callable[[], list[GeneratedTest]]]


def _plan(maker: _Maker, size: Size) -> list[_Planned]:
    """Every log of a campaign: stem, kind, use, valve, and what makes its tests."""
    plan: list[_Planned] = [
        ("friction_static", "friction-static", "fit", None, lambda: maker.static(size.repeats)),
        (
            "friction_sliding",
            "friction-sliding",
            "fit",
            None,
            lambda: maker.sliding(size.repeats, size.slidings),
        ),
        (
            "friction_motion",
            "friction-motion",
            "fit",
            None,
            lambda: maker.friction_motion(size.friction_motions),
        ),
    ]
    for v in "ab":
        plan += [
            (
                f"valve_discrete_{v}",
                "valve-discrete",
                "fit",
                v,
                lambda v=v: maker.valve_discrete(v, size.discrete_trials),
            ),
            (
                f"valve_pwm_{v}",
                "valve-pwm",
                "fit",
                v,
                lambda v=v: maker.valve_pwm(v, size.duty_step),
            ),
        ]
    counts = (size.motor_motions, size.pwm_motions, size.discrete_motions)
    for place, (use, suffix) in enumerate((("fit", ""), ("holdout", "_2"))):
        for kind, count in zip(MOTION_KINDS, counts, strict=True):
            plan.append(
                (
                    kind.replace("-", "_") + suffix,
                    kind,
                    use,
                    None,
                    lambda kind=kind, use=use, n=count[place]: maker.motions(kind, use, n),
                )
            )
    return plan
