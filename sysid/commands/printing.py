"""What the commands print: short tables for a person, one JSON object with `--json`."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from pathlib import Path

    from sysid.checks.log_check import LogCheck
    from sysid.commands.diagnose import Diagnosed
    from sysid.commands.fit import Fitted
    from sysid.commands.run import RunReport
    from sysid.commands.simulate import Simulated
    from sysid.commands.validate import Validated
    from sysid.io.conversion import ConversionReport

# A pipe or a file has no width of its own; file names are not cut there.
_PIPED_WIDTH = 132
# Suspects of one look that a summary names.
_MOST_SUSPECTS = 6
Tables = Callable[[Any], Iterable[Table]]


def console() -> Console:
    """Standard output, as wide as the terminal; never colours what is piped."""
    width = None if sys.stdout.isatty() else _PIPED_WIDTH
    return Console(soft_wrap=False, highlight=False, width=width)


def notices(lines: Iterable[str]) -> None:
    """Each notice once, on standard error."""
    error = Console(stderr=True, soft_wrap=True, highlight=False)
    for line in dict.fromkeys(lines):
        error.print(Text(f"sysid: notice: {line}"))


def print_json(content: Any) -> None:
    """One JSON object on standard output and nothing else."""
    print(json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False))


def show(fitted: Fitted, as_json: bool, tables: Tables) -> None:
    """A fit's summary or its JSON, and where the bundle is."""
    notices(fitted.notices)
    if as_json:
        print_json(fitted.to_json())
        return
    out = console()
    for table in tables(fitted):
        out.print(table)
    if fitted.written is not None:
        out.print(Text(f"written: {fitted.written}"))


def estimate_cells(estimate: Mapping[str, Any]) -> tuple[str, str, str]:
    """Value, 95 % interval and unit of a bundle's parameter, as text."""
    if estimate.get("value") is None:
        return "not identified", estimate.get("reason", ""), ""
    low, high = estimate.get("interval", (None, None))
    interval = "" if low is None or high is None else f"{low:.4g} to {high:.4g}"
    return f"{estimate['value']:.4g}", interval, estimate["unit"]


def new_table(title: str, *columns: str) -> Table:
    """A table whose cells are never cut and whose text is never taken for markup."""
    table = Table(
        title=Text(title), title_justify="left", title_style="bold", box=None, pad_edge=False
    )
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def parameter_table(title: str, parameters: dict[str, Any]) -> Table:
    """One row a parameter of a bundle's part."""
    table = new_table(title, "parameter", "value", "95 % interval", "unit")
    for name, estimate in parameters.items():
        if isinstance(estimate, dict) and "value" in estimate:
            table.add_row(Text(name), *(Text(c) for c in estimate_cells(estimate)))
    return table


def friction_tables(fitted: Fitted) -> Iterable[Table]:
    """The friction parameters, and static friction by position."""
    friction = fitted.bundle["friction"]
    yield parameter_table("Friction", friction)
    yield from _position_tables(friction)
    yield from _remark_tables(fitted)


def _position_tables(friction: dict[str, Any]) -> Iterable[Table]:
    rows = friction.get("static_by_position", [])
    if not rows:
        return
    table = new_table(
        "Static friction by position", "position", "tests", "value", "95 % interval", "unit"
    )
    for row in rows:
        cells = estimate_cells(row["static"])
        table.add_row(f"{row['position']:.4g}", str(row["tests"]), *cells)
    yield table


def valve_tables(fitted: Fitted) -> Iterable[Table]:
    """Each valve's flow parameters and delays, and its surfaces' errors."""
    valves = fitted.bundle.get("valves", {})
    for name, models in valves.items():
        if "discrete" in models:
            yield parameter_table(f"Valve {name.upper()}, on/off", models["discrete"])
    yield from _surface_tables(valves)
    yield from _remark_tables(fitted)


