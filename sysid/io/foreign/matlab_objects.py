"""Objects of MATLAB (tables, timetables, time series), which only MATLAB reads: how to export them.

Their values are in a part of the file whose layout MathWorks does not publish.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from sysid.errors import InputError, input_error, some_of

# A variable, or a field of one, of a struct's or a cell's element: rec(2).T
_PART = r"[A-Za-z]\w{0,62}(?:[({]\d{1,9}[)}])?"
_NAME = re.compile(rf"{_PART}(?:\.{_PART})*", re.ASCII)
_OBJECT = "a MATLAB "
# Lines of MATLAB that save an object `{x}` as plain variables in `{file}`.
_LINES = {
    "table": 's = table2struct({x}, "ToScalar", true); save("{file}", "-struct", "s")',
    "timetable": 's = table2struct(timetable2table({x}, "ConvertRowTimes", false), '
    '"ToScalar", true); t = {x}.Properties.RowTimes; s.t = seconds(t - t(1)); '
    'save("{file}", "-struct", "s")',
    "timeseries": 't = {x}.Time; y = {x}.Data; save("{file}", "t", "y")',
    "datetime": 't = seconds({x} - {x}(1)); save("{file}", "t")',
    "duration": 't = seconds({x}); save("{file}", "t")',
    "Simulink.SimulationOutput": "d = {x}.logsout; t = d{{1}}.Values.Time; y = d{{1}}.Values.Data; "
    'save("{file}", "t", "y")',
    "Simulink.SimulationData.Dataset": "t = {x}{{1}}.Values.Time; y = {x}{{1}}.Values.Data; "
    'save("{file}", "t", "y")',
}


def export_lines(name: str, kind: str, path: Path) -> str:
    """The lines of MATLAB that export an object of a class into a file of its own."""
    lines = _LINES.get(kind)
    if lines is None or not _NAME.fullmatch(name):
        return "save its values as plain variables"
    return lines.format(x=name, file=f"{path.stem}_plain.mat")


def reason(name: str, kind: str, path: Path) -> str:
    """Why such an object is no column, and how it becomes one."""
    return f"{_OBJECT}{kind or 'object'} (in MATLAB: {export_lines(name, kind, path)})"


def named_objects(skipped: Mapping[str, str]) -> str:
    """The objects among what is no column, by name, and why; empty without any."""
    found = [f"{name} is {why}" for name, why in skipped.items() if why.startswith(_OBJECT)]
    return some_of(found, 1)


def only_objects(path: Path, objects: Mapping[str, str]) -> InputError:
    """The error for a file that holds objects (name -> class) and no plain variables."""
    name, kind = next(iter(objects.items()))
    what = f"one MATLAB {kind or 'object'} ({name})"
    if len(objects) > 1:
        shown = [f"{each} ({kind})" for each, kind in objects.items()]
        what = f"MATLAB objects only: {some_of(shown, 6, counted=False)}"
    return input_error(
        path,
        f"holds {what}, which only MATLAB reads",
        f"run in MATLAB: {export_lines(name, kind, path)}, and convert that file",
    )


__all__ = ["export_lines", "named_objects", "only_objects", "reason"]
