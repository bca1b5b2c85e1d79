"""How well a law of mean flow follows constant-duty tests, in duty; and flows that cannot be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sysid.errors import NotIdentifiedError
from sysid.estimation.quality import NOT_TESTABLE, FitQuality, scatter_test, spread
from sysid.identification.valve_pwm.samples import FlowSamples
from sysid.surfaces.comparison import SurfaceError
from sysid.types import FloatArray

HELD_OUT, FITTED = "held_out", "fitted"
CHECK = (
    "check for a wrong unit or time base, the other chamber's pressure, a duty that is not this "
    "valve's, or a piston that moves"
)


def duty_quality(
    errors: Mapping[str, SurfaceError], duty: FloatArray, noise: float | None
) -> FitQuality:
    """Quality of the duty by a law at flows and pressures, on held-out tests if any.

    `duty` (n,) of the points; `noise`: the RMSE that the noise of the flow alone gives, None
    or NaN where it is not known.
    """
    return _quality(errors, HELD_OUT if HELD_OUT in errors else FITTED, duty, noise)


def fails(errors: Mapping[str, SurfaceError], duty: FloatArray, noise: float | None) -> str | None:
    """A law's error on its own training tests where it explains too little; else None.

    Held-out tests may ask for what few tests do not hold; the training tests may not.
    """
    found = _quality(errors, FITTED, duty, noise)
    return found.shortfall if found.explains_too_little else None


def _quality(
    errors: Mapping[str, SurfaceError], use: str, duty: FloatArray, noise: float | None
) -> FitQuality:
    error = errors[use]
    scatter = noise if noise is not None and np.isfinite(noise) and noise > 0.0 else None
    return FitQuality(
        signal=f"duty on {'held-out' if use == HELD_OUT else 'training'} tests",
        unit="of duty",
        count=error.n_points,
        rmse=error.rmse,
        spread=spread(duty, has_constant=True),
        lack_of_fit=NOT_TESTABLE if scatter is None else scatter_test(error.rmse, scatter),
        scatter=scatter,
    )


def require_sign(samples: FlowSamples, direction: str) -> None:
    """NotIdentifiedError where the chamber empties while it should fill, or the reverse."""
    total = float(np.sum(samples.flow))
    if (total < 0.0) == (direction == "fill") and total != 0.0:
        seen, start = ("falls", "atmosphere") if direction == "fill" else ("rises", "supply")
        raise NotIdentifiedError(
            f"the pressure {seen} in tests that start from the {start}, so that the flow has the "
            f"wrong sign: {CHECK}"
        )


__all__ = ["CHECK", "duty_quality", "fails", "require_sign"]
