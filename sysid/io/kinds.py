"""The kinds of tests that a campaign's logs hold, each declared once.

What follows of a kind, the template's entry, what its logs are known by, who fits it, is read off
this table; how it is fitted is said in its own room (a part on a bench: `diagnosis/bench/`).
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass
from typing import Literal

Group = Literal["friction", "valve", "motion", "bench"]


@dataclass(frozen=True)
class TestKind:
    """A kind of test: what a log of it holds (`docs/reference/log-format.md`), in a line.

    `of_a_valve`: its logs name the valve that was tested; `balances`: force or torque are balanced
    with the motion, row by row; `column`: one that logs of this kind alone have; `optional`: not
    every rig has it.
    """

    # pytest must not take this for a test.
    __test__ = False

    name: str
    group: Group
    content: str
    of_a_valve: bool = False
    balances: bool = False
    column: str | None = None
    optional: bool = False


FRICTION_POINTS = "friction-points"
FRICTION_MOTION = "friction-motion"
BY_MOTOR = "motion-motor"
TEST_KINDS = (
    TestKind(
        "friction-static",
        "friction",
        "torque ramped slowly from zero until the shaft moves; several positions",
    ),
    TestKind(
        "friction-sliding",
        "friction",
        "constant torque after a start; at least two levels, both directions",
    ),
    TestKind(
        FRICTION_MOTION,
        "friction",
        "any motion with a known motor torque",
        balances=True,
        optional=True,
    ),
    TestKind(
        "valve-discrete",
        "valve",
        "piston held at an end; valve off, on at about 1 s, off again at about 4 s",
        of_a_valve=True,
    ),
    TestKind(
        "valve-pwm",
        "valve",
        "piston held at an end; one test per duty, filling and discharging",
        of_a_valve=True,
    ),
    TestKind(
        BY_MOTOR,
        "motion",
        "valves off, chambers open; a clipped sine of motor torque",
        balances=True,
    ),
    TestKind("motion-pwm", "motion", "clipped sines of both duties, with or without the motor"),
    TestKind("motion-discrete", "motion", "on/off sequences of both valves"),
    TestKind(
        "tank",
        "bench",
        "a tank without a piston: how its pressure falls through a valve or a port",
        column="pump_volts",
        optional=True,
    ),
    TestKind(
        "valve-flow",
        "bench",
        "a valve or restriction on a bench: settled flow over duty, or over its two pressures",
        column="flow_a_kg_s",
        optional=True,
    ),
    TestKind(
        "valve-time",
        "bench",
        "a valve on a bench: time to a pressure over duty",
        column="time_to_pressure_s",
        optional=True,
    ),
    TestKind(FRICTION_POINTS, "bench", "single readings of friction", optional=True),
)


def _of(group: Group) -> tuple[str, ...]:
    return tuple(kind.name for kind in TEST_KINDS if kind.group == group)


KINDS = tuple(kind.name for kind in TEST_KINDS)
FRICTION_KINDS, MOTION_KINDS, BENCH_KINDS = _of("friction"), _of("motion"), _of("bench")
VALVE_KINDS = _of("valve")
"""Kinds of test in which the piston is held."""
SIMULATED_KINDS = (*MOTION_KINDS, FRICTION_MOTION)
"""Kinds of motion that a model can be simulated along."""
BALANCED_KINDS = tuple(kind.name for kind in TEST_KINDS if kind.balances)
KIND_BY_COLUMN = {kind.column: kind.name for kind in TEST_KINDS if kind.column is not None}
"""Columns that logs of one kind alone have."""
_SETTLED_OVER = {
    "flow_a_kg_s": ({"upstream_pressure_pa", "downstream_pressure_pa"}, {"duty_a"}),
    "time_to_pressure_s": ({"duty_a"},),
}
READ_BY_ROW = (FRICTION_POINTS, *(KIND_BY_COLUMN[name] for name in _SETTLED_OVER))
"""Kinds of test of which each row is a reading by itself, so that they need no time."""


def settled_kind(present: Set[str]) -> str | None:
    """The kind of a bench's table, each row of which is a reading by itself; None of any other."""
    for name, over in _SETTLED_OVER.items():
        if name in present and any(names <= present for names in over):
            return KIND_BY_COLUMN[name]
    return None


def settled_line(where: object, kind: str) -> str:
    """The notice of such a table without time."""
    return f"{where}: holds no time: each row is a reading by itself ({kind})"


__all__ = [
    "BALANCED_KINDS",
    "BENCH_KINDS",
    "BY_MOTOR",
    "FRICTION_KINDS",
    "FRICTION_MOTION",
    "FRICTION_POINTS",
    "KINDS",
    "KIND_BY_COLUMN",
    "MOTION_KINDS",
    "READ_BY_ROW",
    "SIMULATED_KINDS",
    "TEST_KINDS",
    "VALVE_KINDS",
    "TestKind",
    "settled_kind",
    "settled_line",
]
