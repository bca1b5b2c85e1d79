"""Whether a campaign can identify everything: each parameter with the training logs that do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import PurePath
from typing import Any

from sysid.blocks.tables import Table, table
from sysid.checks.bench import BENCH_LAWS, bench_identified
from sysid.checks.friction import Identification, friction_together
from sysid.checks.identifiability import switched_test, valves_identified
from sysid.checks.log_check import (
    CheckedLog,
    LogCheck,
    checked_logs,
    compared,
    kind_of,
    listed,
)
from sysid.io.campaign import (
    BENCH_KINDS,
    FRICTION_KINDS,
    FRICTION_POINTS,
    MOTION_KINDS,
    SIMULATED_KINDS,
    Campaign,
    CampaignLog,
)
from sysid.io.channels import CHAMBER_PRESSURES
from sysid.io.logs import Log, Trial
from sysid.io.rig import Rig
from sysid.recording.friction_kind import balances

# Ratio to the noise declared in the rig file from which a sensor's noise is reported.
_NOISY = 3.0
# Logs of one kind that a cell names; more are counted.
_NAMED = 3
_SWITCHED = ("choked filling flow", "c_fill", "choked exhaust flow", "c_dis")


@dataclass(frozen=True)
class Answer:
    """One parameter of a campaign.

    `logs` are the training logs that identify it, each alone, as the campaign names them; none
    where only all `together` do, or where the rig file gives it. `reason` says why it is not
    identified, or what it follows from; `needs` which test would identify it ("" where it is).
    """

    parameter: str
    identified: bool
    logs: tuple[str, ...] = ()
    together: bool = False
    reason: str = ""
    needs: str = ""

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {**asdict(self), "logs": list(self.logs)}


@dataclass(frozen=True)
class CampaignCheck:
    """The result of `sysid check` for a campaign: its logs in turn, and what they identify.

    `entries` are the campaign's logs, one to each check.
    """

    path: str
    entries: tuple[CampaignLog, ...]
    logs: tuple[LogCheck, ...]
    answers: tuple[Answer, ...]
    noise_pa: float | None = None

    @property
    def training(self) -> tuple[CampaignLog, ...]:
        """The logs that may identify something."""
        return tuple(e for e in self.entries if e.use == "fit")

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Contradictions between the logs, or with the rig file."""
        return tuple(dict.fromkeys(line for c in self.logs for line in c.contradicts))

    @property
    def answer(self) -> str:
        """Whether everything is identified, and else what is not and which test would do."""
        lacking: dict[str, list[str]] = {}
        for one in self.answers:
            if not one.identified:
                lacking.setdefault(one.needs or one.reason, []).append(one.parameter)
        if not self.training:
            said = 'nothing is identified: every log is held out; give some use = "fit"'
        elif not lacking and self.answers:
            said = "everything is identified"
        else:
            parts = (f"{listed(names)} ({why})" for why, names in lacking.items())
            said = f"not identified: {'; '.join(parts)}"
        return said + (", but logs or rig file contradict" if self.contradictions else "")

    def table(self) -> Table:
        """One row per parameter: the logs that identify it, or why none does."""
        names = _names(self.entries)
        # Parameters not identified for the same reason share a row, so that it is read once.
        rows: dict[tuple[str, str], list[str]] = {}
        for one in self.answers:
            key = ("yes", one.parameter) if one.identified else ("no", one.needs or one.reason)
            rows.setdefault(key, []).append(one.parameter)
        answers = {one.parameter: one for one in self.answers}
        shown = tuple(
            (
                "\n".join(parameters),
                mark,
                self._by(answers[parameters[0]], names) if mark == "yes" else reason,
            )
            for (mark, reason), parameters in rows.items()
        )
        return table("", ("parameter", "", "identified by"), shown)

    def _by(self, answer: Answer, names: Mapping[str, str]) -> str:
        """The logs that identify a parameter; of a kind of which there are many, their number."""
        if not answer.logs:
            return f"all together ({answer.reason})" if answer.together else answer.reason
        of_kind: dict[str, list[str]] = {}
        for entry in self.training:
            of_kind.setdefault(entry.kind, []).append(entry.file)
        parts = []
        for kind, files in of_kind.items():
            own = [f for f in dict.fromkeys(files) if f in answer.logs]
            if len(own) <= _NAMED:
                parts += [names[f] for f in own]
                continue
            others = [names[f] for f in dict.fromkeys(files) if f not in own]
            but = f", not {', '.join(others)}" if 0 < len(others) <= _NAMED else ""
            parts.append(f"{len(own)} of {len(files)} {kind} logs{but}")
        return ", ".join(parts)

    def remarks(self) -> Iterator[tuple[CampaignLog, str]]:
        """Remarks on the quality of each log, one line for each log that has any."""
        for entry, check in zip(self.entries, self.logs, strict=True):
            found = list(_remarks(check, self.noise_pa))
            if found:
                yield entry, "; ".join(found)


