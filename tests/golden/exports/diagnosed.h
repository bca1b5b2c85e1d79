/*
 * Identified model of a pneumatic actuator, for a controller. Written by sysid export.
 * rig: generated (rotary, horizontal)
 * bundle: sysid-bundle/1, created 2026-11-22T03:24:25+00:00 by sysid 0.1.0
 * bundle SHA-256: 683d37f0077672a96b88c625612f4e2ffe843e8e6ded9426f7eca3ba50e6b664
 * SI, absolute pressures. Equation numbers are those of the thesis, as corrected.
 * Unknown numbers are absent, and their HAS macros are 0. C99, link with the maths library.
 * Numbers are double; -DSYSID_REAL=float makes them single precision.
 *
 * On a microcontroller: include this file in one source file, compile it with -std=c99 -O2,
 * and -DSYSID_REAL=float where the unit for floating point is single. Nothing is allocated, and
 * nothing is global but constants. The folder ..._check next to this file replays numbers of
 * the Python package through it: cmake and ctest on a computer, or check.c with its vectors.h
 * on the target itself.
 * Controllers: each loop keeps its own structs. Each tick (1 ms) sense() turns readings into an
 * estimate; then pva_control() or backstepping_control(), at the start of each PWM period, or
 * dvmpc_control(), at each tick, gives the commands. For other gains copy ..._defaults and
 * change the copy.
 *
 * Numbers that are not finite (NaN, infinite): where an input is one, or what follows from it,
 * a law answers NaN and a duty is 0. -ffast-math drops these checks and is an error.
 * A controller lets go: motor 0, valves off, 0 returned in place of 1, its state as it was but
 * for rejected, which counts such ticks. sense() leaves its memory as it was, counts, and makes
 * the estimate NaN, at which the controllers let go. OFF IS NOT SAFE EVERYWHERE: an arm in the
 * vertical falls, and so does a load on a linear axis. Watch rejected and what is returned, and
 * brake, or stop the rig, where they say so.
 * Effects, in the constants and the functions that end with _with_effects:
 * seal-friction
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
#define SYSID_HAS_FRICTION 1
#define SYSID_HAS_MOTOR 1
#define SYSID_HAS_INERTIA 1
#define SYSID_HAS_VALVE_A_FILLING 1
#define SYSID_HAS_VALVE_A_EXHAUST 1
#define SYSID_HAS_VALVE_A_DISCRETE 1
#define SYSID_HAS_VALVE_A_DELAYS 1
#define SYSID_HAS_CHAMBER_A 1
#define SYSID_HAS_VALVE_B_FILLING 1
#define SYSID_HAS_VALVE_B_EXHAUST 1
#define SYSID_HAS_VALVE_B_DISCRETE 1
#define SYSID_HAS_VALVE_B_DELAYS 1
#define SYSID_HAS_CHAMBER_B 1
#define SYSID_HAS_PWM_A_FILL_BIPOLYNOMIAL 1
#define SYSID_HAS_PWM_A_FILL_NETWORK 1
#define SYSID_HAS_PWM_A_DISCHARGE_BIPOLYNOMIAL 1
#define SYSID_HAS_PWM_A_DISCHARGE_NETWORK 1
#define SYSID_HAS_PWM_B_FILL_BIPOLYNOMIAL 1
#define SYSID_HAS_PWM_B_FILL_NETWORK 1
#define SYSID_HAS_PWM_B_DISCHARGE_BIPOLYNOMIAL 1
#define SYSID_HAS_PWM_B_DISCHARGE_NETWORK 1
#define SYSID_HAS_CONTROLLERS 1
#define SYSID_EFFECTS_ACT_ON_SLIDING_FRICTION 1
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
#define SYSID_EFFECTS_CONTAINED 1
#define SYSID_EFFECTS_NOT_CONTAINED 0
#define SYSID_HAS_MONITOR 1

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
static const sysid_real sysid_friction_static_nm = (sysid_real)0.2865731068780974; /* Nm */
static const sysid_real sysid_friction_coulomb_nm = (sysid_real)0.17057177775170543; /* Nm */
static const sysid_real sysid_friction_viscous_nm_s_per_rad = (sysid_real)0.05487893374853895; /* Nm s/rad */
static const sysid_real sysid_friction_offset_nm = (sysid_real)-0.0028980011028291227; /* Nm; constant torque against positive motion; what is applied is less by it */
static const sysid_real sysid_valve_a_choked_flow_fill_kg_s = (sysid_real)0.000651844856376044; /* kg/s */
static const sysid_real sysid_valve_a_c_fill = (sysid_real)1.2029226466876177e-06; /* kg/(s Pa^0.5) */
static const sysid_real sysid_valve_a_choked_flow_dis_kg_s = (sysid_real)0.0003455052722469696; /* kg/s */
static const sysid_real sysid_valve_a_c_dis = (sysid_real)3.4485245443699327e-09; /* kg/(s Pa) */
static const sysid_real sysid_valve_a_on_delay_s = (sysid_real)0.0015121878951520197; /* s */
static const sysid_real sysid_valve_a_off_delay_s = (sysid_real)0.001942921047752106; /* s */
static const sysid_real sysid_valve_b_choked_flow_fill_kg_s = (sysid_real)0.0011097830799082764; /* kg/s */
static const sysid_real sysid_valve_b_c_fill = (sysid_real)1.570423174688993e-06; /* kg/(s Pa^0.5) */
static const sysid_real sysid_valve_b_choked_flow_dis_kg_s = (sysid_real)0.00042154738143568814; /* kg/s */
static const sysid_real sysid_valve_b_c_dis = (sysid_real)3.775318095818381e-09; /* kg/(s Pa) */
static const sysid_real sysid_valve_b_on_delay_s = (sysid_real)0.0014959375559552319; /* s */
static const sysid_real sysid_valve_b_off_delay_s = (sysid_real)0.0019577100167835846; /* s */

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

/* Friction in full, Nm (3.4.1, corrected). applied = cylinder + motor - gravity, less the constant
   friction_offset_nm where it is known. At rest friction holds against what is applied, up to
   friction_static_nm. */
static inline sysid_real sysid_friction_torque(sysid_real omega_rad_s, sysid_real applied_nm)
{
    if (!(isfinite(omega_rad_s) && isfinite(applied_nm))) {
        return (sysid_real)NAN;
    }
    return sysid_known((omega_rad_s == (sysid_real)0.0) ? sysid_minimum(sysid_maximum(applied_nm,
        -sysid_friction_static_nm), sysid_friction_static_nm) :
        omega_rad_s*sysid_friction_viscous_nm_s_per_rad +
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

/* Flow into chamber A, kg/s, with the valve on (3.6.6). Choked up to 0.53 of the supply, in
   proportion to it; negative above the supply. */
static inline sysid_real sysid_valve_a_filling_flow(sysid_real pressure_pa,
    sysid_real supply_pa)
{
    if (!(isfinite(pressure_pa) && isfinite(supply_pa))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = -pressure_pa + supply_pa;
    const sysid_real x1 = sysid_sqrt(sysid_fabs(x0));
    return sysid_known((pressure_pa <= (sysid_real)0.53*supply_pa) ?
        supply_pa*sysid_valve_a_choked_flow_fill_kg_s/sysid_supply_pressure_pa :
        sysid_valve_a_c_fill*((x0 < (sysid_real)0.0) ? -x1 : x1));
}

/* Flow into chamber A, kg/s, with the valve off (3.6.7, 3.6.10): negative (out) above the
   atmosphere, choked from atmosphere / 0.53 on; air comes in below it. */
static inline sysid_real sysid_valve_a_exhaust_flow(sysid_real pressure_pa,
    sysid_real atmosphere_pa)
{
    if (!(isfinite(pressure_pa) && isfinite(atmosphere_pa))) {
        return (sysid_real)NAN;
    }
    return sysid_known(((sysid_real)1.8867924528301885*atmosphere_pa <= pressure_pa) ?
        -sysid_valve_a_choked_flow_dis_kg_s : sysid_valve_a_c_dis*(atmosphere_pa - pressure_pa));
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

/* Flow into chamber B, kg/s, with the valve on (3.6.6). Choked up to 0.53 of the supply, in
   proportion to it; negative above the supply. */
static inline sysid_real sysid_valve_b_filling_flow(sysid_real pressure_pa,
    sysid_real supply_pa)
{
    if (!(isfinite(pressure_pa) && isfinite(supply_pa))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = -pressure_pa + supply_pa;
    const sysid_real x1 = sysid_sqrt(sysid_fabs(x0));
    return sysid_known((pressure_pa <= (sysid_real)0.53*supply_pa) ?
        supply_pa*sysid_valve_b_choked_flow_fill_kg_s/sysid_supply_pressure_pa :
        sysid_valve_b_c_fill*((x0 < (sysid_real)0.0) ? -x1 : x1));
}

/* Flow into chamber B, kg/s, with the valve off (3.6.7, 3.6.10): negative (out) above the
   atmosphere, choked from atmosphere / 0.53 on; air comes in below it. */
static inline sysid_real sysid_valve_b_exhaust_flow(sysid_real pressure_pa,
    sysid_real atmosphere_pa)
{
    if (!(isfinite(pressure_pa) && isfinite(atmosphere_pa))) {
        return (sysid_real)NAN;
    }
    return sysid_known(((sysid_real)1.8867924528301885*atmosphere_pa <= pressure_pa) ?
        -sysid_valve_b_choked_flow_dis_kg_s : sysid_valve_b_c_dis*(atmosphere_pa - pressure_pa));
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

/* --- effects that the laws above do not include --- */

/* seal-friction */
static const sysid_real sysid_effect_1_seal_torque_nm_per_pa = (sysid_real)2.9542994623283846e-07; /* Nm/Pa */
static const sysid_real sysid_effect_1_difference_share = (sysid_real)0.0014119374232189758; /* - */

/* Friction while moving, Nm (linear rig: N), from that of the base law.
   Effects: seal-friction. */
static inline sysid_real sysid_sliding_friction_with_effects(sysid_real friction, sysid_real
    position, sysid_real velocity, sysid_real pressure_a_pa, sysid_real pressure_b_pa)
{
    if (!(isfinite(friction) && isfinite(position) && isfinite(velocity) &&
        isfinite(pressure_a_pa) && isfinite(pressure_b_pa))) {
        return (sysid_real)NAN;
    }
    sysid_real value = friction;
    const sysid_real direction = sysid_sign(velocity);
    (void)position;
    {
        const sysid_real x0 = pressure_a_pa + pressure_b_pa -
            (sysid_real)2.0*sysid_atmospheric_pressure_pa;
        value =
            direction*sysid_effect_1_seal_torque_nm_per_pa*(sysid_effect_1_difference_share*(-x0 +
            sysid_fabs(pressure_a_pa - pressure_b_pa)) + x0) + value;
    }
    return sysid_known(value);
}

/* --- PWM surfaces ---------------------------------------------------------------------- */

/* Why a value was saturated; combined by |, 0 where nothing was. */
#define SYSID_PRESSURE 1u   /* outside the pressure range; the nearest edge was used */
#define SYSID_ABOVE 2u      /* flow (inverse) or duty (forward) above what was seen */
#define SYSID_BELOW 4u      /* and below */
#define SYSID_NO_ROOT 8u    /* beyond the extremum of the surface (D < 0): its vertex */
#define SYSID_DECREASING 16u /* root where the fitted flow falls with duty, or is flat */
#define SYSID_INVALID 32u   /* an input is not finite; a flow is NaN, a duty 0 */

/* A result where it is finite, else NaN, and of a duty 0, which is flagged. */
static inline sysid_real sysid_known_flagged(sysid_real x, unsigned *flags)
{
    if (!isfinite(x) && flags) {
        *flags = SYSID_INVALID;
    }
    return sysid_known(x);
}

static inline sysid_real sysid_known_flagged_duty(sysid_real x, unsigned *flags)
{
    if (!isfinite(x) && flags) {
        *flags = SYSID_INVALID;
    }
    return sysid_known_duty(x);
}

/* Linear interpolation over rising nodes; beyond them the nearest value. */
static inline sysid_real sysid_interpolate(sysid_real x, const sysid_real *nodes, const sysid_real *values, int count)
{
    if (!isfinite(x)) {
        return (sysid_real)NAN;
    }
    int low = 0, high = count - 1;
    sysid_real slope;
    if (x <= nodes[0]) {
        return sysid_known(values[0]);
    }
    if (x >= nodes[high]) {
        return sysid_known(values[high]);
    }
    while (high - low > 1) {
        int middle = low + (high - low) / 2;
        if (nodes[middle] <= x) {
            low = middle;
        } else {
            high = middle;
        }
    }
    slope = (values[high] - values[low]) / (nodes[high] - nodes[low]);
    return sysid_known(slope * (x - nodes[low]) + values[low]);
}

static const sysid_real sysid_pwm_a_fill_bipolynomial_duty_range[2] = {
    (sysid_real)0.02, (sysid_real)0.9
};
static const sysid_real sysid_pwm_a_fill_bipolynomial_pressure_range[2] = {
    (sysid_real)104744.06637069919, (sysid_real)311977.09845504956
};
static const sysid_real sysid_pwm_a_fill_bipolynomial_pressure[25] = {
    (sysid_real)104744.06637069919, (sysid_real)113378.77604088046, (sysid_real)122013.48571106172, (sysid_real)130648.19538124299,
    (sysid_real)139282.90505142426, (sysid_real)147917.6147216055, (sysid_real)156552.32439178677, (sysid_real)165187.03406196804,
    (sysid_real)173821.7437321493, (sysid_real)182456.45340233058, (sysid_real)191091.16307251184, (sysid_real)199725.87274269311,
    (sysid_real)208360.58241287438, (sysid_real)216995.29208305562, (sysid_real)225630.0017532369, (sysid_real)234264.71142341814,
    (sysid_real)242899.4210935994, (sysid_real)251534.13076378067, (sysid_real)260168.84043396194, (sysid_real)268803.5501041432,
    (sysid_real)277438.2597743245, (sysid_real)286072.96944450575, (sysid_real)294707.679114687, (sysid_real)303342.3887848683,
    (sysid_real)311977.09845504956
};
static const sysid_real sysid_pwm_a_fill_bipolynomial_duty_low[25] = {
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.06, (sysid_real)0.09999999999999999, (sysid_real)0.14000000000000004, (sysid_real)0.18,
    (sysid_real)0.2599999999999999, (sysid_real)0.29999999999999993, (sysid_real)0.3399999999999999, (sysid_real)0.37999999999999995,
    (sysid_real)0.37999999999999995, (sysid_real)0.42, (sysid_real)0.42, (sysid_real)0.42,
    (sysid_real)0.46000000000000013, (sysid_real)0.46000000000000013, (sysid_real)0.5, (sysid_real)0.5,
    (sysid_real)0.5399999999999997, (sysid_real)0.5399999999999997, (sysid_real)0.58, (sysid_real)0.6199999999999997,
    (sysid_real)0.66
};
static const sysid_real sysid_pwm_a_fill_bipolynomial_duty_high[25] = {
    (sysid_real)0.66, (sysid_real)0.8200000000000002, (sysid_real)0.9, (sysid_real)0.9,
    (sysid_real)0.9, (sysid_real)0.9, (sysid_real)0.9, (sysid_real)0.9,
    (sysid_real)0.9, (sysid_real)0.9, (sysid_real)0.9, (sysid_real)0.9,
    (sysid_real)0.9, (sysid_real)0.9, (sysid_real)0.9, (sysid_real)0.9,
    (sysid_real)0.9, (sysid_real)0.9, (sysid_real)0.9, (sysid_real)0.9,
    (sysid_real)0.9, (sysid_real)0.9, (sysid_real)0.9, (sysid_real)0.9,
    (sysid_real)0.9
};
static const sysid_real sysid_pwm_a_fill_bipolynomial_coefficients[9] = {
    (sysid_real)-0.00022109481251411715, (sysid_real)-0.0002550611717216188, (sysid_real)-1.1885345220727444e-05, (sysid_real)0.0007789164848810723,
    (sysid_real)0.00015393914016786065, (sysid_real)0.0002641095815088774, (sysid_real)-0.00010474677752120638, (sysid_real)-0.0002427710729654873,
    (sysid_real)-0.0002975149262028539
};
static const sysid_real sysid_pwm_a_fill_bipolynomial_pressure_scaling[2] = {
    (sysid_real)208274.5318548868, (sysid_real)103530.46548418759
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_a_fill_flow(
    sysid_real duty, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(duty) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_a_fill_bipolynomial_pressure_range[0]),
        sysid_pwm_a_fill_bipolynomial_pressure_range[1]);
    const sysid_real x1 = -sysid_pwm_a_fill_bipolynomial_pressure_scaling[0] + x0;
    const sysid_real x2 = (sysid_real)-1.0 +
        (sysid_real)2.0*sysid_square(x1)/sysid_square(sysid_pwm_a_fill_bipolynomial_pressure_scaling[1]);
    const sysid_real x3 = x1/sysid_pwm_a_fill_bipolynomial_pressure_scaling[1];
    const sysid_real x4 = sysid_minimum(sysid_maximum(duty,
        sysid_pwm_a_fill_bipolynomial_duty_range[0]), sysid_pwm_a_fill_bipolynomial_duty_range[1]);
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | (sysid_interpolate(x0,
            sysid_pwm_a_fill_bipolynomial_pressure, sysid_pwm_a_fill_bipolynomial_duty_high, 25) +
            (sysid_real)1e-09 < duty ? SYSID_ABOVE : 0u) | (duty < sysid_interpolate(x0,
            sysid_pwm_a_fill_bipolynomial_pressure, sysid_pwm_a_fill_bipolynomial_duty_low, 25) +
            (sysid_real)-1e-09 ? SYSID_BELOW : 0u);
    }
    return sysid_known_flagged(sysid_pwm_a_fill_bipolynomial_coefficients[0] +
        sysid_pwm_a_fill_bipolynomial_coefficients[1]*x3 +
        sysid_pwm_a_fill_bipolynomial_coefficients[2]*x2 +
        x4*(sysid_pwm_a_fill_bipolynomial_coefficients[3] +
        sysid_pwm_a_fill_bipolynomial_coefficients[4]*x3 +
        sysid_pwm_a_fill_bipolynomial_coefficients[5]*x2 +
        x4*(sysid_pwm_a_fill_bipolynomial_coefficients[6] +
        sysid_pwm_a_fill_bipolynomial_coefficients[7]*x3 +
        sysid_pwm_a_fill_bipolynomial_coefficients[8]*x2)), flags);
}

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_a_fill_duty(
    sysid_real flow_kg_s, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return 0;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_a_fill_bipolynomial_pressure_range[0]),
        sysid_pwm_a_fill_bipolynomial_pressure_range[1]);
    const sysid_real x1 = -sysid_pwm_a_fill_bipolynomial_pressure_scaling[0] + x0;
    const sysid_real x2 = (sysid_real)-1.0 +
        (sysid_real)2.0*sysid_square(x1)/sysid_square(sysid_pwm_a_fill_bipolynomial_pressure_scaling[1]);
    const sysid_real x3 = sysid_pwm_a_fill_bipolynomial_coefficients[8]*x2;
    const sysid_real x4 = x1/sysid_pwm_a_fill_bipolynomial_pressure_scaling[1];
    const sysid_real x5 = sysid_pwm_a_fill_bipolynomial_coefficients[7]*x4;
    const sysid_real x6 = (sysid_real)2.0*sysid_pwm_a_fill_bipolynomial_coefficients[6] +
        (sysid_real)2.0*x3 + (sysid_real)2.0*x5;
    const sysid_real x7 = sysid_interpolate(x0, sysid_pwm_a_fill_bipolynomial_pressure,
        sysid_pwm_a_fill_bipolynomial_duty_low, 25);
    const sysid_real x8 = sysid_pwm_a_fill_bipolynomial_coefficients[3] +
        sysid_pwm_a_fill_bipolynomial_coefficients[4]*x4 +
        sysid_pwm_a_fill_bipolynomial_coefficients[5]*x2;
    const sysid_real x9 = x6*x7 + x8;
    const sysid_real x10 = sysid_interpolate(x0, sysid_pwm_a_fill_bipolynomial_pressure,
        sysid_pwm_a_fill_bipolynomial_duty_high, 25);
    const sysid_real x11 = x10*x6 + x8;
    const int x12 = ((x9 <= (sysid_real)0.0) && (x11 <= (sysid_real)0.0)) && ((x9 <
        (sysid_real)0.0) || (x11 < (sysid_real)0.0));
    const sysid_real x13 = sysid_pwm_a_fill_bipolynomial_coefficients[6] + x3 + x5;
    const int x14 = x13 != (sysid_real)0.0;
    const sysid_real x15 = x12 ? -x10 : x7;
    const sysid_real x16 = x12 ? -x8 : x8;
    const sysid_real x17 = ((sysid_real)0.5)/(x14 ? x13 : (sysid_real)1.0);
    const sysid_real x18 = -x16*x17;
    const sysid_real x19 = x12 ? -x7 : x10;
    const int x20 = (x14 && (x15 < x18)) && (x18 < x19);
    const int x21 = (sysid_real)0.0 < x13;
    const sysid_real x22 = (x20 && x21) ? x18 : x15;
    const sysid_real x23 = sysid_pwm_a_fill_bipolynomial_coefficients[2]*x2;
    const sysid_real x24 = sysid_pwm_a_fill_bipolynomial_coefficients[1]*x4;
    const sysid_real x25 = sysid_pwm_a_fill_bipolynomial_coefficients[0] + x23 + x24;
    const int x26 = flow_kg_s < x22*(x13*x22 + x16) + x25;
    const int x27 = x13 < (sysid_real)0.0;
    const sysid_real x28 = (x20 && x27) ? x18 : x19;
    const int x29 = x25 + x28*(x13*x28 + x16) < flow_kg_s;
    const sysid_real x30 = sysid_sqrt(sysid_maximum(sysid_square(x16) - (-flow_kg_s +
        x25)*((sysid_real)4.0*sysid_pwm_a_fill_bipolynomial_coefficients[6] + (sysid_real)4.0*x3 +
        (sysid_real)4.0*x5), (sysid_real)0.0));
    const sysid_real x31 = x16 + x30;
    const int x32 = x31 != (sysid_real)0.0;
    const sysid_real x33 = x26 ? x22 : (x29 ? x28 : sysid_minimum(sysid_maximum(((sysid_real)0.0
        <= x16) ? (x32 ? ((sysid_real)2.0*flow_kg_s -
        (sysid_real)2.0*sysid_pwm_a_fill_bipolynomial_coefficients[0] - (sysid_real)2.0*x23 -
        (sysid_real)2.0*x24)/(x32 ? x31 : (sysid_real)1.0) : x22) : x17*(-x16 + x30), x22), x28));
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | (x26 ? SYSID_BELOW : 0u) | (x29 ?
            SYSID_ABOVE : 0u) | (x20 && ((x26 && x21) || (x29 && x27)) ? SYSID_NO_ROOT : 0u) | (x12
            || ((x13 == (sysid_real)0.0) && (x16 == (sysid_real)0.0)) ? SYSID_DECREASING : 0u);
    }
    return sysid_known_flagged_duty(x12 ? -x33 : x33, flags);
}

static const sysid_real sysid_pwm_a_fill_network_duty_range[2] = {
    (sysid_real)0.02, (sysid_real)0.9
};
static const sysid_real sysid_pwm_a_fill_network_pressure_range[2] = {
    (sysid_real)104744.06637069919, (sysid_real)311977.09845504956
};
static const sysid_real sysid_pwm_a_fill_network_pressure[25] = {
    (sysid_real)104744.06637069919, (sysid_real)113378.77604088046, (sysid_real)122013.48571106172, (sysid_real)130648.19538124299,
    (sysid_real)139282.90505142426, (sysid_real)147917.6147216055, (sysid_real)156552.32439178677, (sysid_real)165187.03406196804,
    (sysid_real)173821.7437321493, (sysid_real)182456.45340233058, (sysid_real)191091.16307251184, (sysid_real)199725.87274269311,
    (sysid_real)208360.58241287438, (sysid_real)216995.29208305562, (sysid_real)225630.0017532369, (sysid_real)234264.71142341814,
    (sysid_real)242899.4210935994, (sysid_real)251534.13076378067, (sysid_real)260168.84043396194, (sysid_real)268803.5501041432,
    (sysid_real)277438.2597743245, (sysid_real)286072.96944450575, (sysid_real)294707.679114687, (sysid_real)303342.3887848683,
    (sysid_real)311977.09845504956
};
static const sysid_real sysid_pwm_a_fill_network_flow_low[25] = {
    (sysid_real)3.18317802843003e-05, (sysid_real)1.1658913546790986e-05, (sysid_real)1.8228548968747756e-06, (sysid_real)1.8228548968747756e-06,
    (sysid_real)6.75169307595436e-07, (sysid_real)6.75169307595436e-07, (sysid_real)1.2852827079503678e-06, (sysid_real)4.4683173311523113e-07,
    (sysid_real)4.4683173311523113e-07, (sysid_real)8.055582835720741e-07, (sysid_real)6.162241365307918e-06, (sysid_real)4.721196223944483e-06,
    (sysid_real)4.721196223944483e-06, (sysid_real)1.2347931263943133e-05, (sysid_real)8.86322961734822e-06, (sysid_real)8.86322961734822e-06,
    (sysid_real)1.3607386625351516e-05, (sysid_real)1.3607386625351516e-05, (sysid_real)1.205786685581445e-05, (sysid_real)1.205786685581445e-05,
    (sysid_real)6.141412977509583e-06, (sysid_real)6.141412977509583e-06, (sysid_real)3.920142720845734e-06, (sysid_real)3.1139151717965583e-07,
    (sysid_real)3.1139151717965583e-07
};
static const sysid_real sysid_pwm_a_fill_network_flow_high[25] = {
    (sysid_real)0.00047605149311621633, (sysid_real)0.000590419195702579, (sysid_real)0.0006455063430717632, (sysid_real)0.0006455063430717632,
    (sysid_real)0.0006425866526091067, (sysid_real)0.0006396669621464502, (sysid_real)0.0006377205018380125, (sysid_real)0.0005851209038943469,
    (sysid_real)0.0005106470531310656, (sysid_real)0.00046099781928887794, (sysid_real)0.0004223692562658295, (sysid_real)0.0004010653836328728,
    (sysid_real)0.0003911300025507021, (sysid_real)0.0003780739615749205, (sysid_real)0.0003571718242167785, (sysid_real)0.00034422060494497585,
    (sysid_real)0.0003221854763690725, (sysid_real)0.00029761218115898803, (sysid_real)0.00028435033010313905, (sysid_real)0.0002599743903938061,
    (sysid_real)0.00023639653166381285, (sysid_real)0.00021569527309981315, (sysid_real)0.0001789401133658255, (sysid_real)0.00013990730893251253,
    (sysid_real)0.00010072860897209889
};
static const sysid_real sysid_pwm_a_fill_network_flow_weights[10] = {
    (sysid_real)0.470947355611833, (sysid_real)-0.3804042316432098, (sysid_real)-5.804448118662301, (sysid_real)0.42893578360682305,
    (sysid_real)-0.09561843531436495, (sysid_real)0.016676949454351192, (sysid_real)0.14114620674902376, (sysid_real)0.0499969452805037,
    (sysid_real)6.594979452392631, (sysid_real)0.5053217974782912
};
static const sysid_real sysid_pwm_a_fill_network_pressure_weights[10] = {
    (sysid_real)18.541771116503863, (sysid_real)-1.5734286202245131, (sysid_real)-24.399608562698724, (sysid_real)17.509462482321478,
    (sysid_real)0.0025263537201096137, (sysid_real)5.478807028323046, (sysid_real)-3.9148492239660095, (sysid_real)-4.781409288631005,
    (sysid_real)27.10520740474535, (sysid_real)3.8265824694813206
};
static const sysid_real sysid_pwm_a_fill_network_hidden_bias[10] = {
    (sysid_real)8.789518711723254, (sysid_real)1.8944041453861302, (sysid_real)19.50953837759331, (sysid_real)8.245473377773804,
    (sysid_real)-0.10474426260955369, (sysid_real)1.597489759905185, (sysid_real)-1.2003979736549657, (sysid_real)-1.4393285297801175,
    (sysid_real)-21.03274218735849, (sysid_real)4.9034742623209855
};
static const sysid_real sysid_pwm_a_fill_network_output_weights[10] = {
    (sysid_real)-4.343320213184484, (sysid_real)-1.9310346559793419, (sysid_real)-11.958108655334893, (sysid_real)4.814124520697032,
    (sysid_real)-10.664748023420284, (sysid_real)7.695929796223134, (sysid_real)-5.851058523527893, (sysid_real)13.552261469116127,
    (sysid_real)-5.747379311825178, (sysid_real)0.39713177204152267
};
static const sysid_real sysid_pwm_a_fill_network_output_bias[1] = {
    (sysid_real)7.036683879388958
};
static const sysid_real sysid_pwm_a_fill_network_scaling[6] = {
    (sysid_real)0.0003228513284479683, (sysid_real)0.0003228138518838768, (sysid_real)208274.5318548868, (sysid_real)103530.46548418759,
    (sysid_real)0.46, (sysid_real)0.44
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_a_fill_network_flow(
    sysid_real duty, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(duty) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(duty,
        sysid_pwm_a_fill_network_duty_range[0]), sysid_pwm_a_fill_network_duty_range[1]);
    const sysid_real x1 = (sysid_real)1.0/sysid_pwm_a_fill_network_scaling[1];
    const sysid_real x2 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_a_fill_network_pressure_range[0]), sysid_pwm_a_fill_network_pressure_range[1]);
    const sysid_real x3 = sysid_interpolate(x2, sysid_pwm_a_fill_network_pressure,
        sysid_pwm_a_fill_network_flow_low, 25);
    const sysid_real x4 = -x3;
    const sysid_real x5 = x1*(-sysid_pwm_a_fill_network_scaling[0] - x4);
    const sysid_real x6 = (-sysid_pwm_a_fill_network_scaling[2] +
        x2)/sysid_pwm_a_fill_network_scaling[3];
    const sysid_real x7 = sysid_pwm_a_fill_network_hidden_bias[0] +
        sysid_pwm_a_fill_network_pressure_weights[0]*x6;
    const sysid_real x8 = sysid_pwm_a_fill_network_hidden_bias[1] +
        sysid_pwm_a_fill_network_pressure_weights[1]*x6;
    const sysid_real x9 = sysid_pwm_a_fill_network_hidden_bias[2] +
        sysid_pwm_a_fill_network_pressure_weights[2]*x6;
    const sysid_real x10 = sysid_pwm_a_fill_network_hidden_bias[3] +
        sysid_pwm_a_fill_network_pressure_weights[3]*x6;
    const sysid_real x11 = sysid_pwm_a_fill_network_hidden_bias[4] +
        sysid_pwm_a_fill_network_pressure_weights[4]*x6;
    const sysid_real x12 = sysid_pwm_a_fill_network_hidden_bias[5] +
        sysid_pwm_a_fill_network_pressure_weights[5]*x6;
    const sysid_real x13 = sysid_pwm_a_fill_network_hidden_bias[6] +
        sysid_pwm_a_fill_network_pressure_weights[6]*x6;
    const sysid_real x14 = sysid_pwm_a_fill_network_hidden_bias[7] +
        sysid_pwm_a_fill_network_pressure_weights[7]*x6;
    const sysid_real x15 = sysid_pwm_a_fill_network_hidden_bias[8] +
        sysid_pwm_a_fill_network_pressure_weights[8]*x6;
    const sysid_real x16 = sysid_pwm_a_fill_network_hidden_bias[9] +
        sysid_pwm_a_fill_network_pressure_weights[9]*x6;
    const sysid_real x17 = sysid_pwm_a_fill_network_scaling[4] +
        sysid_pwm_a_fill_network_scaling[5]*(sysid_pwm_a_fill_network_output_bias[0] +
        sysid_pwm_a_fill_network_output_weights[0]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[0]*x5
        + x7) +
        sysid_pwm_a_fill_network_output_weights[1]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[1]*x5
        + x8) +
        sysid_pwm_a_fill_network_output_weights[2]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[2]*x5
        + x9) +
        sysid_pwm_a_fill_network_output_weights[3]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[3]*x5
        + x10) +
        sysid_pwm_a_fill_network_output_weights[4]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[4]*x5
        + x11) +
        sysid_pwm_a_fill_network_output_weights[5]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[5]*x5
        + x12) +
        sysid_pwm_a_fill_network_output_weights[6]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[6]*x5
        + x13) +
        sysid_pwm_a_fill_network_output_weights[7]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[7]*x5
        + x14) +
        sysid_pwm_a_fill_network_output_weights[8]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[8]*x5
        + x15) +
        sysid_pwm_a_fill_network_output_weights[9]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[9]*x5
        + x16));
    const int x18 = x0 <= x17;
    const sysid_real x19 = -sysid_pwm_a_fill_network_scaling[0];
    const sysid_real x20 = sysid_interpolate(x2, sysid_pwm_a_fill_network_pressure,
        sysid_pwm_a_fill_network_flow_high, 25);
    const sysid_real x21 = x20 + x4;
    const sysid_real x46 = (sysid_real)1.0/x21;
    sysid_real s0_0, s0_1, s0_2, s0_3;
    int ik0;
    {
        s0_0 = x18 ? (sysid_real)1.0 : (sysid_real)0.0;
        s0_1 = x3;
        s0_2 = x3;
        s0_3 = x17;
    }
    for (ik0 = 0; ik0 < 32; ik0++) {
        const sysid_real k0 = (sysid_real)ik0;
        const sysid_real x22 = x21*(((sysid_real)0.03125)*k0 + (sysid_real)0.03125) + x3;
        const sysid_real x23 = x1*(x19 + x22);
        const sysid_real x24 = sysid_pwm_a_fill_network_scaling[4] +
            sysid_pwm_a_fill_network_scaling[5]*(sysid_pwm_a_fill_network_output_bias[0] +
            sysid_pwm_a_fill_network_output_weights[0]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[0]*x23
            + x7) +
            sysid_pwm_a_fill_network_output_weights[1]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[1]*x23
            + x8) +
            sysid_pwm_a_fill_network_output_weights[2]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[2]*x23
            + x9) +
            sysid_pwm_a_fill_network_output_weights[3]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[3]*x23
            + x10) +
            sysid_pwm_a_fill_network_output_weights[4]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[4]*x23
            + x11) +
            sysid_pwm_a_fill_network_output_weights[5]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[5]*x23
            + x12) +
            sysid_pwm_a_fill_network_output_weights[6]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[6]*x23
            + x13) +
            sysid_pwm_a_fill_network_output_weights[7]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[7]*x23
            + x14) +
            sysid_pwm_a_fill_network_output_weights[8]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[8]*x23
            + x15) +
            sysid_pwm_a_fill_network_output_weights[9]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[9]*x23
            + x16));
        const sysid_real x25 = (x0 <= x24) ? (sysid_real)1.0 : s0_0;
        const int x26 = s0_3 < x24;
        const sysid_real y0 = x25;
        const sysid_real y1 = ((sysid_real)0.0 < x25) ? s0_1 : x22;
        const sysid_real y2 = x26 ? x22 : s0_2;
        const sysid_real y3 = x26 ? x24 : s0_3;
        s0_0 = y0;
        s0_1 = y1;
        s0_2 = y2;
        s0_3 = y3;
    }
    sysid_real s1_0, s1_1, s1_2, s1_3;
    int ik1;
    {
        s1_0 = s0_1;
        s1_1 = s0_1 + ((sysid_real)0.03125)*x20 - (sysid_real)0.03125*x3;
        s1_2 = (sysid_real)1.0*s0_1 + (sysid_real)0.015625*x20 - (sysid_real)0.015625*x3;
        s1_3 = (sysid_real)1.0;
    }
    for (ik1 = 0; ik1 < 60; ik1++) {
        if (!((sysid_real)2.220446049250313e-16 < s1_3)) {
            break;
        }
        const sysid_real x27 = x1*(s1_2 + x19);
        const sysid_real x28 = sysid_tanh(sysid_pwm_a_fill_network_flow_weights[0]*x27 + x7);
        const sysid_real x29 = sysid_tanh(sysid_pwm_a_fill_network_flow_weights[1]*x27 + x8);
        const sysid_real x30 = sysid_tanh(sysid_pwm_a_fill_network_flow_weights[2]*x27 + x9);
        const sysid_real x31 = sysid_tanh(sysid_pwm_a_fill_network_flow_weights[3]*x27 + x10);
        const sysid_real x32 = sysid_tanh(sysid_pwm_a_fill_network_flow_weights[4]*x27 + x11);
        const sysid_real x33 = sysid_tanh(sysid_pwm_a_fill_network_flow_weights[5]*x27 + x12);
        const sysid_real x34 = sysid_tanh(sysid_pwm_a_fill_network_flow_weights[6]*x27 + x13);
        const sysid_real x35 = sysid_tanh(sysid_pwm_a_fill_network_flow_weights[7]*x27 + x14);
        const sysid_real x36 = sysid_tanh(sysid_pwm_a_fill_network_flow_weights[8]*x27 + x15);
        const sysid_real x37 = sysid_tanh(sysid_pwm_a_fill_network_flow_weights[9]*x27 + x16);
        const sysid_real x38 = sysid_pwm_a_fill_network_scaling[4] +
            sysid_pwm_a_fill_network_scaling[5]*(sysid_pwm_a_fill_network_output_bias[0] +
            sysid_pwm_a_fill_network_output_weights[0]*x28 +
            sysid_pwm_a_fill_network_output_weights[1]*x29 +
            sysid_pwm_a_fill_network_output_weights[2]*x30 +
            sysid_pwm_a_fill_network_output_weights[3]*x31 +
            sysid_pwm_a_fill_network_output_weights[4]*x32 +
            sysid_pwm_a_fill_network_output_weights[5]*x33 +
            sysid_pwm_a_fill_network_output_weights[6]*x34 +
            sysid_pwm_a_fill_network_output_weights[7]*x35 +
            sysid_pwm_a_fill_network_output_weights[8]*x36 +
            sysid_pwm_a_fill_network_output_weights[9]*x37);
        const int x39 = x0 <= x38;
        const sysid_real x40 = x39 ? s1_0 : s1_2;
        const sysid_real x41 = x39 ? s1_2 : s1_1;
        const sysid_real x42 =
            sysid_pwm_a_fill_network_scaling[5]*x1*(sysid_pwm_a_fill_network_flow_weights[0]*sysid_pwm_a_fill_network_output_weights[0]*((sysid_real)1.0
            - sysid_square(x28)) +
            sysid_pwm_a_fill_network_flow_weights[1]*sysid_pwm_a_fill_network_output_weights[1]*((sysid_real)1.0
            - sysid_square(x29)) +
            sysid_pwm_a_fill_network_flow_weights[2]*sysid_pwm_a_fill_network_output_weights[2]*((sysid_real)1.0
            - sysid_square(x30)) +
            sysid_pwm_a_fill_network_flow_weights[3]*sysid_pwm_a_fill_network_output_weights[3]*((sysid_real)1.0
            - sysid_square(x31)) +
            sysid_pwm_a_fill_network_flow_weights[4]*sysid_pwm_a_fill_network_output_weights[4]*((sysid_real)1.0
            - sysid_square(x32)) +
            sysid_pwm_a_fill_network_flow_weights[5]*sysid_pwm_a_fill_network_output_weights[5]*((sysid_real)1.0
            - sysid_square(x33)) +
            sysid_pwm_a_fill_network_flow_weights[6]*sysid_pwm_a_fill_network_output_weights[6]*((sysid_real)1.0
            - sysid_square(x34)) +
            sysid_pwm_a_fill_network_flow_weights[7]*sysid_pwm_a_fill_network_output_weights[7]*((sysid_real)1.0
            - sysid_square(x35)) +
            sysid_pwm_a_fill_network_flow_weights[8]*sysid_pwm_a_fill_network_output_weights[8]*((sysid_real)1.0
            - sysid_square(x36)) +
            sysid_pwm_a_fill_network_flow_weights[9]*sysid_pwm_a_fill_network_output_weights[9]*((sysid_real)1.0
            - sysid_square(x37)));
        const sysid_real x43 = s1_2 - (-x0 + x38)/((x42 == (sysid_real)0.0) ? (sysid_real)1.0 :
            x42);
        const int x44 = (x40 <= x43) && (x43 <= x41);
        const sysid_real x45 = x44 ? x43 : (sysid_real)0.5*x40 + (sysid_real)0.5*x41;
        const sysid_real y0 = x40;
        const sysid_real y1 = x41;
        const sysid_real y2 = x45;
        const sysid_real y3 = x44 ? (sysid_real)0.000244140625*x46*sysid_fabs(-s1_2 + x45) :
            x46*(-x40 + x41);
        s1_0 = y0;
        s1_1 = y1;
        s1_2 = y2;
        s1_3 = y3;
    }
    const int x47 = (sysid_real)0.0 < s0_0;
    if (flags) {
        *flags = (x2 != pressure_pa ? SYSID_PRESSURE : 0u) |
            ((sysid_pwm_a_fill_network_duty_range[1] + (sysid_real)1e-09 < duty) || !x47 ?
            SYSID_ABOVE : 0u) | ((duty < sysid_pwm_a_fill_network_duty_range[0] +
            (sysid_real)-1e-09) || (x0 < x17) ? SYSID_BELOW : 0u);
    }
    return sysid_known_flagged(x18 ? x3 : (x47 ? s1_2 : s0_2), flags);
}

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_a_fill_network_duty(
    sysid_real flow_kg_s, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return 0;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_a_fill_network_pressure_range[0]), sysid_pwm_a_fill_network_pressure_range[1]);
    const sysid_real x1 = sysid_interpolate(x0, sysid_pwm_a_fill_network_pressure,
        sysid_pwm_a_fill_network_flow_low, 25);
    const sysid_real x2 = sysid_interpolate(x0, sysid_pwm_a_fill_network_pressure,
        sysid_pwm_a_fill_network_flow_high, 25);
    const sysid_real x3 = (-sysid_pwm_a_fill_network_scaling[0] +
        sysid_minimum(sysid_maximum(flow_kg_s, x1), x2))/sysid_pwm_a_fill_network_scaling[1];
    const sysid_real x4 = (-sysid_pwm_a_fill_network_scaling[2] +
        x0)/sysid_pwm_a_fill_network_scaling[3];
    const sysid_real x5 = sysid_pwm_a_fill_network_scaling[4] +
        sysid_pwm_a_fill_network_scaling[5]*(sysid_pwm_a_fill_network_output_bias[0] +
        sysid_pwm_a_fill_network_output_weights[0]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[0]*x3
        + sysid_pwm_a_fill_network_hidden_bias[0] + sysid_pwm_a_fill_network_pressure_weights[0]*x4)
        +
        sysid_pwm_a_fill_network_output_weights[1]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[1]*x3
        + sysid_pwm_a_fill_network_hidden_bias[1] + sysid_pwm_a_fill_network_pressure_weights[1]*x4)
        +
        sysid_pwm_a_fill_network_output_weights[2]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[2]*x3
        + sysid_pwm_a_fill_network_hidden_bias[2] + sysid_pwm_a_fill_network_pressure_weights[2]*x4)
        +
        sysid_pwm_a_fill_network_output_weights[3]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[3]*x3
        + sysid_pwm_a_fill_network_hidden_bias[3] + sysid_pwm_a_fill_network_pressure_weights[3]*x4)
        +
        sysid_pwm_a_fill_network_output_weights[4]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[4]*x3
        + sysid_pwm_a_fill_network_hidden_bias[4] + sysid_pwm_a_fill_network_pressure_weights[4]*x4)
        +
        sysid_pwm_a_fill_network_output_weights[5]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[5]*x3
        + sysid_pwm_a_fill_network_hidden_bias[5] + sysid_pwm_a_fill_network_pressure_weights[5]*x4)
        +
        sysid_pwm_a_fill_network_output_weights[6]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[6]*x3
        + sysid_pwm_a_fill_network_hidden_bias[6] + sysid_pwm_a_fill_network_pressure_weights[6]*x4)
        +
        sysid_pwm_a_fill_network_output_weights[7]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[7]*x3
        + sysid_pwm_a_fill_network_hidden_bias[7] + sysid_pwm_a_fill_network_pressure_weights[7]*x4)
        +
        sysid_pwm_a_fill_network_output_weights[8]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[8]*x3
        + sysid_pwm_a_fill_network_hidden_bias[8] + sysid_pwm_a_fill_network_pressure_weights[8]*x4)
        +
        sysid_pwm_a_fill_network_output_weights[9]*sysid_tanh(sysid_pwm_a_fill_network_flow_weights[9]*x3
        + sysid_pwm_a_fill_network_hidden_bias[9] +
        sysid_pwm_a_fill_network_pressure_weights[9]*x4));
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | ((x2 < flow_kg_s) ||
            (sysid_pwm_a_fill_network_duty_range[1] < x5) ? SYSID_ABOVE : 0u) | ((flow_kg_s < x1) ||
            (x5 < sysid_pwm_a_fill_network_duty_range[0]) ? SYSID_BELOW : 0u);
    }
    return sysid_known_flagged_duty(sysid_minimum(sysid_maximum(x5, sysid_pwm_a_fill_network_duty_range[0]),
        sysid_pwm_a_fill_network_duty_range[1]), flags);
}

