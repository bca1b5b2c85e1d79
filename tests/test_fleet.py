"""Fleets: which rig and date, what changed and from when on, runs that resume, one page."""

from __future__ import annotations

import dataclasses
import datetime
import json
import os
import shutil
import signal
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from golden_folder import GOLDEN, golden_bundle

from sysid.commands.app import main
from sysid.errors import Failure, InputError
from sysid.fleet.changes import change_in
from sysid.fleet.leakage import leakage_flow
from sysid.fleet.origin import Origin, date_in, origin_of, result_folder
from sysid.fleet.rows import LEAKAGE, FleetReading, FleetRow, readings_of
from sysid.fleet.trends import Fleet, fleet_of
from sysid.io.campaign import read_campaign
from sysid.parallel import attempt_all, on_cluster
from sysid.parallel.cluster import collector_off
from sysid.parameters import read_bundle
from sysid.parameters.effects import EffectEntry, entry_of
from sysid.pipeline.fleet import FleetOptions, run_fleet, run_one
from sysid.pipeline.pages.fleet import fleet_page
from sysid.plant.effects import AtmosphereLeakage
from sysid.plant.effects.catalogue import catalogue

DAYS = np.array([0.0, 30.0, 65.0, 90.0, 120.0, 200.0, 230.0, 260.0, 300.0, 340.0])
QUICK = {"diagnose": False, "refine": False}
# The text of elements that reach beyond the window and do not lie in something that scrolls.
OUTSIDE = """() => [...document.querySelectorAll("main *, header *")]
    .filter(e => !e.closest(".scroll, .panels") && !e.closest("svg") && e.getClientRects().length)
    .filter(e => e.getBoundingClientRect().right > window.innerWidth + 1)
    .map(e => e.outerHTML.slice(0, 80))"""

SCROLLED = """() => [...document.querySelectorAll(".scroll")]
    .filter(e => e.scrollWidth > e.clientWidth + 1).length"""


# --- rig and date --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "date"),
    [
        ("rig 2024-03-17 second", datetime.date(2024, 3, 17)),
        ("20240317_after-service", datetime.date(2024, 3, 17)),
        ("2024-01-01 to 2024-03-17", datetime.date(2024, 3, 17)),
        ("rig-0042-2024-03-17", datetime.date(2024, 3, 17)),
        ("2001-2024-03-17", datetime.date(2024, 3, 17)),
        ("0042-20240317-0042", datetime.date(2024, 3, 17)),
        ("serial 12345678", None),
        ("2024-13-17", None),
        ("120240317", None),
    ],
)
def test_a_date_in_a_name(text: str, date: datetime.date | None) -> None:
    assert date_in(text) == date


def points(folder: Path, shift_nm: float = 0.0, rig: str = "hybrid-actuator") -> Path:
    """The golden campaign of single friction readings, its torques shifted."""
    folder.mkdir(parents=True)
    for source in (GOLDEN / "inputs" / "points").iterdir():
        text = source.read_text().replace("hybrid-actuator", rig)
        if source.suffix == ".csv":
            head, *rows = text.strip().rsplit("\n", 6)
            rows = [f"{r.rsplit(',', 1)[0]},{float(r.rsplit(',', 1)[1]) + shift_nm}" for r in rows]
            text = "\n".join([head, *rows]) + "\n"
        (folder / source.name).write_text(text)
    return folder / "campaign.toml"


def test_where_rig_and_date_come_from(tmp_path: Path) -> None:
    path = points(tmp_path / "2024-03-17" / "arm")
    found = origin_of(read_campaign(path))
    assert (found.rig, found.date.isoformat()) == ("hybrid-actuator", "2024-03-17")
    assert found.date_from == "name of the folder 2024-03-17"
    plain = points(tmp_path / "a" / "b" / "c" / "d" / "e")
    for log in plain.parent.glob("*.csv"):
        os.utime(log, (1.7e9, 1.7e9))
    found = origin_of(read_campaign(plain))
    assert found.date.isoformat() == "2023-11-14" and "last change" in found.date_from
    plain.write_text('name = "after 2022-05-01"\n' + plain.read_text())
    assert origin_of(read_campaign(plain)).date.isoformat() == "2022-05-01"


