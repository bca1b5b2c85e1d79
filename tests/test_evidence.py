"""Evidence on made-up columns: the cost of a residual, sets of forms, and what counts against."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from sysid.diagnosis.actuator.columns import ODDS, Columns, FormColumns, Proposal
from sysid.diagnosis.actuator.misfit import RELATIVE_MODEL_ERROR, ResidualChannel
from sysid.diagnosis.actuator.misfit import cost as cost_of
from sysid.diagnosis.actuator.sets import best_sets, names_of
from sysid.types import FloatArray

FREE = (-math.inf, math.inf)

# --- a channel's cost --------------------------------------------------------------------

CHANNELS = {
    "noise": ResidualChannel(1000, 5.0, 2.0, 0.0),
    "structured": ResidualChannel(1000, 5.0, 2.0, 1e6),
    "one-draw": ResidualChannel(50, 1.0, 1e-3, 40.0),
}


@pytest.mark.parametrize("channel", CHANNELS.values(), ids=CHANNELS)
def test_the_cost_is_continuous_with_the_slope_that_a_square_counts_for(
    channel: ResidualChannel,
) -> None:
    """Also where noise ends, and where what is left is as much as an effect's law may be off."""
    noise = channel.rows * channel.square
    edge = noise + channel.misfit * channel.square
    step = 1e-6 * noise
    for squares in [*np.geomspace(0.1 * noise, 1e4 * noise, 60), noise, edge]:
        low, here, high = channel.cost(np.array([squares - step, squares, squares + step]))
        assert (high - low) / (2.0 * step) == pytest.approx(channel.weight(squares), rel=1e-4)
        assert high - here == pytest.approx(here - low, rel=1e-3)
    slopes = channel.weight(np.geomspace(0.1 * noise, 1e4 * noise, 60))
    assert np.all(slopes > 0.0) and np.all(np.diff(slopes) <= 0.0)


def test_the_cost_of_noise_is_its_squares() -> None:
    channel = CHANNELS["noise"]
    squares = np.array([500.0, 1000.0, 2000.0])
    np.testing.assert_allclose(np.diff(channel.cost(squares)), np.diff(squares) / channel.square)
    np.testing.assert_allclose(channel.weight(squares), 1.0 / channel.square)
    # A little beyond, too: less than there are draws.
    assert float(channel.cost(2002.0)) == pytest.approx(1.0, rel=0.15)


def test_the_cost_of_a_misfit_is_the_logarithm_of_it() -> None:
    """A tenth of it is a tenth of it, however much it is."""
    channel = CHANNELS["noise"]
    noise = channel.rows * channel.square
    for excess in (1e6, 1e9):
        falls = channel.cost(noise + excess) - channel.cost(noise + 0.1 * excess)
        assert float(falls) == pytest.approx(channel.draws * math.log(10.0), rel=1e-3)
    more = replace(channel, draws=10.0)
    assert float(more.cost(noise + 1e9)) > 1.5 * float(channel.cost(noise + 1e9))


def test_of_what_an_effect_explained_a_share_is_a_misfit_of_its_law() -> None:
    """Noise beside that counts for less than where there was nothing to explain."""
    rows, draws, square = 1000, 5.0, 2.0
    noise = rows * square
    plain = ResidualChannel(rows, draws, square, noise)
    lacking = ResidualChannel(rows, draws, square, noise + 1e6 * square)
    assert plain.misfit == 0.0
    assert lacking.misfit == pytest.approx(RELATIVE_MODEL_ERROR**2 * 1e6)
    assert ResidualChannel(rows, draws, square, 0.5 * noise).misfit == 0.0
    edge = noise + lacking.misfit * square
    expected = 1.0 / (square * (1.0 + lacking.misfit / draws))
    np.testing.assert_allclose(lacking.weight(np.array([0.5 * noise, noise, edge])), expected)
    # All of it below that is worth less than another draw of the misfit.
    assert float(lacking.cost(edge) - lacking.cost(noise)) < draws
    assert float(plain.cost(edge) - plain.cost(noise)) > 4.0 * draws
    # Beyond it is what it would be.
    np.testing.assert_allclose(lacking.weight(2.0 * edge), plain.weight(2.0 * edge))


# --- columns -----------------------------------------------------------------------------


