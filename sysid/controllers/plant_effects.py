"""The effects of a plant's model in a closed loop: its sensors, and what cannot act there.

Most ports act where the simulator steps the plant. `measure` and `pulses` take whole logs there;
here they act a sample or a period at a time, through `sense` and `recent_pulses`
(`sysid.plant.ports.Effect`), and `delays` is compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sysid.errors import input_error
from sysid.io.channels import SIDES
from sysid.plant.base import Array
from sysid.plant.effects.sensor import TimeSkew
from sysid.plant.jax_setup import jax
from sysid.plant.period_step import KEPT_INTERVALS
from sysid.plant.ports import Effect, Model, overrides
from sysid.plant.sensors import state_channels

_OWN_ROOM = "sysid.plant.effects"
SensorMemory = tuple[tuple[Array, ...], ...]
"""Memory of every effect's `sense`, in the model's order."""


class TrueSignals(NamedTuple):
    """What sensors measure, (lanes,): rad or m, rad/s or m/s, Pa."""

    position: Array
    velocity: Array
    pressure_a: Array
    pressure_b: Array

    def channels(self, is_linear: bool) -> dict[str, Array]:
        """The channels by their log-format names."""
        position = "position_m" if is_linear else "theta_rad"
        names = state_channels(position)
        return dict(zip(names, self, strict=True))


def start_sensors(signals: TrueSignals, model: Model, step: float, is_linear: bool) -> SensorMemory:
    """Memory of the sensors' effects, at rest at these signals; `step` s a sample."""
    channels, memories = signals.channels(is_linear), []
    for effect in model.effects:
        memories.append(effect.start_sensing(channels, step))
        channels, _ = effect.sense(channels, memories[-1], 0.0 * signals.position, step)
    return tuple(memories)


def through_sensors(
    signals: TrueSignals,
    model: Model,
    memories: SensorMemory,
    time: Array,
    step: float,
    is_linear: bool,
) -> tuple[TrueSignals, SensorMemory]:
    """The signals as the model's sensors show them at a sample, and the memory after it."""
    channels, kept = signals.channels(is_linear), []
    for effect, memory in zip(model.effects, memories, strict=True):
        channels, after = effect.sense(channels, memory, time, step)
        kept.append(after)
    return TrueSignals(*channels.values()), tuple(kept)


# --- what cannot act -----------------------------------------------------------------------


def idle_effects(model: Model) -> list[str]:
    """One line for each effect of a plant that a closed loop cannot show."""
    found = []
    for effect in model.effects:
        name = f"plant: {getattr(effect, 'id', type(effect).__name__)}"
        if getattr(effect, "averaged_only", False):
            found.append(f"{name} acts on mean flows only, and the loop follows every pulse")
        if isinstance(effect, TimeSkew) and float(np.min(effect.time_skew_s)) < 0.0:
            found.append(
                f"{name} advances a pressure in time, which no loop can do: it is not shifted"
            )
    return found


def check_effects(model: Model) -> None:
    """Refuse effects, a user's own, whose ports cannot be taken a sample at a time.

    The model's numbers are floats. Raises InputError, which says what the effect needs.
    """
    for effect in model.effects:
        if type(effect).__module__.startswith(_OWN_ROOM):
            continue
        place = f"effect {getattr(effect, 'id', type(effect).__name__)}"
        if overrides(effect, "pulses") and not overrides(effect, "recent_pulses"):
            _refuse(place, "`pulses` takes whole logs", "recent_pulses")
        if overrides(effect, "measure") and not overrides(effect, "sense"):
            _check_rows(effect, place)
        if overrides(effect, "measure", "sense"):
            _check_compiles(partial(_sensed, effect), place, "sense")
        if overrides(effect, "delays"):
            _check_compiles(partial(_delayed, effect), place, "delays")


def _refuse(place: str, why: str, port: str) -> None:
    raise input_error(
        f"{place} in a closed loop",
        f"its {why}, which a loop does not have",
        f"give it `{port}` (sysid.plant.ports.Effect)",
    )


def _check_rows(effect: Effect, place: str) -> None:
    """Whether `measure` takes each row by itself: rows alone show what they show together."""
    rows = np.outer((0.5, 1.0, 1e5, 1.2e5), 1.0 + np.random.default_rng(0).random(5))
    time = 1e-3 * np.arange(5.0)
    together = effect.measure(TrueSignals(*rows).channels(False), time)
    for i in range(5):
        alone = effect.measure(TrueSignals(*rows[:, i : i + 1]).channels(False), time[i : i + 1])
        if any(not np.isclose(together[n][i], alone[n][0], rtol=1e-9) for n in together):
            _refuse(place, "`measure` uses several rows", "sense")


def _sensed(effect: Effect, value: Array) -> Any:
    channels = TrueSignals(value, value, value, value).channels(False)
    memory = effect.start_sensing(channels, 1e-3)
    return effect.sense(channels, memory, value, 1e-3)


def _delayed(effect: Effect, value: Array) -> Any:
    times = value + np.zeros((KEPT_INTERVALS, 1))
    return [effect.delays(times, times, True, side) for side in SIDES]


def _check_compiles(port: Callable[[Any], Any], place: str, name: str) -> None:
    try:
        jax.eval_shape(port, np.ones(1))
    except Exception as error:
        reason = str(error).partition("\n")[0]
        raise input_error(
            f"{place} in a closed loop",
            f"its `{name}` cannot be compiled: {reason}",
            "write it with sysid.plant.base.array_namespace, without branches on values",
        ) from None


__all__ = [
    "SensorMemory",
    "TrueSignals",
    "check_effects",
    "idle_effects",
    "start_sensors",
    "through_sensors",
]
