"""Rigs with one chamber and an elastic return: spring-return cylinders, soft actuators.

The piston's other side is open to the atmosphere. Without pressure the spring holds the piston
inside its stroke, so that every test starts at rest and off the stops.
`make_one_chamber_campaign` draws a rig and its tests; each test has its own seed. `scaled` makes
the same campaign of a rig of another size and speed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from datasets.generator import friction_tests, valve_tests
from datasets.generator.campaign import GeneratedCampaign, GeneratedLog, stream
from datasets.generator.effects import Injected
from datasets.generator.plant import POSITION, FloatArray
from datasets.generator.rigs import GeneratedRig, Truth, ValveTruth, random_rig
from datasets.generator.runs import Commands, GeneratedTest, Start, at_atmosphere, logged, simulated
from datasets.generator.sensors import rounded_duty, rounded_effort

LIMIT = 0.92  # of the half travel, never passed
TRIES = 600
SWING = 0.45  # least way from one extreme to the other, in half travels
# The spring's effort over the whole stroke, in shares of the chamber's effort at the supply.
SPRING_SHARE = (0.35, 0.75)
# Of the way, in half travels, that the supply moves the piston against a stiff spring.
STIFF_SWING = 0.4
# Where the spring holds the piston without pressure, in half travels.
FREE_PLACE = (-0.75, -0.5)
VACUUM_PA = (2e4, 4.5e4)
# Half travels around the free place at which friction holds the piston, and where ramps begin.
RAMP_PLACES = (-0.5, 0.0, 0.5)
KINDS = (
    "friction-static",
    "friction-motion",
    "valve-discrete",
    "valve-pwm",
    "motion-motor",
    "motion-pwm",
    "motion-discrete",
)
NO_VALVE = ValveTruth(0.0, 0.0, 0.0, 0.0)


def random_one_chamber_rig(
    rng: np.random.Generator,
    motion: str | None = None,
    with_motor: bool | None = None,
    vacuum: bool = False,
    bleeds: bool = False,
    stiffer: float = 1.0,
) -> GeneratedRig:
    """A rig with chamber A and a return spring; what is not given is drawn.

    Rotary or linear; with or without a motor next to the cylinder; `vacuum`: its supply is one, and
    the spring holds the piston at the other end; `bleeds`: a fill and a bleed valve, shut while
    both are off. The spring is as stiff as `SPRING_SHARE` says, times `stiffer`.
    """
    drawn_motion = "linear" if rng.random() < 0.5 else "rotary"
    drawn_motor = bool(rng.random() < 0.5)
    rig = random_rig(rng, "horizontal", motion or drawn_motion)
    content = {section: dict(table) for section, table in rig.content.items()}
    cylinder = content["cylinder"]
    del cylinder["area_b_m2"], cylinder["offset_b_m"]
    cylinder["chambers"] = ["a"]
    if bleeds:
        content["valves"]["arrangement"] = "fill-and-bleed"
    if vacuum:
        content["air"]["supply_pressure_pa"] = round(float(rng.uniform(*VACUUM_PA)), -3)
        # What a full vacuum moves is less than what 3 bar do.
        key = "mass_kg" if rig.is_linear else "equivalent_kg_m2"
        content["inertia"][key] = float(f"{0.5 * content['inertia'][key]:.5g}")
    rig = dataclasses.replace(rig, content=content)
    content["spring"] = _spring(rig, rng, stiffer)
    if not (drawn_motor if with_motor is None else with_motor):
        del content["motor"]
    t, less = rig.truth, 0.4 if vacuum else 1.0
    truth = Truth(
        less * t.static_friction,
        less * t.coulomb_friction,
        less * t.viscous_friction,
        t.valve_a,
        NO_VALVE,
        t.pressure_noise_pa,
    )
    return GeneratedRig(content, truth)


def _reach(rig: GeneratedRig) -> float:
    """The chamber's effort at the supply, Nm or N."""
    air, cylinder = rig.content["air"], rig.content["cylinder"]
    gauge = abs(float(air["supply_pressure_pa"] - air["atmospheric_pressure_pa"]))
    return gauge * float(cylinder["area_a_m2"]) * rig.radius


def _spring(rig: GeneratedRig, rng: np.random.Generator, stiffer: float) -> dict[str, float]:
    stiffness = stiffer * rng.uniform(*SPRING_SHARE) * _reach(rig) / (2.0 * rig.half_travel)
    free = rng.uniform(*FREE_PLACE)
    # At the end of rest: where A is smallest, and in a vacuum where it is largest.
    preload = -stiffness * (free + 1.0) * rig.half_travel
    names = ("stiffness_n_per_m", "preload_n")
    if not rig.is_linear:
        names = ("stiffness_nm_per_rad", "preload_nm")
    return {name: float(f"{v:.5g}") for name, v in zip(names, (stiffness, preload), strict=True)}


