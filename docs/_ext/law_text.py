"""The laws of the catalogue, which are text in the code, with their formulas typeset."""

from __future__ import annotations

import re
from itertools import pairwise

# Words with their hyphens, numbers, signs.
_TOKEN = re.compile(r"[A-Za-z][A-Za-z']*(?:_\w+|\d)?(?:-[a-z]+)*|\d+|\S")
_FUNCTIONS = {f: rf"\{f}" for f in ("sin", "cos", "exp", "max")} | {"sign": r"\operatorname{sign}"}
_SYMBOLS = {
    "w": r"\omega", "ws": r"\omega_s", "theta": r"\theta", "tau": r"\tau", "Pa": "P_a", "Pb": "P_b",
    "P0": "P_0", "Pt": "P_t", "Ps": "P_s", "t_cf": "T_{cf}", "A_a": "A_a", "A_b": "A_b",
    "y_a0": "y_{a0}", "y_b0": "y_{b0}", **{v: v for v in "cdknrstuxyABPT"},
}  # fmt: skip
# Quantities that a law has by their names; alone they are words, as an article and a chamber are.
_NAMED = ("gauge", "rest", "phase", "depth", "speed", "torque", "effort", "flow", "zero")
_ARTICLES = ("A", "B", "s")
_SIGNS = "+-*/^|()=<>"


def with_math(law: str) -> str:
    """A law as Markdown, its formulas between dollar signs."""
    runs: list[list[re.Match[str]]] = [[]]
    for token in _TOKEN.finditer(law):
        if _is_math(token[0]) or (token[0] == "," and _is_open(runs[-1])):
            runs[-1].append(token)
        else:
            runs.append([])
    text, ends = "", 0
    for run in runs:
        while run and (run[-1][0] in "+-/(=" or (len(run) == 1 and run[0][0] in _NAMED)):
            run.pop()
        if _is_formula([token[0] for token in run]):
            text += _prose(law[ends : run[0].start()]) + _formula([token[0] for token in run])
            ends = run[-1].end()
    return text + _prose(law[ends:])


def _is_math(token: str) -> bool:
    known = token in _SYMBOLS or token in _FUNCTIONS or token in _NAMED or token in _SIGNS
    return known or token.isdigit()


def _is_open(run: list[re.Match[str]]) -> bool:
    """Whether a bracket is open: a comma is then the formula's."""
    texts = [token[0] for token in run]
    return texts.count("(") > texts.count(")")


def _is_formula(texts: list[str]) -> bool:
    if len(texts) == 1:
        return texts[0] in _SYMBOLS and texts[0] not in _ARTICLES
    return any(t in _SIGNS for t in texts) and any(t in _SYMBOLS for t in texts)


def _formula(texts: list[str]) -> str:
    words = [_FUNCTIONS.get(t) or _SYMBOLS.get(t, t) for t in texts]
    words = [rf"\mathrm{{{t}}}" if t in _NAMED else t for t in words]
    found = words[0]
    for (before, after), word in zip(pairwise(texts), words[1:], strict=True):
        # A name and a function stand off from what they are multiplied by.
        is_wide = {before, after} & {*_NAMED, *_FUNCTIONS}
        found += (r" \, " if is_wide and not {before, after} & set(_SIGNS) else " ") + word
    raised = re.sub(r"\^ (?:\(([^()]*)\)|(\S+))", lambda m: f"^{{{m[1] or m[2]}}}", found)
    return f"${raised}$"


def _prose(text: str) -> str:
    """As Markdown."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")
