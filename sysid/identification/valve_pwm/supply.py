"""The supply during a log's tests, and which tests show another than the rig file's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.estimation.quality import DISAGREE, FEWEST_REPEATS
from sysid.identification.valve_pwm.remarks import Remarks
from sysid.identification.valve_pwm.samples import PwmTest, open_share
from sysid.io.rig import Rig
from sysid.signals import deviation_by_median
from sysid.surfaces.domain import SAME_SUPPLY
from sysid.types import FloatArray

# Deviation of the supply that the tests were run with above which it is said, as a share of
# the rig file's. Smaller ones are taken into account alike; gauges do not show them.
_SAID_DEVIATION = 0.003
_SAME_DUTY = 1e-3


def start_pressure(pressure: FloatArray, duty: float, period: float, rig: Rig) -> float:
    """Mean pressure before the valve's first movement can have changed it."""
    delays, pwm = rig.valves, rig.pwm
    quiet = 0.0
    if delays is not None and pwm is not None:
        quiet = min(delays.on_delay_s, delays.off_delay_s + duty * pwm.period_s)
    return float(np.mean(pressure[: max(1, math.floor(quiet / period + 1e-9) + 1)]))


def rest_pressure(test: PwmTest) -> float | None:
    """Pressure at which the test settles, Pa; None where it is still far from it.

    From the means over the last three stretches: the remaining change is that of a geometric
    series (Aitken), and must be small.
    """
    n = _stretch(test)
    if len(test.pressure) < 4 * n or not test.usable[-3 * n :].all():
        return None
    early, middle, late = test.pressure[-3 * n :].reshape(3, n).mean(axis=1)
    before, last = float(middle - early), float(late - middle)
    ratio = min(max(last / before, 0.0), 0.9) if before != 0.0 else 0.0
    left = last * ratio / (1.0 - ratio)
    return float(late) + left if abs(left) < 0.01 * test.supply else None


