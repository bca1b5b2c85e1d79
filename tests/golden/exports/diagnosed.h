/*
 * Identified model of a pneumatic actuator, for a controller. Written by sysid export.
 * rig: generated (rotary, horizontal)
 * bundle: sysid-bundle/1, created 2026-11-22T03:24:25+00:00 by sysid 0.1.0
 * bundle SHA-256: 683d37f0077672a96b88c625612f4e2ffe843e8e6ded9426f7eca3ba50e6b664
 * SI, absolute pressures. Equation numbers are those of the thesis, as corrected.
 * Unknown numbers are absent, and their HAS macros are 0. C99, link with the maths library;
 * do not compile with -ffast-math, which drops the checks for NaN.
 * Effects, in the functions whose names end with _with_effects: seal-friction
 */
#ifndef SYSID_CONTROLLER_H
#define SYSID_CONTROLLER_H

#include <math.h>

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
static const double sysid_friction_static_nm = 0.2865731068780974; /* Nm */
static const double sysid_friction_coulomb_nm = 0.17057177775170543; /* Nm */
static const double sysid_friction_viscous_nm_s_per_rad = 0.05487893374853895; /* Nm s/rad */
static const double sysid_friction_offset_nm = -0.0028980011028291227; /* Nm; constant torque in the positive direction, part of what is applied */
static const double sysid_valve_a_choked_flow_fill_kg_s = 0.000651844856376044; /* kg/s */
static const double sysid_valve_a_c_fill = 1.2029226466876177e-06; /* kg/(s Pa^0.5) */
static const double sysid_valve_a_choked_flow_dis_kg_s = 0.0003455052722469696; /* kg/s */
static const double sysid_valve_a_c_dis = 3.4485245443699327e-09; /* kg/(s Pa) */
static const double sysid_valve_a_on_delay_s = 0.0015121878951520197; /* s */
static const double sysid_valve_a_off_delay_s = 0.001942921047752106; /* s */
static const double sysid_valve_b_choked_flow_fill_kg_s = 0.0011097830799082764; /* kg/s */
static const double sysid_valve_b_c_fill = 1.570423174688993e-06; /* kg/(s Pa^0.5) */
static const double sysid_valve_b_choked_flow_dis_kg_s = 0.00042154738143568814; /* kg/s */
static const double sysid_valve_b_c_dis = 3.775318095818381e-09; /* kg/(s Pa) */
static const double sysid_valve_b_on_delay_s = 0.0014959375559552319; /* s */
static const double sysid_valve_b_off_delay_s = 0.0019577100167835846; /* s */

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

/* Friction in full, Nm (3.4.1, corrected). applied = cylinder + motor - gravity (+ the
   constant friction_offset_nm, where it is known). At rest it holds against what is
   applied, up to static friction. */
