"""Files of components that cannot be used: one line that names the file, and the line in it."""

from __future__ import annotations

from pathlib import Path

import pytest
from own_components import FOLDER, done, refused, run

import sysid as si
from sysid.components.definition import DynamicComponent
from sysid.components.loading import component_in
from sysid.components.simulation import _identity
from sysid.errors import InputError

GOOD = """\
import jax.numpy as jnp
from sysid.components import DynamicComponent, LogColumn, Parameter, Quantity, Term


def drag(state, inputs, values):
    return {"speed": -values["drag"] * state["speed"]}


class Cart(DynamicComponent):
    kind = "cart"
    columns = {"push_n": LogColumn("N", "input"), "speed_m_per_s": LogColumn("m/s", "output")}
    parameters = (Parameter("mass_kg", 2.0, "kg", 0.1, 10.0),)
    states = ("speed",)
    terms = (Term("drag", "drag", (Quantity("drag", "1/s", 0.1, 0.0, 10.0, ""),), drag),)

    def start(self, first, rates, values):
        return {"speed": first["speed_m_per_s"]}

    def derivative(self, state, inputs, values):
        return {"speed": inputs["push_n"] / values["mass_kg"]}

    def measure(self, state, inputs, values):
        return {"speed_m_per_s": state["speed"]}
"""
RIG = '[rig]\nname = "cart"\norientation = "horizontal"\n'
CAMPAIGN = """\
rig = "rig.toml"

[[log]]
kind = "cart"
file = "run.csv"

[[log]]
kind = "cart"
file = "other.csv"
use = "holdout"
"""


@pytest.fixture
def campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SYSID_JOBS", "1")
    (tmp_path / "rig.toml").write_text(RIG, "utf-8")
    (tmp_path / "campaign.toml").write_text(CAMPAIGN, "utf-8")
    for k, name in enumerate(("run.csv", "other.csv")):
        speed, rows = 0.0, []
        for i in range(200):
            push = 1.0 if (i // (20 + 5 * k)) % 2 else -0.8
            rows.append(f"{0.01 * i:.2f},{push},{speed:.6f}")
            speed += 0.01 * push / 1.7
        text = "\n".join(["time_s,push_n,speed_m_per_s", *rows, ""])
        (tmp_path / name).write_text(text, "utf-8")
    return tmp_path / "campaign.toml"


def test_the_file_is_good(campaign: Path) -> None:
    (campaign.parent / "cart.py").write_text(GOOD, "utf-8")
    read = si.read_campaign(campaign, component=campaign.parent / "cart.py")
    bundle = si.fit(read)
    assert bundle.component is not None
    # A single test is cut into stretches, and where the push turns the start is smoothed across it.
    assert bundle.component.parameters["mass_kg"].value == pytest.approx(1.7, rel=2e-2)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("import jax", "import nothing_of_that_name, jax", "line 1: does not run: ModuleNotFound"),
        ('kind = "cart"', 'kind = "cart" +', "line 10: does not run: SyntaxError"),
        ("DynamicComponent):", "object):", "defines no component"),
        ('    kind = "cart"\n', "", "class Cart lacks kind"),
        ('kind = "cart"', 'kind = "tank"', "kind 'tank' is one of the log format"),
        ('kind = "cart"', 'kind = "boat"', "has no log of kind boat, but of cart"),
        ('"N", "input"', '"N", "driver"', "column push_n: has role 'driver'"),
        ('LogColumn("N", ', 'LogColumn("Newtons!", ', "'Newtons!' is not a known unit"),
        ('"m/s", "output"', '"m/s", "input"', "predicts nothing"),
        ("2.0, \"kg\"", "20.0, \"kg\"", "parameter mass_kg: starts at 20, outside its bounds"),
        ('(Parameter("mass_kg", 2.0, "kg", 0.1, 10.0),)', "()", "has no parameter"),
        ('states = ("speed",)', 'states = "speed"', "states is not a tuple of names"),
        ('return {"speed": first', 'return {"velocity": first', "start: does not give speed"),
        ('inputs["push_n"]', 'inputs["pull_n"]', "line 20: does not run: KeyError: 'pull_n'"),
        ("    def measure", "    def measured", "class Cart lacks measure"),
        ('{"speed_m_per_s": state', '{"velocity": state', "measure: does not give speed_m_per_s"),
        ('-values["drag"] *', "1.0 +", "term drag: does not vanish where its strengths are 0"),
        ('return {"speed": -values', 'return {"drag": -values', "does not give rates by state"),
        ('Quantity("drag"', 'Quantity("mass_kg"', "mass_kg is declared twice"),
        ('Quantity("drag"', 'Quantity("drag/s"', "quantity drag/s: cannot be a name"),
        ('Quantity("drag"', 'Quantity("title"', "quantity title: cannot be a name"),
    ],
)  # fmt: skip
def test_a_bad_file(campaign: Path, old: str, new: str, said: str) -> None:
    assert old in GOOD
    path = campaign.parent / "cart.py"
    path.write_text(GOOD.replace(old, new, 1), "utf-8")
    output = campaign.parent / "b.json"
    line = refused("fit", campaign, "--component", path, "-o", output)
    assert said in line and "cart.py" in line.replace("campaign.toml", "cart.py")
    assert not output.exists()


