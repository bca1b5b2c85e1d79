"""Bundles: checked on the way in and out, merged by part, written whole or not at all."""

from __future__ import annotations

import copy
import functools
import json
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from golden_folder import BUNDLES, golden_bundle
from pydantic import ValidationError
from shared_results import bundled_fit

from sysid.errors import InputError
from sysid.estimation.linear import Estimate
from sysid.io.logs import Log
from sysid.io.rig import Rig, read_rig
from sysid.io.source import Source
from sysid.parameters import (
    Bundle,
    DiscreteLaw,
    FittedValves,
    Friction,
    LogRecord,
    Parts,
    Unread,
    Valve,
    bundle_text,
    read_bundle,
    write_bundle,
)
from sysid.parameters.base import FileContext, Part
from sysid.parameters.files import SCHEMA_FILE, bundle_from_json, shipped_schema
from sysid.parameters.fitted_logs import check_log, check_log_unchanged, check_not_fitted
from sysid.parameters.schema import bundle_schema


def estimate(value: float, unit: str = "Nm") -> dict[str, Any]:
    return {"value": value, "std": 0.1 * value, "unit": unit, "interval": [value - 1, value + 1]}


FRICTION = {
    "static_nm": {"value": None, "identified": False, "reason": "no ramp moves"},
    "coulomb_nm": estimate(0.2),
    "viscous_nm_s_per_rad": estimate(0.05, "Nm s/rad"),
}
PARTS = Parts(friction=Friction.model_validate(FRICTION))
LAW = DiscreteLaw.model_validate(
    {
        name: estimate(1.0, "kg/s")
        for name in ("c_fill", "c_dis", "choked_flow_fill_kg_s", "choked_flow_dis_kg_s")
    }
)
LOG = Log(Path("somewhere/run.csv"), "ab" * 32, ())


@pytest.fixture
def rig(tmp_path: Path, rig_text: str) -> Rig:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text)
    return read_rig(path)


@pytest.fixture
def bundle(rig: Rig) -> Bundle:
    return Bundle.new(rig, PARTS, [Source.of(LOG, "fit", "friction")]).named("b.json")


@pytest.fixture
def content(bundle: Bundle) -> dict[str, Any]:
    """The bundle as its file holds it."""
    return copy.deepcopy(bundle.to_json())


def test_round_trip(bundle: Bundle, tmp_path: Path) -> None:
    path = tmp_path / "bundle.json"
    write_bundle(bundle, path)
    found = read_bundle(path)
    assert json.loads(path.read_text()) == bundle.to_json() == found.to_json()
    assert path.read_text() == bundle_text(found)
    assert found.source == str(path)
    assert found.effects == []
    assert found.provenance.logs[0].file == "run.csv"
    assert found.friction is not None and found.friction.to_json() == FRICTION


@pytest.mark.parametrize("key", ["schema", "created", "rig", "effects", "provenance"])
def test_a_missing_key_is_named(content: dict[str, Any], key: str, tmp_path: Path) -> None:
    path = tmp_path / "bundle.json"
    del content[key]
    path.write_text(json.dumps(content))
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
    content: dict[str, Any], where: tuple[Any, ...], value: Any, message: str, tmp_path: Path
) -> None:
    target: Any = content
    for key in where[:-1]:
        target = target[key]
    target[where[-1]] = value
    path = tmp_path / "bundle.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        read_bundle(path)


@pytest.mark.parametrize(
    "spoilt",
    [
        {"coulomb_nm": Estimate.from_json({**estimate(0.2), "std": math.nan})},
        {"coulomb_nm": Estimate(math.nan, 0.1, "Nm", (0.0, 1.0))},
        {"coulomb_nm": Estimate(0.2, -0.1, "Nm", (0.0, 1.0))},
        {"rmse_nm": {"friction-sliding": math.inf}},
        {"viscous_nm_s_per_rad": None},
    ],
)
def test_nothing_invalid_or_infinite_is_written(
    bundle: Bundle, spoilt: dict[str, Any], tmp_path: Path
) -> None:
    path = tmp_path / "bundle.json"
    assert bundle.friction is not None
    with pytest.raises((InputError, ValueError)):
        write_bundle(bundle.replaced(friction=bundle.friction.replaced(**spoilt)), path)
    assert list(tmp_path.glob("bundle*")) == []


