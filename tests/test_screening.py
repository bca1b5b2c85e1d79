"""Screening: an effect's own signature in a residual gives its strengths back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sysid.diagnosis.actuator.projection import Projected, explained
from sysid.diagnosis.actuator.signatures import candidates
from sysid.plant.effects.catalogue import catalogue

ROWS = 400
KINDS = [kind for kind in catalogue().values() if not kind.averaged_only]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.id)
def test_every_strength_within_its_bounds_is_found(kind: Any) -> None:
    """Also one whose usual size, and so its probing size, is negative."""
    candidate = candidates([kind])[0]
    rng = np.random.default_rng(8)
    signature = rng.standard_normal((ROWS, len(candidate.steps)))
    steps = np.array([step for _, step in candidate.steps])
    for share in (1.0, 0.5):
        strengths = np.array([share * q.typical for q in kind.strengths()]) / steps
        rest = -signature @ strengths
        nothing = np.zeros((ROWS, 0))
        missing: Any = None
        base = Projected(missing, missing, rest, nothing, rest, nothing, np.zeros(0))
        found = explained(base, candidate, signature)
        np.testing.assert_allclose(found.coefficients, strengths, rtol=1e-9)
        assert found.gain == pytest.approx(float(rest @ rest))
