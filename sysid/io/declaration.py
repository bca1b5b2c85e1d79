"""One declaration per key of the TOML files: unit, bounds, description, example, error lines.

A file's tables are pydantic models whose fields carry a `Key` in their annotation. All other
uses of a key follow from it: the check and its error line, the line of the template that
`sysid init` writes, and the JSON schema (`model_json_schema()`).

Reading a file does not use pydantic's validators: `checked` reports the first fault in the
order of the fields, in the project's wording, and the values need no second check. The
validators are therefore built only where a model is constructed by its name, or validated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict
from pydantic.fields import FieldInfo

from sysid.errors import escaped, input_error

Motion = Literal["rotary", "linear"]


@dataclass(frozen=True)
class TemplateLine:
    """A key's line in the template: its value as written, and the comment behind it.

    `motion` names the template that contains it (None: both); `optional` lines are
    themselves comments.
    """

    value: str
    comment: str = ""
    motion: Motion | None = None
    optional: bool = False


@dataclass(frozen=True)
class Range:
    """Lowest and highest value that a real rig has; a value outside is a wrong unit.

    `hint` names the most frequent mistake; empty: the unit alone is named.
    """

    lower: float
    upper: float
    unit: str
    hint: str = ""

    @property
    def fix(self) -> str:
        """What to write instead of a value outside the range."""
        return self.hint or self.unit

    def holds(self, value: float) -> bool:
        """Whether the value is finite and within."""
        return math.isfinite(value) and self.lower <= value <= self.upper


@dataclass(frozen=True)
class Key:
    """The declaration of a key: the base of numbers, choices and texts."""

    description: str

    def check(self, value: Any, where: str, source: str) -> Any:
        """The value as stored. Raises InputError for one that cannot be used."""
        raise NotImplementedError

    def missing(self, name: str, table: str) -> tuple[str, str]:
        """The error of an absent required key, and how to fix it."""
        return f"[{table}] {name} is missing", f"add it under [{table}]"

    def schema(self) -> dict[str, Any]:
        """The key's JSON schema in addition to the type."""
        return {"description": self.description}

    def line(self, motion: Motion) -> TemplateLine | None:
        """The line in the template for rigs of this motion; None without one."""
        return None


