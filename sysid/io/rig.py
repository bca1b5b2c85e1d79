"""A rig as read from its file, and what follows from it (`docs/reference/log-format.md`).

The file's sections and keys are declared in `rig_file` and `rig_sections`.
"""

from __future__ import annotations

import dataclasses
import difflib
import textwrap
import tomllib
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, table
from sysid.errors import InputError, input_error
from sysid.io.channels import CHAMBER_PRESSURES, SIDES
from sysid.io.declaration import TomlSection
from sysid.io.file_kinds import PARQUET_SUFFIXES, is_bag
from sysid.io.files import note_input
from sysid.io.motion import MotionUnits, units_of
from sysid.io.rig_file import RIG_TABLES, RigFile, RigHead
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
    ValveSheet,
)
from sysid.types import FloatArray

GRAVITY_M_PER_S2 = 9.81
RIG_FILE_NAME = "rig.toml"
ASSUMED = "assumed"
"""The key of the rig file's undeclared constants, before its sections."""

BARE = "the reference rig"
"""The `source` of a rig that was made without a rig file."""
END_MARGIN = 0.01
"""Of the stroke: samples this near to an end are not part of the model (log-format.md)."""
HELD_SHARE = 0.005
"""Of the stroke, or of a chamber's volume: a held piston moves by encoder counts and a little
elasticity. Flows out of the volume have the same relative error."""
_NO_FILE = "the assumed rig"
# Share of the atmosphere's pressure: less drives nothing, and is the weather's.
_LEAST_VACUUM = 0.05
# J/(kg K): air that is dry, and saturated with water at 40 degC; nitrogen, too, and without it.
_AIR = (286.0, 297.0)
_MOIST_AIR = (286.0, 295.0)
# Letters in a line of a rig's constants, as it shows itself.
_LINE = 84
_TESTS_BY_MOTOR = {
    "static": "friction-static tests (a torque ramp from rest)",
    "coulomb": "friction-sliding tests (constant torques, at least two levels)",
    "viscous": "friction-sliding tests (constant torques, at least two levels)",
}
_UP_AND_DOWN = "friction-motion tests (the valves drive the piston to and fro at several speeds)"
_TESTS_BY_AIR = {
    "static": "friction-motion tests (the valves move the piston slowly, with rests in between)",
    "coulomb": _UP_AND_DOWN,
    "viscous": _UP_AND_DOWN,
}
_NO_INERTIA = Inertia.model_construct()
_NO_SENSORS = Sensors.model_construct()


@dataclass(frozen=True)
class Load:
    """The excess of a payload over its rig file's: kg m2 or kg, and Nm and N of gravity.

    Of one test, or (n,) of the samples of several.
    """

    inertia: float | FloatArray = 0.0
    gravity_moment: float | FloatArray = 0.0
    weight: float | FloatArray = 0.0


NO_LOAD = Load()


