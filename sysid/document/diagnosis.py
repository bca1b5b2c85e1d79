"""The diagnosis: what the model lacked, the gain, what was tried, and the remainder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sysid.blocks.channels import channel_of
from sysid.blocks.figures import Picture
from sysid.blocks.numbers import number
from sysid.blocks.sections import Block, FigureGroup, Fold, Heading, Lines, Section
from sysid.blocks.tables import Table, table
from sysid.diagnosis.evidence import is_of_actuator
from sysid.diagnosis.wording import (
    CORRECT_MODEL,
    balance_of,
    errors_by_step,
    is_refined,
    joined,
    regressor_name,
    sentence,
    steps,
)
from sysid.document import diagnosis_panels as panels
from sysid.document.effects import effect_blocks, named, short_p, title_of

Content = Mapping[str, Any]


@dataclass(frozen=True)
class _Words:
    """What a section says of one kind of evidence."""

    share: str
    std: str
    errors: str
    floor: str
    residuals: str
    how: str


_TWINS = _Words(
    share="Share of the excess, %",
    std="by leaving out one test at a time",
    errors="Open-loop RMSE over whole held-out tests",
    floor="error in open-loop simulation of the held-out tests, and how much each effect reduces "
    "it, with the base parameters refitted{refined}. The thin line is the error that a correct "
    "model would have: sensor noise, quantisation and the rig's own scatter from test to test.",
    residuals="Residuals of the balances",
    how="The residuals of the fitted equations, in torque and pressure rates, were compared with "
    "those of twins: the same tests simulated with the fitted model and passed through the same "
    "filters and fits. An effect was added if it explains more than on any twin, and a fair share "
    "of the remainder. It was fitted on the training tests; the errors below are those of held-out "
    "tests.{refined}",
)
_LEFT_OUT = _Words(
    share="Share of the prediction error, %",
    std="by the residuals' correlation within tests, or by what differs between tests if more",
    errors="RMSE on the held-out tests",
    floor="error on the held-out tests, and how much each effect reduces it{refined}. The thin "
    "line is the error that a correct law would have: the change from one sample to the next, "
    "which no law in the logged quantities explains.",
    residuals="Residual over its strongest regressors",
    how="The part was tested alone, so there is no actuator to simulate. Each effect that acts on "
    "it was fitted together with its law and had to predict tests left out of that fit; it was "
    "added if its strength differs significantly from 0 and it removes a substantial share of the "
    "prediction error. The errors below are those of tests that no number was fitted on.{refined}",
)


def _words(content: Content) -> _Words:
    return _TWINS if is_of_actuator(content) else _LEFT_OUT


def diagnosis_section(content: Content, is_linear: bool) -> Section:
    """The section of a diagnosis, from `sysid.diagnosis.content.content`.

    To be called within `sysid.document.svg.styled()`. Texts are escaped by the template.
    """
    words = _words(content)
    blocks: list[Block] = []
    if content["effects"]:
        blocks += effect_blocks(content, words.share, words.std, is_linear)
    if content["residual"]:
        blocks += [errors_table(content, words.errors), waterfall(content)]
    blocks += _residuals(content, is_linear)
    blocks += _left(content)
    blocks += _tried(content)
    blocks += _remaining(content, is_linear)
    if content["notices"]:
        blocks.append(Lines(tuple(content["notices"]), "Notices of the diagnosis"))
    refined = (
        " At the end all parameters were estimated together by simulation error on the training "
        "tests (refined)."
        if is_refined(content)
        else ""
    )
    intro = (sentence(content, content["figures"]["titles"]), words.how.format(refined=refined))
    return Section("diagnosis", "Diagnosis", intro, tuple(blocks))


def errors_table(content: Content, caption: str) -> Table:
    """Held-out errors by channel, effect by effect."""
    rows = []
    for name, errors in errors_by_step(content).items():
        channel = channel_of(name)
        floor = content["residual"][name]["noise_floor"]
        cells = [number(channel.residual(e)) for e in (*errors, floor)]
        rows.append((f"{channel.title} ({channel.residual_unit})", *cells))
    columns = ("Channel", "Original bundle", *_steps(content), CORRECT_MODEL)
    return table(caption, columns, rows)


def _steps(content: Content) -> list[str]:
    """What was done to the original bundle, the effects by their titles."""
    added = [f"+ {title_of(content, effect['id'])}" for effect in content["effects"]]
    return [*added, *steps(content)[len(added) :]]


def waterfall(content: Content) -> FigureGroup:
    """Held-out error of every channel, effect by effect, down to that of a correct model."""
    figures = [
        panels.waterfall(
            channel_of(name),
            errors,
            _steps(content),
            float(content["residual"][name]["noise_floor"]),
        )
        for name, errors in errors_by_step(content).items()
    ]
    if not content["effects"]:
        caption = (
            "Error of the bundle on the held-out tests, and that which a correct model would have "
            "(thin line)."
        )
        return FigureGroup(caption, tuple(figures))
    refined = ", and then their refinement" if is_refined(content) else ""
    caption = "From the original bundle to the extended model: " + _words(content).floor.format(
        refined=refined
    )
    return FigureGroup(caption, tuple(figures))


def _residuals(content: Content, is_linear: bool) -> list[Block]:
    """Each balance over its strongest regressor; further ones are collapsed."""
    drawn = content["figures"]["curves"]
    if not drawn:
        return []
    extended = bool(content["effects"])
    first: list[Picture] = []
    further: list[Picture] = []
    seen: set[str] = set()
    for place, entry in enumerate(drawn):
        figure = panels.curve(f"fig-diagnosis-curve-{place}", entry, is_linear, extended)
        (further if entry["channel"] in seen else first).append(figure)
        seen.add(entry["channel"])
    which = (
        "the original bundle (before) and the extended model (after)" if extended else "the bundle"
    )
    is_stretched = any(entry["fine"] for entry in drawn)
    along = "along which the effects change it most" if extended else "on which it depends most"
    caption = (
        f"Residuals on the training tests under {which}: means in bins with their "
        f"95 % band, over the regressor {along}."
        + (" Around 0 the axis is stretched and the bins are finer." if is_stretched else "")
        + " Measured less modelled."
    )
    blocks: list[Block] = [
        Heading("diagnosis-residuals", _words(content).residuals),
        FigureGroup(caption, tuple(first)),
    ]
    if further:
        group = FigureGroup("The next strongest regressors.", tuple(further))
        blocks.append(Fold("Over further regressors", (group,)))
    return (
        [*blocks, _excess_table(content, is_linear)] if "excess" in content["figures"] else blocks
    )


def _excess_table(content: Content, is_linear: bool) -> Table:
    def shown(value: float) -> str:
        return number(value) if value > 0.0 else "none"

    columns = ["Balance", "Original bundle"]
    rows = [
        [panels.residual_title(name, is_linear), shown(e["before"])]
        for name, e in content["figures"]["excess"].items()
    ]
    if content["effects"]:
        columns.append("Extended model")
        for row, e in zip(rows, content["figures"]["excess"].values(), strict=True):
            row.append(shown(e["after"]))
    return table("Whitened sum of squares in excess of the twins'", columns, rows)


def _left(content: Content) -> list[Block]:
    """What the remaining residuals consist of."""
    rests = content.get("remainder")
    if not rests:
        return []
    rows = []
    for rest in rests:
        sizes = (number(rest[k], 3) for k in ("rmse", "repeatable", "scatter", "noise"))
        balance = balance_of(rest["channel"])
        rows.append((f"{balance[:1].upper()}{balance[1:]}", *sizes, rest["unit"]))
    columns = ("Residual of", "RMSE", "Repeats", "Differs between tests", "Noise", "Unit")
    caption = "What is left after the effects; the squares add up"
    over = list(dict.fromkeys(regressor_name(n) for rest in rests for n in rest["regressors"]))
    note = (
        "What repeats is what other tests predict over everything that was logged "
        f"({joined(over)}); the rest above the noise differs from test to test."
    )
    return [table(caption, columns, rows, text=(5,)), Lines((note,))]


def _tried(content: Content) -> list[Block]:
    """Gains of every suspect, next to the twins' where there are some, and its outcome."""
    looks = content["figures"]["looks"]
    shown = [(i, look) for i, look in enumerate(looks, start=1) if look["suspects"]]
    if not shown:
        return []
    blocks: list[Block] = [Heading("diagnosis-tried", "What was tried")]
    gain: tuple[str, ...] = ("Prediction error removed, %",)
    if _words(content) is _TWINS:
        gain = ("Gain", "Largest on a twin", "Refitted")
        caption = (
            "Gains of the suspects in each round, on a logarithmic axis. Circles: on twins, where "
            f"nothing is missing (values up to {number(panels.LEAST_GAIN)} at the left edge); "
            "diamonds: on the logs; crosses: after refitting with the base parameters."
        )
        drawn = tuple(
            panels.suspects(place, look, content["figures"]["titles"]) for place, look in shown
        )
        blocks.append(FigureGroup(caption, drawn))
    rows = [
        (named(content, s["id"]), str(place), *_gains(s), short_p(s["p_value"]), s["fate"])
        for place, look in shown
        for s in look["suspects"]
    ]
    columns = ("Suspect", "Round", *gain, "p", "Outcome")
    details = table("Every suspect", columns, rows, text=(len(columns) - 1,))
    return [*blocks, Fold("Every suspect and its outcome", (details,))]


def _gains(suspect: Mapping[str, Any]) -> tuple[str, ...]:
    """A suspect's gain, on twins and refitted too, or its share of the prediction error."""
    if "twins" not in suspect:
        return (number(100.0 * suspect["gain"]),)
    return tuple(number(v) for v in (suspect["gain"], max(suspect["twins"]), suspect["refitted"]))


def _remaining(content: Content, is_linear: bool) -> list[Block]:
    """The curve of each channel that no effect explains."""
    curves = content["figures"].get("leftover")
    if not curves:
        return []
    figures = tuple(
        panels.leftover(f"fig-diagnosis-left-{place}", entry, is_linear)
        for place, entry in enumerate(curves)
    )
    is_structure = content.get("because", "structure") == "structure"
    what = (
        "The remainder, which no effect in the catalogue explains"
        if is_structure
        else "The residual where it depends most on anything, which does not count as structure"
    )
    caption = (
        f"{what}: means with their 95 % band over the regressor on which the residual depends most."
    )
    return [
        Heading("diagnosis-left", "Unexplained remainder" if is_structure else "Remainder"),
        FigureGroup(caption, figures),
    ]


__all__ = ["diagnosis_section"]
