"""One window of the workbench: the screens, what was done last, and the job at work.

Each window has its own choice of screen and of tests; files and the job belong to all of them
(`Workbench`), and each looks every second whether they have changed.
"""

from __future__ import annotations

import asyncio
import json
import os
import traceback
from collections.abc import Awaitable, Callable, Sequence
from functools import partial
from importlib import import_module
from typing import Any

import panel as pn

from sysid.app import parts
from sysid.app.jobs import Job, own_code
from sysid.app.screens import SCREENS, Screen
from sysid.app.screens.base import Later
from sysid.app.screens.export import written_by
from sysid.app.server import template_text
from sysid.app.workbench import StepMissingError, Workbench, command_line
from sysid.blocks.interactive import Scheme
from sysid.errors import Failure, InputError, SysidError, one_line, some_of

_OWN_STYLES = import_module("panel.io.resources").LOCAL_DIST
_MOST_LINES = 14
# Notices of a command that are shown next to its end; the others are folded.
_MOST_NOTICES = 3
# Panes of a screen that are sent at once when it is shown again: its head and what stands below.
_FIRST_PANES = 2
# What the other screens need at their first visit: a second's work, most of it scipy's.
_SOON = ("pandas", "pyarrow.parquet", "pyarrow.compute", "scipy.signal", "bokeh.plotting")

pn.extension(notifications=False, loading_indicator=False)
pn.config.css_files = ["style.css"]
pn.config.throttled = True


