"""A tank's discharge: its law, what it lacks, and what the measured tank shows."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.tanks import drawn as adiabatic_tank
from sysid.blocks.numbers import number
from sysid.checks.bench import bench_identified, bench_kind
from sysid.checks.friction import friction_identified
from sysid.checks.log_check import check_log
from sysid.diagnosis.bench.component import Law, rmse
from sysid.diagnosis.bench.fitting import fit_law
from sysid.diagnosis.bench.law_choice import chosen_law
from sysid.diagnosis.bench.selection import select
from sysid.diagnosis.bench.tank import TankComponent, tank
from sysid.diagnosis.wording import advice_on_rest
from sysid.errors import InputError, NotIdentifiedError, subject_of
from sysid.estimation.linear import Estimate
from sysid.io.conversion import convert
from sysid.io.logs import Log, Trial, read_log
from sysid.io.rig import Rig, read_rig, rig_from_content
from sysid.parameters import Bundle, FittedValves, Valve
from sysid.parameters.files import shipped_schema
from sysid.pipeline.fit_part import bench_fit
from sysid.plant.effects.catalogue import catalogue

MEASURED = Path(__file__).resolve().parent.parent / "datasets" / "measured" / "pump_tank"

P0, T, R, K, VOLUME = 1.0e5, 293.15, 287.0, 1.4, 1e-3
C_DIS = 9e-10
CHOKED = 1.0e-4
CONDUCTANCE = 0.4
LEVELS_PA = (1.2e4, 2.5e4, 4.0e4, 6.0e4)

RIG = {
    "rig": {"name": "tank", "orientation": "horizontal"},
    "air": {
        "gas_constant_j_per_kg_k": R,
        "heat_capacity_ratio": K,
        "temperature_k": T,
        "atmospheric_pressure_pa": P0,
        "supply_pressure_pa": 6e5,
    },
    "tank": {"volume_m3": VOLUME},
}


def discharge(
    level: float,
    seed: int,
    *,
    conductance: float = 0.0,
    root: float = 0.0,
    choked: float = np.inf,
    noise: float = 8.0,
) -> Trial:
    """2 s at `level` Pa gauge with the pump on, then 40 s of discharge, at 20 Hz.

    Written down apart from `sysid.plant`: the gas' mass and temperature are the states.
    `root` kg/(s Pa^0.5) is the flow through an orifice beside c_dis.
    """
    from scipy.integrate import solve_ivp

    time = np.arange(0.0, 42.0, 0.05)

    def rates(_: float, state: NDArray[np.float64]) -> list[float]:
        mass, gas = state
        excess = mass * R * gas / VOLUME - P0
        flow = min(C_DIS * excess + root * np.sqrt(max(excess, 0.0)), choked)
        # As in 3.3.6: what leaves takes the enthalpy of air at the ambient temperature.
        heat = conductance * (T - gas)
        c_v = R / (K - 1.0)
        return [-flow, (-flow * (K * c_v * T - c_v * gas) + heat) / (mass * c_v)]

    mass = (P0 + level) * VOLUME / (R * T)
    after = time >= 2.0
    found = solve_ivp(
        rates, (0.0, 41.0), [mass, T], t_eval=time[after] - 2.0, rtol=1e-9, atol=1e-12
    )
    pressure = np.full(len(time), P0 + level)
    pressure[after] = found.y[0] * R * found.y[1] / VOLUME
    pressure += noise * np.random.default_rng(seed).standard_normal(len(time))
    volts = np.where(after, 0.0, 5.0)
    channels = {"pressure_a_pa": pressure, "pump_volts": volts}
    return Trial(f"{level:g}", time, channels, f"tank {level:g}")


def rig() -> Rig:
    return rig_from_content(RIG, "rig.toml")


def made(seed: int, **how: float) -> TankComponent:
    return tank(
        [discharge(level, 10 * seed + i, **how) for i, level in enumerate(LEVELS_PA)], rig()
    )


FEW = (
    "wall-heat-transfer",
    "atmosphere-leakage",
    "exhaust-back-pressure",
    "pressure-offset",
    "friction-position",
    "choked-exhaust-scaling",
    "supply-droop",
    "piston-leakage",
)
SOME = {key: kind for key, kind in catalogue().items() if key in FEW}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_law_is_found_and_nothing_beside_it(seed: int) -> None:
    part = made(seed)
    selection = select(part, SOME)
    assert selection.additions == ()
    estimate = selection.base.base_estimates()["c_dis"]
    # The start of each discharge is known to some 6 Pa of 12 to 60 kPa.
    assert abs(estimate.value / C_DIS - 1.0) < 1e-3
    assert rmse(part.residuals(selection.base.law, range(4))) < 2.0 * 8.0 / np.sqrt(2.0)


def test_heat_through_the_wall_is_found() -> None:
    part = made(1, conductance=CONDUCTANCE)
    selection = select(part, SOME)
    assert selection.additions[0].id == "wall-heat-transfer"
    conductance = getattr(selection.final.law.effects[0], "wall_conductance_w_per_k")  # noqa: B009
    assert abs(conductance / CONDUCTANCE - 1.0) < 0.03


@pytest.mark.parametrize("seed", [1, 2])
def test_the_walls_conductance_is_the_true_one(seed: int) -> None:
    part = made(seed, conductance=CONDUCTANCE)
    kind = catalogue()["wall-heat-transfer"]
    near = Law({"c_dis": 0.9 * C_DIS}, (kind.neutral(side="a", wall_conductance_w_per_k=0.2),))
    fitted = fit_law(part, [kind], range(4), near)
    found = fitted.estimates(fitted.law.effects[0])["wall_conductance_w_per_k"]
    assert abs(found.value / CONDUCTANCE - 1.0) < 0.03
    assert abs(fitted.law.values["c_dis"] / C_DIS - 1.0) < 5e-3
    assert rmse(part.residuals(fitted.law, range(4))) < 2.0 * 8.0 / np.sqrt(2.0)


def real_gas(is_isothermal: bool, seed: int) -> Trial:
    """Gas with a temperature of its own, as warm as the wall or without heat from it, that leaves
    by the thesis' flow."""
    from scipy.integrate import solve_ivp

    start, time = 1.6e5, np.arange(0.0, 8.0, 0.02)

    def rate(_: float, pressure: NDArray[np.float64]) -> NDArray[np.float64]:
        cooled = 1.0 if is_isothermal else K * (pressure / start) ** ((K - 1.0) / K)
        return np.asarray(-cooled * R * T / VOLUME * 5e-9 * (pressure - P0))

    run = solve_ivp(rate, (0.0, 8.0), [start], t_eval=time, rtol=1e-10, atol=1e-6)
    shown = np.concatenate([np.full(10, start), run.y[0]])
    shown += 8.0 * np.random.default_rng(seed).normal(size=len(shown))
    valve = (np.arange(len(shown)) < 10).astype(float)
    return Trial("t", 0.02 * np.arange(len(shown)), {"pressure_a_pa": shown, "valve_a": valve}, "x")


