"""Gains of a controller tuned for a bundle, and robustly over what is not known of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.drawing import plot_panels
from sysid.blocks.figures import Panel, Points, Scale
from sysid.blocks.numbers import number
from sysid.blocks.progress import progress_or_shown
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, table
from sysid.controllers.cases import Case
from sysid.controllers.design_model import require_declared
from sysid.controllers.gains import ChosenGains, gains_of
from sysid.controllers.modes import Mode
from sysid.controllers.task import Choice, Task, prepared
from sysid.controllers.trajectories import DURATION_S, TRAJECTORIES
from sysid.controllers.tuner import Bench, score, search
from sysid.errors import InputError, input_error
from sysid.io.files import make_folder, write_atomic
from sysid.parameters import Bundle
from sysid.pipeline.request import Reported, takes
from sysid.types import FloatArray, Progress

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GAINS_NAME = "gains.json"
# Gains are searched on the first part of each motion, and judged on all of it.
_SEARCHED_S = 4.5
# Plants of a robust search, the bundle's own among them, and the others that judge its result.
_SEARCHED_PLANTS, _FEWEST_DRAWS = 5, 20


@dataclass(frozen=True)
class MotionErrors:
    """RMSE of a trajectory, rad, with the gains to start from and the tuned ones.

    `nominal` on the bundle's own plant; `draws` (n,) on plants that the search did not have;
    infinite where the loop is lost.
    """

    trajectory: int
    nominal: tuple[float, float]
    draws: tuple[FloatArray, FloatArray]

    @property
    def improved(self) -> bool:
        """Whether the tuned gains are better on the bundle's own plant."""
        return self.nominal[1] < self.nominal[0]

    def over_draws(self) -> tuple[float, float]:
        """95 % quantiles over the draws, NaN without them."""
        first, second = (
            float(np.quantile(d, 0.95, method="higher")) if len(d) else math.nan for d in self.draws
        )
        return first, second


@dataclass(frozen=True, repr=False)
class TunedGains(Shown):
    """Gains that were found by `tune`, next to those that the search started from.

    `motions`: the errors of both. `kept`: whether the search found none that is better on all that
    judges it, so that `gains` are those to start from.
    """

    gains: ChosenGains
    start: Mapping[str, float]
    motions: tuple[MotionErrors, ...]
    seed: int
    kept: bool
    source: str
    notices: tuple[str, ...] = ()

    def headline(self) -> str:
        """Controller and mode, and what the gains change."""
        name = f"{self.gains.controller}, {self.gains.mode.value}"
        if self.kept:
            return f"{name}: no better gains found"
        logs = [math.log(m.nominal[1] / m.nominal[0]) for m in self._known()]
        ratio = math.exp(float(np.mean(logs))) if logs else math.nan
        return f"{name}: RMSE {number(ratio)} times that of the printed gains"

    def _known(self) -> list[MotionErrors]:
        return [m for m in self.motions if np.isfinite(m.nominal).all()]

    def tables(self) -> Iterable[Table]:
        """The gains; the errors in mrad."""
        units = {g.name: g.unit for g in gains_of(self.gains.controller, self.gains.mode)}
        rows = [
            (name, units[name], number(self.start[name]), number(value))
            for name, value in self.gains.values.items()
        ]
        yield table("Gains", ("Gain", "Unit", "Printed", "Tuned"), rows, text=(1,))
        head = ["Trajectory", "Printed", "Tuned"]
        if self._has_draws:
            head += ["95 % of draws: printed", "tuned", "lost: printed", "tuned"]
        errors = []
        for m in self.motions:
            cells = [_mrad(v) for v in m.nominal]
            if self._has_draws:
                cells += [_mrad(v) for v in m.over_draws()]
                cells += [str(int(np.sum(np.isinf(d)))) for d in m.draws]
            errors.append((str(m.trajectory), *cells))
        yield table("RMSE in mrad", head, errors)

    @property
    def _has_draws(self) -> bool:
        return any(len(m.draws[0]) for m in self.motions)

    def footnotes(self) -> Iterable[str]:
        """The notices."""
        return self.notices

    def records(self) -> list[dict[str, Any]]:
        """One record per trajectory, rad; None where a loop is lost or nothing was drawn."""
        return [
            {
                "trajectory": m.trajectory,
                "printed_rmse_rad": _known(m.nominal[0]),
                "tuned_rmse_rad": _known(m.nominal[1]),
                "printed_rmse_rad_p95": _known(m.over_draws()[0]),
                "tuned_rmse_rad_p95": _known(m.over_draws()[1]),
                "printed_lost": int(np.sum(np.isinf(m.draws[0]))),
                "tuned_lost": int(np.sum(np.isinf(m.draws[1]))),
            }
            for m in self.motions
        ]

    def plot(self, ax: Axes | None = None) -> Axes:
        """RMSE by trajectory, printed and tuned; logarithmic."""
        x = np.array([float(m.trajectory) for m in self.motions])
        first, second = (1e3 * np.array([m.nominal[i] for m in self.motions]) for i in (0, 1))
        marks = (
            Points(x, first, "measured", "Printed", size=6.0),
            Points(x, second, "model", "Tuned", size=6.0),
        )
        panel = Panel(Scale("Trajectory"), Scale("RMSE", "mrad", kind="log"), marks, legend="over")
        return plot_panels((panel,), ax)[0]

    def to_json(self) -> dict[str, Any]:
        """What `sysid control --tune --json` prints."""
        return {
            "controller": self.gains.controller,
            "mode": self.gains.mode.value,
            "gains": dict(self.gains.values),
            "printed": dict(self.start),
            "kept": self.kept,
            "seed": self.seed,
            "motions": self.records(),
            "notices": list(self.notices),
        }

    def write(self, folder: str | Path) -> tuple[Path, ...]:
        """Write `gains.json`, which `sysid control --gains` reads; its path. Raises InputError."""
        place = Path(folder)
        make_folder(place)
        path = place / GAINS_NAME
        write_atomic(path, self.gains.text(bundle=self.source, seed=self.seed, rmse=self.records()))
        return (path,)


