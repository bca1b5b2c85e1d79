"""The content of a diagnosis as its report needs it: plain numbers and text, as in JSON.

A later process draws the same section from `diagnosis.json`, without diagnosing again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.diagnosis.looked import SearchStage
from sysid.types import FloatArray, IntArray

if TYPE_CHECKING:
    from sysid.diagnosis import Diagnosis
    from sysid.diagnosis.actuator.search import Search, Step, Suspect
    from sysid.diagnosis.actuator.unexplained import ResidualCurve
    from sysid.diagnosis.bench.diagnose import ComponentDiagnosis


# Of each channel's regressors, those that the residual depends on most.
_REGRESSORS = 3
_BINS = 24
_LEAST_IN_BIN = 6
_OWN_DERIVATIVE = {
    "effort": "acceleration",
    "rate_a": "pressure_rate",
    "rate_b": "pressure_rate",
}
# Bins widen away from 0 beyond this share of a regressor's range.
_FINE = 0.04


def content(diagnosis: Diagnosis | ComponentDiagnosis) -> dict[str, Any]:
    """The output of `sysid diagnose --json` (spec/cli.md), and the data drawn under `figures`."""
    from sysid.diagnosis.bench.diagnose import ComponentDiagnosis

    if isinstance(diagnosis, ComponentDiagnosis):
        drawn = {"looks": diagnosis.looks(), **_words(diagnosis), "unit": diagnosis.unit}
        return {**diagnosis.to_json(), "figures": drawn}
    return {**diagnosis.to_json(), "figures": figures(diagnosis)}


def _words(diagnosis: Diagnosis | ComponentDiagnosis) -> dict[str, Any]:
    """Titles of the effects found, and the meanings of their parameters."""
    return {
        "titles": {found.id: type(found.effect).title for found in diagnosis.effects},
        "meanings": {
            found.id: {q.label: q.meaning for q in type(found.effect).quantities}
            for found in diagnosis.effects
        },
    }


def figures(diagnosis: Diagnosis) -> dict[str, Any]:
    """The numbers behind the report's figures, a JSON-able dict.

    `looks`: see there. `excess`: by residual (`effort`, `rate_a`, `rate_b`) the whitened sum
    of squares beyond the twins', before and after. `curves`: mean residual over a regressor
    before and after (`centres`, `before`, `after` with their standard errors; Nm or N for
    `effort`, Pa/s for the rates, over the regressor's SI unit; `fine`: up to where bins are
    narrow, None for bins of equal count). `leftover`: the curve of each
    unexplained channel. `titles` and `meanings` name effects and their parameters.
    """
    search, null = diagnosis.loop.search, diagnosis.loop.null
    before, after = null.excess(search.first), null.excess(search.last)
    return {
        "looks": looks(diagnosis),
        "excess": {name: {"before": before[name], "after": after[name]} for name in before},
        "curves": _curves(search),
        "leftover": [
            {"channel": entry.channel, **_curve(entry.curve)} for entry in diagnosis.unexplained
        ],
        **_words(diagnosis),
    }


def looks(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """What each round of the diagnosis tried: `added` (an id, None in the last) and `suspects`.

    A suspect: `id`, `gain` and `refitted` (whitened squares that its signature and its refit
    remove from the residual; None where it was not refitted), `twins` (the gains on the twins
    that were screened), `p_value`, and `fate`, in words.
    """
    search, null = diagnosis.loop.search, diagnosis.loop.null
    missed = diagnosis.looked.missed
    found: list[dict[str, Any]] = []
    views: list[tuple[Step | None, Sequence[Suspect]]] = [
        *((step, step.suspects) for step in search.steps),
        (None, diagnosis.rejected),
    ]
    for number, (step, suspects) in enumerate(views, start=1):
        own = [m for m in missed if (m.stage, m.round) == (SearchStage.SUSPECTS, number)]
        late = {m.subject: f"not fitted: {m.reason}" for m in own}
        rows = [
            {
                "id": s.id,
                "gain": float(s.gain),
                "refitted": None if s.refitted is None else float(s.refitted),
                "twins": [float(g) for g in null.gains(s.id)],
                "p_value": float(s.p_value),
                "fate": late.get(s.id) or _fate(s, step, suspects, search),
            }
            for s in suspects
        ]
        found.append({"added": None if step is None else step.refit.id, "suspects": rows})
    return found


def _fate(suspect: Suspect, step: Step | None, suspects: Sequence[Suspect], search: Search) -> str:
    """Why a suspect was added or not: the rules of `sysid.diagnosis.actuator.search`, in words."""
    from sysid.diagnosis.actuator.search import (
        CLEAR_RATIO,
        MOST_EFFECTS,
        MOST_SUSPECTS,
        SIGNIFICANCE,
        WORTH_REFITTING,
    )

    if step is not None and suspect.id == step.refit.id:
        return "added"
    if step is not None and suspect.refitted is not None:
        share = 100.0 * suspect.refitted / step.refit.gain
        equal = ": indistinguishable in these data" if suspect.id in step.ambiguous else ""
        return f"refitted, explains {share:.3g} % of what {step.refit.id} explains{equal}"
    if suspect.p_value >= SIGNIFICANCE:
        return "gains no more than chance would"
    if suspect.ratio <= CLEAR_RATIO:
        return "gains too little more than on the twins"
    if step is None and len(search.steps) >= MOST_EFFECTS:
        return f"not tried: at most {MOST_EFFECTS} effects are added"
    if suspect.gain <= WORTH_REFITTING * suspects[0].gain:
        return f"not refitted: explains far less than {suspects[0].id}"
    clear = [s for s in suspects if s.p_value < SIGNIFICANCE and s.ratio > CLEAR_RATIO]
    if suspect not in clear[:MOST_SUSPECTS]:
        return f"not refitted: {MOST_SUSPECTS} others gain more"
    if step is None:
        return "explains too small a share of the remainder, or differs from test to test"
    return "refitted: its strength differs from test to test"


def _curves(search: Search) -> list[dict[str, Any]]:
    """Each residual over the regressors along which the effects change it most.

    Without effects, over those that it depends on most, other than the derivative from which
    it is computed, whose noise it shares.
    """
    from sysid.diagnosis.actuator.equation_error import CHANNELS, equation_error
    from sysid.diagnosis.actuator.unexplained import regressors

    frame = search.first.frame
    errors = [equation_error(frame.traces, p.model) for p in (search.first, search.last)]
    found = []
    for channel in CHANNELS:
        view = frame.windows[channel]
        before, after = (view.average(error[channel]) for error in errors)
        ranked: list[tuple[float, dict[str, Any]]] = []
        for name, regressor in regressors(frame.traces, channel).items():
            x = view.average(regressor)
            bins = _bins(x)
            if bins is None or (not search.steps and name == _OWN_DERIVATIVE[channel]):
                continue
            place, fine = bins
            entry: dict[str, Any] = {"channel": channel, "regressor": name, "fine": fine}
            entry["centres"] = (np.bincount(place, x) / np.bincount(place)).tolist()
            for key, values in (("before", before), ("after", after)):
                entry[key] = _means(place, values, view.stretch)
            followed = [entry[key]["power"] for key in ("before", "after")]
            ranked.append((followed[0] - followed[1] if search.steps else followed[0], entry))
        ranked.sort(key=lambda item: -item[0])
        found += [entry for _, entry in ranked[:_REGRESSORS]]
    return found


def _bins(x: FloatArray) -> tuple[IntArray, float | None] | None:
    """The bin of each window, (windows,), and how far from 0 bins are narrow (None: nowhere).

    A regressor of both signs is binned finely about 0, where direction changes and little
    time is spent, any other in bins of equal count. None where fewer than 3 bins hold enough.
    """
    if len(x) < 3 * _LEAST_IN_BIN:
        return None
    fine = None
    if x.min() < 0.0 < x.max():
        fine = _FINE * float(np.quantile(np.abs(x), 0.95))
        x = np.arcsinh(x / fine) if fine > 0.0 else x
        edges = np.linspace(x.min(), x.max(), _BINS + 1)
    else:
        edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, _BINS + 1)))
    place = np.searchsorted(edges[1:-1], x, side="right")
    # Sparse bins are merged with the next one up, the last with the one below.
    joined, held, bins = np.zeros(len(edges), dtype=np.intp), 0, 0
    for i, count in enumerate(np.bincount(place, minlength=len(edges))):
        joined[i] = bins
        held += int(count)
        if held >= _LEAST_IN_BIN:
            held, bins = 0, bins + 1
    return (np.minimum(joined, bins - 1)[place], fine or None) if bins >= 3 else None


def _means(place: IntArray, values: FloatArray, stretch: IntArray) -> dict[str, Any]:
    """Means in the bins, their standard errors, and the mean square and share they explain.

    Neighbouring windows are correlated: the errors take each unbroken stretch of a test
    within a bin as one observation. The share is adjusted for the number of bins.
    """
    count = np.bincount(place)
    means = np.bincount(place, values) / count
    inside = values - means[place]
    clusters, index = np.unique(place * (int(stretch.max()) + 1) + stretch, return_inverse=True)
    sums = np.bincount(index, inside)
    owner = clusters // (int(stretch.max()) + 1)
    own = np.bincount(owner)
    correction = own / np.maximum(own - 1, 1)
    errors = np.sqrt(np.bincount(owner, sums**2) * correction) / count
    total = float(values @ values) / len(values)
    freedom = max(len(values) - len(means), 1)
    share = 1.0 - float(inside @ inside) / freedom / total if total > 0.0 else 0.0
    return {
        "share": max(share, 0.0),
        "power": max(share, 0.0) * total,
        "means": means.tolist(),
        "errors": errors.tolist(),
    }


def _curve(curve: ResidualCurve) -> dict[str, Any]:
    return {
        "residual": curve.channel,
        "regressor": curve.regressor,
        "centres": curve.centres.tolist(),
        "share": float(curve.share),
        "means": curve.means.tolist(),
        "errors": np.nan_to_num(curve.errors).tolist(),
    }


__all__ = ["content", "figures", "looks"]
