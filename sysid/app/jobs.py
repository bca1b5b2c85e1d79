"""Long work: a `sysid` command in a process group of its own, as a terminal would start it.

It ends with its workers when it is cancelled, and when the workbench has ended, however it did: it
holds the reading end of a pipe whose other end is the workbench's. What a command writes is whole
or not there, as on a terminal.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sysid.blocks.progress import Stages, time_text

# SIGTERM lets a command remove what it has begun; after so many seconds it is killed.
_GRACE_S = 5.0
_MOST_LINES = 400
_ENTERED = re.compile(r"sysid: (\w+): (?:starts|up to date|.*starts again)")
_FAULT = re.compile(r"sysid: (?:error|fault): (.*)")
_NOTICE = re.compile(r"sysid: notice: (.*)")
# The command line itself, which ends with its whole group once its standard input has.
_COMMAND = """\
import os, signal, sys, threading
def follow():
    while os.read(0, 1024):
        pass
    os.killpg(0, signal.SIGKILL)
if hasattr(os, "killpg"):
    threading.Thread(target=follow, daemon=True).start()
from sysid.commands.app import main
sys.exit(main())
"""


@dataclass
class Job:
    """A command at work or done. `words` are those behind `sysid`, `expected` its stages' seconds.

    `output` is what it wrote on standard output, `lines` on standard error.
    """

    what: str
    words: tuple[str, ...]
    folder: Path
    expected: Mapping[str, float]
    lines: list[str] = field(default_factory=list)
    output: str = ""
    code: int | None = None
    cancelled: bool = False
    seconds: float = 0.0
    _stages: Any = None
    _process: Any = None
    _follower: Any = None
    _since: float = 0.0

    @property
    def command(self) -> str:
        """The line that does the same in a terminal."""
        return shlex.join(["sysid", *self.words])

    @property
    def is_done(self) -> bool:
        """Whether the command has ended."""
        return self.code is not None

    def start(self) -> None:
        """Start the command; its output is read while it works."""
        self._since = time.monotonic()
        self._stages = Stages(self.expected, time.monotonic)
        environment = {**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONIOENCODING": "utf-8"}
        self._process = subprocess.Popen(
            [sys.executable, "-c", _COMMAND, *self.words],
            cwd=self.folder,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
        self._follower = threading.Thread(target=self._follow, daemon=True)
        self._follower.start()

    def _follow(self) -> None:
        process = self._process
        told = threading.Thread(target=self._read_lines, daemon=True)
        told.start()
        output = process.stdout.read()
        told.join()
        code = process.wait()
        for pipe in (process.stdin, process.stdout, process.stderr):
            pipe.close()
        self.output, self.seconds = output, time.monotonic() - self._since
        self.code = code

    def _read_lines(self) -> None:
        for line in self._process.stderr:
            text = line.rstrip("\n")
            entered = _ENTERED.match(text)
            if entered:
                self._stages.enter(entered[1])
            self.lines = [*self.lines[-_MOST_LINES:], text]

    def cancel(self) -> None:
        """End the command and its workers; returns when they have ended."""
        if self.is_done or self._process is None:
            return
        self.cancelled = True
        self._signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_GRACE_S)
        # Workers that outlived it, or all, where it did not end.
        self._signal(getattr(signal, "SIGKILL", signal.SIGTERM))
        self._follower.join()

    def _signal(self, number: int) -> None:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            if hasattr(os, "killpg"):
                os.killpg(self._process.pid, number)
            else:
                self._process.terminate()

    @property
    def share(self) -> float | None:
        """How much of it is done, 0 to 1; None where its duration is not known."""
        total = sum(self.expected.values())
        if not total or self._stages is None:
            return None
        return float(min(self._stages.completed / total, 0.99))

    @property
    def state(self) -> str:
        """Its state in a line: what it does and how long that takes still, or how it ended."""
        if self.is_done:
            return f"{self.what}: {self.ending}"
        spent = time.monotonic() - self._since
        left = ""
        if self.share is not None:
            left = f", about {time_text(max(self._stages.left, 1.0))} left"
        said = next((line for line in reversed(self.lines) if line.startswith("sysid: ")), "")
        said = said.removeprefix("sysid: ")
        return f"{self.what}: {said or 'starting'} ({time_text(spent)}{left})"

    @property
    def ending(self) -> str:
        """How it ended: done, cancelled, or the error's line."""
        if self.cancelled:
            return "cancelled; nothing was left half-written"
        if self.code == 0:
            return f"done in {time_text(self.seconds)}"
        return next(
            (found[1] for line in reversed(self.lines) if (found := _FAULT.match(line))),
            f"ended with status {self.code}",
        )

    @property
    def notices(self) -> list[str]:
        """The notices that it printed."""
        return [found[1] for line in self.lines if (found := _NOTICE.match(line))]


def own_code(words: Sequence[str]) -> list[str]:
    """The user's own files that a command would run."""
    return [
        after
        for word, after in itertools.pairwise(words)
        if word in ("--effects", "--component", "--controller")
    ]


__all__ = ["Job", "own_code"]
