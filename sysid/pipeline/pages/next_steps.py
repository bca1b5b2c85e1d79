"""What to do next: the tests that would distinguish rivals, and what lacks information."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sysid.blocks.numbers import MISSING, number, span
from sysid.blocks.sections import Block, Fold, Lines, Said, Section
from sysid.blocks.tables import table
from sysid.blocks.titles import capital, within
from sysid.diagnosis.tables import named
from sysid.diagnosis.wording import advice_on_rest, effect_name, is_of_actuator, joined
from sysid.io.channels import channel_of
from sysid.io.motion import FRICTION
from sysid.parameters import Bundle
from sysid.parameters.table import effect_names, in_words
from sysid.parameters.titles import named as named_number
from sysid.parameters.titles import title_of
from sysid.pipeline.pages.opening import unidentified

if TYPE_CHECKING:
    from sysid.plant.effects.entry import Quantity

Content = Mapping[str, Any]
Moves = Callable[[], Mapping[str, float]]
"""By how much each fitted number's standard error moves the simulated position, rad or m RMS."""

# Half-width of a 95 % interval, as a share of the value, from which another test is worthwhile.
_WIDE = 0.25
# Share of the held-out squares from which a number's error is worth a test.
_MATTERS = 0.1
_MOST_TESTS = 5
# Correlation from which two errors are called hard to distinguish. A rival effect below it has its
# test in the table of rivals.
_TIED = 0.5
_MORE = "more tests like those it was read from"


def next_section(
    bundle: Bundle,
    diagnosis: Content | None,
    campaign: str,
    advice: Content | None = None,
    moves: Moves = dict,
    rmse: float | None = None,
) -> Section | None:
    """The section on next steps, from what was found.

    `campaign` is its file's name, `advice` what `sysid advise --json` prints, `moves` is asked
    where parameters have to be ordered, `rmse` is the held-out one of the position, rad or m. None
    without next steps.
    """
    found = _diagnosed(diagnosis)
    blocks: list[Block] = []
    if found is not None:
        blocks += _rivals(found)
        said = advice_on_rest(found)
        blocks += [Lines(said)] if said else []
    if not bundle.rig.is_tank_alone:  # no other test of a tank gives what its discharge does not
        blocks += _lacking(bundle, moves, rmse)
    if advice is not None:
        blocks += _advised(advice)
    is_advised = is_of_actuator(found) and bundle.friction is not None and bundle.valves is not None
    if not blocks and not (found is not None and is_advised):
        return None
    intro = []
    if len(blocks) > 1:
        intro = ["Ordered by what they decide: which effect it is, what remains, how large it is."]
    elif not blocks:
        intro = ["No question is open: an effect too small for these tests may still be there."]
    if advice is not None:
        intro.append(
            "Predicted for this rig. To write such a test as a file that the rig can play: "
            f"`sysid advise {campaign} --bundle bundle.json -o next.csv`."
        )
    elif is_advised and campaign.endswith(".toml"):  # it asks for a campaign, not for a log
        intro.append(
            f"`sysid advise {campaign} --bundle bundle.json` predicts for this rig what each of a "
            "list of further tests would add, and the smallest size of every effect that they "
            "would show; `sysid run --advise` puts it here."
        )
    return Section("next", "What to do next", tuple(intro), tuple(blocks))


def advised_section(advice: Content) -> Section:
    """What `sysid advise --json` prints, a test to play too, as a section of its own."""
    tests, played = advice["tests"], advice.get("test")
    said = best_test(tests) if tests else "No test that this rig can do was found."
    blocks = [*([] if played is None else _played(played)), *_advised(advice), *_sizes(advice)]
    return Section("advice", "Which test to run next", (said,), tuple(blocks))


def next_line(
    bundle: Bundle,
    diagnosis: Content | None,
    advice: Content | None = None,
    moves: Moves = dict,
    rmse: float | None = None,
) -> str:
    """The step that most improves the model in a line; empty where none is known.

    Which effect it is comes first, then the test that adds most, then what is not identified, then
    the number whose error moves the simulated position most (`moves`), if that is not little
    against the held-out `rmse` of the position, rad or m.
    """
    if said := known_step(bundle, diagnosis, advice, lambda: bool(moves())):
        return said
    if bundle.rig.is_tank_alone:
        return ""
    found = _diagnosed(diagnosis)
    is_certain = not _mover(bundle, moves(), rmse)
    if found is not None and is_certain and (said := which_it_is(found)):
        return said
    none = "" if found is None else "No question is open."
    following = _most_moved(bundle, moves(), rmse) or none
    is_open = diagnosis is None and not bundle.effects and bundle.component is None
    if following and is_open and is_certain:
        return f"{following} What the model lacks, sysid diagnose finds."
    return following


