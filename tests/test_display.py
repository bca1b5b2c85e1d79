"""Tables as text and HTML, and progress in a terminal, a notebook and a script."""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import pytest
from rich.console import Console

from sysid.blocks.notebook import table_html
from sysid.blocks.plain_text import table_text
from sysid.blocks.progress import Stages, in_notebook, progress_or_shown, stage_bar
from sysid.blocks.shown import Shown
from sysid.blocks.tables import estimate_table, record_table, table
from sysid.estimation.linear import Estimate


@dataclass(frozen=True, repr=False)
class Bolts(Shown):
    rows: tuple[tuple[str, float | None], ...]
    notices: tuple[str, ...] = ()

    def headline(self) -> str:
        return "bolts <M5>"

    def records(self) -> Sequence[Mapping[str, Any]]:
        return [{"name": name, "length_m": length} for name, length in self.rows]


BOLTS = Bolts((("short", 0.012), ("a & b", None)), ("two are <loose>",))


def test_text_is_aligned() -> None:
    assert str(BOLTS).splitlines() == [
        "bolts <M5>",
        "",
        "name   length_m",
        "short  0.01200",
        "a & b  -",
        "",
        "notice: two are <loose>",
    ]
    assert repr(BOLTS) == "<Bolts: bolts <M5>>"


def test_text_is_ascii_and_html_is_not() -> None:
    estimate = Estimate.symmetric(6.5168e-4, 4.2e-7, "kg/(s Pa^0.5)", 20.0)
    shown = estimate_table(
        "", {"c_fill": estimate, "offset": Estimate.symmetric(-2.0, 1.0, "Nm", 9.0)}
    )
    assert table_text(shown).isascii()
    assert "6.5168e-4" in table_text(shown) and "kg/(s Pa^0.5)" in table_text(shown)
    assert "(6.5080 to 6.5256) x 1e-4" in table_text(shown) and "-2.0" in table_text(shown)
    assert "6.5168 × 10⁻⁴" in table_html(shown) and "−2.0" in table_html(shown)


def test_html_is_escaped() -> None:
    html = BOLTS._repr_html_()
    assert "bolts &lt;M5&gt;" in html and "a &amp; b" in html and "&lt;loose&gt;" in html
    assert "<M5>" not in html and "<loose>" not in html
    title = table_html(table("<i>", ("<u>",), (("<b>",),)))
    assert not any(tag in title for tag in ("<i>", "<u>", "<b>"))


def test_a_frame_holds_numbers() -> None:
    frame = BOLTS.to_frame()
    assert frame["length_m"].dtype.kind == "f" and frame["length_m"][0] == 0.012


def test_a_record_without_a_column_leaves_it_empty() -> None:
    shown = record_table("", [{"a": 1}, {"b": "x"}])
    assert shown.headings == ("a", "b") and shown.rows == (("1", ""), ("", "x"))


def test_estimates_show_their_error_and_why_there_is_none() -> None:
    known = Estimate.symmetric(0.12346, 0.001, "Nm", 10.0)
    rows = estimate_table("", {"x": known, "y": Estimate.unidentified("N", "no test")}).rows
    assert rows[0][:4] == ("x", "0.1235", "0.0010", "N·m")
    assert rows[1][1] == "not identified" and "no test" in rows[1]


# --- progress --------------------------------------------------------------------------


def test_a_callback_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    told: list[str] = []
    with progress_or_shown(told.append, "working") as tell:
        tell("half")
    assert told == ["half"]
    assert capsys.readouterr() == ("", "")


def test_a_script_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_or_shown(None, "working") as tell:
        tell("half")
    assert capsys.readouterr() == ("", "")


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_a_bar_on_standard_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    screen = _Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("TERM", "xterm")
    with progress_or_shown(None, "working") as tell:
        tell("half [way]")
    assert "half [way]" in screen.getvalue()
    assert capsys.readouterr().out == ""


class _Handle:
    def __init__(self, lines: list[str]) -> None:
        self.lines = lines

    def update(self, content: dict[str, str], raw: bool) -> None:
        assert raw
        self.lines.append(content["text/plain"])


def test_a_notebook_shows_a_line_that_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    shell, output = ModuleType("IPython"), ModuleType("IPython.display")

    class Kernel:
        kernel = object()

    def display(content: dict[str, str], raw: bool, display_id: bool) -> _Handle:
        assert raw and display_id
        lines.append(content["text/plain"])
        return _Handle(lines)

    setattr(shell, "get_ipython", Kernel)  # noqa: B010
    setattr(output, "display", display)  # noqa: B010
    assert not in_notebook()
    for name, module in {
        "IPython": shell, "IPython.display": output, "ipykernel": ModuleType("ipykernel"),
    }.items():  # fmt: skip
        monkeypatch.setitem(sys.modules, name, module)
    assert in_notebook()
    with progress_or_shown(None, "working") as tell:
        tell("half")
    assert lines == ["working", "half", ""]


def test_stages_leave_the_time_that_is_expected_of_them() -> None:
    now = 0.0
    stages = Stages({"fit": 10.0, "diagnose": 30.0}, lambda: now)
    stages.enter("fit")
    now = 4.0
    assert stages.total == 40.0 and stages.completed == 4.0
    now = 60.0
    assert stages.completed == pytest.approx(9.8)  # late: still not done
    stages.enter("diagnose")
    now = 75.0
    assert stages.completed == 25.0
    # 75 s for 25: the 15 that remain take three times as long too.
    assert stages.left == pytest.approx(45.0)


def test_a_command_without_named_stages_comes_forward() -> None:
    now = 0.0
    stages = Stages({"convert": 20.0}, lambda: now)
    now = 5.0
    assert (stages.completed, stages.left) == (5.0, 15.0)


def test_a_bar_over_stages_says_what_is_done_and_the_time_left() -> None:
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=80)
    with stage_bar({"fit": 20.0, "diagnose": 200.0}, console) as (tell, entered):
        entered("fit")
        tell("fitting friction")
        time.sleep(0.7)
    assert "about 4 min left" in out.getvalue() and "fitting friction" in out.getvalue()


def test_a_terminal_shows_results_in_ascii(capsys: pytest.CaptureFixture[str]) -> None:
    from types import SimpleNamespace

    from sysid.commands.printing import print_result

    found = SimpleNamespace(
        headline=lambda: "off by 2.05 × 10⁻⁴ N·m", tables=tuple, footnotes=lambda: ("± 3 m²",)
    )
    print_result(found)  # type: ignore[arg-type]
    shown = capsys.readouterr().out
    assert shown.isascii() and "2.05e-4 N m" in shown and "+/- 3 m2" in shown