@pytest.mark.parametrize("is_isothermal", [True, False], ids=["isothermal", "adiabatic"])
def test_what_the_gas_temperature_does_to_the_coefficient_is_said(is_isothermal: bool) -> None:
    trials = [real_gas(is_isothermal, seed) for seed in (1, 2)]
    component = tank(trials, rig())
    fitted = fit_law(component, (), range(2))
    error = 5e-9 / fitted.law.values["c_dis"]
    assert error > (1.38 if is_isothermal else 1.05)
    own = component.wall_ranges["c_dis"]
    low, high = (5e-9 / limit for limit in reversed(fitted.base_estimates()["c_dis"].interval))
    assert own.low <= high and low <= own.high and own.high - own.low < 0.2
    assert own.reaches_all is is_isothermal and own.reaches_none is not is_isothermal
    found = bench_fit("tank", trials, rig(), "thesis")
    (line,) = [line for line in found.notices if "times as large" in line]
    assert subject_of(line) == "valves.a.discrete" and f"c_dis {own.low:.2f}" in line


def test_gas_that_cools_is_the_law_where_the_tests_tell() -> None:
    """Of adiabatic gas the coefficient is the true one; as warm as the wall, what it leaves is what
    3.3.6 leaves, of a coefficient 1.4 times as small, and this is said."""
    trials = [real_gas(False, seed) for seed in (1, 2)]
    found = bench_fit("tank", trials, rig())
    law = found.part().valves.side("a").discrete
    assert law is not None and law.law_of("dis") == "thesis"
    low, high = law.estimates()["c_dis"].interval
    assert low <= 5e-9 <= high and high / low < 1.005
    wall = law.wall_conductance_w_per_k
    assert isinstance(wall, Estimate) and wall.holds(0.0) and wall.interval[1] < 0.05
    assert any("gas that cools" in line and "distinguish" not in line for line in found.notices)
    bundle = Bundle.new(rig(), found.part(), [])
    component = tank(trials, rig()).in_form_of(bundle)
    left = component.residuals(component.law_of(bundle), range(2))
    assert rmse(left) < 2.0 * 8.0
    assert "wall-heat-transfer" not in {kind.id for kind in component.effects(catalogue())}

    found = bench_fit("tank", [real_gas(True, seed) for seed in (1, 2)], rig())
    law = found.part().valves.side("a").discrete
    assert law is not None and law.wall_conductance_w_per_k is None
    estimate = law.estimates()["c_dis"]
    assert estimate.value == pytest.approx(5e-9 / K, rel=2e-3)
    assert any("do not distinguish" in line for line in found.notices)
    # The interval reaches from the one to the other, and no farther; the error is as large.
    assert estimate.holds(5e-9) and estimate.holds(5e-9 / K)
    low, high = estimate.interval
    assert high - low < 1.1 * (5e-9 - 5e-9 / K)
    assert estimate.std == pytest.approx((high - low) / (2.0 * 1.96), rel=1e-3)