static const sysid_real sysid_pwm_a_discharge_bipolynomial_duty_range[2] = {
    (sysid_real)0.02, (sysid_real)0.74
};
static const sysid_real sysid_pwm_a_discharge_bipolynomial_pressure_range[2] = {
    (sysid_real)123712.22359142273, (sysid_real)309116.42611047137
};
static const sysid_real sysid_pwm_a_discharge_bipolynomial_pressure[25] = {
    (sysid_real)123712.22359142273, (sysid_real)131437.39869638308, (sysid_real)139162.57380134345, (sysid_real)146887.7489063038,
    (sysid_real)154612.92401126417, (sysid_real)162338.09911622453, (sysid_real)170063.2742211849, (sysid_real)177788.44932614526,
    (sysid_real)185513.62443110562, (sysid_real)193238.79953606596, (sysid_real)200963.97464102635, (sysid_real)208689.14974598668,
    (sysid_real)216414.32485094707, (sysid_real)224139.4999559074, (sysid_real)231864.67506086777, (sysid_real)239589.85016582813,
    (sysid_real)247315.0252707885, (sysid_real)255040.20037574886, (sysid_real)262765.3754807092, (sysid_real)270490.5505856696,
    (sysid_real)278215.7256906299, (sysid_real)285940.9007955903, (sysid_real)293666.07590055064, (sysid_real)301391.25100551103,
    (sysid_real)309116.42611047137
};
static const sysid_real sysid_pwm_a_discharge_bipolynomial_duty_low[25] = {
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.060000000000000026
};
static const sysid_real sysid_pwm_a_discharge_bipolynomial_duty_high[25] = {
    (sysid_real)0.02, (sysid_real)0.060000000000000026, (sysid_real)0.10000000000000003, (sysid_real)0.10000000000000003,
    (sysid_real)0.14000000000000007, (sysid_real)0.22000000000000006, (sysid_real)0.2599999999999999, (sysid_real)0.29999999999999993,
    (sysid_real)0.3399999999999999, (sysid_real)0.3399999999999999, (sysid_real)0.3399999999999999, (sysid_real)0.3399999999999999,
    (sysid_real)0.37999999999999995, (sysid_real)0.37999999999999995, (sysid_real)0.37999999999999995, (sysid_real)0.42,
    (sysid_real)0.42, (sysid_real)0.4600000000000001, (sysid_real)0.4600000000000001, (sysid_real)0.5,
    (sysid_real)0.54, (sysid_real)0.58, (sysid_real)0.62, (sysid_real)0.74,
    (sysid_real)0.74
};
static const sysid_real sysid_pwm_a_discharge_bipolynomial_coefficients[9] = {
    (sysid_real)-0.00020718250638355204, (sysid_real)-0.00012911958569627338, (sysid_real)7.707800684885808e-05, (sysid_real)0.0007036375023759021,
    (sysid_real)-0.0002868123064877891, (sysid_real)-0.0001211524491114661, (sysid_real)-0.0007220523030818805, (sysid_real)0.0012084309620804174,
    (sysid_real)-0.0004223876002813121
};
static const sysid_real sysid_pwm_a_discharge_bipolynomial_pressure_scaling[2] = {
    (sysid_real)216570.90263255802, (sysid_real)92000.19607774711
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_a_discharge_flow(
    sysid_real duty, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(duty) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_a_discharge_bipolynomial_pressure_range[0]),
        sysid_pwm_a_discharge_bipolynomial_pressure_range[1]);
    const sysid_real x1 = -sysid_pwm_a_discharge_bipolynomial_pressure_scaling[0] + x0;
    const sysid_real x2 = (sysid_real)-1.0 +
        (sysid_real)2.0*sysid_square(x1)/sysid_square(sysid_pwm_a_discharge_bipolynomial_pressure_scaling[1]);
    const sysid_real x3 = x1/sysid_pwm_a_discharge_bipolynomial_pressure_scaling[1];
    const sysid_real x4 = sysid_minimum(sysid_maximum(duty,
        sysid_pwm_a_discharge_bipolynomial_duty_range[0]),
        sysid_pwm_a_discharge_bipolynomial_duty_range[1]);
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | (sysid_interpolate(x0,
            sysid_pwm_a_discharge_bipolynomial_pressure,
            sysid_pwm_a_discharge_bipolynomial_duty_high, 25) + (sysid_real)1e-09 < duty ?
            SYSID_ABOVE : 0u) | (duty < sysid_interpolate(x0,
            sysid_pwm_a_discharge_bipolynomial_pressure,
            sysid_pwm_a_discharge_bipolynomial_duty_low, 25) + (sysid_real)-1e-09 ? SYSID_BELOW :
            0u);
    }
    return sysid_known_flagged(sysid_pwm_a_discharge_bipolynomial_coefficients[0] +
        sysid_pwm_a_discharge_bipolynomial_coefficients[1]*x3 +
        sysid_pwm_a_discharge_bipolynomial_coefficients[2]*x2 +
        x4*(sysid_pwm_a_discharge_bipolynomial_coefficients[3] +
        sysid_pwm_a_discharge_bipolynomial_coefficients[4]*x3 +
        sysid_pwm_a_discharge_bipolynomial_coefficients[5]*x2 +
        x4*(sysid_pwm_a_discharge_bipolynomial_coefficients[6] +
        sysid_pwm_a_discharge_bipolynomial_coefficients[7]*x3 +
        sysid_pwm_a_discharge_bipolynomial_coefficients[8]*x2)), flags);
}

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_a_discharge_duty(
    sysid_real flow_kg_s, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return 0;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_a_discharge_bipolynomial_pressure_range[0]),
        sysid_pwm_a_discharge_bipolynomial_pressure_range[1]);
    const sysid_real x1 = -sysid_pwm_a_discharge_bipolynomial_pressure_scaling[0] + x0;
    const sysid_real x2 = (sysid_real)-1.0 +
        (sysid_real)2.0*sysid_square(x1)/sysid_square(sysid_pwm_a_discharge_bipolynomial_pressure_scaling[1]);
    const sysid_real x3 = sysid_pwm_a_discharge_bipolynomial_coefficients[8]*x2;
    const sysid_real x4 = x1/sysid_pwm_a_discharge_bipolynomial_pressure_scaling[1];
    const sysid_real x5 = sysid_pwm_a_discharge_bipolynomial_coefficients[7]*x4;
    const sysid_real x6 = (sysid_real)2.0*sysid_pwm_a_discharge_bipolynomial_coefficients[6] +
        (sysid_real)2.0*x3 + (sysid_real)2.0*x5;
    const sysid_real x7 = sysid_interpolate(x0, sysid_pwm_a_discharge_bipolynomial_pressure,
        sysid_pwm_a_discharge_bipolynomial_duty_low, 25);
    const sysid_real x8 = sysid_pwm_a_discharge_bipolynomial_coefficients[3] +
        sysid_pwm_a_discharge_bipolynomial_coefficients[4]*x4 +
        sysid_pwm_a_discharge_bipolynomial_coefficients[5]*x2;
    const sysid_real x9 = x6*x7 + x8;
    const sysid_real x10 = sysid_interpolate(x0, sysid_pwm_a_discharge_bipolynomial_pressure,
        sysid_pwm_a_discharge_bipolynomial_duty_high, 25);
    const sysid_real x11 = x10*x6 + x8;
    const int x12 = ((x9 <= (sysid_real)0.0) && (x11 <= (sysid_real)0.0)) && ((x9 <
        (sysid_real)0.0) || (x11 < (sysid_real)0.0));
    const sysid_real x13 = sysid_pwm_a_discharge_bipolynomial_coefficients[6] + x3 + x5;
    const int x14 = x13 != (sysid_real)0.0;
    const sysid_real x15 = x12 ? -x10 : x7;
    const sysid_real x16 = x12 ? -x8 : x8;
    const sysid_real x17 = ((sysid_real)0.5)/(x14 ? x13 : (sysid_real)1.0);
    const sysid_real x18 = -x16*x17;
    const sysid_real x19 = x12 ? -x7 : x10;
    const int x20 = (x14 && (x15 < x18)) && (x18 < x19);
    const int x21 = (sysid_real)0.0 < x13;
    const sysid_real x22 = (x20 && x21) ? x18 : x15;
    const sysid_real x23 = sysid_pwm_a_discharge_bipolynomial_coefficients[2]*x2;
    const sysid_real x24 = sysid_pwm_a_discharge_bipolynomial_coefficients[1]*x4;
    const sysid_real x25 = sysid_pwm_a_discharge_bipolynomial_coefficients[0] + x23 + x24;
    const int x26 = flow_kg_s < x22*(x13*x22 + x16) + x25;
    const int x27 = x13 < (sysid_real)0.0;
    const sysid_real x28 = (x20 && x27) ? x18 : x19;
    const int x29 = x25 + x28*(x13*x28 + x16) < flow_kg_s;
    const sysid_real x30 = sysid_sqrt(sysid_maximum(sysid_square(x16) - (-flow_kg_s +
        x25)*((sysid_real)4.0*sysid_pwm_a_discharge_bipolynomial_coefficients[6] +
        (sysid_real)4.0*x3 + (sysid_real)4.0*x5), (sysid_real)0.0));
    const sysid_real x31 = x16 + x30;
    const int x32 = x31 != (sysid_real)0.0;
    const sysid_real x33 = x26 ? x22 : (x29 ? x28 : sysid_minimum(sysid_maximum(((sysid_real)0.0
        <= x16) ? (x32 ? ((sysid_real)2.0*flow_kg_s -
        (sysid_real)2.0*sysid_pwm_a_discharge_bipolynomial_coefficients[0] - (sysid_real)2.0*x23 -
        (sysid_real)2.0*x24)/(x32 ? x31 : (sysid_real)1.0) : x22) : x17*(-x16 + x30), x22), x28));
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | (x26 ? SYSID_BELOW : 0u) | (x29 ?
            SYSID_ABOVE : 0u) | (x20 && ((x26 && x21) || (x29 && x27)) ? SYSID_NO_ROOT : 0u) | (x12
            || ((x13 == (sysid_real)0.0) && (x16 == (sysid_real)0.0)) ? SYSID_DECREASING : 0u);
    }
    return sysid_known_flagged_duty(x12 ? -x33 : x33, flags);
}

