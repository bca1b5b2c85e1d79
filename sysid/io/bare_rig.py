"""A rig for logs that come without a rig file: what they show, and else the reference rig's.

The reference rig is the thesis' (`sysid.io.bundled`). Each constant that is taken from it is in
the rig's `assumed`; results say what rests on it.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.io import plausibility
from sysid.io.bundled import REFERENCE_BUNDLE, thesis_folder
from sysid.io.channels import PRESSURES, VALVE_COMMANDS
from sysid.io.declaration import LONGEST_TEXT, range_of
from sysid.io.exclusion import Exclusion
from sysid.io.log_constants import VACUUM, ShownConstants, shown_constants
from sysid.io.logs import Log, log_of, log_table
from sysid.io.motion import units_of
from sysid.io.rig import ASSUMED, BARE, Rig, rig_from_content
from sysid.io.rig_sections import FILL_AND_BLEED, Air, Cylinder, Motor, Valves
from sysid.io.tables import LogTable
from sysid.io.units import ColumnMap, parse_map

SOURCE = BARE
"""What messages name in place of a rig file."""

_LINEAR = ("position_m", "velocity_m_per_s", "motor_force_n")
# What a log's columns say, or nothing depends on.
_SAID = (
    ("rig", "name"),
    ("rig", "motion"),
    ("cylinder", "chambers"),
    ("valves", "arrangement"),
)
_FULL_TURN = 2.0 * math.pi


@dataclass(frozen=True)
class BareLogs:
    """Logs that were read without a rig file, and the rig that was made for them.

    `read_with` is that rig, but where the motor's effort is `in_volts`, as no torque constant is
    declared: then one volt is one newton metre (or newton), and nothing else is known. `shown`:
    the constants that the logs show, as dotted keys. `notices`: what may be a slip though no rig
    file contradicts it.
    """

    rig: Rig
    read_with: Rig
    logs: tuple[Log, ...]
    in_volts: bool
    shown: tuple[str, ...]
    notices: tuple[str, ...]


def read_bare_logs(
    paths: Sequence[Path],
    mapping: Mapping[str, ColumnMap],
    existing_content: Mapping[str, Any] | None = None,
    exclude: Sequence[Sequence[Exclusion]] = (),
    *,
    readings: bool = False,
) -> BareLogs:
    """Read logs of one rig without its rig file.

    `existing_content` is the content of the rig with which other parts were fitted: its assumed
    constants are replaced where these logs show them, all others kept. `exclude`: what is not read
    of each log. `readings` and InputError as for `read_log`.
    """
    excluded = exclude or [()] * len(paths)
    tables = [log_table(path, mapping) for path in paths]
    present = {name for table in tables for name in _channels(table, mapping)}
    is_linear = any(name in present for name in _LINEAR)
    reference = _reference(is_linear, paths[0].stem[:LONGEST_TEXT])
    if any(name.endswith(("_fill", "_bleed")) for name in present & {*VALVE_COMMANDS}):
        reference = _of_two_valves(reference)
    in_volts = "motor_volts" in present and not present & {"motor_torque_nm", "motor_force_n"}
    draft = _draft(reference, in_volts)
    shown = shown_constants(
        [
            log_of(t, draft, mapping, None, own, readings=readings)
            for t, own in zip(tables, excluded, strict=True)
        ],
        draft.position_channel,
        draft.effort_channel,
    )
    content = (
        reference
        if existing_content is None
        else {k: v for k, v in existing_content.items() if k != ASSUMED}
    )
    free = (
        set(_dotted(content))
        if existing_content is None
        else set(existing_content.get(ASSUMED, ()))
    )
    if any(entry.gauge for entry in mapping.values()):
        # Their zero is the atmosphere's pressure, whatever that was.
        shown = dataclasses.replace(shown, atmosphere_pa=None, open_pa=())
    content, left = _completed(content, free, shown, present, in_volts)
    found = [key for key in _dotted(content) if key in free and key not in left]
    rig = rig_from_content({ASSUMED: left, **content} if left else content, SOURCE)
    read_with = _volts_as_effort(rig) if in_volts else rig
    logs = tuple(
        log_of(table, read_with, mapping, None, own, readings=readings)
        for table, own in zip(tables, excluded, strict=True)
    )
    doubts = list(_doubts(logs, rig, mapping))
    elsewhere = _not_the_atmosphere(logs, shown)
    if elsewhere is not None and _are_twice(shown, rig):
        logs = tuple(_contradicted(log, elsewhere) for log in logs)
    elif elsewhere is not None:
        doubts.insert(0, elsewhere)
    return BareLogs(rig, read_with, logs, in_volts, tuple(found), tuple(doubts))


def _channels(table: LogTable, mapping: Mapping[str, ColumnMap]) -> Iterator[str]:
    """The channels that a table holds, by their names in the log format."""
    taken = {table.column_of(target, mapping) for target in mapping}
    yield from mapping
    yield from (name for name in table.header if name not in taken)


def _reference(is_linear: bool, name: str) -> dict[str, Any]:
    """The content of the reference rig's file; a linear one is it at its pitch radius."""
    text = (thesis_folder() / REFERENCE_BUNDLE).read_text("utf-8")
    full: dict[str, Any] = json.loads(text)["rig"]
    radius = full["cylinder"]["pitch_radius_m"]
    inertia, torque = full["inertia"]["equivalent_kg_m2"], full["motor"]["max_torque_nm"]
    motion = units_of(is_linear).motion
    counts = full["sensors"]["encoder_counts_per_rev"]
    content = {
        "rig": {"name": name, "motion": motion, "orientation": full["rig"]["orientation"]},
        "air": dict(full["air"]),
        "cylinder": dict(full["cylinder"]),
        "inertia": {"equivalent_kg_m2": inertia},
        "motor": {"max_torque_nm": torque},
        **{section: dict(full[section]) for section in ("pwm", "valves", "sampling")},
        "sensors": {"encoder_counts_per_rev": counts},
    }
    if is_linear:
        del content["cylinder"]["pitch_radius_m"]
        content["inertia"] = {"mass_kg": _rounded(inertia / radius**2)}
        content["motor"] = {"max_force_n": _rounded(torque / radius)}
        content["sensors"] = {"encoder_counts_per_m": round(counts / (_FULL_TURN * radius))}
    return content