@pytest.mark.parametrize("kind, seed", [("isothermal", 2), ("short", 1)])
def test_gas_as_warm_as_the_wall_is_among_the_laws(kind: str, seed: int) -> None:
    """Where its search began with walls that conduct less, and where its wall's number is at the
    bound: what its coefficient would be is in the interval."""
    draw = adiabatic_tank(kind, seed)
    found = bench_fit("tank", draw.trials, draw.rig)
    law = found.part().valves.side("a").discrete
    assert law is not None
    true = draw.truth["c_dis"] * (1.0 if kind == "isothermal" else K)
    assert law.estimates()["c_dis"].holds(true) and law.estimates()["c_dis"].holds(true / K)
    (line,) = [line for line in found.notices if "do not distinguish" in line]
    assert "by thesis with gas that cools" in line


def test_an_insulated_tank_conducts_nothing() -> None:
    """Tests that want a little more than no heat from the wall still have that law."""
    drawn = adiabatic_tank("adiabatic", 810)
    law = bench_fit("tank", drawn.trials, drawn.rig).part().valves.side("a").discrete
    assert law is not None
    for key, true in drawn.truth.items():
        low, high = law.estimates()[key].interval
        assert low <= true <= high and high / low < 1.002, key
    wall = law.wall_conductance_w_per_k
    assert isinstance(wall, Estimate) and wall.value == wall.interval[0] == 0.0
    assert wall.std > 0.0 and wall.interval[1] > 0.0


def test_an_effect_acts_on_gas_that_cools() -> None:
    """One through the pressure outside, by which the choked boundary moves, and one of the heat."""
    part = dataclasses.replace(made(1), has_temperature=True)
    values = {"c_dis": C_DIS, "adiabatic_share": 0.5}
    kinds = catalogue()
    without = np.concatenate(part.residuals(Law(values), range(4)))
    for effect in (
        kinds["exhaust-back-pressure"].neutral(back_pressure_pa_s_per_kg=1e8),
        kinds["polytropic-exponent"].neutral(exponent_change=-0.1),
    ):
        changed = np.concatenate(part.residuals(Law(values, (effect,)), range(4)))
        assert np.isfinite(changed).all() and np.abs(changed - without).max() > 50.0


