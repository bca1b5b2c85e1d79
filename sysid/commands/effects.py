"""`sysid effects`: the catalogue's entries, and what one effect does to a rig."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click

from sysid.blocks.text_plot import WIDTH, text_plot
from sysid.commands.options import PathArgument, effects_option, json_option
from sysid.commands.printing import Strong, print_blocks, print_json, progress, written_lines
from sysid.errors import input_error
from sysid.pipeline.effects import DemonstratedEffect, demonstrated_effect, known_effects


@click.command()
@click.argument("name", metavar="[ID]", required=False)
@effects_option
@click.option("-o", "output", type=PathArgument, help="Plot of what ID changes, SVG or PNG.")
@click.option("--linear", is_flag=True, help="In the units of a linear axis: N, m and kg.")
@json_option
def effects(
    name: str | None, effects: Path | None, output: Path | None, linear: bool, as_json: bool
) -> None:
    """The catalogue of effects; with ID one entry in full, and its influence on a rig."""
    if output is not None:
        _check_picture(name, output)
    if name is None:
        _show_list(effects, linear, as_json)
        return
    shown = demonstrated_effect(name, effects, linear=linear, tell=progress("simulating "))
    if output is not None:
        shown.write(output)
    if as_json:
        written = {} if output is None else {"written": str(output)}
        print_json(shown.to_json() | written)
        return
    _show_entry(shown, output)


def _check_picture(name: str | None, output: Path) -> None:
    if name is None:
        raise input_error(output, "needs the effect to plot", "give its id")
    if output.suffix.lower() not in DemonstratedEffect.pictures:
        ends = " or ".join(DemonstratedEffect.pictures)
        raise input_error(output, "is not the name of a picture file", f"end it in {ends}")


def _show_list(effects: Path | None, linear: bool, as_json: bool) -> None:
    known = known_effects(effects, linear=linear)
    if as_json:
        print_json(known.to_json())
        return
    more = "`sysid effects ID` shows an entry in full, and its influence on a rig"
    print_blocks((known.table(), more))


def _show_entry(shown: DemonstratedEffect, output: Path | None) -> None:
    print_blocks(
        (
            Strong(f"{shown.effect.id}: {shown.effect.title}"),
            *(f"{label + ':':<20}{text}" for label, text in shown.facts().items() if text),
            shown.table(),
            *(_changes(shown) if output is None else written_lines([output])),
        )
    )


def _changes(shown: DemonstratedEffect) -> Iterator[str]:
    """Each channel's change as a curve in braille."""
    yield Strong("Change by the effect at typical size, simulated")
    changes = shown.test.changes()
    for channel, unit in shown.test.channels:
        largest = changes[channel]["largest"]
        yield f"{channel}, at most {largest:.3g} {unit}"
        if largest > 0.0:
            yield from text_plot(shown.test.difference(channel))
    yield f"0 s{shown.test.time[-1]:>{WIDTH - 5}.3g} s; the zero line is dotted"
