/* A second plant, written for speed and independently of the first: a fixed step of 5 us (the
   midpoint rule), valves by the share of each step that they are open, and effects in forms of its
   own. `second_plant.py` reads the names of the rig's numbers from the struct below. */

#include <math.h>

typedef struct {
    /* inertia and friction: static, Coulomb, viscous; SI, at the output shaft */
    double inertia, static_nm, coulomb_nm, viscous;
    /* geometry, motor, gas */
    double radius, max_torque, gas, heat_ratio, temperature, atmosphere, supply;
    double area_a, area_b, offset_a, offset_b;
    /* valves: choked flow in kg/s, then the coefficient below it; filling and exhaust */
    double fill_a, fill_root_a, dis_a, dis_linear_a, fill_b, fill_root_b, dis_b, dis_linear_b;
    /* effects; 0 where absent */
    double stribeck, stribeck_speed, asymmetry, tight, tight_wave, tight_phase, seal;
    double bristle, bristle_damping, drag, eddy, eddy_speed, carried_friction;
    double gap, rotor, contact, contact_damping, link, link_spring, link_damping;
    double mesh, mesh_wave, mesh_phase, eccentric, eccentric_phase, spring, tilt, tilt_phase;
    double ripple, ripple_wave, ripple_phase, saturation, gain, lag, offset;
    double magnet, magnet_place, magnet_width;
    double exponent, wall, dead_a, dead_b, tube, leak, leak_a, leak_b, laminar, laminar_a;
    double iso, ratio_fill, ratio_dis, scaled_exhaust, droop, back, warming, ambient, area_error;
    double pressure_lag_a, pressure_lag_b;
} Rig;

/* How a test is run: rows of `period` s in so many steps each, its friction over the mean (Coulomb
   and viscous; static), the angle beyond which it ends; `held`: the shaft is clamped. */
typedef struct {
    int rows, steps, held, open_a, open_b, edges_a, edges_b;
    double period, angle, pressure_a, pressure_b, sliding, sticking, end;
} Test;

enum { ANGLE, SPEED, PRESSURE_A, PRESSURE_B, MASS_A, MASS_B, BRISTLE, MOTOR, SECOND, SECOND_SPEED,
       TUBE_A, TUBE_B, SHOWN_A, SHOWN_B, STATES };

static const double CRITICAL = 0.53;   /* the thesis' ratio */
static const double STRIBECK_OF_BRISTLE = 0.02; /* rad/s, from static to sliding */

static double sign(double x) { return (x > 0.0) - (x < 0.0); }

static double radius(const Rig *r, double angle) {
    return r->radius * (1.0 + r->eccentric * cos(angle - r->eccentric_phase));
}

static double place(const Rig *r, double angle) {
    double turned = sin(angle - r->eccentric_phase) + sin(r->eccentric_phase);
    return r->radius * (angle + r->eccentric * turned);
}

static double iso6358(double up, double down, double per_pa, double ratio) {
    double x = down / up;
    if (x <= ratio)
        return per_pa * up;
    double left = 1.0 - pow((x - ratio) / (1.0 - ratio), 2.0);
    return left > 0.0 ? per_pa * up * sqrt(left) : 0.0;
}

static double filling(const Rig *r, int b, double pressure, double supply) {
    double choked = b ? r->fill_b : r->fill_a, root = b ? r->fill_root_b : r->fill_root_a;
    if (r->iso > 0.0) {
        double per_pa = choked / r->supply;
        return pressure <= supply ? iso6358(supply, pressure, per_pa, r->ratio_fill)
                                  : -iso6358(pressure, supply, per_pa, r->ratio_fill);
    }
    if (pressure <= CRITICAL * supply)
        return choked * supply / r->supply;
    return sign(supply - pressure) * root * sqrt(fabs(supply - pressure));
}