static const sysid_real sysid_pwm_a_discharge_network_duty_range[2] = {
    (sysid_real)0.02, (sysid_real)0.74
};
static const sysid_real sysid_pwm_a_discharge_network_pressure_range[2] = {
    (sysid_real)123712.22359142273, (sysid_real)309116.42611047137
};
static const sysid_real sysid_pwm_a_discharge_network_pressure[25] = {
    (sysid_real)123712.22359142273, (sysid_real)131437.39869638308, (sysid_real)139162.57380134345, (sysid_real)146887.7489063038,
    (sysid_real)154612.92401126417, (sysid_real)162338.09911622453, (sysid_real)170063.2742211849, (sysid_real)177788.44932614526,
    (sysid_real)185513.62443110562, (sysid_real)193238.79953606596, (sysid_real)200963.97464102635, (sysid_real)208689.14974598668,
    (sysid_real)216414.32485094707, (sysid_real)224139.4999559074, (sysid_real)231864.67506086777, (sysid_real)239589.85016582813,
    (sysid_real)247315.0252707885, (sysid_real)255040.20037574886, (sysid_real)262765.3754807092, (sysid_real)270490.5505856696,
    (sysid_real)278215.7256906299, (sysid_real)285940.9007955903, (sysid_real)293666.07590055064, (sysid_real)301391.25100551103,
    (sysid_real)309116.42611047137
};
static const sysid_real sysid_pwm_a_discharge_network_flow_low[25] = {
    (sysid_real)-2.4025211287139824e-05, (sysid_real)-4.211280025840134e-05, (sysid_real)-6.742782333162733e-05, (sysid_real)-9.60705401612551e-05,
    (sysid_real)-0.00011377034555466193, (sysid_real)-0.0001566775648015729, (sysid_real)-0.0001878308974355373, (sysid_real)-0.00020613161086076035,
    (sysid_real)-0.00024133094176894578, (sysid_real)-0.0002653371554492664, (sysid_real)-0.0002673601779260847, (sysid_real)-0.00027009879169995584,
    (sysid_real)-0.0002701176969692777, (sysid_real)-0.0002701303004821589, (sysid_real)-0.00027212925675242615, (sysid_real)-0.0002744245606176119,
    (sysid_real)-0.00027594459217010427, (sysid_real)-0.00027822327338515015, (sysid_real)-0.0002813982566969767, (sysid_real)-0.00028380645008094436,
    (sysid_real)-0.0002877759784756406, (sysid_real)-0.00029240576091395357, (sysid_real)-0.0002954922825394955, (sysid_real)-0.0002954922825394955,
    (sysid_real)-0.000276413222288717
};
static const sysid_real sysid_pwm_a_discharge_network_flow_high[25] = {
    (sysid_real)-6.33325327789406e-06, (sysid_real)-2.426124046737104e-06, (sysid_real)-2.426124046737104e-06, (sysid_real)-4.080402746735579e-06,
    (sysid_real)-2.6523540817084613e-06, (sysid_real)-2.6523540817084613e-06, (sysid_real)-3.4475881766471888e-06, (sysid_real)-1.460240069587481e-06,
    (sysid_real)-1.460240069587481e-06, (sysid_real)-1.7371978223664413e-06, (sysid_real)-2.088052158501918e-05, (sysid_real)-2.7957919586422665e-05,
    (sysid_real)-1.1106104337203433e-05, (sysid_real)-1.1106104337203433e-05, (sysid_real)-1.948213978535562e-05, (sysid_real)-7.2288208979199456e-06,
    (sysid_real)-7.2288208979199456e-06, (sysid_real)-4.170933395977564e-06, (sysid_real)-4.170933395977564e-06, (sysid_real)-2.554682634737737e-06,
    (sysid_real)-2.554682634737737e-06, (sysid_real)-1.4117430372945917e-07, (sysid_real)-1.4117430372945917e-07, (sysid_real)3.2964378397928136e-08,
    (sysid_real)3.2964378397928136e-08
};
static const sysid_real sysid_pwm_a_discharge_network_flow_weights[10] = {
    (sysid_real)0.7313879168146602, (sysid_real)1.233755231611696, (sysid_real)0.08981988488621742, (sysid_real)0.5444134423922969,
    (sysid_real)0.2616612647434948, (sysid_real)-2.3939791239016937, (sysid_real)-2.358825112544839, (sysid_real)-5.726302830441622,
    (sysid_real)-0.23516822334032342, (sysid_real)5.430857700356015
};
static const sysid_real sysid_pwm_a_discharge_network_pressure_weights[10] = {
    (sysid_real)9.40828659548611, (sysid_real)4.870563959426811, (sysid_real)3.8212375931343328, (sysid_real)11.803865710398236,
    (sysid_real)0.5899384666169131, (sysid_real)0.8392184044023436, (sysid_real)0.9103459483472968, (sysid_real)0.013299174473703483,
    (sysid_real)-0.8313035687830804, (sysid_real)0.7916777662594674
};
static const sysid_real sysid_pwm_a_discharge_network_hidden_bias[10] = {
    (sysid_real)-10.544751649063876, (sysid_real)-5.2047013306393675, (sysid_real)1.7247062635494446, (sysid_real)1.4662390178650575,
    (sysid_real)-0.46204096210570433, (sysid_real)-0.18687897542882526, (sysid_real)-0.24184470070997174, (sysid_real)-1.9051288871099077,
    (sysid_real)0.38136870008498386, (sysid_real)3.6998235736266056
};
static const sysid_real sysid_pwm_a_discharge_network_output_weights[10] = {
    (sysid_real)0.41284496933676074, (sysid_real)0.06262806626352932, (sysid_real)0.3392969386916422, (sysid_real)-0.05450382699166957,
    (sysid_real)5.3186735907008105, (sysid_real)-0.7439625656489515, (sysid_real)0.7258503031509304, (sysid_real)-0.030245744209667375,
    (sysid_real)3.287177391069977, (sysid_real)0.048579098252880454
};
static const sysid_real sysid_pwm_a_discharge_network_output_bias[1] = {
    (sysid_real)0.716671384075675
};
static const sysid_real sysid_pwm_a_discharge_network_scaling[6] = {
    (sysid_real)-0.00014794826769088437, (sysid_real)0.00014781804889360368, (sysid_real)216570.90263255802, (sysid_real)92000.19607774711,
    (sysid_real)0.38, (sysid_real)0.36
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_a_discharge_network_flow(
    sysid_real duty, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(duty) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(duty,
        sysid_pwm_a_discharge_network_duty_range[0]), sysid_pwm_a_discharge_network_duty_range[1]);
    const sysid_real x1 = (sysid_real)1.0/sysid_pwm_a_discharge_network_scaling[1];
    const sysid_real x2 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_a_discharge_network_pressure_range[0]),
        sysid_pwm_a_discharge_network_pressure_range[1]);
    const sysid_real x3 = sysid_interpolate(x2, sysid_pwm_a_discharge_network_pressure,
        sysid_pwm_a_discharge_network_flow_low, 25);
    const sysid_real x4 = -x3;
    const sysid_real x5 = x1*(-sysid_pwm_a_discharge_network_scaling[0] - x4);
    const sysid_real x6 = (-sysid_pwm_a_discharge_network_scaling[2] +
        x2)/sysid_pwm_a_discharge_network_scaling[3];
    const sysid_real x7 = sysid_pwm_a_discharge_network_hidden_bias[0] +
        sysid_pwm_a_discharge_network_pressure_weights[0]*x6;
    const sysid_real x8 = sysid_pwm_a_discharge_network_hidden_bias[1] +
        sysid_pwm_a_discharge_network_pressure_weights[1]*x6;
    const sysid_real x9 = sysid_pwm_a_discharge_network_hidden_bias[2] +
        sysid_pwm_a_discharge_network_pressure_weights[2]*x6;
    const sysid_real x10 = sysid_pwm_a_discharge_network_hidden_bias[3] +
        sysid_pwm_a_discharge_network_pressure_weights[3]*x6;
    const sysid_real x11 = sysid_pwm_a_discharge_network_hidden_bias[4] +
        sysid_pwm_a_discharge_network_pressure_weights[4]*x6;
    const sysid_real x12 = sysid_pwm_a_discharge_network_hidden_bias[5] +
        sysid_pwm_a_discharge_network_pressure_weights[5]*x6;
    const sysid_real x13 = sysid_pwm_a_discharge_network_hidden_bias[6] +
        sysid_pwm_a_discharge_network_pressure_weights[6]*x6;
    const sysid_real x14 = sysid_pwm_a_discharge_network_hidden_bias[7] +
        sysid_pwm_a_discharge_network_pressure_weights[7]*x6;
    const sysid_real x15 = sysid_pwm_a_discharge_network_hidden_bias[8] +
        sysid_pwm_a_discharge_network_pressure_weights[8]*x6;
    const sysid_real x16 = sysid_pwm_a_discharge_network_hidden_bias[9] +
        sysid_pwm_a_discharge_network_pressure_weights[9]*x6;
    const sysid_real x17 = sysid_pwm_a_discharge_network_scaling[4] +
        sysid_pwm_a_discharge_network_scaling[5]*(sysid_pwm_a_discharge_network_output_bias[0] +
        sysid_pwm_a_discharge_network_output_weights[0]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[0]*x5
        + x7) +
        sysid_pwm_a_discharge_network_output_weights[1]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[1]*x5
        + x8) +
        sysid_pwm_a_discharge_network_output_weights[2]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[2]*x5
        + x9) +
        sysid_pwm_a_discharge_network_output_weights[3]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[3]*x5
        + x10) +
        sysid_pwm_a_discharge_network_output_weights[4]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[4]*x5
        + x11) +
        sysid_pwm_a_discharge_network_output_weights[5]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[5]*x5
        + x12) +
        sysid_pwm_a_discharge_network_output_weights[6]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[6]*x5
        + x13) +
        sysid_pwm_a_discharge_network_output_weights[7]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[7]*x5
        + x14) +
        sysid_pwm_a_discharge_network_output_weights[8]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[8]*x5
        + x15) +
        sysid_pwm_a_discharge_network_output_weights[9]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[9]*x5
        + x16));
    const int x18 = x0 <= x17;
    const sysid_real x19 = -sysid_pwm_a_discharge_network_scaling[0];
    const sysid_real x20 = sysid_interpolate(x2, sysid_pwm_a_discharge_network_pressure,
        sysid_pwm_a_discharge_network_flow_high, 25);
    const sysid_real x21 = x20 + x4;
    const sysid_real x46 = (sysid_real)1.0/x21;
    sysid_real s0_0, s0_1, s0_2, s0_3;
    int ik0;
    {
        s0_0 = x18 ? (sysid_real)1.0 : (sysid_real)0.0;
        s0_1 = x3;
        s0_2 = x3;
        s0_3 = x17;
    }
    for (ik0 = 0; ik0 < 32; ik0++) {
        const sysid_real k0 = (sysid_real)ik0;
        const sysid_real x22 = x21*(((sysid_real)0.03125)*k0 + (sysid_real)0.03125) + x3;
        const sysid_real x23 = x1*(x19 + x22);
        const sysid_real x24 = sysid_pwm_a_discharge_network_scaling[4] +
            sysid_pwm_a_discharge_network_scaling[5]*(sysid_pwm_a_discharge_network_output_bias[0] +
            sysid_pwm_a_discharge_network_output_weights[0]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[0]*x23
            + x7) +
            sysid_pwm_a_discharge_network_output_weights[1]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[1]*x23
            + x8) +
            sysid_pwm_a_discharge_network_output_weights[2]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[2]*x23
            + x9) +
            sysid_pwm_a_discharge_network_output_weights[3]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[3]*x23
            + x10) +
            sysid_pwm_a_discharge_network_output_weights[4]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[4]*x23
            + x11) +
            sysid_pwm_a_discharge_network_output_weights[5]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[5]*x23
            + x12) +
            sysid_pwm_a_discharge_network_output_weights[6]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[6]*x23
            + x13) +
            sysid_pwm_a_discharge_network_output_weights[7]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[7]*x23
            + x14) +
            sysid_pwm_a_discharge_network_output_weights[8]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[8]*x23
            + x15) +
            sysid_pwm_a_discharge_network_output_weights[9]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[9]*x23
            + x16));
        const sysid_real x25 = (x0 <= x24) ? (sysid_real)1.0 : s0_0;
        const int x26 = s0_3 < x24;
        const sysid_real y0 = x25;
        const sysid_real y1 = ((sysid_real)0.0 < x25) ? s0_1 : x22;
        const sysid_real y2 = x26 ? x22 : s0_2;
        const sysid_real y3 = x26 ? x24 : s0_3;
        s0_0 = y0;
        s0_1 = y1;
        s0_2 = y2;
        s0_3 = y3;
    }
    sysid_real s1_0, s1_1, s1_2, s1_3;
    int ik1;
    {
        s1_0 = s0_1;
        s1_1 = s0_1 + ((sysid_real)0.03125)*x20 - (sysid_real)0.03125*x3;
        s1_2 = (sysid_real)1.0*s0_1 + (sysid_real)0.015625*x20 - (sysid_real)0.015625*x3;
        s1_3 = (sysid_real)1.0;
    }
    for (ik1 = 0; ik1 < 60; ik1++) {
        if (!((sysid_real)2.220446049250313e-16 < s1_3)) {
            break;
        }
        const sysid_real x27 = x1*(s1_2 + x19);
        const sysid_real x28 = sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[0]*x27 +
            x7);
        const sysid_real x29 = sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[1]*x27 +
            x8);
        const sysid_real x30 = sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[2]*x27 +
            x9);
        const sysid_real x31 = sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[3]*x27 +
            x10);
        const sysid_real x32 = sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[4]*x27 +
            x11);
        const sysid_real x33 = sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[5]*x27 +
            x12);
        const sysid_real x34 = sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[6]*x27 +
            x13);
        const sysid_real x35 = sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[7]*x27 +
            x14);
        const sysid_real x36 = sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[8]*x27 +
            x15);
        const sysid_real x37 = sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[9]*x27 +
            x16);
        const sysid_real x38 = sysid_pwm_a_discharge_network_scaling[4] +
            sysid_pwm_a_discharge_network_scaling[5]*(sysid_pwm_a_discharge_network_output_bias[0] +
            sysid_pwm_a_discharge_network_output_weights[0]*x28 +
            sysid_pwm_a_discharge_network_output_weights[1]*x29 +
            sysid_pwm_a_discharge_network_output_weights[2]*x30 +
            sysid_pwm_a_discharge_network_output_weights[3]*x31 +
            sysid_pwm_a_discharge_network_output_weights[4]*x32 +
            sysid_pwm_a_discharge_network_output_weights[5]*x33 +
            sysid_pwm_a_discharge_network_output_weights[6]*x34 +
            sysid_pwm_a_discharge_network_output_weights[7]*x35 +
            sysid_pwm_a_discharge_network_output_weights[8]*x36 +
            sysid_pwm_a_discharge_network_output_weights[9]*x37);
        const int x39 = x0 <= x38;
        const sysid_real x40 = x39 ? s1_0 : s1_2;
        const sysid_real x41 = x39 ? s1_2 : s1_1;
        const sysid_real x42 =
            sysid_pwm_a_discharge_network_scaling[5]*x1*(sysid_pwm_a_discharge_network_flow_weights[0]*sysid_pwm_a_discharge_network_output_weights[0]*((sysid_real)1.0
            - sysid_square(x28)) +
            sysid_pwm_a_discharge_network_flow_weights[1]*sysid_pwm_a_discharge_network_output_weights[1]*((sysid_real)1.0
            - sysid_square(x29)) +
            sysid_pwm_a_discharge_network_flow_weights[2]*sysid_pwm_a_discharge_network_output_weights[2]*((sysid_real)1.0
            - sysid_square(x30)) +
            sysid_pwm_a_discharge_network_flow_weights[3]*sysid_pwm_a_discharge_network_output_weights[3]*((sysid_real)1.0
            - sysid_square(x31)) +
            sysid_pwm_a_discharge_network_flow_weights[4]*sysid_pwm_a_discharge_network_output_weights[4]*((sysid_real)1.0
            - sysid_square(x32)) +
            sysid_pwm_a_discharge_network_flow_weights[5]*sysid_pwm_a_discharge_network_output_weights[5]*((sysid_real)1.0
            - sysid_square(x33)) +
            sysid_pwm_a_discharge_network_flow_weights[6]*sysid_pwm_a_discharge_network_output_weights[6]*((sysid_real)1.0
            - sysid_square(x34)) +
            sysid_pwm_a_discharge_network_flow_weights[7]*sysid_pwm_a_discharge_network_output_weights[7]*((sysid_real)1.0
            - sysid_square(x35)) +
            sysid_pwm_a_discharge_network_flow_weights[8]*sysid_pwm_a_discharge_network_output_weights[8]*((sysid_real)1.0
            - sysid_square(x36)) +
            sysid_pwm_a_discharge_network_flow_weights[9]*sysid_pwm_a_discharge_network_output_weights[9]*((sysid_real)1.0
            - sysid_square(x37)));
        const sysid_real x43 = s1_2 - (-x0 + x38)/((x42 == (sysid_real)0.0) ? (sysid_real)1.0 :
            x42);
        const int x44 = (x40 <= x43) && (x43 <= x41);
        const sysid_real x45 = x44 ? x43 : (sysid_real)0.5*x40 + (sysid_real)0.5*x41;
        const sysid_real y0 = x40;
        const sysid_real y1 = x41;
        const sysid_real y2 = x45;
        const sysid_real y3 = x44 ? (sysid_real)0.000244140625*x46*sysid_fabs(-s1_2 + x45) :
            x46*(-x40 + x41);
        s1_0 = y0;
        s1_1 = y1;
        s1_2 = y2;
        s1_3 = y3;
    }
    const int x47 = (sysid_real)0.0 < s0_0;
    if (flags) {
        *flags = (x2 != pressure_pa ? SYSID_PRESSURE : 0u) |
            ((sysid_pwm_a_discharge_network_duty_range[1] + (sysid_real)1e-09 < duty) || !x47 ?
            SYSID_ABOVE : 0u) | ((duty < sysid_pwm_a_discharge_network_duty_range[0] +
            (sysid_real)-1e-09) || (x0 < x17) ? SYSID_BELOW : 0u);
    }
    return sysid_known_flagged(x18 ? x3 : (x47 ? s1_2 : s0_2), flags);
}

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_a_discharge_network_duty(
    sysid_real flow_kg_s, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return 0;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_a_discharge_network_pressure_range[0]),
        sysid_pwm_a_discharge_network_pressure_range[1]);
    const sysid_real x1 = sysid_interpolate(x0, sysid_pwm_a_discharge_network_pressure,
        sysid_pwm_a_discharge_network_flow_low, 25);
    const sysid_real x2 = sysid_interpolate(x0, sysid_pwm_a_discharge_network_pressure,
        sysid_pwm_a_discharge_network_flow_high, 25);
    const sysid_real x3 = (-sysid_pwm_a_discharge_network_scaling[0] +
        sysid_minimum(sysid_maximum(flow_kg_s, x1), x2))/sysid_pwm_a_discharge_network_scaling[1];
    const sysid_real x4 = (-sysid_pwm_a_discharge_network_scaling[2] +
        x0)/sysid_pwm_a_discharge_network_scaling[3];
    const sysid_real x5 = sysid_pwm_a_discharge_network_scaling[4] +
        sysid_pwm_a_discharge_network_scaling[5]*(sysid_pwm_a_discharge_network_output_bias[0] +
        sysid_pwm_a_discharge_network_output_weights[0]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[0]*x3
        + sysid_pwm_a_discharge_network_hidden_bias[0] +
        sysid_pwm_a_discharge_network_pressure_weights[0]*x4) +
        sysid_pwm_a_discharge_network_output_weights[1]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[1]*x3
        + sysid_pwm_a_discharge_network_hidden_bias[1] +
        sysid_pwm_a_discharge_network_pressure_weights[1]*x4) +
        sysid_pwm_a_discharge_network_output_weights[2]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[2]*x3
        + sysid_pwm_a_discharge_network_hidden_bias[2] +
        sysid_pwm_a_discharge_network_pressure_weights[2]*x4) +
        sysid_pwm_a_discharge_network_output_weights[3]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[3]*x3
        + sysid_pwm_a_discharge_network_hidden_bias[3] +
        sysid_pwm_a_discharge_network_pressure_weights[3]*x4) +
        sysid_pwm_a_discharge_network_output_weights[4]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[4]*x3
        + sysid_pwm_a_discharge_network_hidden_bias[4] +
        sysid_pwm_a_discharge_network_pressure_weights[4]*x4) +
        sysid_pwm_a_discharge_network_output_weights[5]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[5]*x3
        + sysid_pwm_a_discharge_network_hidden_bias[5] +
        sysid_pwm_a_discharge_network_pressure_weights[5]*x4) +
        sysid_pwm_a_discharge_network_output_weights[6]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[6]*x3
        + sysid_pwm_a_discharge_network_hidden_bias[6] +
        sysid_pwm_a_discharge_network_pressure_weights[6]*x4) +
        sysid_pwm_a_discharge_network_output_weights[7]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[7]*x3
        + sysid_pwm_a_discharge_network_hidden_bias[7] +
        sysid_pwm_a_discharge_network_pressure_weights[7]*x4) +
        sysid_pwm_a_discharge_network_output_weights[8]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[8]*x3
        + sysid_pwm_a_discharge_network_hidden_bias[8] +
        sysid_pwm_a_discharge_network_pressure_weights[8]*x4) +
        sysid_pwm_a_discharge_network_output_weights[9]*sysid_tanh(sysid_pwm_a_discharge_network_flow_weights[9]*x3
        + sysid_pwm_a_discharge_network_hidden_bias[9] +
        sysid_pwm_a_discharge_network_pressure_weights[9]*x4));
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | ((x2 < flow_kg_s) ||
            (sysid_pwm_a_discharge_network_duty_range[1] < x5) ? SYSID_ABOVE : 0u) | ((flow_kg_s <
            x1) || (x5 < sysid_pwm_a_discharge_network_duty_range[0]) ? SYSID_BELOW : 0u);
    }
    return sysid_known_flagged_duty(sysid_minimum(sysid_maximum(x5, sysid_pwm_a_discharge_network_duty_range[0]),
        sysid_pwm_a_discharge_network_duty_range[1]), flags);
}

static const sysid_real sysid_pwm_b_fill_bipolynomial_duty_range[2] = {
    (sysid_real)0.02, (sysid_real)0.8999999999999999
};
static const sysid_real sysid_pwm_b_fill_bipolynomial_pressure_range[2] = {
    (sysid_real)105538.83443826473, (sysid_real)311999.4628866854
};
static const sysid_real sysid_pwm_b_fill_bipolynomial_pressure[25] = {
    (sysid_real)105538.83443826473, (sysid_real)114141.36062361559, (sysid_real)122743.88680896646, (sysid_real)131346.4129943173,
    (sysid_real)139948.93917966817, (sysid_real)148551.46536501904, (sysid_real)157153.9915503699, (sysid_real)165756.51773572076,
    (sysid_real)174359.04392107163, (sysid_real)182961.57010642247, (sysid_real)191564.09629177337, (sysid_real)200166.6224771242,
    (sysid_real)208769.14866247505, (sysid_real)217371.67484782595, (sysid_real)225974.2010331768, (sysid_real)234576.72721852767,
    (sysid_real)243179.25340387854, (sysid_real)251781.77958922938, (sysid_real)260384.30577458022, (sysid_real)268986.8319599311,
    (sysid_real)277589.35814528196, (sysid_real)286191.8843306328, (sysid_real)294794.4105159837, (sysid_real)303396.93670133455,
    (sysid_real)311999.4628866854
};
static const sysid_real sysid_pwm_b_fill_bipolynomial_duty_low[25] = {
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.02, (sysid_real)0.06000000000000001, (sysid_real)0.06000000000000001, (sysid_real)0.1,
    (sysid_real)0.22000000000000006, (sysid_real)0.2599999999999999, (sysid_real)0.29999999999999993, (sysid_real)0.37999999999999995,
    (sysid_real)0.37999999999999995, (sysid_real)0.37999999999999995, (sysid_real)0.42, (sysid_real)0.42,
    (sysid_real)0.42, (sysid_real)0.4600000000000002, (sysid_real)0.4600000000000002, (sysid_real)0.4600000000000002,
    (sysid_real)0.5, (sysid_real)0.5399999999999997, (sysid_real)0.5399999999999997, (sysid_real)0.6199999999999997,
    (sysid_real)0.66
};
static const sysid_real sysid_pwm_b_fill_bipolynomial_duty_high[25] = {
    (sysid_real)0.42, (sysid_real)0.6999999999999997, (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999,
    (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999,
    (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999,
    (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999,
    (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999,
    (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999, (sysid_real)0.8999999999999999,
    (sysid_real)0.8999999999999999
};
static const sysid_real sysid_pwm_b_fill_bipolynomial_coefficients[9] = {
    (sysid_real)-0.00018915378212309422, (sysid_real)-0.0002543477224310199, (sysid_real)-1.9467050832665078e-05, (sysid_real)0.000925673985021882,
    (sysid_real)-0.00019075428431431142, (sysid_real)0.0005344116896062556, (sysid_real)-3.2968591153166796e-05, (sysid_real)-0.00016334545882693471,
    (sysid_real)-0.0004851443570602404
};
static const sysid_real sysid_pwm_b_fill_bipolynomial_pressure_scaling[2] = {
    (sysid_real)208659.03613224928, (sysid_real)103120.20169398456
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_b_fill_flow(
    sysid_real duty, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(duty) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_b_fill_bipolynomial_pressure_range[0]),
        sysid_pwm_b_fill_bipolynomial_pressure_range[1]);
    const sysid_real x1 = -sysid_pwm_b_fill_bipolynomial_pressure_scaling[0] + x0;
    const sysid_real x2 = (sysid_real)-1.0 +
        (sysid_real)2.0*sysid_square(x1)/sysid_square(sysid_pwm_b_fill_bipolynomial_pressure_scaling[1]);
    const sysid_real x3 = x1/sysid_pwm_b_fill_bipolynomial_pressure_scaling[1];
    const sysid_real x4 = sysid_minimum(sysid_maximum(duty,
        sysid_pwm_b_fill_bipolynomial_duty_range[0]), sysid_pwm_b_fill_bipolynomial_duty_range[1]);
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | (sysid_interpolate(x0,
            sysid_pwm_b_fill_bipolynomial_pressure, sysid_pwm_b_fill_bipolynomial_duty_high, 25) +
            (sysid_real)1e-09 < duty ? SYSID_ABOVE : 0u) | (duty < sysid_interpolate(x0,
            sysid_pwm_b_fill_bipolynomial_pressure, sysid_pwm_b_fill_bipolynomial_duty_low, 25) +
            (sysid_real)-1e-09 ? SYSID_BELOW : 0u);
    }
    return sysid_known_flagged(sysid_pwm_b_fill_bipolynomial_coefficients[0] +
        sysid_pwm_b_fill_bipolynomial_coefficients[1]*x3 +
        sysid_pwm_b_fill_bipolynomial_coefficients[2]*x2 +
        x4*(sysid_pwm_b_fill_bipolynomial_coefficients[3] +
        sysid_pwm_b_fill_bipolynomial_coefficients[4]*x3 +
        sysid_pwm_b_fill_bipolynomial_coefficients[5]*x2 +
        x4*(sysid_pwm_b_fill_bipolynomial_coefficients[6] +
        sysid_pwm_b_fill_bipolynomial_coefficients[7]*x3 +
        sysid_pwm_b_fill_bipolynomial_coefficients[8]*x2)), flags);
}

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_b_fill_duty(
    sysid_real flow_kg_s, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return 0;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_b_fill_bipolynomial_pressure_range[0]),
        sysid_pwm_b_fill_bipolynomial_pressure_range[1]);
    const sysid_real x1 = -sysid_pwm_b_fill_bipolynomial_pressure_scaling[0] + x0;
    const sysid_real x2 = (sysid_real)-1.0 +
        (sysid_real)2.0*sysid_square(x1)/sysid_square(sysid_pwm_b_fill_bipolynomial_pressure_scaling[1]);
    const sysid_real x3 = sysid_pwm_b_fill_bipolynomial_coefficients[8]*x2;
    const sysid_real x4 = x1/sysid_pwm_b_fill_bipolynomial_pressure_scaling[1];
    const sysid_real x5 = sysid_pwm_b_fill_bipolynomial_coefficients[7]*x4;
    const sysid_real x6 = (sysid_real)2.0*sysid_pwm_b_fill_bipolynomial_coefficients[6] +
        (sysid_real)2.0*x3 + (sysid_real)2.0*x5;
    const sysid_real x7 = sysid_interpolate(x0, sysid_pwm_b_fill_bipolynomial_pressure,
        sysid_pwm_b_fill_bipolynomial_duty_low, 25);
    const sysid_real x8 = sysid_pwm_b_fill_bipolynomial_coefficients[3] +
        sysid_pwm_b_fill_bipolynomial_coefficients[4]*x4 +
        sysid_pwm_b_fill_bipolynomial_coefficients[5]*x2;
    const sysid_real x9 = x6*x7 + x8;
    const sysid_real x10 = sysid_interpolate(x0, sysid_pwm_b_fill_bipolynomial_pressure,
        sysid_pwm_b_fill_bipolynomial_duty_high, 25);
    const sysid_real x11 = x10*x6 + x8;
    const int x12 = ((x9 <= (sysid_real)0.0) && (x11 <= (sysid_real)0.0)) && ((x9 <
        (sysid_real)0.0) || (x11 < (sysid_real)0.0));
    const sysid_real x13 = sysid_pwm_b_fill_bipolynomial_coefficients[6] + x3 + x5;
    const int x14 = x13 != (sysid_real)0.0;
    const sysid_real x15 = x12 ? -x10 : x7;
    const sysid_real x16 = x12 ? -x8 : x8;
    const sysid_real x17 = ((sysid_real)0.5)/(x14 ? x13 : (sysid_real)1.0);
    const sysid_real x18 = -x16*x17;
    const sysid_real x19 = x12 ? -x7 : x10;
    const int x20 = (x14 && (x15 < x18)) && (x18 < x19);
    const int x21 = (sysid_real)0.0 < x13;
    const sysid_real x22 = (x20 && x21) ? x18 : x15;
    const sysid_real x23 = sysid_pwm_b_fill_bipolynomial_coefficients[2]*x2;
    const sysid_real x24 = sysid_pwm_b_fill_bipolynomial_coefficients[1]*x4;
    const sysid_real x25 = sysid_pwm_b_fill_bipolynomial_coefficients[0] + x23 + x24;
    const int x26 = flow_kg_s < x22*(x13*x22 + x16) + x25;
    const int x27 = x13 < (sysid_real)0.0;
    const sysid_real x28 = (x20 && x27) ? x18 : x19;
    const int x29 = x25 + x28*(x13*x28 + x16) < flow_kg_s;
    const sysid_real x30 = sysid_sqrt(sysid_maximum(sysid_square(x16) - (-flow_kg_s +
        x25)*((sysid_real)4.0*sysid_pwm_b_fill_bipolynomial_coefficients[6] + (sysid_real)4.0*x3 +
        (sysid_real)4.0*x5), (sysid_real)0.0));
    const sysid_real x31 = x16 + x30;
    const int x32 = x31 != (sysid_real)0.0;
    const sysid_real x33 = x26 ? x22 : (x29 ? x28 : sysid_minimum(sysid_maximum(((sysid_real)0.0
        <= x16) ? (x32 ? ((sysid_real)2.0*flow_kg_s -
        (sysid_real)2.0*sysid_pwm_b_fill_bipolynomial_coefficients[0] - (sysid_real)2.0*x23 -
        (sysid_real)2.0*x24)/(x32 ? x31 : (sysid_real)1.0) : x22) : x17*(-x16 + x30), x22), x28));
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | (x26 ? SYSID_BELOW : 0u) | (x29 ?
            SYSID_ABOVE : 0u) | (x20 && ((x26 && x21) || (x29 && x27)) ? SYSID_NO_ROOT : 0u) | (x12
            || ((x13 == (sysid_real)0.0) && (x16 == (sysid_real)0.0)) ? SYSID_DECREASING : 0u);
    }
    return sysid_known_flagged_duty(x12 ? -x33 : x33, flags);
}

static const sysid_real sysid_pwm_b_fill_network_duty_range[2] = {
    (sysid_real)0.02, (sysid_real)0.8999999999999999
};
static const sysid_real sysid_pwm_b_fill_network_pressure_range[2] = {
    (sysid_real)105538.83443826473, (sysid_real)311999.4628866854
};
static const sysid_real sysid_pwm_b_fill_network_pressure[25] = {
    (sysid_real)105538.83443826473, (sysid_real)114141.36062361559, (sysid_real)122743.88680896646, (sysid_real)131346.4129943173,
    (sysid_real)139948.93917966817, (sysid_real)148551.46536501904, (sysid_real)157153.9915503699, (sysid_real)165756.51773572076,
    (sysid_real)174359.04392107163, (sysid_real)182961.57010642247, (sysid_real)191564.09629177337, (sysid_real)200166.6224771242,
    (sysid_real)208769.14866247505, (sysid_real)217371.67484782595, (sysid_real)225974.2010331768, (sysid_real)234576.72721852767,
    (sysid_real)243179.25340387854, (sysid_real)251781.77958922938, (sysid_real)260384.30577458022, (sysid_real)268986.8319599311,
    (sysid_real)277589.35814528196, (sysid_real)286191.8843306328, (sysid_real)294794.4105159837, (sysid_real)303396.93670133455,
    (sysid_real)311999.4628866854
};
static const sysid_real sysid_pwm_b_fill_network_flow_low[25] = {
    (sysid_real)7.540459674049476e-05, (sysid_real)5.183978526702637e-05, (sysid_real)2.0290030798815416e-05, (sysid_real)1.2253860536427687e-06,
    (sysid_real)1.2253860536427687e-06, (sysid_real)6.013324165631573e-07, (sysid_real)6.013324165631573e-07, (sysid_real)2.467003542888902e-06,
    (sysid_real)3.82846648973845e-07, (sysid_real)2.501949468845468e-07, (sysid_real)2.501949468845468e-07, (sysid_real)1.3802877703528539e-05,
    (sysid_real)6.122658873023425e-06, (sysid_real)6.122658873023425e-06, (sysid_real)1.7025215448535213e-05, (sysid_real)7.687872324302064e-06,
    (sysid_real)7.687872324302064e-06, (sysid_real)7.962411108829694e-06, (sysid_real)3.1029767090739937e-06, (sysid_real)3.1029767090739937e-06,
    (sysid_real)4.201355153657115e-06, (sysid_real)1.2751066013439652e-06, (sysid_real)4.1365519547376014e-07, (sysid_real)8.403814134233772e-09,
    (sysid_real)8.403814134233772e-09
};
static const sysid_real sysid_pwm_b_fill_network_flow_high[25] = {
    (sysid_real)0.0005363346907642722, (sysid_real)0.0008521270005267876, (sysid_real)0.0011043495301127247, (sysid_real)0.0011043495301127247,
    (sysid_real)0.0010969802608662954, (sysid_real)0.00108580619373525, (sysid_real)0.0010783568156478862, (sysid_real)0.0009729501233765467,
    (sysid_real)0.0007667896416377097, (sysid_real)0.0006293493204784853, (sysid_real)0.000548236661178386, (sysid_real)0.0005188208053631305,
    (sysid_real)0.000511514726499075, (sysid_real)0.0004947270140717614, (sysid_real)0.0004652020676343406, (sysid_real)0.00044678789900792835,
    (sysid_real)0.00041278816713821574, (sysid_real)0.00039157187878811347, (sysid_real)0.0003726311666328848, (sysid_real)0.0003544387727584697,
    (sysid_real)0.0003078376054030566, (sysid_real)0.00027671553308184903, (sysid_real)0.00023300219708008782, (sysid_real)0.00018535082205580315,
    (sysid_real)0.00012445067399892526
};
static const sysid_real sysid_pwm_b_fill_network_flow_weights[10] = {
    (sysid_real)-0.6304845663612827, (sysid_real)3.4274348889107595, (sysid_real)0.3737330771655974, (sysid_real)-2.0201825908185604,
    (sysid_real)0.19233053448684923, (sysid_real)-0.35596585782012713, (sysid_real)0.17530188195016075, (sysid_real)0.5351525139315148,
    (sysid_real)0.06261815260240207, (sysid_real)-1.2208758462603384
};
static const sysid_real sysid_pwm_b_fill_network_pressure_weights[10] = {
    (sysid_real)-1.808536055610547, (sysid_real)17.951609335605635, (sysid_real)-6.833378762186506, (sysid_real)-7.161529650238918,
    (sysid_real)-27.540702256682238, (sysid_real)-0.3125559262690042, (sysid_real)-6.12068118568076, (sysid_real)-0.3201923373223731,
    (sysid_real)6.466519163884764, (sysid_real)7.3876337037131075
};
static const sysid_real sysid_pwm_b_fill_network_hidden_bias[10] = {
    (sysid_real)-1.0379906158509755, (sysid_real)-16.130706365707873, (sysid_real)-2.963442963903213, (sysid_real)4.35661106743212,
    (sysid_real)-11.326602520173939, (sysid_real)-0.05527699836320029, (sysid_real)-2.4126189659939428, (sysid_real)1.2182585304460092,
    (sysid_real)2.250672999118026, (sysid_real)5.049482020688875
};
static const sysid_real sysid_pwm_b_fill_network_output_weights[10] = {
    (sysid_real)0.44400228370514494, (sysid_real)4.841792432016738, (sysid_real)-2.081583201399783, (sysid_real)-0.12580384925502536,
    (sysid_real)-0.4153975426795375, (sysid_real)-3.5025280828133276, (sysid_real)4.136035422644651, (sysid_real)1.14689153510867,
    (sysid_real)2.0179079053473266, (sysid_real)0.05808473210669972
};
static const sysid_real sysid_pwm_b_fill_network_output_bias[1] = {
    (sysid_real)4.851551592134436
};
static const sysid_real sysid_pwm_b_fill_network_scaling[6] = {
    (sysid_real)0.0005521987190650476, (sysid_real)0.0005521508110476771, (sysid_real)208659.03613224928, (sysid_real)103120.20169398456,
    (sysid_real)0.46, (sysid_real)0.44
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_b_fill_network_flow(
    sysid_real duty, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(duty) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(duty,
        sysid_pwm_b_fill_network_duty_range[0]), sysid_pwm_b_fill_network_duty_range[1]);
    const sysid_real x1 = (sysid_real)1.0/sysid_pwm_b_fill_network_scaling[1];
    const sysid_real x2 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_b_fill_network_pressure_range[0]), sysid_pwm_b_fill_network_pressure_range[1]);
    const sysid_real x3 = sysid_interpolate(x2, sysid_pwm_b_fill_network_pressure,
        sysid_pwm_b_fill_network_flow_low, 25);
    const sysid_real x4 = -x3;
    const sysid_real x5 = x1*(-sysid_pwm_b_fill_network_scaling[0] - x4);
    const sysid_real x6 = (-sysid_pwm_b_fill_network_scaling[2] +
        x2)/sysid_pwm_b_fill_network_scaling[3];
    const sysid_real x7 = sysid_pwm_b_fill_network_hidden_bias[0] +
        sysid_pwm_b_fill_network_pressure_weights[0]*x6;
    const sysid_real x8 = sysid_pwm_b_fill_network_hidden_bias[1] +
        sysid_pwm_b_fill_network_pressure_weights[1]*x6;
    const sysid_real x9 = sysid_pwm_b_fill_network_hidden_bias[2] +
        sysid_pwm_b_fill_network_pressure_weights[2]*x6;
    const sysid_real x10 = sysid_pwm_b_fill_network_hidden_bias[3] +
        sysid_pwm_b_fill_network_pressure_weights[3]*x6;
    const sysid_real x11 = sysid_pwm_b_fill_network_hidden_bias[4] +
        sysid_pwm_b_fill_network_pressure_weights[4]*x6;
    const sysid_real x12 = sysid_pwm_b_fill_network_hidden_bias[5] +
        sysid_pwm_b_fill_network_pressure_weights[5]*x6;
    const sysid_real x13 = sysid_pwm_b_fill_network_hidden_bias[6] +
        sysid_pwm_b_fill_network_pressure_weights[6]*x6;
    const sysid_real x14 = sysid_pwm_b_fill_network_hidden_bias[7] +
        sysid_pwm_b_fill_network_pressure_weights[7]*x6;
    const sysid_real x15 = sysid_pwm_b_fill_network_hidden_bias[8] +
        sysid_pwm_b_fill_network_pressure_weights[8]*x6;
    const sysid_real x16 = sysid_pwm_b_fill_network_hidden_bias[9] +
        sysid_pwm_b_fill_network_pressure_weights[9]*x6;
    const sysid_real x17 = sysid_pwm_b_fill_network_scaling[4] +
        sysid_pwm_b_fill_network_scaling[5]*(sysid_pwm_b_fill_network_output_bias[0] +
        sysid_pwm_b_fill_network_output_weights[0]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[0]*x5
        + x7) +
        sysid_pwm_b_fill_network_output_weights[1]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[1]*x5
        + x8) +
        sysid_pwm_b_fill_network_output_weights[2]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[2]*x5
        + x9) +
        sysid_pwm_b_fill_network_output_weights[3]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[3]*x5
        + x10) +
        sysid_pwm_b_fill_network_output_weights[4]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[4]*x5
        + x11) +
        sysid_pwm_b_fill_network_output_weights[5]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[5]*x5
        + x12) +
        sysid_pwm_b_fill_network_output_weights[6]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[6]*x5
        + x13) +
        sysid_pwm_b_fill_network_output_weights[7]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[7]*x5
        + x14) +
        sysid_pwm_b_fill_network_output_weights[8]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[8]*x5
        + x15) +
        sysid_pwm_b_fill_network_output_weights[9]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[9]*x5
        + x16));
    const int x18 = x0 <= x17;
    const sysid_real x19 = -sysid_pwm_b_fill_network_scaling[0];
    const sysid_real x20 = sysid_interpolate(x2, sysid_pwm_b_fill_network_pressure,
        sysid_pwm_b_fill_network_flow_high, 25);
    const sysid_real x21 = x20 + x4;
    const sysid_real x46 = (sysid_real)1.0/x21;
    sysid_real s0_0, s0_1, s0_2, s0_3;
    int ik0;
    {
        s0_0 = x18 ? (sysid_real)1.0 : (sysid_real)0.0;
        s0_1 = x3;
        s0_2 = x3;
        s0_3 = x17;
    }
    for (ik0 = 0; ik0 < 32; ik0++) {
        const sysid_real k0 = (sysid_real)ik0;
        const sysid_real x22 = x21*(((sysid_real)0.03125)*k0 + (sysid_real)0.03125) + x3;
        const sysid_real x23 = x1*(x19 + x22);
        const sysid_real x24 = sysid_pwm_b_fill_network_scaling[4] +
            sysid_pwm_b_fill_network_scaling[5]*(sysid_pwm_b_fill_network_output_bias[0] +
            sysid_pwm_b_fill_network_output_weights[0]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[0]*x23
            + x7) +
            sysid_pwm_b_fill_network_output_weights[1]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[1]*x23
            + x8) +
            sysid_pwm_b_fill_network_output_weights[2]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[2]*x23
            + x9) +
            sysid_pwm_b_fill_network_output_weights[3]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[3]*x23
            + x10) +
            sysid_pwm_b_fill_network_output_weights[4]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[4]*x23
            + x11) +
            sysid_pwm_b_fill_network_output_weights[5]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[5]*x23
            + x12) +
            sysid_pwm_b_fill_network_output_weights[6]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[6]*x23
            + x13) +
            sysid_pwm_b_fill_network_output_weights[7]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[7]*x23
            + x14) +
            sysid_pwm_b_fill_network_output_weights[8]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[8]*x23
            + x15) +
            sysid_pwm_b_fill_network_output_weights[9]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[9]*x23
            + x16));
        const sysid_real x25 = (x0 <= x24) ? (sysid_real)1.0 : s0_0;
        const int x26 = s0_3 < x24;
        const sysid_real y0 = x25;
        const sysid_real y1 = ((sysid_real)0.0 < x25) ? s0_1 : x22;
        const sysid_real y2 = x26 ? x22 : s0_2;
        const sysid_real y3 = x26 ? x24 : s0_3;
        s0_0 = y0;
        s0_1 = y1;
        s0_2 = y2;
        s0_3 = y3;
    }
    sysid_real s1_0, s1_1, s1_2, s1_3;
    int ik1;
    {
        s1_0 = s0_1;
        s1_1 = s0_1 + ((sysid_real)0.03125)*x20 - (sysid_real)0.03125*x3;
        s1_2 = (sysid_real)1.0*s0_1 + (sysid_real)0.015625*x20 - (sysid_real)0.015625*x3;
        s1_3 = (sysid_real)1.0;
    }
    for (ik1 = 0; ik1 < 60; ik1++) {
        if (!((sysid_real)2.220446049250313e-16 < s1_3)) {
            break;
        }
        const sysid_real x27 = x1*(s1_2 + x19);
        const sysid_real x28 = sysid_tanh(sysid_pwm_b_fill_network_flow_weights[0]*x27 + x7);
        const sysid_real x29 = sysid_tanh(sysid_pwm_b_fill_network_flow_weights[1]*x27 + x8);
        const sysid_real x30 = sysid_tanh(sysid_pwm_b_fill_network_flow_weights[2]*x27 + x9);
        const sysid_real x31 = sysid_tanh(sysid_pwm_b_fill_network_flow_weights[3]*x27 + x10);
        const sysid_real x32 = sysid_tanh(sysid_pwm_b_fill_network_flow_weights[4]*x27 + x11);
        const sysid_real x33 = sysid_tanh(sysid_pwm_b_fill_network_flow_weights[5]*x27 + x12);
        const sysid_real x34 = sysid_tanh(sysid_pwm_b_fill_network_flow_weights[6]*x27 + x13);
        const sysid_real x35 = sysid_tanh(sysid_pwm_b_fill_network_flow_weights[7]*x27 + x14);
        const sysid_real x36 = sysid_tanh(sysid_pwm_b_fill_network_flow_weights[8]*x27 + x15);
        const sysid_real x37 = sysid_tanh(sysid_pwm_b_fill_network_flow_weights[9]*x27 + x16);
        const sysid_real x38 = sysid_pwm_b_fill_network_scaling[4] +
            sysid_pwm_b_fill_network_scaling[5]*(sysid_pwm_b_fill_network_output_bias[0] +
            sysid_pwm_b_fill_network_output_weights[0]*x28 +
            sysid_pwm_b_fill_network_output_weights[1]*x29 +
            sysid_pwm_b_fill_network_output_weights[2]*x30 +
            sysid_pwm_b_fill_network_output_weights[3]*x31 +
            sysid_pwm_b_fill_network_output_weights[4]*x32 +
            sysid_pwm_b_fill_network_output_weights[5]*x33 +
            sysid_pwm_b_fill_network_output_weights[6]*x34 +
            sysid_pwm_b_fill_network_output_weights[7]*x35 +
            sysid_pwm_b_fill_network_output_weights[8]*x36 +
            sysid_pwm_b_fill_network_output_weights[9]*x37);
        const int x39 = x0 <= x38;
        const sysid_real x40 = x39 ? s1_0 : s1_2;
        const sysid_real x41 = x39 ? s1_2 : s1_1;
        const sysid_real x42 =
            sysid_pwm_b_fill_network_scaling[5]*x1*(sysid_pwm_b_fill_network_flow_weights[0]*sysid_pwm_b_fill_network_output_weights[0]*((sysid_real)1.0
            - sysid_square(x28)) +
            sysid_pwm_b_fill_network_flow_weights[1]*sysid_pwm_b_fill_network_output_weights[1]*((sysid_real)1.0
            - sysid_square(x29)) +
            sysid_pwm_b_fill_network_flow_weights[2]*sysid_pwm_b_fill_network_output_weights[2]*((sysid_real)1.0
            - sysid_square(x30)) +
            sysid_pwm_b_fill_network_flow_weights[3]*sysid_pwm_b_fill_network_output_weights[3]*((sysid_real)1.0
            - sysid_square(x31)) +
            sysid_pwm_b_fill_network_flow_weights[4]*sysid_pwm_b_fill_network_output_weights[4]*((sysid_real)1.0
            - sysid_square(x32)) +
            sysid_pwm_b_fill_network_flow_weights[5]*sysid_pwm_b_fill_network_output_weights[5]*((sysid_real)1.0
            - sysid_square(x33)) +
            sysid_pwm_b_fill_network_flow_weights[6]*sysid_pwm_b_fill_network_output_weights[6]*((sysid_real)1.0
            - sysid_square(x34)) +
            sysid_pwm_b_fill_network_flow_weights[7]*sysid_pwm_b_fill_network_output_weights[7]*((sysid_real)1.0
            - sysid_square(x35)) +
            sysid_pwm_b_fill_network_flow_weights[8]*sysid_pwm_b_fill_network_output_weights[8]*((sysid_real)1.0
            - sysid_square(x36)) +
            sysid_pwm_b_fill_network_flow_weights[9]*sysid_pwm_b_fill_network_output_weights[9]*((sysid_real)1.0
            - sysid_square(x37)));
        const sysid_real x43 = s1_2 - (-x0 + x38)/((x42 == (sysid_real)0.0) ? (sysid_real)1.0 :
            x42);
        const int x44 = (x40 <= x43) && (x43 <= x41);
        const sysid_real x45 = x44 ? x43 : (sysid_real)0.5*x40 + (sysid_real)0.5*x41;
        const sysid_real y0 = x40;
        const sysid_real y1 = x41;
        const sysid_real y2 = x45;
        const sysid_real y3 = x44 ? (sysid_real)0.000244140625*x46*sysid_fabs(-s1_2 + x45) :
            x46*(-x40 + x41);
        s1_0 = y0;
        s1_1 = y1;
        s1_2 = y2;
        s1_3 = y3;
    }
    const int x47 = (sysid_real)0.0 < s0_0;
    if (flags) {
        *flags = (x2 != pressure_pa ? SYSID_PRESSURE : 0u) |
            ((sysid_pwm_b_fill_network_duty_range[1] + (sysid_real)1e-09 < duty) || !x47 ?
            SYSID_ABOVE : 0u) | ((duty < sysid_pwm_b_fill_network_duty_range[0] +
            (sysid_real)-1e-09) || (x0 < x17) ? SYSID_BELOW : 0u);
    }
    return sysid_known_flagged(x18 ? x3 : (x47 ? s1_2 : s0_2), flags);
}

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_b_fill_network_duty(
    sysid_real flow_kg_s, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return 0;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_b_fill_network_pressure_range[0]), sysid_pwm_b_fill_network_pressure_range[1]);
    const sysid_real x1 = sysid_interpolate(x0, sysid_pwm_b_fill_network_pressure,
        sysid_pwm_b_fill_network_flow_low, 25);
    const sysid_real x2 = sysid_interpolate(x0, sysid_pwm_b_fill_network_pressure,
        sysid_pwm_b_fill_network_flow_high, 25);
    const sysid_real x3 = (-sysid_pwm_b_fill_network_scaling[0] +
        sysid_minimum(sysid_maximum(flow_kg_s, x1), x2))/sysid_pwm_b_fill_network_scaling[1];
    const sysid_real x4 = (-sysid_pwm_b_fill_network_scaling[2] +
        x0)/sysid_pwm_b_fill_network_scaling[3];
    const sysid_real x5 = sysid_pwm_b_fill_network_scaling[4] +
        sysid_pwm_b_fill_network_scaling[5]*(sysid_pwm_b_fill_network_output_bias[0] +
        sysid_pwm_b_fill_network_output_weights[0]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[0]*x3
        + sysid_pwm_b_fill_network_hidden_bias[0] + sysid_pwm_b_fill_network_pressure_weights[0]*x4)
        +
        sysid_pwm_b_fill_network_output_weights[1]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[1]*x3
        + sysid_pwm_b_fill_network_hidden_bias[1] + sysid_pwm_b_fill_network_pressure_weights[1]*x4)
        +
        sysid_pwm_b_fill_network_output_weights[2]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[2]*x3
        + sysid_pwm_b_fill_network_hidden_bias[2] + sysid_pwm_b_fill_network_pressure_weights[2]*x4)
        +
        sysid_pwm_b_fill_network_output_weights[3]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[3]*x3
        + sysid_pwm_b_fill_network_hidden_bias[3] + sysid_pwm_b_fill_network_pressure_weights[3]*x4)
        +
        sysid_pwm_b_fill_network_output_weights[4]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[4]*x3
        + sysid_pwm_b_fill_network_hidden_bias[4] + sysid_pwm_b_fill_network_pressure_weights[4]*x4)
        +
        sysid_pwm_b_fill_network_output_weights[5]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[5]*x3
        + sysid_pwm_b_fill_network_hidden_bias[5] + sysid_pwm_b_fill_network_pressure_weights[5]*x4)
        +
        sysid_pwm_b_fill_network_output_weights[6]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[6]*x3
        + sysid_pwm_b_fill_network_hidden_bias[6] + sysid_pwm_b_fill_network_pressure_weights[6]*x4)
        +
        sysid_pwm_b_fill_network_output_weights[7]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[7]*x3
        + sysid_pwm_b_fill_network_hidden_bias[7] + sysid_pwm_b_fill_network_pressure_weights[7]*x4)
        +
        sysid_pwm_b_fill_network_output_weights[8]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[8]*x3
        + sysid_pwm_b_fill_network_hidden_bias[8] + sysid_pwm_b_fill_network_pressure_weights[8]*x4)
        +
        sysid_pwm_b_fill_network_output_weights[9]*sysid_tanh(sysid_pwm_b_fill_network_flow_weights[9]*x3
        + sysid_pwm_b_fill_network_hidden_bias[9] +
        sysid_pwm_b_fill_network_pressure_weights[9]*x4));
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | ((x2 < flow_kg_s) ||
            (sysid_pwm_b_fill_network_duty_range[1] < x5) ? SYSID_ABOVE : 0u) | ((flow_kg_s < x1) ||
            (x5 < sysid_pwm_b_fill_network_duty_range[0]) ? SYSID_BELOW : 0u);
    }
    return sysid_known_flagged_duty(sysid_minimum(sysid_maximum(x5, sysid_pwm_b_fill_network_duty_range[0]),
        sysid_pwm_b_fill_network_duty_range[1]), flags);
}

