/*
 * Identified model of a pneumatic actuator, for a controller. Written by sysid export.
 * rig: generated (rotary, horizontal)
 * bundle: sysid-bundle/1, created 2026-11-22T03:26:24+00:00 by sysid 0.1.0
 * bundle SHA-256: 7cdab6ee8bfcd1e2bd1b195b246b83e991df93cc8adc0fc00e07e84dd340dcf4
 * SI, absolute pressures. Equation numbers are those of the thesis, as corrected.
 * Unknown numbers are absent, and their HAS macros are 0. C99, link with the maths library.
 * Numbers are double; -DSYSID_REAL=float makes them single precision.
 *
 * On a microcontroller: include this file in one source file, compile it with -std=c99 -O2,
 * and -DSYSID_REAL=float where the unit for floating point is single. Nothing is allocated, and
 * nothing is global but constants. The folder ..._check next to this file replays numbers of
 * the Python package through it: cmake and ctest on a computer, or check.c with its vectors.h
 * on the target itself.
 *
 * Numbers that are not finite (NaN, infinite): where an input is one, or what follows from it,
 * a law answers NaN and a duty is 0. -ffast-math drops these checks and is an error.
 */
#ifndef SYSID_CONTROLLER_H
#define SYSID_CONTROLLER_H

#include <math.h>

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) \
    || defined(_M_FP_FAST)
# error "compile without -ffast-math: it drops the checks for numbers that are not finite"
#endif

/* --- contained (1) or absent (0) in this header --- */

#define SYSID_HAS_CYLINDER 1
#define SYSID_HAS_GRAVITY 1
#define SYSID_HAS_SLIDING_FRICTION 1
#define SYSID_HAS_FRICTION 0
#define SYSID_HAS_MOTOR 1
#define SYSID_HAS_INERTIA 1
#define SYSID_HAS_VALVE_A_FILLING 0
#define SYSID_HAS_VALVE_A_EXHAUST 0
#define SYSID_HAS_VALVE_A_DISCRETE 0
#define SYSID_HAS_VALVE_A_DELAYS 0
#define SYSID_HAS_CHAMBER_A 1
#define SYSID_HAS_VALVE_B_FILLING 0
#define SYSID_HAS_VALVE_B_EXHAUST 0
#define SYSID_HAS_VALVE_B_DISCRETE 0
#define SYSID_HAS_VALVE_B_DELAYS 0
#define SYSID_HAS_CHAMBER_B 1
#define SYSID_HAS_PWM_A_FILL_BIPOLYNOMIAL 0
#define SYSID_HAS_PWM_A_FILL_NETWORK 0
#define SYSID_HAS_PWM_A_DISCHARGE_BIPOLYNOMIAL 0
#define SYSID_HAS_PWM_A_DISCHARGE_NETWORK 0
#define SYSID_HAS_PWM_B_FILL_BIPOLYNOMIAL 0
#define SYSID_HAS_PWM_B_FILL_NETWORK 0
#define SYSID_HAS_PWM_B_DISCHARGE_BIPOLYNOMIAL 0
#define SYSID_HAS_PWM_B_DISCHARGE_NETWORK 0
#define SYSID_HAS_CONTROLLERS 0
#define SYSID_EFFECTS_ACT_ON_SLIDING_FRICTION 0
#define SYSID_EFFECTS_ACT_ON_STATIC_FRICTION 0
#define SYSID_EFFECTS_ACT_ON_EXTERNAL 0
#define SYSID_EFFECTS_ACT_ON_MOTOR 0
#define SYSID_EFFECTS_ACT_ON_PITCH_RADIUS 0
#define SYSID_EFFECTS_ACT_ON_DISPLACEMENT 0
#define SYSID_EFFECTS_ACT_ON_TRUE_POSITION 0
#define SYSID_EFFECTS_ACT_ON_SUPPLY_PRESSURE_A 0
#define SYSID_EFFECTS_ACT_ON_EXHAUST_PRESSURE_A 0
#define SYSID_EFFECTS_ACT_ON_FILLING_FLOW_A 0
#define SYSID_EFFECTS_ACT_ON_EXHAUST_FLOW_A 0
#define SYSID_EFFECTS_ACT_ON_CHAMBER_FLOW_A 0
#define SYSID_EFFECTS_ACT_ON_PRESSURE_RATE_A 0
#define SYSID_EFFECTS_ACT_ON_TRUE_PRESSURE_A 0
#define SYSID_EFFECTS_ACT_ON_VALVE_A_ON_DELAY 0
#define SYSID_EFFECTS_ACT_ON_VALVE_A_OFF_DELAY 0
#define SYSID_EFFECTS_ACT_ON_SUPPLY_PRESSURE_B 0
#define SYSID_EFFECTS_ACT_ON_EXHAUST_PRESSURE_B 0
#define SYSID_EFFECTS_ACT_ON_FILLING_FLOW_B 0
#define SYSID_EFFECTS_ACT_ON_EXHAUST_FLOW_B 0
#define SYSID_EFFECTS_ACT_ON_CHAMBER_FLOW_B 0
#define SYSID_EFFECTS_ACT_ON_PRESSURE_RATE_B 0
#define SYSID_EFFECTS_ACT_ON_TRUE_PRESSURE_B 0
#define SYSID_EFFECTS_ACT_ON_VALVE_B_ON_DELAY 0
#define SYSID_EFFECTS_ACT_ON_VALVE_B_OFF_DELAY 0
#define SYSID_EFFECTS_ACT_ON_CONSTANTS_OVER_TIME 0
#define SYSID_EFFECTS_CONTAINED 0
#define SYSID_EFFECTS_NOT_CONTAINED 0
#define SYSID_HAS_MONITOR 0 /* bundle.json: valves.a.discrete is missing, which a controller needs; fit valve-discrete tests of valve a into it */

