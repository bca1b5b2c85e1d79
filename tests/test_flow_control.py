"""A flow control in series with a valve (thesis 3.6): logs with and without it, to the plant."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.flow_control import SeriesBench
from sysid.commands.app import main
from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.io.logs import Trial
from sysid.io.rig import rig_from_content
from sysid.parameters.assembled_model import parameters_from_bundle
from sysid.parameters.bundle import Bundle
from sysid.parameters.series import control_coefficient
from sysid.parameters.valves import DiscreteLaw
from sysid.plant import valve_laws
from sysid.valve_discrete import DiscreteFit, fit_valve_discrete

BENCH = SeriesBench(
    c_fill=(2.2e-6, 2.9e-6),
    c_dis=(3.9e-9, 5.5e-9),
    choked_fill=9.5e-4,
    choked_dis=3.6e-4,
    period=0.002,
    off=0.8,
    end=1.4,
)
KEYS = ("valve_c_fill", "control_c_fill", "valve_c_dis", "control_c_dis")
TRUTHS = dict(zip(KEYS, (*BENCH.c_fill, *BENCH.c_dis), strict=True))


@cache
def logged() -> tuple[tuple[Trial, ...], tuple[Trial, ...]]:
    """With the flow control, and without."""
    return tuple(BENCH.trials(1, 1)), tuple(BENCH.bare().trials(2, 1, "bare "))


@cache
def fitted(law: str = "auto", declared: bool = False, bare: bool = True) -> DiscreteFit:
    own, without = logged()
    given = [*own, *(without if bare else ())]
    return fit_valve_discrete(given, BENCH.rig(declared), find_ratio=False, law=law)["a"]


@pytest.mark.parametrize("declared", [False, True])
def test_both_coefficients_and_the_choice(declared: bool) -> None:
    fit = fitted(declared=declared, bare=not declared)
    assert fit.choice is not None and {*fit.choice.laws.values()} == {"thesis-series"}
    for key, truth in TRUTHS.items():
        found = fit.estimates[key]
        assert found.value == pytest.approx(truth, rel=0.01), key
        assert found.holds(truth) or (declared and key.startswith("valve"))
    assert np.isfinite(fit.estimates["valve_c_fill"].std) != declared
    assert fit.estimates["on_delay_s"].value == pytest.approx(BENCH.on_delay, abs=5e-5)
    assert {*fit.choice.rejected} == {"thesis", "iso6358"}


def test_without_what_the_valve_is_alone_only_both_together() -> None:
    fit = fitted(law="thesis-series", bare=False)
    assert fit.estimates["c_fill"].identified and fit.estimates["c_dis"].identified
    for key in KEYS:
        found = fit.estimates[key]
        assert not found.identified and "in combination only" in str(found.reason)
    law = fit.law()
    assert law.law_of("fill") == "thesis-series" and not law.series_keys()


def test_valves_without_a_flow_control_are_not_given_one() -> None:
    """Tests of another valve, declared to be without its flow control, are evidence against it."""
    own, _ = logged()
    alone = replace(BENCH, c_fill=(1.1e-6, None), c_dis=(2.0e-9, None), off=1.2, end=2.2)
    bare = alone.trials(3, 1, "bare ")
    fit = fit_valve_discrete([*own, *bare], BENCH.rig(), find_ratio=False)
    assert fit["a"].choice is not None and "thesis-series" not in fit["a"].choice.laws.values()
    assert any("evidence against a flow control" in line for line in fit.remarks)


def test_all_logs_without_a_flow_control() -> None:
    with pytest.raises(NotIdentifiedError, match="without its flow control: add tests with it"):
        fit_valve_discrete(list(logged()[1]), BENCH.rig(), find_ratio=False)


def test_the_law_in_a_bundle_is_the_plants() -> None:
    law = fitted().law()
    again = DiscreteLaw.model_validate(json.loads(json.dumps(law.to_json())))
    assert again == law and again.choice is not None
    assert [one.law for one in again.choice.rejected] == ["thesis", "iso6358"]
    bundle = _bundle(law)
    valve = parameters_from_bundle(bundle, bundle.rig).valve("a")
    for pressure in np.linspace(1.05e5, 2.95e5, 39):
        for is_open, line in ((True, BENCH.supply), (False, BENCH.atmosphere)):
            flow = (valve_laws.filling_flow if is_open else valve_laws.exhaust_flow)(
                valve, pressure, line
            )
            assert flow == pytest.approx(BENCH.flow(float(pressure), is_open), rel=0.01)


def _bundle(law: DiscreteLaw) -> Bundle:
    from sysid.parameters import FittedValves, Parts, Valve
    from sysid.parameters.friction import Friction

    known = {
        "static_n": Estimate(5.0, 0.1, "N", (4.8, 5.2)),
        "coulomb_n": Estimate(4.0, 0.1, "N", (3.8, 4.2)),
        "viscous_n_s_per_m": Estimate(9.0, 0.1, "N s/m", (8.8, 9.2)),
    }
    content = {**BENCH.rig().content, "inertia": {"mass_kg": 1.0}}
    parts = Parts(friction=Friction(**known), valves=FittedValves(a=Valve(discrete=law)))
    return Bundle.new(rig_from_content(content, "rig.toml"), parts, [])


def test_a_replaced_coefficient_renews_the_flow_controls() -> None:
    law = fitted().law()
    wider = law.replaced(c_fill=replace(law.c_fill, value=1.1 * law.c_fill.value))
    assert law.control_c_fill is not None and wider.control_c_fill is not None
    assert wider.control_c_fill.value > 1.2 * law.control_c_fill.value
    assert wider.control_c_dis == law.control_c_dis


@pytest.mark.parametrize(("way", "power"), [("fill", 2), ("dis", 1)])
def test_intervals_of_the_flow_control_hold(way: str, power: int) -> None:
    """Of what follows from two numbers with errors, drawn."""
    rng = np.random.default_rng(36)
    valve, control, share = 3.0, 6.0, 0.02
    both = (valve**-power + control**-power) ** (-1.0 / power)
    held = []
    for a, b in rng.standard_normal((400, 2)):
        found = control_coefficient(
            way, _known(both * (1.0 + share * a), share), _known(valve * (1.0 + share * b), share)
        )
        held.append(found.identified and found.holds(control))
    assert 0.92 <= np.mean(held) <= 0.98


def _known(value: float, share: float) -> Estimate:
    std = share * value
    return Estimate(value, std, "x", (value - 1.96 * std, value + 1.96 * std))


def test_a_flow_control_that_hinders_nothing_is_not_identified() -> None:
    found = control_coefficient("fill", _known(2.98, 0.02), _known(3.0, 0.02))
    assert not found.identified and "close it further" in str(found.reason)


def test_the_command_takes_logs_without_the_flow_control(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, (trial,) in zip(("with", "bare"), logged(), strict=True):
        columns = {"time_s": trial.time, **trial.channels}
        rows = np.column_stack([*columns.values()])
        head = ",".join(columns)
        np.savetxt(tmp_path / f"{name}.csv", rows, "%.9g", ",", header=head, comments="")
    text = []
    for section, values in BENCH.rig().content.items():
        text += [f"[{section}]", *(f"{k} = {json.dumps(v)}" for k, v in values.items())]
    (tmp_path / "rig.toml").write_text("\n".join(text), "utf-8")
    logs = "".join(
        f'[[log]]\nkind = "valve-discrete"\nfile = "{name}.csv"\n{more}\n'
        for name, more in (("with", ""), ("bare", "flow_control = false"))
    )
    campaign = tmp_path / "campaign.toml"
    campaign.write_text(f'rig = "rig.toml"\n{logs}', "utf-8")
    given, bare, bundle = (str(tmp_path / n) for n in ("with.csv", "bare.csv", "b.json"))
    page = tmp_path / "page.html"
    for arguments in (
        ["valve-discrete", given, "--without-control", bare, "--report", str(page)],
        [str(campaign)],
    ):
        assert main(["fit", *arguments, "-o", bundle, "--json"]) == 0
        found = json.loads(Path(bundle).read_text("utf-8"))
        law = found["valves"]["a"]["discrete"]
        assert law["law"] == {"fill": "thesis-series", "exhaust": "thesis-series"}
        assert law["control_c_fill"]["value"] == pytest.approx(BENCH.c_fill[1], rel=0.01)
        assert [log.get("flow_control") for log in found["provenance"]["logs"]] == [None, False]
    shown = page.read_text("utf-8")
    assert "Flow law of valve A: the law of a flow control in series follows" in shown
    assert "Broken lines: the law that was not chosen (the thesis&#39; law and ISO 6358)" in shown
    campaign.write_text(campaign.read_text("utf-8").replace("= false", '= "no"'), "utf-8")
    assert main(["fit", str(campaign)]) == 2
    assert "flow_control = 'no' is neither true nor false" in capsys.readouterr().err
