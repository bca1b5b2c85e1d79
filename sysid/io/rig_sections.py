"""The sections of the rig file, each key declared once (`docs/reference/log-format.md`).

Every value is SI and has the unit in its name. A section that a command does not need may
be absent (a purely electric axis has no `[cylinder]`); a section that is present must be
complete.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal, Self

from sysid.io.channels import SIDES
from sysid.io.declaration import (
    ChoiceKey,
    ListKey,
    NumberKey,
    Range,
    TemplateLine,
    TomlSection,
    WaysKey,
)
from sysid.types import FloatArray


class Air(TomlSection):
    """`[air]`: the gas, the ambient and the supply."""

    table: ClassVar[str] = "air"

    gas_constant_j_per_kg_k: Annotated[
        float,
        NumberKey(
            "Specific gas constant R.",
            Range(50.0, 5000.0, "J/(kg K)", "J/(kg K): 287.0 for air"),
            TemplateLine("287.0", "R of dry air"),
        ),
    ]
    heat_capacity_ratio: Annotated[
        float,
        NumberKey(
            "Ratio k of the heat capacities at constant pressure and at constant volume.",
            Range(1.0, 1.7, "1", "a ratio: 1.4 for air"),
            TemplateLine("1.4", "k"),
        ),
    ]
    temperature_k: Annotated[
        float,
        NumberKey(
            "Temperature of the room and the air supply.",
            Range(200.0, 400.0, "K", "kelvin: add 273.15 to degrees Celsius"),
            TemplateLine("293.15", "of the room and the air supply"),
        ),
    ]
    atmospheric_pressure_pa: Annotated[
        float,
        NumberKey(
            "Atmospheric pressure on the day of the tests, absolute.",
            Range(4e4, 1.2e5, "Pa", "absolute Pa: about 101325, not kPa or bar"),
            TemplateLine("101325.0", "on the day, absolute: read the barometer"),
        ),
    ]
    supply_pressure_pa: Annotated[
        float,
        NumberKey(
            "Supply pressure, absolute; below the atmosphere it is a vacuum supply.",
            Range(1e3, 5e6, "Pa", "absolute Pa: 3 bar gauge is 400000"),
            TemplateLine("600000.0", "absolute: a gauge that shows 5 bar means about 600000"),
        ),
    ]


Arrangement = Literal["3/2", "fill-and-bleed"]
FILL_AND_BLEED: Arrangement = "fill-and-bleed"

_OPEN_SIDE = {"area_b_m2": 1e-15, "offset_b_m": 1e18}
"""What stands for chamber B where the piston's other side is open to the atmosphere: a piston of no
area before a room, 1000 m3, whose pressure nothing changes."""


class Cylinder(TomlSection):
    """`[cylinder]`: chamber A is (offset_a + y) area_a, chamber B is (offset_b - y) area_b.

    `pitch_radius_m` is 1 on a linear rig, so that y is the position itself. Where `chambers` lists
    A alone, chamber B is the atmosphere.
    """

    table: ClassVar[str] = "cylinder"
    conditional: ClassVar[tuple[str, ...]] = tuple(_OPEN_SIDE)
    why_unused: ClassVar[str] = "the rig has no chamber B"

    @classmethod
    def without(cls, name: str, values: dict[str, Any]) -> Any:
        return None if "b" in values.get("chambers", SIDES) else _OPEN_SIDE.get(name)

    @classmethod
    def from_table(cls, table: dict[str, Any], source: str) -> Self:
        if table.get("chambers") == ["a"]:
            table = {name: value for name, value in table.items() if name not in _OPEN_SIDE}
        return super().from_table(table, source)

    area_a_m2: Annotated[
        float,
        NumberKey(
            "Piston area of chamber A.",
            Range(1e-7, 0.5, "m2", "m2: 452 mm2 is 4.52e-4"),
            TemplateLine("4.524e-4", "piston area of chamber A (bore 24 mm)"),
        ),
    ]
    area_b_m2: Annotated[
        float,
        NumberKey(
            "Piston area of chamber B, without the rod's.",
            Range(1e-7, 0.5, "m2", "m2: 452 mm2 is 4.52e-4"),
            TemplateLine("4.207e-4", "of chamber B: a rod makes it smaller"),
        ),
    ]
    offset_a_m: Annotated[
        float,
        NumberKey(
            "Length of chamber A at y = 0, dead volume included; above half the stroke.",
            Range(1e-5, 10.0, "m", "m: 75 mm is 0.075"),
            TemplateLine("0.075", "chamber A is (offset_a + y) area_a, dead volume included"),
        ),
    ]
    offset_b_m: Annotated[
        float,
        NumberKey(
            "Length of chamber B at y = 0, dead volume included; above half the stroke.",
            Range(1e-5, 10.0, "m", "m: 75 mm is 0.075"),
            TemplateLine("0.075", "chamber B is (offset_b - y) area_b"),
        ),
    ]
    stroke_m: Annotated[
        float,
        NumberKey(
            "Full stroke of the piston.",
            Range(1e-4, 10.0, "m", "m: 127 mm is 0.127"),
            TemplateLine("0.127", "y runs from -stroke/2 to +stroke/2"),
        ),
    ]
    pitch_radius_m: Annotated[
        float,
        NumberKey(
            "Radius that turns angle into piston travel, y = theta * pitch_radius; rotary rigs "
            "only, and required there.",
            Range(1e-4, 2.0, "m", "m: 37.5 mm is 0.0375"),
            TemplateLine("0.0375", "y = theta * pitch_radius (radius, not diameter)", "rotary"),
        ),
    ] = 1.0
    chambers: Annotated[
        tuple[str, ...],
        ListKey(
            'The chambers that there are: ["a"] where the piston\'s other side is open to the '
            "atmosphere.",
            (SIDES[:1], SIDES),
        ),
    ] = SIDES

    def chamber_length(self, position: FloatArray, side: str) -> FloatArray:
        """Length (n,) of a side's chamber, m, at positions (n,), rad or m; dead volume included."""
        y = self.pitch_radius_m * position
        return self.offset_a_m + y if side == "a" else self.offset_b_m - y


