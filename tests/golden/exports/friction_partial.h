/*
 * Identified model of a pneumatic actuator, for a controller. Written by sysid export.
 * rig: generated (rotary, horizontal)
 * bundle: sysid-bundle/1, created 2026-11-22T03:26:24+00:00 by sysid 0.1.0
 * bundle SHA-256: 7cdab6ee8bfcd1e2bd1b195b246b83e991df93cc8adc0fc00e07e84dd340dcf4
 * SI, absolute pressures. Equation numbers are those of the thesis, as corrected.
 * Unknown numbers are absent, and their HAS macros are 0. C99, link with the maths library;
 * do not compile with -ffast-math, which drops the checks for NaN.
 */
#ifndef SYSID_CONTROLLER_H
#define SYSID_CONTROLLER_H

#include <math.h>

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
#define SYSID_EFFECTS_ACT_ON_SLIDING_FRICTION 0
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
#define SYSID_EFFECTS_CONTAINED 0
#define SYSID_EFFECTS_NOT_CONTAINED 0

/* --- constants --- */

static const double sysid_critical_ratio = 0.53; /* 1; downstream over upstream pressure of choked flow (3.5.1) */
static const double sysid_gas_constant_j_per_kg_k = 287.0; /* J/(kg K) */
static const double sysid_heat_capacity_ratio = 1.4; /* 1 */
static const double sysid_temperature_k = 298.4; /* K */
static const double sysid_atmospheric_pressure_pa = 100200.0; /* Pa; absolute */
static const double sysid_supply_pressure_pa = 312000.0; /* Pa; absolute; choked filling holds at it */
static const double sysid_area_a_m2 = 0.0004325; /* m2; piston area, chamber A */
static const double sysid_area_b_m2 = 0.00041743; /* m2; piston area, chamber B */
static const double sysid_offset_a_m = 0.06819; /* m; chamber A is (offset + y) area */
static const double sysid_offset_b_m = 0.072626; /* m; chamber B is (offset - y) area */
static const double sysid_stroke_m = 0.11739; /* m */
static const double sysid_pitch_radius_m = 0.03767; /* m; y is this times the position */
static const double sysid_torque_per_volt_nm = 0.078056; /* Nm/V */
static const double sysid_max_torque_nm = 0.795; /* Nm */
static const double sysid_pwm_period_s = 0.005; /* s */
static const double sysid_declared_on_delay_s = 0.00151; /* s; from the valve's manual; command to opening */
static const double sysid_declared_off_delay_s = 0.00195; /* s; command to closing */
static const double sysid_sampling_period_s = 0.001; /* s */
static const double sysid_encoder_counts_per_rev = 80000.0; /* counts/rev */
static const double sysid_encoder_zero_counts = 0.0; /* counts */
static const double sysid_k_r_t_j_per_kg = 119897.11999999998; /* J/kg; k R T of the pressure equations (3.3.6) */
static const double sysid_inertia_kg_m2 = 0.019623; /* kg m2; payload included (3.3.5) */
static const double sysid_gravity_moment_nm = 0.0; /* Nm; gravity is this times sin(theta) (3.3.8-10) */
static const double sysid_friction_coulomb_nm = 0.16762322460959864; /* Nm */
static const double sysid_friction_viscous_nm_s_per_rad = 0.05746619236865669; /* Nm s/rad */
static const double sysid_friction_offset_nm = -0.0028980011028291227; /* Nm; constant torque in the positive direction, part of what is applied */

/* Torque of the cylinder, Nm, from absolute pressures, Pa (3.3.3). */
static inline double sysid_cylinder_torque(double pressure_a_pa, double pressure_b_pa)
{
    double gauge_a = pressure_a_pa - sysid_atmospheric_pressure_pa;
    double gauge_b = pressure_b_pa - sysid_atmospheric_pressure_pa;
    return (gauge_a * sysid_area_a_m2 - gauge_b * sysid_area_b_m2) * sysid_pitch_radius_m;
}

