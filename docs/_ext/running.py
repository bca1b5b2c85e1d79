"""Blocks that are run while the pages are built: what a page shows is what was printed.

Each page has its own folder, `out/docs-work/PAGE/`, emptied first. In it

- `{file} NAME` writes the block's content and shows it,
- `{script} PATH` copies a script that stands next to the page, and shows it folded,
- `{given} PATH NAME` copies a file of the project and shows nothing,
- `{quoted}` shows rows of `benchmarks/figures.jsonl`,
- `{python} NAME` writes it, runs it, and shows it with what it prints,
- `{shell}` runs one command a line and shows each with what it prints; `:exit:` is the status
  that the last one must have (0), `:hide:` leaves out the output,
- `{picture} NAME` shows a picture that one of them wrote there.

A command that ends with another status is a warning, and `make docs` takes warnings for errors.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

from benchmarks import figures

_LOGGER = logging.getLogger(__name__)
_WIDTH = 96
# What lines begin with that are sentences, not rows of tables.
_SENTENCES = ("sysid: ", "Model: ", "Diagnosis: ", "Next: ")
_LIMIT_S = 300
_LANGUAGES = {".py": "python", ".toml": "toml", ".c": "c", ".m": "matlab", ".csv": "text"}


def environment(root: Path) -> dict[str, str]:
    """What commands run in: this checkout's package, one process, plain text of one width."""
    return os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(root),
        "COLUMNS": str(_WIDTH),
        "SYSID_JOBS": "1",
        "OMP_NUM_THREADS": "1",
        "NO_COLOR": "1",
        "MPLBACKEND": "agg",
    }


def _as_in_a_terminal(line: str) -> list[str]:
    """A long line, such as a notice or a verdict, folded as a terminal of this width folds it."""
    if len(line) <= _WIDTH or not line.startswith(_SENTENCES):
        return [line]
    return textwrap.wrap(line, _WIDTH, break_on_hyphens=False)


class _Running(SphinxDirective):
    has_content = True

    @property
    def folder(self) -> Path:
        """The page's own folder, made anew with its first block."""
        root = Path(self.env.app.outdir).parent / "docs-work"
        folder = root / self.env.docname
        started = self.env.temp_data.setdefault("running", set())
        if self.env.docname not in started:
            started.add(self.env.docname)
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
        return folder

    def run_line(self, words: str | list[str], wanted: int = 0) -> str:
        """What a command prints, errors included, in the order of printing."""
        root = Path(self.env.app.srcdir).parent
        found = subprocess.run(
            words,
            shell=isinstance(words, str),
            executable="/bin/bash" if isinstance(words, str) else None,
            cwd=self.folder,
            env=environment(root),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=_LIMIT_S,
        )
        text = found.stdout.replace(f"{self.folder}/", "")
        if found.returncode != wanted:
            what = f"{words} ended with {found.returncode}, not {wanted}\n{text}"
            _LOGGER.warning("%s", what, location=self.get_location())
        lines = (line.rstrip() for line in text.splitlines())
        return "\n".join(part for line in lines for part in _as_in_a_terminal(line))

    def block(self, text: str, language: str, *classes: str) -> nodes.literal_block:
        """A literal block of the page."""
        # Output need not be of the language of its commands: no warning where it is not.
        return nodes.literal_block(text, text, language=language, force=True, classes=list(classes))


class FileBlock(_Running):
    """`{file} NAME`: written to the page's folder, and shown."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        text = "\n".join(self.content) + "\n"
        path = self.folder / self.arguments[0]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
        return self.shown(path, text)

    def shown(self, path: Path, text: str) -> list[nodes.Node]:
        """The content under the file's name."""
        container = nodes.container("", literal_block=True, classes=["literal-block-wrapper"])
        container += nodes.caption("", self.arguments[0])
        container += self.block(text, _LANGUAGES.get(path.suffix, "text"))
        return [container]


class PythonBlock(FileBlock):
    """`{python} NAME`: written, run, and shown with what it prints."""

    def run(self) -> list[nodes.Node]:
        shown = super().run()
        printed = self.run_line([sys.executable, self.arguments[0]])
        return [*shown, *([self.block(printed, "text", "printed")] if printed.strip() else [])]


class IncludedScript(_Running):
    """`{script} PATH`: a file of this folder of the docs, copied to the page's folder and shown."""

    required_arguments = 1
    has_content = False

    def run(self) -> list[nodes.Node]:
        relative, source = self.env.relfn2path(self.arguments[0])
        self.env.note_dependency(relative)
        text = Path(source).read_text("utf-8")
        path = self.folder / Path(source).name
        path.write_text(text, "utf-8")
        opened = f"<details class='script'><summary><code>{path.name}</code></summary>"
        return [
            nodes.raw("", opened, format="html"),
            self.block(text, _LANGUAGES.get(path.suffix, "text")),
            nodes.raw("", "</details>", format="html"),
        ]


class QuotedRows(_Running):
    """`{quoted}`: rows of `benchmarks/figures.jsonl`, each given by words that only it contains."""

    def run(self) -> list[nodes.Node]:
        self.env.note_dependency(str(figures.FIGURES))
        rows: list[figures.FigureRow] = []
        for words in filter(None, self.content):
            found = [row for row in figures.read() if words in row.figure]
            if len(found) != 1:
                what = f"{words!r} stands in {len(found)} rows of figures"
                _LOGGER.warning("%s", what, location=self.get_location())
            rows += found[:1]
        return list(self.parse_text_to_nodes(figures.table(rows)))


class GivenFile(_Running):
    """`{given} PATH NAME`: a file of the project under this name; nothing is shown."""

    required_arguments = 2
    has_content = False

    def run(self) -> list[nodes.Node]:
        root = Path(self.env.app.srcdir).parent
        source, target = root / self.arguments[0], self.folder / self.arguments[1]
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
        return []


class ShellBlock(_Running):
    """`{shell}`: one command a line, each shown with what it prints."""

    option_spec = {"exit": directives.nonnegative_int, "hide": directives.flag}  # noqa: RUF012

    def run(self) -> list[nodes.Node]:
        commands = "\n".join(self.content).replace("\\\n", "\\\x00").splitlines()
        commands = [c.replace("\\\x00", "\\\n") for c in commands if c.strip()]
        parts = []
        for number, command in enumerate(commands, start=1):
            wanted = self.options.get("exit", 0) if number == len(commands) else 0
            printed = self.run_line(command, wanted)
            kept = [] if "hide" in self.options or not printed.strip() else [printed]
            parts.append("\n".join([f"$ {command}", *kept]))
        return [self.block("\n".join(parts), "console")]


class PictureBlock(_Running):
    """`{picture} NAME`: a picture in the page's folder; the content is its description."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        page = self.env.docname.replace("/", "-")
        name = f"{page}-{self.arguments[0]}"
        target = Path(self.env.app.outdir) / "_images" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(self.folder / self.arguments[0], target)
        up = "../" * self.env.docname.count("/")
        alt = " ".join(self.content)
        html = f'<p><img class="made" src="{up}_images/{name}" alt="{alt}"></p>'
        return [nodes.raw("", html, format="html")]


def setup(app: Any) -> dict[str, bool]:
    """Sphinx' entry."""
    app.add_directive("file", FileBlock)
    app.add_directive("python", PythonBlock)
    app.add_directive("script", IncludedScript)
    app.add_directive("quoted", QuotedRows)
    app.add_directive("given", GivenFile)
    app.add_directive("shell", ShellBlock)
    app.add_directive("picture", PictureBlock)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
