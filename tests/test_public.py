"""`import sysid as si` as a notebook's user has it: README's example, every docstring's example,
and results that show themselves."""

from __future__ import annotations

import doctest
import importlib
import json
import os
import pydoc
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from small_campaign import write_small

import sysid as si
from sysid.blocks.numbers import ascii_text
from sysid.blocks.shown import Shown
from sysid.blocks.tables import plain_text

REPOSITORY = Path(__file__).resolve().parent.parent
BENCH_RIG = """\
[rig]
name = "valve"
orientation = "horizontal"

[air]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
temperature_k = 293.15
atmospheric_pressure_pa = 100000.0
supply_pressure_pa = 300000.0
"""
BENCH_CAMPAIGN = """\
rig = "rig.toml"

[[log]]
kind = "valve-flow"
file = "flow.csv"
valve = "a"
"""


def write_friction_log(folder: Path) -> None:
    """The campaign's friction tests in one file, run.csv."""
    campaign = si.read_campaign(folder / "campaign.toml")
    frames = []
    for entry in campaign.select(["friction-static", "friction-sliding"]):
        frame = campaign.read(entry).frame
        frames.append(frame.assign(test=entry.kind + " " + frame["test"]))
    pd.concat(frames).to_csv(folder / "run.csv", index=False)


def write_bench(folder: Path) -> None:
    """A proportional valve with a dead band of 0.3 on a bench, swept up and down."""
    folder.mkdir()
    frames = []
    for seed, label in enumerate(("up", "down")):
        duty = np.linspace(0.0, 1.0, 101)[:: 1 if label == "up" else -1]
        flow = 2.7e-3 * np.clip((duty - 0.3) / 0.7, 0.0, 1.0)
        noise = 1e-5 * np.random.default_rng(seed).normal(size=len(duty))
        columns = {"test": label, "time_s": np.arange(101.0), "duty_a": duty}
        frames.append(pd.DataFrame({**columns, "flow_a_kg_s": flow + noise}))
    pd.concat(frames).to_csv(folder / "flow.csv", index=False)
    (folder / "rig.toml").write_text(BENCH_RIG)
    (folder / "campaign.toml").write_text(BENCH_CAMPAIGN)


def readme_block() -> str:
    blocks = re.findall(r"```python\n(.*?)```", (REPOSITORY / "README.md").read_text(), re.S)
    (block,) = [b for b in blocks if "import sysid as si\n" in b and "read_campaign" in b]
    return str(block)


@pytest.fixture(scope="module")
def namespace(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """The names that README's example leaves, in a folder with its files."""
    folder = tmp_path_factory.mktemp("notebook")
    write_small(folder)
    write_friction_log(folder)
    write_bench(folder / "bench")
    before = Path.cwd()
    os.chdir(folder)
    matplotlib.use("Agg")
    names: dict[str, Any] = {}
    try:
        exec(compile(readme_block(), "README.md", "exec"), names)
        yield names
    finally:
        os.chdir(before)
        plt.close("all")


# --- README's example ------------------------------------------------------------------


def test_the_example_fits_and_diagnoses(namespace: dict[str, Any]) -> None:
    coulomb = namespace["friction"].coulomb_nm
    assert coulomb.interval[0] < coulomb.value < coulomb.interval[1] and coulomb.unit == "Nm"
    assert isinstance(namespace["bundle"], si.Bundle)
    found = namespace["found"]
    assert found.verdict in ("adequate", "effects-found", "unexplained")
    assert isinstance(found.bundle, si.Bundle)
    assert len(found.bundle.effects) == len(found.effects)
    assert set(found.residual) == {"theta_rad", "pressure_a_pa", "pressure_b_pa"}


def test_the_example_simulates_every_test_with_the_effect(namespace: dict[str, Any]) -> None:
    runs, log, bundle = namespace["runs"], namespace["log"], namespace["bundle"]
    assert [run.label for run in runs] == [trial.label for trial in log.trials]
    assert runs[1].frame.equals(runs[log.trials[1].label].frame)
    assert len(runs.frame) == len(log.frame)
    plain = si.simulate(log, bundle.model())
    moved = "friction-sliding 1"
    assert not np.allclose(plain[moved].channels["theta_rad"], runs[moved].channels["theta_rad"])


def test_the_example_validates_and_writes(namespace: dict[str, Any]) -> None:
    fits = namespace["checked"].fit_percent
    assert (fits["theta_rad"] > 90.0).all()
    assert fits.index.names == ["file", "use", "valve_model"]
    page = Path("out.html").read_text()
    assert namespace["campaign"].rig.name in page and "Diagnosis" in page
    assert "sysid_" in Path("model.h").read_text()


# --- examples of the docstrings --------------------------------------------------------


@pytest.mark.parametrize("name", ["sysid", *si.__all__])
def test_the_docstring_has_an_example_that_runs(name: str, namespace: dict[str, Any]) -> None:
    item = si if name == "sysid" else getattr(si, name)
    finder = doctest.DocTestFinder(recurse=False)
    (test,) = finder.find(item, name, module=False, globs=dict(namespace))
    assert test.examples, f"{name} has no example"
    lines: list[str] = []
    failures = doctest.DocTestRunner(verbose=False).run(test, out=lines.append).failed
    assert failures == 0, "".join(lines)


# --- names -----------------------------------------------------------------------------


def python(code: str) -> str:
    """What a fresh process prints."""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=REPOSITORY)
    return done.stdout