STATIC = """\
import numpy as np
from sysid.components import LogColumn, Parameter, StaticComponent


class Push(StaticComponent):
    kind = "cart"
    columns = {"speed_m_per_s": LogColumn("m/s", "input"), "push_n": LogColumn("N", "output")}
    parameters = (Parameter("gain", 25.0, "N s/m", 0.0, 100.0),)

    def predict(self, columns, values):
        return values["gain"] * columns["speed_m_per_s"]
"""


@pytest.mark.parametrize(
    ("text", "old", "new", "said"),
    [
        (STATIC, "return values", "values", "class Push, predict: gives None for push_n"),
        (
            STATIC,
            'columns["speed_m_per_s"]\n',
            'np.where(columns["time_s"] > 0.195, np.nan, 1.0)\n',
            "class Push: predicts push_n as nan at its starts (...run.csv, row 21, time_s = 0.2)",
        ),
        (
            GOOD,
            '/ values["mass_kg"]',
            '* jnp.log(values["mass_kg"] - 3.0)',
            "class Cart: simulates speed_m_per_s as nan at its starts (...run.csv, row 2, time_s",
        ),
        (
            GOOD,
            '/ values["mass_kg"]',
            '+ 60.0 * values["mass_kg"] * state["speed"]',
            "class Cart: simulates speed_m_per_s as ...e+1",
        ),
        (
            GOOD,
            '/ values["mass_kg"]',
            '* jnp.sqrt(jnp.abs(values["mass_kg"] - 2.0))',
            "class Cart: its simulation has no finite derivative by mass_kg at its starts; start",
        ),
    ],
)
def test_a_law_that_gives_no_number_at_its_starts(
    campaign: Path, text: str, old: str, new: str, said: str
) -> None:
    assert old in text
    path = campaign.parent / "cart.py"
    path.write_text(text.replace(old, new, 1), "utf-8")
    line = refused("fit", campaign, "--component", path, "-o", campaign.parent / "b.json")
    before, _, after = said.partition("...")
    assert f"cart.py, {before}" in line and after in line


def test_a_law_that_gives_no_number_elsewhere_is_stepped_back_from(campaign: Path) -> None:
    """The best gain is below 20, where this law has no root."""
    path = campaign.parent / "cart.py"
    text = STATIC.replace('values["gain"]', 'np.sqrt(values["gain"] - 20.0)')
    path.write_text(text, "utf-8")
    found = run("fit", campaign, "--component", path, "-o", campaign.parent / "b.json")
    assert found.code in (0, 3) and "fault" not in found.err, found.err


def test_a_law_whose_only_parameter_ends_at_its_bound(campaign: Path) -> None:
    path = campaign.parent / "cart.py"
    path.write_text(GOOD.replace('2.0, "kg", 0.1', '3.0, "kg", 2.5', 1), "utf-8")
    found = run("fit", campaign, "--component", path, "-o", campaign.parent / "b.json")
    assert found.code == 3
    assert "mass_kg ends at its bound 2.5 kg, and is not identified there; widen" in found.err


def test_the_component_of_the_docs(campaign: Path) -> None:
    text = (FOLDER.parent.parent / "docs" / "own-components.md").read_text("utf-8")
    path = campaign.parent / "cart.py"
    path.write_text(text.split("```python\n")[1].split("```")[0], "utf-8")
    bundle = si.fit(si.read_campaign(campaign, component=path))
    assert bundle.component is not None
    assert bundle.component.parameters["mass_kg"].value == pytest.approx(1.7, rel=0.05)


def test_a_check_of_a_log_that_shows_nothing(campaign: Path) -> None:
    path = campaign.parent / "cart.py"
    path.write_text(GOOD + "\n\nAlias = Cart\n", "utf-8")
    rows = "\n".join(f"{0.01 * i:.2f},0.0,0.0" for i in range(200))
    for name in ("run.csv", "other.csv"):
        (campaign.parent / name).write_text(f"time_s,push_n,speed_m_per_s\n{rows}\n", "utf-8")
    found = run("check", campaign, "--component", path)
    assert "no output depends on mass_kg in these tests" in " ".join(found.out.split()), found.err


def test_a_number_of_the_class_is_part_of_what_is_compiled(campaign: Path) -> None:
    """A notebook changes `substeps` of a class: the former simulation does not stand for it."""
    path = campaign.parent / "cart.py"
    path.write_text(GOOD, "utf-8")
    read = si.read_campaign(campaign, component=path)
    own = component_in(read)
    assert own is not None and isinstance(own.definition, DynamicComponent)
    before = _identity(own.definition)
    assert before == _identity(own.definition)
    type(own.definition).substeps = 7
    assert before != _identity(own.definition)


def test_code_that_fails_late(campaign: Path) -> None:
    """What passes the check and fails in the compiled loop still names its line."""
    path = campaign.parent / "cart.py"
    branch = 'if state["speed"] > 0.3:\n            pass\n        return {"speed": inputs["push_n"]'
    path.write_text(GOOD.replace('return {"speed": inputs["push_n"]', branch), "utf-8")
    line = refused("fit", campaign, "--component", path)
    assert "cart.py, line 20: does not run: TracerBoolConversionError" in line


