"""The documentation's source: pages that errors name, blocks that are run, notebooks as they are.

That the pages build without a warning, and what they show runs, is `make docs`.
"""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import pytest

from sysid.commands.app import main
from sysid.commands.help_pages import PAGES
from sysid.io.channels import LOG_COLUMNS
from sysid.io.units import CANONICAL_UNITS

DOCS = Path(__file__).resolve().parent.parent / "docs"
WRITTEN = [p for p in sorted(DOCS.rglob("*.md")) if "generated" not in p.parts]
# Blocks that `docs/_ext/running.py` runs, and those of Sphinx that hold no code.
RUN = {"{file}", "{python}", "{shell}", "{script}", "{given}", "{picture}", "{quoted}"}
NO_CODE = {"{toctree}", "{include}", "{eval-rst}"}
# Run by another test; or by nothing, which the page says.
ELSEWHERE = {
    ("own-components.md", "python"),
    ("own-components.md", "toml"),
    ("many-rigs.md", "text"),
    ("monitor.md", "c"),
    ("monitor.md", "text"),
    ("part-alone.md", "text"),
    ("part-alone.md", "toml"),
    ("whole-actuator.md", "text"),
}
NOT_RUN = {("read-the-bundle.md", "matlab"), ("file-formats.md", "matlab"), ("windows.md", "text")}


@pytest.mark.parametrize("module", PAGES)
def test_the_page_that_an_error_names_is_there(module: str) -> None:
    assert importlib.util.find_spec(module) is not None
    assert (DOCS / f"{PAGES[module]}.md").is_file()


@pytest.mark.parametrize(
    ("content", "words", "page"),
    [
        ("x;t\n1;2\n2;3\n", "convert in.csv -o o.csv --map time_s=u", "file-formats"),
        ('[rig]\norientation = "slanted"\n', "check run.csv", "reference/rig-file"),
        ("rig = 1\n", "fit in.toml", "reference/campaign-file"),
    ],
)
def test_an_error_names_its_page_in_its_one_line(
    content: str,
    words: str,
    page: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("in.csv", "rig.toml", "in.toml"):
        Path(name).write_text(content, "utf-8")
    Path("run.csv").write_text("time_s,theta_rad\n0,0\n1,1\n", "utf-8")
    assert main(words.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(rf"\(docs: \S*{page}\)$", line)


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.stem)
def test_every_block_of_code_is_run(path: Path) -> None:
    fences = re.findall(r"^```(\S*).*\n(?:.*\n)*?```$", path.read_text("utf-8"), re.M)
    left = [f for f in fences if f not in RUN | NO_CODE]
    assert all((path.name, f) in ELSEWHERE | NOT_RUN for f in left), left


@pytest.mark.parametrize("path", sorted((DOCS / "notebooks").glob("*.ipynb")), ids=lambda p: p.stem)
def test_a_notebook_is_kept_without_its_output(path: Path) -> None:
    cells = json.loads(path.read_text("utf-8"))["cells"]
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)


def test_the_log_format_names_every_column() -> None:
    assert set(LOG_COLUMNS) == set(CANONICAL_UNITS)
    assert all(column.meaning for column in LOG_COLUMNS.values())
