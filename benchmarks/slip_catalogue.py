"""Slips of unit, column, time and sign, by kind: what each does to a log, and what names it.

A slip is drawn with a seed: the kind, the channel and the factor for one log of a campaign.
`SLIPS` is what `docs/slips.md` lists; `shown` says where a slip can be seen at all.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from benchmarks.slip_changes import FrameChange, only_time, scaled, spiked, swapped

ONE, TWO, NOTHING = "one log", "two logs", "nothing"
MOVING = ("friction-sliding", "friction-motion", "motion-motor", "motion-pwm", "motion-discrete")
VALVES = ("valve-discrete", "valve-pwm")
FRICTION = ("friction-static", "friction-sliding", "friction-motion")
MOTOR = (*FRICTION, "motion-motor")
DRIVEN = ("motion-motor", "motion-pwm", "motion-discrete", "friction-motion")
PRESSURES = ("pressure_a_pa", "pressure_b_pa")


@dataclass(frozen=True)
class LogOfSlip:
    """What a slip may know of the log: its kind, its valve, and the rig."""

    kind: str
    valve: str | None
    linear: bool
    ambient: float
    per_volt: float

    @property
    def position(self) -> str:
        return "position_m" if self.linear else "theta_rad"

    @property
    def effort(self) -> str:
        return "motor_force_n" if self.linear else "motor_torque_nm"


Change = Callable[[pd.DataFrame, LogOfSlip, float], pd.DataFrame]


@dataclass(frozen=True)
class Kind:
    """One kind of slip: `factors` it is drawn with, the kinds of log it applies to, and the words
    (a regular expression) of a notice that names it."""

    name: str
    group: str
    logs: tuple[str, ...]
    change: Change
    words: str
    shown: str = ONE
    factors: tuple[float, ...] = (1.0,)
    linear_factors: tuple[float, ...] | None = None


def of_every_log(change: FrameChange) -> Change:
    """A change that asks neither for the log's kind nor for a factor."""
    return lambda frame, log, _: change(frame)


def position(frame: pd.DataFrame, log: LogOfSlip, factor: float) -> pd.DataFrame:
    return scaled(log.position, factor)(frame)


def shifted(frame: pd.DataFrame, log: LogOfSlip, factor: float) -> pd.DataFrame:
    return scaled(log.position, 1.0, factor)(frame)


def effort(frame: pd.DataFrame, log: LogOfSlip, factor: float) -> pd.DataFrame:
    return scaled(log.effort, factor)(frame)


def volts(frame: pd.DataFrame, log: LogOfSlip, _: float) -> pd.DataFrame:
    return scaled(log.effort, 1.0 / log.per_volt)(frame)


def both_pressures(frame: pd.DataFrame, log: LogOfSlip, factor: float) -> pd.DataFrame:
    for name in PRESSURES:
        frame = scaled(name, factor)(frame)
    return frame


def one_pressure(frame: pd.DataFrame, log: LogOfSlip, factor: float) -> pd.DataFrame:
    return scaled(f"pressure_{log.valve or 'a'}_pa", factor)(frame)


def ambient(frame: pd.DataFrame, log: LogOfSlip, factor: float) -> pd.DataFrame:
    for name in PRESSURES:
        frame = scaled(name, 1.0, factor * log.ambient)(frame)
    return frame


def duty(frame: pd.DataFrame, log: LogOfSlip, factor: float) -> pd.DataFrame:
    for name in ("duty_a", "duty_b"):
        frame = scaled(name, factor)(frame)
    return frame


def inverted(frame: pd.DataFrame, log: LogOfSlip, _: float) -> pd.DataFrame:
    for name in ("duty_a", "duty_b", "valve_a", "valve_b"):
        if name in frame and np.ptp(frame[name]) > 0.0:
            frame = scaled(name, -1.0, 1.0)(frame)
    return frame


def swapped_commands(frame: pd.DataFrame, log: LogOfSlip, _: float) -> pd.DataFrame:
    for stem in ("valve", "duty"):
        frame = swapped(f"{stem}_a", f"{stem}_b")(frame)
    return frame


def twice_a(frame: pd.DataFrame, log: LogOfSlip, _: float) -> pd.DataFrame:
    return frame.assign(pressure_b_pa=frame["pressure_a_pa"]) if "pressure_a_pa" in frame else frame


def spiked_pressure(frame: pd.DataFrame, log: LogOfSlip, factor: float) -> pd.DataFrame:
    return spiked("pressure_a_pa", factor)(frame)