def test_laws_together_are_what_each_is_alone() -> None:
    """To the last bit: with a state, with a sensor's lag, and with another start for each."""
    part = made(1)
    kinds = catalogue()
    laws = [
        Law(
            {"c_dis": scale * C_DIS},
            (
                kinds["wall-heat-transfer"].neutral(side="a", wall_conductance_w_per_k=scale),
                kinds["pressure-offset"].neutral(pressure_offset_pa=100.0 * scale, side="a"),
            ),
        )
        for scale in (0.5, 1.0, 1.7)
    ]
    together = part.residuals_of(laws, [0, 2])
    for law, found in zip(laws, together, strict=True):
        for alone, one in zip(part.residuals(law, [0, 2]), found, strict=True):
            assert np.array_equal(alone, one)
    assert np.max(np.abs(together[0][0] - together[1][0])) > 100.0


def test_a_fit_simulates_its_derivatives_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two simulations a step of the search at most, however many numbers are fitted."""
    from sysid.diagnosis.bench import tank_gas as module

    part, kind = made(1, conductance=CONDUCTANCE), catalogue()["subsonic-flow-shape"]
    simulated, runs = module.simulated, []

    def counted(starts: NDArray[np.float64], *rest: Any) -> Any:
        runs.append(len(starts))
        return simulated(starts, *rest)

    monkeypatch.setattr(module, "simulated", counted)
    near = Law({"c_dis": C_DIS}, (kind.neutral(exhaust_blend=0.5),))
    fitted = fit_law(part, [kind], range(4), near)
    assert len(fitted.fit.values) >= 4
    assert len(runs) <= 2 * fitted.fit.evaluations + 4
    assert max(runs) >= 2 * 4 * 3 * 2


def test_a_root_of_the_pressure_is_a_subsonic_flow_shape() -> None:
    """Not ISO's own law, and yet held-out levels are predicted much better with it."""
    part = made(4, root=1e-7)
    kinds = catalogue()
    lone, shaped = (
        fit_law(part, [kinds[k] for k in ids], [0, 1, 3]) for ids in ((), ("subsonic-flow-shape",))
    )
    errors = [rmse(part.residuals(fit.law, [2])) for fit in (lone, shaped)]
    assert errors[1] < 0.3 * errors[0]


def test_effects_of_what_a_tank_lacks_are_not_tried() -> None:
    found = {kind.id for kind in made(1).effects(catalogue())}
    assert found >= {"wall-heat-transfer", "subsonic-flow-shape", "atmosphere-leakage"}
    lacking = {
        "piston-leakage",
        "supply-droop",
        "choked-exhaust-scaling",
        "stribeck",
        "valve-delay",
    }
    assert not found & lacking


def test_a_discharge_from_above_the_boundary_has_a_choked_flow() -> None:
    trials = [discharge(level, i, choked=CHOKED) for i, level in enumerate((1.5e5, 2.5e5))]
    part = tank(trials, rig())
    assert [p.name for p in part.parameters()] == ["c_dis", "choked_flow_dis_kg_s"]
    fitted = fit_law(part, (), [0, 1])
    # The truth chokes at CHOKED / C_DIS above the atmosphere, the law at P0 / 0.53.
    assert abs(fitted.law.values["choked_flow_dis_kg_s"] / CHOKED - 1.0) < 0.05
    assert "choked-exhaust-scaling" in {kind.id for kind in part.effects(catalogue())}


def test_bundle_holds_the_law_and_gives_it_back() -> None:
    import jsonschema

    part = made(1)
    fitted = fit_law(part, (), range(4))
    found = part.part(fitted.base_estimates())
    assert found.valves is not None
    schema = shipped_schema()
    valve = {**schema["$defs"]["Valve"], "$defs": schema["$defs"]}
    jsonschema.validate(found.valves.side("a").to_json(), valve)
    bundle = Bundle.new(rig(), found, [])
    assert part.law_of(bundle) == Law(fitted.law.values)
    discrete = bundle.valve("a").discrete
    assert discrete is not None
    assert "choked boundary" in str(discrete.choked_flow_dis_kg_s.reason)
    lacking = discrete.replaced(c_dis=discrete.choked_flow_dis_kg_s)
    spoilt = bundle.replaced(valves=FittedValves(a=Valve(discrete=lacking)))
    with pytest.raises(NotIdentifiedError, match="c_dis is not identified"):
        part.law_of(spoilt)