static double exhaust(const Rig *r, int b, double pressure, double outside) {
    double choked = b ? r->dis_b : r->dis_a, linear = b ? r->dis_linear_b : r->dis_linear_a;
    if (r->iso > 0.0) {
        double per_pa = choked / 2e5;
        return pressure >= outside ? -iso6358(pressure, outside, per_pa, r->ratio_dis)
                                   : iso6358(outside, pressure, per_pa, r->ratio_dis);
    }
    double boundary = outside / CRITICAL;
    if (pressure >= boundary)
        return -choked * (1.0 - r->scaled_exhaust + r->scaled_exhaust * pressure / boundary);
    return linear * (outside - pressure);
}

/* Times Coulomb or static friction, at an angle. */
static double tightness(const Rig *r, double angle) {
    return 1.0 + r->tight * sin(r->tight_wave * angle + r->tight_phase);
}

/* What dry friction is more than Coulomb friction, or at rest than static friction. */
static double beyond(const Rig *r, const double *x, double speed, double carried,
                     double atmosphere) {
    double fall = r->stribeck_speed > 0.0 ? exp(-pow(speed / r->stribeck_speed, 2.0)) : 0.0;
    double gauge = x[PRESSURE_A] + x[PRESSURE_B] - 2.0 * atmosphere;
    return r->stribeck * fall + r->seal * gauge + r->carried_friction * carried;
}

static double speed_friction(const Rig *r, double speed, double sliding) {
    double found = sliding * r->viscous * speed + r->drag * speed * fabs(speed);
    if (r->eddy_speed > 0.0)
        found += r->eddy * speed / (1.0 + pow(speed / r->eddy_speed, 2.0));
    return found;
}

/* The motor's torque on the shaft: through a gap, or less what bends a link. */
static double coupled(const Rig *r, const double *x, double *d) {
    double torque = x[MOTOR];
    if (r->rotor > 0.0) {
        double ahead = x[SECOND] - x[ANGLE], half = 0.5 * r->gap, into = 0.0, push = 0.0;
        if (ahead > half)
            into = ahead - half;
        if (ahead < -half)
            into = ahead + half;
        if (into != 0.0)
            push = r->contact * into + r->contact_damping * (x[SECOND_SPEED] - x[SPEED]);
        if (into * push < 0.0)
            push = 0.0;
        d[SECOND] = x[SECOND_SPEED];
        d[SECOND_SPEED] = (torque - push) / r->rotor;
        return push;
    }
    if (r->link > 0.0) {
        double bent = r->link_spring * (x[ANGLE] - x[SECOND])
            + r->link_damping * (x[SPEED] - x[SECOND_SPEED]);
        d[SECOND] = x[SECOND_SPEED];
        d[SECOND_SPEED] = bent / r->link;
        return torque - bent;
    }
    return torque;
}

static void mechanics(const Rig *r, const Test *t, const double *x, double *d, int *stuck) {
    double atmosphere = r->atmosphere + r->ambient, area_b = r->area_b + r->area_error;
    double force = x[PRESSURE_A] * r->area_a - x[PRESSURE_B] * area_b
        - atmosphere * (r->area_a - area_b);
    double motor = coupled(r, x, d), cylinder = force * radius(r, x[ANGLE]);
    double near = r->magnet_width > 0.0 ? (x[ANGLE] - r->magnet_place) / r->magnet_width : 0.0;
    double torque = motor + cylinder - r->spring * x[ANGLE] - r->tilt * sin(x[ANGLE] + r->tilt_phase)
        + r->offset + r->mesh * sin(r->mesh_wave * x[ANGLE] + r->mesh_phase)
        + r->magnet * exp(-near * near);
    double inertia = r->inertia - r->rotor - r->link, carried = fabs(motor + cylinder);
    double speed = x[SPEED], tight = tightness(r, x[ANGLE]);
    double coulomb = t->sliding * r->coulomb_nm * tight, still = t->sticking * r->static_nm;
    if (r->bristle > 0.0) {
        double most = coulomb + beyond(r, x, speed, carried, atmosphere)
            + r->asymmetry * sign(speed) + (still - t->sliding * r->coulomb_nm)
            * exp(-pow(speed / STRIBECK_OF_BRISTLE, 2.0));
        double gives = speed - r->bristle * fabs(speed) / most * x[BRISTLE];
        d[BRISTLE] = gives;
        torque -= r->bristle * x[BRISTLE] + r->bristle_damping * gives;
        d[SPEED] = (torque - speed_friction(r, speed, t->sliding)) / inertia;
        d[ANGLE] = speed;
        return;
    }
    double way = *stuck || speed == 0.0 ? sign(torque) : sign(speed);
    double more = beyond(r, x, *stuck ? 0.0 : speed, carried, atmosphere);
    if (*stuck && fabs(torque) <= still * tight + more)
        return;
    *stuck = 0;
    d[SPEED] = (torque - way * (coulomb + more) - r->asymmetry
                - speed_friction(r, speed, t->sliding)) / inertia;
    d[ANGLE] = speed;
}

