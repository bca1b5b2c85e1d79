"""Gains of the named controllers that may be tuned: their names, units, and the file they are in.

The printed ones (Tables 4.2.2, 4.3.2, 4.4.4) are the controllers' defaults.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.controllers.interface import Controller
from sysid.controllers.modes import Mode
from sysid.errors import input_error

GAINS_SCHEMA = "sysid-gains/1"


@dataclass(frozen=True)
class TunableGain:
    """A gain: the controller's `fields` that have its value, and its unit.

    `whole`: it counts ticks, and is one of `choices`. `needs`: "motor" or "valves" where it acts
    with these only.
    """

    name: str
    fields: tuple[str, ...]
    unit: str
    needs: str = ""
    choices: tuple[int, ...] = ()

    def acts(self, mode: Mode) -> bool:
        """Whether it matters in a mode."""
        return {"motor": mode.uses_motor, "valves": mode.uses_valves}.get(self.needs, True)


_PVA = (
    TunableGain("position_gain", ("position_gain",), "1/rad"),
    TunableGain("velocity_gain", ("velocity_gain",), "s/rad"),
    TunableGain("acceleration_gain", ("acceleration_gain",), "s2/rad"),
    TunableGain("feedforward_velocity", ("feedforward_velocity",), "s/rad"),
    TunableGain("feedforward_acceleration", ("feedforward_acceleration",), "s2/rad"),
)
# As in all of the thesis' tables both chambers have one gain.
_BACKSTEPPING = (
    TunableGain("k1", ("k1",), "1/s"),
    TunableGain("k2", ("k2",), "1/s"),
    TunableGain("k3", ("k3", "k4"), "1/s", "valves"),
    TunableGain("motor_p", ("motor_p",), "N m/rad", "motor"),
    TunableGain("motor_d", ("motor_d",), "N m s/rad", "motor"),
)
_DVMPC = (
    TunableGain("horizon", ("horizon",), "ticks", "valves", (25, 30, 35, 40, 50)),
    TunableGain("natural_frequency", ("natural_frequency",), "1/s", "motor"),
    TunableGain("damping", ("damping",), "", "motor"),
)
GAINS: dict[str, tuple[TunableGain, ...]] = {
    "pva": _PVA,
    "backstepping": _BACKSTEPPING,
    "dvmpc": _DVMPC,
}


@dataclass(frozen=True)
class ChosenGains:
    """Values of gains by name, of a controller and for a mode."""

    controller: str
    mode: Mode
    values: Mapping[str, float]

    def applied(self, controller: Controller) -> Controller:
        """The controller with these gains."""
        return with_gains(controller, gains_of(self.controller, self.mode), self.values)

    def text(self, **provenance: Any) -> str:
        """The file's content; `provenance` says where they come from."""
        content = {
            "schema": GAINS_SCHEMA,
            "controller": self.controller,
            "mode": self.mode.value,
            "gains": dict(self.values),
            **provenance,
        }
        return json.dumps(content, indent=2) + "\n"


def gains_of(controller: str, mode: Mode) -> tuple[TunableGain, ...]:
    """Those that act in a mode. Raises InputError for a controller that has none."""
    if controller not in GAINS:
        raise input_error(
            f"controller {controller!r}",
            "has no gains that are known here",
            f"tune one of {', '.join(GAINS)}",
        )
    return tuple(gain for gain in GAINS[controller] if gain.acts(mode))


def with_gains(
    controller: Controller, gains: tuple[TunableGain, ...], values: Mapping[str, float]
) -> Controller:
    """A controller with other values of its gains."""
    changes: dict[str, Any] = {}
    for gain in gains:
        if gain.name in values:
            value = values[gain.name]
            changes |= dict.fromkeys(gain.fields, int(value) if gain.choices else float(value))
    made: Controller = dataclasses.replace(controller, **changes)  # type: ignore[type-var]
    return made


def values_of(controller: Controller, gains: tuple[TunableGain, ...]) -> dict[str, float]:
    """A controller's own values."""
    return {gain.name: float(getattr(controller, gain.fields[0])) for gain in gains}


def read_gains(path: Path) -> ChosenGains:
    """Gains from a file of `sysid control --tune`. Raises InputError, which names the key."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise input_error(path, f"cannot be read: {error.strerror}", "give a gains file") from None
    except ValueError:
        raise input_error(path, "is not JSON", "give a file of sysid control --tune") from None
    if not isinstance(content, dict) or content.get("schema") != GAINS_SCHEMA:
        raise input_error(path, f"is not a {GAINS_SCHEMA} file", "write one with --tune -o DIR")
    try:
        mode = Mode(content.get("mode"))
    except ValueError:
        known = ", ".join(m.value for m in Mode)
        raise input_error(f"{path}, mode", "is not a mode", f"give one of {known}") from None
    name = content.get("controller")
    gains = {gain.name: gain for gain in gains_of(str(name), mode)}
    values = content.get("gains")
    if not isinstance(values, dict) or not values:
        raise input_error(f"{path}, gains", "is missing", f"give {', '.join(gains)}")
    for key, value in values.items():
        _check(f"{path}, gains.{key}", gains.get(key), value, list(gains))
    return ChosenGains(str(name), mode, {k: float(v) for k, v in values.items()})


def _check(where: str, gain: TunableGain | None, value: Any, known: list[str]) -> None:
    """InputError for a gain that is not one, or a value that it cannot have."""
    if gain is None:
        raise input_error(where, "is not a gain of this controller and mode", f"use {known}")
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or value < 0.0:
        raise input_error(where, "is not a number of at least 0", "give one")
    if gain.choices and not (float(value).is_integer() and 1 <= value <= max(gain.choices) * 4):
        raise input_error(where, "is not a count of ticks", f"give 1 to {max(gain.choices) * 4}")


__all__ = [
    "GAINS",
    "GAINS_SCHEMA",
    "ChosenGains",
    "TunableGain",
    "gains_of",
    "read_gains",
    "values_of",
    "with_gains",
]
