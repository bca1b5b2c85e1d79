"""What a diagnosis on twins shows: its rounds, and its residuals over regressors, in JSON types."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.diagnosis.actuator.equation_error import (
    BALANCES,
    BREAKAWAY,
    channels_of,
    equation_error,
)
from sysid.diagnosis.actuator.samples import Traces
from sysid.diagnosis.actuator.search import RefittedStep, Search, Suspect
from sysid.diagnosis.actuator.unexplained import ResidualCurve, regressors
from sysid.diagnosis.binning import BINS, binned_means, equal_count_edges
from sysid.diagnosis.influence import strongest
from sysid.diagnosis.search_record import SearchRecord, SearchStage
from sysid.plant.ports import Model
from sysid.types import FloatArray, IntArray

# Of each channel's regressors, those that the residual depends on most.
_REGRESSORS = 3
_LEAST_IN_BIN = 6
_OWN_DERIVATIVE = {
    "effort": "acceleration",
    "rate_a": "pressure_rate",
    "rate_b": "pressure_rate",
}
# Bins widen away from 0 beyond this share of a regressor's range.
_FINE = 0.04


def rounds_shown(search: Search, record: SearchRecord) -> list[dict[str, Any]]:
    """What each round tried: `added` (an id, None in the last) and `suspects`.

    A suspect: `id`, `gain` and `refitted` (by how much it lowers minus twice the log likelihood of
    the balances, as it was screened and with its shape fitted; None where it was not fitted),
    `twins` (the same on twins, where nothing is missing), `p_value`, and `fate`, in words.
    """
    shown: list[dict[str, Any]] = []
    for number, one in enumerate(search.rounds, start=1):
        own = [m for m in record.missed if (m.stage, m.round) == (SearchStage.SUSPECTS, number)]
        late = {m.subject: f"not fitted: {m.reason}" for m in own}
        suspects: Sequence[Suspect] = one.tried  # type: ignore[assignment]
        rows = [
            {
                "id": s.id,
                "gain": float(s.reduction),
                "refitted": None if s.refitted is None else float(s.refitted),
                "twins": [float(s.twins)],
                "p_value": float(s.p_value),
                "fate": late.get(s.id) or _fate(s, one.added, search),  # type: ignore[arg-type]
            }
            for s in suspects
        ]
        added = None if one.added is None else one.added.id
        shown.append({"added": added, "removed": list(one.removed), "suspects": rows})
    return shown


def _fate(suspect: Suspect, step: RefittedStep | None, search: Search) -> str:
    """Why a suspect was added or not."""
    if step is not None and suspect.id == step.id:
        return "added"
    if step is not None and suspect.id in step.ambiguous:
        return f"as likely as {step.id}: indistinguishable in these data"
    if suspect.id in {other.id for other in search.steps}:
        return "added together with another effect"
    if suspect.refitted is not None:
        return "fitted: less likely than what was added" if step else "fitted: adds no evidence"
    return "more evidence against it than for it"


def residual_curves(search: Search) -> list[dict[str, Any]]:
    """Each residual over the regressors along which the effects change it most.

    Without effects, over those that it depends on most, other than the derivative from which
    it is computed, whose noise it shares.
    """
    frame = search.first.frame
    errors = [equation_error(frame.traces, p.model) for p in (search.first, search.last)]
    found = []
    acts = {c for step in search.steps for c in channels_of(step.effect)}
    for channel in (*BALANCES, *({BREAKAWAY} & acts)):
        view = frame.windows[channel]
        before, after = (view.average(error[channel]) for error in errors)
        ranked: list[tuple[float, dict[str, Any]]] = []
        for name, regressor in regressors(frame.traces, channel).items():
            x = view.average(regressor)
            bins = _bins(x)
            if bins is None or (not search.steps and name == _OWN_DERIVATIVE.get(channel)):
                continue
            place, fine = bins
            entry: dict[str, Any] = {"channel": channel, "regressor": name, "fine": fine}
            entry["centres"] = (np.bincount(place, x) / np.bincount(place)).tolist()
            for key, values in (("before", before), ("after", after)):
                entry[key] = binned_means(place, values, view.stretch)
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
        edges = np.linspace(x.min(), x.max(), BINS + 1)
    else:
        edges = equal_count_edges(x, BINS)
    place = np.searchsorted(edges[1:-1], x, side="right")
    # Sparse bins are merged with the next one up, the last with the one below.
    joined, held, bins = np.zeros(len(edges), dtype=np.intp), 0, 0
    for i, count in enumerate(np.bincount(place, minlength=len(edges))):
        joined[i] = bins
        held += int(count)
        if held >= _LEAST_IN_BIN:
            held, bins = 0, bins + 1
    return (np.minimum(joined, bins - 1)[place], fine or None) if bins >= 3 else None


def influences(search: Search) -> list[dict[str, Any]]:
    """What each effect adds to the balance that it changes most (`influence.strongest`).

    Along the training logs, at its estimated size, with all others; `channel` is the balance, one
    of those by which the effect is judged.
    """
    model, frame = search.last.model, search.first.frame
    added = model.effects[len(search.first.model.effects) :]
    whole = equation_error(frame.traces, model)
    found = []
    for effect in added:
        others = tuple(e for e in model.effects if e is not effect)
        error = equation_error(frame.traces, replace(model, effects=others))
        ranked: list[tuple[float, str, FloatArray]] = []
        for channel in channels_of(effect, others):
            view = frame.windows[channel]
            if not len(view):
                continue
            change = view.average(error[channel]) - view.average(whole[channel])
            size = float(np.std(view.average(whole[channel]))) or 1.0
            ranked.append((float(np.std(change)) / size, channel, change))
        if not ranked:
            continue
        _, channel, change = max(ranked, key=lambda item: item[0])
        view = frame.windows[channel]
        columns = _in_gauge(regressors(frame.traces, channel), frame.traces, model)
        curve = strongest(change, {name: view.average(x) for name, x in columns.items()})
        if curve is not None:
            found.append({"id": type(effect).id, "channel": channel, **curve})  # type: ignore[attr-defined]
    return found


def _in_gauge(
    columns: dict[str, FloatArray], traces: Traces, model: Model
) -> dict[str, FloatArray]:
    """Regressors with the gauge pressures' sum, which seals feel, in place of the absolute's."""
    gauge = traces.pressure_a + traces.pressure_b - 2.0 * float(model.parameters.atmosphere)
    own = {"pressure_sum times direction": "gauge_pressure_sum times direction"}
    return {
        own.get(name, name): gauge * traces.direction if name in own else values
        for name, values in columns.items()
    }


def shown_curve(curve: ResidualCurve) -> dict[str, Any]:
    """A curve of what no effect explains."""
    return {
        "residual": curve.channel,
        "regressor": curve.regressor,
        "centres": curve.centres.tolist(),
        "share": float(curve.share),
        "means": curve.means.tolist(),
        "errors": np.nan_to_num(curve.errors).tolist(),
    }


__all__ = ["influences", "residual_curves", "rounds_shown", "shown_curve"]
