/* The plant of sysid.model by hand, one segment at a time.
 *
 * A step is one of Kutta's third-order method with the regime frozen, cut at the first event
 * (choking, stop, breakaway, end stop) by its continuous extension: what sysid's own steps do, so
 * that both are equally accurate. Near the supply's pressure a chamber is advanced implicitly.
 */
#include <math.h>

typedef struct {
    double fs, fc, c, inertia, gravity, offset, max_effort;
    double area[2], dead[2], radius, stop;
    double k, rt, p0, ps;
    double choked_fill[2], choked_dis[2], c_fill[2], c_dis[2];
} Plant;

typedef struct {
    int open[2], choked[2], above[2], held[2], way;
    double motor, bound[2], rate[2];
} Regime;

static double clip(double x, double most) { return x < most ? (x > -most ? x : -most) : most; }
static double root(double x) { return x < 0 ? -sqrt(-x) : sqrt(x); }

static double effort(const Plant *p, const double *y, double motor) {
    double cylinder = (y[2] - p->p0) * p->area[0] - (y[3] - p->p0) * p->area[1];
    return cylinder * p->radius + clip(motor, p->max_effort) - p->gravity * sin(y[0]) + p->offset;
}

static double flow(const Plant *p, int s, int open, int choked, double pressure) {
    if (open) return choked ? p->choked_fill[s] : p->c_fill[s] * root(p->ps - pressure);
    return choked ? -p->choked_dis[s] : p->c_dis[s] * (p->p0 - pressure);
}

static double volume(const Plant *p, int s, const double *y) {
    return (p->dead[s] + (s ? -1.0 : 1.0) * p->radius * y[0]) * p->area[s];
}

static double pressure_rate(const Plant *p, int s, int open, int choked, const double *y) {
    double swept = (s ? -1.0 : 1.0) * p->radius * y[1] * p->area[s];
    double inflow = p->rt * flow(p, s, open, choked, y[2 + s]);
    return p->k * (inflow - y[2 + s] * swept) / volume(p, s, y);
}

static double margin(const Plant *p, const double *y, double applied, double *way) {
    double limit = p->fs > p->fc ? p->fs : p->fc;
    *way = applied > 0 ? 1.0 : -1.0;
    return *way * y[0] >= p->stop ? limit : limit - *way * applied;
}

static void rates(const Plant *p, const Regime *r, const double *y, double *k, double *m,
                  double *way) {
    double applied = effort(p, y, r->motor);
    *m = margin(p, y, applied, way);
    k[0] = y[1];
    k[1] = r->way ? (applied - p->fc * r->way - p->c * y[1]) / p->inertia : 0.0;
    for (int s = 0; s < 2; s++)
        k[2 + s] = r->held[s] ? r->rate[s] : pressure_rate(p, s, r->open[s], r->choked[s], y);
}

/* Which law holds; on the boundary that to which it drives the pressure, or neither. */
static void choke(const Plant *p, Regime *r, const double *y, int s) {
    double excess;
    r->bound[s] = r->open[s] ? 0.53 * p->ps : p->p0 / 0.53;
    excess = y[2 + s] - r->bound[s];
    r->above[s] = excess > 0 ? 1 : -1;
    r->held[s] = 0;
    if (fabs(excess) <= 1e-10 * r->bound[s]) {
        int up = pressure_rate(p, s, r->open[s], !r->open[s], y) > 0;
        int down = pressure_rate(p, s, r->open[s], r->open[s], y) < 0;
        r->above[s] = up ? 1 : down ? -1 : 0;
        r->held[s] = !up && !down;
        r->rate[s] = 0.0;
    }
    r->choked[s] = (r->above[s] < 0) == r->open[s];
}

/* A stage of Alexander's method, of order 3, for dD/dt = -K sign(D) sqrt(|D|) + g; k and g by h. */
static double stage(double d, const double *k, const double *g, double at) {
    const double own = 0.43586652150845899942;
    double stiff = 0.5 * (k[0] + at * (k[1] - k[0])), gain = 0.5 * (g[0] + at * (g[1] - g[0]));
    double known = d + own * gain, part = own * stiff;
    double z = 0.5 * (sqrt(part * part + 4.0 * fabs(known)) - part);
    return gain - stiff * (known < 0 ? -z : z);
}

/* Near D = Ps - P = 0: two steps of it, with what the piston's speed changes on the way. */
static void near_supply(const Plant *p, Regime *r, const double *y, int s, double h, double speed) {
    const double own = 0.43586652150845899942, second = 0.28206673924577050029;
    const double third[2] = {1.2084966491760100703, -0.64436317068446906972};
    double v = volume(p, s, y), side = (s ? -1.0 : 1.0) * p->radius * p->area[s];
    double gap = p->ps - y[2 + s], d = gap, k[2], g[2], shrunk;
    if (!r->open[s] || r->choked[s]) return;
    k[0] = h * p->k * p->rt / v * p->c_fill[s];
    g[0] = k[0] * root(gap) - h * pressure_rate(p, s, 1, 0, y);
    if (fabs(gap) >= k[0] * k[0] + 2.0 * fabs(g[0])) return;
    shrunk = 1.0 / (1.0 + 0.5 * h * side * (y[1] + speed) / v);
    k[1] = k[0] * shrunk;
    g[1] = g[0] + h * p->k * y[2 + s] / v * side * (speed * shrunk - y[1]);
    for (int i = 0; i < 2; i++) {
        double a = stage(d, k, g, 0.5 * (i + own));
        double b = stage(d + second * a, k, g, 0.5 * (i + own + second));
        d += third[0] * a + third[1] * b;
        d += own * stage(d, k, g, 0.5 * (i + 1.0));
    }
    r->held[s] = 1;
    r->rate[s] = (gap - d) / h;
}

