"""The catalogue of effects, and what one of them does to a rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from sysid.blocks.tables import Table, table
from sysid.io.files import write_atomic
from sysid.plant.effects.catalogue import catalogue, catalogue_entry, catalogue_with, effect_named
from sysid.plant.effects.demonstration import Demonstration, demonstrate, demonstrate_own
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.linear import ROTARY_ONLY, for_rig
from sysid.plant.effects.picture import PICTURES, picture
from sysid.types import Progress


@dataclass(frozen=True)
class KnownEffects:
    """The effects that the base model lacks, as a rotary or a linear rig has them."""

    effects: Sequence[type[CatalogueEffect]]

    def to_json(self) -> dict[str, Any]:
        """The output of `sysid effects --json`."""
        return {"effects": [catalogue_entry(effect) for effect in self.effects]}

    def table(self) -> Table:
        """One row per parameter."""
        rows = []
        for effect in self.effects:
            first, last = (effect.id, effect.title), effect.signature
            for q in effect.quantities:
                rows.append((*first, q.label, f"{q.typical:.3g} {q.unit}", last))
                first, last = ("", ""), ""
        columns = ("id", "what", "parameter", "typical", "shows in")
        return table("Effects that the base model lacks", columns, rows)


@dataclass(frozen=True)
class DemonstratedEffect:
    """An entry of the catalogue, and a short test simulated without the effect and with it."""

    effect: type[CatalogueEffect]
    test: Demonstration

    pictures: ClassVar[Sequence[str]] = PICTURES
    """Suffixes of the files that `write` can write."""

    def to_json(self) -> dict[str, Any]:
        """The output of `sysid effects ID --json`."""
        return catalogue_entry(self.effect) | {"changes": self.test.changes()}

    def facts(self) -> dict[str, str]:
        """What the entry says, by label; empty texts where it says nothing."""
        effect, content = self.effect, catalogue_entry(self.effect)
        return {
            "law": content["law"],
            "shows in": effect.signature,
            "confused with": ", ".join(effect.rivals),
            "distinguished by": effect.tie_breaker,
            "not separable from": ", ".join(content["ambiguous_with"]),
            "side": "a, b or both" if effect.has_side() else "",
            "source": effect.source,
        }

    def table(self) -> Table:
        """One row per parameter."""
        rows = []
        for q in self.effect.quantities:
            kind = "strength" if q.is_strength else "shape"
            bounds = f"{q.lower:.4g} to {q.upper:.4g}"
            rows.append((q.label, q.unit, f"{q.typical:.4g}", bounds, kind, q.meaning))
        return table("Parameters", ("name", "unit", "typical", "bounds", "", "meaning"), rows)

    def write(self, path: Path) -> None:
        """Plot what the effect changes. Raises InputError where the file cannot be written."""
        write_atomic(path, picture(self.effect, self.test, path.suffix.lower()))


def known_effects(file: Path | None, *, linear: bool) -> KnownEffects:
    """The catalogue and the effects of a Python `file`, which is executed.

    Raises InputError for a file that cannot be used.
    """
    known = for_rig(catalogue_with(file), linear)
    absent = ROTARY_ONLY if linear else ()
    return KnownEffects([effect for id, effect in known.items() if id not in absent])


def demonstrated_effect(
    name: str, file: Path | None, *, linear: bool, tell: Progress
) -> DemonstratedEffect:
    """The effect of this name simulated at its typical size; errors as `known_effects`."""
    effect = effect_named(name, for_rig(catalogue_with(file), linear))
    tell(effect.id)
    if file is not None and effect.id not in catalogue():
        return DemonstratedEffect(effect, demonstrate_own(effect, file, linear=linear))
    return DemonstratedEffect(effect, demonstrate(effect, linear=linear))


__all__ = ["DemonstratedEffect", "KnownEffects", "demonstrated_effect", "known_effects"]