def test_importing_loads_nothing_heavy() -> None:
    code = (
        "import sys; before = set(sys.modules); import sysid; "
        "print({m.partition('.')[0] for m in set(sys.modules) - before})"
    )
    loaded = eval(python(code))
    assert "sysid" in loaded
    assert not loaded & {"numpy", "pandas", "pydantic", "click", "rich", "jax", "matplotlib"}


def test_names_are_listed_and_load() -> None:
    assert dir(si) == sorted([*si.__all__, "__version__"])
    assert all(getattr(si, name) is not None for name in si.__all__)
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        _ = si.fitt  # type: ignore[attr-defined]


def test_help_is_two_screens_that_name_everything() -> None:
    text = pydoc.plain(pydoc.render_doc(si))
    assert len(text.splitlines()) <= 90
    named = set(re.findall(r"`(\w+)`", si.__doc__ or ""))
    assert set(si.__all__) <= named


def test_a_bundle_lists_what_is_its_own() -> None:
    bundle = si.read_bundle(REPOSITORY / "tests" / "golden" / "bundles" / "diagnosed.json")
    names = dir(bundle)
    assert {"friction", "valve", "model", "effects", "to_frame"} <= set(names)
    assert not [name for name in names if name.startswith(("_", "model_"))]
    assert not {"dict", "json", "copy", "parse_obj", "construct"} & set(names)


def test_rooms_of_controllers_and_exporters_are_imported_by_name() -> None:
    code = (
        "import sysid.controllers.backstepping as b, sysid.exporters.flat as f, sysid as si; "
        "print(b.__name__, f.__name__, si.control.__name__, si.export.__name__)"
    )
    found = python(code).split()
    assert found == ["sysid.controllers.backstepping", "sysid.exporters.flat", "control", "export"]


def test_every_effect_of_the_catalogue_is_there_by_its_class_name() -> None:
    for effect in si.effects.catalogue().values():
        assert getattr(si.effects, effect.__name__) is effect
        assert effect.__name__ in si.effects.__all__


def test_types_are_shipped() -> None:
    assert (Path(si.__file__).parent / "py.typed").is_file()


# --- objects and paths -----------------------------------------------------------------


def test_a_log_is_a_frame(namespace: dict[str, Any]) -> None:
    log = namespace["log"]
    written = pd.read_csv("run.csv")
    frame = log.frame[["test", *(c for c in written.columns if c != "test")]]
    pd.testing.assert_frame_equal(frame, written[frame.columns], check_dtype=False)
    trial = log["friction-static 2"]
    assert np.array_equal(trial.frame["theta_rad"], trial["theta_rad"])
    with pytest.raises(KeyError):
        log["no such test"]


def test_a_rig_is_found_given_or_read(namespace: dict[str, Any]) -> None:
    rig = namespace["campaign"].rig
    for given in (None, "rig.toml", Path("rig.toml"), rig):
        read = si.read_log("run.csv", given).rig
        assert read is not None and read.content == rig.content


def test_friction_takes_logs_or_single_tests(namespace: dict[str, Any]) -> None:
    log, rig, whole = namespace["log"], namespace["campaign"].rig, namespace["friction"]
    for tests in (log, [log], log.trials):
        assert si.fit_friction(tests, rig).coulomb_nm == whole.coulomb_nm
    with pytest.raises(si.InputError, match="pass a rig"):
        si.fit_friction(log.trials)
    with pytest.raises(AttributeError, match="it holds static_nm, coulomb_nm"):
        _ = whole.columb_nm
    assert "viscous_nm_s_per_rad" in dir(whole)


