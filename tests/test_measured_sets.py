"""A measured set's file: what it says, what is refused, and the sets of the project."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from measured_samples import make_set

from datasets.measured.run import chosen, run_sets
from datasets.measured.sets import SETS_FOLDER, read_set, set_folders
from sysid.errors import InputError


def test_tables_of_the_project_need_no_data_folder(tmp_path: Path) -> None:
    folder = make_set(tmp_path)
    file = folder / "set.toml"
    file.write_text(f'data = "project"\n{file.read_text()}')
    assert chosen(tmp_path / "sets", [], tmp_path / "none") == [folder]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("licence = ", "license = "), "licence"),
        (('folder = "axis"', "folder = 3"), "folder = 3 is not text"),
        (('log = "axis_2.csv"', 'log = "../axis_2.csv"'), "without a folder"),
        (('source = "run2.txt"', "source = []"), "source = []"),
        (('log = "axis_2.csv"', 'log = "axis_2.csv"\nrows = 3'), "rows = 3 is not text"),
        (("repeat = true", 'repeat = "yes"'), "write true or false"),
        (("repeat = true", 'repeat = true\nof = "other.toml"'), "no campaign before it"),
        (('file = "repeat_1.toml"', 'file = "campaign.toml"'), "occurs twice"),
        (("[[campaign]]", "[[campagne]]"), "campaign"),
    ],
)
def test_a_wrong_set_file(tmp_path: Path, change: tuple[str, str], said: str) -> None:
    folder = make_set(tmp_path)
    text = (folder / "set.toml").read_text()
    assert change[0] in text
    (folder / "set.toml").write_text(text.replace(*change))
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        read_set(folder)
    assert "set.toml" in str(caught.value) and "\n" not in str(caught.value)


def test_what_may_not_be_asked(tmp_path: Path) -> None:
    folder = make_set(tmp_path)
    with pytest.raises(InputError, match="there are: axis"):
        chosen(tmp_path / "sets", ["axes"], tmp_path / "data")
    with pytest.raises(InputError, match=r"no folder with a set\.toml"):
        chosen(tmp_path / "data", [], tmp_path / "data")
    with pytest.raises(InputError, match="is inside the project"):
        run_sets([folder], tmp_path / "data", SETS_FOLDER)


@pytest.mark.parametrize("folder", set_folders(), ids=lambda folder: folder.name)
def test_every_set_file_is_whole(folder: Path) -> None:
    """What a set names lies beside it, no recipe is left over, and no recording lies there."""
    measured = read_set(folder)
    assert not measured.notices
    named = {c.recipe for c in measured.conversions} | {c.file for c in measured.campaigns}
    assert all((folder / name).is_file() for name in named)
    assert {path.name for path in folder.glob("recipe*.toml")} <= named
    assert all(path.suffix in (".toml", ".md") for path in folder.iterdir())
