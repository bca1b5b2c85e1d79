"""The rig file: what is known about a rig before any test (`spec/log-format.md`).

Every value is SI and keeps the unit in its name. A section that a command does not
need may be absent (a bare electric axis has no `[cylinder]`); a section that is there
must be whole.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from sysid.errors import InputError, input_error

GRAVITY_M_PER_S2 = 9.81
RIG_FILE_NAME = "rig.toml"


@dataclass(frozen=True)
class Air:
    """`[air]`: the gas, the ambient and the supply."""

    gas_constant_j_per_kg_k: float
    heat_capacity_ratio: float
    temperature_k: float
    atmospheric_pressure_pa: float
    supply_pressure_pa: float


@dataclass(frozen=True)
class Cylinder:
    """`[cylinder]`: chamber A is (offset_a + y) area_a, chamber B is (offset_b - y) area_b.

    `pitch_radius_m` is 1 on a linear rig, so that y is the position itself.
    """

    area_a_m2: float
    area_b_m2: float
    offset_a_m: float
    offset_b_m: float
    stroke_m: float
    pitch_radius_m: float = 1.0


@dataclass(frozen=True)
class Inertia:
    """`[inertia]`: the equivalent inertia, or the masses and lengths that give it."""

    equivalent_kg_m2: float | None = None
    mass_kg: float | None = None
    arm_mass_kg: float | None = None
    arm_length_m: float | None = None
    block_mass_kg: float | None = None
    payload_mass_kg: float = 0.0
    payload_length_m: float = 0.0


@dataclass(frozen=True)
class Motor:
    """`[motor]`: torque (linear: force) at the output per volt of command, and its limit."""

    torque_per_volt_nm: float | None = None
    max_torque_nm: float | None = None
    force_per_volt_n: float | None = None
    max_force_n: float | None = None


@dataclass(frozen=True)
class Pwm:
    """`[pwm]`: a period starts at every multiple of `period_s` from a test's first row."""

    period_s: float


@dataclass(frozen=True)
class Valves:
    """`[valves]`: declared delays from command to opening and to closing."""

    on_delay_s: float
    off_delay_s: float


@dataclass(frozen=True)
class Tank:
    """`[tank]`: a vessel without a piston; where its volume is a guess, flows scale with it."""

    volume_m3: float


@dataclass(frozen=True)
class Sampling:
    """`[sampling]`: the declared sampling period."""

    period_s: float


@dataclass(frozen=True)
class Sensors:
    """`[sensors]`: optional; what is absent is taken from the data."""

    encoder_counts_per_rev: float | None = None
    encoder_counts_per_m: float | None = None
    encoder_zero_counts: float = 0.0
    pressure_noise_pa: float | None = None


SECTIONS: dict[str, type] = {
    "air": Air,
    "cylinder": Cylinder,
    "inertia": Inertia,
    "motor": Motor,
    "pwm": Pwm,
    "valves": Valves,
    "tank": Tank,
    "sampling": Sampling,
    "sensors": Sensors,
}
RIG_KEYS = ("name", "orientation", "motion")

