"""What a valve's PWM tests do not cover, and which test deviates from the others.

Nothing here changes a fit: each finding is a line on what cannot be trusted.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from sysid.identification.valve_pwm.samples import FlowSamples, PwmTest, choked_boundaries
from sysid.io.rig import Rig
from sysid.surfaces.domain import Domain, level_flows
from sysid.types import FloatArray

# A test that deviates this far (in duty) from the line between its neighbours in duty, and
# six times as far as is usual, is reported.
OFF_SURFACE_DUTY = 0.015
_OFF_SURFACE_FACTOR = 6.0


def coverage(
    samples: FlowSamples,
    domain: Domain,
    other_duties: Sequence[float],
    tests: Sequence[PwmTest],
    rig: Rig,
) -> list[str]:
    """What the tests do not cover, and tests that deviate from the surface of the others."""
    lines = []
    own = samples.duty[domain.holds_duty(samples.duty)]
    for low, high in duty_gaps(np.unique(own), other_duties):
        lines.append(
            f"no usable test between duties {low:.4g} and {high:.4g}: the domain spans the gap, "
            "but the surface is only interpolated there; a test in between would support it"
        )
    lines += _missing_ends(np.unique(samples.duty), other_duties)
    lines += unseen_regimes(samples, tests, rig)
    for duty, off in off_surface_tests(samples.part(domain.holds_duty(samples.duty))):
        lines.append(
            f"duty {duty:.4g} deviates by {off:+.3f} from the line between its neighbours in duty: "
            "the supply, the logged duty or the chamber was different; check that test"
        )
    return lines


def _missing_ends(own: FloatArray, others: Sequence[float]) -> list[str]:
    lines = []
    # The grids of both directions need not meet: the other one reaches further where it has a
    # test that is half a step beyond.
    near = max(1e-3, 0.5 * _usual_step(own))
    for side, mine in (("below", own.min()), ("above", own.max())):
        beyond = [d for d in others if (d < mine - near if side == "below" else d > mine + near)]
        if beyond:
            lines.append(
                f"no usable test {side} duty {mine:.4g}, though the other direction has one at "
                f"{min(beyond) if side == 'below' else max(beyond):.4g}: the domain ends there"
            )
    return lines


def unseen_regimes(samples: FlowSamples, tests: Sequence[PwmTest], rig: Rig) -> list[str]:
    """A regime of the flow of one direction's `tests` without samples."""
    air = rig.require("air", "which the choked boundaries follow from")
    fill, exhaust = choked_boundaries(air, air.supply_pressure_pa)
    low, high = float(samples.pressure.min()), float(samples.pressure.max())
    below, above = _at_start(tests), "fill further or at higher duties"
    if not tests[0].filling:
        below, above = "record longer or at lower duties", below
    regimes = [
        (high <= fill, "unchoked filling", "above", fill, above),
        (low >= fill, "choked filling", "below", fill, below),
        (low >= exhaust, "unchoked exhaust", "below", exhaust, below),
        (high <= exhaust, "choked exhaust", "above", exhaust, above),
    ]
    return [
        f"{name} ({side} {boundary / 1e3:.0f} kPa) cannot be identified: the samples cover "
        f"{low / 1e3:.0f} to {high / 1e3:.0f} kPa, and the surface holds there only; {fix}"
        for absent, name, side, boundary, fix in regimes
        if absent
    ]


def _at_start(tests: Sequence[PwmTest]) -> str:
    """How to have samples where tests begin: at the atmosphere if they fill, else at the supply."""
    first = [t.usable[: max(1, len(t.usable) // 10)].mean() for t in tests]
    if np.mean(first) < 0.5:
        return "tests begin there, but these rows are missing or excluded"
    return "tests pass it too quickly: use a larger chamber, or duties at which they take longer"


def off_surface_tests(samples: FlowSamples) -> list[tuple[float, float]]:
    """Duties whose flow does not lie between that of the neighbouring duties, and by how much.

    At each pressure the flow is nearly a straight line over duty (the valve is open for a
    share of the time that grows with it). Returns (duty, deviation in duty).
    """
    levels = level_flows(samples.duty, samples.pressure, samples.flow)
    u, m = levels.duty, levels.flow
    departure = np.zeros(len(u))
    if len(u) < 4:
        return []
    spans = (u[2:] - u[:-2])[:, None]
    rises = (m[2:] - m[:-2]) / spans
    off = m[1:-1] - m[:-2] - rises * (u[1:-1] - u[:-2])[:, None]
    met = np.isfinite(rises).any(axis=0)
    usual_rise = np.full(m.shape[1], math.nan)
    usual_rise[met] = np.nanmedian(rises[:, met], axis=0)
    for i, row in enumerate(off / usual_rise):
        shared = np.isfinite(row)
        if np.count_nonzero(shared) >= 3:
            departure[i + 1] = float(np.median(row[shared]))
    size = np.abs(departure)
    usual = float(np.median(size[size > 0])) if (size > 0).any() else 0.0
    limit = max(OFF_SURFACE_DUTY, _OFF_SURFACE_FACTOR * usual)
    # A deviating test shifts its neighbours' deviations the other way, by half as much.
    found = np.flatnonzero(size > limit)
    last = len(u) - 1
    peaks = [i for i in found.tolist() if size[i] >= max(size[i - 1], size[min(i + 1, last)])]
    return [(float(u[i]), float(departure[i])) for i in peaks]


def _usual_step(duties: FloatArray) -> float:
    """Median step between neighbouring duties; 0 of a single one."""
    steps = np.diff(np.unique(np.round(duties, 4)))
    return float(np.median(steps)) if len(steps) else 0.0


def duty_gaps(duties: Iterable[float], others: Iterable[float] = ()) -> list[tuple[float, float]]:
    """Gaps in the grid of duties: neighbours more than one and a half usual steps apart.

    `others`: duties of the other direction's tests. Where their grid is the finer one, its step is
    what is usual next to each of them; a grid that is merely shifted shows no gap.
    """
    own = np.unique(np.round(np.fromiter(duties, dtype=float), 4))
    if len(own) < 3:
        return []
    steps = np.diff(own)
    wide = steps > 1.5 * _usual_step(own) + 1e-4
    other = np.unique(np.round(np.fromiter(others, dtype=float), 4))
    if len(other) > 1:
        missing = np.array([np.abs(own - d).min() > 1e-3 for d in other])
        between = np.histogram(other[missing], own)[0] > 0
        wide |= between & (steps > 1.5 * _usual_step(other) + 1e-4)
    return [(float(own[i]), float(own[i + 1])) for i in np.flatnonzero(wide)]
