"""Advice on the next test: errors now and after each test, ties, detectable sizes of effects."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sysid.blocks.numbers import number
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, table
from sysid.estimation.linear import finite_or_none
from sysid.refinement.candidates import CandidateMotion
from sysid.refinement.unknowns import Unknown
from sysid.types import FloatArray


@dataclass(frozen=True)
class CandidateTest:
    """A test that could be run: its log kind, what it is, `duration` s in all.

    `std` (p,) expected standard errors after it, in the parameters' units; `gain` the mean over
    the parameters of log(standard error now / after), `motion_gain` the log of how much less the
    parameters' errors then move the simulation of motion tests (RMS, in the sensors' noise), None
    without motion tests. `motion` are the commands of a motion test.
    """

    kind: str
    text: str
    duration: float
    std: FloatArray
    gain: float
    motion: CandidateMotion | None = None
    motion_gain: float | None = None

    @property
    def name(self) -> str:
        """The test in a line."""
        return f"{self.kind}: {self.text}, {self.duration:g} s"


@dataclass(frozen=True)
class Tie:
    """Two parameters, or effects, whose errors are correlated: their correlation `now`.

    `test` is the candidate that lowers it most, None where none does; `after` with that test.
    """

    one: str
    other: str
    now: float
    test: str | None
    after: float


@dataclass(frozen=True)
class EffectSize:
    """The smallest detectable strength of an effect `now`, and `after` each of some tests.

    In `unit`; `typical` is the catalogue's usual size; infinite where no size is detectable.
    """

    effect: str
    strength: str
    unit: str
    typical: float
    now: float
    after: tuple[float, ...]


@dataclass(frozen=True, repr=False)
class AdviceResult(Shown):
    """Which test to run next.

    `now` (p,) standard errors of the parameters with the campaign at hand; `candidates` the best
    first; `sizes` with each of `size_tests`; `skipped` effects without a size, and why;
    `threshold` is the size in standard errors of the strength.
    """

    parameters: tuple[Unknown, ...]
    now: FloatArray
    candidates: tuple[CandidateTest, ...]
    ties: tuple[Tie, ...]
    sizes: tuple[EffectSize, ...]
    size_tests: tuple[str, ...]
    skipped: Mapping[str, str]
    threshold: float
    notices: tuple[str, ...] = ()

    def headline(self) -> str:
        """The best test in one sentence."""
        if not self.candidates:
            return "no test that this rig can do was found"
        best = self.candidates[0]
        less = 100.0 * (1.0 - math.exp(-best.gain))
        return f"run next: {best.name} (standard errors {less:.0f} % smaller on average)"

    def best_for(self, number_of: int) -> CandidateTest | None:
        """The test after which one parameter's standard error is smallest; None if none helps."""
        best = min(self.candidates, key=lambda c: float(c.std[number_of]), default=None)
        helps = best is not None and best.std[number_of] < 0.99 * self.now[number_of]
        return best if helps else None

    def records(self) -> Sequence[Mapping[str, Any]]:
        """One record per test and parameter: standard error now and after."""
        return [
            {
                "test": c.name,
                "kind": c.kind,
                "duration_s": c.duration,
                "gain": c.gain,
                "parameter": p.name,
                "std_now": float(self.now[i]),
                "std_after": float(c.std[i]),
                "unit": p.unit,
            }
            for c in self.candidates
            for i, p in enumerate(self.parameters)
        ]

    def tables(self) -> Iterable[Table]:
        """Tests, the best first; parameters; ties; sizes of effects."""
        yield self._tests_table()
        yield self._parameters_table()
        ties = tuple(
            (t.one, t.other, number(t.now, 3), t.test or "no test here", number(t.after, 3))
            for t in self.ties
        )
        head = ("one", "other", "correlation", "test that lowers it most", "then")
        yield table("Hard to distinguish", head, ties)
        yield self._sizes_table()

    def _tests_table(self) -> Table:
        rows = tuple(
            (
                str(i),
                c.kind,
                c.text,
                f"{c.duration:g}",
                f"{100.0 * (1.0 - math.exp(-c.gain)):.0f}",
                self._most(c),
            )
            for i, c in enumerate(self.candidates, start=1)
        )
        head = ("", "kind", "test", "s", "std. errors smaller by, %", "most")
        return table("Tests that could be run next, the best first", head, rows)

    def _most(self, candidate: CandidateTest) -> str:
        """The parameter whose error the test lowers most."""
        if not len(self.now):
            return ""
        ratio = [_ratio(float(a), float(n)) for a, n in zip(candidate.std, self.now, strict=True)]
        at = min(range(len(ratio)), key=ratio.__getitem__)
        return f"{self.parameters[at].name} by {100.0 * (1.0 - ratio[at]):.0f} %"

    def _parameters_table(self) -> Table:
        shown = self.candidates[:3]
        rows = []
        for i, p in enumerate(self.parameters):
            best = self.best_for(i)
            after = (number(float(c.std[i]), 2) for c in shown)
            least = number(float(best.std[i]), 2) if best else "-"
            row = (p.name, number(p.value, 4), number(float(self.now[i]), 2), *after)
            rows.append((*row, p.unit, least, best.name if best else "none helps"))
        after_heads = (f"after {i}" for i in range(1, len(shown) + 1))
        head = ("parameter", "value", "std. error now", *after_heads, "unit", "best", "by")
        return table("Expected standard errors", head, tuple(rows))

    def _sizes_table(self) -> Table:
        rows = tuple(
            (
                s.effect,
                s.strength,
                number(s.typical, 2),
                number(s.now, 2),
                *(number(a, 2) for a in s.after),
                s.unit,
            )
            for s in self.sizes
        )
        numbers = [i for i, c in enumerate(self.candidates, 1) if c.name in self.size_tests]
        head = ("effect", "strength", "usual", "now", *(f"after {i}" for i in numbers), "unit")
        return table("Smallest size of an effect that would show", head, rows)

    def footnotes(self) -> Iterable[str]:
        """What the sizes mean, the effects skipped, and the notices."""
        if self.sizes:
            yield (
                f"sizes: {self.threshold:.1f} standard errors of the strength, with all parameters "
                "estimated together with it and no other model error"
            )
        for reason in dict.fromkeys(self.skipped.values()):
            names = ", ".join(i for i, r in self.skipped.items() if r == reason)
            yield f"sizes, omitted ({reason}): {names}"
        yield from super().footnotes()

    def to_json(self) -> dict[str, Any]:
        """The object that `sysid advise --json` prints; null for infinite."""
        return {
            "parameters": [
                {
                    "name": p.name,
                    "value": p.value,
                    "unit": p.unit,
                    "std_now": finite_or_none(float(self.now[i])),
                    "best_test": best.name if (best := self.best_for(i)) else None,
                }
                for i, p in enumerate(self.parameters)
            ],
            "tests": [
                {
                    "kind": c.kind,
                    "test": c.name,
                    "duration_s": c.duration,
                    "gain": c.gain,
                    "motion_gain": c.motion_gain,
                    "std_after": {
                        p.name: finite_or_none(float(s))
                        for p, s in zip(self.parameters, c.std, strict=True)
                    },
                }
                for c in self.candidates
            ],
            "ties": [
                {
                    "pair": [t.one, t.other],
                    "correlation_now": t.now,
                    "test": t.test,
                    "correlation_after": t.after,
                }
                for t in self.ties
            ],
            "smallest_sizes": [
                {
                    "effect": s.effect,
                    "strength": s.strength,
                    "unit": s.unit,
                    "usual": s.typical,
                    "now": finite_or_none(s.now),
                    "after": {
                        name: finite_or_none(a)
                        for name, a in zip(self.size_tests, s.after, strict=True)
                    },
                }
                for s in self.sizes
            ],
            "skipped_effects": dict(self.skipped),
            "threshold_std": self.threshold,
            "notices": list(self.notices),
        }


def _ratio(after: float, now: float) -> float:
    return after / now if math.isfinite(now) else float(not math.isfinite(after))


__all__ = ["AdviceResult", "CandidateTest", "EffectSize", "Tie"]
