"""Held-out errors of the model with the true parameters, for comparison with a diagnosis.

    python benchmarks/true_model.py CAMPAIGN BUNDLE TRUTH

CAMPAIGN and TRUTH are what `python -m datasets.generator --truth` wrote, BUNDLE what
`sysid fit` made of the campaign. Where every injected effect is a law of the catalogue, the
bundle's numbers are replaced by the true ones, its held-out motion tests are simulated as
`sysid diagnose` does it, and each channel's RMSE is printed as JSON; else `null`.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from datasets.generator.effects.mechanics import ARM_MOMENT_NM, STATIC_SPEED_RAD_S  # noqa: E402

Values = Mapping[str, float]


def wave(amplitude: str, phase: str, sine: str, cosine: str, size: float = 1.0) -> dict[str, Any]:
    """Sine and cosine of a wave that the truth gives by amplitude and phase."""
    return {
        sine: lambda v: size * v[amplitude] * math.cos(v[phase]),
        cosine: lambda v: size * v[amplitude] * math.sin(v[phase]),
    }


def laminar(v: Values) -> float:
    """A leak between the chambers, or out of one."""
    return v["piston_laminar"] if "piston_laminar" in v else v["leak_laminar"]


BRISTLE: dict[str, Any] = {
    "bristle_compliance_rad_per_nm": "bristle_compliance_rad_per_nm",
    "bristle_static_torque_nm": lambda v: v["static_nm"] - v["coulomb_nm"],
    "stribeck_velocity_rad_per_s": STATIC_SPEED_RAD_S,
}
MESH: dict[str, Any] = {
    **wave("mesh_torque_nm", "mesh_phase_rad", "mesh_sine_nm", "mesh_cosine_nm"),
    "mesh_wave_per_rad": "mesh_teeth",
}
ECCENTRIC: dict[str, Any] = wave(
    "eccentricity", "eccentric_phase_rad", "eccentricity_cosine", "eccentricity_sine"
)
LINK: dict[str, Any] = {
    "flexible_share": "arm_share",
    "link_frequency_hz": lambda v: 1.0 / v["arm_period_s"],
    "link_damping": "arm_damping_ratio",
}
HEATING: dict[str, Any] = {"on_delay_drift_s": "heating_s", "heating_time_s": "heating_time_s"}
LAMINAR: dict[str, Any] = {"laminar_leakage_kg_per_s_pa": laminar}

# Forms that are the catalogue's own law: its parameters, by the truth's key, as a share of it, as a
# number, or as a function of the truth's values. The first of each is its strength.
SAME_LAW: dict[str, dict[str, str | float | tuple[str, float] | Callable[[Values], float]]] = {
    "stribeck-friction:gaussian": {
        "stribeck_torque_nm": "stribeck_torque_nm",
        "stribeck_velocity_rad_per_s": "stribeck_speed_rad_s",
        "stribeck_exponent": 2.0,
    },
    "asymmetric-coulomb-friction:constant": {"asymmetry_nm": "asymmetry_nm"},
    "seal-friction:sum": {"seal_torque_nm_per_pa": "seal_sum_nm_per_pa", "difference_share": 0.0},
    "seal-friction:breakaway": {
        "seal_torque_nm_per_pa": "seal_sum_nm_per_pa",
        "difference_share": 0.0,
        "breakaway_share": 1.0,
    },
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
    "pressure-lag:second-order": {"pressure_lag_s": "pressure_lag_s", "second_order_share": 1.0},
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
    "piston-leakage:laminar": LAMINAR,
    "atmosphere-leakage:laminar": LAMINAR,
    "laminar-leakage:laminar": LAMINAR,
    "stribeck-friction:exponential": {
        "stribeck_torque_nm": "stribeck_torque_nm",
        "stribeck_velocity_rad_per_s": "stribeck_speed_rad_s",
        "stribeck_exponent": 1.0,
    },
    "position-dependent-friction:sine": {
        **wave("position_sine", "position_phase_rad", "friction_sine", "friction_cosine"),
        "friction_wave_per_rad": "position_wave_per_rad",
    },
    "seal-friction:difference": {
        "seal_torque_nm_per_pa": "seal_difference_nm_per_pa",
        "difference_share": 1.0,
    },
    "load-dependent-friction:gear": {"load_friction": "gear_friction"},
    "load-dependent-friction:gear-and-rack": {
        "load_friction": "gear_friction",
        "load_is_transmitted": 1.0,
    },
    "presliding:lugre": BRISTLE | {"bristle_damping_nm_s_per_rad": "bristle_damping_nm_s_per_rad"},
    "presliding:dahl": BRISTLE | {"bristle_damping_nm_s_per_rad": 0.0},
    "quadratic-drag:power": {"drag_nm_s2_per_rad2": "drag", "drag_exponent": "use_drag_exponent"},
    "backlash:gap": {"gap_rad": "gap_rad", "motor_share": "motor_share"},
    "gear-mesh-ripple:sine": MESH,
    "gear-mesh-ripple:harmonics": MESH | {"second_sine": "mesh_second"},
    "pitch-eccentricity:torque": ECCENTRIC | {"lever_arm_only": 1.0},
    "pitch-eccentricity:kinematic": ECCENTRIC,
    "link-flexibility:arm": LINK,
    "link-flexibility:encoder-on-arm": LINK | {"encoder_on_link": 1.0},
    "mounting-tilt:sine": wave(
        "tilt_rad", "tilt_phase_rad", "tilt_sine_nm", "tilt_cosine_nm", ARM_MOMENT_NM
    ),
    "torque-ripple:sine": {
        **wave("ripple", "ripple_phase_rad", "ripple_sine", "ripple_cosine"),
        "ripple_wave_per_rad": "ripple_count",
    },
    "torque-saturation:hard": {"inverse_limit_per_nm": "saturation_per_nm"},
    "choked-exhaust-scaling:proportional": {"exhaust_scaling": "choked_scaling"},
    "supply-droop:separate": {"droop_pa_s_per_kg": "droop_pa_s_per_kg", "common_share": 0.0},
    "supply-pulsation:sine": {
        **wave("pulsation_pa", "pulsation_phase_rad", "pulsation_sine_pa", "pulsation_cosine_pa"),
        "pulsation_hz": "pulsation_hz",
    },
    "exhaust-back-pressure:common": {"back_pressure_pa_s_per_kg": "back_pa_s_per_kg"},
    "exhaust-back-pressure:quadratic-common": {
        "back_pressure_pa_s_per_kg": "back_pa_s_per_kg",
        "linear_share": 0.0,
    },
    "temperature-drift:settling": {
        "temperature_drift_k_per_s": lambda v: v["temperature_settled_k"] / v["temperature_time_s"],
        "settling_time_s": "temperature_time_s",
    },
    "coil-heating:both-delays": HEATING | {"off_delay_drift_s": "heating_s"},
    "coil-heating:on-delay": HEATING | {"off_delay_drift_s": 0.0},
    "pressure-gain:gauge": {
        "pressure_gain_error": "pressure_gain",
        "gain_zero_pa": "atmospheric_pressure_pa",
    },
    "encoder-eccentricity:sine": wave(
        "encoder_rad", "encoder_phase_rad", "encoder_sine_rad", "encoder_cosine_rad"
    ),
    "lost-counts:all": {
        "lost_share": "lost_share",
        "counted_speed_rad_per_s": "counted_rad_s",
        "lost_of_all": 1.0,
    },
    "duty-dead-zone:vanish": {"dead_time_s": "dead_s"},
    "duty-dead-zone:on-pulses": {"dead_time_s": "dead_s", "pause_ratio": 0.0},
    "duty-dead-zone:partial": {"dead_time_s": "dead_s", "whole_ratio": "dead_whole_ratio"},
}


def true_value(form: str, parameter: str, values: Values) -> float:
    """A parameter of the catalogue's law from the true values of the same form.

    That of the same name there, a share or a function of them, or a number that the form does not
    vary.
    """
    key = SAME_LAW[form][parameter]
    if callable(key):
        return key(values)
    if isinstance(key, tuple):
        return values[key[0]] * key[1]
    return values[key] if isinstance(key, str) else key


def true_effects(truth: Sequence[dict[str, Any]], base: Any) -> tuple[Any, ...]:
    """The injected effects by the catalogue's laws, on a rig of these base parameters. KeyError
    for a form that is not one."""
    from sysid.plant.effects import catalogue

    own = {
        "static_nm": float(base.static_effort),
        "coulomb_nm": float(base.coulomb_effort),
        "atmospheric_pressure_pa": float(base.atmosphere),
    }
    effects = []
    for injected in truth:
        form = f"{injected['id']}:{injected['form']}"
        fields: dict[str, Any] = {
            name: true_value(form, name, own | injected["values"]) for name in SAME_LAW[form]
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
    base = fitted.parameters.replace(**changes)
    return Model(base, true_effects(truth["effects"], base))


def held_out_errors(
    campaign_path: Path, bundle_path: Path, truth_path: Path
) -> dict[str, float] | None:
    """Each channel's RMSE over the held-out tests; None where a form is no law of the catalogue."""
    import numpy as np

    from sysid.diagnosis.actuator.holdout import motion_tests
    from sysid.io.campaign import read_campaign
    from sysid.parameters import read_bundle

    campaign = read_campaign(campaign_path)
    fitted = read_bundle(bundle_path).model(campaign.rig)
    model = true_model(json.loads(truth_path.read_text()), fitted)
    if model is None:
        return None
    logs = [(e.kind, campaign.read(e)) for e in campaign.logs if e.use == "holdout"]
    errors = motion_tests(campaign.rig, logs).rmse(model)
    names = (campaign.rig.position_channel, "pressure_a_pa", "pressure_b_pa")
    return {n: e for n, e in zip(names, errors.tolist(), strict=True) if np.isfinite(e)}


if __name__ == "__main__":
    print(json.dumps(held_out_errors(*map(Path, sys.argv[1:4]))))
