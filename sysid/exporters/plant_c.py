"""The plant as a header of C99: parameters, the traced equations, and what integrates them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources

from sysid.exporters.c_maths import mathematics
from sysid.exporters.c_text import LARGEST, comment_text, indented, number
from sysid.exporters.plant_laws import KEPT, NAMES, TracedPlant
from sysid.plant import supply_approach
from sysid.plant.base import MAX_STEP
from sysid.plant.valve_timing import TIME_TOLERANCE, WHOLE_STEP

_TYPES = """\
/* Where the plant is, and what it is told; open_a, open_b 1 or 0; direction -1, 0 at rest, or 1. */
typedef struct {
    plant_real time, position, velocity, pressure_a, pressure_b;
    plant_real motor, open_a, open_b, direction, extra[@extras@];
} plant_point;

/* A chamber's choked boundary and the flows above and below it, kg/s; dP/dt, Pa/s, on the side on
   which the pressure is; m3, k R T / V in Pa/kg; flow over the root of the gap to `line`, the
   pressure that the chamber is open to, Pa, and whether the flow ends by a root there. */
typedef struct {
    plant_real boundary, fixed, flow_above, flow_below, rate, volume, per_flow, root, line, nears;
} plant_chamber_laws;

typedef struct {
    plant_real applied, breakaway, acceleration, flow[2], pressure_rate[2], extra_rate[@extras@];
} plant_rates;

typedef struct {
    plant_real cylinder, motor, gravity, sliding;
} plant_efforts;

/* A valve's last on-intervals as commanded, newest first, and when it really opens and closes. One
   that lasts ends at PLANT_NEVER, one that is none is at -PLANT_NEVER; until: when the next may
   start. */
#define PLANT_NEVER @never@
#define PLANT_KEPT @kept@
typedef struct {
    plant_real on[PLANT_KEPT], off[PLANT_KEPT], opens[PLANT_KEPT], closes[PLANT_KEPT], until;
} plant_valve;
"""


def plant_header(traced: TracedPlant, title: Sequence[str]) -> str:
    """The header's text; `title` are the lines of its opening comment."""
    extras: dict[str, object] = {
        "states": len(traced.states),
        "extras": max(len(traced.states), 1),
        "never": number(LARGEST),
        "kept": KEPT,
    }
    body = "\n".join(f" * {comment_text(line)}".rstrip() for line in title)
    parts = [
        f"/*\n{body}\n */",
        "#ifndef SYSID_PLANT_H\n#define SYSID_PLANT_H\n\n#include <math.h>\n",
        mathematics(NAMES),
        _parameters(traced),
        _filled(_TYPES, extras),
        traced.functions,
        _filled(_template("plant.h.in"), extras | _method(traced)),
        "#endif /* SYSID_PLANT_H */\n",
    ]
    return "\n".join(parts)


def _parameters(traced: TracedPlant) -> str:
    """The struct of parameters, the bundle's own, and whether all are numbers."""
    names = [one.name for one in traced.numbers]
    tests = " && ".join(f"isfinite(q->{name})" for name in names)
    values = ", ".join(number(one.value) for one in traced.numbers)
    return f"""\
/* The model's numbers, SI; effort in Nm or N, position in rad or m. */
typedef struct {{
    plant_real {", ".join(names[:1])};
{indented([f"plant_real {name};" for name in names[1:]])}
}} plant_parameters;

static const plant_parameters plant_parameters_default = {{
{indented([values])}
}};

static inline int plant_parameters_are_finite(const plant_parameters *q)
{{
{indented([f"return {tests};"])}
}}
"""


def _method(traced: TracedPlant) -> dict[str, object]:
    a = supply_approach
    return {
        "max_step": number(MAX_STEP),
        "together": number(TIME_TOLERANCE),
        "whole": number(WHOLE_STEP),
        "memory": max(traced.memory, 1),
        "remembers": int(traced.memory > 0),
        "drifts": int(traced.drifts),
        "own_payload": number(traced.own_payload_kg),
        "gamma": number(a.GAMMA),
        "second": number(a.SECOND),
        "third_0": number(a.THIRD[0]),
        "third_1": number(a.THIRD[1]),
    }


def _template(name: str) -> str:
    return resources.files("sysid.exporters").joinpath(name).read_text("utf-8")


def _filled(text: str, values: Mapping[str, object]) -> str:
    for key, value in values.items():
        text = text.replace(f"@{key}@", str(value))
    return text


__all__ = ["plant_header"]