static const sysid_real sysid_pwm_b_discharge_bipolynomial_duty_range[2] = {
    (sysid_real)0.02, (sysid_real)0.7400000000000001
};
static const sysid_real sysid_pwm_b_discharge_bipolynomial_pressure_range[2] = {
    (sysid_real)135896.6743122265, (sysid_real)309250.49169166014
};
static const sysid_real sysid_pwm_b_discharge_bipolynomial_pressure[25] = {
    (sysid_real)135896.6743122265, (sysid_real)143119.75003636957, (sysid_real)150342.82576051264, (sysid_real)157565.9014846557,
    (sysid_real)164788.97720879878, (sysid_real)172012.05293294185, (sysid_real)179235.12865708492, (sysid_real)186458.204381228,
    (sysid_real)193681.28010537106, (sysid_real)200904.35582951413, (sysid_real)208127.43155365717, (sysid_real)215350.50727780024,
    (sysid_real)222573.5830019433, (sysid_real)229796.65872608637, (sysid_real)237019.73445022944, (sysid_real)244242.8101743725,
    (sysid_real)251465.88589851558, (sysid_real)258688.96162265865, (sysid_real)265912.0373468017, (sysid_real)273135.1130709448,
    (sysid_real)280358.18879508786, (sysid_real)287581.2645192309, (sysid_real)294804.340243374, (sysid_real)302027.41596751707,
    (sysid_real)309250.49169166014
};
static const sysid_real sysid_pwm_b_discharge_bipolynomial_duty_low[25] = {
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.02,
    (sysid_real)0.18000000000000005
};
static const sysid_real sysid_pwm_b_discharge_bipolynomial_duty_high[25] = {
    (sysid_real)0.02, (sysid_real)0.02, (sysid_real)0.06000000000000002, (sysid_real)0.14000000000000007,
    (sysid_real)0.22000000000000008, (sysid_real)0.22000000000000008, (sysid_real)0.2599999999999999, (sysid_real)0.29999999999999993,
    (sysid_real)0.3399999999999999, (sysid_real)0.3399999999999999, (sysid_real)0.3399999999999999, (sysid_real)0.3399999999999999,
    (sysid_real)0.37999999999999995, (sysid_real)0.37999999999999995, (sysid_real)0.37999999999999995, (sysid_real)0.42,
    (sysid_real)0.42, (sysid_real)0.4600000000000001, (sysid_real)0.4600000000000001, (sysid_real)0.5,
    (sysid_real)0.54, (sysid_real)0.58, (sysid_real)0.62, (sysid_real)0.7400000000000001,
    (sysid_real)0.7400000000000001
};
static const sysid_real sysid_pwm_b_discharge_bipolynomial_coefficients[9] = {
    (sysid_real)-0.0002484831069447166, (sysid_real)-0.00015887331227227585, (sysid_real)0.00010526306122583782, (sysid_real)0.0007992122748023243,
    (sysid_real)-0.00025517104852309646, (sysid_real)-0.0002394896703559503, (sysid_real)-0.0007443811583109572, (sysid_real)0.0012676177937613442,
    (sysid_real)-0.00038486329855064703
};
static const sysid_real sysid_pwm_b_discharge_bipolynomial_pressure_scaling[2] = {
    (sysid_real)222883.0455618224, (sysid_real)86065.55360999223
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_b_discharge_flow(
    sysid_real duty, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(duty) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_b_discharge_bipolynomial_pressure_range[0]),
        sysid_pwm_b_discharge_bipolynomial_pressure_range[1]);
    const sysid_real x1 = -sysid_pwm_b_discharge_bipolynomial_pressure_scaling[0] + x0;
    const sysid_real x2 = (sysid_real)-1.0 +
        (sysid_real)2.0*sysid_square(x1)/sysid_square(sysid_pwm_b_discharge_bipolynomial_pressure_scaling[1]);
    const sysid_real x3 = x1/sysid_pwm_b_discharge_bipolynomial_pressure_scaling[1];
    const sysid_real x4 = sysid_minimum(sysid_maximum(duty,
        sysid_pwm_b_discharge_bipolynomial_duty_range[0]),
        sysid_pwm_b_discharge_bipolynomial_duty_range[1]);
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | (sysid_interpolate(x0,
            sysid_pwm_b_discharge_bipolynomial_pressure,
            sysid_pwm_b_discharge_bipolynomial_duty_high, 25) + (sysid_real)1e-09 < duty ?
            SYSID_ABOVE : 0u) | (duty < sysid_interpolate(x0,
            sysid_pwm_b_discharge_bipolynomial_pressure,
            sysid_pwm_b_discharge_bipolynomial_duty_low, 25) + (sysid_real)-1e-09 ? SYSID_BELOW :
            0u);
    }
    return sysid_known_flagged(sysid_pwm_b_discharge_bipolynomial_coefficients[0] +
        sysid_pwm_b_discharge_bipolynomial_coefficients[1]*x3 +
        sysid_pwm_b_discharge_bipolynomial_coefficients[2]*x2 +
        x4*(sysid_pwm_b_discharge_bipolynomial_coefficients[3] +
        sysid_pwm_b_discharge_bipolynomial_coefficients[4]*x3 +
        sysid_pwm_b_discharge_bipolynomial_coefficients[5]*x2 +
        x4*(sysid_pwm_b_discharge_bipolynomial_coefficients[6] +
        sysid_pwm_b_discharge_bipolynomial_coefficients[7]*x3 +
        sysid_pwm_b_discharge_bipolynomial_coefficients[8]*x2)), flags);
}

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_b_discharge_duty(
    sysid_real flow_kg_s, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return 0;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_b_discharge_bipolynomial_pressure_range[0]),
        sysid_pwm_b_discharge_bipolynomial_pressure_range[1]);
    const sysid_real x1 = -sysid_pwm_b_discharge_bipolynomial_pressure_scaling[0] + x0;
    const sysid_real x2 = (sysid_real)-1.0 +
        (sysid_real)2.0*sysid_square(x1)/sysid_square(sysid_pwm_b_discharge_bipolynomial_pressure_scaling[1]);
    const sysid_real x3 = sysid_pwm_b_discharge_bipolynomial_coefficients[8]*x2;
    const sysid_real x4 = x1/sysid_pwm_b_discharge_bipolynomial_pressure_scaling[1];
    const sysid_real x5 = sysid_pwm_b_discharge_bipolynomial_coefficients[7]*x4;
    const sysid_real x6 = (sysid_real)2.0*sysid_pwm_b_discharge_bipolynomial_coefficients[6] +
        (sysid_real)2.0*x3 + (sysid_real)2.0*x5;
    const sysid_real x7 = sysid_interpolate(x0, sysid_pwm_b_discharge_bipolynomial_pressure,
        sysid_pwm_b_discharge_bipolynomial_duty_low, 25);
    const sysid_real x8 = sysid_pwm_b_discharge_bipolynomial_coefficients[3] +
        sysid_pwm_b_discharge_bipolynomial_coefficients[4]*x4 +
        sysid_pwm_b_discharge_bipolynomial_coefficients[5]*x2;
    const sysid_real x9 = x6*x7 + x8;
    const sysid_real x10 = sysid_interpolate(x0, sysid_pwm_b_discharge_bipolynomial_pressure,
        sysid_pwm_b_discharge_bipolynomial_duty_high, 25);
    const sysid_real x11 = x10*x6 + x8;
    const int x12 = ((x9 <= (sysid_real)0.0) && (x11 <= (sysid_real)0.0)) && ((x9 <
        (sysid_real)0.0) || (x11 < (sysid_real)0.0));
    const sysid_real x13 = sysid_pwm_b_discharge_bipolynomial_coefficients[6] + x3 + x5;
    const int x14 = x13 != (sysid_real)0.0;
    const sysid_real x15 = x12 ? -x10 : x7;
    const sysid_real x16 = x12 ? -x8 : x8;
    const sysid_real x17 = ((sysid_real)0.5)/(x14 ? x13 : (sysid_real)1.0);
    const sysid_real x18 = -x16*x17;
    const sysid_real x19 = x12 ? -x7 : x10;
    const int x20 = (x14 && (x15 < x18)) && (x18 < x19);
    const int x21 = (sysid_real)0.0 < x13;
    const sysid_real x22 = (x20 && x21) ? x18 : x15;
    const sysid_real x23 = sysid_pwm_b_discharge_bipolynomial_coefficients[2]*x2;
    const sysid_real x24 = sysid_pwm_b_discharge_bipolynomial_coefficients[1]*x4;
    const sysid_real x25 = sysid_pwm_b_discharge_bipolynomial_coefficients[0] + x23 + x24;
    const int x26 = flow_kg_s < x22*(x13*x22 + x16) + x25;
    const int x27 = x13 < (sysid_real)0.0;
    const sysid_real x28 = (x20 && x27) ? x18 : x19;
    const int x29 = x25 + x28*(x13*x28 + x16) < flow_kg_s;
    const sysid_real x30 = sysid_sqrt(sysid_maximum(sysid_square(x16) - (-flow_kg_s +
        x25)*((sysid_real)4.0*sysid_pwm_b_discharge_bipolynomial_coefficients[6] +
        (sysid_real)4.0*x3 + (sysid_real)4.0*x5), (sysid_real)0.0));
    const sysid_real x31 = x16 + x30;
    const int x32 = x31 != (sysid_real)0.0;
    const sysid_real x33 = x26 ? x22 : (x29 ? x28 : sysid_minimum(sysid_maximum(((sysid_real)0.0
        <= x16) ? (x32 ? ((sysid_real)2.0*flow_kg_s -
        (sysid_real)2.0*sysid_pwm_b_discharge_bipolynomial_coefficients[0] - (sysid_real)2.0*x23 -
        (sysid_real)2.0*x24)/(x32 ? x31 : (sysid_real)1.0) : x22) : x17*(-x16 + x30), x22), x28));
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | (x26 ? SYSID_BELOW : 0u) | (x29 ?
            SYSID_ABOVE : 0u) | (x20 && ((x26 && x21) || (x29 && x27)) ? SYSID_NO_ROOT : 0u) | (x12
            || ((x13 == (sysid_real)0.0) && (x16 == (sysid_real)0.0)) ? SYSID_DECREASING : 0u);
    }
    return sysid_known_flagged_duty(x12 ? -x33 : x33, flags);
}

