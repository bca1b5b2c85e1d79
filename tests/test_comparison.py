"""The comparison of estimators goes on where one of them is stopped."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import pytest

from benchmarks import refinement_comparison as comparison
from benchmarks.refinement_comparison import Contender, Used, compare
from sysid.plant.base import PARAMETER_NAMES, Parameters

PARAMETERS = Parameters(**dict.fromkeys(PARAMETER_NAMES, 1.0))


@pytest.mark.parametrize(("stopped", "turn"), [("scipy", 0), ("scipy", 2), ("sysid", 1)])
def test_a_contender_that_is_stopped_in_any_turn_leaves(
    stopped: str, turn: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    turns = {"sysid": -1, "scipy": -1}

    def run(one: Contender, *_: Any) -> tuple[Used, list[float]]:
        turns[one.name] += 1
        if (one.name, turns[one.name]) == (stopped, turn):
            return Used(math.inf, 9.0), []
        return Used(2.0, 1.0), [5.0, *([0.0] * len(comparison.NUMBERS))]

    field = [Contender(name, ()) for name in turns]
    monkeypatch.setattr(comparison, "run", run)
    monkeypatch.setattr(comparison, "contenders", lambda *_: field)
    monkeypatch.setattr(comparison, "make_job", lambda *_: (Path("job"), PARAMETERS, PARAMETERS))
    compare(1, 3, 1.0, 1, argparse.Namespace(python="", only=None))
    out = capsys.readouterr().out
    assert f"{stopped}: stopped in turn {turn} after 9 s" in out
    other = "scipy" if stopped == "sysid" else "sysid"
    assert f"{other}: median 2.00 s" in out
    assert turns[other] == 3 and turns[stopped] == turn