def _names(entries: Sequence[CampaignLog]) -> dict[str, str]:
    """Short names of a campaign's logs: without their suffix, and the folder that all share."""
    files = [PurePath(entry.file) for entry in entries]
    stems = [f.with_suffix("") for f in files]
    # It distinguishes runs of one name in two formats.
    kept = stems if len({*stems}) == len({*files}) else files
    folders = {f.parent for f in files}
    shared = folders.pop() if len(folders) == 1 else PurePath()
    return {e.file: str(name.relative_to(shared)) for e, name in zip(entries, kept, strict=True)}


def check_whole(
    campaign: Campaign,
    logs: Sequence[Log] | None = None,
    checked: Sequence[CheckedLog] | None = None,
) -> CampaignCheck:
    """Check every log of a rig's campaign, and what all training logs identify.

    `logs` are the campaign's as read and `checked` what each is good for by itself, None where
    that has not been done yet. A parameter is identified by a log alone, or by all of its kind
    together. Raises InputError.
    """
    logs = [campaign.read(entry) for entry in campaign.logs] if logs is None else logs
    checked = checked_logs(campaign, logs) if checked is None else checked
    checks = tuple(compared(campaign, logs, checked))
    answers = tuple(_answers(campaign, logs, checks))
    noise = campaign.rig.sensors.pressure_noise_pa
    return CampaignCheck(str(campaign.path), campaign.logs, checks, answers, noise)


def merged(
    entries: Sequence[CampaignLog],
    found: Sequence[Sequence[Identification]],
    together: Mapping[str, Identification],
) -> Iterator[Answer]:
    """Each parameter once, from what training logs identify alone (`found`, one to each entry) and
    together."""
    alone: dict[str, list[str]] = {}
    reasons: dict[str, str] = {}
    for entry, own in zip(entries, found, strict=True):
        for item in own:
            by = alone.setdefault(item.parameter, [])
            by += [entry.file] if item.identified else []
            reasons.setdefault(item.parameter, item.reason)
    for name in dict.fromkeys([*alone, *together]):
        by, joint = alone.get(name, []), together.get(name)
        if by:
            yield Answer(name, True, tuple(by))
        elif joint is not None and joint.identified:
            yield Answer(name, True, together=True, reason=joint.reason)
        else:
            yield Answer(name, False, reason=joint.reason if joint else reasons[name])


# --- of a rig -----------------------------------------------------------------------------


def _answers(
    campaign: Campaign, logs: Sequence[Log], checks: Sequence[LogCheck]
) -> Iterator[Answer]:
    pairs = [(e, c) for e, c in zip(campaign.logs, checks, strict=True) if e.use == "fit"]
    entries = [e for e, _ in pairs]
    found = [[i for i in c.identifies if _is_of(e, i.parameter)] for e, c in pairs]
    yes = {i.parameter for own in found for i in own if i.identified}
    lacking = {i.parameter for own in found for i in own} - yes
    together: dict[str, Identification] = {}
    if lacking and len(entries) > 1:
        tests = [
            (entry, trial)
            for entry, log in zip(campaign.logs, logs, strict=True)
            if entry.use == "fit"
            for trial in log.trials
        ]
        joint = _together(tests, campaign.rig)
        together = {i.parameter: i for i in joint if i.parameter not in yes}
        # A law is listed by its parameters once tests identify some of them.
        found = [[i for i in own if i.parameter in {*yes, *together}] for own in found]
    has_pwm = campaign.rig.pwm is not None or any("valve-pwm" in c.kinds for _, c in pairs)
    fitted = has_pwm and campaign.rig.has_pwm_surfaces
    for one in merged(entries, found, together):
        if "PWM surface" in one.parameter and not (one.identified or fitted):
            continue
        yield one if one.identified else _asked(one, campaign.rig, {e.kind for e in entries})


