"""What a log can be used for: its data quality, and which parameters it can identify."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid import signals
from sysid.blocks.drawing import plot_panels
from sysid.blocks.figures import Panel, Scale, grouped_bars
from sysid.blocks.numbers import si_number
from sysid.blocks.shown import Shown
from sysid.blocks.tables import NotedCell, Table, table
from sysid.checks.bench import (
    BENCH_LAWS,
    TANK,
    VALVE_TESTS,
    bench_identified,
    bench_kind,
    filling_of_tank,
)
from sysid.checks.consistency.campaign import (
    LogReadings,
    located_contradictions,
    readings_of,
)
from sysid.checks.consistency.repeats import repeated_tests
from sysid.checks.friction import Identification
from sysid.checks.identifiability import (
    excitation,
    identifications,
    readable,
    valves_identified,
)
from sysid.io.campaign import FRICTION_POINTS, Campaign, CampaignLog
from sysid.io.channels import DUTIES, PRESSURES, READINGS, SWITCHES
from sysid.io.exclusion import Excluded
from sysid.io.kinds import BY_MOTOR, KIND_BY_COLUMN
from sysid.io.logs import Log, Trial
from sysid.io.played_header import PlayedHeader, played_header
from sysid.io.rig import Rig
from sysid.io.trial_kind import is_active, is_held, rows_per_ripple
from sysid.recording.friction_kind import KINDS as FRICTION_TRIALS
from sysid.recording.friction_kind import MOTION, classify_trial
from sysid.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# A sensor is stuck from so many equal readings on, if a dithering one does not give them by chance.
_STUCK_RUN = 25


@dataclass(frozen=True)
class ChannelCheck:
    """One channel over all tests of a log; noise and quantum in the channel's unit.

    `noise_std` is the noise before the converter (one standard deviation), `quantum` the smallest
    step between readings (0: none found). `stuck_s` is the longest time for which a dithering
    sensor repeats one reading, `saturated_share` the share of samples in such stretches at
    the channel's highest or lowest reading.
    """

    name: str
    low: float
    high: float
    quantum: float
    noise_std: float | None
    stuck_s: float
    saturated_share: float

    @property
    def sample_std(self) -> float | None:
        """The whole error of one sample: the noise, and the converter's rounding."""
        if self.noise_std is None:
            return None
        return signals.NoiseFloor(self.noise_std, self.quantum).total


