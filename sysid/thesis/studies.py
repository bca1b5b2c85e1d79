"""What the thesis asks of its controllers beyond its tables: stability, and valves of more flow.

`stabilities`: the conditions of its analyses and the bounds of the tracking error (4.3.50, 4.3.36,
4.4.5) along the loops of its comparison. `flow_study`: its first recommendation (7.3), valves of a
higher flow, in simulation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.blocks.figures import SMALL_PANEL, Figure, Line, Panel, Role, Scale
from sysid.blocks.numbers import number
from sysid.blocks.sections import FigureGroup, Section
from sysid.blocks.tables import Table, table
from sysid.blocks.titles import capital
from sysid.controllers.error_budget import Stability, stability_of
from sysid.controllers.modes import Mode
from sysid.thesis.computed import position_error
from sysid.thesis.declaration import TableLoop
from sysid.thesis.figures import Runs
from sysid.thesis.rig import TRAJECTORIES, TableRig
from sysid.types import FloatArray, Progress, no_progress

FLOWS = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
"""Flows of the valves that are tried, times those of the rig's."""
_NAMES = {"pva": "PVA", "backstepping": "backstepping", "dvmpc": "DVMPC"}
_ROLES: dict[str, Role] = {"backstepping": "model", "dvmpc": "second", "pva": "third"}
_ANALYSED = (
    ("backstepping", Mode.PNEUMATIC),
    ("backstepping", Mode.HYBRID),
    ("dvmpc", Mode.HYBRID),
)
_COMPARED = (
    ("pva", Mode.PNEUMATIC),
    ("backstepping", Mode.PNEUMATIC),
    ("dvmpc", Mode.PNEUMATIC),
    ("backstepping", Mode.HYBRID),
    ("dvmpc", Mode.HYBRID),
)

# --- stability -------------------------------------------------------------------------

Stabilities = Mapping[TableLoop, Stability]


def stabilities(rig: TableRig, runs: Runs) -> Stabilities:
    """The analysis of each loop of the comparison that the thesis has one for."""
    loops = [TableLoop(name, mode, n) for name, mode in _ANALYSED for n in TRAJECTORIES]
    return {loop: stability_of(rig.case_of(loop), runs[loop]) for loop in loops}


def stability_section(found: Stabilities) -> Section:
    """The conditions on the gains, and what the errors of each run allow."""
    held = [s.budget for s in found.values() if not (s.budget.saturated or s.budget.corners)]
    kept = sum(b.largest <= b.bound for b in held)
    said = (
        "A proof fails where a condition does not hold; the loop need not. The thesis bounds the "
        "tracking error by the errors of friction, valves and motor (4.3.36, 4.4.14). Here these "
        "are taken from each run, as the plant's effort less what the controller took it for, and "
        "so is the error that they allow. Where the motor is at its limit the analysis makes no "
        "statement, and where the reference's velocity jumps no bounded effort follows: of the "
        f"other {len(held)} runs the error stays within its bound in {kept}."
    )
    return Section("stability", "Stability (4.3.3.2, 4.4.5)", (said,), tuple(_tables(found)))


def _tables(found: Stabilities) -> Sequence[Table]:
    conditions, bounds = [], []
    for loop, one in found.items():
        who = f"{_title(loop.controller)}, {loop.mode.value}"
        if loop.trajectory == 1:
            for c in one.conditions:
                cells = (c.name, c.equation, number(c.value), number(c.least), c.unit)
                conditions.append((who, *cells, "yes" if c.holds else "no"))
        b = one.budget
        name, size = max(b.sources, key=lambda source: source[1])
        bounds.append(
            (
                f"{who}, {loop.trajectory}",
                f"{name}, {number(size)}",
                number(b.together),
                number(1e3 * b.bound),
                number(1e3 * b.largest),
                number(100.0 * b.saturated) if b.saturated else "0",
            )
        )
    head = ("Controller, mode", "Condition", "Equation", "Value", "Exceeds", "Unit", "Holds")
    return (
        table("Conditions on the gains, trajectory 1", head, conditions, text=(1, 2, 5, 6)),
        table(
            "What the errors allow, and the largest error of the run",
            (
                "Controller, mode, trajectory",
                "Largest source, N m",
                "All sources, N m",
                "Allows, mrad",
                "Found, mrad",
                "Motor at its limit, %",
            ),
            bounds,
            text=(1,),
        ),
    )


def _title(name: str) -> str:
    return capital(_NAMES[name])


# --- valves of more flow ---------------------------------------------------------------