@dataclass(frozen=True, repr=False)
class Rig(Shown):
    """A rig: constants by section, SI. Sections missing from the file are None.

    `source` is the file that it was read from; `content` the file's tables as read, which
    go into a bundle; `notices` the reader's notices. `assumed` are the constants that were not
    declared and that no log shows, as dotted keys ("cylinder.area_a_m2").

    >>> campaign.rig.air.supply_pressure_pa, campaign.rig.effort_channel
    (312000.0, 'motor_torque_nm')
    """

    name: str
    orientation: str
    motion: str
    air: Air | None = None
    cylinder: Cylinder | None = None
    spring: Spring | None = None
    inertia: Inertia | None = None
    motor: Motor | None = None
    pwm: Pwm | None = None
    valves: Valves | None = None
    valve_a: ValveASheet | None = None
    valve_b: ValveBSheet | None = None
    tank: Tank | None = None
    sampling: Sampling | None = None
    sensors: Sensors = _NO_SENSORS
    source: str = "rig"
    content: dict[str, Any] = dataclasses.field(default_factory=dict, compare=False)
    notices: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()

    def headline(self) -> str:
        """Its name, what it moves and how, and the file that describes it."""
        what = "tank" if self.is_tank_alone else f"{self.motion}, {self.orientation}"
        return f"rig {self.name}: {what} ({Path(self.source).name})"

    def records(self) -> list[dict[str, Any]]:
        """One record per constant of the file: section, key, value, and whether it is assumed."""
        return [
            {
                "section": section,
                "key": key,
                "value": value,
                "assumed": f"{section}.{key}" in self.assumed,
            }
            for section, values in self.content.items()
            if section != "rig" and isinstance(values, Mapping)
            for key, value in values.items()
        ]

    def tables(self) -> Iterable[Table]:
        """The constants, one row per section of the file; SI."""
        said: dict[str, list[str]] = {}
        for one in self.records():
            value = one["value"]
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            mark = " (assumed)" if one["assumed"] else ""
            said.setdefault(one["section"], []).append(f"{one['key']}={shown}{mark}")
        rows = [
            (k, textwrap.fill(", ".join(v), _LINE, break_on_hyphens=False)) for k, v in said.items()
        ]
        yield table("", ("section", "constants, SI"), rows, text=(1,))

    def said(self, line: str) -> str:
        """A line about the rig: one that no file describes is not called a file."""
        return line.replace("the rig file", _NO_FILE) if self.is_bare else line

    def data_sheet(self, side: str) -> ValveSheet | None:
        """The data sheet of valve "a" or "b" by ISO 6358; None where none is declared."""
        sheet = self.valve_a if side == "a" else self.valve_b
        return None if sheet is None or sheet.law != "iso6358" else sheet

    def valve_alone(self, side: str) -> dict[str, float]:
        """The coefficients of valve "a" or "b" without its flow control, by direction, "fill" in
        kg/(s Pa^0.5) and "dis" in kg/(s Pa); empty where none are declared."""
        sheet = self.valve_a if side == "a" else self.valve_b
        if sheet is None or sheet.law == "iso6358":
            return {}
        return {"fill": sheet.valve_c_fill, "dis": sheet.valve_c_dis}

    @property
    def is_bare(self) -> bool:
        """Whether no rig file was given: what the logs do not show is assumed."""
        return self.source == BARE

    @property
    def is_linear(self) -> bool:
        """Whether position is in metres and effort in newtons."""
        return self.motion == "linear"

    @property
    def units(self) -> MotionUnits:
        """The units of its quantities, and their names in files."""
        return units_of(self.is_linear)

    @property
    def is_vertical(self) -> bool:
        """Whether gravity acts."""
        return self.orientation == "vertical"

    @property
    def position_channel(self) -> str:
        """`position_m` on a linear rig, else `theta_rad`."""
        return self.units.position_channel

    @property
    def encoder_step(self) -> float | None:
        """An encoder's count, rad or m; None where its number of counts is not declared."""
        counts = getattr(self.sensors, self.units.encoder_counts)
        return None if counts is None else self.units.turn / counts

    @property
    def effort_channel(self) -> str:
        """`motor_force_n` on a linear rig, else `motor_torque_nm`."""
        return self.units.effort_channel

    @property
    def max_effort(self) -> float | None:
        """The motor's declared limit at the output, N or Nm; None if not declared."""
        return None if self.motor is None else getattr(self.motor, self.units.max_effort)

    @property
    def effort_per_volt(self) -> float | None:
        """Motor effort per volt of command, N/V or Nm/V; None if not declared."""
        return None if self.motor is None else getattr(self.motor, self.units.effort_per_volt)

    @property
    def travel(self) -> float | None:
        """Whole stroke in position units, rad or m; None without a cylinder."""
        if self.cylinder is None:
            return None
        return self.cylinder.stroke_m / self.cylinder.pitch_radius_m

    @property
    def sides(self) -> tuple[str, ...]:
        """The chambers, and their valves, that it has: "a" alone, or "a" and "b"."""
        return SIDES if self.cylinder is None else self.cylinder.chambers

    @property
    def supply_way(self) -> float:
        """1 where the supply is above the atmosphere, -1 where it is a vacuum."""
        a = self.air
        vacuum = a is not None and a.supply_pressure_pa < a.atmospheric_pressure_pa
        return -1.0 if vacuum else 1.0

    @property
    def pressure_channels(self) -> tuple[str, ...]:
        """The channels of its chambers' pressures; none of a motor alone."""
        return () if self.is_motor_alone else CHAMBER_PRESSURES[: len(self.sides)]

    @property
    def bleeds(self) -> bool:
        """Whether a chamber has two on/off valves: one fills it, one empties it."""
        return self.valves is not None and self.valves.arrangement == "fill-and-bleed"

    @property
    def has_pwm_surfaces(self) -> bool:
        """Whether PWM surfaces are fitted of its valves: 3/2 valves at a supply that fills."""
        return self.why_no_surfaces is None

    @property
    def why_no_surfaces(self) -> str | None:
        """Why no PWM surfaces are fitted of its valves, in words; None where they are."""
        if self.bleeds:
            return (
                "a fill and a bleed valve, of which no PWM surface is fitted; valve-discrete tests "
                "give the law that is followed pulse by pulse"
            )
        if self.supply_way < 0.0:
            return (
                "the supply is a vacuum, under which no PWM surface is fitted; valve-discrete "
                "tests give the law that is averaged over the pulses"
            )
        return None

    @property
    def valve_names(self) -> tuple[str, ...]:
        """What its valves' commands are named after: `valve_a`, or `valve_a_fill`, `valve_a_bleed`.

        At most two: of chambers A and B, or the fill and the bleed valve of one chamber.
        """
        return ("a_fill", "a_bleed") if self.bleeds else self.sides

    @property
    def all_valves(self) -> str:
        """ "both valves"; of a rig with one chamber "its valve" or, one fills, "its valves"."""
        if len(self.sides) > 1:
            return "both valves"
        return "its valves" if self.bleeds else "its valve"

    @property
    def friction_tests(self) -> Mapping[str, str]:
        """The tests that identify static, Coulomb and viscous friction on this rig, in words."""
        return _TESTS_BY_AIR if self.has_air_alone else _TESTS_BY_MOTOR

    @property
    def has_air_alone(self) -> bool:
        """Whether a cylinder alone drives it: no motor is declared, nor assumed."""
        return self.motor is None and self.cylinder is not None

    @property
    def valve_steps(self) -> str:
        """How a valve-discrete test switches a chamber's valves, in words."""
        if self.bleeds:
            return "fill valve on for 3 s, both off, bleed valve on, piston held"
        if self.held_tank is not None:
            return "off, on until the pressure rests, off until it rests again"
        return "off, on for 3 s, off, piston held"

    def filled_by(self, side: str) -> str:
        """The name of the valve that fills a chamber."""
        return f"{side}_fill" if self.bleeds else side

    def require_motion(self) -> None:
        """InputError where nothing that it declares moves, so that nothing can be simulated."""
        if self.is_tank_alone:
            raise input_error(
                self.source,
                "declares a tank alone, which has no motion to simulate",
                "judge its laws by their own fits (sysid fit), and diagnose them by tank tests",
            )

    def require_side(self, side: str, what: str) -> None:
        """InputError, which names `what` asks, where the rig lacks a chamber and its valve."""
        if side not in self.sides:
            name = side.upper()
            raise input_error(
                self.source,
                f"[cylinder] chambers lists no chamber {name}, but {what} is of valve {name}",
                f'write valve "a", or add "{side}" to chambers',
            )

    @property
    def spring_law(self) -> tuple[float, float] | None:
        """The return spring's stiffness, Nm/rad or N/m, and its effort against positive motion at
        position 0, Nm or N; None without one."""
        if self.spring is None:
            return None
        stiffness: float = getattr(self.spring, self.units.stiffness)
        preload: float = getattr(self.spring, self.units.preload)
        at_0 = preload + stiffness * 0.5 * (self.travel or 0.0)
        return stiffness, self.supply_way * at_0

    @property
    def is_tank_alone(self) -> bool:
        """Whether it is a tank, with nothing that moves."""
        return self.tank is not None and self.cylinder is None and self.motor is None

    @property
    def held_tank(self) -> Tank | None:
        """The tank that takes a held chamber's place, as no piston is declared; None without."""
        return self.tank if self.cylinder is None else None

    @property
    def is_motor_alone(self) -> bool:
        """Whether a motor alone drives it: neither air nor a cylinder nor valves are declared."""
        return self.air is None and self.cylinder is None and self.valves is None

    @property
    def has_declared_inertia(self) -> bool:
        """Whether the file gives an inertia, and not as an assumed one."""
        return self.total_inertia() is not None and not self.assumes("inertia")

    @property
    def has_declared_motor(self) -> bool:
        """Whether a motor is declared, and not only assumed."""
        return self.motor is not None and not self.assumes("motor")

    def air_alone_drives(self, channels: Container[str]) -> bool:
        """Whether a motion is balanced without an effort: no motor is declared, and the pressure of
        each chamber is logged."""
        logged = all(name in channels for name in CHAMBER_PRESSURES[: len(self.sides)])
        return not self.has_declared_motor and logged

    @property
    def has_declared_encoder(self) -> bool:
        """Whether an encoder's count is declared, and not only assumed."""
        return self.encoder_step is not None and not self.assumes("sensors")

    def assumes(self, section: str) -> bool:
        """Whether a constant of this section was not declared, and no log shows it."""
        return any(key.startswith(f"{section}.") for key in self.assumed)

    def constant(self, key: str) -> Any:
        """The file's value of a dotted key ("cylinder.area_a_m2"); None where it has none."""
        return constant_in(self.content, key)

    def require(self, section: str, why: str) -> Any:
        """The section, or an InputError that says what needs it."""
        value = getattr(self, section)
        if value is None:
            raise input_error(
                self.source,
                f"section [{section}] is missing, {why}",
                f"add it (`sysid init` writes a commented example of [{section}])",
            )
        return value

    def total_inertia(self) -> float | None:
        """Inertia with payload (thesis 3.3.5), kg m2 or kg; None if the file gives none."""
        i, payload = self.inertia, self.payload_inertia()
        if i is None:
            return None
        if self.is_linear:
            return None if i.mass_kg is None else i.mass_kg + payload
        if i.equivalent_kg_m2 is not None:
            return i.equivalent_kg_m2 + payload
        if i.arm_mass_kg is None or i.arm_length_m is None:
            return None
        radius = self.cylinder.pitch_radius_m if self.cylinder else 0.0
        block = (i.block_mass_kg or 0.0) * radius**2
        return i.arm_mass_kg * i.arm_length_m**2 / 3.0 + block + payload

    @property
    def atmosphere_pa(self) -> float | None:
        """The atmosphere's pressure, Pa; None where the file does not give it."""
        return None if self.air is None else self.air.atmospheric_pressure_pa

    @property
    def other_gas(self) -> float | None:
        """The constant of a gas that is not air, J/(kg K); None of air, or where none is given."""
        constant = None if self.air is None else self.air.gas_constant_j_per_kg_k
        is_air = constant is None or _MOIST_AIR[0] <= constant <= _MOIST_AIR[1]
        return None if is_air else constant

    def payload_inertia(self) -> float:
        """What the payload adds to the inertia (thesis 3.3.5), kg m2 or, its mass, kg."""
        if self.inertia is None:
            return 0.0
        lever = 1.0 if self.is_linear else self.inertia.payload_length_m
        return self.inertia.payload_mass_kg * lever**2

    def carrying(self, payload_kg: float | None, by: str = "a log") -> Rig:
        """The rig with another payload, kg (None: its own); `by` names what declares it.

        Raises InputError where the file does not say where the payload is.
        """
        own = 0.0 if self.inertia is None else self.inertia.payload_mass_kg
        if payload_kg is None or payload_kg == own:
            return self
        if self.inertia is None:
            raise input_error(
                self.source,
                f"section [inertia] is missing, but {by} carries a payload",
                "add it, with what moves without the payload",
            )
        said = self.inertia.payload_length_m or "payload_length_m" in self.content.get(
            "inertia", {}
        )
        if not (self.is_linear or said):
            raise input_error(
                self.source,
                f"[inertia] payload_length_m is missing, but {by} carries a payload",
                "add its distance from the shaft",
            )
        inertia = self.inertia.model_copy(update={"payload_mass_kg": payload_kg})
        return dataclasses.replace(self, inertia=inertia)

    def load_of(self, payload_kg: float | None) -> Load:
        """The excess of a payload, kg (None: the rig's own), over the rig's own."""
        other = self.carrying(payload_kg)
        if other is self:
            return NO_LOAD
        gravity = other.gravity_moment() - self.gravity_moment()
        inertia = other.payload_inertia() - self.payload_inertia()
        return Load(inertia, *((0.0, gravity) if self.is_linear else (gravity, 0.0)))

    def gravity_moment(self) -> float:
        """Amplitude of gravity's effort (thesis 3.3.8-3.3.10): Nm, or N on a linear rig.

        Zero in the horizontal. Rotary: the effort is this times sin(theta). Linear: the
        weight itself, acting against positive motion. Raises InputError for a vertical
        rig without the masses that gravity needs.
        """
        if not self.is_vertical:
            return 0.0
        i = self.inertia or _NO_INERTIA
        needed = ("mass_kg",) if self.is_linear else ("arm_mass_kg", "arm_length_m")
        values = [getattr(i, name) for name in needed]
        if None in values:
            raise input_error(
                self.source,
                f"[inertia] {needed[values.index(None)]} is missing, and gravity acts in the "
                "vertical",
                f"add {' and '.join(needed)} under [inertia]",
            )
        if self.is_linear:
            return float(values[0] + i.payload_mass_kg) * GRAVITY_M_PER_S2
        arm = values[0] * values[1] / 2.0
        return float(arm + i.payload_mass_kg * i.payload_length_m) * GRAVITY_M_PER_S2