def test_regressors_match_the_residuals() -> None:
    part = made(1)
    law = Law({p.name: p.value for p in part.parameters()})
    count = sum(len(r) for r in part.residuals(law, [1, 3]))
    assert {len(v) for v in part.regressors([1, 3]).values()} == {count}


def test_what_a_test_lacks_is_said() -> None:
    trial = discharge(3e4, 0)
    pressure, volts = trial["pressure_a_pa"], trial["pump_volts"]

    def changed(**channels: NDArray[np.float64]) -> Trial:
        return Trial("1", trial.time, channels, "log.csv")

    with pytest.raises(InputError, match=r"log\.csv: column pump_volts is missing"):
        tank([changed(pressure_a_pa=pressure)], rig())
    with pytest.raises(InputError, match=r"log\.csv: column pressure_a_pa is missing"):
        tank([changed(pump_volts=volts)], rig())
    with pytest.raises(NotIdentifiedError, match="c_dis is not identified: pump_volts is never"):
        tank([changed(pressure_a_pa=pressure, pump_volts=volts * 0.0 + 5.0)], rig())
    with pytest.raises(NotIdentifiedError, match="Pa above the atmosphere"):
        tank([changed(pressure_a_pa=0.0 * pressure + P0, pump_volts=volts)], rig())
    without = rig_from_content({k: v for k, v in RIG.items() if k != "tank"}, "rig.toml")
    with pytest.raises(InputError, match=r"rig.toml: section \[tank\] is missing"):
        tank([trial], without)


def test_a_test_without_a_discharge_is_left_out() -> None:
    """And says so; only where no test has one is nothing identified."""
    empty, full = discharge(10.0, 1), [discharge(level, 2) for level in LEVELS_PA]
    part = tank([empty, *full], rig())
    assert len(part.tests) == len(full)
    (line,) = part.left_out
    assert line.startswith("excluded: tank 10: c_dis is not identified")
    with pytest.raises(NotIdentifiedError, match="tank 10: c_dis"):
        tank([empty], rig())


@pytest.mark.parametrize(
    ("columns", "missing"),
    [
        ({"pressure_b_pa": 3e5}, '--map "pressure_a_pa=pressure_b_pa"'),
        ({"pressure_a_pa": 3e5, "valve_b": 0.0}, "column pump_volts is missing"),
    ],
)
def test_a_tank_on_the_other_sides_columns_is_a_tank(
    columns: dict[str, float], missing: str
) -> None:
    time = np.arange(0.0, 5.0, 0.01)
    channels = {name: np.full(len(time), value) for name, value in columns.items()}
    trial = Trial("1", time, channels, "log.csv")
    assert bench_kind(trial, rig()) == "tank"
    (row,) = bench_identified("tank", [trial], rig())
    assert row.reason.startswith("this is a tank's discharge") and missing in row.reason


@pytest.mark.parametrize(
    ("columns", "of"),
    [
        ({"pressure_a_pa": 1e5, "theta_rad": 0.0}, "filling (a rig file with a [tank] alone)"),
        ({"pressure_a_pa": -1e5, "pressure_b_pa": -1.0}, "discharge (a rig file with a [tank] al"),
        ({"pressure_a_pa": 1e5}, "filling (one pressure, and a rig file with [tank])"),
    ],
)
def test_of_a_tank_alone_every_log_is_a_tanks(columns: dict[str, float], of: str) -> None:
    """By how much each of its columns rises: one that falls is of a discharge."""
    time = np.arange(0.0, 5.0, 0.01)
    channels = {name: 3e5 + rise * time / time[-1] for name, rise in columns.items()}
    log = Log(Path("tank.csv"), "", (Trial("", time, channels, "tank.csv"),), (), rig())
    assert check_log(log, rig()).answer.startswith(
        f"tank.csv identifies nothing: this is a tank's {of}"
    )