class Window:
    """A browser's window on the workbench."""

    def __init__(self, bench: Workbench, scheme: Scheme, first: str) -> None:
        self.bench, self.scheme = bench, scheme
        self.screens: dict[str, Screen] = {key: kind(self) for key, kind in SCREENS.items()}
        self.current = first if first in self.screens else next(iter(self.screens))
        self.message = ""
        self.is_error = False
        self.waiting: tuple[str, tuple[str, ...], Any] | None = None
        self.top = parts.html("", css_classes=["markup", "bar"])
        self.strip = parts.html("")
        self.main = parts.column()
        self.done = parts.html("")
        self.asked = pn.widgets.TextInput(visible=False)
        self._stamp: tuple[Any, ...] = ()
        self._job: Job | None = None
        self._filling = 0
        self._waits: asyncio.Future[None] | None = None
        self._heard = 0

    # --- drawing --------------------------------------------------------------------------

    def draw_frame(self) -> None:
        """The bar at the top, the strip of messages and work, and what was done last."""
        self.top.object = self._top()
        self.strip.object = self._strip()
        self.done.object = self._done()

    def _top(self) -> str:
        bench, journal = self.bench, self.bench.journal
        tabs = "".join(
            f'<button type="button" class="tab{" on" if key == self.current else ""}" '
            f'data-do="screen" data-value="{i}"'
            f"{' aria-current=page' if key == self.current else ''}>"
            f"<kbd>{i}</kbd> {parts.words(screen.title)}</button>"
            for i, (key, screen) in enumerate(self.screens.items(), 1)
        )
        file = bench.campaign_file
        name = "no campaign" if file is None else f"{file.parent.name}/{file.name}"
        undo, redo = journal.undoable, journal.redoable
        buttons = (
            parts.button("Undo", "undo", off=undo is None, kind="small",
                         title=f"Undo: {undo.what} (z)" if undo else "Nothing to undo")
            + parts.button("Redo", "redo", off=redo is None, kind="small",
                           title=f"Redo: {redo.what} (y)" if redo else "Nothing to redo")
            + parts.button("Light" if self.scheme == "dark" else "Dark", "scheme", kind="small",
                           title="The other colours")
        )  # fmt: skip
        return (
            f'<div class="head"><strong>sysid</strong><span class="name">{parts.words(name)}'
            f'</span><span class="tools">{buttons}</span></div>'
            f'<nav aria-label="Screens">{tabs}</nav>'
        )

    def _strip(self) -> str:
        text = ""
        for code in self.bench.unasked():
            text += (
                f'<div class="ask">{parts.words(code)} is Python code of your own. It runs with '
                f"your rights, in this program and in the commands. "
                f"{parts.button('Allow it to run', 'allow', value=code, kind='small')}</div>"
            )
        if self.message:
            kind = "error" if self.is_error else "info"
            text += (
                f'<div class="{kind}">{parts.words(self.message)} '
                f"{parts.button('×', 'dismiss', kind='small', title='Dismiss')}</div>"
            )
        job = self.bench.job
        if job is not None:
            text += self.bench.brief(_job_bar(job, self._made(job)))
        return text

    def _made(self, job: Job) -> str:
        """Where the pages and exports that a command wrote are found."""
        found = "".join(f"{parts.file_link(self.bench.named(path), path.name)} "
                        for path in written_by(job)
                        if path.is_relative_to(self.bench.folder))  # fmt: skip
        if job.words[0] == "run" and job.code == 0 and self.current != "export":
            number = 1 + list(self.screens).index("export")
            found += parts.button("Go to Export", "screen", value=str(number), kind="small") + " "
        return found

    def _done(self) -> str:
        bench = self.bench
        if not bench.said:
            return (
                '<p class="muted">What you do here is shown at this place: the command, or the '
                "lines of a file, that do the same.</p>"
            )
        lines = bench.lines.splitlines()
        shown = "\n".join(lines[:_MOST_LINES])
        more = f"\n... and {len(lines) - _MOST_LINES} more" if len(lines) > _MOST_LINES else ""
        inner = f"<pre>{parts.words(shown + more)}</pre>" if lines else ""
        return f"<h3>The same by hand</h3><code>{parts.words(bench.said)}</code>{inner}"

    async def fill(self) -> None:
        """Read what the current screen shows, in a thread, and draw it."""
        self._filling += 1
        number, screen = self._filling, self.screens[self.current]
        self._stamp = self.bench.stamp()
        try:
            content = await asyncio.to_thread(screen.read)
            if number != self._filling:
                return
            screen.later = []
            panes = screen.draw(content)
        except SysidError as error:
            panes = [parts.html(self._lacking(screen, error))]
        except Exception as error:
            if os.environ.get("SYSID_DEBUG"):
                traceback.print_exc()
            reason = f"{Failure.of(error).reason} (a fault in sysid itself)"
            panes = [parts.html(parts.note(reason, "error"))]
        screen.panes, screen.stamp = panes, self._stamp
        self.main.objects = panes
        self._go_on(number)

    def _lacking(self, screen: Screen, error: SysidError) -> str:
        """Why a screen shows nothing, and the way to the one where that is fixed."""
        reason = self.bench.brief(str(error))
        head = f"<h2>{parts.words(screen.title)}</h2>"
        if not isinstance(error, StepMissingError):
            return head + parts.note(reason, "warn")
        number, title = 1 + list(self.screens).index(error.screen), self.screens[error.screen].title
        go = parts.button(f"Go to {title}", "screen", value=str(number), kind="primary")
        return f"{head}<p class='sentence'>{parts.words(reason)}</p><p>{go}</p>"

    def _go_on(self, number: int) -> None:
        """What the current screen left for later, piece by piece: what a person does comes between.

        A screen that was left is drawn to its end when it is shown again.
        """
        if number == self._filling and self.screens[self.current].later:
            document: Any = pn.state.curdoc
            document.add_next_tick_callback(partial(self._draw_later, number))

    def _bring_back(self, number: int, count: int) -> None:
        """The first panes of a screen that was drawn before, then one after the other: to send a
        section's figures again takes a while."""
        panes = self.screens[self.current].panes
        if number != self._filling:
            return
        self.main.objects = panes[:count]
        if count < len(panes):
            document: Any = pn.state.curdoc
            document.add_next_tick_callback(partial(self._bring_back, number, count + 1))
        else:
            self._go_on(number)

    async def _draw_later(self, number: int) -> None:
        later = self.screens[self.current].later
        if number == self._filling and later:
            waiting = later.pop(0)()
            if waiting is None:
                self._go_on(number)
            else:  # outside of the document's lock, so that what a person does is heard meanwhile
                document: Any = pn.state.curdoc
                self._waits = asyncio.ensure_future(self._wait_for(waiting, number, document))

    async def _wait_for(self, waiting: Later, number: int, document: Any) -> None:
        drawn = await waiting

        def draw() -> None:
            drawn()
            self._go_on(number)

        document.add_next_tick_callback(draw)

    def wait(self) -> None:
        """Say that the screen is being made."""
        screen = self.screens[self.current]
        self.main.objects = [parts.html(f'<p class="muted wait">{parts.words(screen.title)} …</p>')]

    # --- what a person does ---------------------------------------------------------------

    async def heard(self, text: str) -> None:
        """Messages of the page, some heard before: what was clicked or changed, and its value."""
        try:
            messages = [(str(m["do"]), m.get("value"), int(m["count"])) for m in json.loads(text)]
        except (ValueError, KeyError, TypeError, AttributeError):
            return
        for what, value, number in messages:
            if number > self._heard:
                self._heard = number
                await self.settle()
                await self.guarded(partial(self._do, what, value))
        self.draw_frame()

    async def guarded(self, act: Callable[[], Awaitable[None]]) -> None:
        """Do something; an error that a user can fix becomes a line at the top."""
        try:
            await act()
        except SysidError as error:
            self.tell(str(error), is_error=True)
        except Exception as error:
            if os.environ.get("SYSID_DEBUG"):
                traceback.print_exc()
            what = one_line(f"{type(error).__name__}: {error}")
            self.tell(f"{what} (a fault in sysid itself)", is_error=True)

    async def _do(self, what: str, value: Any) -> None:
        bench = self.bench
        if what == "screen":
            await self.show(list(self.screens)[int(value) - 1])
        elif what == "undo":
            self.tell(f"undone: {bench.undo()}")
        elif what == "redo":
            self.tell(f"done again: {bench.redo()}")
        elif what == "dismiss":
            self.message = ""
        elif what == "cancel":
            if bench.job is not None:
                await asyncio.to_thread(bench.job.cancel)
        elif what == "close-job":
            if bench.job is not None and bench.job.is_done:
                bench.job = None
        elif what == "allow":
            bench.allowed.add(str(value))
            bench.changes += 1
        elif what == "upload-began":
            self.tell(f"receiving {value}")
        elif what == "upload-refused":
            raise InputError(str(value))
        elif what == "uploaded":
            names = [str(name) for name in value]
            said = f"{some_of(names, 3)} {'is' if len(names) == 1 else 'are'} in the folder"
            self.tell(f"{said}; below, say what the channels of {names[0]} are")
            bench.changes += 1
            await self.show("files")
            await self.screens["files"].do("file", names[0])
        else:
            self.message = ""
            await self.screens[self.current].do(what, value)

    async def show(self, key: str) -> None:
        """Go to a screen."""
        if key not in self.screens:
            return
        self.current = key
        self.draw_frame()
        screen = self.screens[key]
        if screen.panes and screen.stamp == self.bench.stamp():
            self._filling += 1
            self._stamp = screen.stamp
            self._bring_back(self._filling, _FIRST_PANES)
            return
        self.wait()
        await self.fill()

    def tell(self, text: str, *, is_error: bool = False) -> None:
        """A line at the top."""
        self.message, self.is_error = self.bench.brief(text), is_error

    def start(self, what: str, words: Sequence[str], expected: Any = None) -> None:
        """Start a command, once the code that it would run was allowed."""
        for code in own_code(words):
            self.bench.check_allowed(code)
        if self._job is not None and self._job.is_done:
            raise InputError(f"{self._job.what} ends just now; repeat this")
        self._job = self.bench.start(what, words, expected)

    async def settle(self) -> None:
        """What follows of this window's job, once it has ended: before anything else is done."""
        job = self._job
        if job is not None and job.is_done:
            self._job = None
            self.bench.ended(job)
            await self.guarded(lambda: self._finished(job))

    async def look(self) -> None:
        """Whether files or the job have changed, by this window, another or an editor."""
        await self.settle()
        job = self.bench.job
        if job is not None and not job.is_done:
            self.strip.object = self._strip()
        if self.bench.stamp() != self._stamp:
            await self.fill()
            self.draw_frame()

    async def _finished(self, job: Job) -> None:
        for screen in self.screens.values():
            await screen.finished(job)


