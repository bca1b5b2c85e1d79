"""What a simulation's residual is worth: per channel an autoregression, its innovations white."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.estimation.autoregression import Autoregression, autoregression
from sysid.types import FloatArray

# Innovations below this share of the sensor's noise would be believed too much.
_LEAST_SHARE = 0.3


@dataclass(frozen=True)
class Whitening:
    """One channel's errors over time: e[t] = a1 e[t-1] + ... + innovation of this std."""

    coefficients: FloatArray
    std: float

    @classmethod
    def white(cls, std: float) -> Whitening:
        return cls(np.zeros(0), std)

    @classmethod
    def of(cls, residuals: Sequence[FloatArray], floor: float, most: int) -> Whitening:
        """As residuals of runs show it: order by AIC, at most `most`."""
        model: Autoregression = autoregression(residuals, most)
        std = max(float(np.sqrt(model.innovation)), _LEAST_SHARE * floor)
        return cls(model.coefficients, std)

    def __call__(self, columns: FloatArray) -> FloatArray:
        """Innovations (n, k) of columns (n, k) in units of their std.

        The first rows, before which nothing is known, count by their own variance.
        """
        order = len(self.coefficients)
        white = np.array(columns)
        for lag, a in enumerate(self.coefficients, start=1):
            white[lag:] -= a * columns[:-lag]
        if order:
            # As many rows as the order: with what of the past there is.
            shares = self._start_shares[: len(white)]
            white[:order] *= shares[:, None]
        return white / self.std

    @functools.cached_property
    def _start_shares(self) -> FloatArray:
        """(order,): of the first rows' std that an innovation has."""
        from scipy.signal import lfilter

        impulse = np.zeros(4096)
        impulse[0] = 1.0
        response = lfilter([1.0], np.concatenate([[1.0], -self.coefficients]), impulse)
        total = float(response @ response)
        return np.full(len(self.coefficients), 1.0 / np.sqrt(total))
