"""Which PWM frequency to run a valve at, from constant-duty tests at several (thesis 3.7.2).

A pulse shorter than the valve's delays cannot be set, and a period that is not much longer leaves
little of the duty: neighbouring duties then give the same response. For each frequency the share of
time that the valve is open follows from the tests without a law of the flow: at any one pressure
the mean flow is linear in it. A line that ends where the share no longer follows the duty gives the
linear range of the duty.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.drawing import plot_panels
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table
from sysid.errors import Failure, NotIdentifiedError, input_error, on_its_own
from sysid.estimation.linear import LEVEL
from sysid.identification.valve_pwm.duty_response import DutyResponse, LinearRange, line_of
from sysid.identification.valve_pwm.frequency_shown import (
    frequency_table,
    opening_panel,
    resolution_table,
)
from sysid.identification.valve_pwm.pulse_line import SAID_DEVIATION
from sysid.identification.valve_pwm.remarks import Remarks
from sysid.identification.valve_pwm.result import DIRECTIONS
from sysid.identification.valve_pwm.samples import FlowSamples, PwmTest, sample_tests
from sysid.identification.valve_pwm.selection import moved_valves, select_tests
from sysid.io.log_constants import pwm_period
from sysid.io.logs import Log, Trial
from sysid.io.rig import Rig
from sysid.surfaces.comparison import ResolutionStudy, resolution_study
from sysid.surfaces.domain import level_flows
from sysid.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# A line with two ends needs so many duties.
_FEWEST_DUTIES = 6
_ROUNDS = 200
# The one-sided quantile of a difference that is significant at 5 %.
_SIGNIFICANT = NormalDist().inv_cdf(LEVEL)


@dataclass(frozen=True, repr=False)
class FrequencyChoice(Shown):
    """Responses at several PWM frequencies, and which frequency to run at, with why.

    `responses` by frequency, each valve's next to each other; `chosen_s`: the period chosen.
    """

    responses: tuple[DutyResponse, ...]
    chosen_s: float
    why: str
    notices: tuple[str, ...] = ()

    def headline(self) -> str:
        """The choice in words."""
        return f"PWM frequency: {1.0 / self.chosen_s:.4g} Hz: {self.why}"

    def records(self) -> list[dict[str, Any]]:
        """One record per valve and frequency."""
        return [
            {
                "valve": r.valve,
                "log": r.source,
                "frequency_hz": r.frequency_hz,
                "pwm_period_s": r.period_s,
                "duties": len(r.duty),
                "linear_from": r.linear.first,
                "linear_to": r.linear.last,
                "linear_range": r.linear.width,
                "linear_range_std": r.linear.std,
                "unusable_s": r.unusable_s,
                "overlapping_duties": r.overlapping,
                "unevenness": r.unevenness,
                "least_step": r.least_step,
                "is_chosen": r.period_s == self.chosen_s,
            }
            for r in self.responses
        ]

    def noting(self, lines: Iterable[str]) -> FrequencyChoice:
        """The choice with further notices before its own."""
        return replace(self, notices=tuple(dict.fromkeys((*lines, *self.notices))))

    def to_json(self) -> dict[str, Any]:
        """The output of `--json`."""
        return {
            "pwm_period_s": self.chosen_s,
            "frequency_hz": 1.0 / self.chosen_s,
            "why": self.why,
            "frequencies": self.records(),
            "notices": list(self.notices),
        }

    def tables(self) -> Iterable[Table]:
        """The frequencies next to each other, and the largest flow by step of duty at each."""
        yield frequency_table(self.responses, self.chosen_s)
        yield from resolution_table(self.responses)

    def plot(self, axes: Axes | Iterable[Axes] | None = None) -> list[Axes]:
        """Opening over duty, one panel per valve; returns the axes."""
        valves = dict.fromkeys(r.valve for r in self.responses)
        return plot_panels([opening_panel(self.responses, v) for v in valves], axes)


def choose_frequency(
    logs: Sequence[tuple[float, str, Sequence[Trial]]],
    rig: Rig,
    *,
    valve: str | None = None,
    least_range: float | None = None,
) -> FrequencyChoice:
    """The choice among the PWM periods (s) of `logs`, each with its name and its trials.

    The frequency with the widest linear range of the duty; of those that do not differ from it
    significantly, the highest. `least_range` (0 to 1): the highest frequency with at least this
    linear range instead. Raises InputError for fewer than two periods, NotIdentifiedError where
    tests do not show the opening, or no frequency has the range.
    """
    periods = sorted({period for period, _, _ in logs}, reverse=True)
    if len(periods) < 2:
        raise input_error(
            ", ".join(name for _, name, _ in logs) or "logs",
            f"all logs have one PWM period ({_hertz(periods)})",
            "give valve-pwm logs at two frequencies or more",
        )
    remarks = Remarks()
    found: list[DutyResponse] = []
    for period in periods:
        own = [(name, trial) for p, name, trials in logs if p == period for trial in trials]
        names = ", ".join(dict.fromkeys(name for name, _ in own))
        trials = [trial for _, trial in own]
        at = _at_period(rig, period)
        for side in moved_valves(trials) if valve is None else [valve]:
            response = on_its_own(partial(_response, trials, at, side, names, remarks))
            if isinstance(response, Failure):
                raise NotIdentifiedError(
                    f"{names} ({_hertz([period])}), valve {side.upper()}: {response.reason}"
                )
            found.append(response)
    chosen, why = _chosen(found, least_range)
    return FrequencyChoice(tuple(found), chosen, why, remarks.notices())


@dataclass(frozen=True)
class CampaignTests:
    """A campaign's log: the valve that it is declared to be of (None: any), and the PWM period that
    it is declared to have, s (None: none is)."""

    valve: str | None
    log: Log
    declared_s: float | None = None


def logged_periods(logs: Sequence[CampaignTests], rig: Rig) -> list[float]:
    """The PWM period (s) of each log of a campaign.

    It is the declared one, else the one that the ripple of pulses shows; the rig file's where none
    shows, where both are as good as the same, and for a valve with a single log, which has nothing
    to compare it with.
    """
    usual = float(rig.require("pwm", "which the mean over pulses needs").period_s)
    valves = [one.valve for one in logs]
    found = []
    for one in logs:
        shown = one.declared_s
        if shown is None and valves.count(one.valve) > 1:
            shown = pwm_period(one.log.trials)
        is_other = shown is not None and abs(shown / usual - 1.0) > SAID_DEVIATION
        found.append(shown if shown is not None and is_other else usual)
    return found


def at_the_rigs_period(logs: Sequence[CampaignTests], rig: Rig) -> list[CampaignTests]:
    """The logs without those at another PWM period than the rig file's; of a valve without one at
    the rig file's, all whose period is not declared."""
    if rig.pwm is None:
        return list(logs)
    usual = rig.pwm.period_s
    found = list(zip(logs, logged_periods(logs, rig), strict=True))
    has_own = {one.valve for one, period in found if period == usual}
    return [
        one
        for one, period in found
        if period == usual or (one.declared_s is None and one.valve not in has_own)
    ]