def _is_of(entry: CampaignLog, parameter: str) -> bool:
    """Whether a log can be fitted for a parameter: not for one of the other valve."""
    other = {"a": "valve B ", "b": "valve A "}.get(entry.valve or "", "")
    return not (other and parameter.startswith(other))


def _together(tests: Sequence[tuple[CampaignLog, Trial]], rig: Rig) -> Iterator[Identification]:
    """What the tests of the training logs identify together but no log alone."""
    for kind in BENCH_KINDS:
        trials = [t for e, t in tests if e.kind == kind]
        if trials and kind in BENCH_LAWS:
            yield from bench_identified(kind, trials, rig)
        elif trials:
            yield from friction_together(trials, FRICTION_POINTS, rig)
    rest = [(e, t) for e, t in tests if e.kind not in BENCH_KINDS]
    if not rest:
        return
    moving = [
        (t, "friction-motion" if e.kind in MOTION_KINDS else e.kind)
        for e, t in rest
        if e.kind in FRICTION_KINDS or (e.kind in MOTION_KINDS and balances(t, rig))
    ]
    if not rig.is_tank_alone:
        yield from friction_together([t for t, _ in moving], [k for _, k in moving], rig)
    for valve in rig.sides:
        by_kind: dict[str, list[Trial]] = {}
        for entry, trial in rest:
            if entry.valve in (None, valve):
                found = entry.kind if rig.is_tank_alone else kind_of(trial, rig)
                by_kind.setdefault(found or "", []).append(trial)
        yield from valves_identified(by_kind, rig, (valve,))


def _asked(one: Answer, rig: Rig, kinds: set[str]) -> Answer:
    """A parameter that no log identifies: given by the rig file, or with the test that it needs."""
    name = one.parameter
    if name == "inertia" and rig.has_declared_inertia:
        given = "as the rig file gives it; no log identifies it"
        return Answer(name, True, reason=given)
    suited, test = _test_for(name, rig)
    needs = "" if suited & kinds or not test else f"needs {test}"
    return Answer(name, False, reason=one.reason, needs=needs)


def _test_for(name: str, rig: Rig) -> tuple[set[str], str]:
    """The kinds of test that identify a parameter, and the test in words."""
    own, by_air = name.removesuffix(" friction").lower(), rig.has_air_alone
    if by_air and own in rig.friction_tests:
        return {*SIMULATED_KINDS}, rig.friction_tests[own]
    if name == "static friction":
        effort = rig.units.word
        return {"friction-static"}, f"a friction-static test: {effort} ramped slowly from zero"
    if name in ("Coulomb friction", "viscous friction"):
        test = "friction-sliding tests at two levels of the effort, or a friction-motion test"
        return {"friction-sliding", *SIMULATED_KINDS}, test
    if name in ("torque offset", "force offset"):
        test = "friction-motion tests in both directions"
        test = test if by_air else f"friction-sliding or {test}"
        return {"friction-sliding", *SIMULATED_KINDS}, test
    if name == "inertia":
        return {*SIMULATED_KINDS}, "a friction-motion test that accelerates and reverses"
    valve = name.removeprefix("valve ")[:1]
    if name.startswith("valve ") and name[8:] in _SWITCHED:
        return {"valve-discrete"}, switched_test(rig, valve)
    if name.startswith("valve ") and "PWM surface" in name:
        ways = "filling and discharging, at least five duties"
        return {"valve-pwm"}, f"valve-pwm tests of valve {valve}, {ways}"
    return set(), ""


# --- words --------------------------------------------------------------------------------


def _remarks(check: LogCheck, noise_pa: float | None) -> Iterator[str]:
    if check.gaps:
        many = f"{check.gaps} gap{'s' * (check.gaps > 1)}"
        yield f"{many}, {'the longest ' * (check.gaps > 1)}{check.longest_gap_s:.3g} s"
    for channel in check.channels:
        if channel.saturated_share:
            yield f"{channel.name} saturated in {100.0 * channel.saturated_share:.2g} %"
        elif channel.stuck_s:
            yield f"{channel.name} stuck for {channel.stuck_s:.3g} s"
        std = channel.sample_std
        if channel.name in CHAMBER_PRESSURES and noise_pa and std and std > _NOISY * noise_pa:
            times = std / noise_pa
            yield f"{channel.name}: noise {std:.3g} Pa, {times:.2g} times the rig file's"
    yield from (line for line in check.excitation if "does not change" in line)


__all__ = ["Answer", "CampaignCheck", "check_whole", "merged"]
