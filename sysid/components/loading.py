"""A component of the user's own, from its file or class: checked, and tried once at its start."""

from __future__ import annotations

import functools
import hashlib
import inspect
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from keyword import iskeyword
from pathlib import Path
from typing import Any

import numpy as np

from sysid.components.definition import (
    DynamicComponent,
    LogColumn,
    OwnComponent,
    StaticComponent,
    Term,
    outputs_of,
)
from sysid.errors import InputError, SysidError, input_error
from sysid.estimation.nonlinear import Parameter
from sysid.io.campaign import KINDS, Campaign, kinds_named, read_campaign
from sysid.io.own_kind import OwnKind
from sysid.io.tables import read_bytes
from sysid.io.units import check_unit
from sysid.io.user_code import error_in_file, run_file
from sysid.plant.effects.entry import CatalogueEffect, Quantity

ComponentSource = str | Path | OwnComponent | type[OwnComponent]
"""A component of the user's own: `FILE.py`, `FILE.py:CLASS`, its class, or an object of it."""

_DERIVE = "derive it from sysid.components.StaticComponent or DynamicComponent"
_TRIED_AT = np.array([0.25, 0.75])
# A term becomes an effect of the catalogue, whose attributes its quantities may not hide.
_TAKEN = set(dir(CatalogueEffect)).union(*map(inspect.get_annotations, CatalogueEffect.__mro__))


@dataclass(frozen=True)
class LoadedComponent(OwnKind):
    """A component that has passed the checks. `file` and `sha256` are empty for one without a file.

    `path` is its file, to name lines of it.
    """

    definition: OwnComponent
    file: str = ""
    sha256: str = ""
    path: Path | None = None

    @property
    def held(self) -> tuple[str, ...]:
        columns = self.definition.columns
        return tuple(n for n, c in columns.items() if c.role == "input" and c.between == "held")

    @property
    def numbers(self) -> dict[str, str]:
        return {p.name: p.unit for p in self.definition.parameters}

    @property
    def defined_in(self) -> str:
        return self.file

    @property
    def name(self) -> str:
        """The class's name."""
        return type(self.definition).__name__

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process runs the file again: what it defines cannot be imported there."""
        if self.path is None:
            fields = (self.kind, self.columns, self.definition, self.file, self.sha256, self.path)
            return type(self), fields
        return _again, (str(self.path), self.name, self.sha256)

    def error(self, error: BaseException) -> InputError:
        """The InputError for what the user's code raised."""
        return error_in_file(error, self.path or Path(_source_of(type(self.definition))))


def with_component(path: str | Path, component: ComponentSource) -> Campaign:
    """Read a campaign whose logs are of a component of the user's own. Runs its file.

    Of several components in one file that of the campaign's logs is taken. Raises InputError where
    the file does not run, a component is incomplete, or the campaign has no log of one or logs of
    other kinds.
    """
    path = Path(path)
    kinds = sorted(set(kinds_named(path)))
    offered = _offered(component)
    known = [c.kind for c in offered]
    chosen = next((c for c in offered if c.kind in kinds), None)
    if chosen is None:
        raise input_error(
            path,
            f"has no log of kind {' or '.join(known)}, but of {' and '.join(kinds) or 'none'}",
            f'give the logs of {offered[0].name} kind = "{known[0]}"',
        )
    campaign = read_campaign(path, chosen)
    others = [kind for kind in kinds if kind != chosen.kind]
    if others:
        raise input_error(
            path,
            f"holds logs of kinds {' and '.join((chosen.kind, *others))}",
            "give each kind its own campaign",
        )
    return campaign


def one_component(component: ComponentSource) -> LoadedComponent:
    """The component of a source, checked. Runs its file.

    Raises InputError where the file does not run, a component is incomplete, or it holds several.
    """
    offered = _offered(component)
    if len(offered) > 1:
        names = [one.name for one in offered]
        raise input_error(
            str(component),
            f"defines {len(names)} components, {', '.join(names)}",
            f"name one: --component {component}:{names[0]}",
        )
    return offered[0]


def component_in(campaign: Campaign) -> LoadedComponent | None:
    """The component of the user's own that a campaign was read with."""
    return campaign.own if isinstance(campaign.own, LoadedComponent) else None


@functools.cache
def _again(path: str, name: str, sha256: str) -> LoadedComponent:
    """The component loaded anew in a worker, which may hold an earlier state of the file."""
    found = _of_file(f"{path}:{name}")[0]
    if found.sha256 != sha256:
        raise input_error(path, "has changed since it was read", "read the campaign again")
    return found


def _offered(component: ComponentSource) -> list[LoadedComponent]:
    """The components of a source, at least one, checked."""
    if isinstance(component, str | Path):
        return _of_file(str(component))
    made = component
    if isinstance(component, type):
        made = _made(component, None, f"class {component.__name__}")
    if not isinstance(made, OwnComponent):
        raise input_error("component", f"{component!r} is not a component", _DERIVE)
    return [_checked(made, None)]


