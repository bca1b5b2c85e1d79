"""Which parameters a log of a part on a bench identifies: those that the fit of it returns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from sysid.checks.friction import Identification
from sysid.errors import InputError, NotIdentifiedError
from sysid.io.logs import Trial
from sysid.io.rig import Rig

COLUMNS = {
    "pump_volts": "tank",
    "flow_a_kg_s": "valve-flow",
    "time_to_pressure_s": "valve-time",
}
"""Columns that logs of one kind alone have."""
BENCH_LAWS = tuple(COLUMNS.values())
"""Kinds of test that give a law of a tank or a valve."""


def bench_kind(trial: Trial) -> str | None:
    """The kind of a bench test by its columns; None for any other test."""
    return next((kind for name, kind in COLUMNS.items() if name in trial), None)


def bench_identified(kind: str, trials: Sequence[Trial], rig: Rig) -> Iterator[Identification]:
    """Every parameter of the part's law in turn; one line where its tests cannot be used."""
    from sysid.diagnosis.bench.fitting import fit_law
    from sysid.diagnosis.bench.registry import component_of

    try:
        component = component_of(kind, trials, rig)
        fitted = fit_law(component, (), range(len(component.tests)))
    except (InputError, NotIdentifiedError) as error:
        yield Identification(f"the law of {kind} tests", False, str(error))
        return
    count = len(component.recordings)
    tests = f"{count} of {len(trials)} {kind} test{'s' * (len(trials) > 1)}"
    for name, estimate in fitted.base_estimates().items():
        yield Identification(name, estimate.identified, estimate.reason or tests)


__all__ = ["BENCH_LAWS", "COLUMNS", "bench_identified", "bench_kind"]
