"""The content of a diagnosis as its report needs it: plain numbers and text, as in JSON.

A later process draws the same section from `diagnosis.json`, without diagnosing again.
"""

from __future__ import annotations

from typing import Any

from sysid.diagnosis.result import Diagnosis


def content(diagnosis: Diagnosis) -> dict[str, Any]:
    """The output of `sysid diagnose --json` (spec/cli.md), and the data drawn under `figures`."""
    return {**diagnosis.to_json(), "figures": figures(diagnosis)}


def figures(diagnosis: Diagnosis) -> dict[str, Any]:
    """The numbers behind the report's figures, a JSON-able dict.

    `looks`: what each round tried (`ComponentEvidence.rounds_shown`). `curves`: mean residual over
    a regressor before and after the effects. `titles` and `meanings` name effects and their
    parameters. Further keys are the evidence's own.
    """
    return {
        "looks": diagnosis.evidence.rounds_shown(),
        **diagnosis.evidence.figures(),
        "titles": {found.id: type(found.effect).title for found in diagnosis.effects},
        "meanings": {
            found.id: {q.label: q.meaning for q in type(found.effect).quantities}
            for found in diagnosis.effects
        },
    }


__all__ = ["content", "figures"]