/* --- real numbers: double, or what SYSID_REAL says (-DSYSID_REAL=float) --- */

#ifndef SYSID_REAL
#define SYSID_REAL double
#endif
typedef SYSID_REAL sysid_real;

/* A result where it is finite, else NaN; of a duty, else 0. */
static inline sysid_real sysid_known(sysid_real x)
{
    return isfinite(x) ? x : (sysid_real)NAN;
}
static inline sysid_real sysid_known_duty(sysid_real x)
{
    return isfinite(x) ? x : 0;
}

/* The functions of the maths library, those of float where that is the real type; NaN of an
   argument that is not finite. */
static inline sysid_real sysid_sin(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)sinf((float)x) : (sysid_real)sin((double)x);
}
static inline sysid_real sysid_cos(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)cosf((float)x) : (sysid_real)cos((double)x);
}
static inline sysid_real sysid_tan(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)tanf((float)x) : (sysid_real)tan((double)x);
}
static inline sysid_real sysid_asin(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)asinf((float)x) : (sysid_real)asin((double)x);
}
static inline sysid_real sysid_acos(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)acosf((float)x) : (sysid_real)acos((double)x);
}
static inline sysid_real sysid_atan(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)atanf((float)x) : (sysid_real)atan((double)x);
}
static inline sysid_real sysid_sinh(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)sinhf((float)x) : (sysid_real)sinh((double)x);
}
static inline sysid_real sysid_cosh(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)coshf((float)x) : (sysid_real)cosh((double)x);
}
static inline sysid_real sysid_tanh(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)tanhf((float)x) : (sysid_real)tanh((double)x);
}
static inline sysid_real sysid_exp(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)expf((float)x) : (sysid_real)exp((double)x);
}
static inline sysid_real sysid_expm1(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)expm1f((float)x) : (sysid_real)expm1((double)x);
}
static inline sysid_real sysid_log(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)logf((float)x) : (sysid_real)log((double)x);
}
static inline sysid_real sysid_log1p(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)log1pf((float)x) : (sysid_real)log1p((double)x);
}
static inline sysid_real sysid_sqrt(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)sqrtf((float)x) : (sysid_real)sqrt((double)x);
}
static inline sysid_real sysid_fabs(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)fabsf((float)x) : (sysid_real)fabs((double)x);
}
static inline sysid_real sysid_floor(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)floorf((float)x) : (sysid_real)floor((double)x);
}
static inline sysid_real sysid_ceil(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)ceilf((float)x) : (sysid_real)ceil((double)x);
}
static inline sysid_real sysid_pow(sysid_real x, sysid_real y)
{
    if (!(isfinite(x) && isfinite(y))) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)powf((float)x, (float)y) : (sysid_real)pow((double)x, (double)y);
}
static inline sysid_real sysid_atan2(sysid_real x, sysid_real y)
{
    if (!(isfinite(x) && isfinite(y))) {
        return (sysid_real)NAN;
    }
    return sizeof x == sizeof(float) ? (sysid_real)atan2f((float)x, (float)y) : (sysid_real)atan2((double)x, (double)y);
}

