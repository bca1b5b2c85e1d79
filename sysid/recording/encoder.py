"""Which of an encoder's readings are rests: those that last longer than a motion explains."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

PASSED = 8.0
"""While the shaft moves, an encoder's reading lasts less than so many times as long as the second
shortest of the two before and the two after: 7.5 times where a motion slows down and goes on as the
cube of time, 6.3 where one of constant acceleration turns, at the worst place within a count."""


def counts_at_rest(changes: NDArray[np.intp], count: int) -> NDArray[np.bool_]:
    """Which of the readings of an encoder that stay the same are rests, (k + 1,).

    `changes` (k,): the rows at which the next reading begins, of `count` rows. A rest lasts longer
    than a reading that a motion passes can, next to those around it (`PASSED`), and by more than
    the sampling, which changes each by up to a row.
    """
    lengths = np.diff(np.concatenate([[0], changes, [count]]))
    if len(lengths) == 1:
        return np.ones(1, dtype=bool)
    # The first and the last reading are truncated: their durations are unknown.
    known = np.concatenate([[count] * 3, lengths[1:-1], [count] * 3])
    near = [known[2 + shift : 2 + shift + len(lengths)] for shift in (-2, -1, 1, 2)]
    second = np.sort(near, axis=0)[1]
    return np.asarray(lengths - 1 > PASSED * (second + 1))


__all__ = ["PASSED", "counts_at_rest"]
