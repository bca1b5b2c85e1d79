"""The refinement: parameters from the bench tests to motion, and the errors before and after."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

from sysid.blocks.numbers import MISSING, estimate_cells, number, percent
from sysid.blocks.sections import Block, FigureGroup, Fold, Heading, Lines, Notes, Section
from sysid.blocks.tables import NotedCell, Table, table
from sysid.blocks.titles import within
from sysid.estimation.linear import Estimate
from sysid.io.channels import channel_of
from sysid.io.rig import Rig
from sysid.parameters.base import Number, read_number
from sysid.parameters.declared import contradictions
from sysid.parameters.refinement import (
    BeforeAndAfter,
    FiguresByUse,
    RefinedValue,
    Refinement,
    ScatterOfFriction,
)
from sysid.parameters.titles import named, title_of
from sysid.refinement import figures

HIGHLY_CORRELATED = 0.9
"""Correlation of two errors from which on tests hardly distinguish the parameters."""

_COLUMNS = (
    "No.", "Parameter", "Moved by", "Known from", "Before", "After", "Unit",
)  # fmt: skip
_USES = {"fit": "training", "holdout": "held out"}


def refinement_section(refinement: Refinement, rig: Rig) -> Section | None:
    """The section on the bundle's `refinement`; None if it holds no parameters in a known form."""
    values = refinement.values()
    if not values:
        return None
    intervals = Fold("95 % intervals", (intervals_table(refinement),))
    blocks: list[Block] = [*_excluded(refinement), before_and_after_table(values), intervals]
    wrong = contradictions(values, rig)
    if wrong:
        blocks.append(Lines(tuple(wrong)))
    blocks += _pictures(refinement, values)
    blocks += _profiles(refinement)
    if refinement.errors():
        blocks.append(errors_table(refinement))
    if refinement.effort_errors():
        blocks.append(effort_table(refinement))
    return Section("refinement", "Refinement on motion", _intro(refinement, values), tuple(blocks))


def before_and_after_table(values: Iterable[RefinedValue]) -> Table:
    """Every parameter before and after; marked where only the bench tests identify it."""
    rows = []
    for place, value in enumerate(values, start=1):
        std = read_number(value.before_std)
        limits = (math.nan, math.nan)
        before = Estimate(
            float(value.before), math.nan if std is None else std, value.after.unit, limits
        )
        unit = estimate_cells(value.after)[3]
        moved = number(read_number(value.movement), 2)
        cells = (_with_error(before), _with_error(value.after), unit)
        rows.append((str(place), named(value.name), moved, _known_from(value), *cells))
    caption = (
        "Parameters before and after, ± one standard error; the movement is in standard errors "
        "of the value before"
    )
    return table(caption, _COLUMNS, rows, text=(1, 3, 6))


def intervals_table(refinement: Refinement) -> Table:
    """The 95 % interval of every parameter: by its standard error, and by profile where known."""
    profiles = refinement.profiled()
    rows: list[tuple[str, ...]] = []
    for value in refinement.values():
        _, _, interval, unit = estimate_cells(value.after)
        found = profiles.get(value.name)
        by_profile = MISSING
        if found is not None:
            low, high = (_limit(limit) for limit in found.interval)
            own = Estimate(value.after.value, value.after.std, value.after.unit, (low, high))
            by_profile = estimate_cells(own)[2]
        rows.append((named(value.name), interval, by_profile, unit))
    columns = ["Parameter", "By standard error", "By profile likelihood", "Unit"]
    if not profiles:
        columns, rows = columns[:2] + columns[3:], [(*row[:2], row[3]) for row in rows]
    return table("95 % intervals after", columns, rows, text=(len(columns) - 1,))


def _limit(value: Number | None) -> float:
    return math.nan if value is None else float(value)


def _known_from(value: RefinedValue) -> str:
    if value.informed_by_motion:
        return "motion"
    if value.after.std is None or not math.isfinite(value.after.std):
        return MISSING
    return "rig file" if value.origin == "rig" else "bench"


def _with_error(estimate: Estimate) -> str:
    """Value ± standard error, with one power of ten."""
    value, error, _, _ = estimate_cells(estimate)
    if error == MISSING:
        return value
    size, cross, power = value.partition(" × ")
    both = f"{size} ± {error.partition(' × ')[0]}"
    return f"({both}){cross}{power}" if cross else both


def _intro(refinement: Refinement, values: list[RefinedValue]) -> tuple[str, ...]:
    segments = read_number(refinement.segments)
    said = f"{len(values)} parameters were estimated together, by the error of simulation"
    if segments is not None:
        said += f" over {segments:.0f} segments of the training motion tests"
        longest = read_number(refinement.longest_segment_s)
        said += "" if longest is None else f", the longest of {longest:.2g} s"
    lines = [f"{said}. {_state(refinement)}".strip(), _informed(values)]
    scatter = refinement.friction_scatter
    if isinstance(scatter, ScatterOfFriction):
        lines.append(
            "Friction differs from test to test: each test has its own, with a standard deviation "
            f"of {percent(100.0 * scatter.sliding, 2)} for sliding and "
            f"{percent(100.0 * scatter.static, 2)} for static friction (2 % where none shows it)."
        )
    return tuple(lines)


def _state(refinement: Refinement) -> str:
    """How the estimation ended."""
    count = read_number(refinement.evaluations)
    after = "" if count is None else f" after {count:.0f} simulations of all of them"
    parts = []
    if refinement.converged is True:
        parts.append(f"The estimation converged{after}.")
    elif refinement.converged is False:
        parts.append(
            f"The estimation did not converge: it stalled{after}, so that values and standard "
            "errors are those of the best point found."
        )
    return " ".join(parts)


