"""Held-out errors of the model with the true parameters, for comparison with a diagnosis.

    python benchmarks/true_model.py CAMPAIGN BUNDLE TRUTH

CAMPAIGN and TRUTH are what `python -m datasets.generator --truth` wrote, BUNDLE what
`sysid fit` made of the campaign. Where every injected effect is a law of the catalogue, the
bundle's numbers are replaced by the true ones, its held-out motion tests are simulated as
`sysid diagnose` does it, and each channel's RMSE is printed as JSON; else `null`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

# Forms that are the catalogue's own law: its parameters, by the truth's key or as a number.
# The first of each is its strength.
SAME_LAW: dict[str, dict[str, str | float | tuple[str, float]]] = {
    "stribeck-friction:gaussian": {
        "stribeck_torque_nm": "stribeck_torque_nm",
        "stribeck_velocity_rad_per_s": "stribeck_speed_rad_s",
        "stribeck_exponent": 2.0,
    },
    "asymmetric-coulomb-friction:constant": {"asymmetry_nm": "asymmetry_nm"},
    "seal-friction:sum": {"seal_torque_nm_per_pa": "seal_sum_nm_per_pa", "difference_share": 0.0},
    "stroke-dependent-seals:linear": {
        "seal_slope_nm_per_pa_rad": "seal_slope_nm_per_pa_rad",
        "seal_bend_nm_per_pa_rad": 0.0,
    },
    "stroke-dependent-seals:one-half": {
        "seal_slope_nm_per_pa_rad": ("seal_half_nm_per_pa_rad", 0.5),
        "seal_bend_nm_per_pa_rad": ("seal_half_nm_per_pa_rad", 0.5),
    },
    "stroke-dependent-area:taper": {
        "area_slope_per_rad": "taper_per_rad",
        "area_curvature_per_rad2": 0.0,
    },
    "stroke-dependent-area:barrel": {
        "area_curvature_per_rad2": "barrel_per_rad2",
        "area_slope_per_rad": 0.0,
    },
    "quadratic-drag:quadratic": {"drag_nm_s2_per_rad2": "drag", "drag_exponent": 2.0},
    "cable-spring:linear": {"stiffness_nm_per_rad": "cable_nm_per_rad", "spring_rest_rad": 0.0},
    "cable-spring:preloaded": {
        "stiffness_nm_per_rad": "cable_nm_per_rad",
        "spring_rest_rad": "cable_rest_rad",
    },
    "end-cushion:linear": {
        "cushion_nm_per_rad": "cushion_nm_per_rad",
        "cushion_start_rad": "cushion_start_rad",
        "cushion_exponent": 1.0,
    },
    "end-cushion:damped": {
        "cushion_nm_per_rad": "cushion_nm_per_rad",
        "cushion_start_rad": "cushion_start_rad",
        "cushion_exponent": 1.0,
        "cushion_damping_s_per_rad": "cushion_damping_s_per_rad",
    },
    "inertia-mismatch:balanced": {"inertia_change_kg_m2": "added_inertia_kg_m2"},
    "torque-constant-error:gain": {"torque_gain_error": "torque_gain"},
    "amplifier-lag:first-order": {"amplifier_lag_s": "motor_lag_s"},
    "torque-offset:constant": {"offset_nm": "torque_offset_nm"},
    "polytropic-exponent:exponent": {"exponent_change": "exponent"},
    "wall-heat-transfer:mass-state": {"wall_conductance_w_per_k": "conductance_w_per_k"},
    "wall-heat-transfer:turbulent": {
        "wall_conductance_w_per_k": "conductance_w_per_k",
        "density_exponent": "use_heat_exponent",
    },
    "dead-volume-error:offset": {"dead_length_m": "offset_m"},
    "tube-lag:first-order": {"tube_lag_s": "tube_lag_s"},
    "subsonic-flow-shape:iso6358": {
        "filling_blend": "iso_fill",
        "exhaust_blend": 0.0,
        "critical_ratio": "iso_critical_ratio",
        "subsonic_exponent": "use_iso_exponent",
    },
    "subsonic-flow-shape:exponent": {
        "filling_blend": "iso_fill",
        "exhaust_blend": 0.0,
        "critical_ratio": "iso_critical_ratio",
        "subsonic_exponent": "use_iso_exponent",
    },
    "subsonic-flow-shape:exhaust-too": {
        "filling_blend": "iso_fill",
        "exhaust_blend": "iso_dis",
        "critical_ratio": "iso_critical_ratio",
        "subsonic_exponent": "use_iso_exponent",
    },
    "supply-droop:coupled": {"droop_pa_s_per_kg": "droop_pa_s_per_kg"},
    "supply-droop:reservoir": {
        "droop_pa_s_per_kg": "droop_pa_s_per_kg",
        "line_time_s": "reservoir_s",
    },
    "exhaust-back-pressure:separate": {
        "back_pressure_pa_s_per_kg": "back_pa_s_per_kg",
        "common_share": 0.0,
        "linear_share": 1.0,
    },
    "exhaust-back-pressure:quadratic": {
        "back_pressure_pa_s_per_kg": "back_pa_s_per_kg",
        "common_share": 0.0,
        "linear_share": 0.0,
    },
    "temperature-drift:linear": {"temperature_drift_k_per_s": "temperature_k_per_s"},
    "temperature-drift:saturating": {
        "temperature_drift_k_per_s": "temperature_k_per_s",
        "settling_time_s": "temperature_time_s",
    },
    "ambient-pressure-error:ambient": {"ambient_pressure_pa": "ambient_pa"},
    "area-error:area": {"area_change_m2": "area_m2"},
    "valve-delay:both": {"on_delay_s": "on_delay_s", "off_delay_s": "off_delay_s"},
    "valve-delay:on": {"on_delay_s": "on_delay_s", "off_delay_s": 0.0},
    "valve-delay:off": {"off_delay_s": "off_delay_s", "on_delay_s": 0.0},
    "pressure-offset:constant": {"pressure_offset_pa": "pressure_offset_pa"},
    "pressure-gain:absolute": {"pressure_gain_error": "pressure_gain", "gain_zero_pa": 0.0},
    "pressure-lag:first-order": {"pressure_lag_s": "pressure_lag_s"},
    "time-skew:delay": {"time_skew_s": "skew_s"},
    "lost-counts:beyond": {
        "lost_share": "lost_share",
        "counted_speed_rad_per_s": "counted_rad_s",
    },
    "piston-leakage:quadratic": {"piston_leakage_kg_per_s_pa2": "piston_quadratic"},
    "atmosphere-leakage:quadratic": {"atmosphere_leakage_kg_per_s_pa2": "leak_quadratic"},
    "sticking-valve:hyperbolic": {
        "stuck_delay_s": "stick_s",
        "sticking_time_s": "stick_time_s",
    },
    "threshold-leakage:linear": {
        "threshold_leakage_kg_per_s_pa": "relief_kg_per_s_pa",
        "threshold_pa": "relief_pa",
    },
    "duty-dead-zone:vanish": {"dead_time_s": "dead_s"},
    "duty-dead-zone:on-pulses": {"dead_time_s": "dead_s", "pause_ratio": 0.0},
    "duty-dead-zone:partial": {"dead_time_s": "dead_s", "whole_ratio": "dead_whole_ratio"},
}


def true_value(form: str, parameter: str, values: dict[str, float]) -> float:
    """A parameter of the catalogue's law from the true values of the same form.

    That of the same name there, a share of one, or a number that the form does not vary.
    """
    key = SAME_LAW[form][parameter]
    if isinstance(key, tuple):
        return values[key[0]] * key[1]
    return values[key] if isinstance(key, str) else key


def true_effects(truth: Sequence[dict[str, Any]]) -> tuple[Any, ...]:
    """The injected effects by the catalogue's laws. KeyError for a form that is not one."""
    from sysid.plant.effects import catalogue

    effects = []
    for injected in truth:
        form = f"{injected['id']}:{injected['form']}"
        fields: dict[str, Any] = {
            name: true_value(form, name, injected["values"]) for name in SAME_LAW[form]
        }
        kind = catalogue()[injected["id"]]
        if injected["side"] and kind.has_side():
            fields["side"] = injected["side"]
        effects.append(kind(**fields))
    return tuple(effects)


