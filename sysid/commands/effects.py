"""`sysid effects`: the catalogue's entries, and what one effect does to a rig.

A user's own effect is a class in a Python file, given with `--effects my_effects.py`::

    from dataclasses import dataclass
    from sysid.model.effects import CatalogueEffect, Quantity

    @dataclass(frozen=True)
    class HoseDrag(CatalogueEffect):
        drag_nm_per_rad: float = 0.0  # the strength: 0 is the base model, to the last bit
        id, title, subsystem = "hose-drag", "Drag of the hoses", "friction"
        quantities = (Quantity("drag_nm_per_rad", "Nm/rad", 0.05, 0.0, 1.0, "per angle"),)
        signature, source = "friction that grows with the angle", "our lab"
        def friction_effort(self, effort, point):
            return effort + self.drag_nm_per_rad * abs(point.position) * point.direction

Its ports (`sysid.model.ports.Effect`) get arrays of numpy and of jax, so they are written
without branches on values; `sysid.model.base.array_namespace` gives the module to call.
"""

from __future__ import annotations

import difflib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.text import Text

from sysid.commands import printing as summary
from sysid.errors import input_error
from sysid.io.files import write_atomic
from sysid.model.effects.catalogue import catalogue, class_of, load_user_effects
from sysid.model.effects.demonstration import CHANNELS, Demonstration, demonstrate, demonstrate_own
from sysid.model.effects.entry import CatalogueEffect
from sysid.types import FloatArray

PICTURES = (".png", ".svg")


_PLOT_WIDTH, _PLOT_ROWS = 64, 4
_BRAILLE = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))  # dots by row and column


# --- entries ---------------------------------------------------------------------------


def known_effects(path: Path | None) -> dict[str, type[CatalogueEffect]]:
    """The catalogue by id, a user's effects (None: no file, else it is run) after it."""
    return catalogue() if path is None else {**catalogue(), **load_user_effects(path)}


def entry(effect: type[CatalogueEffect]) -> dict[str, Any]:
    """An effect's entry as JSON takes it."""
    parameters = [
        {
            "name": q.name,
            "unit": q.unit,
            "typical": q.typical,
            "bounds": [q.lower, q.upper],
            "is_strength": q.is_strength,
            "meaning": q.meaning,
        }
        for q in effect.quantities
    ]
    return {
        "id": effect.id,
        "title": effect.title,
        "subsystem": effect.subsystem,
        "law": _law(effect),
        "parameters": parameters,
        "has_side": effect.has_side(),
        "signature": effect.signature,
        "rivals": list(effect.rivals),
        "tie_breaker": effect.tie_breaker,
        "ambiguous_with": sorted(class_of(effect.id) - {effect.id}),
        "source": effect.source,
    }


def _law(effect: type[CatalogueEffect]) -> str:
    """What the class says of itself; nothing where Python made up its docstring."""
    text = (effect.__doc__ or "").partition("\n\n")[0]
    return "" if text.startswith(f"{effect.__name__}(") else " ".join(text.split())


def find(name: str, effects: Mapping[str, type[CatalogueEffect]]) -> type[CatalogueEffect]:
    """The effect of an id; InputError, with the nearest one, where there is none."""
    if name in effects:
        return effects[name]
    near = difflib.get_close_matches(name, effects, 1)
    hint = f"did you mean {near[0]}?" if near else "`sysid effects` lists them"
    raise input_error(f"effect {name}", "is not in the catalogue", hint)


# --- the command -----------------------------------------------------------------------


def show_effects(
    name: str | None, path: Path | None, as_json: bool, output: Path | None = None
) -> None:
    """`sysid effects`: the list, or one entry with what it changes in a simulation.

    `path` is a user's file of effects, `output` the picture to write.
    """
    if output is not None:
        _check_picture(name, output)
    effects = known_effects(path)
    if name is None:
        _show_list(effects, as_json)
        return
    effect = find(name, effects)
    summary.progress("simulating ")(effect.id)
    is_own = path is not None and effect.id not in catalogue()
    shown = demonstrate_own(effect, path) if is_own and path else demonstrate(effect)
    if output is not None:
        write_atomic(output, picture(effect, shown, output.suffix.lower()))
    if as_json:
        written = {} if output is None else {"written": str(output)}
        summary.print_json(entry(effect) | {"changes": changes(shown)} | written)
        return
    _show_entry(effect, shown, output)


def _check_picture(name: str | None, output: Path) -> None:
    if name is None:
        raise input_error(output, "a picture of which effect?", "give its id")
    if output.suffix.lower() not in PICTURES:
        raise input_error(output, "is no picture's name", f"end it in {' or '.join(PICTURES)}")


def changes(shown: Demonstration) -> dict[str, Any]:
    """What an effect changes in each channel: rms and largest, in the channel's unit."""
    return {
        channel: {
            "rms": float(np.sqrt(np.mean(shown.difference(channel) ** 2))),
            "largest": float(np.abs(shown.difference(channel)).max()),
            "unit": unit,
        }
        for channel, unit in CHANNELS
    }


