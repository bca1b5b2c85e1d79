"""The flow law of ISO 6358: its regimes, its ends, and the same numbers on numpy and jax."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.plant.iso6358 import choked_flow, iso6358_flow, subsonic_share

C, B = 1.5e-8, 0.3


def test_choked_flow_is_proportional_to_the_upstream_pressure() -> None:
    low = iso6358_flow(4e5, 1e5, C, B)
    assert low == pytest.approx(1.5e-8 * 1.185 * 4e5)
    assert iso6358_flow(8e5, 1e5, C, B) == pytest.approx(2.0 * low)
    assert iso6358_flow(4e5, 0.0, C, B) == low


def test_hotter_air_flows_by_the_root_of_its_temperature() -> None:
    assert choked_flow(5e5, C, 4.0 * 293.15) == pytest.approx(0.5 * choked_flow(5e5, C))


@pytest.mark.parametrize("index", [0.4, 0.5, 0.9])
def test_beyond_the_critical_ratio_flow_falls_to_nothing(index: float) -> None:
    ratio = np.linspace(0.0, 1.0, 201)
    share = subsonic_share(ratio, B, index)
    assert np.all(share[ratio <= B] == 1.0) and share[-1] == 0.0
    assert np.all(np.diff(share[ratio > B]) < 0.0)
    expected = (1.0 - ((0.65 - B) / (1.0 - B)) ** 2) ** index
    assert subsonic_share(0.65, B, index) == pytest.approx(expected)


def test_flow_reverses_with_the_pressures() -> None:
    up, down = np.array([1e5, 6e5, 3e5]), np.array([6e5, 1e5, 3e5])
    flow = iso6358_flow(up, down, C, B)
    assert flow[0] == -flow[1] < 0.0
    assert flow[2] == 0.0


def test_jax_and_numpy_agree_and_slopes_are_finite() -> None:
    jax = pytest.importorskip("jax")
    pressure = np.linspace(0.5e5, 6e5, 23)
    plain = iso6358_flow(6e5, pressure, C, B)
    with jax.enable_x64(True):
        traced = jax.jit(lambda p: iso6358_flow(6e5, p, C, B, 0.5))(pressure)
        slope = jax.vmap(jax.grad(lambda p: iso6358_flow(6e5, p, C, B, 0.5)))(pressure)
    assert np.allclose(traced, plain, rtol=1e-12, atol=0.0)
    assert np.all(np.isfinite(slope))
