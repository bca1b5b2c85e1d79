"""Result files: written whole or not at all, and not over what a command has read."""

from __future__ import annotations

import contextlib
import os
import secrets
import signal
import stat
import tempfile
import threading
from collections.abc import Generator, Sequence
from pathlib import Path
from types import FrameType
from typing import BinaryIO

from sysid.errors import InputError, input_error

_PREFIX, _SUFFIX = ".sysid-", ".tmp"
_DESCRIPTORS = Path("/proc/self/fd")

# The inputs of the command at work: whether a new bundle may replace it. By their paths: the number
# of a file that another process has replaced in the meantime may be that of a new one.
_inputs: dict[Path, bool] | None = None


def stamp_of(path: Path | None) -> tuple[str, int, int, int] | None:
    """What changes when a file does, or another is put in its place; None where there is none."""
    if path is None:
        return None
    try:
        found = path.stat()
    except OSError:
        return None
    return str(path), found.st_mtime_ns, found.st_size, found.st_ino


@contextlib.contextmanager
def inputs_kept() -> Generator[None, None, None]:
    """No file that is read as an input in the block is written over in it: for a command.

    But a bundle, by a bundle.
    """
    global _inputs
    before, _inputs = _inputs, {}
    try:
        yield
    finally:
        _inputs = before


@contextlib.contextmanager
def inputs_changed() -> Generator[None, None, None]:
    """What is read in the block may be written over in it: to change inputs on purpose."""
    global _inputs
    before, _inputs = _inputs, None
    try:
        yield
    finally:
        _inputs = before


def note_input(path: Path, *, is_bundle: bool = False) -> None:
    """Note that a file was read as an input (`inputs_kept`)."""
    if _inputs is not None:
        key = Path(os.path.realpath(path))
        _inputs[key] = is_bundle and _inputs.get(key, True)


def _refuse_input(path: Path, is_bundle: bool) -> None:
    if not _inputs or not path.is_file():
        return
    read = [may_be for known, may_be in _inputs.items() if _is_same(known, path)]
    if read and not (is_bundle and all(read)):
        raise input_error(
            path,
            "is what this command reads; its result would replace it",
            "give another path for the result",
        )


def _is_same(known: Path, path: Path) -> bool:
    try:
        return known.samefile(path)
    except OSError:  # it is no longer there
        return False


def write_atomic(path: Path, data: bytes | str, *, is_bundle: bool = False) -> None:
    """Write `data` (text as UTF-8) to `path`, whole or not at all; see `open_atomic`."""
    with open_atomic(path, is_bundle=is_bundle) as file:
        file.write(data.encode("utf-8") if isinstance(data, str) else data)


def write_new(path: Path, text: str, *, force: bool) -> None:
    """`write_atomic` of a template; InputError where the file exists and `force` is not given."""
    if path.exists() and not force:
        raise input_error(path, "exists already", "choose another file, or give --force")
    write_atomic(path, text)


@contextlib.contextmanager
def open_atomic(path: Path, *, is_bundle: bool = False) -> Generator[BinaryIO, None, None]:
    """A file to write `path` through: in place once the block has ended without an error.

    The bytes go to a temporary file in the same folder, which is then renamed. After an
    error, Ctrl-C or SIGTERM inside the block the temporary file is removed and `path` is
    unchanged. A pipe or device is written directly. Raises InputError where
    the folder is missing, not writable or full, and for an input of the command (`inputs_kept`);
    only a bundle that it has read may be replaced, by a bundle.
    """
    try:
        mode = _mode(path)
        _refuse_input(path, is_bundle)
    except (OSError, ValueError) as error:
        raise not_writable(path, error) from None
    if stat.S_ISDIR(mode):
        raise input_error(path, "is a directory", "give the path of a file in it to write")
    if mode and not stat.S_ISREG(mode):
        try:
            with path.open("wb") as direct:
                yield direct
        except BrokenPipeError:
            raise
        except OSError as error:
            raise not_writable(path, error) from None
        return
    with terminated_by_exception():
        yield from _through_temporary(path, mode)


def _mode(path: Path) -> int:
    """`st_mode` of the file at `path` (or of what it links to), 0 if it does not exist."""
    try:
        return path.stat().st_mode
    except FileNotFoundError:
        return 0


