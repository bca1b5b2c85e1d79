"""`sysid check`: what logs, or a campaign's logs, can be used for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import click
from rich.text import Text

from sysid.checks.log_check import LogCheck, check_log
from sysid.commands.options import (
    component_option,
    json_option,
    logs_argument,
    map_option,
    rig_option,
)
from sysid.commands.own_component import read_with
from sysid.commands.printing import notices, print_json, progress
from sysid.display.terminal import console, new_table
from sysid.errors import input_error
from sysid.io.bare_rig import read_bare_logs
from sysid.io.logs import read_log
from sysid.io.rig import find_rig_file, read_rig
from sysid.io.units import parse_map
from sysid.workflows.subject import subject_of


@click.command()
@logs_argument
@rig_option
@map_option
@component_option
@json_option
def check(
    logs: Sequence[Path],
    rig: Path | None,
    maps: Sequence[str],
    component: str | None,
    as_json: bool,
) -> None:
    """Data quality of each LOG, and what it can and cannot identify.

    A campaign file in place of a LOG stands for all logs that it lists, which are then also
    compared with one another and with the rig file.
    """
    checks: list[LogCheck] = []
    said: list[str] = []
    for path in logs:
        if path.suffix == ".toml":
            checks += _campaign_checks(path, rig, maps, component, said)
        elif component is not None:
            mend = "give the campaign file that lists it"
            raise input_error(path, "is no campaign file, which --component needs", mend)
        else:
            checks.append(_log_check(path, rig or find_rig_file(path), maps, said))
    _show(checks, said, as_json)


def _log_check(path: Path, rig: Path | None, maps: Sequence[str], said: list[str]) -> LogCheck:
    """The check of one log; without a rig file by what it shows and the reference rig."""
    mapping = parse_map(maps)
    if rig is not None:
        known = read_rig(rig)
        return check_log(read_log(path, known, mapping), known)
    bare = read_bare_logs([path], mapping)
    said += [
        f"{path}: no rig file: {', '.join(bare.rig.assumed)} are assumed, as on the reference rig "
        f"(`sysid init --from {path.name} rig.toml` writes one to correct)",
        *bare.notices,
    ]
    return check_log(bare.logs[0], bare.read_with)


def _campaign_checks(
    path: Path, rig: Path | None, maps: Sequence[str], component: str | None, said: list[str]
) -> list[LogCheck]:
    """The checks of a campaign's logs; the reader's notices are added to `said`."""
    if rig is not None or maps:
        given = "--rig" if rig is not None else "--map"
        raise input_error(
            path, f"a campaign file names its own rig and maps, {given} is for logs", "omit it"
        )
    campaign = read_with(path, component, progress())
    said += [*campaign.notices, *campaign.rig.notices]
    return subject_of(campaign).checks()


# --- printing -----------------------------------------------------------------------------


def _show(checks: Sequence[LogCheck], said: Sequence[str], as_json: bool) -> None:
    """One block per log."""
    notices([*said, *(line for c in checks for line in c.said)])
    if as_json:
        print_json({"logs": [c.to_json() for c in checks]})
        return
    out = console()
    for check in checks:
        for block in _blocks(check):
            out.print(block)
        out.print()


def _blocks(check: LogCheck) -> Iterable[Any]:
    kinds = ", ".join(f"{n} x {k}" for k, n in check.kinds.items())
    yield Text(check.file, style="bold")
    if check.declared is not None:
        yield Text(f"in the campaign: {check.declared}, {check.use}")
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
        numbers = (channel.low, channel.high, channel.quantum or None, channel.sample_std)
        cells = ("-" if n is None else f"{n:.5g}" for n in numbers)
        table.add_row(channel.name, *cells, ", ".join(remark))
    yield table
    for line in check.excitation:
        yield Text(f"excitation: {line}")
    table = new_table("Identifies", "parameter", "", "reason, or test needed")
    # What has one reason is one row: the reason is read once.
    rows: dict[tuple[bool, str], list[str]] = {}
    for item in check.identifies:
        rows.setdefault((item.identified, item.reason), []).append(item.parameter)
    for (identified, reason), names in rows.items():
        table.add_row("\n".join(names), "yes" if identified else "no", Text(reason))
    yield table