static double chambers(const Rig *r, const double *x, double *d, double speed, double share_a,
                       double share_b, double time) {
    double outside = r->atmosphere + r->ambient, area_b = r->area_b + r->area_error;
    double y = place(r, x[ANGLE]), rate = radius(r, x[ANGLE]) * speed;
    double volume_a = (r->offset_a + r->dead_a + y) * r->area_a;
    double volume_b = (r->offset_b + r->dead_b - y) * area_b;
    double supply = r->supply, line_a = outside, line_b = outside, flow_a = 0.0, flow_b = 0.0;
    double k = r->heat_ratio + r->exponent, temperature = r->temperature + r->warming * time;
    /* What the flow takes from the supply, and gives the exhaust, by repetition. */
    for (int i = 0; i < (r->droop > 0.0 || r->back > 0.0 ? 8 : 1); i++) {
        double in_a = share_a * filling(r, 0, x[PRESSURE_A], supply);
        double in_b = share_b * filling(r, 1, x[PRESSURE_B], supply);
        double out_a = (1.0 - share_a) * exhaust(r, 0, x[PRESSURE_A], line_a);
        double out_b = (1.0 - share_b) * exhaust(r, 1, x[PRESSURE_B], line_b);
        flow_a = in_a + out_a;
        flow_b = in_b + out_b;
        supply = 0.5 * (supply + r->supply - r->droop * fmax(in_a + in_b, 0.0));
        line_a = 0.5 * (line_a + outside + r->back * fmax(-out_a, 0.0));
        line_b = 0.5 * (line_b + outside + r->back * fmax(-out_b, 0.0));
    }
    if (r->tube > 0.0) {
        d[TUBE_A] = (flow_a - x[TUBE_A]) / r->tube;
        d[TUBE_B] = (flow_b - x[TUBE_B]) / r->tube;
        flow_a = x[TUBE_A];
        flow_b = x[TUBE_B];
    }
    double a = x[PRESSURE_A], b = x[PRESSURE_B], square = outside * outside;
    double across = r->leak * (a * a - b * b) + r->laminar * (a - b);
    flow_a -= across + r->leak_a * (a * a - square) + r->laminar_a * (a - outside);
    flow_b += across - r->leak_b * (b * b - square);
    double heat_a = 0.0, heat_b = 0.0;
    if (r->wall > 0.0) {
        double gas_a = a * volume_a / (x[MASS_A] * r->gas), gas_b = b * volume_b / (x[MASS_B] * r->gas);
        heat_a = (k - 1.0) * r->wall * (r->temperature - gas_a) / volume_a;
        heat_b = (k - 1.0) * r->wall * (r->temperature - gas_b) / volume_b;
        d[MASS_A] = flow_a;
        d[MASS_B] = flow_b;
    }
    d[PRESSURE_A] = k * (r->gas * temperature * flow_a - a * r->area_a * rate) / volume_a + heat_a;
    d[PRESSURE_B] = k * (r->gas * temperature * flow_b + b * area_b * rate) / volume_b + heat_b;
    return supply;
}