static const sysid_real sysid_pwm_b_discharge_network_duty_range[2] = {
    (sysid_real)0.02, (sysid_real)0.7400000000000001
};
static const sysid_real sysid_pwm_b_discharge_network_pressure_range[2] = {
    (sysid_real)135896.6743122265, (sysid_real)309250.49169166014
};
static const sysid_real sysid_pwm_b_discharge_network_pressure[25] = {
    (sysid_real)135896.6743122265, (sysid_real)143119.75003636957, (sysid_real)150342.82576051264, (sysid_real)157565.9014846557,
    (sysid_real)164788.97720879878, (sysid_real)172012.05293294185, (sysid_real)179235.12865708492, (sysid_real)186458.204381228,
    (sysid_real)193681.28010537106, (sysid_real)200904.35582951413, (sysid_real)208127.43155365717, (sysid_real)215350.50727780024,
    (sysid_real)222573.5830019433, (sysid_real)229796.65872608637, (sysid_real)237019.73445022944, (sysid_real)244242.8101743725,
    (sysid_real)251465.88589851558, (sysid_real)258688.96162265865, (sysid_real)265912.0373468017, (sysid_real)273135.1130709448,
    (sysid_real)280358.18879508786, (sysid_real)287581.2645192309, (sysid_real)294804.340243374, (sysid_real)302027.41596751707,
    (sysid_real)309250.49169166014
};
static const sysid_real sysid_pwm_b_discharge_network_flow_low[25] = {
    (sysid_real)-2.2999761971492455e-05, (sysid_real)-4.121670050799171e-05, (sysid_real)-6.878070750047493e-05, (sysid_real)-0.00011081013707045007,
    (sysid_real)-0.00016598484149064395, (sysid_real)-0.0001990088357980812, (sysid_real)-0.00024018669706845318, (sysid_real)-0.0002753415467299822,
    (sysid_real)-0.00031960684046773865, (sysid_real)-0.00031960684046773865, (sysid_real)-0.0003195225681017383, (sysid_real)-0.00032076225490862474,
    (sysid_real)-0.0003242012186993891, (sysid_real)-0.00032649386122656534, (sysid_real)-0.00032997052436935313, (sysid_real)-0.00033345765481862993,
    (sysid_real)-0.0003357809915829624, (sysid_real)-0.00033922971385587694, (sysid_real)-0.0003426784361287914, (sysid_real)-0.00034501145789222364,
    (sysid_real)-0.0003486060356154051, (sysid_real)-0.00035220061333858657, (sysid_real)-0.0003533988059129804, (sysid_real)-0.0003533988059129804,
    (sysid_real)-0.00026580251497824564
};
static const sysid_real sysid_pwm_b_discharge_network_flow_high[25] = {
    (sysid_real)-4.764869341547063e-06, (sysid_real)-4.764869341547063e-06, (sysid_real)-1.4788992186970294e-06, (sysid_real)-7.709251780510722e-08,
    (sysid_real)-7.709251780510722e-08, (sysid_real)-1.0410301378310408e-06, (sysid_real)-1.1373710044856791e-06, (sysid_real)-1.1373710044856791e-06,
    (sysid_real)-4.015243037550183e-06, (sysid_real)-1.565813914263326e-05, (sysid_real)-1.830584270566519e-05, (sysid_real)-2.7213579360986905e-05,
    (sysid_real)-6.169994205084258e-06, (sysid_real)-6.169994205084258e-06, (sysid_real)-1.659266299946658e-05, (sysid_real)-6.050256846402628e-06,
    (sysid_real)-6.050256846402628e-06, (sysid_real)-3.0712459562239146e-06, (sysid_real)-3.0712459562239146e-06, (sysid_real)-3.6966737735542142e-06,
    (sysid_real)-6.72451185954192e-07, (sysid_real)-6.142713992077936e-07, (sysid_real)-2.5480834875775057e-07, (sysid_real)-1.4003964768040957e-08,
    (sysid_real)-1.4003964768040957e-08
};
static const sysid_real sysid_pwm_b_discharge_network_flow_weights[10] = {
    (sysid_real)1.5224656596673172, (sysid_real)0.3372024828135144, (sysid_real)4.081039402357273, (sysid_real)-0.263875569141844,
    (sysid_real)-0.04620668569970403, (sysid_real)0.26137015278983444, (sysid_real)-0.4376433281162447, (sysid_real)0.3842452557416901,
    (sysid_real)-0.5125537010646316, (sysid_real)0.11304641874218607
};
static const sysid_real sysid_pwm_b_discharge_network_pressure_weights[10] = {
    (sysid_real)-9.073072760256393, (sysid_real)21.44551872853345, (sysid_real)86.08888241980713, (sysid_real)-4.228280841374572,
    (sysid_real)-0.3047258221898148, (sysid_real)-1.2064022509502674, (sysid_real)-17.17897086742309, (sysid_real)19.909014833273257,
    (sysid_real)-5.836584803418606, (sysid_real)-0.5422824751413088
};
static const sysid_real sysid_pwm_b_discharge_network_hidden_bias[10] = {
    (sysid_real)-6.270975499522476, (sysid_real)7.481650803043049, (sysid_real)53.346016417066934, (sysid_real)6.121362215829745,
    (sysid_real)1.0030359598345364, (sysid_real)-0.3522327846469938, (sysid_real)-5.99794804837728, (sysid_real)6.968244097356639,
    (sysid_real)-2.417760405430211, (sysid_real)1.4341763274715713
};
static const sysid_real sysid_pwm_b_discharge_network_output_weights[10] = {
    (sysid_real)0.06215791060875163, (sysid_real)-2.2540762752847274, (sysid_real)0.14038000078432938, (sysid_real)-5.739927658691555,
    (sysid_real)-12.482974611278436, (sysid_real)0.5968043079748133, (sysid_real)1.7433034395224691, (sysid_real)3.9980848942785565,
    (sysid_real)-0.22931055708708833, (sysid_real)7.434275447333298
};
static const sysid_real sysid_pwm_b_discharge_network_output_bias[1] = {
    (sysid_real)7.988986901426538
};
static const sysid_real sysid_pwm_b_discharge_network_scaling[6] = {
    (sysid_real)-0.00017674074998484882, (sysid_real)0.0001767267460200808, (sysid_real)222883.0455618224, (sysid_real)86065.55360999223,
    (sysid_real)0.38000000000000006, (sysid_real)0.36000000000000004
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_b_discharge_network_flow(
    sysid_real duty, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(duty) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(duty,
        sysid_pwm_b_discharge_network_duty_range[0]), sysid_pwm_b_discharge_network_duty_range[1]);
    const sysid_real x1 = (sysid_real)1.0/sysid_pwm_b_discharge_network_scaling[1];
    const sysid_real x2 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_b_discharge_network_pressure_range[0]),
        sysid_pwm_b_discharge_network_pressure_range[1]);
    const sysid_real x3 = sysid_interpolate(x2, sysid_pwm_b_discharge_network_pressure,
        sysid_pwm_b_discharge_network_flow_low, 25);
    const sysid_real x4 = -x3;
    const sysid_real x5 = x1*(-sysid_pwm_b_discharge_network_scaling[0] - x4);
    const sysid_real x6 = (-sysid_pwm_b_discharge_network_scaling[2] +
        x2)/sysid_pwm_b_discharge_network_scaling[3];
    const sysid_real x7 = sysid_pwm_b_discharge_network_hidden_bias[0] +
        sysid_pwm_b_discharge_network_pressure_weights[0]*x6;
    const sysid_real x8 = sysid_pwm_b_discharge_network_hidden_bias[1] +
        sysid_pwm_b_discharge_network_pressure_weights[1]*x6;
    const sysid_real x9 = sysid_pwm_b_discharge_network_hidden_bias[2] +
        sysid_pwm_b_discharge_network_pressure_weights[2]*x6;
    const sysid_real x10 = sysid_pwm_b_discharge_network_hidden_bias[3] +
        sysid_pwm_b_discharge_network_pressure_weights[3]*x6;
    const sysid_real x11 = sysid_pwm_b_discharge_network_hidden_bias[4] +
        sysid_pwm_b_discharge_network_pressure_weights[4]*x6;
    const sysid_real x12 = sysid_pwm_b_discharge_network_hidden_bias[5] +
        sysid_pwm_b_discharge_network_pressure_weights[5]*x6;
    const sysid_real x13 = sysid_pwm_b_discharge_network_hidden_bias[6] +
        sysid_pwm_b_discharge_network_pressure_weights[6]*x6;
    const sysid_real x14 = sysid_pwm_b_discharge_network_hidden_bias[7] +
        sysid_pwm_b_discharge_network_pressure_weights[7]*x6;
    const sysid_real x15 = sysid_pwm_b_discharge_network_hidden_bias[8] +
        sysid_pwm_b_discharge_network_pressure_weights[8]*x6;
    const sysid_real x16 = sysid_pwm_b_discharge_network_hidden_bias[9] +
        sysid_pwm_b_discharge_network_pressure_weights[9]*x6;
    const sysid_real x17 = sysid_pwm_b_discharge_network_scaling[4] +
        sysid_pwm_b_discharge_network_scaling[5]*(sysid_pwm_b_discharge_network_output_bias[0] +
        sysid_pwm_b_discharge_network_output_weights[0]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[0]*x5
        + x7) +
        sysid_pwm_b_discharge_network_output_weights[1]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[1]*x5
        + x8) +
        sysid_pwm_b_discharge_network_output_weights[2]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[2]*x5
        + x9) +
        sysid_pwm_b_discharge_network_output_weights[3]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[3]*x5
        + x10) +
        sysid_pwm_b_discharge_network_output_weights[4]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[4]*x5
        + x11) +
        sysid_pwm_b_discharge_network_output_weights[5]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[5]*x5
        + x12) +
        sysid_pwm_b_discharge_network_output_weights[6]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[6]*x5
        + x13) +
        sysid_pwm_b_discharge_network_output_weights[7]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[7]*x5
        + x14) +
        sysid_pwm_b_discharge_network_output_weights[8]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[8]*x5
        + x15) +
        sysid_pwm_b_discharge_network_output_weights[9]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[9]*x5
        + x16));
    const int x18 = x0 <= x17;
    const sysid_real x19 = -sysid_pwm_b_discharge_network_scaling[0];
    const sysid_real x20 = sysid_interpolate(x2, sysid_pwm_b_discharge_network_pressure,
        sysid_pwm_b_discharge_network_flow_high, 25);
    const sysid_real x21 = x20 + x4;
    const sysid_real x46 = (sysid_real)1.0/x21;
    sysid_real s0_0, s0_1, s0_2, s0_3;
    int ik0;
    {
        s0_0 = x18 ? (sysid_real)1.0 : (sysid_real)0.0;
        s0_1 = x3;
        s0_2 = x3;
        s0_3 = x17;
    }
    for (ik0 = 0; ik0 < 32; ik0++) {
        const sysid_real k0 = (sysid_real)ik0;
        const sysid_real x22 = x21*(((sysid_real)0.03125)*k0 + (sysid_real)0.03125) + x3;
        const sysid_real x23 = x1*(x19 + x22);
        const sysid_real x24 = sysid_pwm_b_discharge_network_scaling[4] +
            sysid_pwm_b_discharge_network_scaling[5]*(sysid_pwm_b_discharge_network_output_bias[0] +
            sysid_pwm_b_discharge_network_output_weights[0]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[0]*x23
            + x7) +
            sysid_pwm_b_discharge_network_output_weights[1]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[1]*x23
            + x8) +
            sysid_pwm_b_discharge_network_output_weights[2]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[2]*x23
            + x9) +
            sysid_pwm_b_discharge_network_output_weights[3]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[3]*x23
            + x10) +
            sysid_pwm_b_discharge_network_output_weights[4]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[4]*x23
            + x11) +
            sysid_pwm_b_discharge_network_output_weights[5]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[5]*x23
            + x12) +
            sysid_pwm_b_discharge_network_output_weights[6]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[6]*x23
            + x13) +
            sysid_pwm_b_discharge_network_output_weights[7]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[7]*x23
            + x14) +
            sysid_pwm_b_discharge_network_output_weights[8]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[8]*x23
            + x15) +
            sysid_pwm_b_discharge_network_output_weights[9]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[9]*x23
            + x16));
        const sysid_real x25 = (x0 <= x24) ? (sysid_real)1.0 : s0_0;
        const int x26 = s0_3 < x24;
        const sysid_real y0 = x25;
        const sysid_real y1 = ((sysid_real)0.0 < x25) ? s0_1 : x22;
        const sysid_real y2 = x26 ? x22 : s0_2;
        const sysid_real y3 = x26 ? x24 : s0_3;
        s0_0 = y0;
        s0_1 = y1;
        s0_2 = y2;
        s0_3 = y3;
    }
    sysid_real s1_0, s1_1, s1_2, s1_3;
    int ik1;
    {
        s1_0 = s0_1;
        s1_1 = s0_1 + ((sysid_real)0.03125)*x20 - (sysid_real)0.03125*x3;
        s1_2 = (sysid_real)1.0*s0_1 + (sysid_real)0.015625*x20 - (sysid_real)0.015625*x3;
        s1_3 = (sysid_real)1.0;
    }
    for (ik1 = 0; ik1 < 60; ik1++) {
        if (!((sysid_real)2.220446049250313e-16 < s1_3)) {
            break;
        }
        const sysid_real x27 = x1*(s1_2 + x19);
        const sysid_real x28 = sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[0]*x27 +
            x7);
        const sysid_real x29 = sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[1]*x27 +
            x8);
        const sysid_real x30 = sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[2]*x27 +
            x9);
        const sysid_real x31 = sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[3]*x27 +
            x10);
        const sysid_real x32 = sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[4]*x27 +
            x11);
        const sysid_real x33 = sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[5]*x27 +
            x12);
        const sysid_real x34 = sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[6]*x27 +
            x13);
        const sysid_real x35 = sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[7]*x27 +
            x14);
        const sysid_real x36 = sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[8]*x27 +
            x15);
        const sysid_real x37 = sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[9]*x27 +
            x16);
        const sysid_real x38 = sysid_pwm_b_discharge_network_scaling[4] +
            sysid_pwm_b_discharge_network_scaling[5]*(sysid_pwm_b_discharge_network_output_bias[0] +
            sysid_pwm_b_discharge_network_output_weights[0]*x28 +
            sysid_pwm_b_discharge_network_output_weights[1]*x29 +
            sysid_pwm_b_discharge_network_output_weights[2]*x30 +
            sysid_pwm_b_discharge_network_output_weights[3]*x31 +
            sysid_pwm_b_discharge_network_output_weights[4]*x32 +
            sysid_pwm_b_discharge_network_output_weights[5]*x33 +
            sysid_pwm_b_discharge_network_output_weights[6]*x34 +
            sysid_pwm_b_discharge_network_output_weights[7]*x35 +
            sysid_pwm_b_discharge_network_output_weights[8]*x36 +
            sysid_pwm_b_discharge_network_output_weights[9]*x37);
        const int x39 = x0 <= x38;
        const sysid_real x40 = x39 ? s1_0 : s1_2;
        const sysid_real x41 = x39 ? s1_2 : s1_1;
        const sysid_real x42 =
            sysid_pwm_b_discharge_network_scaling[5]*x1*(sysid_pwm_b_discharge_network_flow_weights[0]*sysid_pwm_b_discharge_network_output_weights[0]*((sysid_real)1.0
            - sysid_square(x28)) +
            sysid_pwm_b_discharge_network_flow_weights[1]*sysid_pwm_b_discharge_network_output_weights[1]*((sysid_real)1.0
            - sysid_square(x29)) +
            sysid_pwm_b_discharge_network_flow_weights[2]*sysid_pwm_b_discharge_network_output_weights[2]*((sysid_real)1.0
            - sysid_square(x30)) +
            sysid_pwm_b_discharge_network_flow_weights[3]*sysid_pwm_b_discharge_network_output_weights[3]*((sysid_real)1.0
            - sysid_square(x31)) +
            sysid_pwm_b_discharge_network_flow_weights[4]*sysid_pwm_b_discharge_network_output_weights[4]*((sysid_real)1.0
            - sysid_square(x32)) +
            sysid_pwm_b_discharge_network_flow_weights[5]*sysid_pwm_b_discharge_network_output_weights[5]*((sysid_real)1.0
            - sysid_square(x33)) +
            sysid_pwm_b_discharge_network_flow_weights[6]*sysid_pwm_b_discharge_network_output_weights[6]*((sysid_real)1.0
            - sysid_square(x34)) +
            sysid_pwm_b_discharge_network_flow_weights[7]*sysid_pwm_b_discharge_network_output_weights[7]*((sysid_real)1.0
            - sysid_square(x35)) +
            sysid_pwm_b_discharge_network_flow_weights[8]*sysid_pwm_b_discharge_network_output_weights[8]*((sysid_real)1.0
            - sysid_square(x36)) +
            sysid_pwm_b_discharge_network_flow_weights[9]*sysid_pwm_b_discharge_network_output_weights[9]*((sysid_real)1.0
            - sysid_square(x37)));
        const sysid_real x43 = s1_2 - (-x0 + x38)/((x42 == (sysid_real)0.0) ? (sysid_real)1.0 :
            x42);
        const int x44 = (x40 <= x43) && (x43 <= x41);
        const sysid_real x45 = x44 ? x43 : (sysid_real)0.5*x40 + (sysid_real)0.5*x41;
        const sysid_real y0 = x40;
        const sysid_real y1 = x41;
        const sysid_real y2 = x45;
        const sysid_real y3 = x44 ? (sysid_real)0.000244140625*x46*sysid_fabs(-s1_2 + x45) :
            x46*(-x40 + x41);
        s1_0 = y0;
        s1_1 = y1;
        s1_2 = y2;
        s1_3 = y3;
    }
    const int x47 = (sysid_real)0.0 < s0_0;
    if (flags) {
        *flags = (x2 != pressure_pa ? SYSID_PRESSURE : 0u) |
            ((sysid_pwm_b_discharge_network_duty_range[1] + (sysid_real)1e-09 < duty) || !x47 ?
            SYSID_ABOVE : 0u) | ((duty < sysid_pwm_b_discharge_network_duty_range[0] +
            (sysid_real)-1e-09) || (x0 < x17) ? SYSID_BELOW : 0u);
    }
    return sysid_known_flagged(x18 ? x3 : (x47 ? s1_2 : s0_2), flags);
}

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa; flags may be NULL. */
static inline sysid_real sysid_pwm_b_discharge_network_duty(
    sysid_real flow_kg_s, sysid_real pressure_pa, unsigned *flags)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        if (flags) {
            *flags = SYSID_INVALID;
        }
        return 0;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(pressure_pa,
        sysid_pwm_b_discharge_network_pressure_range[0]),
        sysid_pwm_b_discharge_network_pressure_range[1]);
    const sysid_real x1 = sysid_interpolate(x0, sysid_pwm_b_discharge_network_pressure,
        sysid_pwm_b_discharge_network_flow_low, 25);
    const sysid_real x2 = sysid_interpolate(x0, sysid_pwm_b_discharge_network_pressure,
        sysid_pwm_b_discharge_network_flow_high, 25);
    const sysid_real x3 = (-sysid_pwm_b_discharge_network_scaling[0] +
        sysid_minimum(sysid_maximum(flow_kg_s, x1), x2))/sysid_pwm_b_discharge_network_scaling[1];
    const sysid_real x4 = (-sysid_pwm_b_discharge_network_scaling[2] +
        x0)/sysid_pwm_b_discharge_network_scaling[3];
    const sysid_real x5 = sysid_pwm_b_discharge_network_scaling[4] +
        sysid_pwm_b_discharge_network_scaling[5]*(sysid_pwm_b_discharge_network_output_bias[0] +
        sysid_pwm_b_discharge_network_output_weights[0]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[0]*x3
        + sysid_pwm_b_discharge_network_hidden_bias[0] +
        sysid_pwm_b_discharge_network_pressure_weights[0]*x4) +
        sysid_pwm_b_discharge_network_output_weights[1]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[1]*x3
        + sysid_pwm_b_discharge_network_hidden_bias[1] +
        sysid_pwm_b_discharge_network_pressure_weights[1]*x4) +
        sysid_pwm_b_discharge_network_output_weights[2]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[2]*x3
        + sysid_pwm_b_discharge_network_hidden_bias[2] +
        sysid_pwm_b_discharge_network_pressure_weights[2]*x4) +
        sysid_pwm_b_discharge_network_output_weights[3]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[3]*x3
        + sysid_pwm_b_discharge_network_hidden_bias[3] +
        sysid_pwm_b_discharge_network_pressure_weights[3]*x4) +
        sysid_pwm_b_discharge_network_output_weights[4]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[4]*x3
        + sysid_pwm_b_discharge_network_hidden_bias[4] +
        sysid_pwm_b_discharge_network_pressure_weights[4]*x4) +
        sysid_pwm_b_discharge_network_output_weights[5]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[5]*x3
        + sysid_pwm_b_discharge_network_hidden_bias[5] +
        sysid_pwm_b_discharge_network_pressure_weights[5]*x4) +
        sysid_pwm_b_discharge_network_output_weights[6]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[6]*x3
        + sysid_pwm_b_discharge_network_hidden_bias[6] +
        sysid_pwm_b_discharge_network_pressure_weights[6]*x4) +
        sysid_pwm_b_discharge_network_output_weights[7]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[7]*x3
        + sysid_pwm_b_discharge_network_hidden_bias[7] +
        sysid_pwm_b_discharge_network_pressure_weights[7]*x4) +
        sysid_pwm_b_discharge_network_output_weights[8]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[8]*x3
        + sysid_pwm_b_discharge_network_hidden_bias[8] +
        sysid_pwm_b_discharge_network_pressure_weights[8]*x4) +
        sysid_pwm_b_discharge_network_output_weights[9]*sysid_tanh(sysid_pwm_b_discharge_network_flow_weights[9]*x3
        + sysid_pwm_b_discharge_network_hidden_bias[9] +
        sysid_pwm_b_discharge_network_pressure_weights[9]*x4));
    if (flags) {
        *flags = (x0 != pressure_pa ? SYSID_PRESSURE : 0u) | ((x2 < flow_kg_s) ||
            (sysid_pwm_b_discharge_network_duty_range[1] < x5) ? SYSID_ABOVE : 0u) | ((flow_kg_s <
            x1) || (x5 < sysid_pwm_b_discharge_network_duty_range[0]) ? SYSID_BELOW : 0u);
    }
    return sysid_known_flagged_duty(sysid_minimum(sysid_maximum(x5, sysid_pwm_b_discharge_network_duty_range[0]),
        sysid_pwm_b_discharge_network_duty_range[1]), flags);
}

/* --- controllers ----------------------------------------------------------------------- */

/* Absolute pressures in Pa; position in rad (linear rig: m), efforts in Nm (N). No allocation and
   no global state: what a controller remembers is in the struct that its caller passes. The
   bundle's effects count in what they predict; an effect with a state starts at rest there, for
   nothing measures it. */

typedef struct {
    sysid_real position, velocity, pressure_a_pa, pressure_b_pa;
} sysid_motion;
static inline int sysid_motion_is_finite(const sysid_motion *x)
{
    return !x || (isfinite(x->position) && isfinite(x->velocity) && isfinite(x->pressure_a_pa)
        && isfinite(x->pressure_b_pa));
}

/* What is known of the plant at a tick; raw_velocity is the unfiltered difference. */
typedef struct {
    sysid_real position, velocity, acceleration, raw_velocity, pressure_a_pa, pressure_b_pa;
} sysid_estimate;
static inline int sysid_estimate_is_finite(const sysid_estimate *x)
{
    return !x || (isfinite(x->position) && isfinite(x->velocity) && isfinite(x->acceleration) &&
        isfinite(x->raw_velocity) && isfinite(x->pressure_a_pa) && isfinite(x->pressure_b_pa));
}

/* The wanted motion at a tick. */
typedef struct {
    sysid_real position, velocity, acceleration, jerk;
} sysid_reference;
static inline int sysid_reference_is_finite(const sysid_reference *x)
{
    return !x || (isfinite(x->position) && isfinite(x->velocity) && isfinite(x->acceleration) &&
        isfinite(x->jerk));
}

/* Whether all ticks of a reference, from now on, are finite. */
static inline int sysid_references_are_finite(const sysid_reference *ahead, int horizon)
{
    int k;
    for (k = 0; k <= horizon; k++) {
        if (!sysid_reference_is_finite(ahead + k)) {
            return 0;
        }
    }
    return 1;
}

/* To the actuators: the motor's effort; valves A and B by duty (0 to 1), or 1 on and 0 off. */
typedef struct {
    sysid_real motor, valve_a, valve_b, payload_kg;
} sysid_commands;
static inline int sysid_commands_is_finite(const sysid_commands *x)
{
    return !x || (isfinite(x->motor) && isfinite(x->valve_a) && isfinite(x->valve_b));
}

/* A Butterworth low-pass of the differences, for ticks of period_s. */
typedef struct {
    sysid_real b[3], a[3], period_s;
} sysid_filter;
static inline int sysid_filter_is_finite(const sysid_filter *x)
{
    return !x || (isfinite(x->b[0]) && isfinite(x->b[1]) && isfinite(x->b[2]) &&
        isfinite(x->a[0]) && isfinite(x->a[1]) && isfinite(x->a[2]) && isfinite(x->period_s));
}

/* What is remembered of the sensors. Here as below, rejected counts the ticks in which a number was
   not finite: for a supervisor. */
typedef struct {
    sysid_real position, pressure_a_pa, pressure_b_pa, difference;
    sysid_real velocity_filter[2], acceleration_filter[2];
    unsigned rejected;
} sysid_sensing;
static inline int sysid_sensing_is_finite(const sysid_sensing *x)
{
    return !x || (isfinite(x->position) && isfinite(x->pressure_a_pa) &&
        isfinite(x->pressure_b_pa) && isfinite(x->difference) && isfinite(x->velocity_filter[0]) &&
        isfinite(x->velocity_filter[1]) && isfinite(x->acceleration_filter[0]) &&
        isfinite(x->acceleration_filter[1]));
}

typedef struct {
    unsigned rejected;
} sysid_pva_state;

/* The payload's inertia, kg m2, and the motor's last effort. */
typedef struct {
    sysid_real payload, motor;
    unsigned rejected;
} sysid_backstepping_state;
static inline int sysid_backstepping_state_is_finite(const sysid_backstepping_state *x)
{
    return !x || (isfinite(x->payload) && isfinite(x->motor));
}

/* Held inputs, 0 or 1, and how many ticks ago they were decided. */
typedef struct {
    sysid_real payload, motor, valve_a, valve_b;
    int tick;
    unsigned rejected;
} sysid_dvmpc_state;
static inline int sysid_dvmpc_state_is_finite(const sysid_dvmpc_state *x)
{
    return !x || (isfinite(x->payload) && isfinite(x->motor) && isfinite(x->valve_a) &&
        isfinite(x->valve_b));
}

/* Motor 0, valves off. Returns 0. */
static inline int sysid_let_go(sysid_commands *out)
{
    out->motor = out->valve_a = out->valve_b = 0;
    out->payload_kg = (sysid_real)NAN;
    return 0;
}

/* The payload that the constants contain, at its lever, kg m2. */
static const sysid_real sysid_payload_inertia_kg_m2 = (sysid_real)0.0;

typedef struct {
    sysid_real position_gain;
    sysid_real velocity_gain;
    sysid_real acceleration_gain;
    sysid_real feedforward_velocity;
    sysid_real feedforward_acceleration;
    sysid_real full_scale;
    sysid_real duty_a_min;
    sysid_real duty_a_max;
    sysid_real duty_b_min;
    sysid_real duty_b_max;
} sysid_pva;
static inline int sysid_pva_is_finite(const sysid_pva *x)
{
    return !x || (isfinite(x->position_gain) && isfinite(x->velocity_gain) &&
        isfinite(x->acceleration_gain) && isfinite(x->feedforward_velocity) &&
        isfinite(x->feedforward_acceleration) && isfinite(x->full_scale) && isfinite(x->duty_a_min)
        && isfinite(x->duty_a_max) && isfinite(x->duty_b_min) && isfinite(x->duty_b_max));
}

static const sysid_pva sysid_pva_defaults = {
    (sysid_real)140.0, (sysid_real)45.0, (sysid_real)1.0, (sysid_real)1.0, (sysid_real)0.1,
        (sysid_real)10.0, (sysid_real)0.08, (sysid_real)0.8, (sysid_real)0.08, (sysid_real)0.72
};

typedef struct {
    sysid_real threshold; /* Nm */
    sysid_real least_angle; /* rad */
    sysid_real least_speed; /* rad/s */
    sysid_real forgetting; /* per tick */
    sysid_real heaviest; /* kg */
} sysid_payload_estimator;
static inline int sysid_payload_estimator_is_finite(const sysid_payload_estimator *x)
{
    return !x || (isfinite(x->threshold) && isfinite(x->least_angle) && isfinite(x->least_speed)
        && isfinite(x->forgetting) && isfinite(x->heaviest));
}

static const sysid_payload_estimator sysid_payload_estimator_defaults = {
    (sysid_real)0.15, (sysid_real)0.318, (sysid_real)0.05, (sysid_real)0.999, (sysid_real)2.0
};

/* Inverses from flow to duty that this header holds. */
enum { SYSID_AVERAGED, SYSID_BIPOLYNOMIAL, SYSID_NETWORK };

typedef struct {
    sysid_real k1;
    sysid_real k2;
    sysid_real k3;
    sysid_real k4;
    sysid_real portion; /* the motor's share of the cylinder's effort; 0 without a motor */
    sysid_real motor_p;
    sysid_real motor_d;
    int feedforward; /* pneumatic feedforward, 1 or 0 */
    int compensation; /* the motor's feedback, 1 or 0 */
    int inverse; /* which of the inverses below gives the duties */
} sysid_backstepping;
static inline int sysid_backstepping_is_finite(const sysid_backstepping *x)
{
    return !x || (isfinite(x->k1) && isfinite(x->k2) && isfinite(x->k3) && isfinite(x->k4) &&
        isfinite(x->portion) && isfinite(x->motor_p) && isfinite(x->motor_d));
}

static const sysid_backstepping sysid_backstepping_defaults = {
    (sysid_real)60.0, (sysid_real)20.0, (sysid_real)65.0, (sysid_real)65.0, (sysid_real)0.1,
        (sysid_real)85.0, (sysid_real)14.0, 1, 1, SYSID_AVERAGED
};

typedef struct {
    int horizon; /* ticks predicted */
    int hold; /* ticks for which a decision holds */
    sysid_real period_s; /* of a tick, s */
    sysid_real natural_frequency; /* rad/s */
    sysid_real damping;
    int predicts_delays; /* inputs act after the valves' delays */
    int trapezoidal; /* positions by the mean velocity of a step */
    int filtered_velocity; /* predictions start from it, else from raw_velocity */
    int varying; /* the input changes once within the horizon */
    int coarse; /* ticks of a step after the change */
} sysid_dvmpc;
static inline int sysid_dvmpc_is_finite(const sysid_dvmpc *x)
{
    return !x || (isfinite(x->period_s) && isfinite(x->natural_frequency) &&
        isfinite(x->damping));
}

static const sysid_dvmpc sysid_dvmpc_defaults = {
    40, 5, (sysid_real)0.001, (sysid_real)50.0, (sysid_real)1.0, 0, 0, 0, 0, 4
};

/* 50 Hz, second order, at ticks of 1 ms. */
static const sysid_filter sysid_filter_defaults = {{(sysid_real)0.020083365564211232, (sysid_real)0.040166731128422464, (sysid_real)0.020083365564211232}, {(sysid_real)1.0, (sysid_real)-1.5610180758007182, (sysid_real)0.6413515380575631}, (sysid_real)0.001};

/* Mean flow into chamber A, kg/s, over a duty (0 to 1) and pressure, Pa: the averaged law. */
static inline sysid_real sysid_averaged_a_flow(sysid_real duty, sysid_real pressure_pa)
{
    if (!(isfinite(duty) && isfinite(pressure_pa))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = (duty <= (sysid_real)0.0) ? (sysid_real)0.0 : (((sysid_real)1.0 <=
        duty) ? (sysid_real)1.0 : sysid_minimum(sysid_maximum(duty + (sysid_declared_off_delay_s -
        sysid_declared_on_delay_s)/sysid_pwm_period_s, (sysid_real)0.0), (sysid_real)1.0));
    const sysid_real x1 = -pressure_pa + sysid_supply_pressure_pa;
    const sysid_real x2 = sysid_sqrt(sysid_fabs(x1));
    return sysid_known(x0*((pressure_pa <= (sysid_real)0.53*sysid_supply_pressure_pa) ?
        sysid_valve_a_choked_flow_fill_kg_s : sysid_valve_a_c_fill*((x1 < (sysid_real)0.0) ? -x2 :
        x2)) + ((sysid_real)1.0 - x0)*(((sysid_real)1.8867924528301885*sysid_atmospheric_pressure_pa
        <= pressure_pa) ? -sysid_valve_a_choked_flow_dis_kg_s : sysid_valve_a_c_dis*(-pressure_pa +
        sysid_atmospheric_pressure_pa)));
}

/* Its inverse: duty for a wanted mean flow, kg/s; 0 or 1 beyond what the valve passes. */
static inline sysid_real sysid_averaged_a_duty(sysid_real flow_kg_s, sysid_real pressure_pa)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        return 0;
    }
    const sysid_real x0 = -(((sysid_real)1.8867924528301885*sysid_atmospheric_pressure_pa <=
        pressure_pa) ? -sysid_valve_a_choked_flow_dis_kg_s : sysid_valve_a_c_dis*(-pressure_pa +
        sysid_atmospheric_pressure_pa));
    const sysid_real x1 = -pressure_pa + sysid_supply_pressure_pa;
    const sysid_real x2 = sysid_sqrt(sysid_fabs(x1));
    const sysid_real x3 = sysid_minimum(sysid_maximum((flow_kg_s + x0)/sysid_maximum(x0 +
        ((pressure_pa <= (sysid_real)0.53*sysid_supply_pressure_pa) ?
        sysid_valve_a_choked_flow_fill_kg_s : sysid_valve_a_c_fill*((x1 < (sysid_real)0.0) ? -x2 :
        x2)), (sysid_real)1e-12), (sysid_real)0.0), (sysid_real)1.0);
    const sysid_real x4 = (sysid_declared_off_delay_s -
        sysid_declared_on_delay_s)/sysid_pwm_period_s;
    const sysid_real x5 = sysid_minimum(x4, (sysid_real)0.0);
    const sysid_real x6 = sysid_maximum(x4, (sysid_real)0.0);
    return sysid_known_duty(((sysid_real)1.0 <= x3) ? (sysid_real)1.0 : sysid_minimum(sysid_maximum((x5 +
        (sysid_real)1.0 < x3) ? ((x3 < (sysid_real)0.5*x5 + (sysid_real)1.0) ? (sysid_real)0.999999
        : (sysid_real)1.0) : ((x3 < x6) ? ((x3 < (sysid_real)0.5*x6) ? (sysid_real)0.0 :
        (sysid_real)1e-06) : x3 - x4), (sysid_real)0.0), (sysid_real)1.0));
}

/* Mean flow into chamber B, kg/s, over a duty (0 to 1) and pressure, Pa: the averaged law. */
static inline sysid_real sysid_averaged_b_flow(sysid_real duty, sysid_real pressure_pa)
{
    if (!(isfinite(duty) && isfinite(pressure_pa))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = (duty <= (sysid_real)0.0) ? (sysid_real)0.0 : (((sysid_real)1.0 <=
        duty) ? (sysid_real)1.0 : sysid_minimum(sysid_maximum(duty + (sysid_declared_off_delay_s -
        sysid_declared_on_delay_s)/sysid_pwm_period_s, (sysid_real)0.0), (sysid_real)1.0));
    const sysid_real x1 = -pressure_pa + sysid_supply_pressure_pa;
    const sysid_real x2 = sysid_sqrt(sysid_fabs(x1));
    return sysid_known(x0*((pressure_pa <= (sysid_real)0.53*sysid_supply_pressure_pa) ?
        sysid_valve_b_choked_flow_fill_kg_s : sysid_valve_b_c_fill*((x1 < (sysid_real)0.0) ? -x2 :
        x2)) + ((sysid_real)1.0 - x0)*(((sysid_real)1.8867924528301885*sysid_atmospheric_pressure_pa
        <= pressure_pa) ? -sysid_valve_b_choked_flow_dis_kg_s : sysid_valve_b_c_dis*(-pressure_pa +
        sysid_atmospheric_pressure_pa)));
}

/* Its inverse: duty for a wanted mean flow, kg/s; 0 or 1 beyond what the valve passes. */
static inline sysid_real sysid_averaged_b_duty(sysid_real flow_kg_s, sysid_real pressure_pa)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        return 0;
    }
    const sysid_real x0 = -(((sysid_real)1.8867924528301885*sysid_atmospheric_pressure_pa <=
        pressure_pa) ? -sysid_valve_b_choked_flow_dis_kg_s : sysid_valve_b_c_dis*(-pressure_pa +
        sysid_atmospheric_pressure_pa));
    const sysid_real x1 = -pressure_pa + sysid_supply_pressure_pa;
    const sysid_real x2 = sysid_sqrt(sysid_fabs(x1));
    const sysid_real x3 = sysid_minimum(sysid_maximum((flow_kg_s + x0)/sysid_maximum(x0 +
        ((pressure_pa <= (sysid_real)0.53*sysid_supply_pressure_pa) ?
        sysid_valve_b_choked_flow_fill_kg_s : sysid_valve_b_c_fill*((x1 < (sysid_real)0.0) ? -x2 :
        x2)), (sysid_real)1e-12), (sysid_real)0.0), (sysid_real)1.0);
    const sysid_real x4 = (sysid_declared_off_delay_s -
        sysid_declared_on_delay_s)/sysid_pwm_period_s;
    const sysid_real x5 = sysid_minimum(x4, (sysid_real)0.0);
    const sysid_real x6 = sysid_maximum(x4, (sysid_real)0.0);
    return sysid_known_duty(((sysid_real)1.0 <= x3) ? (sysid_real)1.0 : sysid_minimum(sysid_maximum((x5 +
        (sysid_real)1.0 < x3) ? ((x3 < (sysid_real)0.5*x5 + (sysid_real)1.0) ? (sysid_real)0.999999
        : (sysid_real)1.0) : ((x3 < x6) ? ((x3 < (sysid_real)0.5*x6) ? (sysid_real)0.0 :
        (sysid_real)1e-06) : x3 - x4), (sysid_real)0.0), (sysid_real)1.0));
}

/* One Euler step of step_s (4.4.2): valves A and B open for shares of it, 0 to 1; friction by
   the wanted velocity; payload in kg m2. */
static inline void sysid_prediction_step(const sysid_motion *now, sysid_real share_a,
    sysid_real share_b, sysid_real wanted_velocity, sysid_real payload, sysid_real step_s,
    int trapezoidal, sysid_motion *next)
{
    if (!(sysid_motion_is_finite(now) && isfinite(share_a) && isfinite(share_b) &&
        isfinite(wanted_velocity) && isfinite(payload) && isfinite(step_s))) {
        next->position = next->velocity = next->pressure_a_pa = next->pressure_b_pa =
            (sysid_real)NAN;
        return;
    }
    const sysid_real x0 = (sysid_max_torque_nm <= (sysid_real)0.0) ? sysid_max_torque_nm :
        (sysid_real)0.0;
    const sysid_real x1 = -sysid_max_torque_nm;
    const sysid_real x2 = sysid_sign(wanted_velocity);
    const sysid_real x3 = -sysid_atmospheric_pressure_pa;
    const sysid_real x4 = now->pressure_a_pa + x3;
    const sysid_real x5 = now->pressure_b_pa + x3;
    const sysid_real x6 = now->pressure_a_pa + now->pressure_b_pa -
        (sysid_real)2.0*sysid_atmospheric_pressure_pa;
    const sysid_real x7 =
        step_s*(-sysid_effect_1_seal_torque_nm_per_pa*x2*(sysid_effect_1_difference_share*(-x6 +
        sysid_fabs(now->pressure_a_pa - now->pressure_b_pa)) + x6) - sysid_friction_coulomb_nm*x2 -
        sysid_friction_viscous_nm_s_per_rad*wanted_velocity +
        sysid_pitch_radius_m*(sysid_area_a_m2*x4 - sysid_area_b_m2*x5) + ((x0 <= x1) ? x1 :
        x0))/(payload + sysid_inertia_kg_m2);
    const sysid_real x8 = now->position*sysid_pitch_radius_m;
    const sysid_real x9 = (sysid_real)0.53*sysid_supply_pressure_pa;
    const sysid_real x10 = -sysid_supply_pressure_pa;
    const sysid_real x11 = -now->pressure_a_pa - x10;
    const sysid_real x12 = sysid_sqrt(sysid_fabs(x11));
    const sysid_real x13 = (sysid_real)1.8867924528301885*sysid_atmospheric_pressure_pa;
    const sysid_real x14 = now->velocity*sysid_pitch_radius_m;
    const sysid_real x15 = step_s*sysid_heat_capacity_ratio;
    const sysid_real x16 = -now->pressure_b_pa - x10;
    const sysid_real x17 = sysid_sqrt(sysid_fabs(x16));
    const sysid_real y0 = trapezoidal ? now->position + step_s*((sysid_real)1.0*now->velocity +
        (sysid_real)0.5*x7) : now->position + now->velocity*step_s;
    const sysid_real y1 = now->velocity + x7;
    const sysid_real y2 = now->pressure_a_pa + x15*(-now->pressure_a_pa*sysid_area_a_m2*x14 +
        sysid_gas_constant_j_per_kg_k*sysid_temperature_k*(share_a*((now->pressure_a_pa <= x9) ?
        sysid_valve_a_choked_flow_fill_kg_s : sysid_valve_a_c_fill*((x11 < (sysid_real)0.0) ? -x12 :
        x12)) + ((sysid_real)1.0 - share_a)*((x13 <= now->pressure_a_pa) ?
        -sysid_valve_a_choked_flow_dis_kg_s :
        -sysid_valve_a_c_dis*x4)))/(sysid_area_a_m2*(sysid_offset_a_m + x8));
    const sysid_real y3 = now->pressure_b_pa + x15*(now->pressure_b_pa*sysid_area_b_m2*x14 +
        sysid_gas_constant_j_per_kg_k*sysid_temperature_k*(share_b*((now->pressure_b_pa <= x9) ?
        sysid_valve_b_choked_flow_fill_kg_s : sysid_valve_b_c_fill*((x16 < (sysid_real)0.0) ? -x17 :
        x17)) + ((sysid_real)1.0 - share_b)*((x13 <= now->pressure_b_pa) ?
        -sysid_valve_b_choked_flow_dis_kg_s :
        -sysid_valve_b_c_dis*x5)))/(sysid_area_b_m2*(sysid_offset_b_m - x8));
    next->position = y0;
    next->velocity = y1;
    next->pressure_a_pa = y2;
    next->pressure_b_pa = y3;
    if (!sysid_motion_is_finite(next)) {
        next->position = next->velocity = next->pressure_a_pa = next->pressure_b_pa =
            (sysid_real)NAN;
    }
}