def _of_file(text: str) -> list[LoadedComponent]:
    file, _, name = text.rpartition(":")
    path, name = (Path(file), name) if name.isidentifier() and file else (Path(text), "")
    module = run_file(path, "a component")
    own = {
        key: value
        for key, value in vars(module).items()
        if _is_component(value) and value.__module__ == module.__name__
    }
    if name and name not in own:
        hint = f"it defines {', '.join(own)}" if own else _DERIVE
        raise input_error(path, f"defines no component {name}", hint)
    complete = {k: v for k, v in own.items() if k == name or (not name and _is_complete(v))}
    if not complete:
        missing = [f"class {k} lacks {', '.join(_lacking(v))}" for k, v in own.items()]
        what = missing[0] if missing else "defines no component"
        raise input_error(path, what, "add it" if missing else _DERIVE)
    once = {v: k for k, v in complete.items()}  # a class may have several names
    found = [_checked(_made(v, path, f"{path}, class {k}"), path) for v, k in once.items()]
    kinds = [c.kind for c in found]
    for one in found:
        if kinds.count(one.kind) > 1:
            raise input_error(
                path, f"several components take the kind {one.kind}", "give each its own"
            )
    return found


def _is_component(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, OwnComponent)


def _is_complete(cls: type[OwnComponent]) -> bool:
    return not _lacking(cls)


def _lacking(cls: type[OwnComponent]) -> list[str]:
    """Attributes and methods that a class does not have."""
    wanted = ["kind", "columns", "parameters"]
    wanted += ["states"] if issubclass(cls, DynamicComponent) else []
    missing = [name for name in wanted if not hasattr(cls, name)]
    return missing + sorted(getattr(cls, "__abstractmethods__", ()))


def _made(cls: type[OwnComponent], path: Path | None, where: str) -> OwnComponent:
    if not _is_component(cls):
        raise input_error(where, "is not a component", _DERIVE)
    missing = _lacking(cls)
    if missing:
        raise input_error(where, f"lacks {', '.join(missing)}", "add it")
    try:
        return cls()
    except Exception as error:
        raise error_in_file(error, path or Path(_source_of(cls))) from None


def _checked(made: OwnComponent, path: Path | None) -> LoadedComponent:
    where = f"{path}, class {type(made).__name__}" if path else f"class {type(made).__name__}"
    lacking = _lacking(type(made))
    if lacking:
        raise input_error(where, f"lacks {', '.join(lacking)}", "add it")
    _check_declaration(made, where)
    units = {name: column.unit for name, column in made.columns.items()}
    digest = hashlib.sha256(read_bytes(path, "a component")).hexdigest() if path else ""
    loaded = LoadedComponent(made.kind, units, made, path.name if path else "", digest, path)
    _try_out(loaded, where)
    return loaded


def _check_declaration(made: OwnComponent, where: str) -> None:
    if not isinstance(made.kind, str) or not made.kind or made.kind in KINDS:
        what = (
            f"kind {made.kind!r} is one of the log format" if made.kind in KINDS else "has no kind"
        )
        raise input_error(where, what, 'name it differently, for example kind = "servo"')
    columns = made.columns
    if not isinstance(columns, Mapping) or not all(
        isinstance(c, LogColumn) for c in columns.values()
    ):
        raise input_error(
            where, "columns is not a dict of LogColumn", 'write {"volts": LogColumn("V", "input")}'
        )
    for name, column in columns.items():
        place = f"{where}, column {name}"
        if name in ("time_s", "test"):
            raise input_error(place, "is in every log", "omit it")
        if column.role not in ("input", "output") or column.between not in ("held", "line"):
            given = f"role {column.role!r}, between {column.between!r}"
            raise input_error(
                place, f"has {given}", 'role is "input" or "output", between "held" or "line"'
            )
        check_unit(column.unit, place)
    if not made.outputs:
        raise input_error(where, "predicts nothing", 'give a column the role "output"')
    _check_parameters(made, where)
    _check_terms(made, where)


def _check_parameters(made: OwnComponent, where: str) -> None:
    given = made.parameters
    if not isinstance(given, tuple) or not all(isinstance(p, Parameter) for p in given):
        raise input_error(
            where, "parameters is not a tuple of Parameter", "make it one: (Parameter(...),)"
        )
    if not given:
        raise input_error(where, "has no parameter", "a law to fit has at least one")
    _reject_twice([p.name for p in given], where)
    for p in given:
        if not math.isfinite(p.value) or not p.lower <= p.value <= p.upper:
            bounds = f"{p.lower:g} to {p.upper:g}"
            raise input_error(
                f"{where}, parameter {p.name}",
                f"starts at {p.value:g}, outside its bounds {bounds}",
                "start it within them",
            )


def _reject_twice(names: Sequence[str], where: str) -> None:
    for name in names:
        if names.count(name) > 1:
            raise input_error(where, f"{name} is declared twice", "keep one")


