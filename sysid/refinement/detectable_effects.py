"""The smallest size of each effect that the model lacks at which tests would show it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import overrides
from sysid.refinement.advice_result import EffectSize
from sysid.refinement.information import covariance
from sysid.refinement.options import AdviceSetting, Option, RunsOfTests, information, problem_of
from sysid.refinement.probes import probes_of, without_slope
from sysid.types import FloatArray, Progress

_NO_SLOPE = "no derivative at zero strength"
_NOT_SHOWN = "these tests do not show it"
# Less information than this, per typical size squared, counts as 0.
_LEAST_INFORMATION = 1e-6
# Effects in one compiled program. Of 4, 8, 16 and all 45 the bundled campaign's take 56, 41, 39
# and 42 s of processor time with nothing compiled, else 21, 20, 19 and 25 s.
_TOGETHER = 8
# Through these ports a difference is no slope: the stiff step near a line's pressure begins where
# the line's is, and an edge moves by less than its instant can hold.
_NOT_BY_DIFFERENCES = ("supply_pressure", "exhaust_pressure", "pulses")


def effect_sizes(
    tests: RunsOfTests,
    best: Sequence[Option],
    setting: AdviceSetting,
    effects: Iterable[type[CatalogueEffect]],
    threshold: float,
    progress: Progress,
) -> tuple[tuple[EffectSize, ...], Mapping[str, str]]:
    """Sizes that the campaign shows now and with each of the `best` motion tests; what is skipped.

    The size is `threshold` standard errors of the strength about zero (several strengths in the
    proportion of their typical sizes), with all parameters of the bundle as nuisance parameters.
    """
    own = {e.id for e in setting.model.effects if isinstance(e, CatalogueEffect)}
    sought = [e for e in effects if not e.averaged_only and e.id not in own]
    if not sought:
        return (), {}
    numbers = list(dict.fromkeys(o.motion for o in best if o.motion is not None))
    some = tests.only(numbers)
    if not some.runs:
        return (), {e.id: "no motion test" for e in sought}
    found: dict[str, EffectSize | str] = {}
    for group, by_differences in _groups(sought):
        progress(f"effects that the model lacks, at zero: {len(found)} of {len(sought)} done")
        probes = probes_of(setting.model, group)
        problem = problem_of(some, probes, setting, by_differences=by_differences)
        now, motions = information(problem, some, setting)
        more = [_same(o, motions, numbers) for o in best]
        jumping, places = without_slope(problem, probes), probes.places()
        for effect in probes.effects:
            at = [len(setting.unknowns) + c for c in places[effect.id]]
            said = now, *(now + m for m in more)
            stds = [_std(one, len(setting.unknowns), at) for one in said]
            if effect.id in jumping:
                found[effect.id] = _NO_SLOPE
            elif not math.isfinite(min(stds)):
                found[effect.id] = _NOT_SHOWN
            else:
                found[effect.id] = _size(effect, [threshold * s for s in stds])
    known = {e.id: found[e.id] for e in sought}
    sizes = tuple(one for one in known.values() if isinstance(one, EffectSize))
    return sizes, {id: why for id, why in known.items() if isinstance(why, str)}


def _groups(
    effects: Sequence[type[CatalogueEffect]],
) -> Iterator[tuple[list[type[CatalogueEffect]], bool]]:
    """Effects to simulate in one program, and whether by differences.

    A program with all of them takes eighteen times as long for a run as one without any; one for
    each compiles for longer than it runs. Differences compile nothing of their own.
    """
    derived = [e for e in effects if overrides(e, *_NOT_BY_DIFFERENCES)]
    others = [e for e in effects if e not in derived]
    for first in range(0, len(others), _TOGETHER):
        yield others[first : first + _TOGETHER], True
    if derived:
        yield derived, False


def _same(option: Option, motions: Sequence[Option], numbers: Sequence[int | None]) -> FloatArray:
    """The information of an option with the further columns."""
    place = numbers.index(option.motion)
    return next(
        m.information for m in motions if m.motion == place and m.duration == option.duration
    )


def _std(found: FloatArray, base: int, at: Sequence[int]) -> float:
    """Standard error of the strengths' common factor (columns `at`), base included."""
    along = np.ones(len(at))
    cross = found[:base][:, at] @ along
    left = float(along @ found[np.ix_(at, at)] @ along)
    left -= float(cross @ covariance(found[:base, :base]) @ cross)
    return 1.0 / math.sqrt(left) if left > _LEAST_INFORMATION else math.inf


def _size(effect: type[CatalogueEffect], shares: Sequence[float]) -> EffectSize:
    """The size in the unit of the first strength, whose column is one typical size."""
    first = effect.strengths()[0]
    typical = abs(first.typical)
    now, *after = (s * typical for s in shares)
    return EffectSize(effect.id, first.label, first.unit, typical, now, tuple(after))


__all__ = ["effect_sizes"]
