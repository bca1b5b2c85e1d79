"""The catalogue of effects as pages, one per subsystem, and a picture of each effect.

The pictures are of `sysid effects`: one short test of the reference rig without and with the
effect. Here all effects stand in one model, all but one of them neutral, so that one program is
compiled for all; and they are kept until the model or the effects change.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

from law_text import with_math

from sysid.plant.effects.catalogue import catalogue, catalogue_entry
from sysid.plant.effects.entry import CatalogueEffect

_TITLES = {
    "friction": "Friction",
    "mechanics": "Mechanics",
    "motor": "Motor and drive",
    "chamber": "Chambers",
    "valve": "Valves",
    "supply": "Supply and exhaust",
    "sensor": "Sensors",
}
# Rows of the simulation per point that is drawn.
_EVERY = 4
Effects = list[type[CatalogueEffect]]


def pages(cache: Path) -> dict[str, str | bytes]:
    """Every page and picture by its file's name."""
    known = list(catalogue().values())
    found: dict[str, str | bytes] = {"effects.md": _index(known)}
    for subsystem in _TITLES:
        own = [e for e in known if e.subsystem == subsystem]
        found[f"effects-{subsystem}.md"] = _page(subsystem, own)
    for effect, data in _pictures(known, cache):
        found[f"effect-{effect.id}.png"] = data
    return found


def _index(known: Effects) -> str:
    rows = [
        f"| [{e.id}](#effect-{e.id}) | {e.title} | {_typical(e)} | {e.signature} |" for e in known
    ]
    names = "\n".join(f"effects-{name}" for name in _TITLES)
    return (
        "# Catalogue of effects\n\n"
        f"What the base model may lack: {len(known)} effects. `sysid effects` prints this list, "
        "`sysid effects ID` one entry with its influence on a rig. An effect at strength 0 is the "
        "base model, to the last bit.\n\n"
        f"```{{toctree}}\n{names}\n```\n\n"
        "| id | what | usual size | visible in |\n| --- | --- | --- | --- |\n"
        + "\n".join(rows)
        + "\n"
    )


def _typical(effect: type[CatalogueEffect]) -> str:
    first = effect.strengths()[0]
    return f"{first.typical:.3g} {first.unit}".removesuffix(" -")


def _page(subsystem: str, own: Effects) -> str:
    return f"# {_TITLES[subsystem]}\n\n" + "\n".join(_section(e) for e in own)


def _section(effect: type[CatalogueEffect]) -> str:
    entry = catalogue_entry(effect)
    known = catalogue()
    said = {
        "Visible in": effect.signature,
        "Confused with": ", ".join(_link(r) for r in effect.rivals if r in known),
        "Test that distinguishes": effect.tie_breaker,
        "Ordinary data cannot separate it from": ", ".join(map(_link, entry["ambiguous_with"])),
        "Acts on": "one side, `a` or `b`, or both" if effect.has_side() else "",
        "Source": effect.source,
    }
    lines = [f"**{label}:** {text}  " for label, text in said.items() if text]
    rows = [
        f"| `{q.name}` | {q.unit} | {q.typical:.4g} | {q.lower:.4g} to {q.upper:.4g} | "
        f"{'strength' if q.is_strength else 'shape'} | {q.meaning.replace('|', chr(92) + '|')} |"
        for q in effect.quantities
    ]
    picture = (
        "It acts on flows averaged over a PWM period, so a swing of the arm does not show it."
        if effect.averaged_only
        else f"![{effect.title}: channels without and with it](effect-{effect.id}.png)"
    )
    law = with_math(entry["law"])
    return "\n".join(
        [
            f"(effect-{effect.id})=",
            f"## {effect.title}",
            "",
            f"`{effect.id}`. {law}",
            "",
            *lines,
            "",
            "| parameter | unit | usual | bounds | | meaning |",
            "| --- | --- | --- | --- | --- | --- |",
            *rows,
            "",
            picture,
            "",
        ]
    )


def _link(effect: str) -> str:
    return f"[{effect}](#effect-{effect})"


def _pictures(known: Effects, cache: Path) -> Iterator[tuple[type[CatalogueEffect], bytes]]:
    drawn = [e for e in known if not e.averaged_only]
    folder = cache / _state_of_the_model()
    missing = [e for e in drawn if not (folder / f"{e.id}.png").exists()]
    if missing:
        folder.mkdir(parents=True, exist_ok=True)
        _draw(missing, folder)
    for effect in drawn:
        yield effect, (folder / f"{effect.id}.png").read_bytes()


def _state_of_the_model() -> str:
    import sysid.plant

    digest = hashlib.sha256(Path(__file__).read_bytes())
    for path in sorted(Path(sysid.plant.__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _draw(effects: Effects, folder: Path) -> None:
    from sysid.plant.effects.demonstration import Demonstration, short_test
    from sysid.plant.effects.picture import picture
    from sysid.plant.ports import Model

    on = short_test()

    def model(chosen: type[CatalogueEffect] | None) -> Model:
        all_of_them = tuple(e.typical() if e is chosen else e.neutral() for e in effects)
        return Model(on.model.parameters, all_of_them)

    shown = on.shown([model(None), *(model(effect) for effect in effects)])
    thin = slice(None, None, _EVERY)
    base, *others = ({k: v[thin] for k, v in run.items()} for run in shown)
    for effect, changed in zip(effects, others, strict=True):
        demonstration = Demonstration(on.inputs.time[thin], base, changed, on.channels)
        data = picture(effect, demonstration, ".png")
        (folder / f"{effect.id}.png").write_bytes(data)