def _check_terms(made: OwnComponent, where: str) -> None:
    terms: Iterable[Any] = made.terms
    if not isinstance(terms, tuple) or not all(isinstance(t, Term) for t in terms):
        raise input_error(where, "terms is not a tuple of Term", "make it one: (Term(...),)")
    _reject_twice([t.id for t in made.terms], where)
    names = [p.name for p in made.parameters]
    for term in made.terms:
        place = f"{where}, term {term.id}"
        quantities = term.quantities
        if not isinstance(quantities, tuple) or not all(
            isinstance(q, Quantity) for q in quantities
        ):
            raise input_error(
                place, "quantities is not a tuple of Quantity", "make it one: (Quantity(...),)"
            )
        if not any(q.is_strength for q in quantities):
            raise input_error(
                place, "has no strength", "make one quantity 0 where the term vanishes"
            )
        if chosen := [q.name for q in quantities if q.is_choice]:
            raise input_error(
                f"{place}, quantity {chosen[0]}",
                "is a choice",
                "make each choice a separate term",
            )
        _reject_twice([*names, *(q.name for q in quantities)], place)
        for q in quantities:
            if not q.name.isidentifier() or iskeyword(q.name) or q.name in _TAKEN:
                raise input_error(
                    f"{place}, quantity {q.name}", "cannot be a name here", "give it another one"
                )


# --- tried once ---------------------------------------------------------------------------


def _try_out(loaded: LoadedComponent, where: str) -> None:
    """Call the user's functions once, at the parameters' starts, where errors name the line."""
    made = loaded.definition
    values = {p.name: p.value for p in made.parameters}
    try:
        if isinstance(made, DynamicComponent):
            from sysid.plant.jax_setup import on_processor

            with on_processor():
                _try_dynamic(made, values, where)
        elif isinstance(made, StaticComponent):
            _try_static(made, values, where)
    except SysidError:
        raise
    except Exception as error:
        raise loaded.error(error) from None


def _try_static(made: StaticComponent, values: dict[str, float], where: str) -> None:
    columns = dict.fromkeys((*made.inputs, "time_s"), _TRIED_AT)
    _named_only(outputs_of(made.predict(columns, values), made), made.outputs, f"{where}, predict")
    for term in made.terms:
        place = f"{where}, term {term.id}"
        added = outputs_of(term.adds(columns, {**values, **_absent(term)}), made)
        _check_neutral(added, place)
        if set(added) - set(made.outputs):
            raise input_error(
                place, "adds to something that is not an output", f"return {made.outputs[0]}"
            )


def _try_dynamic(made: DynamicComponent, values: dict[str, float], where: str) -> None:
    from sysid.plant.jax_setup import jnp

    if not isinstance(made.states, tuple) or not made.states:
        raise input_error(where, "states is not a tuple of names", 'write ("position",)')
    # The user's functions see the numbers of jax that they will be compiled with.
    numbers = {name: jnp.asarray(value, float) for name, value in values.items()}
    first = {name: jnp.asarray(0.25) for name in (*made.columns, "time_s")}
    rates = {name: jnp.asarray(0.0) for name in made.columns}
    state = made.start(first, rates, numbers)
    _named_only(state, made.states, f"{where}, start")
    inputs = {name: first[name] for name in (*made.inputs, "time_s")}
    _named_only(made.derivative(state, inputs, numbers), made.states, f"{where}, derivative")
    _named_only(made.measure(state, inputs, numbers), made.outputs, f"{where}, measure")
    for term in made.terms:
        place = f"{where}, term {term.id}"
        added = term.adds(state, inputs, {**numbers, **_absent(term)})
        if not isinstance(added, Mapping) or set(added) - set(made.states):
            raise input_error(
                place, "does not give rates by state", f"return a dict of {', '.join(made.states)}"
            )
        _check_neutral(added, place)


def _absent(term: Term) -> dict[str, float]:
    """A term's quantities where it is absent: strengths 0."""
    return {q.name: 0.0 if q.is_strength else q.typical for q in term.quantities}


def _named_only(found: Any, names: Sequence[str], where: str) -> None:
    if not isinstance(found, Mapping):
        raise input_error(where, "does not return a dict", f"return one with {', '.join(names)}")
    missing = [n for n in names if n not in found]
    more = [n for n in found if n not in names]
    if missing or more:
        what = (
            f"does not give {missing[0]}" if missing else f"gives {more[0]}, which is not declared"
        )
        raise input_error(where, what, f"return a dict of {', '.join(names)}")
    _check_given(found, where)
    for name in names:
        if np.size(found[name]) > len(_TRIED_AT):
            raise input_error(where, f"{name} is not one number a row", "return one")


def _check_given(found: Mapping[str, Any], where: str) -> None:
    none = [name for name, value in found.items() if value is None]
    if none:
        raise input_error(where, f"gives None for {none[0]}", "end it with a return of numbers")


def _check_neutral(added: Mapping[str, Any], where: str) -> None:
    _check_given(added, where)
    if any(np.any(np.asarray(v) != 0.0) for v in added.values()):
        raise input_error(
            where, "does not vanish where its strengths are 0", "multiply it by a strength"
        )


def _source_of(cls: type[OwnComponent]) -> str:
    try:
        return inspect.getsourcefile(cls) or ""
    except (TypeError, OSError):
        return ""


__all__ = ["ComponentSource", "LoadedComponent", "component_in", "one_component", "with_component"]