# --- merged --------------------------------------------------------------------------------


def test_merge_adds_a_part_and_keeps_the_rest(bundle: Bundle, rig: Rig) -> None:
    log = Log(Path("valve.csv"), "cd" * 32, ())
    valve_a, valve_b = (
        Bundle.new(rig, Parts(valves=FittedValves.model_validate({s: {"discrete": LAW}})), logs)
        for s, logs in (("a", [Source.of(log, "fit", "v")]), ("b", []))
    )
    merged = bundle.merged(valve_a).merged(valve_b)
    content = merged.to_json()
    assert content["friction"] == FRICTION
    assert content["valves"] == {side: {"discrete": LAW.to_json()} for side in "ab"}
    assert [e.file for e in merged.provenance.logs] == ["run.csv", "valve.csv"]


def test_a_held_out_log_that_changed_is_one_log(bundle: Bundle) -> None:
    """Its record is that of its content now; a log of the same name and another use stays."""

    def held(letter: str, use: str = "holdout", kind: str = "friction") -> Source:
        return Source.of(Log(Path("run.csv"), 64 * letter, ()), use, kind)

    first = bundle.with_sources([held("1"), held("2"), held("3", kind="v")])
    again = first.with_sources([held("1"), held("4")])
    assert [(e.sha256[0], e.use) for e in again.provenance.logs] == [
        ("a", "fit"), ("1", "holdout"), ("3", "holdout"), ("4", "holdout"),
    ]  # fmt: skip
    # A bundle's training logs are what it was fitted on, whatever they hold now.
    refitted = first.with_sources([held("5", use="fit")])
    assert [e.sha256[0] for e in refitted.provenance.logs] == ["a", "1", "2", "3", "5"]


def test_parts_of_different_rigs_do_not_mix(bundle: Bundle, content: dict[str, Any]) -> None:
    content["rig"]["air"]["supply_pressure_pa"] = 4e5
    other = bundle_from_json(content, Path("other.json"))
    with pytest.raises(InputError, match=r"^b\.json: .*\[air\] differs"):
        bundle.merged(other)


def test_a_part_that_is_replaced_takes_its_logs_and_the_validation_along(
    content: dict[str, Any], rig: Rig
) -> None:
    log = Log(Path("run.csv"), "cd" * 32, ())
    again = Bundle.new(rig, PARTS, [Source.of(log, "fit", "friction")])
    validated = bundle_from_json({**content, "validation": {"logs": []}}, Path("b.json"))
    assert validated.validation is not None
    merged = validated.merged(again)
    assert [e.sha256 for e in merged.provenance.logs] == ["cd" * 32]
    assert merged.validation is None and "validation" not in merged.to_json()


# --- logs ----------------------------------------------------------------------------------


def test_a_bundle_lists_what_is_for_users(bundle: Bundle) -> None:
    assert not [name for name in dir(bundle) if name.startswith("check")]


def test_logs_of_two_folders_may_share_a_name(bundle: Bundle) -> None:
    other = Log(Path("day2/run.csv"), "cd" * 32, ())
    both = bundle.with_sources([Source.of(other, "fit", "friction-sliding")])
    for digest in ("ab" * 32, "cd" * 32):
        check_log_unchanged(both, Log(Path("run.csv"), digest, ()), "friction-static")
    new = Log(Path("run.csv"), "ef" * 32, ())
    check_log_unchanged(both, new, "motion-pwm")
    with pytest.raises(InputError, match=r"^b\.json: run\.csv has changed since"):
        check_log_unchanged(both, new, "friction-static")


def test_a_changed_log_is_noticed(bundle: Bundle) -> None:
    kind = "friction-sliding"
    check_log_unchanged(bundle, Log(Path("run.csv"), "ab" * 32, ()), kind)
    with pytest.raises(InputError, match="changed since"):
        check_log_unchanged(bundle, Log(Path("run.csv"), "cd" * 32, ()), kind)