/* The share of a step at which a cubic that starts positive turns negative; 2: nowhere. */
static double turns(const double *c) {
    double slope = c[1] - 0.5 * c[3], bend = c[2] + 1.5 * c[3], wide, s;
    if (!(c[0] + c[1] + c[2] + c[3] < 0)) return 2.0;
    wide = sqrt(fabs(slope * slope - 4.0 * bend * c[0]));
    s = slope > 0 ? (slope + wide) / (-2.0 * bend + 1e-300) : 2.0 * c[0] / (wide - slope + 1e-300);
    if (!(s < 1.0)) return 2.0;
    for (int i = 0; i < 2; i++) {
        double f = c[0] + s * (c[1] + s * (c[2] + s * c[3]));
        s -= f / (c[1] + s * (2.0 * c[2] + s * 3.0 * c[3]) - 1e-300);
        s = s > 0 ? (s < 1 ? s : 1.0) : 0.0;
    }
    return s;
}

static void distance(double sign, const double *c, double origin, double *found) {
    found[0] = sign * (c[0] - origin);
    for (int i = 1; i < 4; i++) found[i] = sign * c[i];
}

/* One step of at most h s; returns what it took. */
static double step(const Plant *p, Regime *r, double *y, double *loose, double h) {
    double k1[4], k2[4], k3[4], z[4], c[4][4], e[4], m1, m2, m3, way, at = 2.0, s;
    int event = -1;
    m1 = margin(p, y, effort(p, y, r->motor), &way);
    if (y[1] != 0) r->way = y[1] > 0 ? 1 : -1;
    else r->way = m1 < 0 || *loose * way > 0 ? (int)way : 0;
    *loose = 0.0;
    for (int i = 0; i < 2; i++) choke(p, r, y, i);
    rates(p, r, y, k1, &m1, &way);
    for (int i = 0; i < 2; i++) {
        if (r->above[i]) near_supply(p, r, y, i, h, y[1] + h * k1[1]);
        if (r->held[i]) k1[2 + i] = r->rate[i];
    }
    for (int i = 0; i < 4; i++) z[i] = y[i] + 0.5 * h * k1[i];
    rates(p, r, z, k2, &m2, &way);
    for (int i = 0; i < 4; i++) z[i] = y[i] + h * (2.0 * k2[i] - k1[i]);
    rates(p, r, z, k3, &m3, &way);
    for (int i = 0; i < 4; i++) {
        c[i][0] = y[i];
        c[i][1] = h * k1[i];
        c[i][2] = h * (2.0 * k2[i] - 1.5 * k1[i] - 0.5 * k3[i]);
        c[i][3] = h * (2.0 / 3.0) * (k1[i] - 2.0 * k2[i] + k3[i]);
    }
    e[0] = m1; e[1] = 2.0 * (m2 - m1); e[2] = 0.5 * (m3 - 2.0 * m2 + m1); e[3] = 0.0;
    if (r->way) distance(r->way, c[1], 0.0, e);
    if ((s = turns(e)) < at) at = s, event = 0;
    if (r->way) {
        distance(-r->way, c[0], r->way * p->stop, e);
        if ((s = turns(e)) < at) at = s, event = 1;
    }
    for (int i = 0; i < 2; i++) {
        distance(r->above[i], c[2 + i], r->bound[i], e);
        if ((s = turns(e)) < at) at = s, event = 2 + i;
    }
    s = event < 0 ? 1.0 : at > 1e-4 ? at : 1e-4;
    for (int i = 0; i < 4; i++) y[i] = c[i][0] + s * (c[i][1] + s * (c[i][2] + s * c[i][3]));
    if (event == 0 && !r->way) *loose = way;
    if (event == 0 || event == 1) y[1] = 0.0;
    if (event == 1) y[0] = r->way * p->stop;
    if (event > 1) y[event] = r->bound[event - 2];
    return s * h;
}

/* rows + 1 states (position, pressures) at the log's rows; edges end with infinity. */
static void simulate(const Plant *p, const double *start, int rows, const double *time,
                     const double *motor, const double *edges_a, const double *edges_b,
                     double *position, double *pressure_a, double *pressure_b) {
    double y[4], loose = 0.0, now = time[0];
    Regime r;
    for (int i = 0; i < 4; i++) y[i] = start[i];
    r.open[0] = r.open[1] = 0;
    for (int row = 0; row <= rows; row++) {
        while (row && now < time[row]) {
            double end = time[row], left;
            while (*edges_a <= now) r.open[0] ^= 1, edges_a++;
            while (*edges_b <= now) r.open[1] ^= 1, edges_b++;
            if (*edges_a < end) end = *edges_a;
            if (*edges_b < end) end = *edges_b;
            r.motor = motor[row - 1];
            for (left = end - now; left > 1e-15;) left -= step(p, &r, y, &loose, left);
            now = end;
        }
        position[row] = y[0];
        pressure_a[row] = y[2];
        pressure_b[row] = y[3];
    }
}
