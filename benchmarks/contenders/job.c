/* The whole job in C: Levenberg and Marquardt's method with differences, starts eliminated.
 *
 *     job JOB.bin RESULT.txt
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "plant.h"

enum { SHARED = 8, START = 4, LOCAL = START + 2, WIDE = LOCAL + SHARED, MOST = 64 };
static const double SCATTER = 0.02, STEP = 1e-6, TOLERANCE = 1e-6;

static int segments, tests, rows, edges;
static double *test_of, *time_s, *motor, *edge_a, *edge_b, *measured, *starts, *widths, *noise;
static Plant base;
static int robust = 1, hold_static = 1, *left_out;

typedef struct {
    double shared[SHARED], *friction, *local;
} Unknowns;

static double *take(FILE *file, size_t count) {
    double *found = malloc(count * sizeof *found);
    if (!found || fread(found, sizeof *found, count, file) != count) exit(2);
    return found;
}

static void read_job(const char *path) {
    FILE *file = fopen(path, "rb");
    double *head;
    if (!file) exit(2);
    head = take(file, 4);
    segments = (int)head[0]; tests = (int)head[1]; rows = (int)head[2]; edges = (int)head[3];
    memcpy(&base, take(file, sizeof base / sizeof(double)), sizeof base);
    noise = take(file, 3);
    test_of = take(file, segments);
    time_s = take(file, (size_t)segments * rows);
    motor = take(file, (size_t)segments * rows);
    edge_a = take(file, (size_t)segments * edges);
    edge_b = take(file, (size_t)segments * edges);
    measured = take(file, (size_t)segments * 3 * rows);
    starts = take(file, (size_t)segments * START);
    widths = take(file, (size_t)segments * START);
    fclose(file);
}

/* A segment's whitened residuals (3 rows) with one of its unknowns moved by STEP (column), or none. */
static void residual(int i, const Unknowns *x, int column, double *work, double *found) {
    const double *u = x->shared, *f = x->friction + 2 * (int)test_of[i];
    double v[WIDE], start[START];
    Plant p = base;
    for (int j = 0; j < START; j++) v[j] = x->local[START * i + j];
    v[4] = f[0]; v[5] = f[1];
    memcpy(v + LOCAL, u, sizeof x->shared);
    if (column >= 0) v[column] += STEP;
    u = v + LOCAL;
    p.fs *= exp(u[0] + SCATTER * v[5]);
    p.fc *= exp(u[1] + SCATTER * v[4]);
    p.c *= exp(u[2] + SCATTER * v[4]);
    p.choked_fill[0] *= exp(u[3]);
    p.choked_dis[0] *= exp(u[4]);
    p.choked_fill[1] *= exp(u[5]);
    p.choked_dis[1] *= exp(u[6]);
    p.c_fill[0] *= exp(u[7]);
    for (int j = 0; j < START; j++)
        start[j] = starts[START * i + j] + widths[START * i + j] * v[j];
    simulate(&p, start, rows - 1, time_s + (size_t)i * rows, motor + (size_t)i * rows,
             edge_a + (size_t)i * edges, edge_b + (size_t)i * edges, work, work + rows,
             work + 2 * rows);
    for (int c = 0; c < 3; c++)
        for (int r = 0; r < rows; r++)
            found[c * rows + r] =
                (work[c * rows + r] - measured[((size_t)i * 3 + c) * rows + r]) / noise[c];
}

static double priors(const Unknowns *x) {
    double sum = 0.0;
    for (int j = 0; j < 2 * tests; j++) sum += x->friction[j] * x->friction[j];
    for (int j = 0; j < START * segments; j++) sum += x->local[j] * x->local[j];
    return sum;
}

/* The cost of a channel; robust: its errors have a size of their own. `weight` of its squares. */
static double channel_cost(const double *r, double *weight) {
    double sum = 0.0;
    for (int i = 0; i < rows; i++) sum += r[i] * r[i];
    *weight = robust ? 1.0 / (1.0 + sum / rows) : 1.0;
    return robust ? rows * log1p(sum / rows) : sum;
}

