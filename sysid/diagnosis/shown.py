"""The section on a diagnosis: effects found, improvement, effects tried, and the remainder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.blocks.figures import Figure
from sysid.blocks.numbers import number
from sysid.blocks.sections import Block, FigureGroup, Fold, Heading, Lines, Section, Terms
from sysid.blocks.tables import Table, table
from sysid.diagnosis import figures, tables
from sysid.diagnosis.wording import (
    WEIGHED,
    errors_by_step,
    is_of_actuator,
    is_refined,
    is_weighed,
    joined,
    judged_tests,
    own_of,
    regressor_name,
    sentence,
)
from sysid.io.own_channels import channel_in

Content = Mapping[str, Any]

_HOW_TWINS = (
    "The residuals of the fitted equations, in torque and pressure rates, were compared with "
    "those of twins: the same tests simulated with the fitted model and passed through the same "
    "filters and fits. An effect was added if it explains more than on any twin, and a fair share "
    "of the remainder. It was fitted on the training tests; the errors shown are those of held-out "
    "tests."
)
_HOW_LEFT_OUT = (
    "The part was tested alone, so there is no actuator to simulate. Each effect that acts on "
    "it was fitted together with its law and had to predict tests excluded from that fit; it was "
    "added if its strength differs significantly from 0 and it removes a substantial share of the "
    "prediction error. The errors shown are those of {tests}."
)


def diagnosis_section(content: Content, is_linear: bool) -> Section:
    """The section of a diagnosis, from `sysid.diagnosis.content.content`."""
    blocks: list[Block] = []
    if content["effects"]:
        blocks += _effects(content, is_linear)
    if content["residual"]:
        numbers = Fold("These errors as a table", (tables.errors_table(content),))
        blocks += [_errors(content), numbers]
    blocks += _residuals(content, is_linear)
    blocks += _remaining(content, is_linear)
    blocks += _remainder(content, is_linear)
    blocks += _tried(content)
    if content["notices"]:
        blocks.append(Lines(tuple(content["notices"]), "Notices of the diagnosis"))
    refined = (
        " At the end all parameters were estimated together by simulation error on the training "
        "tests (refined)."
        if is_refined(content)
        else ""
    )
    how = _HOW_TWINS if is_of_actuator(content) else _HOW_LEFT_OUT
    how = how.format(tests=judged_tests(content))
    blocks.append(Lines((f"{how}{refined}",), "How effects are found"))
    intro = (sentence(content, content["figures"]["titles"]),)
    return Section("diagnosis", "Diagnosis", intro, tuple(blocks))


def _effects(content: Content, is_linear: bool) -> list[Block]:
    """What each effect is, what it adds along the tests, and its numbers."""
    blocks: list[Block] = [tables.effects_table(content), _explained(content)]
    shown = content["figures"].get("shows") or []
    if shown:
        drawn = tuple(
            figures.influence(
                f"fig-effect-{place}", tables.title_of(content, entry["id"]), entry, is_linear
            )
            for place, entry in enumerate(shown)
        )
        caption = (
            "What each effect adds to the model along the training tests, at its estimated size, "
            "over the quantity that it depends on most. Line: mean; shaded: the middle 90 %."
        )
        if any("unit" not in entry for entry in shown):
            caption += " Torques and forces count in the direction of positive motion."
        blocks.append(FigureGroup(caption, drawn))
    blocks.append(tables.parameters_table(content))
    refitted = tables.refitted_table(content, is_linear)
    if is_refined(content):
        line = (
            "The other parameters were estimated again together with these; the section "
            "on the refinement lists how each of them changed."
        )
        blocks.append(Lines((line,)))
    elif refitted.rows:
        blocks.append(refitted)
    return blocks


def _explained(content: Content) -> Terms:
    """What each effect does, in a sentence of the catalogue's."""
    laws = content["figures"].get("laws", {})
    ids = [effect["id"] for effect in content["effects"]]
    return Terms(tuple((tables.title_of(content, id), id, laws[id]) for id in ids if laws.get(id)))


def _errors(content: Content) -> FigureGroup:
    """Error of every channel, effect by effect, down to that of a correct model."""
    drawn = tuple(
        figures.waterfall(
            channel_in(name, own_of(content)),
            errors,
            tables.step_names(content),
            float(content["residual"][name]["noise_floor"]),
            content,
        )
        for name, errors in errors_by_step(content).items()
    )
    if not content["effects"]:
        caption = (
            f"Error of the bundle on {judged_tests(content)}, and that which a correct model "
            "would have (thin line)."
        )
        return FigureGroup(caption, drawn)
    refined = ", and then their refinement" if is_refined(content) else ""
    rest = (
        f"error on {judged_tests(content)}, and how much each effect reduces it{refined}. The thin "
        "line is the error that a correct law would have: the change from one sample to the next, "
        "which no law in the logged quantities explains."
    )
    if is_of_actuator(content):
        rest = (
            "error in open-loop simulation of the held-out tests, and how much each effect reduces "
            f"it, with the base parameters refitted{refined}. The thin line is the error that a "
            "correct model would have: sensor noise, quantisation and the rig's own scatter from "
            "test to test."
        )
    return FigureGroup(f"From the original bundle to the extended model: {rest}", drawn)


