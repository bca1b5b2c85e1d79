"""One command at a time in a folder of results, on all the machines that share it.

A command keeps a file in the folder that says who works there. It is made with O_EXCL, which
network file systems keep too, and touched again and again. What a killed process has left there, or
a machine that went down, is recognised: on the same machine by the process itself, on another by
the file's age by the clock of the file system.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import platform
import secrets
import tempfile
import threading
import time
from collections.abc import Generator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sysid.errors import InputError, input_error
from sysid.io.files import make_folder, not_writable, terminated_by_exception

LOCK_FILE = ".sysid-lock"
_TAKEOVER = ".sysid-lock-takeover"
# A machine that does not touch its file so many times over is taken to be down.
_BEAT_S = 15.0
_SILENT_BEATS = 20
# Another process writes its file, or takes the folder over.
_WAIT_S = 0.05
# proc(5): the fields of /proc/PID/stat behind the name: state first, the start's time later.
_BEGAN, _ENDED = 19, ("Z", "X")

_READ_ONLY = (errno.EROFS, errno.EACCES, errno.EPERM)

_held: set[tuple[str, int, int]] = set()


class FolderInUseError(InputError):
    """Another command is at work in a folder."""


@dataclass(frozen=True)
class Holder:
    """Who works in a folder: machine, process, and since when (s since 1970).

    `boot` and `processes` say which start of the machine, and which of its spaces of process
    numbers; `began` is when the process began, by the machine's clock; all empty where the system
    does not say.
    """

    host: str
    machine: str
    boot: str
    processes: str
    pid: int
    began: str
    since: float
    token: str

    @classmethod
    def this(cls) -> Holder:
        """This process, from now on."""
        return cls(
            host=platform.node(),
            machine=_text("/etc/machine-id"),
            boot=_text("/proc/sys/kernel/random/boot_id"),
            processes=_space(),
            pid=os.getpid(),
            began=_began(os.getpid()) or "",
            since=time.time(),
            token=secrets.token_hex(8),
        )

    @classmethod
    def of(cls, text: str) -> Holder | None:
        """The holder as written into the file; None where it is not (yet) complete."""
        try:
            content: dict[str, Any] = json.loads(text)
            found = cls(**content)
        except (ValueError, TypeError):
            return None
        whole = isinstance(found.pid, int) and isinstance(found.since, int | float)
        return found if whole else None

    def is_gone(self) -> bool | None:
        """Whether the process has ended; None where that cannot be seen from here."""
        here = Holder.this()
        if os.name != "posix":  # elsewhere asking for a process may end it
            return None
        if (self.host, self.machine) != (here.host, here.machine):
            return None
        if self.boot != here.boot:
            # The machine was restarted; without a host name of its own it may be a different one.
            return True if self.machine else None
        if self.processes != here.processes:
            return None
        return not _is_alive(self.pid) or _began(self.pid) not in (self.began, None)

    def __str__(self) -> str:
        day, now = time.localtime(self.since), time.localtime()
        form = "%H:%M" if day[:3] == now[:3] else "%Y-%m-%d %H:%M"
        return f"since {time.strftime(form, day)} (process {self.pid} on {self.host})"


@contextlib.contextmanager
def working_in(folder: Path) -> Generator[None, None, None]:
    """No other command works in `folder` within the block; the folder is made.

    Raises FolderInUseError where one does, InputError where there can be no such folder. What a
    process that was killed has left is taken over. Ctrl-C and SIGTERM release the folder too.
    Within a block of the same thread nothing is done again; neither is where the folder may not
    be written.
    """
    make_folder(folder)
    key = os.path.realpath(folder), os.getpid(), threading.get_ident()
    if key in _held:
        yield
        return
    with terminated_by_exception():
        holder = _acquired(folder)
        _held.add(key)
        ended = threading.Event()
        if holder is not None:
            beat = (folder / LOCK_FILE, ended)
            threading.Thread(target=_touch_often, args=beat, daemon=True).start()
        try:
            yield
        finally:
            ended.set()
            _held.discard(key)
            if holder is not None:
                _release(folder, holder)


def clear_left(folder: Path) -> bool:
    """Remove what an ended process has left of its work in `folder`; whether none works there."""
    path = folder / LOCK_FILE
    with contextlib.suppress(OSError):
        if path.exists() and _is_left(folder):
            with _alone(folder) as is_mine:
                if is_mine and _is_left(folder):
                    path.unlink(missing_ok=True)
        return not path.exists()
    return True


def _acquired(folder: Path) -> Holder | None:
    """This process as the one at work in the folder; None where nothing can be written there."""
    holder, path = Holder.this(), folder / LOCK_FILE
    try:
        for _ in range(100):
            if _made(path, json.dumps(asdict(holder))):
                return holder
            if not _is_left(folder):
                if _read(path) is not None:
                    break
            else:
                with _alone(folder) as is_mine:
                    if is_mine and _is_left(folder):
                        path.unlink(missing_ok=True)
                        continue
            time.sleep(_WAIT_S)
    except OSError as error:
        if error.errno in _READ_ONLY:
            return None
        raise not_writable(path, error) from None
    raise _in_use(folder)


def _made(path: Path, text: str) -> bool:
    """Make a file of this text; False where there is one already."""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
    except FileExistsError:
        return False
    try:
        with os.fdopen(handle, "w") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
    except OSError:
        path.unlink(missing_ok=True)
        raise
    return True


@contextlib.contextmanager
def _alone(folder: Path) -> Generator[bool, None, None]:
    """Whether this process is the only one that may remove the folder's file within the block."""
    guard = folder / _TAKEOVER
    if not _made(guard, ""):
        # Kept for a moment only, unless its process was killed in it.
        if _age(folder, guard) > _BEAT_S * _SILENT_BEATS:
            guard.unlink(missing_ok=True)
        yield False
        return
    try:
        yield True
    finally:
        guard.unlink(missing_ok=True)


