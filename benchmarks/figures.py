"""Every required figure as a row of `figures.jsonl`: what was asked, what was measured, and how.

    python -m benchmarks.figures [SUBJECT ...]     # the rows in a terminal, what is missed first
    python -m benchmarks.figures --missed          # only those that are not reached

A row has `subject`, `figure`, `asked`, `measured`, `reached` (null where nothing was asked),
`machine`, `command` and the `commit` that recorded it; `note` says what limits it.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

FIGURES = Path(__file__).resolve().parent / "figures.jsonl"
SUBJECTS = {
    "first-command": "The first command, and nothing that can hurt",
    "files": "Files as laboratories write them, tests as people choose them",
    "input": "Bad input, slips and start-up",
    "friction": "Friction",
    "valves": "Valves and surfaces",
    "surfaces": "Surfaces in motion",
    "plant": "Simulation",
    "validation": "Validation, report, pipeline",
    "intervals": "Intervals",
    "refinement": "The whole model at once",
    "diagnosis": "What the model lacks",
    "detectable-sizes": "Smallest detectable sizes",
    "measured-data": "Measured data",
    "controllers": "Controllers",
    "effect-worth": "What a found effect is worth",
    "experiment": "From simulation to experiment",
    "exported-c": "Exported C",
    "what-people-see": "What people see",
    "house": "Layout and library",
}


@dataclass(frozen=True)
class FigureRow:
    """A figure as measured; texts are Markdown. `reached`: None where nothing was asked."""

    subject: str
    figure: str
    asked: str
    measured: str
    reached: bool | None
    machine: str
    command: str
    commit: str
    note: str = ""


def read(path: Path = FIGURES) -> list[FigureRow]:
    """All rows, in the order of the file."""
    return [FigureRow(**json.loads(line)) for line in path.read_text("utf-8").splitlines()]


def of_subject(rows: Iterable[FigureRow], subject: str) -> list[FigureRow]:
    """A subject's rows, what is missed first."""
    return sorted((r for r in rows if r.subject == subject), key=lambda r: r.reached is not False)


def table(rows: Sequence[FigureRow]) -> str:
    """Rows as a Markdown table."""
    lines = ["| | figure | asked | measured | command |", "| --- | --- | --- | --- | --- |"]
    for row in rows:
        measured = f"{row.measured}<br>*{row.note}*" if row.note else row.measured
        mark = "**missed**" if row.reached is False else ""
        cells = (mark, row.figure, row.asked, measured, f"`{row.command}`")
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("subjects", nargs="*", choices=[[], *SUBJECTS])
    parser.add_argument("--missed", action="store_true", help="only what is not reached")
    words = parser.parse_args()
    rows = [r for r in read() if r.reached is False or not words.missed]
    for subject in words.subjects or SUBJECTS:
        own = of_subject(rows, subject)
        if own:
            print(f"{SUBJECTS[subject]}\n")
        for row in own:
            print(f"  {'missed: ' if row.reached is False else ''}{row.figure}")
            print(f"    {row.measured}" + (f"  (asked: {row.asked})" if row.asked else ""))
            print(f"    {row.command}  [{row.machine}, {row.commit}]\n")


if __name__ == "__main__":
    _main()
