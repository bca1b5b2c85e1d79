"""The functions that a law in C may call: their names in C and in numpy. Imports no sympy."""

from __future__ import annotations

UNARY = {
    "sin": "sin",
    "cos": "cos",
    "tan": "tan",
    "asin": "arcsin",
    "acos": "arccos",
    "atan": "arctan",
    "sinh": "sinh",
    "cosh": "cosh",
    "tanh": "tanh",
    "exp": "exp",
    "expm1": "expm1",
    "log": "log",
    "log1p": "log1p",
    "sqrt": "sqrt",
    "fabs": "absolute",
    "floor": "floor",
    "ceil": "ceil",
    "sign": "sign",
}
BINARY = {"pow": "power", "atan2": "arctan2", "maximum": "maximum", "minimum": "minimum"}
OWN = ("sign", "maximum", "minimum")
"""What the header defines itself, for C's maths library has it not, or otherwise about NaN."""

COMPARISONS = {"less": "<", "less_equal": "<=", "equal": "==", "not_equal": "!="}
LOGIC = {"both": "&&", "either": "||"}
WHERE, NEGATION, IS_FINITE, INTERPOLATE = "where", "negation", "isfinite", "interpolate"
POWERS = {2: "square", 3: "cube"}
"""Whole powers: functions of the header."""