def test_a_bundle_simulates_as_its_model(namespace: dict[str, Any]) -> None:
    log, bundle = namespace["log"].trials[:1], namespace["bundle"]
    rig = namespace["campaign"].rig
    ours, theirs = si.simulate(log, bundle, rig), si.simulate(log, bundle.model(), rig)
    pd.testing.assert_frame_equal(ours.frame, theirs.frame)
    with pytest.raises(si.InputError, match="pass the bundle"):
        si.simulate(log, bundle.model(), rig, valve_model="ann")
    with pytest.raises(si.NotIdentifiedError, match="ann"):
        si.simulate(log, bundle, rig, valve_model="ann")


def test_what_is_no_test_is_said(namespace: dict[str, Any]) -> None:
    log, bundle = namespace["log"], namespace["bundle"]
    rig = namespace["campaign"].rig
    with pytest.raises(si.InputError, match=r"DataFrame is neither a log nor .* si\.read_log"):
        si.simulate(log.frame, bundle, rig)
    with pytest.raises(si.InputError, match="str is neither a log"):
        si.simulate("run.csv", bundle)
    runs = si.simulate(log.trials[:1], bundle.model(), rig)
    assert runs[runs[0].label] is runs[0]
    with pytest.raises(KeyError, match=f"no test 'nope': the tests are '{runs[0].label}'"):
        runs["nope"]