/* Share of a step of span_s in which valve A is open, since_s after its command changed from
   before, by its delays. */
static inline sysid_real sysid_delayed_share_a(sysid_real command, sysid_real before,
    sysid_real since_s, sysid_real span_s)
{
    if (!(isfinite(command) && isfinite(before) && isfinite(since_s) && isfinite(span_s))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(((before < command) ? -since_s +
        sysid_declared_on_delay_s : -since_s + sysid_declared_off_delay_s)/span_s, (sysid_real)0.0),
        (sysid_real)1.0);
    return sysid_known(before*x0 + command*((sysid_real)1.0 - x0));
}

/* Share of a step of span_s in which valve B is open, since_s after its command changed from
   before, by its delays. */
static inline sysid_real sysid_delayed_share_b(sysid_real command, sysid_real before,
    sysid_real since_s, sysid_real span_s)
{
    if (!(isfinite(command) && isfinite(before) && isfinite(since_s) && isfinite(span_s))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = sysid_minimum(sysid_maximum(((before < command) ? -since_s +
        sysid_declared_on_delay_s : -since_s + sysid_declared_off_delay_s)/span_s, (sysid_real)0.0),
        (sysid_real)1.0);
    return sysid_known(before*x0 + command*((sysid_real)1.0 - x0));
}

/* A tick's readings to an estimate: differences of the position, filtered. A reading that is
   not finite leaves the memory as it was, is counted in rejected, and makes the estimate NaN,
   at which a controller lets go. */
static inline void sysid_sense(const sysid_filter *filter, sysid_sensing *memory,
    sysid_real position, sysid_real pressure_a_pa, sysid_real pressure_b_pa,
    sysid_estimate *now)
{
    if (!(sysid_filter_is_finite(filter) && isfinite(position) && isfinite(pressure_a_pa) &&
        isfinite(pressure_b_pa))) {
        memory->rejected++;
        now->position = now->velocity = now->acceleration = now->raw_velocity =
            now->pressure_a_pa = now->pressure_b_pa = (sysid_real)NAN;
        return;
    }
    const sysid_sensing memory_before = *memory;
    const sysid_real x0 = (sysid_real)1.0/filter->period_s;
    const int x1 = ((((((isfinite(memory->position) && isfinite(memory->pressure_a_pa)) &&
        isfinite(memory->pressure_b_pa)) && isfinite(memory->difference)) &&
        isfinite(memory->velocity_filter[0])) && isfinite(memory->velocity_filter[1])) &&
        isfinite(memory->acceleration_filter[0])) && isfinite(memory->acceleration_filter[1]);
    const sysid_real x2 = position - (x1 ? memory->position : position);
    const sysid_real x3 = x0*x2;
    const sysid_real x4 = filter->b[0]*x3 + (x1 ? memory->velocity_filter[0] : (sysid_real)0.0);
    const sysid_real x5 = x0*x2 - (x1 ? memory->difference : (sysid_real)0.0);
    const sysid_real x6 = x0*x5;
    const sysid_real x7 = filter->b[0]*x6 + (x1 ? memory->acceleration_filter[0] :
        (sysid_real)0.0);
    const sysid_real y0 = position;
    const sysid_real y1 = pressure_a_pa;
    const sysid_real y2 = pressure_b_pa;
    const sysid_real y3 = x3;
    const sysid_real y4 = -filter->a[1]*x4 + filter->b[1]*x3 + (x1 ? memory->velocity_filter[1] :
        (sysid_real)0.0);
    const sysid_real y5 = -filter->a[2]*x4 + filter->b[2]*x0*x2;
    const sysid_real y6 = -filter->a[1]*x7 + filter->b[1]*x6 + (x1 ? memory->acceleration_filter[1]
        : (sysid_real)0.0);
    const sysid_real y7 = -filter->a[2]*x7 + filter->b[2]*x0*x5;
    const sysid_real y8 = position;
    const sysid_real y9 = x4;
    const sysid_real y10 = x7;
    const sysid_real y11 = x3;
    const sysid_real y12 = pressure_a_pa;
    const sysid_real y13 = pressure_b_pa;
    memory->position = y0;
    memory->pressure_a_pa = y1;
    memory->pressure_b_pa = y2;
    memory->difference = y3;
    memory->velocity_filter[0] = y4;
    memory->velocity_filter[1] = y5;
    memory->acceleration_filter[0] = y6;
    memory->acceleration_filter[1] = y7;
    now->position = y8;
    now->velocity = y9;
    now->acceleration = y10;
    now->raw_velocity = y11;
    now->pressure_a_pa = y12;
    now->pressure_b_pa = y13;
    if (!(sysid_estimate_is_finite(now) && sysid_sensing_is_finite(memory))) {
        *memory = memory_before;
        memory->rejected++;
        now->position = now->velocity = now->acceleration = now->raw_velocity =
            now->pressure_a_pa = now->pressure_b_pa = (sysid_real)NAN;
    }
}

/* The payload's inertia at its lever, kg m2, from the one before and the motor's effort now
   (4.4.18 to 4.4.24); it moves in the vertical only. */
static inline sysid_real sysid_payload_update(const sysid_payload_estimator *gains,
    sysid_real payload, sysid_real motor, const sysid_estimate *now,
    const sysid_reference *wanted)
{
    if (!(sysid_payload_estimator_is_finite(gains) && isfinite(payload) && isfinite(motor) &&
        sysid_estimate_is_finite(now) && sysid_reference_is_finite(wanted))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = (sysid_max_torque_nm <= (sysid_real)0.0) ? sysid_max_torque_nm :
        (sysid_real)0.0;
    const sysid_real x1 = -sysid_max_torque_nm;
    const sysid_real x2 = (x0 <= x1) ? x1 : x0;
    const sysid_real x3 = sysid_sign(wanted->velocity);
    const sysid_real x4 = sysid_friction_coulomb_nm*x3;
    const sysid_real x5 = sysid_friction_viscous_nm_s_per_rad*wanted->velocity;
    const sysid_real x6 = wanted->acceleration*(payload + sysid_inertia_kg_m2);
    const sysid_real x7 = -sysid_atmospheric_pressure_pa;
    const sysid_real x8 = sysid_pitch_radius_m*(sysid_area_a_m2*(now->pressure_a_pa + x7) -
        sysid_area_b_m2*(now->pressure_b_pa + x7));
    const sysid_real x9 = now->pressure_a_pa + now->pressure_b_pa -
        (sysid_real)2.0*sysid_atmospheric_pressure_pa;
    const sysid_real x10 =
        sysid_effect_1_seal_torque_nm_per_pa*x3*(sysid_effect_1_difference_share*(-x9 +
        sysid_fabs(now->pressure_a_pa - now->pressure_b_pa)) + x9);
    const sysid_real x11 = sysid_sin(now->position);
    const sysid_real x12 = (sysid_real)0.1019367991845056*((sysid_real)0.37*motor +
        (sysid_real)9.81*payload*x11 - (sysid_real)0.37*x10 + (sysid_real)0.37*x2 -
        (sysid_real)0.37*x4 - (sysid_real)0.37*x5 - (sysid_real)0.37*x6 +
        (sysid_real)0.37*x8)/(((sysid_real)0.001 < sysid_fabs(x11)) ? x11 : (sysid_real)0.001);
    return sysid_known((isfinite(-motor + x10 - x2 + x4 + x5 + x6 - x8) &&
        isfinite(gains->forgetting*payload + ((sysid_real)1.0 -
        gains->forgetting)*sysid_minimum(sysid_maximum(isfinite(x12) ? x12 : NAN, (sysid_real)0.0),
        (sysid_real)0.1369*gains->heaviest))) ? payload : NAN);
}

/* Mass, kg, of a payload of this inertia, kg m2. */
static inline sysid_real sysid_payload_mass(sysid_real payload)
{
    if (!isfinite(payload)) {
        return (sysid_real)NAN;
    }
    return sysid_known((sysid_real)7.304601899196494*payload);
}

/* 1 where an estimate is a payload, 0 where it is indistinguishable from none. */
static inline int sysid_payload_detected(const sysid_payload_estimator *gains,
    sysid_real payload)
{
    if (!(sysid_payload_estimator_is_finite(gains) && isfinite(payload))) {
        return 0;
    }
    (void)gains;
    (void)payload;
    return 0;
}

/* Duties of valves A and B, past their dead zones (4.2.1 to 4.2.3); returns 1, or 0 with both
   0 where a number is not finite. */
static inline int sysid_pva_duties(const sysid_pva *gains, const sysid_estimate *now,
    const sysid_reference *wanted, sysid_real duty[2])
{
    if (!(sysid_pva_is_finite(gains) && sysid_estimate_is_finite(now) &&
        sysid_reference_is_finite(wanted))) {
        duty[0] = duty[1] = 0;
        return 0;
    }
    const sysid_real x0 = (gains->acceleration_gain*(-now->acceleration + wanted->acceleration)
        + gains->feedforward_acceleration*wanted->acceleration +
        gains->feedforward_velocity*wanted->velocity + gains->position_gain*(-now->position +
        wanted->position) + gains->velocity_gain*(-now->velocity +
        wanted->velocity))/gains->full_scale;
    const sysid_real x1 = sysid_minimum(sysid_maximum(isfinite(x0) ? x0 : NAN,
        (sysid_real)-1.0), (sysid_real)1.0);
    const sysid_real x2 = sysid_fabs(x1);
    const sysid_real y0 = (x1 <= (sysid_real)0.0) ? (sysid_real)0.0 : gains->duty_a_min +
        x2*(gains->duty_a_max - gains->duty_a_min);
    const sysid_real y1 = ((sysid_real)0.0 <= x1) ? (sysid_real)0.0 : gains->duty_b_min +
        x2*(gains->duty_b_max - gains->duty_b_min);
    duty[0] = y0;
    duty[1] = y1;
    if (!(isfinite(duty[0]) && isfinite(duty[1]))) {
        duty[0] = duty[1] = 0;
        return 0;
    }
    return 1;
}

/* Flows into chambers A and B, kg/s (4.3.59), the motor's effort (4.3.41) and the command that
   gives it; soon is the reference one PWM period ahead, motor the effort now. */
static inline void sysid_backstepping_wanted(const sysid_backstepping *gains,
    sysid_real payload, sysid_real motor, const sysid_estimate *now,
    const sysid_reference *wanted, const sysid_reference *soon, sysid_real flow_kg_s[2],
    sysid_real *effort, sysid_real *command)
{
    if (!(sysid_backstepping_is_finite(gains) && isfinite(payload) && isfinite(motor) &&
        sysid_estimate_is_finite(now) && sysid_reference_is_finite(wanted) &&
        sysid_reference_is_finite(soon))) {
        flow_kg_s[0] = flow_kg_s[1] = (sysid_real)NAN;
        *effort = (sysid_real)NAN;
        *command = (sysid_real)NAN;
        return;
    }
    const sysid_real x0 = sysid_area_a_m2*sysid_pitch_radius_m;
    const sysid_real x1 = now->position*sysid_pitch_radius_m;
    const sysid_real x2 = (sysid_real)1.0/(sysid_area_a_m2 + sysid_area_b_m2);
    const sysid_real x3 = (sysid_real)0.5*sysid_atmospheric_pressure_pa;
    const sysid_real x4 = -(sysid_real)0.5*sysid_supply_pressure_pa;
    const sysid_real x5 = x3 + x4;
    const sysid_real x6 = -x5;
    const sysid_real x7 = x2*x6*(sysid_area_a_m2 - sysid_area_b_m2);
    const sysid_real x8 = (sysid_real)1.0/sysid_pitch_radius_m;
    const sysid_real x9 = (sysid_real)1.0/(gains->portion + (sysid_real)1.0);
    const sysid_real x10 = payload + sysid_inertia_kg_m2;
    const sysid_real x11 = -now->position + wanted->position;
    const sysid_real x12 = -now->velocity + wanted->velocity;
    const sysid_real x13 = gains->k1*x11 + x12;
    const sysid_real x14 = -now->velocity + wanted->velocity;
    const sysid_real x15 = gains->k1*x14 + wanted->acceleration;
    const sysid_real x16 = now->pressure_a_pa + now->pressure_b_pa -
        (sysid_real)2.0*sysid_atmospheric_pressure_pa;
    const sysid_real x17 = sysid_sign(wanted->velocity);
    const sysid_real x18 = sysid_effect_1_seal_torque_nm_per_pa*x17;
    const sysid_real x19 = (sysid_max_torque_nm <= (sysid_real)0.0) ? sysid_max_torque_nm :
        (sysid_real)0.0;
    const sysid_real x20 = -sysid_max_torque_nm;
    const sysid_real x21 = -((x19 <= x20) ? x20 : x19);
    const sysid_real x22 = sysid_friction_coulomb_nm*x17 +
        sysid_friction_viscous_nm_s_per_rad*wanted->velocity + x21;
    const sysid_real x23 = x10*(gains->k2*x13 - now->position + wanted->position + x15) +
        x18*(sysid_effect_1_difference_share*(-x16 + sysid_fabs(now->pressure_a_pa -
        now->pressure_b_pa)) + x16) + x22;
    const sysid_real x24 = x2*x23*x8*x9 - x7;
    const sysid_real x25 = sysid_minimum(sysid_maximum(isfinite(x24) ? x24 : NAN, x5), x6);
    const sysid_real x26 = (sysid_real)0.5*sysid_supply_pressure_pa + x3;
    const sysid_real x27 = x13/x10;
    const sysid_real x28 = sysid_friction_viscous_nm_s_per_rad*wanted->acceleration +
        x10*(gains->k1*(-now->acceleration + wanted->acceleration) + gains->k2*(-now->acceleration +
        x15) + wanted->jerk + x12);
    const sysid_real x29 = x2*x8*x9;
    const sysid_real x30 = (sysid_real)1.0/sysid_heat_capacity_ratio;
    const sysid_real x31 = sysid_area_a_m2*x30;
    const sysid_real x32 = (sysid_real)1.0/(sysid_gas_constant_j_per_kg_k*sysid_temperature_k);
    const sysid_real x33 = x32*(now->pressure_a_pa*now->velocity*x0 + x31*(sysid_offset_a_m +
        x1)*(gains->k3*(-now->pressure_a_pa + x25 + x26) + x0*x27 + x28*x29));
    const sysid_real x34 = sysid_sign(soon->velocity);
    const sysid_real x35 = sysid_effect_1_difference_share*sysid_fabs((sysid_real)0.0);
    const sysid_real x36 = x2*x8*(soon->acceleration*x10 +
        soon->velocity*sysid_friction_viscous_nm_s_per_rad +
        sysid_effect_1_seal_torque_nm_per_pa*x34*x35 + sysid_friction_coulomb_nm*x34 + x21) - x7;
    const sysid_real x37 = sysid_minimum(sysid_maximum(isfinite(x36) ? x36 : NAN, x5), x6);
    const sysid_real x38 = (sysid_real)1.0/sysid_pwm_period_s;
    const sysid_real x39 = soon->position*sysid_pitch_radius_m;
    const sysid_real x40 = x2*x8*(wanted->acceleration*x10 + x18*x35 + x22) - x7;
    const sysid_real x41 = x37 - sysid_minimum(sysid_maximum(isfinite(x40) ? x40 : NAN, x5),
        x6);
    const sysid_real x42 = x32*(soon->velocity*x0*(x26 + x37) + x31*x38*x41*(sysid_offset_a_m +
        x39)) + x33;
    const sysid_real x43 = sysid_area_b_m2*sysid_pitch_radius_m;
    const sysid_real x44 = -sysid_offset_b_m;
    const sysid_real x45 = x32*(-now->pressure_b_pa*now->velocity*x43 + sysid_area_b_m2*x30*(-x1
        - x44)*(gains->k4*(-now->pressure_b_pa - x25 + x3 - x4) - x27*x43 - x28*x29));
    const sysid_real x46 = x32*(-soon->velocity*x43*(x26 - x37) -
        sysid_area_b_m2*x30*x38*x41*(-x39 - x44)) + x45;
    const sysid_real x47 = gains->portion*x23*x9;
    const sysid_real x48 = gains->motor_d*x14 + gains->motor_p*x11 + x47;
    const sysid_real x49 = isfinite(x48) ? x48 : NAN;
    const sysid_real x50 = (sysid_max_torque_nm <= x49) ? sysid_max_torque_nm : x49;
    const sysid_real x51 = isfinite(x47) ? x47 : NAN;
    const sysid_real x52 = (sysid_max_torque_nm <= x51) ? sysid_max_torque_nm : x51;
    const sysid_real x53 = gains->compensation ? ((x50 <= x20) ? x20 : x50) : ((x52 <= x20) ?
        x20 : x52);
    (void)motor;
    const sysid_real y0 = gains->feedforward ? (isfinite(x42) ? x42 : NAN) : (isfinite(x33) ? x33 :
        NAN);
    const sysid_real y1 = gains->feedforward ? (isfinite(x46) ? x46 : NAN) : (isfinite(x45) ? x45 :
        NAN);
    const sysid_real y2 = x53;
    const sysid_real y3 = x53;
    flow_kg_s[0] = y0;
    flow_kg_s[1] = y1;
    *effort = y2;
    *command = y3;
    if (!(isfinite(flow_kg_s[0]) && isfinite(flow_kg_s[1]) && isfinite(*effort) &&
        isfinite(*command))) {
        flow_kg_s[0] = flow_kg_s[1] = (sysid_real)NAN;
        *effort = (sysid_real)NAN;
        *command = (sysid_real)NAN;
    }
}

/* The motor's effort (4.4.10): what the cylinder does not give, and feedback (4.4.17). */
static inline sysid_real sysid_inverse_dynamics(const sysid_dvmpc *gains,
    sysid_real payload, const sysid_estimate *now, const sysid_reference *wanted)
{
    if (!(sysid_dvmpc_is_finite(gains) && isfinite(payload) && sysid_estimate_is_finite(now) &&
        sysid_reference_is_finite(wanted))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = (sysid_max_torque_nm <= (sysid_real)0.0) ? sysid_max_torque_nm :
        (sysid_real)0.0;
    const sysid_real x1 = -sysid_max_torque_nm;
    const sysid_real x2 = sysid_sign(wanted->velocity);
    const sysid_real x3 = payload + sysid_inertia_kg_m2;
    const sysid_real x4 = -sysid_atmospheric_pressure_pa;
    const sysid_real x5 = now->pressure_a_pa + now->pressure_b_pa -
        (sysid_real)2.0*sysid_atmospheric_pressure_pa;
    const sysid_real x6 =
        (sysid_real)2.0*gains->damping*gains->natural_frequency*x3*(-now->velocity +
        wanted->velocity) + sysid_square(gains->natural_frequency)*x3*(-now->position +
        wanted->position) +
        sysid_effect_1_seal_torque_nm_per_pa*x2*(sysid_effect_1_difference_share*(-x5 +
        sysid_fabs(now->pressure_a_pa - now->pressure_b_pa)) + x5) + sysid_friction_coulomb_nm*x2 +
        sysid_friction_viscous_nm_s_per_rad*wanted->velocity -
        sysid_pitch_radius_m*(sysid_area_a_m2*(now->pressure_a_pa + x4) -
        sysid_area_b_m2*(now->pressure_b_pa + x4)) + wanted->acceleration*x3 - ((x0 <= x1) ? x1 :
        x0);
    const sysid_real x7 = isfinite(x6) ? x6 : NAN;
    const sysid_real x8 = (sysid_max_torque_nm <= x7) ? sysid_max_torque_nm : x7;
    return sysid_known((x8 <= x1) ? x1 : x8);
}

/* Memory at rest at the first readings; if one is not finite, at the first that are. */
static inline sysid_sensing sysid_sensing_start(sysid_real position, sysid_real pressure_a_pa,
                                          sysid_real pressure_b_pa)
{
    sysid_sensing memory;
    memory.position = position;
    memory.pressure_a_pa = pressure_a_pa;
    memory.pressure_b_pa = pressure_b_pa;
    memory.difference = 0;
    memory.velocity_filter[0] = memory.velocity_filter[1] = 0;
    memory.acceleration_filter[0] = memory.acceleration_filter[1] = 0;
    memory.rejected = 0;
    return memory;
}

static inline sysid_pva_state sysid_pva_start(void)
{
    sysid_pva_state state = {0};
    return state;
}

static inline sysid_backstepping_state sysid_backstepping_start(void)
{
    sysid_backstepping_state state = {sysid_payload_inertia_kg_m2, 0, 0};
    return state;
}

static inline sysid_dvmpc_state sysid_dvmpc_start(void)
{
    sysid_dvmpc_state state = {sysid_payload_inertia_kg_m2, 0, 0, 0, 0, 0};
    return state;
}

/* Types 1 to 4 (Table 5.4.3): without compensation, with the motor's, pneumatic, both. */
static inline sysid_backstepping sysid_backstepping_type(int number)
{
    sysid_backstepping gains = sysid_backstepping_defaults;
    gains.feedforward = number == 3 || number == 4;
    gains.compensation = number == 2 || number == 4;
    return gains;
}

/* Duty of valve A for a wanted mean flow, kg/s. */
static inline sysid_real sysid_duty_a(int inverse, sysid_real flow_kg_s, sysid_real pressure_pa)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        return 0;
    }
    if (inverse == SYSID_BIPOLYNOMIAL) {
        return sysid_known_duty(flow_kg_s >= 0 ? sysid_pwm_a_fill_duty(flow_kg_s, pressure_pa, 0)
                              : sysid_pwm_a_discharge_duty(flow_kg_s, pressure_pa, 0));
    }
    if (inverse == SYSID_NETWORK) {
        return sysid_known_duty(flow_kg_s >= 0 ? sysid_pwm_a_fill_network_duty(flow_kg_s, pressure_pa, 0)
                              : sysid_pwm_a_discharge_network_duty(flow_kg_s, pressure_pa, 0));
    }
    return sysid_known_duty(sysid_averaged_a_duty(flow_kg_s, pressure_pa));
}


/* Duty of valve B for a wanted mean flow, kg/s. */
static inline sysid_real sysid_duty_b(int inverse, sysid_real flow_kg_s, sysid_real pressure_pa)
{
    if (!(isfinite(flow_kg_s) && isfinite(pressure_pa))) {
        return 0;
    }
    if (inverse == SYSID_BIPOLYNOMIAL) {
        return sysid_known_duty(flow_kg_s >= 0 ? sysid_pwm_b_fill_duty(flow_kg_s, pressure_pa, 0)
                              : sysid_pwm_b_discharge_duty(flow_kg_s, pressure_pa, 0));
    }
    if (inverse == SYSID_NETWORK) {
        return sysid_known_duty(flow_kg_s >= 0 ? sysid_pwm_b_fill_network_duty(flow_kg_s, pressure_pa, 0)
                              : sysid_pwm_b_discharge_network_duty(flow_kg_s, pressure_pa, 0));
    }
    return sysid_known_duty(sysid_averaged_b_duty(flow_kg_s, pressure_pa));
}

/* Controllers. Each returns 1; where a number is not finite it lets go (motor 0, valves off, its
   state as it was but for rejected) and returns 0. */

/* PVA with feedforward and dead-zone compensation (4.2); at the start of a PWM period. It remembers
   nothing: pva_control_counted() is the same with a count of the ticks that were not finite. */
static inline int sysid_pva_control(const sysid_pva *gains, const sysid_estimate *now,
                                 const sysid_reference *wanted, sysid_commands *out)
{
    if (!(sysid_pva_is_finite(gains) && sysid_estimate_is_finite(now) &&
        sysid_reference_is_finite(wanted))) {
        return sysid_let_go(out);
    }
    sysid_real duty[2];
    if (!sysid_pva_duties(gains, now, wanted, duty)) {
        return sysid_let_go(out);
    }
    out->motor = 0;
    out->valve_a = duty[0];
    out->valve_b = duty[1];
    out->payload_kg = (sysid_real)NAN;
    if (!sysid_commands_is_finite(out)) {
        return sysid_let_go(out);
    }
    return 1;
}

static inline int sysid_pva_control_counted(const sysid_pva *gains, sysid_pva_state *state,
                                         const sysid_estimate *now, const sysid_reference *wanted,
                                         sysid_commands *out)
{
    if (!(sysid_pva_is_finite(gains) && sysid_estimate_is_finite(now) &&
        sysid_reference_is_finite(wanted))) {
        state->rejected++;
        return sysid_let_go(out);
    }
    const sysid_pva_state state_before = *state;
    if (!sysid_pva_control(gains, now, wanted, out)) {
        *state = state_before;
        state->rejected++;
        return sysid_let_go(out);
    }
    if (!sysid_commands_is_finite(out)) {
        *state = state_before;
        state->rejected++;
        return sysid_let_go(out);
    }
    return 1;
}

/* Backstepping (4.3). estimator: of the payload, or NULL for none; soon: the reference one PWM
   period ahead. The duties count at the start of a PWM period. */
static inline int sysid_backstepping_control(const sysid_backstepping *gains,
                                          const sysid_payload_estimator *estimator,
                                          sysid_backstepping_state *state, const sysid_estimate *now,
                                          const sysid_reference *wanted, const sysid_reference *soon,
                                          sysid_commands *out)
{
    if (!(sysid_backstepping_is_finite(gains) && sysid_payload_estimator_is_finite(estimator) &&
        sysid_backstepping_state_is_finite(state) && sysid_estimate_is_finite(now) &&
        sysid_reference_is_finite(wanted) && sysid_reference_is_finite(soon))) {
        state->rejected++;
        return sysid_let_go(out);
    }
    const sysid_backstepping_state state_before = *state;
    sysid_real flow[2], effort, command;
    if (estimator) {
        state->payload = sysid_payload_update(estimator, state->payload, state->motor, now, wanted);
    }
    sysid_backstepping_wanted(gains, state->payload, state->motor, now, wanted, soon, flow, &effort,
                           &command);
    state->motor = effort;
    out->motor = command;
    out->valve_a = sysid_duty_a(gains->inverse, flow[0], now->pressure_a_pa);
    out->valve_b = sysid_duty_b(gains->inverse, flow[1], now->pressure_b_pa);
    out->payload_kg = sysid_payload_mass(state->payload);
    if (!(sysid_commands_is_finite(out) && sysid_backstepping_state_is_finite(state))) {
        *state = state_before;
        state->rejected++;
        return sysid_let_go(out);
    }
    return 1;
}

/* The motion and the sum of squared errors after a stretch of the horizon with one input:
   steps of ticks each, the first at the tick first; before: the inputs that the delays end; path:
   the reference from now on. */
static inline void sysid_dvmpc_roll(const sysid_dvmpc *gains, sysid_real payload, int steps, int ticks,
                                 int first, const sysid_real input[2], const sysid_real before[2],
                                 const sysid_reference *path, sysid_motion *motion, sysid_real *cost)
{
    if (!(sysid_dvmpc_is_finite(gains) && isfinite(payload) && isfinite(input[0]) &&
        isfinite(input[1]) && isfinite(before[0]) && isfinite(before[1]) &&
        sysid_reference_is_finite(path) && sysid_motion_is_finite(motion))) {
        motion->position = motion->velocity = motion->pressure_a_pa = motion->pressure_b_pa =
            (sysid_real)NAN;
        *cost = (sysid_real)NAN;
        return;
    }
    const sysid_real span = (sysid_real)ticks * gains->period_s;
    int i;
    for (i = 0; i < steps; i++) {
        const int tick = first + i * ticks;
        const sysid_real since = (sysid_real)(i * ticks) * gains->period_s;
        sysid_real a = input[0], b = input[1], error;
        sysid_motion next;
        if (gains->predicts_delays) {
            a = sysid_delayed_share_a(a, before[0], since, span);
            b = sysid_delayed_share_b(b, before[1], since, span);
        }
        sysid_prediction_step(motion, a, b, path[tick].velocity, payload, span, gains->trapezoidal,
                           &next);
        *motion = next;
        error = path[tick + ticks].position - next.position;
        *cost += (sysid_real)ticks * error * error;
    }
    if (!(sysid_motion_is_finite(motion) && isfinite(*cost))) {
        motion->position = motion->velocity = motion->pressure_a_pa = motion->pressure_b_pa =
            (sysid_real)NAN;
        *cost = (sysid_real)NAN;
    }
}

/* Sum of squared errors (4.4.1) of every sequence of inputs: 4 in the order of Table 4.4.1 (off
   and off, A on, B on, on and on); with varying 16, four times the first input plus the second.
   ahead: the reference from now on, horizon + 1 ticks. Returns how many there are. */
static inline int sysid_dvmpc_costs(const sysid_dvmpc *gains, const sysid_dvmpc_state *state,
                                 const sysid_estimate *now, const sysid_reference *ahead,
                                 sysid_real costs[16])
{
    if (!(sysid_dvmpc_is_finite(gains) && sysid_dvmpc_state_is_finite(state) &&
        sysid_estimate_is_finite(now) && sysid_references_are_finite(ahead, gains->horizon))) {
        costs[0] = costs[1] = costs[2] = costs[3] = costs[4] = costs[5] = costs[6] = costs[7] =
            costs[8] = costs[9] = costs[10] = costs[11] = costs[12] = costs[13] = costs[14] =
            costs[15] = (sysid_real)NAN;
        return 0;
    }
    const int coarse = gains->coarse < 1 ? 1 : gains->coarse;
    const int whole = gains->varying ? gains->hold : gains->horizon;
    const sysid_real held[2] = {state->valve_a, state->valve_b};
    int first, second;
    for (first = 0; first < 4; first++) {
        const sysid_real input[2] = {(sysid_real)(first & 1), (sysid_real)(first >> 1)};
        sysid_motion motion;
        sysid_real cost = 0;
        motion.position = now->position;
        motion.velocity = gains->filtered_velocity ? now->velocity : now->raw_velocity;
        motion.pressure_a_pa = now->pressure_a_pa;
        motion.pressure_b_pa = now->pressure_b_pa;
        sysid_dvmpc_roll(gains, state->payload, whole, 1, 0, input, held, ahead, &motion, &cost);
        if (!gains->varying) {
            costs[first] = cost;
            continue;
        }
        for (second = 0; second < 4; second++) {
            const sysid_real then[2] = {(sysid_real)(second & 1), (sysid_real)(second >> 1)};
            sysid_motion later = motion;
            sysid_real sum = cost;
            sysid_dvmpc_roll(gains, state->payload, (gains->horizon - gains->hold) / coarse, coarse,
                          gains->hold, then, input, ahead, &later, &sum);
            costs[4 * first + second] = sum;
        }
    }
    return gains->varying ? 16 : 4;
}

/* The inputs of least cost, into the state; a cost that overflowed is none. Returns 1; 0 where
   there is none. */
static inline int sysid_dvmpc_decide(const sysid_dvmpc *gains, sysid_dvmpc_state *state,
                                  const sysid_estimate *now, const sysid_reference *ahead)
{
    if (!(sysid_dvmpc_is_finite(gains) && sysid_dvmpc_state_is_finite(state) &&
        sysid_estimate_is_finite(now) && sysid_references_are_finite(ahead, gains->horizon))) {
        state->rejected++;
        return 0;
    }
    const sysid_dvmpc_state state_before = *state;
    sysid_real costs[16];
    const int count = sysid_dvmpc_costs(gains, state, now, ahead, costs);
    int k, best = -1;
    for (k = 0; k < count; k++) {
        if (isfinite(costs[k]) && (best < 0 || costs[k] < costs[best])) {
            best = k;
        }
    }
    if (best < 0) {
        *state = state_before;
        state->rejected++;
        return 0;
    }
    best = gains->varying ? best / 4 : best;
    state->valve_a = (sysid_real)(best & 1);
    state->valve_b = (sysid_real)(best >> 1);
    if (!sysid_dvmpc_state_is_finite(state)) {
        *state = state_before;
        state->rejected++;
        return 0;
    }
    return 1;
}

/* DVMPC with inverse dynamics of the motor (4.4), each tick; it decides every hold ticks.
   estimator: of the payload, or NULL; ahead: the reference from now on, horizon + 1 ticks. */
static inline int sysid_dvmpc_control(const sysid_dvmpc *gains, const sysid_payload_estimator *estimator,
                                   sysid_dvmpc_state *state, const sysid_estimate *now,
                                   const sysid_reference *ahead, sysid_commands *out)
{
    if (!(sysid_dvmpc_is_finite(gains) && sysid_payload_estimator_is_finite(estimator) &&
        sysid_dvmpc_state_is_finite(state) && sysid_estimate_is_finite(now) &&
        sysid_references_are_finite(ahead, gains->horizon))) {
        state->rejected++;
        return sysid_let_go(out);
    }
    const sysid_dvmpc_state state_before = *state;
    if (estimator) {
        state->payload = sysid_payload_update(estimator, state->payload, state->motor, now, ahead);
    }
    if (state->tick == 0 && !sysid_dvmpc_decide(gains, state, now, ahead)) {
        *state = state_before;
        state->rejected++;
        return sysid_let_go(out);
    }
    state->tick = state->tick + 1 < gains->hold ? state->tick + 1 : 0;
    state->motor = sysid_inverse_dynamics(gains, state->payload, now, ahead);
    out->motor = state->motor;
    out->valve_a = state->valve_a;
    out->valve_b = state->valve_b;
    out->payload_kg = sysid_payload_mass(state->payload);
    if (!(sysid_commands_is_finite(out) && sysid_dvmpc_state_is_finite(state))) {
        *state = state_before;
        state->rejected++;
        return sysid_let_go(out);
    }
    return 1;
}

/* dP/dt of chamber A, Pa/s; other_pa is the other chamber's pressure, the valves are open, 1,
   or shut, 0. */
static inline sysid_real sysid_monitor_rate_a(sysid_real position, sysid_real velocity,
    sysid_real pressure_pa, sysid_real other_pa, sysid_real is_open, sysid_real other_open,
    sysid_real supply_pa)
{
    if (!(isfinite(position) && isfinite(velocity) && isfinite(pressure_pa) &&
        isfinite(other_pa) && isfinite(is_open) && isfinite(other_open) && isfinite(supply_pa))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = -pressure_pa + supply_pa;
    const sysid_real x1 = sysid_sqrt(sysid_fabs(x0));
    (void)other_pa;
    (void)other_open;
    return sysid_known(sysid_heat_capacity_ratio*(-pressure_pa*sysid_area_a_m2*sysid_pitch_radius_m*velocity
        + sysid_gas_constant_j_per_kg_k*sysid_temperature_k*(is_open*((pressure_pa <=
        (sysid_real)0.53*supply_pa) ?
        supply_pa*sysid_valve_a_choked_flow_fill_kg_s/sysid_supply_pressure_pa :
        sysid_valve_a_c_fill*((x0 < (sysid_real)0.0) ? -x1 : x1)) + ((sysid_real)1.0 -
        is_open)*(((sysid_real)1.8867924528301885*sysid_atmospheric_pressure_pa <= pressure_pa) ?
        -sysid_valve_a_choked_flow_dis_kg_s : sysid_valve_a_c_dis*(-pressure_pa +
        sysid_atmospheric_pressure_pa))))/(sysid_area_a_m2*(position*sysid_pitch_radius_m +
        sysid_offset_a_m)));
}

/* The same without any flow. */
static inline sysid_real sysid_monitor_swept_a(sysid_real position, sysid_real velocity,
    sysid_real pressure_pa, sysid_real other_pa)
{
    if (!(isfinite(position) && isfinite(velocity) && isfinite(pressure_pa) &&
        isfinite(other_pa))) {
        return (sysid_real)NAN;
    }
    (void)other_pa;
    return
        -pressure_pa*sysid_heat_capacity_ratio*sysid_pitch_radius_m*velocity/(position*sysid_pitch_radius_m
        + sysid_offset_a_m);
}

/* k R T / V of chamber A, Pa/kg. */
static inline sysid_real sysid_monitor_per_flow_a(sysid_real position)
{
    if (!isfinite(position)) {
        return (sysid_real)NAN;
    }
    return
        sysid_gas_constant_j_per_kg_k*sysid_heat_capacity_ratio*sysid_temperature_k/(sysid_area_a_m2*(position*sysid_pitch_radius_m
        + sysid_offset_a_m));
}

/* dP/dt of chamber B, Pa/s; other_pa is the other chamber's pressure, the valves are open, 1,
   or shut, 0. */
static inline sysid_real sysid_monitor_rate_b(sysid_real position, sysid_real velocity,
    sysid_real pressure_pa, sysid_real other_pa, sysid_real is_open, sysid_real other_open,
    sysid_real supply_pa)
{
    if (!(isfinite(position) && isfinite(velocity) && isfinite(pressure_pa) &&
        isfinite(other_pa) && isfinite(is_open) && isfinite(other_open) && isfinite(supply_pa))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = -pressure_pa + supply_pa;
    const sysid_real x1 = sysid_sqrt(sysid_fabs(x0));
    (void)other_pa;
    (void)other_open;
    return sysid_known(sysid_heat_capacity_ratio*(pressure_pa*sysid_area_b_m2*sysid_pitch_radius_m*velocity
        + sysid_gas_constant_j_per_kg_k*sysid_temperature_k*(is_open*((pressure_pa <=
        (sysid_real)0.53*supply_pa) ?
        supply_pa*sysid_valve_b_choked_flow_fill_kg_s/sysid_supply_pressure_pa :
        sysid_valve_b_c_fill*((x0 < (sysid_real)0.0) ? -x1 : x1)) + ((sysid_real)1.0 -
        is_open)*(((sysid_real)1.8867924528301885*sysid_atmospheric_pressure_pa <= pressure_pa) ?
        -sysid_valve_b_choked_flow_dis_kg_s : sysid_valve_b_c_dis*(-pressure_pa +
        sysid_atmospheric_pressure_pa))))/(sysid_area_b_m2*(-position*sysid_pitch_radius_m +
        sysid_offset_b_m)));
}

/* The same without any flow. */
static inline sysid_real sysid_monitor_swept_b(sysid_real position, sysid_real velocity,
    sysid_real pressure_pa, sysid_real other_pa)
{
    if (!(isfinite(position) && isfinite(velocity) && isfinite(pressure_pa) &&
        isfinite(other_pa))) {
        return (sysid_real)NAN;
    }
    (void)other_pa;
    return
        pressure_pa*sysid_heat_capacity_ratio*sysid_pitch_radius_m*velocity/(-position*sysid_pitch_radius_m
        + sysid_offset_b_m);
}

/* k R T / V of chamber B, Pa/kg. */
static inline sysid_real sysid_monitor_per_flow_b(sysid_real position)
{
    if (!isfinite(position)) {
        return (sysid_real)NAN;
    }
    return
        sysid_gas_constant_j_per_kg_k*sysid_heat_capacity_ratio*sysid_temperature_k/(sysid_area_b_m2*(-position*sysid_pitch_radius_m
        + sysid_offset_b_m));
}

/* All efforts less friction while the shaft moves as the velocity says, Nm or N. */
static inline sysid_real sysid_monitor_effort(sysid_real position, sysid_real velocity,
    sysid_real pressure_a_pa, sysid_real pressure_b_pa, sysid_real motor)
{
    if (!(isfinite(position) && isfinite(velocity) && isfinite(pressure_a_pa) &&
        isfinite(pressure_b_pa) && isfinite(motor))) {
        return (sysid_real)NAN;
    }
    const sysid_real x0 = (sysid_max_torque_nm <= motor) ? sysid_max_torque_nm : motor;
    const sysid_real x1 = -sysid_max_torque_nm;
    const sysid_real x2 = sysid_sign(velocity);
    const sysid_real x3 = -sysid_atmospheric_pressure_pa;
    const sysid_real x4 = pressure_a_pa + pressure_b_pa -
        (sysid_real)2.0*sysid_atmospheric_pressure_pa;
    (void)position;
    return sysid_known(-sysid_effect_1_seal_torque_nm_per_pa*x2*(sysid_effect_1_difference_share*(-x4 +
        sysid_fabs(pressure_a_pa - pressure_b_pa)) + x4) - sysid_friction_coulomb_nm*x2 -
        sysid_friction_viscous_nm_s_per_rad*velocity +
        sysid_pitch_radius_m*(sysid_area_a_m2*(pressure_a_pa + x3) - sysid_area_b_m2*(pressure_b_pa
        + x3)) + ((x0 <= x1) ? x1 : x0));
}

/* --- monitor ---------------------------------------------------------------------------

   What left its bundle: friction, leakage, delay or supply.
   False alarms: one in 1,000,000 healthy cycles at most (278 h of cycles of 1 s),
   as long as friction scatters, and the sensors are as noisy, as the bundle says.
   A kind is named where it is 20 times as likely as any other, else it is undecided.
   Smallest detectable changes, found in half of the cases, on cycles of 0.68 s
   in which both valves are switched at 30 % of the stroke from the middle (for another
   motion: sysid monitor BUNDLE LOG); of twice the size they are practically always found:
     Coulomb friction: 0.056 Nm within 1 cycle, 0.013 Nm within 10 cycles
     viscous friction: 0.019 Nm s/rad within 1 cycle, 0.0042 Nm s/rad within 10 cycles
     leak past the piston, at supply pressure: 0.53 mg/s within 1 cycle, 0.39 mg/s within 10 cycles
     leak of chamber A, at supply pressure: 0.89 mg/s within 1 cycle, 0.48 mg/s within 10 cycles
     leak of chamber B, at supply pressure: 1 mg/s within 1 cycle, 0.56 mg/s within 10 cycles
     on-delay of valve A: 0.13 ms within 1 cycle, 0.13 ms within 10 cycles
     off-delay of valve A: 0.48 ms within 1 cycle, 0.22 ms within 10 cycles
     on-delay of valve B: 0.15 ms within 1 cycle, 0.14 ms within 10 cycles
     off-delay of valve B: 0.14 ms within 1 cycle, 0.13 ms within 10 cycles
     supply pressure: 0.86 kPa within 1 cycle, 0.86 kPa within 10 cycles
   Use: one struct a machine, monitor_start() once, then each 0.001 s one call of
   monitor_update() with the readings and the commands that hold from now on. It returns the alarm:
   MONITOR_HEALTHY, or a kind of drift; a verdict changes when a cycle ends, a stroke there and back
   of at least 10 % of the travel each way. An alarm is undecided in the cycle that raises it;
   the cycles after it name the kind. z[] are the drifts' statistics in standard deviations, change[]
   their sizes in SI; drift is the place of the most likely one. A reading or a command that is not
   finite is left out and counted in rejected: it raises no alarm. A call that ends a cycle takes
   about 92,000 operations, any other about a twentieth of that; nothing is allocated.

   The observers are Kalman filters of each chamber's pressure and of the shaft, with their slopes
   over what may drift; a cycle's innovations give normal equations of the drifts, which are tested
   alone, but for friction's, and summed over the cycles with forgetting. The first 10 cycles
   teach it what friction is like, and what the observers make of this motion
   (sysid/controllers/monitor). */

enum {
    SYSID_MONITOR_DRIFT_COULOMB, /* Coulomb friction */
    SYSID_MONITOR_DRIFT_VISCOUS, /* viscous friction */
    SYSID_MONITOR_DRIFT_OFFSET, /* effort of a load */
    SYSID_MONITOR_DRIFT_INERTIA, /* inertia, relative */
    SYSID_MONITOR_DRIFT_PISTON_LEAK, /* leak past the piston, at supply pressure */
    SYSID_MONITOR_DRIFT_LEAK_A, /* leak of chamber A, at supply pressure */
    SYSID_MONITOR_DRIFT_LEAK_B, /* leak of chamber B, at supply pressure */
    SYSID_MONITOR_DRIFT_ON_DELAY_A, /* on-delay of valve A */
    SYSID_MONITOR_DRIFT_OFF_DELAY_A, /* off-delay of valve A */
    SYSID_MONITOR_DRIFT_ON_DELAY_B, /* on-delay of valve B */
    SYSID_MONITOR_DRIFT_OFF_DELAY_B, /* off-delay of valve B */
    SYSID_MONITOR_DRIFT_SUPPLY, /* supply pressure */
    SYSID_MONITOR_DRIFT_CHOKED_FILL_A, /* choked filling flow of valve A, relative */
    SYSID_MONITOR_DRIFT_C_FILL_A, /* unchoked filling flow of valve A, relative */
    SYSID_MONITOR_DRIFT_CHOKED_DIS_A, /* choked exhaust flow of valve A, relative */
    SYSID_MONITOR_DRIFT_C_DIS_A, /* unchoked exhaust flow of valve A, relative */
    SYSID_MONITOR_DRIFT_CHOKED_FILL_B, /* choked filling flow of valve B, relative */
    SYSID_MONITOR_DRIFT_C_FILL_B, /* unchoked filling flow of valve B, relative */
    SYSID_MONITOR_DRIFT_CHOKED_DIS_B, /* choked exhaust flow of valve B, relative */
    SYSID_MONITOR_DRIFT_C_DIS_B, /* unchoked exhaust flow of valve B, relative */
    SYSID_MONITOR_DRIFTS
};
enum {
    SYSID_MONITOR_HEALTHY,
    SYSID_MONITOR_FRICTION, SYSID_MONITOR_LEAKAGE, SYSID_MONITOR_DELAY, SYSID_MONITOR_SUPPLY,
    SYSID_MONITOR_UNDECIDED
};

#define SYSID_MONITOR_PERIOD_S (sysid_real)0.001
#define SYSID_MONITOR_NEVER (sysid_real)1e+30
/* On-intervals of a valve that may still act. */
#define SYSID_MONITOR_KEPT 8
/* Slopes of a chamber's pressure and of the shaft; causes that scatter from cycle to cycle. */
#define SYSID_MONITOR_CHAMBER 9
#define SYSID_MONITOR_SHAFT 4
#define SYSID_MONITOR_SCATTER 4
/* Cycles that the monitor learns from at first. */
#define SYSID_MONITOR_LEARNING 10

static const sysid_real sysid_monitor_pressure_noise = (sysid_real)157.0; /* Pa */
static const sysid_real sysid_monitor_position_noise = (sysid_real)2.2672492052927723e-05; /* rad */
static const sysid_real sysid_monitor_supply = (sysid_real)312000.0; /* Pa */
static const sysid_real sysid_monitor_atmosphere = (sysid_real)100200.0; /* Pa */
static const sysid_real sysid_monitor_pwm_period = (sysid_real)0.005; /* s */
static const sysid_real sysid_monitor_on_delay[2] = {
    (sysid_real)0.00151, (sysid_real)0.00151
};
static const sysid_real sysid_monitor_off_delay[2] = {
    (sysid_real)0.00195, (sysid_real)0.00195
};
static const sysid_real sysid_monitor_sweep[2] = {
    (sysid_real)6.099795463786066e-15, (sysid_real)5.887254613753105e-15
};
static const sysid_real sysid_monitor_choked[2][2] = {
    {(sysid_real)165360.0, (sysid_real)189056.60377358488}, {(sysid_real)165360.0,
        (sysid_real)189056.60377358488}
};
static const sysid_real sysid_monitor_inertia = (sysid_real)0.019623; /* kg m2 */
static const sysid_real sysid_monitor_viscous = (sysid_real)0.05487893374853895; /* Nm s/rad */
static const sysid_real sysid_monitor_breakaway = (sysid_real)0.2865731068780974; /* Nm */
static const sysid_real sysid_monitor_acceleration_variance = (sysid_real)0.016409773155600264;
static const sysid_real sysid_monitor_travel = (sysid_real)1.5269737191398989; /* rad */
static const sysid_real sysid_monitor_speed = (sysid_real)34.167476949145836; /* rad/s */
static const sysid_real sysid_monitor_least_stroke = (sysid_real)0.31162728962038755; /* rad */
static const sysid_real sysid_monitor_scales[20] = {
    (sysid_real)0.02865731068780974, (sysid_real)0.005487893374853895,
        (sysid_real)0.02865731068780974, (sysid_real)0.01, (sysid_real)1.1400631573679697e-16,
        (sysid_real)1.1400631573679697e-16, (sysid_real)1.1400631573679697e-16, (sysid_real)0.0001,
        (sysid_real)0.0001, (sysid_real)0.0001, (sysid_real)0.0001, (sysid_real)3120.0,
        (sysid_real)0.01, (sysid_real)0.01, (sysid_real)0.01, (sysid_real)0.01, (sysid_real)0.01,
        (sysid_real)0.01, (sysid_real)0.01, (sysid_real)0.01
};
static const sysid_real sysid_monitor_chamber_scales[2][9] = {
    {(sysid_real)1.1400631573679697e-16, (sysid_real)1.1400631573679697e-16, (sysid_real)0.0001,
        (sysid_real)0.0001, (sysid_real)3120.0, (sysid_real)0.01, (sysid_real)0.01,
        (sysid_real)0.01, (sysid_real)0.01}, {(sysid_real)1.1400631573679697e-16,
        (sysid_real)1.1400631573679697e-16, (sysid_real)0.0001, (sysid_real)0.0001,
        (sysid_real)3120.0, (sysid_real)0.01, (sysid_real)0.01, (sysid_real)0.01, (sysid_real)0.01}
};
static const sysid_real sysid_monitor_shaft_scales[4] = {
    (sysid_real)0.02865731068780974, (sysid_real)0.005487893374853895,
        (sysid_real)0.02865731068780974, (sysid_real)0.01
};
static const sysid_real sysid_monitor_scatter[20][4] = {
    {(sysid_real)0.11904241790857459, (sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0},
        {(sysid_real)0.0, (sysid_real)0.2, (sysid_real)0.0, (sysid_real)0.0}, {(sysid_real)0.0,
        (sysid_real)0.0, (sysid_real)10.0, (sysid_real)0.0}, {(sysid_real)0.0, (sysid_real)0.0,
        (sysid_real)0.0, (sysid_real)100.0}, {(sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0,
        (sysid_real)0.0}, {(sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0},
        {(sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0}, {(sysid_real)0.0,
        (sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0}, {(sysid_real)0.0, (sysid_real)0.0,
        (sysid_real)0.0, (sysid_real)0.0}, {(sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0,
        (sysid_real)0.0}, {(sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0},
        {(sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0}, {(sysid_real)0.0,
        (sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0}, {(sysid_real)0.0, (sysid_real)0.0,
        (sysid_real)0.0, (sysid_real)0.0}, {(sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0,
        (sysid_real)0.0}, {(sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0},
        {(sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0}, {(sysid_real)0.0,
        (sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0}, {(sysid_real)0.0, (sysid_real)0.0,
        (sysid_real)0.0, (sysid_real)0.0}, {(sysid_real)0.0, (sysid_real)0.0, (sysid_real)0.0,
        (sysid_real)0.0}
};
/* Variances of the bundle's errors, and the covariance of friction's first two. */
static const sysid_real sysid_monitor_errors[20] = {
    (sysid_real)0.0036134842459124472, (sysid_real)0.011655009164955073, (sysid_real)0.0,
        (sysid_real)0.0, (sysid_real)3.1803057251873707e-05, (sysid_real)2.7562009446681967e-05,
        (sysid_real)3.1803057251873707e-05, (sysid_real)0.046411224864514926,
        (sysid_real)0.05408649850695824, (sysid_real)0.04701112426918582,
        (sysid_real)0.045832053095043575, (sysid_real)0.0025321540105193953,
        (sysid_real)0.0004350168926466429, (sysid_real)0.00013580006893223925,
        (sysid_real)0.0002287321583680774, (sysid_real)0.00015897286579654238,
        (sysid_real)0.0003860493812721061, (sysid_real)0.00010691896796393924,
        (sysid_real)0.00017729716363083214, (sysid_real)0.00011335233345071049
};
/* The same while the monitor learns. */
static const sysid_real sysid_monitor_first_errors[20] = {
    (sysid_real)35.431356638045216, (sysid_real)100.01165500916495, (sysid_real)0.0,
        (sysid_real)0.0, (sysid_real)3.1803057251873707e-05, (sysid_real)2.7562009446681967e-05,
        (sysid_real)3.1803057251873707e-05, (sysid_real)0.046411224864514926,
        (sysid_real)0.05408649850695824, (sysid_real)0.04701112426918582,
        (sysid_real)0.045832053095043575, (sysid_real)0.0025321540105193953,
        (sysid_real)0.0004350168926466429, (sysid_real)0.00013580006893223925,
        (sysid_real)0.0002287321583680774, (sysid_real)0.00015897286579654238,
        (sysid_real)0.0003860493812721061, (sysid_real)0.00010691896796393924,
        (sysid_real)0.00017729716363083214, (sysid_real)0.00011335233345071049
};
static const sysid_real sysid_monitor_shared_error = (sysid_real)0.0;
static const sysid_real sysid_monitor_threshold = (sysid_real)5.42234100323058; /* standard deviations */
static const sysid_real sysid_monitor_log_odds = (sysid_real)2.995732273553991;
static const sysid_real sysid_monitor_forgetting = (sysid_real)0.8;
static const sysid_real sysid_monitor_excited = sizeof(sysid_real) == sizeof(float) ? (sysid_real)1e-05 : (sysid_real)1e-09;
static const int sysid_monitor_kind[20] = {
    1, 1, 0, 0, 2, 2, 2, 3, 3, 3, 3, 4, 0, 0, 0, 0, 0, 0, 0, 0
};
static const int sysid_monitor_grows[20] = {
    0, 0, 0, 0, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0
};
static const int sysid_monitor_chamber_places[2][9] = {{4, 5, 7, 8, 11, 12, 13, 14, 15}, {4, 6, 9, 10, 11, 16, 17, 18, 19}};
static const int sysid_monitor_shaft_places[4] = {
    0, 1, 2, 3
};

typedef struct {
    sysid_real pressure, variance, slopes[SYSID_MONITOR_CHAMBER];
} sysid_monitor_chamber;

typedef struct {
    sysid_real position, velocity, var_position, covariance, var_velocity;
    sysid_real position_slopes[SYSID_MONITOR_SHAFT], velocity_slopes[SYSID_MONITOR_SHAFT];
} sysid_monitor_shaft;

/* When a valve opens and closes, newest first, and when its last command ends, s from now. */
typedef struct {
    sysid_real opens[SYSID_MONITOR_KEPT], closes[SYSID_MONITOR_KEPT], commanded_off, command;
    int was_open;
} sysid_monitor_valve;

/* Normal equations of the drifts. */
typedef struct {
    sysid_real matrix[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS], vector[SYSID_MONITOR_DRIFTS];
} sysid_monitor_equations;

typedef struct {
    sysid_monitor_chamber chamber[2];
    sysid_monitor_shaft shaft;
    sysid_monitor_valve valve[2];
    sysid_monitor_equations cycle, pool;
    /* Of the cycles since an alarm; energy, samples: then of this cycle. */
    sysid_real score[SYSID_MONITOR_DRIFTS], power[SYSID_MONITOR_DRIFTS], since_energy, since_samples;
    sysid_real energy, samples;
    sysid_real variance[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS], baseline[SYSID_MONITOR_DRIFTS];
    sysid_real position, pressure[2], motor, next_period;
    sysid_real extreme, low, squares[3], count[3], before[3];
    sysid_real z[SYSID_MONITOR_DRIFTS], change[SYSID_MONITOR_DRIFTS];
    int counted[3], is_since, is_duty, is_known, is_begun, way, turns, alarm, drift;
    unsigned long cycles;
    unsigned rejected;
} sysid_monitor;

/* --- when a valve is open --- */

static inline void sysid_monitor_push(sysid_monitor_valve *v, sysid_real opens, sysid_real closes)
{
    const sysid_real together = (sysid_real)1e-06 * SYSID_MONITOR_PERIOD_S;
    int k;
    if (!(closes - opens > together)) {
        return; /* an edge that is overtaken cancels, and so does its pulse */
    }
    if (opens - v->closes[0] <= together && v->opens[0] > -SYSID_MONITOR_NEVER) {
        v->closes[0] = closes; /* it opens again before it closed */
        return;
    }
    for (k = SYSID_MONITOR_KEPT - 1; k > 0; k--) {
        v->opens[k] = v->opens[k - 1];
        v->closes[k] = v->closes[k - 1];
    }
    v->opens[0] = opens;
    v->closes[0] = closes;
}

/* The newest interval ends at a time; one that would end before it begins is none. */
static inline void sysid_monitor_close(sysid_monitor_valve *v, sysid_real closes)
{
    const sysid_real together = (sysid_real)1e-06 * SYSID_MONITOR_PERIOD_S;
    v->closes[0] = closes;
    if (!(closes - v->opens[0] > together)) {
        v->opens[0] = v->closes[0] = -SYSID_MONITOR_NEVER;
    }
}

/* An on/off command from now on. */
static inline void sysid_monitor_switch(sysid_monitor_valve *v, int side)
{
    const int is_on = v->command > (sysid_real)0.5;
    const int was_on = v->commanded_off >= SYSID_MONITOR_NEVER;
    if (is_on == was_on) {
        return;
    }
    if (is_on) {
        v->commanded_off = SYSID_MONITOR_NEVER;
        sysid_monitor_push(v, sysid_monitor_on_delay[side], SYSID_MONITOR_NEVER);
    } else {
        v->commanded_off = 0;
        sysid_monitor_close(v, sysid_monitor_off_delay[side]);
    }
}

/* A PWM period that starts so many s from now, with the duty in force. */
static inline void sysid_monitor_pulse(sysid_monitor_valve *v, int side, sysid_real start)
{
    const sysid_real together = (sysid_real)1e-06 * SYSID_MONITOR_PERIOD_S;
    const sysid_real duty = v->command < 0 ? 0 : v->command > 1 ? 1 : v->command;
    const sysid_real off = start + duty * sysid_monitor_pwm_period;
    const sysid_real closes = off + sysid_monitor_off_delay[side];
    if (!(duty > 0)) {
        return;
    }
    if (start - v->commanded_off <= together && v->opens[0] > -SYSID_MONITOR_NEVER) {
        sysid_monitor_close(v, closes); /* it joins the last pulse: no gap */
    } else {
        sysid_monitor_push(v, start + sysid_monitor_on_delay[side], closes);
    }
    v->commanded_off = off;
}

static inline int sysid_monitor_is_open(const sysid_monitor_valve *v, sysid_real time)
{
    int k;
    for (k = 0; k < SYSID_MONITOR_KEPT; k++) {
        if (v->opens[k] <= time && time < v->closes[k]) {
            return 1;
        }
    }
    return 0;
}

/* The first edge of either valve after a time, before the end. */
static inline sysid_real sysid_monitor_edge(const sysid_monitor_valve v[2], sysid_real since, sysid_real end)
{
    int side, k;
    for (side = 0; side < 2; side++) {
        for (k = 0; k < SYSID_MONITOR_KEPT; k++) {
            if (v[side].opens[k] > since && v[side].opens[k] < end) {
                end = v[side].opens[k];
            }
            if (v[side].closes[k] > since && v[side].closes[k] < end) {
                end = v[side].closes[k];
            }
        }
    }
    return end;
}

/* One sample later: all times are from the new sample. */
static inline void sysid_monitor_shift(sysid_monitor_valve *v)
{
    const sysid_real oldest = -2 * SYSID_MONITOR_PERIOD_S;
    int k;
    for (k = 0; k < SYSID_MONITOR_KEPT; k++) {
        if (v->closes[k] < SYSID_MONITOR_NEVER) {
            v->closes[k] -= SYSID_MONITOR_PERIOD_S;
        }
        v->opens[k] -= SYSID_MONITOR_PERIOD_S;
        if (v->closes[k] < oldest) {
            v->opens[k] = v->closes[k] = -SYSID_MONITOR_NEVER;
        } else if (v->opens[k] < oldest) {
            v->opens[k] = oldest;
        }
    }
    if (v->commanded_off < SYSID_MONITOR_NEVER && v->commanded_off > oldest) {
        v->commanded_off -= SYSID_MONITOR_PERIOD_S;
    }
}

/* The commands from now on: edges at once, or the PWM periods that start within the sample. */
static inline void sysid_monitor_command(sysid_monitor *m)
{
    const sysid_real together = (sysid_real)1e-06 * SYSID_MONITOR_PERIOD_S;
    int side;
    if (!m->is_duty) {
        for (side = 0; side < 2; side++) {
            sysid_monitor_switch(&m->valve[side], side);
        }
        return;
    }
    while (m->next_period < SYSID_MONITOR_PERIOD_S - together) {
        for (side = 0; side < 2; side++) {
            sysid_monitor_pulse(&m->valve[side], side, m->next_period);
        }
        m->next_period += sysid_monitor_pwm_period;
    }
}

/* --- observers --- */

static inline sysid_real sysid_monitor_rate(int side, sysid_real position, sysid_real velocity,
                                      sysid_real pressure, sysid_real other, int is_open, int other_open,
                                      sysid_real supply)
{
    const sysid_real own = (sysid_real)is_open, its = (sysid_real)other_open;
    return side ? sysid_monitor_rate_b(position, velocity, pressure, other, own, its, supply)
                : sysid_monitor_rate_a(position, velocity, pressure, other, own, its, supply);
}

static inline int sysid_monitor_chokes(int side, int is_open, sysid_real pressure, sysid_real supply)
{
    return is_open ? pressure <= sysid_monitor_choked[side][0] * supply / sysid_monitor_supply
                   : pressure >= sysid_monitor_choked[side][1];
}

static inline void sysid_monitor_chamber_start(sysid_monitor_chamber *c, sysid_real pressure)
{
    int k;
    c->pressure = pressure;
    c->variance = sysid_monitor_pressure_noise * sysid_monitor_pressure_noise;
    for (k = 0; k < SYSID_MONITOR_CHAMBER; k++) {
        c->slopes[k] = 0;
    }
}

static inline sysid_real sysid_monitor_softplus(sysid_real x)
{
    return sysid_maximum(x, 0) + sysid_log1p(sysid_exp(-sysid_fabs(x)));
}

/* The logistic function's mean from one value to a higher one; density: the mean of its slope. */
static inline sysid_real sysid_monitor_past(sysid_real from, sysid_real to, sysid_real *density)
{
    const sysid_real width = to - from, half = (sysid_real)0.5;
    if (width < (sysid_real)0.01) {
        const sysid_real middle = half + half * sysid_tanh((sysid_real)0.25 * (from + to));
        *density = middle * (1 - middle);
        return middle;
    }
    *density = half * (sysid_tanh(half * to) - sysid_tanh(half * from)) / width;
    return (sysid_monitor_softplus(to) - sysid_monitor_softplus(from)) / width;
}

/* A chamber over a stretch of duration s in which no valve moves; turned 1 where its own opened as
   it began, -1 where it closed, else 0. */
static inline void sysid_monitor_chamber_ahead(sysid_monitor_chamber *c, int side, sysid_real position,
                                            sysid_real velocity, sysid_real other, int is_open,
                                            int other_open, int turned, sysid_real duration)
{
    const sysid_real spread = sysid_monitor_pressure_noise, supply = sysid_monitor_supply;
    const sysid_real *scales = sysid_monitor_chamber_scales[side];
    const sysid_real p = c->pressure, atmosphere = sysid_monitor_atmosphere;
    const sysid_real now =
        sysid_monitor_rate(side, position, velocity, p, other, is_open, other_open, supply);
    const sysid_real swept = side ? sysid_monitor_swept_b(position, velocity, p, other)
                               : sysid_monitor_swept_a(position, velocity, p, other);
    const sysid_real per_flow =
        side ? sysid_monitor_per_flow_b(position) : sysid_monitor_per_flow_a(position);
    const int chokes = sysid_monitor_chokes(side, is_open, p, supply);
    const sysid_real boundary = sysid_monitor_choked[side][is_open ? 0 : 1];
    const sysid_real moved =
        sysid_monitor_sweep[side] * (duration / SYSID_MONITOR_PERIOD_S) * per_flow * p;
    sysid_real low = p - spread, high = p + spread, lower = supply - spread, upper = supply + spread;
    sysid_real slopes[SYSID_MONITOR_CHAMBER], over, z, gain, carried, way, scale, from, to;
    int k;
    if (sysid_monitor_chokes(side, is_open, low, supply) != chokes) {
        low = p;
    }
    if (sysid_monitor_chokes(side, is_open, high, supply) != chokes) {
        high = p;
    }
    if (sysid_monitor_chokes(side, is_open, p, lower) != chokes) {
        lower = supply;
    }
    if (sysid_monitor_chokes(side, is_open, p, upper) != chokes) {
        upper = supply;
    }
    over = (sysid_monitor_rate(side, position, velocity, high, other, is_open, other_open, supply) -
            sysid_monitor_rate(side, position, velocity, low, other, is_open, other_open, supply)) /
           (high - low);
    for (k = 0; k < SYSID_MONITOR_CHAMBER; k++) {
        slopes[k] = 0;
    }
    slopes[0] = -scales[0] * per_flow * (p * p - other * other);
    slopes[1] = -scales[1] * per_flow * (p * p - atmosphere * atmosphere);
    slopes[4] =
        scales[4] *
        (sysid_monitor_rate(side, position, velocity, p, other, is_open, other_open, upper) -
         sysid_monitor_rate(side, position, velocity, p, other, is_open, other_open, lower)) /
        (upper - lower);
    k = is_open ? (chokes ? 5 : 6) : (chokes ? 7 : 8);
    slopes[k] = scales[k] * (now - swept);
    if (turned) {
        const sysid_real shut =
            sysid_monitor_rate(side, position, velocity, p, other, !is_open, other_open, supply);
        const sysid_real edge = is_open ? now - shut : shut - now;
        c->slopes[turned > 0 ? 2 : 3] += turned > 0 ? -scales[2] * edge : scales[3] * edge;
    }
    z = duration * over;
    gain = duration;
    gain *= sysid_fabs(z) < (sysid_real)1e-4 ? 1 + (sysid_real)0.5 * z : sysid_expm1(z) / z;
    carried = 1 + gain * over;
    way = p < boundary ? (sysid_real)1 : (sysid_real)-1;
    c->pressure = p + gain * now;
    c->variance = carried * carried * c->variance + moved * moved;
    for (k = 0; k < SYSID_MONITOR_CHAMBER; k++) {
        c->slopes[k] = carried * c->slopes[k] + gain * slopes[k];
    }
    /* Past the choked flow's boundary the other rate counts. */
    scale = sysid_sqrt(c->variance) / (sysid_real)1.702;
    from = way * (p - boundary) / scale;
    to = from + sysid_maximum(way * gain * now / scale, 0);
    if (to > -(sysid_real)40.0) {
        const sysid_real there = boundary * (1 + way * (sysid_real)1e-06);
        const sysid_real beyond = sysid_monitor_rate(side, position, velocity, there, other, is_open,
                                               other_open, supply);
        const sysid_real more = way * gain * (beyond - now) / scale;
        sysid_real density, share, bend;
        from += sysid_minimum(way * gain * beyond / scale, 0);
        share = sysid_monitor_past(from, to, &density);
        bend = 1 + more * density;
        c->pressure += way * scale * more * share;
        c->variance *= bend * bend;
        for (k = 0; k < SYSID_MONITOR_CHAMBER; k++) {
            c->slopes[k] *= bend;
        }
    }
}

/* Whether a reading shows that the pressure is on the other side of the choked flow's boundary. */
static inline int sysid_monitor_chamber_lost(const sysid_monitor_chamber *c, int side, int is_open,
                                          sysid_real reading)
{
    const sysid_real noise = sysid_monitor_pressure_noise * sysid_monitor_pressure_noise;
    const sysid_real boundary = sysid_monitor_choked[side][is_open ? 0 : 1];
    return (reading < boundary) != (c->pressure < boundary) &&
           sysid_fabs(reading - c->pressure) > (sysid_real)3.0 * sysid_sqrt(c->variance + noise);
}

/* What an innovation and its slopes count times: one over its standard deviation, less for a
   spike. */
static inline sysid_real sysid_monitor_weight(sysid_real gap, sysid_real part)
{
    const sysid_real size = sysid_fabs(part * gap), most = (sysid_real)20.0;
    return size > most ? part * most / size : part;
}

/* An innovation as it counts; shown: its slopes likewise. */
static inline sysid_real sysid_monitor_chamber_seen(sysid_monitor_chamber *c, sysid_real reading,
                                              sysid_real shown[SYSID_MONITOR_CHAMBER])
{
    const sysid_real noise = sysid_monitor_pressure_noise * sysid_monitor_pressure_noise;
    const sysid_real whole = c->variance + noise, part = 1 / sysid_sqrt(whole);
    const sysid_real gap = reading - c->pressure, gain = c->variance / whole;
    const sysid_real weight = sysid_monitor_weight(gap, part);
    int k;
    c->pressure += gain * gap;
    c->variance *= 1 - gain;
    for (k = 0; k < SYSID_MONITOR_CHAMBER; k++) {
        shown[k] = weight * c->slopes[k];
        c->slopes[k] *= 1 - gain;
    }
    return weight * gap;
}

static inline void sysid_monitor_shaft_start(sysid_monitor_shaft *s, sysid_real position)
{
    int k;
    s->position = position;
    s->velocity = 0;
    s->var_position = sysid_monitor_position_noise * sysid_monitor_position_noise;
    s->covariance = 0;
    s->var_velocity = sysid_monitor_speed * sysid_monitor_speed;
    for (k = 0; k < SYSID_MONITOR_SHAFT; k++) {
        s->position_slopes[k] = s->velocity_slopes[k] = 0;
    }
}

/* Whether the shaft slides, in a known direction, between the stops. */
static inline int sysid_monitor_shaft_moves(const sysid_monitor_shaft *s)
{
    return sysid_fabs(s->velocity) > (sysid_real)3.0 * sysid_sqrt(s->var_velocity) &&
           sysid_fabs(s->position) < sysid_monitor_travel;
}

/* A sample later. Where the shaft may rest, or touches a stop, its acceleration is unknown. */
static inline void sysid_monitor_shaft_ahead(sysid_monitor_shaft *s, const sysid_real pressure[2],
                                          sysid_real motor)
{
    const sysid_real h = SYSID_MONITOR_PERIOD_S, half = (sysid_real)0.5 * h * h;
    const int moves = sysid_monitor_shaft_moves(s);
    const sysid_real effort =
        sysid_monitor_effort(s->position, s->velocity, pressure[0], pressure[1], motor);
    const sysid_real inert = sysid_monitor_inertia + (sysid_real)0.5 * h * sysid_monitor_viscous;
    const sysid_real acceleration = moves ? effort / inert : 0;
    const sysid_real free = (sysid_fabs(effort) + 2 * sysid_monitor_breakaway) / sysid_monitor_inertia;
    const sysid_real spread = moves ? sysid_monitor_acceleration_variance : free * free;
    const sysid_real cross = s->covariance + h * s->var_velocity;
    sysid_real slopes[SYSID_MONITOR_SHAFT];
    int k;
    slopes[0] = -sysid_monitor_shaft_scales[0] * sysid_sign(s->velocity) / sysid_monitor_inertia;
    slopes[1] = -sysid_monitor_shaft_scales[1] *
                (s->velocity + (sysid_real)0.5 * h * acceleration) / sysid_monitor_inertia;
    slopes[2] = sysid_monitor_shaft_scales[2] / sysid_monitor_inertia;
    slopes[3] = -sysid_monitor_shaft_scales[3] * acceleration;
    s->position += h * s->velocity + half * acceleration;
    s->velocity += h * acceleration;
    s->var_position += h * (s->covariance + cross) + half * half * spread;
    s->covariance = cross + half * h * spread;
    s->var_velocity += h * h * spread;
    for (k = 0; k < SYSID_MONITOR_SHAFT; k++) {
        if (moves) {
            s->position_slopes[k] += h * s->velocity_slopes[k] + half * slopes[k];
            s->velocity_slopes[k] += h * slopes[k];
        } else {
            s->position_slopes[k] = s->velocity_slopes[k] = 0;
        }
    }
}

static inline sysid_real sysid_monitor_shaft_seen(sysid_monitor_shaft *s, sysid_real reading,
                                            sysid_real shown[SYSID_MONITOR_SHAFT])
{
    const sysid_real noise = sysid_monitor_position_noise * sysid_monitor_position_noise;
    const sysid_real whole = s->var_position + noise, part = 1 / sysid_sqrt(whole);
    const sysid_real gap = reading - s->position;
    const sysid_real to_position = s->var_position / whole, to_velocity = s->covariance / whole;
    const sysid_real weight = sysid_monitor_weight(gap, part);
    int k;
    s->position += to_position * gap;
    s->velocity += to_velocity * gap;
    s->var_velocity -= to_velocity * s->covariance;
    s->var_position *= 1 - to_position;
    s->covariance *= 1 - to_position;
    for (k = 0; k < SYSID_MONITOR_SHAFT; k++) {
        shown[k] = weight * s->position_slopes[k];
        s->velocity_slopes[k] -= to_velocity * s->position_slopes[k];
        s->position_slopes[k] *= 1 - to_position;
    }
    return weight * gap;
}

/* --- evidence --- */

/* One innovation with its slopes over the drifts of these places; not if it is not finite. */
static inline void sysid_monitor_collect(sysid_monitor *m, int sensor, int count, const int *places,
                                      const sysid_real *slopes, sysid_real value, int counts)
{
    int i, j;
    for (i = 0; i < count; i++) {
        for (j = 0; j < count; j++) {
            m->cycle.matrix[places[i]][places[j]] += slopes[i] * slopes[j];
        }
        m->cycle.vector[places[i]] += slopes[i] * value;
    }
    if (!m->is_duty || sensor < 2) {
        m->energy += value * value;
        m->samples += 1;
    }
    /* Of neighbours: what drifts or scatters slowly is no noise. */
    if (counts && m->counted[sensor]) {
        const sysid_real step = value - m->before[sensor];
        m->squares[sensor] += (sysid_real)0.5 * step * step;
        m->count[sensor] += 1;
    }
    m->before[sensor] = value;
    m->counted[sensor] = counts;
}

static inline void sysid_monitor_new_cycle(sysid_monitor *m)
{
    int i, j;
    for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
        for (j = 0; j < SYSID_MONITOR_DRIFTS; j++) {
            m->cycle.matrix[i][j] = 0;
        }
        m->cycle.vector[i] = 0;
    }
    for (i = 0; i < 3; i++) {
        m->squares[i] = m->count[i] = 0;
    }
    m->energy = m->samples = 0;
}

/* Takes what scatters from cycle to cycle out of the cycle's equations, by Cholesky's factor of
   I + L'AL, one column of L at a time. */
static inline void sysid_monitor_without_scatter(sysid_monitor_equations *e)
{
    sysid_real rows[SYSID_MONITOR_SCATTER][SYSID_MONITOR_DRIFTS], taken[SYSID_MONITOR_SCATTER];
    sysid_real factor[SYSID_MONITOR_SCATTER][SYSID_MONITOR_SCATTER];
    int i, j, k;
    for (k = 0; k < SYSID_MONITOR_SCATTER; k++) {
        taken[k] = 0;
        for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
            sysid_real sum = 0;
            for (j = 0; j < SYSID_MONITOR_DRIFTS; j++) {
                sum += e->matrix[i][j] * sysid_monitor_scatter[j][k];
            }
            rows[k][i] = sum;
            taken[k] += sysid_monitor_scatter[i][k] * e->vector[i];
        }
    }
    for (k = 0; k < SYSID_MONITOR_SCATTER; k++) {
        for (j = 0; j <= k; j++) {
            sysid_real sum = j == k ? 1 : 0;
            for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
                sum += rows[k][i] * sysid_monitor_scatter[i][j];
            }
            for (i = 0; i < j; i++) {
                sum -= factor[k][i] * factor[j][i];
            }
            factor[k][j] = j == k ? sysid_sqrt(sum) : sum / factor[j][j];
        }
    }
    for (k = 0; k < SYSID_MONITOR_SCATTER; k++) {
        for (j = 0; j < k; j++) {
            for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
                rows[k][i] -= factor[k][j] * rows[j][i];
            }
            taken[k] -= factor[k][j] * taken[j];
        }
        for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
            rows[k][i] /= factor[k][k];
        }
        taken[k] /= factor[k][k];
    }
    for (k = 0; k < SYSID_MONITOR_SCATTER; k++) {
        for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
            for (j = 0; j < SYSID_MONITOR_DRIFTS; j++) {
                e->matrix[i][j] -= rows[k][i] * rows[k][j];
            }
            e->vector[i] -= rows[k][i] * taken[k];
        }
    }
}

/* The covariance of sums M of variance V under health, V + M B M: B is diagonal but for friction's
   first two. */
static inline void sysid_monitor_covariance(sysid_real matrix[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS],
                                         sysid_real variance[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS],
                                         const sysid_real *errors,
                                         sysid_real out[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS])
{
    int i, j, k;
    for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
        for (j = 0; j < SYSID_MONITOR_DRIFTS; j++) {
            sysid_real sum = 0;
            for (k = 0; k < SYSID_MONITOR_DRIFTS; k++) {
                sum += matrix[i][k] * errors[k] * matrix[k][j];
            }
            sum += sysid_monitor_shared_error *
                   (matrix[i][0] * matrix[1][j] + matrix[i][1] * matrix[0][j]);
            out[i][j] = variance[i][j] + sum;
        }
    }
}

/* Cholesky's factor G of a covariance in its place, and G^-1 of a vector and of rows in theirs; a
   direction that was not excited has none. */
static inline void sysid_monitor_whiten(sysid_real factor[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS],
                                     sysid_real *white,
                                     sysid_real rows[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS])
{
    int i, j, k;
    for (k = 0; k < SYSID_MONITOR_DRIFTS; k++) {
        const sysid_real own = factor[k][k];
        sysid_real pivot = own;
        for (j = 0; j < k; j++) {
            pivot -= factor[k][j] * factor[k][j];
        }
        if (!(pivot > sysid_monitor_excited * own)) {
            for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
                factor[i][k] = i < k ? factor[i][k] : 0;
                rows[k][i] = 0;
            }
            white[k] = 0;
            continue;
        }
        factor[k][k] = sysid_sqrt(pivot);
        for (j = 0; j < k; j++) {
            white[k] -= factor[k][j] * white[j];
            for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
                rows[k][i] -= factor[k][j] * rows[j][i];
            }
        }
        white[k] /= factor[k][k];
        for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
            rows[k][i] /= factor[k][k];
        }
        for (i = k + 1; i < SYSID_MONITOR_DRIFTS; i++) {
            sysid_real sum = factor[i][k];
            for (j = 0; j < k; j++) {
                sum -= factor[i][j] * factor[k][j];
            }
            factor[i][k] = sum / factor[k][k];
        }
    }
}

/* The statistics of sums and of their variance, less what the first cycles taught, where they are
   larger than those that are there; friction's, which scatters, not by a cycle alone. */
static inline void sysid_monitor_test(sysid_monitor *m, sysid_monitor_equations *e, int is_alone,
                                   sysid_real variance[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS])
{
    const sysid_real *errors =
        m->cycles > SYSID_MONITOR_LEARNING ? sysid_monitor_errors : sysid_monitor_first_errors;
    sysid_real factor[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS];
    sysid_real rows[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS], white[SYSID_MONITOR_DRIFTS];
    int i, k;
    sysid_monitor_covariance(e->matrix, variance, errors, factor);
    for (k = 0; k < SYSID_MONITOR_DRIFTS; k++) {
        white[k] = e->vector[k];
        for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
            rows[k][i] = e->matrix[k][i];
            white[k] -= e->matrix[k][i] * m->baseline[i];
        }
    }
    sysid_monitor_whiten(factor, white, rows);
    for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
        sysid_real score = 0, power = 0, z;
        for (k = 0; k < SYSID_MONITOR_DRIFTS; k++) {
            score += rows[k][i] * white[k];
            power += rows[k][i] * rows[k][i];
        }
        z = power > 0 ? score / sysid_sqrt(power) : 0;
        if (is_alone && sysid_monitor_kind[i] == SYSID_MONITOR_FRICTION) {
            continue;
        }
        if (sysid_fabs(z) > sysid_fabs(m->z[i])) {
            m->z[i] = z;
            m->change[i] = score / power * sysid_monitor_scales[i];
        }
    }
}

static inline void sysid_monitor_new_sums(sysid_monitor *m)
{
    int i, j;
    for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
        for (j = 0; j < SYSID_MONITOR_DRIFTS; j++) {
            m->pool.matrix[i][j] = m->variance[i][j] = 0;
        }
        m->pool.vector[i] = 0;
    }
    m->is_since = 0;
}

/* The drifts that the first cycles show, the posterior mean, as the baseline; and sums anew. */
static inline void sysid_monitor_learn(sysid_monitor *m)
{
    sysid_real factor[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS];
    sysid_real rows[SYSID_MONITOR_DRIFTS][SYSID_MONITOR_DRIFTS], white[SYSID_MONITOR_DRIFTS];
    int i, k;
    sysid_monitor_covariance(m->pool.matrix, m->variance, sysid_monitor_first_errors, factor);
    for (k = 0; k < SYSID_MONITOR_DRIFTS; k++) {
        white[k] = m->pool.vector[k];
        for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
            rows[k][i] = m->pool.matrix[k][i] * sysid_monitor_first_errors[i];
        }
        rows[k][0] += m->pool.matrix[k][1] * sysid_monitor_shared_error;
        rows[k][1] += m->pool.matrix[k][0] * sysid_monitor_shared_error;
    }
    sysid_monitor_whiten(factor, white, rows);
    for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
        m->baseline[i] = 0;
        for (k = 0; k < SYSID_MONITOR_DRIFTS; k++) {
            m->baseline[i] += rows[k][i] * white[k];
        }
    }
    sysid_monitor_new_sums(m);
}

/* The size of a statistic in the direction in which it alarms; of a nuisance 0. */
static inline sysid_real sysid_monitor_size(const sysid_real *z, int k)
{
    const sysid_real size = sysid_monitor_grows[k] ? z[k] : sysid_fabs(z[k]);
    return sysid_monitor_kind[k] && size > 0 ? size : 0;
}

static inline int sysid_monitor_likeliest(const sysid_real *z)
{
    int k, best = 0;
    for (k = 1; k < SYSID_MONITOR_DRIFTS; k++) {
        best = sysid_monitor_size(z, k) > sysid_monitor_size(z, best) ? k : best;
    }
    return best;
}

/* The kind that statistics speak for, if another is much less likely. */
static inline int sysid_monitor_named(const sysid_real *z, int best)
{
    const sysid_real most = sysid_monitor_size(z, best);
    sysid_real other = 0;
    int k;
    for (k = 0; k < SYSID_MONITOR_DRIFTS; k++) {
        if (sysid_monitor_kind[k] != sysid_monitor_kind[best]) {
            other = sysid_maximum(other, sysid_monitor_size(z, k));
        }
    }
    return (sysid_real)0.5 * (most * most - other * other) > sysid_monitor_log_odds
               ? sysid_monitor_kind[best]
               : SYSID_MONITOR_UNDECIDED;
}

/* One more cycle since the alarm, and the kind that all of them speak for: these have all of the
   change, and their variance about the most likely drift takes in what is not linear in it. */
static inline int sysid_monitor_after_alarm(sysid_monitor *m, sysid_real energy)
{
    sysid_real z[SYSID_MONITOR_DRIFTS], misfit, most;
    int i, k;
    m->since_energy += energy;
    m->since_samples += m->samples;
    for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
        sysid_real score = m->cycle.vector[i];
        for (k = 0; k < SYSID_MONITOR_DRIFTS; k++) {
            score -= m->cycle.matrix[i][k] * m->baseline[k];
        }
        m->since_energy -= m->baseline[i] * (m->cycle.vector[i] + score);
        m->score[i] += score;
        m->power[i] += m->cycle.matrix[i][i];
        z[i] = m->power[i] > 0 ? m->score[i] / sysid_sqrt(m->power[i]) : 0;
        m->change[i] =
            m->power[i] > 0 ? m->score[i] / m->power[i] * sysid_monitor_scales[i] : 0;
    }
    m->drift = sysid_monitor_likeliest(z);
    most = sysid_monitor_size(z, m->drift);
    misfit = (m->since_energy - most * most) / sysid_maximum(m->since_samples, 1);
    misfit = sysid_maximum(misfit, 1);
    for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
        z[i] /= sysid_sqrt(misfit);
    }
    return sysid_monitor_named(z, m->drift);
}

