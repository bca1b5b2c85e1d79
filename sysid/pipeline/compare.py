"""Bundles compared with each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from sysid.fleet.comparison import Comparison, compare_bundles
from sysid.parameters import Bundle


def compare(*bundles: Bundle) -> Comparison:
    """Parameters of at least two bundles side by side, and what moved against the first.

    `moved` are the parameters that moved by more than the standard errors of both explain, the
    false discovery rate being 5 % over the whole comparison; `effects` says which appeared,
    disappeared, grew or shrank. Raises InputError for fewer than two bundles, for rotary and
    linear rigs together, and for bundles that have no part in common.

    >>> si.write_bundle(bundle, "fitted.json")
    >>> si.compare(bundle, si.read_bundle("fitted.json")).moved
    ()
    """
    return compare_bundles(bundles, shown_names([bundle.source for bundle in bundles]))


def shown_names(sources: Sequence[str]) -> list[str]:
    """Names that distinguish files: their own, with folders where needed, numbered if the same."""
    paths = [Path(source) for source in sources]
    for length in range(1, max((len(p.parts) for p in paths), default=1) + 1):
        names = ["/".join(p.parts[-length:]) for p in paths]
        if len(set(names)) == len(names):
            return names
    seen: Counter[str] = Counter()
    names = []
    for source in sources:
        seen[source] += 1
        names.append(source if seen[source] == 1 else f"{source} ({seen[source]})")
    return names


__all__ = ["compare", "shown_names"]
