"""Torques and friction with undeclared effects, at one moment.

Laws are written in Nm and rad; `angle_scale` (1 for a rotary rig) takes them to the position's
units. Sources: Armstrong-Helouvry et al. 1994 (Stribeck forms), Canudas de Wit et al. 1995 (LuGre),
Dupont et al. 2002 (elastoplastic presliding), Dahl 1968.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from datasets.generator.effects.compiling import compiled
from datasets.generator.plant import (
    POSITION,
    PRESSURE_A,
    PRESSURE_B,
    VELOCITY,
    FloatArray,
    static_load,
)

# States beyond the plant's own four.
BRISTLE = 4  # rad
LAG_1, LAG_2 = 5, 6  # Nm, motor torque behind the amplifier
MOTOR, MOTOR_SPEED = 7, 8  # before the gear's gap (position units); play: the gap itself, rad
ARM, ARM_SPEED = 9, 10
PENDULUM, PENDULUM_SPEED = 11, 12
N_MECHANICAL = 13

DWELL_S = 10.0  # rest after which static friction is the rig's
STATIC_SPEED_RAD_S = 0.02  # over which a bristle law falls from static to sliding friction
SLOPE_ANGLE_RAD = 0.6
MAINS_HZ = 50.0
ARM_MOMENT_NM = 0.30 * 0.23 * 9.81  # of the arm, which a horizontal rig's file does not contain


@compiled
def motor_torque(command: float, p: Any, k: Any) -> float:
    """The motor's torque before any lag, Nm: declared limit, saturation, constant."""
    torque = min(max(command, -p.max_effort), p.max_effort) / k.angle_scale
    if k.saturation_per_nm > 0.0:
        limit = 1.0 / k.saturation_per_nm
        if k.use_tanh > 0.0:
            torque = limit * np.tanh(torque / limit)
        else:
            torque = min(max(torque, -limit), limit)
    return float(torque * (1.0 + k.torque_gain))


@compiled
def delivered_torque(x: FloatArray, command: float, p: Any, k: Any) -> float:
    """The motor's torque at the gear, Nm: lagged, with its ripple."""
    if k.motor_lag_s > 0.0:
        torque = x[LAG_2] if k.use_motor_second > 0.0 else x[LAG_1]
    else:
        torque = motor_torque(command, p, k)
    if k.ripple != 0.0:
        angle = k.ripple_count * x[POSITION] * k.angle_scale + k.ripple_phase_rad
        wave = 2.0 * abs(np.sin(angle)) - 1.0 if k.use_rectified > 0.0 else np.sin(angle)
        torque *= 1.0 + k.ripple * wave
    return float(torque)


@compiled
def shaft_effort(x: FloatArray, command: float, p: Any, k: Any) -> float:
    """What the gear gives the output, Nm (N): nothing while its gap is open."""
    torque = delivered_torque(x, command, p, k)
    if k.gap_rad <= 0.0:
        return torque * float(k.angle_scale)
    half = 0.5 * k.gap_rad
    if k.use_gap == 2.0:
        pushes = (x[MOTOR] >= half and torque > 0.0) or (x[MOTOR] <= -half and torque < 0.0)
        return torque * float(k.angle_scale) if pushes else 0.0
    half /= k.angle_scale
    play = x[MOTOR] - x[POSITION]
    rate = x[MOTOR_SPEED] - x[VELOCITY]
    if play > half:  # a flank pushes and does not pull
        return float(max(k.contact_stiffness * (play - half) + k.contact_damping * rate, 0.0))
    if play < -half:
        return float(min(k.contact_stiffness * (play + half) + k.contact_damping * rate, 0.0))
    return 0.0


@compiled
def pitch_factor(angle: float, k: Any) -> float:
    """Pitch radius over the declared one."""
    if k.eccentricity == 0.0:
        return 1.0
    return float(1.0 + k.eccentricity * np.cos(angle - k.eccentric_phase_rad))


@compiled
def pitch_angle(position: float, k: Any) -> float:
    """The position whose stroke a round pinion would have: the integral of the pitch factor."""
    if k.eccentricity == 0.0 or k.use_kinematic == 0.0:
        return position
    phase = k.eccentric_phase_rad
    wave = np.sin(position * k.angle_scale - phase) + np.sin(phase)
    return float(position + k.eccentricity * wave / k.angle_scale)


