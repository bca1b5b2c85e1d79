"""What a campaign is about, and how that is fitted, diagnosed, refined, validated and checked.

An actuator or one of its parts (`RigSubject`), or a component of the user's own (`OwnSubject`):
whatever goes through a campaign asks its subject, and nothing else tells the two apart.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sysid.checks.campaign_check import CampaignCheck, check_whole
from sysid.checks.log_check import LogCheck, check_campaign
from sysid.components.loading import component_in
from sysid.errors import input_error
from sysid.io.campaign import MOTION_KINDS, Campaign
from sysid.parameters import Bundle
from sysid.plant.effects.entry import Catalogue
from sysid.types import Progress

if TYPE_CHECKING:
    from sysid.components.refinement import OwnRefinement
    from sysid.diagnosis.result import Diagnosis
    from sysid.refinement.result import RefineResult
    from sysid.validation.results import ValidationResult

_EFFECTS = "effects act on the equations of an actuator or its parts"
_TERMS = "declare what your component may lack as its terms"


@dataclass(frozen=True)
class Subject(ABC):
    """A campaign's subject. Errors are those of what it calls (InputError, NotIdentifiedError)."""

    campaign: Campaign

    @property
    @abstractmethod
    def is_exported(self) -> bool:
        """Whether its law can be written as files for a controller."""

    @abstractmethod
    def fit(self, surface: str, seed: int, progress: Progress) -> tuple[Bundle, tuple[str, ...]]:
        """A bundle of all that the training logs identify, and notices."""

    def contradictions(self) -> tuple[str, ...]:
        """What the training logs say of one another that cannot be true."""
        return ()

    @abstractmethod
    def diagnose(
        self, bundle: Bundle, budget: float | None, progress: Progress, options: Mapping[str, Any]
    ) -> tuple[Diagnosis, tuple[str, ...]]:
        """What the bundle lacks, and notices; `options` of `sysid.diagnosis.campaign`."""

    @abstractmethod
    def refine(
        self, bundle: Bundle, progress: Progress, options: Mapping[str, Any]
    ) -> RefineResult | OwnRefinement:
        """All its parameters estimated by simulation error; `options` of `sysid.refinement`."""

    def why_not_refined(self, bundle: Bundle) -> str:
        """Why a bundle of it is not to be refined (again); empty where it is."""
        return "" if bundle.refinement is None else "it was refined already"

    @abstractmethod
    def is_validated(self, bundle: Bundle) -> bool:
        """Whether a bundle of it is simulated against whole tests."""

    @abstractmethod
    def validate(
        self, bundle: Bundle, catalogue: Catalogue | None, progress: Progress
    ) -> ValidationResult:
        """Its whole tests simulated open loop."""

    @abstractmethod
    def checks(self) -> list[LogCheck]:
        """What each log is good for."""

    @abstractmethod
    def check(self) -> CampaignCheck:
        """The same, and whether all training logs together identify everything."""


@dataclass(frozen=True)
class RigSubject(Subject):
    """An actuator, or a part of one tested alone."""

    is_exported = True

    def fit(self, surface: str, seed: int, progress: Progress) -> tuple[Bundle, tuple[str, ...]]:
        from sysid.pipeline.fit import fit_campaign

        found = fit_campaign(self.campaign, surface=surface, seed=seed, progress=progress)
        return found.bundle, found.notices

    def contradictions(self) -> tuple[str, ...]:
        from sysid.checks.consistency.campaign import check_consistency

        return tuple(check_consistency(self.campaign, "fit"))

    def diagnose(
        self, bundle: Bundle, budget: float | None, progress: Progress, options: Mapping[str, Any]
    ) -> tuple[Diagnosis, tuple[str, ...]]:
        from sysid.diagnosis.campaign import diagnose_logs

        return diagnose_logs(self.campaign, bundle, budget=budget, progress=progress, **options)

    def refine(
        self, bundle: Bundle, progress: Progress, options: Mapping[str, Any]
    ) -> RefineResult:
        from sysid.refinement.refine import refine  # loads jax

        return refine(self.campaign, bundle, progress=progress, **options)

    def why_not_refined(self, bundle: Bundle) -> str:
        """A part tested alone has no motion to simulate, save an axis with a motor."""
        from sysid.diagnosis.bench.registry import AXIS

        part = self._part(bundle)
        if part is not None and not (part == AXIS and self.campaign.rig.is_motor_alone):
            return "a part tested alone has no motion to simulate"
        return super().why_not_refined(bundle)

    def is_validated(self, bundle: Bundle) -> bool:
        """Where it has motion logs, and is a whole actuator or has its motion held out."""
        from sysid.diagnosis.bench.registry import AXIS
        from sysid.validation import VALIDATED_KINDS

        part = self._part(bundle)
        is_whole = part is None or (part == AXIS and self.campaign.select(MOTION_KINDS, "holdout"))
        return bool(is_whole and self.campaign.select(VALIDATED_KINDS, None))

    def _part(self, bundle: Bundle) -> str | None:
        from sysid.diagnosis.bench.registry import part_tested

        return part_tested(self.campaign.training_kinds(), bundle)

    def validate(
        self, bundle: Bundle, catalogue: Catalogue | None, progress: Progress
    ) -> ValidationResult:
        from sysid.validation import validate

        return validate(self.campaign, bundle, catalogue=catalogue, progress=progress)

    def checks(self) -> list[LogCheck]:
        return check_campaign(self.campaign)

    def check(self) -> CampaignCheck:
        return check_whole(self.campaign)


@dataclass(frozen=True)
class OwnSubject(Subject):
    """A component of the user's own: its law is the user's Python, and so are files of it."""

    is_exported = False

    def fit(self, surface: str, seed: int, progress: Progress) -> tuple[Bundle, tuple[str, ...]]:
        from sysid.components.campaign import fit_own

        found = fit_own(self.campaign, progress=progress)
        return found.bundle, found.notices

    def diagnose(
        self, bundle: Bundle, budget: float | None, progress: Progress, options: Mapping[str, Any]
    ) -> tuple[Diagnosis, tuple[str, ...]]:
        from sysid.components.campaign import diagnose_own

        if options.get("effects") is not None:
            raise input_error(self.campaign.path, _EFFECTS, _TERMS)
        return diagnose_own(
            self.campaign, bundle, budget=budget, quick=options["quick"], progress=progress
        )

    def refine(
        self, bundle: Bundle, progress: Progress, options: Mapping[str, Any]
    ) -> OwnRefinement:
        from sysid.components.refinement import refine_own

        return refine_own(self.campaign, bundle, progress=progress)

    def is_validated(self, bundle: Bundle) -> bool:
        return True

    def validate(
        self, bundle: Bundle, catalogue: Catalogue | None, progress: Progress
    ) -> ValidationResult:
        from sysid.components.validation import validate_own

        return validate_own(self.campaign, bundle, progress=progress)

    def checks(self) -> list[LogCheck]:
        from sysid.components.log_check import check_own

        return check_own(self.campaign)

    def check(self) -> CampaignCheck:
        from sysid.components.log_check import check_own_whole

        return check_own_whole(self.campaign)


def subject_of(campaign: Campaign) -> Subject:
    """The subject of a campaign."""
    return RigSubject(campaign) if component_in(campaign) is None else OwnSubject(campaign)


__all__ = ["OwnSubject", "RigSubject", "Subject", "subject_of"]
