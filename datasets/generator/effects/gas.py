"""Chambers, valves and leaks with undeclared effects, at one moment.

Sources: ISO 6358-1:2013 (flow function with critical ratio and exponent), thesis chapter 3 for
what is left as it is. Flows are kg/s, positive into the chamber.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from datasets.generator.effects.compiling import compiled
from datasets.generator.effects.mechanics import (
    N_MECHANICAL,
    area_factor,
    pitch_angle,
    pitch_factor,
    swept_beyond,
)
from datasets.generator.plant import (
    CRITICAL_RATIO,
    OPEN_A,
    OPEN_B,
    POSITION,
    PRESSURE_A,
    PRESSURE_B,
    SHUT,
    VELOCITY,
    FloatArray,
    IntArray,
)

# States, A's first, B's next to it.
GAS = N_MECHANICAL  # mass, kg, or temperature, K
FLOW_1, FLOW_2 = GAS + 2, GAS + 4  # kg/s, behind the tube
TREND = GAS + 6  # -1 to 1: whether the pressure last fell or rose
SENSOR_1, SENSOR_2 = GAS + 8, GAS + 10  # Pa
RESERVOIR = GAS + 12  # Pa
N_EFFECT_STATES = GAS + 13

BISECTIONS = 24
TREND_S = 0.004
SILENCER_FLOW_KG_S = 3.5e-4  # at which every silencer of one size has the same back pressure


@compiled
def air_temperature(time: float, p: Any, k: Any) -> float:
    """Temperature of the supply and the room, K."""
    if k.temperature_k_per_s == 0.0 and k.temperature_settled_k == 0.0:
        return float(p.temperature)
    if k.temperature_settled_k != 0.0:
        settled = 1.0 - np.exp(-time / k.temperature_time_s)
        return float(p.temperature + k.temperature_settled_k * settled)
    span = time
    if k.temperature_time_s > 0.0:
        span = k.temperature_time_s * (1.0 - np.exp(-time / k.temperature_time_s))
    return float(p.temperature + k.temperature_k_per_s * span)


@compiled
def _iso_share(ratio: float, k: Any) -> float:
    """ISO 6358-1's flow over the choked flow, by downstream over upstream pressure (0 to 1)."""
    b = k.iso_critical_ratio
    if ratio <= b:
        return 1.0
    share = (ratio - b) / (1.0 - b)
    return float(max(1.0 - share * share, 0.0) ** k.use_iso_exponent)


@compiled
def fill_flow(pressure: float, supply: float, c: Any, p: Any, k: Any) -> float:
    """Flow from a supply at that pressure, Pa, into the chamber."""
    choked = c.choked_fill * supply / p.declared_supply
    if pressure <= CRITICAL_RATIO * supply:
        base = choked
    elif pressure <= supply:
        base = c.c_fill * np.sqrt(supply - pressure)
    else:
        base = -c.c_fill * np.sqrt(pressure - supply)
    if k.iso_fill != 0.0 and pressure < supply:
        base += k.iso_fill * (choked * _iso_share(pressure / supply, k) - base)
    return float(base)


@compiled
def exhaust_flow(pressure: float, back: float, c: Any, p: Any, k: Any) -> float:
    """Flow out of the chamber to the back pressure, Pa, of its exhaust."""
    choked = c.choked_dis
    if k.choked_scaling != 0.0:
        reference = k.use_reference * p.atmosphere / CRITICAL_RATIO
        choked *= max(1.0 + k.choked_scaling * (pressure / reference - 1.0), 0.1)
    base = choked if pressure >= back / CRITICAL_RATIO else c.c_dis * (pressure - back)
    if k.iso_dis != 0.0 and pressure > back:
        base += k.iso_dis * (choked * _iso_share(back / pressure, k) - base)
    return float(base)