@compiled
def area_factor(angle: float, k: Any) -> float:
    """Both piston areas over the declared ones: a tapered or a barrelled bore."""
    return float(1.0 + angle * (k.taper_per_rad + angle * k.barrel_per_rad2))


@compiled
def swept_beyond(angle: float, k: Any) -> float:
    """Angle by which a bore of the declared area would have to be longer: the factor's integral."""
    return float(angle * angle * (k.taper_per_rad / 2.0 + angle * k.barrel_per_rad2 / 3.0))


@compiled
def conservative_torque(angle: float, time: float, p: Any, k: Any) -> float:
    """Torques by angle and time alone, Nm: offset, mesh, cable, tilt, latch, springs, hum."""
    torque = k.torque_offset_nm - k.cable_nm_per_rad * (angle - k.cable_rest_rad)
    if k.mesh_torque_nm != 0.0:
        mesh = k.mesh_teeth * angle + k.mesh_phase_rad
        torque += k.mesh_torque_nm * (np.sin(mesh) + k.mesh_second * np.sin(2.0 * mesh))
    if k.tilt_rad != 0.0:
        torque -= ARM_MOMENT_NM * k.tilt_rad * np.sin(angle + k.tilt_phase_rad)
    if k.latch_nm != 0.0:
        away = (angle - k.latch_angle_rad) / k.latch_width_rad
        torque -= k.latch_nm * away * np.exp(0.5 - 0.5 * away * away)
    if k.hardening_nm_per_rad3 != 0.0:
        into = max(abs(angle) - k.hardening_start_rad, 0.0)
        torque -= k.hardening_nm_per_rad3 * into**3 * np.sign(angle)
    if k.hum_nm != 0.0:
        torque += k.hum_nm * np.sin(2.0 * np.pi * MAINS_HZ * time + k.hum_phase_rad)
    return float(torque)


@compiled
def cushion_torque(angle: float, speed: float, k: Any) -> float:
    """Torque of the cushions at both ends, Nm: it pushes, harder on the way in if damped."""
    depth = abs(angle) - k.cushion_start_rad
    if depth <= 0.0:
        return 0.0
    way = 1.0 if angle > 0.0 else -1.0
    push = 1.0 + k.cushion_damping_s_per_rad * way * speed  # Hunt, Crossley 1975
    return float(-way * k.cushion_nm_per_rad * depth * max(push, 0.0))


@compiled
def load_effort(x: FloatArray, p: Any, k: Any) -> float:
    """Gravity, or the flexible link that carries it, and the pendulum; Nm (N) at the output."""
    if k.arm_inertia > 0.0:
        stretch = x[ARM] - x[POSITION]
        load = k.arm_stiffness * stretch + k.arm_damping * (x[ARM_SPEED] - x[VELOCITY])
    else:
        has_load = p.gravity != 0.0 or p.spring_stiffness != 0.0
        load = -static_load(x[POSITION], p) if has_load else 0.0
    if k.pendulum_inertia > 0.0:
        load += k.pendulum_stiffness * (x[PENDULUM] - x[POSITION])
        load += k.pendulum_damping * (x[PENDULUM_SPEED] - x[VELOCITY])
    return float(load)


@compiled
def applied_effort(x: FloatArray, time: float, command: float, p: Any, k: Any) -> float:
    """Everything but friction and the end stops, Nm (N)."""
    angle = x[POSITION] * k.angle_scale
    force = x[PRESSURE_A] * p.a.area - x[PRESSURE_B] * p.b.area
    force -= p.atmosphere * (p.a.area - p.b.area)
    if k.taper_per_rad != 0.0 or k.barrel_per_rad2 != 0.0:
        force *= area_factor(angle, k)
    effort = shaft_effort(x, command, p, k) + force * p.radius * pitch_factor(angle, k)
    effort += conservative_torque(angle, time, p, k) * k.angle_scale
    if k.cushion_nm_per_rad != 0.0:
        effort += cushion_torque(angle, x[VELOCITY] * k.angle_scale, k) * k.angle_scale
    return float(effort + load_effort(x, p, k))


