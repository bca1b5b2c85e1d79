"""What once was a fault (exit 1) in well-meant use: one clear line and exit 2."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import openpyxl
import pandas as pd
import pytest
from golden_folder import golden_bundle
from rich.text import Text

from sysid.blocks.html import fill
from sysid.blocks.terminal import console, new_table
from sysid.commands.app import main
from sysid.diagnosis.bench import axis
from sysid.errors import InputError, one_line
from sysid.io.conversion import convert
from sysid.io.foreign.table import ForeignTable, take_names
from sysid.io.logs import read_log
from sysid.io.rig import read_rig, read_toml, rig_from_content
from sysid.io.samples import Trial
from sysid.io.tables import read_table
from sysid.plant.base import bare_parameters
from sysid.plant.effects import InertiaMismatch
from sysid.plant.effects.catalogue import catalogue

REFERENCE = Path(__file__).resolve().parent.parent / "datasets" / "thesis" / "reference_bundle.json"


def test_toml_that_is_nested_too_deeply(tmp_path: Path) -> None:
    file = tmp_path / "deep.toml"
    file.write_text("a = " + "[" * 2000 + "]" * 2000 + "\n")
    with pytest.raises(InputError, match="nested too deeply"):
        read_toml(file, "a rig file")


def test_a_line_beyond_the_readers_limit(tmp_path: Path) -> None:
    names = ",".join(f"c{i}" for i in range(90_000))
    (tmp_path / "wide.csv").write_text(f"{names}\n{'1,' * 89_999}1\n{'2,' * 89_999}2\n")
    with pytest.raises(InputError, match=r"wide\.csv: cannot be read as text"):
        convert(tmp_path / "wide.csv", tmp_path / "out.csv", maps=["time_s=c0:s"])


@pytest.mark.parametrize("name", ["log.xlsx", "log.mat", "log.tdms"])
def test_a_log_is_not_written_under_a_foreign_name(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time_s,theta_rad\n0,0\n1,1\n")
    with pytest.raises(InputError, match=r"CSV or Parquet.*log\.csv"):
        convert(tmp_path / "a.csv", tmp_path / name)
    assert not (tmp_path / name).exists()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_standard_output() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "sysid", "effects"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr.startswith("sysid: error: standard output: ")
    assert len(done.stderr.splitlines()) == 1


def test_a_closed_standard_output() -> None:
    done = subprocess.run(
        ["sh", "-c", '"$0" -m sysid effects >&-', sys.executable],
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("key", ["c_fill", "c_dis", "choked_flow_fill_kg_s"])
def test_a_flow_below_zero(key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = json.loads(REFERENCE.read_text())
    content["valves"]["a"]["discrete"][key]["value"] *= -1.0
    file = tmp_path / "b.json"
    file.write_text(json.dumps(content))
    assert main(["export", str(file), "--format", "c", "-o", str(tmp_path / "b.h")]) == 2
    assert f"valves.a.discrete: {key} is -" in capsys.readouterr().err


def test_many_columns_are_read_in_linear_time(tmp_path: Path) -> None:
    """20,000 columns took 7 s, quadratic: here each name is compared a few times at most."""
    names = [Counted(f"c{i}") for i in range(4000)]
    table = ForeignTable(Path("wide.csv"), "text")
    take_names(table, names, ([1.0] for _ in names))
    assert len(table.columns) == 4000
    assert sum(name.compared for name in names) < 40 * len(names)


class Counted(str):
    """Text that counts how often it is compared."""

    __slots__ = ("compared",)

    def __new__(cls, text: str) -> Counted:
        made = super().__new__(cls, text)
        made.compared = 0
        return made

    def __eq__(self, other: object) -> bool:
        self.compared += 1
        return str.__eq__(self, other)

    __hash__ = str.__hash__


def sheet(tmp_path: Path, cells: dict[str, float]) -> Path:
    book = openpyxl.Workbook()
    for place, value in cells.items():
        book.active[place] = value
    book.save(tmp_path / "book.xlsx")
    return tmp_path / "book.xlsx"


def padded(path: Path, before: bytes, what: bytes) -> Path:
    """The workbook with `what` put before `before` in its sheet."""
    out = path.with_name("padded.xlsx")
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as made:
        for part in source.infolist():
            data = source.read(part)
            if part.filename == "xl/worksheets/sheet1.xml":
                data = data.replace(before, what + before)
            made.writestr(part.filename, data)
    return out


def test_a_workbook_whose_one_cell_is_the_last(tmp_path: Path) -> None:
    book = sheet(tmp_path, {"XFD1048576": 1.0})
    with pytest.raises(InputError, match=r"1,048,576 rows and 16,384 columns .* 20,000,000 cells"):
        convert(book, tmp_path / "o.csv", maps=["time_s=#1:s"])


@pytest.mark.parametrize(
    ("before", "what", "said"),
    [
        (b"</sheetData>", b" " * 40_000_000, "bytes for"),
        (b"</sheetData>", b'<row r="4"/>' * 1_100_000, "more than 1,048,576 rows"),
    ],
)
def test_a_workbook_that_unpacks_to_far_more(
    before: bytes, what: bytes, said: str, tmp_path: Path
) -> None:
    book = padded(sheet(tmp_path, {"A1": 0.0, "A2": 1.0}), before, what)
    assert book.stat().st_size < 200_000
    with pytest.raises(InputError, match=said):
        convert(book, tmp_path / "o.csv", maps=["time_s=#1:s"])


def test_parquet_whose_metadata_is_damaged(tmp_path: Path) -> None:
    file = tmp_path / "log.parquet"
    pd.DataFrame({"time_s": [0.0, 1.0], "theta_rad": [0.0, 1.0]}).to_parquet(file)
    sound = file.read_bytes()
    place = sound.rindex(b'{"index_columns"')  # pandas' own JSON in the file's footer
    for damage in (b"\xff\xfe", b"}{"):
        file.write_bytes(sound[:place] + damage + sound[place + 2 :])
        with pytest.raises(InputError, match="is damaged or not Parquet"):
            read_table(file, {"time_s"})
        # It does not need this metadata, so it may read the columns.
        assert main(["convert", str(file), "-o", str(tmp_path / "o.csv")]) in (0, 2)


@pytest.mark.parametrize("column", ["time_s", "theta_rad", "encoder_counts", "motor_torque_nm"])
@pytest.mark.parametrize("value", [1e300, 10**30])
def test_values_beyond_anything_measured(
    column: str, value: float, rig_text: str, tmp_path: Path
) -> None:
    (tmp_path / "rig.toml").write_text(rig_text)
    values = {"time_s": [0.0, 1.0], "theta_rad": [0.0, 0.1]}
    values[column] = [0, value]
    file = tmp_path / "log.csv"
    pd.DataFrame(values, dtype=object).to_csv(file, index=False)
    with pytest.raises(InputError, match=f"{column} reaches 1e.* beyond anything measured"):
        read_log(file, read_rig(tmp_path / "rig.toml"))
    made = ["convert", str(file), "-o", str(tmp_path / "o.csv"), "--map", f"{column}={column}:1e9 "]
    units = {"time_s": "s", "theta_rad": "rad", "encoder_counts": "count"}
    assert main([*made[:-1], made[-1] + units.get(column, "Nm")]) == (
        2 if value == 1e300 or column == "time_s" else 0
    )


def test_a_number_of_thousands_of_digits(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(f"a = {'9' * 5000}\n")
    with pytest.raises(InputError, match="unusable number"):
        read_toml(file, "a rig file")


HOSTILE = "\x1b[31mred\x07\u202e" + "x" * 500


@pytest.mark.parametrize(
    "text",
    [
        f"time_s,theta_rad\n0,0\n1,{HOSTILE}\n",
        f"time_s,theta_rad,{HOSTILE}\n0,0,0\n1,1,1\n",
        f"time_s,theta_rad,test\n0,0,{HOSTILE}\n0,1,{HOSTILE}\n",
        f"{HOSTILE},theta_rad\n0,0\n1,1\n",
    ],
    ids=["cell", "column", "label", "time"],
)
def test_nothing_of_a_file_is_echoed_raw(
    text: str, rig_text: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.toml").write_text(rig_text)
    (tmp_path / "log.csv").write_text(text)
    for words in (["check"], ["convert", "-o", str(tmp_path / "o.csv")]):
        main([*words, str(tmp_path / "log.csv")])
        said = "".join(capfd.readouterr())
        assert not set(said) & set("\x1b\x07\u202e")
        assert "x" * 200 not in said


def test_a_table_shows_no_control_characters(capsys: pytest.CaptureFixture[str]) -> None:
    table = new_table("tests", "name")
    table.add_row(Text("\x1b[31mred\u202e"))
    console().print(table)
    assert r"\x1b[31mred\u202e" in capsys.readouterr().out


def test_a_page_shows_no_control_characters(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text("<p>{{ name }}</p>")
    page = fill("page.html", folder=tmp_path, name="\x1b[31mred\u202e <b>\nnext")
    assert page == "<p>\\x1b[31mred\\u202e &lt;b&gt;\nnext</p>"


def test_one_line_keeps_what_is_short() -> None:
    assert one_line("two  words\nand 'a value'") == "two words and 'a value'"
    assert one_line(f"key = {'v' * 61!r}; fix") == f"key = '{'v' * 42}...{'v' * 15}'; fix"
    assert one_line(f"a rig's key = {'v ' * 40!r}").count("...") == 1
    assert one_line(f"in the rig's file, {'words ' * 20}the rig's").count("...") == 0


def test_warnings_of_others_do_not_stand_beside_our_line(tmp_path: Path) -> None:
    """Those of Python's own machinery, and of libraries that log."""
    plugin = tmp_path / "loud.py"
    plugin.write_text(
        "import logging, warnings\nwarnings.warn('loud')\nlogging.getLogger('x').error('loud')\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "sysid", "effects", "--effects", str(plugin)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "loud.py" in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr


def test_an_inertia_that_a_change_would_take_away() -> None:
    """The fit of a rig without `[inertia]` tries 0, and changes down to below nothing."""
    rig = read_rig(REFERENCE.parent.parent / "bundled" / "rig.toml")
    for inertia, change in ((0.0, 0.01), (0.01, -0.01), (0.01, -0.02)):
        given = bare_parameters(rig).replace(inertia=inertia, gravity_moment=1.0)
        found = InertiaMismatch(inertia_change_kg_m2=change).parameters(given, 0.0)
        assert np.isfinite(found.gravity_moment)
        assert found.inertia >= 0.02 * inertia


def test_a_rig_without_inertia_has_no_mismatch_of_it() -> None:
    """Where the inertia is fitted, a change of a declared one is no suspect."""
    trial = Trial(
        "1",
        np.arange(2000) * 0.001,
        {
            "position_m": 0.05 * np.sin(np.arange(2000) * 0.005),
            "motor_force_n": 10.0 * np.cos(np.arange(2000) * 0.005),
        },
        "log",
    )
    content = {"rig": {"name": "axis", "motion": "linear", "orientation": "horizontal"}}
    for section, suspected in (({}, False), ({"inertia": {"mass_kg": 5.0}}, True)):
        rig = rig_from_content(content | section, "rig.toml")
        kinds = axis.axis([trial], rig).effects(catalogue())
        assert (InertiaMismatch in kinds) is suspected


def put(content: object, path: str, value: object) -> None:
    *parents, last = path.split(".")
    for key in parents:
        content = content[int(key)] if isinstance(content, list) else content[key]  # type: ignore[index]
    content[last] = value  # type: ignore[index]


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("valves.a.pwm.fill.ann.scaling.duty", ["NaN", 1.0]),
        ("valves.a.pwm.fill.ann.scaling.duty", 1.0),
        ("valves.a.pwm.fill.bipolynomial.scaling.duty", ["NaN", 1.0]),
        ("valves.a.discrete.on_delay_s.std", {"value": 1}),
        ("valves.a.discrete.on_delay_s.value", "NaN"),
        ("friction.coulomb_nm.interval", [1.0]),
        ("friction.coulomb_nm.unit", 3),
    ],
)
def test_text_in_place_of_a_bundles_numbers(path: str, value: object, tmp_path: Path) -> None:
    content = json.loads(golden_bundle("diagnosed").read_text())
    put(content, path, value)
    (tmp_path / "b.json").write_text(json.dumps(content))
    for form, file in (("json", "m.json"), ("c", "m.h"), ("mat", "m.mat")):
        words = ["export", str(tmp_path / "b.json"), "--format", form]
        assert main([*words, "-o", str(tmp_path / file)]) == 2


def test_a_bundle_without_units_is_exported(tmp_path: Path) -> None:
    """They are for readers: without them the numbers are what they are."""
    content = json.loads(golden_bundle("friction_partial").read_text())
    for estimate in content["friction"].values():
        if isinstance(estimate, dict):
            estimate.pop("unit", None)
    (tmp_path / "b.json").write_text(json.dumps(content))
    words = ["export", str(tmp_path / "b.json"), "--format", "json", "-o", str(tmp_path / "m.json")]
    assert main(words) in (0, 2)