def test_a_held_out_log_of_a_new_day_may_have_an_old_name(bundle: Bundle) -> None:
    new = Log(Path("newday/run.csv"), "cd" * 32, ())
    check_log(bundle, new, "friction-motion", "holdout")
    with pytest.raises(InputError, match="changed since"):
        check_log(bundle, new, "friction-motion", "fit")
    with pytest.raises(InputError, match="is held out"):
        check_log(bundle, Log(Path("new.csv"), "ab" * 32, ()), "friction-motion", "holdout")


def test_a_log_that_was_fitted_on_is_not_held_out(bundle: Bundle) -> None:
    check_not_fitted(bundle, Log(Path("new.csv"), "cd" * 32, ()))
    with pytest.raises(InputError, match=r"^new\.csv: is held out .*b\.json.*\(run\.csv\)"):
        check_not_fitted(bundle, Log(Path("new.csv"), "ab" * 32, ()))


# --- nothing is lost -----------------------------------------------------------------------


@pytest.fixture
def foreign(content: dict[str, Any]) -> Bundle:
    """A bundle with keys that sysid has not, in an order that is not its own."""
    friction = {
        "note": {"by": ["hand"]},
        **dict(reversed(FRICTION.items())),
        "coulomb_nm": {**FRICTION["coulomb_nm"], "confidence": 0.9},
        "bearing": None,
    }
    valve = {"serial": 17, "discrete": {"batch": "x", **LAW.to_json()}, "datasheet": []}
    made: dict[str, Any] = {
        **dict(reversed(content.items())),
        "lab": {"room": 3},
        "friction": friction,
        "valves": {"b": valve, "a": valve},
    }
    made["provenance"] = {
        "operator": "k",
        **dict(reversed(made["provenance"].items())),
        "logs": [{"shelf": 4, **record} for record in made["provenance"]["logs"]],
    }
    return bundle_from_json(made, Path("b.json"))


def test_unknown_keys_and_the_order_of_all_keys_are_kept(foreign: Bundle) -> None:
    content = foreign.to_json()
    assert list(content) == [
        *("provenance", "effects", "friction", "rig", "sysid_version", "created", "schema"),
        *("lab", "valves"),
    ]
    assert list(content["friction"]) == [
        *("note", "viscous_nm_s_per_rad", "coulomb_nm", "static_nm", "bearing")
    ]
    assert list(content["valves"]) == ["b", "a"]
    assert list(content["valves"]["a"]) == ["serial", "discrete", "datasheet"]
    assert content["friction"]["coulomb_nm"]["confidence"] == 0.9
    assert list(content["provenance"]) == ["operator", "options", "seeds", "logs"]
    assert list(content["provenance"]["logs"][0]) == ["shelf", "file", "sha256", "use", "kind"]


def test_a_replaced_value_stands_where_the_old_one_stood(foreign: Bundle) -> None:
    assert foreign.friction is not None
    new, offset = (Estimate.symmetric(v, 0.01, "Nm", 8.0) for v in (0.3, 0.01))
    friction = foreign.friction.replaced(coulomb_nm=new, offset_nm=offset).without("static_nm")
    found = foreign.replaced(friction=friction)
    wanted = foreign.to_json()
    del wanted["friction"]["static_nm"]
    wanted["friction"] |= {"coulomb_nm": new.to_json()}
    at = found.to_json()["friction"]
    assert at.pop("offset_nm") == offset.to_json()
    assert text({**found.to_json(), "friction": at}) == text(wanted)
    # What was changed was a copy.
    assert foreign.friction.static_nm is not None and foreign.friction.offset_nm is None


def test_an_overlaid_part_keeps_what_the_other_does_not_hold(foreign: Bundle) -> None:
    flow = Estimate.symmetric(2.0, 0.1, "kg/s", 8.0)
    law = LAW.replaced(c_dis=flow)
    over = FittedValves(a=Valve(discrete=law))
    assert foreign.valves is not None
    found = foreign.replaced(valves=foreign.valves.overlaid(over))
    wanted = foreign.to_json()
    wanted["valves"]["a"]["discrete"] |= law.to_json()
    assert wanted["valves"]["a"]["discrete"]["c_dis"]["value"] == 2.0
    assert wanted["valves"]["b"]["discrete"]["c_dis"]["value"] == 1.0
    assert text(found.to_json()) == text(wanted)


