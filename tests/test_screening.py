"""Screening: an effect's own signature in a residual gives its strengths back."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sysid.diagnosis.actuator import screened as screened_module
from sysid.diagnosis.actuator.equation_error import CHANNELS
from sysid.diagnosis.actuator.misfit import ResidualChannel
from sysid.diagnosis.actuator.projection import Projected
from sysid.diagnosis.actuator.screened import screened
from sysid.diagnosis.actuator.signatures import Candidate, candidates
from sysid.diagnosis.search_record import Recorder
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.friction import QuadraticDrag, SealFriction
from sysid.types import FloatArray

ROWS = 400
KINDS = [kind for kind in catalogue().values() if not kind.averaged_only]
# So little noise, and so many draws of a misfit, that what is left alone counts.
EXACT = tuple(ResidualChannel(ROWS // len(CHANNELS), 1e30, 1e-12, 0.0) for _ in CHANNELS)


def rows(name: str) -> slice:
    each = ROWS // len(CHANNELS)
    place = CHANNELS.index(name)
    return slice(place * each, (place + 1) * each)


def residual(rest: FloatArray, basis: FloatArray | None = None) -> Projected:
    nothing = np.zeros((ROWS, 0))
    missing: Any = None
    bare = SimpleNamespace(residual=lambda _: rest)
    frame: Any = SimpleNamespace(rows=rows, bare=bare, scattered=lambda values: values)
    basis = nothing if basis is None else basis
    return Projected(frame, missing, rest, basis, rest, nothing, np.zeros(0))


def given(monkeypatch: pytest.MonkeyPatch, signature: Callable[[Candidate], FloatArray]) -> None:
    """Forms whose signatures are these, (rows, strengths)."""
    monkeypatch.setattr(screened_module, "Signatures", lambda *_: signature)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.id)
def test_every_strength_within_its_bounds_is_found(
    kind: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also one whose usual size, and so its probing size, is negative."""
    candidate = candidates([kind])[0]
    rng = np.random.default_rng(8)
    signature = rng.standard_normal((ROWS, len(candidate.steps)))
    given(monkeypatch, lambda _: signature.copy())
    steps = np.array([step for _, step in candidate.steps])
    for share in (1.0, 0.5):
        strengths = np.array([share * q.typical for q in kind.strengths()])
        rest = -signature @ (strengths / steps)
        some = screened(residual(rest), [candidate], EXACT, Recorder())
        (found,) = some.columns.proposals([(0,)])
        sizes = np.array([q.usual_size for q in kind.strengths()])
        np.testing.assert_allclose(found.strengths[0] * sizes, strengths, rtol=1e-5)
        assert float(np.sum(found.squares)) < 1e-9 * float(rest @ rest)
        assert found.evidence > 0.0
        (effect,) = some.effects(found)
        for q, value, (_, step) in zip(kind.strengths(), strengths, candidate.steps, strict=True):
            # A threshold is where it was screened: it has no slope.
            expected = step if q.grid else value
            assert getattr(effect, q.name) == pytest.approx(expected, rel=1e-5)
        assert all(getattr(effect, name) == value for name, value in candidate.shape)


def test_what_the_base_parameters_imitate_is_no_column(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(9)
    basis = np.linalg.qr(rng.standard_normal((ROWS, 3)))[0]
    own = rng.standard_normal((ROWS, 1))
    plain = {"quadratic-drag": own, "seal-friction": basis @ np.ones((3, 1)) + 1e-5 * own}
    given(monkeypatch, lambda form: plain[form.id].copy())
    forms = candidates([QuadraticDrag, SealFriction])
    rest = -own[:, 0] + basis @ (basis.T @ own[:, 0])
    some = screened(residual(rest, basis), forms, EXACT, Recorder())
    drag, seals = some.columns.proposals(
        [(next(i for i, f in enumerate(some.forms) if f.id == name),) for name in plain]
    )
    assert drag.evidence > 0.0 > seals.evidence
    assert np.all(seals.strengths[0] == 0.0)


def test_an_effect_that_cannot_be_screened_is_noted_and_the_others_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("SYSID_DEBUG", raising=False)
    rng = np.random.default_rng(10)

    def signature(form: Candidate) -> FloatArray:
        if form.id == "seal-friction":
            raise np.linalg.LinAlgError("Singular matrix")
        return rng.standard_normal((ROWS, len(form.steps)))

    given(monkeypatch, signature)
    recorder = Recorder()
    forms = candidates([QuadraticDrag, SealFriction])
    some = screened(residual(np.ones(ROWS)), forms, EXACT, recorder)
    assert {form.id for form in some.forms} == {"quadratic-drag"}
    assert len(some.columns.blocks) == len(some.forms)
    assert recorder.screened == ["quadratic-drag"]
    assert [m.subject for m in recorder.missed] == ["seal-friction"]