def _residuals(content: Content, is_linear: bool) -> list[Block]:
    """Each balance over its strongest regressor; further ones are collapsed."""
    curves = content["figures"]["curves"]
    if not curves:
        return []
    extended = bool(content["effects"])
    first: list[Figure] = []
    further: list[Figure] = []
    seen: set[str] = set()
    for place, entry in enumerate(curves):
        figure = figures.curve(f"fig-diagnosis-curve-{place}", entry, is_linear, extended)
        (further if entry["channel"] in seen else first).append(figure)
        seen.add(entry["channel"])
    which = (
        "the original bundle (before) and the extended model (after)" if extended else "the bundle"
    )
    is_stretched = any(map(figures.is_stretched, curves))
    along = "along which the effects change it most" if extended else "on which it depends most"
    caption = (
        f"Residuals on the training tests under {which}: means in bins with their "
        f"95 % band, over the regressor {along}."
        + (" Around 0 the axis is stretched and the bins are finer." if is_stretched else "")
        + " Measured less modelled."
    )
    title = "Residual over its strongest regressors"
    if is_of_actuator(content):
        title = "Residuals of the balances"
    blocks: list[Block] = [
        Heading("diagnosis-residuals", title),
        FigureGroup(caption, tuple(first)),
    ]
    if further:
        group = FigureGroup("The next strongest regressors.", tuple(further))
        blocks.append(Fold("Over further regressors", (group,)))
    return blocks


def _excess_table(content: Content, is_linear: bool) -> Table:
    def shown(value: float) -> str:
        return number(value) if value > 0.0 else "none"

    columns = ["Balance", "Original bundle"]
    rows = [
        [figures.residual_title(name, is_linear), shown(e["before"])]
        for name, e in content["figures"]["excess"].items()
    ]
    if content["effects"]:
        columns.append("Extended model")
        for row, e in zip(rows, content["figures"]["excess"].values(), strict=True):
            row.append(shown(e["after"]))
    caption = f"Sum of squares in excess of the twins', {WEIGHED}, as effects are judged"
    return table(caption, columns, rows)


def _remainder(content: Content, is_linear: bool) -> list[Block]:
    """What the remaining residuals consist of."""
    blocks: list[Block] = []
    if "excess" in content["figures"]:
        blocks.append(_excess_table(content, is_linear))
    rests = content.get("remainder")
    if not rests:
        return [Fold("Sums of squares before and after", tuple(blocks))] if blocks else []
    own = own_of(content)
    over = list(dict.fromkeys(regressor_name(n, own) for rest in rests for n in rest["regressors"]))
    note = (
        "What repeats is what other tests predict over everything that was logged "
        f"({joined(over)}); the rest above the noise differs from test to test."
    )
    if any(is_weighed(content, entry) for entry in content["unexplained"]):
        note += (
            " These are sizes in the balance's unit. The verdict's share counts squares with "
            f"{WEIGHED}, as effects are judged: a part at frequencies of little noise may be most "
            "of those and next to nothing of the size."
        )
    blocks += [tables.remainder_table(content), Lines((note,))]
    return [Fold("What the residuals consist of, before and after", tuple(blocks))]


def _tried(content: Content) -> list[Block]:
    """Reductions by every suspect, next to the twins' where there are some, and its outcome."""
    looks = content["figures"]["looks"]
    shown = [(i, look) for i, look in enumerate(looks, start=1) if look["suspects"]]
    if not shown:
        return []
    blocks: list[Block] = []
    if is_of_actuator(content):
        caption = (
            "Improvement by each suspect in each round, on a logarithmic axis. Circles: on twins, "
            f"where nothing is missing (values up to {number(figures.LEAST_REDUCTION)} at the left "
            "edge); diamonds: on the logs; crosses: after refitting with the base parameters. An "
            "effect is refitted where the evidence for it, which counts its parameters and the "
            "plausible sizes of it, is more than against it; p is how often logs that lack nothing "
            "show as much."
        )
        titles = content["figures"]["titles"]
        drawn = tuple(figures.suspects(place, look, titles) for place, look in shown)
        blocks.append(FigureGroup(caption, drawn))
    every = [(place, suspect) for place, look in shown for suspect in look["suspects"]]
    details = tables.suspects_table(content, "Every suspect", every)
    return [Fold("What was tried: every suspect and its outcome", (*blocks, details))]


def _remaining(content: Content, is_linear: bool) -> list[Block]:
    """The curve of each channel that no effect explains."""
    curves = content["figures"].get("leftover")
    if not curves:
        return []
    drawn = tuple(
        figures.leftover(f"fig-diagnosis-left-{place}", entry, is_linear)
        for place, entry in enumerate(curves)
    )
    is_structure = content.get("because", "structure") == "structure"
    what = (
        "The remainder, which no effect in the catalogue explains"
        if is_structure
        else "The residual over its strongest regressor, which does not count as structure"
    )
    caption = (
        f"{what}: means with their 95 % band over the regressor on which the residual depends most."
    )
    return [
        Heading("diagnosis-left", "Unexplained remainder" if is_structure else "Remainder"),
        FigureGroup(caption, drawn),
    ]


__all__ = ["diagnosis_section"]
