"""The errors of a request that are not faults of the program, and parts that fail on their own.

An error that ends a command is turned into one line and an exit code by `sysid.commands.app`; one
of a part that the rest goes on without becomes a `Failure`, and its line a `Notice`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

Result = TypeVar("Result")

FAULT = 1
"""Exit code of what is no fault of the input: a worker that died, a fault of the program."""

# Characters of a file's value, of a word, of a place and of a whole part that a line shows.
_LONGEST_VALUE, _LONGEST_WORD, _LONGEST_PLACE, _LONGEST_PART = 60, 160, 300, 2000
_QUOTED = re.compile(rf"""(?<![\w'"])(['"])((?:(?!\1).){{{_LONGEST_VALUE + 1},}}?)\1(?!\w)""")
_CONTROL = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]"
)


# What varies among lines that say the same; several in a list are one.
_ITEM = (
    r"(?:[^\s,;:]*[/\\][^\s,;:]*|[^\s,;:]+\.(?:csv|parquet|toml|json)\b|\b[ABab]\b"
    r"|\d+(?:\.\d+)?(?:e[+-]?\d+)?)"
)
_VARIES = re.compile(rf"{_ITEM}(?:, {_ITEM})*")
_WORD_BEFORE = re.compile(r"[A-Za-z]+ $")
# Others of a group of which a line says what is different; places of which the same is said.
_MOST_ALIKE = 3


class SysidError(Exception):
    """Base of the errors that a user can fix; `exit_code` is the process' exit status.

    >>> try:
    ...     si.read_rig("no such file.toml")
    ... except si.SysidError as error:
    ...     print(type(error).__name__, error.exit_code)
    InputError 2
    """

    exit_code = 1


class InputError(SysidError):
    """Unusable input or arguments (exit 2): one line that names the place and the fix.

    >>> si.read_log("campaign.csv", campaign.rig)
    Traceback (most recent call last):
    sysid.errors.InputError: campaign.csv: no such file; give the path of a log
    """

    exit_code = 2


class NotIdentifiedError(SysidError):
    """The data were read, but cannot identify the requested parameters (exit 3).

    >>> moving = si.read_log("motion_pwm.parquet", campaign.rig)
    >>> try:
    ...     si.fit_valve_pwm(moving)
    ... except si.NotIdentifiedError as error:
    ...     print("is not constant" in str(error))
    True
    """

    exit_code = 3


class SimulationError(NotIdentifiedError):
    """A model that cannot be simulated: it diverges, or switches without end at one instant."""


class OutOfBudgetError(Exception):
    """The budget of a computation (`sysid.parallel.limited`) is used up."""


def input_error(where: str | Path, what: str, fix: str) -> InputError:
    """One line: where it is (file, row or key), what is wrong, how to fix it."""
    place = shortened(visible(str(where)), _LONGEST_PLACE)
    return InputError(f"{place}: {one_line(what)}; {one_line(fix)}")


def escaped(text: str, keep: str = "") -> str:
    """`text` with control characters (of a terminal, of the direction of writing) as escapes.

    Those in `keep`, such as line feeds, stay.
    """
    return _CONTROL.sub(lambda m: m[0] if m[0] in keep else ascii(m[0])[1:-1], text)


def visible(text: str) -> str:
    """`text` on one line: white space as single blanks, nothing else that cannot be seen."""
    return escaped(" ".join(text.split()))


def shortened(text: str, longest: int = _LONGEST_VALUE) -> str:
    """`text`, without its middle where it is longer than that many characters."""
    tail = longest // 4
    return text if len(text) <= longest else f"{text[: longest - tail - 3]}...{text[-tail:]}"


def some_of(names: Sequence[str], most: int, *, counted: bool = True) -> str:
    """The first of `names`, as a list; with how many more there are, or only that there are."""
    more = len(names) - most
    end = "" if more <= 0 else f" and {more} more" if counted else " ..."
    return ", ".join(names[:most]) + end


def together(lines: Iterable[str]) -> Iterator[str]:
    """Lines `place: what`; what is said of several places is said once."""
    places: dict[str, list[str]] = {}
    for line in lines:
        place, _, said = line.partition(": ")
        places.setdefault(said, []).append(place)
    for said, found in places.items():
        names = list(dict.fromkeys(found))
        yield from [f"{some_of(names, _MOST_ALIKE)}: {said}"] if said else names


