"""The sub-steps that a table of rows and valve edges leads a run through."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid.plant import valve_timing
from sysid.plant.jax_setup import jax, jnp
from sysid.plant.lanes import Lanes, Now, SwitchedTable
from sysid.plant.preparation import SwitchedRun
from sysid.plant.tables import block_of
from sysid.types import FloatArray

MAX_STEP = 1e-3
ROWS = 10


@jax.jit
def step(lanes: Lanes, table: SwitchedTable) -> tuple[Lanes, Now]:
    now = table.now(lanes)
    return lanes._replace(**table.moved(lanes, now, jnp.zeros(1, dtype=bool), now.step)), now


def walked(time: FloatArray, edges: FloatArray, apart: bool = False) -> FloatArray:
    """(5, sub-steps): row, start s since the first row, duration s, A open, B open."""
    run = SwitchedRun(time, np.zeros(len(time)), (edges, edges[:0]))
    table = block_of([run], 1, len(run), MAX_STEP, apart).table(0)
    zero, none = np.zeros(1), np.zeros(1, dtype=int)
    lanes = Lanes(zero, zero, zero, zero, zero, (), zero, none, zero, (none, none))
    found = []
    while int(lanes.index[0]) < len(run):
        after, now = step(lanes, table)
        _, open_a, open_b = now.commands
        found.append([lanes.index, lanes.elapsed, now.step, open_a, open_b])
        lanes = after
        assert len(found) < 5000
    return np.array(found)[..., 0].T


def test_samples_are_split_at_edges_and_at_the_longest_step() -> None:
    time = 7.0 + np.arange(ROWS + 1) / 250.0
    edges = np.array([0.0005, 0.004, 0.00402, 0.0061])
    row, start, duration, _, _ = walked(time, 7.0 + edges)
    assert duration.max() <= MAX_STEP * (1 + 1e-6)
    np.testing.assert_allclose(start[1:], (start + duration)[:-1], atol=1e-12)
    for edge in edges:
        assert np.abs(start - edge).min() < 1e-12
    np.testing.assert_array_equal(row, np.searchsorted(time - 7.0, start + 1e-9) - 1)


@settings(max_examples=60, deadline=None)
@given(
    edges=st.lists(
        st.one_of(
            st.floats(-0.01, 0.05),
            st.sampled_from([-np.inf, 0.0, 0.004, 0.004 + 5e-10, 0.008 - 5e-10, 0.02, np.inf]),
        ),
        min_size=0,
        max_size=12,
    ),
    jitter=st.floats(0.0, 3e-4),
    apart=st.booleans(),
)
def test_the_table_knows_where_the_valve_is_open(
    edges: list[float], jitter: float, apart: bool
) -> None:
    rows = np.arange(ROWS + 1) * 2e-3
    time = 5.0 + rows + jitter * np.sin(rows * 1e4) * (rows > 0)
    # Distinct edges, alternately opening and closing.
    ordered = np.array(sorted(edges)) + 5.0
    if len(ordered):
        with np.errstate(invalid="ignore"):
            ordered = ordered[np.concatenate(([True], np.diff(ordered) > 3e-9))]
    ordered = ordered[: len(ordered) // 2 * 2]
    intervals = valve_timing.OpenIntervals(ordered[0::2], ordered[1::2])
    row, start, duration, open_a, open_b = walked(time, ordered, apart)
    middle = time[0] + start + 0.5 * duration
    long = duration > 1e-8
    np.testing.assert_array_equal(open_a[long] == 1.0, intervals.is_open(middle)[long])
    assert not open_b.any()
    assert apart or duration.min() > 0.0
    assert duration.max() <= MAX_STEP * (1 + 1e-6)
    assert duration.sum() == pytest.approx(time[-1] - time[0])
    np.testing.assert_array_equal(row[long], np.searchsorted(time, middle[long]) - 1)


def test_edges_beyond_the_tables_first_room_are_kept() -> None:
    time = 3.0 + np.arange(ROWS + 1) * 0.5
    edges = 3.0 + 0.001 + np.arange(2000) * 5e-4
    _, _, duration, open_a, _ = walked(time[:3], edges)
    intervals = valve_timing.OpenIntervals(edges[0::2], edges[1::2])
    whole = intervals.open_time(time[:1], time[2:3])[0]
    assert (duration * open_a).sum() == pytest.approx(whole, abs=1e-9)
