"""Progress: to the caller's callback, else to a terminal or a notebook."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

from sysid.types import Progress, no_progress


@contextmanager
def progress_or_shown(progress: Progress | None, doing: str) -> Iterator[Progress]:
    """The callback given; else one that shows each line during the work.

    In a notebook the line below the cell changes, in a terminal a bar on standard error runs
    next to it; both are gone at the end. A script whose output is piped shows nothing. `doing`
    is what stands there first.
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
        handle.update(_plain(""), raw=True)


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


__all__ = ["in_notebook", "progress_or_shown"]