def _of_two_valves(reference: Mapping[str, Any]) -> dict[str, Any]:
    """The same with one chamber, which a fill and a bleed valve serve, as the columns say."""
    cylinder = {k: v for k, v in reference["cylinder"].items() if not k.endswith(("_b_m2", "_b_m"))}
    return {
        **reference,
        "cylinder": {**cylinder, "chambers": ["a"]},
        "valves": {**reference["valves"], "arrangement": FILL_AND_BLEED},
    }


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _draft(reference: Mapping[str, Any], in_volts: bool) -> Rig:
    """A rig to read logs with before anything is known: it contradicts nothing but units."""
    highest = range_of(Air, "supply_pressure_pa").upper  # pressures are taken as they are
    air = {**reference["air"], "supply_pressure_pa": highest}
    content = {"rig": reference["rig"], "air": air, "sensors": reference["sensors"]}
    draft = rig_from_content(content, SOURCE)
    if reference["valves"].get("arrangement") == FILL_AND_BLEED:
        valves = Valves.from_table(reference["valves"], SOURCE)
        draft = dataclasses.replace(draft, valves=valves)
    return _volts_as_effort(draft) if in_volts else draft


def _volts_as_effort(rig: Rig) -> Rig:
    """The rig on which one volt is one unit of effort, of which nothing else is known.

    Without cylinder and inertia, whose efforts cannot be added to volts.
    """
    key = rig.units.effort_per_volt
    motor = Motor.from_table({key: 1.0}, SOURCE)
    assumed = (*rig.assumed, f"motor.{key}")
    return dataclasses.replace(rig, motor=motor, cylinder=None, inertia=None, assumed=assumed)


def _dotted(content: Mapping[str, Any]) -> Iterator[str]:
    """The keys of a rig file's constants: not its name, nor what the columns say."""
    for section, table in content.items():
        for key in table:
            if (section, key) not in _SAID:
                yield f"{section}.{key}"


def _completed(
    content: Mapping[str, Any],
    free: Collection[str],
    shown: ShownConstants,
    present: Collection[str],
    in_volts: bool,
) -> tuple[dict[str, Any], list[str]]:
    """The rig's content with what the logs show in place of `free` constants, and which of these
    are still assumed.
    """
    made = {section: dict(table) for section, table in content.items()}
    known = {
        "air.atmospheric_pressure_pa": shown.atmosphere_pa,
        "air.supply_pressure_pa": shown.supply_pa,
        "air.temperature_k": shown.temperature_k,
        "sampling.period_s": shown.sampling_s,
        "pwm.period_s": shown.pwm_period_s,
    }
    low, high = known["air.atmospheric_pressure_pa"], known["air.supply_pressure_pa"]
    ambient = low or made["air"]["atmospheric_pressure_pa"]
    is_vacuum = low is not None and high is not None and high < VACUUM * low
    if high is not None and high <= ambient and not is_vacuum:
        known["air.supply_pressure_pa"] = high = None
    if high is None and "air.supply_pressure_pa" in free and shown.highest_pa is not None:
        # No test is excluded by an assumed supply.
        lowest = max(made["air"]["supply_pressure_pa"], _rounded(shown.highest_pa))
        made["air"]["supply_pressure_pa"] = lowest
    found = {key: value for key, value in known.items() if value is not None and key in free}
    stroke = _stroke(made, shown) if "cylinder.stroke_m" in free else None
    if stroke is not None:
        _set_stroke(made["cylinder"], stroke)
        if made["rig"].get("motion") == "linear":
            found["cylinder.stroke_m"] = stroke
    for key, value in found.items():
        section, name = key.split(".")
        made[section][name] = value
    left = [key for key in free if key not in found]
    dropped = set()
    if "encoder_counts" not in present:
        dropped.add("sensors")  # readings in SI say their own resolution
    if not {*PRESSURES, *VALVE_COMMANDS} & set(present):
        # A motor alone, as far as the logs say: its inertia follows from its motion.
        dropped |= {"air", "cylinder", "pwm", "valves", "inertia"}
    limit = max(made.get("motor", {}).values(), default=math.inf)
    is_driven = bool({"motor_torque_nm", "motor_force_n"} & set(present))
    if not is_driven or (shown.largest_effort or 0.0) > limit:
        dropped.add("motor")
    for section in dropped:
        if all(f"{section}.{key}" in free for key in made.get(section, ())):
            made.pop(section, None)
            left = [key for key in left if not key.startswith(f"{section}.")]
    order = [key for key in _dotted(made) if key in left]
    return made, order


