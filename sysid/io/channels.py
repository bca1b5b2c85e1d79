"""The channels of logs, each declared once: its column in a file, its unit, how it is shown, and
whether a simulated motion is compared with a measured one in it.

What reads a log, maps a foreign file, checks a recording, fits motion and draws it follows
`CHANNELS`; how the model gives a compared channel is said in `plant/sensors.py`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

TEST_COLUMN = "test"
SIDES = ("a", "b")
"""Chamber, valve and pressure sensor A and B."""


@dataclass(frozen=True)
class Channel:
    """A channel of logs, or a quantity that a bench's residual is shown in.

    `key` is its column in the log format, `si` the unit there as pint writes it (None: text),
    `meaning` what the format says of it. It is shown as `title`, in `unit` after `scale`; its
    residual, resolution and noise in `residual_unit` after `residual_scale`. `is_reading`: a
    sensor's, next to those of motion and effort. `least_noise`: the noise of a sample that shows
    none, in the SI unit, of a channel that belongs to the likelihood of motion; None for one in
    which simulations are not compared.
    """

    key: str
    si: str | None
    meaning: str = ""
    title: str = ""
    unit: str = ""
    scale: float = 1.0
    residual_unit: str = ""
    residual_scale: float = 1.0
    is_reading: bool = False
    least_noise: float | None = None

    @property
    def is_pressure(self) -> bool:
        """Whether it is a pressure."""
        return self.si == "Pa"

    @property
    def name(self) -> str:
        """The title within a sentence; a column of a user's own as it is."""
        return self.title if self.title == self.key else self.title[:1].lower() + self.title[1:]

    def residual(self, value: float | None) -> float | None:
        """A value of the residual, in its shown unit."""
        return None if value is None else value * self.residual_scale


def _pressure(key: str, meaning: str, title: str, least_noise: float | None = None) -> Channel:
    shown = ("kPa", 1e-3)
    return Channel(key, "Pa", meaning, title, *shown, *shown, True, least_noise)


CHANNELS: tuple[Channel, ...] = (
    Channel("time_s", "s", "time, strictly increasing within a test"),
    Channel(TEST_COLUMN, None, "which test of this file the row belongs to, integer or text"),
    _pressure("pressure_a_pa", "pressure of chamber A", "Pressure A", 1.0),
    _pressure("pressure_b_pa", "pressure of chamber B", "Pressure B", 1.0),
    _pressure("supply_pressure_pa", "measured supply", "Supply"),
    Channel(
        "theta_rad", "rad", "angle of the output shaft, 0 in the middle of the stroke",
        "Position", "rad", 1.0, "mrad", 1e3, False, 1e-7,
    ),
    Channel(
        "velocity_rad_per_s", "rad/s",
        "measured speed of the shaft; of single readings, the settled one",
        "Speed", "rad/s", 1.0, "mrad/s", 1e3,
    ),
    Channel(
        "position_m", "m", "position of a linear rig, 0 in the middle of the stroke",
        "Position", "mm", 1e3, "mm", 1e3, False, 1e-7,
    ),
    Channel(
        "velocity_m_per_s", "m/s", "measured speed of a linear rig",
        "Speed", "mm/s", 1e3, "mm/s", 1e3,
    ),
    Channel("encoder_counts", "count", "the encoder's reading in place of the position"),
    *(
        Channel(
            f"valve_{side}", "dimensionless",
            f"on/off command of valve {side.upper()}: 1 connects the chamber to the supply, 0 to "
            "the exhaust",
            f"Valve {side.upper()}",
        )
        for side in SIDES
    ),
    *(
        Channel(
            f"duty_{side}", "dimensionless", f"PWM duty of valve {side.upper()}, 0 to 1",
            f"Duty {side.upper()}",
        )
        for side in SIDES
    ),
    *(
        Channel(
            f"{stem}_{side}_{valve}", "dimensionless",
            f"{command} of the valve that {does} chamber {side.upper()}, of two valves",
            f"{valve.capitalize()} {stem} {side.upper()}",
        )
        for stem, command in (("valve", "on/off command"), ("duty", "PWM duty"))
        for side in SIDES
        for valve, does in (("fill", "fills"), ("bleed", "empties"))
    ),
    Channel(
        "motor_torque_nm", "N*m", "torque of the motor at the output shaft",
        "Torque", "N·m", 1.0, "mN·m", 1e3,
    ),
    Channel(
        "motor_force_n", "N", "force of the motor, linear rigs",
        "Force", "N", 1.0, "N", 1.0,
    ),
    Channel(
        "motor_volts", "V", "the motor's command in place of its effort",
        "Motor voltage", "V", 1.0, "V", 1.0,
    ),
    Channel(
        "pump_volts", "V", "command of the pump that fills a tank",
        "Pump voltage", "V", 1.0, "V", 1.0,
    ),
    Channel("flow_a_kg_s", "kg/s", "settled flow through a valve", "Flow", "g/s", 1e3, "mg/s", 1e6),
    Channel(
        "upstream_pressure_pa", "Pa", "pressure before a valve or restriction",
        "Pressure upstream", "kPa", 1e-3, "Pa", 1.0,
    ),
    Channel(
        "downstream_pressure_pa", "Pa", "pressure behind a valve or restriction",
        "Pressure downstream", "kPa", 1e-3, "Pa", 1.0,
    ),
    Channel(
        "time_to_pressure_s", "s", "time that filling or emptying took",
        "Time to the pressure", "s", 1.0, "ms", 1e3,
    ),
    Channel("pwm_period_s", "s", "period of a reading's PWM"),
    Channel(
        "temperature_k", "K", "ambient temperature", "Temperature", "K", 1.0, "K", 1.0, True
    ),
)  # fmt: skip
LOG_COLUMNS = {channel.key: channel for channel in CHANNELS}

