"""Rotary and linear: what a rig's quantities are measured in, and what files call them.

Inside the program a parameter has one name whatever moves, `coulomb` for example; a file's key has
the unit in it, `coulomb_nm` or `coulomb_n`. Which one is said here and nowhere else.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from sysid.io.channels import VELOCITY_CHANNELS

FRICTION = ("static", "coulomb", "viscous")
LOADS = ("motor", "transmitted")
"""Efforts that friction may grow with: the motor's, or that of motor and cylinder together."""


@dataclass(frozen=True)
class MotionUnits:
    """Units and names of a rig whose output turns (Nm, rad) or slides (N, m).

    `effort`, `position` and what ends in `_unit` are units, `word` is what the effort is called;
    `rig_inertia` is the rig file's key of the whole inertia; `turn` is what an encoder's counts are
    declared per, in units of position, and `counts_per` its name in keys.
    """

    motion: Literal["rotary", "linear"]
    word: str
    effort: str
    position: str
    viscous_unit: str
    inertia_unit: str
    position_channel: str
    effort_channel: str
    rig_inertia: str
    turn: float
    counts_per: str
    keys: Mapping[str, str]

    @property
    def speed(self) -> str:
        """Unit of speed."""
        return f"{self.position}/s"

    @property
    def place(self) -> str:
        """What the position is called: "angle" or "position"."""
        return "position" if self is LINEAR else "angle"

    @property
    def speed_channel(self) -> str:
        """The channel of a measured speed."""
        return VELOCITY_CHANNELS[self.position_channel]

    @property
    def suffix(self) -> str:
        """The effort's unit at the end of a key: "nm" or "n"."""
        return self.effort.lower()

    @property
    def effort_per_volt(self) -> str:
        """The rig file's key of the motor's effort per volt."""
        return f"{self.word}_per_volt_{self.suffix}"

    @property
    def max_effort(self) -> str:
        """The rig file's key of the motor's limit."""
        return f"max_{self.word}_{self.suffix}"

    @property
    def stiffness(self) -> str:
        """The rig file's key of the return spring's stiffness."""
        return f"stiffness_{self.suffix}_per_{self.position}"

    @property
    def preload(self) -> str:
        """The rig file's key of the return spring's preload."""
        return f"preload_{self.suffix}"

    @property
    def encoder_counts(self) -> str:
        """The rig file's key of the encoder's counts."""
        return f"encoder_counts_per_{self.counts_per}"

    @property
    def other(self) -> MotionUnits:
        """The units of the other kind of motion."""
        return ROTARY if self is LINEAR else LINEAR

    def key(self, name: str) -> str:
        """A bundle's key of a parameter of friction: `coulomb_nm` of `coulomb`."""
        return self.keys[name]

    def unit(self, name: str) -> str:
        """The unit of a parameter of friction."""
        return {"viscous": self.viscous_unit, "inertia": self.inertia_unit}.get(name, self.effort)

    def keyed(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Values by name as values by a bundle's key."""
        return {self.keys[name]: value for name, value in values.items()}

    def named(self, keys: Iterable[str]) -> list[str]:
        """The names of a bundle's keys; an unknown key stays."""
        names = {key: name for name, key in self.keys.items()}
        return [names.get(key, key) for key in keys]


ROTARY = MotionUnits(
    motion="rotary",
    word="torque",
    effort="Nm",
    position="rad",
    viscous_unit="Nm s/rad",
    inertia_unit="kg m2",
    position_channel="theta_rad",
    effort_channel="motor_torque_nm",
    rig_inertia="equivalent_kg_m2",
    turn=2.0 * math.pi,
    counts_per="rev",
    keys={
        "static": "static_nm",
        "coulomb": "coulomb_nm",
        "viscous": "viscous_nm_s_per_rad",
        "offset": "offset_nm",
        "inertia": "inertia_kg_m2",
    },
)
LINEAR = MotionUnits(
    motion="linear",
    word="force",
    effort="N",
    position="m",
    viscous_unit="N s/m",
    inertia_unit="kg",
    position_channel="position_m",
    effort_channel="motor_force_n",
    rig_inertia="mass_kg",
    turn=1.0,
    counts_per="m",
    keys={
        "static": "static_n",
        "coulomb": "coulomb_n",
        "viscous": "viscous_n_s_per_m",
        "offset": "offset_n",
        "inertia": "mass_kg",
    },
)


def units_of(is_linear: bool) -> MotionUnits:
    """The units of a linear or a rotary rig."""
    return LINEAR if is_linear else ROTARY


__all__ = ["FRICTION", "LINEAR", "LOADS", "ROTARY", "MotionUnits", "units_of"]
