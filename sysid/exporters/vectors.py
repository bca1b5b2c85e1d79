"""Inputs at random and on the edges of the laws, and Python's outputs, for C to replay."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.exporters.replay import Replay
from sysid.plant.base import Parameters, exhaust_boundary, filling_boundary
from sysid.types import FloatArray

# Rounding in single precision, of a value or its column's root mean square, and the change of an
# output, of its bound of 1e-4, beyond which a row cannot test single precision.
_ROUNDING, _MOST_CHANGE = 2.0**-21, 0.3
SINGLE, DOUBLE = 1e-4, 1e-12
# Inputs that choose: nothing is between their values.
CHOICES = ("switch", "variant", "type", "inverse")

_BAD = (np.nan, np.inf, -np.inf)


Draw = Callable[[np.random.Generator, int], FloatArray]


@dataclass(frozen=True)
class Vectors:
    """Rows of one function: `inputs` (n, in), `outputs` (n, out), `scale` (out,).

    `scale` is each output's root mean square, outliers limited. `bounds` (n, 2) is the relative
    difference that a row may have in double and in single precision. In double that is 1e-12;
    where the last bits of one input move Python's own output by more (the root of subsonic flow
    at its end), it is four times that. In single it is 1e-4, or 0 for a row that is not
    compared: one within the rounding of single precision of a jump, without a clear decision, or
    beyond its range.
    """

    replay: Replay
    inputs: FloatArray
    outputs: FloatArray
    scale: FloatArray
    bounds: FloatArray


def draws(p: Parameters) -> dict[str, tuple[Draw, Sequence[float]]]:
    """For each kind of input how it is drawn, with its edges, about the parameters of a rig.

    A parameter that is not known (NaN) is taken as that of a small rig.
    """
    atmosphere, supply = _known(p.atmosphere, 1e5), _known(p.supply, 3e5)
    lever, stroke = _known(p.pitch_radius, 0.04), _known(p.stroke, 0.1)
    reach = min(0.45 * stroke / lever, 1e3)
    speed = min(reach, 1.0)  # so that a horizon does not end beyond the travel
    effort = min(_known(p.max_effort, 1.0), 100.0)
    flow = 1.2 * max(_known(p.choked_fill_a, 1e-3), _known(p.choked_fill_b, 1e-3), 1e-6)
    corners = [atmosphere, supply, filling_boundary(supply), exhaust_boundary(atmosphere)]
    corners += [np.nextafter(c, way) for c in corners for way in (0.0, np.inf)]
    pressure = _uniform(0.8 * min(atmosphere, supply), 1.1 * max(atmosphere, supply))
    return {
        "position": (_uniform(-reach, reach), [0.0]),
        "reading": (_uniform(-reach, reach), [0.0]),
        "wanted": (_uniform(-reach, reach), [0.0]),
        "velocity": (_normal(2.0 * speed), [0.0]),
        "acceleration": (_normal(10.0 * speed), [0.0]),
        "jerk": (_normal(50.0 * speed), [0.0]),
        "pressure": (pressure, corners),
        "pressure_reading": (pressure, corners),
        "supply": (_uniform(0.7 * supply, 1.1 * supply), [supply]),
        "atmosphere": (_uniform(0.9 * atmosphere, 1.1 * atmosphere), [atmosphere]),
        "rate": (_normal(1e6), [0.0]),
        "duty": (_uniform(-0.02, 1.02), [0.0, 1.0, 1e-6, 1.0 - 1e-6, 0.5]),
        "share": (_uniform(0.0, 1.0), [0.0, 1.0]),
        "flow": (_uniform(-flow, flow), [0.0]),
        "step": (_uniform(1e-4, 5e-3), [1e-3]),
        "payload": (_uniform(0.0, 0.2), [0.0]),
        "effort": (_normal(0.5 * effort), [0.0, effort, -effort]),
        "switch": (_choice(0.0, 1.0), []),
        "variant": (_choice(0.0, 1.0, 2.0, 4.0, 8.0, 15.0), []),
        "type": (_choice(1.0, 2.0, 3.0, 4.0), []),
        "inverse": (_choice(0.0, 1.0, 2.0), []),
    }


def _known(value: float, otherwise: float) -> float:
    return float(value) if np.isfinite(value) and value > 0.0 else otherwise


def _uniform(low: float, high: float) -> Draw:
    return lambda rng, n: rng.uniform(low, high, n)


def _normal(std: float) -> Draw:
    return lambda rng, n: rng.normal(0.0, std, n)


def _choice(*values: float) -> Draw:
    return lambda rng, n: rng.choice(values, n)


def vectors(replay: Replay, p: Parameters, rows: int, seed: int) -> Vectors:
    """`rows` rows of a function; inputs off the edges are numbers of single precision.

    And two for each input, in which it is not finite, in the second another as well.
    """
    rng = np.random.default_rng([seed, *replay.name.encode()])
    kinds = draws(p)
    inputs = np.stack([_column(*kinds[kind], rng, rows) for kind in replay.inputs])
    if "wanted" in replay.inputs:
        _near(inputs, replay, rng)
    outputs = _evaluated(replay, inputs)
    scale = np.array([_scale(column) for column in outputs])
    size = np.maximum(np.abs(outputs), scale[:, None])
    size = np.where(size > 0.0, size, 1.0)
    coarse = _change(replay, inputs, outputs / size, size, is_single=True)
    fine = _change(replay, inputs, outputs / size, size, is_single=False)
    single = np.all(coarse <= _MOST_CHANGE * SINGLE, axis=(0, 1))
    # Where squares overflow in single precision: the cost of a motion far beyond the travel.
    single &= np.all(~(np.abs(outputs) > 1e18), axis=0)
    if replay.is_tie is not None:
        single &= ~replay.is_tie(list(inputs))
    # What is more, as a share, is a jump, which both take on the same side.
    room = np.max(np.where(fine < 1e-6, fine, 0.0), axis=(0, 1))
    # Roundings within a function count as that many of an input.
    bounds = np.stack([np.maximum(DOUBLE, 4.0 * room), np.where(single, SINGLE, 0.0)])
    bad = _not_finite(replay, inputs, rng)
    answers = _evaluated(replay, bad)
    if replay.answer is not None:
        answers = np.full_like(answers, replay.answer)
    tight = np.full((bad.shape[1], 2), (DOUBLE, SINGLE))
    return Vectors(
        replay,
        np.concatenate([inputs.T, bad.T]),
        np.concatenate([outputs.T, answers.T]),
        scale,
        np.concatenate([bounds.T, tight]),
    )


def _not_finite(replay: Replay, inputs: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Rows in which one or two inputs are not finite, (in, n); nothing that chooses is."""
    known = [k for k, kind in enumerate(replay.inputs) if kind not in CHOICES]
    rows = []
    for place, k in enumerate(known):
        for others in ((), rng.choice(known, 1)):
            row = inputs[:, rng.integers(inputs.shape[1])].copy()
            row[k] = _BAD[place % len(_BAD)]
            row[list(others)] = rng.choice(_BAD)
            rows.append(row)
    return np.stack(rows, axis=1) if rows else np.zeros((len(inputs), 0))