/* -1, 0 or 1; whole powers; the larger and the smaller of two. */
static inline sysid_real sysid_sign(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return x > 0 ? 1 : x < 0 ? -1 : x;
}
static inline sysid_real sysid_square(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return x * x;
}
static inline sysid_real sysid_cube(sysid_real x)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    return x * x * x;
}
static inline sysid_real sysid_maximum(sysid_real x, sysid_real y)
{
    if (!(isfinite(x) && isfinite(y))) {
        return (sysid_real)NAN;
    }
    return x > y ? x : y;
}
static inline sysid_real sysid_minimum(sysid_real x, sysid_real y)
{
    if (!(isfinite(x) && isfinite(y))) {
        return (sysid_real)NAN;
    }
    return x < y ? x : y;
}

/* --- constants --- */

static const sysid_real sysid_critical_ratio = (sysid_real)0.53; /* 1; downstream over upstream pressure of choked flow (3.5.1) */
static const sysid_real sysid_gas_constant_j_per_kg_k = (sysid_real)287.0; /* J/(kg K) */
static const sysid_real sysid_heat_capacity_ratio = (sysid_real)1.4; /* 1 */
static const sysid_real sysid_temperature_k = (sysid_real)298.4; /* K */
static const sysid_real sysid_atmospheric_pressure_pa = (sysid_real)100200.0; /* Pa; absolute */
static const sysid_real sysid_supply_pressure_pa = (sysid_real)312000.0; /* Pa; absolute; choked filling holds at it */
static const sysid_real sysid_area_a_m2 = (sysid_real)0.0004325; /* m2; piston area, chamber A */
static const sysid_real sysid_area_b_m2 = (sysid_real)0.00041743; /* m2; piston area, chamber B */
static const sysid_real sysid_offset_a_m = (sysid_real)0.06819; /* m; chamber A is (offset + y) area */
static const sysid_real sysid_offset_b_m = (sysid_real)0.072626; /* m; chamber B is (offset - y) area */
static const sysid_real sysid_stroke_m = (sysid_real)0.11739; /* m */
static const sysid_real sysid_pitch_radius_m = (sysid_real)0.03767; /* m; y is this times the position */
static const sysid_real sysid_torque_per_volt_nm = (sysid_real)0.078056; /* Nm/V */
static const sysid_real sysid_max_torque_nm = (sysid_real)0.795; /* Nm */
static const sysid_real sysid_pwm_period_s = (sysid_real)0.005; /* s */
static const sysid_real sysid_declared_on_delay_s = (sysid_real)0.00151; /* s; from the valve's manual; command to opening */
static const sysid_real sysid_declared_off_delay_s = (sysid_real)0.00195; /* s; command to closing */
static const sysid_real sysid_sampling_period_s = (sysid_real)0.001; /* s */
static const sysid_real sysid_encoder_counts_per_rev = (sysid_real)80000.0; /* counts/rev */
static const sysid_real sysid_encoder_zero_counts = (sysid_real)0.0; /* counts */
static const sysid_real sysid_k_r_t_j_per_kg = (sysid_real)119897.11999999998; /* J/kg; k R T of the pressure equations (3.3.6) */
static const sysid_real sysid_inertia_kg_m2 = (sysid_real)0.019623; /* kg m2; payload included (3.3.5) */
static const sysid_real sysid_gravity_moment_nm = (sysid_real)0.0; /* Nm; gravity is this times sin(theta) (3.3.8-10) */
static const sysid_real sysid_friction_coulomb_nm = (sysid_real)0.16762322460959864; /* Nm */
static const sysid_real sysid_friction_viscous_nm_s_per_rad = (sysid_real)0.05746619236865669; /* Nm s/rad */
static const sysid_real sysid_friction_offset_nm = (sysid_real)-0.0028980011028291227; /* Nm; constant torque against positive motion; what is applied is less by it */

