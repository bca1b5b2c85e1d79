"""An effect's entry in the catalogue, in addition to how it acts through the ports."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np

from sysid.plant.base import MAX_STEP, Array, array_namespace
from sysid.plant.ports import Effect

Subsystem = Literal["friction", "mechanics", "motor", "chamber", "valve", "supply", "sensor"]
SIDE_CHOICES = ("a", "b", "both")
SPEEDS = ("rad/s", "m/s")
PER_FLOW = "Pa s/kg"
_SIZED = {"N", "Nm", "kg", "W"}
LIKE = math.sqrt(3.0)
"""What is tried of a strength is a factor of 3 apart: rigs are alike to within half of it."""
NEARBY = 1.15
"""Factor to either side of a threshold's tried value within which a fit looks for the best one."""
# What is tried of a threshold in time: from the quantile of the commands' lengths up, but no less
# than so many times below the longest that is tried.
_SHORTEST, _TIMES_SHORTER = 0.005, 30.0
_UNIT_WORDS = re.compile(r"[A-Za-z]+")
# Shares of a rig's fastest speed that are tried of a speed, and its least.
_SPEED_SHARES, _SLOWEST = (0.05, 0.1, 0.2, 0.4), 0.01


def state_lag(lag: Array) -> Array:
    """Time constant of the state that stands for a lag, s: the lag itself, but never too short.

    A shorter lag counts by the share lag / state_lag(lag) of what the state is behind.
    """
    return array_namespace(lag).maximum(lag, MAX_STEP)