def _through_temporary(path: Path, mode: int) -> Generator[BinaryIO, None, None]:
    target = Path(os.path.realpath(path))  # a link stays a link
    try:
        effective = os.access in os.supports_effective_ids
        # A rename would not check whether the file that it replaces may be written.
        if mode and not os.access(target, os.W_OK, effective_ids=effective):
            raise PermissionError(None, "Permission denied")
        handle, name = _temporary(target.parent)
    except OSError as error:
        raise not_writable(path, error) from None
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
            if name is None:
                name = _named(file.fileno(), target.parent)
        name.chmod(stat.S_IMODE(mode) if mode else 0o666 & ~_umask())
        name.replace(target)
    except OSError as error:
        raise not_writable(path, error) from None
    finally:
        if name is not None:
            name.unlink(missing_ok=True)  # already gone once it was renamed


def _temporary(folder: Path) -> tuple[int, Path | None]:
    """A file to write to: unnamed where the system allows, so that SIGKILL leaves nothing."""
    unnamed = getattr(os, "O_TMPFILE", None)
    if unnamed is not None and _DESCRIPTORS.is_dir():
        # Some file systems have no unnamed files; a folder that is missing fails again below.
        with contextlib.suppress(OSError):
            return os.open(folder, unnamed | os.O_WRONLY, 0o600), None
    handle, name = tempfile.mkstemp(prefix=_PREFIX, suffix=_SUFFIX, dir=folder)
    return handle, Path(name)


def _named(handle: int, folder: Path) -> Path:
    """Give a whole, unnamed file a temporary name, to be renamed from."""
    name = folder / f"{_PREFIX}{os.getpid()}-{handle}-{secrets.token_hex(4)}{_SUFFIX}"
    descriptors = os.open(_DESCRIPTORS, os.O_RDONLY)
    try:
        # With a folder's descriptor Python asks for linkat, which does follow the link.
        os.link(str(handle), name, src_dir_fd=descriptors, follow_symlinks=True)
    finally:
        os.close(descriptors)
    return name


def check_each_once(paths: Sequence[Path], what: str) -> None:
    """InputError for a file that is given twice; `what` each is ("log")."""
    seen: set[Path] = set()
    for path in paths:
        if path.resolve() in seen:
            raise input_error(path, "is given twice", f"give each {what} once")
        seen.add(path.resolve())


def make_folder(folder: Path, *, parents: bool = True) -> None:
    """Make a folder for results unless it exists. Raises InputError where that is not possible."""
    try:
        folder.mkdir(parents=parents, exist_ok=True)
    except OSError as error:
        why = error.strerror or str(error)
        raise input_error(
            folder, f"cannot be created as a folder: {why}", "choose another with -o"
        ) from None


def need_folder_of(path: Path) -> None:
    """InputError where the folder of a file that is to be written is not there: before the work."""
    if not path.parent.is_dir():
        exists = path.parent.exists()
        raise not_writable(path, NotADirectoryError() if exists else FileNotFoundError())


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files that a killed process left in `folder`."""
    for leftover in folder.glob(f"{_PREFIX}*{_SUFFIX}"):
        leftover.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


@contextlib.contextmanager
def terminated_by_exception() -> Generator[None, None, None]:
    """SIGTERM raises SystemExit inside the block, so that the clean-up runs.

    A handler that is already set is kept; outside the main thread none can be set.
    """
    if (
        threading.current_thread() is not threading.main_thread()
        or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    ):
        yield
        return

    def leave(number: int, _frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def not_writable(path: Path, error: OSError | ValueError) -> InputError:
    """The error line for a file that cannot be written."""
    shown = str(path) if len(str(path)) < 200 else f"{str(path)[:80]}..."
    if isinstance(error, FileNotFoundError):
        return input_error(
            shown, f"its folder {path.parent} does not exist", "create it, or choose another"
        )
    if isinstance(error, NotADirectoryError):
        return input_error(shown, f"{path.parent} is not a folder", "choose another place")
    if isinstance(error, PermissionError):
        return input_error(
            shown, "may not be written", "change the permissions, or choose another place"
        )
    reason = getattr(error, "strerror", None) or str(error)
    return input_error(shown, f"cannot be written: {reason}", "choose another place")
