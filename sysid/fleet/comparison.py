"""Bundles next to each other: what moved more than the errors of both explain.

A number that two bundles hold moved by z = (second - first) / sqrt(s1^2 + s2^2): bundles of
different tests have independent errors. Standard errors of few trials are uncertain themselves: z
is Student's t with the degrees of freedom by Welch (Biometrika 34, 1947, 28-35), those of each
number being the ones of its interval. The numbers that one fit gave are also compared as a whole,
by the Wald statistic of their differences with the sum of both covariances: numbers whose errors
go together (Coulomb and viscous friction) may each move little and yet all of them much. Over the
count of numbers it is F distributed where one residual variance scales all errors; the fewest
degrees of freedom of them stand for all, which is on the safe side for errors of separate tests.
All p-values of a comparison, of numbers and of parts, are adjusted together for the false
discovery rate (`sysid.estimation.multiple_tests`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sysid.blocks.drawing import plot_panels
from sysid.blocks.figures import PANEL, Bars, Figure, Mark, Panel, Points, Role, Scale, Words
from sysid.blocks.numbers import estimate_cells as cells_of
from sysid.blocks.numbers import number, percent
from sysid.blocks.shown import Shown
from sysid.blocks.tables import NotedCell, Table, table
from sysid.blocks.titles import capital, within
from sysid.errors import InputError, input_error
from sysid.estimation.linear import LEVEL, Estimate, finite_or_none, t_p_value, t_quantile
from sysid.estimation.multiple_tests import LEAST_P, SIGNIFICANCE, adjusted, largest_significant
from sysid.io.channels import SIDES
from sysid.io.rig import differing_sections
from sysid.parameters import Bundle
from sysid.parameters.correlation import ROUNDING
from sysid.parameters.table import ParameterTable
from sysid.parameters.titles import part_title, short_title, title_of
from sysid.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# A row of a figure: its name above, the stripes of the bundles below; shares of its height, inches.
_BELOW_NAME, _STRIPES = 0.52, 0.44
_ROW, _STRIPE = 0.26, 0.06
VALVES = ("valve A", "valve B")
"""The names in a comparison of the valves of one bundle."""

State = Literal["same", "grew", "shrank", "appeared", "disappeared"]


@dataclass(frozen=True)
class Movement:
    """One number of a bundle against that of the first: in standard errors of the difference `z`.

    `name` is None for a part as a whole. `p_value` of no movement, `p_adjusted` among all of the
    comparison. `change`: the difference in the number's unit, NaN for a part. `limit`: up to
    which `z` it is not significant among them.
    """

    bundle: str
    part: str
    name: str | None
    change: float
    z: float
    p_value: float
    p_adjusted: float = math.nan
    limit: float = math.nan

    @property
    def is_significant(self) -> bool:
        """Whether it moved, the false discovery rate being 5 %."""
        return self.p_adjusted < SIGNIFICANCE

    def to_json(self) -> dict[str, Any]:
        """As `sysid compare --json` lists it."""
        return {
            "bundle": self.bundle,
            "part": self.part,
            "parameter": self.name,
            "change": finite_or_none(self.change),
            "z": finite_or_none(self.z),
            "p_value": self.p_value,
            "p_adjusted": self.p_adjusted,
            "significant": self.is_significant,
        }


@dataclass(frozen=True)
class EffectChange:
    """An effect of a bundle against the first: appeared, disappeared, grew, shrank, or the same.

    It grew or shrank where its strength, the first of its numbers, did, significantly; where only
    its shape moved it is the same, and the movement stands among the others.
    """

    bundle: str
    effect: str
    state: State

    def to_json(self) -> dict[str, Any]:
        """As `sysid compare --json` lists it."""
        return {"bundle": self.bundle, "effect": self.effect, "state": self.state}


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """The result of `compare`: `estimates` by part, parameter and bundle; what moved; effects.

    `names` are of bundles, or of the two valves of one. `respond` makes `responses`.
    """

    names: tuple[str, ...]
    parts: tuple[dict[str, ParameterTable], ...]
    movements: tuple[Movement, ...]
    effects: tuple[EffectChange, ...]
    notices: tuple[str, ...]
    respond: Callable[[], Shown | None] | None = field(default=None, repr=False, compare=False)

    @cached_property
    def responses(self) -> Shown | None:
        """Those of the on/off valves over one another; None without two."""
        return None if self.respond is None else self.respond()

    @property
    def moved(self) -> tuple[Movement, ...]:
        """The movements that are significant."""
        return tuple(m for m in self.movements if m.is_significant)

    def headline(self, *, is_titled: bool = False) -> str:
        """What moved against the first, in one line by keys, as commands have them; with titles a
        sentence without its full stop."""
        moved = list(dict.fromkeys(_label(m, is_titled=is_titled) for m in self.moved))
        against = f" against {self.names[0]}" if is_titled else ""
        none = f"no parameter moved significantly{against}"
        if not self.movements:
            none = "no parameter has a standard error in both: no movement was tested"
        said = [f"moved{against}: {', '.join(moved)}" if moved else none]
        for state in ("appeared", "disappeared", "grew", "shrank"):
            effects = dict.fromkeys(
                within(part_title(f"effect {e.effect}")) if is_titled else e.effect
                for e in self.effects
                if e.state == state
            )
            said += [f"{state}: {', '.join(effects)}"] if effects else []
        if is_titled:
            return capital("; ".join(said))
        what = "valves" if self.names == VALVES else "bundles"
        return f"{len(self.names)} {what}, against {self.names[0]}: {'; '.join(said)}"

    def records(self) -> list[dict[str, Any]]:
        """One record per number and bundle: value, std, limits, unit, and its movement."""
        by_place = {(m.bundle, m.part, m.name): m for m in self.movements}
        records = []
        for part, key in self._keys():
            for name, parts in zip(self.names, self.parts, strict=True):
                found = _estimate(parts, part, key)
                if found is None:
                    continue
                moved = by_place.get((name, part, key))
                records.append(
                    {
                        "part": part,
                        "parameter": key,
                        "bundle": name,
                        "value": found.value,
                        "std": found.std,
                        "low": found.interval[0],
                        "high": found.interval[1],
                        "unit": found.unit,
                        "z": math.nan if moved is None else moved.z,
                        "p_adjusted": math.nan if moved is None else moved.p_adjusted,
                        "significant": moved is not None and moved.is_significant,
                    }
                )
        return records

    def tables(self) -> Iterable[Table]:
        """The numbers next to each other, what moved, the effects, and the valves' responses."""
        yield table(
            "Parameters with 95 % intervals; * moved significantly against the first",
            (*_heads("part", "parameter", "unit"), *self.names),
            tuple(self._row(part, key) for part, key in self._keys()),
            text=(1, 2),
            grouped=True,
            across=True,
        )
        yield table(
            "What moved, most significant first",
            (*_heads("bundle", "part", "parameter", "change", "in std. errors"), "p, adjusted"),
            tuple(self._moved_row(m) for m in sorted(self.moved, key=lambda m: m.p_value)),
            text=(1, 2),
        )
        yield table(
            "Effects against the first",
            _heads("bundle", "effect", "change"),
            tuple(
                (e.bundle, _part_cell(f"effect {e.effect}", is_short=True), e.state)
                for e in self.effects
                if e.state != "same"
            ),
            text=(1, 2),
        )
        if self.responses is not None:
            yield from self.responses.tables()

    def plot(self, ax: Axes | None = None) -> Axes:
        """Every number that both have, in standard errors of the difference from the first."""
        return plot_panels(self.figure().panels, ax)[0]

    def figure(self) -> Figure:
        """What `plot` draws."""
        keys = list(dict.fromkeys((m.part, m.name) for m in self.movements if m.name))
        roles: tuple[Role, ...] = ("model", "second", "third", "fourth", "ink")
        last = len(keys) - 1  # the first is at the top, as in the table
        marks: list[Mark] = []
        others = self.names[1:]
        for place, name in enumerate(others):
            found = {(m.part, m.name): m for m in self.movements if m.bundle == name}
            role = roles[place % len(roles)]
            # One row a number, and in it one stripe a bundle, the first bundle's at the top.
            share = _STRIPES / len(others)
            below = _BELOW_NAME + share * (place + 0.5)
            at = {k: last - i + 0.5 - below for i, k in enumerate(keys) if k in found}
            limits = np.array([found[k].limit for k in at])
            rows = np.array(list(at.values()))
            grey = "" if place else "not significant"
            marks.append(Bars(rows, limits, "grid", grey, 0.9 * share, -limits, is_across=True))
            for is_moved in (False, True):
                own = [(found[k].z, y) for k, y in at.items()
                       if found[k].is_significant == is_moved]  # fmt: skip
                if own:
                    said = f"{name}, moved" if is_moved else name
                    x, y = np.transpose(own)
                    marks.append(Points(x, y, role, said, is_filled=is_moved))
        for i, key in enumerate(keys):
            row = Words(0.0, last - i + 0.5 - 0.5 * _BELOW_NAME, _title(*key), is_at_edge=True)
            marks.append(row)
        reach = 1.08 * max((max(m.limit, abs(m.z)) for m in self.movements if m.name), default=1.0)
        scale = Scale("Change", "standard errors of the difference", (-reach, reach))
        rows_of = Scale(limits=(-0.5, last + 0.5))
        # Between the rows of numbers a legend would hide points.
        panel = Panel(scale, rows_of, tuple(marks), legend="over", has_names=True)
        size = (PANEL[0], 1.0 + (_ROW + _STRIPE * len(others)) * len(keys))
        title = "Each number against the first"
        described = self.headline(is_titled=True)
        return Figure("fig-moved", title, described, (panel,), size=size)

    def to_json(self) -> dict[str, Any]:
        """The object that `sysid compare --json` prints."""
        return {
            "bundles": list(self.names),
            "parameters": _plain(self.records()),
            "moved": [m.to_json() for m in self.movements],
            "effects": [e.to_json() for e in self.effects],
            "responses": [] if self.responses is None else _plain(self.responses.records()),
            "notices": list(self.notices),
        }

    def _keys(self) -> list[tuple[str, str]]:
        rows = (row for parts in self.parts for part in parts.values() for row in part.rows)
        return list(dict.fromkeys((row.part, row.key) for row in rows))

    def _row(self, part: str, key: str) -> tuple[str, ...]:
        moved = {m.bundle for m in self.moved if (m.part, m.name) == (part, key)}
        cells, unit = [], ""
        for name, parts in zip(self.names, self.parts, strict=True):
            found = _estimate(parts, part, key)
            if found is None:
                cells.append("")
                continue
            value, _, interval, shown_unit = cells_of(found)
            unit = shown_unit or unit
            star = " *" if name in moved else ""
            between = interval if interval.startswith("(") else f"({interval})"
            # A power of ten that the interval has too is written once, behind both.
            short = value.partition(" × ")[0] if " × " in between else value
            plain = f"{short} {between}{star}" if found.identified else value
            small = interval if found.identified else ""
            cells.append(NotedCell(f"{value}{star}", small, plain))
        return (_part_cell(part), _key_cell(part, key), unit, *cells)

    def _moved_row(self, m: Movement) -> tuple[str, ...]:
        change = number(m.change)
        first = _estimate(self.parts[0], m.part, m.name or "")
        if first is not None:
            moved = Estimate(m.change, abs(m.change / m.z), first.unit, (math.nan, math.nan))
            value, _, _, unit = cells_of(moved)
            change = f"{value} {unit}".rstrip()
        if first is not None and first.value != 0.0:
            change += f" ({percent(100.0 * m.change / abs(first.value))})"
        p = "<1e-20" if m.p_adjusted < 1e-20 else number(m.p_adjusted, 2)
        key = _key_cell(m.part, m.name) if m.name else "all of it"
        return (m.bundle, _part_cell(m.part), key, change, number(m.z), p)