@pytest.mark.parametrize("command", ["valve_a", "pump_volts"])
def test_a_tank_without_its_pressure_lacks_that(command: str) -> None:
    time = np.arange(0.0, 5.0, 0.01)
    trial = Trial("1", time, {command: (time < 2.0).astype(float)}, "log.csv")
    assert bench_kind(trial, rig()) == "tank"
    (row,) = bench_identified("tank", [trial], rig())
    assert "column pressure_a_pa is missing" in row.reason and "motor" not in row.reason


@pytest.mark.parametrize("extra", [{}, {"valve_a": 0.0}, {"theta_rad": 0.0}])
def test_one_pressure_may_be_a_tanks_whose_rig_file_does_not_say_so(
    extra: dict[str, float],
) -> None:
    time = np.arange(0.0, 5.0, 0.01)
    columns = {"pressure_a_pa": 3e5, **extra}
    channels = {name: np.full(len(time), value) for name, value in columns.items()}
    trial = Trial("1", time, channels, "log.csv")
    arm = Rig("arm", "horizontal", "rotary")
    (reason,) = {row.reason for row in friction_identified([trial], arm)}
    assert "motor_torque_nm is missing" in reason
    assert ("rig file has [tank]" in reason) == ("theta_rad" not in extra)


def test_check_says_what_a_tank_identifies() -> None:
    trials = [discharge(level, 3) for level in LEVELS_PA]
    log = Log(Path("tank.csv"), "", tuple(trials), (), rig())
    check = check_log(log, rig(), "tank")
    assert check.kinds == {"tank": len(trials)}
    found = {item.parameter: item for item in check.identifies}
    assert found["c_dis"].identified and f"of {len(trials)} tank tests" in found["c_dis"].reason
    assert not any("friction" in name for name in found)
    # Undeclared, it is known by its columns.
    assert check_log(log, rig()).kinds == check.kinds


def test_numbers_that_differ_between_tests_have_wide_intervals() -> None:
    """Each test its own coefficient: the interval is that of their scatter, not of the noise."""
    same = [discharge(level, 4) for level in LEVELS_PA]
    stretch = (0.9, 1.0, 1.1, 0.95)
    other = [dataclasses.replace(t, time=f * t.time) for t, f in zip(same, stretch, strict=False)]
    widths = []
    for trials in (same, other):
        part = tank(trials, rig())
        estimate = fit_law(part, (), range(len(part.tests))).base_estimates()["c_dis"]
        widths.append(float(np.ptp(estimate.interval)) / estimate.value)
    assert widths[0] < 0.01 and widths[1] > 0.1


def test_a_valve_command_serves_as_the_pump() -> None:
    trial = discharge(3e4, 0)
    on = (trial["pump_volts"] > 0.0).astype(float)
    other = Trial("1", trial.time, {"pressure_a_pa": trial["pressure_a_pa"], "valve_a": on}, "l")
    one, two = tank([trial], rig()).discharges[0], tank([other], rig()).discharges[0]
    assert np.array_equal(one.pressure, two.pressure)


def test_a_valve_that_is_off_throughout_begins_with_the_discharge() -> None:
    trial = discharge(4.0e4, 3)
    begun = int(np.flatnonzero(trial["pump_volts"] != 0.0)[-1]) + 1
    falling = {"pressure_a_pa": trial["pressure_a_pa"][begun:]}
    time = trial.time[begun:]
    alone = Trial("1", time, {**falling, "valve_a": np.zeros(len(time))}, "l")
    one, two = tank([trial], rig()).discharges[0], tank([alone], rig()).discharges[0]
    assert np.array_equal(one.pressure, two.pressure)