def known_step(
    bundle: Bundle,
    diagnosis: Content | None,
    advice: Content | None,
    is_weighed: Callable[[], bool],
) -> str:
    """The step that the findings name, before the numbers are weighed by simulated motion; empty
    where they name none. `is_weighed` as in `lacking_line`."""
    found = _diagnosed(diagnosis)
    if found is not None and (said := which_it_is(found, is_testable=True)):
        return said
    rest = () if found is None else advice_on_rest(found)
    if rest:
        return rest[0]
    if advice is not None and advice["tests"]:
        return best_test(advice["tests"])
    return "" if bundle.rig.is_tank_alone else lacking_line(bundle, is_weighed=is_weighed())


def which_it_is(found: Content, *, is_testable: bool = False) -> str:
    """The first effect that the tests do not distinguish from others; empty where they do.

    `is_testable`: of those for which a test is known that would.
    """
    titles = found.get("figures", {}).get("titles", {})
    for effect in found["effects"]:
        if not effect["ambiguous_with"] or (is_testable and not effect["advice"]):
            continue
        names = [effect_name(id, titles) for id in (effect["id"], *effect["ambiguous_with"])]
        said = f"These tests do not say which it is: {'; '.join(names[:-1])}; or {names[-1]}."
        if not effect["advice"]:
            return f"{said} No test is known that would distinguish them."
        return f"{said} To distinguish them: {within(effect['advice'])}."
    return ""


def _diagnosed(diagnosis: Content | None) -> Content | None:
    """A diagnosis that came to a verdict."""
    return diagnosis if diagnosis is not None and "verdict" in diagnosis else None


def lacking_line(bundle: Bundle, *, is_weighed: bool) -> str:
    """The first number that lacks information; empty where none does. `is_weighed`: wide intervals
    are judged by what they do to the motion instead."""
    found = (*_missing(bundle), *(() if is_weighed else _wide(bundle)))
    if not found:
        return ""
    name, lacks, helps = found[0]
    about = [lacking for lacking, *_ in _unidentified(bundle) if lacking == name]
    return Said(f"{title_of(name)} ({lacks}): {helps}.", *about)


def best_test(tests: Sequence[Content]) -> str:
    """The test that lowers the error of simulated motion most, not that of all numbers alike."""
    best = _best_first(tests)[0]
    if not best.get("motion_gain"):
        return f"Record {best['test']}: standard errors {_smaller(best)} % smaller on average."
    return (
        f"Record {best['test']}. What the uncertainty of the parameters adds to the simulation's "
        f"error is then {_smaller(best, 'motion_gain')} % smaller."
    )


def _best_first(tests: Sequence[Content]) -> list[Content]:
    """By what each does for simulated motion; in their own order where none does anything."""
    return sorted(tests, key=lambda test: -(test.get("motion_gain") or 0.0))


def _most_moved(bundle: Bundle, moves: Mapping[str, float], rmse: float | None) -> str:
    """The number whose error moves the simulated position most, and whether that matters."""
    if not moves:
        return ""
    if found := _mover(bundle, moves, rmse):
        name, moved, helps = found
        return f"{title_of(name)}: {moved}: {helps}."
    return (
        f"No number is too uncertain: no standard error moves the simulated position by more than "
        f"{_shown(bundle, max(moves.values()))} (held-out RMSE {_shown(bundle, rmse or 0.0)}). "
        "More tests of these kinds would not lower that error."
    )


def _mover(
    bundle: Bundle, moves: Mapping[str, float], rmse: float | None
) -> tuple[str, str, str] | None:
    """That number with what its error does and what would help; None where it does little."""
    if not moves:
        return None
    name = max(moves, key=moves.__getitem__)
    moved = f"its standard error moves the simulated position by {_shown(bundle, moves[name])}"
    if rmse is None:
        return name, moved, _MORE
    if moves[name] ** 2 < _MATTERS * rmse**2:
        return None
    return name, f"{moved} (held-out RMSE {_shown(bundle, rmse)})", _MORE


def _shown(bundle: Bundle, position: float) -> str:
    key = "position_m" if bundle.is_linear else "theta_rad"
    channel = channel_of(key)
    return f"{number(channel.residual(position), 2)} {channel.residual_unit}"


