"""The controllers' part of the C header: gains, laws printed from Python, loops around them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from importlib import resources
from typing import Any

from sysid.controllers.backstepping import BacksteppingController
from sysid.controllers.cases import PERIOD_S
from sysid.controllers.design_model import DesignModel
from sysid.controllers.dvmpc import DvmpcController
from sysid.controllers.payload import PayloadEstimator
from sysid.controllers.pva import PvaController
from sysid.controllers.sensing import filter_coefficients
from sysid.controllers.task import HORIZON, MOTOR_SHARE
from sysid.exporters.c_printer import all_statements, reduced
from sysid.exporters.c_text import KEPT, Names, comment_text, indented, literal, wrapped
from sysid.exporters.control_function import ControlLaw
from sysid.exporters.control_model import ControlModel
from sysid.exporters.flat import DIRECTIONS, Flat
from sysid.io.channels import SIDES
from sysid.surfaces.kinds import SURFACES

AVERAGED = "averaged"
# Fields of the Python classes that C has as arguments, or not at all.
_NO_GAINS = ("design", "estimator", "is_duty", "preview")
_RENAMED = {"period": "period_s"}
_MEANING = {
    "portion": "the motor's share of the cylinder's effort; 0 without a motor",
    "feedforward": "pneumatic feedforward, 1 or 0",
    "compensation": "the motor's feedback, 1 or 0",
    "horizon": "ticks predicted",
    "hold": "ticks for which a decision holds",
    "period_s": "of a tick, s",
    "natural_frequency": "rad/s",
    "predicts_delays": "inputs act after the valves' delays",
    "trapezoidal": "positions by the mean velocity of a step",
    "filtered_velocity": "predictions start from it, else from raw_velocity",
    "varying": "the input changes once within the horizon",
    "coarse": "ticks of a step after the change",
    "threshold": "Nm",
    "least_angle": "rad",
    "least_speed": "rad/s",
    "forgetting": "per tick",
    "heaviest": "kg",
    "inverse": "which of the inverses below gives the duties",
}


def inverses(flat: Flat) -> list[str]:
    """The inverses that the header can choose from: the averaged law's, then kinds of surface."""
    maps = [flat.valves[side].pwm[direction] for side in SIDES for direction in DIRECTIONS]
    held = [kind for kind in SURFACES if all(part.surfaces[kind] is not None for part in maps)]
    return [AVERAGED, *held]


def _choice(inverse: str) -> str:
    """The macro of an inverse."""
    return f"@P@{SURFACES[inverse].c_name if inverse in SURFACES else inverse}".upper()


def controllers(flat: Flat, model: ControlModel, n: Names) -> str:
    """The whole part, of a model that the bundle gives."""
    fixed = resources.files("sysid.exporters").joinpath("control.h.in").read_text("utf-8")
    pieces = {
        "@structs@": "\n".join(_gains(flat, model, n)),
        "@laws@": "\n".join(function_text(law, n) for law in model.laws),
        "@inverses@": "\n".join(_inverse(flat, side, n) for side in SIDES),
    }
    for mark, text in pieces.items():
        fixed = fixed.replace(mark, text)
    return fixed.replace("@p@", n.lower).replace("@P@", n.upper)


def gains(design: DesignModel, has_motor: bool = True) -> dict[str, Any]:
    """The defaults of every struct of controller gains: instances of the Python classes."""
    backstepping = BacksteppingController(
        design, portion=MOTOR_SHARE if has_motor else 0.0, compensation=has_motor
    )
    return {
        "pva": PvaController(),
        "payload_estimator": PayloadEstimator(),
        "backstepping": backstepping,
        "dvmpc": DvmpcController(design, horizon=HORIZON),
    }


def _gains(flat: Flat, model: ControlModel, n: Names) -> Iterator[str]:
    """Structs with their defaults, the filter and the payload's own inertia."""
    design = model.design
    own = float(design.payload_mass * design.payload_length**2)
    yield (
        "\n/* The payload that the constants contain, at its lever, kg m2. */\n"
        f"static const @p@real @p@payload_inertia_kg_m2 = {literal(own, n)};\n"
    )
    for name, defaults in gains(design, flat.rig.motor is not None).items():
        values = gain_values(defaults)
        if name == "backstepping":
            yield _choices(flat)
            values["inverse"] = f"@P@{AVERAGED.upper()}"
        yield _struct(name, values, n)
    b, a = filter_coefficients(PERIOD_S)
    rows = ", ".join("{" + ", ".join(literal(v, n) for v in row) + "}" for row in (b, a))
    yield (
        "/* 50 Hz, second order, at ticks of 1 ms. */\n"
        f"static const @p@filter @p@filter_defaults = {{{rows}, {literal(PERIOD_S, n)}}};\n"
    )