@compiled
def _total_fill(x: FloatArray, supply: float, a: bool, b: bool, p: Any, k: Any) -> float:
    flow = fill_flow(x[PRESSURE_A], supply, p.a, p, k) if a else 0.0
    return flow + (fill_flow(x[PRESSURE_B], supply, p.b, p, k) if b else 0.0)


@compiled
def _drooped(x: FloatArray, supply: float, drop: float, a: bool, b: bool, p: Any, k: Any) -> float:
    """Supply pressure behind `drop` Pa s/kg while the flow that it itself drives passes, Pa."""
    low, high = 0.0, _total_fill(x, supply, a, b, p, k)
    if high <= 0.0:
        return supply
    for _ in range(BISECTIONS):  # the flow jumps where it chokes: bisection finds the jump too
        middle = 0.5 * (low + high)
        if _total_fill(x, supply - drop * middle, a, b, p, k) > middle:
            low = middle
        else:
            high = middle
    return float(supply - drop * high)


@compiled
def _total_exhaust(x: FloatArray, back: float, a: bool, b: bool, p: Any, k: Any) -> float:
    flow = exhaust_flow(x[PRESSURE_A], back, p.a, p, k) if a else 0.0
    return flow + (exhaust_flow(x[PRESSURE_B], back, p.b, p, k) if b else 0.0)


@compiled
def _silencer_rise(flow: float, k: Any) -> float:
    """What a silencer holds back at a flow, Pa: in proportion, or by the square."""
    if k.use_back_square > 0.0:
        return float(k.back_pa_s_per_kg * flow * abs(flow) / SILENCER_FLOW_KG_S)
    return float(k.back_pa_s_per_kg * flow)


@compiled
def _backed(x: FloatArray, a: bool, b: bool, p: Any, k: Any) -> float:
    """Pressure before a silencer that the chambers' own flow passes, Pa."""
    low, high = 0.0, _total_exhaust(x, p.atmosphere, a, b, p, k)
    if high <= 0.0:
        return float(p.atmosphere)
    # A valve that its own rise unchokes may pass more than when it is choked.
    while _total_exhaust(x, p.atmosphere + _silencer_rise(high, k), a, b, p, k) > high:
        high *= 2.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if _total_exhaust(x, p.atmosphere + _silencer_rise(middle, k), a, b, p, k) > middle:
            low = middle
        else:
            high = middle
    return float(p.atmosphere + _silencer_rise(high, k))


@compiled
def line_supply(time: float, p: Any, k: Any) -> float:
    """The compressor's pressure, Pa."""
    if k.pulsation_pa == 0.0:
        return float(p.supply)
    phase = 2.0 * np.pi * k.pulsation_hz * time + k.pulsation_phase_rad
    if k.use_sawtooth > 0.0:  # delivered in strokes, drawn evenly: a jump up, a slow fall
        turns = phase / (2.0 * np.pi)
        return float(p.supply + k.pulsation_pa * (1.0 - 2.0 * (turns - np.floor(turns))))
    return float(p.supply + k.pulsation_pa * np.sin(phase))


@compiled
def supplies(
    x: FloatArray, mode: IntArray, time: float, p: Any, k: Any
) -> tuple[float, float, float]:
    """Supply pressure at valve A, at valve B, and where it is measured, Pa."""
    line = line_supply(time, p, k)
    drop = k.droop_pa_s_per_kg
    if drop == 0.0:
        return line, line, line
    on_a, on_b = mode[OPEN_A] == 1, mode[OPEN_B] == 1
    if k.use_droop == 3.0:
        return x[RESERVOIR], x[RESERVOIR], x[RESERVOIR]
    if k.use_droop == 2.0:
        at_a = _drooped(x, line, drop, True, False, p, k) if on_a else line
        at_b = _drooped(x, line, drop, False, True, p, k) if on_b else line
        return at_a, at_b, line
    both = _drooped(x, line, drop, on_a, on_b, p, k)
    return both, both, both


