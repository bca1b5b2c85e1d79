"""A diagnosis in words, for the report and for the summary of `sysid diagnose`.

Everything is read from the dict that `sysid.diagnosis.content.content` makes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from sysid.blocks.numbers import number, percent, span
from sysid.blocks.titles import capital, within
from sysid.diagnosis.lack_of_fit import MISFIT
from sysid.diagnosis.search_record import QUICK, stage_text
from sysid.estimation.linear import Estimate
from sysid.io.channels import CHAMBER_PRESSURES, SIDES, VELOCITY_CHANNELS, channel_of
from sysid.io.own_channels import Own, channel_in, error_unit, in_words

Content = Mapping[str, Any]

ACTUATOR = "actuator"
"""A diagnosis' component that is no part alone."""
CORRECT_MODEL = "Correct model"
"""Heads the errors that a correct model would have: noise, and the tests' own scatter."""
SMALLEST_P = 1e-20
"""P-values extrapolate from a few twins: below this their size means nothing."""
# Up to this share of a residual, a dependence leaves most of it to be said.
_LITTLE = 0.1
# What of a residual depends on nothing that was logged, by its key in a remainder.
_REST = {"scatter": "differs from test to test", "noise": "is noise"}
_REGRESSORS = {
    "velocity": "velocity",
    "angle": "position",
    "pressure_a": "pressure A",
    "pressure_b": "pressure B",
    "time": "time",
    "acceleration": "acceleration",
    "motor": "motor command",
    "pressure_sum times direction": "absolute pressure sum times direction",
    "gauge_pressure_sum times direction": "gauge pressure sum times direction",
    "angle times direction": "position times direction",
    "pressure_difference": "pressure difference",
    "pressure_rate": "pressure rate",
    "valve_opening": "valve opening",
    "duty_a": "duty",
    "flow_a_kg_s": "flow",
    "pressure_a_pa": "pressure",
    "rest": "rest before",
}


def is_of_actuator(content: Content | None) -> bool:
    """Whether a diagnosis' content is of a whole actuator, as without any; else of a part alone."""
    return content is None or content.get("component", ACTUATOR) == ACTUATOR


def own_of(content: Content | None) -> Own:
    """The units by name of the columns of a user's own component, of a diagnosis' content or of
    what is drawn; of others empty."""
    found = (content or {}).get("own", (content or {}).get("figures", {}).get("own"))
    return found if isinstance(found, Mapping) else {}


def is_cross_validated(content: Content) -> bool:
    """Whether the errors are of training tests, each excluded from the fit in turn."""
    return content.get("judged_on") == "fit"


def judged_use(content: Content) -> str:
    """The tests that the errors are of, in two words."""
    return "training tests" if is_cross_validated(content) else "held-out tests"


def judged_tests(content: Content) -> str:
    """The tests that the errors are of, and how those of training tests are such of predictions."""
    how = ", each excluded from the fit in turn" if is_cross_validated(content) else ""
    return f"{judged_use(content)}{how}"


def sentence(content: Content, titles: Mapping[str, str] | None = None) -> str:
    """The verdict in one sentence, and a second one where the search did not end.

    Effects by their ids, or by the `titles` that are given.
    """
    return f"{_verdict(content, titles or {})}{_incomplete(content)}"


def effect_name(id: str, titles: Mapping[str, str]) -> str:
    """An effect within a sentence: by its title, else by its id."""
    return within(titles.get(id, id))


def _incomplete(content: Content) -> str:
    """The stages that a search did not come to the end of; empty where it did."""
    missed = content.get("search", {}).get("missed", [])
    stages = list(dict.fromkeys(stage_text(e["stage"], e.get("round")) for e in missed))
    if not stages:
        return ""
    lead = "Not done: " if content["verdict"] == "incomplete" else "The search did not complete "
    return f" {lead}{joined(stages)}."


def _is_undecided(content: Content) -> bool:
    """Whether something was missed on which the verdict depends."""
    missed = content.get("search", {}).get("missed", [])
    return any(entry.get("decides", True) for entry in missed)