/* Normal equations of each segment (WIDE + 1 squared), and the cost. */
static double linearise(const Unknowns *x, double *normal, double *work) {
    double cost = priors(x), weight[3];
    int n = 3 * rows;
    for (int i = 0; i < segments; i++) {
        double *columns = work + n, *own = normal + i * (WIDE + 1) * (WIDE + 1);
        double *last = columns + (size_t)WIDE * n;
        if (left_out[i]) {
            memset(own, 0, (WIDE + 1) * (WIDE + 1) * sizeof *own);
            for (int j = 0; j < START; j++) own[j * (WIDE + 2)] = 1.0;
            continue;
        }
        residual(i, x, -1, work, last);
        for (int j = 0; j < WIDE; j++) {
            double *column = columns + (size_t)j * n;
            /* A shaft at rest stays so: its velocity is no unknown. Static friction waits for the scan. */
            int known = j < START ? widths[START * i + j] < 1e-8
                                  : hold_static && (j == LOCAL - 1 || j == LOCAL);
            residual(i, x, known ? -1 : j, work, column);
            for (int r = 0; r < n; r++) column[r] = (column[r] - last[r]) / STEP;
        }
        for (int c = 0; c < 3; c++) cost += channel_cost(last + c * rows, &weight[c]);
        for (int a = 0; a <= WIDE; a++)
            for (int b = 0; b <= a; b++) {
                const double *u = columns + (size_t)a * n, *v = columns + (size_t)b * n;
                double sum = 0.0;
                for (int c = 0; c < 3; c++) {
                    double part = 0.0;
                    for (int r = c * rows; r < (c + 1) * rows; r++) part += u[r] * v[r];
                    sum += weight[c] * part;
                }
                own[a * (WIDE + 1) + b] = own[b * (WIDE + 1) + a] = sum;
            }
        for (int j = 0; j < START; j++) {
            own[j * (WIDE + 2)] += 1.0;
            own[j * (WIDE + 1) + WIDE] += x->local[START * i + j];
            own[WIDE * (WIDE + 1) + j] += x->local[START * i + j];
        }
    }
    return cost;
}

/* Gauss elimination of the first `count` unknowns of a symmetric system (n, n) in place. */
static void eliminate(double *m, int n, int count) {
    for (int j = 0; j < count; j++)
        for (int a = j + 1; a < n; a++) {
            double share = m[a * n + j] / m[j * n + j];
            for (int b = j; b < n; b++) m[a * n + b] -= share * m[j * n + b];
        }
}

static void back(const double *m, int n, int count, double *x) {
    for (int j = count - 1; j >= 0; j--) {
        double sum = m[j * n + n - 1];
        for (int b = j + 1; b < n - 1; b++) sum += m[j * n + b] * x[b];
        x[j] = -sum / m[j * n + j];
    }
}

/* The step that the equations, damped, propose. */
static void propose(const double *normal, double damping, const Unknowns *x, Unknowns *to) {
    int wide = WIDE + 1, m = SHARED + 2 * tests, n = m + 1;
    double *all = calloc((size_t)n * n, sizeof *all), *z = calloc(n, sizeof *z);
    double *own = malloc((size_t)segments * wide * wide * sizeof *own);
    memcpy(own, normal, (size_t)segments * wide * wide * sizeof *own);
    for (int j = 0; j < 2 * tests; j++) {
        all[(SHARED + j) * (n + 1)] = 1.0;
        all[(SHARED + j) * n + m] = x->friction[j];
    }
    for (int i = 0; i < segments; i++) {
        double *o = own + (size_t)i * wide * wide;
        int place[WIDE + 1];
        for (int j = 0; j < START; j++) o[j * (wide + 1)] *= 1.0 + damping;
        eliminate(o, wide, START);
        for (int j = START; j < WIDE; j++)
            place[j] = j < LOCAL ? SHARED + 2 * (int)test_of[i] + j - START : j - LOCAL;
        place[WIDE] = m;
        for (int a = START; a < WIDE; a++)
            for (int b = START; b <= WIDE; b++) all[place[a] * n + place[b]] += o[a * wide + b];
    }
    for (int j = 0; j < m; j++) all[j * (n + 1)] += damping * all[j * (n + 1)] + 1e-6;
    eliminate(all, n, m);
    back(all, n, m, z);
    for (int j = 0; j < SHARED; j++) to->shared[j] = x->shared[j] + z[j];
    for (int j = 0; j < 2 * tests; j++) to->friction[j] = x->friction[j] + z[SHARED + j];
    for (int i = 0; i < segments; i++) {
        double s[WIDE];
        s[4] = z[SHARED + 2 * (int)test_of[i]];
        s[5] = z[SHARED + 2 * (int)test_of[i] + 1];
        memcpy(s + LOCAL, z, SHARED * sizeof *z);
        back(own + (size_t)i * wide * wide, wide, START, s);
        for (int j = 0; j < START; j++) to->local[START * i + j] = x->local[START * i + j] + s[j];
    }
    free(all); free(z); free(own);
}