# Lowest and highest value that a real rig has; what lies outside is a slip of unit.
# The hint names the slip that is made most.
_PLAUSIBLE: dict[str, tuple[float, float, str]] = {
    "gas_constant_j_per_kg_k": (50.0, 5000.0, "J/(kg K): 287.0 for air"),
    "heat_capacity_ratio": (1.0, 1.7, "a ratio: 1.4 for air"),
    "temperature_k": (200.0, 400.0, "kelvin: add 273.15 to degrees Celsius"),
    "atmospheric_pressure_pa": (4e4, 1.2e5, "absolute Pa: about 101325, not kPa or bar"),
    "supply_pressure_pa": (1.05e5, 5e6, "absolute Pa: 3 bar gauge is 400000"),
    "area_a_m2": (1e-7, 0.5, "m2: 452 mm2 is 4.52e-4"),
    "area_b_m2": (1e-7, 0.5, "m2: 452 mm2 is 4.52e-4"),
    "offset_a_m": (1e-5, 10.0, "m: 75 mm is 0.075"),
    "offset_b_m": (1e-5, 10.0, "m: 75 mm is 0.075"),
    "stroke_m": (1e-4, 10.0, "m: 127 mm is 0.127"),
    "pitch_radius_m": (1e-4, 2.0, "m: 37.5 mm is 0.0375"),
    "equivalent_kg_m2": (1e-8, 1e4, "kg m2"),
    "mass_kg": (1e-4, 1e5, "kg"),
    "arm_mass_kg": (0.0, 1e4, "kg"),
    "arm_length_m": (0.0, 20.0, "m"),
    "block_mass_kg": (0.0, 1e4, "kg"),
    "payload_mass_kg": (0.0, 1e4, "kg"),
    "payload_length_m": (0.0, 20.0, "m"),
    "torque_per_volt_nm": (1e-9, 1e6, "Nm/V, positive"),
    "max_torque_nm": (1e-6, 1e6, "Nm, positive"),
    "force_per_volt_n": (1e-9, 1e7, "N/V, positive"),
    "max_force_n": (1e-6, 1e7, "N, positive"),
    "volume_m3": (1e-9, 1e3, "m3: 1 litre is 0.001"),
    "on_delay_s": (0.0, 0.5, "s: 1.7 ms is 0.0017"),
    "off_delay_s": (0.0, 0.5, "s: 2 ms is 0.002"),
    "encoder_counts_per_rev": (1.0, 1e9, "counts a revolution"),
    "encoder_counts_per_m": (1.0, 1e12, "counts a metre"),
    "encoder_zero_counts": (-1e12, 1e12, "counts"),
    "pressure_noise_pa": (0.0, 1e5, "Pa"),
}
_PLAUSIBLE_PERIOD = {
    "pwm": (1e-5, 5.0, "s: 5 ms is 0.005"),
    "sampling": (1e-6, 10.0, "s: 1 ms is 0.001"),
}

_Section = TypeVar("_Section")


@dataclass(frozen=True)
class Rig:
    """A rig: constants by section, SI. Sections that the file does not hold are None.

    `source` is the file that it was read from; `content` the file's tables as read, which
    go into a bundle; `notices` what the reader wants said.
    """

    name: str
    orientation: str
    motion: str
    air: Air | None = None
    cylinder: Cylinder | None = None
    inertia: Inertia | None = None
    motor: Motor | None = None
    pwm: Pwm | None = None
    valves: Valves | None = None
    tank: Tank | None = None
    sampling: Sampling | None = None
    sensors: Sensors = Sensors()
    source: str = "rig"
    content: dict[str, Any] = dataclasses.field(default_factory=dict, compare=False)
    notices: tuple[str, ...] = ()

    @property
    def is_linear(self) -> bool:
        """Whether position is in metres and effort in newtons."""
        return self.motion == "linear"

    @property
    def is_vertical(self) -> bool:
        """Whether gravity acts."""
        return self.orientation == "vertical"

    @property
    def position_channel(self) -> str:
        """`position_m` on a linear rig, else `theta_rad`."""
        return "position_m" if self.is_linear else "theta_rad"

    @property
    def effort_channel(self) -> str:
        """`motor_force_n` on a linear rig, else `motor_torque_nm`."""
        return "motor_force_n" if self.is_linear else "motor_torque_nm"

    @property
    def max_effort(self) -> float | None:
        """The motor's declared limit at the output, N or Nm; None if not declared."""
        if self.motor is None:
            return None
        return self.motor.max_force_n if self.is_linear else self.motor.max_torque_nm

    @property
    def effort_per_volt(self) -> float | None:
        """Motor effort per volt of command, N/V or Nm/V; None if not declared."""
        if self.motor is None:
            return None
        return self.motor.force_per_volt_n if self.is_linear else self.motor.torque_per_volt_nm

    @property
    def travel(self) -> float | None:
        """Whole stroke in position units, rad or m; None without a cylinder."""
        if self.cylinder is None:
            return None
        return self.cylinder.stroke_m / self.cylinder.pitch_radius_m

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
        i = self.inertia
        if i is None:
            return None
        if self.is_linear:
            return None if i.mass_kg is None else i.mass_kg + i.payload_mass_kg
        payload = i.payload_mass_kg * i.payload_length_m**2
        if i.equivalent_kg_m2 is not None:
            return i.equivalent_kg_m2 + payload
        if i.arm_mass_kg is None or i.arm_length_m is None:
            return None
        radius = self.cylinder.pitch_radius_m if self.cylinder else 0.0
        block = (i.block_mass_kg or 0.0) * radius**2
        return i.arm_mass_kg * i.arm_length_m**2 / 3.0 + block + payload

    def gravity_moment(self) -> float:
        """Amplitude of gravity's effort (thesis 3.3.8-3.3.10): Nm, or N on a linear rig.

        Zero in the horizontal. Rotary: the effort is this times sin(theta). Linear: the
        weight itself, acting against positive motion. Raises InputError where the rig stands
        upright and the masses that gravity needs are not given.
        """
        if not self.is_vertical:
            return 0.0
        i = self.inertia or Inertia()
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