def _scale(column: FloatArray) -> float:
    """The root mean square of what is known, without the weight of outliers."""
    sizes = np.abs(column[np.isfinite(column)])
    if not np.any(sizes > 0.0):
        return 0.0
    # A column's root mean square counts what is more than this many medians as that many.
    most = 10.0 * float(np.median(sizes[sizes > 0.0]))
    return float(np.sqrt(np.mean(np.minimum(sizes, most) ** 2)))


def _change(
    replay: Replay, inputs: FloatArray, shares: FloatArray, size: FloatArray, is_single: bool
) -> FloatArray:
    """The most that rounding one input moves the outputs, as a share of `size`.

    (outputs, nudges, n)
    """
    rows = inputs.shape[1]
    nudges = list(_nudged(replay, inputs, is_single))
    # Lanes that Python works out at once.
    many, most = max(1, 40_000 // rows), []
    for k in range(0, len(nudges), many):
        moved = np.stack(nudges[k : k + many], axis=1)
        found = _evaluated(replay, moved.reshape(len(inputs), -1)).reshape(len(size), -1, rows)
        change = np.abs(found / size[:, None, :] - shares[:, None, :])
        most.append(np.nan_to_num(change, nan=0.0))
    return np.concatenate(most, axis=1) if most else np.zeros((len(size), 1, rows))


def _column(draw: Draw, edges: Sequence[float], rng: np.random.Generator, n: int) -> FloatArray:
    values = draw(rng, n).astype(np.float32).astype(float)
    if not len(edges):
        return values
    # A share of the values are on edges, or within the last bit of one.
    return np.where(rng.random(n) < 0.05, rng.choice(np.array(edges), n), values)


def _near(inputs: FloatArray, replay: Replay, rng: np.random.Generator) -> None:
    """Wanted positions near the position itself, as in a loop."""
    place = replay.inputs.index("wanted")
    own = inputs[replay.inputs.index("position")]
    near = own + rng.normal(0.0, 0.05, len(own))
    inputs[place] = near.astype(np.float32)


def _evaluated(replay: Replay, inputs: FloatArray) -> FloatArray:
    with np.errstate(all="ignore"):
        columns = replay.evaluate(list(inputs))
    return np.stack([np.broadcast_to(np.asarray(c, dtype=float), inputs[0].shape) for c in columns])


def _nudged(replay: Replay, inputs: FloatArray, is_single: bool) -> Iterator[FloatArray]:
    """Each input but those that choose, moved down and up by the rounding of a precision."""
    for k, kind in enumerate(replay.inputs):
        if kind in CHOICES:
            continue
        column = inputs[k]
        known = np.isfinite(column)
        span = np.sqrt(np.mean(column[known] ** 2))
        # An effect rounds the pressure at which a root ends otherwise in Python than in C.
        step = (
            _ROUNDING * np.maximum(np.abs(column), span) if is_single else 4.0 * np.spacing(column)
        )
        for way in (-1.0, 1.0):
            moved = inputs.copy()
            moved[k] += way * np.where(known, step, 0.0)
            yield moved


__all__ = ["CHOICES", "DOUBLE", "SINGLE", "Vectors", "draws", "vectors"]