def speed(frame: pd.DataFrame, log: LogOfSlip, _: float) -> pd.DataFrame:
    if log.position not in frame:
        return frame
    return frame.assign(**{log.position: np.gradient(frame[log.position], frame["time_s"])})


def effort_as_position(frame: pd.DataFrame, log: LogOfSlip, _: float) -> pd.DataFrame:
    return frame.assign(**{log.position: frame[log.effort]}) if log.effort in frame else frame


def size_of(name: str) -> Change:
    def change(frame: pd.DataFrame, log: LogOfSlip, _: float) -> pd.DataFrame:
        column = getattr(log, name)
        return frame.assign(**{column: frame[column].abs()}) if column in frame else frame

    return change


def time(frame: pd.DataFrame, log: LogOfSlip, factor: float) -> pd.DataFrame:
    return scaled("time_s", factor)(frame)


def rows_dropped(frame: pd.DataFrame, log: LogOfSlip, factor: float) -> pd.DataFrame:
    """Every so manieth row kept, with the times of as many rows from each test's start."""
    parts = []
    groups = [frame] if "test" not in frame else [g for _, g in frame.groupby("test", sort=False)]
    for group in groups:
        kept = group.iloc[:: int(factor)].copy()
        kept["time_s"] = group["time_s"].to_numpy()[: len(kept)]
        parts.append(kept)
    return pd.concat(parts, ignore_index=True)


_DEG = 180.0 / np.pi
TIME_WORDS = r"sampled every|per row|time base|rows are left out"
POSITION_WORDS = r"position_m|theta_rad|end stops|encoder"
SIGN_WORDS = r"sign|reversed|swapped"
PRESSURE_WORDS = r"pressure|gauge|atmosphere|unit"

KINDS: tuple[Kind, ...] = (
    Kind("position in another unit", "unit", (*FRICTION, *DRIVEN, *VALVES), position,
         POSITION_WORDS, factors=(_DEG, 0.5 / np.pi, 1e3, 200.0 / np.pi),
         linear_factors=(1e3, 1e2, 1e6, 39.3701)),
    Kind("position scaled", "unit", (*FRICTION, *DRIVEN, *VALVES), position, POSITION_WORDS,
         factors=(2.0, 0.5, 3.0, 4.0, 0.25, 1.5)),
    Kind("pressures in another unit", "unit", (*MOVING, *VALVES), both_pressures, PRESSURE_WORDS,
         factors=(1e-3, 1e-5, 1e-6, 1e-2, 1.0 / 6894.757, 1.0 / 133.322)),
    Kind("one pressure in another unit", "unit", (*MOVING, *VALVES), one_pressure, PRESSURE_WORDS,
         factors=(1e-3, 1e-5, 1e-2, 1.0 / 6894.757)),
    Kind("gauge pressures", "unit", (*MOVING, *VALVES), ambient, PRESSURE_WORDS, factors=(-1.0,)),
    Kind("atmosphere added twice", "unit", (*MOVING, *VALVES), ambient, r"twice|at rest",
         factors=(1.0,)),
    Kind("effort in milli or centi units", "unit", MOTOR, effort, r"motor_(torque|force)",
         factors=(1e3, 1e2)),
    Kind("volts for effort", "unit", MOTOR, volts, r"motor_volts|motor_(torque|force)"),
    Kind("effort scaled", "unit", ("friction-sliding", "friction-motion", "motion-motor"), effort,
         r"motor_(torque|force)|effort", shown=TWO, factors=(0.5, 0.4, 2.0, 2.5)),
    Kind("duty in percent or counts", "unit", ("valve-pwm", "motion-pwm"), duty, r"duty",
         factors=(100.0, 255.0, 1000.0, 4095.0)),
    Kind("chambers swapped", "column", (*MOVING, *VALVES),
         of_every_log(swapped(*PRESSURES)), r"swapped"),
    Kind("valve commands swapped", "column", (*VALVES, "motion-pwm", "motion-discrete"),
         swapped_commands, r"swapped"),
    Kind("one pressure under both names", "column", (*MOVING, *VALVES), twice_a,
         r"same values|swapped"),
    Kind("effort and position exchanged", "column",
         ("friction-sliding", "friction-motion", "motion-motor"), effort_as_position,
         r"theta_rad|position_m|same values"),
    Kind("speed for position", "column", ("friction-motion", "motion-motor", "motion-pwm"), speed,
         r"theta_rad|position_m|end stops|encoder"),
    Kind("effort zero", "column", MOTOR, lambda f, g, x: effort(f, g, 0.0),
         r"motor_(torque|force)"),
    Kind("every channel but the time held", "column", (*FRICTION, "motion-motor", *VALVES),
         of_every_log(only_time), r"constant"),
    Kind("one sample of 1.2 MPa", "column", (*MOVING, *VALVES), spiked_pressure,
         r"single sample", factors=(1.2e6,)),
    Kind("time scaled", "time", (*FRICTION, *DRIVEN, *VALVES), time, TIME_WORDS,
         factors=(1.5, 2.0, 10.0, 0.5, 0.1, 60.0, 1e3, 1e6)),
    Kind("rows left out, times kept", "time", ("friction-motion", *DRIVEN, *VALVES), rows_dropped,
         TIME_WORDS, shown=TWO, factors=(2.0, 3.0, 5.0)),
    Kind("effort reversed", "sign", (*MOTOR, "motion-motor"), lambda f, g, x: effort(f, g, -1.0),
         SIGN_WORDS),
    Kind("position reversed", "sign", (*FRICTION, *DRIVEN), lambda f, g, x: position(f, g, -1.0),
         SIGN_WORDS),
    Kind("position without its sign", "sign", ("friction-motion", "motion-motor", "motion-pwm"),
         size_of("position"), SIGN_WORDS),
    Kind("effort without its sign", "sign", ("friction-motion", "motion-motor"),
         size_of("effort"), SIGN_WORDS),
    Kind("valve commands inverted", "sign", (*VALVES, "motion-discrete"), inverted,
         r"inverted|falls"),
    Kind("position shifted", "unit", ("friction-static", "valve-discrete"), shifted,
         r"end stops", shown=NOTHING, factors=(0.3, -0.3), linear_factors=(0.01, -0.01)),
    Kind("effort of the breakaway ramps scaled", "unit", ("friction-static",), effort,
         r"motor_(torque|force)", shown=NOTHING, factors=(0.8, 1.25)),
)  # fmt: skip

