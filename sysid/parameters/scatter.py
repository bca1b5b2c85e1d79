"""How far friction scatters from one test to the next, as a bundle's tests showed it."""

from __future__ import annotations

from typing import NamedTuple

from sysid.parameters.content import BundleContent
from sysid.parameters.friction import Friction
from sysid.parameters.refinement import ScatterOfFriction

MOST_SCATTER = 0.1
"""Of friction, from test to test: tests that differ by more are not of one rig."""
_LEAST_SCATTER = 2e-3
# Where no bench test shows the scatter of friction: a usual one, believed as much as five tests.
_ASSUMED, _ASSUMED_TESTS = 0.02, 5.0


class BenchScatter(NamedTuple):
    """Relative standard deviation of sliding and static friction, and how many tests show it."""

    sliding: float
    static: float
    tests: float


def bench_scatter(friction: Friction | None) -> BenchScatter:
    """As the bench tests showed it; 2 % where they did not."""
    pairs = (("coulomb", "friction-sliding"), ("static", "friction-static"))
    found = [_of_one(friction, *pair) for pair in pairs]
    return BenchScatter(found[0][0], found[1][0], min(tests for _, tests in found))


def friction_scatter(bundle: BundleContent) -> tuple[float, float]:
    """Of sliding and of static friction: as the refinement found it, else as the bench did."""
    refined = None if bundle.refinement is None else bundle.refinement.friction_scatter
    if isinstance(refined, ScatterOfFriction):
        return float(refined.sliding), float(refined.static)
    sliding, static, _ = bench_scatter(bundle.friction)
    return sliding, static


def _of_one(friction: Friction | None, name: str, kind: str) -> tuple[float, float]:
    """Relative scatter about one law, and the number of tests behind it."""
    quality = friction.quality if friction is not None else None
    own = quality.get(kind) if isinstance(quality, dict) else None
    value = None if friction is None else friction.parameter(name)
    if own is None or not own.rmse or value is None or not value.identified:
        return _ASSUMED, _ASSUMED_TESTS
    share = float(own.rmse) / max(abs(float(value.value)), 1e-12)
    return min(max(share, _LEAST_SCATTER), MOST_SCATTER), float(own.samples)


__all__ = ["BenchScatter", "bench_scatter", "friction_scatter"]