def test_results_have_folders_of_their_own() -> None:
    paths = [Path(p) for p in ("/a/x/campaign.toml", "/b/x/campaign.toml", "/a/x/other.toml")]
    names = [result_folder(path) for path in paths]
    assert len(set(names)) == 3 and names[0].startswith("a-x-") and "other" in names[2]


# --- changes -------------------------------------------------------------------------------


@pytest.mark.parametrize("scatter", [1.0, 5.0])
def test_chance_is_not_called_a_change(scatter: float) -> None:
    """Also where the rig scatters more than the standard errors say."""
    rng = np.random.default_rng(20182)
    std = rng.uniform(0.5, 2.0, len(DAYS))
    found = [change_in(DAYS, rng.normal(0.0, scatter * std), std) for _ in range(1000)]
    assert sum(c is not None and c.p_value < 0.05 for c in found) <= 65


@pytest.mark.parametrize("first", [1, 4, 8])
@pytest.mark.parametrize("shape", ["step", "growth"])
def test_a_change_is_found_where_it_is(first: int, shape: str) -> None:
    rng = np.random.default_rng(first)
    std = np.full(len(DAYS), 0.02)
    grown = np.maximum(DAYS - DAYS[first - 1], 0.0) / 30.0
    course = grown if shape == "growth" else (np.arange(len(DAYS)) >= first) * 1.0
    change = change_in(DAYS, 1.0 + course + rng.normal(0.0, std), std)
    assert change is not None and (change.first, change.shape) == (first, shape)
    assert change.p_value < 1e-4
    assert abs(change.size - course[-1]) < 5.0 * change.std
    assert np.allclose(change.at(DAYS), 1.0 + course, atol=0.1)


def test_too_few_dates_and_two_campaigns_of_one_day() -> None:
    ones = np.ones(4)
    assert change_in(np.array([0.0, 0.0, 1.0, 2.0]), ones, ones) is None
    days = np.array([0.0, 0.0, 1.0, 1.0, 2.0, 3.0])
    change = change_in(days, np.array([0.0, 0.0, 0.0, 9.0, 9.0, 9.0]), np.full(6, 0.1))
    assert change is not None and change.first in (2, 4)  # not between two of one day


# --- leakage and rows ----------------------------------------------------------------------


def test_leakage_is_one_number_whatever_its_law() -> None:
    bundle = read_bundle(golden_bundle("diagnosed")).replaced(effects=[])
    assert leakage_flow(bundle) is None
    entry = entry_of(AtmosphereLeakage(5e-17, "a"))
    name = next(iter(entry.numbers()))
    parameters: dict[str, Any] = {**entry.to_json()["parameters"]}
    parameters[name] = {"value": 5e-17, "std": 1e-18, "unit": "kg/(s Pa^2)"}
    leaking = bundle.replaced(effects=[type(entry)(id=entry.id, parameters=parameters)])
    found = leakage_flow(leaking)
    air = bundle.rig.air
    assert found is not None and air is not None
    squares = air.supply_pressure_pa**2 - air.atmospheric_pressure_pa**2
    assert found == pytest.approx((5e-17 * squares, 1e-18 * squares))


def test_the_error_of_a_leak_is_that_of_the_chamber_that_loses_more() -> None:
    bundle = read_bundle(golden_bundle("diagnosed")).replaced(effects=[])
    leaks = (("a", 5e-16, 5e-18), ("b", 1e-17, 1e-17), ("a", 1e-16, 1e-18))
    effects = []
    for side, value, std in leaks:
        entry = entry_of(AtmosphereLeakage(value, side))
        parameters: dict[str, Any] = {**entry.to_json()["parameters"]}
        parameters[next(iter(entry.numbers()))] = {
            "value": value,
            "std": std,
            "unit": "kg/(s Pa^2)",
        }
        effects.append(type(entry)(id=entry.id, parameters=parameters))
    air = bundle.rig.air
    assert air is not None
    squares = air.supply_pressure_pa**2 - air.atmospheric_pressure_pa**2
    one = leakage_flow(bundle.replaced(effects=effects[:2]))
    assert one == pytest.approx((5e-16 * squares, 5e-18 * squares))
    both = leakage_flow(bundle.replaced(effects=effects))
    assert both == pytest.approx((6e-16 * squares, np.hypot(5e-18, 1e-18) * squares))


