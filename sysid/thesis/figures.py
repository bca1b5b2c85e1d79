"""The thesis' figures of closed loops (4.2 to 4.31, 5.1 to 5.3): which loops each shows.

Simulated ones and those measured on the rig are the same loops here where their settings are the
same: a counterpart then carries both numbers. What exists only in print is omitted: schematic 4.1.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import Literal

from sysid.controllers.cases import ClosedLoopRun
from sysid.controllers.modes import Mode
from sysid.thesis.declaration import TableLoop
from sysid.thesis.rig import TRAJECTORIES, TableRig
from sysid.types import Progress, no_progress

View = Literal["tracking", "errors", "pressures", "payload"]
"""Position, error and pressures of one loop; the errors of several; pressures; estimates."""

# 4.4.8.1: the carried inertia is 1.9 times the assumed one, which is the bare arm's.
_MISMATCH_KG = 0.156
_TRACKING = (
    "From above: position over its reference, error, and pressures of chambers A and B. All are "
    "simulated; where two numbers are given, the second figure was measured on the rig."
)
_BOTH = (Mode.PNEUMATIC, Mode.HYBRID)


@dataclass(frozen=True)
class ThesisFigure:
    """A counterpart: the figure's `number` as the thesis has it (or ""), and its loops by name."""

    number: str
    title: str
    loops: tuple[tuple[str, TableLoop], ...]
    view: View = "tracking"


@dataclass(frozen=True)
class FigureSet:
    """Figures that belong together, and what they show."""

    id: str
    title: str
    figures: tuple[ThesisFigure, ...]
    said: str


def _of_trajectories(
    numbers: tuple[str, ...], loop: TableLoop, said: str = ""
) -> list[ThesisFigure]:
    """A figure for each trajectory, all of one controller."""
    return [
        ThesisFigure(number, f"{said}trajectory {n}", (("", _on(loop, n)),))
        for n, number in zip(TRAJECTORIES, numbers, strict=True)
    ]


def _on(loop: TableLoop, trajectory: int) -> TableLoop:
    return dataclasses.replace(loop, trajectory=trajectory)


def _pneumatic(controller: str, **options: object) -> TableLoop:
    return TableLoop(controller, Mode.PNEUMATIC, 1, **options)  # type: ignore[arg-type]


def _pva() -> FigureSet:
    numbers = ("4.2, 4.6", "4.3, 4.7", "4.4, 4.8", "4.5, 4.9")
    figures = _of_trajectories(numbers, _pneumatic("pva"))
    title = "PVA with feedforward and dead-zone compensation"
    return FigureSet("pva", title, tuple(figures), _TRACKING)


def _backstepping() -> FigureSet:
    whole = _pneumatic("backstepping")
    figures = [
        ThesisFigure("4.10", "pressures about the nominal one", (("", whole),), "pressures"),
        ThesisFigure("4.11", "feedforward only", (("", _pneumatic("feedforward")),)),
        ThesisFigure("4.12", "backstepping only", (("", _pneumatic("backstepping", type=1)),)),
    ]
    numbers = ("4.13, 4.17", "4.14, 4.18", "4.15, 4.19", "4.16, 4.20")
    figures += _of_trajectories(numbers, whole, "both, ")
    said = (
        f"{_TRACKING} Feedforward only (4.11) sets flows, and nothing corrects the pressures that "
        "come of them: ours ends up far from the reference, the thesis' within 60 mrad of it."
    )
    return FigureSet("backstepping", "Backstepping and feedforward", tuple(figures), said)


def _estimator() -> FigureSet:
    def loops(has_estimator: bool) -> tuple[tuple[str, TableLoop], ...]:
        return tuple(
            (
                mode.value,
                TableLoop(
                    "dvmpc",
                    mode,
                    1,
                    orientation="vertical",
                    assumed_kg=0.0,
                    carried_kg=_MISMATCH_KG,
                    has_estimator=has_estimator,
                ),
            )
            for mode in _BOTH
        )

    figures = (
        ThesisFigure("4.21", "without the estimator", loops(False), "errors"),
        ThesisFigure("4.22", "with the estimator", loops(True), "errors"),
        ThesisFigure("4.22", f"estimate, {_MISMATCH_KG:g} kg carried", loops(True), "payload"),
    )
    said = "The controller assumes the bare arm; the inertia is 1.9 times that, as in 4.4.8.1."
    return FigureSet("estimator", "Payload estimator with DVMPC, vertical", figures, said)


def _dvmpc() -> FigureSet:
    figures = _of_trajectories(("4.23", "4.24", "4.25", "4.26"), _pneumatic("dvmpc"))
    tested = _pneumatic("dvmpc", as_tested=True)
    figures += _of_trajectories(("4.27", "4.28", "4.29", "4.30"), tested, "as tested, ")
    said = f"{_TRACKING} As tested: the settings of the experiments (Table 4.4.5)."
    return FigureSet("dvmpc", "DVMPC, pneumatic", tuple(figures), said)


def _comparison() -> FigureSet:
    names = {"PVA": "pva", "Backstepping": "backstepping", "DVMPC": "dvmpc"}
    figures = []
    for mode in Mode:
        for n in TRAJECTORIES:
            loops = tuple(
                (name, TableLoop(controller, mode, n))
                for name, controller in names.items()
                if mode is Mode.PNEUMATIC or controller != "pva"
            )
            number = "4.31" if n == 1 and mode is not Mode.MOTOR else ""
            title = f"{mode.value}, trajectory {n}"
            figures.append(ThesisFigure(number, title, loops, "errors"))
    title = "Errors of the controllers by mode and trajectory"
    said = "Scales differ. Figure 4.31 is trajectory 1 in the pneumatic and the hybrid mode."
    return FigureSet("modes", title, tuple(figures), said)


def _compensations() -> FigureSet:
    def pair(mode: Mode, with_: int, n: int) -> tuple[tuple[str, TableLoop], ...]:
        made = functools.partial(TableLoop, "backstepping", mode, n)
        return (("without", made(type=1)), ("with", made(type=with_)))

    figures = [
        ThesisFigure("5.1", "motor, trajectory 1", pair(Mode.HYBRID, 2, 1), "errors"),
        ThesisFigure("5.2", "motor, trajectory 4", pair(Mode.HYBRID, 2, 4), "errors"),
    ]
    figures += [
        ThesisFigure("5.3", f"feedforward, trajectory {n}", pair(Mode.PNEUMATIC, 3, n), "errors")
        for n in (1, 4)
    ]
    said = (
        "Backstepping without and with one compensation: the motor's, hybrid (5.1, 5.2), and "
        "feedforward, pneumatic (5.3)."
    )
    return FigureSet("compensations", "Backstepping's compensations", tuple(figures), said)


def figure_sets() -> tuple[FigureSet, ...]:
    """All counterparts, in the thesis' order."""
    return (_pva(), _backstepping(), _estimator(), _dvmpc(), _comparison(), _compensations())


Runs = dict[TableLoop, ClosedLoopRun]


def figure_runs(rig: TableRig, progress: Progress = no_progress) -> Runs:
    """Every loop of the figures, in one batch."""
    loops = dict.fromkeys(
        loop for part in figure_sets() for figure in part.figures for _, loop in figure.loops
    )
    progress(f"simulating {len(loops)} closed loops for the figures")
    return dict(zip(loops, rig.run([rig.case_of(loop) for loop in loops]), strict=True))


__all__ = ["FigureSet", "Runs", "ThesisFigure", "View", "figure_runs", "figure_sets"]
