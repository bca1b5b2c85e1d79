"""The functions of the header through which effects act: one a port of the model, and side."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from sysid.io.channels import SIDES

DIRECTION = "direction"
"""Name of the way of motion, which the functions work out from the velocity."""

ARGUMENTS = {
    "position": "position, rad (linear rig: m)",
    "velocity": "velocity, rad/s (linear rig: m/s)",
    "pressure_a_pa": "pressure in chamber A, Pa, absolute",
    "pressure_b_pa": "pressure in chamber B, Pa, absolute",
    "motor_command": "commanded effort of the motor, Nm (linear rig: N)",
    "open_a": "1 with valve A on, 0 with it off; averaged over a PWM period, its duty",
    "open_b": "1 with valve B on, 0 with it off; averaged over a PWM period, its duty",
    "duty_direction_a": "1 where the duty of valve A rose to its value, -1 fell, 0 neither",
    "duty_direction_b": "1 where the duty of valve B rose to its value, -1 fell, 0 neither",
    "time_s": "time since the start of the test, s",
}
"""What a port may read, in the order of the arguments, with what each one is."""


@dataclass(frozen=True)
class Port:
    """A function of the header: its name without prefix, arguments, and what it gives.

    `port` is that of `sysid.plant.ports.Effect`. The first argument is the value without
    effects, the others are there whatever acts. `channels` are the measured channels that a
    sensor's port changes and the function takes back, the last effect first.
    """

    name: str
    port: str
    arguments: tuple[str, ...]
    meaning: str
    side: str | None = None
    is_opening: bool = False
    channels: tuple[str, ...] = ()

    @property
    def feature(self) -> str:
        """The feature macro, without prefix."""
        return f"EFFECTS_ACT_ON_{self.name.upper()}"


def ports() -> Iterator[Port]:
    """Every function, in the order of the header."""
    yield Port(
        "sliding_friction",
        "friction_effort",
        ("friction", "position", "velocity", "pressure_a_pa", "pressure_b_pa"),
        "Friction while moving, Nm (linear rig: N), from that of the base law",
    )
    yield Port(
        "static_friction",
        "static_effort",
        ("friction",),
        "Friction at breakaway, Nm (linear rig: N), from that of the base law",
    )
    yield Port(
        "external",
        "external_effort",
        ("effort", "position", "velocity"),
        "Effort in the positive direction, Nm (linear rig: N), from that without effects",
    )
    yield Port(
        "motor",
        "motor_effort",
        ("effort",),
        "Effort of the motor, Nm (linear rig: N), from that of the base law",
    )
    yield Port(
        "pitch_radius",
        "pitch_radius",
        ("radius_m",),
        "Lever of the cylinder's force and rate of its displacement, m, from the pitch radius",
    )
    yield Port(
        "displacement",
        "displacement",
        ("displacement_m",),
        "Place of the piston, m, from pitch radius times position",
    )
    yield Port(
        "true_position",
        "measure",
        ("measured",),
        "Position, rad (linear rig: m), from what its sensor shows",
        channels=("theta_rad", "position_m"),
    )
    for side in SIDES:
        yield from _of_side(side, side.upper())


def _of_side(side: str, upper: str) -> Iterator[Port]:
    for name, argument, meaning in (
        ("supply_pressure", "supply_pa", f"Supply pressure at valve {upper}, Pa"),
        ("exhaust_pressure", "atmosphere_pa", f"Pressure that valve {upper} exhausts to, Pa"),
        ("filling_flow", "flow_kg_s", f"Flow into chamber {upper} through its open valve, kg/s"),
        ("exhaust_flow", "flow_kg_s", f"Flow into chamber {upper} through its shut valve, kg/s"),
    ):
        said = f"{meaning}, from that without effects"
        yield Port(f"{name}_{side}", name, (argument,), said, side)
    yield Port(
        f"chamber_flow_{side}",
        "chamber_flow",
        ("flow_kg_s", "pressure_a_pa", "pressure_b_pa"),
        f"Whole flow into chamber {upper}, kg/s, from that through its valve",
        side,
    )
    yield Port(
        f"pressure_rate_{side}",
        "pressure_rate",
        ("rate_pa_s", "flow_kg_s"),
        f"dP/dt of chamber {upper}, Pa/s, from that of its energy balance and its whole flow",
        side,
    )
    yield Port(
        f"true_pressure_{side}",
        "measure",
        ("measured_pa",),
        f"Pressure in chamber {upper}, Pa, absolute, from what its sensor shows",
        channels=(f"pressure_{side}_pa",),
    )
    for edge, moment in (("on", "opening"), ("off", "closing")):
        yield Port(
            f"valve_{side}_{edge}_delay",
            "delays",
            ("delay_s",),
            f"Delay of valve {upper} from command to {moment}, s, from the one without effects",
            side,
            is_opening=edge == "on",
        )


ACTED_ON = frozenset(port.port for port in ports()) | {"parameters"}
"""The ports of an effect that the header can hold."""
