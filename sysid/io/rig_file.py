"""The rig file as a whole: its head, its sections and their order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, get_args

from sysid.io.declaration import (
    ChoiceKey,
    Motion,
    TemplateLine,
    TextKey,
    TomlSection,
    TomlTable,
)
from sysid.io.rig_sections import (
    Air,
    Cylinder,
    Inertia,
    Motor,
    Pwm,
    Sampling,
    Sensors,
    Spring,
    Tank,
    ValveASheet,
    ValveBSheet,
    Valves,
)

Orientation = Literal["horizontal", "vertical"]


@dataclass(frozen=True)
class SectionComment:
    """The comment behind a section's heading in the template for this motion (None: both)."""

    text: str
    motion: Motion | None = None


class RigHead(TomlSection):
    """`[rig]`: the rig's name, its motion and its orientation."""

    table: ClassVar[str] = "rig"

    name: Annotated[str, TextKey("The rig's name.", TemplateLine('"my-actuator"'))] = "rig"
    motion: Annotated[
        Motion,
        ChoiceKey(
            "Whether the output rotates (rad, Nm, kg m2) or translates (m, N, kg).",
            get_args(Motion),
            (
                TemplateLine('"rotary"', motion="rotary"),
                TemplateLine('"linear"', motion="linear"),
            ),
        ),
    ] = "rotary"
    orientation: Annotated[
        Orientation,
        ChoiceKey(
            "Whether gravity acts on the motion.",
            get_args(Orientation),
            (
                TemplateLine(
                    '"horizontal"',
                    '"vertical": gravity acts, theta = 0 where its torque is zero',
                    motion="rotary",
                ),
                TemplateLine(
                    '"horizontal"',
                    '"vertical": the weight acts against positive motion',
                    motion="linear",
                ),
            ),
        ),
    ]


class RigFile(TomlTable):
    """The rig file: what is known about a rig before any test. SI; pressures are absolute."""

    rig: RigHead
    air: Air | None = None
    cylinder: Cylinder | None = None
    spring: Spring | None = None
    inertia: Inertia | None = None
    motor: Annotated[
        Motor | None,
        SectionComment("of an electric drive next to the cylinder, if there is one", "linear"),
    ] = None
    pwm: Pwm | None = None
    valves: Annotated[Valves | None, SectionComment("from the valve's manual")] = None
    valve_a: ValveASheet | None = None
    valve_b: ValveBSheet | None = None
    tank: Tank | None = None
    sampling: Sampling | None = None
    sensors: Annotated[
        Sensors | None, SectionComment("optional: taken from the data where absent")
    ] = None


RIG_TABLES: dict[str, type[TomlSection]] = {
    cls.table: cls
    for cls in (
        *(RigHead, Air, Cylinder, Spring, Inertia, Motor),
        *(Pwm, Valves, ValveASheet, ValveBSheet, Tank, Sampling, Sensors),
    )
}

__all__ = ["RIG_TABLES", "Orientation", "RigFile", "RigHead", "SectionComment"]