static double segment_cost(int i, const Unknowns *x, double *work) {
    double cost = 0.0, weight, *found = work + 3 * rows;
    if (left_out[i]) return 0.0;
    residual(i, x, -1, work, found);
    for (int c = 0; c < 3; c++) cost += channel_cost(found + c * rows, &weight);
    return cost;
}

static double cost_of(const Unknowns *x, double *work) {
    double cost = priors(x);
    for (int i = 0; i < segments; i++) cost += segment_cost(i, x, work);
    return cost;
}

static double log_cost(int test, const Unknowns *x, double *work) {
    double cost = 0.0;
    for (int i = 0; i < segments; i++)
        if (test_of[i] == test) cost += segment_cost(i, x, work);
    return cost;
}

/* Static friction of each log where its segments cost least: breakaway is a staircase of it. */
static void scan(Unknowns *x, double *work) {
    for (int t = 0; t < tests; t++) {
        double *own = x->friction + 2 * t + 1, best = *own, least = log_cost(t, x, work);
        for (int fine = 0; fine < 2; fine++) {
            double middle = best;
            for (int k = -20; k <= 20; k++) {
                double cost;
                *own = middle + k * (fine ? 0.05 : 1.0);
                cost = log_cost(t, x, work);
                if (cost < least) least = cost, best = *own;
            }
        }
        *own = best;
    }
    /* The model's is their mean; the prior is about it. */
    double mean = 0.0;
    for (int t = 0; t < tests; t++) mean += x->friction[2 * t + 1] / tests;
    for (int t = 0; t < tests; t++) x->friction[2 * t + 1] -= mean;
    x->shared[0] += SCATTER * mean;
}

/* Segments whose errors are not like those of the others are left out. */
static void leave_out(const Unknowns *x, double *work) {
    double *cost = malloc(2 * segments * sizeof *cost), *sorted = cost + segments;
    for (int i = 0; i < segments; i++) {
        int j = i;
        sorted[i] = cost[i] = segment_cost(i, x, work) / (3 * rows);
        for (; j && sorted[j - 1] > cost[i]; j--) sorted[j] = sorted[j - 1];
        sorted[j] = cost[i];
    }
    for (int i = 0; i < segments; i++) left_out[i] = cost[i] > 9.0 * fmax(sorted[segments / 2], 1.0);
    free(cost);
}

/* Descend until a step lowers the cost by little; returns the evaluations. */
static int descend(Unknowns *x, Unknowns *to, double *normal, double *work) {
    double damping = 1e-3, cost = linearise(x, normal, work), after;
    int evaluations = 1, refused = 0;
    while (evaluations < MOST && refused < 6) {
        Unknowns former = *x;
        propose(normal, damping, x, to);
        after = cost_of(to, work);
        evaluations++;
        if (getenv("VERBOSE")) fprintf(stderr, "%d %g %g %g\n", evaluations, cost, after, damping);
        if (!isfinite(after) || after >= cost) {
            damping *= 10.0;
            refused++;
            continue;
        }
        refused = 0;
        *x = *to;
        *to = former;
        damping *= 0.1;
        if (cost - after < TOLERANCE * fabs(after)) break;
        cost = linearise(x, normal, work);
    }
    return evaluations;
}

static Unknowns unknowns(void) {
    Unknowns x = {{0}, calloc(2 * tests, sizeof(double)),
                  calloc((size_t)START * segments, sizeof(double))};
    return x;
}

int main(int count, char **arguments) {
    Unknowns x, to;
    double *normal, *work;
    int evaluations;
    FILE *out;
    if (count != 3) return 2;
    read_job(arguments[1]);
    x = unknowns();
    to = unknowns();
    normal = malloc((size_t)segments * (WIDE + 1) * (WIDE + 1) * sizeof *normal);
    work = malloc((size_t)(WIDE + 2) * 3 * rows * sizeof *work);
    left_out = calloc(segments, sizeof *left_out);
    evaluations = descend(&x, &to, normal, work);
    scan(&x, work);
    hold_static = 0;
    evaluations += descend(&x, &to, normal, work);
    robust = 0;
    leave_out(&x, work);
    evaluations += descend(&x, &to, normal, work);
    if (!(out = fopen(arguments[2], "w"))) return 2;
    fprintf(out, "%d\n", evaluations);
    for (int j = 0; j < SHARED; j++) fprintf(out, "%.17g\n", x.shared[j]);
    return fclose(out) ? 2 : 0;
}