/* Share of a step in which a valve is open; `edges` alternate, `next` is the first not yet met. */
static double opened(const double *edges, int count, int *next, int *open, double from, double to) {
    double found = 0.0, at = from;
    for (; *next < count && edges[*next] < to; (*next)++) {
        if (edges[*next] > at) {
            found += *open ? edges[*next] - at : 0.0;
            at = edges[*next];
        }
        *open = !*open;
    }
    return (found + (*open ? to - at : 0.0)) / (to - from);
}

/* Rows of angle, both pressures as their sensors show them, and supply; how many there are. */
int run(const Rig *r, const Test *t, const double *torque, const double *edges_a,
        const double *edges_b, double *rows) {
    double x[STATES] = {0}, step = t->period / t->steps, supply = r->supply;
    double area_b = r->area_b + r->area_error, y = place(r, t->angle);
    int stuck = 1, next_a = 0, next_b = 0, open_a = t->open_a, open_b = t->open_b;
    x[ANGLE] = x[SECOND] = t->angle;
    x[PRESSURE_A] = x[SHOWN_A] = t->pressure_a;
    x[PRESSURE_B] = x[SHOWN_B] = t->pressure_b;
    x[MASS_A] = t->pressure_a * (r->offset_a + r->dead_a + y) * r->area_a / (r->gas * r->temperature);
    x[MASS_B] = t->pressure_b * (r->offset_b + r->dead_b - y) * area_b / (r->gas * r->temperature);
    for (int i = 0; i < t->rows; i++) {
        double *row = rows + 4 * i;
        row[0] = x[ANGLE], row[1] = x[SHOWN_A], row[2] = x[SHOWN_B], row[3] = supply;
        if (!t->held && fabs(x[ANGLE]) > t->end)
            return i + 1;
        for (int j = 0; j < t->steps; j++) {
            double time = (i + (double)j / t->steps) * t->period;
            double share_a = opened(edges_a, t->edges_a, &next_a, &open_a, time, time + step);
            double share_b = opened(edges_b, t->edges_b, &next_b, &open_b, time, time + step);
            double limit = r->saturation > 0.0 ? r->saturation : r->max_torque;
            double wanted = torque[i] * (1.0 + r->gain)
                * (1.0 + r->ripple * sin(r->ripple_wave * x[ANGLE] + r->ripple_phase));
            wanted = fmin(fmax(wanted, -limit), limit);
            x[MOTOR] += (wanted - x[MOTOR]) * (r->lag > 0.0 ? 1.0 - exp(-step / r->lag) : 1.0);
            double middle[STATES], before = x[SPEED];
            const double *at = x;
            for (int stage = 0; stage < 2; stage++) {
                double d[STATES] = {0};
                if (!t->held)
                    mechanics(r, t, at, d, &stuck);
                supply = chambers(r, at, d, t->held ? 0.0 : at[SPEED], share_a, share_b, time);
                double *to = stage ? x : middle;
                for (int k = 0; k < STATES; k++)
                    to[k] = x[k] + (stage ? step : 0.5 * step) * d[k];
                at = middle;
            }
            if (r->bristle <= 0.0 && !stuck && before != 0.0 && x[SPEED] * before < 0.0) {
                stuck = 1;
                x[SPEED] = 0.0;
            }
            x[SHOWN_A] += (x[PRESSURE_A] - x[SHOWN_A])
                * (r->pressure_lag_a > 0.0 ? 1.0 - exp(-step / r->pressure_lag_a) : 1.0);
            x[SHOWN_B] += (x[PRESSURE_B] - x[SHOWN_B])
                * (r->pressure_lag_b > 0.0 ? 1.0 - exp(-step / r->pressure_lag_b) : 1.0);
        }
    }
    return t->rows;
}