def test_a_merged_bundle_keeps_what_the_other_does_not_hold(foreign: Bundle, rig: Rig) -> None:
    flow = Estimate.symmetric(2.0, 0.1, "kg/s", 8.0)
    law = LAW.replaced(c_fill=flow)
    log = Source.of(Log(Path("valve.csv"), "cd" * 32, ()), "fit", "valve-discrete")
    parts = Parts(valves=FittedValves(a=Valve(discrete=law)))
    part = Bundle.new(rig, parts, [log], seeds={"valve-discrete": 1})
    found = foreign.merged(part).to_json()
    wanted = foreign.to_json()
    wanted["valves"]["a"]["discrete"] = law.to_json()
    wanted["created"] = part.created
    wanted["provenance"]["seeds"] = {"valve-discrete": 1}
    wanted["provenance"]["logs"] += [e.to_json() for e in part.provenance.logs]
    assert text(found) == text(wanted)


def text(content: Any) -> str:
    """JSON, in which the order of keys counts, and 1 is not 1.0."""
    return json.dumps(content, indent=1)


@pytest.mark.parametrize(
    "content",
    [
        {"value": 0.2, "std": 0.01, "unit": "Nm", "interval": [0.18, 0.22]},
        {"value": 1, "std": 0, "unit": "Nm", "interval": [0, 2]},
        {"unit": "Nm", "interval": [None, 2], "std": None, "value": 1.0},
        {"value": 1.0, "std": 0.1, "unit": "Nm", "interval": [None, None]},
        {"value": 1.0, "std": 0.1, "unit": "Nm"},
        {"value": 2},
        {"value": None},
        {"value": None, "identified": False, "reason": "no test"},
        {"value": None, "identified": False, "reason": "no test", "unit": "Nm", "tests": 3},
        {"value": 0.2, "std": 0.01, "unit": "Nm", "by": {"hand": True}},
    ],
)
def test_an_estimate_is_written_as_it_was_read(content: dict[str, Any]) -> None:
    found = Estimate.from_json(content)
    assert text(found.to_json()) == text(content)
    assert found.identified == (content["value"] is not None)
    assert found.has_interval == ("interval" in content)


def test_what_an_estimate_reads() -> None:
    found = Estimate.from_json({"value": 1, "std": None, "unit": "Nm", "interval": [None, 2]})
    assert (found.value, found.unit, found.interval) == (1.0, "Nm", (-math.inf, 2.0))
    assert math.isnan(found.std)
    bare = Estimate.from_json({"value": 1})
    assert math.isnan(bare.interval[0]) and math.isnan(bare.interval[1])
    missing = Estimate.from_json({"value": None, "identified": False, "reason": "no test"})
    assert math.isnan(missing.value) and missing.reason == "no test"


# --- schema --------------------------------------------------------------------------------


def test_the_shipped_schema_is_that_of_the_classes() -> None:
    assert bundle_schema() == shipped_schema(), (
        f"write {SCHEMA_FILE} again: python -m sysid.parameters.schema"
    )


def unread(held: Any, place: str) -> Iterator[str]:
    """Where a part of a bundle holds what could not be read, with its values."""
    if isinstance(held, Unread):
        yield f"{place}: {held.value!r}"
    elif isinstance(held, Part):
        for name, value in held:
            yield from unread(value, f"{place}.{name}")
    elif isinstance(held, dict):
        for name, value in held.items():
            yield from unread(value, f"{place}.{name}")
    elif isinstance(held, list | tuple):
        for i, value in enumerate(held):
            yield from unread(value, f"{place}.{i}")


def test_content_of_another_form_is_found(content: dict[str, Any]) -> None:
    """The walk of the next two tests sees what it is to see."""
    content["friction"] |= {"source": 3, "static_by_position": [{"position": 1.0}]}
    content["valves"] = {"a": {"pwm": {"fill": {"ann": {"domain": {}}}}}}
    bundle = bundle_from_json(content, Path("b.json"))
    assert list(unread(bundle, "bundle")) == [
        "bundle.friction.source: 3",
        "bundle.friction.static_by_position.0: {'position': 1.0}",
        "bundle.valves.a.pwm.fill.ann.domain: {}",
    ]