class Spring(TomlSection):
    """`[spring]`: a return spring, which pushes the piston back to where the supply moves it from.

    That end is where chamber A is smallest; with a vacuum supply, where it is largest.
    """

    table: ClassVar[str] = "spring"

    stiffness_nm_per_rad: Annotated[
        float | None,
        NumberKey(
            "Stiffness of the return spring at the output; rotary rigs, and required there.",
            Range(0.0, 1e6, "Nm/rad", "Nm/rad at the output"),
        ),
    ] = None
    preload_nm: Annotated[
        float,
        NumberKey(
            "Torque of the return spring at the end to which it returns the piston; rotary rigs.",
            Range(-1e6, 1e6, "Nm"),
        ),
    ] = 0.0
    stiffness_n_per_m: Annotated[
        float | None,
        NumberKey(
            "Stiffness of the return spring; linear rigs, and required there.",
            Range(0.0, 1e8, "N/m", "N/m: 1 N/mm is 1000"),
        ),
    ] = None
    preload_n: Annotated[
        float,
        NumberKey(
            "Force of the return spring at the end to which it returns the piston; linear rigs.",
            Range(-1e7, 1e7, "N"),
        ),
    ] = 0.0


class Inertia(TomlSection):
    """`[inertia]`: the equivalent inertia, or the masses and lengths that give it."""

    table: ClassVar[str] = "inertia"

    equivalent_kg_m2: Annotated[
        float | None,
        NumberKey(
            "Total inertia at the output shaft without payload, instead of masses and lengths.",
            Range(1e-8, 1e4, "kg m2"),
            TemplateLine(
                "0.02368",
                "at the output shaft, without payload; or instead of it:",
                motion="rotary",
            ),
        ),
    ] = None
    mass_kg: Annotated[
        float | None,
        NumberKey(
            "Mass of all moving parts, without payload; linear rigs.",
            Range(1e-4, 1e5, "kg"),
            TemplateLine("1.2", "all moving parts, without payload", "linear"),
        ),
    ] = None
    arm_mass_kg: Annotated[
        float | None,
        NumberKey(
            "Mass of the arm, a uniform bar; needed for gravity in the vertical.",
            Range(0.0, 1e4, "kg"),
            TemplateLine(
                "0.30",
                "(these three are needed for gravity in the vertical)",
                motion="rotary",
                optional=True,
            ),
        ),
    ] = None
    arm_length_m: Annotated[
        float | None,
        NumberKey(
            "Length of the arm; needed for gravity in the vertical.",
            Range(0.0, 20.0, "m"),
            TemplateLine("0.46", motion="rotary", optional=True),
        ),
    ] = None
    block_mass_kg: Annotated[
        float | None,
        NumberKey(
            "Mass of the parts that move with the piston, at the pitch radius.",
            Range(0.0, 1e4, "kg"),
            TemplateLine("0.50", motion="rotary", optional=True),
        ),
    ] = None
    payload_mass_kg: Annotated[
        float,
        NumberKey(
            "Mass of the payload.",
            Range(0.0, 1e4, "kg"),
            TemplateLine("0.0"),
        ),
    ] = 0.0
    payload_length_m: Annotated[
        float,
        NumberKey(
            "Distance of the payload from the shaft; required with a payload on a rotary rig.",
            Range(0.0, 20.0, "m"),
            TemplateLine("0.370", "from the shaft to the payload", "rotary"),
        ),
    ] = 0.0