def _verdict(content: Content, titles: Mapping[str, str]) -> str:
    ids = [effect_name(effect["id"], titles) for effect in content["effects"]]
    change = f"; {_error_change(content)}" if content["residual"] else ""
    if content["verdict"] == "adequate":
        return f"Adequate: no test found structure above the noise{change}."
    if content["verdict"] == "effects-found":
        return f"Effects found: {joined(ids)}{change}."
    if content["verdict"] == "incomplete":
        so_far = f"effects so far: {joined(ids)}" if ids else "no effect found so far"
        return f"Incomplete: the budget ended before the search did; {so_far}{change}."
    helped = f"; {_help(content)}: {joined(ids)}" if ids else ""
    return f"Unexplained: {_remaining(content)}{helped}{change}."


def _help(content: Content) -> str:
    """Whether the effects help, to a tenth, on the held-out tests, where there are any."""
    errors = content["residual"].values()
    if errors and not any(e["after"] < _GROWN * e["before"] for e in errors):
        return "of help on the training tests alone"
    return "of help"


def _error_change(content: Content) -> str:
    """Held-out errors before and after: the position's, the one that falls most, those that grow.

    Empty where nothing is held out.
    """
    errors = content["residual"]
    if not errors:
        return ""
    position = next((n for n in errors if n in VELOCITY_CHANNELS), next(iter(errors)))
    falls = {name: e["before"] / max(e["after"], 1e-300) for name, e in errors.items()}
    named = [position]
    if content["effects"] and max(falls.values()) > falls[position]:
        named.append(max(falls, key=lambda name: falls[name]))
    if content["effects"]:
        named += [name for name, fall in falls.items() if fall < _GROWN and name not in named]
    said = []
    for name in named:
        sizes = _sizes(content, name)
        said.append(f"{channel_in(name, own_of(content)).name} {sizes}")
    return f"errors on {judged_tests(content)}: {joined(said)}"


def _sizes(content: Content, name: str) -> str:
    """A channel's errors with their unit: "from 107 to 15.1 mrad (a correct model: 10.2)"."""
    channel, errors = channel_in(name, own_of(content)), content["residual"][name]
    kept = [errors[k] for k in ("before", "after", "noise_floor")]
    unit, scale = error_unit(channel, is_alone=not is_of_actuator(content))
    before, after, floor = (None if e is None else scale * e for e in kept)
    change = f"from {span(before, after)}" if content["effects"] else number(before)
    correct = f"(a correct model: {floor_text(floor, after)})"
    return " ".join(filter(None, (change, unit, correct)))


def floor_text(floor: float | None, after: float | None) -> str:
    """A correct model's error next to the one after the effects, which it may be far below."""
    if floor is not None and after is not None and 0.0 < floor < LEAST_SHOWN * after:
        return f"less than {number(LEAST_SHOWN * after, 1)}"
    return number(floor)


LEAST_SHOWN = 1e-3
"""The share of a residual's variance, or of an error, below which a number of it is not shown."""
# Before over after, below which an error has grown by a tenth; after over before, has fallen.
_GROWN = 1.0 / 1.1
# Verdicts of a search that came to its end and left nothing unexplained.
_ENDED = ("adequate", "effects-found")
_NO_STRUCTURE = {
    "held-out errors": (
        "the errors on {tests} are far above those of a correct model, and no residual of the "
        "training tests shows why"
    ),
    "unfinished search": "the search did not come to its end, and may have missed an effect",
    "one recording": "one recording cannot tell what the law lacks",
}


def _remaining(content: Content) -> str:
    """The remaining structure by balance; if none counts, the reason, and what is largest."""
    other = _NO_STRUCTURE.get(content.get("because") or "", "")
    other = other.replace("{tests}", judged_use(content))
    said = (
        "the residual of {0} depends most on {1} ({2} of its variance)"
        if other
        else "structure remains in {0}, strongest over {1} ({2} of the residual's variance)"
    )
    found = []
    for entry in content["unexplained"]:
        share, own = entry["share"], own_of(content)
        balance = balance_of(entry["channel"], own)
        if share is None or (other and not _is_predicted(entry)):
            continue
        if not _is_predicted(entry):
            most = _most_of(content, entry)
            of = f" ({most})" if most else ""
            line = f"{balance} leaves more than noise does, and nothing logged predicts it{of}"
        else:
            regressor = regressor_name(entry["regressor"], own)
            line = said.format(balance, regressor, f"{number(100.0 * share, 2)} %")
            line = f"{line[:-1]}{_of_what(content, entry)})"
        found.append(line)
    return "; ".join(filter(None, (other, joined(found))))