/* The alarm that the statistics speak for. */
static inline void sysid_monitor_judge(sysid_monitor *m, sysid_real energy)
{
    int i;
    m->drift = sysid_monitor_likeliest(m->z);
    if (!(sysid_monitor_size(m->z, m->drift) > sysid_monitor_threshold)) {
        m->alarm = SYSID_MONITOR_HEALTHY;
        m->is_since = 0;
    } else if (m->is_since) {
        m->alarm = sysid_monitor_after_alarm(m, energy);
    } else {
        m->alarm = SYSID_MONITOR_UNDECIDED;
        m->is_since = 1;
        m->since_energy = m->since_samples = 0;
        for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
            m->score[i] = m->power[i] = 0;
        }
    }
}

/* The end of a cycle: its equations into the sums, and what these say. */
static inline void sysid_monitor_cycle_ends(sysid_monitor *m)
{
    const sysid_real keeps = m->cycles < SYSID_MONITOR_LEARNING ? 1 : sysid_monitor_forgetting;
    sysid_real excess = 1;
    int i, j;
    for (i = 0; i < 3; i++) {
        if (m->count[i] > 0 && m->squares[i] / m->count[i] > excess) {
            excess = m->squares[i] / m->count[i];
        }
    }
    for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
        for (j = 0; j < SYSID_MONITOR_DRIFTS; j++) {
            m->cycle.matrix[i][j] /= excess;
        }
        m->cycle.vector[i] /= excess;
    }
    sysid_monitor_without_scatter(&m->cycle);
    for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
        for (j = 0; j < SYSID_MONITOR_DRIFTS; j++) {
            m->pool.matrix[i][j] = keeps * m->pool.matrix[i][j] + m->cycle.matrix[i][j];
            m->variance[i][j] = keeps * keeps * m->variance[i][j] + m->cycle.matrix[i][j];
        }
        m->pool.vector[i] = keeps * m->pool.vector[i] + m->cycle.vector[i];
    }
    m->cycles++;
    for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
        m->z[i] = m->change[i] = 0;
    }
    /* The first sums after learning are one cycle alone. */
    sysid_monitor_test(m, &m->pool, m->cycles == SYSID_MONITOR_LEARNING + 1, m->variance);
    sysid_monitor_test(m, &m->cycle, 1, m->cycle.matrix);
    sysid_monitor_judge(m, m->energy / excess);
    sysid_monitor_new_cycle(m);
    if (m->cycles == SYSID_MONITOR_LEARNING) {
        sysid_monitor_learn(m);
    }
}