@compiled
def free_effort(x: FloatArray, time: float, command: float, p: Any, k: Any) -> float:
    """The applied effort, or 0 where an end stop takes it."""
    effort = applied_effort(x, time, command, p, k)
    if x[POSITION] >= p.half_travel and effort > 0.0:
        return 0.0
    if x[POSITION] <= -p.half_travel and effort < 0.0:
        return 0.0
    return effort


@compiled
def _coulomb_factor(angle: float, time: float, k: Any) -> float:
    """Coulomb friction over the rig's: by position, and while the seals warm up."""
    factor = 1.0
    if k.position_sine != 0.0:
        factor += k.position_sine * np.sin(k.position_wave_per_rad * angle + k.position_phase_rad)
    if k.position_slope != 0.0:
        factor += k.position_slope * angle / SLOPE_ANGLE_RAD
    if k.position_bump != 0.0:
        away = (angle - k.position_centre_rad) / k.position_width_rad
        factor += k.position_bump * np.exp(-away * away)
    if k.warm_up != 0.0:
        factor *= 1.0 + k.warm_up * np.exp(-time / k.warm_up_time_s)
    return float(max(factor, 0.05))


@compiled
def _seal_torque(x: FloatArray, p: Any, k: Any) -> float:
    """The seals' own friction by pressure, Nm."""
    gauge = max(x[PRESSURE_A] + x[PRESSURE_B] - 2.0 * p.atmosphere, 0.0)
    difference = abs(x[PRESSURE_A] - x[PRESSURE_B])
    torque = k.seal_sum_nm_per_pa * gauge + k.seal_difference_nm_per_pa * difference
    angle = x[POSITION] * k.angle_scale
    if k.seal_slope_nm_per_pa_rad != 0.0:
        torque += k.seal_slope_nm_per_pa_rad * angle * gauge
    if k.seal_half_nm_per_pa_rad != 0.0 and angle > 0.0:
        torque += k.seal_half_nm_per_pa_rad * angle * gauge
    return float(torque)


@compiled
def _gear_friction(x: FloatArray, command: float, p: Any, k: Any) -> float:
    """Friction of the flanks by what they carry, Nm (N): of the gear, or of gear and rack."""
    carried = shaft_effort(x, command, p, k)
    if k.use_gear == 2.0:
        force = x[PRESSURE_A] * p.a.area - x[PRESSURE_B] * p.b.area
        force -= p.atmosphere * (p.a.area - p.b.area)
        carried += force * p.radius * pitch_factor(x[POSITION] * k.angle_scale, k)
    return float(k.gear_friction * abs(carried))


@compiled
def sliding_level(
    x: FloatArray, speed: float, time: float, command: float, p: Any, k: Any
) -> float:
    """Friction while sliding without the viscous part, Nm (N), 0 or more; `speed` in rad/s."""
    factor = _coulomb_factor(x[POSITION] * k.angle_scale, time, k)
    torque = _seal_torque(x, p, k)
    if k.stribeck_torque_nm != 0.0:
        share = abs(speed) / k.stribeck_speed_rad_s
        if k.use_exponent > 0.0:
            torque += k.stribeck_torque_nm * np.exp(-(share**k.use_exponent))
        else:
            torque += k.stribeck_torque_nm / (1.0 + share * share)
    level = p.coulomb_friction * factor + torque * k.angle_scale
    if k.gear_friction != 0.0:
        level += _gear_friction(x, command, p, k)
    return float(max(level, 0.0))


@compiled
def breakaway_level(
    x: FloatArray, time: float, stuck: float, command: float, p: Any, k: Any
) -> float:
    """Static friction, Nm (N), after `stuck` s at rest; never below what slides."""
    static = p.static_friction
    if k.dwell != 0.0:
        missing = np.log((DWELL_S + k.dwell_time_s) / (min(stuck, DWELL_S) + k.dwell_time_s))
        static *= 1.0 - k.dwell * missing
    if k.fresh_loss != 0.0:
        static *= 1.0 - k.fresh_loss * np.exp(-stuck / k.growth_time_s)
    if k.warm_up != 0.0:
        static *= 1.0 + k.warm_up * np.exp(-time / k.warm_up_time_s)
    if k.use_seal_static > 0.0:
        static += _seal_torque(x, p, k) * k.angle_scale
    return float(max(static, sliding_level(x, 0.0, time, command, p, k)))


