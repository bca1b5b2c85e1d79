"""The command line (`docs/reference/command-line.md`): the group of commands, and exit codes.

Each command is a file of this folder, imported when it is called: `sysid --help` reads only
`COMMANDS` and stays quick.
"""

from __future__ import annotations

import contextlib
import errno
import gc
import logging
import os
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from sysid import __version__, parallel
from sysid.commands.help_pages import page_for
from sysid.errors import FAULT, InputError, SysidError, one_line, visible
from sysid.io.files import inputs_kept

# Small matrices are slower on several BLAS threads; read when numpy is first imported.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # jax's C++ parts print on their own

# As a shell says it of a process that the signal ended.
_INTERRUPTED = 128 + signal.SIGINT
_NO_OUTPUT = (errno.ENOSPC, errno.EIO, errno.EDQUOT)

COMMANDS = {
    "advise": "Which test to run next: expected standard errors, ties, sizes of effects.",
    "app": "The workbench in the browser: look at logs, fit, try effects, compare and export.",
    "check": "Data quality of each LOG, and what it can and cannot identify.",
    "compare": "Parameters of several bundles side by side, and what moved.",
    "control": "Closed-loop simulation with a controller that reads BUNDLE.",
    "convert": "Bring a lab's own file (.mat, text, Excel, TDMS, Parquet) into the log format.",
    "demo": "The whole pipeline on the bundled campaign.",
    "diagnose": "What the model lacks: the residual's cause, and the errors with and without it.",
    "effects": "The catalogue of effects; with ID one entry in full, and its influence on a rig.",
    "export": "Files for a controller (a C header, MATLAB, flat JSON) or a simulator (FMU, MJCF).",
    "fit": "Identify parameters: one part from its logs, or a whole CAMPAIGN.toml.",
    "fleet": "`run` for every CAMPAIGN, and one page on all of them: what changed, and when.",
    "init": "Write a commented rig or campaign file to fill in.",
    "monitor": "Alarms where the machine of each LOG no longer obeys BUNDLE, by kind of drift.",
    "pwm-frequency": "Which PWM frequency to run at, from valve-pwm logs at several: one LOG each.",
    "refine": "All parameters of the assembled model together, by simulation error.",
    "run": "The whole pipeline, from checks to exports. Resumes where it stopped.",
    "simulate": "Open-loop simulation of the commands in INPUTS, a log.",
    "validate": "Open-loop simulation of a bundle's model against a campaign's motion logs.",
}
"""The first line of each command's help; `NAME` is the function of that name in `NAME.py`."""
# This file has the name of one of them, and a name in Python has no hyphen.
_FILES = {"app": "workbench", "pwm-frequency": "pwm_frequency"}


def home_of(name: str) -> str:
    """The file of a command, without its suffix, and the function in it."""
    return _FILES.get(name, name)


class _ReaderGoneError(Exception):
    """The reader of a pipe (head, less) has ended; click would exit with status 1."""


class _App(click.Group):
    """All commands, imported when called; their output is flushed before they end."""

    def __init__(self, **settings: Any) -> None:
        lines = {name: click.Command(name, help=line) for name, line in COMMANDS.items()}
        super().__init__(**{**settings, "commands": lines})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.commands:
            return None
        home = home_of(cmd_name)
        command: click.Command = getattr(import_module(f"sysid.commands.{home}"), home)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        click.Group(commands=self.commands).format_commands(ctx, formatter)

    def make_context(self, *words: Any, **options: Any) -> click.Context:
        try:
            return super().make_context(*words, **options)  # prints --help
        except BrokenPipeError:
            raise _ReaderGoneError from None

    def invoke(self, ctx: click.Context) -> Any:
        try:
            found = super().invoke(ctx)
            sys.stdout.flush()
        except BrokenPipeError:
            raise _ReaderGoneError from None
        return found


@click.group(cls=_App, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="sysid")
@click.option(
    "--jobs",
    metavar="N",
    expose_value=False,
    help="Maximum number of processes, anywhere on the line (also SYSID_JOBS); 1: no worker.",
)
def app() -> None:
    """Turn logged tests of a pneumatic actuator into a model that controllers can trust."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; its exit status, errors as one line on standard error."""
    _open_closed()
    parallel.share_one_heap()
    # Modules and traced programs are objects that stay: to search them for garbage as often as by
    # default takes 3 % of a diagnosis.
    gc.set_threshold(10_000)
    with _others_silent(), inputs_kept():
        return _run(arguments)


@contextlib.contextmanager
def _others_silent() -> Iterator[None]:
    """Suppress warnings and log lines of other libraries: one line is printed."""
    if os.environ.get("SYSID_DEBUG"):
        yield
        return
    shown, disabled = warnings.showwarning, logging.root.manager.disable
    # Not the filters: where a caller turns warnings into errors, they remain that.
    warnings.showwarning = lambda *_, **__: None
    logging.disable()
    try:
        yield
    finally:
        warnings.showwarning = shown
        logging.disable(disabled)


def _run(arguments: Sequence[str] | None) -> int:
    try:
        words = _without_jobs(sys.argv[1:] if arguments is None else arguments)
        app(args=words, prog_name="sysid", standalone_mode=False)
    except SysidError as error:
        for line in getattr(error, "__notes__", ()):
            click.echo(f"sysid: notice: {visible(one_line(line))}", err=True)
        return _report("error", _with_page(error), error.exit_code)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        return InputError.exit_code
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "sysid"
        return _report(
            "error",
            f"{one_line(error.format_message().rstrip('.'))}; see `{command} --help`",
            InputError.exit_code,
        )
    except (click.Abort, KeyboardInterrupt):
        return _report("error", "interrupted; no file was left half-written", _INTERRUPTED)
    except _ReaderGoneError:
        # The rest of the output has no reader.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        if error.filename is not None or error.errno not in _NO_OUTPUT:
            return _fault(error)
        # Buffered output cannot be written at exit either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        what = f"standard output: {error.strerror}; free space there, or write elsewhere"
        return _report("error", what, InputError.exit_code)
    except Exception as error:
        return _fault(error)
    return 0


def _with_page(error: SysidError) -> str:
    """The error's line with the page of the documentation that helps, where there is one."""
    page = page_for(error)
    return f"{error} (docs: {page})" if page else str(error)


def _fault(error: Exception) -> int:
    """A fault in sysid itself: one line, or with SYSID_DEBUG the traceback."""
    if os.environ.get("SYSID_DEBUG"):
        raise error
    what = one_line(f"{type(error).__name__}: {error}")
    return _report("fault", f"{what} (a fault in sysid itself; SYSID_DEBUG=1 shows where)", FAULT)


def _open_closed() -> None:
    """A caller may have closed standard output or error: then there is no reader."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115


def _without_jobs(words: Sequence[str]) -> list[str]:
    """The line without `--jobs N`, which holds for every command. Raises InputError."""
    kept: list[str] = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        if word == "--":
            return [*kept, word, *rest]
        name, equals, value = word.partition("=")
        if name != "--jobs":
            kept.append(word)
            continue
        if not equals and not rest:
            raise click.UsageError("Option '--jobs' requires an argument.")
        os.environ[parallel.VARIABLE] = value if equals else rest.pop(0)
        parallel.check_jobs("--jobs")
    return kept


def _report(kind: str, line: str, code: int) -> int:
    click.echo(f"sysid: {kind}: {visible(line)}", err=True)
    return code


if __name__ == "__main__":
    sys.exit(main())
