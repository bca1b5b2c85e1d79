"""A bundle's controllers as a model of FMI: the exported C's own, a tick a millisecond."""

from __future__ import annotations

import dataclasses
import html
from collections.abc import Iterator
from importlib import resources

from sysid import __version__
from sysid.controllers.cases import PERIOD_S
from sysid.exporters.c_control import gain_values, gains, inverses
from sysid.exporters.c_header import Header
from sysid.exporters.c_text import number
from sysid.exporters.control_model import ControlModel
from sysid.exporters.flat import Flat
from sysid.exporters.fmu import FmuContent, FmuVariable
from sysid.io.channels import SIDES
from sysid.io.rig import Rig
from sysid.parameters import Bundle

IDENTIFIER = "sysid_controllers"
_CHOICES = "1: PVA (4.2), 2: backstepping (4.3), 3: DVMPC (4.4)"


def controllers_fmu(
    bundle: Bundle, flat: Flat, header: Header, control: ControlModel
) -> FmuContent:
    """The controllers of a C header with the names of no other prefix than the default."""
    rig, p = bundle.rig, control.design.parameters
    assert rig.pwm is not None  # `control` needs it
    values = {
        "period": str(max(round(rig.pwm.period_s / PERIOD_S), 1)),
        "has_motor": str(int(rig.motor is not None)),
        "atmosphere": number(float(p.atmosphere)),
        "payload": number(float(control.design.payload_mass)),
    }
    text = resources.files("sysid.exporters").joinpath("fmu_controllers.h.in").read_text("utf-8")
    for key, value in values.items():
        text = text.replace(f"@{key}@", value)
    title = f"Controllers for {rig.name}"
    return FmuContent(
        identifier=IDENTIFIER,
        title=title,
        sources={"model.h": text, "controllers.h": header.text},
        variables=(
            *_inputs(rig, float(p.atmosphere)),
            *_outputs(rig),
            *_choice(rig),
            *_gains(control, flat),
        ),
        step=PERIOD_S,
        created=bundle.created.replace("+00:00", "Z"),
        tool=f"sysid {__version__}",
        notes=_notes(title),
    )


def _inputs(rig: Rig, atmosphere: float) -> Iterator[FmuVariable]:
    u = rig.units
    yield FmuVariable(
        rig.position_channel, "position", "measured position", "input", u.position, 0.0
    )
    for k, side in enumerate(SIDES):
        yield FmuVariable(
            f"pressure_{side}_pa",
            f"pressure[{k}]",
            f"measured absolute pressure of chamber {side.upper()}",
            "input",
            "Pa",
            atmosphere,
        )
    speed = u.position
    for k, name in enumerate(("position", "velocity", "acceleration", "jerk")):
        unit = speed if k == 0 else f"{speed}/s" if k == 1 else f"{speed}/s{k}"
        said = f"{name} of the wanted motion, reference.lead_s from now"
        yield FmuVariable(f"reference.{name}", f"wanted[{k}]", said, "input", unit, 0.0)


def _outputs(rig: Rig) -> Iterator[FmuVariable]:
    u = rig.units

    def output(name: str, place: str, said: str, unit: str = "", kind: str = "r") -> FmuVariable:
        return FmuVariable(name, place, said, "output", unit, kind=kind, is_held=True)

    yield output(rig.effort_channel, "motor", f"commanded {u.word} of the motor", u.effort)
    for k, side in enumerate(SIDES):
        upper = side.upper()
        yield output(f"duty_{side}", f"duty[{k}]", f"duty of valve {upper}; of DVMPC 0 or 1")
        yield output(f"valve_{side}", f"valve[{k}]", f"valve {upper} on, by DVMPC", kind="b")
    yield output("payload_kg", "payload_kg", "payload, as estimated or declared", "kg")
    yield output("is_good", "is_good", "false: it let go (motor 0, valves off)", kind="b")
    yield output("rejected", "rejected", "ticks at which it let go", kind="i")


def _choice(rig: Rig) -> Iterator[FmuVariable]:
    has_motor = float(rig.motor is not None)

    def fixed(name: str, said: str, start: float, kind: str = "b") -> FmuVariable:
        return FmuVariable(name, name, said, "fixed", start=start, kind=kind)

    yield dataclasses.replace(fixed("controller", _CHOICES, 2.0, "i"), bounds=(1.0, 3.0))
    yield fixed("uses_valves", "the valves are commanded", 1.0)
    yield fixed("uses_motor", "the motor is commanded", has_motor)
    yield fixed("estimates_payload", "backstepping and DVMPC estimate the payload (vertical)", 0.0)
    said = "how long before its time the reference is given, at most 0.128 s"
    yield FmuVariable("reference.lead_s", "lead_s", said, "fixed", "s", 0.0)


def _gains(control: ControlModel, flat: Flat) -> Iterator[FmuVariable]:
    kinds = inverses(flat)
    said = ", ".join(f"{k}: {kind}" for k, kind in enumerate(kinds))
    yield FmuVariable(
        "backstepping.inverse",
        "backstepping.inverse",
        f"which inverse gives the duties; {said}",
        "tunable",
        start=0.0,
        bounds=(0.0, len(kinds) - 1.0),
        kind="i",
    )
    for name, defaults in gains(control.design, flat.rig.motor is not None).items():
        for key, value in gain_values(defaults).items():
            is_real = isinstance(value, float)
            kind = "r" if is_real else "b" if isinstance(value, bool) else "i"
            said = f"{key.replace('_', ' ')} of {name.replace('_', ' ')}"
            yield FmuVariable(
                f"{name}.{key}", f"{name}.{key}", said, "tunable", start=float(value), kind=kind
            )


def _notes(title: str) -> str:
    said = [
        f"{title}: the controllers of the exported C header, which are those of sysid control.",
        "Readings and reference are taken at ticks of 1 ms, with the inputs as they are when a "
        "step begins; the commands hold until the next tick. Let it step before the plant.",
        "Between the given reference and the end of a horizon the jerk is taken for constant; with "
        "reference.lead_s the reference is given so long before its time, and nothing is guessed "
        "within that span.",
        "Where a number is not finite it lets go: motor 0, valves off. OFF IS NOT SAFE EVERYWHERE.",
    ]
    body = "\n".join(f"<p>{html.escape(text)}</p>" for text in said)
    head = f'<!DOCTYPE html>\n<meta charset="utf-8">\n<title>{html.escape(title)}</title>'
    return f"{head}\n{body}\n"


__all__ = ["controllers_fmu"]
