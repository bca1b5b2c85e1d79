"""Which parameters a log's tests can identify, and which test would identify the rest.

Friction: what its fit returns, so that the two cannot differ.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sysid.checks.friction import POINTS, Identification, friction_identified
from sysid.io.channels import DUTIES, SIDES, SWITCHES
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.io.trial_kind import is_active
from sysid.model.base import CRITICAL_RATIO
from sysid.types import FloatArray

TrialsByKind = Mapping[str, Sequence[Trial]]

_FEWEST_DUTIES = 5


def identifications(
    by_kind: TrialsByKind, rig: Rig, declared: str | None = None
) -> Iterator[Identification]:
    """Every parameter of the model in turn; those of valves where the rig or the log has some.

    `by_kind` holds the log's trials by kind; `declared` is the kind that a campaign gives them.
    """
    yield from friction_identified([t for group in by_kind.values() for t in group], rig, declared)
    if declared != POINTS:
        yield from valves_identified(by_kind, rig)


def valves_identified(
    by_kind: TrialsByKind, rig: Rig, valves: Sequence[str] = SIDES
) -> Iterator[Identification]:
    """The flows of these valves, where the rig or the log has some."""
    commanded = any(is_active(t, *DUTIES, *SWITCHES) for group in by_kind.values() for t in group)
    if rig.cylinder is None or (rig.valves is None and not commanded):
        return
    for valve in valves:
        yield from _discrete(by_kind.get("valve-discrete", ()), rig, valve)
        yield from _pwm(by_kind.get("valve-pwm", ()), valve)


def excitation(by_kind: TrialsByKind, rig: Rig) -> Iterator[str]:
    """One line per kind of test: the commands and their range."""
    for kind, trials in by_kind.items():
        parts = [f"{kind}: {len(trials)} test{'s' * (len(trials) > 1)}"]
        for name in (rig.effort_channel, rig.position_channel, "pressure_a_pa", "pressure_b_pa"):
            values = [t[name] for t in trials if name in t]
            if values:
                joined = np.concatenate(values)
                parts.append(f"{name} {joined.min():.4g} to {joined.max():.4g}")
        yield ", ".join(parts)


def _discrete(trials: Sequence[Trial], rig: Rig, valve: str) -> Iterator[Identification]:
    pressure = f"pressure_{valve}_pa"
    used = [t for t in trials if is_active(t, f"valve_{valve}") and pressure in t]
    air = rig.air
    parameters = ("choked filling flow", "c_fill", "choked exhaust flow", "c_dis")
    if not used or air is None:
        why = f"needs a valve-discrete test of valve {valve.upper()}: piston held, on 3 s, off"
        for name in parameters:
            yield Identification(f"valve {valve.upper()} {name}", False, why)
        return
    boundary_fill = CRITICAL_RATIO * air.supply_pressure_pa
    boundary_dis = air.atmospheric_pressure_pa / CRITICAL_RATIO
    filling = np.concatenate([t[pressure][t[f"valve_{valve}"] > 0] for t in used])
    exhaust = np.concatenate([_after_on(t, valve) for t in used])
    checks = (
        (filling, np.less, boundary_fill, "fill from the atmosphere"),
        (filling, np.greater, boundary_fill, "hold the valve on longer"),
        (exhaust, np.greater, boundary_dis, "fill further before switching off"),
        (exhaust, np.less, boundary_dis, "record longer after switching off"),
    )
    for name, (values, relation, boundary, remedy) in zip(parameters, checks, strict=True):
        share = int(np.count_nonzero(relation(values, boundary)))
        good = share >= 20
        reason = f"{share} samples in its regime (boundary {boundary:.0f} Pa)"
        yield Identification(
            f"valve {valve.upper()} {name}", good, reason if good else f"{reason}: {remedy}"
        )


def _after_on(trial: Trial, valve: str) -> FloatArray:
    command = trial[f"valve_{valve}"] > 0
    first = int(np.argmax(command))
    later = ~command
    later[:first] = False
    return trial[f"pressure_{valve}_pa"][later]


def _pwm(trials: Sequence[Trial], valve: str) -> Iterator[Identification]:
    name, pressure = f"duty_{valve}", f"pressure_{valve}_pa"
    filling: set[float] = set()
    discharging: set[float] = set()
    for trial in trials:
        if name not in trial or pressure not in trial:
            continue
        values = trial[pressure]
        rising = np.mean(values[-20:]) >= np.mean(values[:5])
        (filling if rising else discharging).add(round(float(np.median(trial[name])), 4))
    for what, duties in (("filling", filling), ("discharging", discharging)):
        duties.discard(0.0)
        good = len(duties) >= _FEWEST_DUTIES
        reason = f"{len(duties)} duties"
        if not good:
            tests = f"valve-pwm tests of valve {valve.upper()}, {what}"
            reason += f": needs {tests}, with at least {_FEWEST_DUTIES} duties"
        yield Identification(f"valve {valve.upper()} PWM surface, {what}", good, reason)
