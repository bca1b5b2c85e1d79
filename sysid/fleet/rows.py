"""One campaign of a fleet: its rig, date and verdict, and the numbers whose trends are followed."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from sysid.errors import SysidError, one_line
from sysid.fleet.leakage import is_leakage, leakage_flow
from sysid.fleet.origin import Origin
from sysid.io.files import write_atomic
from sysid.io.motion import FRICTION
from sysid.parameters import Bundle
from sysid.parameters.table import DELAYS, ParameterRow
from sysid.plant.effects.entry import Catalogue

ROW_FILE = "row.json"

Family = Literal["friction", "leakage", "delay", "flow"]
FAMILIES: tuple[Family, ...] = ("friction", "leakage", "delay", "flow")
LEAKAGE = "leakage at supply pressure"


@dataclass(frozen=True)
class FleetReading:
    """One number of a campaign with its standard error; `name` as in the bundle."""

    family: Family
    name: str
    value: float
    std: float
    unit: str

    def to_json(self) -> dict[str, Any]:
        """In JSON types."""
        return dict(vars(self))


@dataclass(frozen=True)
class FleetRow:
    """A campaign that went through `run`, or (`failure`) why it came to no result.

    `folder` is that of its results within the fleet's; `verdict` None without a diagnosis,
    `is_whole` false for one that was cut short or a quick one; `effects` by id, each with its
    p-value; `readings` the numbers whose trends are followed; `rig` the content of its rig file by
    section, `fit_logs` the SHA-256 of what was fitted; `notices` those of its run, and of the
    stages that it found up to date. `exit_code`: what `run` ends with, 0 with a result. `alarm`:
    what the monitor of the rig's first campaign says of the motion logs of this one, empty where it
    is silent; None where there was nothing to watch.
    """

    campaign: str
    folder: str
    origin: Origin | None
    verdict: str | None = None
    sentence: str = ""
    is_whole: bool = True
    effects: Mapping[str, float] = field(default_factory=dict)
    readings: tuple[FleetReading, ...] = ()
    rig: Mapping[str, Any] = field(default_factory=dict)
    fit_logs: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()
    failure: str = ""
    exit_code: int = 0
    alarm: str | None = None

    @property
    def lacks_leakage(self) -> bool:
        """Whether a complete diagnosis searched for a leak and found none."""
        found = any(is_leakage(id) for id in self.effects)
        return self.verdict is not None and self.is_whole and not found

    def to_json(self) -> dict[str, Any]:
        """The content of its file."""
        return {
            "campaign": self.campaign,
            "folder": self.folder,
            "origin": self.origin and self.origin.to_json(),
            "verdict": self.verdict,
            "sentence": self.sentence,
            "is_whole": self.is_whole,
            "effects": dict(self.effects),
            "readings": [reading.to_json() for reading in self.readings],
            "rig": dict(self.rig),
            "fit_logs": list(self.fit_logs),
            "notices": list(self.notices),
            "failure": self.failure,
            "exit_code": self.exit_code,
            "alarm": self.alarm,
        }

    @classmethod
    def failed(
        cls, campaign: Path, folder: str, origin: Origin | None, why: str, exit_code: int
    ) -> FleetRow:
        """The row of a campaign without a result."""
        return cls(str(campaign), folder, origin, failure=one_line(why), exit_code=exit_code)

    def write(self, folder: Path) -> None:
        """Write it into the campaign's folder, whole or not at all."""
        write_atomic(folder / ROW_FILE, json.dumps(self.to_json(), indent=2) + "\n")


def readings_of(
    fitted: Bundle, final: Bundle, catalogue: Catalogue | None = None
) -> tuple[FleetReading, ...]:
    """The quantities tracked over time: friction and valves from the bench tests, and leakage.

    The bench tests' own fit (`fitted`) is estimated in the same way on every date; in the `final`
    bundle the same numbers have a different meaning once an effect was added. `catalogue` holds
    the effects of `final` (None: the project's own); a model that cannot be assembled gives no
    leakage.
    """
    found: list[FleetReading] = []
    for row in fitted.parameters.fitted().rows:
        if row.origin == "friction" and row.name in FRICTION:
            found += _reading("friction", row)
        elif row.name in DELAYS:
            found += _reading("delay", row)
        elif row.origin == "valve" and row.part.endswith(".discrete"):
            found += _reading("flow", row)
    return (*found, *_leakage(final, catalogue))


def _leakage(final: Bundle, catalogue: Catalogue | None) -> tuple[FleetReading, ...]:
    try:
        leak = leakage_flow(final, catalogue)
    except SysidError:  # one number less, the campaign's other results stand
        return ()
    return () if leak is None else (FleetReading("leakage", LEAKAGE, *leak, "kg/s"),)


def _reading(family: Family, row: ParameterRow) -> list[FleetReading]:
    known = row.estimate
    if not known.has_error:
        return []
    return [FleetReading(family, row.path, known.value, known.std, known.unit)]


def effects_of(bundle: Bundle) -> dict[str, float]:
    """The p-value of each effect of a bundle, by id, the smallest of its sides; NaN is omitted."""
    found: dict[str, float] = {}
    for effect in bundle.effects:
        p = 1.0 if effect.p_value is None else float(effect.p_value)
        if math.isfinite(p):
            found[effect.id] = min(p, found.get(effect.id, p))
    return found


__all__ = [
    "FAMILIES",
    "LEAKAGE",
    "ROW_FILE",
    "Family",
    "FleetReading",
    "FleetRow",
    "effects_of",
    "readings_of",
]