def test_measured_tank_is_predicted_twice_as_well(shared_data: Path, tmp_path: Path) -> None:
    """Levels that nothing was fitted on, by the wall's heat and the shape of the flow."""
    described = read_rig(MEASURED / "rig.toml")
    content = tomllib.loads((MEASURED / "set.toml").read_text())
    campaign = tomllib.loads((MEASURED / "campaign.toml").read_text())
    logs = {}
    for entry in content["convert"]:
        path = tmp_path / entry["log"]
        source = shared_data / content["folder"] / entry["source"]
        convert(source, path, spec_file=MEASURED / entry["recipe"])
        logs[entry["log"]] = read_log(path, described).trials[0]
    fitted, held = (
        tank([logs[e["file"]] for e in campaign["log"] if e["use"] == use], described)
        for use in ("fit", "holdout")
    )
    kinds = catalogue()

    def error(law: Law) -> float:
        return rmse(held.residuals(law, range(len(held.tests))))

    tests = range(len(fitted.tests))
    thesis = error(fit_law(fitted, (), tests).law)
    both = [kinds["subsonic-flow-shape"], kinds["wall-heat-transfer"]]
    extended = error(fit_law(fitted, both, tests).law)
    assert extended < 0.5 * thesis
    # ISO 6358's law in place of the thesis', adiabatic: the least that any size of it leaves.
    iso = min(
        error(Law({"c_dis": c_dis}, (kinds["subsonic-flow-shape"].neutral(exhaust_blend=1.0),)))
        for c_dis in np.linspace(3e-10, 9e-10, 13)
    )
    assert extended < 0.5 * iso


def resized(trial: Trial, size: float, every: int) -> Trial:
    """The discharge of a tank `size` times as large, of which every so many rows are logged."""
    chosen = slice(None, None, every)
    channels = {name: values[chosen] for name, values in trial.channels.items()}
    return Trial(trial.label, size * trial.time[chosen], channels, trial.source)


@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.parametrize("size", [3e-3, 0.1, 1.0, 40.0])
def test_a_tank_of_any_size_on_its_own_time_scale(size: float, every: int) -> None:
    """The same rows over another time: 0.13 to 1680 s, down to some 19 rows a time constant."""
    content = {**RIG, "tank": {"volume_m3": size * VOLUME}}
    trials = [resized(discharge(level, 5, noise=4.0), size, every) for level in LEVELS_PA]
    part = tank(trials, rig_from_content(content, "rig.toml"))
    assert part.left_out == ()
    found = fit_law(part, (), range(len(part.tests))).base_estimates()["c_dis"]
    assert found.value == pytest.approx(C_DIS, rel=2e-3)


def sampled(every_s: float, rows: int) -> Trial:
    """A discharge of 40 kPa gauge without noise, so many rows so far apart, from its first on."""
    time = every_s * np.arange(rows)
    pressure = P0 + 4e4 * np.exp(-time * K * R * T * C_DIS / VOLUME)
    return Trial("1", time, {"pressure_a_pa": pressure, "valve_a": 0.0 * time}, "rows.csv")


def test_rows_that_are_too_far_apart_for_a_tank_are_named() -> None:
    with pytest.raises(NotIdentifiedError, match=r"only \d rows lie; sample every"):
        tank([sampled(20.0, 8)], rig())


def test_twenty_exact_readings_are_a_discharge() -> None:
    part = tank([sampled(3.0, 20)], rig())
    found = fit_law(part, (), [0]).base_estimates()["c_dis"]
    assert found.value == pytest.approx(C_DIS, rel=1e-5)
    assert chosen_law(part).fitted.component.law == "thesis"  # type: ignore[attr-defined]


def test_an_empty_tank_is_not_looked_at_for_hours() -> None:
    """Rows long after the discharge say nothing of it, and a line says that they are not used."""
    trial = discharge(4e4, 5)
    step = float(np.diff(trial.time[-2:])[0])
    more = trial.time[-1] + step * np.arange(1.0, 20001.0)
    channels = {
        "pressure_a_pa": np.concatenate([trial["pressure_a_pa"], np.full(len(more), P0)]),
        "pump_volts": np.concatenate([trial["pump_volts"], np.zeros(len(more))]),
    }
    part = tank([Trial("1", np.concatenate([trial.time, more]), channels, "long")], rig())
    assert part.discharges[0].time[-1] < 600.0
    assert any("are not used: the tank is empty long before" in line for line in part.left_out)
    found = fit_law(part, (), [0]).base_estimates()["c_dis"]
    assert found.value == pytest.approx(C_DIS, rel=5e-3)