@dataclass(frozen=True)
class FlowStudy:
    """RMSE, rad, by controller and mode, (trajectories, `FLOWS`); NaN where a loop is lost."""

    rmse: Mapping[tuple[str, Mode], FloatArray]

    def ratios(self, key: tuple[str, Mode]) -> FloatArray:
        """RMSE over that of the rig's valves, geometric mean over the trajectories, (FLOWS,).

        NaN where a trajectory is lost that the rig's valves follow.
        """
        own = self.rmse[key]
        logs = np.log(own / own[:, [FLOWS.index(1.0)]])
        return np.asarray(np.exp(np.mean(logs[~np.isnan(own[:, FLOWS.index(1.0)])], axis=0)))


def flow_study(rig: TableRig, progress: Progress = no_progress) -> FlowStudy:
    """The controllers with their printed gains, which know their valves, in one batch."""
    rigs = [rig.with_flow(factor) for factor in FLOWS]
    loops = [TableLoop(name, mode, n) for name, mode in _COMPARED for n in TRAJECTORIES]
    cases = [own.case_of(loop) for loop in loops for own in rigs]
    progress(f"simulating {len(cases)} closed loops with valves of {len(FLOWS)} flows")
    errors = [position_error(run, rig.reach) for run in rig.run(cases)]
    shape = (len(_COMPARED), len(TRAJECTORIES), len(FLOWS))
    return FlowStudy(dict(zip(_COMPARED, np.reshape(errors, shape), strict=True)))


def flow_section(found: FlowStudy) -> Section:
    """RMSE over the valves' flow."""
    rows = [
        (f"{_title(name)}, {mode.value}", *(_ratio(r) for r in found.ratios((name, mode))))
        for name, mode in found.rmse
    ]
    head = ("Controller, mode", *(f"{factor:g} times the flow" for factor in FLOWS))
    caption = "RMSE over that of the rig's valves, geometric mean of trajectories 1 to 4"
    groups = tuple(
        FigureGroup(
            f"{mode.value.capitalize()} mode: RMSE over the valves' flow.",
            tuple(_flow_figure(found, mode, i, n) for i, n in enumerate(TRAJECTORIES)),
        )
        for mode in (Mode.PNEUMATIC, Mode.HYBRID)
    )
    said = (
        "The thesis recommends valves of a higher flow, which are to raise the bandwidth and the "
        "precision of tracking (7.3, 1). Ours have the delays of the rig's valves, and so many "
        "times their flows, choked and unchoked, both ways; the controllers know them, and keep "
        f"the printed gains. {_said(found)} More flow makes each step of the duty larger, which "
        "costs precision on the slow trajectories; of the fastest one, half the flow is too little."
    )
    return Section(
        "flow", "Valves of a higher flow (7.3)", (said,), (table(caption, head, rows), *groups)
    )


def _said(found: FlowStudy) -> str:
    """What twice the flow changes, in words."""
    twice = FLOWS.index(2.0)
    parts = [
        f"{_NAMES[name]} ({mode.value}) {_ratio(found.ratios((name, mode))[twice])}"
        for name, mode in found.rmse
    ]
    return f"With twice the flow the RMSE is, times that of the rig's: {', '.join(parts)}."


def _ratio(value: float) -> str:
    return "lost" if math.isnan(value) else number(float(value), 2)


def _flow_figure(found: FlowStudy, mode: Mode, place: int, trajectory: int) -> Figure:
    lines = tuple(
        Line(np.array(FLOWS), 1e3 * rmse[place], _ROLES[name], _title(name), marker="o")
        for (name, own), rmse in found.rmse.items()
        if own is mode
    )
    best = ", ".join(
        f"{_NAMES[name]} {FLOWS[int(np.nanargmin(rmse[place]))]:g}"
        for (name, own), rmse in found.rmse.items()
        if own is mode and not np.isnan(rmse[place]).all()
    )
    x = Scale("Flow, times the rig's", kind="log", ticks=tuple((f, f"{f:g}") for f in FLOWS))
    panel = Panel(x, Scale("RMSE", "mrad", kind="log"), lines, legend="above")
    said = f"Smallest at: {best} times the flow."
    id_ = f"fig-flow-{mode.value}-{trajectory}"
    return Figure(id_, f"Trajectory {trajectory}", said, (panel,), size=SMALL_PANEL)


__all__ = [
    "FLOWS",
    "FlowStudy",
    "Stabilities",
    "flow_section",
    "flow_study",
    "stabilities",
    "stability_section",
]
