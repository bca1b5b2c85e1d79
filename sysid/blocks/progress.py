"""Progress: to the caller's callback, else to a terminal or a notebook."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING

from sysid.types import Progress, no_progress

if TYPE_CHECKING:
    from rich.console import Console


@contextmanager
def progress_or_shown(progress: Progress | None, doing: str) -> Iterator[Progress]:
    """The callback given; else one that shows each line during the work.

    In a notebook the line below the cell changes, in a terminal a bar on standard error runs
    next to it; both are gone at the end. A script whose output is piped shows nothing. `doing`
    is what is there first.
    """
    if progress is not None:
        yield progress
    elif in_notebook():
        with _notebook_line(doing) as tell:
            yield tell
    elif sys.stderr.isatty():
        with _terminal_bar(doing) as tell:
            yield tell
    else:
        yield no_progress


def in_notebook() -> bool:
    """Whether a Jupyter kernel runs this process."""
    shell = sys.modules.get("IPython")
    running = None if shell is None else shell.get_ipython()
    return "ipykernel" in sys.modules and getattr(running, "kernel", None) is not None


@contextmanager
def _notebook_line(doing: str) -> Iterator[Progress]:
    handle = import_module("IPython.display").display(_plain(doing), raw=True, display_id=True)
    try:
        yield lambda line: handle.update(_plain(line), raw=True)
    finally:
        # As HTML, of which nothing is left to see.
        handle.update(_plain("") | {"text/html": ""}, raw=True)


def _plain(line: str) -> dict[str, str]:
    return {"text/plain": line}


@contextmanager
def _terminal_bar(doing: str) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (BarColumn(20), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        # The amount of work is unknown beforehand: the bar pulses.
        task = bar.add_task(doing, total=None)
        yield lambda line: bar.update(task, description=line)


class Stages:
    """How far a sequence of stages has come, in the seconds that each is expected to take."""

    def __init__(self, expected: Mapping[str, float], clock: Callable[[], float]) -> None:
        self._expected, self._clock = dict(expected), clock
        self._start = clock()
        # Until a stage is named it is the first one.
        self._own = next(iter(self._expected.values()), 0.0)
        self._before, self._since = 0.0, self._start

    @property
    def total(self) -> float:
        """The expected duration of all stages, s."""
        return sum(self._expected.values())

    def enter(self, name: str) -> None:
        """A stage begins: those before it are done, whatever time they took."""
        names = list(self._expected)
        place = names.index(name) if name in names else 0
        self._before = sum(self._expected[n] for n in names[:place])
        self._own, self._since = self._expected.get(name, 0.0), self._clock()

    @property
    def completed(self) -> float:
        """Seconds of the expected ones that are over; a late stage stays short of its end."""
        spent = self._clock() - self._since
        return self._before + min(spent, 0.98 * self._own)

    @property
    def left(self) -> float:
        """Seconds still to go, at the pace so far where that is slower than expected."""
        completed, spent = self.completed, self._clock() - self._start
        pace = max(1.0, spent / completed) if completed > 0.0 else 1.0
        return (self.total - completed) * pace


@contextmanager
def stage_bar(
    expected: Mapping[str, float], console: Console | None = None
) -> Iterator[tuple[Progress, Progress]]:
    """A bar on standard error over stages, with the time left: (a step's line, a stage's name).

    `expected`: each stage's seconds, in turn. The bar is gone at the end.
    """
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    stages = Stages(expected, time.monotonic)
    columns = (
        BarColumn(20),
        TextColumn("{task.fields[left]}", markup=False),
        TextColumn("{task.description}", markup=False),
    )
    where = console or Console(stderr=True)
    over = threading.Event()
    with Bar(*columns, console=where, transient=True) as bar:
        task = bar.add_task("starting", total=max(stages.total, 1e-9), left="")

        def show() -> None:
            left = f"about {time_text(stages.left)} left"
            bar.update(task, completed=stages.completed, left=left)

        def follow() -> None:
            while not over.wait(0.5):
                show()

        def entered(name: str) -> None:
            stages.enter(name)
            bar.update(task, description=name)
            show()

        watcher = threading.Thread(target=follow, daemon=True)
        watcher.start()
        try:
            yield (lambda line: bar.update(task, description=line)), entered
        finally:
            over.set()
            watcher.join()


def time_text(seconds: float) -> str:
    """A duration in seconds or minutes."""
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"


__all__ = ["Stages", "in_notebook", "progress_or_shown", "stage_bar", "time_text"]