def _at_period(rig: Rig, period: float) -> Rig:
    """The rig with another PWM period, s."""
    pwm = rig.require("pwm", "which the mean over pulses needs")
    return replace(rig, pwm=pwm.model_copy(update={"period_s": period}))


def _hertz(periods: Iterable[float]) -> str:
    return ", ".join(f"{1.0 / p:.4g} Hz" for p in periods)


def _response(
    trials: Sequence[Trial], rig: Rig, valve: str, source: str, remarks: Remarks
) -> DutyResponse:
    """A valve's opening by duty at the rig's PWM period."""
    tests = select_tests(trials, rig, valve, remarks)
    if not tests:
        raise NotIdentifiedError("no usable valve-pwm test (piston held, one constant duty each)")
    parts = {name: [t for t in tests if t.filling == (name == "fill")] for name in DIRECTIONS}
    samples = {name: sample_tests(own, rig) for name, own in parts.items() if own}
    duty, opening, std = openings(list(samples.values()))
    return DutyResponse(
        valve,
        float(rig.require("pwm", "which the mean over pulses needs").period_s),
        source,
        duty,
        opening,
        std,
        linear_range(duty, opening, std),
        {name: study for name, own in samples.items() if (study := _resolution(own)) is not None},
        tuple(_curve(test) for test in tests),
    )


def _curve(test: PwmTest) -> tuple[float, bool, FloatArray, FloatArray]:
    time = np.asarray(test.period * np.arange(len(test.pressure)), dtype=np.float64)
    return test.duty, test.filling, time, test.pressure


