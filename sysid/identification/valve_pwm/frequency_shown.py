"""PWM frequencies as they are shown: their table, openings over duty, responses by duty."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from sysid.blocks.figures import Dash, Figure, Line, Mark, Panel, Points, Role, Scale
from sysid.blocks.numbers import number
from sysid.blocks.sections import Block, FigureGroup, Lines, Section
from sysid.blocks.tables import Table, table
from sysid.identification.valve_pwm.duty_response import DutyResponse
from sysid.identification.valve_pwm.shown import DIRECTIONS

_ROLES: tuple[Role, ...] = ("second", "model", "third", "fourth")
_DASHES: tuple[Dash, ...] = ("solid", "dashed", "dotted", "dash-dot")


def frequency_table(responses: Sequence[DutyResponse], chosen_s: float) -> Table:
    """The frequencies next to each other."""
    several = len({r.valve for r in responses}) > 1
    rows = []
    for r in responses:
        mark = ", chosen" if r.period_s == chosen_s else ""
        valve = f"valve {r.valve.upper()}, " if several else ""
        overlap = ", ".join(f"{a:.4g} and {b:.4g}" for a, b in r.overlapping) or "none"
        rows.append(
            (
                f"{valve}{number(r.frequency_hz)} Hz{mark}",
                number(1e3 * r.period_s),
                str(len(r.duty)),
                f"{r.linear.first:.3f} to {r.linear.last:.3f}",
                f"{r.linear.width:.3f} ± {2.0 * r.linear.std:.3f}",
                number(1e3 * r.unusable_s),
                number(100.0 * r.unevenness),
                number(r.least_step),
                overlap,
            )
        )
    columns = (
        "Frequency",
        "Period (ms)",
        "Duties",
        "Linear from, to",
        "Linear range",
        "Unusable (ms)",
        "Off the line (%)",
        "Least step of duty",
        "Duties that overlap",
    )
    return table("PWM frequencies", columns, rows, text=(3, 4, 8))


def resolution_table(responses: Sequence[DutyResponse]) -> Iterator[Table]:
    """Largest mean flow by step of duty (Table 3.7.1), and the largest step that keeps it."""
    rows = []
    for r in responses:
        for direction, study in r.resolution.items():
            flows = ", ".join(
                f"{step:.3g}: {number(1e4 * flow)}"
                for step, flow in zip(study.steps, study.max_flow, strict=True)
            )
            rows.append(
                (
                    f"{number(r.frequency_hz)} Hz, valve {r.valve.upper()}",
                    DIRECTIONS[direction],
                    f"{study.coarsest:.3g}",
                    flows,
                )
            )
    if rows:
        columns = (
            "Frequency",
            "Direction",
            "Largest step",
            "Step of duty: largest flow (1e-4 kg/s)",
        )
        yield table("Resolution of the duty", columns, rows, text=(1, 3))


def opening_panel(responses: Sequence[DutyResponse], valve: str) -> Panel:
    """Opening over duty at each frequency, with the line that ends where it is no longer linear."""
    marks: list[Mark] = []
    for i, r in enumerate(r for r in responses if r.valve == valve):
        role, dash = _ROLES[i % len(_ROLES)], _DASHES[i % len(_DASHES)]
        linear = r.linear
        x = np.array([r.duty[0], linear.first, linear.last, r.duty[-1]])
        y = np.array([linear.low, linear.low, linear.high, linear.high])
        label = f"{number(r.frequency_hz)} Hz"
        marks += [Points(r.duty, r.opening, role, label), Line(x, y, role, "", dash, 0.9)]
    return Panel(Scale("Duty"), Scale("Opening"), tuple(marks))


def _responses_panel(response: DutyResponse, filling: bool) -> Panel:
    """Pressure over time of each duty (Figures 3.11 to 3.13)."""
    own = [(d, t, p) for d, fills, t, p in response.curves if fills == filling]
    end = min(float(t[-1]) for _, t, _ in own)
    marks = []
    for _, time, pressure in own:
        rows = time <= end
        marks.append(Line(time[rows], 1e-3 * pressure[rows], "second", "", width=0.5))
    return Panel(Scale("Time", "s"), Scale("Pressure", "kPa"), tuple(marks))


def frequency_section(
    headline: str, tables: Iterable[Table], responses: Sequence[DutyResponse]
) -> Section:
    """The section of a page on the choice of the PWM frequency; `headline` says which and why."""
    blocks: list[Block] = [Lines((f"{headline}.",)), *tables]
    for valve in dict.fromkeys(r.valve for r in responses):
        own = [r for r in responses if r.valve == valve]
        ranges = ", ".join(
            f"{number(r.frequency_hz)} Hz {r.linear.first:.3f} to {r.linear.last:.3f}" for r in own
        )
        opening = Figure(
            f"fig-pwm-frequency-{valve}",
            f"Valve {valve.upper()}: opening over duty",
            f"Share of time that valve {valve.upper()} is open, over duty; linear at {ranges}.",
            (opening_panel(responses, valve),),
        )
        blocks.append(
            FigureGroup(
                f"Valve {valve.upper()}, opening over duty at each frequency, and the line that is "
                "closest to it.",
                (opening,),
            )
        )
        for filling, word in ((True, "filling"), (False, "discharging")):
            figures = tuple(
                Figure(
                    f"fig-pwm-responses-{valve}-{word}-{i}",
                    f"{number(r.frequency_hz)} Hz, {word}",
                    f"Chamber pressure over time at {len(r.duty)} duties and "
                    f"{number(r.frequency_hz)} Hz: even distances are a linear duty.",
                    (_responses_panel(r, filling),),
                )
                for i, r in enumerate(own)
                if any(fills == filling for _, fills, _, _ in r.curves)
            )
            if figures:
                caption = f"Valve {valve.upper()}, {word}: pressure responses by duty."
                blocks.append(FigureGroup(caption, figures))
    intro = (
        "Tests at several PWM frequencies (thesis 3.7.2). At each pressure the mean flow is linear "
        "in the share of time that the valve is open; the linear range is where this opening "
        "follows the duty. Duties overlap where a step of duty gives less than half of an even "
        "step's response.",
    )
    return Section("pwm-frequency", "PWM frequency", intro, tuple(blocks))


__all__ = ["frequency_section", "frequency_table", "opening_panel", "resolution_table"]
