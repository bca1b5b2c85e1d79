"""Gains that are searched: what counts as better, what is kept, the file that is read again."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

import sysid as si
from sysid.commands.app import main
from sysid.controllers.gains import GAINS, gains_of, read_gains
from sysid.controllers.modes import Mode
from sysid.controllers.pva import PvaController
from sysid.controllers.task import Choice, prepared
from sysid.controllers.tuner import Bench, score, search
from sysid.controllers.tuning import Tuning
from sysid.errors import InputError
from sysid.io.bundled import REFERENCE_BUNDLE, thesis_folder
from sysid.pipeline.tune import tune
from sysid.types import FloatArray


@pytest.fixture(scope="module")
def bundle() -> si.Bundle:
    return si.read_bundle(thesis_folder() / REFERENCE_BUNDLE)


BEST = {"k1": 90.0, "k2": 12.0, "k3": 65.0, "motor_p": 40.0, "motor_d": 9.0}


def stand(self: Bench, candidates: Sequence[Mapping[str, float]]) -> FloatArray:
    """A bowl about `BEST` in the place of closed loops, of two motions; k1 above 200 is lost."""
    rows = []
    for values in candidates:
        off = sum(np.log(value / BEST.get(name, value)) ** 2 for name, value in values.items())
        error = np.inf if values.get("k1", 0.0) > 200.0 else 1e-3 * (1.0 + off)
        rows.append([error, 2.0 * error])
    return np.array(rows)


def test_a_search_finds_the_best_gains(bundle: si.Bundle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Bench, "rmse", stand)
    task = prepared(Choice("backstepping", 3, Mode.HYBRID), bundle)
    gains = gains_of("backstepping", Mode.HYBRID)
    case = task.case(task.make())
    bench = Bench(((case,), (case,)), gains, 1.0, 1.7)
    assert bench.start["motor_p"] == 85.0 and set(bench.start) == set(BEST)
    found = search(bench, 40, 1)
    assert found == search(bench, 40, 1)
    for name, value in BEST.items():
        assert found[name] == pytest.approx(value, rel=0.1)


def test_what_harms_one_motion_is_no_improvement() -> None:
    start = np.array([1e-3, 1e-3])
    rows = np.array([[1e-3, 1e-3], [0.6e-3, 1.4e-3], [0.9e-3, 0.9e-3], [0.1e-3, np.inf]])
    scores = score(rows, start)
    assert scores[0] == 0.0
    assert scores[2] < 0.0 < scores[1] < scores[3]
    assert score(np.array([[0.05, 1e-3]]), np.array([np.inf, 1e-3]))[0] < 0.0


def test_printed_gains_stay_where_the_search_finds_none(
    bundle: si.Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where what judges differs from what was searched on, and where nothing is better."""

    def worse(self: Bench, candidates: Sequence[Mapping[str, float]]) -> FloatArray:
        judges = self.duration > 5.0
        found = [[(-1 if judges else 1) * np.log(c["position_gain"] / 140.0)] for c in candidates]
        return 1e-3 * np.exp(-np.array(found))

    monkeypatch.setattr(Bench, "rmse", worse)
    found = tune(bundle, "pva", mode="pneumatic", trajectories=(3,), generations=2)
    assert found.kept and found.gains.values["position_gain"] == 140.0
    assert "no better gains" in found.headline()


def test_pva_is_tuned_and_its_gains_are_read_again(
    bundle: si.Bundle, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Half a second of trajectory 3: the gains that are written are those of the runs."""
    found = tune(bundle, "pva", mode="pneumatic", trajectories=(3,), generations=2, duration_s=0.5)
    (motion,) = found.motions
    assert not found.kept and motion.improved
    (path,) = found.write(tmp_path)
    again = read_gains(path)
    assert again == found.gains
    made = again.applied(PvaController())
    assert isinstance(made, PvaController)
    assert made.velocity_gain == found.gains.values["velocity_gain"] != 45.0
    words = f"control {bundle.source} --controller backstepping --trajectory 3 --mode hybrid"
    assert main([*words.split(), "--gains", str(path)]) == 2
    assert "not of backstepping" in capsys.readouterr().err
    choice = Choice("pva", 3, Mode.PNEUMATIC, gains=again)
    assert prepared(choice, bundle).make() == made and choice.words == ("tuned gains",)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"schema": "other"}, "sysid-gains/1"),
        ({"controller": "mine"}, "has no gains"),
        ({"mode": "sleep"}, "mode"),
        ({"gains": {"k9": 1.0}}, "gains.k9"),
        ({"gains": {"k1": -1.0}}, "gains.k1"),
        ({"gains": {"k1": True}}, "gains.k1"),
        ({"gains": {}}, "is missing"),
        ({"controller": "dvmpc", "gains": {"horizon": 30.5}}, "count of ticks"),
    ],
)
def test_what_is_no_gains_file_is_refused(
    tmp_path: Path, change: dict[str, object], said: str
) -> None:
    content = {"schema": "sysid-gains/1", "controller": "backstepping", "mode": "hybrid"}
    path = tmp_path / "gains.json"
    path.write_text(json.dumps(content | {"gains": {"k1": 50.0}} | change), encoding="utf-8")
    with pytest.raises(InputError, match=said):
        read_gains(path)


def test_options_of_a_search_and_of_a_run(capsys: pytest.CaptureFixture[str]) -> None:
    words = f"control {thesis_folder() / REFERENCE_BUNDLE} --controller backstepping --mode hybrid"
    assert main([*words.split(), "--tune", "--stability"]) == 2
    assert "--stability does not go with --tune" in capsys.readouterr().err
    assert main(["control", "--table", "4.5.1", "--tune"]) == 2
    assert "--tune does not go with --table" in capsys.readouterr().err


def test_every_gain_is_a_number_of_its_controller(bundle: si.Bundle) -> None:
    for name, gains in GAINS.items():
        task = prepared(Choice(name, 3, Mode.PNEUMATIC, tuning=Tuning()), bundle)
        fields = {f.name for f in dataclasses.fields(task.make())}  # type: ignore[arg-type]
        assert {field for gain in gains for field in gain.fields} <= fields
