"""A DC motor with gearbox, driven by volts; and the same behind a current-controlled drive.

    sysid fit campaign.toml --component geared_motor.py -o bundle.json

The component is chosen by the campaign's logs: `kind = "servo"` holds volts, current and angle,
`kind = "servo-axis"` the force of a drive and a position.
"""

import jax.numpy as jnp

from sysid.components import DynamicComponent, LogColumn, Parameter, Quantity, Term

# Speeds below which friction's sign is smoothed: the derivatives need a slope.
CREEP_RAD_PER_S, CREEP_M_PER_S = 0.02, 5e-4


def unbalance(state, inputs, values):
    """A load whose centre of mass is off the axis: gravity's torque over the angle."""
    torque = values["unbalance_nm"] * jnp.sin(state["angle"])
    return {"speed": -torque / values["inertia_kg_m2"]}


def stribeck(state, inputs, values):
    """Friction that is higher at low speed."""
    speed = state["speed"]
    share = jnp.exp(-((speed / values["stribeck_speed_rad_per_s"]) ** 2))
    torque = values["stribeck_nm"] * share * jnp.tanh(speed / CREEP_RAD_PER_S)
    return {"speed": -torque / values["inertia_kg_m2"]}


def drag(state, inputs, values):
    """Drag that grows with the square of speed."""
    torque = values["drag_nm_s2_per_rad2"] * jnp.abs(state["speed"]) * state["speed"]
    return {"speed": -torque / values["inertia_kg_m2"]}


class GearedMotor(DynamicComponent):
    """All numbers at the output shaft; the winding's inductance acts within one sample."""

    kind = "servo"
    title = "DC motor with gearbox"
    columns = {
        "volts": LogColumn("V", "input", lower=-30.0, upper=30.0),
        "current_a": LogColumn("A", "output"),
        "angle_rad": LogColumn("rad", "output"),
    }
    parameters = (
        Parameter("resistance_ohm", 1.0, "ohm", 0.05, 100.0),
        # Of a DC motor it is the torque constant too, Nm/A.
        Parameter("back_emf_v_s_per_rad", 0.5, "V*s/rad", 0.01, 20.0),
        Parameter("inertia_kg_m2", 0.02, "kg*m**2", 1e-5, 10.0),
        Parameter("coulomb_nm", 0.1, "N*m", 0.0, 50.0),
        Parameter("viscous_nm_s_per_rad", 0.01, "N*m*s/rad", 0.0, 50.0),
    )
    states = ("angle", "speed")
    terms = (
        Term(
            "unbalance",
            "a load whose centre of mass is off the axis",
            (Quantity("unbalance_nm", "Nm", 0.2, -20.0, 20.0, "largest torque of gravity"),),
            unbalance,
        ),
        Term(
            "stribeck",
            "friction that is higher at low speed",
            (
                Quantity("stribeck_nm", "Nm", 0.05, 0.0, 10.0, "excess at rest"),
                Quantity(
                    "stribeck_speed_rad_per_s",
                    "rad/s",
                    0.5,
                    0.05,
                    5.0,
                    "speed at which 1/e of it is left",
                    is_strength=False,
                    grid=(0.2, 0.5, 1.5),
                ),
            ),
            stribeck,
            tie_breaker="slow motion at constant volts",
        ),
        Term(
            "drag",
            "drag that grows with the square of speed",
            (Quantity("drag_nm_s2_per_rad2", "Nm*s**2/rad**2", 1e-3, -1.0, 1.0, "per speed^2"),),
            drag,
        ),
    )

    def start(self, first, rates, values):
        return {"angle": first["angle_rad"], "speed": rates["angle_rad"]}

    def current(self, state, inputs, values):
        emf = values["back_emf_v_s_per_rad"] * state["speed"]
        return (inputs["volts"] - emf) / values["resistance_ohm"]

    def derivative(self, state, inputs, values):
        speed = state["speed"]
        driven = values["back_emf_v_s_per_rad"] * self.current(state, inputs, values)
        friction = values["coulomb_nm"] * jnp.tanh(speed / CREEP_RAD_PER_S)
        friction += values["viscous_nm_s_per_rad"] * speed
        return {"angle": speed, "speed": (driven - friction) / values["inertia_kg_m2"]}

    def measure(self, state, inputs, values):
        return {"angle_rad": state["angle"], "current_a": self.current(state, inputs, values)}


def uneven_coulomb(state, inputs, values):
    """Coulomb friction that differs between the two directions."""
    force = values["uneven_n"] * jnp.abs(jnp.tanh(state["speed"] / CREEP_M_PER_S))
    return {"speed": -force / values["mass_kg"]}


def uneven_viscous(state, inputs, values):
    """Viscous friction that differs between the two directions."""
    return {"speed": -values["uneven_n_s_per_m"] * jnp.abs(state["speed"]) / values["mass_kg"]}


class ServoAxis(DynamicComponent):
    """Behind a drive that controls the current, the motor's force is known.

    The back-EMF is then the drive's to overcome, and does not show. The position drifts under
    friction, so that the fit simulates a second at a time.
    """

    kind = "servo-axis"
    title = "electric axis behind a current-controlled drive"
    columns = {
        "motor_force_n": LogColumn("N", "input"),
        "position_m": LogColumn("m", "output"),
    }
    parameters = (
        Parameter("mass_kg", 50.0, "kg", 0.1, 5000.0),
        Parameter("coulomb_n", 10.0, "N", 0.0, 1000.0),
        Parameter("viscous_n_s_per_m", 100.0, "N*s/m", 0.0, 10000.0),
        Parameter("offset_n", 0.0, "N", -100.0, 100.0, scale=1.0),
    )
    states = ("position", "speed")
    segment_s = 1.0
    terms = (
        Term(
            "uneven-coulomb",
            "Coulomb friction that differs between the directions",
            (Quantity("uneven_n", "N", 2.0, -500.0, 500.0, "half the difference"),),
            uneven_coulomb,
            tie_breaker="the drive's force at rest: an offset acts there too",
        ),
        Term(
            "uneven-viscous",
            "viscous friction that differs between the directions",
            (Quantity("uneven_n_s_per_m", "N*s/m", 20.0, -5e3, 5e3, "half the difference"),),
            uneven_viscous,
        ),
    )

    def start(self, first, rates, values):
        return {"position": first["position_m"], "speed": rates["position_m"]}

    def derivative(self, state, inputs, values):
        speed = state["speed"]
        friction = values["coulomb_n"] * jnp.tanh(speed / CREEP_M_PER_S)
        friction += values["viscous_n_s_per_m"] * speed + values["offset_n"]
        return {
            "position": speed,
            "speed": (inputs["motor_force_n"] - friction) / values["mass_kg"],
        }

    def measure(self, state, inputs, values):
        return {"position_m": state["position"]}
