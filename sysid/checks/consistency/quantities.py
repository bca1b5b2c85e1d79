"""What is read from every log of a campaign so that the logs can be compared."""

from __future__ import annotations

from dataclasses import dataclass

RIG = "the rig file"


@dataclass(frozen=True)
class SharedQuantity:
    """A number that every log of a rig should agree on.

    Two values are reported where they differ by the factor `large` and their intervals do not
    overlap. `slips` says which slip of a log would do that, `effects` names the catalogue's
    entries that could. In `slips`, {ratio} stands for the factor, {inverse} for one over it, and
    {time} for the factor of a log's time base, to whose `power` the quantity is proportional.
    """

    name: str
    unit: str
    large: float
    slips: str
    effects: str
    power: float = 1.0


@dataclass(frozen=True)
class Reading:
    """One log's value of a quantity with its 95 % interval.

    `by` says by what, where a log gives several (`its motor`); `slips` which slip would change
    this reading alone, in addition to those of the quantity.
    """

    quantity: SharedQuantity
    source: str
    value: float
    low: float
    high: float
    by: str = ""
    slips: str = ""

    @property
    def title(self) -> str:
        """`motion_pwm.csv by its motor`."""
        return f"{self.source} by {self.by}" if self.by else self.source

    @property
    def shown(self) -> str:
        """`0.0230 (0.0228 to 0.0232) kg m2`."""
        limits = f"({self.low:.3g} to {self.high:.3g})" if self.low < self.high else ""
        return " ".join(filter(None, (f"{self.value:.3g}", limits, self.quantity.unit)))


__all__ = ["RIG", "Reading", "SharedQuantity"]
