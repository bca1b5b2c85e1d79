"""The sets of effects that explain a residual best: leaders, then pairs, then triples."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from sysid.diagnosis.actuator.columns import Columns, Proposal

# Effects that alone explain most, with each of which every form is tried; and the sets to which a
# further one is added. The true pair came first where its second effect ranked 10th alone.
_LEADERS, _LONGER = 20, 5
_SETTLING = 2


def best_sets(columns: Columns, most: int) -> list[list[Proposal]]:
    """By size, from one effect to `most`: of every set the best forms, the best set first."""
    alone = [(f,) for f in range(len(columns.blocks))]
    found = [_best_by_effects(columns, columns.proposals(alone))]
    leaders: Sequence[Proposal] = found[0][:_LEADERS]
    while len(found) < most:
        longer = [
            (*some.forms, f)
            for some in leaders
            for f in range(len(columns.blocks))
            if _go_together(columns, (*some.forms, f))
        ]
        best = _best_by_effects(columns, columns.proposals(longer))
        settled = [_settled(columns, some) for some in best[:_LONGER]]
        found.append(_best_by_effects(columns, [*settled, *best[_LONGER:]]))
        leaders = found[-1][:_LONGER]
    return found


def names_of(columns: Columns, proposal: Proposal) -> frozenset[str]:
    """The effects of a set."""
    return frozenset(columns.blocks[f].name for f in proposal.forms)


def _go_together(columns: Columns, forms: Sequence[int]) -> bool:
    """Whether no two of these forms are of one effect, or claim the same."""
    blocks = [columns.blocks[f] for f in forms]
    claims = [claim for block in blocks for claim in (block.name, *block.claims)]
    return len(set(claims)) == len(claims)


def _settled(columns: Columns, proposal: Proposal) -> Proposal:
    """The set with each of its effects in the form that is best together with the others."""
    for _ in range(_SETTLING):
        before = proposal
        for place, form in enumerate(proposal.forms):
            own = [f for f, b in enumerate(columns.blocks) if b.name == columns.blocks[form].name]
            tried = [(*proposal.forms[:place], f, *proposal.forms[place + 1 :]) for f in own]
            proposal = max(columns.proposals(tried), key=lambda p: p.evidence)
        if proposal.forms == before.forms:
            break
    return proposal


def _best_by_effects(columns: Columns, proposals: Iterable[Proposal]) -> list[Proposal]:
    """Of every set of effects the best forms, the best set first."""
    best: dict[frozenset[str], Proposal] = {}
    for one in proposals:
        names = names_of(columns, one)
        if names not in best or one.evidence > best[names].evidence:
            best[names] = one
    return sorted(best.values(), key=lambda p: -p.evidence)


__all__ = ["best_sets", "names_of"]