def columns_of(
    parts: Sequence[FloatArray],
    rests: Sequence[FloatArray],
    blocks: Sequence[tuple[str, int]],
    *,
    square: float | None = 1.0,
    draws: float = 4.0,
    bounds: tuple[float, float] = FREE,
    claims: Sequence[frozenset[str]] | None = None,
) -> Columns:
    """Columns (rows, m) and residual (rows,) of each channel; names and sizes of the forms.

    `square`: that of the noise; None where it is more than all that there is.
    """
    edges = np.cumsum([0, *(size for _, size in blocks)]).tolist()
    own = tuple(
        FormColumns(
            name,
            range(low, high),
            np.full(high - low, bounds[0]),
            np.full(high - low, bounds[1]),
            frozenset() if claims is None else claims[i],
        )
        for i, ((name, _), (low, high)) in enumerate(
            zip(blocks, itertools.pairwise(edges), strict=True)
        )
    )
    squares = np.array([float(rest @ rest) for rest in rests])
    channels = tuple(
        ResidualChannel(
            len(rest), draws, 2.0 * power / len(rest) if square is None else square, power
        )
        for rest, power in zip(rests, squares, strict=True)
    )
    return Columns(
        channels,
        own,
        np.array([x.T @ x for x in parts]),
        np.array([x.T @ rest for x, rest in zip(parts, rests, strict=True)]),
        squares,
        np.zeros(len(blocks)),
    )