class Motor(TomlSection):
    """`[motor]`: torque (linear: force) at the output per volt of command, and its limit."""

    table: ClassVar[str] = "motor"

    torque_per_volt_nm: Annotated[
        float | None,
        NumberKey(
            "Torque at the output per volt of command; rotary rigs.",
            Range(1e-9, 1e6, "Nm/V", "Nm/V, positive"),
            TemplateLine(
                "0.0795",
                "torque constant x amplifier gain x gear ratio, at the output",
                motion="rotary",
            ),
        ),
    ] = None
    max_torque_nm: Annotated[
        float | None,
        NumberKey(
            "Largest torque of the drive at the output; rotary rigs.",
            Range(1e-6, 1e6, "Nm", "Nm, positive"),
            TemplateLine("0.795", "the drive's largest torque at the output", "rotary"),
        ),
    ] = None
    force_per_volt_n: Annotated[
        float | None,
        NumberKey(
            "Force at the output per volt of command; linear rigs.",
            Range(1e-9, 1e7, "N/V", "N/V, positive"),
            TemplateLine("35.0", motion="linear"),
        ),
    ] = None
    max_force_n: Annotated[
        float | None,
        NumberKey(
            "Largest force of the drive at the output; linear rigs.",
            Range(1e-6, 1e7, "N", "N, positive"),
            TemplateLine("200.0", motion="linear"),
        ),
    ] = None


class Pwm(TomlSection):
    """`[pwm]`: a period starts at every multiple of `period_s` from a test's first row."""

    table: ClassVar[str] = "pwm"

    period_s: Annotated[
        float,
        NumberKey(
            "Period of the pulse-width modulation; the pulse is on for duty * period_s.",
            Range(1e-5, 5.0, "s", "s: 5 ms is 0.005"),
            TemplateLine("0.005", "starts at every multiple from a test's first row"),
        ),
    ]


class Valves(TomlSection):
    """`[valves]`: which there are, and declared delays from command to opening and to closing."""

    table: ClassVar[str] = "valves"

    arrangement: Annotated[
        Arrangement,
        ChoiceKey(
            'One 3/2 valve a chamber, or two on/off valves: "fill-and-bleed", both off is shut.',
            ("3/2", "fill-and-bleed"),
        ),
    ] = "3/2"

    on_delay_s: Annotated[
        float,
        NumberKey(
            "Delay from command to opening.",
            Range(0.0, 0.5, "s", "s: 1.7 ms is 0.0017"),
            TemplateLine("0.0017", "command to opening"),
        ),
    ]
    off_delay_s: Annotated[
        float,
        NumberKey(
            "Delay from command to closing.",
            Range(0.0, 0.5, "s", "s: 2 ms is 0.002"),
            TemplateLine("0.0020", "command to closing"),
        ),
    ]


