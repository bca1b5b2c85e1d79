"""Reports of small generated parts: an axis, a cylinder under pressure, a tank."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

import sysid as si
from sysid.diagnosis.bench.diagnose import diagnose_component
from sysid.diagnosis.content import content
from sysid.io.campaign import read_campaign
from sysid.pipeline.check import checks_of
from sysid.pipeline.diagnose import extended_bundle
from sysid.pipeline.pages.report import render_report
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.linear import for_rig

ATMOSPHERE = 101325.0
AIR = f"""
[air]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
temperature_k = 293.15
atmospheric_pressure_pa = {ATMOSPHERE}
supply_pressure_pa = 800000.0
"""
CYLINDER = """
[cylinder]
area_a_m2 = 4.909e-4
area_b_m2 = 4.909e-4
offset_a_m = 0.1
offset_b_m = 0.1
stroke_m = 0.12

[inertia]
mass_kg = 0.2
"""
LINEAR = '[rig]\nname = "{}"\nmotion = "linear"\norientation = "horizontal"\n'
TANK = f'[rig]\nname = "tank"\norientation = "horizontal"\n{AIR}\n[tank]\nvolume_m3 = 0.001\n'


def _moved(seed: int) -> tuple[np.ndarray, ...]:
    """10 s at 100 Hz along several sines: time, position, velocity, acceleration."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 10.0, 0.01)
    waves = ((0.25, 0.045), (0.6, 0.012), (1.1, 0.006))
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    position = np.zeros(len(time))
    for (frequency, size), phase in zip(waves, phases, strict=True):
        position += size * np.sin(2.0 * np.pi * frequency * time + phase)
    velocity = np.gradient(position, time)
    return time, position, velocity, np.gradient(velocity, time)


def _axis(seed: int) -> pd.DataFrame:
    """Viscous friction that differs by direction."""
    time, position, velocity, acceleration = _moved(seed)
    force = 90.0 * acceleration + 20.0 * np.sign(velocity) + 200.0 * velocity
    force += -40.0 * np.abs(velocity) + 0.5 * np.random.default_rng(seed).normal(size=len(time))
    return pd.DataFrame({"time_s": time, "position_m": position, "motor_force_n": force})


def _cylinder(seed: int) -> pd.DataFrame:
    """Friction that grows with the pressure of a chamber, here of one log each."""
    time, position, velocity, acceleration = _moved(seed)
    gauge = 1e5 * (1.0 + seed % 5)
    noise = np.random.default_rng(seed).normal(size=(2, len(time)))
    force = 0.2 * acceleration + (3.0 + 8e-6 * gauge) * np.sign(velocity) + 4.909e-4 * gauge
    return pd.DataFrame(
        {
            "time_s": time,
            "position_m": 0.8 * position,
            "motor_force_n": force + 0.3 * noise[0],
            "pressure_b_pa": ATMOSPHERE + gauge + 100.0 * noise[1],
        }
    )


def _tank(seed: int) -> pd.DataFrame:
    """Discharge through an orifice from one of several levels; the pump runs for 2 s."""
    time = np.arange(0.0, 30.0, 0.05)
    level = 1e4 * (1.0 + seed % 5)
    root = np.maximum(np.sqrt(level) - 8.0 * np.maximum(time - 2.0, 0.0), 0.0)
    noise = 8.0 * np.random.default_rng(seed).normal(size=len(time))
    volts = np.where(time < 2.0, 5.0, 0.0)
    return pd.DataFrame(
        {"time_s": time, "pressure_a_pa": ATMOSPHERE + root**2 + noise, "pump_volts": volts}
    )


Maker = Callable[[int], pd.DataFrame]
_PARTS: dict[str, tuple[str, str, Maker, tuple[str, ...]]] = {
    "axis": (
        LINEAR.format("axis"), "friction-motion", _axis, ("asymmetric-viscous-friction",),
    ),
    "cylinder": (
        LINEAR.format("cylinder") + AIR + CYLINDER, "friction-motion", _cylinder,
        ("seal-friction", "asymmetric-coulomb-friction"),
    ),
    "tank": (TANK, "tank", _tank, ("subsonic-flow-shape", "wall-heat-transfer")),
}  # fmt: skip
PART_NAMES = tuple(_PARTS)


def write_part_report(name: str, folder: Path) -> Path:
    """A campaign of the part, fitted, diagnosed with a few effects only, and its report."""
    rig, kind, make, ids = _PARTS[name]
    home = folder / name
    home.mkdir()
    (home / "rig.toml").write_text(rig)
    entries = ['rig = "rig.toml"\n']
    for seed, use in ((1, "fit"), (2, "fit"), (3, "fit"), (4, "holdout")):
        make(seed).to_csv(home / f"test_{seed}.csv", index=False)
        entries.append(f'[[log]]\nkind = "{kind}"\nfile = "test_{seed}.csv"\nuse = "{use}"\n')
    (home / "campaign.toml").write_text("\n".join(entries))
    campaign = read_campaign(home / "campaign.toml")
    # By the law that the tests would not choose, whose misfit is an effect.
    bundle = si.fit(campaign, law="thesis")
    trials = {
        use: [t for e in campaign.logs if e.use == use for t in campaign.read(e).trials]
        for use in ("fit", "holdout")
    }
    known = for_rig(catalogue(), campaign.rig.is_linear)
    found = diagnose_component(
        kind,
        trials["fit"],
        trials["holdout"],
        campaign.rig,
        bundle,
        {id: known[id] for id in ids},
        quick=True,
    )
    assert found.effects, f"no effect is found in the generated {name}"
    path = home / "report.html"
    html = render_report(
        campaign=campaign,
        bundle=extended_bundle(bundle, found, campaign),
        checks=checks_of(campaign),
        diagnosis=content(found),
    )
    path.write_text(html, "utf-8")
    return path