@pytest.mark.parametrize("name", BUNDLES)
def test_a_bundle_that_was_written_before_the_types_is_read_whole(name: str) -> None:
    found = read_bundle(golden_bundle(name))
    assert list(unread(found, "bundle")) == []
    assert found.to_json() == json.loads(golden_bundle(name).read_text())


def test_a_freshly_fitted_bundle_is_read_whole(tmp_path_factory: pytest.TempPathFactory) -> None:
    """As the fit makes it, and as it is read back from its JSON."""
    fitted = bundled_fit(tmp_path_factory).bundle
    assert fitted.valves is not None and set(fitted.valves.sides()) == {"a", "b"}
    for side, valve in fitted.valves.sides().items():
        assert valve.discrete is not None, side
        for direction in ("fill", "discharge"):
            surfaces = valve.surfaces(direction)
            assert surfaces is not None and set(surfaces.surfaces()) == {"bipolynomial", "ann"}
    again = bundle_from_json(json.loads(bundle_text(fitted)), Path("b.json"))
    for held in (fitted, again):
        assert isinstance(held.provenance.logs[0], LogRecord)
        assert list(unread(held, "bundle")) == []
    assert again.to_json() == fitted.to_json()
    assert text(again.to_json()) == text(fitted.to_json())


@pytest.mark.parametrize("name", BUNDLES)
def test_a_bundle_of_the_last_version_is_read(name: str, tmp_path: Path) -> None:
    """0.2 reads what 0.1 wrote, and writes it as it was."""
    content = json.loads(golden_bundle(name).read_text("utf-8")) | {"sysid_version": "0.1.0"}
    written = tmp_path / "bundle.json"
    written.write_text(json.dumps(content), "utf-8")
    bundle = read_bundle(written)
    assert bundle.sysid_version == "0.1.0"
    assert json.loads(bundle_text(bundle)) == content


# --- one validation ----------------------------------------------------------------------

_PARAMETER = {"value": 1.0, "std": 0.1, "unit": "N"}
_REPLACED: tuple[Any, ...] = (
    *(None, "x", "3", 3, 2.5, True, -1.0, [], {}, {"value": 1.0}, _PARAMETER),
    *({**_PARAMETER, key: wrong} for key in _PARAMETER for wrong in (None, -1.0, "a", True)),
    *({**_PARAMETER, "interval": wrong} for wrong in (None, [1.0], [None, 2], ["a", 2])),
    *({"value": None, "identified": said, "reason": "x"} for said in (False, True)),
    {"value": None, "identified": False},
)


def _places(content: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every key of a file's content, of a list its first entry."""
    if at:
        yield at
    entries = list(enumerate(content[:1])) if isinstance(content, list) else ()
    for key, value in content.items() if isinstance(content, dict) else entries:
        yield from _places(value, (*at, key))


def _spoilt(content: Any, place: tuple[Any, ...]) -> Iterator[Any]:
    """The content with something else, and with nothing, at a place."""
    made = copy.deepcopy(content)
    node = functools.reduce(lambda held, key: held[key], place[:-1], made)
    for value in _REPLACED:
        node[place[-1]] = value
        yield made
    del node[place[-1]]
    yield made


@pytest.mark.parametrize("name", ["friction_points", "linear_axis", "valve_time", "tank"])
def test_the_classes_refuse_what_the_schema_refuses(name: str) -> None:
    """They are the one validation; the schema words what they refuse."""
    schema = jsonschema.Draft202012Validator(shipped_schema())
    content = json.loads(golden_bundle(name).read_bytes())
    for place in _places(content):
        for spoilt in _spoilt(content, place):
            try:
                Bundle.model_validate(spoilt, context=FileContext())
            except ValidationError:
                assert not schema.is_valid(spoilt), place
            else:
                assert schema.is_valid(spoilt), place


def test_a_sound_bundle_is_read_without_its_schema(tmp_path: Path) -> None:
    program = (
        "import sys; from pathlib import Path; from sysid.parameters import read_bundle;"
        f"read_bundle(Path({str(golden_bundle('diagnosed'))!r}));"
        "assert 'jsonschema' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=tmp_path)