@compiled
def drag_effort(velocity: float, p: Any, k: Any) -> float:
    """Viscous and other drag by velocity, Nm (N)."""
    speed = velocity * k.angle_scale
    torque = 0.0
    if k.drag != 0.0:
        torque += k.drag * abs(speed) ** k.use_drag_exponent * np.sign(speed)
    if k.eddy_nm_s_per_rad != 0.0:
        torque += k.eddy_nm_s_per_rad * speed / (1.0 + (speed / k.eddy_speed_rad_s) ** 2)
    return float(p.viscous_friction * velocity + torque * k.angle_scale)


@compiled
def bristle(x: FloatArray, time: float, command: float, p: Any, k: Any) -> tuple[float, float]:
    """Rate of the bristles, rad/s, and their friction, Nm (N), with the asymmetric part."""
    speed = x[VELOCITY] * k.angle_scale
    stiffness = 1.0 / k.bristle_compliance_rad_per_nm
    level = sliding_level(x, speed, time, command, p, k)
    rest = max(breakaway_level(x, time, 0.0, command, p, k) - level, 0.0)
    top = (level + rest * np.exp(-((speed / STATIC_SPEED_RAD_S) ** 2))) / k.angle_scale
    z = x[BRISTLE]
    full = max(top, 1e-6) / stiffness  # rad, the deflection at steady sliding
    plastic = 1.0
    if k.use_bristle == 2.0:
        share = abs(z) / full
        plastic = 0.0
        if speed * z > 0.0 and share > 0.7:
            plastic = min(0.5 + 0.5 * np.sin(np.pi * (min(share, 1.0) - 0.85) / 0.3), 1.0)
    rate = speed - plastic * abs(speed) * z / full
    damping = 0.0 if k.use_bristle == 3.0 else k.bristle_damping_nm_s_per_rad
    torque = stiffness * z + damping * rate + k.asymmetry_nm * min(abs(z) / full, 1.0)
    return float(rate), float(torque * k.angle_scale)


@compiled
def second_rates(x: FloatArray, dx: FloatArray, command: float, p: Any, k: Any, held: bool) -> None:
    """Rates of the amplifier, the motor before its gap, the arm and the pendulum."""
    if k.motor_lag_s > 0.0:
        second = k.use_motor_second > 0.0
        lag = 0.5 * k.motor_lag_s if second else k.motor_lag_s
        dx[LAG_1] = (motor_torque(command, p, k) - x[LAG_1]) / lag
        dx[LAG_2] = (x[LAG_1] - x[LAG_2]) / lag
    if k.gap_rad > 0.0:
        torque = delivered_torque(x, command, p, k)
        if k.use_gap == 2.0:
            rate = torque / k.play_drag_nm_s_per_rad
            open_to = 0.5 * k.gap_rad * np.sign(rate)
            dx[MOTOR] = rate if (open_to - x[MOTOR]) * rate > 0.0 else 0.0
        elif not held:
            dx[MOTOR] = x[MOTOR_SPEED]
            back = shaft_effort(x, command, p, k)
            dx[MOTOR_SPEED] = (torque * k.angle_scale - back) / k.motor_inertia
    if k.arm_inertia > 0.0 and not held:
        stretch = x[ARM] - x[POSITION]
        spring = k.arm_stiffness * stretch + k.arm_damping * (x[ARM_SPEED] - x[VELOCITY])
        dx[ARM] = x[ARM_SPEED]
        dx[ARM_SPEED] = -(spring + static_load(x[ARM], p)) / k.arm_inertia
    if k.pendulum_inertia > 0.0 and not held:
        pull = k.pendulum_stiffness * (x[PENDULUM] - x[POSITION])
        pull += k.pendulum_damping * (x[PENDULUM_SPEED] - x[VELOCITY])
        dx[PENDULUM] = x[PENDULUM_SPEED]
        dx[PENDULUM_SPEED] = -pull / k.pendulum_inertia