def _is_predicted(entry: Content) -> bool:
    """Whether the quantity on which a residual depends most predicts any of it to speak of."""
    return bool(entry["share"] is None or entry["share"] >= LEAST_SHOWN)


WEIGHED = "each frequency weighed by its noise"
"""What an actuator's search counts squares by, where it differs from the residual's size."""


def _of_what(content: Content, entry: Content) -> str:
    """What else there is to say of a share: of which squares it is, or, where it is little, what
    most of the residual is."""
    # A share of the squares by which effects are judged may be nothing of the residual's size.
    if is_weighed(content, entry):
        return f", {WEIGHED}"
    most = _most_of(content, entry) if entry["share"] <= _LITTLE else ""
    return f"; {most}" if most else ""


def _most_of(content: Content, entry: Content) -> str:
    """What more than half of a residual's variance is, where not what repeats; empty of others."""
    rest = _remainder_of(content, entry)
    if rest is None:
        return ""
    parts = {key: _share(rest, key) for key in _REST}
    most = max(parts, key=lambda key: parts[key])
    return f"{percent(100.0 * parts[most], 2)} {_REST[most]}" if parts[most] > 0.5 else ""


def _remainder_of(content: Content, entry: Content) -> Content | None:
    """The remainder of an `unexplained` residual; None where it is not known."""
    every = content.get("remainder") or ()
    return next((rest for rest in every if rest["channel"] == entry["channel"]), None)


def _share(rest: Content, key: str) -> float:
    """A part of a remainder as a share of its square; of none 0."""
    return float(rest[key] / rest["rmse"]) ** 2 if rest["rmse"] > 0.0 else 0.0


def is_weighed(content: Content, entry: Content) -> bool:
    """Whether a share of `unexplained` is far above what repeats of that residual's size.

    It is then of the squares by which effects are judged, each frequency weighed by its noise.
    """
    rest = _remainder_of(content, entry)
    if rest is None or not is_of_actuator(content):
        return False
    return bool(_share(rest, "repeatable") < 0.5 * entry["share"])


def remainder_lines(content: Content) -> tuple[str, ...]:
    """The parts of the remaining errors, balance by balance; none where they are not known."""
    own = own_of(content)
    return tuple(_remainder_line(rest, own) for rest in content.get("remainder") or ())


def _remainder_line(rest: Content, own: Own) -> str:
    unit, over = rest["unit"], joined([regressor_name(n, own) for n in rest["regressors"]])
    repeats, scatter, noise = (number(rest[k], 3) for k in ("repeatable", "scatter", "noise"))
    return (
        f"Remainder of {balance_of(rest['channel'], own)}, {number(rest['rmse'], 3)} {unit} "
        f"(squares add up): {repeats} {unit} repeat from test to test over {over}, {scatter} "
        f"{unit} differ between tests, {noise} {unit} are noise."
    )


def advice(content: Content, titles: Mapping[str, str] | None = None) -> tuple[str, ...]:
    """What to do next: the tests that would distinguish rivals, and how to treat a remainder."""
    return (*_rivals_distinguished(content, titles or {}), *advice_on_rest(content))


def _rivals_distinguished(content: Content, known: Mapping[str, str]) -> Iterator[str]:
    for effect in content["effects"]:
        if effect["ambiguous_with"]:
            rivals = joined([effect_name(id, known) for id in effect["ambiguous_with"]], "or")
            own = effect_name(effect["id"], known)
            own = own if own == effect["id"] else capital(own)
            test = f" To distinguish them: {effect['advice']}." if effect["advice"] else ""
            yield f"{own} is indistinguishable from {rivals} in these data.{test}"