def free_place(rig: GeneratedRig) -> float:
    """Where the spring holds the piston without pressure, rad or m."""
    p = rig.plant()
    return -p.spring_effort / p.spring_stiffness


def _start(rig: GeneratedRig, rng: np.random.Generator) -> Start:
    """Somewhere near the free place, where friction holds the piston."""
    p = rig.plant()
    within = 0.5 * p.coulomb_friction / p.spring_stiffness
    within = min(within, 0.15 * rig.half_travel)
    return at_atmosphere(rig, free_place(rig) + float(rng.uniform(-within, within)))


@dataclasses.dataclass(frozen=True)
class _Maker:
    rig: GeneratedRig
    scatter: float
    noise: float

    def _logged(
        self,
        label: str,
        commands: Commands,
        states: FloatArray,
        factors: tuple[float, float],
        rng: np.random.Generator,
    ) -> GeneratedTest:
        truth = friction_tests.factors_truth(*factors)
        return logged(label, self.rig, commands, states, self.noise, rng, truth)

    def _tried(
        self, label: str, rng: np.random.Generator, draw: Any, swing: float = SWING
    ) -> GeneratedTest:
        """A test whose commands `draw` makes, tried until the piston moves well, off its stops."""
        rig, limit = self.rig, LIMIT * self.rig.half_travel
        factors = friction_tests.friction_factors(rng, self.scatter)
        plant, start = rig.plant(*factors), _start(rig, rng)
        within = _reach(rig) / plant.spring_stiffness / rig.half_travel
        swing = min(swing, STIFF_SWING * within)
        for attempt in range(TRIES):
            commands = draw(attempt / TRIES)
            states = simulated(rig, plant, commands, start, (-limit, limit))
            n, least = commands.motor.size, swing * (1.0 - 0.6 * attempt / TRIES)
            if len(states) == n and np.ptp(states[:, POSITION]) > least * rig.half_travel:
                return self._logged(label, commands, states, factors, rng)
        raise ValueError("no commands move this rig well and keep it off its stops")

    def pwm(self, label: str, duration: float, rng: np.random.Generator) -> GeneratedTest:
        """A clipped sine of the duty, and in some tests of a motor next to the cylinder."""
        rig = self.rig
        n = round(duration / rig.row_period)
        with_motor = "motor" in rig.content and rng.random() < 0.5

        def draw(progress: float) -> Commands:
            period = float(rig.content["pwm"]["period_s"])
            held = np.floor(np.arange(n) * rig.row_period / period + 1e-6).astype(int)
            frequency, phase = rng.uniform(0.15, 0.5), rng.uniform(0.0, 2.0 * np.pi)
            middle, amplitude = rng.uniform(0.1, 0.5), rng.uniform(0.06, 0.3)
            sine = friction_tests.clipped_sine(
                held[-1] + 1, period, frequency, phase, amplitude, rng.uniform(0.7, 1.0)
            )
            duty, bleed = rounded_duty(np.clip(middle + sine, 0.004, 0.95))[held], None
            if rig.bleeds:  # one fills, the other one empties, and in between both are shut
                size = rng.uniform(0.5, 1.5) * amplitude
                shift = rng.uniform(-0.02, 0.04)
                duty = rounded_duty(np.clip(size * sine / amplitude - shift, 0.0, 0.95))[held]
                bleed = rounded_duty(np.clip(-size * sine / amplitude - shift, 0.0, 0.95))[held]
            motor = np.zeros(n)
            if with_motor:
                size = rng.uniform(0.1, 0.3) * rig.max_effort
                motor = friction_tests.clipped_sine(
                    n, rig.row_period, 1.7 * frequency, phase, size, 0.8
                )
            return Commands(rounded_effort(motor, rig), duty_a=duty, bleed=bleed)

        return self._tried(label, rng, draw)

    def discrete(self, label: str, duration: float, rng: np.random.Generator) -> GeneratedTest:
        """Pulses of the valve, some short and some that fill the chamber, and pauses."""
        rig = self.rig
        n = round(duration / rig.row_period)

        def draw(progress: float) -> Commands:
            valve, bleed = np.zeros(n), np.zeros(n)
            row = round(rng.uniform(0.25, 0.6) / rig.row_period)
            longest = 0.2 * (1.0 - 0.8 * progress) + 0.02
            while row < n:
                pulse = np.exp(rng.uniform(np.log(0.008), np.log(longest)))
                length = max(1, round(float(pulse) / rig.row_period))
                # Of two valves either one, and a pause in which both are shut.
                own = bleed if rig.bleeds and rng.random() < 0.5 else valve
                own[row : row + length] = 1.0
                row += length + round(rng.uniform(0.03, 0.5) / rig.row_period)
            both = bleed if rig.bleeds else None
            return Commands(np.zeros(n), valve_a=valve, bleed=both)

        return self._tried(label, rng, draw)

    def motor(self, label: str, duration: float, rng: np.random.Generator) -> GeneratedTest:
        """A clipped sine of the motor against the spring, the chamber open."""
        rig = self.rig
        n = round(duration / rig.row_period)

        def draw(progress: float) -> Commands:
            sine = friction_tests.clipped_sine(
                n,
                rig.row_period,
                rng.uniform(0.3, 0.9),
                rng.uniform(0.0, 2.0 * np.pi),
                rng.uniform(0.6, 1.25) * rig.max_effort,
                rng.uniform(0.6, 0.95),
            )
            return Commands(rounded_effort(sine, rig), valve_a=np.zeros(n), bleed=np.zeros(n))

        return self._tried(label, rng, draw, 0.15)

    def static(self, label: str, place: float, way: int, rng: np.random.Generator) -> GeneratedTest:
        """A slow ramp of the motor from where friction holds the piston, until it moves."""
        rig = self.rig
        factors = friction_tests.friction_factors(rng, self.scatter)
        plant = rig.plant(*factors)
        held = 0.8 * plant.static_friction / plant.spring_stiffness
        position = free_place(rig) + (place + rng.uniform(-0.1, 0.1)) * held
        n = round(friction_tests.RAMP_S / rig.row_period)
        ramp = way * rig.max_effort / friction_tests.RAMP_S * rig.row_period * np.arange(n)
        commands = Commands(rounded_effort(np.asarray(ramp), rig))
        limit = LIMIT * rig.half_travel
        states = simulated(rig, plant, commands, at_atmosphere(rig, position), (-limit, limit))
        counts = np.round(states[:, POSITION] / rig.position_per_count)
        moved = np.flatnonzero(counts != counts[0])
        if moved.size == 0:
            raise ValueError("the motor is too weak to break this rig away")
        last = int(moved[0]) + round(rng.uniform(0.3, 0.5) / rig.row_period)
        return self._logged(label, commands, states[:last], factors, rng)

    def logs(
        self, seed: int, duty_step: float, more: int, kinds: tuple[str, ...]
    ) -> list[GeneratedLog]:
        """The logs of these kinds; `more` motion tests beyond the least."""
        plan = [log for log in self._plan(duty_step, more) if log.kind in kinds]
        return [
            GeneratedLog(log.stem, log.kind, log.use, list(_made(log, seed)), log.valve)
            for log in plan
        ]

    def _plan(self, duty_step: float, more: int) -> Iterator[_Planned]:
        rig, noise = self.rig, self.noise
        has_motor = "motor" in rig.content
        if has_motor:
            ramps = [(p, w) for p in RAMP_PLACES for w in (1, -1) for _ in range(2)]
            yield _Planned(
                "friction_static", len(ramps), lambda i, t, r: self.static(t, *ramps[i], r)
            )
        move = self.motor if has_motor else self.pwm
        yield _Planned("friction_motion", 2 + more, lambda i, t, r: move(t, 8.0, r))
        yield _Planned(
            "valve_discrete_a",
            3,
            lambda i, t, r: valve_tests.discrete_test(rig, t, "a", noise, r),
            valve="a",
        )
        if rig.bleeds:
            yield from self._motions(more)
            return
        duties = [(d, f) for f in (True, False) for d in valve_tests.duties(duty_step)]
        yield _Planned(
            "valve_pwm_a",
            len(duties),
            lambda i, t, r: valve_tests.pwm_test(rig, t, "a", *duties[i], noise, r),
            valve="a",
        )
        yield from self._motions(more)

    def _motions(self, more: int) -> Iterator[_Planned]:
        for suffix, use, count in (("", "fit", 2 + more), ("_2", "holdout", 1)):
            if "motor" in self.rig.content:
                yield _Planned(
                    f"motion_motor{suffix}", count, lambda i, t, r: self.motor(t, 7.0, r), use
                )
            yield _Planned(f"motion_pwm{suffix}", count, lambda i, t, r: self.pwm(t, 7.0, r), use)
            yield _Planned(
                f"motion_discrete{suffix}", count, lambda i, t, r: self.discrete(t, 6.0, r), use
            )