/* Torque of the cylinder, Nm, from absolute pressures, Pa (3.3.3). */
static inline sysid_real sysid_cylinder_torque(sysid_real pressure_a_pa,
    sysid_real pressure_b_pa)
{
    if (!(isfinite(pressure_a_pa) && isfinite(pressure_b_pa))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = -sysid_atmospheric_pressure_pa;
    return sysid_known(sysid_pitch_radius_m*(sysid_area_a_m2*(pressure_a_pa + x0) -
        sysid_area_b_m2*(pressure_b_pa + x0)));
}

/* Torque of gravity against positive motion, Nm (3.3.8-10): theta = 0 hangs down. */
static inline sysid_real sysid_gravity_torque(sysid_real theta_rad)
{
    if (!isfinite(theta_rad)) {
        return (sysid_real)NAN;
    }
    return sysid_known(sysid_gravity_moment_nm*sysid_sin(theta_rad));
}

/* Friction while moving, Nm (3.4.1): Coulomb sign(w) + viscous w; 0 at rest. */
static inline sysid_real sysid_sliding_friction_torque(sysid_real omega_rad_s)
{
    if (!isfinite(omega_rad_s)) {
        return (sysid_real)NAN;
    }
    return sysid_known(omega_rad_s*sysid_friction_viscous_nm_s_per_rad +
        sysid_friction_coulomb_nm*sysid_sign(omega_rad_s));
}

/* Torque of the motor at the output, Nm, from volts (3.3.4); within its declared limit. */
static inline sysid_real sysid_motor_torque(sysid_real volts)
{
    if (!isfinite(volts)) {
        return (sysid_real)NAN;
    }
    sysid_real effort = volts * sysid_torque_per_volt_nm;
    return sysid_known(sysid_maximum(sysid_minimum(effort, sysid_max_torque_nm), -sysid_max_torque_nm));
}

/* dP/dt of chamber A, Pa/s (3.3.6), from the flow into it, kg/s; NaN where no volume is left. */
static inline sysid_real sysid_pressure_rate_a(sysid_real pressure_pa, sysid_real theta_rad,
    sysid_real omega_rad_s, sysid_real flow_kg_s)
{
    if (!(isfinite(pressure_pa) && isfinite(theta_rad) && isfinite(omega_rad_s) &&
        isfinite(flow_kg_s))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_offset_a_m + sysid_pitch_radius_m*theta_rad;
    return sysid_known(((sysid_real)0.0 < sysid_area_a_m2*x0) ?
        sysid_heat_capacity_ratio*(flow_kg_s*sysid_gas_constant_j_per_kg_k*sysid_temperature_k -
        omega_rad_s*pressure_pa*sysid_area_a_m2*sysid_pitch_radius_m)/(sysid_area_a_m2*x0) : NAN);
}

/* The flow into chamber A, kg/s, that gives this dP/dt, Pa/s: (3.3.6) solved. */
static inline sysid_real sysid_flow_for_pressure_rate_a(sysid_real rate_pa_s,
    sysid_real pressure_pa, sysid_real theta_rad, sysid_real omega_rad_s)
{
    if (!(isfinite(rate_pa_s) && isfinite(pressure_pa) && isfinite(theta_rad) &&
        isfinite(omega_rad_s))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_area_a_m2*(sysid_offset_a_m + sysid_pitch_radius_m*theta_rad);
    return sysid_known(((sysid_real)0.0 < x0) ?
        (omega_rad_s*pressure_pa*sysid_area_a_m2*sysid_pitch_radius_m +
        rate_pa_s*x0/sysid_heat_capacity_ratio)/(sysid_gas_constant_j_per_kg_k*sysid_temperature_k)
        : NAN);
}

/* dP/dt of chamber B, Pa/s (3.3.6), from the flow into it, kg/s; NaN where no volume is left. */
static inline sysid_real sysid_pressure_rate_b(sysid_real pressure_pa, sysid_real theta_rad,
    sysid_real omega_rad_s, sysid_real flow_kg_s)
{
    if (!(isfinite(pressure_pa) && isfinite(theta_rad) && isfinite(omega_rad_s) &&
        isfinite(flow_kg_s))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_offset_b_m - sysid_pitch_radius_m*theta_rad;
    return sysid_known(((sysid_real)0.0 < sysid_area_b_m2*x0) ?
        sysid_heat_capacity_ratio*(flow_kg_s*sysid_gas_constant_j_per_kg_k*sysid_temperature_k +
        omega_rad_s*pressure_pa*sysid_area_b_m2*sysid_pitch_radius_m)/(sysid_area_b_m2*x0) : NAN);
}

/* The flow into chamber B, kg/s, that gives this dP/dt, Pa/s: (3.3.6) solved. */
static inline sysid_real sysid_flow_for_pressure_rate_b(sysid_real rate_pa_s,
    sysid_real pressure_pa, sysid_real theta_rad, sysid_real omega_rad_s)
{
    if (!(isfinite(rate_pa_s) && isfinite(pressure_pa) && isfinite(theta_rad) &&
        isfinite(omega_rad_s))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_offset_b_m - sysid_pitch_radius_m*theta_rad;
    return sysid_known(((sysid_real)0.0 < sysid_area_b_m2*x0) ?
        (-omega_rad_s*pressure_pa*sysid_area_b_m2*sysid_pitch_radius_m +
        rate_pa_s*sysid_area_b_m2*x0/sysid_heat_capacity_ratio)/(sysid_gas_constant_j_per_kg_k*sysid_temperature_k)
        : NAN);
}

#endif /* SYSID_CONTROLLER_H */