@compiled
def backs(x: FloatArray, mode: IntArray, p: Any, k: Any) -> tuple[float, float]:
    """Pressure at the exhausts of A and B, Pa."""
    if k.back_pa_s_per_kg == 0.0:
        return p.atmosphere, p.atmosphere
    off_a, off_b = mode[OPEN_A] == 0, mode[OPEN_B] == 0
    if k.use_common > 0.0:
        both = _backed(x, off_a, off_b, p, k)
        return both, both
    at_a = _backed(x, True, False, p, k) if off_a else p.atmosphere
    at_b = _backed(x, False, True, p, k) if off_b else p.atmosphere
    return at_a, at_b


@compiled
def valve_flows(x: FloatArray, mode: IntArray, time: float, p: Any, k: Any) -> tuple[float, float]:
    """Flows through both valves at this moment."""
    supply_a, supply_b, _ = supplies(x, mode, time, p, k)
    back_a, back_b = backs(x, mode, p, k)
    icing = 1.0
    if k.icing != 0.0:
        icing -= k.icing * (1.0 - np.exp(-time / k.icing_time_s))
    if mode[OPEN_A] == 1:
        a = fill_flow(x[PRESSURE_A], supply_a, p.a, p, k)
    elif mode[OPEN_A] == SHUT:
        a = 0.0
    else:
        a = -icing * exhaust_flow(x[PRESSURE_A], back_a, p.a, p, k)
    if mode[OPEN_B] == 1:
        b = fill_flow(x[PRESSURE_B], supply_b, p.b, p, k)
    else:
        b = -icing * exhaust_flow(x[PRESSURE_B], back_b, p.b, p, k)
    if k.flow_hysteresis != 0.0:
        a *= 1.0 + k.flow_hysteresis * x[TREND]
        b *= 1.0 + k.flow_hysteresis * x[TREND + 1]
    return a, b


@compiled
def leak_flows(x: FloatArray, p: Any, k: Any) -> tuple[float, float]:
    """Flows into A and B that pass no valve: past the piston, and to the atmosphere."""
    a, b, out = x[PRESSURE_A], x[PRESSURE_B], p.atmosphere
    squares = a * a - b * b
    across = k.piston_quadratic * squares + k.piston_laminar * (a - b)
    across += k.piston_orifice * np.sqrt(abs(squares)) * np.sign(squares)
    from_a = k.leak_quadratic_a * (a * a - out * out) + k.leak_laminar_a * (a - out)
    from_a += k.relief_kg_per_s_pa_a * max(a - k.relief_pa_a, 0.0)
    from_b = k.leak_quadratic_b * (b * b - out * out) + k.leak_laminar_b * (b - out)
    from_b += k.relief_kg_per_s_pa_b * max(b - k.relief_pa_b, 0.0)
    if k.relief_quadratic_a != 0.0:
        from_a += k.relief_quadratic_a * max(a * a - k.relief_pa_a * k.relief_pa_a, 0.0)
    if k.relief_quadratic_b != 0.0:
        from_b += k.relief_quadratic_b * max(b * b - k.relief_pa_b * k.relief_pa_b, 0.0)
    return -across - from_a, across - from_b


@compiled
def _heat(
    x: FloatArray, i: int, flow: float, volume: float, work: float, room: float, p: Any, k: Any,
    dx: FloatArray,
) -> float:  # fmt: skip
    """Heat into chamber `i` (0: A), W; writes the rate of its gas state."""
    pressure = x[PRESSURE_A + i]
    r = p.gas_constant
    if k.use_heat == 2.0:
        temperature = max(x[GAS + i], 50.0)
    else:
        temperature = pressure * volume / (r * max(x[GAS + i], 1e-9))
    conductance = k.conductance_w_per_k
    if k.use_heat_exponent > 0.0:
        conductance *= max(pressure / p.atmosphere, 0.0) ** k.use_heat_exponent
    heat = conductance * (room - temperature)
    if k.use_heat == 2.0:  # m cv dT/dt = flow (cp T_in - cv T) - P dV/dt + Q
        cv = r / (p.heat_ratio - 1.0)
        mass = pressure * volume / (r * temperature)
        entering = room if flow > 0.0 else temperature
        enthalpy = flow * ((cv + r) * entering - cv * temperature)
        dx[GAS + i] = (enthalpy - work + heat) / (mass * cv)
    else:
        dx[GAS + i] = flow
    return float(heat)


