"""The errors of a request that are not faults of the program.

All are turned into one line and an exit code by `sysid.commands.app`.
"""

from __future__ import annotations

from pathlib import Path


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

    >>> valves_still = si.read_log("friction_static.parquet", campaign.rig)
    >>> try:
    ...     si.fit_valve_pwm(valves_still)
    ... except si.NotIdentifiedError as error:
    ...     print("never leaves zero" in str(error))
    True
    """

    exit_code = 3


class SimulationError(NotIdentifiedError):
    """A model that cannot be simulated: its equations switch without end at one instant."""


def input_error(where: str | Path, what: str, mend: str) -> InputError:
    """One line: where it is (file, row or key), what is wrong, how to fix it."""
    line = f"{where}: {what}; {mend}"
    return InputError(" ".join(line.split()))