def _surface_tables(valves: dict[str, Any]) -> Iterable[Table]:
    table = new_table(
        "PWM surfaces, error in duty on tests left out of the fit",
        "valve",
        "direction",
        "surface",
        "RMSE",
        "largest relative error, %",
        "parameters",
    )
    for name, models in valves.items():
        for direction, content in models.get("pwm", {}).items():
            for kind, count in (("bipolynomial", 9), ("ann", 41)):
                if kind in content:
                    surface = content[kind]
                    numbers = (
                        surface["rmse_duty"],
                        surface["max_relative_error_duty_percent"],
                    )
                    cells = [f"{n:.3g}" for n in numbers]
                    table.add_row(name.upper(), direction, kind, *cells, str(count))
    if table.row_count:
        yield table


def _remark_tables(fitted: Fitted) -> Iterable[Table]:
    if fitted.remarks:
        table = new_table("Remarks", "")
        for remark in fitted.remarks:
            table.add_row(Text(remark))
        yield table


def campaign_tables(fitted: Fitted) -> Iterable[Table]:
    """Every part of a campaign's bundle."""
    friction = fitted.bundle.get("friction")
    if friction is not None:
        yield parameter_table("Friction", friction)
        yield from _position_tables(friction)
    yield from valve_tables(fitted)


def progress(doing: str = "") -> Callable[[str], None]:
    """A function that says on standard error what is being done now."""
    error = Console(stderr=True, soft_wrap=True, highlight=False)

    def say(what: str) -> None:
        error.print(Text(f"sysid: {doing}{what}"))

    return say


def validation_table(validation: dict[str, Any]) -> Table:
    """One row a log, valve model and channel of a bundle's `validation`."""
    table = new_table(
        "Open-loop validation",
        "log",
        "use",
        "valve model",
        "channel",
        "RMSE",
        "fit, %",
        "noise floor",
    )
    for log in validation.get("logs", []):
        for name, channel in log["channels"].items():
            table.add_row(
                Text(log["file"]),
                log["use"],
                log["valve_model"],
                name,
                f"{channel['rmse']:.4g}",
                "-" if channel["fit_percent"] is None else f"{channel['fit_percent']:.1f}",
                f"{channel['noise_floor']:.3g}",
            )
    return table


def show_validation(validated: Validated, as_json: bool) -> None:
    """`sysid validate`: the errors of every log, and what was written."""
    notices(validated.notices)
    if as_json:
        print_json(validated.to_json())
        return
    out = console()
    out.print(validation_table(validated.validation))
    for path in validated.written:
        out.print(Text(f"written: {path}"))


def show_diagnosis(diagnosed: Diagnosed, as_json: bool) -> None:
    """`sysid diagnose`: the verdict, the effects, the errors, what was tried, what to do next."""
    from sysid.diagnosis import wording
    from sysid.diagnosis.bench.verdict import ComponentDiagnosis
    from sysid.diagnosis.content import looks

    notices(diagnosed.notices)
    content = diagnosed.to_json()
    if as_json:
        print_json(content)
        return
    out = console()
    out.print(Text(wording.sentence(content), style="bold"), soft_wrap=True)
    tables = [*_effect_tables(content), *_before_after_tables(content)]
    tables += _unexplained_tables(content)
    found = diagnosed.diagnosis
    if isinstance(found, ComponentDiagnosis):
        tables += _tried_on_part(found.looks())
    else:
        tables += _tried_tables(looks(found))
    for table in tables:
        out.print("", table)
    out.print()
    written = (f"written: {path}" for path in diagnosed.written)
    for line in (*wording.advice(content), *written):
        out.print(Text(line), soft_wrap=True)