def _advised(advice: Content) -> list[Block]:
    """The tests that say most, and those that would distinguish what is tied."""
    units = {p["name"]: (p["unit"], p["std_now"]) for p in advice["parameters"]}
    rows = []
    for test in _best_first(advice["tests"])[:_MOST_TESTS]:
        after = {
            name: std / units[name][1]
            for name, std in test["std_after"].items()
            if std is not None and units[name][1]
        }
        most = min(after, key=after.__getitem__, default=None)
        helped = "" if most is None else f"{title_of(most)}, by {_share(1.0 - after[most])} %"
        moved = _smaller(test, "motion_gain") if test.get("motion_gain") else MISSING
        rows.append((test["test"], moved, _smaller(test), helped))
    blocks: list[Block] = []
    if rows:
        columns = ("Test", "Simulated motion", "All parameters", "Most")
        caption = (
            "Tests that the rig could run next, the best for simulated motion first: by how many "
            "per cent each lowers the errors that the parameters' uncertainty causes in it, the "
            "standard errors on average, and that of one parameter"
        )
        blocks.append(table(caption, columns, rows, text=(0, 3)))
    ties = [
        (*map(named_number, tie["pair"]), number(tie["correlation_now"], 2),
         tie["test"] or "none of these")
        for tie in advice["ties"]
        if abs(tie["correlation_now"]) >= _TIED
    ]  # fmt: skip
    if ties:
        heads = ("One", "Other", "Correlation", "Test that lowers it most")
        caption = "Hard to distinguish in these tests, by the correlation of their errors"
        blocks.append(table(caption, heads, ties, text=(1, 3)))
    return blocks


def _played(test: Content) -> list[Block]:
    """What a test to play is, and what it is expected to tell."""
    rows = [
        (named_number(e["parameter"]), number(e["value"], 4), _digits(e["std_now"]),
         _digits(e["std_after"]), e["unit"])
        for e in test["expected"]
    ]  # fmt: skip
    count = test["tests"]
    parts = f"{count} part{'s' * (count > 1)}"
    caption = f"Expected of the test to play: {parts}, {test['duration_s']:g} s in all"
    heads = ("Parameter", "Value", "Standard error now", "After it", "Unit")
    return [table(caption, heads, rows, text=(4,))]


def _sizes(advice: Content) -> list[Block]:
    """The smallest size of each effect that would show, now and after the first of the tests."""
    sizes = advice["smallest_sizes"]
    if not sizes:
        return []
    first = next(iter(sizes[0]["after"]), None)
    heads = ["Effect, and what of it", "Usual size", "Would show now"]
    heads += [] if first is None else [f"After {first}"]
    rows = []
    for one in sizes:
        after = [] if first is None else [one["after"][first]]
        shown = map(_digits, (one["usual"], one["now"], *after))
        named_one = named_number(f"{one['effect']}.{one['strength']}")
        rows.append((named_one, *shown, one["unit"]))
    listed = table("", (*heads, "Unit"), rows, text=(len(heads),))
    return [Fold("The smallest size of each effect that these tests would show", (listed,))]


def _digits(value: float | None) -> str:
    return MISSING if value is None else number(value, 2)


def _smaller(test: Content, by: str = "gain") -> str:
    """By how much a test would lower the standard errors on average, per cent."""
    return _share(1.0 - math.exp(-test[by]))


def _share(part: float) -> str:
    """A share in per cent that is never all of it."""
    return f"{100.0 * part:.0f}" if part < 0.995 else "over 99"


def open_questions(diagnosis: Content | None, *, is_validated: bool) -> str:
    """What to do where a section is missing, since what was not examined may be open."""
    if not is_of_actuator(diagnosis):
        is_validated = True  # a part alone has no motion to be validated on
    runs = [] if is_validated else ["sysid validate"]
    if diagnosis is None:
        runs.append("sysid diagnose")
    if runs:
        return f"run {' and '.join(runs)}"
    if diagnosis is not None and "verdict" not in diagnosis:
        return "add the tests that the diagnosis needs"
    return "no open question"


def unfinished(bundle: Bundle, diagnosis: Content | None, *, is_validated: bool) -> str:
    """What has to be fitted, run or recorded before the model is judged; empty where it has been.

    A part of an actuator can be simulated along a motion only with the others.
    """
    rig, lacking = bundle.rig, []
    if is_of_actuator(diagnosis) and bundle.component is None and not rig.is_tank_alone:
        valves = {} if bundle.valves is None else bundle.valves.sides()
        if bundle.friction is None:
            lacking.append("friction")
        if not rig.is_motor_alone:
            lacking += [f"valve {s.upper()}" for s in rig.sides if s not in valves]
    if lacking:
        return (
            f"Fit {joined(lacking)} too, in a campaign (sysid run): a part alone cannot be "
            "simulated along a motion, by which the model is judged."
        )
    said = open_questions(diagnosis, is_validated=is_validated)
    return "" if said == "no open question" else f"{capital(said)}."