def _stretch(test: PwmTest) -> int:
    """Rows of one of the stretches over whose means a test's pressure settles."""
    return max(8, len(test.pressure) // 20)


def consistent_supply(tests: Sequence[PwmTest], rig: Rig, remarks: Remarks) -> list[PwmTest]:
    """The tests that show no other supply than the rig file's.

    Evidence: where a discharging test starts; where the pressure rests under a duty at
    which the valve never closes; a filling test that rests elsewhere than the discharging one
    of the same duty; and a pressure at rest below that of two tests at lower duties. Filling
    tests without evidence are treated as the majority of those with evidence.
    """
    declared = float(rig.require("air", "which the supply is taken from").supply_pressure_pa)
    tolerance = SAME_SUPPLY * declared
    rests = [rest_pressure(t) for t in tests]
    seen = [_supply_seen(t, r, rig) for t, r in zip(tests, rests, strict=True)]
    wrong = [s is not None and abs(s - declared) > tolerance for s in seen]
    good = [
        (t.duty, r, t.filling)
        for t, r, w in zip(tests, rests, wrong, strict=True)
        if r is not None and not w
    ]
    known = np.array(good, dtype=float).reshape(-1, 3)
    verdicts: list[bool | None] = []
    for i, (test, rest) in enumerate(zip(tests, rests, strict=True)):
        if wrong[i]:
            supply = round(float(seen[i] or 0.0), -3) / 1e3
            remarks.exclude(
                test,
                f"the supply was at about {supply:.0f} kPa, not the rig file's "
                f"{declared / 1e3:.0f} kPa, the only supply that the surface is valid for",
            )
            verdicts.append(False)
            continue
        verdict = None if rest is None else _rests_as_others(test, rest, known, tolerance)
        if verdict is False:
            remarks.exclude(
                test,
                "the pressure settles at another level than in the other direction "
                "or at lower duties: the supply dropped, or the logged duty is wrong",
            )
        verdicts.append(True if seen[i] is not None and verdict is None else verdict)
    return _with_the_majority(tests, verdicts, remarks)


def _rests_as_others(
    test: PwmTest, rest: float, known: FloatArray, tolerance: float
) -> bool | None:
    """Whether a test's pressure at rest fits the others'; None where they do not show it.

    `known` (m, 3): duty, pressure at rest and direction (1: filling) of the tests.
    """
    duty, level, filling = known.T
    partner = (np.abs(duty - test.duty) < _SAME_DUTY) & (filling == 0.0)
    if test.filling and partner.any():
        return bool(np.min(np.abs(level[partner] - rest)) <= tolerance)
    below = (duty <= test.duty + _SAME_DUTY) & (level > rest + 1.5 * tolerance)
    return False if np.count_nonzero(below) >= 2 else None


def _with_the_majority(
    tests: Sequence[PwmTest], verdicts: Sequence[bool | None], remarks: Remarks
) -> list[PwmTest]:
    """The good tests, together with those without evidence unless most filling tests are bad."""
    filling = [v for t, v in zip(tests, verdicts, strict=True) if t.filling and v is not None]
    suspect = filling.count(False) > filling.count(True)
    kept = []
    for test, verdict in zip(tests, verdicts, strict=True):
        if verdict is None and test.filling and suspect:
            remarks.exclude(
                test, "most filling tests show another supply pressure than the rig file's"
            )
        elif verdict is not False:
            kept.append(test)
    return kept


def _supply_seen(test: PwmTest, rest: float | None, rig: Rig) -> float | None:
    """The supply pressure, Pa, from the test itself; None where it does not show it."""
    if not test.filling and test.usable[0]:
        return start_pressure(test.pressure, test.duty, test.period, rig)
    return rest if open_share(test.duty, rig) >= 1.0 else None


def with_seen_supply(tests: Sequence[PwmTest], rig: Rig, remarks: Remarks) -> list[PwmTest]:
    """The tests of one valve, each with the supply in the scale of the chamber's own sensor.

    A discharging test starts at the supply. The median by which those starts differ from the
    logged supply is an offset between the two sensors; without a log, they are the supply.
    Where logs or directions disagree, each takes its own; where the starts of one log do, too.
    """
    declared = float(rig.require("air", "which the supply is taken from").supply_pressure_pa)
    apart = max(_SAID_DEVIATION * declared, DISAGREE * _sensor_noise(tests))
    found = list(tests)
    for logged in (True, False):
        own = [i for i, t in enumerate(tests) if t.supply_logged == logged]
        pooled = _beyond_noise(_starts([tests[i] for i in own], rig))
        groups: dict[tuple[str, bool], list[int]] = {}
        for i in own:
            groups.setdefault((_log_of(tests[i]), tests[i].filling), []).append(i)
        shifts = {key: _shift_of(key, tests, own, pooled, rig) for key in groups}
        several = any(abs(shift - pooled) > apart for shift in shifts.values())
        for key, rows in groups.items():
            for i in rows:
                by = shifts[key] if several else pooled
                found[i] = replace(tests[i], supply=tests[i].supply + by)
            if several:
                where = f"{key[0]}, {'filling' if key[1] else 'discharging'}: "
                held = [found[i] for i in rows]
                lines = _deviating_supply(held, shifts[key], logged, rig)
                remarks.lines += [where + line for line in lines]
        if not several:
            remarks.lines += _deviating_supply([found[i] for i in own], pooled, logged, rig)
        for key, rows in groups.items():
            if not key[1]:
                _with_own_starts(found, tests, rows, apart, rig, remarks)
    return found


def _log_of(test: PwmTest) -> str:
    return test.source.removesuffix(f", test {test.label}")


def _start_shift(test: PwmTest, rig: Rig) -> float:
    """Excess, Pa, of a test's starting pressure over the logged (else declared) supply."""
    start = start_pressure(test.pressure, test.duty, test.period, rig)
    return start - test.supply_at_start


def _starts(tests: Sequence[PwmTest], rig: Rig) -> FloatArray:
    """`_start_shift` of the discharging tests whose first row is usable, (n,)."""
    return np.array([_start_shift(t, rig) for t in tests if not t.filling and t.usable[0]])


def _shift_of(
    key: tuple[str, bool], tests: Sequence[PwmTest], own: Sequence[int], pooled: float, rig: Rig
) -> float:
    """Shift of the supply, Pa, of one log's tests in one direction; `key`: log, filling.

    Filling tests show it where they rest without the valve closing, else their log's
    discharging ones do. What shows nothing takes the valve's `pooled` shift.
    """
    log, filling = key
    held = [tests[i] for i in own if _log_of(tests[i]) == log]
    rests = [_rest_shift(t, rig) for t in held if t.filling] if filling else []
    seen = np.array([r for r in rests if r is not None])
    if len(seen) >= 2 and np.ptp(seen) < _SAID_DEVIATION * held[0].supply_at_start:
        return float(np.median(seen))
    starts = _starts(held, rig)
    return _beyond_noise(starts) if len(starts) >= FEWEST_REPEATS else pooled


def _rest_shift(test: PwmTest, rig: Rig) -> float | None:
    """Excess, Pa, at rest over the logged (else declared) supply; the valve never closes.

    None where it closes, or where the rest is extrapolated by as much as would be said.
    """
    rest = rest_pressure(test) if open_share(test.duty, rig) >= 1.0 else None
    if rest is None:
        return None
    last = float(test.pressure[-_stretch(test) :].mean())
    extrapolated = abs(rest - last) > 0.5 * _SAID_DEVIATION * test.supply
    return None if extrapolated else rest - test.supply_at_start


def _sensor_noise(tests: Sequence[PwmTest]) -> float:
    """Noise of one row, Pa: that of the test whose pulses disturb it least."""
    found = [np.diff(t.pressure, 2) for t in tests if len(t.pressure) > 2]
    noise = [deviation_by_median(d) / math.sqrt(6.0) for d in found]
    return min(noise, default=0.0)


def _with_own_starts(
    found: list[PwmTest],
    tests: Sequence[PwmTest],
    rows: Sequence[int],
    apart: float,
    rig: Rig,
    remarks: Remarks,
) -> None:
    """Give one log's discharging tests (`rows`) their own starts where these disagree."""
    known = [i for i in rows if tests[i].usable[0]]
    starts = _starts([tests[i] for i in known], rig)
    if len(starts) < FEWEST_REPEATS:
        return
    if np.count_nonzero(np.abs(starts - np.median(starts)) > apart) < FEWEST_REPEATS:
        return
    for i, shift in zip(known, starts, strict=True):
        found[i] = replace(tests[i], supply=tests[i].supply + float(shift))
    low, high = (1e-3 * float(f([found[i].supply for i in known])) for f in (min, max))
    first = tests[known[0]]
    remarks.lines.append(
        f"{_log_of(first)}: valve {first.valve.upper()}: discharging tests start at {low:.1f} to "
        f"{high:.1f} kPa: the supply changed between tests; each is taken at its own start, "
        "filling tests show none and may be off by as much, and the averaged law with them: "
        "log supply_pressure_pa, or steady the supply and repeat"
    )


def supply_of_surfaces(seen: float, declared: float) -> float:
    """The supply (Pa) that surfaces hold at: the tests' where they are said to show another."""
    return seen if abs(seen - declared) > _SAID_DEVIATION * declared else declared


def _beyond_noise(differences: FloatArray) -> float:
    """The median of the differences (n,), 0 where it is within their noise."""
    if len(differences) < FEWEST_REPEATS:
        return 0.0
    middle = float(np.median(differences))
    scatter = deviation_by_median(differences, middle)
    error = math.sqrt(0.5 * math.pi / len(differences)) * scatter
    return middle if abs(middle) > DISAGREE * error else 0.0


def _deviating_supply(tests: Sequence[PwmTest], shift: float, logged: bool, rig: Rig) -> list[str]:
    """A notice where the supply of the tests differs from the rig file's or the logged one."""
    if not tests:
        return []
    declared = float(rig.require("air", "which the supply is taken from").supply_pressure_pa)
    supply = float(np.median([t.supply for t in tests]))
    valve = f"valve {tests[0].valve.upper()}"
    lines = []
    if logged and abs(shift) > _SAID_DEVIATION * declared:
        lines.append(
            f"{valve}: discharging tests start {abs(shift):.3g} Pa "
            f"{'above' if shift > 0.0 else 'below'} the logged supply: one of the two sensors has "
            "an offset, or the chamber was not at the supply; the chamber's sensor is used"
        )
    if abs(supply - declared) > _SAID_DEVIATION * declared:
        by_rest = all(t.filling for t in tests)
        seen = "the supply was at" if logged or by_rest else "discharging tests start at"
        lines.append(
            f"{valve}: {seen} {supply / 1e3:.1f} kPa, the rig file's supply_pressure_pa is "
            f"{declared / 1e3:.1f} kPa: the averaged law is fitted with the former and its choked "
            "filling flow is scaled to the latter; the surfaces hold at the former"
        )
    return lines