@dataclass(frozen=True, repr=False)
class LogCheck(Shown):
    """The result of `sysid check` for one log. Times in s.

    `kinds` counts its tests by the kind that their content shows; `declared` is the kind and
    `use` the use that a campaign gives the log, None for one that was checked alone. `contradicts`
    says in what it contradicts the rig file or, in a campaign, the other logs; `excluded` is what
    was excluded. `by_row`: a table without time, whose times count the rows.
    """

    file: str
    kinds: dict[str, int]
    tests: int
    rows: int
    duration_s: float
    period_s: float
    jitter_s: float
    gaps: int
    longest_gap_s: float
    channels: tuple[ChannelCheck, ...]
    excitation: tuple[str, ...]
    identifies: tuple[Identification, ...]
    notices: tuple[str, ...]
    declared: str | None = None
    use: str | None = None
    contradicts: tuple[str, ...] = ()
    excluded: tuple[Excluded, ...] = ()
    by_row: bool = False

    def to_json(self) -> dict[str, Any]:
        """Plain dictionaries and lists; `declared` and `use` only for a campaign's log,
        `contradicts` only for one that does, `excluded` only where something is, `by_row` only
        where it is so."""
        content = asdict(self)
        if not self.by_row:
            del content["by_row"]
        del content["excluded"]
        if self.excluded:
            content["excluded"] = [one.to_json() for one in self.excluded]
        if self.declared is None:
            del content["declared"], content["use"]
        if not self.contradicts:
            del content["contradicts"]
        return content

    @property
    def said(self) -> tuple[str, ...]:
        """Contradictions first, then the notices of its reader."""
        return (*self.contradicts, *self.notices)

    @property
    def answer(self) -> str:
        """One line: what the log identifies, and what it does not."""
        yes, no = ([i for i in self.identifies if i.identified is good] for good in (True, False))
        name = Path(self.file).name
        if not yes:
            why = f": {no[0].reason}" if no else ""
            return f"{name} identifies nothing{why}"
        lacking = f"; it does not identify {_listed(no)}" if no else ""
        apart = "; it contradicts the rig file" if self.contradicts else ""
        return f"{name} identifies {_listed(yes)}{lacking}{apart}"

    def answer_by_itself(self, kind: str) -> str:
        """What the log identifies, for one that others may join; else the reason that speaks of
        its kind of test."""
        good = [item for item in self.identifies if item.identified]
        if good:
            return f"By itself it identifies {_listed(good)}"
        reasons = [item.reason for item in self.identifies]
        of_kind = (reason for reason in reasons if kind and kind in reason)
        reason = next(of_kind, next(iter(reasons), ""))
        return f"By itself it identifies nothing{': ' if reason else ''}{reason}"

    @property
    def is_even(self) -> bool:
        """Whether its samples are as evenly spaced as a fit takes for even."""
        return self.jitter_s < signals.JITTER_IGNORED * self.period_s

    @property
    def extent(self) -> str:
        """Its tests by kind, and how long and how often they were sampled."""
        kinds = ", ".join(f"{count} x {kind}" for kind, count in self.kinds.items())
        if self.by_row:
            return f"{kinds}; {self.rows} readings"
        return f"{kinds}; {self.rows} rows, {self.duration_s:.4g} s, every {self.period_s:.4g} s"

    def headline(self) -> str:
        """The file, its tests and its sampling."""
        gaps = f", {self.gaps} gaps" if self.gaps else ", no gaps"
        return f"{self.file}: {self.extent}{'' if self.by_row else gaps}"

    def records(self) -> list[dict[str, Any]]:
        """One record per measured channel: range, resolution and noise in its own unit."""
        return [asdict(channel) for channel in self.channels]

    def tables(self) -> Iterable[Table]:
        """The channels, and what the log can identify."""
        columns = ("channel", "low", "high", "resolution", "noise", "remark")
        yield table("Channels", columns, tuple(map(_channel_row, self.channels)))
        # A shared reason is read once.
        rows: dict[tuple[bool, str], list[str]] = {}
        for item in self.identifies:
            rows.setdefault((item.identified, item.reason), []).append(item.parameter)
        found = tuple(
            (_named(names), "yes" if identified else "no", reason)
            for (identified, reason), names in rows.items()
        )
        headings = ("parameter", "", "reason, or test needed")
        yield table("Identifies", headings, found, text=(1, 2))

    def left_out(self) -> Iterator[str]:
        """A line for each excluded test or span."""
        for one in self.excluded:
            why = f": {one.exclusion.why}" if one.exclusion.why else ""
            yield f"excluded: {one.exclusion.title} ({one.rows} rows){why}"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Each channel's range over its noise and over its resolution."""
        shares: dict[str, Sequence[float]] = {
            "range over noise": [_ratio(c, c.noise_std) for c in self.channels],
            "range over resolution": [_ratio(c, c.quantum) for c in self.channels],
        }
        shown, ticks = grouped_bars([c.name for c in self.channels], shares)
        panel = Panel(
            Scale(ticks=ticks), Scale("range over noise or step", kind="log"), shown, legend="right"
        )
        return plot_panels((panel,), ax)[0]

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> LogCheck:
        """The check as `to_json` wrote it."""
        return cls(
            **{
                **content,
                "channels": tuple(ChannelCheck(**c) for c in content["channels"]),
                "excitation": tuple(content["excitation"]),
                "identifies": tuple(Identification(**i) for i in content["identifies"]),
                "notices": tuple(content["notices"]),
                "contradicts": tuple(content.get("contradicts", ())),
                "excluded": tuple(map(Excluded.from_json, content.get("excluded", ()))),
            }
        )


