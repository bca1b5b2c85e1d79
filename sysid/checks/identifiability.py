"""Which parameters a log's tests can identify, and which test would identify the rest.

Friction: what its fit returns, and the flows of an on/off valve: what its fit finds in the
samples, so that the two do not differ.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sysid.blocks.numbers import si_number
from sysid.checks.friction import Identification, friction_identified
from sysid.errors import InputError, NotIdentifiedError
from sysid.identification.valve_discrete.start import flows_not_shown
from sysid.identification.valve_discrete.trials import is_switched
from sysid.io.campaign import FRICTION_POINTS
from sysid.io.channels import DUTIES, SWITCHES
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.io.trial_kind import is_active, is_one_duty
from sysid.plant.base import CRITICAL_RATIO
from sysid.types import FloatArray

TrialsByKind = Mapping[str, Sequence[Trial]]

_FEWEST_DUTIES = 5
# An on/off valve's flows, by their names in a bundle.
_FLOW_NAMES = {
    "choked_flow_fill_kg_s": "choked filling flow",
    "c_fill": "c_fill",
    "choked_flow_dis_kg_s": "choked exhaust flow",
    "c_dis": "c_dis",
}


# As pages name those which commands call by their keys.
_READABLE = {
    "c_fill": "unchoked filling coefficient",
    "c_dis": "unchoked exhaust coefficient",
    "sonic_conductance": "sonic conductance",
    "critical_ratio": "critical ratio",
    "subsonic_index": "subsonic index",
    "adiabatic_share": "heat from the wall",
}


def readable(parameter: str) -> str:
    """A parameter of a check as a page names it."""
    place, _, name = parameter.rpartition(" ")
    return f"{place} {_READABLE[name]}".lstrip() if name in _READABLE else parameter


def identifications(
    by_kind: TrialsByKind, rig: Rig, declared: str | None = None
) -> Iterator[Identification]:
    """Every parameter of the model in turn; those of valves where the rig or the log has some.

    `by_kind` holds the log's trials by kind; `declared` is the kind that a campaign gives them.
    """
    if not rig.is_tank_alone:
        trials = [t for group in by_kind.values() for t in group]
        yield from friction_identified(trials, rig, declared)
    if declared != FRICTION_POINTS:
        yield from valves_identified(by_kind, rig)


def valves_identified(
    by_kind: TrialsByKind, rig: Rig, valves: Sequence[str] | None = None
) -> Iterator[Identification]:
    """The flows of these valves (None: the rig's), where the rig or the log has some."""
    if rig.is_tank_alone:
        tests = by_kind.get("valve-discrete", ())
        for valve in rig.sides if valves is None else valves:
            if any(f"pressure_{valve}_pa" in trial for trial in tests):
                yield from _discrete(tests, rig, valve)
        return
    commanded = any(is_active(t, *DUTIES, *SWITCHES) for group in by_kind.values() for t in group)
    if rig.cylinder is None or (rig.valves is None and not commanded):
        return
    for valve in rig.sides if valves is None else valves:
        yield from _discrete(by_kind.get("valve-discrete", ()), rig, valve)
        if rig.has_pwm_surfaces or "valve-pwm" in by_kind:
            yield from _pwm(by_kind.get("valve-pwm", ()), rig, valve)


def switched_test(rig: Rig, valve: str) -> str:
    """The test that identifies an on/off valve, by its letter, in words."""
    return f"a valve-discrete test of valve {valve}: {rig.valve_steps}"


def excitation(by_kind: TrialsByKind, rig: Rig) -> Iterator[str]:
    """One line per kind of test: the commands and their range."""
    for kind, trials in by_kind.items():
        parts = [f"{kind}: {len(trials)} test{'s' * (len(trials) > 1)}"]
        for name in (rig.effort_channel, rig.position_channel, "pressure_a_pa", "pressure_b_pa"):
            values = [t[name] for t in trials if name in t]
            if values:
                joined = np.concatenate(values)
                parts.append(f"{name} {si_number(joined.min())} to {si_number(joined.max())}")
        yield ", ".join(parts)


def _discrete(trials: Sequence[Trial], rig: Rig, valve: str) -> Iterator[Identification]:
    """The flows of an on/off valve: those that a fit of the tests finds in their samples."""
    pressure = f"pressure_{valve}_pa"
    fills = f"valve_{rig.filled_by(valve)}"
    used = [t for t in trials if is_switched(t, valve) and pressure in t]
    title = f"valve {valve.upper()}"
    needs = f"needs {switched_test(rig, title[-1])}"
    if trials and not any(is_switched(t, valve) for t in trials):
        needs = f"{fills} is not logged, or never switched on: {needs}"
    lacking = dict.fromkeys(_FLOW_NAMES, needs)
    counts = dict.fromkeys(_FLOW_NAMES, 0)
    if used and rig.air is not None:
        counts = _in_regime(used, rig, valve)
        try:
            lacking = flows_not_shown(used, rig, valve)
        except (InputError, NotIdentifiedError) as error:
            lacking = dict.fromkeys(_FLOW_NAMES, str(error))
    for name, shown in _FLOW_NAMES.items():
        reason = lacking.get(name, f"{counts[name]} samples in its regime")
        yield Identification(f"{title} {shown}", name not in lacking, reason)


def _in_regime(trials: Sequence[Trial], rig: Rig, valve: str) -> dict[str, int]:
    """How many samples show each flow, choked or not, by its name in a bundle."""
    air, fills = rig.require("air", "which the valve law needs"), f"valve_{rig.filled_by(valve)}"
    boundary_fill = CRITICAL_RATIO * air.supply_pressure_pa
    boundary_dis = air.atmospheric_pressure_pa / CRITICAL_RATIO
    filling = np.concatenate([_while_on(t, valve, fills) for t in trials])
    exhaust = np.concatenate([_after_on(t, valve, fills) for t in trials])
    inside = (
        filling < boundary_fill,
        filling > boundary_fill,
        exhaust > boundary_dis,
        exhaust < boundary_dis,
    )
    found = (int(np.count_nonzero(rows)) for rows in inside)
    return dict(zip(_FLOW_NAMES, found, strict=True))


def _while_on(trial: Trial, valve: str, command: str) -> FloatArray:
    pressure = trial[f"pressure_{valve}_pa"]
    return pressure[trial[command] > 0] if command in trial else pressure[:0]


def _after_on(trial: Trial, valve: str, fills: str) -> FloatArray:
    if f"valve_{valve}_bleed" in trial:
        return _while_on(trial, valve, f"valve_{valve}_bleed")
    command = trial[fills] > 0
    first = int(np.argmax(command))
    later = ~command
    later[:first] = False
    return trial[f"pressure_{valve}_pa"][later]


def _fills(pressure: FloatArray, rig: Rig) -> bool:
    """Whether a test under PWM fills: it begins nearer to the atmosphere than to the supply."""
    start = float(np.mean(pressure[:5]))
    if rig.air is None:
        return bool(np.mean(pressure[-20:]) >= start)
    return abs(start - rig.air.atmospheric_pressure_pa) < abs(start - rig.air.supply_pressure_pa)


def _pwm(trials: Sequence[Trial], rig: Rig, valve: str) -> Iterator[Identification]:
    name, pressure = f"duty_{valve}", f"pressure_{valve}_pa"
    filling: set[float] = set()
    discharging: set[float] = set()
    changes = 0
    for trial in trials:
        if name not in trial or pressure not in trial:
            continue
        if not is_one_duty(trial[name]):
            changes += 1
            continue
        way = filling if _fills(trial[pressure], rig) else discharging
        way.add(round(float(np.median(trial[name])), 4))
    within, one_each = "", ""
    if changes:
        within, one_each = f" ({name} changes within {changes} of {len(trials)})", ", one a test"
    for what, duties in (("filling", filling), ("discharging", discharging)):
        duties.discard(0.0)
        good = len(duties) >= _FEWEST_DUTIES and rig.has_pwm_surfaces
        reason = rig.why_no_surfaces or f"{len(duties)} duties"
        if not good and rig.has_pwm_surfaces:
            tests = f"valve-pwm tests of valve {valve.upper()}, {what}"
            least = f"with at least {_FEWEST_DUTIES} duties{one_each}"
            reason += f"{within}: needs {tests}, {least}"
        yield Identification(f"valve {valve.upper()} PWM surface, {what}", good, reason)
