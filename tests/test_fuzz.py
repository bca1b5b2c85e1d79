"""Mutated inputs (`benchmarks/fuzz.py`, which runs 10,000): a sample of them each time."""

from __future__ import annotations

import pytest

from benchmarks import fuzz

# The command itself silences the warnings of others; here they would be errors.
pytestmark = pytest.mark.filterwarnings("ignore")
SEED = 15
SHARES = 10
CASES = 160


@pytest.fixture(scope="module")
def corpus() -> fuzz.Corpus:
    return fuzz.Corpus.read()


@pytest.mark.parametrize("share", range(SHARES))
def test_mutated_inputs(share: int, corpus: fuzz.Corpus, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit 0, 2 or 3, one line of error, whole and finite results; nothing hangs."""
    monkeypatch.setenv("SYSID_JOBS", "1")
    failed = [
        f"python benchmarks/fuzz.py --seed {SEED} --case {number}: {', '.join(outcome.faults)}"
        for number in range(share, CASES, SHARES)
        if (outcome := fuzz.run(corpus, SEED, number)).faults
    ]
    assert not failed, "\n".join(failed)
