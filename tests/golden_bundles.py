"""Bundles spoilt one key at a time: what the reader, the models and the exports must refuse.

The sound bundle is `golden/bundles/diagnosed.json`, which holds every part. A change is a
function of its content; a text is a whole file.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from typing import Any

from golden_folder import golden_bundle

Change = Callable[[dict[str, Any]], object]

BASE = "diagnosed"
_SEAL = "effects.0.parameters.seal_torque_nm_per_pa"
_FILL = "valves.a.pwm.fill"
_POLY = f"{_FILL}.bipolynomial"
_NOT = {"value": None, "identified": False, "reason": "no test moves it"}


def _at(content: Any, path: list[str]) -> Any:
    for key in path:
        content = content[int(key)] if isinstance(content, list) else content[key]
    return content


def _put(path: str, value: Any) -> Change:
    *parents, last = path.split(".")

    def change(bundle: dict[str, Any]) -> None:
        place = _at(bundle, parents)
        place[int(last) if isinstance(place, list) else last] = copy.deepcopy(value)

    return change


def _drop(path: str) -> Change:
    *parents, last = path.split(".")

    def change(bundle: dict[str, Any]) -> None:
        place = _at(bundle, parents)
        del place[int(last) if isinstance(place, list) else last]

    return change


def _drops(*paths: str) -> dict[str, Change]:
    return {f"no {path}": _drop(path) for path in paths}


def _puts(*pairs: tuple[str, Any]) -> dict[str, Change]:
    return {f"{path} = {json.dumps(value)[:50]}": _put(path, value) for path, value in pairs}


def _linear(bundle: dict[str, Any]) -> None:
    bundle["rig"]["rig"]["motion"] = "linear"


CHANGES: dict[str, Change] = {
    "sound": lambda bundle: None,
    **_drops(
        *("schema", "created", "sysid_version", "rig", "effects", "provenance", "friction"),
        *("valves", "rig.rig", "rig.air", "rig.cylinder", "rig.inertia", "rig.motor", "rig.pwm"),
        *("rig.valves", "rig.sampling", "rig.sensors", "rig.rig.name", "rig.rig.orientation"),
        *("rig.air.temperature_k", "rig.cylinder.pitch_radius_m", "rig.inertia.equivalent_kg_m2"),
        *("friction.static_nm", "friction.coulomb_nm", "friction.viscous_nm_s_per_rad"),
        *("friction.offset_nm", "friction.static_nm.value", "friction.static_nm.std"),
        *("friction.static_nm.unit", "friction.static_nm.interval"),
        *("friction.static_by_position.0.static", "friction.static_by_position.0.position"),
        *("valves.a", "valves.a.discrete", "valves.a.pwm", "valves.a.discrete.c_fill"),
        *("valves.b.discrete.c_dis", "valves.a.discrete.choked_flow_fill_kg_s"),
        *("valves.b.discrete.choked_flow_dis_kg_s", "valves.a.discrete.on_delay_s"),
        *(_FILL, f"{_FILL}.pwm_period_s", _POLY, f"{_FILL}.ann", f"{_POLY}.kind"),
        *(f"{_POLY}.coefficients", f"{_POLY}.coefficients.8", f"{_POLY}.scaling"),
        *(f"{_POLY}.domain", f"{_FILL}.ann.hidden_weights", f"{_FILL}.ann.activation"),
        *("effects.0.id", "effects.0.parameters", _SEAL, f"{_SEAL}.value", f"{_SEAL}.unit"),
        *(f"{_SEAL}.std", "effects.0.holdout_rmse.theta_rad.after", "effects.0.p_value"),
        *("provenance.logs", "provenance.logs.0.file", "provenance.logs.0.sha256"),
        *("provenance.logs.0.use", "provenance.logs.0.kind", "provenance.seeds"),
    ),
    **_puts(
        ("schema", "sysid-bundle/9"),
        ("schema", 1),
        ("created", 20260101),
        ("sysid_version", None),
        ("rig", "rig.toml"),
        ("rig", {}),
        ("rig.rig", "arm"),
        ("rig.rig.name", 7),
        ("rig.rig.orientation", "sideways"),
        ("rig.rig.motion", "round"),
        ("rig.air", 1.0),
        ("rig.air.temperature_k", 20.0),
        ("rig.air.temperature_k", "298.4"),
        ("rig.air.supply_pressure_pa", 1.06e5),
        ("rig.air.temprature_k", 298.4),
        ("rig.aer", {}),
        ("rig.garden", {"flowers": 3}),
        ("rig.cylinder.offset_a_m", 0.02),
        ("rig.pwm.period_s", 0.004),
        ("rig.pwm.period_s", 50.0),
        ("friction", []),
        ("friction", None),
        ("friction.static_nm", 0.3),
        ("friction.static_nm", None),
        ("friction.static_nm", _NOT),
        ("friction.coulomb_nm", {**_NOT, "identified": True}),
        ("friction.coulomb_nm", {"value": None, "identified": False}),
        ("friction.coulomb_nm.value", "0.2"),
        ("friction.coulomb_nm.value", True),
        ("friction.coulomb_nm.value", -0.2),
        ("friction.coulomb_nm.std", -1.0),
        ("friction.coulomb_nm.std", None),
        ("friction.coulomb_nm.std", "small"),
        ("friction.coulomb_nm.unit", 3),
        ("friction.coulomb_nm.unit", "N"),
        ("friction.coulomb_nm.interval", [0.1]),
        ("friction.coulomb_nm.interval", [0.1, 0.2, 0.3]),
        ("friction.coulomb_nm.interval", ["a", 0.2]),
        ("friction.coulomb_nm.interval", [None, None]),
        ("friction.viscous_nm_s_per_rad", _NOT),
        ("friction.inertia_kg_m2", {"value": 0.02, "std": 0.001, "unit": "kg m2"}),
        ("friction.inertia_kg_m2", {"value": 0.02}),
        ("friction.static_by_position", {}),
        ("friction.static_by_position", [1.0]),
        ("friction.static_by_position.0.position", "left"),
        ("friction.static_by_position.0.static", 0.3),
        ("friction.more", 1.0),
        ("valves", []),
        ("valves.c", {}),
        ("valves.a", 1.0),
        ("valves.a.discrete", []),
        ("valves.a.discrete.c_fill", _NOT),
        ("valves.a.discrete.c_fill", 1.5e-6),
        ("valves.b.discrete.c_dis.value", "3.7e-9"),
        ("valves.b.discrete.c_dis.std", -1e-12),
        ("valves.a.discrete.c_dis.unit", "kg/s"),
        ("valves.a.discrete.on_delay_s", "late"),
        ("valves.a.pwm", 5),
        (_FILL, "surface"),
        (f"{_FILL}.pwm_period_s", 0.01),
        (f"{_FILL}.pwm_period_s", "5 ms"),
        (_POLY, 3),
        (f"{_POLY}.kind", "spline"),
        (f"{_POLY}.coefficients", []),
        (f"{_POLY}.coefficients.0.term", "u^9 P^9"),
        (f"{_POLY}.coefficients.0.value", "1"),
        (f"{_POLY}.scaling.duty", [0.5, 0.0]),
        (f"{_POLY}.domain.nodes.duty_low", [0.1]),
        (f"{_FILL}.ann.activation", "relu"),
        (f"{_FILL}.ann.hidden_weights.value", [[1.0]]),
        ("valves.a.steady", {}),
        ("valves.a.steady", {"full_flow_kg_s": 1.0}),
        ("valves.a.timing", {"filling_time_s": _NOT}),
        ("effects", {}),
        ("effects", None),
        ("effects", ["seal-friction"]),
        ("effects.0.id", "no-such-effect"),
        ("effects.0.id", 4),
        ("effects.0.parameters", []),
        ("effects.0.parameters.side", "c"),
        ("effects.0.parameters.side", "a"),
        ("effects.0.parameters.more", {"value": 1.0}),
        (_SEAL, 1.0),
        (f"{_SEAL}.value", "1"),
        (f"{_SEAL}.value", None),
        (f"{_SEAL}.value", True),
        (f"{_SEAL}.value", 1e9),
        (f"{_SEAL}.std", -1.0),
        (f"{_SEAL}.unit", "bar"),
        (f"{_SEAL}.unit", 1),
        (f"{_SEAL}.interval", [0.0]),
        ("effects.0.p_value", 1.5),
        ("effects.0.p_value", -0.1),
        ("effects.0.p_value", None),
        ("effects.0.holdout_rmse", []),
        ("effects.0.holdout_rmse.theta_rad", 0.1),
        ("effects.0.holdout_rmse.theta_rad.before", -1.0),
        ("effects.0.ambiguous_with", "backlash"),
        ("effects.0.ambiguous_with", [1]),
        ("validation", []),
        ("validation", {}),
        ("provenance", []),
        ("provenance.logs", {}),
        ("provenance.logs", []),
        ("provenance.logs.0", "run.csv"),
        ("provenance.logs.0.file", 1),
        ("provenance.logs.0.sha256", "1234"),
        ("provenance.logs.0.sha256", "G" * 64),
        ("provenance.logs.0.sha256", "AB" * 32),
        ("provenance.logs.0.use", "train"),
        ("provenance.logs.0.kind", 1),
        ("provenance.seeds", []),
        ("provenance.options", "none"),
        ("more", {"anything": 1}),
    ),
    "the same effect twice": lambda b: b["effects"].append(copy.deepcopy(b["effects"][0])),
    "rotary friction on a linear rig": _linear,
}

# Whole files: what is no JSON, or no bundle.
TEXTS: dict[str, bytes] = {
    "empty": b"",
    "not JSON": b'{"schema": ',
    "a comma too many": b'{\n  "schema": "sysid-bundle/1",\n}',
    "a list": b"[]",
    "a number": b"3",
    "null": b"null",
    "NaN": b'{"schema": "sysid-bundle/1", "created": NaN}',
    "Infinity": b'{"schema": "sysid-bundle/1", "created": -Infinity}',
    "beyond the range": b'{"schema": "sysid-bundle/1", "created": 1e999}',
    "an endless whole number": b'{"schema": "sysid-bundle/1", "created": %s}' % (b"9" * 5000),
    "nested without end": b"[" * 200_000,
    "not UTF-8": b'{"schema": "\xff\xfe"}',
    "nothing but the schema": b'{"schema": "sysid-bundle/1"}',
    "no schema": b'{"created": "2026-01-01"}',
}

# `read_bundle` checks the rig's content too, which the schema leaves open.
BEYOND_SCHEMA = tuple(
    f"{path}"
    for path in CHANGES
    if path.startswith(("rig.", "no rig.")) or path == "rotary friction on a linear rig"
)


def changed(name: str) -> str:
    """The file of a changed bundle, as JSON."""
    bundle = json.loads(golden_bundle(BASE).read_bytes())
    CHANGES[name](bundle)
    return json.dumps(bundle)
