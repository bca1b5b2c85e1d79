"""The plant of `plant.h` for numba: the same steps, segment by segment in parallel."""

# ruff: noqa: SIM108, PLR0915

from __future__ import annotations

import math

import numba
import numpy as np

# Places of the plant's numbers.
FS, FC, VISCOUS, INERTIA, GRAVITY, OFFSET, MOTOR, AREA, DEAD, RADIUS, STOP, K, RT, P0, PS = (
    *range(8),
    9,
    *range(11, 17),
)
CHOKED_FILL, CHOKED_DIS, C_FILL, C_DIS = 17, 19, 21, 23
GAMMA = 0.43586652150845899942
SECOND = 0.28206673924577050029
THIRD = (1.2084966491760100703, -0.64436317068446906972)

quick = numba.njit(cache=True, inline="never")


@quick
def root(x):
    return -math.sqrt(-x) if x < 0 else math.sqrt(x)


@quick
def effort(p, y, motor):
    cylinder = (y[2] - p[P0]) * p[AREA] - (y[3] - p[P0]) * p[AREA + 1]
    driven = min(max(motor, -p[MOTOR]), p[MOTOR])
    return cylinder * p[RADIUS] + driven - p[GRAVITY] * math.sin(y[0]) + p[OFFSET]


@quick
def volume(p, s, y):
    return (p[DEAD + s] + (1.0 - 2.0 * s) * p[RADIUS] * y[0]) * p[AREA + s]


@quick
def pressure_rate(p, s, opened, choked, y):
    pressure = y[2 + s]
    if opened:
        flow = p[CHOKED_FILL + s] if choked else p[C_FILL + s] * root(p[PS] - pressure)
    else:
        flow = -p[CHOKED_DIS + s] if choked else p[C_DIS + s] * (p[P0] - pressure)
    swept = (1.0 - 2.0 * s) * p[RADIUS] * y[1] * p[AREA + s]
    return p[K] * (p[RT] * flow - pressure * swept) / volume(p, s, y)


@quick
def margin(p, y, applied):
    limit = max(p[FS], p[FC])
    way = 1.0 if applied > 0 else -1.0
    return (limit if way * y[0] >= p[STOP] else limit - way * applied), way


@quick
def rates(p, y, motor, moves, opened, choked, held, rate, k):
    applied = effort(p, y, motor)
    k[0] = y[1]
    sliding = p[FC] * moves + p[VISCOUS] * y[1]
    k[1] = (applied - sliding) / p[INERTIA] if moves != 0 else 0.0
    for s in range(2):
        k[2 + s] = rate[s] if held[s] else pressure_rate(p, s, opened[s], choked[s], y)
    return margin(p, y, applied)


@quick
def stage(d, k0, k1, g0, g1, at):
    stiff, gain = 0.5 * (k0 + at * (k1 - k0)), 0.5 * (g0 + at * (g1 - g0))
    known, part = d + GAMMA * gain, GAMMA * stiff
    z = 0.5 * (math.sqrt(part * part + 4.0 * abs(known)) - part)
    return gain - stiff * (-z if known < 0 else z)


@quick
def near_supply(p, y, s, h, speed):
    """Whether a chamber that fills unchoked is near the supply's pressure, and its mean rate."""
    v, side = volume(p, s, y), (1.0 - 2.0 * s) * p[RADIUS] * p[AREA + s]
    gap = p[PS] - y[2 + s]
    k0 = h * p[K] * p[RT] / v * p[C_FILL + s]
    g0 = k0 * root(gap) - h * pressure_rate(p, s, True, False, y)
    if abs(gap) >= k0 * k0 + 2.0 * abs(g0):
        return False, 0.0
    shrunk = 1.0 / (1.0 + 0.5 * h * side * (y[1] + speed) / v)
    k1, d = k0 * shrunk, gap
    g1 = g0 + h * p[K] * y[2 + s] / v * side * (speed * shrunk - y[1])
    for i in range(2):
        a = stage(d, k0, k1, g0, g1, 0.5 * (i + GAMMA))
        b = stage(d + SECOND * a, k0, k1, g0, g1, 0.5 * (i + GAMMA + SECOND))
        d += THIRD[0] * a + THIRD[1] * b
        d += GAMMA * stage(d, k0, k1, g0, g1, 0.5 * (i + 1.0))
    return True, (gap - d) / h


@quick
def turns(c0, c1, c2, c3):
    if not c0 + c1 + c2 + c3 < 0:
        return 2.0
    slope, bend = c1 - 0.5 * c3, c2 + 1.5 * c3
    wide = math.sqrt(abs(slope * slope - 4.0 * bend * c0))
    if slope > 0:
        s = (slope + wide) / (-2.0 * bend + 1e-300)
    else:
        s = 2.0 * c0 / (wide - slope + 1e-300)
    if not s < 1.0:
        return 2.0
    for _ in range(2):
        f = c0 + s * (c1 + s * (c2 + s * c3))
        s -= f / (c1 + s * (2.0 * c2 + s * 3.0 * c3) - 1e-300)
        s = min(max(s, 0.0), 1.0)
    return s


