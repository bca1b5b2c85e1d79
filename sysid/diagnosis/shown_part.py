"""A part tested alone: its signal over what it depends on and over time, with the fitted law."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.figures import (
    TALL_PANEL,
    Dash,
    Figure,
    Line,
    Mark,
    Panel,
    Points,
    Role,
    Rule,
    Scale,
)
from sysid.blocks.numbers import number
from sysid.blocks.sections import Block, FigureGroup, Section
from sysid.blocks.titles import use_word
from sysid.diagnosis.figures import drawable, regressor_axis
from sysid.diagnosis.wording import own_of, regressor_name
from sysid.errors import InputError, NotIdentifiedError
from sysid.io.kinds import FRICTION_MOTION
from sysid.io.own_channels import channel_in, error_unit
from sysid.types import FloatArray

if TYPE_CHECKING:
    from sysid.io.campaign import Campaign
    from sysid.parameters import Bundle

Content = Mapping[str, Any]

# Below this share of the signal's variance between bins, their means would hide the signal.
_LEAST_BETWEEN = 0.6
_STYLES: Mapping[str, tuple[Role, Dash]] = {
    "before": ("second", "dashed"),
    "after": ("model", "solid"),
}


def fitted_axis(campaign: Campaign, bundle: Bundle) -> Content | None:
    """Pictures of friction that was fitted to general motion, as `part_section` takes them.

    None where it came from other tests, or these cannot be used.
    """
    if bundle.friction is None or bundle.friction.source != FRICTION_MOTION or bundle.effects:
        return None
    from sysid.diagnosis.bench import pictures
    from sysid.diagnosis.bench.registry import component_of

    try:
        trials = {
            use: [
                t for e in campaign.select((FRICTION_MOTION,), use) for t in campaign.read(e).trials
            ]
            for use in ("fit", "holdout")
        }
        part, outside = (
            component_of(FRICTION_MOTION, own, campaign.rig) if own else None
            for own in trials.values()
        )
        if part is None:
            return None
        law = part.law_of(bundle)
        return {"effects": [], "figures": pictures.drawn(part, outside, law, law)}
    except (InputError, NotIdentifiedError):
        return None


def part_section(content: Content, is_linear: bool, *, is_alone: bool = True) -> Section | None:
    """From a diagnosis' content; None where it is not of a part, or holds no pictures."""
    figures = content["figures"]
    over, tests = figures.get("over") or [], figures.get("tests") or []
    if not over and not tests:
        return None
    named = _laws(content)
    blocks: list[Block] = []
    if over:
        shown = tuple(
            _over(place, entry, figures, named, is_linear) for place, entry in enumerate(over)
        )
        blocks.append(FigureGroup(_over_caption(figures), shown))
    if tests:
        shown = tuple(figures_of_tests(content, is_linear))
        blocks.append(FigureGroup(tests_caption(content, len(tests)), shown))
    alone = "The part was tested alone. " if is_alone else ""
    intro = (
        f"{alone}The signal as it was measured, together with the fitted law "
        "under the same conditions"
        + (
            ": the base law, and the law extended by the effects that the diagnosis added."
            if content["effects"]
            else "."
        ),
    )
    return Section("part", "Measured and modelled", intro, tuple(blocks))


def _laws(content: Content) -> Mapping[str, str]:
    """The laws that are drawn, by their keys in an entry, and what they are called."""
    return {"before": "base", "after": "extended"} if content["effects"] else {"after": "fitted"}


def figures_of_tests(content: Content, is_linear: bool) -> list[Figure]:
    """A figure of each test that a part's content holds."""
    figures, named = content["figures"], _laws(content)
    return [
        _test(place, entry, figures, named, is_linear)
        for place, entry in enumerate(figures.get("tests") or [])
    ]


def _over_caption(figures: Content) -> str:
    less = (
        f"{_what(figures)} The inertia's share is subtracted, so that friction and what "
        "acts alongside it remain."
        if figures["channel"].startswith("motor_")
        else ""
    )
    return (
        "The signal over the quantities on which it may depend, training tests. Grey: a sample of "
        "the measurements; colour: the laws along the same tests, as means in bins, or as dots "
        f"where a mean would hide that the signal depends on more than this.{less}"
    )


def tests_caption(content: Content, shown: int) -> str:
    """Says of the first `shown` tests of a part's content what is drawn."""
    figures = content["figures"]
    tests: Sequence[Content] = figures["tests"][:shown]
    used = use_word(figures.get("use", "fit"), before_noun=True)
    many = len(tests) > 1
    names = "; ".join(entry["test"] for entry in tests if entry["test"])
    listed = f": {names}" if names else ""
    of = int(figures.get("count") or len(tests))
    count = f"{len(tests)} of {of}" if of > len(tests) else str(len(tests)) if many else "a"
    return (
        f"Measured and modelled over {count} {used} test{'s' * (many or of > 1)}{listed}. Below "
        f"each: measured less modelled.{_what(figures)}"
    )