def _is_left(folder: Path) -> bool:
    """Whether the one whose file is in the folder has ended, or has long been silent."""
    path = folder / LOCK_FILE
    gone = None if (holder := _read(path)) is None else holder.is_gone()
    return _age(folder, path) > _BEAT_S * _SILENT_BEATS if gone is None else gone


def _age(folder: Path, path: Path) -> float:
    """Seconds since a file was touched, by the clock of its file system; 0 without the file."""
    with tempfile.TemporaryFile(dir=folder) as now, contextlib.suppress(FileNotFoundError):
        return os.fstat(now.fileno()).st_mtime - path.stat().st_mtime
    return 0.0


def _read(path: Path) -> Holder | None:
    try:
        return Holder.of(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError):
        return None


def _release(folder: Path, holder: Holder) -> None:
    path = folder / LOCK_FILE
    if _read(path) == holder:  # else another machine has taken this one to be down
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)


def _touch_often(path: Path, ended: threading.Event) -> None:
    while not ended.wait(_BEAT_S):
        with contextlib.suppress(OSError):
            os.utime(path)


def _in_use(folder: Path) -> FolderInUseError:
    holder = _read(folder / LOCK_FILE)
    said = input_error(
        folder,
        f"another run has been working in this folder{'' if holder is None else f' {holder}'}",
        "wait until it has ended, or choose another folder with -o",
    )
    return FolderInUseError(str(said))


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:  # another user's
        return True
    return True


def _began(pid: int) -> str | None:
    """When a process began, in ticks since the machine did; empty where it has ended.

    None where the system does not say.
    """
    stat = _text(f"/proc/{pid}/stat").rpartition(")")[2].split()  # its name may hold anything
    if len(stat) <= _BEGAN:
        return None
    return "" if stat[0] in _ENDED else stat[_BEGAN]


def _space() -> str:
    try:
        return str(Path("/proc/self/ns/pid").readlink())
    except OSError:
        return ""


def _text(path: str) -> str:
    try:
        return Path(path).read_text("utf-8", "replace").strip()
    except OSError:
        return ""


__all__ = ["LOCK_FILE", "FolderInUseError", "Holder", "clear_left", "working_in"]
