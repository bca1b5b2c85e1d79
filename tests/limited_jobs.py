"""Jobs for other processes, which import no more than this for them."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np

from sysid.parallel import processes, spend


def spending(evaluations: int) -> int:
    """A job that counts."""
    for _ in range(evaluations):
        spend()
    return evaluations


def busy(seconds: float) -> float:
    """A job that looks at its limit while it computes for so long."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        spend(0)
    return seconds


def told_and_busy(folder: str) -> None:
    """Leave one's process number in a folder, and compute without an end.

    A worker is ended some seconds of processor time after its share: here soon after.
    """
    processes._GRACE_S = 0.2
    (Path(folder) / str(os.getpid())).touch()
    while True:
        pass


def broken(_: int) -> float:
    raise np.linalg.LinAlgError("Singular matrix")


def used_by(seconds: float) -> float:
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
    return seconds