def test_a_vacuum_that_fills_is_named() -> None:
    trial = sampled(3.0, 40)
    vacuum = {"pressure_a_pa": 2.0 * P0 - trial["pressure_a_pa"], "valve_a": trial["valve_a"]}
    with pytest.raises(NotIdentifiedError, match=r"Pa below the atmosphere .* a vacuum that fills"):
        tank([Trial("1", trial.time, vacuum, "v.csv")], rig())


def test_earlier_discharges_of_a_test_are_said_to_be_unused() -> None:
    first, last = discharge(6e4, 5), discharge(4e4, 6)
    channels = {k: np.concatenate([first[k], last[k]]) for k in ("pressure_a_pa", "pump_volts")}
    time = np.concatenate([first.time, first.time[-1] + 0.05 + last.time])
    part = tank([Trial("1", time, channels, "two.csv")], rig())
    assert any("two.csv: 1 earlier discharge before row 881" in line for line in part.left_out)
    one = tank([last], rig())
    assert one.left_out == ()
    assert part.discharges[0].start == pytest.approx(one.discharges[0].start, rel=1e-12)
    assert np.array_equal(part.discharges[0].pressure[:100], one.discharges[0].pressure[:100])


def test_a_part_without_a_held_out_log_asks_for_one_of_its_own_kind() -> None:
    content = {"verdict": "adequate", "unexplained": [], "residual": {}, "effects": []}
    (of_tank,) = advice_on_rest(content | {"component": "tank"})
    (of_rig,) = advice_on_rest(content)
    assert "give a log use" in of_tank and "give a motion log use" in of_rig


def test_a_tank_that_keeps_its_pressure_leaks_nothing() -> None:
    """Its coefficient is 0, a value; its record is no time of its own, after which it is empty."""
    rng, time = np.random.default_rng(6), np.arange(0.0, 42.0, 0.05)
    volts = np.where(time < 2.0, 5.0, 0.0)
    trials = []
    for label, level in (("1", 3e4), ("2", 5e4)):
        pressure = P0 + level + 8.0 * rng.standard_normal(len(time))
        trials.append(
            Trial(label, time, {"pressure_a_pa": pressure, "pump_volts": volts}, f"tank {label}")
        )
    found = bench_fit("tank", trials, rig())
    law = found.part().valves.side("a").discrete
    assert law is not None and law.law_of("dis") == "thesis"
    estimate = law.estimates()["c_dis"]
    assert estimate.holds(0.0) and estimate.interval[0] == 0.0
    # What falls by noise within the record.
    fall = 3.0 * 8.0 / 3e4 / 40.0
    assert estimate.interval[1] < fall * VOLUME / (K * R * T)
    said = " ".join(found.notices)
    assert "empty" not in said and "times as large" not in said

    rising = trials[0].channels["pressure_a_pa"] + np.maximum(time - 2.0, 0.0)
    trial = Trial("1", time, {"pressure_a_pa": rising, "pump_volts": volts}, "tank 1")
    with pytest.raises(NotIdentifiedError, match=r"the pressure rises from 1.* while pump_volts"):
        tank([trial], rig())


@pytest.mark.parametrize("seed", [812, 815])
def test_the_errors_of_a_choice_are_those_of_the_table(seed: int) -> None:
    """Until the tank is empty, of every law, and of the fit that is used."""
    drawn = adiabatic_tank("adiabatic", seed)
    found = bench_fit("tank", drawn.trials, drawn.rig)
    law = found.part().valves.side("a").discrete
    assert law is not None and law.quality is not None
    (line,) = [line for line in found.notices if "RMSE:" in line]
    own = f"{number(law.quality['discharge'].rmse)} Pa by thesis with gas that cools"
    assert own in line