# Key of the rig file (a regular expression), factor, and the words of a notice that names it.
RIG_SLIPS: dict[str, tuple[str, float, str]] = {
    "pitch diameter for pitch radius": ("pitch_radius_m", 2.0, r"pitch|end stops"),
    "pitch radius in mm": ("pitch_radius_m", 1e3, r"pitch"),
    "areas four times too large (diameter for radius)": (r"area_[ab]_m2", 4.0, r"areas"),
    "areas a quarter": (r"area_[ab]_m2", 0.25, r"areas"),
    "areas in cm2": (r"area_[ab]_m2", 1e4, r"area"),
    "inertia in kg cm2 (mass in g)": (r"(?:equivalent_kg_m2|mass_kg)", 1e4, r"inertia"),
    "inertia x 10": (r"(?:equivalent_kg_m2|mass_kg)", 10.0, r"inertia"),
    "inertia x 0.1": (r"(?:equivalent_kg_m2|mass_kg)", 0.1, r"inertia"),
    "supply in kPa": ("supply_pressure_pa", 1e-3, r"supply"),
    "supply as a gauge pressure": ("supply_pressure_pa", 0.67, r"supply"),
    "atmosphere in kPa": ("atmospheric_pressure_pa", 1e-3, r"atmospheric"),
    "stroke in mm": ("stroke_m", 1e3, r"stroke"),
    "encoder counts before decoding (a quarter)": (r"encoder_counts_per_\w+", 0.25, r"encoder"),
    "sampling period in ms": ("period_s", 1e3, r"sampled every|period"),
}
_EVERY_WORD = re.compile(
    "|".join(
        (
            "end stops|motor_volts|single sample|twice|swapped|sampled every|per row|inverted",
            "time base|same values|either a slip|reversed|resolved in steps|its sign is missing",
            "below the Coulomb friction of|take energy out|hold the same|one of the two is wrong",
            "is wrong by|though no valve opens|jumps|wraps around|a fresh one comes|too slow",
            "too far apart|opposite sign|do not belong to one motion|times as far as",
        )
    )
)


def names_a_slip(notice: str) -> bool:
    """Whether a notice says that a unit, a column, the time or a sign may be wrong."""
    return _EVERY_WORD.search(notice) is not None