def _plain(records: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Records as JSON holds them: null for what is not a number."""
    return [
        {k: finite_or_none(v) if isinstance(v, float) else v for k, v in record.items()}
        for record in records
    ]


def compare_bundles(bundles: Sequence[Bundle], names: Sequence[str]) -> Comparison:
    """Each bundle against the first, or valve B of one bundle against its valve A.

    `names` distinguish the bundles in what is shown. Bundles of one motion (rotary or linear) are
    comparable; a different rig file is reported in a notice. Raises InputError for none, for one
    without two valves, and for bundles of other motion or of no part in common.
    """
    if len(bundles) < 2:
        return _compared(VALVES, _by_valve(bundles, names), ())
    _check_comparable(bundles, names)
    parts = [bundle.parameters.fitted().parts() for bundle in bundles]
    if not any(set(parts[0]) & set(other) for other in parts[1:]):
        raise _nothing_shared(bundles, names)
    laws = [_laws(bundle) for bundle in bundles]
    said = [
        line
        for name, found, own in zip(names[1:], parts[1:], laws[1:], strict=True)
        for line in _of_laws(names[0], name, (parts[0], found), (laws[0], own))
    ]
    return _compared(names, parts, (*_notices(bundles, names), *said), laws)


def _by_valve(bundles: Sequence[Bundle], names: Sequence[str]) -> list[dict[str, ParameterTable]]:
    """The parts of valve A and of valve B of the one bundle, under names that both have."""
    if not bundles:
        raise input_error("compare", "no bundle", "give at least one with two valves")
    parts = bundles[0].parameters.fitted().parts()
    found: list[dict[str, ParameterTable]] = []
    for side in SIDES:
        prefix = f"valves.{side}."
        own = {place: held for place, held in parts.items() if place.startswith(prefix)}
        found.append({})
        for place, held in own.items():
            shared = f"valve {place.removeprefix(prefix)}"
            rows = tuple(replace(row, part=shared) for row in held.rows)
            found[-1][shared] = replace(held, rows=rows)
    if not found[0].keys() & found[1].keys():
        raise input_error(
            names[0],
            "holds no law of valve A that valve B has too",
            "give at least two bundles, or one with both valves",
        )
    return found


def _compared(
    names: Sequence[str],
    parts: Sequence[dict[str, ParameterTable]],
    notices: tuple[str, ...],
    laws: Sequence[_Laws] = (),
) -> Comparison:
    """The parts of each name against those of the first; `laws` that their tests leave open."""
    known = laws or [_Laws()] * len(names)
    movements = [
        m
        for name, other, own in zip(names[1:], parts[1:], known[1:], strict=True)
        for m in _moves(parts[0], other, name, (known[0], own))
    ]
    p_values = [m.p_value for m, _ in movements]
    level = 1.0 - largest_significant(p_values) if p_values else LEVEL
    moves = tuple(
        replace(m, p_adjusted=float(p), limit=t_quantile(dof, level))
        for (m, dof), p in zip(movements, adjusted(p_values), strict=True)
    )
    effects = [
        change
        for name, other in zip(names[1:], parts[1:], strict=True)
        for change in _effects(parts[0], other, name, moves)
    ]
    return Comparison(tuple(names), tuple(parts), moves, tuple(effects), notices)


def _nothing_shared(bundles: Sequence[Bundle], names: Sequence[str]) -> InputError:
    if all(_has_surfaces(bundle) for bundle in bundles):
        return input_error(
            names[1],
            f"has nothing in common with {names[0]} but PWM surfaces, which are not compared",
            "compare what `sysid validate` says of both",
        )
    return input_error(
        names[1], f"holds no part that {names[0]} holds", "compare bundles of the same tests"
    )


def _has_surfaces(bundle: Bundle) -> bool:
    return any(bundle.valve(side).pwm is not None for side in SIDES)


def _holds_surface(bundle: Bundle) -> bool:
    """Whether a surface was fitted, not only requested."""
    found = [bundle.valve(side).pwm for side in SIDES]
    return any(one.surfaces() for pwm in found if pwm for one in pwm.directions().values())


def _check_comparable(bundles: Sequence[Bundle], names: Sequence[str]) -> None:
    for name, bundle in zip(names[1:], bundles[1:], strict=True):
        if bundle.is_linear != bundles[0].is_linear:
            kinds = [b.units.motion for b in (bundle, bundles[0])]
            raise input_error(
                name,
                f"is of a {kinds[0]} rig, {names[0]} of a {kinds[1]} one: their units differ",
                "compare bundles of the same kind of rig",
            )


def _notices(bundles: Sequence[Bundle], names: Sequence[str]) -> tuple[str, ...]:
    said = []
    for name, bundle in zip(names[1:], bundles[1:], strict=True):
        if differ := differing_sections(bundles[0].rig_content, bundle.rig_content):
            sections = ", ".join(f"[{k}]" for k in differ)
            said.append(f"{name}: another rig file than that of {names[0]}: {sections} differs")
        logs = {e.sha256 for e in bundle.provenance.logs if e.use == "fit"}
        shared = logs & {e.sha256 for e in bundles[0].provenance.logs if e.use == "fit"}
        if shared:
            said.append(
                f"{name}: {len(shared)} of its {len(logs)} training logs are those of {names[0]}: "
                "the errors of both are not independent, and movements appear smaller than they are"
            )
        if _holds_surface(bundle) and _holds_surface(bundles[0]):
            said.append(
                f"{name}: its PWM surfaces are not compared with those of {names[0]}; compare what "
                "`sysid validate` says of both"
            )
    return tuple(said)


class _Laws(dict[str, dict[str, Mapping[str, Estimate]]]):
    """By part: the numbers by each law that the tests leave open, by its name."""

    def shared(self, other: _Laws, part: str) -> list[str] | None:
        """The laws of a part that both have; None where either does not say its laws."""
        if part not in self or part not in other:
            return None
        return [law for law in self[part] if law in other[part]]


def _laws(bundle: Bundle) -> _Laws:
    found = _Laws()
    for side in SIDES:
        held = bundle.valve(side).discrete
        if held is not None and isinstance(held.by_law, list) and held.by_law:
            found[f"valves.{side}.discrete"] = {one.law: one.numbers for one in held.by_law}
    return found


def _of_laws(
    first: str,
    name: str,
    parts: tuple[dict[str, ParameterTable], dict[str, ParameterTable]],
    laws: tuple[_Laws, _Laws],
) -> Iterator[str]:
    """By which laws a part's numbers are compared, and whether intervals that cover several of
    them overlap."""
    for place in laws[0]:
        shared = laws[0].shared(laws[1], place)
        if shared is None:
            continue
        one, two = (" or ".join(own[place]) for own in laws)
        if not shared:
            yield (
                f"{name}: {place} follows the flow law {two}, that of {first} {one}: numbers of "
                "different laws are not compared; fit both with the same --law"
            )
            continue
        if len(laws[0][place]) == len(laws[1][place]) == 1:
            continue
        both = [
            (key, estimate, parts[1][place].estimates[key])
            for key, estimate in parts[0][place].estimates.items()
            if key in parts[1][place].estimates and estimate.has_error
        ]
        met = [f"{key} {'overlap' if _overlap(*pair) else 'do not overlap'}" for key, *pair in both]
        of_both = f"{one} in {first}, {two} in {name}" if one != two else f"{one} in both"
        yield (
            f"{name}: {place}: the flow law is not decided ({of_both}): a number moved where it "
            f"did by each law that both may have ({', '.join(shared)}); the intervals, which cover "
            f"the laws, of {', of '.join(met)}"
        )


def _overlap(one: Estimate, two: Estimate) -> bool:
    (low, high), (least, most) = one.interval, two.interval
    return low <= most and least <= high


def _by_each_law(
    laws: tuple[_Laws, _Laws], place: str, key: str
) -> tuple[float, float, float] | None:
    """The change, in standard errors as well, and its degrees of freedom, of a number that two fits
    give by each law that both leave open.

    The machine has one law, so that what it moves by each of them it moves: the standard errors are
    of the law by which it moved least, the change is by the first that both have.
    """
    found = []
    for law in laws[0].shared(laws[1], place) or ():
        one, two = (own[place][law].get(key) for own in laws)
        if one is None or two is None or one.unit != two.unit:
            continue
        change = two.value - one.value
        found.append((change, change / math.hypot(one.std, two.std), _welch(one, two)))
    if not found:
        return None
    _, size, dof = min(found, key=lambda moved: abs(moved[1]))
    return found[0][0], size, dof


def _estimate(parts: dict[str, ParameterTable], part: str, key: str) -> Estimate | None:
    return parts[part].estimates.get(key) if part in parts else None


def _moves(
    first: dict[str, ParameterTable],
    other: dict[str, ParameterTable],
    bundle: str,
    laws: tuple[_Laws, _Laws],
) -> Iterable[tuple[Movement, float]]:
    """Each movement with the degrees of freedom of its standard error."""
    for place in first:
        if place not in other:
            continue
        one, two = first[place], other[place]
        keys = tuple(
            key
            for key, estimate in one.estimates.items()
            if key in two.estimates
            and estimate.has_error
            and two.estimates[key].has_error
            and estimate.unit == two.estimates[key].unit
        )
        if not keys:
            continue
        if laws[0].shared(laws[1], place) is not None:
            for key in keys:
                if (least := _by_each_law(laws, place, key)) is not None:
                    moved, size, own = least
                    p = max(t_p_value(size, own), LEAST_P)
                    yield Movement(bundle, place, key, moved, size, p), own
            continue
        change = np.array([two.estimates[k].value - one.estimates[k].value for k in keys])
        covariance = one.covariance(keys) + two.covariance(keys)
        z = change / np.sqrt(np.diag(covariance))
        dof = [_welch(one.estimates[k], two.estimates[k]) for k in keys]
        for key, moved, size, own in zip(keys, change, z, dof, strict=True):
            p = max(t_p_value(float(size), own), LEAST_P)
            yield Movement(bundle, place, key, float(moved), float(size), p), own
        if len(keys) > 1:
            scale = np.sqrt(np.diag(covariance))
            wald, rank = _wald(z, covariance / np.outer(scale, scale))
            p = max(_f_p_value(wald, rank, min(dof)), LEAST_P)
            yield Movement(bundle, place, None, math.nan, math.sqrt(wald / rank), p), min(dof)


def _welch(one: Estimate, two: Estimate) -> float:
    """The degrees of freedom of the difference's standard error, by Welch and Satterthwaite."""
    variances = one.std**2, two.std**2
    dof = one.degrees_of_freedom, two.degrees_of_freedom
    share = sum((v / sum(variances)) ** 2 / n for v, n in zip(variances, dof, strict=True))
    return 1.0 / share if share > 0.0 else math.inf


def _f_p_value(wald: float, rank: int, dof: float) -> float:
    from scipy.special import chdtrc, fdtrc

    if math.isinf(dof):
        return float(chdtrc(rank, wald))
    return float(fdtrc(rank, dof, wald / rank))


def _wald(z: FloatArray, correlation: FloatArray) -> tuple[float, int]:
    """The Wald statistic of scaled changes (k,) with this correlation (k, k), and its rank.

    A direction whose variance is within the rounding of the file's matrix carries no information
    and is omitted.
    """
    variances, directions = np.linalg.eigh(correlation)
    kept = variances > ROUNDING * len(z)
    scores = directions.T[kept] @ z
    return float(np.sum(np.square(scores) / variances[kept])), int(np.count_nonzero(kept))


def _effects(
    first: dict[str, ParameterTable],
    other: dict[str, ParameterTable],
    bundle: str,
    movements: Iterable[Movement],
) -> Iterable[EffectChange]:
    moved = {(m.part, m.name): m for m in movements if m.bundle == bundle and m.is_significant}
    for place in dict.fromkeys((*first, *other)):
        if not place.startswith("effect "):
            continue
        state: State = "same"
        strength = next(iter(first[place].estimates), "") if place in first else ""
        if place not in first:
            state = "appeared"
        elif place not in other:
            state = "disappeared"
        elif (place, strength) in moved:
            before = first[place].estimates[strength].value
            grew = abs(before + moved[place, strength].change) > abs(before)
            state = "grew" if grew else "shrank"
        yield EffectChange(bundle, place.removeprefix("effect "), state)


def _heads(*names: str) -> tuple[str, ...]:
    """Columns by their names, which begin with a capital on a page."""
    return tuple(NotedCell(capital(name), plain=name) for name in names)


def _title(part: str, key: str) -> str:
    """A number's title; its place and key where it has none."""
    path = f"{part}.{key}"
    return f"{part} {key}" if title_of(path) == path else short_title(path)


def _part_cell(part: str, *, is_short: bool = False) -> NotedCell:
    """A part by its title, in a terminal by its place (`is_short`: without what kind it is)."""
    plain = part.removeprefix("effect ") if is_short else part
    return NotedCell(part_title(part), plain=plain)


def _key_cell(part: str, key: str) -> NotedCell:
    """A number by what it is called within its part, with its key beneath."""
    title, whole = title_of(f"{part}.{key}"), part_title(part)
    if title == f"{part}.{key}":
        return NotedCell(key)
    own = title.removeprefix(f"{whole}: ").removeprefix(f"{whole.partition(',')[0]}, ")
    return NotedCell(capital(own), key)


def _label(movement: Movement, *, is_titled: bool) -> str:
    if is_titled:
        whole = f"{part_title(movement.part)} as a whole"
        return within(_title(movement.part, movement.name) if movement.name else whole)
    part = movement.part.removeprefix("effect ")
    return f"{part} {movement.name}" if movement.name else f"{part} as a whole"


__all__ = ["VALVES", "Comparison", "EffectChange", "Movement", "compare_bundles"]
