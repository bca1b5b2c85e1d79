"""What a screen of the workbench is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Sequence
from typing import Any, ClassVar, Protocol

from sysid.app import parts
from sysid.app.jobs import Job
from sysid.app.workbench import Workbench
from sysid.blocks.interactive import Scheme
from sysid.blocks.sections import Section
from sysid.errors import Failure, InputError, on_its_own

Later = Awaitable[Callable[[], None]]
"""What takes a while, in a thread, and gives what draws it."""


class Host(Protocol):
    """What a screen needs of its window."""

    bench: Workbench
    scheme: Scheme

    def start(self, what: str, words: Sequence[str], expected: Any = None) -> None:
        """Start a command; raises InputError while another is at work."""

    def tell(self, text: str, *, is_error: bool = False) -> None:
        """Show a line at the top."""


class Screen(ABC):
    """A screen of one window: `read` in a thread, then `draw`; `do` what a person does on it.

    `later` are pieces that the window draws, or waits for (`Later`), once what `draw` gave is
    shown.
    """

    title: ClassVar[str]

    def __init__(self, window: Host) -> None:
        self.window = window
        self.bench = window.bench
        self.panes: list[Any] = []
        self.stamp: tuple[Any, ...] = ()
        self.later: list[Callable[[], Later | None]] = []

    @abstractmethod
    def read(self) -> Any:
        """What is shown, from files and the library. Raises InputError. Touches no pane."""

    @abstractmethod
    def draw(self, content: Any) -> list[Any]:
        """The panes that show it."""

    def section_place(self, section: Section, chosen: parts.Chosen | None = None) -> Any:
        """A place for a section, which is drawn when the page shows what stands above it."""
        head = f"<h2>{parts.words(section.title)}</h2>"
        place = parts.column(parts.html(f"{head}<p class='muted'>is being drawn …</p>"))

        def drawn() -> None:
            made = on_its_own(lambda: parts.section_panes(section, self.window.scheme, chosen))
            if isinstance(made, Failure):
                made = [parts.html(head + parts.note(made.reason, "error"))]
            place.objects = made

        self.later.append(drawn)
        return place

    async def do(self, what: str, value: Any) -> None:
        """What a person did: the text of the element's `data-do`, and its value."""
        raise InputError(f"{what}: the screen {self.title} does not know this; load the page anew")

    async def finished(self, job: Job) -> None:
        """A job of this window has ended."""
        return


__all__ = ["Later", "Screen"]