def _resolution(samples: FlowSamples) -> ResolutionStudy | None:
    # The study needs at least two samples in a bin; each of these is a mean over a window.
    duty, pressure, flow = (np.repeat(c, 2) for c in (samples.duty, samples.pressure, samples.flow))
    found = on_its_own(partial(resolution_study, duty, pressure, flow))
    return None if isinstance(found, Failure) else found


def openings(samples: Sequence[FlowSamples]) -> tuple[FloatArray, FloatArray, float]:
    """Duties (n,), the share of time that the valve is open at each (n,), and its standard error.

    The mean flow at a pressure is that of the shut valve and, in proportion to the share, what the
    open one adds: both are free at each pressure, and the shares follow by alternating least
    squares. They are known up to their zero and unit: 0 is the least that the tests show, 1 the
    largest. Raises NotIdentifiedError for too few duties.
    """
    columns = (
        np.concatenate([getattr(s, n) for s in samples]) for n in ("duty", "pressure", "flow")
    )
    levels = level_flows(*columns)
    known = np.isfinite(levels.flow)
    met = known.sum(axis=0) >= 3  # a pressure at which fewer duties meet says nothing of them
    flow, known = levels.flow[:, met], known[:, met]
    rows = known.any(axis=1)
    if rows.sum() < _FEWEST_DUTIES:
        raise NotIdentifiedError(
            f"{int(rows.sum())} duties meet at a pressure, of which {_FEWEST_DUTIES} are needed: "
            "test more duties"
        )
    duty, flow = levels.duty[rows], flow[rows]
    # A cell between samples is a guess by its neighbours.
    known = known[rows] * np.maximum(levels.count[:, met][rows], 0.5)
    share = (duty - duty[0]) / (duty[-1] - duty[0])
    filled = np.where(known > 0.0, flow, 0.0)
    for _ in range(_ROUNDS):
        shut, adds = _lines(share, filled, known)
        weight = (known * adds**2).sum(axis=1)
        following = (known * adds * (filled - shut)).sum(axis=1) / np.maximum(weight, 1e-300)
        low, high = float(following.min()), float(following.max())
        following = (following - low) / (high - low)
        moved = float(np.abs(following - share).max())
        share = following
        if moved < 1e-9:
            break
    shut, adds = _lines(share, filled, known)
    left = filled - shut - share[:, None] * adds
    freedom = max(np.count_nonzero(known) - len(share) - 2 * known.shape[1] + 2, 1)
    variance = float((known * left**2).sum()) / freedom
    weight = (known * adds**2).sum(axis=1)
    return duty, share, math.sqrt(variance / float(np.median(weight)))


def _lines(share: FloatArray, flow: FloatArray, known: FloatArray) -> tuple[FloatArray, FloatArray]:
    """At each pressure the flow at share 0 and what a share of 1 adds, (B,) each, of weights
    `known` (n, B)."""
    count = known.sum(axis=0)
    mean_share = (known * share[:, None]).sum(axis=0) / count
    mean_flow = (known * flow).sum(axis=0) / count
    spread = (known * (share[:, None] - mean_share) ** 2).sum(axis=0)
    product = (known * (share[:, None] - mean_share) * (flow - mean_flow)).sum(axis=0)
    adds = product / np.maximum(spread, 1e-12)
    return mean_flow - adds * mean_share, adds


# --- the linear range ------------------------------------------------------------------


def linear_range(duty: FloatArray, opening: FloatArray, std: float = 0.0) -> LinearRange:
    """The line with two ends that is closest to the opening (n,) over duty (n,).

    Its ends lie within the duties tested. Their errors follow from what the line leaves, or from
    the opening's standard error `std` where that is larger. Least squares over both ends on ever
    finer grids; the levels follow linearly.
    """
    low, high = float(duty[0]), float(duty[-1])
    span = high - low
    firsts = np.linspace(low, low + 0.6 * span, 61)
    found = _best(duty, opening, firsts, np.linspace(high - 0.6 * span, high, 61))
    width = 0.01 * span
    for _ in range(12):
        steps = np.linspace(-width, width, 9)
        firsts, lasts = found.first + steps, found.last + steps
        found = _best(
            duty,
            opening,
            np.unique(np.clip(firsts, low, high)),
            np.unique(np.clip(lasts, low, high)),
        )
        width *= 0.5
    return replace(found, std=_width_error(duty, opening, found, std))


