"""A model driven by the commands of logged tests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from sysid.blocks.plots import legend, some_axes
from sysid.blocks.progress import progress_or_shown
from sysid.blocks.shown import Shown
from sysid.errors import NotIdentifiedError, input_error
from sysid.io.channels import VALVE_COMMANDS
from sysid.io.logs import read_log
from sysid.io.rig import Rig
from sysid.io.samples import Trial
from sysid.io.tables import write_table
from sysid.io.trial_kind import is_held
from sysid.io.units import parse_map
from sysid.parameters import Bundle, read_bundle
from sysid.parameters.assembled_model import (
    DISCRETE,
    VALVE_MODELS,
    assumed_parameters,
    first_valve_model,
    friction_wanted,
    surfaces_for,
)
from sysid.pipeline.given_tests import Tests, rig_of, trials_of
from sysid.pipeline.request import Reported, takes
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.plant.ports import Model
from sysid.plant.trials import (
    assumed_starts,
    check_commands,
    simulate_trials,
    simulated_table,
    starts_on_supply,
)
from sysid.refinement.prediction_bands import SHARE, MotionBand, open_loop_bands
from sysid.types import FloatArray

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

_COMMANDS = (*VALVE_COMMANDS, "motor_torque_nm", "motor_force_n")


@dataclass(frozen=True, repr=False)
class SimulatedRun:
    """One test as simulated: channels (n,) by their names in the log format, SI.

    `trial` is the test whose commands drove it.
    """

    trial: Trial
    channels: Mapping[str, FloatArray]

    @property
    def label(self) -> str:
        """The test's label."""
        return self.trial.label

    @property
    def frame(self) -> pd.DataFrame:
        """A new DataFrame: `time_s`, the commands, the simulated channels; one row per sample."""
        import pandas as pd

        commands = {name: self.trial[name] for name in _COMMANDS if name in self.trial}
        return pd.DataFrame({"time_s": self.trial.time, **commands, **self.channels})

    def __repr__(self) -> str:
        return f"<SimulatedRun: test {self.label or '-'}, {len(self.trial)} samples>"


@dataclass(frozen=True, repr=False)
class Simulation(Shown):
    """Simulated tests: `runs[0]` or `runs["label"]`, each with a `frame`; all: `runs.frame`."""

    runs: tuple[SimulatedRun, ...]
    valve_model: str

    def __len__(self) -> int:
        return len(self.runs)

    def __iter__(self) -> Iterator[SimulatedRun]:
        return iter(self.runs)

    def __getitem__(self, test: int | str) -> SimulatedRun:
        if isinstance(test, int):
            return self.runs[test]
        for run in reversed(self.runs):
            if run.label == test:
                return run
        known = ", ".join(repr(run.label) for run in self.runs)
        raise KeyError(f"no test {test!r}: the tests are {known}")

    @property
    def frame(self) -> pd.DataFrame:
        """All tests in one table, `test` their label."""
        import pandas as pd

        parts = [run.frame for run in self.runs]
        for run, part in zip(self.runs, parts, strict=True):
            part.insert(0, "test", run.label)
        return pd.concat(parts, ignore_index=True)

    def to_frame(self) -> pd.DataFrame:
        """The samples, as `frame`."""
        return self.frame

    def headline(self) -> str:
        """How many tests, and by which valve model."""
        return f"{len(self.runs)} tests simulated, {self.valve_model} valves"

    def records(self) -> list[dict[str, Any]]:
        """One record per test: its length, and each channel's last value."""
        return [
            {
                "test": run.label,
                "length_s": float(run.trial.time[-1] - run.trial.time[0]),
                **{f"last {name}": float(v[-1]) for name, v in run.channels.items() if len(v)},
            }
            for run in self.runs
        ]

    def plot(self, axes: Axes | Iterable[Axes] | None = None, test: int | str = 0) -> list[Axes]:
        """One test's channels, one panel each, over the logged ones if any; returns the axes."""
        run = self[test]
        panels = some_axes(len(run.channels), axes)
        for ax, (name, values) in zip(panels, run.channels.items(), strict=True):
            if name in run.trial:
                ax.plot(run.trial.time, run.trial[name], color="0.5", label="logged")
            ax.plot(run.trial.time, values, label="simulated")
            ax.set_ylabel(name)
        legend(panels[0])
        panels[-1].set_xlabel("time_s")
        return panels


