/*
 * Identified model of a pneumatic actuator, for a controller. Written by sysid export.
 * rig: axis (linear, horizontal)
 * bundle: sysid-bundle/1, created 2026-11-22T03:26:27+00:00 by sysid 0.1.0
 * bundle SHA-256: 725ef7d841da525d5a800c492ecb52e581b84ffb9c3261a1e3f91940da73a5a1
 * SI, absolute pressures. Equation numbers are those of the thesis, as corrected.
 * Unknown numbers are absent, and their HAS macros are 0. C99, link with the maths library;
 * do not compile with -ffast-math, which drops the checks for NaN.
 * Effects, in the functions whose names end with _with_effects: asymmetric-viscous-friction
 */
#ifndef SYSID_CONTROLLER_H
#define SYSID_CONTROLLER_H

#include <math.h>

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
#define SYSID_EFFECTS_ACT_ON_SLIDING_FRICTION 1
#define SYSID_EFFECTS_ACT_ON_EXTERNAL 0
#define SYSID_EFFECTS_ACT_ON_MOTOR 0
#define SYSID_EFFECTS_ACT_ON_CHAMBER_FLOW_A 0
#define SYSID_EFFECTS_ACT_ON_TRUE_PRESSURE_A 0
#define SYSID_EFFECTS_ACT_ON_VALVE_A_ON_DELAY 0
#define SYSID_EFFECTS_ACT_ON_VALVE_A_OFF_DELAY 0
#define SYSID_EFFECTS_ACT_ON_CHAMBER_FLOW_B 0
#define SYSID_EFFECTS_ACT_ON_TRUE_PRESSURE_B 0
#define SYSID_EFFECTS_ACT_ON_VALVE_B_ON_DELAY 0
#define SYSID_EFFECTS_ACT_ON_VALVE_B_OFF_DELAY 0
#define SYSID_EFFECTS_CONTAINED 1
#define SYSID_EFFECTS_NOT_CONTAINED 0

/* --- constants --- */

static const double sysid_critical_ratio = 0.53; /* 1; downstream over upstream pressure of choked flow (3.5.1) */
static const double sysid_encoder_zero_counts = 0.0; /* counts */
static const double sysid_mass_kg = 89.56518225378538; /* kg; payload included */
static const double sysid_weight_n = 0.0; /* N */
static const double sysid_friction_coulomb_n = 19.98209725734192; /* N */
static const double sysid_friction_viscous_n_s_per_m = 201.49259089089745; /* N s/m */
static const double sysid_friction_offset_n = 3.0123224046463957; /* N; constant force in the positive direction, part of what is applied */

/* Force of gravity against positive motion, N (3.3.8-10): the weight. */
static inline double sysid_gravity_force(double position_m)
{
    (void)position_m;
    return sysid_weight_n;
}

/* Friction while moving, N (3.4.1): Coulomb sign(w) + viscous w; 0 at rest. */
static inline double sysid_sliding_friction_force(double velocity_m_s)
{
    double sign = (double)((velocity_m_s > 0.0) - (velocity_m_s < 0.0));
    return sysid_friction_coulomb_n * sign + sysid_friction_viscous_n_s_per_m * velocity_m_s;
}

/* --- effects that the laws above do not include --- */

/* asymmetric-viscous-friction */
static const double sysid_effect_1_viscous_asymmetry_n_s_per_m = -40.21437703327822; /* N s/m */

/* Friction while moving, Nm (linear rig: N), from that of the base law.
   Effects: asymmetric-viscous-friction. */
static inline double sysid_sliding_friction_with_effects(double friction, double position, double velocity, double pressure_a_pa, double pressure_b_pa)
{
    double value = friction;
    double direction = (double)((velocity > 0.0) - (velocity < 0.0));
    (void)position;
    (void)pressure_a_pa;
    (void)pressure_b_pa;
    value = value + sysid_effect_1_viscous_asymmetry_n_s_per_m * velocity * direction;
    return value;
}

#endif /* SYSID_CONTROLLER_H */