@dataclass(frozen=True)
class Quantity:
    """One number of an effect: a field of its class, the unit in the name.

    A strength (`is_strength`) makes the effect vanish at 0; a shape parameter says what
    form it takes. `typical` is the usual size on a rig like the reference rig. `grid` holds
    the values that screening tries: of a shape parameter all plausible ones, of a strength
    only where the effect is not proportional to it (a threshold, a limit, a dead gap; `is_smooth`
    where it has a slope all the same; of a shape tried at one value, that a fit finds the others).
    `key` is its name in files and reports, where that differs from the field's name. `is_wave`:
    a wave number over position (rad per unit), of which data show something only where a whole
    period lies within what they visit. `absent`: what files mean that were written before the
    quantity was there, the effect's plain form; None: files must give it.
    `is_choice`: one of the values of its grid, which no fit moves.
    `radius_power`: the power of a pitch radius that brings it from angle and torque to path and
    force, where its unit does not say (a speed per torque, named a speed).
    `least`: what no value is below on the rig at hand, whatever its size.
    `jumps`: a shape at which the effect jumps, as at a limit beyond which all is lost: its slope
    shows over a wide step alone.
    `begins_plain`: a shape that fits bend from the effect's plain form (see `bent`).
    `forms`: what some of its values stand for, in words, and `caption` what these are forms of:
    pages say so in place of the `meaning`, which files and terminals have.
    """

    name: str
    unit: str
    typical: float
    lower: float
    upper: float
    meaning: str
    is_strength: bool = True
    grid: tuple[float, ...] = ()
    key: str = ""
    is_wave: bool = False
    absent: float | None = None
    is_smooth: bool = False
    is_choice: bool = False
    radius_power: float | None = None
    least: float = -math.inf
    jumps: bool = False
    begins_plain: bool = False
    forms: tuple[tuple[float, str], ...] = ()
    caption: str = ""

    @property
    def title(self) -> str:
        """Its meaning as pages have it."""
        return self.caption or self.meaning

    def form(self, value: float) -> str:
        """What a value stands for, in words; empty where it stands for itself."""
        return dict(self.forms).get(value, "")

    @property
    def is_threshold(self) -> bool:
        """Whether it acts in steps: screening tries a grid of sizes, and it has no slope."""
        return self.is_strength and bool(self.grid) and not self.is_smooth

    @property
    def plain(self) -> float | None:
        """Of a choice, its value in the effect's plain form; None: it has none."""
        return self.absent if self.is_choice else None

    def within(self, travel: float, spacing: float = math.inf) -> Quantity | None:
        """It on a log that visits so much of the position: at least one period; None: none fits.

        Less than a period is a polynomial of low order, and its amplitude and phase mean nothing.
        `spacing` of the samples in the position: waves are as short as two samples resolve.
        """
        if not self.is_wave or math.isinf(travel):
            return self
        least = max(2.0 * math.pi / travel, self.lower) if travel > 0.0 else math.inf
        most = max(self.upper, math.pi / spacing) if spacing > 0.0 else self.upper
        if least > most:
            return None
        grid = tuple(value for value in self.grid if value >= least) or (least,)
        return replace(self, lower=least, upper=most, typical=max(self.typical, least), grid=grid)

    @property
    def anywhere(self) -> tuple[float, float]:
        """Its bounds on a rig of any size: for a strength in units of effort, flow or heat, for
        a lag, whose sensor or tube is as slow as it is, and for a shape that is a speed or a wave,
        only those of sign; a delay that may be negative or an exponent is the same on any rig."""
        units = set(_UNIT_WORDS.findall(self.unit))
        sized = self.unit in SPEEDS or self.is_wave
        if self.is_strength:
            sized = bool(units & _SIZED) or (self.unit == "s" and self.lower == 0.0)
        if not sized or self.is_choice:
            return self.lower, self.upper
        return max(-math.inf if self.lower < 0.0 else 0.0, self.least), math.inf

    def around(self, value: float) -> tuple[float, float]:
        """Its bounds, or those on a rig of any size where a value is beyond them."""
        return (self.lower, self.upper) if self.lower <= value <= self.upper else self.anywhere

    def at_speeds(self, fastest: float) -> Quantity:
        """It on a rig that moves as fast as this, rad/s or m/s: a speed's range, and what is tried
        of it, reach from a hundredth of that to that. What is tried at one value stays so."""
        if self.is_strength or self.unit not in SPEEDS or not self.grid or not fastest > 0.0:
            return self
        tried = (share * fastest for share in _SPEED_SHARES)
        grows = len(self.grid) > 1
        beyond = [v for v in tried if grows and not min(self.grid) <= v <= max(self.grid)]
        return replace(
            self,
            lower=min(self.lower, _SLOWEST * fastest),
            upper=max(self.upper, fastest),
            grid=tuple(sorted((*self.grid, *beyond))),
        )

    def at_lengths(self, lengths: Array) -> Quantity:
        """It on logs whose commands and pauses last so long (n,), s: of a threshold in time, as of
        a valve that forgets short pulses, what is tried lies between the shortest of them and half
        of them, so closely that each is near one. It acts in steps, which two values far apart
        both miss."""
        known = lengths[lengths > 0.0]
        if not (self.is_threshold and self.unit == "s" and len(known)):
            return self
        most = min(float(np.median(known)), self.upper)
        least = max(float(np.quantile(known, _SHORTEST)), most / _TIMES_SHORTER)
        if least >= most:
            return self
        count = 1 + math.ceil(math.log(most / least) / math.log(NEARBY**2))
        return replace(self, grid=tuple(np.geomspace(least, most, count).tolist()))

    def at_flows(self, times: float) -> Quantity:
        """It on a rig whose valves let through so many `times` the reference rig's flow: of a
        strength per flow that an effect is not proportional to, what is tried is such as does there
        what the usual ones do here, in proportion to the flow or to its square."""
        is_usual = 1.0 / LIKE < times < LIKE
        if not (self.is_strength and self.grid and self.unit == PER_FLOW) or is_usual:
            return self
        tried = {min(v / times**power, self.upper) for v in self.grid for power in (1, 2)}
        return replace(self, grid=tuple(sorted(tried)))

    @property
    def usual_size(self) -> float:
        """The size of its prior, in its unit."""
        return abs(self.typical) or self.upper

    @property
    def label(self) -> str:
        """Its name in files and reports."""
        return self.key or self.name


def either(
    name: str,
    meaning: str,
    caption: str,
    forms: tuple[str, str],
    absent: float | None = 0.0,
) -> Quantity:
    """Which of two forms an effect has, 0 or 1; `forms` says what these stand for in words, and
    `caption` what they are forms of."""
    return Quantity(
        name,
        "-",
        0.0,
        0.0,
        1.0,
        meaning,
        is_strength=False,
        grid=(0.0, 1.0),
        absent=absent,
        is_choice=True,
        forms=((0.0, forms[0]), (1.0, forms[1])),
        caption=caption,
    )


def bent(
    name: str,
    plain: float,
    lower: float,
    upper: float,
    meaning: str,
    caption: str = "",
    forms: tuple[tuple[float, str], ...] = (),
    is_smooth: bool = True,
) -> Quantity:
    """A shape without unit that a fit bends from its value in the effect's `plain` form, which is
    also what files mean that do not give it; the others as in `Quantity`."""
    return Quantity(
        name,
        "-",
        plain,
        lower,
        upper,
        meaning,
        is_strength=False,
        grid=(plain,),
        absent=plain,
        is_smooth=is_smooth,
        begins_plain=True,
        caption=caption,
        forms=forms,
    )