@dataclasses.dataclass(frozen=True)
class _Planned:
    """A log of so many tests; `make` makes one by its number, label and random numbers."""

    stem: str
    count: int
    make: Callable[[int, str, np.random.Generator], GeneratedTest]
    use: str = "fit"
    valve: str | None = None

    @property
    def kind(self) -> str:
        words = self.stem.removesuffix("_2")
        return (words if self.valve is None else words[:-2]).replace("_", "-")


def _made(log: _Planned, seed: int) -> Iterator[GeneratedTest]:
    for i in range(log.count):
        yield log.make(i, str(i + 1), stream(seed, _STREAMS[log.stem], 1000 + i))


_STREAMS = {
    "friction_static": "friction-static",
    "friction_motion": "friction-motion",
    "valve_discrete_a": "valve-discrete-a",
    "valve_pwm_a": "valve-pwm-a",
    "motion_motor": "motion-motor-fit",
    "motion_motor_2": "motion-motor-holdout",
    "motion_pwm": "motion-pwm-fit",
    "motion_pwm_2": "motion-pwm-holdout",
    "motion_discrete": "motion-discrete-fit",
    "motion_discrete_2": "motion-discrete-holdout",
}


def make_one_chamber_campaign(
    seed: int,
    *,
    scatter: float = 0.02,
    motion: str | None = None,
    with_motor: bool | None = None,
    vacuum: bool = False,
    bleeds: bool = False,
    stiffer: float = 1.0,
    effects: tuple[Injected, ...] = (),
    duty_step: float = 0.06,
    more: int = 0,
    kinds: tuple[str, ...] = KINDS,
) -> GeneratedCampaign:
    """A campaign of a drawn one-chamber rig; arguments as in `random_one_chamber_rig` and
    `campaign.make_campaign`. Raises ValueError where a rig can make no test of a kind."""
    rng = stream(seed, "rig", 1000)
    rig = random_one_chamber_rig(rng, motion, with_motor, vacuum, bleeds, stiffer)
    rig = dataclasses.replace(rig, effects=effects)
    maker = _Maker(rig, scatter, rig.truth.pressure_noise_pa)
    logs = maker.logs(seed, duty_step, more, kinds)
    truth = rig.truth_content() | {"seed": seed, "scatter": scatter}
    truth["tests"] = {log.stem: {test.label: test.truth for test in log.tests} for log in logs}
    return GeneratedCampaign(rig, logs, truth)


