/*
 * Identified model of a pneumatic actuator, for a controller. Written by sysid export.
 * rig: axis (linear, horizontal)
 * bundle: sysid-bundle/1, created 2026-11-22T03:26:27+00:00 by sysid 0.1.0
 * bundle SHA-256: 725ef7d841da525d5a800c492ecb52e581b84ffb9c3261a1e3f91940da73a5a1
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
 * Effects, in the constants and the functions that end with _with_effects:
 * asymmetric-viscous-friction
 */
#ifndef SYSID_CONTROLLER_H
#define SYSID_CONTROLLER_H

#include <math.h>

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) \
    || defined(_M_FP_FAST)
# error "compile without -ffast-math: it drops the checks for numbers that are not finite"
#endif

/* --- contained (1) or absent (0) in this header --- */

#define SYSID_HAS_CYLINDER 0
#define SYSID_HAS_GRAVITY 1
#define SYSID_HAS_SLIDING_FRICTION 1
#define SYSID_HAS_FRICTION 0
#define SYSID_HAS_MOTOR 0
#define SYSID_HAS_INERTIA 1
#define SYSID_HAS_VALVE_A_FILLING 0
#define SYSID_HAS_VALVE_A_EXHAUST 0
#define SYSID_HAS_VALVE_A_DISCRETE 0
#define SYSID_HAS_VALVE_A_DELAYS 0
#define SYSID_HAS_CHAMBER_A 0
#define SYSID_HAS_VALVE_B_FILLING 0
#define SYSID_HAS_VALVE_B_EXHAUST 0
#define SYSID_HAS_VALVE_B_DISCRETE 0
#define SYSID_HAS_VALVE_B_DELAYS 0
#define SYSID_HAS_CHAMBER_B 0
#define SYSID_HAS_PWM_A_FILL_BIPOLYNOMIAL 0
#define SYSID_HAS_PWM_A_FILL_NETWORK 0
#define SYSID_HAS_PWM_A_DISCHARGE_BIPOLYNOMIAL 0
#define SYSID_HAS_PWM_A_DISCHARGE_NETWORK 0
#define SYSID_HAS_PWM_B_FILL_BIPOLYNOMIAL 0
#define SYSID_HAS_PWM_B_FILL_NETWORK 0
#define SYSID_HAS_PWM_B_DISCHARGE_BIPOLYNOMIAL 0
#define SYSID_HAS_PWM_B_DISCHARGE_NETWORK 0
#define SYSID_HAS_CONTROLLERS 0
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
#define SYSID_HAS_MONITOR 0 /* the rig file has no _pwm_, whose period they need */

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
static const sysid_real sysid_encoder_zero_counts = (sysid_real)0.0; /* counts */
static const sysid_real sysid_mass_kg = (sysid_real)89.56518225378538; /* kg; payload included */
static const sysid_real sysid_weight_n = (sysid_real)0.0; /* N */
static const sysid_real sysid_friction_coulomb_n = (sysid_real)19.98209725734192; /* N */
static const sysid_real sysid_friction_viscous_n_s_per_m = (sysid_real)201.49259089089745; /* N s/m */
static const sysid_real sysid_friction_offset_n = (sysid_real)3.0123224046463957; /* N; constant force against positive motion; what is applied is less by it */

/* Force of gravity against positive motion, N (3.3.8-10): the weight. */
static inline sysid_real sysid_gravity_force(sysid_real position_m)
{
    if (!isfinite(position_m)) {
        return (sysid_real)NAN;
    }
    (void)position_m;
    return sysid_known(sysid_weight_n);
}

/* Friction while moving, N (3.4.1): Coulomb sign(w) + viscous w; 0 at rest. */
static inline sysid_real sysid_sliding_friction_force(sysid_real velocity_m_s)
{
    if (!isfinite(velocity_m_s)) {
        return (sysid_real)NAN;
    }
    return sysid_known(sysid_friction_coulomb_n*sysid_sign(velocity_m_s) +
        sysid_friction_viscous_n_s_per_m*velocity_m_s);
}

/* --- effects that the laws above do not include --- */

/* asymmetric-viscous-friction */
static const sysid_real sysid_effect_1_viscous_asymmetry_n_s_per_m = (sysid_real)-40.21437703327822; /* N s/m */

/* Friction while moving, Nm (linear rig: N), from that of the base law.
   Effects: asymmetric-viscous-friction. */
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
    (void)pressure_a_pa;
    (void)pressure_b_pa;
    value = direction*sysid_effect_1_viscous_asymmetry_n_s_per_m*velocity + value;
    return sysid_known(value);
}

#endif /* SYSID_CONTROLLER_H */
