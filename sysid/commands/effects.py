"""`sysid effects`: the catalogue's entries, and what one effect does to a rig."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click

from sysid.blocks.tables import table
from sysid.blocks.text_plot import WIDTH, text_plot
from sysid.commands.options import PathArgument, effects_option, json_option
from sysid.commands.printing import Strong, print_blocks, print_json, progress, written_lines
from sysid.errors import input_error
from sysid.io.files import write_atomic
from sysid.plant.effects.catalogue import catalogue, catalogue_entry, catalogue_with, effect_named
from sysid.plant.effects.demonstration import Demonstration, demonstrate, demonstrate_own
from sysid.plant.effects.entry import Catalogue, CatalogueEffect
from sysid.plant.effects.linear import ROTARY_ONLY, for_rig
from sysid.plant.effects.picture import PICTURES, picture


@click.command()
@click.argument("name", metavar="[ID]", required=False)
@effects_option
@click.option("-o", "output", type=PathArgument, help="Plot of what ID changes, SVG or PNG.")
@click.option("--linear", is_flag=True, help="As a linear axis has them: N, m and kg.")
@json_option
def effects(
    name: str | None, effects: Path | None, output: Path | None, linear: bool, as_json: bool
) -> None:
    """The catalogue of effects; with ID one entry in full, and its influence on a rig."""
    if output is not None:
        _check_picture(name, output)
    known = for_rig(catalogue_with(effects), linear)
    if name is None:
        absent = ROTARY_ONLY if linear else ()
        _show_list({id: effect for id, effect in known.items() if id not in absent}, as_json)
        return
    effect = effect_named(name, known)
    progress("simulating ")(effect.id)
    is_own = effect.id not in catalogue()
    if is_own and effects:
        shown = demonstrate_own(effect, effects, linear=linear)
    else:
        shown = demonstrate(effect, linear=linear)
    if output is not None:
        write_atomic(output, picture(effect, shown, output.suffix.lower()))
    if as_json:
        written = {} if output is None else {"written": str(output)}
        print_json(catalogue_entry(effect) | {"changes": shown.changes()} | written)
        return
    _show_entry(effect, shown, output)


def _check_picture(name: str | None, output: Path) -> None:
    if name is None:
        raise input_error(output, "needs the effect to plot", "give its id")
    if output.suffix.lower() not in PICTURES:
        raise input_error(
            output, "is not the name of a picture file", f"end it in {' or '.join(PICTURES)}"
        )


def _show_list(effects: Catalogue, as_json: bool) -> None:
    if as_json:
        print_json({"effects": [catalogue_entry(effect) for effect in effects.values()]})
        return
    rows = []
    for effect in effects.values():
        first, last = (effect.id, effect.title), effect.signature
        for q in effect.quantities:
            rows.append((*first, q.label, f"{q.typical:.3g} {q.unit}", last))
            first, last = ("", ""), ""
    columns = ("id", "what", "parameter", "typical", "shows in")
    more = "`sysid effects ID` shows an entry in full, and its influence on a rig"
    print_blocks((table("Effects that the base model lacks", columns, rows), more))


def _show_entry(effect: type[CatalogueEffect], shown: Demonstration, output: Path | None) -> None:
    content = catalogue_entry(effect)
    lines = {
        "law": content["law"],
        "shows in": effect.signature,
        "confused with": ", ".join(effect.rivals),
        "distinguished by": effect.tie_breaker,
        "not separable from": ", ".join(content["ambiguous_with"]),
        "side": "a, b or both" if effect.has_side() else "",
        "source": effect.source,
    }
    rows = []
    for q in effect.quantities:
        kind = "strength" if q.is_strength else "shape"
        bounds = f"{q.lower:.4g} to {q.upper:.4g}"
        rows.append((q.label, q.unit, f"{q.typical:.4g}", bounds, kind, q.meaning))
    columns = ("name", "unit", "typical", "bounds", "", "meaning")
    print_blocks(
        (
            Strong(f"{effect.id}: {effect.title}"),
            *(f"{label + ':':<20}{text}" for label, text in lines.items() if text),
            table("Parameters", columns, rows),
            *(_changes(shown) if output is None else written_lines([output])),
        )
    )


def _changes(shown: Demonstration) -> Iterator[str]:
    """Each channel's change as a curve in braille."""
    yield Strong("Change by the effect at typical size, simulated")
    changes = shown.changes()
    for channel, unit in shown.channels:
        largest = changes[channel]["largest"]
        yield f"{channel}, at most {largest:.3g} {unit}"
        if largest > 0.0:
            yield from text_plot(shown.difference(channel))
    yield f"0 s{shown.time[-1]:>{WIDTH - 5}.3g} s; the zero line is dotted"