def _effect_tables(content: dict[str, Any]) -> Iterable[Table]:
    """One row a parameter; what is said of the effect as a whole stands in its first row."""
    from sysid.diagnosis.wording import joined, p_text, parameter_rows

    if not content["effects"]:
        return
    columns = ("parameter", "value", "95 % interval", "unit", "p", "share, %", "ambiguous with")
    table = new_table("Effects", "effect", *columns)
    for effect in content["effects"]:
        head = effect["id"]
        share = f"{100.0 * effect['share']:.3g}"
        whole = (p_text(effect["p_value"]), share, joined(effect["ambiguous_with"], "or") or "-")
        for name, estimate in parameter_rows(effect):
            cells = (estimate, "", "") if isinstance(estimate, str) else estimate_cells(estimate)
            table.add_row(*(Text(c) for c in (head, name, *cells, *whole)))
            head, whole = "", ("", "", "")
    yield table


def _before_after_tables(content: dict[str, Any]) -> Iterable[Table]:
    from sysid.diagnosis.wording import errors_by_step

    if not content["residual"]:
        return
    added = [f"+ {effect['id']}" for effect in content["effects"]]
    how = "" if "component" in content else ", simulated open loop"
    title = f"RMSE on held-out logs{how}"
    table = new_table(title, "channel", "bundle given", *added, "noise floor")
    for name, errors in errors_by_step(content).items():
        floor = content["residual"][name]["noise_floor"]
        cells = ("-" if math.isnan(e) else f"{e:.4g}" for e in errors)
        table.add_row(name, *cells, f"{floor:.4g}")
    yield table


def _unexplained_tables(content: dict[str, Any]) -> Iterable[Table]:
    from sysid.diagnosis.wording import regressor_name

    if content["unexplained"]:
        table = new_table("Unexplained", "channel", "depends most on", "share of variance, %")
        for entry in content["unexplained"]:
            share = f"{100.0 * entry['share']:.3g}"
            table.add_row(entry["channel"], regressor_name(entry["regressor"]), share)
        yield table


def _tried_tables(looks: Sequence[dict[str, Any]]) -> Iterable[Table]:
    """What each look at the residual tried besides the effect that it added."""
    from sysid.diagnosis.wording import p_text

    columns = ("look", "suspect", "gain", "most on a twin", "p", "what became of it")
    table = new_table("Tried, and not added", *columns)
    for place, look in enumerate(looks, start=1):
        others = [s for s in look["suspects"] if s["id"] != look["added"]]
        for suspect in others[:_MOST_SUSPECTS]:
            gains = (f"{suspect['gain']:.3g}", f"{max(suspect['twins']):.3g}")
            cells = (suspect["id"], *gains, p_text(suspect["p_value"]), suspect["fate"])
            table.add_row(str(place), *(Text(c) for c in cells))
        if len(others) > _MOST_SUSPECTS:
            table.add_row(str(place), f"{len(others) - _MOST_SUSPECTS} more that gain less")
    if table.row_count:
        yield table


def _tried_on_part(looks: Sequence[dict[str, Any]]) -> Iterable[Table]:
    """What each look at a part tried besides the effect that it added."""
    from sysid.diagnosis.wording import p_text

    columns = ("look", "suspect", "takes of the error of prediction, %", "p")
    table = new_table("Tried, and not added", *columns)
    for place, look in enumerate(looks, start=1):
        others = [a for a in look["attempts"] if a["id"] != look["added"]]
        for attempt in others[:_MOST_SUSPECTS]:
            gain = f"{100.0 * attempt['gain']:.3g}"
            table.add_row(str(place), Text(attempt["id"]), gain, p_text(attempt["p_value"]))
        if len(others) > _MOST_SUSPECTS:
            table.add_row(str(place), f"{len(others) - _MOST_SUSPECTS} more that take less")
    if table.row_count:
        yield table