@dataclass(frozen=True)
class NumberKey(Key):
    """A number and its range; without `example` the template omits the key."""

    range: Range
    example: TemplateLine | None = None

    def check(self, value: Any, where: str, source: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            what = f"{where} = {value!r} is not a number"
            raise input_error(source, what, "write it without quotes")
        number, limits = _as_float(value), self.range
        if not limits.holds(number):
            expected = f"(expected {limits.lower:g} to {limits.upper:g})"
            what = f"{where} = {number:g} is not plausible {expected}"
            raise input_error(source, what, f"give it in {limits.fix}")
        return number

    def missing(self, name: str, table: str) -> tuple[str, str]:
        what, _ = super().missing(name, table)
        return what, f"add `{name} = ...` under [{table}] ({self.range.fix})"

    def schema(self) -> dict[str, Any]:
        limits = self.range
        said = {"unit": limits.unit, "minimum": limits.lower, "maximum": limits.upper}
        shown = {"examples": [float(self.example.value)]} if self.example else {}
        return super().schema() | said | shown

    def line(self, motion: Motion) -> TemplateLine | None:
        example = self.example
        return example if example is not None and example.motion in (None, motion) else None


@dataclass(frozen=True)
class ChoiceKey(Key):
    """One of several choices."""

    allowed: tuple[str, ...]
    examples: tuple[TemplateLine, ...] = ()

    def check(self, value: Any, where: str, source: str) -> str:
        if value not in self.allowed:
            raise input_error(source, f"{where} = {value!r} is unknown", self._choices())
        return str(value)

    def missing(self, name: str, table: str) -> tuple[str, str]:
        return super().missing(name, table)[0], self._choices()

    def line(self, motion: Motion) -> TemplateLine | None:
        return next((one for one in self.examples if one.motion in (None, motion)), None)

    def _choices(self) -> str:
        return f"write one of {', '.join(map(repr, self.allowed))}"


@dataclass(frozen=True)
class ListKey(Key):
    """A list of names, one of several lists."""

    allowed: tuple[tuple[str, ...], ...]

    def check(self, value: Any, where: str, source: str) -> tuple[str, ...]:
        if not isinstance(value, list | tuple) or tuple(value) not in self.allowed:
            shown = " or ".join(str(list(one)).replace("'", '"') for one in self.allowed)
            raise input_error(source, f"{where} = {value!r} is unknown", f"write {shown}")
        return tuple(value)


@dataclass(frozen=True)
class WaysKey(Key):
    """A number of each direction of a valve, as a table `{fill = ..., exhaust = ...}`."""

    range: Range

    def check(self, value: Any, where: str, source: str) -> tuple[float, float]:
        ways = ("fill", "exhaust")
        if not isinstance(value, dict) or set(value) != set(ways):
            what = f"{where} = {value!r} is not a number of each direction"
            raise input_error(source, what, "write {fill = ..., exhaust = ...}")
        number = NumberKey(self.description, self.range)
        fill, exhaust = (number.check(value[way], f"{where}.{way}", source) for way in ways)
        return fill, exhaust

    def missing(self, name: str, table: str) -> tuple[str, str]:
        what, _ = super().missing(name, table)
        fix = f"add `{name} = {{fill = ..., exhaust = ...}}` under [{table}] ({self.range.fix})"
        return what, fix

    def schema(self) -> dict[str, Any]:
        limits = self.range
        one = {"type": "number", "minimum": limits.lower, "maximum": limits.upper}
        ways = {"fill": one, "exhaust": one}
        said = {"type": "object", "unit": limits.unit, "properties": ways, "required": list(ways)}
        return super().schema() | said


LONGEST_TEXT = 200


@dataclass(frozen=True)
class TextKey(Key):
    """Any text."""

    example: TemplateLine | None = None

    def check(self, value: Any, where: str, source: str) -> str:
        if not isinstance(value, str):
            raise input_error(source, f"{where} = {value!r} is not text", "put it in quotes")
        plain = escaped(value) == value
        if len(value) > LONGEST_TEXT or not plain:
            fault = "too long" if plain else "not plain text (control characters)"
            fix = f"at most {LONGEST_TEXT} characters" if plain else "remove these characters"
            raise input_error(source, f"{where} = {value!r} is {fault}", fix)
        return value

    def line(self, motion: Motion) -> TemplateLine | None:
        return self.example


def _as_float(value: int | float) -> float:
    try:
        return float(value)
    except OverflowError:  # TOML's integers are unlimited here
        return math.inf if value > 0 else -math.inf


def _plain_schema(schema: dict[str, Any], model: type[BaseModel]) -> None:
    """Each key as a file may hold it: TOML has no null, and a title only repeats the name."""
    schema.pop("title", None)
    if conditional := getattr(model, "conditional", ()):
        schema["required"] = [name for name in schema["required"] if name not in conditional]
    for name, field in model.model_fields.items():
        shown = schema["properties"][name]
        shown.pop("title", None)
        if shown.get("default", ...) is None:
            del shown["default"]
        choices = [c for c in shown.pop("anyOf", ()) if c.get("type") != "null"]
        shown.update(*choices)
        if (key := key_of(field)) is not None:
            shown.update(key.schema())


class TomlTable(BaseModel):
    """A table of a TOML file."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", defer_build=True, json_schema_extra=_plain_schema
    )


class TomlSection(TomlTable):
    """A section whose every key is declared by a `Key`; `table` is its name in the file."""

    table: ClassVar[str]
    conditional: ClassVar[tuple[str, ...]] = ()
    """Keys without a default that other keys may make superfluous (`without`)."""
    why_unused: ClassVar[str] = ""
    """Why one of them is then not used though a file has it; empty: it is kept."""

    @classmethod
    def without(cls, name: str, values: dict[str, Any]) -> Any:
        """What stands for an absent key by the choices in `values`; None: it is needed."""
        return None

    def __init__(self, **values: Any) -> None:
        """Keys by name; None stands for an absent one. Raises InputError as a file would."""
        given = {name: value for name, value in values.items() if value is not None}
        super().__init__(**given | checked(type(self), given, type(self).__name__))

    @classmethod
    def from_table(cls, table: dict[str, Any], source: str) -> Self:
        """A section as read from `source`; unknown keys are ignored.

        Raises InputError for the first key that is missing or cannot be used.
        """
        return cls.model_construct(**checked(cls, table, source))


def key_of(field: FieldInfo) -> Key | None:
    """The declaration of a field; None for one that holds a table."""
    return next((m for m in field.metadata if isinstance(m, Key)), None)


def range_of(model: type[BaseModel], name: str) -> Range:
    """The range of a table's numeric key. Raises TypeError for any other key."""
    declared = key_of(model.model_fields[name])
    if not isinstance(declared, NumberKey):
        raise TypeError(f"{name} is not a number")
    return declared.range


def declared_keys(model: type[BaseModel]) -> dict[str, Key]:
    """The declaration of each key that has one, by name."""
    found = {name: key_of(field) for name, field in model.model_fields.items()}
    return {name: key for name, key in found.items() if key is not None}


def checked(model: type[TomlSection], table: dict[str, Any], source: str) -> dict[str, Any]:
    """A section's values, checked. Raises InputError for the first fault.

    Choices go first: they decide how the rest is read.
    """
    keys = declared_keys(model)
    values: dict[str, Any] = {}
    for name in sorted(keys, key=lambda n: not isinstance(keys[n], ChoiceKey | ListKey)):
        if name in table:
            values[name] = keys[name].check(table[name], f"[{model.table}] {name}", source)
        elif (stand_in := model.without(name, values)) is not None:
            values[name] = stand_in
        elif model.model_fields[name].is_required():
            raise input_error(source, *keys[name].missing(name, model.table))
    return values


__all__ = [
    "ChoiceKey",
    "Key",
    "ListKey",
    "Motion",
    "NumberKey",
    "Range",
    "TemplateLine",
    "TextKey",
    "TomlSection",
    "TomlTable",
    "WaysKey",
    "checked",
    "declared_keys",
    "key_of",
]
