"""The tests of a component of the user's own, and the component on them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.components.definition import DynamicComponent
from sysid.components.dynamic import DynamicPart
from sysid.components.loading import LoadedComponent, component_in
from sysid.components.parts import OwnPart, effects_in, scales_of, stretches_of
from sysid.components.static import StaticPart
from sysid.diagnosis.bench.component import Law
from sysid.errors import InputError, NotIdentifiedError, input_error
from sysid.io.campaign import Campaign
from sysid.io.logs import Log, Trial
from sysid.io.plausibility import TYPED_TO
from sysid.parameters import Bundle
from sysid.parameters.fitted_logs import check_log


@dataclass(frozen=True)
class OwnTests:
    """The tests of a campaign's component: training and held-out ones, and the readers' notices.

    `logs` are the campaign's in turn, each with its use.
    """

    loaded: LoadedComponent
    fitted: tuple[Trial, ...]
    held_out: tuple[Trial, ...]
    notices: tuple[str, ...]
    logs: tuple[tuple[str, Log], ...] = ()

    @property
    def all_trials(self) -> tuple[Trial, ...]:
        """Training and held-out tests."""
        return (*self.fitted, *self.held_out)


def loaded_in(campaign: Campaign) -> LoadedComponent:
    """The component of a campaign. Raises InputError where it was read without one."""
    loaded = component_in(campaign)
    if loaded is None:
        raise input_error(
            campaign.path, "was read without a component", "give its file with --component"
        )
    return loaded


def runs_own_code(campaign: Campaign) -> str:
    """Says that the user's own code runs."""
    loaded = loaded_in(campaign)
    return f"runs the user's own code: {loaded.path or 'class'} ({loaded.name})"


def tests_of(campaign: Campaign, bundle: Bundle | None = None) -> OwnTests:
    """Read a campaign's logs. Raises InputError where one lacks a column or cannot be used.

    With `bundle` also where a log has changed since it was fitted, or is held out and was fitted;
    that the component's file has changed is a notice.
    """
    loaded = loaded_in(campaign)
    trials: dict[str, list[Trial]] = {"fit": [], "holdout": []}
    notices = [*campaign.notices, *campaign.rig.notices]
    logs = []
    for entry in campaign.logs:
        log = campaign.read(entry)
        if bundle is not None:
            check_log(bundle, log, entry.kind, entry.use)
        require_columns(log, loaded)
        trials[entry.use] += log.trials
        notices += log.notices
        logs.append((entry.use, log))
    notices += out_of_range(loaded, (*trials["fit"], *trials["holdout"]))
    notices += [] if bundle is None else _other_law(bundle, loaded)
    fitted, held_out = tuple(trials["fit"]), tuple(trials["holdout"])
    return OwnTests(loaded, fitted, held_out, tuple(notices), tuple(logs))


def require_columns(log: Log, loaded: LoadedComponent) -> None:
    """InputError that names the first column that a log lacks."""
    for name, unit in loaded.columns.items():
        if log.trials and name not in log.trials[0]:
            raise missing_column(log, name, unit)


def missing_column(log: Log, name: str, unit: str) -> InputError:
    """The error of a log that lacks a column, with how to add it."""
    return input_error(
        log.path,
        f"column {name} ({unit or 'a ratio'}) is missing",
        f'add it, or map it in the campaign file: map = {{ {name} = "COLUMN:UNIT" }}',
    )


def out_of_range(loaded: LoadedComponent, trials: Sequence[Trial]) -> list[str]:
    """A line for each column that leaves what its declaration says can be measured."""
    lines = []
    for name, column in loaded.definition.columns.items():
        sizes = [abs(b) for b in (column.lower, column.upper) if math.isfinite(b)]
        slack = TYPED_TO * max(sizes, default=0.0)
        for trial in trials:
            low, high = float(np.min(trial[name])), float(np.max(trial[name]))
            if low < column.lower - slack or high > column.upper + slack:
                bounds = f"{column.lower:g} to {column.upper:g} {column.unit}".rstrip()
                asked = f"is it in {column.unit}?" if column.unit else "is it a ratio?"
                lines.append(
                    f"{trial.source}: {name} runs from {low:.4g} to {high:.4g}, outside the "
                    f"declared {bounds}: {asked}"
                )
                break
    return lines


def part_of(
    loaded: LoadedComponent,
    trials: Sequence[Trial],
    scales: Sequence[float],
    kept: Sequence[str] = (),
) -> OwnPart:
    """The component on tests; `scales` of its outputs are those of the training tests."""
    make: Callable[..., OwnPart] = StaticPart
    if isinstance(loaded.definition, DynamicComponent):
        make = DynamicPart
    return make(loaded, stretches_of(trials), tuple(scales), tuple(kept))


def law_in(tests: OwnTests, bundle: Bundle) -> tuple[OwnPart, Law]:
    """The component on all tests, and the law of a bundle with the terms in it.

    Raises InputError for terms that are unknown, NotIdentifiedError where the bundle lacks the law.
    """
    kept = [effect.id for effect in effects_in(bundle, tests.loaded)]
    scales = scales_of(tests.loaded, tests.fitted or tests.held_out)
    part = part_of(tests.loaded, tests.all_trials, scales, kept)
    return part, part.law_of(bundle)


def training_part(tests: OwnTests, kept: Sequence[str] = ()) -> OwnPart:
    """The component on its training tests. Raises NotIdentifiedError without one."""
    if not tests.fitted:
        raise NotIdentifiedError(
            f'component {tests.loaded.kind}: no log has use = "fit"; give it some'
        )
    return part_of(tests.loaded, tests.fitted, scales_of(tests.loaded, tests.fitted), kept)


def _other_law(bundle: Bundle, loaded: LoadedComponent) -> list[str]:
    """A notice where the file has changed since the fit."""
    record = bundle.component
    if record is None or not record.sha256 or record.sha256 == loaded.sha256:
        return []
    return [f"{loaded.file} is not the file that the bundle was fitted with (SHA-256)"]


__all__ = [
    "OwnTests",
    "law_in",
    "loaded_in",
    "missing_column",
    "out_of_range",
    "part_of",
    "runs_own_code",
    "tests_of",
    "training_part",
]