@dataclass(frozen=True)
class SimulatedLog:
    """The result of `sysid simulate`: each trial with its channels (n,), and notices.

    `pressures`: the channels of the rig's chambers. `bands` of each trial, from `draws` models.
    """

    trials: tuple[Trial, ...]
    channels: tuple[Mapping[str, FloatArray], ...]
    position: str
    pressures: tuple[str, ...]
    valve_model: str
    notices: tuple[str, ...]
    written: Path
    bands: tuple[Mapping[str, MotionBand], ...] = ()
    draws: int = 0

    def widths(self, test: int) -> dict[str, float]:
        """The mean width of each channel's 90 % band in a test; empty without draws."""
        if not self.bands:
            return {}
        return {name: float(np.mean(b.high - b.low)) for name, b in self.bands[test].items()}

    def to_json(self) -> dict[str, Any]:
        """The output of `sysid simulate --json`."""
        own = {}
        if self.bands:
            widths = {t.label: self.widths(i) for i, t in enumerate(self.trials)}
            own = {"draws": {"count": self.draws, "share": SHARE, "band_width": widths}}
        return {
            **own,
            "written": str(self.written),
            "valve_model": self.valve_model,
            "tests": [t.label for t in self.trials],
            "rows": sum(len(t) for t in self.trials),
            "notices": list(self.notices),
        }


@dataclass(frozen=True)
class SimulateOptions(Reported):
    """The rig and the valve model; `effects`: those that the catalogue lacks.

    `draws` (`simulate_log`): models drawn from the errors of the bundle's numbers, by `seed`, for a
    90 % band about each channel.
    """

    rig: Rig | None = None
    _: KW_ONLY
    valve_model: str | None = None
    effects: EffectSource = None
    draws: int = 0
    seed: int = 0

    valve_models: ClassVar[tuple[str, ...]] = VALVE_MODELS
    """What `valve_model` can be."""


@takes(SimulateOptions)
def simulate(tests: Tests, model: Model | Bundle, options: SimulateOptions) -> Simulation:
    """Simulate the commands of a log, several, or single tests open loop.

    Each test starts at rest, at its first row's position and pressures. `rig` None: that
    of the logs. A model is simulated with the on/off law under the real pulses; a bundle also
    with its PWM mean flow: `valve_model` "discrete", "averaged", "bipolynomial" or "ann" (None:
    the first that it holds), `effects` are those that it lists and the catalogue lacks. Raises
    InputError for commands that cannot be used, NotIdentifiedError where the model lacks a
    parameter.

    >>> runs = si.simulate(log, bundle.model())
    >>> runs[0].frame[["time_s", "theta_rad", "pressure_a_pa"]].shape == (len(log.trials[0]), 3)
    True
    """
    known, trials = rig_of(tests, options.rig), trials_of(tests)
    surfaces: tuple[Any, ...] = ()
    chosen = options.valve_model or DISCRETE
    if isinstance(model, Bundle):
        held = _is_held(model, trials, known)
        plain = model.model(known, catalogue_from(options.effects), held=held)
        chosen = options.valve_model or first_valve_model(model, known, plain.parameters)
        surfaces = surfaces_for(model, known, chosen)
    elif chosen == DISCRETE:
        plain = model
    else:
        raise input_error("valve_model", f"{chosen} is a surface of a bundle", "pass the bundle")
    with progress_or_shown(options.progress, "simulating") as tell:
        tell(f"simulating {len(trials)} tests, {chosen} valve model")
        starts = [starts_on_supply(trial, known) for trial in trials]
        found = simulate_trials(trials, known, plain, surfaces, starts)
    runs = zip(trials, found, strict=True)
    return Simulation(tuple(SimulatedRun(t, _without_time(c)) for t, c in runs), chosen)