def find_rig_file(log: Path) -> Path | None:
    """`rig.toml` in the log's folder or the nearest folder above it; None without one.

    Raises InputError for a path that is no file's.
    """
    try:
        is_folder, folder = log.is_dir(), log.resolve().parent
    except OSError as error:
        name = str(log) if len(str(log)) < 200 else f"{str(log)[:80]}..."
        what = f"cannot be opened: {error.strerror}"
        raise input_error(name, what, "give the path of a log") from None
    if is_folder and not is_bag(log):
        raise input_error(log, "is a directory", "give the path of a log in it")
    return nearest_rig_file(folder / log.name)


def require_rig_file(log: Path) -> Path:
    """`find_rig_file`; InputError if none is found."""
    path = find_rig_file(log)
    if path is None:
        raise input_error(
            log,
            f"no {RIG_FILE_NAME} in its folder or any folder above",
            f"give one with --rig, or write one with `sysid init --from {log.name} rig.toml`",
        )
    return path


def nearest_rig_file(log: Path) -> Path | None:
    """`rig.toml` in the file's folder or the nearest folder above it; None without one."""
    folder = log.resolve().parent
    places = (candidate / RIG_FILE_NAME for candidate in (folder, *folder.parents))
    return next((path for path in places if path.is_file()), None)