def test_campaigns_and_logs_that_do_not_fit_it(campaign: Path) -> None:
    path = campaign.parent / "cart.py"
    path.write_text(GOOD, "utf-8")
    assert "give the file of your own component with --component" in refused("fit", campaign)
    assert "no such file" in refused("fit", campaign, "--component", "absent.py")
    assert "defines no component Boat" in refused("fit", campaign, "--component", f"{path}:Boat")
    campaign.write_text(CAMPAIGN.replace('kind = "cart"', 'kind = "tank"', 1), "utf-8")
    assert "holds logs of kinds cart and tank" in refused("fit", campaign, "--component", path)
    campaign.write_text(CAMPAIGN, "utf-8")
    log = campaign.parent / "run.csv"
    log.write_text(log.read_text("utf-8").replace("push_n", "force"), "utf-8")
    line = refused("fit", campaign, "--component", path)
    assert "run.csv: column push_n (N) is missing" in line and 'push_n = "COLUMN:UNIT"' in line
    mapped = CAMPAIGN.replace('"run.csv"', '"run.csv"\nmap = { push_n = "force:kg" }')
    campaign.write_text(mapped, "utf-8")
    assert "not a force" in refused("fit", campaign, "--component", path)


def test_a_bundle_without_it(campaign: Path, rig_text: str) -> None:
    path = campaign.parent / "cart.py"
    path.write_text(GOOD, "utf-8")
    fitted = campaign.parent / "b.json"
    assert run("fit", campaign, "--component", path, "-o", fitted).code == 0
    text = fitted.read_text("utf-8").replace('"mass_kg"', '"other_kg"')
    fitted.write_text(text, "utf-8")
    found = run("diagnose", campaign, "--bundle", fitted, "--component", path)
    assert found.code == 3 and "mass_kg is not identified" in found.err


def test_a_component_given_as_something_else(campaign: Path) -> None:
    with pytest.raises(InputError, match="is not a component"):
        si.read_campaign(campaign, component=dict)  # type: ignore[arg-type]


def test_a_column_that_is_empty_is_absent(campaign: Path) -> None:
    (campaign.parent / "cart.py").write_text(GOOD, "utf-8")
    rows = (campaign.parent / "other.csv").read_text("utf-8").splitlines()
    for extra in ("speed_m_per_s", "push_n"):
        emptied = [rows[0]]
        for row in rows[1:]:
            time, push, speed = row.split(",")
            emptied.append(f"{time},{push if extra != 'push_n' else ''},"
                           f"{speed if extra != 'speed_m_per_s' else ''}")  # fmt: skip
        (campaign.parent / "other.csv").write_text("\n".join([*emptied, ""]), "utf-8")
        read = si.read_campaign(campaign, component=campaign.parent / "cart.py")
        (log,) = [one for one in read.logs if one.use == "holdout"]
        said = read.read(log)
        assert any(f"{extra} is empty: taken as absent" in line for line in said.notices)
        assert extra not in said.trials[0]


def test_a_column_that_is_empty_in_one_test_is_absent_there(campaign: Path) -> None:
    (campaign.parent / "cart.py").write_text(GOOD, "utf-8")
    rows = [
        f"{label},{0.01 * i:.2f},{0.1 * i},{'' if label == 'b' else i}"
        for label in "ab"
        for i in range(5)
    ]
    text = "\n".join(["test,time_s,push_n,speed_m_per_s", *rows, ""])
    (campaign.parent / "other.csv").write_text(text, "utf-8")
    read = si.read_campaign(campaign, component=campaign.parent / "cart.py")
    (log,) = [one for one in read.logs if one.use == "holdout"]
    said = read.read(log)
    assert any("speed_m_per_s is empty in test b: taken as absent" in n for n in said.notices)
    first, second = said.trials
    assert "speed_m_per_s" in first and "speed_m_per_s" not in second and "push_n" in second


def test_a_recording_that_starts_again_is_converted_with_the_component(campaign: Path) -> None:
    (campaign.parent / "cart.py").write_text(GOOD, "utf-8")
    rows = (campaign.parent / "run.csv").read_text("utf-8").splitlines()
    (campaign.parent / "other.csv").write_text("\n".join([*rows, *rows[1:], ""]), "utf-8")
    told = refused("check", campaign, "--component", campaign.parent / "cart.py")
    assert "the recording starts again there" in told
    assert "`sysid convert --component cart.py other.csv -o other_2.csv`" in told
    done("convert", "--component", campaign.parent / "cart.py", campaign.parent / "other.csv",
         "-o", campaign.parent / "other_2.csv", "--map", "time_s=time_s", "--map", "push_n=push_n",
         "--map", "speed_m_per_s=speed_m_per_s")  # fmt: skip
    text = (campaign.parent / "other_2.csv").read_text("utf-8")
    assert "\ntime_s,test," in text and "\n1.99,2," in text