_ON_CURVE = (
    "No effect in the catalogue explains the remainder. Its curve shows what a user effect would "
    "have to produce (--effects FILE); tests that vary its regressor over a wider range, one at a "
    "time, would show more."
)
_ON_SCATTER = (
    "The remainder is another in each test: run one test several times, unchanged, and log what "
    "may differ from one to the next (the supply pressure, the temperature, what the arm carries)."
)


def advice_on_rest(content: Content) -> tuple[str, ...]:
    """What to do about parts that were not examined, not explained, or cannot be judged."""
    lines = []
    missed = content.get("search", {}).get("missed", [])
    if any(entry.get("reason") == QUICK.reason for entry in missed):
        lines.append(
            "This was a quick diagnosis: without --quick, every form of every effect is tried, "
            "several effects are searched for, and the parameters are refined."
        )
    elif content["verdict"] == "incomplete":
        lines.append(
            "What was not examined may change the verdict and the numbers: allow more processor "
            "time with --budget SECONDS."
        )
    elif _is_undecided(content):
        lines.append(
            "What could not be examined may explain the remainder: the notices name what failed."
        )
    elif content.get("because") == "one recording":
        lines.append(
            "Record the test again from at least two other conditions (pressures, levels): what "
            "repeats in all of them is the law's, and each is predicted by the others."
        )
    elif content.get("because") == "held-out errors" and is_cross_validated(content):
        lines.append(
            "Check for a log that is not like the others: chambers exchanged, a sign, a unit, "
            "another rig, or a condition (pressure, level, speed) that no other test has. Then "
            "record more tests like it, and diagnose again."
        )
    elif content.get("because") == "held-out errors":
        lines.append(
            "Check for a held-out log that is not like the training logs: chambers exchanged, a "
            "sign, a unit, another rig, or a condition (pressure, level, speed) that no training "
            "test has. Then train on it, hold out another, and diagnose again."
        )
    elif content["unexplained"] and not _NO_STRUCTURE.get(content.get("because") or ""):
        lines.append(_ON_CURVE if any(map(_is_predicted, content["unexplained"])) else _ON_SCATTER)
    elif content["verdict"] in _ENDED and (above := dict(above_noise(content))):
        lines.append(_on_errors(content, max(above, key=lambda name: above[name]), above))
    if not content["residual"]:
        log = "motion log" if is_of_actuator(content) else "log"
        lines.append(
            f'Errors before and after are not known: give a {log} use = "holdout" in the campaign.'
        )
    return tuple(lines)


def above_noise(content: Content) -> Iterator[tuple[str, float]]:
    """The channels of a part alone whose errors are a misfit, and how many times the noise each is.

    The floor of a part is what no law could explain; in a motion small errors add up.
    """
    if is_of_actuator(content):
        return
    for name, errors in content.get("residual", {}).items():
        after, floor = errors["after"], errors["noise_floor"]
        if name not in VELOCITY_CHANNELS and floor and after > MISFIT * floor:
            yield name, after / floor


def _on_errors(content: Content, name: str, above: Mapping[str, float]) -> str:
    """What to do about errors of a channel that are far above the noise though the search ended."""
    own = own_of(content)
    said = (
        f"The errors of {channel_in(name, own).name} on {judged_use(content)} are still "
        f"{above[name]:.0f} times the noise"
    )
    adds = "a term of the component" if own else "an effect of your own (--effects FILE)"
    form = f"the law's form is not quite the rig's; {adds} can add what it lacks"
    rest = _remainder_of(content, {"channel": name})
    parts = {} if rest is None else {key: _share(rest, key) for key in ("repeatable", *_REST)}
    most = max(parts, key=lambda key: parts[key], default="")
    if rest is not None and most == "repeatable":
        over = joined([regressor_name(n, own) for n in rest["regressors"]])
        return f"{said}; most of their square repeats over {over}: {form}."
    if most == "scatter":
        return (
            f"{said}; most of their square differs from test to test: log what may differ between "
            "them (temperature, supply, load), and repeat one test unchanged."
        )
    return f"{said}: {form}."