def read_rig(path: Path) -> Rig:
    """Read and check a rig file. Raises InputError naming the key and the fix."""
    return rig_from_content(read_toml(path, "a rig file"), str(path))


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """A TOML file's tables, or an InputError that names the line."""
    if path.suffix.lower() in (".csv", *PARQUET_SUFFIXES) and path.exists():
        raise input_error(
            path,
            f"is a log, not {what}",
            f"give the path of {what}; one log is fitted by `sysid fit friction`, `valve-discrete` "
            "or `valve-pwm`",
        )
    try:
        raw = path.read_bytes()
        note_input(path)
    except FileNotFoundError:
        raise input_error(path, "no such file", f"give the path of {what}") from None
    except IsADirectoryError:
        raise input_error(path, "is a directory", f"give the path of {what}") from None
    except PermissionError:
        raise input_error(path, "may not be read", "change its permissions") from None
    except OSError as error:
        raise input_error(path, str(error.strerror), f"give the path of {what}") from None
    try:
        return tomllib.loads(raw.decode("utf-8-sig").replace("\r\n", "\n"))
    except UnicodeDecodeError:
        raise input_error(path, "is not UTF-8 text", "save it as UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise input_error(path, f"is not valid TOML: {error}", "fix that line") from None
    except RecursionError:
        raise input_error(path, "is nested too deeply", "write tables and lists flat") from None
    except ValueError as error:  # tomllib passes on what int() says of thousands of digits
        raise input_error(path, f"holds an unusable number: {error}", "shorten it") from None


def name_meant(name: str, known: Sequence[str]) -> str | None:
    """The known name that differs by at most one letter in six; None if no name does."""
    return next(iter(difflib.get_close_matches(name, known, 1, 0.8)), None)


def reject_misspelt(given: Any, known: Any, where: str, source: str) -> list[str]:
    """Notices for unknown keys; an InputError for one close to a known key."""
    notices = []
    for key in given:
        if key in known:
            continue
        meant = name_meant(key, [k for k in known if k not in given])
        if meant is not None:
            raise input_error(source, f"{where}{key} is not a key", f"did you mean {where}{meant}?")
        notices.append(f"{source}: {where}{key} is unknown and is ignored")
    return notices


def rig_from_content(content: dict[str, Any], source: str) -> Rig:
    """Check a rig file's tables (also as stored in a bundle) and build the Rig."""
    notices = reject_misspelt(content, (*RIG_TABLES, ASSUMED), "section ", source)
    if not isinstance(content.get("rig"), dict):
        raise input_error(source, "section [rig] is missing", 'add [rig] with name = "..."')
    found: dict[str, Any] = {
        name: _section(cls, content, source, notices)
        for name, cls in RIG_TABLES.items()
        if name in content
    }
    head: RigHead = found.pop("rig")
    rig = Rig(
        name=head.name,
        orientation=head.orientation,
        motion=head.motion,
        source=source,
        content=content,
        notices=tuple(notices),
        assumed=_assumed(content, source),
        **found,
    )
    _check_together(rig)
    return rig


def _assumed(content: dict[str, Any], source: str) -> tuple[str, ...]:
    """The dotted keys of a file's `assumed`, each a constant that the file holds."""
    keys = content.get(ASSUMED, [])
    if not isinstance(keys, list) or not all(isinstance(key, str) for key in keys):
        raise input_error(
            source, f"{ASSUMED} is not a list of keys", 'write ["cylinder.area_a_m2", ...]'
        )
    for key in keys:
        if constant_in(content, key) is None:
            raise input_error(
                source,
                f"{ASSUMED} names {key}, which the file does not hold",
                f"write section.key of a constant in it, or take {key} out of the list",
            )
    return tuple(keys)


def _section(
    cls: type[TomlSection], content: dict[str, Any], source: str, notices: list[str]
) -> TomlSection:
    table = content[cls.table]
    if not isinstance(table, dict):
        raise input_error(source, f"{cls.table} is not a section", f"write [{cls.table}]")
    notices += reject_misspelt(table, cls.model_fields, f"[{cls.table}] ", source)
    section = cls.from_table(table, source)
    for name in cls.conditional if cls.why_unused else ():
        if name in table and getattr(section, name) != table[name]:
            notices.append(f"{source}: [{cls.table}] {name} is not used: {cls.why_unused}")
    return section


def _check_together(rig: Rig) -> None:
    """Checks that involve several keys."""
    air, cylinder = rig.air, rig.cylinder
    if air is not None and _is_atmosphere(air):
        raise input_error(
            rig.source,
            f"[air] supply_pressure_pa = {air.supply_pressure_pa:g} is not above "
            f"atmospheric_pressure_pa = {air.atmospheric_pressure_pa:g}",
            "give both as absolute pressures (add the atmosphere to a gauge reading)",
        )
    _check_data_sheets(rig)
    carries = rig.inertia is not None and rig.inertia.payload_mass_kg > 0.0
    if carries and not rig.is_linear and "payload_length_m" not in rig.content["inertia"]:
        raise input_error(
            rig.source,
            "[inertia] payload_length_m is missing, but there is a payload",
            "add its distance from the shaft",
        )
    _check_spring(rig)
    # A tank has one chamber, whatever a cylinder would have.
    if rig.bleeds and len(rig.sides) > 1 and rig.held_tank is None:
        raise input_error(
            rig.source,
            '[valves] arrangement = "fill-and-bleed" on a rig with two chambers, of which no model '
            "is made yet",
            'write [cylinder] chambers = ["a"] if there is one, or leave the valves out',
        )
    if cylinder is None:
        return
    if not rig.is_linear and "pitch_radius_m" not in rig.content["cylinder"]:
        raise input_error(
            rig.source,
            "[cylinder] pitch_radius_m is missing",
            'add it, or set [rig] motion = "linear"',
        )
    if rig.is_linear and cylinder.pitch_radius_m != 1.0:
        raise input_error(rig.source, "[cylinder] pitch_radius_m on a linear rig", "remove the key")
    for side, offset in (("a", cylinder.offset_a_m), ("b", cylinder.offset_b_m)):
        if offset <= cylinder.stroke_m / 2:
            raise input_error(
                rig.source,
                f"[cylinder] offset_{side}_m = {offset:g} leaves chamber {side.upper()} without "
                f"volume at the end of the stroke ({cylinder.stroke_m:g} m)",
                f"give an offset above {cylinder.stroke_m / 2:g} m: half the stroke and the "
                "dead length",
            )


def _check_data_sheets(rig: Rig) -> None:
    """ISO 6358's conductance is of air: of another gas a valve passes another volume."""
    if rig.air is None or _AIR[0] <= rig.air.gas_constant_j_per_kg_k <= _AIR[1]:
        return
    for side in filter(rig.data_sheet, SIDES):
        raise input_error(
            rig.source,
            f"[valve_{side}] is a data sheet by ISO 6358, of air, but [air] gas_constant_j_per_kg_k"
            f" = {rig.air.gas_constant_j_per_kg_k:g} is another gas's",
            f"remove [valve_{side}], and record valve-discrete tests with that gas",
        )


def _is_atmosphere(air: Air) -> bool:
    """Whether a supply is neither above the atmosphere nor a vacuum."""
    highest_vacuum = (1.0 - _LEAST_VACUUM) * air.atmospheric_pressure_pa
    return highest_vacuum < air.supply_pressure_pa <= air.atmospheric_pressure_pa


def _check_spring(rig: Rig) -> None:
    """A spring's keys are those of the rig's motion."""
    if rig.spring is None:
        return
    given, u = rig.content["spring"], rig.units
    for foreign, own in ((u.other.stiffness, u.stiffness), (u.other.preload, u.preload)):
        if foreign in given:
            raise input_error(
                rig.source, f"[spring] {foreign} on a {rig.motion} rig", f"give {own} in its place"
            )
    if u.stiffness not in given:
        raise input_error(
            rig.source, f"[spring] {u.stiffness} is missing", "add it; 0 for a constant effort"
        )


def constant_in(content: Mapping[str, Any], key: str) -> Any:
    """A rig file's value of a dotted key; None where it has none."""
    section, _, name = key.partition(".")
    table = content.get(section)
    return table.get(name) if isinstance(table, Mapping) else None


def differing_sections(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """The sections in which two rig files' contents differ, sorted."""
    return [s for s in sorted({*one, *other} - {ASSUMED}) if one.get(s) != other.get(s)]


def require_inertia(rig: Rig) -> float:
    """Total inertia (kg m2, or kg), or an InputError that names the key to add."""
    value = rig.total_inertia()
    if value is None:
        key = f"[inertia] {rig.units.rig_inertia}"
        raise input_error(rig.source, f"{key} is missing", "add it to the rig file")
    return value


__all__ = [
    "ASSUMED",
    "END_MARGIN",
    "GRAVITY_M_PER_S2",
    "NO_LOAD",
    "RIG_FILE_NAME",
    "Air",
    "Cylinder",
    "Inertia",
    "InputError",
    "Load",
    "Motor",
    "Pwm",
    "Rig",
    "RigFile",
    "Sampling",
    "Sensors",
    "Spring",
    "Tank",
    "Valves",
    "constant_in",
    "differing_sections",
    "find_rig_file",
    "name_meant",
    "nearest_rig_file",
    "read_rig",
    "read_toml",
    "reject_misspelt",
    "require_inertia",
    "require_rig_file",
    "rig_from_content",
]