def show_run(done: RunReport, as_json: bool) -> None:
    """`sysid run`: the validation, the diagnosis, what each stage did, and where the report is."""
    from sysid.diagnosis import wording

    notices(done.notices)
    if as_json:
        print_json(done.to_json())
        return
    out = console()
    out.print(validation_table(done.bundle.get("validation", {})))
    if done.diagnosis is not None:
        out.print(Text(f"Diagnosis: {wording.sentence(done.diagnosis)}"), soft_wrap=True)
    table = new_table("Stages", "stage", "", "s")
    for stage in done.stages:
        table.add_row(stage.name, stage.why or "up to date", f"{stage.seconds:.1f}")
    out.print(table)
    out.print(Text(f"bundle: {done.folder / 'bundle.json'}"), soft_wrap=True)
    out.print(Text(f"report: {done.report}"), soft_wrap=True)


def show_simulated(simulated: Simulated, as_json: bool) -> None:
    """`sysid simulate`: how far each test went, and where the result is."""
    notices(simulated.notices)
    if as_json:
        print_json(simulated.to_json())
        return
    table = new_table(
        f"Simulated, {simulated.valve_model} valves", "test", "s", "position", "A, Pa", "B, Pa"
    )
    names = (simulated.position, "pressure_a_pa", "pressure_b_pa")
    for trial, channels in zip(simulated.trials, simulated.channels, strict=True):
        ranges = [channels[name] for name in names]
        cells = [f"{float(r.min()):.4g} to {float(r.max()):.4g}" for r in ranges]
        table.add_row(Text(trial.label or "-"), f"{trial.time[-1] - trial.time[0]:.3g}", *cells)
    out = console()
    out.print(table)
    out.print(Text(f"written: {simulated.written}"), soft_wrap=True)


def show_written(path: Path, said: Sequence[str], as_json: bool) -> None:
    """A command whose result is one file."""
    notices(said)
    if as_json:
        print_json({"written": str(path), "notices": list(said)})
        return
    console().print(Text(f"written: {path}"), soft_wrap=True)


def show_checks(checks: Sequence[LogCheck], as_json: bool) -> None:
    """`sysid check`: a block a log."""
    notices(line for c in checks for line in c.notices)
    if as_json:
        print_json({"logs": [c.to_json() for c in checks]})
        return
    out = console()
    for check in checks:
        for block in _check_blocks(check):
            out.print(block)
        out.print()


def _check_blocks(check: LogCheck) -> Iterable[Any]:
    kinds = ", ".join(f"{n} x {k}" for k, n in check.kinds.items())
    yield Text(check.file, style="bold")
    yield Text(
        f"{kinds}; {check.rows} rows, {check.duration_s:.4g} s, every {check.period_s:.4g} s "
        f"(jitter {check.jitter_s:.2g} s)"
    )
    yield Text(
        f"{check.gaps} gaps, the longest {check.longest_gap_s:.4g} s" if check.gaps else "no gaps"
    )
    table = new_table("Channels", "channel", "low", "high", "resolution", "noise", "remark")
    for channel in check.channels:
        remark = []
        if channel.stuck_s:
            remark.append(f"stuck for {channel.stuck_s:.3g} s")
        if channel.saturated_share:
            remark.append(f"saturated {100 * channel.saturated_share:.2g} %")
        numbers = (channel.low, channel.high, channel.quantum or None, channel.noise_std)
        cells = ("-" if n is None else f"{n:.5g}" for n in numbers)
        table.add_row(channel.name, *cells, ", ".join(remark))
    yield table
    for line in check.excitation:
        yield Text(f"excitation: {line}")
    table = new_table("Identifies", "parameter", "", "why, or what would")
    for item in check.identifies:
        table.add_row(item.parameter, "yes" if item.identified else "no", Text(item.reason))
    yield table


def show_conversion(report: ConversionReport, as_json: bool) -> None:
    """`sysid convert`: what became of each column."""
    notices(report.notices)
    if as_json:
        print_json(report.to_json())
        return
    out = console()
    tests = f", {len(report.tests)} tests" if report.tests else ""
    out.print(Text(f"written: {report.output}: {report.rows} rows{tests}"))
    out.print(Text(f"columns: {', '.join(report.columns)}"))
