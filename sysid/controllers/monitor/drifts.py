"""What may drift in a machine, and the kinds that a monitor distinguishes."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.io.channels import SIDES
from sysid.io.motion import MotionUnits

FRICTION, LEAKAGE, DELAY, SUPPLY = KINDS = ("friction", "leakage", "delay", "supply")
UNDECIDED = "undecided"
FLOWS = {
    "choked_fill": "choked filling",
    "c_fill": "unchoked filling",
    "choked_dis": "choked exhaust",
    "c_dis": "unchoked exhaust",
}
"""A valve's flows, whose errors in the bundle are no drift, by name."""


@dataclass(frozen=True)
class Drift:
    """A number of the machine that may leave its value; `kind` empty: a nuisance, never an alarm.

    `grows_only`: below 0 it has no meaning.
    """

    name: str
    kind: str
    title: str
    side: str = ""
    grows_only: bool = False

    def unit(self, units: MotionUnits) -> str:
        """The unit of its change."""
        if self.name in ("coulomb", "offset"):
            return units.effort
        if self.name == "viscous":
            return units.unit("viscous")
        return {LEAKAGE: "kg/(s Pa2)", DELAY: "s", SUPPLY: "Pa"}.get(self.kind, "1")


DRIFTS: tuple[Drift, ...] = (
    Drift("coulomb", FRICTION, "Coulomb friction"),
    Drift("viscous", FRICTION, "viscous friction"),
    Drift("offset", "", "effort of a load"),
    Drift("inertia", "", "inertia, relative"),
    Drift("piston_leak", LEAKAGE, "leak past the piston, at supply pressure", grows_only=True),
    *(
        Drift(
            f"leak_{s}",
            LEAKAGE,
            f"leak of chamber {s.upper()}, at supply pressure",
            s,
            grows_only=True,
        )
        for s in SIDES
    ),
    *(
        Drift(f"{edge}_delay_{s}", DELAY, f"{edge}-delay of valve {s.upper()}", s)
        for s in SIDES
        for edge in ("on", "off")
    ),
    Drift("supply", SUPPLY, "supply pressure"),
    *(
        Drift(f"{name}_{s}", "", f"{said} flow of valve {s.upper()}, relative", s)
        for s in SIDES
        for name, said in FLOWS.items()
    ),
)
NAMES = tuple(drift.name for drift in DRIFTS)
COUNT = len(DRIFTS)
SHAFT = tuple(NAMES.index(n) for n in ("coulomb", "viscous", "offset", "inertia"))
"""The drifts that move the shaft's innovations."""
CHAMBER = {
    side: tuple(
        NAMES.index(name)
        for name in (
            "piston_leak",
            f"leak_{side}",
            f"on_delay_{side}",
            f"off_delay_{side}",
            "supply",
            *(f"{name}_{side}" for name in FLOWS),
        )
    )
    for side in SIDES
}
"""Those that move a chamber's, in the order of `terms.ChamberTerms.slopes`."""
TESTED = tuple(k for k, drift in enumerate(DRIFTS) if drift.kind)
TAILS = sum(1 if DRIFTS[k].grows_only else 2 for k in TESTED)
"""How many tails the tests of one cycle have."""

__all__ = [
    "CHAMBER",
    "COUNT",
    "DELAY",
    "DRIFTS",
    "FLOWS",
    "FRICTION",
    "KINDS",
    "LEAKAGE",
    "NAMES",
    "SHAFT",
    "SUPPLY",
    "TAILS",
    "TESTED",
    "UNDECIDED",
    "Drift",
]
