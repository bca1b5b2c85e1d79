"""The folder next to an exported header that replays Python's numbers through it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from importlib import resources
from pathlib import Path

from sysid.exporters.base_laws import law_replays
from sysid.exporters.c_constants import parameter_values
from sysid.exporters.c_header import Header
from sysid.exporters.c_surfaces import surface_functions
from sysid.exporters.c_text import Names, names, number
from sysid.exporters.flat import Flat
from sysid.exporters.replay import Replay
from sysid.exporters.replays import HELPERS, control_replays
from sysid.exporters.vectors import Vectors, vectors
from sysid.io.files import make_folder, write_atomic
from sysid.io.locks import working_in
from sysid.plant.base import Parameters

CHECK_FILES = ("check.c", "vectors.h", "CMakeLists.txt")
ROWS = 24
_SEED = 20


def check_texts(
    flat: Flat, made: Header, prefix: str, header: str, rows: int = ROWS, seed: int = _SEED
) -> dict[str, str]:
    """The text of each of CHECK_FILES; `header` is how check.c includes the header.

    `rows` a function, drawn with `seed`. Empty where the header holds no function to check.
    """
    found = checked_rows(flat, made, rows, seed)
    if not found:
        return {}
    return {
        "check.c": _check(found, header, names(prefix), made.control is not None),
        "vectors.h": _numbers(found),
        "CMakeLists.txt": _template("check.cmake.in", {"name": _project(header)}),
    }


def checked_rows(flat: Flat, made: Header, rows: int = ROWS, seed: int = _SEED) -> list[Vectors]:
    """The rows of every function of a header, in check.c's order."""
    parameters = Parameters(**parameter_values(flat, made.constants))
    replays = list(law_replays(flat, made.constants, made.features))
    replays += [function.replay() for function in surface_functions(flat)]
    if made.control is not None:
        replays += control_replays(flat, made.control.design)
    if made.control is not None and made.has_monitor:
        from sysid.exporters.c_monitor import MONITOR_FUNCTIONS

        replays += [function.replay(made.control.design) for function in MONITOR_FUNCTIONS]
    return [vectors(replay, parameters, rows, seed) for replay in replays]


def write_check(folder: Path, texts: dict[str, str]) -> None:
    """Write the files of a header's check. Raises InputError where that is not possible."""
    if not texts:
        return
    make_folder(folder, parents=False)
    with working_in(folder):
        for name, text in texts.items():
            write_atomic(folder / name, text)


def _template(name: str, values: dict[str, str]) -> str:
    text = resources.files("sysid.exporters").joinpath(name).read_text("utf-8")
    for key, value in values.items():
        text = text.replace(f"@{key}@", value)
    return text


def _project(header: str) -> str:
    return re.sub(r"\W", "_", Path(header).stem) + "_check"


def _check(found: Sequence[Vectors], header: str, n: Names, has_controllers: bool) -> str:
    entries, outputs = [], [v.outputs.shape[1] for v in found]
    for v, count in zip(found, outputs, strict=True):
        name = v.replay.name
        entries.append(
            f'    {{"{name}", (int)(sizeof vectors_{name} / sizeof *vectors_{name}),\n'
            f"     {len(v.replay.inputs)}, {count}, vectors_{name}[0], scale_{name},\n"
            f"     replay_{name}}}"
        )
    table = ",\n".join(entries)
    values = {
        "header": header,
        "helpers": HELPERS if has_controllers else "",
        "replays": "\n".join(_function(v.replay) for v in found),
        "table": f"static const @p@vectors @p@all[@count@] = {{\n{table}\n}};\n",
        "count": str(len(found)),
        "most": str(max(outputs)),
        "p": n.lower,
    }
    return _template("check.c.in", values)


def _function(replay: Replay) -> str:
    return f"""\
static void replay_{replay.name}(const double *v, double *out)
{{
    {replay.call}
}}
"""


def _numbers(found: Iterable[Vectors]) -> str:
    parts = [
        "/* Bounds of double and single precision, inputs, outputs; written by sysid export. */"
    ]
    for v in found:
        width = 2 + v.inputs.shape[1] + v.outputs.shape[1]
        rows = ",\n".join(
            "    {" + ", ".join(_number(x) for x in (*b, *i, *o)) + "}"
            for b, i, o in zip(v.bounds, v.inputs, v.outputs, strict=True)
        )
        name = v.replay.name
        scale = ", ".join(map(_number, v.scale))
        parts.append(f"static const double vectors_{name}[][{width}] = {{\n{rows}\n}};")
        parts.append(f"static const double scale_{name}[] = {{{scale}}};\n")
    return "\n".join(parts)


def _number(value: float) -> str:
    """A number as C reads it back to the last bit."""
    if value != value:
        return "NAN"
    if value in (float("inf"), float("-inf")):
        return "HUGE_VAL" if value > 0 else "-HUGE_VAL"
    return number(value)


__all__ = ["CHECK_FILES", "ROWS", "check_texts", "checked_rows", "write_check"]