def _channel_row(channel: ChannelCheck) -> tuple[str, ...]:
    """Name, range, resolution and noise in the channel's unit, and what is remarkable."""
    remark = []
    if channel.stuck_s:
        remark.append(f"stuck for {channel.stuck_s:.3g} s")
    if channel.saturated_share:
        remark.append(f"saturated {100 * channel.saturated_share:.2g} %")
    # Of a noise or a resolution three digits are known at most.
    sizes = (
        "-" if n is None else f"{n:.3g}" for n in (channel.quantum or None, channel.sample_std)
    )
    ends = (si_number(n, 5) for n in (channel.low, channel.high))
    return (channel.name, *ends, *sizes, ", ".join(remark))


def _named(names: Sequence[str]) -> str:
    """Parameters, one a line; a terminal has those names which other commands take."""
    return NotedCell("\n".join(map(readable, names)), plain="\n".join(names))


def _listed(items: Sequence[Identification]) -> str:
    """Their parameters as a list; what several of a valve share is said once."""
    return listed([i.parameter for i in items])


def listed(names: Sequence[str]) -> str:
    """Parameters as a list; a valve that follows itself is named once."""
    valves, shown = ("valve A ", "valve B "), []
    for before, name in zip(("", *names), names, strict=False):
        same = next((v for v in valves if name.startswith(v) and before.startswith(v)), "")
        shown.append(name.removeprefix(same).replace("surface, ", "surface "))
    return ", ".join(shown)


def _ratio(channel: ChannelCheck, size: float | None) -> float:
    """A channel's range in units of `size`; NaN where `size` is 0 or unknown."""
    return (channel.high - channel.low) / size if size else math.nan


@dataclass(frozen=True)
class CheckedLog:
    """One log of a campaign: what it is good for by itself, and what it is compared by with the
    others."""

    check: LogCheck
    readings: LogReadings


def check_entry(entry: CampaignLog, log: Log, rig: Rig, *, by_content: bool = False) -> CheckedLog:
    """Check one log of a campaign, as read, by itself; `by_content` as `check_campaign`."""
    by_row = all(trial.is_readings for trial in log.trials)
    declared = None if by_content and not by_row else entry.kind
    check = replace(check_log(log, rig, declared), use=entry.use)
    return CheckedLog(check, readings_of(log, entry.kind, rig, entry.file))


def checked_logs(
    campaign: Campaign, logs: Sequence[Log], *, by_content: bool = False
) -> list[CheckedLog]:
    """`check_entry` of every log of a campaign, as read."""
    pairs = zip(campaign.logs, logs, strict=True)
    return [check_entry(e, log, campaign.rig, by_content=by_content) for e, log in pairs]


def compared(
    campaign: Campaign, logs: Sequence[Log], checked: Sequence[CheckedLog]
) -> list[LogCheck]:
    """The checks of a campaign's logs, each with what it contradicts in the others or the rig."""
    names = [entry.file for entry in campaign.logs]
    lines: list[list[str]] = [[] for _ in checked]
    pairs = list(zip(campaign.logs, logs, strict=True))
    repeated = repeated_tests(pairs, campaign.rig)
    readings = [one.readings for one in checked]
    for found in (*located_contradictions(readings, campaign.rig), *repeated):
        # What is wrong in the rig file is said with the first log.
        lines[names.index(found.source) if found.source in names else 0].append(found.line)
    return [
        replace(one.check, contradicts=(*one.check.contradicts, *own))
        for one, own in zip(checked, lines, strict=True)
    ]


def check_campaign(campaign: Campaign, *, by_content: bool = False) -> list[LogCheck]:
    """Check every log of a campaign, with its rig and maps, and all together.

    `by_content`: what a log identifies goes by each test, not by the kind that is declared. Raises
    InputError.
    """
    logs = [campaign.read(entry) for entry in campaign.logs]
    return compared(campaign, logs, checked_logs(campaign, logs, by_content=by_content))


