"""Bundles: checked on the way in and out, merged by part, written whole or not at all."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from sysid.bundle.content import (
    add_sources,
    check_log_unchanged,
    merge,
    new_bundle,
    read_bundle,
    write_bundle,
)
from sysid.errors import InputError
from sysid.io.logs import Log
from sysid.io.rig import Rig, read_rig
from sysid.io.source import Source


def estimate(value: float, unit: str = "Nm") -> dict[str, Any]:
    return {"value": value, "std": 0.1 * value, "unit": unit, "interval": [value - 1, value + 1]}


FRICTION = {
    "static_nm": {"value": None, "identified": False, "reason": "no ramp moves"},
    "coulomb_nm": estimate(0.2),
    "viscous_nm_s_per_rad": estimate(0.05, "Nm s/rad"),
}


@pytest.fixture
def rig(tmp_path: Path, rig_text: str) -> Rig:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text)
    return read_rig(path)


@pytest.fixture
def bundle(rig: Rig) -> dict[str, Any]:
    log = Log(Path("somewhere/run.csv"), "ab" * 32, ())
    return new_bundle(rig, {"friction": FRICTION}, [Source.of(log, "fit", "friction")])


def test_round_trip(bundle: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "bundle.json"
    write_bundle(bundle, path)
    assert read_bundle(path) == bundle
    assert bundle["effects"] == []
    assert bundle["provenance"]["logs"][0]["file"] == "run.csv"


@pytest.mark.parametrize("key", ["schema", "created", "rig", "effects", "provenance"])
def test_a_missing_key_is_named(bundle: dict[str, Any], key: str, tmp_path: Path) -> None:
    path = tmp_path / "bundle.json"
    del bundle[key]
    path.write_text(json.dumps(bundle))
    with pytest.raises(InputError, match=key):
        read_bundle(path)


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        (("friction", "coulomb_nm"), {"value": 1.0}, "friction.coulomb_nm"),
        (("friction", "coulomb_nm", "value"), "0.2", "friction.coulomb_nm"),
        (("friction", "coulomb_nm", "std"), -1.0, "friction.coulomb_nm"),
        (("provenance", "logs", 0, "sha256"), "1234", "provenance.logs.0.sha256"),
        (("schema",), "sysid-bundle/2", "sysid-bundle/2"),
        (("rig", "air", "temperature_k"), 20.0, "temperature_k"),
    ],
)
def test_a_wrong_value_is_named(
    bundle: dict[str, Any], where: tuple[Any, ...], value: Any, message: str, tmp_path: Path
) -> None:
    spoilt = copy.deepcopy(bundle)
    target: Any = spoilt
    for key in where[:-1]:
        target = target[key]
    target[where[-1]] = value
    path = tmp_path / "bundle.json"
    path.write_text(json.dumps(spoilt))
    with pytest.raises(InputError, match=message):
        read_bundle(path)


def test_nothing_invalid_or_infinite_is_written(bundle: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "bundle.json"
    bundle["friction"]["coulomb_nm"] = {**estimate(0.2), "std": float("nan")}
    with pytest.raises((InputError, ValueError)):
        write_bundle(bundle, path)
    assert list(tmp_path.glob("bundle*")) == []


def test_merge_adds_a_part_and_keeps_the_rest(bundle: dict[str, Any], rig: Rig) -> None:
    discrete = {
        name: estimate(1.0, "kg/s")
        for name in ("c_fill", "c_dis", "choked_flow_fill_kg_s", "choked_flow_dis_kg_s")
    }
    log = Log(Path("valve.csv"), "cd" * 32, ())
    valve_a = new_bundle(
        rig, {"valves": {"a": {"discrete": discrete}}}, [Source.of(log, "fit", "v")]
    )
    valve_b = new_bundle(rig, {"valves": {"b": {"discrete": discrete}}}, [])
    merged = merge(merge(bundle, valve_a, Path("b.json")), valve_b, Path("b.json"))
    assert merged["friction"] == FRICTION
    assert set(merged["valves"]) == {"a", "b"}
    assert [e["file"] for e in merged["provenance"]["logs"]] == ["run.csv", "valve.csv"]


def test_parts_of_different_rigs_do_not_mix(bundle: dict[str, Any]) -> None:
    other = copy.deepcopy(bundle)
    other["rig"]["air"]["supply_pressure_pa"] = 4e5
    with pytest.raises(InputError, match=r"\[air\] differs"):
        merge(bundle, other, Path("b.json"))


def test_a_part_that_is_replaced_takes_its_logs_and_the_validation_along(
    bundle: dict[str, Any], rig: Rig
) -> None:
    log = Log(Path("run.csv"), "cd" * 32, ())
    again = new_bundle(rig, {"friction": FRICTION}, [Source.of(log, "fit", "friction")])
    merged = merge({**bundle, "validation": {"logs": []}}, again, Path("b.json"))
    assert [e["sha256"] for e in merged["provenance"]["logs"]] == ["cd" * 32]
    assert "validation" not in merged


def test_logs_of_two_folders_may_share_a_name(bundle: dict[str, Any]) -> None:
    other = Log(Path("day2/run.csv"), "cd" * 32, ())
    add_sources(bundle, [Source.of(other, "fit", "friction-sliding")])
    for digest in ("ab" * 32, "cd" * 32):
        check_log_unchanged(
            bundle, Log(Path("run.csv"), digest, ()), "friction-static", Path("b.json")
        )
    new = Log(Path("run.csv"), "ef" * 32, ())
    check_log_unchanged(bundle, new, "motion-pwm", Path("b.json"))
    with pytest.raises(InputError, match="changed since"):
        check_log_unchanged(bundle, new, "friction-static", Path("b.json"))


def test_a_changed_log_is_noticed(bundle: dict[str, Any]) -> None:
    kind, path = "friction-sliding", Path("b.json")
    check_log_unchanged(bundle, Log(Path("run.csv"), "ab" * 32, ()), kind, path)
    with pytest.raises(InputError, match="changed since"):
        check_log_unchanged(bundle, Log(Path("run.csv"), "cd" * 32, ()), kind, path)
