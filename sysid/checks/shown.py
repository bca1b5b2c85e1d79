"""The data: every log, what its tests can identify, and the notices about it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sysid.blocks.numbers import MISSING, duration, number
from sysid.blocks.sections import Block, Fold, Lines, Section
from sysid.blocks.tables import Table, table
from sysid.blocks.titles import use_word
from sysid.checks.identifiability import readable
from sysid.checks.log_check import listed
from sysid.io.channels import channel_of
from sysid.io.own_channels import Own, channel_in, in_words

if TYPE_CHECKING:
    from sysid.checks.log_check import LogCheck
    from sysid.io.campaign import Campaign, CampaignLog


def quality_section(campaign: Campaign, checks: Sequence[LogCheck]) -> Section:
    """Every log of the campaign, with its check if there is one."""
    by_path = {Path(check.file).resolve(): check for check in checks}
    pairs = [(entry, by_path.get(entry.path.resolve())) for entry in campaign.logs]
    blocks: list[Block] = [_logs_table(pairs)]
    excluded = list(_excluded(pairs))
    if excluded:
        columns = ("Log", "Test", "Span", "Reason", "Rows")
        blocks.append(table("Excluded, not used at all", columns, excluded, text=(1, 2, 3)))
    known = [(e, c) for e, c in pairs if c is not None]
    own, numbers = (campaign.own.columns, campaign.own.numbers) if campaign.own else ({}, {})
    if known:
        blocks.append(Fold("Channels: range, resolution and noise", (_channels_table(known, own),)))
        blocks.append(Fold("What each log can identify", (_identifies_table(known, numbers),)))
    said = [*campaign.notices, *campaign.rig.notices, *(n for _, c in known for n in c.notices)]
    if said:
        blocks.append(Lines(tuple(dict.fromkeys(said)), "Notices of the readers"))
    apart = [line for _, c in known for line in c.contradicts]
    if apart:
        blocks.append(Lines(tuple(apart), "Logs that contradict one another or the rig file"))
    held = sum(e.use == "holdout" for e in campaign.logs)
    count = f"{len(campaign.logs)} log{'s' * (len(campaign.logs) != 1)}"
    intro = (
        f"{count}, {held} of them held out: no parameter was fitted to these."
        if held
        else f"{count}; none is held out, so that the errors below are those on the training data; "
        "errors called held-out are of training tests, each excluded from the fit in turn.",
    )
    return Section("data", "Data and their quality", intro, tuple(blocks))


def _excluded(
    pairs: Sequence[tuple[CampaignLog, LogCheck | None]],
) -> Iterator[tuple[str, ...]]:
    """A row of each test or span that is not read, with the reason that was given."""
    for entry, check in pairs:
        rows = [None] * len(entry.exclude) if check is None else [e.rows for e in check.excluded]
        for one, count in zip(entry.exclude, rows, strict=False):
            shown = MISSING if count is None else str(count)
            span = one.span or "whole"
            yield entry.file, one.test or MISSING, span, one.why or MISSING, shown


def _logs_table(pairs: Sequence[tuple[CampaignLog, LogCheck | None]]) -> Table:
    rows = []
    for entry, check in pairs:
        head = (
            entry.file,
            entry.kind if check is None or check.declared else _kinds(check),
            entry.valve.upper() if entry.valve else MISSING,
            use_word(entry.use),
        )
        if check is None:
            rows.append((*head, MISSING, MISSING, MISSING, MISSING, "not checked"))
            continue
        rows.append(
            (
                *head,
                str(check.tests),
                f"{check.rows:,}".replace(",", "\N{NARROW NO-BREAK SPACE}"),
                "" if check.by_row else number(check.duration_s),
                "" if check.by_row else number(1e3 * check.period_s),
                _remarks(entry, check),
            )
        )
    columns = (
        "Log", "Kind", "Valve", "Use", "Tests", "Rows", "Duration (s)", "Period (ms)", "Remarks",
    )  # fmt: skip
    return table("Logs", columns, rows, text=(1, 2, 3, 8)).without("Valve")


def _kinds(check: LogCheck) -> str:
    """The kinds of a log's tests, which no campaign declares."""
    if len(check.kinds) == 1:
        return next(iter(check.kinds))
    return ", ".join(f"{count} {kind}" for kind, count in check.kinds.items())


def _remarks(entry: CampaignLog, check: LogCheck) -> str:
    found = []
    if entry.payload_kg is not None:
        found.append(f"payload {number(entry.payload_kg)} kg")
    if check.by_row:
        found.append("each row a reading by itself")
    if check.gaps:
        found.append(f"{check.gaps} gaps, the longest {duration(check.longest_gap_s)}")
    if not check.is_even:
        found.append(f"jitter {duration(check.jitter_s)}")
    for channel in check.channels:
        name = channel_of(channel.name).name
        if channel.saturated_share:
            found.append(f"{name} saturated in {number(100.0 * channel.saturated_share, 2)} %")
        elif channel.stuck_s:
            found.append(f"{name} stuck for {duration(channel.stuck_s)}")
    return "; ".join(found) or "no gaps, nothing saturated"


def _channels_table(pairs: Sequence[tuple[CampaignLog, LogCheck]], own: Own) -> Table:
    rows = []
    for entry, check in pairs:
        for channel in check.channels:
            shown = channel_in(channel.name, own)
            scale = shown.residual_scale
            rows.append(
                (
                    entry.file,
                    shown.name,
                    number(scale * channel.low, 4),
                    number(scale * channel.high, 4),
                    number(scale * channel.quantum) if channel.quantum else MISSING,
                    MISSING if channel.sample_std is None else number(scale * channel.sample_std),
                    shown.residual_unit or ("" if shown.si == "dimensionless" else "SI"),
                )
            )
    columns = ("Log", "Channel", "Lowest", "Highest", "Resolution", "Noise (std)", "Unit")
    return table("Channels", columns, rows, text=(1, 6))


def _identifies_table(pairs: Sequence[tuple[CampaignLog, LogCheck]], own: Own) -> Table:
    """What each log identifies, in one cell; what it does not identify is omitted. `own`: the
    units of the parameters of a user's own component, by name."""
    rows = []
    for entry, check in pairs:
        by_reason: dict[str, list[str]] = {}
        for one in check.identifies:
            if one.identified:
                by_reason.setdefault(one.reason, []).append(in_words(readable(one.parameter), own))
        shown = "; ".join(f"{listed(n)} ({why})" for why, n in by_reason.items())
        rows.append((entry.file, shown or "nothing by itself"))
    return table("What each log can identify", ("Log", "Parameters"), rows, text=(1,))


__all__ = ["quality_section"]