def _rivals(content: Content) -> list[Block]:
    """The effects that the data cannot distinguish, with the test that would."""
    telling = content["figures"].get("telling", {})
    rows = []
    for effect in content["effects"]:
        for rival in effect["ambiguous_with"]:
            tests = (effect["advice"] or telling.get(effect["id"], ""), telling.get(rival, ""))
            said = "; or ".join(dict.fromkeys(within(t) for t in tests if t))
            rows.append((named(content, effect["id"]), named(content, rival), said or "none known"))
    if not rows:
        return []
    columns = ("Effect", "Indistinguishable from", "Test that would distinguish them")
    return [table("Which of them it is", columns, rows, text=(1, 2))]


def _missing(bundle: Bundle) -> Iterator[tuple[str, str, str]]:
    yield from _unidentified(bundle)
    yield from _only_together(bundle)
    yield from _uninformed(bundle)


def _lacking(bundle: Bundle, moves: Moves, rmse: float | None) -> list[Block]:
    """What is not identified, then what moves the simulation most, then wide intervals."""
    wide = list(_wide(bundle))
    moved = moves()
    mover = _mover(bundle, moved, rmse)

    def moves_it(name: str) -> str:
        if name in moved:
            return f"; one standard error moves the position by {_shown(bundle, moved[name])}"
        return "; the simulated model has no such term" if moved else ""

    wide.sort(key=lambda row: -moved.get(row[0], 0.0))
    found = list(_missing(bundle))
    if mover is not None and all(mover[0] != name for name, *_ in (*found, *wide)):
        found.append(mover)
    found += [(n, f"{lacks}{moves_it(n)}", helps) for n, lacks, helps in wide]
    if not found:
        return []
    rows = [(named_number(name), lacks, helps) for name, lacks, helps in found]
    columns = ("Parameter", "What is missing", "What would help")
    return [table("Parameters that lack information", columns, rows, text=(1, 2))]


def _unidentified(bundle: Bundle) -> Iterator[tuple[str, str, str]]:
    for name, reason in unidentified(bundle):
        # A reason may end with its fix, "only a + b is identified: give ...", or be the fix alone.
        why, _, fix = f": {in_words(reason)}".partition(": give ")
        yield name, f"not identified{why}", fix or "a test that moves it alone"


def _only_together(bundle: Bundle) -> Iterator[tuple[str, str, str]]:
    if bundle.friction is not None:
        for name, row in bundle.friction.sums().items():
            yield name, "identified only together", row.test


def _uninformed(bundle: Bundle) -> Iterator[tuple[str, str, str]]:
    """Parameters that neither motion nor any bench test identifies."""
    part = bundle.refinement
    for value in [] if part is None else part.values():
        std = value.after.std
        if not value.informed_by_motion and (std is None or not math.isfinite(std)):
            yield value.name, "neither bench tests nor motion determine it", "a test of its own"


def _wide(bundle: Bundle) -> Iterator[tuple[str, str, str]]:
    """Parameters whose interval is wide against their value."""
    positive = _positive(bundle)
    for row in bundle.parameters.rows:
        if row.origin not in ("friction", "effect") or row.status != "fitted":
            continue
        name, estimate = row.alias, row.estimate
        low, high = estimate.interval
        if not estimate.identified or not (math.isfinite(low) and math.isfinite(high)):
            continue
        half = 0.5 * (high - low)
        # A quantity of either sign, such as an offset, is not wide merely because it is close to 0.
        size = max(abs(estimate.value), positive.get(name, 0.0))
        if half <= _WIDE * size or (low * high <= 0.0 and name not in positive):
            continue
        if low * high > 0.0:
            wide = f"± {number(100.0 * half / abs(estimate.value), 2)} %"
        else:
            wide = span(low, high, 2)
            wide += f" {estimate.unit}" if estimate.unit not in ("", "-") else ""
        yield name, f"95 % interval of {wide}", _MORE


def _positive(bundle: Bundle) -> dict[str, float]:
    """The parameters that cannot be below 0, and the size at which one matters.

    An effect's quantity has its typical one, or its whole range; others have 0: their own value.
    For a user's own effect it is unknown.
    """
    found = {f"friction.{bundle.units.key(name)}": 0.0 for name in FRICTION}
    if not bundle.effects:
        return found
    from sysid.plant.effects.catalogue import catalogue
    from sysid.plant.effects.linear import for_rig

    known = for_rig(catalogue(), bundle.is_linear)
    for name, entry in zip(effect_names(bundle.effects), bundle.effects, strict=True):
        if entry.id in known:
            sizes = known[entry.id].quantities
            found |= {f"{name}.{q.label}": _size(q) for q in sizes if q.lower >= 0.0}
    return found


def _size(quantity: Quantity) -> float:
    reach = quantity.upper - quantity.lower
    return quantity.typical or (reach if math.isfinite(reach) else 0.0)


__all__ = [
    "advised_section",
    "known_step",
    "next_line",
    "next_section",
    "open_questions",
    "which_it_is",
]
