"""Names of a log's channels that come in pairs, and the two sides that they belong to."""

from __future__ import annotations

SIDES = ("a", "b")
"""Chamber, valve and pressure sensor A and B."""

CHAMBER_PRESSURES = ("pressure_a_pa", "pressure_b_pa")
PRESSURES = (*CHAMBER_PRESSURES, "supply_pressure_pa")


def simulated_channels(position: str) -> tuple[str, ...]:
    """What a simulated motion is compared with a measured one in, in the order of every array of
    them: position, which the log calls `position`, and chamber pressures."""
    return (position, *CHAMBER_PRESSURES)


VELOCITY_CHANNELS = {"theta_rad": "velocity_rad_per_s", "position_m": "velocity_m_per_s"}
"""The channel of the speed that goes with a log's position channel."""

_OF_TWO_VALVES = ("a_fill", "a_bleed", "b_fill", "b_bleed")
DUTIES = ("duty_a", "duty_b", *(f"duty_{name}" for name in _OF_TWO_VALVES))
SWITCHES = ("valve_a", "valve_b", *(f"valve_{name}" for name in _OF_TWO_VALVES))
VALVE_COMMANDS = (*SWITCHES, *DUTIES)