def scaled(
    made: GeneratedCampaign, *, time: float = 1.0, area: float = 1.0, length: float = 1.0
) -> GeneratedCampaign:
    """The campaign of a rig that is so many times slower, wider and longer, by similarity.

    Pressures, angles and temperatures stay; efforts grow as the area (torques: times the length),
    flows as the volume over the time. So it is exact, undeclared effects included, which the truth
    lists with the values that they had before.
    """
    rig = made.rig
    effort = area if rig.is_linear else area * length
    way = length if rig.is_linear else 1.0
    flow = area * length / time
    factors = {
        "area_a_m2": area,
        "area_b_m2": area,
        "offset_a_m": length,
        "offset_b_m": length,
        "stroke_m": length,
        "pitch_radius_m": length,
        "equivalent_kg_m2": effort * time**2,
        "mass_kg": effort * time**2 / way,
        "stiffness_nm_per_rad": effort,
        "stiffness_n_per_m": effort / way,
        "encoder_counts_per_m": 1.0 / way,
        "c_fill": flow,
        "c_dis": flow,
        "choked_flow_fill_kg_s": flow,
        "choked_flow_dis_kg_s": flow,
    }
    efforts = ("preload", "torque_per_volt", "force_per_volt", "max_", "static", "coulomb", "motor")
    times = ("time_s", "period_s", "on_delay_s", "off_delay_s")

    def factor(name: str) -> float:
        if name.startswith(efforts):
            return effort
        if name.startswith("viscous"):
            return effort * time / way
        return time if name in times else factors.get(name, 1.0)

    def changed(table: dict[str, Any]) -> dict[str, Any]:
        return {
            k: float(f"{v * factor(k):.12g}") if factor(k) != 1.0 else v for k, v in table.items()
        }

    content = {section: changed(table) for section, table in rig.content.items()}
    truth = Truth(
        **{
            k: ValveTruth(**changed(v)) if isinstance(v, dict) else changed({k: v})[k]
            for k, v in dataclasses.asdict(rig.truth).items()
        }
    )
    factors["position_m"] = way
    logs = [
        dataclasses.replace(log, tests=[_scaled_test(t, factor) for t in log.tests])
        for log in made.logs
    ]
    now = GeneratedRig(content, truth, rig.effects)
    return GeneratedCampaign(now, logs, made.truth | now.truth_content())


def _scaled_test(test: GeneratedTest, factor: Callable[[str], float]) -> GeneratedTest:
    columns = {name: factor(name) * values for name, values in test.columns.items()}
    return dataclasses.replace(test, columns=columns)


__all__ = ["KINDS", "make_one_chamber_campaign", "random_one_chamber_rig", "scaled"]
