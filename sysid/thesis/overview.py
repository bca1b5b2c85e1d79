"""All of the thesis' tables of controllers and its figures' counterparts, section by section."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from sysid.blocks.sections import Block, FigureGroup, Section
from sysid.blocks.tables import Table, table
from sysid.thesis.computed import Agreement, ThesisTable
from sysid.thesis.figures import FigureSet, Runs, figure_sets
from sysid.thesis.index import TABLES
from sysid.thesis.loop_figures import figure_groups, horizon_figure
from sysid.thesis.shown import agreement_sentence, compared, means, scatter
from sysid.thesis.studies import FlowStudy, Stabilities, flow_section, stability_section


@dataclass(frozen=True)
class ControllersPage:
    """What the page shows: all of `TABLES` by number, with the rig's sensors and with `perfect`
    ones, the runs of the figures, and the studies; `rig` names the rig."""

    rig: str
    tables: Mapping[str, ThesisTable]
    perfect: Mapping[str, ThesisTable]
    runs: Runs
    stabilities: Stabilities
    flows: FlowStudy


@dataclass(frozen=True)
class _Part:
    """Tables that are shown together, and why they differ from the print."""

    id: str
    title: str
    first: str
    last: str
    why: str

    @property
    def names(self) -> tuple[str, ...]:
        """Its tables."""
        return TABLES[TABLES.index(self.first) : TABLES.index(self.last) + 1]


_PARTS = (
    _Part(
        "previous",
        "The previous prototype, measured (4.4)",
        "4.4.3",
        "4.4.3",
        "Measured on hardware of which only the inertias and the horizon are printed; ours runs "
        "on this rig with these. In the pneumatic mode its RMSE are within 6 % of the print's, "
        "without and with the estimator.",
    ),
    _Part(
        "simulated",
        "Controllers by mode, simulated (4.5)",
        "4.5.1",
        "4.5.3",
        "DVMPC's errors in the hybrid mode on the sines are the motor's damping working with a "
        "velocity that the 50 Hz filter shows 5 ms late; with perfect sensors they are gone.",
    ),
    _Part(
        "measured",
        "Controllers by mode, measured (4.5)",
        "4.5.4",
        "4.5.6",
        "The printed errors were measured on the rig; ours are simulations with the settings of "
        "those experiments (DVMPC: Table 4.4.5), five seeds of the sensors' noise as five tests.",
    ),
    _Part(
        "compensation",
        "Compensations and horizon (5.2, 5.3)",
        "5.2.1",
        "5.3.1",
        "The printed rise without feedforward does not come about: the backstepping law itself "
        "contains the flows of the motion (4.3.29), which feedforward adds a second time. With the "
        "pressures' errors alone in the law, Table 5.2.2 comes to 38.4 mrad without and 12.4 mrad "
        "with feedforward on trajectory 4, and to 2.13 mrad with it on trajectory 1. Without it "
        "trajectory 1 stays at 1.42 mrad; the printed 14.7 mrad contradict Figure 4.12, where the "
        "same loop is off by 10 mrad at most.",
    ),
    _Part(
        "horizontal",
        "Payload mismatch, horizontal: backstepping (5.4.1)",
        "5.4.4",
        "5.4.6",
        "On trajectory 1 our errors are smaller, most so without compensation, as above. On "
        "trajectory 4 ours loses 0.5 kg and more with nearly every type, the print only with "
        "some.",
    ),
    _Part(
        "horizontal-estimator",
        "The same with the payload estimator",
        "5.4.7",
        "5.4.12",
        "The estimator knows a payload by its weight, which has no lever in the horizontal: ours "
        "does not act there, so that both halves of each table are equal. The printed one acts, "
        "and makes type 2 unstable.",
    ),
    _Part(
        "horizontal-dvmpc",
        "Payload mismatch, horizontal: DVMPC (5.4.1)",
        "5.4.14",
        "5.4.15",
        "Which loops are lost on trajectory 4 is as printed, cell by cell. Ours also loses a "
        "payload that is much lighter than assumed in the pneumatic mode on trajectory 1 (167 and "
        "211 mrad, printed 0.38 and 0.30). That is the valves' delay, which the prediction does "
        "not know: on a plant whose valves switch at once the same loops come to 0.48 and 0.41 "
        "mrad, which speaks for a printed plant without delay.",
    ),
    _Part(
        "vertical",
        "Payload mismatch, vertical: backstepping (5.4.2)",
        "5.4.16",
        "5.4.18",
        "On trajectory 1 the print loses 0.8 and 0.9 kg, which our rig carries: at 1 rad, "
        "the travel that we assume, 0.9 kg and the arm (0.30 kg, assumed) need 3.3 N·m; the "
        "cylinder gives 3.4 N·m and the motor 0.8 N·m.",
    ),
    _Part(
        "vertical-estimator",
        "The same with the payload estimator",
        "5.4.19",
        "5.4.24",
        "Where the payload is not the assumed one, the estimator lowers nearly all of our errors "
        "on trajectory 1, and 16 of 36 in print. On trajectory 4 it raises most of both (by the "
        "thesis: it converges too slowly), and makes loops unstable in print that it merely "
        "disturbs in ours.",
    ),
    _Part(
        "vertical-dvmpc",
        "Payload mismatch, vertical: DVMPC (5.4.2)",
        "5.4.25",
        "5.4.26",
        "Four cells of type 1 on trajectory 4 are printed twice, in 5.4.25 and as estimator off "
        "in 5.4.26, with figures up to 37 times apart; ours are nearer to the latter.",
    ),
    _Part(
        "valve",
        "The valve model's share (5.5)",
        "5.5.3",
        "5.5.3",
        "Our bipolynomial is fitted to the plant's own mean flow, so that it is nearly perfect. "
        "With perfect sensors, which the wanted pressures depend on, the pressures' errors at 1 "
        "and 2 Hz are within a factor of 2 of the printed perfect valve's but for one (2.01). At "
        "4 Hz the sine asks for 4.5 N·m, more than the cylinder's 3.3 N·m and the motor's 0.8 N·m: "
        "there the print is out of reach. With a motor of 2 N·m our four errors are 22 to 24 mrad "
        "(printed 11.9 to 14.8, and 77.6 with high gains and the imperfect model).",
    ),
    _Part(
        "tests-horizontal",
        "Robustness tests, horizontal, measured (6.3, 6.5.1)",
        "6.3.2",
        "6.5.9",
        "Measured with gains that were retuned for 0.22 kg, which the controllers assume; ours "
        "are simulations with these gains, five seeds of the sensors' noise as five tests. In "
        "the horizontal our estimator does not act, as above. Backstepping comes within a "
        "factor of 2 in 54 of 72 cells. Printed DVMPC follows trajectory 1 to 5 to 9 mrad in "
        "the pneumatic mode, ours to 1 to 2 mrad. Ours loses trajectory 4 with 0.22 kg in the "
        "pneumatic mode and with 0.32 kg in the hybrid one, the print only with 0.32 kg in the "
        "pneumatic one. The largest group of misses is friction that the controllers did not "
        "know: the motor alone (6.3.2) follows trajectory 1 to 4.93 mrad in print and to 0.73 "
        "mrad in ours, and to as much as in print where our plant has 0.11 N·m more Coulomb and "
        "static friction than its controllers take into account. That one number, from five "
        "cells, brings the cells of chapter 6 that are within a factor of 2 from 158 to 194 of "
        "455 (test 1 for all five), and those that are smaller from 219 to 152: DVMPC's of "
        "trajectory 1 are then 2 to 5 mrad in both modes. Without the valves' delays in "
        "addition it is 203. A motor of 1.2 N·m changes nothing.",
    ),
    _Part(
        "tests-vertical",
        "Robustness tests, vertical, measured (6.5.2)",
        "6.5.10",
        "6.5.22",
        "As in the horizontal; backstepping was retuned once more (Table 6.5.18). Printed tests "
        "with the estimator differ from one to the next, and some are lost; ours differ in "
        "noise alone. The second largest group is the payload: printed errors of backstepping "
        "grow with what is carried (pneumatic, trajectory 4: 26, 32, 76 and 178 mrad with 0, "
        "0.12, 0.22 and 0.32 kg), ours do not (26, 23, 23 and 28), as if the tested actuator "
        "had less torque left than ours; more friction, valves without delays and a stronger "
        "motor do not change that.",
    ),
)
_METRICS = (
    "Each test by itself is shown by sysid control --table A.1, and so on. Of C.2 the rows are "
    "missing from the text; in A.1 the RMSE of test 1 and in D.6 the mean MAE are printed ten "
    "times too small. SSA of 0.00 are below the print's resolution, and not counted."
)


def sections(page: ControllersPage) -> Iterator[Section]:
    """Every table and figure of the page."""
    yield Section("overview", "All cells", (), (_overview(page),))
    yield from (_tables(part, page) for part in _PARTS)
    yield _appendices(page)
    yield stability_section(page.stabilities)
    yield flow_section(page.flows)
    yield from (_figures(part, page.runs) for part in figure_sets())
    yield _horizon(page)


def summary(page: ControllersPage) -> Table:
    """How many cells of each part agree with the print."""
    rows = []
    for part in _PARTS:
        own, ideal = (
            Agreement.of([tables[name] for name in part.names])
            for tables in (page.tables, page.perfect)
        )
        names = part.first if part.first == part.last else f"{part.first} to {part.last}"
        counts = (own.tracked, own.within, own.lower, own.higher, own.lost, own.both, ideal.within)
        rows.append((names, *(str(count) for count in counts)))
    columns = (
        "Tables",
        "Cells",
        "Within 2",
        "Smaller",
        "Larger",
        "Lost in print",
        "Lost in both",
        "Perfect sensors: within 2",
    )
    return table("Our RMSE over the printed one", columns, rows)


def _overview(page: ControllersPage) -> FigureGroup:
    caption = (
        "RMSE of the position in every cell; thick line: equal, thin lines: a factor of 2 apart. "
        "Above 100 mrad the thesis calls a loop unstable."
    )
    return FigureGroup(caption, (scatter(rmse_tables(page.tables), "fig-all"),))


def rmse_tables(tables: Mapping[str, ThesisTable]) -> list[ThesisTable]:
    """Those whose cells all hold RMSE: the appendices repeat them, with other metrics."""
    return [found for found in tables.values() if found.measure == "RMSE"]


def _appendices(page: ControllersPage) -> Section:
    """The other metrics of the tests of chapter 6."""
    chosen = [[page.tables[name] for name in TABLES if name.startswith(f"{a}.")] for a in "ABCD"]
    blocks = tuple(means(tables, a) for tables, a in zip(chosen, "ABCD", strict=True))
    said = agreement_sentence(Agreement.of([found for tables in chosen for found in tables]))
    return Section(
        "appendices", "Metrics of the tests (appendices A to D)", (said, _METRICS), blocks
    )


def _tables(part: _Part, page: ControllersPage) -> Section:
    chosen = [page.tables[name] for name in part.names]
    blocks: list[Block] = [compared(found) for found in chosen]
    said = agreement_sentence(Agreement.of(chosen))
    return Section(part.id, part.title, (said, part.why), tuple(blocks))


def _figures(part: FigureSet, runs: Runs) -> Section:
    groups = figure_groups(part, runs)
    return Section(f"figures-{part.id}", f"Figures: {part.title}", (part.said,), groups)


def _horizon(page: ControllersPage) -> Section:
    figure = horizon_figure(page.tables["5.3.1"], "fig-horizon")
    caption = "Solid: ours; dashed: printed (Table 5.3.1)."
    group = FigureGroup(caption, (figure,))
    return Section("figures-horizon", "Figures: DVMPC by its horizon", (), (group,))


__all__ = ["ControllersPage", "rmse_tables", "sections", "summary"]
