"""Export: the report, and files for a controller."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.app import parts
from sysid.app.jobs import Job
from sysid.app.screens.base import Screen
from sysid.app.workbench import NOTHING_FITTED, StepMissingError
from sysid.io.files import make_folder
from sysid.pipeline.export import SUFFIXES
from sysid.pipeline.run import DIAGNOSIS_FILE, REPORT_FILE

_NAMES = {"c": "C header", "mat": "MATLAB", "json": "flat JSON", "fmu": "FMU", "mjcf": "MuJoCo"}
_SHOWN = (".html", *SUFFIXES)


# What the files of a run are for, by their names or their endings.
_PURPOSES = {
    "bundle.json": "the model: parameters with errors, and where they are from",
    "fitted.json": "the model as its own tests fitted it",
    "extended.json": "with the effects that the diagnosis found",
    "refined.json": "estimated again on motion",
    "diagnosis.json": "what the diagnosis found, for programs",
    "advice.json": "which test to run next, for programs",
    "checks.json": "what each log is worth, for programs",
    "run.json": "what was done, so that the next run goes on from there",
    ".html": "to read and to send",
    ".h": "for a controller in C",
    ".mat": "for MATLAB",
    ".fmu": "for co-simulation",
    ".xml": "a joint for MuJoCo",
}
_EXPORTS = "export"


def _what(path: Path) -> str:
    """What a file is for, in a few words."""
    if path.suffix == ".json" and path.parent.name == _EXPORTS:
        return "the numbers alone, for other programs"
    return _PURPOSES.get(path.name, _PURPOSES.get(path.suffix, ""))


def written_by(job: Job) -> Iterator[Path]:
    """The pages and exports that a command wrote, once it has ended well."""
    for word, after in itertools.pairwise(job.words if job.code == 0 else ()):
        path = job.folder / after
        page = path / REPORT_FILE if job.words[0] == "run" else path
        is_made = word in ("-o", "--report") and page.is_file()
        if is_made and (page.suffix == ".html" or job.words[0] == "export"):
            yield page


def _size(count: int) -> str:
    """A file's size, in the unit that keeps it readable."""
    unit, factor = ("MB", 1e-6) if count >= 1e6 else ("kB", 1e-3)
    return f"{count * factor:.{1 if unit == 'MB' else 0}f}\N{NO-BREAK SPACE}{unit}"


@dataclass(frozen=True)
class ExportContent:
    """The bundles, the one that is exported, and the files that there are."""

    bundles: tuple[Path, ...]
    chosen: Path
    files: tuple[Path, ...]


class ExportScreen(Screen):
    """What leaves the workbench."""

    title = "Export"

    def __init__(self, window: Any) -> None:
        super().__init__(window)
        self.chosen: Path | None = None
        self.accepts = False

    def read(self) -> ExportContent:
        bench = self.bench
        bundles = tuple(bench.bundles())
        if self.chosen not in bundles:
            self.chosen = bench.best_bundle()
        if self.chosen is None:
            raise StepMissingError(NOTHING_FITTED, "fit")
        return ExportContent(bundles, self.chosen, tuple(self._files()))

    def _files(self) -> Iterator[Path]:
        """What is read and sent comes first, then what controllers take, then the models."""
        results = self.bench.results

        def rank(path: Path) -> tuple[bool, bool, bool, Path]:
            is_page, is_export = path.suffix == ".html", path.parent.name == _EXPORTS
            return not is_page, not is_export, path.name != "bundle.json", path

        for path in sorted(results.rglob("*"), key=rank) if results.is_dir() else ():
            if path.suffix in _SHOWN and path.is_file() and "_check" not in path.parent.name:
                yield path

    def draw(self, content: ExportContent) -> list[Any]:
        text = "<h2>Export</h2>"
        names = [(self.bench.named(p), self.bench.named(p)) for p in content.bundles]
        menu = parts.select("out-bundle", names, self.bench.named(content.chosen), "Bundle")
        report = parts.button("Report", "out-report", kind="primary",
                              title="sysid validate --report: one self-contained page")  # fmt: skip
        files = "".join(
            parts.button(_NAMES.get(kind, kind), f"out:{kind}") for kind in SUFFIXES.values()
        )
        tick = parts.tick("out-accept", "controllers may use assumed constants", self.accepts)
        text += f"<div class='bar2'>{menu} {report} {files} {tick}</div>"
        lines = [self._line(path) for path in content.files]
        if lines:
            text += parts.rows(("File", "Size", ""), lines, "Files that were written")
        return [parts.html(text)]

    def _line(self, path: Path) -> list[str]:
        name = self.bench.named(path)
        head = f"<b>{parts.words(name)}</b><br><small>{_what(path)}</small>"
        size = _size(path.stat().st_size)
        if not path.is_relative_to(self.bench.folder):
            return [head, size, ""]
        return [head, size, parts.file_link(name, "")]

    async def do(self, what: str, value: Any) -> None:
        act, _, rest = what.partition(":")
        if act == "out-bundle":
            self.chosen = self.bench.folder / str(value)
            self.bench.changes += 1
        elif act == "out-accept":
            self.accepts = bool(value)
        elif act == "out":
            self._export(rest)
        elif act == "out-report":
            self._report()
        else:
            await super().do(what, value)

    def _source(self) -> Path:
        if self.chosen is None:
            raise StepMissingError(NOTHING_FITTED, "fit")
        return self.chosen

    def _export(self, kind: str) -> None:
        bench, source = self.bench, self._source()
        suffix = next(s for s, k in SUFFIXES.items() if k == kind)
        folder = bench.results / _EXPORTS
        make_folder(folder)
        output = folder / f"{source.stem}{suffix}"
        words = ["export", bench.named(source), "--format", kind, "-o", bench.named(output)]
        words += ["--accept-assumed"] if self.accepts else []
        what = f"writing {output.name}"
        self.window.start(what, [*words, *bench.own_words(component=False)])

    def _report(self) -> None:
        bench, source = self.bench, self._source()
        make_folder(bench.results)
        output = bench.results / f"{source.stem}.html"
        words = ["validate", bench.campaign().path.name, "--bundle", bench.named(source)]
        words += ["--report", bench.named(output)]
        if bench.has_diagnosis(source):
            words += ["--diagnosis", bench.named(bench.result(DIAGNOSIS_FILE))]
        self.window.start(f"writing {output.name}", [*words, *bench.own_words()])


__all__ = ["ExportScreen"]
