"""Recompute what the thesis derives from its tables, and compare it with the printed values.

Run from the repository: `python -m datasets.thesis.recompute` prints `derived.csv`,
`--write` writes it, `--check` compares it with the existing file (exit status 1 if they
differ).
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sysid.friction import (
    SlidingFriction,
    SlidingPoints,
    StaticFriction,
    fit_sliding,
    static_summary,
)
from sysid.io.motion import ROTARY
from sysid.plant.base import exhaust_jump, filling_jump

FOLDER = Path(__file__).resolve().parent
DERIVED = FOLDER / "derived.csv"
HEADER = ("table", "quantity", "unit", "printed", "recomputed", "remark")
ATMOSPHERE_PA = 1.0e5
CRITICAL_RATIO = 0.53
ANN_WEIGHTS, BIPOLYNOMIAL_COEFFICIENTS = 41, 9

Row = tuple[str, str, str, str, str, str]


def table(name: str) -> list[dict[str, str]]:
    """Rows of one of the thesis' tables, as printed."""
    with (FOLDER / f"table_{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def column(rows: list[dict[str, str]], name: str) -> np.ndarray:
    return np.array([float(row[name]) for row in rows])


def static_friction() -> StaticFriction:
    """Table 3.4.1's 18 breakaway torques. The thesis names no direction: all are one."""
    rows = table("3_4_1")
    order = {"left": -1.0, "middle": 0.0, "right": 1.0}
    places = np.array([order[row["position"]] for row in rows])
    return static_summary(column(rows, "breakaway_nm"), places, places, np.ones(len(rows)), "Nm")


def sliding_friction() -> SlidingFriction:
    """Table 3.4.2's 12 steady speeds at two torques."""
    rows = table("3_4_2")
    torque = column(rows, "motor_torque_nm")
    labels = tuple(f"set {row['set']} test {row['test']}" for row in rows)
    speed = column(rows, "velocity_rad_per_s")
    return fit_sliding(SlidingPoints(labels, np.ones(len(rows)), torque, torque, speed), ROTARY)


def derived() -> Iterator[Row]:
    """Every derived number: table, quantity, unit, as printed, recomputed, remark."""
    yield from _table_3_4_1()
    yield from _table_3_4_2()
    yield from _table_3_6_1()
    yield from _tables_3_7()


def _table_3_4_1() -> Iterator[Row]:
    found = static_friction()
    test = found.tests["position"]
    mean = f"{found.estimate.value:.3f}"
    yield "3.4.1", "mean", "Nm", "0.329", mean, "the printed mean is not that of the 18"
    for name, place in zip(("left", "middle", "right"), found.by_position, strict=True):
        yield "3.4.1", f"mean {name}", "Nm", "", f"{place.estimate.value:.3f}", ""
    yield "3.4.1", "repeatability (pooled std)", "Nm", "", f"{found.repeatability:.4f}", ""
    yield "3.4.1", "F of position (2 and 15)", "-", "", f"{test.statistic:.1f}", ""
    yield "3.4.1", "p-value of position", "-", "", f"{test.p_value:.1e}", "position matters"


def _table_3_4_2() -> Iterator[Row]:
    rows, found = table("3_4_2"), sliding_friction()
    speed, number = column(rows, "velocity_rad_per_s"), column(rows, "set")
    for which, printed in ((1, "0.859"), (2, "1.269")):
        mean = f"{speed[number == which].mean():.3f}"
        yield "3.4.2", f"mean velocity of set {which}", "rad/s", printed, mean, ""
    for name, estimate, printed in (
        ("viscous friction", found.viscous, "0.0488"),
        ("Coulomb friction", found.coulomb, "0.2081"),
    ):
        yield "3.4.2", name, estimate.unit, printed, f"{estimate.value:.4f}", ""
        low, high = estimate.interval
        remark = "95 %, Fieller, a variance for each set"
        yield "3.4.2", f"{name}, interval", estimate.unit, "", f"{low:.4f} to {high:.4f}", remark
    for cluster in found.clusters:
        text = f"{', '.join(cluster.first)} | {', '.join(cluster.second)}"
        yield "3.4.2", "clusters", "-", "", text, f"p = {cluster.p_value:.4f}"


def _table_3_6_1() -> Iterator[Row]:
    for row in table("3_6_1"):
        valve, supply = row["valve"], float(row["supply_pressure_pa"])
        c_fill, c_dis = float(row["c_fill_kg_per_s_pa05"]), float(row["c_dis_kg_per_s_pa"])
        fill, dis = float(row["choked_flow_fill_kg_s"]), float(row["choked_flow_dis_kg_s"])
        for name, unit, printed, value, jump in (
            (
                "c_fill",
                "kg/(s Pa^0.5)",
                row["c_fill_kg_per_s_pa05"],
                fill / np.sqrt(supply - CRITICAL_RATIO * supply),
                filling_jump(supply, fill, c_fill),
            ),
            (
                "c_dis",
                "kg/(s Pa)",
                row["c_dis_kg_per_s_pa"],
                dis / (ATMOSPHERE_PA / CRITICAL_RATIO - ATMOSPHERE_PA),
                exhaust_jump(ATMOSPHERE_PA, dis, c_dis),
            ),
        ):
            remark = f"recomputed for continuity; the printed one jumps by {100.0 * jump:+.1f} %"
            yield "3.6.1", f"{name} of valve {valve}", unit, printed, f"{value:.3g}", remark


def _tables_3_7() -> Iterator[Row]:
    rows = table("3_7_1")
    flow, step = column(rows, "max_flow_kg_s"), column(rows, "duty_step")
    for duty, change in zip(step, 100.0 * (flow / flow[0] - 1.0), strict=True):
        yield "3.7.1", f"maximum flow at {duty:g} against 0.01", "%", "", f"{change:+.2f}", ""
    for name, key, unit, claim in (
        ("3.7.2", "max_error_percent", "maximum relative error", "discharge: more than 50"),
        ("3.7.3", "rmse_duty", "RMSE", "up to 70, 50 on average"),
    ):
        rows = table(name.replace(".", "_"))
        ratio = column(rows, f"ann_{key}") / column(rows, f"bipolynomial_{key}")
        for row, cut in zip(rows, 100.0 * (1.0 - ratio), strict=True):
            what = f"network's cut of the {unit}, valve {row['valve']} {row['case']}"
            yield name, what, "%", "", f"{cut:.1f}", f"text: {claim}"
        average = f"{100.0 * (1.0 - ratio).mean():.1f}"
        yield name, f"network's cut of the {unit}, average", "%", "", average, f"text: {claim}"
    for row in table("3_7_4"):
        surfaces = 2 * int(row["valves"])  # one filling, one discharging
        for kind, size in (("ann", ANN_WEIGHTS), ("bipolynomial", BIPOLYNOMIAL_COEFFICIENTS)):
            printed, count = row[f"{kind}_parameters"], str(surfaces * size)
            remark = "" if printed == count else f"{size} x {surfaces} = {count}"
            yield "3.7.4", f"{kind} parameters, {row['valves']} valves", "-", printed, count, remark


def text() -> str:
    """`derived.csv`."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(HEADER)
    writer.writerows(derived())
    return out.getvalue()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write derived.csv")
    parser.add_argument("--check", action="store_true", help="compare with derived.csv")
    options = parser.parse_args()
    new = text()
    if options.write:
        DERIVED.write_text(new, encoding="utf-8")
    elif options.check:
        same = DERIVED.read_text(encoding="utf-8") == new
        print("derived.csv is as recomputed" if same else "derived.csv differs")
        return 0 if same else 1
    else:
        sys.stdout.write(new)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
