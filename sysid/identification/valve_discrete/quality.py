"""How well an on/off law follows the pressure while the chamber fills, and while it empties."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from sysid.errors import NotIdentifiedError
from sysid.estimation.quality import FitQuality, root_mean_square, scatter_test
from sysid.identification.valve_discrete.curve import CurveFit
from sysid.identification.valve_discrete.trials import FEWEST_ROWS, Piece
from sysid.parameters.valves import DIRECTIONS, LAW_NAMES, WAYS
from sysid.types import BoolArray

# From either end of the pressure, in standard deviations of the noise.
_AWAY = 5.0


def qualities(curves: CurveFit) -> dict[str, FitQuality]:
    """Quality by direction, "fill" and "discharge"; one without a fitted flow is omitted.

    The scatter is the noise of the pressure sensor. The rows are those that the command
    assigns to a direction, while the measured or the fitted pressure moves: at rest any law
    that ends at the right pressure is right.
    """
    found = {}
    free = curves.problem.free
    for direction, what, names, commanded in (
        ("fill", "filling", curves.problem.flow_names("fill"), _filling),
        ("discharge", "discharging", curves.problem.flow_names("dis"), _emptying),
    ):
        measured, left, noise = [], [], []
        for i, piece in enumerate(curves.problem.pieces):
            rows = commanded(piece) & _moving(curves, i)
            measured.append(piece.pressure[rows])
            left.append(-curves.residuals(i)[rows])
            noise.append(np.full(int(rows.sum()), piece.noise))
        residuals = np.concatenate(left)
        if len(residuals) < FEWEST_ROWS or not set(names) & set(free):
            continue
        scatter = root_mean_square(np.concatenate(noise))
        test = scatter_test(root_mean_square(residuals), scatter)
        found[direction] = FitQuality.of(
            f"pressure while {what}",
            "Pa",
            np.concatenate(measured),
            residuals,
            has_constant=True,
            lack_of_fit=test,
            scatter=scatter,
        )
    return found


def judged(curves: CurveFit, title: str, better: Mapping[str, str]) -> dict[str, FitQuality]:
    """How well the law follows each direction; NotIdentifiedError where it does not.

    `better`: by direction, "fill" and "dis", a law that follows it decidedly better.
    """
    found = qualities(curves)
    for direction, way in zip(DIRECTIONS, WAYS, strict=True):
        if direction in found and way in better:
            found[direction] = replace(found[direction], outdone_by=LAW_NAMES[better[way]])
    wrong = [f"{title}, {q.shortfall}" for q in found.values() if q.explains_too_little]
    if wrong:
        raise NotIdentifiedError(
            f"{'; '.join(wrong)}: check for a wrong unit or time base, the other chamber's "
            "pressure, a command that is not this valve's, or a piston that moves"
        )
    return found


def rows_of(way: str, piece: Piece, fits: Iterable[CurveFit], index: int) -> BoolArray:
    """Rows (n,) of a piece that a direction, "fill" or "dis", moves as measured or by any fit."""
    commanded = _filling(piece) if way == "fill" else _emptying(piece)
    return np.asarray(commanded & np.any([_moving(fit, index) for fit in fits], axis=0))


def _moving(curves: CurveFit, index: int) -> BoolArray:
    """Rows (n,) of a piece that are away from atmosphere and supply, as measured or as fitted."""
    piece = curves.problem.pieces[index]
    away = _AWAY * piece.noise
    ends = (
        curves.value("atmosphere", index),
        float(np.mean(piece.chamber.supply)) + curves.value("supply_shift", index),
    )
    found = np.zeros(len(piece.pressure), dtype=bool)
    for values in (piece.pressure, piece.pressure + curves.residuals(index)):
        found |= np.all([np.abs(values - end) > away for end in ends], axis=0)
    return found


def _filling(piece: Piece) -> BoolArray:
    """Rows (n,) in which the valve is commanded on."""
    c = piece.chamber
    rows = np.zeros(len(c.time), dtype=bool)
    for opened, closed in zip(c.opens, c.closes, strict=True):
        rows |= (c.time >= opened) & (c.time < closed)
    return rows


def _emptying(piece: Piece) -> BoolArray:
    """Rows (n,) after the valve was switched off; all of a piece in which it never is on."""
    c = piece.chamber
    if c.bleeds is not None:
        rows = [(c.time >= begin) & (c.time < end) for begin, end in zip(*c.bleeds, strict=True)]
        return np.any(rows, axis=0) if rows else np.zeros(len(c.time), dtype=bool)
    first = float(c.closes[0]) if len(c.closes) else -math.inf
    return np.asarray((c.time >= first) & ~_filling(piece))


__all__ = ["judged", "qualities", "rows_of"]
