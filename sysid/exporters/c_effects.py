"""The laws of a bundle's effects in C: constants, and a function for each port where they act.

The laws are those of the effects' own classes, evaluated on names (`effect_laws`). The
effects of one port act in the bundle's order, as in the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.exporters.c_constants import header_constants
from sysid.exporters.c_ports import ARGUMENTS, DIRECTION, Port, ports
from sysid.exporters.c_text import (
    Names,
    comment_text,
    constant,
    has,
    indented,
    real,
    wrapped,
)
from sysid.exporters.flat import ExportedEffect, Flat, NumberTable
from sysid.plant.effects.entry import CatalogueEffect

if TYPE_CHECKING:  # sympy is loaded only for a bundle that has effects
    from sysid.exporters.effect_laws import EffectLaw, Laws


class EffectsInC:
    """The effects' part of the header.

    `effects` are those of the bundle in its order, None for an entry that is no effect.
    """

    def __init__(self, flat: Flat, effects: Sequence[CatalogueEffect | None], n: Names) -> None:
        self._flat, self._n = flat, n
        self._laws: Laws | None = None
        if flat.effects:
            from sysid.exporters.effect_laws import effect_laws

            self._laws = effect_laws(flat, effects, n)

    @property
    def constants(self) -> NumberTable:
        """The header's constants, with the effects that change them."""
        return header_constants(self._flat) if self._laws is None else self._laws.constants

    def changes(self, name: str) -> str:
        """The ids of the effects in a constant; empty for none."""
        places = self._laws.changed_by.get(name, ()) if self._laws else ()
        return ", ".join(self._flat.effects[place].id for place in places)

    def contained(self) -> tuple[ExportedEffect, ...]:
        """The effects whose laws the header holds, in the bundle's order."""
        return tuple(effect for k, effect in self._numbered() if k not in self._reasons())

    def contained_places(self) -> frozenset[int]:
        """The places, from 0, of the effects that the header holds, and their constants with."""
        return frozenset(k for k, _ in self._numbered() if k not in self._reasons())

    def not_contained(self) -> tuple[tuple[ExportedEffect, str], ...]:
        """The effects whose laws the header does not hold, and why."""
        reasons = self._reasons()
        return tuple((effect, reasons[k]) for k, effect in self._numbered() if k in reasons)

    def features(self) -> list[str]:
        """One macro per port, 1 if an effect acts there and its function exists, and counts."""
        upper = self._n.upper
        lines = [has(f"{upper}{port.feature}", bool(self._stages(port))) for port in ports()]
        drifts = bool(self._laws and self._laws.drifts)
        lines.append(has(f"{upper}EFFECTS_ACT_ON_CONSTANTS_OVER_TIME", drifts))
        lines.append(f"#define {upper}EFFECTS_CONTAINED {len(self.contained())}")
        lines.append(f"#define {upper}EFFECTS_NOT_CONTAINED {len(self.not_contained())}")
        return lines

    def text(self) -> str:
        """The parameters of the contained effects and a function for each port where they act."""
        if self._laws is None or not self.contained():
            return ""
        parts = ["/* --- effects that the laws above do not include --- */\n"]
        reasons = self._reasons()
        parts += [self._own(k, effect) for k, effect in self._numbered() if k not in reasons]
        parts += [self._drift(name) for name in self._laws.drifts]
        parts += [self._function(port, found) for port in ports() if (found := self._stages(port))]
        return "\n".join(parts)

    def _numbered(self) -> list[tuple[int, ExportedEffect]]:
        return list(enumerate(self._flat.effects))

    def _reasons(self) -> dict[int, str]:
        return dict(self._laws.reasons) if self._laws else {}

    def _stages(self, port: Port) -> tuple[EffectLaw, ...]:
        return self._laws.stages.get(port.name, ()) if self._laws else ()

    def _own(self, place: int, effect: ExportedEffect) -> str:
        """An effect's own parameters as constants."""
        from sysid.exporters.effect_laws import constant_name

        side = effect.values.get("side")
        words = effect.id if side is None else f"{effect.id}, side {side}"
        lines = [f"/* {comment_text(words)} */"]
        for label, value in effect.values.items():
            if isinstance(value, float):
                name = constant_name(place, label, self._n)
                lines.append(constant(name, value, effect.units[label], self._n))
        return "\n".join(lines) + "\n"

    def _drift(self, name: str) -> str:
        """A constant that effects let change over a test."""
        from sysid.exporters.c_printer import statements

        assert self._laws is not None  # called for what it holds
        lines, result = statements(self._laws.drifts[name], self._n)
        r, whole = real(self._n), f"{self._n.lower}{name}"
        body = indented([*lines, f"return {result};"])
        return f"""\
/* {comment_text(f"{name} at a time, s, since the start of the test")}. */
static inline {r} {whole}_with_effects({r} time_s)
{{
{body}
}}
"""

    def _function(self, port: Port, stages: Sequence[EffectLaw]) -> str:
        from sysid.exporters.effect_laws import VALUE, arguments_of

        r = real(self._n)
        arguments = arguments_of(port, stages)
        read = {name for stage in stages for name in stage.law.names()}
        lines = [f"{r} {VALUE} = {arguments[0]};"]
        if DIRECTION in read:
            lines.append(f"const {r} {DIRECTION} = {self._n.lower}sign(velocity);")
            read.add("velocity")
        lines += [f"(void){name};" for name in arguments[1:] if name not in read]
        for stage in stages:
            lines += self._sensor(stage) if stage.is_sensor else self._step(stage)
        body = indented([*lines, f"return {VALUE};"])
        inputs = ", ".join(f"{r} {name}" for name in arguments)
        name = f"{self._n.lower}{port.name}_with_effects"
        head = "\n    ".join(wrapped(f"static inline {r} {name}({inputs})"))
        ids = [self._flat.effects[stage.place].id for stage in stages]
        said = [f"{port.meaning}.", *_meanings(port, arguments)]
        said += ["Effects: " + ", ".join(dict.fromkeys(ids)) + "."]
        comment = "\n   ".join(comment_text(part) for text in said for part in wrapped(text))
        return f"""\
/* {comment} */
{head}
{{
{body}
}}
"""

    def _step(self, stage: EffectLaw) -> list[str]:
        from sysid.exporters.c_printer import statements

        lines, result = statements(stage.law, self._n)
        last = f"value = {result};"
        return ["{", *(f"    {line}" for line in (*lines, last)), "}"] if lines else [last]

    def _sensor(self, stage: EffectLaw) -> list[str]:
        """The value that a sensor shows so, in steps of what is missing to what it shows."""
        from sysid.exporters.c_printer import statements

        lines, result = statements(stage.law, self._n)
        # The steps in which a sensor that is not linear is solved: what it adds shrinks each time.
        return [
            "{",
            f"    const {real(self._n)} shown = value;",
            "    int k;",
            "    for (k = 0; k < 30; k++) {",
            *(f"        {line}" for line in lines),
            f"        const {real(self._n)} missing = shown - ({result});",
            "        if (value + missing == value) {",
            "            break;",
            "        }",
            "        value += missing;",
            "    }",
            "}",
        ]


def _meanings(port: Port, arguments: Sequence[str]) -> list[str]:
    """The meaning of the arguments that the function has in addition to its own."""
    return [f"{name}: {ARGUMENTS[name]};" for name in arguments if name not in port.arguments]


__all__ = ["EffectsInC"]