@quick
def step(p, y, motor, opened, loose, h, work, flags):
    """One step of at most h s; what it took, and which way the shaft has broken away."""
    z, k1, k2, k3, c1, c2, c3, rate = work
    choked, held = flags
    bound, above = np.empty(2), np.empty(2)
    m1, way = margin(p, y, effort(p, y, motor))
    if y[1] != 0:
        moves = 1.0 if y[1] > 0 else -1.0
    else:
        moves = way if m1 < 0 or loose * way > 0 else 0.0
    for s in range(2):
        bound[s] = 0.53 * p[PS] if opened[s] else p[P0] / 0.53
        excess = y[2 + s] - bound[s]
        above[s], held[s], rate[s] = (1.0 if excess > 0 else -1.0), False, 0.0
        if abs(excess) <= 1e-10 * bound[s]:
            up = pressure_rate(p, s, opened[s], not opened[s], y) > 0
            down = pressure_rate(p, s, opened[s], opened[s], y) < 0
            above[s] = 1.0 if up else -1.0 if down else 0.0
            held[s] = not up and not down
        choked[s] = (above[s] < 0) == opened[s]
    m1, way = rates(p, y, motor, moves, opened, choked, held, rate, k1)
    for s in range(2):
        if above[s] != 0 and opened[s] and not choked[s]:
            held[s], rate[s] = near_supply(p, y, s, h, y[1] + h * k1[1])
            if held[s]:
                k1[2 + s] = rate[s]
    for i in range(4):
        z[i] = y[i] + 0.5 * h * k1[i]
    m2, way = rates(p, z, motor, moves, opened, choked, held, rate, k2)
    for i in range(4):
        z[i] = y[i] + h * (2.0 * k2[i] - k1[i])
    m3, way = rates(p, z, motor, moves, opened, choked, held, rate, k3)
    for i in range(4):
        c1[i] = h * k1[i]
        c2[i] = h * (2.0 * k2[i] - 1.5 * k1[i] - 0.5 * k3[i])
        c3[i] = h * (2.0 / 3.0) * (k1[i] - 2.0 * k2[i] + k3[i])
    event, at = -1, 2.0
    if moves == 0:
        share = turns(m1, 2.0 * (m2 - m1), 0.5 * (m3 - 2.0 * m2 + m1), 0.0)
    else:
        share = turns(moves * y[1], moves * c1[1], moves * c2[1], moves * c3[1])
    if share < at:
        event, at = 0, share
    if moves != 0:
        room = p[STOP] - moves * y[0]
        share = turns(room, -moves * c1[0], -moves * c2[0], -moves * c3[0])
        if share < at:
            event, at = 1, share
    for s in range(2):
        a, i = above[s], 2 + s
        share = turns(a * (y[i] - bound[s]), a * c1[i], a * c2[i], a * c3[i])
        if share < at:
            event, at = i, share
    at = 1.0 if event < 0 else max(at, 1e-4)
    for i in range(4):
        y[i] += at * (c1[i] + at * (c2[i] + at * c3[i]))
    if event == 0 or event == 1:
        y[1] = 0.0
    if event == 1:
        y[0] = moves * p[STOP]
    if event > 1:
        y[event] = bound[event - 2]
    return at * h, (way if event == 0 and moves == 0 else 0.0)


@quick
def segment(p, start, time, motor, edges_a, edges_b, out):
    y, work, flags = start.copy(), np.empty((8, 4)), np.empty((2, 2), dtype=np.bool_)
    opened = np.zeros(2, dtype=np.bool_)
    now, loose, a, b = time[0], 0.0, 0, 0
    for row in range(len(time)):
        while row > 0 and now < time[row]:
            while edges_a[a] <= now:
                opened[0] = not opened[0]
                a += 1
            while edges_b[b] <= now:
                opened[1] = not opened[1]
                b += 1
            end = min(time[row], edges_a[a], edges_b[b])
            left = end - now
            while left > 1e-15:
                gone, loose = step(p, y, motor[row - 1], opened, loose, left, work, flags)
                left -= gone
            now = end
        out[0, row], out[1, row], out[2, row] = y[0], y[2], y[3]


@numba.njit(cache=True, parallel=True)
def simulate(plants, starts, time, motor, edges_a, edges_b):
    """Position and pressures (n, 3, rows) of n segments, each with its own plant (n, 25)."""
    out = np.empty((len(plants), 3, time.shape[1]))
    for i in numba.prange(len(plants)):
        segment(plants[i], starts[i], time[i], motor[i], edges_a[i], edges_b[i], out[i])
    return out
