"""How a request is made: its inputs, and its options, declared once in a dataclass.

Within the package the options are passed whole; a notebook names each by keyword.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from typing import Any, Generic, ParamSpec, Protocol, TypeVar, overload

from sysid.errors import input_error
from sysid.types import Progress, no_progress

Named = ParamSpec("Named")
Given = TypeVar("Given")
Other = TypeVar("Other")
Chosen = TypeVar("Chosen", bound="Options")
Result = TypeVar("Result")
_Given = TypeVar("_Given", contravariant=True)
_Other = TypeVar("_Other", contravariant=True)
_Chosen = TypeVar("_Chosen", contravariant=True)
_Result = TypeVar("_Result", covariant=True)
# What a request may be about, by its class: as a sentence names it, and where one comes from.
_SOURCES = {
    "Campaign": ("campaign", "si.read_campaign reads one from its file"),
    "Bundle": ("bundle", "si.fit finds one, si.read_bundle reads one from its file"),
    "Rig": ("rig", "si.read_rig reads one from its file"),
    "CampaignDiagnosis": ("diagnosis", "si.diagnose makes one"),
    "Model": ("model", "a bundle's model() is one"),
}


@dataclass(frozen=True)
class Options:
    """Options of any request."""

    def those_of(self, kind: type[Chosen], **others: Any) -> Chosen:
        """The options of a request that is part of this one, all of whose fields this has.

        `others` replace them.
        """
        return kind(**{f.name: getattr(self, f.name) for f in fields(kind)} | others)


@dataclass(frozen=True, kw_only=True)
class Reported(Options):
    """Options of a long request: `progress` is called with a line for each step.

    None: a terminal or a notebook shows the lines, a script does not.
    """

    progress: Progress | None = None

    @property
    def tell(self) -> Progress:
        """`progress`, or a function that does nothing."""
        return self.progress or no_progress


class OfOne(Protocol[_Given, _Chosen, Named, _Result]):
    """A request about one thing: its options as one object, or by keyword."""

    @overload
    def __call__(self, given: _Given, options: _Chosen, /) -> _Result: ...
    @overload
    def __call__(
        self, given: _Given, /, *rest: Named.args, **keywords: Named.kwargs
    ) -> _Result: ...


class OfTwo(Protocol[_Given, _Other, _Chosen, Named, _Result]):
    """A request about two things, a campaign and a bundle: likewise."""

    @overload
    def __call__(self, given: _Given, other: _Other, options: _Chosen, /) -> _Result: ...
    @overload
    def __call__(
        self, given: _Given, other: _Other, /, *rest: Named.args, **keywords: Named.kwargs
    ) -> _Result: ...


class takes(Generic[Named, Chosen]):  # noqa: N801 - a decorator
    """Decorates a request: its last argument, of the class `options`, may be given by keyword."""

    def __init__(self, options: Callable[Named, Chosen]) -> None:
        self.options: Any = options

    @overload
    def __call__(
        self, request: Callable[[Given, Chosen], Result]
    ) -> OfOne[Given, Chosen, Named, Result]: ...
    @overload
    def __call__(
        self, request: Callable[[Given, Other, Chosen], Result]
    ) -> OfTwo[Given, Other, Chosen, Named, Result]: ...
    def __call__(self, request: Callable[..., Any]) -> Any:
        whole = inspect.signature(request)
        *given, _ = whole.parameters.values()
        chosen = inspect.signature(self.options).parameters.values()
        by_keyword = whole.replace(parameters=[*given, *chosen])

        @wraps(request)
        def called(*words: Any, **keywords: Any) -> Any:
            if len(words) > len(given) and isinstance(words[-1], self.options):
                return request(*words, **keywords)
            named = by_keyword.bind(*words, **keywords).arguments
            asked = [named.pop(parameter.name) for parameter in given]
            for parameter, value in zip(given, asked, strict=True):
                require(value, parameter.name, *str(parameter.annotation).split(" | "))
            return request(*asked, self.options(**named))

        called.__dict__["__signature__"] = by_keyword
        return called


def require(value: Any, name: str, *kinds: str) -> None:
    """Raises InputError where an argument is of none of these classes, as a path given for it is.

    Of kinds that have no place in `_SOURCES` anything is taken: others check these.
    """
    if not {*kinds} <= {*_SOURCES}:
        return
    if not {*kinds} & {base.__name__ for base in type(value).__mro__}:
        nouns, sources = zip(*(_SOURCES[kind] for kind in kinds), strict=True)
        what = f"{type(value).__name__} is no {' or '.join(nouns)}"
        raise input_error(name, what, "; ".join(sources))


__all__ = ["Options", "Reported", "require", "takes"]