def find_rig_file(log: Path) -> Path:
    """`rig.toml` in the log's folder or the nearest folder above it.

    Raises InputError where there is none.
    """
    try:
        is_folder, folder = log.is_dir(), log.resolve().parent
    except OSError as error:
        name = str(log) if len(str(log)) < 200 else f"{str(log)[:80]}..."
        what = f"cannot be opened: {error.strerror}"
        raise input_error(name, what, "give the path of a log") from None
    if is_folder:
        raise input_error(log, "is a directory", "give the path of a log in it")
    path = nearest_rig_file(folder / log.name)
    if path is None:
        raise input_error(
            log,
            f"no {RIG_FILE_NAME} in its folder or any folder above",
            "name one with --rig, or write one with `sysid init rig.toml`",
        )
    return path


def nearest_rig_file(log: Path) -> Path | None:
    """`rig.toml` in the file's folder or the nearest folder above it; None without one."""
    folder = log.resolve().parent
    places = (candidate / RIG_FILE_NAME for candidate in (folder, *folder.parents))
    return next((path for path in places if path.is_file()), None)


def read_rig(path: Path) -> Rig:
    """Read and check a rig file. Raises InputError naming the key and the mend."""
    return rig_from_content(read_toml(path, "a rig file"), str(path))


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """A TOML file's tables, or an InputError that names the line."""
    try:
        raw = path.read_bytes()
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
        raise input_error(path, f"is not valid TOML: {error}", "mend that line") from None


def reject_misspelt(given: Any, known: Any, where: str, source: str) -> list[str]:
    """Notices for keys that nobody knows; an InputError for one close to a known key."""
    notices = []
    for key in given:
        if key in known:
            continue
        close = difflib.get_close_matches(key, [k for k in known if k not in given], 1, 0.8)
        if close:
            raise input_error(
                source, f"{where}{key} is not a key", f"did you mean {where}{close[0]}?"
            )
        notices.append(f"{source}: {where}{key} is not known and is ignored")
    return notices


def rig_from_content(content: dict[str, Any], source: str) -> Rig:
    """Check a rig file's tables (also as kept in a bundle) and build the Rig."""
    notices = reject_misspelt(content, ("rig", *SECTIONS), "section ", source)
    head = content.get("rig")
    if not isinstance(head, dict):
        raise input_error(source, "section [rig] is missing", 'add [rig] with name = "..."')
    notices += reject_misspelt(head, RIG_KEYS, "[rig] ", source)
    motion = _choice(head, "motion", ("rotary", "linear"), "rotary", source)
    orientation = _choice(head, "orientation", ("horizontal", "vertical"), None, source)
    name = head.get("name", "rig")
    if not isinstance(name, str):
        raise input_error(source, f"[rig] name = {name!r} is not text", "put it in quotes")
    sections: dict[str, Any] = {}
    for key, cls in SECTIONS.items():
        if key in content:
            table = content[key]
            if not isinstance(table, dict):
                raise input_error(source, f"{key} is not a section", f"write [{key}]")
            sections[key] = _section(cls, key, table, source, notices)
    rig = Rig(
        name=name,
        orientation=orientation,
        motion=motion,
        source=source,
        content=content,
        notices=tuple(notices),
        **sections,
    )
    _check_together(rig)
    return rig


