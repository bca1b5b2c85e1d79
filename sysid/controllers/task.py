"""What `sysid control` runs: a controller by name, class or file, on the plant of a bundle."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sysid.controllers.cases import Case, ClosedLoopRun
from sysid.controllers.design_model import DesignModel, design_from_bundle
from sysid.controllers.force import force_controller
from sysid.controllers.gains import ChosenGains
from sysid.controllers.hidden_state import Watch
from sysid.controllers.interface import Controller
from sysid.controllers.modes import Mode
from sysid.controllers.prediction import with_payload
from sysid.controllers.pva import PvaController
from sysid.controllers.sensing import SensorSuite
from sysid.controllers.trajectories import DURATION_S, DesiredMotion, thesis_trajectory
from sysid.controllers.tuning import NO_TUNING, Tuning
from sysid.controllers.user_controller import (
    load_controller,
    make_controller,
    split_reference,
)
from sysid.errors import SysidError, input_error
from sysid.io.rig import END_MARGIN, Rig, rig_from_content
from sysid.io.user_code import error_in_file
from sysid.parameters.content import BundleContent
from sysid.plant.effects.entry import Catalogue
from sysid.plant.ports import Model
from sysid.types import Progress, no_progress

CONTROLLERS = ("pva", "backstepping", "dvmpc", "force")
HORIZON = 40
"""Ticks that DVMPC predicts: the best of Table 5.3.1."""
MOTOR_SHARE = 0.1
"""The motor's share of the cylinder's effort in backstepping, where the motor acts."""
# Loops that are simulated at once.
_BATCH = 32


@dataclass(frozen=True)
class Choice:
    """The requested run: `controller` as requested, the number of the trajectory, the mode.

    `payload_kg` is on the plant, unknown to the controller (None: the rig file's).
    `inverse`: which of `INVERSES` gives backstepping and force control their duties; `seed` that of
    the noise.
    `tuning`: the options of the named controllers; `perfect_sensors`: no counts, noise, filter.
    `gains`: of a named controller, in place of the printed ones.
    """

    controller: str
    trajectory: int
    mode: Mode
    payload_kg: float | None = None
    inverse: str = "averaged"
    seed: int = 0
    tuning: Tuning = NO_TUNING
    perfect_sensors: bool = False
    gains: ChosenGains | None = None

    @property
    def words(self) -> tuple[str, ...]:
        """The options that were given, in words."""
        found = [
            name if value is True else f"no {name}" if value is False else f"{name} {value}"
            for name, value in self.tuning.given().items()
        ]
        sensors = ["perfect sensors"] if self.perfect_sensors else []
        gains = ["tuned gains"] if self.gains is not None else []
        return tuple(word.replace("_", " ") for word in (*found, *sensors, *gains))


@dataclass(frozen=True)
class Task:
    """A choice made ready: `make` gives the controller anew, `rig` is the plant's.

    `plant` is the model that stands for it, `user_file` the file of a user's own controller.
    """

    choice: Choice
    make: Callable[[], Controller]
    plant: Model
    rig: Rig
    trajectory: DesiredMotion
    user_file: Path | None
    notices: tuple[str, ...]

    def case(self, controller: Controller) -> Case:
        """The closed loop with this controller."""
        return Case(
            controller,
            self.plant,
            self.trajectory,
            self.choice.mode,
            SensorSuite.perfect() if self.choice.perfect_sensors else SensorSuite.of(self.rig),
            seed=self.choice.seed,
        )


def prepared(
    choice: Choice,
    bundle: BundleContent,
    plant: BundleContent | None = None,
    *,
    own: type[Controller] | Controller | None = None,
    catalogue: Catalogue | None = None,
) -> Task:
    """The task of a choice; `plant` None: the bundle's own model is the plant.

    `own`: a user's controller, class or object, in place of one by name. Raises InputError or
    NotIdentifiedError for a rig that cannot do it, and for a bundle without what the
    controller or the plant needs, with the missing key.
    """
    plant = plant or bundle
    check_rotary(bundle.rig)
    rig = _carrying(plant.rig, choice.payload_kg)
    check_rotary(rig)
    trajectory = thesis_trajectory(choice.trajectory, rig.is_vertical)
    check_travel(rig, choice.trajectory)
    if choice.mode.uses_motor:
        rig.require("motor", f"which mode {choice.mode.value} drives")
    named = split_reference(choice.controller) if own is None else None
    choice.tuning.check(choice.controller if own is None and named is None else None)
    notices = [*rig.notices]
    if choice.gains is not None and (own is not None or named is not None):
        raise input_error("gains", "are those of a named controller", "omit them")
    if own is None and named is None:
        make = _with_gains(choice, _by_name(choice, bundle, catalogue))
    else:
        make, said = _users(choice, bundle, catalogue, own, named)
        notices += said
    if choice.mode.uses_valves and make().is_duty:
        rig.require("pwm", "which holds the PWM period")
    return Task(
        choice,
        make,
        _plant(plant, rig, catalogue),
        rig,
        trajectory,
        named[0] if named else None,
        tuple(notices),
    )


def check_rotary(rig: Rig) -> None:
    """InputError for a linear rig: the trajectories are angles."""
    if rig.is_linear:
        raise input_error(
            rig.source,
            "the rig is linear, and trajectories 1 to 4 are angles",
            "give the bundle of a rotary rig",
        )


def check_travel(rig: Rig, number: int) -> None:
    """InputError where a trajectory runs into the rig's end stops."""
    trajectory = thesis_trajectory(number, rig.is_vertical)
    path = trajectory.sample(np.linspace(0.0, DURATION_S, 2001))[:, 0]
    reach = float(np.max(np.abs(path)))
    half = 0.5 * (rig.travel or np.inf)
    if reach > (1.0 - 2.0 * END_MARGIN) * half:
        raise input_error(
            rig.source,
            f"trajectory {number} goes to {reach:.3g} rad, and the end stops are at {half:.3g}",
            "choose another trajectory",
        )


def _carrying(rig: Rig, payload: float | None) -> Rig:
    """The rig with this payload, kg; its length must be in the rig file."""
    if payload is None:
        return rig
    content = copy.deepcopy(rig.content)
    if "payload_length_m" not in content.get("inertia", {}):
        raise input_error(
            rig.source,
            "[inertia] payload_length_m is missing, and --payload needs it",
            "add its distance from the shaft to the rig file, and fit again",
        )
    content["inertia"]["payload_mass_kg"] = float(payload)
    return rig_from_content(content, rig.source)


def _plant(bundle: BundleContent, rig: Rig, catalogue: Catalogue | None) -> Model:
    """The plant's model: what was fitted, and the payload that is on it now.

    A fitted inertia holds for the payload of the fit; the difference is added to it.
    """
    made = design_from_bundle(bundle, catalogue=catalogue)
    if rig.inertia is None:
        return made.model
    payload = rig.inertia.payload_mass_kg * rig.inertia.payload_length_m**2
    return with_payload(made, payload)


def _by_name(
    choice: Choice, bundle: BundleContent, catalogue: Catalogue | None
) -> Callable[[], Controller]:
    name, mode = choice.controller, choice.mode
    if name not in CONTROLLERS:
        known = ", ".join(CONTROLLERS)
        raise input_error(
            f"controller {name!r}", "is unknown", f"give {known} or FILE.py:CLASS of your own"
        )
    if name == "pva":
        if mode is not Mode.PNEUMATIC:
            raise input_error(f"mode {mode.value}", "pva drives no motor", "use mode pneumatic")
        return PvaController
    inverse = "averaged" if name == "dvmpc" else choice.inverse
    design = design_from_bundle(bundle, inverse=inverse, catalogue=catalogue)
    if name == "force":
        return lambda: force_controller(design, bundle.rig, choice.tuning.stiffness)
    seen = choice.payload_kg is not None and bundle.rig.is_vertical
    estimator = choice.tuning.estimator(seen, bundle.rig)
    if name == "dvmpc":
        return lambda: choice.tuning.dvmpc(design, HORIZON, estimator)
    portion = MOTOR_SHARE if mode.uses_motor else 0.0
    return lambda: choice.tuning.backstepping(design, portion, estimator)


def _with_gains(choice: Choice, make: Callable[[], Controller]) -> Callable[[], Controller]:
    """The same with the choice's gains. Raises InputError for those of another controller."""
    gains = choice.gains
    if gains is None:
        return make
    if (gains.controller, gains.mode) != (choice.controller, choice.mode):
        raise input_error(
            "gains",
            f"are those of {gains.controller} in mode {gains.mode.value}, not of "
            f"{choice.controller} in mode {choice.mode.value}",
            "give the file of this controller and mode",
        )
    return lambda: gains.applied(make())


def _users(
    choice: Choice,
    bundle: BundleContent,
    catalogue: Catalogue | None,
    own: type[Controller] | Controller | None,
    named: tuple[Path, str] | None,
) -> tuple[Callable[[], Controller], list[str]]:
    """How a user's own controller is made, and what to say of it."""
    if isinstance(own, Controller):
        kept = copy.deepcopy(own)
        return (lambda: copy.deepcopy(kept)), []
    said, path = [], None
    if named is not None:
        path = named[0]
        own = load_controller(*named)
        said = [f"{path} is run: {named[1]} is the user's own controller"]
    assert own is not None
    cls = own

    def design() -> DesignModel:
        return design_from_bundle(bundle, inverse=choice.inverse, catalogue=catalogue)

    return (lambda: make_controller(cls, design, path)), said


# --- running -------------------------------------------------------------------------------


def run_task(
    task: Task, duration: float = DURATION_S, progress: Progress = no_progress
) -> tuple[ClosedLoopRun, tuple[str, ...]]:
    """The run of a task, and notices of how it was run.

    A user's controller is compiled if it can be, else called from Python at every tick. Raises
    InputError for what its file raises.
    """
    with _faults_of_user(task):
        return _run(task, duration, progress)


def run_draws(
    task: Task,
    plants: Sequence[Model],
    duration: float = DURATION_S,
    progress: Progress = no_progress,
) -> list[ClosedLoopRun]:
    """The run of a task on each of these plants in place of its own; the sensors' noise is one.

    In batches of a fixed width: a run is the same in any company. Raises InputError for what a
    user's file raises.
    """
    with _faults_of_user(task):
        return _run_draws(task, plants, duration, progress)


@contextlib.contextmanager
def _faults_of_user(task: Task) -> Iterator[None]:
    """What a user's own controller raises is an error of its file."""
    try:
        yield
    except SysidError:
        raise
    except Exception as error:
        if task.user_file is None:
            raise
        raise error_in_file(error, task.user_file) from None


def _run_draws(
    task: Task, plants: Sequence[Model], duration: float, progress: Progress
) -> list[ClosedLoopRun]:
    from sysid.controllers.loop import closed_loop

    found: list[ClosedLoopRun] = []
    compiled = True
    for first in range(0, len(plants), _BATCH):
        part = plants[first : first + _BATCH]
        progress(f"simulating draws {first + 1} to {first + len(part)} of {len(plants)}")
        # The last batch is filled up with its last plant, so that one shape is compiled.
        filled = [*part, *[part[-1]] * (min(_BATCH, len(plants)) - len(part))]
        if compiled:
            # Copies: a controller that keeps its state outside its memory shows it by changing.
            controllers = [task.make() for _ in filled]
            watch = Watch(controllers[0])
            try:
                runs = closed_loop(_on(task, controllers, filled), duration)
            except _untraceable():
                compiled = False
            else:
                compiled = not watch.changed()
            if not compiled:
                watch.restore()
        if not compiled:
            # Called from Python such a controller holds the state of one loop.
            runs = [
                closed_loop(_on(task, [task.make()], [plant]), duration, compiled=False)[0]
                for plant in part
            ]
        found += runs[: len(part)]
    return found


def _on(task: Task, controllers: Sequence[Controller], plants: Sequence[Model]) -> list[Case]:
    return [
        replace(task.case(controller), plant=plant)
        for controller, plant in zip(controllers, plants, strict=True)
    ]


def _run(task: Task, duration: float, progress: Progress) -> tuple[ClosedLoopRun, tuple[str, ...]]:
    from sysid.controllers.loop import closed_loop

    progress(f"simulating {duration:g} s of the closed loop")
    controller = task.make()
    watch = Watch(controller)
    try:
        run = closed_loop([task.case(controller)], duration)[0]
    except _untraceable():
        why = "its code branches on values or takes numpy arrays only"
    else:
        where = watch.changed()
        if not where:
            return run, ()
        why = f"it keeps its state {where}"
    watch.restore()
    progress("the controller cannot be compiled: calling it from Python at every tick")
    run = closed_loop([task.case(task.make())], duration, compiled=False)[0]
    return run, (f"{task.choice.controller}: called from Python at every tick, as {why}",)


def _untraceable() -> tuple[type[Exception], ...]:
    """What jax raises for a controller that it cannot compile."""
    from sysid.plant.jax_setup import jax

    errors = jax.errors
    return errors.JAXTypeError, errors.JAXIndexError, errors.UnexpectedTracerError


__all__ = [
    "CONTROLLERS",
    "HORIZON",
    "MOTOR_SHARE",
    "Choice",
    "Task",
    "check_rotary",
    "check_travel",
    "prepared",
    "run_draws",
    "run_task",
]