def _what(figures: Content) -> str:
    """What is drawn where the channel is not drawn as it was logged."""
    if not figures["channel"].startswith("motor_"):
        return ""
    of = "force" if figures["channel"].endswith("_n") else "torque"
    return (
        f" The {of} is what moved the axis: the motor's and, where pressures were logged, the "
        "cylinder's, less the weight."
    )


def _signal(figures: Content) -> tuple[str, str, float]:
    """Title, shown unit and scale of what the law predicts."""
    channel = channel_in(figures["channel"], own_of(figures))
    if channel.unit and channel.unit != "-":
        return channel.title, channel.unit, channel.scale
    return channel.title, figures["unit"] if figures["unit"] != "-" else "", 1.0


def _residual_unit(figures: Content) -> tuple[str, float]:
    """Shown unit and scale of what the law leaves of it."""
    channel = channel_in(figures["channel"], own_of(figures))
    if channel.unit and channel.unit != "-":
        return error_unit(channel, is_alone=True)
    return _signal(figures)[1:]


def _over(
    place: int, entry: Content, figures: Content, named: Mapping[str, str], is_linear: bool
) -> Figure:
    title, unit, scale = _signal(figures)
    axis, x_scale = regressor_axis(entry["regressor"], is_linear, own=own_of(figures))
    name = regressor_name(entry["regressor"], own_of(figures))
    x, measured = x_scale * np.array(entry["x"]), scale * np.array(entry["measured"])
    marks: list[Mark] = [
        Points(x, measured, "measured", "measured", ".", 6.0, alpha=0.6, is_cloud=True)
    ]
    centres = x_scale * np.array(entry["centres"])
    lines = named if entry["share"] >= _LEAST_BETWEEN else {}
    if not lines:
        fitted = scale * np.array(entry["fitted"])
        cloud = Points(x, fitted, "model", named["after"], ".", 1.8, is_filled=True, alpha=0.8)
        marks.append(cloud)
    for key, label in lines.items():
        role, dash = _STYLES[key]
        marks.append(Line(centres, scale * np.array(entry[key]), role, label, dash, 1.4))
    off = {k: _rms(scale * (np.array(entry["mean"]) - np.array(entry[k]))) for k in named}
    told = ", ".join(f"{label} {number(off[key])} {unit}".rstrip() for key, label in named.items())
    description = f"Means of the measurements in bins of {name} less the law's, RMS: {told}."
    whole = f"{title} over {name}, measured and modelled"
    panel = Panel(axis, Scale(title, unit), tuple(marks), legend="above")
    heading = f"{title} over {name}"
    return Figure(f"fig-part-over-{place}", whole, description, (panel,), heading)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _test(
    place: int, entry: Content, figures: Content, named: Mapping[str, str], is_linear: bool
) -> Figure:
    of = {**figures, "channel": entry.get("channel", figures["channel"])}
    title, unit, scale = _signal(of)
    off_unit, finer = _residual_unit(of)
    to_si = entry.get("scale", 1.0)
    scale, finer = scale * to_si, finer * to_si
    axis, x_scale = regressor_axis(entry["along"], is_linear, own=own_of(figures))
    x = x_scale * np.array(entry["x"])
    measured = np.array(entry["measured"])
    above: list[Mark] = [Line(x, scale * measured, "measured", "measured", width=2.2)]
    below: list[Mark] = []
    told = []
    for key, label in named.items():
        role, dash = _STYLES[key]
        modelled = np.array(entry[key])
        above.append(Line(x, scale * modelled, role, label, dash, 1.0))
        residual = finer * (measured - modelled)
        below.append(Line(x, residual, role, dash=dash, width=0.8))
        told.append(f"{label} {number(_rms(residual))} {off_unit}".rstrip())
    test, along = entry["test"], regressor_name(entry["along"], own_of(figures))
    description = (
        f"{title} of {test or 'a test'} over {along}; RMSE of the samples drawn: {', '.join(told)}."
    )
    panels = (
        Panel(axis, Scale(title, unit), tuple(above), 2.0, "above"),
        Panel(axis, Scale("Residual", off_unit), (*below, Rule(0.0)), 1.0, "none"),
    )
    return Figure(
        f"fig-part-test-{place}",
        f"{title} of {test or f'test {place + 1}'}, measured and modelled",
        description,
        panels,
        f"{title}, {drawable(test) or f'test {place + 1}'}",
        TALL_PANEL,
    )


__all__ = ["figures_of_tests", "fitted_axis", "part_section", "tests_caption"]