static inline double sysid_friction_torque(double omega_rad_s, double applied_nm)
{
    if (omega_rad_s != 0.0) {
        return sysid_sliding_friction_torque(omega_rad_s);
    }
    if (applied_nm > sysid_friction_static_nm) {
        return sysid_friction_static_nm;
    }
    return applied_nm < -sysid_friction_static_nm ? -sysid_friction_static_nm : applied_nm;
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

/* Flow into chamber A, kg/s, with the valve on (3.6.6). Choked up to 0.53 of the
   supply, in proportion to it; negative above the supply. */
static inline double sysid_valve_a_filling_flow(double pressure_pa, double supply_pa)
{
    double gap = supply_pa - pressure_pa;
    if (pressure_pa <= sysid_critical_ratio * supply_pa) {
        return sysid_valve_a_choked_flow_fill_kg_s * (supply_pa / sysid_supply_pressure_pa);
    }
    return sysid_valve_a_c_fill * (gap < 0.0 ? -sqrt(-gap) : sqrt(gap));
}

/* Flow into chamber A, kg/s, with the valve off (3.6.7, 3.6.10): negative (out)
   above the atmosphere, choked from atmosphere / 0.53 on; air comes in below it. */
static inline double sysid_valve_a_exhaust_flow(double pressure_pa, double atmosphere_pa)
{
    if (pressure_pa >= (1.0 / sysid_critical_ratio) * atmosphere_pa) {
        return -sysid_valve_a_choked_flow_dis_kg_s;
    }
    return sysid_valve_a_c_dis * (atmosphere_pa - pressure_pa);
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

/* Flow into chamber B, kg/s, with the valve on (3.6.6). Choked up to 0.53 of the
   supply, in proportion to it; negative above the supply. */
static inline double sysid_valve_b_filling_flow(double pressure_pa, double supply_pa)
{
    double gap = supply_pa - pressure_pa;
    if (pressure_pa <= sysid_critical_ratio * supply_pa) {
        return sysid_valve_b_choked_flow_fill_kg_s * (supply_pa / sysid_supply_pressure_pa);
    }
    return sysid_valve_b_c_fill * (gap < 0.0 ? -sqrt(-gap) : sqrt(gap));
}

/* Flow into chamber B, kg/s, with the valve off (3.6.7, 3.6.10): negative (out)
   above the atmosphere, choked from atmosphere / 0.53 on; air comes in below it. */
static inline double sysid_valve_b_exhaust_flow(double pressure_pa, double atmosphere_pa)
{
    if (pressure_pa >= (1.0 / sysid_critical_ratio) * atmosphere_pa) {
        return -sysid_valve_b_choked_flow_dis_kg_s;
    }
    return sysid_valve_b_c_dis * (atmosphere_pa - pressure_pa);
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

/* --- effects that the laws above do not include --- */

/* seal-friction */
static const double sysid_effect_1_seal_torque_nm_per_pa = 2.9542994623283846e-07; /* Nm/Pa */
static const double sysid_effect_1_difference_share = 0.0014119374232189758; /* - */

/* Friction while moving, Nm (linear rig: N), from that of the base law.
   Effects: seal-friction. */
static inline double sysid_sliding_friction_with_effects(double friction, double position, double velocity, double pressure_a_pa, double pressure_b_pa)
{
    double value = friction;
    double direction = (double)((velocity > 0.0) - (velocity < 0.0));
    (void)position;
    value = value + sysid_effect_1_seal_torque_nm_per_pa * direction * ((1.0 - sysid_effect_1_difference_share) * (pressure_a_pa + pressure_b_pa - 2.0 * sysid_atmospheric_pressure_pa) + sysid_effect_1_difference_share * fabs(pressure_a_pa - pressure_b_pa));
    return value;
}

/* --- PWM surfaces ---------------------------------------------------------------------- */

/* Why a value was saturated; combined by |, 0 where nothing was. */
#define SYSID_PRESSURE 1u   /* outside the pressure range; the nearest edge was used */
#define SYSID_ABOVE 2u      /* flow (inverse) or duty (forward) above what was seen */
#define SYSID_BELOW 4u      /* and below */
#define SYSID_NO_ROOT 8u    /* beyond the extremum of the surface (D < 0): its vertex */
#define SYSID_DECREASING 16u /* root where the fitted flow falls with duty, or is flat */
#define SYSID_INVALID 32u   /* an input is not finite; the result is NaN */

/* The hull of the data: ranges, and limits at pressure nodes (linear between them). */
typedef struct {
    double duty_range[2], pressure_range_pa[2];
    int nodes;
    const double *pressure_pa, *duty_low, *duty_high, *flow_low_kg_s, *flow_high_kg_s;
} sysid_domain;

/* Sum of c[i][j] Ti(scaled duty) Tj(scaled pressure), Chebyshev polynomials, kg/s. It is
   (3.7.1) in a form that loses no digits; `thesis` holds the same in powers u^i P^j. */
typedef struct {
    double c[3][3];
    double duty_power[3][3]; /* row i: Ti(scaled duty) in powers of the duty */
    double pressure_centre_pa, pressure_half_range_pa;
    double thesis[3][3]; /* kg/(s Pa^j) */
    const sysid_domain *domain;
} sysid_bipolynomial;

/* duty = centre + half (w2 tanh(w1 x + b1) + b2), x the scaled flow and pressure (3.7.4). */
typedef struct {
    int hidden;
    const double *w1, *b1, *w2; /* w1: hidden rows of 2 */
    double b2;
    double flow_scaling_kg_s[2], pressure_scaling_pa[2], duty_scaling[2]; /* centre, half */
    const sysid_domain *domain;
} sysid_network;

static inline double sysid_clip(double x, double low, double high)
{
    double y = x < low ? low : x;
    return y > high ? high : y;
}

/* Linear interpolation over rising nodes; beyond them the nearest value. */
static inline double sysid_interpolate(double x, const double *nodes, const double *values, int count)
{
    int low = 0, high = count - 1;
    double slope;
    if (x <= nodes[0]) {
        return values[0];
    }
    if (x >= nodes[high]) {
        return values[high];
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
    return slope * (x - nodes[low]) + values[low];
}

/* Pressure moved into the range; sets the flag where it was moved. */
static inline double sysid_clip_pressure(const sysid_domain *d, double pressure_pa, unsigned *flags)
{
    double p = sysid_clip(pressure_pa, d->pressure_range_pa[0], d->pressure_range_pa[1]);
    if (p != pressure_pa) {
        *flags |= SYSID_PRESSURE;
    }
    return p;
}

/* C21, C11 and C01 + flow of (3.7.2) at a pressure: q[2], q[1], q[0], kg/s. */
static inline void sysid_quadratic(const sysid_bipolynomial *s, double pressure_pa, double q[3])
{
    double b = (pressure_pa - s->pressure_centre_pa) / s->pressure_half_range_pa;
    double second = 2.0 * b * b - 1.0;
    int i, k;
    q[0] = q[1] = q[2] = 0.0;
    for (i = 0; i < 3; i++) {
        double along_pressure = s->c[i][0] + s->c[i][1] * b + s->c[i][2] * second;
        for (k = 0; k < 3; k++) {
            q[k] += s->duty_power[i][k] * along_pressure;
        }
    }
}

/* Whether the parabola q falls with the duty on all of [low, high]. */
static inline int sysid_falls(const double q[3], double low, double high)
{
    double at_low = 2.0 * q[2] * low + q[1], at_high = 2.0 * q[2] * high + q[1];
    return at_low <= 0.0 && at_high <= 0.0 && (at_low < 0.0 || at_high < 0.0);
}

/* Root of a u^2 + b u + c where the slope is +sqrt(D); the vertex where D < 0. For b >= 0
   in the form that loses no digits and becomes the linear solution as a vanishes. */
static inline double sysid_rising_root(double a, double b, double c)
{
    double discriminant = b * b - 4.0 * a * c;
    double root = discriminant > 0.0 ? sqrt(discriminant) : 0.0;
    return b >= 0.0 ? -2.0 * c / (b + root) : (root - b) / (2.0 * a);
}

/* Duty in [low, high] at which q[2] u^2 + q[1] u + q[0] = flow, on the stretch where the
   parabola rises (3.7.2, 3.7.3). A flow beyond the stretch gives its nearer end: an edge, or
   the vertex where D < 0. If the parabola falls throughout, the falling root, flagged. */
static inline double sysid_invert_quadratic(const double q[3], double flow, double low, double high,
                                         unsigned *flags)
{
    int falling = sysid_falls(q, low, high);
    double b = falling ? -q[1] : q[1]; /* mirrored in u, a falling parabola rises */
    double left = falling ? -high : low, right = falling ? -low : high;
    double vertex = -b / (2.0 * q[2]);
    int inner = isfinite(vertex) && vertex > left && vertex < right;
    double start = inner && q[2] > 0.0 ? vertex : left;
    double stop = inner && q[2] < 0.0 ? vertex : right;
    int below = flow < (q[2] * start + b) * start + q[0];
    int above = flow > (q[2] * stop + b) * stop + q[0];
    double u = sysid_rising_root(q[2], b, q[0] - flow);
    if (below) {
        u = start;
    } else if (above) {
        u = stop;
    } else if (isnan(u)) {
        u = start; /* flat everywhere: any duty gives the same flow */
    } else {
        u = sysid_clip(u, start, stop);
    }
    if (below) {
        *flags |= SYSID_BELOW;
    }
    if (above) {
        *flags |= SYSID_ABOVE;
    }
    if (inner && ((below && q[2] > 0.0) || (above && q[2] < 0.0))) {
        *flags |= SYSID_NO_ROOT;
    }
    if (falling || (q[2] == 0.0 && b == 0.0)) {
        *flags |= SYSID_DECREASING;
    }
    return falling ? -u : u;
}

/* Mean flow, kg/s, at a duty and a chamber pressure (3.7.1); flags may be NULL. */
static inline double sysid_bipolynomial_flow(const sysid_bipolynomial *s, double duty,
                                          double pressure_pa, unsigned *flags)
{
    const sysid_domain *d = s->domain;
    unsigned found = 0u;
    double q[3], p, u, flow = (double)NAN;
    if (!isfinite(duty) || !isfinite(pressure_pa)) {
        found = SYSID_INVALID;
    } else {
        p = sysid_clip_pressure(d, pressure_pa, &found);
        if (duty > sysid_interpolate(p, d->pressure_pa, d->duty_high, d->nodes)) {
            found |= SYSID_ABOVE;
        }
        if (duty < sysid_interpolate(p, d->pressure_pa, d->duty_low, d->nodes)) {
            found |= SYSID_BELOW;
        }
        sysid_quadratic(s, p, q);
        u = sysid_clip(duty, d->duty_range[0], d->duty_range[1]);
        flow = (q[2] * u + q[1]) * u + q[0];
    }
    if (flags) {
        *flags = found;
    }
    return flow;
}

/* Duty for a wanted mean flow (3.7.2, 3.7.3), saturated at the duties seen at this pressure. */
static inline double sysid_bipolynomial_duty(const sysid_bipolynomial *s, double flow_kg_s,
                                          double pressure_pa, unsigned *flags)
{
    const sysid_domain *d = s->domain;
    unsigned found = 0u;
    double q[3], p, low, high, duty = (double)NAN;
    if (!isfinite(flow_kg_s) || !isfinite(pressure_pa)) {
        found = SYSID_INVALID;
    } else {
        p = sysid_clip_pressure(d, pressure_pa, &found);
        low = sysid_interpolate(p, d->pressure_pa, d->duty_low, d->nodes);
        high = sysid_interpolate(p, d->pressure_pa, d->duty_high, d->nodes);
        sysid_quadratic(s, p, q);
        duty = sysid_invert_quadratic(q, flow_kg_s, low, high, &found);
    }
    if (flags) {
        *flags = found;
    }
    return duty;
}

/* Duty for a wanted mean flow by the network (3.7.4); flow, pressure and duty saturated. */
static inline double sysid_network_duty(const sysid_network *s, double flow_kg_s, double pressure_pa,
                                     unsigned *flags)
{
    const sysid_domain *d = s->domain;
    unsigned found = 0u;
    double p, low, high, m, x, y, sum = 0.0, u, duty = (double)NAN;
    int i;
    if (!isfinite(flow_kg_s) || !isfinite(pressure_pa)) {
        found = SYSID_INVALID;
    } else {
        p = sysid_clip_pressure(d, pressure_pa, &found);
        low = sysid_interpolate(p, d->pressure_pa, d->flow_low_kg_s, d->nodes);
        high = sysid_interpolate(p, d->pressure_pa, d->flow_high_kg_s, d->nodes);
        m = sysid_clip(flow_kg_s, low, high);
        x = (m - s->flow_scaling_kg_s[0]) / s->flow_scaling_kg_s[1];
        y = (p - s->pressure_scaling_pa[0]) / s->pressure_scaling_pa[1];
        for (i = 0; i < s->hidden; i++) {
            sum += s->w2[i] * tanh(s->w1[2 * i] * x + s->w1[2 * i + 1] * y + s->b1[i]);
        }
        u = s->duty_scaling[0] + s->duty_scaling[1] * (sum + s->b2);
        if (flow_kg_s > high || u > d->duty_range[1]) {
            found |= SYSID_ABOVE;
        }
        if (flow_kg_s < low || u < d->duty_range[0]) {
            found |= SYSID_BELOW;
        }
        duty = sysid_clip(u, d->duty_range[0], d->duty_range[1]);
    }
    if (flags) {
        *flags = found;
    }
    return duty;
}

static const double sysid_pwm_a_fill_bipolynomial_pressure_pa[25] = {
    104744.06637069919, 113378.77604088046, 122013.48571106172, 130648.19538124299,
    139282.90505142426, 147917.6147216055, 156552.32439178677, 165187.03406196804,
    173821.7437321493, 182456.45340233058, 191091.16307251184, 199725.87274269311,
    208360.58241287438, 216995.29208305562, 225630.0017532369, 234264.71142341814,
    242899.4210935994, 251534.13076378067, 260168.84043396194, 268803.5501041432,
    277438.2597743245, 286072.96944450575, 294707.679114687, 303342.3887848683,
    311977.09845504956
};
static const double sysid_pwm_a_fill_bipolynomial_duty_low[25] = {
    0.02, 0.02, 0.02, 0.02,
    0.06, 0.09999999999999999, 0.14000000000000004, 0.18,
    0.2599999999999999, 0.29999999999999993, 0.3399999999999999, 0.37999999999999995,
    0.37999999999999995, 0.42, 0.42, 0.42,
    0.46000000000000013, 0.46000000000000013, 0.5, 0.5,
    0.5399999999999997, 0.5399999999999997, 0.58, 0.6199999999999997,
    0.66
};
static const double sysid_pwm_a_fill_bipolynomial_duty_high[25] = {
    0.66, 0.8200000000000002, 0.9, 0.9,
    0.9, 0.9, 0.9, 0.9,
    0.9, 0.9, 0.9, 0.9,
    0.9, 0.9, 0.9, 0.9,
    0.9, 0.9, 0.9, 0.9,
    0.9, 0.9, 0.9, 0.9,
    0.9
};
static const double sysid_pwm_a_fill_bipolynomial_flow_low_kg_s[25] = {
    3.18317802843003e-05, 1.1658913546790986e-05, 1.8228548968747756e-06, 1.8228548968747756e-06,
    6.75169307595436e-07, 6.75169307595436e-07, 1.2852827079503678e-06, 4.4683173311523113e-07,
    4.4683173311523113e-07, 8.055582835720741e-07, 6.162241365307918e-06, 4.721196223944483e-06,
    4.721196223944483e-06, 1.2347931263943133e-05, 8.86322961734822e-06, 8.86322961734822e-06,
    1.3607386625351516e-05, 1.3607386625351516e-05, 1.205786685581445e-05, 1.205786685581445e-05,
    6.141412977509583e-06, 6.141412977509583e-06, 3.920142720845734e-06, 3.1139151717965583e-07,
    3.1139151717965583e-07
};
static const double sysid_pwm_a_fill_bipolynomial_flow_high_kg_s[25] = {
    0.00047605149311621633, 0.000590419195702579, 0.0006455063430717632, 0.0006455063430717632,
    0.0006425866526091067, 0.0006396669621464502, 0.0006377205018380125, 0.0005851209038943469,
    0.0005106470531310656, 0.00046099781928887794, 0.0004223692562658295, 0.0004010653836328728,
    0.0003911300025507021, 0.0003780739615749205, 0.0003571718242167785, 0.00034422060494497585,
    0.0003221854763690725, 0.00029761218115898803, 0.00028435033010313905, 0.0002599743903938061,
    0.00023639653166381285, 0.00021569527309981315, 0.0001789401133658255, 0.00013990730893251253,
    0.00010072860897209889
};
static const sysid_domain sysid_pwm_a_fill_bipolynomial_domain = {
    {0.02, 0.9}, {104744.06637069919, 311977.09845504956}, 25,
    sysid_pwm_a_fill_bipolynomial_pressure_pa,
    sysid_pwm_a_fill_bipolynomial_duty_low,
    sysid_pwm_a_fill_bipolynomial_duty_high,
    sysid_pwm_a_fill_bipolynomial_flow_low_kg_s,
    sysid_pwm_a_fill_bipolynomial_flow_high_kg_s
};
static const sysid_bipolynomial sysid_pwm_a_fill_bipolynomial = {
    {{0.00010490286434363598, -0.00025911976614695917, 1.785145903239601e-05},
     {0.0003003217578070874, -3.0540508662570556e-05, -4.225826263009199e-06},
     {-1.0139488064052776e-05, -2.3500239863059165e-05, -2.8799444856436254e-05}},
    {{1.0, 0.0, 0.0},
     {-1.0454545454545454, 2.272727272727273, 0.0},
     {1.1859504132231402, -9.50413223140496, 10.330578512396697}},
    208274.5318548868, 103530.46548418759,
    {{0.00020770214091046451, -1.5398474395208329e-09, -2.2177136169556876e-15},
     {0.002342840840045325, -1.904097739603394e-08, 4.928080795324652e-14},
     {-0.001726945220930677, 2.077937541596738e-08, -5.551398725356103e-14}},
    &sysid_pwm_a_fill_bipolynomial_domain
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa (3.7.1); flags may be NULL. */
static inline double sysid_pwm_a_fill_flow(double duty, double pressure_pa, unsigned *flags)
{
    return sysid_bipolynomial_flow(&sysid_pwm_a_fill_bipolynomial, duty, pressure_pa, flags);
}

/* Its inverse: duty for a wanted mean flow, kg/s, at a chamber pressure, Pa (3.7.3). */
static inline double sysid_pwm_a_fill_duty(double flow_kg_s, double pressure_pa, unsigned *flags)
{
    return sysid_bipolynomial_duty(&sysid_pwm_a_fill_bipolynomial, flow_kg_s, pressure_pa, flags);
}

static const double sysid_pwm_a_fill_network_pressure_pa[25] = {
    104744.06637069919, 113378.77604088046, 122013.48571106172, 130648.19538124299,
    139282.90505142426, 147917.6147216055, 156552.32439178677, 165187.03406196804,
    173821.7437321493, 182456.45340233058, 191091.16307251184, 199725.87274269311,
    208360.58241287438, 216995.29208305562, 225630.0017532369, 234264.71142341814,
    242899.4210935994, 251534.13076378067, 260168.84043396194, 268803.5501041432,
    277438.2597743245, 286072.96944450575, 294707.679114687, 303342.3887848683,
    311977.09845504956
};
static const double sysid_pwm_a_fill_network_duty_low[25] = {
    0.02, 0.02, 0.02, 0.02,
    0.06, 0.09999999999999999, 0.14000000000000004, 0.18,
    0.2599999999999999, 0.29999999999999993, 0.3399999999999999, 0.37999999999999995,
    0.37999999999999995, 0.42, 0.42, 0.42,
    0.46000000000000013, 0.46000000000000013, 0.5, 0.5,
    0.5399999999999997, 0.5399999999999997, 0.58, 0.6199999999999997,
    0.66
};
static const double sysid_pwm_a_fill_network_duty_high[25] = {
    0.66, 0.8200000000000002, 0.9, 0.9,
    0.9, 0.9, 0.9, 0.9,
    0.9, 0.9, 0.9, 0.9,
    0.9, 0.9, 0.9, 0.9,
    0.9, 0.9, 0.9, 0.9,
    0.9, 0.9, 0.9, 0.9,
    0.9
};
static const double sysid_pwm_a_fill_network_flow_low_kg_s[25] = {
    3.18317802843003e-05, 1.1658913546790986e-05, 1.8228548968747756e-06, 1.8228548968747756e-06,
    6.75169307595436e-07, 6.75169307595436e-07, 1.2852827079503678e-06, 4.4683173311523113e-07,
    4.4683173311523113e-07, 8.055582835720741e-07, 6.162241365307918e-06, 4.721196223944483e-06,
    4.721196223944483e-06, 1.2347931263943133e-05, 8.86322961734822e-06, 8.86322961734822e-06,
    1.3607386625351516e-05, 1.3607386625351516e-05, 1.205786685581445e-05, 1.205786685581445e-05,
    6.141412977509583e-06, 6.141412977509583e-06, 3.920142720845734e-06, 3.1139151717965583e-07,
    3.1139151717965583e-07
};
static const double sysid_pwm_a_fill_network_flow_high_kg_s[25] = {
    0.00047605149311621633, 0.000590419195702579, 0.0006455063430717632, 0.0006455063430717632,
    0.0006425866526091067, 0.0006396669621464502, 0.0006377205018380125, 0.0005851209038943469,
    0.0005106470531310656, 0.00046099781928887794, 0.0004223692562658295, 0.0004010653836328728,
    0.0003911300025507021, 0.0003780739615749205, 0.0003571718242167785, 0.00034422060494497585,
    0.0003221854763690725, 0.00029761218115898803, 0.00028435033010313905, 0.0002599743903938061,
    0.00023639653166381285, 0.00021569527309981315, 0.0001789401133658255, 0.00013990730893251253,
    0.00010072860897209889
};
static const sysid_domain sysid_pwm_a_fill_network_domain = {
    {0.02, 0.9}, {104744.06637069919, 311977.09845504956}, 25,
    sysid_pwm_a_fill_network_pressure_pa,
    sysid_pwm_a_fill_network_duty_low,
    sysid_pwm_a_fill_network_duty_high,
    sysid_pwm_a_fill_network_flow_low_kg_s,
    sysid_pwm_a_fill_network_flow_high_kg_s
};
static const double sysid_pwm_a_fill_network_w1[20] = {
    0.470947355611833, 18.541771116503863, -0.3804042316432098, -1.5734286202245131,
    -5.804448118662301, -24.399608562698724, 0.42893578360682305, 17.509462482321478,
    -0.09561843531436495, 0.0025263537201096137, 0.016676949454351192, 5.478807028323046,
    0.14114620674902376, -3.9148492239660095, 0.0499969452805037, -4.781409288631005,
    6.594979452392631, 27.10520740474535, 0.5053217974782912, 3.8265824694813206
};
static const double sysid_pwm_a_fill_network_b1[10] = {
    8.789518711723254, 1.8944041453861302, 19.50953837759331, 8.245473377773804,
    -0.10474426260955369, 1.597489759905185, -1.2003979736549657, -1.4393285297801175,
    -21.03274218735849, 4.9034742623209855
};
static const double sysid_pwm_a_fill_network_w2[10] = {
    -4.343320213184484, -1.9310346559793419, -11.958108655334893, 4.814124520697032,
    -10.664748023420284, 7.695929796223134, -5.851058523527893, 13.552261469116127,
    -5.747379311825178, 0.39713177204152267
};
static const sysid_network sysid_pwm_a_fill_network = {
    10, sysid_pwm_a_fill_network_w1, sysid_pwm_a_fill_network_b1, sysid_pwm_a_fill_network_w2,
    7.036683879388958,
    {0.0003228513284479683, 0.0003228138518838768}, {208274.5318548868, 103530.46548418759}, {0.46, 0.44},
    &sysid_pwm_a_fill_network_domain
};

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa, by the network (3.7.4). */
static inline double sysid_pwm_a_fill_network_duty(double flow_kg_s, double pressure_pa, unsigned *flags)
{
    return sysid_network_duty(&sysid_pwm_a_fill_network, flow_kg_s, pressure_pa, flags);
}

static const double sysid_pwm_a_discharge_bipolynomial_pressure_pa[25] = {
    123712.22359142273, 131437.39869638308, 139162.57380134345, 146887.7489063038,
    154612.92401126417, 162338.09911622453, 170063.2742211849, 177788.44932614526,
    185513.62443110562, 193238.79953606596, 200963.97464102635, 208689.14974598668,
    216414.32485094707, 224139.4999559074, 231864.67506086777, 239589.85016582813,
    247315.0252707885, 255040.20037574886, 262765.3754807092, 270490.5505856696,
    278215.7256906299, 285940.9007955903, 293666.07590055064, 301391.25100551103,
    309116.42611047137
};
static const double sysid_pwm_a_discharge_bipolynomial_duty_low[25] = {
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.060000000000000026
};
static const double sysid_pwm_a_discharge_bipolynomial_duty_high[25] = {
    0.02, 0.060000000000000026, 0.10000000000000003, 0.10000000000000003,
    0.14000000000000007, 0.22000000000000006, 0.2599999999999999, 0.29999999999999993,
    0.3399999999999999, 0.3399999999999999, 0.3399999999999999, 0.3399999999999999,
    0.37999999999999995, 0.37999999999999995, 0.37999999999999995, 0.42,
    0.42, 0.4600000000000001, 0.4600000000000001, 0.5,
    0.54, 0.58, 0.62, 0.74,
    0.74
};
static const double sysid_pwm_a_discharge_bipolynomial_flow_low_kg_s[25] = {
    -2.4025211287139824e-05, -4.211280025840134e-05, -6.742782333162733e-05, -9.60705401612551e-05,
    -0.00011377034555466193, -0.0001566775648015729, -0.0001878308974355373, -0.00020613161086076035,
    -0.00024133094176894578, -0.0002653371554492664, -0.0002673601779260847, -0.00027009879169995584,
    -0.0002701176969692777, -0.0002701303004821589, -0.00027212925675242615, -0.0002744245606176119,
    -0.00027594459217010427, -0.00027822327338515015, -0.0002813982566969767, -0.00028380645008094436,
    -0.0002877759784756406, -0.00029240576091395357, -0.0002954922825394955, -0.0002954922825394955,
    -0.000276413222288717
};
static const double sysid_pwm_a_discharge_bipolynomial_flow_high_kg_s[25] = {
    -6.33325327789406e-06, -2.426124046737104e-06, -2.426124046737104e-06, -4.080402746735579e-06,
    -2.6523540817084613e-06, -2.6523540817084613e-06, -3.4475881766471888e-06, -1.460240069587481e-06,
    -1.460240069587481e-06, -1.7371978223664413e-06, -2.088052158501918e-05, -2.7957919586422665e-05,
    -1.1106104337203433e-05, -1.1106104337203433e-05, -1.948213978535562e-05, -7.2288208979199456e-06,
    -7.2288208979199456e-06, -4.170933395977564e-06, -4.170933395977564e-06, -2.554682634737737e-06,
    -2.554682634737737e-06, -1.4117430372945917e-07, -1.4117430372945917e-07, 3.2964378397928136e-08,
    3.2964378397928136e-08
};
static const sysid_domain sysid_pwm_a_discharge_bipolynomial_domain = {
    {0.02, 0.74}, {123712.22359142273, 309116.42611047137}, 25,
    sysid_pwm_a_discharge_bipolynomial_pressure_pa,
    sysid_pwm_a_discharge_bipolynomial_duty_low,
    sysid_pwm_a_discharge_bipolynomial_duty_high,
    sysid_pwm_a_discharge_bipolynomial_flow_low_kg_s,
    sysid_pwm_a_discharge_bipolynomial_flow_high_kg_s
};
static const sysid_bipolynomial sysid_pwm_a_discharge_bipolynomial = {
    {{-9.085359728543868e-05, 1.4695495105590119e-05, -5.732340979234955e-05},
     {5.5755990732122213e-05, 0.00022737428088959817, -0.00015918012911709481},
     {-4.678898923970586e-05, 7.830632634281106e-05, -2.7370716498229027e-05}},
    {{1.0, 0.0, 0.0},
     {-1.0555555555555556, 2.7777777777777777, 0.0},
     {1.2283950617283952, -11.728395061728396, 15.432098765432098}},
    216570.90263255802, 92000.19607774711,
    {{0.0008739368597235237, -9.292309311898187e-09, 1.821306198022239e-14},
     {0.00015723545306377436, 9.282284701915618e-09, -2.862758333968987e-14},
     {-0.007825615115175294, 5.636593895120321e-08, -9.980760865659191e-14}},
    &sysid_pwm_a_discharge_bipolynomial_domain
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa (3.7.1); flags may be NULL. */
static inline double sysid_pwm_a_discharge_flow(double duty, double pressure_pa, unsigned *flags)
{
    return sysid_bipolynomial_flow(&sysid_pwm_a_discharge_bipolynomial, duty, pressure_pa, flags);
}

/* Its inverse: duty for a wanted mean flow, kg/s, at a chamber pressure, Pa (3.7.3). */
static inline double sysid_pwm_a_discharge_duty(double flow_kg_s, double pressure_pa, unsigned *flags)
{
    return sysid_bipolynomial_duty(&sysid_pwm_a_discharge_bipolynomial, flow_kg_s, pressure_pa, flags);
}

static const double sysid_pwm_a_discharge_network_pressure_pa[25] = {
    123712.22359142273, 131437.39869638308, 139162.57380134345, 146887.7489063038,
    154612.92401126417, 162338.09911622453, 170063.2742211849, 177788.44932614526,
    185513.62443110562, 193238.79953606596, 200963.97464102635, 208689.14974598668,
    216414.32485094707, 224139.4999559074, 231864.67506086777, 239589.85016582813,
    247315.0252707885, 255040.20037574886, 262765.3754807092, 270490.5505856696,
    278215.7256906299, 285940.9007955903, 293666.07590055064, 301391.25100551103,
    309116.42611047137
};
static const double sysid_pwm_a_discharge_network_duty_low[25] = {
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.060000000000000026
};
static const double sysid_pwm_a_discharge_network_duty_high[25] = {
    0.02, 0.060000000000000026, 0.10000000000000003, 0.10000000000000003,
    0.14000000000000007, 0.22000000000000006, 0.2599999999999999, 0.29999999999999993,
    0.3399999999999999, 0.3399999999999999, 0.3399999999999999, 0.3399999999999999,
    0.37999999999999995, 0.37999999999999995, 0.37999999999999995, 0.42,
    0.42, 0.4600000000000001, 0.4600000000000001, 0.5,
    0.54, 0.58, 0.62, 0.74,
    0.74
};
static const double sysid_pwm_a_discharge_network_flow_low_kg_s[25] = {
    -2.4025211287139824e-05, -4.211280025840134e-05, -6.742782333162733e-05, -9.60705401612551e-05,
    -0.00011377034555466193, -0.0001566775648015729, -0.0001878308974355373, -0.00020613161086076035,
    -0.00024133094176894578, -0.0002653371554492664, -0.0002673601779260847, -0.00027009879169995584,
    -0.0002701176969692777, -0.0002701303004821589, -0.00027212925675242615, -0.0002744245606176119,
    -0.00027594459217010427, -0.00027822327338515015, -0.0002813982566969767, -0.00028380645008094436,
    -0.0002877759784756406, -0.00029240576091395357, -0.0002954922825394955, -0.0002954922825394955,
    -0.000276413222288717
};
static const double sysid_pwm_a_discharge_network_flow_high_kg_s[25] = {
    -6.33325327789406e-06, -2.426124046737104e-06, -2.426124046737104e-06, -4.080402746735579e-06,
    -2.6523540817084613e-06, -2.6523540817084613e-06, -3.4475881766471888e-06, -1.460240069587481e-06,
    -1.460240069587481e-06, -1.7371978223664413e-06, -2.088052158501918e-05, -2.7957919586422665e-05,
    -1.1106104337203433e-05, -1.1106104337203433e-05, -1.948213978535562e-05, -7.2288208979199456e-06,
    -7.2288208979199456e-06, -4.170933395977564e-06, -4.170933395977564e-06, -2.554682634737737e-06,
    -2.554682634737737e-06, -1.4117430372945917e-07, -1.4117430372945917e-07, 3.2964378397928136e-08,
    3.2964378397928136e-08
};
static const sysid_domain sysid_pwm_a_discharge_network_domain = {
    {0.02, 0.74}, {123712.22359142273, 309116.42611047137}, 25,
    sysid_pwm_a_discharge_network_pressure_pa,
    sysid_pwm_a_discharge_network_duty_low,
    sysid_pwm_a_discharge_network_duty_high,
    sysid_pwm_a_discharge_network_flow_low_kg_s,
    sysid_pwm_a_discharge_network_flow_high_kg_s
};
static const double sysid_pwm_a_discharge_network_w1[20] = {
    0.7313879168146602, 9.40828659548611, 1.233755231611696, 4.870563959426811,
    0.08981988488621742, 3.8212375931343328, 0.5444134423922969, 11.803865710398236,
    0.2616612647434948, 0.5899384666169131, -2.3939791239016937, 0.8392184044023436,
    -2.358825112544839, 0.9103459483472968, -5.726302830441622, 0.013299174473703483,
    -0.23516822334032342, -0.8313035687830804, 5.430857700356015, 0.7916777662594674
};
static const double sysid_pwm_a_discharge_network_b1[10] = {
    -10.544751649063876, -5.2047013306393675, 1.7247062635494446, 1.4662390178650575,
    -0.46204096210570433, -0.18687897542882526, -0.24184470070997174, -1.9051288871099077,
    0.38136870008498386, 3.6998235736266056
};
static const double sysid_pwm_a_discharge_network_w2[10] = {
    0.41284496933676074, 0.06262806626352932, 0.3392969386916422, -0.05450382699166957,
    5.3186735907008105, -0.7439625656489515, 0.7258503031509304, -0.030245744209667375,
    3.287177391069977, 0.048579098252880454
};
static const sysid_network sysid_pwm_a_discharge_network = {
    10, sysid_pwm_a_discharge_network_w1, sysid_pwm_a_discharge_network_b1, sysid_pwm_a_discharge_network_w2,
    0.716671384075675,
    {-0.00014794826769088437, 0.00014781804889360368}, {216570.90263255802, 92000.19607774711}, {0.38, 0.36},
    &sysid_pwm_a_discharge_network_domain
};

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa, by the network (3.7.4). */
static inline double sysid_pwm_a_discharge_network_duty(double flow_kg_s, double pressure_pa, unsigned *flags)
{
    return sysid_network_duty(&sysid_pwm_a_discharge_network, flow_kg_s, pressure_pa, flags);
}

static const double sysid_pwm_b_fill_bipolynomial_pressure_pa[25] = {
    105538.83443826473, 114141.36062361559, 122743.88680896646, 131346.4129943173,
    139948.93917966817, 148551.46536501904, 157153.9915503699, 165756.51773572076,
    174359.04392107163, 182961.57010642247, 191564.09629177337, 200166.6224771242,
    208769.14866247505, 217371.67484782595, 225974.2010331768, 234576.72721852767,
    243179.25340387854, 251781.77958922938, 260384.30577458022, 268986.8319599311,
    277589.35814528196, 286191.8843306328, 294794.4105159837, 303396.93670133455,
    311999.4628866854
};
static const double sysid_pwm_b_fill_bipolynomial_duty_low[25] = {
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.06000000000000001, 0.06000000000000001, 0.1,
    0.22000000000000006, 0.2599999999999999, 0.29999999999999993, 0.37999999999999995,
    0.37999999999999995, 0.37999999999999995, 0.42, 0.42,
    0.42, 0.4600000000000002, 0.4600000000000002, 0.4600000000000002,
    0.5, 0.5399999999999997, 0.5399999999999997, 0.6199999999999997,
    0.66
};
static const double sysid_pwm_b_fill_bipolynomial_duty_high[25] = {
    0.42, 0.6999999999999997, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999, 0.8999999999999999, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999, 0.8999999999999999, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999, 0.8999999999999999, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999, 0.8999999999999999, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999, 0.8999999999999999, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999
};
static const double sysid_pwm_b_fill_bipolynomial_flow_low_kg_s[25] = {
    7.540459674049476e-05, 5.183978526702637e-05, 2.0290030798815416e-05, 1.2253860536427687e-06,
    1.2253860536427687e-06, 6.013324165631573e-07, 6.013324165631573e-07, 2.467003542888902e-06,
    3.82846648973845e-07, 2.501949468845468e-07, 2.501949468845468e-07, 1.3802877703528539e-05,
    6.122658873023425e-06, 6.122658873023425e-06, 1.7025215448535213e-05, 7.687872324302064e-06,
    7.687872324302064e-06, 7.962411108829694e-06, 3.1029767090739937e-06, 3.1029767090739937e-06,
    4.201355153657115e-06, 1.2751066013439652e-06, 4.1365519547376014e-07, 8.403814134233772e-09,
    8.403814134233772e-09
};
static const double sysid_pwm_b_fill_bipolynomial_flow_high_kg_s[25] = {
    0.0005363346907642722, 0.0008521270005267876, 0.0011043495301127247, 0.0011043495301127247,
    0.0010969802608662954, 0.00108580619373525, 0.0010783568156478862, 0.0009729501233765467,
    0.0007667896416377097, 0.0006293493204784853, 0.000548236661178386, 0.0005188208053631305,
    0.000511514726499075, 0.0004947270140717614, 0.0004652020676343406, 0.00044678789900792835,
    0.00041278816713821574, 0.00039157187878811347, 0.0003726311666328848, 0.0003544387727584697,
    0.0003078376054030566, 0.00027671553308184903, 0.00023300219708008782, 0.00018535082205580315,
    0.00012445067399892526
};
static const sysid_domain sysid_pwm_b_fill_bipolynomial_domain = {
    {0.02, 0.8999999999999999}, {105538.83443826473, 311999.4628866854}, 25,
    sysid_pwm_b_fill_bipolynomial_pressure_pa,
    sysid_pwm_b_fill_bipolynomial_duty_low,
    sysid_pwm_b_fill_bipolynomial_duty_high,
    sysid_pwm_b_fill_bipolynomial_flow_low_kg_s,
    sysid_pwm_b_fill_bipolynomial_flow_high_kg_s
};
static const sysid_bipolynomial sysid_pwm_b_fill_bipolynomial = {
    {{0.0002264887374753348, -0.0003924704327178298, 7.674380666883434e-05},
     {0.0003939508677108261, -0.00015005412683144018, 3.875470768876717e-05},
     {-3.191359623626545e-06, -1.5811840414447278e-05, -4.696197376343126e-05}},
    {{1.0, 0.0, 0.0},
     {-1.0454545454545454, 2.272727272727273, 0.0},
     {1.1859504132231402, -9.50413223140496, 10.330578512396697}},
    208659.03613224928, 103120.20169398456,
    {{0.00018556376781360607, -9.385644560877998e-10, -3.661361841251897e-15},
     {0.00515340127213774, -4.379534913940173e-08, 1.0051212095054785e-13},
     {-0.0031900213014652945, 3.649454334484006e-08, -9.124592377693353e-14}},
    &sysid_pwm_b_fill_bipolynomial_domain
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa (3.7.1); flags may be NULL. */
static inline double sysid_pwm_b_fill_flow(double duty, double pressure_pa, unsigned *flags)
{
    return sysid_bipolynomial_flow(&sysid_pwm_b_fill_bipolynomial, duty, pressure_pa, flags);
}

/* Its inverse: duty for a wanted mean flow, kg/s, at a chamber pressure, Pa (3.7.3). */
static inline double sysid_pwm_b_fill_duty(double flow_kg_s, double pressure_pa, unsigned *flags)
{
    return sysid_bipolynomial_duty(&sysid_pwm_b_fill_bipolynomial, flow_kg_s, pressure_pa, flags);
}

static const double sysid_pwm_b_fill_network_pressure_pa[25] = {
    105538.83443826473, 114141.36062361559, 122743.88680896646, 131346.4129943173,
    139948.93917966817, 148551.46536501904, 157153.9915503699, 165756.51773572076,
    174359.04392107163, 182961.57010642247, 191564.09629177337, 200166.6224771242,
    208769.14866247505, 217371.67484782595, 225974.2010331768, 234576.72721852767,
    243179.25340387854, 251781.77958922938, 260384.30577458022, 268986.8319599311,
    277589.35814528196, 286191.8843306328, 294794.4105159837, 303396.93670133455,
    311999.4628866854
};
static const double sysid_pwm_b_fill_network_duty_low[25] = {
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.06000000000000001, 0.06000000000000001, 0.1,
    0.22000000000000006, 0.2599999999999999, 0.29999999999999993, 0.37999999999999995,
    0.37999999999999995, 0.37999999999999995, 0.42, 0.42,
    0.42, 0.4600000000000002, 0.4600000000000002, 0.4600000000000002,
    0.5, 0.5399999999999997, 0.5399999999999997, 0.6199999999999997,
    0.66
};
static const double sysid_pwm_b_fill_network_duty_high[25] = {
    0.42, 0.6999999999999997, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999, 0.8999999999999999, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999, 0.8999999999999999, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999, 0.8999999999999999, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999, 0.8999999999999999, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999, 0.8999999999999999, 0.8999999999999999, 0.8999999999999999,
    0.8999999999999999
};
static const double sysid_pwm_b_fill_network_flow_low_kg_s[25] = {
    7.540459674049476e-05, 5.183978526702637e-05, 2.0290030798815416e-05, 1.2253860536427687e-06,
    1.2253860536427687e-06, 6.013324165631573e-07, 6.013324165631573e-07, 2.467003542888902e-06,
    3.82846648973845e-07, 2.501949468845468e-07, 2.501949468845468e-07, 1.3802877703528539e-05,
    6.122658873023425e-06, 6.122658873023425e-06, 1.7025215448535213e-05, 7.687872324302064e-06,
    7.687872324302064e-06, 7.962411108829694e-06, 3.1029767090739937e-06, 3.1029767090739937e-06,
    4.201355153657115e-06, 1.2751066013439652e-06, 4.1365519547376014e-07, 8.403814134233772e-09,
    8.403814134233772e-09
};
static const double sysid_pwm_b_fill_network_flow_high_kg_s[25] = {
    0.0005363346907642722, 0.0008521270005267876, 0.0011043495301127247, 0.0011043495301127247,
    0.0010969802608662954, 0.00108580619373525, 0.0010783568156478862, 0.0009729501233765467,
    0.0007667896416377097, 0.0006293493204784853, 0.000548236661178386, 0.0005188208053631305,
    0.000511514726499075, 0.0004947270140717614, 0.0004652020676343406, 0.00044678789900792835,
    0.00041278816713821574, 0.00039157187878811347, 0.0003726311666328848, 0.0003544387727584697,
    0.0003078376054030566, 0.00027671553308184903, 0.00023300219708008782, 0.00018535082205580315,
    0.00012445067399892526
};
static const sysid_domain sysid_pwm_b_fill_network_domain = {
    {0.02, 0.8999999999999999}, {105538.83443826473, 311999.4628866854}, 25,
    sysid_pwm_b_fill_network_pressure_pa,
    sysid_pwm_b_fill_network_duty_low,
    sysid_pwm_b_fill_network_duty_high,
    sysid_pwm_b_fill_network_flow_low_kg_s,
    sysid_pwm_b_fill_network_flow_high_kg_s
};
static const double sysid_pwm_b_fill_network_w1[20] = {
    -0.6304845663612827, -1.808536055610547, 3.4274348889107595, 17.951609335605635,
    0.3737330771655974, -6.833378762186506, -2.0201825908185604, -7.161529650238918,
    0.19233053448684923, -27.540702256682238, -0.35596585782012713, -0.3125559262690042,
    0.17530188195016075, -6.12068118568076, 0.5351525139315148, -0.3201923373223731,
    0.06261815260240207, 6.466519163884764, -1.2208758462603384, 7.3876337037131075
};
static const double sysid_pwm_b_fill_network_b1[10] = {
    -1.0379906158509755, -16.130706365707873, -2.963442963903213, 4.35661106743212,
    -11.326602520173939, -0.05527699836320029, -2.4126189659939428, 1.2182585304460092,
    2.250672999118026, 5.049482020688875
};
static const double sysid_pwm_b_fill_network_w2[10] = {
    0.44400228370514494, 4.841792432016738, -2.081583201399783, -0.12580384925502536,
    -0.4153975426795375, -3.5025280828133276, 4.136035422644651, 1.14689153510867,
    2.0179079053473266, 0.05808473210669972
};
static const sysid_network sysid_pwm_b_fill_network = {
    10, sysid_pwm_b_fill_network_w1, sysid_pwm_b_fill_network_b1, sysid_pwm_b_fill_network_w2,
    4.851551592134436,
    {0.0005521987190650476, 0.0005521508110476771}, {208659.03613224928, 103120.20169398456}, {0.46, 0.44},
    &sysid_pwm_b_fill_network_domain
};

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa, by the network (3.7.4). */
static inline double sysid_pwm_b_fill_network_duty(double flow_kg_s, double pressure_pa, unsigned *flags)
{
    return sysid_network_duty(&sysid_pwm_b_fill_network, flow_kg_s, pressure_pa, flags);
}

static const double sysid_pwm_b_discharge_bipolynomial_pressure_pa[25] = {
    135896.6743122265, 143119.75003636957, 150342.82576051264, 157565.9014846557,
    164788.97720879878, 172012.05293294185, 179235.12865708492, 186458.204381228,
    193681.28010537106, 200904.35582951413, 208127.43155365717, 215350.50727780024,
    222573.5830019433, 229796.65872608637, 237019.73445022944, 244242.8101743725,
    251465.88589851558, 258688.96162265865, 265912.0373468017, 273135.1130709448,
    280358.18879508786, 287581.2645192309, 294804.340243374, 302027.41596751707,
    309250.49169166014
};
static const double sysid_pwm_b_discharge_bipolynomial_duty_low[25] = {
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.18000000000000005
};
static const double sysid_pwm_b_discharge_bipolynomial_duty_high[25] = {
    0.02, 0.02, 0.06000000000000002, 0.14000000000000007,
    0.22000000000000008, 0.22000000000000008, 0.2599999999999999, 0.29999999999999993,
    0.3399999999999999, 0.3399999999999999, 0.3399999999999999, 0.3399999999999999,
    0.37999999999999995, 0.37999999999999995, 0.37999999999999995, 0.42,
    0.42, 0.4600000000000001, 0.4600000000000001, 0.5,
    0.54, 0.58, 0.62, 0.7400000000000001,
    0.7400000000000001
};
static const double sysid_pwm_b_discharge_bipolynomial_flow_low_kg_s[25] = {
    -2.2999761971492455e-05, -4.121670050799171e-05, -6.878070750047493e-05, -0.00011081013707045007,
    -0.00016598484149064395, -0.0001990088357980812, -0.00024018669706845318, -0.0002753415467299822,
    -0.00031960684046773865, -0.00031960684046773865, -0.0003195225681017383, -0.00032076225490862474,
    -0.0003242012186993891, -0.00032649386122656534, -0.00032997052436935313, -0.00033345765481862993,
    -0.0003357809915829624, -0.00033922971385587694, -0.0003426784361287914, -0.00034501145789222364,
    -0.0003486060356154051, -0.00035220061333858657, -0.0003533988059129804, -0.0003533988059129804,
    -0.00026580251497824564
};
static const double sysid_pwm_b_discharge_bipolynomial_flow_high_kg_s[25] = {
    -4.764869341547063e-06, -4.764869341547063e-06, -1.4788992186970294e-06, -7.709251780510722e-08,
    -7.709251780510722e-08, -1.0410301378310408e-06, -1.1373710044856791e-06, -1.1373710044856791e-06,
    -4.015243037550183e-06, -1.565813914263326e-05, -1.830584270566519e-05, -2.7213579360986905e-05,
    -6.169994205084258e-06, -6.169994205084258e-06, -1.659266299946658e-05, -6.050256846402628e-06,
    -6.050256846402628e-06, -3.0712459562239146e-06, -3.0712459562239146e-06, -3.6966737735542142e-06,
    -6.72451185954192e-07, -6.142713992077936e-07, -2.5480834875775057e-07, -1.4003964768040957e-08,
    -1.4003964768040957e-08
};
static const sysid_domain sysid_pwm_b_discharge_bipolynomial_domain = {
    {0.02, 0.7400000000000001}, {135896.6743122265, 309250.49169166014}, 25,
    sysid_pwm_b_discharge_bipolynomial_pressure_pa,
    sysid_pwm_b_discharge_bipolynomial_duty_low,
    sysid_pwm_b_discharge_bipolynomial_duty_high,
    sysid_pwm_b_discharge_bipolynomial_flow_low_kg_s,
    sysid_pwm_b_discharge_bipolynomial_flow_high_kg_s
};
static const sysid_bipolynomial sysid_pwm_b_discharge_bipolynomial = {
    {{-0.00010050698083848566, 9.347331743820828e-06, -6.625641556621874e-05},
     {8.40537340149588e-05, 0.00025495865090478917, -0.00019151487981159922},
     {-4.823589905855005e-05, 8.214163303573513e-05, -2.4939141746081936e-05}},
    {{1.0, 0.0, 0.0},
     {-1.0555555555555556, 2.7777777777777772, 0.0},
     {1.2283950617283952, -11.728395061728394, 15.432098765432093}},
    222883.0455618224, 86065.55360999223,
    {{0.0014695778578893825, -1.4515305652388284e-08, 2.8421517229714622e-14},
     {-0.0015127548596210703, 2.5859873440881487e-08, -6.466332741128335e-14},
     {-0.008804418478236691, 6.105024692249294e-08, -1.0391488470370535e-13}},
    &sysid_pwm_b_discharge_bipolynomial_domain
};

/* Mean flow, kg/s, over duty (0 to 1) and chamber pressure, Pa (3.7.1); flags may be NULL. */
static inline double sysid_pwm_b_discharge_flow(double duty, double pressure_pa, unsigned *flags)
{
    return sysid_bipolynomial_flow(&sysid_pwm_b_discharge_bipolynomial, duty, pressure_pa, flags);
}

/* Its inverse: duty for a wanted mean flow, kg/s, at a chamber pressure, Pa (3.7.3). */
static inline double sysid_pwm_b_discharge_duty(double flow_kg_s, double pressure_pa, unsigned *flags)
{
    return sysid_bipolynomial_duty(&sysid_pwm_b_discharge_bipolynomial, flow_kg_s, pressure_pa, flags);
}

static const double sysid_pwm_b_discharge_network_pressure_pa[25] = {
    135896.6743122265, 143119.75003636957, 150342.82576051264, 157565.9014846557,
    164788.97720879878, 172012.05293294185, 179235.12865708492, 186458.204381228,
    193681.28010537106, 200904.35582951413, 208127.43155365717, 215350.50727780024,
    222573.5830019433, 229796.65872608637, 237019.73445022944, 244242.8101743725,
    251465.88589851558, 258688.96162265865, 265912.0373468017, 273135.1130709448,
    280358.18879508786, 287581.2645192309, 294804.340243374, 302027.41596751707,
    309250.49169166014
};
static const double sysid_pwm_b_discharge_network_duty_low[25] = {
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.02, 0.02, 0.02, 0.02,
    0.18000000000000005
};
static const double sysid_pwm_b_discharge_network_duty_high[25] = {
    0.02, 0.02, 0.06000000000000002, 0.14000000000000007,
    0.22000000000000008, 0.22000000000000008, 0.2599999999999999, 0.29999999999999993,
    0.3399999999999999, 0.3399999999999999, 0.3399999999999999, 0.3399999999999999,
    0.37999999999999995, 0.37999999999999995, 0.37999999999999995, 0.42,
    0.42, 0.4600000000000001, 0.4600000000000001, 0.5,
    0.54, 0.58, 0.62, 0.7400000000000001,
    0.7400000000000001
};
static const double sysid_pwm_b_discharge_network_flow_low_kg_s[25] = {
    -2.2999761971492455e-05, -4.121670050799171e-05, -6.878070750047493e-05, -0.00011081013707045007,
    -0.00016598484149064395, -0.0001990088357980812, -0.00024018669706845318, -0.0002753415467299822,
    -0.00031960684046773865, -0.00031960684046773865, -0.0003195225681017383, -0.00032076225490862474,
    -0.0003242012186993891, -0.00032649386122656534, -0.00032997052436935313, -0.00033345765481862993,
    -0.0003357809915829624, -0.00033922971385587694, -0.0003426784361287914, -0.00034501145789222364,
    -0.0003486060356154051, -0.00035220061333858657, -0.0003533988059129804, -0.0003533988059129804,
    -0.00026580251497824564
};
static const double sysid_pwm_b_discharge_network_flow_high_kg_s[25] = {
    -4.764869341547063e-06, -4.764869341547063e-06, -1.4788992186970294e-06, -7.709251780510722e-08,
    -7.709251780510722e-08, -1.0410301378310408e-06, -1.1373710044856791e-06, -1.1373710044856791e-06,
    -4.015243037550183e-06, -1.565813914263326e-05, -1.830584270566519e-05, -2.7213579360986905e-05,
    -6.169994205084258e-06, -6.169994205084258e-06, -1.659266299946658e-05, -6.050256846402628e-06,
    -6.050256846402628e-06, -3.0712459562239146e-06, -3.0712459562239146e-06, -3.6966737735542142e-06,
    -6.72451185954192e-07, -6.142713992077936e-07, -2.5480834875775057e-07, -1.4003964768040957e-08,
    -1.4003964768040957e-08
};
static const sysid_domain sysid_pwm_b_discharge_network_domain = {
    {0.02, 0.7400000000000001}, {135896.6743122265, 309250.49169166014}, 25,
    sysid_pwm_b_discharge_network_pressure_pa,
    sysid_pwm_b_discharge_network_duty_low,
    sysid_pwm_b_discharge_network_duty_high,
    sysid_pwm_b_discharge_network_flow_low_kg_s,
    sysid_pwm_b_discharge_network_flow_high_kg_s
};
static const double sysid_pwm_b_discharge_network_w1[20] = {
    1.5224656596673172, -9.073072760256393, 0.3372024828135144, 21.44551872853345,
    4.081039402357273, 86.08888241980713, -0.263875569141844, -4.228280841374572,
    -0.04620668569970403, -0.3047258221898148, 0.26137015278983444, -1.2064022509502674,
    -0.4376433281162447, -17.17897086742309, 0.3842452557416901, 19.909014833273257,
    -0.5125537010646316, -5.836584803418606, 0.11304641874218607, -0.5422824751413088
};
static const double sysid_pwm_b_discharge_network_b1[10] = {
    -6.270975499522476, 7.481650803043049, 53.346016417066934, 6.121362215829745,
    1.0030359598345364, -0.3522327846469938, -5.99794804837728, 6.968244097356639,
    -2.417760405430211, 1.4341763274715713
};
static const double sysid_pwm_b_discharge_network_w2[10] = {
    0.06215791060875163, -2.2540762752847274, 0.14038000078432938, -5.739927658691555,
    -12.482974611278436, 0.5968043079748133, 1.7433034395224691, 3.9980848942785565,
    -0.22931055708708833, 7.434275447333298
};
static const sysid_network sysid_pwm_b_discharge_network = {
    10, sysid_pwm_b_discharge_network_w1, sysid_pwm_b_discharge_network_b1, sysid_pwm_b_discharge_network_w2,
    7.988986901426538,
    {-0.00017674074998484882, 0.0001767267460200808}, {222883.0455618224, 86065.55360999223}, {0.38000000000000006, 0.36000000000000004},
    &sysid_pwm_b_discharge_network_domain
};

/* Duty for a wanted mean flow, kg/s, at a chamber pressure, Pa, by the network (3.7.4). */
static inline double sysid_pwm_b_discharge_network_duty(double flow_kg_s, double pressure_pa, unsigned *flags)
{
    return sysid_network_duty(&sysid_pwm_b_discharge_network, flow_kg_s, pressure_pa, flags);
}

#endif /* SYSID_CONTROLLER_H */