# What residuals of parts on a bench are shown in, and no log holds.
_OF_BENCHES = (
    Channel("flow_up_kg_s", "kg/s", "", "Flow, duty rising", "g/s", 1e3, "mg/s", 1e6),
    Channel("flow_down_kg_s", "kg/s", "", "Flow, duty falling", "g/s", 1e3, "mg/s", 1e6),
    *(
        Channel(f"log_time_{key}", None, "", f"Logarithm of the time{of}", "-", 1.0, "-", 1.0)
        for key, of in (
            ("to_pressure", ""),
            ("filling", ", filling"),
            ("emptying", ", emptying"),
        )
    ),
)
_SHOWN = {channel.key: channel for channel in (*CHANNELS, *_OF_BENCHES) if channel.title}

VELOCITY_CHANNELS = {"theta_rad": "velocity_rad_per_s", "position_m": "velocity_m_per_s"}
"""The channel of the speed that goes with a log's position channel."""
READINGS = tuple(c.key for c in CHANNELS if c.is_reading)
PRESSURES = tuple(key for key in READINGS if LOG_COLUMNS[key].is_pressure)
DUTIES = tuple(key for key in LOG_COLUMNS if key.startswith("duty_"))
SWITCHES = tuple(key for key in LOG_COLUMNS if key.startswith("valve_"))
VALVE_COMMANDS = (*SWITCHES, *DUTIES)
CHAMBER_PRESSURES = ("pressure_a_pa", "pressure_b_pa")
_STATES_SHOWN = (*VELOCITY_CHANNELS, *CHAMBER_PRESSURES)
COMPARED = (
    *CHAMBER_PRESSURES,
    *(c.key for c in CHANNELS if c.least_noise is not None and c.key not in _STATES_SHOWN),
)
"""What simulations are compared in next to the position, in the order of every array of them."""


def channel_of(key: str) -> Channel:
    """A channel as it is shown; one of a user's own component by its name, as it was logged."""
    return _SHOWN.get(key) or Channel(key, None, title=key)


def simulated_channels(position: str) -> tuple[str, ...]:
    """What a simulated motion is compared with a measured one in: the position, which the log calls
    `position`, and `COMPARED`."""
    return (position, *COMPARED)


def shown_of(keys: Iterable[str]) -> list[Channel]:
    """Those of these channels in which simulations are compared, position first."""
    present = set(keys)
    return [LOG_COLUMNS[key] for key in (*VELOCITY_CHANNELS, *COMPARED) if key in present]
