"""The smallest size of each effect that the model lacks at which tests would show it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from sysid.plant.effects.entry import CatalogueEffect
from sysid.refinement.advice_result import EffectSize
from sysid.refinement.information import covariance
from sysid.refinement.options import AdviceSetting, Option, RunsOfTests, information, problem_of
from sysid.refinement.probes import probes_of, without_slope
from sysid.types import FloatArray, Progress

_NO_SLOPE = "no derivative at zero strength"
_NOT_SHOWN = "these tests do not show it"
# Less information than this, per typical size squared, counts as 0.
_LEAST = 1e-6


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
    probes = probes_of(
        setting.model, [e for e in effects if not e.averaged_only and e.id not in own]
    )
    if not probes.effects:
        return (), {}
    numbers = list(dict.fromkeys(o.motion for o in best if o.motion is not None))
    some = tests.only(numbers)
    if not some.runs:
        return (), {e.id: "no motion test" for e in probes.effects}
    progress(f"{probes.columns} strengths of effects that the model lacks, at zero")
    problem = problem_of(some, probes, setting)
    now, motions = information(problem, some, setting)
    more = [_same(o, motions, numbers) for o in best]
    skipped = dict.fromkeys(without_slope(problem, probes), _NO_SLOPE)
    sizes, places = [], probes.places()
    for effect in probes.effects:
        if effect.id in skipped:
            continue
        at = [len(setting.unknowns) + c for c in places[effect.id]]
        stds = [_std(now, len(setting.unknowns), at)]
        stds += [_std(now + m, len(setting.unknowns), at) for m in more]
        if not math.isfinite(min(stds)):
            skipped[effect.id] = _NOT_SHOWN
            continue
        sizes.append(_size(effect, [threshold * s for s in stds]))
    return tuple(sizes), skipped


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
    return 1.0 / math.sqrt(left) if left > _LEAST else math.inf


def _size(effect: type[CatalogueEffect], shares: Sequence[float]) -> EffectSize:
    """The size in the unit of the first strength, whose column is one typical size."""
    first = effect.strengths()[0]
    typical = abs(first.typical)
    now, *after = (s * typical for s in shares)
    return EffectSize(effect.id, first.label, first.unit, typical, now, tuple(after))


__all__ = ["effect_sizes"]
