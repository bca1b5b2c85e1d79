"""The outcome of a run in three lines: how well the model follows, what it lacks, what to do
next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.blocks.quality import quality_name
from sysid.diagnosis import wording
from sysid.diagnosis.wording import is_of_actuator
from sysid.io.channels import channel_of
from sysid.parameters import Bundle, Validation
from sysid.pipeline.pages.next_steps import known_step, which_it_is


def verdict_lines(
    bundle: Bundle,
    diagnosis: Mapping[str, Any] | None,
    skipped: str = "",
    advice: Mapping[str, Any] | None = None,
) -> tuple[str, str, str]:
    """The three lines, from the final bundle and the diagnosis (None where it was `skipped`);
    `advice` as in `next_steps.next_line`."""
    reason = skipped.removeprefix("diagnosis: ")
    none = f"not possible: {reason}" if skipped else "none was made"
    found = none if diagnosis is None else wording.sentence(diagnosis)
    return (
        f"Model: {_model(bundle)}",
        f"Diagnosis: {found}",
        f"Next: {_next(bundle, diagnosis, bool(skipped), advice)}",
    )


def _model(bundle: Bundle) -> str:
    fits = _fits(bundle.validation)
    if not fits:
        return f"not validated on motion; {_laws(bundle)}"
    use = "held-out" if any(use == "holdout" for use, *_ in fits) else "training"
    chosen = [f for f in fits if (f[0] == "holdout") == (use == "held-out")]
    said = []
    for title in dict.fromkeys(title for _, _, title, _ in chosen):
        own = sorted(fit for _, _, name, fit in chosen if name == title)
        said.append(f"{title} fits to {_span(own[0], own[-1])} %")
    logs = len({log for _, log, _, _ in chosen})
    return f"{', '.join(said)} on {logs} {use} log{'s' * (logs > 1)}, simulated open loop"


_Log = tuple[str, str | None, str | None]


def _fits(validation: Validation | None) -> list[tuple[str, _Log, str, float]]:
    """Use, log, channel's title and fit percentage under the first valve model of each log.

    Logs of several folders may share a file name: the digest distinguishes them.
    """
    found: list[tuple[str, _Log, str, float]] = []
    seen: set[tuple[_Log, str]] = set()
    for log in [] if validation is None else validation.validated():
        key = (log.file, log.sha256, log.kind)
        if (key, log.use) in seen:
            continue
        seen.add((key, log.use))
        for name, channel in log.channels.items():
            if channel.fit_percent is not None:
                fit = float(channel.fit_percent)
                found.append((log.use, key, channel_of(name).name, fit))
    return found


def _span(low: float, high: float) -> str:
    return f"{low:.1f}" if f"{low:.1f}" == f"{high:.1f}" else f"{low:.1f} to {high:.1f}"


def _laws(bundle: Bundle) -> str:
    """The verdicts on the laws' own fits, the same ones together."""
    groups: dict[str, list[str]] = {}
    for place, one in bundle.qualities().items():
        groups.setdefault(one.verdict.partition(":")[0], []).append(quality_name(place))
    said = [f"{verdict}: {', '.join(names)}" for verdict, names in groups.items()]
    return f"its laws' fits are {'; '.join(said)}" if said else "no law was judged"


def _next(
    bundle: Bundle,
    diagnosis: Mapping[str, Any] | None,
    is_impossible: bool,
    advice: Mapping[str, Any] | None,
) -> str:
    if diagnosis is None and is_impossible:
        if bundle.rig.is_tank_alone:
            return "add tank tests, which a diagnosis of a tank needs"
        return "add the tests that the diagnosis needs"
    if diagnosis is None:
        return "sysid diagnose finds what the model lacks"
    # As the report does, which weighs them by simulated motion.
    is_weighed = bundle.validation is not None and is_of_actuator(diagnosis)
    known = known_step(bundle, diagnosis, advice, lambda: is_weighed) or which_it_is(diagnosis)
    if known:
        lines = wording.advice(diagnosis)
        more = f" ({len(lines) - 1} more in the report)" if len(lines) > 1 else ""
        return f"{known.removesuffix('.')}{more}"
    open_ones = "no open question"
    if is_weighed:
        open_ones = "no open question on effects; the report weighs the errors of the numbers"
    is_advised = bundle.component is None and is_of_actuator(diagnosis)
    return f"{open_ones}{'; sysid advise names the most informative test' if is_advised else ''}"


__all__ = ["verdict_lines"]