def check_log(log: Log, rig: Rig, declared: str | None = None) -> LogCheck:
    """Check one log as read; `declared` is the kind that a campaign gives it."""
    steps = np.concatenate([np.diff(t.time) for t in log.trials])
    period = float(np.median(steps))
    late = steps > signals.SAMPLE_MISSING * period
    regular = steps[~late]
    kinds: dict[str, int] = {}
    by_kind: dict[str, list[Trial]] = {}
    header = played_header(log.comments)
    for trial in log.trials:
        kind = _kind_in(trial, rig, declared, header)
        kinds[kind] = kinds.get(kind, 0) + 1
        by_kind.setdefault(kind, []).append(trial)
    bench = next(iter(by_kind)) if set(by_kind) & {*BENCH_LAWS} else None
    taken_as = FRICTION_POINTS if set(by_kind) == {FRICTION_POINTS} else declared
    identified = tuple(
        identifications(by_kind, rig, taken_as)
        if bench is None
        else bench_identified(bench, log.trials, rig)
    )
    if bench == TANK and rig.is_tank_alone and declared is None:
        # By its columns the same is a fill, of whose valve it gives the law.
        filled = {VALVE_TESTS: list(log.trials)}
        other = tuple(valves_identified(filled, rig))
        if any(one.identified for one in identified):
            identified += tuple(filling_of_tank(other))
        elif any(one.identified for one in other):
            by_kind, identified, kinds = filled, other, {VALVE_TESTS: len(log.trials)}
    designed, wrong = _as_designed(log, header, kinds, declared)
    channels = _measured_channels(log, rig)
    return LogCheck(
        file=str(log.path),
        kinds=kinds,
        tests=len(log.trials),
        rows=sum(len(t) for t in log.trials),
        duration_s=float(sum(t.time[-1] - t.time[0] for t in log.trials)),
        period_s=period,
        jitter_s=float(np.std(regular)),
        gaps=int(np.count_nonzero(late)),
        longest_gap_s=float(np.max(steps)) if late.any() else 0.0,
        channels=tuple(check_channel(log, name, rig) for name in channels),
        excitation=tuple(excitation(by_kind, rig)),
        identifies=identified,
        notices=(*designed, *(n for n in log.notices if n not in log.contradictions)),
        declared=declared,
        contradicts=(*log.contradictions, *wrong),
        excluded=log.excluded,
        by_row=all(trial.is_readings for trial in log.trials),
    )


def _kind_in(trial: Trial, rig: Rig, declared: str | None, header: PlayedHeader | None) -> str:
    """A trial's kind: of a bench as declared, else by its content.

    A motion by the motor alone may be either of two kinds: what a designed test is, it says.
    """
    if declared in BENCH_LAWS or declared == FRICTION_POINTS:
        return declared
    if declared == VALVE_TESTS and rig.is_tank_alone:  # by its columns the same as a discharge
        return declared
    # Of a tank alone no other test is made, whatever else the log holds.
    nothing = TANK if rig.is_tank_alone else "nothing commanded"
    found = bench_kind(trial, rig) or kind_of(trial, rig) or nothing
    by_motor = header is not None and header.kind == BY_MOTOR and found in FRICTION_TRIALS
    return BY_MOTOR if by_motor else found


def _as_designed(
    log: Log, header: PlayedHeader | None, kinds: Collection[str], declared: str | None
) -> tuple[list[str], list[str]]:
    """A notice that a log is a designed test's; what contradicts its header."""
    if header is None:
        return [], []
    wrong = []
    if declared is not None and declared != header.kind:
        wrong.append(
            f"{log.path}: is {header.told()}, but the campaign declares {declared}: "
            f'give kind = "{header.kind}"'
        )
    if other := [kind for kind in kinds if kind != header.kind]:
        wrong.append(
            f"{log.path}: its header says {header.kind}, its commands are those of {other[0]}: "
            "was another test recorded under this header?"
        )
    return [f"{log.path}: {header.told()}"], wrong


def _measured_channels(log: Log, rig: Rig) -> list[str]:
    present = log.channels
    # The integral of a speed is not a measurement: range and noise are those of the speed.
    motion = [rig.position_channel] if all(t.place_known for t in log.trials) else []
    motion.append(rig.units.speed_channel)
    names = [*motion, *READINGS, rig.effort_channel, *KIND_BY_COLUMN]
    return [n for n in names if n in present]


