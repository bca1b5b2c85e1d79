"""The base of a bundle's parts: typed fields, nothing lost, the order of the file."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeAlias, TypeVar, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    PrivateAttr,
    SerializerFunctionWrapHandler,
    Strict,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    model_serializer,
    model_validator,
)
from pydantic.functional_validators import ModelWrapValidatorHandler
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import core_schema

from sysid.estimation.linear import Estimate

Number = Annotated[
    Annotated[int, Strict()] | Annotated[float, Strict()], WithJsonSchema({"type": "number"})
]
"""A number as in the file: an integer stays an integer, and text ("NaN") is not a number."""


_MACHINERY = frozenset(dir(BaseModel))


class Part(BaseModel):
    """A part of a bundle. Keys without a field are kept, as is the order of all keys.

    A field that was not given is None and is not written.
    """

    model_config = ConfigDict(
        extra="allow",
        frozen=True,
        arbitrary_types_allowed=True,
        protected_namespaces=(),
        # A class is made ready when it is used: a tenth of a second at the start of each command.
        defer_build=True,
    )

    _order: tuple[str, ...] = PrivateAttr(())

    def __dir__(self) -> list[str]:
        """What a part of a bundle has, without what is private and pydantic's own machinery."""
        names = {*super().__dir__(), *(self.model_extra or ())}
        return sorted(n for n in names - _MACHINERY if not n.startswith("_"))

    @model_validator(mode="wrap")
    @classmethod
    def _remember_order(
        cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo
    ) -> Self:
        if (
            isinstance(info.context, FileContext)
            and isinstance(data, dict)
            and not info.context.within
        ):
            cls._check_form(data)
        made = handler(data)
        if isinstance(data, dict) and not made._order:
            made._order = tuple(data)
        return made

    @model_serializer(mode="wrap")
    def _in_order(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        content = handler(self)
        return {key: content[key] for key in self.given()}

    @classmethod
    def _check_form(cls, data: Mapping[str, Any]) -> None:
        """ValueError where the schema refuses a file's object that the types accept."""
        for name, field in cls.model_fields.items():
            key = field.alias or name
            form = (field.annotation, *get_args(field.annotation), *field.metadata)
            said = [m for one in form for m in getattr(one, "__metadata__", ())]
            if key not in data or any(isinstance(m, _OrUnread) for m in (*form, *said)):
                continue
            if data[key] is None and any(type(m) is SkipJsonSchema for m in said):
                raise ValueError(f"{key} is null")
            if Estimate in form:
                held = data[key] if get_origin(field.annotation) is dict else {key: data[key]}
                if not all(map(is_written_estimate, held.values())):
                    raise ValueError(f"{key} is not a parameter")

    def given(self) -> tuple[str, ...]:
        """The keys that were given, in the file's order, then those added later."""
        names = {field.alias or name: name for name, field in type(self).model_fields.items()}
        given = self.model_fields_set
        kept = [key for key in self._order if names.get(key, key) in given]
        added = [key for key, name in names.items() if name in given]
        return tuple(dict.fromkeys([*kept, *added, *(self.model_extra or {})]))

    def to_json(self) -> dict[str, Any]:
        """The part as the file holds it."""
        return self.model_dump(by_alias=True)

    def replaced(self, **fields: Any) -> Self:
        """A copy with other values in these fields."""
        return self.model_copy(update=fields)

    def without(self, *names: str) -> Self:
        """A copy without these fields."""
        made = self.model_copy(update=dict.fromkeys(names))
        made.__pydantic_fields_set__.difference_update(names)
        return made

    def overlaid(self, other: Self) -> Self:
        """A copy updated with the content of `other`, level by level."""
        fields = {}
        for key in other.given():
            old, new = getattr(self, key, None), getattr(other, key)
            if isinstance(old, Part) and isinstance(new, Part):
                new = old.overlaid(new)
            fields[key] = new
        return self.replaced(**fields)

    def estimates(self) -> dict[str, Estimate]:
        """The fitted numbers of this part by key, in its order."""
        values = {key: getattr(self, key) for key in self.given() if key.isidentifier()}
        return {key: value for key, value in values.items() if isinstance(value, Estimate)}


@dataclass
class FileContext:
    """State while a file's content is validated; `within` counts enclosing lenient fields, whose
    form is free."""

    within: int = 0


def is_written_estimate(content: Any) -> bool:
    """Whether a file's object is an `Estimate` as the schema has it."""
    if not isinstance(content, Mapping) or content.get("value", _NOTHING) is _NOTHING:
        return False
    if content["value"] is None:
        return content.get("identified") is False and isinstance(content.get("reason"), str)
    std = content.get("std", _NOTHING)
    known = std is None or (isinstance(std, int | float) and not std < 0.0)
    # The interval's form is what `Estimate.from_json` refuses.
    return known and isinstance(content.get("unit"), str)


_NOTHING = object()


@dataclass(frozen=True)
class Unread:
    """Content in another form than sysid writes, kept as it is in the file."""

    value: Any


def read_number(value: int | float | Unread | None) -> float | None:
    """The number of a lenient field; None without one."""
    return float(value) if isinstance(value, int | float) else None


@dataclass(frozen=True)
class _OrUnread:
    """Marks a field whose content is kept as `Unread` where it does not match the field's type.

    `form` is all that the JSON schema requires of it.
    """

    form: tuple[tuple[str, str], ...] = ()

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        return core_schema.with_info_wrap_validator_function(
            functools.partial(_or_unread, is_object=bool(self.form)),
            handler(source),
            serialization=core_schema.wrap_serializer_function_ser_schema(_written),
        )

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return dict(self.form)


def _or_unread(
    value: Any,
    handler: Callable[[Any], Any],
    info: core_schema.ValidationInfo,
    *,
    is_object: bool,
) -> Any:
    if isinstance(value, Unread):
        return value
    reading = info.context if isinstance(info.context, FileContext) else FileContext(within=1)
    if is_object and not reading.within and not isinstance(value, Mapping):
        raise ValueError("is not an object")
    reading.within += 1
    try:
        return handler(value)
    except ValidationError:
        return Unread(value)
    finally:
        reading.within -= 1


def _written(value: Any, handler: SerializerFunctionWrapHandler) -> Any:
    return value.value if isinstance(value, Unread) else handler(value)


if TYPE_CHECKING:
    T = TypeVar("T")
    Absent: TypeAlias = T | None
    Lenient: TypeAlias = T | Unread
else:

    class Absent:
        """`Absent[T]`: a T, or the key is absent; null is an error."""

        def __class_getitem__(cls, kind: Any) -> Any:
            return kind | SkipJsonSchema[None]

    class Lenient:
        """`Lenient[T]`: a T, or any other content as `Unread`."""

        def __class_getitem__(cls, kind: Any) -> Any:
            is_part = isinstance(kind, type) and issubclass(kind, Part)
            form = (("type", "object"),) if is_part else ()
            return Annotated[kind, _OrUnread(form)]


__all__ = ["Absent", "FileContext", "Lenient", "Number", "Part", "Unread", "read_number"]