/* Whether a cycle ends with a position: the second time that a stroke turns. */
static inline int sysid_monitor_turns(sysid_monitor *m, sysid_real position)
{
    const sysid_real least = sysid_monitor_least_stroke;
    if (!m->is_begun) {
        m->is_begun = 1;
        m->extreme = m->low = position;
        return 0;
    }
    if (m->way == 0) {
        m->extreme = position > m->extreme ? position : m->extreme;
        m->low = position < m->low ? position : m->low;
        if (m->extreme - m->low >= least) {
            m->way = position >= m->extreme ? 1 : -1;
            m->extreme = position;
        }
        return 0;
    }
    if ((sysid_real)m->way * (position - m->extreme) > 0) {
        m->extreme = position;
        return 0;
    }
    if ((sysid_real)m->way * (m->extreme - position) < least) {
        return 0;
    }
    m->way = -m->way;
    m->extreme = position;
    m->turns = !m->turns;
    return !m->turns;
}

/* --- one call a sample --- */

/* Anew: nothing seen, both valves off. is_duty: the valves' commands are duties, else 1 and 0. */
static inline void sysid_monitor_start(sysid_monitor *m, int is_duty)
{
    int side, i;
    m->is_duty = is_duty;
    m->is_known = m->is_begun = m->way = m->turns = m->alarm = m->drift = 0;
    m->cycles = 0;
    m->rejected = 0;
    m->next_period = m->position = m->motor = m->extreme = m->low = 0;
    for (side = 0; side < 2; side++) {
        sysid_monitor_valve *v = &m->valve[side];
        for (i = 0; i < SYSID_MONITOR_KEPT; i++) {
            v->opens[i] = v->closes[i] = -SYSID_MONITOR_NEVER;
        }
        v->commanded_off = -SYSID_MONITOR_NEVER;
        v->command = 0;
        v->was_open = 0;
        m->pressure[side] = 0;
        sysid_monitor_chamber_start(&m->chamber[side], 0);
    }
    sysid_monitor_shaft_start(&m->shaft, 0);
    for (i = 0; i < 3; i++) {
        m->counted[i] = 0;
        m->before[i] = 0;
    }
    sysid_monitor_new_cycle(m);
    sysid_monitor_new_sums(m);
    for (i = 0; i < SYSID_MONITOR_DRIFTS; i++) {
        m->baseline[i] = m->z[i] = m->change[i] = 0;
    }
}

static inline int sysid_monitor_all_finite(sysid_real value, const sysid_real *slopes, int count)
{
    int k;
    for (k = 0; k < count; k++) {
        value += slopes[k];
    }
    return isfinite(value);
}

/* The observers from the last sample to this one: chambers stretch by stretch between the valves'
   edges, then the shaft under their mean pressures. One whose numbers are not finite, or whose
   pressure is on the other side of the choked flow's boundary, begins anew. Returns 1; 0 where
   numbers are not finite. */
static inline int sysid_monitor_observe(sysid_monitor *m, sysid_real position, const sysid_real pressure[2])
{
    const sysid_real h = SYSID_MONITOR_PERIOD_S, together = (sysid_real)1e-06 * h;
    const sysid_real middle = (sysid_real)0.5 * (position + m->position);
    const sysid_real velocity = (position - m->position) / h;
    const sysid_real begun[2] = {m->chamber[0].pressure, m->chamber[1].pressure};
    sysid_real mean[2] = {0, 0}, chambers[2][SYSID_MONITOR_CHAMBER], shaft[SYSID_MONITOR_SHAFT], value[3];
    sysid_real since = 0, under[2];
    int side, counts, lost[2], all = 1;
    while (since < h - together) {
        sysid_real until = sysid_monitor_edge(m->valve, since + together, h);
        int is_open[2];
        until = h - until > together ? until : h;
        for (side = 0; side < 2; side++) {
            is_open[side] = sysid_monitor_is_open(&m->valve[side], since + together);
        }
        for (side = 0; side < 2; side++) {
            sysid_monitor_chamber *c = &m->chamber[side];
            const sysid_real from = c->pressure;
            sysid_monitor_chamber_ahead(c, side, middle, velocity, m->pressure[1 - side],
                                     is_open[side], is_open[1 - side],
                                     is_open[side] - m->valve[side].was_open, until - since);
            mean[side] += (sysid_real)0.5 * (until - since) / h * (from + c->pressure);
        }
        for (side = 0; side < 2; side++) {
            m->valve[side].was_open = is_open[side];
        }
        since = until;
    }
    for (side = 0; side < 2; side++) {
        const sysid_real ends = (sysid_real)0.5 * (begun[side] + m->chamber[side].pressure);
        under[side] = (sysid_real)0.5 * (pressure[side] + m->pressure[side]);
        under[side] += isfinite(mean[side] - ends) ? mean[side] - ends : 0;
        lost[side] = sysid_monitor_chamber_lost(&m->chamber[side], side, m->valve[side].was_open,
                                             pressure[side]);
        value[side] = sysid_monitor_chamber_seen(&m->chamber[side], pressure[side], chambers[side]);
    }
    counts = sysid_monitor_shaft_moves(&m->shaft);
    sysid_monitor_shaft_ahead(&m->shaft, under, m->motor);
    value[2] = sysid_monitor_shaft_seen(&m->shaft, position, shaft);
    for (side = 0; side < 2; side++) {
        if (!sysid_monitor_all_finite(value[side] + m->chamber[side].pressure, chambers[side],
                                   SYSID_MONITOR_CHAMBER)) {
            lost[side] = 1;
            all = 0;
        }
        if (lost[side]) {
            sysid_monitor_chamber_start(&m->chamber[side], pressure[side]);
            m->counted[side] = 0;
        } else {
            sysid_monitor_collect(m, side, SYSID_MONITOR_CHAMBER, sysid_monitor_chamber_places[side],
                               chambers[side], value[side], 1);
        }
    }
    if (sysid_monitor_all_finite(value[2] + m->shaft.velocity, shaft, SYSID_MONITOR_SHAFT)) {
        /* Under PWM the effort's ripple is not resolved well enough to speak of friction. */
        for (side = 0; m->is_duty && side < SYSID_MONITOR_SHAFT; side++) {
            shaft[side] = 0;
        }
        sysid_monitor_collect(m, 2, SYSID_MONITOR_SHAFT, sysid_monitor_shaft_places, shaft, value[2],
                           counts && !m->is_duty);
    } else {
        sysid_monitor_shaft_start(&m->shaft, position);
        m->counted[2] = all = 0;
    }
    return all;
}

/* The valves' state over a sample that is not observed. */
static inline void sysid_monitor_unseen(sysid_monitor *m)
{
    const sysid_real last = (1 - (sysid_real)1e-06) * SYSID_MONITOR_PERIOD_S;
    int side;
    for (side = 0; side < 2; side++) {
        m->valve[side].was_open = sysid_monitor_is_open(&m->valve[side], last);
    }
}

/* A sample: position (rad or m), pressures (Pa, absolute), and the commands from now on: the
   motor's effort (Nm or N), the valves by duty or 1 and 0. Returns the alarm. */
static inline int sysid_monitor_update(sysid_monitor *m, sysid_real position, sysid_real pressure_a_pa,
                                    sysid_real pressure_b_pa, sysid_real motor, sysid_real valve_a,
                                    sysid_real valve_b)
{
    const sysid_real pressure[2] = {pressure_a_pa, pressure_b_pa}, command[2] = {valve_a, valve_b};
    const int is_finite = isfinite(position) && isfinite(pressure_a_pa) &&
                          isfinite(pressure_b_pa) && isfinite(motor) && isfinite(valve_a) &&
                          isfinite(valve_b);
    int side, ends = 0, is_seen = 0;
    if (m->is_known > 1 && is_finite) {
        m->rejected += sysid_monitor_observe(m, position, pressure) ? 0U : 1U;
        is_seen = 1;
    } else {
        sysid_monitor_unseen(m);
        m->rejected += is_finite ? 0U : 1U;
    }
    if (is_finite) {
        if (!is_seen) {
            for (side = 0; side < 2; side++) {
                sysid_monitor_chamber_start(&m->chamber[side], pressure[side]);
            }
            sysid_monitor_shaft_start(&m->shaft, position);
            for (side = 0; side < 3; side++) {
                m->counted[side] = 0;
            }
        }
        ends = sysid_monitor_turns(m, position);
        m->position = position;
        m->pressure[0] = pressure[0];
        m->pressure[1] = pressure[1];
        m->motor = motor;
    }
    for (side = 0; side < 2; side++) {
        if (m->is_known) {
            sysid_monitor_shift(&m->valve[side]);
        }
        if (isfinite(command[side])) {
            m->valve[side].command = command[side];
        }
    }
    if (m->is_known) {
        /* Whole samples stay whole, however long it runs. */
        const sysid_real left = m->next_period - SYSID_MONITOR_PERIOD_S;
        const sysid_real whole = sysid_floor(left / SYSID_MONITOR_PERIOD_S + (sysid_real)0.5);
        const sysid_real off = left / SYSID_MONITOR_PERIOD_S - whole;
        m->next_period = sysid_fabs(off) < (sysid_real)1e-3 ? whole * SYSID_MONITOR_PERIOD_S : left;
    }
    sysid_monitor_command(m);
    m->is_known = is_finite ? 2 : 1;
    if (ends) {
        sysid_monitor_cycle_ends(m);
    }
    return m->alarm;
}

#endif /* SYSID_CONTROLLER_H */