def check_channel(log: Log, name: str, rig: Rig) -> ChannelCheck:
    """Range, resolution, noise, stuck and saturated stretches of one channel."""
    trials = [t for t in log.trials if name in t]
    parts = [t[name] for t in trials]
    values = np.concatenate(parts)
    quantum = signals.quantum(values)
    noise = None
    if name not in KIND_BY_COLUMN and not any(t.is_readings for t in trials):
        noise = _noise([c for t in trials for c in _combs(t, name, rig)], quantum)
    stuck_s, saturated = 0.0, 0
    dithers = noise is not None and noise > 0.5 * quantum
    if name in PRESSURES and (dithers or np.ptp(values) == 0.0):
        low, high = float(np.min(values)), float(np.max(values))
        shortest = _stuck_run(noise or 0.0, quantum, len(values))
        for trial in trials:
            for start, stop in _runs(trial[name], shortest):
                stuck_s = max(stuck_s, float(trial.time[stop - 1] - trial.time[start]))
                if low < high and trial[name][start] in (low, high):
                    saturated += stop - start
    return ChannelCheck(
        name=name,
        low=float(np.min(values)),
        high=float(np.max(values)),
        quantum=quantum,
        noise_std=noise,
        stuck_s=stuck_s,
        saturated_share=saturated / len(values),
    )


def _stuck_run(noise: float, quantum: float, rows: int) -> int:
    """Equal readings in a row from which on a sensor of so many rows is stuck."""
    by_chance = signals.repeats_by_chance(noise, quantum, rows)
    return max(_STUCK_RUN, int(by_chance)) if math.isfinite(by_chance) else _STUCK_RUN


def _combs(trial: Trial, name: str, rig: Rig) -> list[FloatArray]:
    """A channel's samples, (n,) each, without the ripple of a PWM valve, which is not noise.

    Rows a whole number of PWM periods apart fall on the same point of a pulse.
    """
    values = trial[name]
    if name not in PRESSURES or rig.pwm is None or not is_active(trial, *DUTIES):
        return [values]
    stride = rows_per_ripple(trial, rig)
    combs = [values[start::stride] for start in {0, stride // 2}]
    return [c for c in combs if len(c) >= signals.FEWEST_FOR_NOISE] or [values]


def _noise(parts: Sequence[FloatArray], quantum: float) -> float | None:
    """Median of the tests' noise floors: one disturbed test does not raise it.

    In a file of many tests a sample of them, spread over the file, is used.
    """
    long = [p for p in parts if len(p) >= signals.FEWEST_FOR_NOISE]
    # Nine tests show the noise as well as all of them.
    some = long[:: -(-len(long) // 9)] if long else []
    floors = [signals.noise_floor(p, quantum).noise for p in some]
    return float(np.median(floors)) if floors else None


def _runs(values: FloatArray, shortest: int) -> list[tuple[int, int]]:
    """[start, stop) of every stretch of at least `shortest` equal samples."""
    repeats = signals.runs(np.diff(values) == 0.0)
    return [(first, last + 1) for first, last in repeats if last + 1 - first >= shortest]


def kind_of(trial: Trial, rig: Rig) -> str | None:
    """The trial's kind as in `docs/reference/log-format.md`; None where nothing is commanded.

    A motion driven by the motor alone is called `friction-motion`: it can identify the same
    as `motion-motor`. So is one that the logged chamber pressures alone drive.
    """
    held = is_held(trial, rig)
    if is_active(trial, *DUTIES):
        return "valve-pwm" if held else "motion-pwm"
    if is_active(trial, *SWITCHES):
        return "valve-discrete" if held else "motion-discrete"
    if is_active(trial, rig.effort_channel) and rig.position_channel in trial:
        return classify_trial(trial, rig)
    if not held and rig.position_channel in trial and rig.air_alone_drives(trial.channels):
        return MOTION
    return None