def true_model(truth: dict[str, Any], fitted: Any) -> Any:
    """The model with the true base parameters and effects; None where a form is not known."""
    from sysid.plant.ports import Model

    if any(f"{e['id']}:{e['form']}" not in SAME_LAW for e in truth["effects"]):
        return None
    friction = truth["friction"]
    changes = {
        "static_effort": friction["static_nm"],
        "coulomb_effort": friction["coulomb_nm"],
        "viscous": friction["viscous_nm_s_per_rad"],
        "inertia": truth["inertia"],
    }
    laws = {
        "c_fill": "c_fill",
        "c_dis": "c_dis",
        "choked_fill": "choked_flow_fill_kg_s",
        "choked_dis": "choked_flow_dis_kg_s",
    }
    for side, valve in truth["valves"].items():
        changes |= {f"{name}_{side}": valve[key] for name, key in laws.items()}
        changes |= {f"on_delay_{side}": truth["delays"]["on_delay_s"]}
        changes |= {f"off_delay_{side}": truth["delays"]["off_delay_s"]}
    return Model(fitted.parameters.replace(**changes), true_effects(truth["effects"]))


def main(campaign_path: Path, bundle_path: Path, truth_path: Path) -> None:
    """Print the errors."""
    import numpy as np

    from sysid.diagnosis.actuator.holdout import motion_tests
    from sysid.io.campaign import read_campaign
    from sysid.parameters import read_bundle

    campaign = read_campaign(campaign_path)
    fitted = read_bundle(bundle_path).model(campaign.rig)
    model = true_model(json.loads(truth_path.read_text()), fitted)
    if model is None:
        print("null")
        return
    logs = [(e.kind, campaign.read(e)) for e in campaign.logs if e.use == "holdout"]
    errors = motion_tests(campaign.rig, logs).rmse(model)
    names = (campaign.rig.position_channel, "pressure_a_pa", "pressure_b_pa")
    print(json.dumps({n: e for n, e in zip(names, errors.tolist(), strict=True) if np.isfinite(e)}))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]))