class ValveSheet(TomlSection):
    """`[valve_a]`, `[valve_b]`: a data sheet's flow, taken where no test identifies a valve's.

    Numbers of ISO 6358, each of filling and of the exhaust; or, of a valve with a flow control in
    series ("thesis-series"), the coefficients of the thesis' law of the valve alone.
    """

    conditional: ClassVar[tuple[str, ...]] = (
        "sonic_conductance_m3_per_s_pa",
        "critical_ratio",
        "valve_c_fill",
        "valve_c_dis",
    )

    law: Annotated[
        str,
        ChoiceKey(
            "The flow law that the data sheet's numbers belong to.", ("iso6358", "thesis-series")
        ),
    ]
    sonic_conductance_m3_per_s_pa: Annotated[
        Any,
        WaysKey(
            "Sonic conductance C at the reference atmosphere ANR, by direction.",
            Range(1e-12, 1e-5, "m3/(s Pa)", "m3/(s Pa): 1 dm3/(s bar) is 1e-8"),
        ),
    ]
    critical_ratio: Annotated[
        Any, WaysKey("Critical pressure ratio b, by direction.", Range(0.0, 0.95, "1", "a ratio"))
    ]
    subsonic_index: Annotated[
        Any, WaysKey("Subsonic index m, by direction.", Range(0.2, 0.95, "1", "an exponent"))
    ] = (0.5, 0.5)
    valve_c_fill: Annotated[
        float,
        NumberKey(
            "Unchoked filling coefficient of the valve without its flow control.",
            Range(1e-10, 1e-3, "kg/(s Pa^0.5)", "kg/(s Pa^0.5): 2.3e-6 of a small valve"),
        ),
    ]
    valve_c_dis: Annotated[
        float,
        NumberKey(
            "Unchoked exhaust coefficient of the valve without its flow control.",
            Range(1e-13, 1e-5, "kg/(s Pa)", "kg/(s Pa): 4e-9 of a small valve"),
        ),
    ]

    @classmethod
    def without(cls, name: str, values: dict[str, Any]) -> Any:
        """Numbers of the law that is not declared are none."""
        if name not in cls.conditional:
            return None
        of_series = name.startswith("valve_c")
        return None if of_series == (values.get("law") == "thesis-series") else math.nan


class ValveASheet(ValveSheet):
    """`[valve_a]`."""

    __doc__ = ValveSheet.__doc__
    table: ClassVar[str] = "valve_a"


class ValveBSheet(ValveSheet):
    """`[valve_b]`."""

    __doc__ = ValveSheet.__doc__
    table: ClassVar[str] = "valve_b"


class Tank(TomlSection):
    """`[tank]`: a vessel without a piston; flows scale with an error of its volume."""

    table: ClassVar[str] = "tank"

    volume_m3: Annotated[
        float,
        NumberKey(
            "Volume of the vessel with its fittings.",
            Range(1e-9, 1e3, "m3", "m3: 1 litre is 0.001"),
        ),
    ]


class Sampling(TomlSection):
    """`[sampling]`: the declared sampling period."""

    table: ClassVar[str] = "sampling"

    period_s: Annotated[
        float,
        NumberKey(
            "Time from one row of a log to the next.",
            Range(1e-6, 10.0, "s", "s: 1 ms is 0.001"),
            TemplateLine("0.001"),
        ),
    ]


class Sensors(TomlSection):
    """`[sensors]`: optional; missing values are taken from the data."""

    table: ClassVar[str] = "sensors"

    encoder_counts_per_rev: Annotated[
        float | None,
        NumberKey(
            "Encoder counts per revolution of the output; rotary rigs.",
            Range(1.0, 1e9, "count/rev", "counts per revolution"),
            TemplateLine("80000", motion="rotary", optional=True),
        ),
    ] = None
    encoder_counts_per_m: Annotated[
        float | None,
        NumberKey(
            "Encoder counts per metre of travel; linear rigs.",
            Range(1.0, 1e12, "count/m", "counts per metre"),
            TemplateLine("200000", motion="linear", optional=True),
        ),
    ] = None
    encoder_zero_counts: Annotated[
        float,
        NumberKey(
            "Encoder reading at zero angle or position.",
            Range(-1e12, 1e12, "count", "counts"),
            TemplateLine("0", optional=True),
        ),
    ] = 0.0
    pressure_noise_pa: Annotated[
        float | None,
        NumberKey(
            "Standard deviation of the noise of the chamber pressures.",
            Range(0.0, 1e5, "Pa"),
            TemplateLine("250.0", "one standard deviation", optional=True),
        ),
    ] = None


__all__ = [
    "FILL_AND_BLEED",
    "Air",
    "Cylinder",
    "Inertia",
    "Motor",
    "Pwm",
    "Sampling",
    "Sensors",
    "Spring",
    "Tank",
    "Valves",
]
