"""The errors of a request that are not faults of the program.

All are turned into one line and an exit code by `sysid.commands.app`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

# Characters of a file's value, of a word, of a place and of a whole part that a line shows.
_LONGEST_VALUE, _LONGEST_WORD, _LONGEST_PLACE, _LONGEST_PART = 60, 160, 300, 2000
_QUOTED = re.compile(rf"""(?<![\w'"])(['"])((?:(?!\1).){{{_LONGEST_VALUE + 1},}}?)\1(?!\w)""")
_CONTROL = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff\ufeff]"
)


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


def input_error(where: str | Path, what: str, mend: str) -> InputError:
    """One line: where it is (file, row or key), what is wrong, how to fix it."""
    place = shortened(visible(str(where)), _LONGEST_PLACE)
    return InputError(f"{place}: {one_line(what)}; {one_line(mend)}")


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


def one_line(text: str) -> str:
    """`text` as a message shows it: one line, nothing raw, long words and quoted values cut."""
    line = _QUOTED.sub(lambda m: f"{m[1]}{shortened(m[2])}{m[1]}", visible(text))
    words = (shortened(word, _LONGEST_WORD) for word in line.split(" "))
    return shortened(" ".join(words), _LONGEST_PART)