def test_own_effects_are_classes_or_a_file(
    namespace: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (REPOSITORY / "docs" / "how-to" / "own-effect.md").read_text("utf-8")
    (source,) = re.findall(r"```\{file\} my_effects.py\n(.*?)```", page, re.S)
    Path("own.py").write_text(source)
    monkeypatch.syspath_prepend(".")
    own = importlib.import_module("own")
    part = si.read_campaign("bench/campaign.toml")
    bundle = si.fit(part)
    for effects in ("own.py", [own.HoseDrag]):
        assert si.diagnose(part, bundle, effects=effects).verdict == "effects-found"
    with pytest.raises(si.InputError, match="takes the id"):
        si.diagnose(part, bundle, effects=[si.effects.Backlash])


def test_exports_go_by_the_suffix(namespace: dict[str, Any]) -> None:
    bundle = namespace["bundle"]
    for name in ("model.h", "model.mat", "model.json"):
        si.export(bundle, name)
        assert Path(name).stat().st_size > 0
    with pytest.raises(si.InputError, match="pass format"):
        si.export(bundle, "model.txt")


# --- results show themselves -----------------------------------------------------------


def results(names: dict[str, Any]) -> dict[str, Any]:
    """A result of each kind, those that the example has not made among them."""
    part = si.read_campaign("bench/campaign.toml")
    return {
        **{name: names[name] for name in ("log", "friction", "bundle", "runs", "found", "checked")},
        "check": si.check(names["log"]),
        "part": si.diagnose(part, si.fit(part)),
        "valves": si.fit_valve_discrete(si.read_log("valve_discrete_a.parquet"), find_ratio=False),
        "surfaces": si.fit_valve_pwm(si.read_log("valve_pwm_a.parquet"), surface="bipolynomial"),
    }


@pytest.fixture(scope="module")
def shown(namespace: dict[str, Any]) -> dict[str, Any]:
    return results(namespace)


DRAWN = ("log", "friction", "runs", "found", "checked", "check", "part", "valves", "surfaces")


@pytest.mark.parametrize("name", [*DRAWN, "bundle"])
def test_a_result_is_one_line_text_html_and_a_frame(name: str, shown: dict[str, Any]) -> None:
    result = shown[name]
    assert isinstance(result, Shown)
    assert "\n" not in repr(result) and len(repr(result)) < 300
    text, html = str(result), result._repr_html_()
    assert text.startswith(ascii_text(result.headline()))
    for table in result.tables():
        for row in table.rows:
            first = [plain_text(cell).split("\n")[0] for cell in row]
            assert any(all(c in line for c in first) for line in text.splitlines())
            assert all(line in text for cell in row for line in plain_text(cell).split("\n"))
            assert "<td>" in html
    frame = result.to_frame()
    assert isinstance(frame, pd.DataFrame)
    assert len(frame) or not result.records()


@pytest.mark.parametrize("name", ["campaign", "rig", "model"])
def test_what_is_read_shows_itself_in_a_few_lines(name: str, namespace: dict[str, Any]) -> None:
    campaign = namespace["campaign"]
    item = {"campaign": campaign, "rig": campaign.rig, "model": namespace["model"]}[name]
    text = str(item)
    assert "\n" not in repr(item) and len(repr(item)) < 150
    assert 5 <= len(text.splitlines()) <= 16
    assert max(map(len, text.splitlines())) <= 100
    assert item._repr_html_().startswith("<div>") and len(item.to_frame()) == len(item.records())
    for word in {
        "campaign": ["friction-static", "valve_discrete_a.parquet and 1 more"],
        "rig": ["area_a_m2=0.0004325", "supply_pressure_pa=312000"],
        "model": ["StribeckFriction", "inertia=0.01962", "choked_fill_b"],
    }[name]:
        assert word in text


def test_plots_leave_no_figure_open(shown: dict[str, Any]) -> None:
    plt.close("all")
    for name in DRAWN:
        drawn = shown[name].plot()
        axes = drawn if isinstance(drawn, list) else [drawn]
        assert all(ax.get_ylabel() or len(ax.get_yticks()) == 0 for ax in axes[:1])
    assert plt.get_fignums() == []


# --- a diagnosis in a file -------------------------------------------------------------


def test_a_diagnosis_is_read_as_it_was_printed(namespace: dict[str, Any]) -> None:
    found = namespace["found"]
    Path("printed.json").write_text(json.dumps(found.detail.to_json()))
    read = si.read_diagnosis("printed.json")
    assert (read.verdict, read.residual) == (found.verdict, found.residual)
    assert [e.id for e in read.effects] == [e.id for e in found.effects]
    assert read.headline() == found.headline()
    said = [line for line in found.footnotes() if not line.startswith("notice")]
    assert [line for line in read.footnotes() if not line.startswith("notice")] == said
    errors = [t for t in read.tables() if "RMSE" in t.caption]
    assert errors == [t for t in found.tables() if "RMSE" in t.caption]
    assert read.plot().has_data() == found.plot().has_data()


def test_a_diagnosis_is_read_from_its_bundle(tmp_path: Path) -> None:
    file = REPOSITORY / "tests" / "golden" / "bundles" / "diagnosed.json"
    read = si.read_diagnosis(file)
    assert read.verdict == "effects-found" and read.bundle is not None
    held = json.loads(file.read_text())["effects"][0]["holdout_rmse"]["theta_rad"]
    assert read.residual["theta_rad"].before == held["before"]
    assert [e.id for e in read.effects] == ["seal-friction"]
    assert "seal-friction" in str(read) and read.plot().has_data()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "line 1: is not JSON"),
        ("[1]", "is not a JSON object"),
        ("{}", "holds no verdict"),
        ('{"verdict": "good", "effects": []}', "verdict is 'good'"),
        ('{"verdict": "adequate", "effects": []}', "residual is missing"),
        (
            '{"verdict": "adequate", "effects": [{"id": 1}], "residual": {}, "unexplained": [], '
            '"notices": []}',
            "effect 1: id is missing",
        ),
    ],
)
def test_what_is_no_diagnosis_is_said(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "found.json"
    path.write_text(text)
    with pytest.raises(si.InputError, match=f"found.json.*{re.escape(said)}.*; give") as caught:
        si.read_diagnosis(path)
    assert "\n" not in str(caught.value)


def test_a_bundle_that_was_not_diagnosed_is_no_diagnosis() -> None:
    with pytest.raises(si.InputError, match="without a diagnosis's verdict; diagnose it"):
        si.read_diagnosis(REPOSITORY / "tests" / "golden" / "bundles" / "validated.json")


@pytest.mark.parametrize("name", DRAWN)
def test_a_result_draws_itself_on_new_axes_or_those_given(name: str, shown: dict[str, Any]) -> None:
    drawn = shown[name].plot()
    axes = drawn if isinstance(drawn, list) else [drawn]
    assert all(ax.has_data() for ax in axes)
    _, own = plt.subplots(len(axes), squeeze=False)
    again = shown[name].plot(list(own[:, 0]) if isinstance(drawn, list) else own[0, 0])
    assert np.array_equal(np.ravel(again), own[:, 0])
    assert all(ax.has_data() for ax in own[:, 0])
    plt.close("all")


def test_a_test_of_a_validation_draws_its_curves(namespace: dict[str, Any]) -> None:
    test = namespace["checked"].logs[0].tests[0]
    assert len(test.plot()) == 3
    assert len(test.frame) == len(test.time)
    _, too_few = plt.subplots(2)
    with pytest.raises(si.InputError, match="2 for 3 panels"):
        test.plot(too_few)
    plt.close("all")


def test_plots_of_friction_hold_the_points_and_the_fit(namespace: dict[str, Any]) -> None:
    friction = namespace["friction"]
    ax = friction.plot()
    points = [line for line in ax.lines if line.get_marker() in ("o", "s")]
    used = [use for use in friction.trials if use.used and use.kind == "friction-sliding"]
    assert sum(len(line.get_xdata()) for line in points) == len(used)
    law = next(line for line in ax.lines if line.get_marker() not in ("o", "s"))
    first = friction.coulomb_nm.value + friction.offset_nm.value
    assert law.get_ydata()[0] == pytest.approx(first)
    plt.close("all")