def _stroke(content: Mapping[str, Any], shown: ShownConstants) -> float | None:
    """The stroke (m) by which a held piston is at an end; of a moving one, at least its way.

    None where the reference rig's does.
    """
    if shown.reach is None:
        return None
    cylinder = content["cylinder"]
    way = _rounded(2.0 * shown.reach * cylinder.get("pitch_radius_m", 1.0))
    if shown.is_held:
        return way if way >= range_of(Cylinder, "stroke_m").lower else None
    return way if way > cylinder["stroke_m"] else None


def _set_stroke(cylinder: dict[str, Any], stroke: float) -> None:
    """A stroke, and offsets that leave each chamber its dead length at the end."""
    for key in {"offset_a_m", "offset_b_m"} & cylinder.keys():
        dead = cylinder[key] - 0.5 * cylinder["stroke_m"]
        if cylinder[key] <= 0.5 * stroke:
            cylinder[key] = _rounded(0.5 * stroke + dead)
    cylinder["stroke_m"] = stroke


def _not_the_atmosphere(logs: Sequence[Log], shown: ShownConstants) -> str | None:
    """A line where open chambers rest at another pressure than the atmosphere's; else None."""
    if len(shown.open_pa) <= (shown.atmosphere_pa is not None):
        return None
    rests = " and at ".join(f"{pressure:.4g}" for pressure in shown.open_pa)
    return (
        f"{', '.join(str(log.path) for log in logs)}: chambers rest at {rests} Pa with their "
        "valves off, which is not the atmosphere's pressure: is that added twice? Map an "
        "absolute pressure without (g)"
    )


def _are_twice(shown: ShownConstants, rig: Rig) -> bool:
    """Whether open chambers rest at twice the atmosphere's pressure."""
    ambient = rig.atmosphere_pa
    if ambient is None:
        return False
    return any(abs(rest / (2.0 * ambient) - 1.0) <= plausibility.TWICE for rest in shown.open_pa)


def _contradicted(log: Log, line: str) -> Log:
    """A log that says, first, what is contradictory in it."""
    trials = tuple(
        dataclasses.replace(t, contradictions=(line, *t.contradictions)) for t in log.trials
    )
    return dataclasses.replace(
        log,
        trials=trials,
        contradictions=(line, *log.contradictions),
        notices=(line, *log.notices),
    )


def _doubts(logs: Sequence[Log], rig: Rig, mapping: Mapping[str, ColumnMap]) -> Iterator[str]:
    """Notices of what a rig file would contradict, as far as the logs alone show it."""
    name, undeclared = rig.position_channel, dataclasses.replace(rig, sampling=None)
    for log in logs:
        period, rows = float(np.median([t.period for t in log.trials])), sum(map(len, log.trials))
        slow = plausibility.check_speed(str(log.path), "time_s", period, rows, undeclared)
        if slow is not None:
            yield slow
        if rig.is_linear or _has_stated_unit(log, name, mapping):
            continue
        # The integral of a speed has no unit of its own, and a wheel goes on turning.
        read = [t[name] for t in log.trials if name in t and t.place_known]
        ends = [float(end) for place in read for end in (place.min(), place.max())]
        if ends and max(max(ends), -min(ends)) > _FULL_TURN:
            yield (
                f"{log.path}: {name} runs from {min(ends):.4g} to {max(ends):.4g} rad, more than a "
                "turn from its zero: if it is in degrees, "
                + plausibility.give_map(name, name, "deg")
            )


def _has_stated_unit(log: Log, name: str, mapping: Mapping[str, ColumnMap]) -> bool:
    """Whether the unit of a channel was given: with `mapping`, or when the log was converted."""
    if name in mapping:
        return mapping[name].unit is not None
    entries = (line.strip("# ").removeprefix("map: ") for line in log.comments if "map: " in line)
    given = [entry for entry in entries if entry.startswith(f"{name}=")]
    return any(parse_map([entry])[name].unit is not None for entry in given if "(" not in entry)


__all__ = ["SOURCE", "BareLogs", "read_bare_logs"]