/* Torque of gravity against positive motion, Nm (3.3.8-10): theta = 0 hangs down. */
static inline double sysid_gravity_torque(double theta_rad)
{
    return sysid_gravity_moment_nm * sin(theta_rad);
}

/* Friction while moving, Nm (3.4.1): Coulomb sign(w) + viscous w; 0 at rest. */
static inline double sysid_sliding_friction_torque(double omega_rad_s)
{
    double sign = (double)((omega_rad_s > 0.0) - (omega_rad_s < 0.0));
    return sysid_friction_coulomb_nm * sign + sysid_friction_viscous_nm_s_per_rad * omega_rad_s;
}

/* Torque of the motor at the output, Nm, from volts (3.3.4); within its declared limit. */
static inline double sysid_motor_torque(double volts)
{
    double effort = volts * sysid_torque_per_volt_nm;
    if (effort > sysid_max_torque_nm) {
        return sysid_max_torque_nm;
    }
    return effort < -sysid_max_torque_nm ? -sysid_max_torque_nm : effort;
}

/* dP/dt of chamber A, Pa/s (3.3.6): position and velocity in rad, rad/s, flow into it
   in kg/s. */
static inline double sysid_pressure_rate_a(double pressure_pa, double theta_rad,
                                             double omega_rad_s, double flow_kg_s)
{
    double volume = (sysid_offset_a_m + sysid_pitch_radius_m * theta_rad) * sysid_area_a_m2;
    double volume_rate = sysid_pitch_radius_m * omega_rad_s * sysid_area_a_m2;
    if (!(volume > 0.0)) {
        return (double)NAN; /* no such position */
    }
    return (sysid_k_r_t_j_per_kg * flow_kg_s - sysid_heat_capacity_ratio * pressure_pa * volume_rate)
           / volume;
}

/* The flow into chamber A, kg/s, that gives this dP/dt, Pa/s: (3.3.6) solved. */
static inline double sysid_flow_for_pressure_rate_a(double rate_pa_s, double pressure_pa,
                                                      double theta_rad, double omega_rad_s)
{
    double volume = (sysid_offset_a_m + sysid_pitch_radius_m * theta_rad) * sysid_area_a_m2;
    double volume_rate = sysid_pitch_radius_m * omega_rad_s * sysid_area_a_m2;
    if (!(volume > 0.0)) {
        return (double)NAN; /* no such position */
    }
    return (volume * rate_pa_s + sysid_heat_capacity_ratio * pressure_pa * volume_rate)
           / sysid_k_r_t_j_per_kg;
}

/* dP/dt of chamber B, Pa/s (3.3.6): position and velocity in rad, rad/s, flow into it
   in kg/s. */
static inline double sysid_pressure_rate_b(double pressure_pa, double theta_rad,
                                             double omega_rad_s, double flow_kg_s)
{
    double volume = (sysid_offset_b_m - sysid_pitch_radius_m * theta_rad) * sysid_area_b_m2;
    double volume_rate = -sysid_pitch_radius_m * omega_rad_s * sysid_area_b_m2;
    if (!(volume > 0.0)) {
        return (double)NAN; /* no such position */
    }
    return (sysid_k_r_t_j_per_kg * flow_kg_s - sysid_heat_capacity_ratio * pressure_pa * volume_rate)
           / volume;
}

/* The flow into chamber B, kg/s, that gives this dP/dt, Pa/s: (3.3.6) solved. */
static inline double sysid_flow_for_pressure_rate_b(double rate_pa_s, double pressure_pa,
                                                      double theta_rad, double omega_rad_s)
{
    double volume = (sysid_offset_b_m - sysid_pitch_radius_m * theta_rad) * sysid_area_b_m2;
    double volume_rate = -sysid_pitch_radius_m * omega_rad_s * sysid_area_b_m2;
    if (!(volume > 0.0)) {
        return (double)NAN; /* no such position */
    }
    return (volume * rate_pa_s + sysid_heat_capacity_ratio * pressure_pa * volume_rate)
           / sysid_k_r_t_j_per_kg;
}

#endif /* SYSID_CONTROLLER_H */
