"""The monitor of a bundle over recorded logs: does the machine still obey its model?"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.blocks.progress import progress_or_shown
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, table
from sysid.controllers.monitor.design import MonitorDesign, monitor_design
from sysid.controllers.monitor.drifts import DRIFTS, TESTED, UNDECIDED
from sysid.controllers.monitor.evidence import (
    FALSE_ALARMS,
    WITHIN,
    Detectable,
    Verdict,
    detectable,
    mean_cycle,
)
from sysid.controllers.monitor.logged import CycleVerdict, WatchedSamples, monitored
from sysid.controllers.monitor.reference import reference_changes
from sysid.controllers.monitor.stated import change_table, promise, shown_unit
from sysid.errors import NotIdentifiedError, input_error
from sysid.io.channels import CHAMBER_PRESSURES, SIDES
from sysid.io.files import write_atomic
from sysid.io.logs import exclusions_for, read_log
from sysid.io.rig import Rig
from sysid.io.samples import Trial
from sysid.io.units import parse_map
from sysid.parameters import Bundle, read_bundle
from sysid.pipeline.given_tests import Tests, trials_of
from sysid.pipeline.request import Reported, takes
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.types import FloatArray

# Rows differ in their distance by this share of the period at most.
_EVEN = 0.01


@dataclass(frozen=True)
class MonitoredTest:
    """One test: its verdicts, one after each of its cycles."""

    name: str
    cycles: tuple[CycleVerdict, ...]

    @property
    def alarms(self) -> tuple[CycleVerdict, ...]:
        """The cycles that end with an alarm."""
        return tuple(c for c in self.cycles if c.verdict.alarms)


@dataclass(frozen=True, repr=False)
class Monitoring(Shown):
    """A monitor over tests, in the order given, and what it can detect.

    `changes`: the smallest detectable changes on cycles like those of the tests, or, without any,
    on the reference cycle, which takes `duration` s; None where this does not move the shaft.
    """

    design: MonitorDesign
    tests: tuple[MonitoredTest, ...]
    changes: Detectable | None
    duration: float
    notices: tuple[str, ...] = ()

    @property
    def last(self) -> Verdict | None:
        """What the monitor says at the end."""
        found = [c.verdict for test in self.tests for c in test.cycles]
        return found[-1] if found else None

    @property
    def alarm(self) -> str:
        """The kind of drift that the last cycle alarms for; empty for none."""
        return "" if self.last is None else self.last.kind

    @property
    def alarm_in_words(self) -> str:
        """The kind, and the drift that is most likely; empty for none."""
        if self.last is None or not self.alarm:
            return ""
        said = DRIFTS[self.last.drift].title
        if self.alarm == UNDECIDED:
            return f"kind undecided: most likely {said}"
        return f"{self.alarm} ({said})"

    def headline(self) -> str:
        """The last verdict in words."""
        count = sum(len(test.cycles) for test in self.tests)
        if self.last is None:
            return f"monitor of {len(TESTED)} drifts"
        if not self.alarm:
            own = sum(len(test.alarms) for test in self.tests)
            before = f"; {own} earlier alarms" if own else ""
            return f"no alarm after {count} cycles: the machine obeys its bundle{before}"
        return f"alarm after {count} cycles: {self.alarm_in_words}"

    def records(self) -> list[dict[str, Any]]:
        """One record per cycle."""
        return [
            {
                "test": test.name,
                "time_s": c.time,
                "alarm": c.verdict.kind or None,
                "drift": DRIFTS[c.verdict.drift].name,
                "change": float(c.verdict.change[c.verdict.drift]),
                "z": float(c.verdict.z[c.verdict.drift]),
            }
            for test in self.tests
            for c in test.cycles
        ]

    def tables(self) -> Iterable[Table]:
        """Alarms by test, and the smallest detectable changes."""
        if self.tests:
            rows = [self._row(test) for test in self.tests]
            columns = ("test", "cycles", "alarms", "first, s", "kind", "drift", "change")
            yield table("Monitor", columns, rows, text=(4, 5, 6))
        if self.changes is not None:
            on = "these tests" if self.tests else f"the reference cycle of {self.duration:.2g} s"
            yield change_table(
                self.design, self.changes, f"Smallest detectable change, on {on} (half are found)"
            )

    def _row(self, test: MonitoredTest) -> tuple[str, ...]:
        if not test.alarms:
            return (test.name, str(len(test.cycles)), "0", "-", "-", "-", "-")
        first, last = test.alarms[0], test.alarms[-1].verdict
        unit, factor = shown_unit(self.design, DRIFTS[last.drift])
        change = f"{factor * float(last.change[last.drift]):+.2g} {unit}"
        own = (f"{first.time:.1f}", last.kind, DRIFTS[last.drift].title, change)
        return (test.name, str(len(test.cycles)), str(len(test.alarms)), *own)

    def footnotes(self) -> Iterable[str]:
        """What the alarms are worth, and the notices."""
        return (*promise(), *super().footnotes())

    def to_json(self) -> dict[str, Any]:
        """The output of `sysid monitor --json`."""
        return {
            "alarm": self.alarm or None,
            "drift": DRIFTS[self.last.drift].name if self.last and self.alarm else None,
            "false_alarms_per_cycle": FALSE_ALARMS,
            "smallest_detectable": self._changes(),
            "tests": [
                {"test": test.name, "cycles": [self._cycle(c) for c in test.cycles]}
                for test in self.tests
            ],
            "notices": list(self.notices),
        }

    def _changes(self) -> dict[str, Any] | None:
        if self.changes is None:
            return None
        found = {}
        for k in TESTED:
            sizes = {f"within_{n}": float(self.changes.by_cycles[n][k]) for n in WITHIN}
            known = {key: size if np.isfinite(size) else None for key, size in sizes.items()}
            found[DRIFTS[k].name] = {**known, "unit": DRIFTS[k].unit(self.design.units)}
        return found

    def _cycle(self, c: CycleVerdict) -> dict[str, Any]:
        v = c.verdict
        return {
            "time_s": c.time,
            "alarm": v.kind or None,
            "drift": DRIFTS[v.drift].name if v.kind else None,
            "z": {DRIFTS[k].name: float(v.z[k]) for k in TESTED},
            "change": {DRIFTS[k].name: float(v.change[k]) for k in TESTED},
        }


@dataclass(frozen=True, kw_only=True)
class MonitorOptions(Reported):
    """`effects`: those of the bundle that the catalogue lacks."""

    effects: EffectSource = None


@takes(MonitorOptions)
def monitor(tests: Tests, bundle: Bundle, options: MonitorOptions) -> Monitoring:
    """A bundle's monitor over tests of motion, one after the other: has the machine drifted?

    The same as in the exported C: friction, leakage, a valve's delay or the supply that left the
    bundle's value by more than its errors, and its scatter from test to test, explain. A verdict
    follows each cycle, a stroke there and back. Raises InputError for tests that lack what it
    needs, NotIdentifiedError where there is no cycle.

    >>> motion = campaign.read(campaign.select(["motion-discrete"])[0])
    >>> watched = si.monitor(motion, bundle)
    >>> watched.alarm
    ''
    """
    catalogue = catalogue_from(options.effects)
    trials = trials_of(tests)
    found, pool, last = [], None, monitor_design(bundle, catalogue)
    with progress_or_shown(options.progress, "monitoring") as tell:
        for trial in trials:
            tell(f"monitoring {trial.title}")
            samples = samples_of(trial, bundle.rig)
            last = monitor_design(bundle, catalogue, trial.period)
            pool = pool or last.pool()
            found.append(MonitoredTest(trial.title, tuple(monitored(last, samples, pool))))
    cycles = [c.cycle for test in found for c in test.cycles]
    if not cycles:
        raise NotIdentifiedError(
            f"{trials[0].source if trials else bundle.source}: no cycle: the shaft does not go "
            "there and back by a tenth of its travel; give logs of motion to and fro"
        )
    changes = detectable(mean_cycle(cycles), last.scatter, last.errors, last.scales)
    return Monitoring(last, tuple(found), changes, 0.0, _assumed(last))


def monitor_logs(
    bundle_path: Path,
    logs: Sequence[Path],
    maps: Sequence[str],
    exclude: Sequence[str],
    options: MonitorOptions,
) -> Monitoring:
    """`monitor` of logs in files, in this order; without any what the monitor could detect.

    `maps` translates foreign columns, `exclude` names what is not read. Raises InputError for
    unusable files too.
    """
    bundle = read_bundle(bundle_path)
    if not logs:
        return _without_logs(bundle, options)
    mapping = parse_map(maps)
    excluded = exclusions_for(exclude, logs, mapping)
    read = [
        read_log(path, bundle.rig, mapping, None, own)
        for path, own in zip(logs, excluded, strict=True)
    ]
    found = monitor([trial for log in read for trial in log.trials], bundle, options)
    notices = [line for log in read for line in log.notices]
    return Monitoring(
        found.design, found.tests, found.changes, 0.0, (*dict.fromkeys(notices), *found.notices)
    )


def write_monitoring(found: Monitoring, path: Path) -> None:
    """Write a result as JSON, whole or not at all."""
    write_atomic(path, json.dumps(found.to_json(), indent=2) + "\n")


def _without_logs(bundle: Bundle, options: MonitorOptions) -> Monitoring:
    design = monitor_design(bundle, catalogue_from(options.effects))
    changes = reference_changes(design)
    if changes is None:
        raise NotIdentifiedError(
            f"{bundle.source}: the valves do not move the shaft to and fro in simulation, so that "
            "no change is computed; give logs of the machine's own motion"
        )
    return Monitoring(design, (), *changes, _assumed(design))


def _assumed(design: MonitorDesign) -> tuple[str, ...]:
    if not design.assumed:
        return ()
    titles = [drift.title for drift in DRIFTS if drift.name in design.assumed]
    return (
        f"the bundle gives no standard error of: {', '.join(titles)}; 3 % is taken, and smaller "
        "changes go unseen: fit again for errors",
    )


def samples_of(trial: Trial, rig: Rig) -> WatchedSamples:
    """A test's readings and commands, evenly sampled. Raises InputError."""
    why = "which a monitor needs"
    trial.require((rig.position_channel, *CHAMBER_PRESSURES), why)
    steps = np.diff(trial.time)
    period = trial.period
    uneven = (np.abs(steps / period - 1.0) > _EVEN) & (steps < 1.5 * period)
    if uneven.any():
        raise input_error(
            trial.source,
            f"is not evenly sampled, at {trial.time[int(np.argmax(uneven))]:g} s",
            "resample it: sysid convert LOG --resample",
        )
    is_duty = f"duty_{SIDES[0]}" in trial
    names = [f"{'duty' if is_duty else 'valve'}_{side}" for side in SIDES]
    if rig.effort_channel in trial and not any(name in trial for name in names):
        valves: Mapping[str, FloatArray] = {side: np.zeros(len(trial)) for side in SIDES}
    else:
        trial.require(names, why)
        valves = {side: trial[name] for side, name in zip(SIDES, names, strict=True)}
    motor = trial[rig.effort_channel] if rig.effort_channel in trial else np.zeros(len(trial))
    return WatchedSamples(
        trial.time - trial.time[0],
        trial[rig.position_channel],
        {side: trial[name] for side, name in zip(SIDES, CHAMBER_PRESSURES, strict=True)},
        motor,
        valves,
        dict.fromkeys(SIDES, is_duty),
    )


__all__ = [
    "MonitorOptions",
    "MonitoredTest",
    "Monitoring",
    "monitor",
    "monitor_logs",
    "samples_of",
    "write_monitoring",
]