def _job_bar(job: Job, made: str) -> str:
    """A command that works or has ended; `made` leads to what it has made."""
    command = f"<code>{parts.words(command_line(job.words))}</code>"
    if job.is_done:
        kind = "info" if job.code == 0 else "error"
        # What programs read is shown by the screen that asked for it.
        said = job.lines if "--json" in job.words else (*job.lines, job.output)
        output = "\n".join(said)[-8000:]
        printed = f"<pre>{parts.words(output)}</pre>" if output else ""
        told = parts.notices(job.notices, _MOST_NOTICES)
        more = parts.fold("the command and what it printed", command + printed)
        close = parts.button("×", "close-job", kind="small", title="Dismiss")
        return f'<div class="{kind} job">{parts.words(job.state)} {made}{close}{told}{more}</div>'
    share = job.share
    value = "" if share is None else f' value="{share:.3f}"'
    cancel = parts.button("Cancel", "cancel", kind="small danger")
    return (
        f'<div class="info job"><progress max="1"{value} aria-label="{parts.words(job.what)}">'
        f"</progress> {parts.words(job.state)} {cancel}"
        f"{command}</div>"
    )


def _import_soon() -> None:
    for name in _SOON:
        import_module(name)


def window(bench: Workbench) -> pn.Template:
    """The page of one window."""
    given = pn.state.session_args
    document: Any = pn.state.curdoc
    # Panel says so when it writes the page; a window that comes back later than its session was
    # kept has a new one, and would ask the network for its style sheets.
    document.template_variables["dist_url"] = _OWN_STYLES
    said = [value.decode("utf-8", "replace") for value in given.get("scheme", [])]
    scheme: Scheme = "dark" if said[:1] == ["dark"] else "light"
    first = [value.decode("utf-8", "replace") for value in given.get("screen", [])]
    made = Window(bench, scheme, first[0] if first else "")
    page = pn.Template(template_text("page.html"), design=pn.theme.Native)
    page.add_variable("scheme", scheme)
    page.add_variable("script", template_text("page.js"))
    for name in ("top", "strip", "main", "done", "asked"):
        page.add_panel(name, getattr(made, name))
    made.draw_frame()
    made.wait()

    def heard(event: Any) -> None:
        document.add_next_tick_callback(partial(made.heard, event.new))

    async def loaded() -> None:
        await made.fill()
        # Not waited for: the window's document is locked until this function returns.
        asyncio.get_running_loop().run_in_executor(None, _import_soon)
        document.add_periodic_callback(made.look, 700)  # ms

    # All of it runs with the document locked, one after the other.
    made.asked.param.watch(heard, "value")
    onload: Any = pn.state.onload
    onload(lambda: document.add_next_tick_callback(loaded))
    return page


__all__ = ["Window", "window"]
