"""A diagnosis read from the file that `sysid diagnose` wrote, without diagnosing again."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

from pydantic import ValidationError

from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, estimate_records
from sysid.diagnosis import wording
from sysid.diagnosis.figures import steps_panel
from sysid.diagnosis.result import BeforeAfter, Verdict
from sysid.diagnosis.tables import summary
from sysid.errors import InputError, input_error
from sysid.io.tables import read_bytes
from sysid.parameters import Bundle, EffectEntry
from sysid.parameters.content import SCHEMA
from sysid.parameters.files import bundle_from_json
from sysid.plant.effects.catalogue import catalogue

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WHAT = "what sysid diagnose -o or --json wrote"
_FIX = "give the bundle of sysid diagnose -o, or what its --json printed"
# What every effect of a diagnosis has, and the kind of its value.
_OF_EFFECT: dict[str, tuple[type, ...]] = {
    "id": (str,),
    "parameters": (dict,),
    "p_value": (int, float),
    "share": (int, float),
    "holdout_rmse": (dict,),
    "ambiguous_with": (list,),
    "advice": (str,),
}


@dataclass(frozen=True, repr=False)
class ReadDiagnosis(Shown):
    """A diagnosis as its file holds it: `verdict`, `effects`, errors before and after.

    `content` is the file's, in JSON types; `bundle` the extended bundle where the file is one: what
    share of the residual each effect explains is unknown then.
    """

    content: Mapping[str, Any]
    effects: tuple[EffectEntry, ...]
    residual: Mapping[str, BeforeAfter]
    source: str
    bundle: Bundle | None = None

    @property
    def verdict(self) -> Verdict:
        """ "adequate", "effects-found", "incomplete" or "unexplained"."""
        return cast(Verdict, self.content["verdict"])

    def shown_with(self, bundle: Bundle) -> Mapping[str, Any]:
        """What a page on this bundle shows of it. Raises InputError where it is of another model.

        A refinement since may have moved the numbers of its effects, not which effects there are.
        """
        if "figures" not in self.content:
            raise input_error(
                self.source, "holds no figures to draw", "give diagnosis.json of sysid run"
            )
        own, other = ([e.id for e in one.effects] for one in (self, bundle))
        if sorted(own) != sorted(other):
            raise input_error(
                self.source,
                f"found {_listed(own)}, {bundle.source} has {_listed(other)}",
                "give the bundle that this diagnosis extended, or leave it out",
            )
        return self.content

    def headline(self) -> str:
        """The verdict in one sentence; of a bundle that says no more, its word."""
        if self.bundle is not None and self.verdict == "unexplained":
            return "Unexplained: the bundle does not say what remains."
        return wording.sentence(self.content)

    def records(self) -> list[dict[str, Any]]:
        """One record per parameter of an effect: value, std, limits of the 95 % interval, unit."""
        return [
            record for e in self.effects for record in estimate_records(e.numbers(), effect=e.id)
        ]

    def tables(self) -> Iterable[Table]:
        """The effects, their parameters, and the errors on held-out logs."""
        return summary({**self.content, "figures": self._names()})

    def footnotes(self) -> Iterable[str]:
        """What the remaining errors consist of, what to do next, and the notices."""
        notices = (f"notice: {line}" for line in self.content["notices"])
        if self.bundle is not None:
            return tuple(notices)
        found = self.content
        return (*wording.remainder_lines(found), *wording.advice(found), *notices)

    def plot(self, ax: Axes | None = None) -> Axes:
        """RMSE on held-out logs over that of a correct model, before and after each effect."""
        from sysid.blocks.drawing import plot_panels

        return plot_panels((steps_panel(self.content),), ax)[0]

    def to_json(self) -> dict[str, Any]:
        """The content of the file."""
        return dict(self.content)

    def _names(self) -> dict[str, Any]:
        known = catalogue()
        mine = {e.id: known[e.id] for e in self.effects if e.id in known}
        rivals = [id for e in self.effects for id in e.ambiguous_with if id in known]
        return {
            "looks": [],
            "titles": {id: known[id].title for id in (*mine, *rivals)},
            "meanings": {id: {q.label: q.title for q in e.quantities} for id, e in mine.items()},
            "forms": {id: e.forms() for id, e in mine.items()},
        }


def read_diagnosis(path: str | Path) -> ReadDiagnosis:
    """Read what `sysid diagnose` wrote: the extended bundle (`-o`) or the output of `--json`.

    Computes nothing and runs no code. Raises InputError, one line that names the key, where the
    file is neither, or a bundle that was not diagnosed.

    >>> import json, pathlib
    >>> text = json.dumps(found.detail.to_json())
    >>> _ = pathlib.Path("found.json").write_text(text)
    >>> si.read_diagnosis("found.json").verdict == found.verdict
    True
    """
    place = Path(path)
    content = _content(place)
    bundle = None
    if content.get("schema") == SCHEMA:
        bundle = bundle_from_json(content, place)
        content = _of_bundle(bundle, place)
    _check(content, place)
    try:
        effects = tuple(EffectEntry.model_validate(one) for one in content["effects"])
        residual = {name: BeforeAfter(**e) for name, e in content["residual"].items()}
        return ReadDiagnosis(content, effects, residual, str(place), bundle)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"])) or "effects"
        raise _unusable(place, f"effects: {key}: {first['msg']}") from None
    except (TypeError, AttributeError):
        raise _unusable(place, "residual is not an object of errors by channel") from None


def _listed(effects: Sequence[str]) -> str:
    return ", ".join(effects) or "no effect"


def _content(path: Path) -> dict[str, Any]:
    """The object in the file."""
    try:
        content = json.loads(read_bytes(path, _WHAT).decode("utf-8-sig"))
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        line = f", line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise input_error(f"{path}{line}", "is not JSON", _FIX) from None
    if not isinstance(content, dict):
        raise _unusable(path, "is not a JSON object")
    return content


def _of_bundle(bundle: Bundle, path: Path) -> dict[str, Any]:
    """A diagnosis as far as its extended bundle holds it: each effect with its errors."""
    made = bundle.provenance.options.get("diagnosis")
    if not isinstance(made, Mapping):
        raise input_error(
            path,
            "is a bundle without a diagnosis's verdict",
            "diagnose it, or give what sysid diagnose --json printed: a bundle to which nothing "
            "was added does not keep the verdict",
        )
    effects: list[dict[str, Any]] = []
    for entry in bundle.effects:
        one = entry.model_dump(mode="json")
        p_value = math.nan if entry.p_value is None else entry.p_value
        held = one.get("holdout_rmse") or {}
        rivals = list(entry.ambiguous_with)
        effects.append(
            {
                **one, "p_value": p_value, "share": math.nan, "holdout_rmse": held,
                "ambiguous_with": rivals, "advice": "",
            }
        )  # fmt: skip
    errors = [one["holdout_rmse"] for one in effects]
    residual = {
        name: {"noise_floor": math.nan, **last, "before": errors[0].get(name, last)["before"]}
        for name, last in (errors[-1] if errors else {}).items()
    }
    return {
        "verdict": made.get("verdict"),
        "effects": effects,
        "residual": residual,
        "unexplained": [],
        "search": made.get("search", {}),
        "seed": made.get("seed", 0),
        "notices": [],
    }


def _check(content: Mapping[str, Any], path: Path) -> None:
    """InputError that names what a diagnosis lacks."""
    if "verdict" not in content or not isinstance(content.get("effects"), list):
        raise _unusable(path, "holds no verdict of a diagnosis")
    if content["verdict"] not in get_args(Verdict):
        raise _unusable(path, f"verdict is {content['verdict']!r}")
    for key, kind in (("residual", dict), ("unexplained", list), ("notices", list)):
        if not isinstance(content.get(key), kind):
            raise _unusable(path, f"{key} is missing, or of another kind")
    for place, effect in enumerate(content["effects"], start=1):
        for key, kinds in _OF_EFFECT.items():
            if not isinstance(effect, dict) or not isinstance(effect.get(key), kinds):
                raise _unusable(path, f"effect {place}: {key} is missing, or of another kind")


def _unusable(path: Path, what: str) -> InputError:
    return input_error(path, what, _FIX)


__all__ = ["ReadDiagnosis", "read_diagnosis"]