def _mrad(value: float) -> str:
    return "lost" if math.isinf(value) else number(1e3 * value)


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


@dataclass(frozen=True, kw_only=True)
class TuneOptions(Reported):
    """For which motions, on which plants, and how long gains are searched."""

    trajectories: tuple[int, ...] = ()
    mode: str | Mode = "hybrid"
    plant: Bundle | None = None
    inverse: str = "averaged"
    draws: int = 0
    generations: int = 15
    duration_s: float = DURATION_S
    seed: int = 0
    accept_assumed: bool = False


@takes(TuneOptions)
def tune(bundle: Bundle, controller: str, options: TuneOptions) -> TunedGains:
    """Gains of "pva", "backstepping" or "dvmpc" for the plant of a bundle, by search.

    For trajectories 1 to 4, as far as the rig's travel allows, or those given. `draws`: the gains
    are to hold on plants drawn from the errors of the plant's bundle, too; the search has four of
    them, and at least 20 others judge its result. `generations` of the search. Deterministic by
    `seed`; noise and draws that judge are not those of the search. The printed gains stay where
    none are found that are better on average and lose no loop that they hold. Raises as `control`
    does.
    """
    require_declared(bundle, options.accept_assumed)
    mode = Mode(options.mode)
    gains_of(controller, mode)
    tasks, said = _tasks(bundle, controller, mode, options)
    with progress_or_shown(options.progress, "tuning") as tell:
        return _tuned(bundle, controller, tasks, said, options, tell)


def _tasks(
    bundle: Bundle, controller: str, mode: Mode, options: TuneOptions
) -> tuple[list[Task], list[str]]:
    """A task for each trajectory that the rig can follow, and which it cannot."""
    found, said = [], []
    for number_ in options.trajectories or TRAJECTORIES:
        choice = Choice(controller, number_, mode, inverse=options.inverse)
        try:
            found.append(prepared(choice, bundle, options.plant))
        except InputError as error:
            if options.trajectories or "end stops" not in str(error):
                raise
            said.append(f"trajectory {number_} is omitted: it goes beyond the end stops")
    if not found:
        raise input_error(bundle.source, "the rig can follow none of the trajectories", "give one")
    return found, said


def _tuned(
    bundle: Bundle,
    controller: str,
    tasks: list[Task],
    said: list[str],
    options: TuneOptions,
    tell: Progress,
) -> TunedGains:
    plants, held = _plants(tasks[0], options.plant or bundle, options)
    reach = 0.5 * (tasks[0].rig.travel or math.inf)
    gains = gains_of(controller, tasks[0].choice.mode)
    few, others = plants[:_SEARCHED_PLANTS], plants[_SEARCHED_PLANTS:]

    def bench(of: list[Any], seed: int, duration: float) -> Bench:
        motions = tuple(tuple(_case(task, plant, seed) for plant in of) for task in tasks)
        return Bench(motions, gains, duration, reach)

    first = bench(few, options.seed, min(_SEARCHED_S, options.duration_s))
    start = first.start
    values = search(first, options.generations, options.seed, tell)
    tell("judging the gains that were found")
    pair = [start, values]
    nominal = bench(plants[:1], options.seed + 1, options.duration_s).rmse(pair)
    drawn = [
        bench([plant], options.seed + 2 + i, options.duration_s).rmse(pair)
        for i, plant in enumerate(others)
    ]
    over = np.array(drawn).reshape(len(others), 2, len(tasks))
    rows = np.concatenate([nominal[None], over])
    better = all(score(row[1:], row[0])[0] <= 0.0 for row in [nominal, np.max(rows, axis=0)])
    loses = bool((np.isinf(rows[:, 1]) & np.isfinite(rows[:, 0])).any())
    kept = values == start or loses or not better
    chosen = start if kept else values
    at = 0 if kept else 1
    motions = tuple(
        MotionErrors(
            task.choice.trajectory,
            (float(nominal[0, i]), float(nominal[at, i])),
            (over[:, 0, i], over[:, at, i]),
        )
        for i, task in enumerate(tasks)
    )
    return TunedGains(
        ChosenGains(controller, tasks[0].choice.mode, chosen),
        start,
        motions,
        options.seed,
        kept,
        bundle.source,
        tuple(dict.fromkeys((*tasks[0].notices, *said, *held))),
    )


def _case(task: Task, plant: Any, seed: int) -> Case:
    return replace(task.case(task.make()), plant=plant, seed=seed)


def _plants(task: Task, bundle: Bundle, options: TuneOptions) -> tuple[list[Any], tuple[str, ...]]:
    """The task's own plant first, and those that are drawn about it."""
    if not options.draws:
        return [task.plant], ()
    from sysid.refinement.draws import posterior_draws

    count = max(options.draws, _FEWEST_DRAWS) + _SEARCHED_PLANTS - 1
    drawn = posterior_draws(bundle, task.rig, task.plant, count, options.seed)
    return [task.plant, *drawn.models], drawn.notices()


__all__ = ["GAINS_NAME", "MotionErrors", "TuneOptions", "TunedGains", "tune"]
