"""What the commands print: short tables for a person, one JSON object with `--json`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from sysid.check import LogCheck
    from sysid.convert import ConversionReport
    from sysid.fit import Fitted

Tables = Callable[[Any], Iterable[Table]]


def console() -> Console:
    """Standard output, as wide as the terminal; never colours what is piped."""
    return Console(soft_wrap=False, highlight=False)


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


def estimate_cells(estimate: dict[str, Any]) -> tuple[str, str, str]:
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


def _remark_tables(fitted: Fitted) -> Iterable[Table]:
    if fitted.remarks:
        table = new_table("Remarks", "")
        for remark in fitted.remarks:
            table.add_row(Text(remark))
        yield table


def campaign_tables(fitted: Fitted) -> Iterable[Table]:
    """Every part of a campaign's bundle."""
    if "friction" in fitted.bundle:
        yield from friction_tables(fitted)


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