def gain_values(defaults: Any) -> dict[str, Any]:
    """A controller's gains by their names in C."""
    return {
        _RENAMED.get(f.name, f.name): getattr(defaults, f.name)
        for f in dataclasses.fields(defaults)
        if f.name not in _NO_GAINS
    }


def _choices(flat: Flat) -> str:
    names = ", ".join(map(_choice, inverses(flat)))
    return f"/* Inverses from flow to duty that this header holds. */\nenum {{ {names} }};\n"


def _struct(name: str, values: Mapping[str, Any], n: Names) -> str:
    """A struct of gains and its defaults."""
    fields, texts = [], []
    for key, value in values.items():
        is_real = isinstance(value, float)
        comment = f" /* {_MEANING[key]} */" if key in _MEANING else ""
        fields.append(f"    {'@p@real' if is_real else 'int'} {key};{comment}")
        whole = value if isinstance(value, str) else str(int(value))
        texts.append(literal(value, n) if is_real else whole)
    body, numbers = "\n".join(fields), indented([", ".join(texts)])
    return f"""\
typedef struct {{
{body}
}} @p@{name};

static const @p@{name} @p@{name}_defaults = {{
{numbers}
}};
"""


def function_text(law: ControlLaw, n: Names) -> str:
    """A law as a C function; its results are worked out before the first is set."""
    made = reduced(*law.results.values())
    lines, results = all_statements(made, n)
    read = {name.partition("-")[0] for name in made.names()}
    names = [argument.split()[-1].lstrip("*").partition("[")[0] for argument in law.arguments]
    outs = {target.lstrip("*").partition("[")[0].partition("-")[0] for target in law.results}
    lines += [f"(void){name};" for name in names if name not in read | outs]
    if "return" not in law.results:
        targets = list(law.results)
        lines += [f"const @p@real y{k} = {text};" for k, text in enumerate(results)]
        lines += [f"{target} = y{k};" for k, target in enumerate(targets)]
        lines += ["return 1;"] if law.kind == "int" else []
    else:
        lines.append(f"return {results[0]};")
    arguments = ", ".join(argument.replace(" ", KEPT) for argument in law.arguments)
    head = f"static inline {law.kind} @p@{law.name}({arguments})"
    comment = "\n   ".join(wrapped(f"{law.meaning}.", 92))
    start = "\n    ".join(wrapped(head.replace("@p@", n.lower), 92)).replace(KEPT, " ")
    return f"/* {comment} */\n{start}\n{{\n{indented(lines)}\n}}\n"


def _inverse(flat: Flat, side: str, n: Names) -> str:
    """The duty of one valve by the inverse chosen."""
    lines = []
    for kind in inverses(flat)[1:]:
        suffix = SURFACES[kind].c_suffix
        fill, out = (f"@p@pwm_{side}_{d}{suffix}_duty" for d in DIRECTIONS)
        lines += [
            f"    if (inverse == {_choice(kind)}) {{",
            f"        return flow_kg_s >= 0 ? {fill}(flow_kg_s, pressure_pa, 0)",
            f"                              : {out}(flow_kg_s, pressure_pa, 0);",
            "    }",
        ]
    body = "\n".join([*lines, f"    return @p@averaged_{side}_duty(flow_kg_s, pressure_pa);"])
    unused = "" if lines else "    (void)inverse;\n"
    said = comment_text(f"Duty of valve {side.upper()} for a wanted mean flow, kg/s")
    return f"""
/* {said}. */
static inline @p@real @p@duty_{side}(int inverse, @p@real flow_kg_s, @p@real pressure_pa)
{{
{unused}{body}
}}
"""


__all__ = ["AVERAGED", "controllers", "function_text", "gain_values", "gains", "inverses"]