@compiled
def _chamber_rates(
    x: FloatArray, i: int, flow: float, leak: float, time: float, c: Any, p: Any, k: Any,
    dx: FloatArray,
) -> None:  # fmt: skip
    """Rates of one chamber's pressure, gas, tube and sensor."""
    stroke = pitch_angle(x[POSITION], k) * p.radius
    factor = pitch_factor(x[POSITION] * k.angle_scale, k) if k.use_kinematic > 0.0 else 1.0
    if k.taper_per_rad != 0.0 or k.barrel_per_rad2 != 0.0:
        angle = x[POSITION] * k.angle_scale
        stroke += swept_beyond(angle, k) / k.angle_scale * p.radius
        factor *= area_factor(angle, k)
    volume = (c.offset + c.direction * stroke) * c.area
    volume_rate = c.direction * x[VELOCITY] * factor * p.radius * c.area
    if k.tube_lag_s_a > 0.0:
        second = k.use_tube_second_a > 0.0
        lag = 0.5 * k.tube_lag_s_a if second else k.tube_lag_s_a
        dx[FLOW_1 + i] = (flow - x[FLOW_1 + i]) / lag
        dx[FLOW_2 + i] = (x[FLOW_1 + i] - x[FLOW_2 + i]) / lag
        flow = x[FLOW_2 + i] if second else x[FLOW_1 + i]
    flow += leak
    room = air_temperature(time, p, k)
    pressure = x[PRESSURE_A + i]
    power = p.heat_ratio * p.gas_constant * room * flow
    power -= (p.heat_ratio + k.work_exponent) * pressure * volume_rate
    if k.conductance_w_per_k > 0.0:
        heat = _heat(x, i, flow, volume, pressure * volume_rate, room, p, k, dx)
        power += (p.heat_ratio - 1.0) * heat
    dx[PRESSURE_A + i] = power / volume
    if k.flow_hysteresis != 0.0:
        dx[TREND + i] = (np.tanh(dx[PRESSURE_A + i] / 2e4) - x[TREND + i]) / TREND_S
    lag = k.pressure_lag_s_a if i == 0 else k.pressure_lag_s_b
    if lag > 0.0:
        second = (k.use_sensor_second_a if i == 0 else k.use_sensor_second_b) > 0.0
        lag = 0.5 * lag if second else lag
        dx[SENSOR_1 + i] = (pressure - x[SENSOR_1 + i]) / lag
        dx[SENSOR_2 + i] = (x[SENSOR_1 + i] - x[SENSOR_2 + i]) / lag


@compiled
def gas_rates(x: FloatArray, mode: IntArray, time: float, p: Any, k: Any, dx: FloatArray) -> None:
    """Rates of all that holds gas or reads its pressure."""
    flow_a, flow_b = valve_flows(x, mode, time, p, k)
    leak_a, leak_b = leak_flows(x, p, k)
    _chamber_rates(x, 0, flow_a, leak_a, time, p.a, p, k, dx)
    _chamber_rates(x, 1, flow_b, leak_b, time, p.b, p, k, dx)
    if k.use_droop == 3.0:
        on = _total_fill(x, x[RESERVOIR], mode[OPEN_A] == 1, mode[OPEN_B] == 1, p, k)
        line = line_supply(time, p, k)
        dx[RESERVOIR] = (line - k.droop_pa_s_per_kg * on - x[RESERVOIR]) / k.reservoir_s
