"""What the errors of the fitted numbers do to the simulated motion."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from sysid.io.campaign import SIMULATED_KINDS, Campaign
from sysid.parameters import Bundle
from sysid.plant.effects.entry import Catalogue
from sysid.plant.ports import Model
from sysid.recording.motion_tests import MotionTest, prepare_all
from sysid.recording.simulation import simulate_segments
from sysid.refinement.prior import prior_factor
from sysid.refinement.refine import SEGMENT_S
from sysid.refinement.unknowns import Unknown, model_at, unknowns_of
from sysid.types import FloatArray


def position_errors(
    campaign: Campaign, bundle: Bundle, catalogue: Catalogue | None = None
) -> dict[str, float]:
    """RMS (rad or m) by which each fitted number's standard error moves the simulated position.

    Over whole training tests, one of each motion log, open loop. A number that is one standard
    error off has those with it that its error is correlated with, by the bundle's covariance, as
    their regression on it says: what it and they do to the motion may cancel. Only numbers with a
    standard error are there; empty where none has one, or the campaign has no training motion log.
    Raises SimulationError where the model cannot be simulated.
    """
    rig = campaign.rig
    model = bundle.model(rig, catalogue)
    fitted = (u for u in unknowns_of(bundle, rig, model) if u.origin != "rig")
    known = [dataclasses.replace(u, has_prior=True) for u in fitted if u.std > 0.0]
    tests = _tests(campaign) if known else []
    if not tests:
        return {}
    spread = np.linalg.inv(prior_factor(known))
    covariance = spread @ spread.T
    off = covariance / np.sqrt(np.diag(covariance))[:, None]
    moved = [model, *(_moved(model, known, row) for row in off)]
    segments = [(test, test.whole) for test in tests]
    runs = simulate_segments(
        [one for _ in moved for one in segments],
        [own for own in moved for _ in segments],
        position=rig.position_channel,
        nan_if_endless=True,
    )
    shown = [_counted(runs[i : i + len(tests)], tests) for i in range(0, len(runs), len(tests))]
    errors = [math.sqrt(np.mean((one - shown[0]) ** 2)) for one in shown[1:]]
    found = zip(known, errors, strict=True)
    return {u.name: error for u, error in found if math.isfinite(error)}


def _moved(model: Model, known: Sequence[Unknown], off: FloatArray) -> Model:
    """The model whose numbers are off by so much, in their coordinates."""
    values = [u.at(u.start + o) for u, o in zip(known, off, strict=True)]
    return model_at(model, known, np.array(values))


def _tests(campaign: Campaign) -> list[MotionTest]:
    """The first usable training test of each motion log."""
    found = []
    for entry in campaign.select(SIMULATED_KINDS):
        tests, _ = prepare_all(campaign.read(entry).trials, entry.kind, campaign.rig, SEGMENT_S)
        found += [test for test in tests if test.counted(test.whole) > 1][:1]
    return found


def _counted(runs: Sequence[FloatArray], tests: Sequence[MotionTest]) -> FloatArray:
    """The positions of some runs until the end stops, one after the other."""
    pairs = zip(runs, tests, strict=True)
    return np.concatenate([run[0, : test.counted(test.whole)] for run, test in pairs])


__all__ = ["position_errors"]
