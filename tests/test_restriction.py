"""Flow over two pressures: ISO 6358's numbers, the law by evidence, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.diagnosis.bench.diagnose import diagnose_component
from sysid.diagnosis.bench.registry import component_of
from sysid.diagnosis.bench.restriction import Restriction
from sysid.errors import InputError, NotIdentifiedError
from sysid.io.campaign import read_campaign
from sysid.io.logs import Trial
from sysid.io.rig import rig_from_content
from sysid.parameters import Bundle, DiscreteLaw
from sysid.pipeline.fit import fit_campaign
from sysid.pipeline.fit_part import bench_fit
from sysid.plant.effects.catalogue import catalogue

RIG_TEXT = '[rig]\nname = "orifice"\norientation = "horizontal"\n'
RIG = rig_from_content({"rig": {"name": "orifice", "orientation": "horizontal"}}, "rig.toml")
C, B = 1.3e-8, 0.32


def readings(
    seed: int, *, count: int = 40, index: float = 0.5, noise: float = 0.003, **more: float
) -> Trial:
    """Settled readings at 3 to 7 bar upstream, from choked to nearly equal pressures; the noise is
    a share of the largest flow. Written apart from `sysid.plant`."""
    rng = np.random.default_rng(seed)
    up = np.repeat([3e5, 5e5, 7e5, 4e5], count // 4)
    ratio = np.tile(np.linspace(0.15, 0.98, count // 4), 4)
    beyond = np.clip((ratio - B) / (1.0 - B), 0.0, None)
    flow = C * 1.185 * up * (1.0 - beyond**2) ** index
    if "c_fill" in more:
        root = more["c_fill"] * np.sqrt(up * (1.0 - ratio))
        flow = np.where(ratio <= 0.53, more["c_fill"] * np.sqrt(0.47 / 5e5) * up, root)
    flow = flow + noise * flow.max() * rng.standard_normal(len(flow))
    channels = {
        "upstream_pressure_pa": up,
        "downstream_pressure_pa": ratio * up,
        "flow_a_kg_s": flow,
    }
    return Trial("1", np.arange(float(len(up))), channels, "flow.csv")


def law_of(*trials: Trial, law: str = "auto") -> DiscreteLaw:
    valves = bench_fit("valve-flow", trials, RIG, law).part().valves
    assert valves is not None
    found = valves.side("a").discrete
    assert found is not None
    return found


def test_conductance_and_ratio_hold_in_their_intervals() -> None:
    held = []
    for seed in range(40):
        found = law_of(readings(seed)).estimates()
        conductance, ratio = found["sonic_conductance.fill"], found["critical_ratio.fill"]
        assert conductance.value == pytest.approx(C, rel=0.01)
        assert ratio.value == pytest.approx(B, abs=0.02)
        held += [conductance.holds(C), ratio.holds(B)]
    # Of 80 at 95 %: 69 or fewer come about once in 2,000 such tests.
    assert sum(held) >= 70


def test_an_index_of_its_own_and_the_thesis_law_are_told_from_the_standard() -> None:
    laminar = law_of(readings(1, index=0.75, noise=0.002)).estimates()
    assert laminar["subsonic_index.fill"].holds(0.75)
    assert law_of(readings(1)).estimates()["subsonic_index.fill"].value == 0.5
    root = law_of(readings(1, c_fill=2e-6, noise=0.002))
    assert root.law_of("fill") == "thesis"
    assert root.c_fill.value == pytest.approx(2e-6, rel=0.01)
    assert law_of(readings(1, c_fill=2e-6), law="iso6358").law_of("fill") == "iso6358"


def test_the_law_is_complete_and_an_exhaust_is_one() -> None:
    trial = readings(3)
    closed = Trial("1", trial.time, {**trial.channels, "valve_a": 0.0 * trial.time}, "flow.csv")
    parts = bench_fit("valve-flow", [closed], RIG).part()
    bundle = Bundle.new(RIG, parts, [])
    assert {"valves.a.discrete.critical_ratio.exhaust"} < set(bundle.parameters)
    found = diagnose_component("valve-flow", [closed], [readings(4)], RIG, bundle, catalogue())
    assert found.verdict == "adequate"
    discrete = bundle.valve("a").discrete
    assert discrete is not None and discrete.law_of("dis") == "iso6358"
    assert discrete.law_of("fill") == "thesis"


def test_what_a_test_lacks_is_said() -> None:
    trial = readings(1)

    def changed(**channels: np.ndarray) -> Trial:
        return Trial("1", trial.time, {**trial.channels, **channels}, "flow.csv")

    gauge = changed(downstream_pressure_pa=trial["downstream_pressure_pa"] - 3e5)
    with pytest.raises(InputError, match=r"flow\.csv: downstream_pressure_pa = .* absolute"):
        component_of("valve-flow", [gauge], RIG)
    with pytest.raises(NotIdentifiedError, match="of which 0 have a flow"):
        component_of("valve-flow", [changed(flow_a_kg_s=0.0 * trial.time)], RIG)
    lacking = {k: v for k, v in trial.channels.items() if k != "upstream_pressure_pa"}
    with pytest.raises(InputError, match="column upstream_pressure_pa is missing"):
        component_of("valve-flow", [Trial("1", trial.time, lacking, "flow.csv")], RIG)
    ratio = trial["downstream_pressure_pa"] / trial["upstream_pressure_pa"]
    backwards = changed(flow_a_kg_s=1e-3 * (ratio > 0.9))
    with pytest.raises(NotIdentifiedError, match="more than it explains"):
        bench_fit("valve-flow", [backwards], RIG, "thesis")


def test_a_campaign_of_a_file(tmp_path: Path) -> None:
    trial = readings(2)
    names = ["time_s", *trial.channels]
    rows = np.column_stack([trial.time, *trial.channels.values()])
    np.savetxt(tmp_path / "flow.csv", rows, delimiter=",", header=",".join(names), comments="")
    (tmp_path / "rig.toml").write_text(RIG_TEXT, "utf-8")
    log = 'rig = "rig.toml"\n[[log]]\nkind = "valve-flow"\nfile = "flow.csv"\n'
    (tmp_path / "campaign.toml").write_text(log, "utf-8")
    bundle = fit_campaign(read_campaign(tmp_path / "campaign.toml")).bundle
    discrete = bundle.valve("a").discrete
    assert discrete is not None and discrete.law_of("fill") == "iso6358"
    assert isinstance(component_of("valve-flow", [trial], RIG).in_form_of(bundle), Restriction)
