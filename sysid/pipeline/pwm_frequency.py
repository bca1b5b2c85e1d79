"""The choice of a PWM frequency from constant-duty logs at several."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sysid.blocks.sections import Section
from sysid.errors import InputError, input_error
from sysid.identification.valve_pwm.frequency import (
    CampaignTests,
    FrequencyChoice,
    choose_frequency,
    logged_periods,
)
from sysid.identification.valve_pwm.frequency_shown import frequency_section
from sysid.io.bare_rig import read_bare_logs
from sysid.io.campaign import Campaign
from sysid.io.files import check_each_once, write_atomic
from sysid.io.log_constants import pwm_period
from sysid.io.logs import Log, Trial, exclusions_for, read_log
from sysid.io.rig import Rig, find_rig_file, read_rig
from sysid.io.tables import require_log
from sysid.io.units import parse_map
from sysid.pipeline.given_tests import rig_of


@dataclass(frozen=True, kw_only=True)
class FrequencyFiles:
    """The logs of a comparison, one PWM frequency each, and where its page goes.

    `hertz`: the frequency of each log, in order; empty: what the ripple of its pulses shows.
    `valve`, `least_range` as in `choose_frequency`.
    """

    logs: Sequence[Path]
    rig: Path | None = None
    maps: Sequence[str] = ()
    exclude: Sequence[str] = ()
    hertz: Sequence[float] = ()
    valve: str | None = None
    least_range: float | None = None
    report: Path | None = None


def compare_frequencies(files: FrequencyFiles) -> FrequencyChoice:
    """Read the logs and choose among their frequencies; writes the page where one is asked for.

    Raises InputError for logs that cannot be used or show no frequency, NotIdentifiedError where
    they do not identify the linear range of the duty.
    """
    check_each_once(files.logs, "log")
    if files.hertz and len(files.hertz) != len(files.logs):
        raise _not_one_each(files.hertz, files.logs)
    logs, rig, notices = _read(files)
    found = pwm_frequency(
        logs, rig, hertz=files.hertz, valve=files.valve, least_range=files.least_range
    ).noting(notices)
    if files.report is not None:
        write_atomic(files.report, _page(found, rig))
    return found


def pwm_frequency(
    logs: Campaign | Sequence[Log],
    rig: Rig | None = None,
    *,
    hertz: Sequence[float] = (),
    valve: str | None = None,
    least_range: float | None = None,
) -> FrequencyChoice:
    """Which PWM frequency to run at, from valve-pwm logs at several (thesis 3.7.2).

    `logs`: one log for each frequency, or a campaign with them among its training logs. `hertz`:
    the frequency of each log, in order; by default that of the ripple of its pulses. The
    frequency with the widest linear range of the duty is chosen; of those that do not differ from
    it significantly, the highest. `least_range` (0 to 1): the highest frequency with at least this
    linear range instead; `valve`: "a" or "b" alone. Raises InputError for logs at one frequency or
    that show none, NotIdentifiedError where they do not identify the linear range.

    >>> try:
    ...     si.pwm_frequency(campaign).chosen_s
    ... except si.InputError as why:
    ...     "all logs have one PWM period" in str(why)
    True
    """
    if isinstance(logs, Campaign):
        tests = campaign_tests(logs)
        own, rig = [one.log for one in tests], logs.rig if rig is None else rig
        shown = logged_periods(tests, rig)
    else:
        own, rig, shown = list(logs), rig_of(logs, rig), []
    if hertz and len(hertz) != len(own):
        raise _not_one_each(hertz, own)
    periods = [1.0 / f for f in hertz] or shown or [period_of(log.trials, log.path) for log in own]
    return choose_frequency(_given(periods, own), rig, valve=valve, least_range=least_range)


def _given(
    periods: Sequence[float], logs: Sequence[Log]
) -> list[tuple[float, str, Sequence[Trial]]]:
    """The logs as `choose_frequency` takes them: period (s), name and tests of each."""
    return [(p, log.path.name, log.trials) for p, log in zip(periods, logs, strict=True)]


def _not_one_each(hertz: Sequence[float], logs: Sequence[object]) -> InputError:
    return input_error(
        "--hz",
        f"{len(hertz)} frequencies for {len(logs)} logs",
        "give one for each log, in order",
    )


def campaign_tests(campaign: Campaign) -> list[CampaignTests]:
    """The training logs of PWM valves."""
    return [
        CampaignTests(entry.valve, campaign.read(entry), entry.pwm_period_s)
        for entry in campaign.select(("valve-pwm",))
    ]


def campaign_section(tests: Sequence[CampaignTests], rig: Rig) -> Section | None:
    """The report's section on a campaign's logs at several frequencies; None without such."""
    periods = [] if rig.pwm is None else logged_periods(tests, rig)
    if len(set(periods)) < 2:
        return None
    found = choose_frequency(_given(periods, [one.log for one in tests]), rig)
    return frequency_section(found.headline(), found.tables(), found.responses)


def _read(files: FrequencyFiles) -> tuple[list[Log], Rig, list[str]]:
    """The logs, their rig (of bare logs the first one's), and notices."""
    mapping = parse_map(files.maps)
    excluded = exclusions_for(files.exclude, files.logs, mapping)
    logs: list[Log] = []
    rigs: list[Rig] = []
    notices: list[str] = []
    for path, own in zip(files.logs, excluded, strict=True):
        require_log(path)
        place = files.rig or find_rig_file(path)
        if place is None:
            bare = read_bare_logs((path,), mapping, None, (own,), readings=False)
            rigs.append(bare.read_with)
            logs += bare.logs
            notices += bare.notices
        else:
            rigs.append(read_rig(place))
            logs.append(read_log(path, rigs[-1], mapping, exclude=own))
    notices += [line for log in logs for line in log.notices]
    return logs, rigs[0], list(dict.fromkeys(notices))


def period_of(trials: Sequence[Trial], path: Path) -> float:
    """The PWM period that the ripple of a log's pulses shows, s. Raises InputError for none."""
    found = pwm_period(trials)
    if found is None:
        raise input_error(
            path,
            "its pressures show no ripple of pulses, which would give its PWM frequency",
            "give the frequency of each log with --hz, in order",
        )
    return found


def _page(found: FrequencyChoice, rig: Rig) -> str:
    from sysid.blocks.html import fill

    first, *others = found.tables()
    section = frequency_section(found.headline(), others, found.responses)
    return fill(
        "control.html",
        name=rig.name,
        subject="PWM frequencies",
        facts=[("Logs", ", ".join(dict.fromkeys(r.source for r in found.responses)))],
        level="good",
        sentence=f"{found.headline()}.",
        metrics=first,
        notes=[f"Notice: {line}." for line in found.notices],
        sections=[section],
    )


__all__ = [
    "FrequencyFiles",
    "campaign_section",
    "campaign_tests",
    "compare_frequencies",
    "period_of",
    "pwm_frequency",
]