class CatalogueEffect(Effect):
    """An effect with its entry in the catalogue. Derive as a frozen dataclass.

    Each `Quantity` names a field; the strengths' defaults are 0. An effect of one chamber,
    valve or sensor also has the field `side`, "a", "b" or "both".
    """

    id: ClassVar[str]
    title: ClassVar[str]
    subsystem: ClassVar[Subsystem]
    quantities: ClassVar[tuple[Quantity, ...]]
    signature: ClassVar[str]
    """Where it is visible, in words."""
    rivals: ClassVar[tuple[str, ...]] = ()
    """Ids of the effects that it is often confused with."""
    tie_breaker: ClassVar[str] = ""
    """The test that distinguishes it from its rivals."""
    source: ClassVar[str]
    averaged_only: ClassVar[bool] = False
    """Acts on flows averaged over a PWM period only, not on a valve followed pulse by pulse."""
    needs_chamber_b: ClassVar[bool] = False
    """Is of chamber B, or between the two: not of a rig with one chamber."""
    needs_motor: ClassVar[bool] = False
    """Is of what a motor does: of tests without one it changes nothing."""

    is_between_sides: ClassVar[bool] = False
    """On both sides it acts between the chambers, and is not the sum of one on either."""
    is_of_an_end: ClassVar[bool] = False
    """Its side is an end of the stroke, of which a rig with one chamber has two as well."""

    @classmethod
    def is_of(cls, sides: Collection[str]) -> bool:
        """Whether a rig with the chambers `sides` can have it."""
        return "b" in sides or not cls.needs_chamber_b

    @classmethod
    def strengths(cls) -> tuple[Quantity, ...]:
        """The quantities that are 0 where the effect is absent."""
        return tuple(q for q in cls.quantities if q.is_strength)

    @classmethod
    def shapes(cls) -> tuple[Quantity, ...]:
        """The quantities that determine the form of the effect."""
        return tuple(q for q in cls.quantities if not q.is_strength)

    @classmethod
    def forms(cls) -> dict[str, tuple[tuple[float, str], ...]]:
        """What values of its quantities stand for in words, by the name in files."""
        return {q.label: q.forms for q in cls.quantities if q.forms}

    @classmethod
    def fitted(cls) -> tuple[Quantity, ...]:
        """The quantities that a fit moves: all but choices."""
        return tuple(q for q in cls.quantities if not q.is_choice)

    @classmethod
    def within(cls, travel: float, spacing: float = math.inf) -> tuple[Quantity, ...] | None:
        """The quantities on logs that visit so much of the position (rad or m; infinite: unknown).

        None where no period of a wave fits (`Quantity.within`).
        """
        found = [q.within(travel, spacing) for q in cls.quantities]
        kept = tuple(q for q in found if q is not None)
        return kept if len(kept) == len(found) else None

    @classmethod
    def has_side(cls) -> bool:
        """Whether the effect belongs to one chamber, valve or sensor."""
        return "side" in {f.name for f in dataclasses.fields(cls)}  # type: ignore[arg-type]

    @classmethod
    def neutral(cls, **fields: Any) -> Self:
        """The effect at neutral strength, its other fields typical or as given."""
        values = {q.name: 0.0 if q.is_strength else q.typical for q in cls.quantities}
        return cls(**values | fields)

    @classmethod
    def typical(cls, **fields: Any) -> Self:
        """The effect at its usual size, or as given."""
        return cls(**{q.name: q.typical for q in cls.quantities} | fields)


Catalogue = Mapping[str, type[CatalogueEffect]]
"""Effects by their ids."""


def with_values(
    effects: Sequence[CatalogueEffect], values: Iterable[float]
) -> tuple[CatalogueEffect, ...]:
    """The effects with other numbers, given in the order of their quantities; sides stay."""
    found, rest = [], iter(values)
    for effect in effects:
        numbers: dict[str, Any] = {q.name: float(next(rest)) for q in type(effect).quantities}
        found.append(dataclasses.replace(effect, **numbers))  # type: ignore[type-var]
    return tuple(found)


def of_side(side: str, chosen: str) -> bool:
    """Whether an effect on `chosen` ("a", "b" or "both") acts on `side`."""
    return chosen in (side, "both")
