"""Every change that was made, so that it can be undone: after a restart too.

It is a file next to the campaign. A step is undone only where the file still holds what the step
wrote: what an editor has changed since is not lost.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from sysid.errors import InputError, input_error
from sysid.io.files import write_atomic

JOURNAL_FILE = ".sysid-app.json"
_MOST_STEPS = 200


@dataclass(frozen=True)
class FileChange:
    """A change of a file, by its name in the folder; `before` None: there was no such file."""

    what: str
    file: str
    before: str | None
    after: str


@dataclass
class Journal:
    """The steps in turn; those from `position` on were undone. `kept`: what else is remembered."""

    folder: Path
    steps: list[FileChange] = field(default_factory=list)
    position: int = 0
    kept: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, folder: Path) -> Journal:
        """The folder's journal; a new one where it has none, or none that can be read."""
        try:
            content = json.loads((folder / JOURNAL_FILE).read_text("utf-8"))
            steps = [FileChange(**step) for step in content["steps"]]
            position = min(max(int(content["position"]), 0), len(steps))
            return cls(folder, steps, position, dict(content["kept"]))
        except (OSError, ValueError, KeyError, TypeError):
            return cls(folder)

    def write(self) -> None:
        """Write it, whole or not at all."""
        steps = [asdict(step) for step in self.steps]
        content = {"steps": steps, "position": self.position, "kept": self.kept}
        write_atomic(self.folder / JOURNAL_FILE, json.dumps(content, indent=1) + "\n")

    def keep(self, key: str, value: Any) -> None:
        """Remember a plain value over restarts."""
        self.kept[key] = value
        self.write()

    def made(self, step: FileChange) -> None:
        """Enter a step that was made; what was undone before it is forgotten."""
        self.steps = [*self.steps[: self.position], step][-_MOST_STEPS:]
        self.position = len(self.steps)
        self.write()

    @property
    def undoable(self) -> FileChange | None:
        """The step that undo takes back."""
        return self.steps[self.position - 1] if self.position else None

    @property
    def redoable(self) -> FileChange | None:
        """The step that redo makes again."""
        return self.steps[self.position] if self.position < len(self.steps) else None

    def undo(self) -> FileChange:
        """Take the last step back. Raises InputError where that is not possible."""
        step = self.undoable
        if step is None:
            raise InputError("nothing to undo; no change was made here")
        self._put(step, step.after, step.before)
        self.position -= 1
        self.write()
        return step

    def redo(self) -> FileChange:
        """Make the step again that was undone last. Raises InputError likewise."""
        step = self.redoable
        if step is None:
            raise InputError("nothing to redo; no change was undone")
        self._put(step, step.before, step.after)
        self.position += 1
        self.write()
        return step

    def _put(self, step: FileChange, expected: str | None, content: str | None) -> None:
        path = self.folder / step.file
        found = path.read_text("utf-8") if path.is_file() else None
        if found != expected:
            what = f"was changed outside the workbench since '{step.what}'"
            raise input_error(path, what, "change it back in your editor")
        if content is None:
            path.unlink()
        else:
            write_atomic(path, content)


__all__ = ["JOURNAL_FILE", "FileChange", "Journal"]