def test_leakage_beside_an_effect_of_the_users_own() -> None:
    class Own(AtmosphereLeakage):
        id = "own-leakage"

    bundle = read_bundle(golden_bundle("diagnosed"))
    entry = entry_of(AtmosphereLeakage(5e-17, "a")).to_json()
    name = next(iter(entry["parameters"]))
    entry["parameters"][name] = {"value": 5e-17, "std": 1e-18, "unit": "kg/(s Pa^2)"}
    own = EffectEntry.model_validate({**entry, "id": "own-leakage"})
    leaking = bundle.replaced(effects=[own])
    with pytest.raises(InputError, match="is not in the catalogue"):
        leakage_flow(leaking)
    families = {r.family for r in readings_of(bundle, leaking)}
    assert "friction" in families and "leakage" not in families
    known = {**catalogue(), "own-leakage": Own}
    assert "leakage" in {r.family for r in readings_of(bundle, leaking, known)}


def row(rig: str, place: int, friction: float, leak: float | None = None) -> FleetRow:
    date = datetime.date(2021, 1, 15) + datetime.timedelta(days=60 * int(place))
    readings = [FleetReading("friction", "friction.coulomb_nm", friction, 0.002, "Nm")]
    readings += [] if leak is None else [FleetReading("leakage", LEAKAGE, leak, 2e-7, "kg/s")]
    return FleetRow(
        campaign=f"/data/{rig}/{date}/campaign.toml",
        folder=f"{rig}-{date} #1",
        origin=Origin(rig, date, "rig file", "name of the folder"),
        verdict="adequate" if leak is None else "effects-found",
        effects={} if leak is None else {"atmosphere-leakage": 1e-30},
        readings=tuple(readings),
    )


@pytest.fixture(scope="module")
def made() -> Fleet:
    """Three rigs over ten dates: one wears from the fifth on, one leaks from the seventh on."""
    rng = np.random.default_rng(20183)
    rows = [
        row(
            rig,
            i,
            0.25 * (1.0 + 0.1 * max(i - 3, 0) * (rig == "worn") + 0.01 * rng.normal()),
            4e-6 * (1.0 + 0.05 * rng.normal()) if rig == "leaky" and i >= 6 else None,
        )
        for rig in ("sound", "worn", "leaky")
        for i in rng.permutation(10)
    ]
    broken = FleetRow.failed(
        Path("bad.toml"), "bad", None, "bad.toml: rig is missing; add <rig>", 2
    )
    return fleet_of([broken, *rows])


def test_each_change_is_found_at_its_date_and_no_other(made: Fleet) -> None:
    found = {(t.rig, t.family): t.since for t in made.changes}
    assert found == {("worn", "friction"): "2021-09-12", ("leaky", "leakage"): "2022-01-10"}
    assert made.changed_rigs()["worn"] == "friction from 2021-09-12 on"
    dates = [r.origin.date for r in made.rows if r.origin and r.origin.rig == "sound"]
    assert dates == sorted(dates) and len(dates) == 10
    leak = next(t for t in made.trends if t.family == "leakage")
    assert list(leak.values[:6]) == [0.0] * 6
    assert "appears with" in leak.sentence() and "rises by" in made.changes[0].sentence()