def grouped(lines: Iterable[str], *, named: bool = False, rest: str = "") -> list[str]:
    """Lines that differ only in numbers, tests, files and sides as one each: the first of them.

    It ends with what is different in the others, as far as a line holds that; `rest` says where the
    others are. `named`: the name before the first colon, of a campaign, may differ too.
    """
    groups: dict[str, list[tuple[str, list[str]]]] = {}
    for line in dict.fromkeys(map(str, lines)):
        name, _, said = line.partition(": ") if named else ("", "", line)
        varying = [name] if named else []
        for found in _VARIES.finditer(said):  # with the word that says what it is: "duty 0.98"
            before = _WORD_BEFORE.search(said, 0, found.start())
            varying.append((before[0] if before else "") + found[0])
        groups.setdefault(_VARIES.sub("#", said), []).append((line, varying))
    return [_as_one(own, rest) for own in groups.values()]


def _as_one(own: Sequence[tuple[str, list[str]]], rest: str) -> str:
    (line, first), *others = own
    if not others:
        return line
    differing = [
        ", ".join(mine for mine, its in zip(varying, first, strict=True) if mine != its)
        for _, varying in others
    ]
    shown = differing[:_MOST_ALIKE]
    more = len(differing) - len(shown)
    end = [f"and {more} more{rest and f': {rest}'}"] if more else []
    return f"{line} (likewise {'; '.join([*shown, *end])})"


def one_line(text: str) -> str:
    """`text` as a message shows it: one line, nothing raw, long words and quoted values cut."""
    line = _QUOTED.sub(lambda m: f"{m[1]}{shortened(m[2])}{m[1]}", visible(text))
    words = (shortened(word, _LONGEST_WORD) for word in line.split(" "))
    return shortened(" ".join(words), _LONGEST_PART)


@dataclass(frozen=True)
class Failure:
    """A job that came to no result: why, in a line, and whether only as its budget ended.

    `error`: what would have ended the command, where that is not a fault of the program.
    """

    reason: str
    out_of_budget: bool = False
    error: SysidError | None = field(default=None, compare=False, repr=False)

    @property
    def status(self) -> int:
        """The exit status with which it would have ended the command."""
        return 1 if self.error is None else self.error.exit_code

    @staticmethod
    def of(error: BaseException) -> Failure:
        """The failure of a job that raised an error."""
        return Failure(one_line(f"{type(error).__name__}: {error}"))


def on_its_own(part: Callable[[], Result]) -> Result | Failure:
    """The result of a part without which the other work continues, or why it failed.

    What the data do not give (a SysidError) is a reason in its own words, and so is what cannot be
    computed from them: a singular matrix, an overflow. Anything else is a fault of the program:
    its reason says so, and with `SYSID_DEBUG` it is raised. A budget that ends, and what the
    machine refuses (OSError), are not the part's: they pass.
    """
    from numpy.linalg import LinAlgError

    try:
        return part()
    except (OutOfBudgetError, OSError):
        raise
    except SysidError as error:
        return Failure(str(error), error=error)
    except (ArithmeticError, LinAlgError) as error:
        what = one_line(f"its equations cannot be solved: {error}")
        return Failure(what, error=NotIdentifiedError(what))
    except Exception as error:
        if os.environ.get("SYSID_DEBUG"):
            raise
        what = f"{Failure.of(error).reason} (a fault in sysid itself; SYSID_DEBUG=1 shows where)"
        return Failure(what)


def unless_failed(
    not_done: str, part: Callable[[], Result], notices: list[str]
) -> Result | Failure:
    """`on_its_own`, with a notice of what is `not_done`, and why, where the part failed."""
    found = on_its_own(part)
    if isinstance(found, Failure):
        notices.append(f"{not_done}: {found.reason}")
    return found


def error_of(failures: Sequence[Failure], what: str) -> Exception:
    """The error, saying `what`, of a whole of which no part came to a result, as these failed.

    InputError where the input is unusable for every part, NotIdentifiedError where the data do not
    suffice for some or there is none, RuntimeError where a fault of the program ended one. Where a
    part's own error says it, that error.
    """
    for failure in failures:
        if failure.error is not None and failure.reason == what:
            return failure.error
    statuses = {failure.status for failure in failures}
    if 1 in statuses:
        return RuntimeError(what)
    return InputError(what) if statuses == {InputError.exit_code} else NotIdentifiedError(what)


class Notice(str):
    """A line for the user that knows what it is about; it prints, compares and is kept as text.

    `subject`: a place in a bundle ("friction.coulomb_nm", "valves.a.pwm"), or the kind of a log.
    """

    subject: str

    def __new__(cls, line: str, subject: str = "") -> Notice:
        made = super().__new__(cls, line)
        made.subject = subject
        return made


def about(subject: str, lines: Iterable[str]) -> list[str]:
    """These lines as notices about a subject; those that have their own keep it."""
    return [line if isinstance(line, Notice) else Notice(line, subject) for line in lines]


def subject_of(line: str) -> str:
    """What a notice is about; empty where it does not say so."""
    return line.subject if isinstance(line, Notice) else ""
