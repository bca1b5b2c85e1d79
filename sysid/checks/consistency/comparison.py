"""Which readings of a quantity disagree, and which log or rig file stands alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sysid.checks.consistency.quantities import RIG, Reading

# Ratios closer than that come from one slip.
_ONE_SLIP = 1.15


@dataclass(frozen=True)
class Contradiction:
    """A notice, and the log (or the rig file) that it is about first."""

    source: str
    line: str


def disagreements(readings: Sequence[Reading]) -> Iterator[Contradiction]:
    """One notice for every slip that sets readings of a quantity apart from most of them.

    The largest group that agrees is the reference, the rig file's value among it where two groups
    are equal. Readings that are apart from it by the same factor, all of one log or all by the same
    means, share a notice.
    """
    groups = [_agreeing(one, readings) for one in readings]
    best = max(groups, key=lambda group: (len(group), _has_rig(group)), default=[])
    apart = [one for one in readings if 2 * sum(differ(one, o) for o in best) > len(best)]
    if not apart:
        return
    reference = min(best, key=lambda one: (one.source == RIG and len(best) > 1, _spread(one)))
    while apart:
        together = _of_one_slip(apart, reference)
        apart = [one for one in apart if one not in together]
        yield Contradiction(together[0].source, _line(together, reference))


def _agreeing(one: Reading, readings: Sequence[Reading]) -> list[Reading]:
    """Readings that all agree with each other, starting with the nearest to this one."""
    group: list[Reading] = []
    for other in sorted(readings, key=lambda r: ratio_of(one, r)):
        if not any(differ(other, member) for member in group):
            group.append(other)
    return group


def differ(one: Reading, other: Reading) -> bool:
    """Whether two readings differ significantly and by a large factor (or in sign)."""
    if one.low <= other.high and other.low <= one.high:
        return False
    return ratio_of(one, other) > one.quantity.large


def ratio_of(one: Reading, other: Reading) -> float:
    """Larger over smaller value; infinite where they differ in sign."""
    if one.value * other.value <= 0.0:
        return math.inf
    ratio = one.value / other.value
    return max(ratio, 1.0 / ratio)


def _has_rig(group: Sequence[Reading]) -> bool:
    return any(one.source == RIG for one in group)


def _spread(one: Reading) -> float:
    return (one.high - one.low) / abs(one.value) if one.value else math.inf


def _of_one_slip(apart: Sequence[Reading], reference: Reading) -> list[Reading]:
    """The first reading, and those of its log, or else by its means, that are as far apart."""
    first = apart[0]
    alike = [one for one in apart if ratio_of(one, first) < _ONE_SLIP]
    own = [one for one in alike if one.source == first.source]
    if len(own) > 1:
        return own
    return [one for one in alike if one.by == first.by and one.source != RIG] or [first]


def _line(apart: Sequence[Reading], reference: Reading) -> str:
    one, quantity = apart[0], reference.quantity
    sources = list(dict.fromkeys(other.source for other in apart[1:]))
    same_log = len(apart) > 1 and sources == [one.source]
    others = "" if same_log or not sources else f" (and likewise {', '.join(sources)})"
    words = [] if same_log else [one.slips]
    if same_log or (len(apart) == 1 and one.source != RIG):
        words.append(quantity.slips)
    slips = _filled("; ".join(filter(None, words)) or quantity.slips, one, reference)
    if reference.slips:
        slips = f"{slips}; {_filled(reference.slips, reference, one)}"
    title = one.source if same_log else one.title
    ratio = ratio_of(one, reference)
    if math.isinf(ratio):
        return (
            f"{title}{others}: {quantity.name} is {one.shown}, but {reference.title} gives "
            f"{reference.shown}: the signs differ, or one is zero; a command or a sign is swapped "
            "or inverted in one of the two; check them against each other"
        )
    return (
        f"{title}{others}: {quantity.name} is {one.shown}, but {reference.title} gives "
        f"{reference.shown}, a factor of {ratio:.3g}: either a slip ({slips}) "
        f"or an effect that the diagnosis tests ({quantity.effects}); check the two against "
        "each other"
    )


def _filled(slips: str, one: Reading, reference: Reading) -> str:
    ratio = one.value / reference.value if reference.value else math.inf
    if not 0.0 < ratio < math.inf:
        return slips.format(ratio="any factor", inverse="any factor", time="any factor")
    return slips.format(
        ratio=f"{ratio:.3g}",
        inverse=f"{1.0 / ratio:.3g}",
        time=f"{ratio ** (1.0 / one.quantity.power):.3g}",
    )


__all__ = ["Contradiction", "differ", "disagreements", "ratio_of"]