def own_friction(trace: Content, source: str) -> str:
    """How much of a held-out test's residual is that friction differs from test to test.

    That no law of one friction can follow. `source` is the test as the diagnosis' trace names it;
    empty where it is not most of the residual's square.
    """
    own = next((one for one in trace.get("friction", ()) if one["source"] == source), None)
    removed = 0.0 if own is None else 1.0 - (own["rmse"] / own["of"]) ** 2
    if own is None or removed < 0.5:
        return ""
    channel = channel_of(trace["channel"])
    off, scatter = (percent(100.0 * abs(own[k]), 2) for k in ("own", "scatter"))
    before, after = (number(channel.residual(own[k])) for k in ("of", "rmse"))
    return (
        f" Most of its residual ({percent(100.0 * removed, 2)} of the square) is this test's own "
        f"friction, {off} {'more' if own['own'] > 0.0 else 'less'} than the model's (from test to "
        f"test it differs by {scatter}): with it the RMSE is {after} {channel.residual_unit}, not "
        f"{before}."
    )


def joined(items: Sequence[str], word: str = "and") -> str:
    """A list in words."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {word} {items[-1]}"


def p_text(value: float) -> str:
    """A p-value; very small ones by their bound."""
    return f"< {SMALLEST_P:.0e}" if value < SMALLEST_P else f"{value:.1g}"


_BALANCES = {
    "flow_a_kg_s": "the valve's law",
    "log_time_to_pressure": "the valve's law",
    "position_m": "the force balance",
    "motor_force_n": "the force balance",
    "theta_rad": "the torque balance",
    "motor_torque_nm": "the torque balance",
}


def balance_of(channel: str, own: Own = MappingProxyType({})) -> str:
    """The balance whose residual a channel of the log format, or of a user's `own`, shows."""
    if channel in CHAMBER_PRESSURES:
        return f"chamber {SIDES[CHAMBER_PRESSURES.index(channel)].upper()}'s balance"
    known = {} if own else _BALANCES
    return known.get(channel, f"the prediction of {channel_in(channel, own).name}")


def regressor_name(name: str, own: Own = MappingProxyType({})) -> str:
    """A regressor in words, those of a user's `own` columns among them."""
    return in_words(name, own) if own else _REGRESSORS.get(name, name)


def regressor_key(name: str) -> str:
    """The key of a regressor that is given in words; other names are their own."""
    return next((key for key, words in _REGRESSORS.items() if words == name), name)


def parameter_rows(effect: Mapping[str, Any]) -> Iterator[tuple[str, Estimate | str]]:
    """An effect's parameters: estimates, and the side that it acts on as text."""
    for name, estimate in effect["parameters"].items():
        is_number = isinstance(estimate, Mapping)
        yield name, Estimate.from_json(estimate) if is_number else str(estimate)


def errors_by_step(content: Content) -> dict[str, list[float]]:
    """Held-out RMSE by channel: of the original bundle, then after each of `steps`.

    NaN after an effect that could not be simulated without the next.
    """
    found = {}
    for name, error in content["residual"].items():
        after = [effect["holdout_rmse"].get(name, {}) for effect in content["effects"]]
        errors = [step.get("after", math.nan) for step in after]
        last = [error["after"]] if is_refined(content) else []
        found[name] = [error["before"], *errors, *last]
    return found


def steps(content: Content) -> list[str]:
    """What was done to the original bundle, step by step: the effects, then the refinement."""
    added = [f"+ {effect['id']}" for effect in content["effects"]]
    return [*added, "refined"] if is_refined(content) else added


def is_refined(content: Content) -> bool:
    """Whether the numbers are from a refinement by simulation error."""
    return bool(content.get("refined"))


__all__ = [
    "ACTUATOR",
    "CORRECT_MODEL",
    "LEAST_SHOWN",
    "SMALLEST_P",
    "WEIGHED",
    "above_noise",
    "advice",
    "advice_on_rest",
    "balance_of",
    "effect_name",
    "errors_by_step",
    "floor_text",
    "is_cross_validated",
    "is_of_actuator",
    "is_refined",
    "is_weighed",
    "joined",
    "judged_tests",
    "judged_use",
    "own_friction",
    "own_of",
    "p_text",
    "parameter_rows",
    "regressor_key",
    "regressor_name",
    "remainder_lines",
    "sentence",
    "steps",
]