def test_a_changed_rig_file_and_shared_logs_are_said() -> None:
    """A level that moves with the rig file's numbers may be the file's, not the rig's."""
    rows = [
        dataclasses.replace(
            row("one", i, 0.25 if i < 3 else 0.35),
            rig={"cylinder": {"area": 1.0 if i < 3 else 1.4}, "rig": {"name": "one"}},
            fit_logs=(f"{min(i, 4)}" * 64, "f" * 63 + f"{i}"),
        )
        for i in range(6)
    ]
    assert fleet_of(rows).notices == (
        "one: the rig file differs from that of 2021-05-15: [cylinder]; what changed from "
        "2021-07-14 on may be the file, not the rig",
        "one of 2021-11-11: 1 of its 2 training logs are those of one of 2021-09-12, byte for "
        "byte: a test repeated on another date has a log of its own",
    )
    same = [dataclasses.replace(r, rig={"rig": {"name": "one"}}, fit_logs=()) for r in rows]
    assert fleet_of(same).changes and not fleet_of(same).notices
    unknown = [dataclasses.replace(r, rig={}, fit_logs=()) for r in rows[:3]]
    assert not fleet_of([*unknown, *rows[3:5]]).notices


@pytest.mark.parametrize(
    ("given", "points"),
    [({}, 10), ({"effects": {"orifice-leakage": 1e-9}}, 9), ({"is_whole": False}, 9)],
)
def test_a_leak_that_was_not_ruled_out_is_not_one_of_0(given: dict[str, Any], points: int) -> None:
    rows = [row("leaky", i, 0.25, 4e-6 if i >= 6 else None) for i in range(10)]
    rows[2] = dataclasses.replace(rows[2], **given)
    leak = next(t for t in fleet_of(rows).trends if t.family == "leakage")
    assert len(leak.values) == points


@pytest.mark.parametrize(("fill", "dis", "leaks"), [(-1, 1, ["b"]), (1, 1, []), (-1, 0, [])])
def test_a_valve_that_fills_less_and_empties_more_leaks(
    fill: int, dis: int, leaks: list[str]
) -> None:
    rng = np.random.default_rng(20184)
    rows = []
    for i in range(10):
        shift = 0.004 * (i >= 5)
        flows = {"c_fill": 1.5e-6 * (1.0 + fill * shift), "c_dis": 3.7e-9 * (1.0 + dis * shift)}
        flow = tuple(
            FleetReading("flow", f"valves.b.discrete.{k}", v * rng.normal(1.0, 4e-4), 4e-4 * v, "-")
            for k, v in flows.items()
        )
        rows.append(dataclasses.replace(row("rig", i, 0.25), readings=flow))
    fleet = fleet_of(rows)
    assert [sign.side for sign in fleet.leaks] == leaks
    assert all(sign.since == "2021-11-11" for sign in fleet.leaks)
    assert ("leak of chamber B" in fleet.headline()) == bool(leaks)
    assert ("plug its port" in fleet_page(fleet)) == bool(leaks)


def test_the_sign_of_a_leak_where_a_number_is_missing_on_a_date() -> None:
    rng = np.random.default_rng(20186)
    rows = []
    for i in range(12):
        flows = {"c_fill": 1.0 - 0.004 * (i >= 7), "c_dis": 1.0 + 0.004 * (i >= 7)}
        if i in (1, 3):
            del flows["c_dis"]
        flow = tuple(
            FleetReading("flow", f"valves.b.discrete.{k}", v * rng.normal(1.0, 2e-4), 2e-4, "-")
            for k, v in flows.items()
        )
        rows.append(dataclasses.replace(row("rig", i, 0.25), readings=flow))
    assert [sign.side for sign in fleet_of(rows).leaks] == ["b"]


def test_a_fleet_is_shown_and_written(made: Fleet) -> None:
    assert "31 campaigns of 3 rigs, 1 without a result" in made.headline()
    assert len(made.to_frame()) == 40
    assert made.plot().get_lines()
    content = json.loads(json.dumps(made.to_json(), allow_nan=False))
    assert [c["folder"] for c in content["campaigns"]] == [r.folder for r in made.rows]
    assert {r["value"] for r in made.records() if r["family"] == "friction"} == {
        reading["value"]
        for c in content["campaigns"]
        for reading in c["readings"]
        if reading["family"] == "friction"
    }


