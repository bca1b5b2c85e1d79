"""A single-acting cylinder that a spring returns, on a proportional valve.

sysid fit campaign.toml --component spring_return_cylinder.py -o bundle.json
"""

import jax.numpy as jnp

from sysid.components import DynamicComponent, LogColumn, Parameter, Quantity, Term

# What the data sheets say: SI, absolute pressures.
AREA, STROKE_VOLUME_AT_0, MASS = 4.9e-4, 1.5e-5, 0.4
SUPPLY, ATMOSPHERE, GAS = 6.0e5, 1.0e5, 287.0 * 293.15
POLYTROPIC, CRITICAL_RATIO = 1.2, 0.35
CREEP_M_PER_S = 2e-3


def through(upstream, downstream):
    """Flow per conductance by ISO 6358, Pa: choked below the critical pressure ratio."""
    ratio = jnp.clip(downstream / upstream, CRITICAL_RATIO, 1.0)
    share = (ratio - CRITICAL_RATIO) / (1.0 - CRITICAL_RATIO)
    # Laminar where the pressures are nearly equal: the root's slope stays finite.
    return upstream * (jnp.sqrt(1.0 - share**2 + 1e-4) - 1e-2)


def volume(state):
    return STROKE_VOLUME_AT_0 + AREA * state["position"]


def seal_friction(state, inputs, values):
    """Friction of the lip seals, which the pressure pushes against the barrel."""
    force = values["seal_n_per_pa"] * (state["pressure"] - ATMOSPHERE)
    return {"speed": -force * jnp.tanh(state["speed"] / CREEP_M_PER_S) / MASS}


def leakage(state, inputs, values):
    """Air that leaks past the piston into the vented side."""
    flow = values["leak_kg_s_pa"] * (state["pressure"] - ATMOSPHERE)
    return {"pressure": -POLYTROPIC * GAS * flow / volume(state)}


def soft_spring(state, inputs, values):
    """A spring that stiffens along the stroke."""
    return {"speed": -values["hardening_n_per_m2"] * state["position"] ** 2 / MASS}


class SpringReturnCylinder(DynamicComponent):
    """Chamber, piston and spring; the valve's flow is proportional to its command."""

    kind = "spring-return"
    title = "spring-return cylinder with a proportional valve"
    columns = {
        "command": LogColumn("dimensionless", "input", lower=-1.0, upper=1.0),
        "position_m": LogColumn("m", "output"),
        "pressure_pa": LogColumn("Pa", "output", lower=0.5e5, upper=12e5),
    }
    parameters = (
        Parameter("conductance_kg_s_pa", 1.0e-9, "kg/s/Pa", 1e-11, 1e-6),
        Parameter("stiffness_n_per_m", 1500.0, "N/m", 10.0, 1e5),
        Parameter("preload_n", 30.0, "N", 0.0, 1000.0),
        Parameter("coulomb_n", 5.0, "N", 0.0, 200.0),
        Parameter("viscous_n_s_per_m", 30.0, "N*s/m", 0.0, 2000.0),
    )
    states = ("position", "speed", "pressure")
    # Friction's smoothed sign is steep: with longer steps the derivatives explode.
    substeps = 8
    terms = (
        Term(
            "seal-friction",
            "friction that grows with the chamber's pressure",
            (Quantity("seal_n_per_pa", "N/Pa", 3e-5, 0.0, 1e-2, "per gauge pressure"),),
            seal_friction,
        ),
        Term(
            "leakage",
            "leakage past the piston",
            (Quantity("leak_kg_s_pa", "kg/s/Pa", 2e-11, 0.0, 1e-8, "per gauge pressure"),),
            leakage,
        ),
        Term(
            "hardening-spring",
            "a spring that stiffens along the stroke",
            (Quantity("hardening_n_per_m2", "N/m**2", 1e4, -1e6, 1e6, "per position squared"),),
            soft_spring,
        ),
    )

    def start(self, first, rates, values):
        return {
            "position": first["position_m"],
            "speed": rates["position_m"],
            "pressure": first["pressure_pa"],
        }

    def derivative(self, state, inputs, values):
        pressure, speed = state["pressure"], state["speed"]
        filled = jnp.maximum(inputs["command"], 0.0) * through(SUPPLY, pressure)
        vented = jnp.maximum(-inputs["command"], 0.0) * through(pressure, ATMOSPHERE)
        flow = values["conductance_kg_s_pa"] * (filled - vented)
        force = AREA * (pressure - ATMOSPHERE) - values["preload_n"]
        force -= values["stiffness_n_per_m"] * state["position"]
        force -= values["coulomb_n"] * jnp.tanh(speed / CREEP_M_PER_S)
        force -= values["viscous_n_s_per_m"] * speed
        return {
            "position": speed,
            "speed": force / MASS,
            "pressure": POLYTROPIC * (GAS * flow - pressure * AREA * speed) / volume(state),
        }

    def measure(self, state, inputs, values):
        return {"position_m": state["position"], "pressure_pa": state["pressure"]}
