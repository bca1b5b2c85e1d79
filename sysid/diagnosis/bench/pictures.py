"""The numbers behind the pictures of a part tested alone: its signal and its law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.diagnosis.bench.component import Component, Law
from sysid.diagnosis.influence import rounded, strongest
from sysid.types import FloatArray, IntArray

_MOST_TESTS = 3
_MOST_SAMPLES = 400
_MOST_POINTS = 700
_BINS = 28
# What a law has in common with the acceleration is no part of its friction.
_INERTIAS = ("inertia_kg_m2", "mass_kg")
# Of these the first that a part has is what its tests are drawn over.
_ALONG = ("time", "time since the pump's stop (s)", "duty_a", "number of the reading")
# Neither what a signal is made of nor what it is measured over.
_NOT_DRAWN = (*_ALONG[:2], "acceleration", "motor", "direction of the duty", _ALONG[-1])


def drawn(part: Component, outside: Component | None, before: Law, after: Law) -> dict[str, Any]:
    """The part's signal, measured and modelled, over regressors and along tests (`use`).

    Those of `outside`, the part on held-out tests, where there are some; `count` of all.
    """
    shown = outside or part
    return {
        "unit": part.unit,
        "channel": part.channel,
        "own": dict(part.own_columns),
        "over": over_regressors(part, before, after),
        "tests": tests_shown(shown, before, after),
        "count": len(shown.recordings),
        "use": "holdout" if outside else "fit",
    }


def tests_shown(part: Component, before: Law, after: Law) -> list[dict[str, Any]]:
    """Some recordings whole: the signal as measured, and as modelled by the two laws.

    The first, the last and one between. Each: `test`, `along` (a regressor's name), and by it `x`,
    `measured`, `before`, `after`. Of several outputs each by itself, that which the law after
    follows worst first: `channel`, and the `scale` to its unit.
    """
    found = []
    recordings = list(part.recordings.items())
    chosen = np.unique(np.linspace(0, len(recordings) - 1, _MOST_TESTS).round().astype(int))
    for name, tests in (recordings[i] for i in chosen):
        columns = part.regressors(tests)
        along = next((name for name in _ALONG if name in columns), next(iter(columns), ""))
        measured = np.concatenate(part.measured(tests))
        if not along or len(columns[along]) != len(measured):
            continue
        curves = {"x": columns[along], "measured": measured}
        for key, law in (("before", before), ("after", after)):
            curves[key] = measured - np.concatenate(part.residuals(law, tests))
        which = _output_of(part, tests)
        several = []
        for place, (channel, scale) in enumerate(part.outputs):
            own = {key: values[which == place] for key, values in curves.items()}
            x = own["x"]
            rows = np.unique(np.linspace(0, len(x) - 1, _MOST_SAMPLES).astype(int))
            rows = rows if along == "time" else rows[np.argsort(x[rows], kind="stable")]
            shown = {key: rounded(values[rows]) for key, values in own.items()}
            of = {"channel": channel, "scale": scale} if len(part.outputs) > 1 else {}
            off = float(np.mean((own["measured"] - own["after"]) ** 2))
            several.append((off, {"test": name, "along": along, **of, **shown}))
        found += [one for _, one in sorted(several, key=lambda pair: -pair[0])]
    return found


def _output_of(part: Component, tests: Sequence[int]) -> IntArray:
    """The place of each sample's output among the part's, of these tests end to end."""
    count = len(part.outputs)
    each = (len(values) // count for values in part.measured(tests))
    return np.concatenate([np.repeat(np.arange(count), size) for size in each])


def over_regressors(part: Component, before: Law, after: Law) -> list[dict[str, Any]]:
    """The signal over each quantity on which it may depend: samples, and the two laws' means.

    Of an axis the inertia's share is taken off, so that friction and what acts in addition remain.
    Each: `regressor`; of some samples `x`, `measured` and `fitted` (by the law after); `centres` of
    bins with the means `mean` (measured), `before` and `after`; `share` of the signal's variance
    that lies between the bins, 0 to 1.
    """
    every = range(len(part.tests))
    signal, modelled = _without_inertia(part, before, after)
    if not len(signal):
        return []
    found = []
    shown = np.sort(np.random.default_rng(0).permutation(len(signal))[:_MOST_POINTS])
    for name, x in part.regressors(every).items():
        if name in (*_NOT_DRAWN, part.channel) or len(np.unique(x)) < 3 or len(x) != len(signal):
            continue
        edges = np.linspace(float(x.min()), float(x.max()), _BINS + 1)
        _, place = np.unique(np.searchsorted(edges[1:-1], x, side="right"), return_inverse=True)
        count = np.bincount(place)
        means = {
            key: rounded(np.bincount(place, values) / count)
            for key, values in {"centres": x, "mean": signal, **modelled}.items()
        }
        points = {"x": x, "measured": signal, "fitted": modelled["after"]}
        inside = signal - (np.bincount(place, signal) / count)[place]
        spread = float(np.var(signal))
        share = 1.0 - float(np.mean(inside**2)) / spread if spread > 0.0 else 0.0
        drawn = {key: rounded(values[shown]) for key, values in points.items()}
        found.append({"regressor": name, "share": share, **drawn, **means})
    return found


def _without_inertia(
    part: Component, before: Law, after: Law
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """The measured signal (n,) of all tests end to end, and both laws', less the inertia's."""
    every = range(len(part.tests))
    signal = np.concatenate([np.zeros(0), *part.measured(every)])
    kept = {k: v if k in _INERTIAS else 0.0 for k, v in after.values.items()}
    if any(kept.values()):
        signal = np.concatenate(part.residuals(Law(kept), every))
        of_before = {k: kept[k] for k in kept if k in _INERTIAS} | {
            k: v for k, v in before.values.items() if k not in _INERTIAS
        }
        before = replace(before, values={**before.values, **of_before})
    laws = {"before": before, "after": after}
    left = {key: np.concatenate(part.residuals(law, every)) for key, law in laws.items()}
    return signal, {key: signal - residual for key, residual in left.items()}


def influences(part: Component, law: Law) -> list[dict[str, Any]]:
    """What each effect of a law adds to its prediction along the tests (`influence.strongest`)."""
    every = range(len(part.tests))
    whole = np.concatenate([np.zeros(0), *part.residuals(law, every)])
    columns = part.regressors(every)
    found: list[dict[str, Any]] = []
    for place, effect in enumerate(law.effects):
        others: Sequence[Any] = (*law.effects[:place], *law.effects[place + 1 :])
        without = np.concatenate(part.residuals(Law(law.values, tuple(others)), every))
        curve = strongest(without - whole, columns)
        if curve is not None:
            about = {"id": effect.id, "channel": part.channel, "unit": part.unit}
            found.append(about | curve)
    return found


__all__ = ["drawn", "influences", "over_regressors", "tests_shown"]