def _choice(
    table: dict[str, Any], key: str, allowed: tuple[str, ...], default: str | None, source: str
) -> str:
    if key not in table and default is not None:
        return default
    value = table.get(key)
    if value not in allowed:
        what = f"[rig] {key} is missing" if value is None else f"[rig] {key} = {value!r} is unknown"
        raise input_error(source, what, f"write one of {', '.join(map(repr, allowed))}")
    return str(value)


def _section(
    cls: type[_Section], section: str, table: dict[str, Any], source: str, notices: list[str]
) -> _Section:
    fields = {f.name: f for f in dataclasses.fields(cls)}  # type: ignore[arg-type]
    notices += reject_misspelt(table, fields, f"[{section}] ", source)
    values: dict[str, float] = {}
    for name, field in fields.items():
        if name not in table:
            if field.default is dataclasses.MISSING:
                raise input_error(
                    source,
                    f"[{section}] {name} is missing",
                    f"add `{name} = ...` under [{section}] ({_hint(section, name)})",
                )
            continue
        values[name] = _number(table[name], section, name, source)
    return cls(**values)


def _hint(section: str, name: str) -> str:
    if name == "period_s":
        return _PLAUSIBLE_PERIOD[section][2]
    return _PLAUSIBLE[name][2]


def _number(value: Any, section: str, name: str, source: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise input_error(
            source, f"[{section}] {name} = {value!r} is not a number", "write it without quotes"
        )
    low, high, hint = _PLAUSIBLE_PERIOD[section] if name == "period_s" else _PLAUSIBLE[name]
    if not math.isfinite(value) or not low <= value <= high:
        raise input_error(
            source,
            f"[{section}] {name} = {value:g} is not plausible (expected {low:g} to {high:g})",
            f"give it in {hint}",
        )
    return float(value)


def _check_together(rig: Rig) -> None:
    """What no key alone can show."""
    air, cylinder = rig.air, rig.cylinder
    if air is not None and air.supply_pressure_pa <= air.atmospheric_pressure_pa:
        raise input_error(
            rig.source,
            f"[air] supply_pressure_pa = {air.supply_pressure_pa:g} is not above "
            f"atmospheric_pressure_pa = {air.atmospheric_pressure_pa:g}",
            "give both as absolute pressures (add the atmosphere to a gauge reading)",
        )
    carries = rig.inertia is not None and rig.inertia.payload_mass_kg > 0.0
    if carries and not rig.is_linear and "payload_length_m" not in rig.content["inertia"]:
        raise input_error(
            rig.source,
            "[inertia] payload_length_m is missing, and there is a payload",
            "add its distance from the shaft",
        )
    if cylinder is None:
        return
    if not rig.is_linear and "pitch_radius_m" not in rig.content["cylinder"]:
        raise input_error(
            rig.source,
            "[cylinder] pitch_radius_m is missing",
            'add it, or say [rig] motion = "linear"',
        )
    if rig.is_linear and cylinder.pitch_radius_m != 1.0:
        raise input_error(rig.source, "[cylinder] pitch_radius_m on a linear rig", "remove the key")
    for side, offset in (("a", cylinder.offset_a_m), ("b", cylinder.offset_b_m)):
        if offset <= cylinder.stroke_m / 2:
            raise input_error(
                rig.source,
                f"[cylinder] offset_{side}_m = {offset:g} leaves chamber {side.upper()} no "
                f"volume at the end of the stroke ({cylinder.stroke_m:g} m)",
                f"give an offset above {cylinder.stroke_m / 2:g} m: half the stroke and the "
                "dead length",
            )


def require_inertia(rig: Rig) -> float:
    """Total inertia (kg m2, or kg), or an InputError that names the key to add."""
    value = rig.total_inertia()
    if value is None:
        key = "mass_kg" if rig.is_linear else "equivalent_kg_m2"
        raise input_error(rig.source, f"[inertia] {key} is missing", "add it to the rig file")
    return value


__all__ = [
    "GRAVITY_M_PER_S2",
    "RIG_FILE_NAME",
    "Air",
    "Cylinder",
    "Inertia",
    "InputError",
    "Motor",
    "Pwm",
    "Rig",
    "Sampling",
    "Sensors",
    "Tank",
    "Valves",
    "find_rig_file",
    "nearest_rig_file",
    "read_rig",
    "read_toml",
    "reject_misspelt",
    "require_inertia",
    "rig_from_content",
]