def _excluded(refinement: Refinement) -> list[Block]:
    """The share of the training tests that the numbers do not rest on."""
    used, left_out = (
        read_number(refinement.segments),
        read_number(refinement.segments_left_out),
    )
    if not left_out:
        return []
    many = left_out > 1
    of = "" if used is None else f" of {used + left_out:.0f}"
    return [
        Notes(
            (
                f"{left_out:.0f}{of} segments {'are' if many else 'is'} excluded, as the model "
                f"does not follow {'them' if many else 'it'} from any start state: the numbers "
                "hold for the others.",
            )
        )
    ]


def _informed(values: list[RefinedValue]) -> str:
    told = [_within(v.name) for v in values if v.informed_by_motion]
    rest = [_within(v.name) for v in values if not v.informed_by_motion]
    if not rest:
        return "The motion tests inform every parameter."
    if not told:
        return "The motion tests inform none of them beyond what was known before."
    return (
        f"The motion tests inform {'; '.join(told)}. They say less than what was known before of "
        f"{'; '.join(rest)}."
    )


def _within(name: str) -> str:
    """A number's title within a sentence."""
    title = title_of(name)
    return title if title == name else within(title)


def _pictures(refinement: Refinement, values: list[RefinedValue]) -> list[Block]:
    """Movement and correlation."""
    drawn, caption = [], ""
    if any(value.movement is not None for value in values):
        drawn.append(figures.movement(values))
        caption = (
            "Movement from bench to motion: diamonds with the 95 % interval after, over that "
            "before (shaded); grey where the motion tests add nothing. "
        )
    matrix = refinement.correlations()
    if len(matrix) > 1:
        drawn.append(figures.correlation(values, matrix))
        caption += (
            "Correlation of the errors after, by the table's numbers: blue the same way, orange "
            f"opposite ways; sizes from {figures.LEAST_WRITTEN} are written."
        )
        caption += _tied(values, matrix)
    return [FigureGroup(caption, tuple(drawn))] if drawn else []


def _tied(values: list[RefinedValue], matrix: list[list[float]]) -> str:
    """The pairs that these tests hardly distinguish."""
    pairs = [
        f"{_within(values[i].name)} and {_within(values[j].name)} ({number(matrix[i][j], 2)})"
        for i, j in itertools.combinations(range(len(values)), 2)
        if abs(matrix[i][j]) > HIGHLY_CORRELATED
    ]
    return f" The tests hardly distinguish: {'; '.join(pairs)}." if pairs else ""


def _profiles(refinement: Refinement) -> list[Block]:
    by_name = {value.name: value for value in refinement.values()}
    drawn = [
        figures.profile(place, by_name[name], profile)
        for place, (name, profile) in enumerate(refinement.profiled().items())
        if name in by_name and len(profile.values) == len(profile.rise) > 1
    ]
    if not drawn:
        return []
    caption = (
        "Profile likelihood: rise of the cost where one parameter is held and all others are "
        "estimated again, in units of the errors' variance. Below the line (3.84) is the 95 % "
        "interval (shaded); dashed: what the standard error predicts."
    )
    return [Heading("refinement-profiles", "Profiles"), FigureGroup(caption, tuple(drawn))]


def errors_table(refinement: Refinement) -> Table:
    """RMSE of whole tests and the residual's autocorrelation, by use and channel."""
    caption = (
        "Whole tests simulated open loop: RMSE, and the residual's autocorrelation from one "
        "sample to the next"
    )
    return _errors(caption, refinement.errors(), refinement.autocorrelations())


def effort_table(refinement: Refinement) -> Table:
    """RMSE of the equation of motion, by use: it does not add up over time as a position does."""
    caption = "Equation of motion along the measured motion: RMSE of the residual effort"
    return _errors(caption, refinement.effort_errors(), None)


def _errors(caption: str, errors: FiguresByUse, correlations: FiguresByUse | None) -> Table:
    """Errors by use and channel, with their autocorrelations where these are given."""
    columns = ["Tests", "Channel", "RMSE before", "RMSE after", "Change"]
    rows = []
    for use, channels in errors.items():
        for name, found in channels.items():
            row = [_USES.get(use, use), *_channel_cells(name, found)]
            if correlations is not None:
                white = correlations.get(use, {}).get(name)
                pair = (None, None) if white is None else (white.before, white.after)
                row += [number(read_number(c), 4) for c in pair]
            rows.append(row)
    if correlations is not None:
        columns += ["Autocorrelation before", "Autocorrelation after"]
    return table(caption, columns, rows, text=(1,))


def _channel_cells(name: str, errors: BeforeAndAfter) -> tuple[str, ...]:
    """A channel with its errors before and after, readable; SI in a terminal."""
    title, scale = name, 1.0
    try:
        channel = channel_of(name)
    except KeyError:
        pass
    else:
        title, scale = f"{channel.title} ({channel.residual_unit})", channel.residual_scale
    before, after = read_number(errors.before), read_number(errors.after)
    change = MISSING
    if before and after is not None:
        share = 100.0 * (after / before - 1.0)
        change = f"{'+' if share > 0.0 else ''}{number(share, 2)} %"
    sizes = [
        MISSING if e is None else NotedCell(number(scale * e), plain=number(e, 4))
        for e in (before, after)
    ]
    return NotedCell(title, plain=name), *sizes, change


__all__ = [
    "before_and_after_table",
    "effort_table",
    "errors_table",
    "intervals_table",
    "refinement_section",
]