def random_parts(
    rng: np.random.Generator, strengths: FloatArray, sizes: Sequence[float] = (1.0, 1.0)
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Columns of two channels of 60 and 90 rows, and residuals that lack these strengths."""
    parts = [
        size * rng.standard_normal((rows, len(strengths)))
        for rows, size in zip((60, 90), sizes, strict=True)
    ]
    return parts, [rng.standard_normal(len(x)) - x @ strengths for x in parts]


def index_of(columns: Columns, forms: Sequence[int]) -> list[int]:
    return [i for f in forms for i in columns.blocks[f].columns]


def test_where_all_is_noise_the_evidence_is_that_of_normal_distributions() -> None:
    """Of the residual, with the strengths of a set drawn from their prior, and without any."""
    rng = np.random.default_rng(2)
    blocks = [("one", 1), ("one", 1), ("two", 2), ("three", 1), ("three", 3)]
    parts, rests = random_parts(rng, np.array([0.5, 0.0, 0.3, -0.4, 0.0, 0.2, 0.0, 0.0]))
    columns = columns_of(parts, rests, blocks, square=None)
    sets = [(0,), (1,), (2,), (4,), (0, 2), (1, 4), (2, 0), (0, 2, 4)]
    found = columns.proposals(sets)
    assert [p.forms for p in found] == sets
    for proposal in found:
        own, expected = index_of(columns, proposal.forms), 0.0
        # ResidualChannel by channel only the noise differs: the strengths are those of both.
        scaled = [
            np.column_stack([x[:, own], rest]) / math.sqrt(c.square)
            for x, rest, c in zip(parts, rests, columns.channels, strict=True)
        ]
        x, rest = np.vstack(scaled)[:, :-1], np.vstack(scaled)[:, -1]
        with_set = multivariate_normal(cov=np.eye(len(rest)) + x @ x.T).logpdf(rest)
        without = multivariate_normal(cov=np.eye(len(rest))).logpdf(rest)
        expected = 2.0 * float(with_set - without) - sum(columns.penalty[list(proposal.forms)])
        assert proposal.evidence == pytest.approx(expected, rel=1e-9, abs=1e-9)
        best = -np.linalg.solve(x.T @ x + np.eye(len(own)), x.T @ rest)
        np.testing.assert_allclose(np.concatenate(proposal.strengths), best, rtol=1e-9)
        assert [len(own) for own in proposal.strengths] == [blocks[f][1] for f in proposal.forms]
        left = [np.sum((r + x[:, own] @ best) ** 2) for x, r in zip(parts, rests, strict=True)]
        np.testing.assert_allclose(proposal.squares, left, rtol=1e-9)


@pytest.mark.parametrize("draws", [2.0, 20.0])
def test_where_there_is_a_misfit_the_strengths_are_those_of_least_cost(draws: float) -> None:
    """In channels that are described badly and well: brute force, by another program's search."""
    rng = np.random.default_rng(3)
    truth = np.array([3.0, 0.0, 1.0, -2.0, 0.5])
    parts, rests = random_parts(rng, truth, (1.0, 4.0))
    # What no column explains is left in one of the channels.
    rests[1] += 20.0 * rng.standard_normal(len(rests[1]))
    columns = columns_of(
        parts, rests, [("one", 1), ("two", 1), ("three", 2), ("four", 1)], draws=draws
    )
    sets = [(0,), (2,), (0, 2), (0, 2, 3)]
    for proposal in columns.proposals(sets):
        own = index_of(columns, proposal.forms)

        def left(strengths: FloatArray, own: Sequence[int] = own) -> FloatArray:
            pairs = zip(parts, rests, strict=True)
            return np.array([np.sum((r + x[:, own] @ strengths) ** 2) for x, r in pairs])

        def cost(strengths: FloatArray, left=left) -> float:  # type: ignore[no-untyped-def]
            return float(cost_of(columns.channels, left(strengths)) + strengths @ strengths)

        best = minimize(cost, np.concatenate(proposal.strengths), method="BFGS")
        weights = [float(c.weight(s)) for c, s in zip(columns.channels, left(best.x), strict=True)]
        curvature = sum(w * x[:, own].T @ x[:, own] for w, x in zip(weights, parts, strict=True))
        size = np.linalg.slogdet(np.eye(len(own)) + curvature)[1]
        none = float(cost_of(columns.channels, columns.squares))
        expected = none - float(best.fun) - size - sum(columns.penalty[list(proposal.forms)])
        # As close as no decision depends on: the weights are those of the last pass but one.
        assert cost(np.concatenate(proposal.strengths)) == pytest.approx(best.fun, abs=0.05)
        assert proposal.evidence == pytest.approx(expected, abs=0.5)
        np.testing.assert_allclose(
            proposal.squares, left(np.concatenate(proposal.strengths)), rtol=1e-9
        )


def test_a_strength_that_would_have_to_leave_its_bound_at_0_is_absent() -> None:
    rng = np.random.default_rng(4)
    parts, rests = random_parts(rng, np.array([-2.0, 2.0, 2.0, -2.0]))
    blocks = [("below", 1), ("above", 1), ("both", 2)]
    columns = columns_of(parts, rests, blocks, square=None, bounds=(0.0, math.inf))
    below, above, both, pair = columns.proposals([(0,), (1,), (2,), (1, 0)])
    assert below.evidence == -math.inf and below.strengths[0] == 0.0
    assert above.evidence > -math.inf and above.strengths[0] > 0.0
    # Of a form with two strengths the other stays, as if it were alone.
    assert both.evidence > -math.inf
    assert both.strengths[0][0] > 0.0 and both.strengths[0][1] == 0.0
    single = columns_of(
        [x[:, [2]] for x in parts], rests, [("both", 1)], square=None, bounds=(0.0, math.inf)
    )
    (alone,) = single.proposals([(0,)])
    assert both.strengths[0][0] == pytest.approx(alone.strengths[0][0])
    assert both.evidence + columns.penalty[2] == pytest.approx(alone.evidence + single.penalty[0])
    # A set with a form that is absent is none, however well the other explains.
    assert pair.evidence == -math.inf
    mirrored = columns_of(parts, rests, blocks, square=None, bounds=(-math.inf, 0.0))
    assert [p.evidence > -math.inf for p in mirrored.proposals([(0,), (1,)])] == [True, False]


def test_a_strength_ends_at_its_other_bound() -> None:
    rng = np.random.default_rng(5)
    parts, rests = random_parts(rng, np.array([3.0]))
    free, bound = (
        columns_of(parts, rests, [("one", 1)], square=None, bounds=(0.0, most)).proposals([(0,)])[0]
        for most in (math.inf, 0.5)
    )
    assert free.strengths[0] > 2.0 and bound.strengths[0] == 0.5
    assert -math.inf < bound.evidence < free.evidence
    left = [np.sum((r + 0.5 * x[:, 0]) ** 2) for x, r in zip(parts, rests, strict=True)]
    np.testing.assert_allclose(bound.squares, left)


def test_how_many_were_tried_counts_against_an_effect() -> None:
    """How many effects, and how many forms of it: the best of many gains by chance."""
    rng = np.random.default_rng(6)
    parts, rests = random_parts(rng, np.zeros(5))
    blocks = [("one", 1), ("two", 1), ("two", 1), ("three", 2)]
    columns = columns_of(parts, rests, blocks)
    np.testing.assert_allclose(columns.penalty, ODDS + 2.0 * np.log([3.0, 6.0, 6.0, 3.0]))


def test_what_an_effect_gains_where_nothing_is_missing_is_no_evidence() -> None:
    """It counts against every set that the effect is in, and against no other."""
    rng = np.random.default_rng(7)
    parts, rests = random_parts(rng, np.array([1.0, 0.5, 0.0]))
    columns = columns_of(parts, rests, [("one", 1), ("two", 1), ("three", 1)], square=None)
    chance = np.array([7.0, 0.0, 0.0])
    sets = [(0,), (1,), (0, 1), (1, 2)]
    before = columns.proposals(sets)
    after = columns.with_chance(chance).proposals(sets)
    falls = [b.evidence - a.evidence for b, a in zip(before, after, strict=True)]
    assert falls == pytest.approx([7.0, 0.0, 7.0, 0.0])
    for one, other in zip(before, after, strict=True):
        np.testing.assert_array_equal(one.squares, other.squares)
    (some,) = columns.with_chance(chance).of([2, 0]).proposals([(1,)])
    assert some.evidence == pytest.approx(after[0].evidence + 2.0 * math.log(1.5))


def test_the_columns_of_some_forms_are_what_they_were() -> None:
    rng = np.random.default_rng(8)
    parts, rests = random_parts(rng, rng.standard_normal(7))
    blocks = [("one", 2), ("two", 1), ("two", 1), ("three", 3)]
    columns = columns_of(parts, rests, blocks)
    some = columns.of([0, 3])
    assert [(b.name, b.columns) for b in some.blocks] == [
        ("one", range(0, 2)),
        ("three", range(2, 5)),
    ]
    pairs = zip([(0,), (1,), (0, 1)], [(0,), (3,), (0, 3)], strict=True)
    for own, given in pairs:
        (here,), (there,) = some.proposals([own]), columns.proposals([given])
        np.testing.assert_allclose(here.strengths[0], there.strengths[0])
        np.testing.assert_allclose(here.squares, there.squares)
        raw = (
            here.evidence + sum(some.penalty[list(own)]),
            there.evidence + sum(columns.penalty[list(given)]),
        )
        assert raw[0] == pytest.approx(raw[1])
    # Of fewer effects, less counts against each.
    assert some.penalty[0] < columns.penalty[0]


@pytest.mark.parametrize("forms", [1, 3])
def test_orthogonal_effects_are_as_many_directions(forms: int) -> None:
    """Whatever their sizes are, and however many forms an effect has."""
    rng = np.random.default_rng(9)
    basis = np.linalg.qr(rng.standard_normal((40, 5)))[0]
    effect = np.repeat(np.arange(5), forms)
    sizes = rng.uniform(0.1, 10.0, len(effect))
    one = basis[:, effect] * sizes
    nothing = np.zeros((30, len(effect)))
    few = np.where(effect < 2, 1.0, 0.0) * basis[:, effect]
    blocks = [(str(name), 1) for name in effect]
    rests = [np.ones(40), np.ones(30), np.ones(40)]
    columns = columns_of([one, nothing, few], rests, blocks)
    np.testing.assert_allclose(columns.directions(), [5.0, 1.0, 2.0])
    alike = np.repeat(basis[:, :1], len(effect), axis=1)
    np.testing.assert_allclose(columns_of([alike], rests[:1], blocks).directions(), [1.0])


# --- sets --------------------------------------------------------------------------------


def ranks(ranked: Sequence[Proposal], columns: Columns) -> list[frozenset[str]]:
    return [names_of(columns, p) for p in ranked]


def test_a_pair_is_found_whose_second_effect_alone_explains_nothing() -> None:
    """What it does is hidden by the first: beside that it shows."""
    rng = np.random.default_rng(10)
    count, rows = 40, 400
    x = rng.standard_normal((rows, count))
    x /= np.linalg.norm(x, axis=0)
    # The two look alike, and have opposite signs.
    x[:, 1] = 0.8 * x[:, 0] + 0.6 * x[:, 1]
    x *= 20.0
    noise = rng.standard_normal(rows)
    overlap = float(x[:, 0] @ x[:, 1])
    strengths = np.zeros(count)
    strengths[0] = 2.0
    strengths[1] = (float(x[:, 1] @ noise) - 2.0 * overlap) / float(x[:, 1] @ x[:, 1])
    blocks = [(str(i), 1) for i in range(count)]
    columns = columns_of([x], [noise - x @ strengths], blocks, draws=1e6)
    alone, pairs, _ = best_sets(columns, 3)
    ranked = ranks(alone, columns)
    assert ranked[0] == {"0"} and ranked.index(frozenset({"1"})) > 20
    assert names_of(columns, pairs[0]) == {"0", "1"}
    assert pairs[0].evidence > alone[0].evidence + 50.0 > 50.0
    found = dict(zip(pairs[0].forms, pairs[0].strengths, strict=True))
    assert [float(found[i][0]) for i in (0, 1)] == pytest.approx(list(strengths[:2]), abs=0.2)


def test_of_three_effects_all_are_found_in_their_forms() -> None:
    """Each with the form that is best beside the others."""
    rng = np.random.default_rng(11)
    effects, forms, rows = 12, 4, 300
    x = rng.standard_normal((rows, effects * forms))
    for effect in range(effects):
        own = slice(effect * forms, (effect + 1) * forms)
        x[:, own] += 3.0 * rng.standard_normal((rows, 1))
    strengths = np.zeros(effects * forms)
    true = (2 * forms + 1, 5 * forms + 3, 9 * forms)
    strengths[list(true)] = 1.0, -0.6, 0.4
    rest = rng.standard_normal(rows) - x @ strengths
    blocks = [(str(i // forms), 1) for i in range(effects * forms)]
    columns = columns_of([x], [rest], blocks, draws=1e6)
    by_size = best_sets(columns, 3)
    assert [len(p.forms) for p in (ranked[0] for ranked in by_size)] == [1, 2, 3]
    assert set(by_size[2][0].forms) == set(true)
    assert by_size[0][0].evidence < by_size[1][0].evidence < by_size[2][0].evidence
    for ranked in by_size:
        assert [p.evidence for p in ranked] == sorted((p.evidence for p in ranked), reverse=True)
        names = ranks(ranked, columns)
        assert len(set(names)) == len(names)


def test_forms_of_one_effect_or_of_one_state_are_never_combined() -> None:
    """However well they would explain it together."""
    rng = np.random.default_rng(12)
    strengths = np.array([2.0, 2.0, 2.0, 2.0, 0.1, 0.1])
    parts, rests = random_parts(rng, strengths)
    names = ["one", "one", "lag", "delay", "drag", "spring"]
    claims = [frozenset[str]()] * 2 + [frozenset({"state"})] * 2 + [frozenset[str]()] * 2
    columns = columns_of(parts, rests, [(n, 1) for n in names], draws=1e6, claims=claims)
    together = columns.proposals([(0, 1), (2, 3)])
    found = [p for ranked in best_sets(columns, 3) for p in ranked]
    assert any(len(p.forms) == 3 for p in found)
    for proposal in found:
        assert len(names_of(columns, proposal)) == len(proposal.forms)
        assert not {"lag", "delay"} <= names_of(columns, proposal)
    pairs = [p for p in found if len(p.forms) == 2]
    assert {names_of(columns, p) for p in pairs} >= {frozenset({"one", "lag"})}
    assert all(p.evidence > 0.0 for p in together)  # it is not that they explain nothing


def test_no_more_effects_are_proposed_than_may_be() -> None:
    rng = np.random.default_rng(13)
    parts, rests = random_parts(rng, np.array([1.0, 1.0, 1.0]))
    columns = columns_of(parts, rests, [("one", 1), ("two", 1), ("three", 1)])
    for most in (1, 2):
        by_size = best_sets(columns, most)
        assert len(by_size) == most
        assert {len(p.forms) for p in by_size[-1]} == {most}