def test_the_page_links_to_the_reports(made: Fleet) -> None:
    page = fleet_page(made)
    assert page.count(">report</a>") == 30
    assert 'href="worn-2021-01-15%20%231/report.html"' in page
    assert "add &lt;rig&gt;" in page
    assert page.count("<svg") == 4 and "fig-0-0" in page
    assert 'class="verdict poor"' in page


def test_rotary_and_linear_rigs_have_columns_of_their_own() -> None:
    axis = dataclasses.replace(
        row("axis", 0, 0.25),
        readings=(FleetReading("friction", "friction.coulomb_n", 17.25, 0.1, "N"),),
    )
    page = fleet_page(fleet_of([axis, row("arm", 0, 0.25)]))
    assert "Coulomb friction (N)" in page and "Coulomb friction (Nm)" in page.replace("N·m", "Nm")
    assert "17.25" in page


def test_a_fleet_without_a_trend() -> None:
    small = fleet_of([row("one", 0, 0.25)])
    assert "1 rig, 1 campaign" in fleet_page(small) and "1 rigs" not in fleet_page(small)
    assert "no rig with 4 dates" in small.headline()
    assert "No rig has enough dates" in fleet_page(small)


@pytest.mark.parametrize(("codes", "wanted"), [((3, 3), 3), ((3, 2), 2), ((1, 1), 2)])
def test_how_a_fleet_without_a_result_ends(
    codes: tuple[int, ...],
    wanted: int,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rows = [FleetRow.failed(Path(f"{i}.toml"), str(i), None, "why", c) for i, c in enumerate(codes)]
    monkeypatch.setattr("sysid.commands.fleet.run_fleet", lambda *_, **__: fleet_of(rows))
    assert main(["fleet", "a.toml", "-o", str(tmp_path)]) == wanted
    assert "1.toml: no result: why" in capsys.readouterr().err


def test_each_campaigns_notices_are_shown(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [
        dataclasses.replace(row(rig, i, 0.25), notices=(f"log {i}.csv: {i} samples lack",))
        for i, rig in enumerate(("left", "right"))
    ]
    rows[0].write(tmp_path)
    assert json.loads((tmp_path / "row.json").read_text())["notices"] == list(rows[0].notices)
    monkeypatch.setattr("sysid.commands.fleet.run_fleet", lambda *_, **__: fleet_of(rows))
    words = ["fleet", "a.toml", "-o", str(tmp_path)]
    assert main(words) == 0
    assert "(likewise " in (said := capsys.readouterr().err) and "log 1.csv, 1)" in said
    assert main([*words, "-v"]) == 0
    said = capsys.readouterr().err
    assert all(f"{one.folder}: {one.notices[0]}" in said for one in rows)


# --- the command ---------------------------------------------------------------------------


def content(path: Path) -> Any:
    """A bundle without the time at which it was made."""
    return {k: v for k, v in json.loads(path.read_text()).items() if k != "created"}


def test_a_fleet_resumes_and_goes_on_past_a_bad_campaign(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    campaigns = [points(tmp_path / f"2024-0{i}-01", 0.01 * i) for i in (1, 2)]
    bad = tmp_path / "bad.toml"
    bad.write_text("[[log]]\n")
    words = ["fleet", *map(str, [*campaigns, bad]), "-o", str(tmp_path / "out")]
    options = ["--no-diagnose", "--no-refine", "--json", "--jobs", "1"]
    assert main([*words, *options]) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert [c["failure"] == "" for c in found["campaigns"]] == [True, True, False]
    assert "no result" in said.err and "rig is missing" in said.err
    folder = tmp_path / "out" / found["campaigns"][0]["folder"]
    assert (folder / "report.html").is_file()
    kept = json.loads((folder / "row.json").read_text())
    assert kept["rig"] == content(folder / "bundle.json")["rig"] and len(kept["fit_logs"]) == 3
    before = (folder / "bundle.json").stat().st_mtime_ns
    shutil.rmtree(tmp_path / "out" / found["campaigns"][1]["folder"])
    assert main([*words, *options]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["trends"] == found["trends"]
    notices = [c["notices"] for c in found["campaigns"]]
    assert notices[0] and [c["notices"] for c in again["campaigns"]] == notices
    assert (folder / "bundle.json").stat().st_mtime_ns == before
    assert main([*words[:2], *words[1:]]) == 2
    assert "is given twice" in capsys.readouterr().err
    campaigns[0].write_text("[[log]]\n")
    failed = run_one(campaigns[0], tmp_path / "out", **QUICK)
    assert failed.exit_code == 2 and json.loads((folder / "row.json").read_text())["failure"]


def test_a_campaign_that_fails_leaves_no_empty_folder(tmp_path: Path) -> None:
    campaign = points(tmp_path / "2024-01-01")
    for log in campaign.parent.glob("*.csv"):
        log.write_text("time_s\n0\n")
    failed = run_one(campaign, tmp_path / "out", **QUICK)
    assert failed.failure and not (tmp_path / "out" / failed.folder / "export").exists()


def test_the_file_of_effects_is_found_from_any_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    given = []

    def one(campaign: Path, folder: Path, options: FleetOptions) -> FleetRow:
        given.append(options.effects)
        return row("rig", 0, 0.25)

    monkeypatch.setattr("sysid.pipeline.fleet.run_one", one)
    monkeypatch.chdir(tmp_path)
    run_fleet((Path("campaign.toml"),), Path("out"), effects=Path("my.py"))
    assert given == [tmp_path / "my.py"]


# --- Dask ----------------------------------------------------------------------------------


def dies_once(mark: str) -> int:
    path = Path(mark)
    if not path.exists():
        path.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 7


def counts(mark: str) -> int:
    with Path(mark).open("a") as file:
        file.write("ran\n")
    time.sleep(1.0)
    return 8


def fails() -> int:
    raise ValueError("no such thing")


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_dask_gives_the_same_results_and_survives_a_killed_worker(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    campaigns = (points(tmp_path / "2024-01-01", 0.01),)
    with on_cluster("local", 1):
        jobs = [fails, partial(dies_once, str(tmp_path / "mark")), os.getpid]
        failed, survived, process = attempt_all(jobs)
        assert isinstance(failed, Failure) and "no such thing" in failed.reason
        assert survived == 7 and process != os.getpid()
        there = run_fleet(campaigns, tmp_path / "dask", **QUICK)
    here = run_fleet(campaigns, tmp_path / "here", **QUICK)
    # A notice may name the folder.
    said = json.dumps(there.to_json()).replace(str(tmp_path / "dask"), str(tmp_path / "here"))
    assert json.loads(said) == here.to_json()
    for name in [r.folder for r in here.rows]:
        ours, theirs = (tmp_path / where / name / "bundle.json" for where in ("here", "dask"))
        assert content(ours) == content(theirs)


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_what_a_dead_worker_did_not_run_is_not_run_again(tmp_path: Path) -> None:
    pytest.importorskip("distributed")  # its settings have to be there before one is set
    dask = pytest.importorskip("dask")
    jobs = [partial(counts, str(tmp_path / "ran")), partial(dies_once, str(tmp_path / "mark"))]
    settings = {"distributed.scheduler.allowed-failures": 0}
    with dask.config.set(settings), on_cluster("local", 2):
        assert attempt_all(jobs) == [8, 7]
    assert (tmp_path / "ran").read_text() == "ran\n"


def addresses() -> set[str]:
    """Where this process and those that it started listen, or are connected."""
    me = pytest.importorskip("psutil").Process()
    tree = [me, *me.children(recursive=True)]
    return {found.laddr.ip for one in tree for found in one.net_connections("inet")}


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_local_cluster_is_heard_on_this_machine_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setenv("SYSID_JOBS", "2")
    found: list[set[str]] = []

    def tell(line: str) -> None:
        if line.startswith("Dask: "):
            assert "Dask: tls://127.0.0.1:" in line and ", 2 workers, http://127.0.0.1:" in line
            found.append(addresses())

    campaigns = (points(tmp_path / "2024-01-01", 0.01),)
    done = run_fleet(campaigns, tmp_path / "out", scheduler="local", progress=tell, **QUICK)
    assert not done.failed
    assert found == [{"127.0.0.1"}]


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_local_cluster_takes_work_from_its_own_process_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    distributed = pytest.importorskip("distributed")
    dask = pytest.importorskip("dask")
    with on_cluster("local", 1) as cluster:
        monkeypatch.setattr("sysid.parallel.cluster._CONNECT_S", 1.0)
        own = cluster.client.security
        others = distributed.Security.temporary()
        plain = cluster.address.replace("tls://", "tcp://")
        for address, shown in ((plain, None), (cluster.address, None), (cluster.address, others)):
            with pytest.raises((OSError, TypeError)), collector_off():
                distributed.Client(address, security=shown, timeout=1.0, set_as_default=False)
        with (
            pytest.raises(InputError, match=r"tls://.*: no Dask scheduler answers"),
            on_cluster(cluster.address, 1),
        ):
            raise AssertionError
        # Whoever has the certificate is let in: Dask's configuration names it.
        with dask.config.set(tls_settings(tmp_path, own)), on_cluster(cluster.address, 1):
            (process,) = attempt_all([os.getpid])
            assert process != os.getpid()


def tls_settings(folder: Path, security: Any) -> dict[str, str]:
    """Dask's configuration of a client that shows this certificate."""
    files = {"ca-file": "tls_ca_file", "client.cert": "tls_client_cert"}
    files["client.key"] = "tls_client_key"
    for key, name in files.items():
        (folder / key).write_text(getattr(security, name))
    return {f"distributed.comm.tls.{key}": str(folder / key) for key in files}


def test_a_local_cluster_without_cryptography(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setitem(__import__("sys").modules, "cryptography", None)
    what = "--scheduler local: needs cryptography, which is not installed"
    with pytest.raises(InputError, match=what), on_cluster("local", 1):
        raise AssertionError


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_scheduler_without_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr("sysid.parallel.cluster._CONNECT_S", 1.0)
    none = {"n_workers": 0, "processes": False, "dashboard_address": ":0", "protocol": "tcp://"}
    wanted = pytest.raises(InputError, match="has no workers; start `dask worker tcp:")
    with distributed.LocalCluster(**none) as empty, wanted, on_cluster(empty.scheduler_address, 1):
        raise AssertionError


def test_an_encrypted_address_without_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refused before a client is made: closing that took 20 s, and ended in a traceback."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "Client", None)
    for address in ("tls://127.0.0.1:9", "wss://127.0.0.1:9"):
        wanted = pytest.raises(InputError, match=f"--scheduler {address}: .*names none; name the")
        with wanted, on_cluster(address, 1):
            raise AssertionError


def test_a_scheduler_that_does_not_answer() -> None:
    pytest.importorskip("distributed")
    for address in ("nonsense", "tcp://127.0.0.1:1:2"):
        with pytest.raises(InputError, match="no Dask scheduler answers"), on_cluster(address, 1):
            raise AssertionError


def test_dask_that_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(InputError, match="needs dask, which is not installed"), on_cluster("x", 1):
        raise AssertionError


# --- in a browser --------------------------------------------------------------------------


def test_the_page_fits_a_desk_and_a_phone(made: Fleet, tmp_path: Path, browser: Any) -> None:
    """Nothing is wider than the window but what scrolls in a frame of its own."""
    (tmp_path / "fleet.html").write_text(fleet_page(made))
    for width, scheme in ((1400, "light"), (390, "dark")):
        window = {"width": width, "height": 900}
        page = browser.new_page(viewport=window, color_scheme=scheme)
        said: list[str] = []
        page.on("console", lambda message, said=said: said.append(message.text))
        page.goto((tmp_path / "fleet.html").as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(OUTSIDE) == [] and said == []
        assert width < 1400 or page.evaluate(SCROLLED) == 0
