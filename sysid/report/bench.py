"""The diagnosis of a part tested alone: what its law lacked, the gain, and the remainder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sysid.diagnosis.wording import advice, left, regressor_name, sentence
from sysid.display.numbers import number
from sysid.report import svg
from sysid.report.blocks import Block, Figure, FigureGroup, Fold, Heading, Lines, Section, table
from sysid.report.diagnosis import (
    effects_table,
    errors_table,
    parameters_table,
    short_p,
    waterfall,
)
from sysid.report.svg import COLOUR

Content = Mapping[str, Any]


def component_section(content: Content) -> Section:
    """The section of a part's diagnosis, from `sysid.diagnosis.content.content`.

    To be called within `sysid.report.svg.styled()`. Texts are escaped by the template.
    """
    blocks: list[Block] = []
    if content["effects"]:
        share = "Share of the prediction error, %"
        blocks.append(effects_table(content, share))
        caption = "Their parameters; standard errors allow for correlated residuals"
        blocks.append(parameters_table(content, caption))
    if content["residual"]:
        blocks.append(errors_table(content, "RMSE on the held-out tests"))
        caption = (
            "From the original law to the extended one: error on the held-out tests, and how much "
            "each effect reduces it. The noise floor (thin line) is the change from one sample to "
            "the next, which no law in the logged quantities explains."
        )
        blocks.append(waterfall(content, caption))
    if content["curves"]:
        blocks += [
            Heading("diagnosis-residuals", "Residual over its strongest regressors"),
            FigureGroup(
                "Mean residual on the training tests, in bins of equal count. Measured less "
                "modelled.",
                tuple(_curve(i, c) for i, c in enumerate(content["curves"])),
            ),
        ]
    if left(content):
        blocks.append(Lines((left(content),)))
    blocks += _tried(content)
    lines = advice(content)
    if lines:
        blocks += [Heading("diagnosis-advice", "What to do next"), Lines(lines)]
    if content["notices"]:
        blocks.append(Lines(tuple(content["notices"]), "Notices of the diagnosis"))
    intro = (
        sentence(content),
        "The part was tested alone, so there is no actuator to simulate. Each effect of the "
        "catalogue that acts on it was fitted together with its law and had to predict tests left "
        "out of that fit; it was added if its strength differs significantly from 0 and it removes "
        "a substantial share of the prediction error. The errors below are those of tests that "
        "were left out of the fit.",
    )
    return Section("diagnosis", "Diagnosis", intro, tuple(blocks))


def _curve(place: int, entry: Mapping[str, Any]) -> Figure:
    name = regressor_name(entry["regressor"])
    figure, ax = svg.panel(f"Residual over {name}")
    for label, role in (("before", "model"), ("after", "second")):
        ax.plot(
            entry["centres"], entry[label], "o-", color=COLOUR[role], ms=3.0, lw=1.3, label=label
        )
    ax.axhline(0.0, color=COLOUR["muted"], linewidth=0.7)
    ax.margins(x=0.03, y=0.12)
    ax.set_xlabel(f"{name[:1].upper()}{name[1:]} (SI)")
    ax.set_ylabel(f"Residual ({entry['unit']})")
    svg.legend(ax)
    reach = {k: float(np.max(np.abs(entry[k]))) for k in ("before", "after")}
    description = (
        f"Mean residual by {name}: it reaches {number(reach['before'])} {entry['unit']} before and "
        f"{number(reach['after'])} after; the remaining curve predicts "
        f"{number(100.0 * entry['share'], 2)} % of the squares of tests left out."
    )
    title = f"Residual over {name}, before and after"
    return svg.to_figure(figure, f"fig-component-curve-{place}", title, description)


def _tried(content: Content) -> list[Block]:
    rows = [
        (
            attempt["id"],
            str(place),
            number(100.0 * attempt["gain"]),
            short_p(attempt["p_value"]),
            "added" if attempt["id"] == look["added"] else "not added",
        )
        for place, look in enumerate(content["figures"]["looks"], start=1)
        for attempt in look["attempts"]
    ]
    if not rows:
        return []
    columns = ("Suspect", "Round", "Prediction error removed, %", "p", "Outcome")
    details = table("Every suspect", columns, rows, text=(4,))
    return [
        Heading("diagnosis-tried", "What was tried"),
        Fold("Every suspect and its outcome", (details,)),
    ]


__all__ = ["component_section"]
