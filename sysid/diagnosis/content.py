"""The content of a diagnosis as its report needs it: plain numbers and text, as in JSON.

A later process draws the same section from `diagnosis.json`, without diagnosing again.
"""

from __future__ import annotations

from typing import Any

from sysid.diagnosis.result import Diagnosis
from sysid.errors import Failure, on_its_own
from sysid.plant.effects.catalogue import catalogue, catalogue_entry
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.linear import for_rig


def content(diagnosis: Diagnosis) -> dict[str, Any]:
    """The output of `sysid diagnose --json`, and the data drawn under `figures`.

    Pictures that cannot be drawn are skipped, and the notices say why.
    """
    found, drawn = diagnosis.to_json(), figures(diagnosis)
    missing = drawn.pop("missing")
    return {**found, "notices": [*found["notices"], *missing], "figures": drawn}


def figures(diagnosis: Diagnosis) -> dict[str, Any]:
    """The numbers behind the report's figures, a JSON-able dict.

    `curves`: mean residual over a regressor before and after the effects; `trace`: a held-out test
    of an actuator, where there is one. Further keys are those of `names`, and the evidence's own.
    `missing` says which of these could not be worked out, and why.
    """
    found = names(diagnosis)
    own = on_its_own(diagnosis.evidence.figures)
    if isinstance(own, Failure):
        what = "the figures of the residual could not be worked out"
        found["missing"].append(f"{what}: {own.reason}")
        own = {"curves": []}
    trace = {} if diagnosis.trace is None else {"trace": dict(diagnosis.trace)}
    return {**found, **own, **trace}


def names(diagnosis: Diagnosis) -> dict[str, Any]:
    """What its tables need: `looks`, what each round tried (`ComponentEvidence.rounds_shown`).

    `titles` and `meanings` name effects, those that were tried among them, and the parameters of
    those found, `forms` says what some values of these stand for; `laws` says in a sentence what
    each found one and each rival does, `telling` which test distinguishes it from others; `own` are
    the units of a user's own columns. `missing` says what could not be computed, and why.
    """
    missing: list[str] = []
    looks = on_its_own(diagnosis.evidence.rounds_shown)
    if isinstance(looks, Failure):
        missing.append(f"what each round tried could not be worked out: {looks.reason}")
        looks = []
    tried = {suspect["id"] for look in looks for suspect in look["suspects"]}
    rivals = {id for found in diagnosis.effects for id in found.ambiguous_with}
    known = _known(diagnosis)
    named = {found.id for found in diagnosis.effects} | rivals
    own = diagnosis.evidence.own_columns
    return {
        **({"own": dict(own)} if own else {}),
        "looks": looks,
        "titles": {id: known[id].title for id in sorted(named | tried) if id in known},
        "laws": {id: catalogue_entry(known[id])["law"] for id in sorted(named) if id in known},
        "telling": {id: known[id].tie_breaker for id in sorted(named) if id in known},
        "meanings": {
            found.id: {q.label: q.title for q in type(found.effect).quantities}
            for found in diagnosis.effects
        },
        "forms": {found.id: type(found.effect).forms() for found in diagnosis.effects},
        "missing": missing,
    }


def _known(diagnosis: Diagnosis) -> dict[str, type[CatalogueEffect]]:
    """The catalogue's effects by id, and those that were found, a user's own among them."""
    own = for_rig(catalogue(), diagnosis.evidence.is_linear)
    mine = {effect.id: effect for effect in diagnosis.evidence.own_effects}
    return {**own, **mine, **{found.id: type(found.effect) for found in diagnosis.effects}}


__all__ = ["content", "figures", "names"]