def _width_error(duty: FloatArray, opening: FloatArray, line: LinearRange, std: float) -> float:
    """Standard error of the line's width; an end that is that of the duties tested has none."""
    rise, width = line.high - line.low, line.width
    x = np.clip((duty - line.first) / width, 0.0, 1.0)
    inside = np.where((x > 0.0) & (x < 1.0), 1.0, 0.0)
    columns, of_width = [1.0 - x, x], [0.0, 0.0]
    if line.first > duty[0] + 1e-6:
        columns.append(inside * rise * (duty - line.last) / width**2)
        of_width.append(-1.0)
    if line.last < duty[-1] - 1e-6:
        columns.append(-inside * rise * (duty - line.first) / width**2)
        of_width.append(1.0)
    left = opening - line_of(duty, line)
    variance = max(float(left @ left) / max(len(duty) - len(columns), 1), std**2)
    jacobian, weights = np.column_stack(columns), np.array(of_width)
    inverse = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
    return math.sqrt(variance * float(weights @ inverse @ weights))


def _best(
    duty: FloatArray, opening: FloatArray, firsts: FloatArray, lasts: FloatArray
) -> LinearRange:
    a, b = (g.ravel() for g in np.meshgrid(firsts, lasts, indexing="ij"))
    kept = b - a > 1e-6
    a, b = a[kept], b[kept]
    x = np.clip((duty - a[:, None]) / (b - a)[:, None], 0.0, 1.0)
    centred = x - x.mean(axis=1, keepdims=True)
    spread = (centred**2).sum(axis=1)
    product = centred @ (opening - opening.mean())
    slope = product / np.maximum(spread, 1e-12)
    left = float(((opening - opening.mean()) ** 2).sum()) - slope * product
    i = int(np.argmin(left))
    level = float(opening.mean() - slope[i] * x[i].mean())
    return LinearRange(float(a[i]), float(b[i]), 0.0, level, level + float(slope[i]))


# --- the choice ------------------------------------------------------------------------


def _chosen(responses: Sequence[DutyResponse], least_range: float | None) -> tuple[float, str]:
    """The period chosen, s, and why; of several valves the narrowest range counts."""
    periods = list(dict.fromkeys(r.period_s for r in responses))
    worst = {
        p: min((r for r in responses if r.period_s == p), key=lambda r: r.linear.width)
        for p in periods
    }
    if least_range is not None:
        wide = [p for p in periods if worst[p].linear.width >= least_range]
        if not wide:
            raise NotIdentifiedError(
                f"no frequency has a linear range of {least_range:g} of the duty (the widest: "
                f"{max(r.linear.width for r in worst.values()):.3f})"
            )
        chosen = min(wide)
        return chosen, (
            f"the highest with a linear range of at least {least_range:g} of the duty "
            f"({_range(worst[chosen])}){_others(worst, chosen)}"
        )
    widest = max(worst.values(), key=lambda r: r.linear.width)
    alike = [p for p in periods if not _narrower(worst[p], widest)]
    chosen = min(alike)
    why = f"the duty is linear over the widest range ({_range(worst[chosen])})"
    if chosen != widest.period_s:
        why = (
            f"its linear range of the duty ({_range(worst[chosen])}) is not significantly narrower "
            f"than that at {widest.frequency_hz:.4g} Hz, and it changes the flow sooner"
        )
    return chosen, why + _others(worst, chosen)


def _narrower(one: DutyResponse, widest: DutyResponse) -> bool:
    """Whether a linear range is significantly narrower than the widest."""
    error = math.hypot(one.linear.std, widest.linear.std)
    return widest.linear.width - one.linear.width > _SIGNIFICANT * error


def _range(response: DutyResponse) -> str:
    linear = response.linear
    return f"{linear.first:.3f} to {linear.last:.3f}"


def _others(worst: Mapping[float, DutyResponse], chosen: float) -> str:
    """What the other frequencies have."""
    said = []
    for period, response in worst.items():
        if period == chosen:
            continue
        pairs = response.overlapping
        text = f"{response.frequency_hz:.4g} Hz {_range(response)}"
        if pairs:
            shown = ", ".join(f"{a:.4g} and {b:.4g}" for a, b in pairs[:3])
            text += f", where duties {shown}{' and more' if len(pairs) > 3 else ''} overlap"
        said.append(text)
    return f"; {'; '.join(said)}" if said else ""


__all__ = [
    "CampaignTests",
    "DutyResponse",
    "FrequencyChoice",
    "LinearRange",
    "at_the_rigs_period",
    "choose_frequency",
    "linear_range",
    "logged_periods",
    "openings",
]
