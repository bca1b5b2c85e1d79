"""The job with casadi's exact derivatives and scipy's least_squares: JOB.npz RESULT.txt.

The steps of `plant.h` without branches: each is taken to its events, three at most. casadi compiles
them by way of C; the program stays beside the job.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix, vstack
from shooting import DESCENT, PLACES, SHARED, START, Job

GAMMA, SECOND = 0.43586652150845899942, 0.28206673924577050029
THIRD = (1.2084966491760100703, -0.64436317068446906972)


def either(condition: Any, one: Any, other: Any) -> Any:
    return ca.if_else(condition, one, other)


class Plant:
    """The plant's equations on casadi's symbols; `p` its 25 numbers."""

    def __init__(self, p: Any) -> None:
        self.fs, self.fc, self.c, self.inertia, self.gravity, self.offset, self.most = p[:7]
        self.area, self.dead, (self.radius, self.stop, self.k, self.rt, self.p0, self.ps) = (
            p[7:9],
            p[9:11],
            p[11:17],
        )
        self.choked_fill, self.choked_dis, self.c_fill, self.c_dis = (
            p[i : i + 2] for i in (17, 19, 21, 23)
        )

    def effort(self, y: Any, motor: Any) -> Any:
        cylinder = (y[2] - self.p0) * self.area[0] - (y[3] - self.p0) * self.area[1]
        driven = ca.fmin(ca.fmax(motor, -self.most), self.most)
        return cylinder * self.radius + driven - self.gravity * ca.sin(y[0]) + self.offset

    def volume(self, s: int, y: Any) -> Any:
        return (self.dead[s] + (1.0 - 2.0 * s) * self.radius * y[0]) * self.area[s]

    def pressure_rate(self, s: int, opened: Any, choked: Any, y: Any) -> Any:
        gap = self.ps - y[2 + s]
        fill = either(choked, self.choked_fill[s], self.c_fill[s] * root(gap))
        exhaust = either(choked, -self.choked_dis[s], self.c_dis[s] * (self.p0 - y[2 + s]))
        swept = (1.0 - 2.0 * s) * self.radius * y[1] * self.area[s]
        flow = either(opened, fill, exhaust)
        return self.k * (self.rt * flow - y[2 + s] * swept) / self.volume(s, y)

    def margin(self, y: Any, motor: Any) -> tuple[Any, Any]:
        applied = self.effort(y, motor)
        limit, way = ca.fmax(self.fs, self.fc), either(applied > 0, 1.0, -1.0)
        return either(way * y[0] >= self.stop, limit, limit - way * applied), way

    def near_supply(self, s: int, y: Any, h: Any, speed: Any) -> tuple[Any, Any]:
        v, side = self.volume(s, y), (1.0 - 2.0 * s) * self.radius * self.area[s]
        gap = self.ps - y[2 + s]
        k0 = h * self.k * self.rt / v * self.c_fill[s]
        g0 = k0 * root(gap) - h * self.pressure_rate(s, 1, 0, y)
        shrunk = 1.0 / (1.0 + 0.5 * h * side * (y[1] + speed) / v)
        k1, d = k0 * shrunk, gap
        g1 = g0 + h * self.k * y[2 + s] / v * side * (speed * shrunk - y[1])

        def stage(d: Any, at: float) -> Any:
            stiff, gain = 0.5 * (k0 + at * (k1 - k0)), 0.5 * (g0 + at * (g1 - g0))
            known, part = d + GAMMA * gain, GAMMA * stiff
            z = 0.5 * (ca.sqrt(part * part + 4.0 * ca.fabs(known) + 1e-300) - part)
            return gain - stiff * either(known < 0, -z, z)

        for i in range(2):
            a = stage(d, 0.5 * (i + GAMMA))
            b = stage(d + SECOND * a, 0.5 * (i + GAMMA + SECOND))
            d += THIRD[0] * a + THIRD[1] * b
            d += GAMMA * stage(d, 0.5 * (i + 1.0))
        return ca.fabs(gap) < k0 * k0 + 2.0 * ca.fabs(g0), (gap - d) / either(h > 0, h, 1.0)

    def step(self, y: list[Any], loose: Any, h: Any, motor: Any, opened: Any) -> Any:
        """States, `loose` and the time after a step of at most h s."""
        m1, way = self.margin(y, motor)
        starts = ca.logic_or(m1 < 0, loose * way > 0)
        moves = either(y[1] != 0, ca.sign(y[1]), either(starts, way, 0.0))
        bound, above, held, rate = [], [], [], []
        for s in range(2):
            bound.append(either(opened[s], 0.53 * self.ps, self.p0 / 0.53))
            excess = y[2 + s] - bound[s]
            up = self.pressure_rate(s, opened[s], 1 - opened[s], y) > 0
            down = self.pressure_rate(s, opened[s], opened[s], y) < 0
            driven = either(up, 1.0, either(down, -1.0, 0.0))
            on = ca.fabs(excess) <= 1e-10 * bound[s]
            above.append(either(on, driven, either(excess > 0, 1.0, -1.0)))
            held.append(above[s] == 0)
            rate.append(0.0 * h)
        choked = [either(above[s] < 0, opened[s], 1 - opened[s]) for s in range(2)]

        def rates(z: list[Any]) -> tuple[list[Any], Any]:
            net = self.effort(z, motor) - self.fc * moves - self.c * z[1]
            own = [z[1], either(moves == 0, 0.0, net / self.inertia)]
            for s in range(2):
                free = self.pressure_rate(s, opened[s], choked[s], z)
                own.append(either(held[s], rate[s], free))
            return own, self.margin(z, motor)

        k1, _ = rates(y)
        for s in range(2):
            near, approach = self.near_supply(s, y, h, y[1] + h * k1[1])
            fills = ca.logic_and(opened[s], ca.logic_and(choked[s] == 0, above[s] != 0))
            stiff = ca.logic_and(fills, near)
            rate[s] = either(stiff, approach, rate[s])
            held[s] = ca.logic_or(held[s], stiff)
            k1[2 + s] = either(stiff, approach, k1[2 + s])
        k2, (m2, _) = rates([a + 0.5 * h * b for a, b in zip(y, k1, strict=True)])
        third = [a + h * (2.0 * c - b) for a, b, c in zip(y, k1, k2, strict=True)]
        k3, (m3, way) = rates(third)
        c = [
            (
                a,
                h * b,
                h * (2.0 * d - 1.5 * b - 0.5 * e),
                h * (2.0 / 3.0) * (b - 2.0 * d + e),
            )
            for a, b, d, e in zip(y, k1, k2, k3, strict=True)
        ]
        margin = (m1, 2.0 * (m2 - m1), 0.5 * (m3 - 2.0 * m2 + m1), 0.0)
        turn = [either(moves == 0, m, moves * v) for m, v in zip(margin, c[1], strict=True)]
        stop = [moves * self.stop * moves - moves * c[0][0], *(-moves * q for q in c[0][1:])]
        switches = [
            [a * (q[0] - b), *(a * r for r in q[1:])]
            for a, b, q in zip(above, bound, c[2:], strict=True)
        ]
        shares = [turns(*e) for e in (turn, stop, *switches)]
        at = ca.fmin(ca.fmin(shares[0], shares[1]), ca.fmin(shares[2], shares[3]))
        is_event = [ca.logic_and(share == at, at < 2.0) for share in shares]
        at = either(at < 2.0, ca.fmax(at, 1e-4), 1.0)
        z = [a + at * (b + at * (d + at * e)) for a, b, d, e in c]
        z[0] = either(is_event[1], moves * self.stop, z[0])
        z[1] = either(ca.logic_or(is_event[0], is_event[1]), 0.0, z[1])
        for s in range(2):
            z[2 + s] = either(is_event[2 + s], bound[s], z[2 + s])
        broke = ca.logic_and(is_event[0], moves == 0)
        return z, either(broke, way, 0.0), at * h


def root(x: Any) -> Any:
    return ca.sign(x) * ca.sqrt(ca.fabs(x) + 1e-300)


def turns(c0: Any, c1: Any, c2: Any, c3: Any) -> Any:
    slope, bend = c1 - 0.5 * c3, c2 + 1.5 * c3
    wide = ca.sqrt(ca.fabs(slope * slope - 4.0 * bend * c0) + 1e-300)
    rises = slope > 0
    top = either(rises, slope + wide, 2.0 * c0)
    bottom = either(rises, -2.0 * bend, wide - slope)
    first = top / either(bottom == 0, 1e-300, bottom)
    s = either(first < 1.0, first, 0.5)
    for _ in range(2):
        f = c0 + s * (c1 + s * (c2 + s * c3))
        slope = c1 + s * (2.0 * c2 + s * 3.0 * c3)
        s = ca.fmin(ca.fmax(s - f / either(slope == 0, -1e-300, slope), 0.0), 1.0)
    ends = ca.logic_and(c0 + c1 + c2 + c3 < 0, first < 1.0)
    return either(ends, s, 2.0)


def compiled(function: Any, folder: Path) -> Any:
    """A function and its derivatives by way of C, kept in a folder."""
    library = folder / "one.so"
    if not library.exists():
        made = ca.CodeGenerator("one.c")
        made.add(function)
        for count in (1, START + SHARED):  # it looks for the first before it asks for all
            made.add(function.forward(count))
        made.generate(f"{folder}/")
        flags = ["-O2", "-fPIC", "-shared", "-o", str(library)]
        subprocess.run(["cc", *flags, str(folder / "one.c"), "-lm"], check=True)
    return ca.external("one", str(library))


def simulation(plant: Any, steps: int, folder: Path) -> tuple[Any, Any]:
    """States after each of many sub-steps, and the same with derivatives by 14 unknowns.

    The accumulated state: position, velocity, pressures, `loose`, eight logarithms.
    """
    state, given = ca.SX.sym("state", 5 + SHARED), ca.SX.sym("given", 4)
    numbers = [ca.SX(float(v)) for v in plant]
    for i, place in enumerate(PLACES):
        numbers[place] = numbers[place] * ca.exp(state[5 + i])
    own = Plant(numbers)
    y, loose, left = [state[i] for i in range(4)], state[4], given[0]
    for _ in range(3):
        y, loose, gone = own.step(y, loose, left, given[1], (given[2], given[3]))
        left = left - gone
    # Three events in a sub-step of 1 ms are all that is looked for.
    after = ca.vertcat(*y, loose, state[5:])
    one = compiled(ca.Function("one", [state, given], [after]), folder)
    many = one.mapaccum("many", steps)
    return many, many.forward(START + SHARED)


class Shooting:
    """Simulates every segment by casadi, with derivatives where asked."""

    def __init__(self, path: str) -> None:
        self.job = Job(path, self.simulate)
        found = [self.table(i) for i in range(self.job.count)]
        steps = max(table.shape[1] for table, _ in found)
        self.tables = [(np.pad(t, ((0, 0), (0, steps - t.shape[1]))), rows) for t, rows in found]
        self.plain, self.forward = simulation(self.job.data["plant"], steps, Path(path).parent)

    def table(self, i: int) -> tuple[Any, Any]:
        """Sub-steps (4, steps): duration, motor, both valves; which of them end at a row."""
        d = self.job.data
        time, edges = d["time"][i], (d["edges_a"][i], d["edges_b"][i])
        inside = [e[(e > time[0]) & (e < time[-1])] for e in edges]
        ends = np.unique(np.concatenate([time, *inside]))
        row = np.searchsorted(time, ends[:-1], side="right") - 1
        opened = [np.searchsorted(e, ends[:-1], side="right") % 2 for e in edges]
        table = np.array([np.diff(ends), d["motor"][i][row], *opened], dtype=float)
        return table, np.searchsorted(ends, time[1:]) - 1

    def states(self, logs: Any, starts: Any) -> Any:
        return np.concatenate([starts, np.zeros((len(starts), 1)), logs], axis=1)

    def simulate(self, plants: Any, starts: Any, *_: Any) -> Any:
        logs = np.log(plants[:, PLACES] / self.job.data["plant"][PLACES])
        out = np.empty_like(self.job.data["measured"])
        for i, start in enumerate(self.states(logs, starts)):
            table, rows = self.tables[i]
            found = np.asarray(self.plain(start, table))
            out[i, :, 0] = start[[0, 2, 3]]
            out[i, :, 1:] = found[[0, 2, 3]][:, rows]
        return out

    def slopes(self, plants: Any, starts: Any) -> tuple[Any, Any]:
        """Channels (n, 3, rows) and their slopes (n, 12, 3, rows) by start and logarithms."""
        logs = np.log(plants[:, PLACES] / self.job.data["plant"][PLACES])
        out = np.empty_like(self.job.data["measured"])
        along = np.empty((len(out), START + SHARED, *out.shape[1:]))
        seeds = np.zeros((5 + SHARED, START + SHARED))
        seeds[:4, :4], seeds[5:, 4:] = np.eye(4), np.eye(SHARED)
        for i, start in enumerate(self.states(logs, starts)):
            table, rows = self.tables[i]
            found = np.asarray(self.plain(start, table))
            still = np.zeros((4, table.shape[1] * (START + SHARED)))
            slope = np.asarray(self.forward(start, table, found, seeds, still))
            slope = slope.reshape(5 + SHARED, START + SHARED, -1)[[0, 2, 3]]
            out[i, :, 0], out[i, :, 1:] = start[[0, 2, 3]], found[[0, 2, 3]][:, rows]
            along[i, :, :, 0] = seeds[[0, 2, 3]].T
            along[i, :, :, 1:] = slope[:, :, rows].transpose(1, 0, 2)
        return out, along

    def jacobian(self, free: Any) -> Any:
        """Of `Job.residual`, sparse."""
        job, x = self.job, self.job.with_free(free)
        d, rows = job.data, job.data["measured"][0].size
        starts = d["starts"] + d["widths"] * x[job.first_start :].reshape(-1, START)
        errors, along = self.slopes(job.plants(x), starts)
        errors = (errors - d["measured"]) / d["noise"][:, None]
        along /= d["noise"][:, None]
        along[:, :START] *= d["widths"][:, :, None, None]
        along = self.scaled(errors, along)
        place, values = [], []
        for i, test in enumerate(job.test):
            s, t = job.first_start + START * i, SHARED + 2 * test
            by = along[i, START:]
            # A log's own friction stands for the model's; viscous friction is over Coulomb's.
            own = [*along[i, :START], by[1] + by[2], by[0], *by[2:]]
            place.append([*range(s, s + START), t, t + 1, *range(2, SHARED)])
            values.append([o.ravel() for o in own])
        wide = len(place[0])
        columns = np.repeat(np.array(place), rows, axis=0).ravel()
        data = np.concatenate([np.array(v).T.ravel() for v in values])
        count = job.count * rows
        ends = np.arange(count + 1) * wide
        found = csr_matrix((data, columns, ends), shape=(count, len(x)))
        return vstack([found, job.prior], format="csc")[:, np.flatnonzero(job.free)].tocsr()

    def scaled(self, errors: Any, along: Any) -> Any:
        """The slopes of the errors times `Job.scale`, which moves with them."""
        scale = self.job.scale(errors)[:, None]
        if not self.job.robust:
            return along * scale
        errors = errors[:, None]
        size = np.maximum(np.mean(errors**2, axis=-1, keepdims=True), 1e-12)
        grows = 0.5 / ((1.0 + size) * np.log1p(size)) - 0.5 / size
        by = 2.0 * np.mean(errors * along, axis=-1, keepdims=True)
        return scale * (along + errors * grows * by)


def main() -> None:
    """All stages, with casadi's Jacobian in each descent."""
    shooting = Shooting(sys.argv[1])

    def descend(job: Job) -> Any:
        return least_squares(
            job.residual,
            job.x[job.free],
            jac=shooting.jacobian,
            max_nfev=64,
            **DESCENT,
        ).x

    shooting.job.solve(descend, sys.argv[2])


if __name__ == "__main__":
    main()