def simulate_log(
    inputs: Path,
    bundle_path: Path,
    output: Path,
    maps: Sequence[str],
    options: SimulateOptions,
) -> SimulatedLog:
    """Simulate every test of a log of commands and write the result in the log format.

    The rig is the bundle's. A test starts at rest, at its first row's position and pressures;
    one under PWM with the piston held that starts nearer to the supply than to the atmosphere
    starts with its valve on (log format). `maps` translates foreign columns, as `--map` does.
    Raises InputError for unusable files, NotIdentifiedError where the bundle lacks what the
    model needs.
    """
    bundle = read_bundle(bundle_path)
    rig = bundle.rig
    log = read_log(inputs, rig, parse_map(maps))
    held = _is_held(bundle, log.trials, rig)
    model = bundle.model(rig, catalogue_from(options.effects), held=held)
    chosen = options.valve_model or first_valve_model(bundle, rig, model.parameters)
    notices = [*rig.notices, *log.notices, *assumed_parameters(bundle, rig)]
    if held:
        notices.append(
            f"{bundle_path.name}: holds no friction: the piston stays where {inputs.name} has it"
        )
    for trial in log.trials:
        check_commands(trial, rig, chosen)
        notices += assumed_starts(trial, rig)
    channels = simulate_trials(
        log.trials,
        rig,
        model,
        surfaces_for(bundle, rig, chosen),
        [starts_on_supply(trial, rig) for trial in log.trials],
    )
    bands: list[Mapping[str, MotionBand]] = []
    if options.draws:
        bands, kept = _bands(bundle, rig, model, log.trials, chosen, options)
        notices += kept
    columns = [
        {**own, **(_band_columns(bands[i]) if bands else {})} for i, own in enumerate(channels)
    ]
    source = f"simulated from: {log.path.name}, SHA-256 {log.sha256}"
    said = [source, f"bundle: {bundle_path.name}", f"valve model: {chosen}"]
    if bands:
        said.append(f"bands of {100 * SHARE:.0f} %: {options.draws} draws, seed {options.seed}")
    write_table(simulated_table(log.trials, columns, rig), output, said)
    return SimulatedLog(
        log.trials,
        tuple(channels),
        rig.position_channel,
        () if rig.cylinder is None else rig.pressure_channels,
        chosen,
        tuple(dict.fromkeys(notices)),
        output,
        tuple(bands),
        options.draws,
    )


def _is_held(bundle: Bundle, trials: Sequence[Trial], rig: Rig) -> bool:
    """Whether the piston is held in tests by a bundle without friction, as their position shows.

    Raises NotIdentifiedError where such a test shows no position: it may move.
    """
    if bundle.friction is not None or rig.cylinder is None:
        return False
    name = rig.position_channel
    if unknown := [trial.source for trial in trials if name not in trial]:
        raise NotIdentifiedError(
            f"{bundle.source}: holds no friction; {friction_wanted(rig)}, or where the piston is "
            f"held, give its place as {name} in every row of {unknown[0]}"
        )
    return all(is_held(trial, rig) for trial in trials)


def _bands(
    bundle: Bundle,
    rig: Rig,
    model: Model,
    trials: Sequence[Trial],
    valve_model: str,
    options: SimulateOptions,
) -> tuple[list[Mapping[str, MotionBand]], tuple[str, ...]]:
    """The bands of each test, and notices of what is not varied."""
    from sysid.refinement.draws import posterior_draws

    if valve_model != DISCRETE:
        raise input_error(
            f"valve model {valve_model}",
            "holds no errors from which to draw",
            "give --valve-model discrete, or leave --draws out",
        )
    drawn = posterior_draws(bundle, rig, model, options.draws, options.seed)
    return open_loop_bands(bundle, rig, drawn, trials, options.seed, options.tell), drawn.notices()


def _band_columns(bands: Mapping[str, MotionBand]) -> dict[str, FloatArray]:
    ends = {"p05": "low", "p95": "high"}
    return {f"{n}_{end}": getattr(b, at) for n, b in bands.items() for end, at in ends.items()}


def _without_time(channels: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    return {name: values for name, values in channels.items() if name != "time_s"}


__all__ = [
    "SimulateOptions",
    "SimulatedLog",
    "SimulatedRun",
    "Simulation",
    "simulate",
    "simulate_log",
]
