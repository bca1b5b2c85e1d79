"""Which tests are held out: whole tests, never samples, and never the ends of the range."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sysid.errors import input_error
from sysid.types import FloatArray, IntArray


def end_groups(codes: IntArray, duty: FloatArray) -> IntArray:
    """Groups that hold the lowest or the highest duty; `codes` (n,) are 0, 1, ..."""
    count = np.bincount(codes)
    mean = np.bincount(codes, duty) / np.maximum(count, 1)
    held = count > 0
    low, high = mean[held].min(), mean[held].max()
    at_end = (mean <= low + 1e-4) | (mean >= high - 1e-4)
    return np.flatnonzero(held & at_end)


def hold_out_groups(
    groups: ArrayLike, duty: FloatArray, share: float, seed: int
) -> NDArray[np.bool_]:
    """(n,) True for samples of held-out tests: a random `share` of the groups.

    Groups at the ends of the duty range stay in training. Raises InputError where fewer
    than one group would be held out.
    """
    codes = np.unique(np.asarray(groups), return_inverse=True)[1].astype(np.intp)
    inner = np.setdiff1d(np.arange(codes.max() + 1), end_groups(codes, duty))
    if len(inner) < 1 or not 0.0 < share < 1.0:
        raise input_error(
            "DutyNetwork",
            f"cannot hold out {share:g} of {codes.max() + 1} tests",
            "give tests at three or more duties and a share between 0 and 1",
        )
    rng = np.random.default_rng(seed)
    count = min(max(1, round(share * (codes.max() + 1))), max(1, len(inner) - 1))
    # Stratified: one test from each of `count` neighbouring runs of duties.
    mean = np.bincount(codes, duty) / np.bincount(codes)
    ordered = inner[np.argsort(mean[inner], kind="stable")]
    chosen = [rng.choice(run) for run in np.array_split(ordered, count)]
    return np.isin(codes, chosen)


def group_folds(
    groups: ArrayLike, duty: FloatArray, folds: int, seed: int
) -> list[NDArray[np.bool_]]:
    """`folds` masks (n,): every test but those at the ends of the duty range is held out once.

    A held-out end would require extrapolation, which the surfaces refuse. Neighbouring
    duties go to different folds. Raises InputError for fewer inner tests than folds.
    """
    codes = np.unique(np.asarray(groups), return_inverse=True)[1].astype(np.intp)
    inner = np.setdiff1d(np.arange(codes.max() + 1), end_groups(codes, duty))
    if folds < 2 or len(inner) < folds:
        raise input_error(
            "held-out comparison",
            f"{len(inner)} tests inside the duty range are too few for {folds} folds",
            "give more tests, or ask for fewer folds (at least 2)",
        )
    mean = np.bincount(codes, duty) / np.bincount(codes)
    ordered = inner[np.argsort(mean[inner], kind="stable")]
    rng = np.random.default_rng(seed)
    fold = np.full(codes.max() + 1, -1)
    for start in range(0, len(ordered), folds):
        run = ordered[start : start + folds]
        fold[run] = rng.permutation(folds)[: len(run)]
    return [fold[codes] == k for k in range(folds)]
