"""How the channels of logs are shown: title, unit and scale."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Channel:
    """How a channel is shown: in `unit` after `scale`, its residual in a separate unit."""

    key: str
    title: str
    unit: str
    scale: float
    residual_unit: str
    residual_scale: float

    def residual(self, value: float | None) -> float | None:
        """A value of the residual, in its shown unit."""
        return None if value is None else value * self.residual_scale


ACTUATOR_CHANNELS = (
    Channel("theta_rad", "Position", "rad", 1.0, "mrad", 1e3),
    Channel("position_m", "Position", "mm", 1e3, "mm", 1e3),
    Channel("pressure_a_pa", "Pressure A", "kPa", 1e-3, "kPa", 1e-3),
    Channel("pressure_b_pa", "Pressure B", "kPa", 1e-3, "kPa", 1e-3),
)


# Channels of parts on a bench.
_BENCH_CHANNELS = (
    Channel("motor_torque_nm", "Torque", "N·m", 1.0, "mN·m", 1e3),
    Channel("velocity_rad_per_s", "Speed", "rad/s", 1.0, "mrad/s", 1e3),
    Channel("motor_force_n", "Force", "N", 1.0, "N", 1.0),
    Channel("flow_a_kg_s", "Flow", "g/s", 1e3, "mg/s", 1e6),
    Channel("upstream_pressure_pa", "Pressure upstream", "kPa", 1e-3, "Pa", 1.0),
    Channel("flow_up_kg_s", "Flow, duty rising", "g/s", 1e3, "mg/s", 1e6),
    Channel("flow_down_kg_s", "Flow, duty falling", "g/s", 1e3, "mg/s", 1e6),
    Channel("log_time_to_pressure", "Logarithm of the time", "-", 1.0, "-", 1.0),
    Channel("log_time_filling", "Logarithm of the time, filling", "-", 1.0, "-", 1.0),
    Channel("log_time_emptying", "Logarithm of the time, emptying", "-", 1.0, "-", 1.0),
)


def channel_of(key: str) -> Channel:
    """How a channel is shown; one of a user's own component by its name, as it was logged."""
    known = {channel.key: channel for channel in (*ACTUATOR_CHANNELS, *_BENCH_CHANNELS)}
    return known.get(key) or Channel(key, key, "", 1.0, "", 1.0)