def _show_list(effects: Mapping[str, type[CatalogueEffect]], as_json: bool) -> None:
    if as_json:
        summary.print_json({"effects": [entry(effect) for effect in effects.values()]})
        return
    table = summary.new_table(
        "Effects that the base model lacks", "id", "what", "parameter", "typical", "shows in"
    )
    for effect in effects.values():
        first = [effect.id, effect.title]
        for q in effect.quantities:
            last = "" if not first[0] else effect.signature
            table.add_row(*map(Text, (*first, q.name, f"{q.typical:.3g} {q.unit}", last)))
            first = ["", ""]
    out = summary.console()
    out.print(table)
    out.print(Text("`sysid effects ID` shows all of an entry, and what it does to a rig"))


def _show_entry(effect: type[CatalogueEffect], shown: Demonstration, output: Path | None) -> None:
    out = summary.console()
    out.print(Text(f"{effect.id}: {effect.title}", style="bold"))
    content = entry(effect)
    lines = {
        "law": content["law"],
        "shows in": effect.signature,
        "confused with": ", ".join(effect.rivals),
        "told apart by": effect.tie_breaker,
        "not separable from": ", ".join(content["ambiguous_with"]),
        "side": "a, b or both" if effect.has_side() else "",
        "source": effect.source,
    }
    for label, text in lines.items():
        if text:
            out.print(Text(f"{label + ':':<20}{text}"))
    table = summary.new_table("Parameters", "name", "unit", "typical", "bounds", "", "meaning")
    for q in effect.quantities:
        kind = "strength" if q.is_strength else "shape"
        bounds = f"{q.lower:.4g} to {q.upper:.4g}"
        table.add_row(*map(Text, (q.name, q.unit, f"{q.typical:.4g}", bounds, kind, q.meaning)))
    out.print(table)
    if output is not None:
        out.print(Text(f"written: {output}"), soft_wrap=True)
        return
    out.print(Text("Change by the effect at typical size, simulated", style="bold"))
    for channel, unit in CHANNELS:
        largest = changes(shown)[channel]["largest"]
        out.print(Text(f"{channel}, at most {largest:.3g} {unit}"))
        if largest > 0.0:
            out.print(Text("\n".join(text_plot(shown.difference(channel)))))
    out.print(Text(f"0 s{shown.time[-1]:>{_PLOT_WIDTH - 5}.3g} s; the zero line is dotted"))


# --- pictures --------------------------------------------------------------------------


def text_plot(values: FloatArray, width: int = _PLOT_WIDTH, rows: int = _PLOT_ROWS) -> list[str]:
    """A curve (n,) in braille, `rows` lines of `width` characters; dots mark its zero line.

    Each column of dots spans the values that fall into it.
    """
    height = 4 * rows
    low, high = min(float(values.min()), 0.0), max(float(values.max()), 0.0)
    span = high - low or 1.0
    cells = np.zeros((rows, width), dtype=int)

    def mark(column: int, value: float, to: float) -> None:
        first, last = sorted(round((high - v) / span * (height - 1)) for v in (value, to))
        for dot in range(first, last + 1):
            cells[dot // 4, column // 2] |= _BRAILLE[dot % 4][column % 2]

    parts = np.array_split(values, min(2 * width, len(values)))
    for column, part in enumerate(parts):
        mark(column, float(part.min()), float(part.max()))
        if column % 4 == 0:
            mark(column, 0.0, 0.0)
    return ["".join(chr(0x2800 + int(cell)) for cell in line) for line in cells]


def picture(effect: type[CatalogueEffect], shown: Demonstration, suffix: str) -> bytes:
    """The channels without and with the effect, and their difference: SVG or PNG by `suffix`."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "sysid", "text.parse_math": False}
    buffer = io.BytesIO()
    with matplotlib.rc_context(style):
        figure = Figure(figsize=(10.0, 6.5), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(len(CHANNELS), 2, sharex=True)
        for row, (channel, unit) in zip(axes, CHANNELS, strict=True):
            row[0].plot(shown.time, shown.base[channel], color="0.6", lw=2.0, label="base model")
            row[0].plot(shown.time, shown.changed[channel], color="C0", lw=1.0, label="with it")
            row[0].set_ylabel(f"{channel}, {unit}" if channel == "theta_rad" else channel)
            row[1].axhline(0.0, color="0.6", lw=0.8)
            row[1].plot(shown.time, shown.difference(channel), color="C3", lw=1.0)
        axes[0, 0].legend()
        axes[0, 1].set_title("change by the effect", fontsize="medium")
        for ax in axes[-1]:
            ax.set_xlabel("time, s")
        sizes = ", ".join(f"{q.name} = {q.typical:.3g}" for q in effect.quantities)
        figure.suptitle(f"{effect.title}: {sizes}", fontsize="medium")
        metadata: Any = {"Date": None} if suffix == ".svg" else None
        figure.savefig(buffer, format=suffix[1:], dpi=120, metadata=metadata)
    return buffer.getvalue()


__all__ = [
    "Demonstration",
    "demonstrate",
    "demonstrate_own",
    "entry",
    "find",
    "known_effects",
    "picture",
    "show_effects",
    "text_plot",
]
