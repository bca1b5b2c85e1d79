"""A controller in closed loop with the model that a bundle describes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from sysid.blocks.drawing import plot_panels
from sysid.blocks.numbers import number
from sysid.blocks.progress import progress_or_shown
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, table
from sysid.controllers.cases import ClosedLoopRun
from sysid.controllers.design_model import assumed_constants, require_declared
from sysid.controllers.error_budget import Stability, stability_of
from sysid.controllers.force import effort_errors
from sysid.controllers.gains import read_gains
from sysid.controllers.interface import Controller
from sysid.controllers.metrics import TrackingMetrics
from sysid.controllers.modes import Mode
from sysid.controllers.run_files import log_frame, write_run
from sysid.controllers.shown import ShownLoop
from sysid.controllers.task import Choice, Task, prepared, run_draws, run_task
from sysid.controllers.tracking_draws import TrackingDraws
from sysid.controllers.trajectories import DURATION_S
from sysid.controllers.tuning import Tuning
from sysid.errors import input_error
from sysid.io.locks import working_in
from sysid.parameters import Bundle
from sysid.parameters.assembled_model import MEAN_FLOW_MODELS
from sysid.pipeline.pages.loop import write_control_page
from sysid.pipeline.request import Reported, takes
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.types import Progress

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

PAGE_NAME = "page.html"
MODES = tuple(mode.value for mode in Mode)
_METRICS = {
    "rmse": "RMSE",
    "mae": "MAE, largest error",
    "sse": "SSE, mean error at rest",
    "ssa": "SSA, range at rest",
}
# Only these come to rest where the steady state is judged.
_SETTLING = (1, 2)


@dataclass(frozen=True, repr=False)
class ControlledRun(Shown):
    """A closed loop that was run: `metrics`, `faults`, the samples as `frame`.

    `run` holds every signal, true and measured; `task` what was run; `sources` name the
    controller's bundle and the plant's. `draws`: the same loop on plants drawn from the errors of
    the plant's bundle. `stability`: the thesis' conditions and the run's errors against its bounds.
    """

    run: ClosedLoopRun
    task: Task
    sources: tuple[str, str]
    notices: tuple[str, ...]
    draws: TrackingDraws | None = None
    stability: Stability | None = None

    @property
    def metrics(self) -> TrackingMetrics:
        """RMSE, MAE (largest), SSE and SSA of the true position, rad (thesis 6.4).

        SSE and SSA are NaN on trajectories that do not come to rest.
        """
        found = self.run.metrics
        if self.task.choice.trajectory in _SETTLING:
            return found
        return TrackingMetrics(found.rmse, found.mae, math.nan, math.nan)

    @property
    def effort_rmse_nm(self) -> float:
        """RMSE of the effort of cylinder and motor against the wanted one, Nm; NaN without force
        control."""
        if self.task.choice.controller != "force":
            return math.nan
        case = self.task.case(self.task.make())
        return float(np.sqrt(np.mean(effort_errors(case, self.run) ** 2)))

    @property
    def faults(self) -> tuple[str, ...]:
        """What kept the loop from working as designed, one line each."""
        return self.run.faults

    @property
    def frame(self) -> pd.DataFrame:
        """A new DataFrame of the log: `time_s`, measured signals, commands; one row per tick."""
        return log_frame(self.run, self.task.choice.mode, self.task.rig)

    def to_frame(self) -> pd.DataFrame:
        """The samples, as `frame`."""
        return self.frame

    def headline(self) -> str:
        """Controller, trajectory and mode, and how well the reference was followed."""
        choice, found = self.task.choice, self.metrics
        return (
            f"{choice.controller}, trajectory {choice.trajectory}, {choice.mode.value}: "
            f"RMSE {number(1e3 * found.rmse)} mrad, largest error {number(1e3 * found.mae)} mrad"
        )

    def records(self) -> list[dict[str, Any]]:
        """One record: the choice, and the metrics in rad."""
        choice, found = self.task.choice, self.metrics
        return [
            {
                "controller": choice.controller,
                "trajectory": choice.trajectory,
                "mode": choice.mode.value,
                "payload_kg": self.payload_kg,
                **{f"{name}_rad": getattr(found, name) for name in _METRICS},
            }
        ]

    @property
    def payload_kg(self) -> float:
        """What the plant carries, kg."""
        inertia = self.task.rig.inertia
        return inertia.payload_mass_kg if inertia else 0.0

    def tables(self) -> Iterable[Table]:
        """The metrics, in mrad."""
        found = [(text, getattr(self.metrics, name)) for name, text in _METRICS.items()]
        rows = [(text, number(1e3 * value)) for text, value in found if not math.isnan(value)]
        yield table("Errors of the true position", ("Metric", "mrad"), rows)
        if not math.isnan(self.effort_rmse_nm):
            row = ("RMSE", number(self.effort_rmse_nm))
            yield table("Error of the effort, wanted less given", ("Metric", "N m"), [row])
        if self.draws is not None:
            yield self.draws.table()
        if self.stability is not None:
            yield from self.stability.tables()

    def footnotes(self) -> Iterable[str]:
        """The faults that the loop reports, and the notices."""
        return (*(f"fault: {line}" for line in self.faults), *super().footnotes())

    @property
    def shown(self) -> ShownLoop:
        """Its figures."""
        return ShownLoop(self.run, self.task.rig, self.task.choice.mode)

    def plot(self, axes: Axes | Iterable[Axes] | None = None) -> list[Axes]:
        """Position over its reference, the error, pressures, commands: four panels; the axes."""
        return plot_panels(self.shown.panels(), axes)

    def write(self, folder: str | Path) -> tuple[Path, ...]:
        """Write `run.csv` (a log), its reference, rig file and campaign, and `page.html`.

        Returns the paths. Raises InputError where the folder cannot be written, or another command
        is at work in it.
        """
        place, choice = Path(folder), self.task.choice
        comments = (self.headline(), *(f"{k}: {v}" for k, v in self._origin().items()))
        with working_in(place):
            written = write_run(place, self.run, choice.mode, self.task.rig, comments)
            page = place / PAGE_NAME
            metrics = next(iter(self.tables()))
            if self.draws is not None:
                written += self.draws.write(place, comments)
            write_control_page(
                page,
                self.shown,
                self.headline(),
                metrics,
                self._origin(),
                self.notices,
                self.stability,
            )
            return (*written, page)

    def _origin(self) -> dict[str, str]:
        controller, plant = (Path(source).name for source in self.sources)
        choice = self.task.choice
        payload = f"{number(self.payload_kg)} kg" if self.payload_kg else "none"
        told = ", ".join([choice.controller, *choice.words])
        return {
            "Controller": f"{told}, bundle {controller}",
            "Plant": plant if plant != controller else "the same bundle",
            "Trajectory": f"{choice.trajectory}, mode {choice.mode.value}",
            "Payload": payload,
        }

    def to_json(self) -> dict[str, Any]:
        """What `sysid control --json` prints."""
        record = {
            k: None if isinstance(v, float) and math.isnan(v) else v
            for k, v in self.records()[0].items()
        }
        effort = self.effort_rmse_nm
        return {
            **record,
            **({} if math.isnan(effort) else {"effort_rmse_nm": effort}),
            **({} if self.draws is None else {"draws": self.draws.to_json()}),
            **({} if self.stability is None else {"stability": self.stability.to_json()}),
            "options": list(self.task.choice.words),
            "faults": list(self.faults),
            "notices": list(self.notices),
        }


@dataclass(frozen=True, kw_only=True)
class ControlOptions(Reported):
    """What is followed, on which plant, and how the controller is tuned."""

    trajectory: int = 1
    mode: str | Mode = "hybrid"
    payload_kg: float | None = None
    plant: Bundle | None = None
    inverse: str = "averaged"
    horizon: int | None = None
    varying_input: bool | None = None
    backstepping_type: int | None = None
    estimate_payload: bool | None = None
    stiffness: float | None = None
    perfect_sensors: bool = False
    gains: str | Path | None = None
    duration_s: float = DURATION_S
    seed: int = 0
    draws: int = 0
    stability: bool = False
    effects: EffectSource = None
    accept_assumed: bool = False

    inverses: ClassVar[tuple[str, ...]] = MEAN_FLOW_MODELS
    """What `inverse` can be."""

    def choice(self, controller: str) -> Choice:
        """The case of a controller of this name. Raises InputError for an unknown mode."""
        tuning = Tuning(
            self.horizon,
            self.varying_input,
            self.backstepping_type,
            self.estimate_payload,
            self.stiffness,
        )
        return Choice(
            controller,
            self.trajectory,
            _mode(self.mode),
            self.payload_kg,
            self.inverse,
            self.seed,
            tuning,
            self.perfect_sensors,
            None if self.gains is None else read_gains(Path(self.gains)),
        )


@takes(ControlOptions)
def control(
    bundle: Bundle, controller: str | type[Controller] | Controller, options: ControlOptions
) -> ControlledRun:
    """Run a controller that reads a bundle, in closed loop on the plant of the same or another.

    `controller`: "pva", "backstepping", "dvmpc", "force", "FILE.py:CLASS" (the file is run), or a
    class or object of your own (`sysid.controllers.interface.Controller`). `trajectory` 1 to 4
    (thesis, Table 4.2.1), `mode` "pneumatic", "motor" or "hybrid". `payload_kg` is on the plant;
    the controller does not know it and, in the vertical, estimates it. `plant`: a bundle that
    stands for the rig (None: the controller's). `inverse`: where backstepping's duties come from,
    "averaged", "bipolynomial" or "ann". DVMPC's `horizon` in ticks, and whether its input may vary
    within it; `backstepping_type` 1 to 4 (Table 5.4.3: without compensation, motor's, feedforward,
    both); `estimate_payload` (None: where `payload_kg` is given in the vertical).
    `stiffness` of force control, Nm/rad (None: the cylinder's effort at a tenth of the travel).
    `perfect_sensors`: no counts, noise or filter. `gains`: a file of `sysid control --tune`, for
    the printed gains. `draws`: on so many plants, drawn from the errors of the plant's bundle, the
    loop runs too. `seed` is that of the sensors' noise and of the draws.
    `stability`: the thesis' conditions on the gains of backstepping or DVMPC, and what the run's
    errors of friction, flows and motor allow as a tracking error. `accept_assumed`: the controller
    may use assumed constants. Raises InputError for a rig or choice that cannot be run,
    NotIdentifiedError, with the missing key, for a bundle that lacks what controller or plant
    needs.

    >>> tracked = si.control(bundle, "dvmpc", trajectory=3, mode="hybrid", duration_s=1.0)
    >>> tracked.metrics.rmse < 0.1, tracked.faults
    (True, ())
    """
    require_declared(bundle, options.accept_assumed)
    own = None if isinstance(controller, str) else controller
    choice = options.choice(controller if isinstance(controller, str) else _name(controller))
    catalogue = catalogue_from(options.effects)
    task = prepared(choice, bundle, options.plant, own=own, catalogue=catalogue)
    with progress_or_shown(options.progress, "controlling") as tell:
        run, said = run_task(task, options.duration_s, tell)
        stability = stability_of(task.case(task.make()), run) if options.stability else None
        said = (*said, *(() if stability is None else stability.notes()))
        draws = None
        if options.draws:
            draws, held = _drawn(task, options.plant or bundle, options, tell)
            said = (*said, *held)
    sources = bundle.source, (options.plant or bundle).source
    if assumed := assumed_constants(bundle.rig):
        names = ", ".join(assumed)
        said = (f"the controller uses undeclared constants: {names}", *said)
    told = tuple(dict.fromkeys((*task.notices, *said)))
    return ControlledRun(run, task, sources, told, draws, stability)


def _drawn(
    task: Task, plant: Bundle, options: ControlOptions, tell: Progress
) -> tuple[TrackingDraws, tuple[str, ...]]:
    """The loop on plants drawn about the task's, and what is not varied."""
    from sysid.refinement.draws import posterior_draws

    drawn = posterior_draws(plant, task.rig, task.plant, options.draws, options.seed)
    runs = run_draws(task, drawn.models, options.duration_s, tell)
    return TrackingDraws.of(options.seed, drawn.names, drawn.values, runs), drawn.notices()


def _name(controller: type[Controller] | Controller) -> str:
    cls = controller if isinstance(controller, type) else type(controller)
    return cls.__name__


def _mode(mode: str | Mode) -> Mode:
    try:
        return Mode(mode)
    except ValueError:
        known = ", ".join(m.value for m in Mode)
        raise input_error(f"mode {mode!r}", "is unknown", f"give one of {known}") from None


__all__ = ["MODES", "ControlOptions", "ControlledRun", "control"]
