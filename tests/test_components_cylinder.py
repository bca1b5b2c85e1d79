"""How seal friction grows with pressure on the measured cylinder, by 1, 3 and 5 bar alone.

The 7 bar of the set are held out (datasets/measured/cylinder): no file of theirs is read here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from sysid.diagnosis.bench.axis import Axis, axis
from sysid.diagnosis.bench.component import rmse
from sysid.diagnosis.bench.fitting import fit_law
from sysid.io.conversion import convert
from sysid.io.logs import Trial, read_log
from sysid.io.rig import read_rig
from sysid.plant.base import Array, array_namespace
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.entry import CatalogueEffect, Quantity
from sysid.plant.ports import Point

SET = Path(__file__).resolve().parent.parent / "datasets" / "measured" / "cylinder"
BAR = (1, 3, 5)
AREA, SEAL = (catalogue()[name] for name in ("area-error", "seal-friction"))


@dataclass(frozen=True)
class PowerSeal(CatalogueEffect):
    """Seal friction as a power of the gauge pressures' sum: + s p^n sign w, p in bar."""

    seal_n: Array = 0.0
    exponent: Array = 1.0

    id = "power-seal"
    title = "Seal friction as a power of the pressure"
    subsystem = "friction"
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("seal_n", "N", 3.0, 0.0, 100.0, "at 1 bar"),
        Quantity("exponent", "-", 1.0, 0.2, 4.0, "n", is_strength=False, grid=(0.5, 1.0, 2.0)),
    )
    signature = "force against the pressure"
    source = "this test"

    @property
    def power(self) -> Array:
        return self.exponent

    def friction_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(point.pressure_a, self.seal_n)
        gauge = point.pressure_a + point.pressure_b - 2.0 * point.parameters.atmosphere
        pressure = xp.maximum(gauge / 1e5, 1e-3)
        return effort + self.seal_n * pressure**self.power * point.direction


def fixed(n: float) -> type[CatalogueEffect]:
    """The same with one exponent for good."""

    @dataclass(frozen=True)
    class Fixed(PowerSeal):
        id = f"power-seal-{n:g}"
        quantities = PowerSeal.quantities[:1]

        @property
        def power(self) -> Array:
            return n

    return Fixed


@pytest.fixture
def x_ring(shared_data: Path, tmp_path: Path) -> Axis:
    rig, trials = read_rig(SET / "rig_257.toml"), list[Trial]()
    for bar in BAR:
        source = shared_data / "zillen_cylinder" / "friction" / f"X-ring257_{bar}bar.csv"
        convert(source, tmp_path / f"{bar}.csv", spec_file=SET / "recipe.toml")
        trials += read_log(tmp_path / f"{bar}.csv", rig).trials
    return axis(trials, rig)


def test_the_exponent_of_the_pressure_is_one(x_ring: Axis) -> None:
    fitted = fit_law(x_ring, [AREA, PowerSeal], range(len(BAR)))
    found = fitted.estimates(fitted.law.effects[1])["exponent"]
    assert found.interval[0] < 1.0 < found.interval[1] < 1.5


def test_no_steeper_law_predicts_5_bar_from_1_and_3(x_ring: Axis) -> None:
    errors = [
        rmse(x_ring.residuals(fit_law(x_ring, [AREA, fixed(n)], [0, 1]).law, [2]))
        for n in (1.0, 1.5, 2.0)
    ]
    assert np.all(np.diff(errors) > 0.0)
    assert errors[0] < 0.5 * rmse(x_ring.residuals(fit_law(x_ring, (), [0, 1]).law, [2]))


def test_an_effect_that_is_needed_is_so_in_any_order(x_ring: Axis) -> None:
    """`seal-friction` has a share that acts nowhere on this cylinder: it says nothing of another.

    Taken for the area's number, it had the area removed as superfluous beside the seals.
    """
    every = range(len(x_ring.tests))
    alone = fit_law(x_ring, [SEAL], every)
    last = fit_law(x_ring, [SEAL, AREA], every).p_value(alone)
    first = fit_law(x_ring, [AREA, SEAL], every).p_value(alone)
    assert last < 1e-3
    # Of either order's own minimum: tens of powers of ten, of which a fit's end changes a part.
    assert math.log(first) == pytest.approx(math.log(last), rel=0.05)
