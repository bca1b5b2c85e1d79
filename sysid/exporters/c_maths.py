"""The header's real type and its mathematics: what every other part of the header calls."""

from __future__ import annotations

from sysid.exporters.c_guard import guarded
from sysid.exporters.c_text import Names, real
from sysid.exporters.symbolic_names import BINARY, OWN, UNARY


def mathematics(n: Names) -> str:
    """The real type, and the functions of it under the header's prefix."""
    r, p = real(n), n.lower
    parts = [
        f"""\
/* --- real numbers: double, or what SYSID_REAL says (-DSYSID_REAL=float) --- */

#ifndef SYSID_REAL
#define SYSID_REAL double
#endif
typedef SYSID_REAL {r};

/* A result where it is finite, else NaN; of a duty, else 0. */
static inline {r} {p}known({r} x)
{{
    return isfinite(x) ? x : ({r})NAN;
}}
static inline {r} {p}known_duty({r} x)
{{
    return isfinite(x) ? x : 0;
}}

/* The functions of the maths library, those of float where that is the real type; NaN of an
   argument that is not finite. */""",
        *(_call(name, ("x",), n) for name in UNARY if name not in OWN),
        *(_call(name, ("x", "y"), n) for name in BINARY if name not in OWN),
        f"""
/* -1, 0 or 1; whole powers; the larger and the smaller of two. */
static inline {r} {p}sign({r} x)
{{
    return x > 0 ? 1 : x < 0 ? -1 : x;
}}
static inline {r} {p}square({r} x)
{{
    return x * x;
}}
static inline {r} {p}cube({r} x)
{{
    return x * x * x;
}}
static inline {r} {p}maximum({r} x, {r} y)
{{
    return x > y ? x : y;
}}
static inline {r} {p}minimum({r} x, {r} y)
{{
    return x < y ? x : y;
}}
""",
    ]
    return guarded("\n".join(parts), n, results=False)


def _call(name: str, arguments: tuple[str, ...], n: Names) -> str:
    r = real(n)
    inputs = ", ".join(f"{r} {argument}" for argument in arguments)
    single, double = (
        f"({r}){name}{suffix}({', '.join(f'({kind}){a}' for a in arguments)})"
        for suffix, kind in (("f", "float"), ("", "double"))
    )
    return f"""\
static inline {r} {n.lower}{name}({inputs})
{{
    return sizeof x == sizeof(float) ? {single} : {double};
}}"""
