"""The effects that can be injected: their forms, and values of the size that rigs show.

Ids are those of `effects.md`, with further ones that no catalogue holds (`OUT_OF_CATALOGUE`).
A form is one functional law; the first of an id is the law that `effects.md` states. Every value
is in rotary units (Nm, rad); a linear rig sees it at the pitch radius of the reference machine.
A key that starts with `use_` chooses a law and is no size.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

SIDES = ("a", "b")
SIDES_OR_BOTH = ("a", "b", "both")


@dataclass(frozen=True)
class Injected:
    """One effect in a rig: the law, the chamber, valve or sensor (`""`: none), and its values."""

    id: str
    form: str
    side: str = ""
    values: dict[str, float] = field(default_factory=dict)

    def content(self) -> dict[str, Any]:
        """The effect as the truth file lists it, by the name that the catalogue has for it."""
        is_known = self.id not in OUT_OF_CATALOGUE
        return asdict(self) | {"id": name_of(self.id, self.form), "in_catalogue": is_known}


@dataclass(frozen=True)
class Form:
    """How one law is drawn.

    `strengths` (low, high): log-uniform, times the scale; a law without effect at scale 0.
    `signed`: the strengths share a random sign. `shapes` (low, high): uniform. `flags` as they are.
    """

    strengths: dict[str, tuple[float, float]]
    shapes: dict[str, tuple[float, float]] = field(default_factory=dict)
    flags: dict[str, float] = field(default_factory=dict)
    signed: bool = False
    sides: tuple[str, ...] = ("",)


def _one(key: str, size: float, **options: Any) -> Form:
    """A form with one strength of one size."""
    return Form({key: (size, size)}, **options)


_PHASE = (0.0, 2.0 * math.pi)
_SPEED = {"stribeck_speed_rad_s": (0.05, 0.1)}
_LEAK = (2e-17, 7e-17)  # kg/(s Pa2); the laminar ones pass as much at 300 against 100 kPa
_LAMINAR_LEAK = (8e-12, 2.8e-11)
_SINE = {"position_wave_per_rad": (3.5, 7.0), "position_phase_rad": _PHASE}
_BUMP = {"position_centre_rad": (-0.6, 0.6), "position_width_rad": (0.2, 0.4)}
_MESH = {"mesh_teeth": (16.0, 48.0), "mesh_phase_rad": _PHASE}
_RIPPLE = {"ripple_count": (6.0, 24.0), "ripple_phase_rad": _PHASE}
_ARM = {"arm_share": (0.2, 0.4), "arm_damping_ratio": (0.02, 0.08)}
_BRISTLE = {"bristle_damping_nm_s_per_rad": (0.8, 1.6)}
_ISO = {"iso_critical_ratio": (0.22, 0.4)}
_DROOP = 10e3 / 7.8e-4  # Pa s/kg
_BACK = 5e3 / 3.5e-4
_RELIEF = {"relief_pa": (1.4e5, 1.9e5)}
_CUSHION = {"cushion_start_rad": (0.2, 0.4)}
_STICK = {"stick_time_s": (0.05, 0.3)}
_PULSATION = {"pulsation_hz": (1.0, 3.0), "pulsation_phase_rad": _PHASE}
_FAST = {"counted_rad_s": (0.8, 1.6)}
_COMPLIANCE = 1.0 / 400.0  # rad/Nm

_FRICTION: dict[str, dict[str, Form]] = {
    "stribeck-friction": {
        name: _one("stribeck_torque_nm", 0.12, shapes=_SPEED, flags={"use_exponent": exponent})
        # Armstrong-Helouvry 1994: Gaussian, Tustin's exponential, Bo and Pavelescu, Hess and Soom.
        for name, exponent in (
            ("gaussian", 2.0),
            ("exponential", 1.0),
            ("pavelescu", 0.5),
            ("lorentzian", 0.0),
        )
    },
    "asymmetric-coulomb-friction": {
        "constant": _one("asymmetry_nm", 0.017, signed=True),
        "breakaway": _one("asymmetry_nm", 0.017, signed=True, flags={"use_asymmetric_static": 1.0}),
    },
    "position-dependent-friction": {
        "sine": _one("position_sine", 0.3, shapes=_SINE),
        "linear": _one("position_slope", 0.3, signed=True),
        "bump": _one("position_bump", 0.3, shapes=_BUMP, signed=True),
    },
    "stiction-after-rest": {
        # Dieterich 1972; a contact that creeps to its full size.
        "logarithmic": _one("dwell", 0.06, shapes={"dwell_time_s": (0.03, 0.1)}),
        "exponential": _one("fresh_loss", 0.25, shapes={"growth_time_s": (0.2, 1.0)}),
    },
    "seal-friction": {
        "sum": _one("seal_sum_nm_per_pa", 2e-7),
        "breakaway": _one("seal_sum_nm_per_pa", 2e-7, flags={"use_seal_static": 1.0}),
        "difference": _one("seal_difference_nm_per_pa", 4e-7),
    },
    "load-dependent-friction": {
        "gear": _one("gear_friction", 0.05, flags={"use_gear": 1.0}),
        "gear-and-rack": _one("gear_friction", 0.05, flags={"use_gear": 2.0}),
    },
    "stroke-dependent-seals": {
        "linear": _one("seal_slope_nm_per_pa_rad", 2e-7, signed=True),
        "one-half": _one("seal_half_nm_per_pa_rad", 4e-7),
    },
    "presliding": {
        name: _one(
            "bristle_compliance_rad_per_nm", _COMPLIANCE, shapes=_BRISTLE, flags={"use_bristle": n}
        )
        # Canudas de Wit 1995; Dupont 2002; Dahl 1968.
        for name, n in (("lugre", 1.0), ("elastoplastic", 2.0), ("dahl", 3.0))
    },
    "quadratic-drag": {
        "quadratic": _one("drag", 0.005, flags={"use_drag_exponent": 2.0}),
        "power": _one("drag", 0.008, flags={"use_drag_exponent": 1.6}),
    },
}

_DRIVE: dict[str, dict[str, Form]] = {
    "backlash": {
        "gap": _one("gap_rad", 4e-3, shapes={"motor_share": (0.08, 0.15)}, flags={"use_gap": 1.0}),
        "play": _one(
            "gap_rad", 4e-3, shapes={"play_drag_nm_s_per_rad": (0.2, 0.6)}, flags={"use_gap": 2.0}
        ),
    },
    "gear-mesh-ripple": {
        "sine": _one("mesh_torque_nm", 0.02, shapes=_MESH),
        "harmonics": _one("mesh_torque_nm", 0.02, shapes=_MESH | {"mesh_second": (0.3, 0.6)}),
    },
    "pitch-eccentricity": {
        "torque": _one("eccentricity", 0.005, shapes={"eccentric_phase_rad": _PHASE}),
        "kinematic": _one(
            "eccentricity",
            0.005,
            shapes={"eccentric_phase_rad": _PHASE},
            flags={"use_kinematic": 1.0},
        ),
    },
    "stroke-dependent-area": {
        "taper": _one("taper_per_rad", 0.05, signed=True),
        "barrel": _one("barrel_per_rad2", 0.1, signed=True),
    },
    "link-flexibility": {
        "arm": _one("arm_period_s", 1.0 / 25.0, shapes=_ARM),
        "encoder-on-arm": _one(
            "arm_period_s", 1.0 / 25.0, shapes=_ARM, flags={"use_encoder_on_arm": 1.0}
        ),
    },
    "cable-spring": {
        "linear": _one("cable_nm_per_rad", 0.05),
        "preloaded": _one("cable_nm_per_rad", 0.05, shapes={"cable_rest_rad": (-0.5, 0.5)}),
    },
    "end-cushion": {
        "linear": _one("cushion_nm_per_rad", 0.3, shapes=_CUSHION),
        "cubic": _one("hardening_nm_per_rad3", 0.6, shapes={"hardening_start_rad": (0.3, 0.5)}),
        "damped": _one(
            "cushion_nm_per_rad", 0.3, shapes=_CUSHION | {"cushion_damping_s_per_rad": (0.2, 0.6)}
        ),
    },
    "mounting-tilt": {"sine": _one("tilt_rad", math.pi / 180, shapes={"tilt_phase_rad": _PHASE})},
    "inertia-mismatch": {
        "arm-end": _one("added_inertia_kg_m2", 0.003, signed=True, flags={"use_gravity": 1.0}),
        "balanced": _one("added_inertia_kg_m2", 0.003, signed=True),
    },
    "torque-ripple": {
        "sine": _one("ripple", 0.02, shapes=_RIPPLE),
        "rectified": _one("ripple", 0.02, shapes=_RIPPLE, flags={"use_rectified": 1.0}),
    },
    "torque-saturation": {
        "hard": Form({"saturation_per_nm": (1 / 0.75, 1 / 0.4)}),
        "soft": Form({"saturation_per_nm": (1 / 0.75, 1 / 0.4)}, flags={"use_tanh": 1.0}),
    },
    "torque-constant-error": {"gain": _one("torque_gain", 0.05, signed=True)},
    "amplifier-lag": {
        "first-order": _one("motor_lag_s", 0.002),
        "second-order": _one("motor_lag_s", 0.002, flags={"use_motor_second": 1.0}),
    },
    "torque-offset": {"constant": _one("torque_offset_nm", 0.01, signed=True)},
}

_GAS: dict[str, dict[str, Form]] = {
    "polytropic-exponent": {
        "exponent": _one("exponent", -0.1),
        "work": _one("work_exponent", -0.1),
    },
    "wall-heat-transfer": {
        "mass-state": _one("conductance_w_per_k", 0.4, flags={"use_heat": 1.0}),
        "temperature-state": _one("conductance_w_per_k", 0.4, flags={"use_heat": 2.0}),
        "turbulent": _one(
            "conductance_w_per_k", 0.3, flags={"use_heat": 1.0, "use_heat_exponent": 0.8}
        ),
    },
    "dead-volume-error": {"offset": _one("offset_m", 0.003, signed=True, sides=SIDES)},
    "tube-lag": {
        "first-order": _one("tube_lag_s", 0.0015, sides=("both",)),
        "second-order": _one("tube_lag_s", 0.0015, sides=("both",), flags={"use_tube_second": 1.0}),
    },
    "piston-leakage": {
        "quadratic": Form({"piston_quadratic": _LEAK}),
        "laminar": Form({"piston_laminar": _LAMINAR_LEAK}),
        "orifice": Form({"piston_orifice": (6e-12, 2e-11)}),
    },
    "atmosphere-leakage": {
        "quadratic": Form({"leak_quadratic": _LEAK}, sides=SIDES),
        "laminar": Form({"leak_laminar": _LAMINAR_LEAK}, sides=SIDES),
    },
    "threshold-leakage": {
        "linear": _one("relief_kg_per_s_pa", 1.2e-9, shapes=_RELIEF, sides=SIDES),
        "narrow-gap": _one("relief_quadratic", 3e-15, shapes=_RELIEF, sides=SIDES),
    },
    "subsonic-flow-shape": {
        "iso6358": _one("iso_fill", 1.0, shapes=_ISO, flags={"use_iso_exponent": 0.5}),
        "exponent": _one("iso_fill", 1.0, shapes=_ISO | {"use_iso_exponent": (0.55, 0.65)}),
        "exhaust-too": Form(
            {"iso_fill": (1.0, 1.0), "iso_dis": (1.0, 1.0)}, _ISO, {"use_iso_exponent": 0.5}
        ),
    },
    "choked-exhaust-scaling": {
        "proportional": Form({"choked_scaling": (0.5, 1.0)}, flags={"use_reference": 1.0}),
        "about-middle": Form({"choked_scaling": (0.5, 1.0)}, flags={"use_reference": 1.27}),
    },
    "supply-droop": {
        "coupled": _one("droop_pa_s_per_kg", _DROOP, flags={"use_droop": 1.0}),
        "separate": _one("droop_pa_s_per_kg", _DROOP, flags={"use_droop": 2.0}),
        "reservoir": _one(
            "droop_pa_s_per_kg",
            _DROOP,
            shapes={"reservoir_s": (0.01, 0.03)},
            flags={"use_droop": 3.0},
        ),
    },
    "supply-pulsation": {
        "sine": Form({"pulsation_pa": (8e3, 16e3)}, _PULSATION),
        "sawtooth": Form({"pulsation_pa": (8e3, 16e3)}, _PULSATION, {"use_sawtooth": 1.0}),
    },
    "exhaust-back-pressure": {
        "separate": _one("back_pa_s_per_kg", _BACK),
        "common": _one("back_pa_s_per_kg", _BACK, flags={"use_common": 1.0}),
        "quadratic": _one("back_pa_s_per_kg", _BACK, flags={"use_back_square": 1.0}),
        "quadratic-common": _one(
            "back_pa_s_per_kg", _BACK, flags={"use_back_square": 1.0, "use_common": 1.0}
        ),
    },
    "temperature-drift": {
        "linear": _one("temperature_k_per_s", 10.0 / 60.0, signed=True),
        "saturating": _one(
            "temperature_k_per_s", 10.0 / 60.0, signed=True, shapes={"temperature_time_s": (4, 15)}
        ),
        "settling": _one(
            "temperature_settled_k", 8.0, signed=True, shapes={"temperature_time_s": (1.5, 8.0)}
        ),
    },
    "ambient-pressure-error": {"ambient": _one("ambient_pa", 1e3, signed=True)},
    "area-error": {"area": _one("area_m2", 3e-6, signed=True, sides=("b",))},
}

_TIMING_AND_SENSORS: dict[str, dict[str, Form]] = {
    "valve-delay": {
        "both": Form(
            {"on_delay_s": (5e-4, 5e-4), "off_delay_s": (5e-4, 5e-4)}, sides=SIDES_OR_BOTH
        ),
        "on": _one("on_delay_s", 5e-4, sides=SIDES_OR_BOTH, signed=True),
        "off": _one("off_delay_s", 5e-4, sides=SIDES_OR_BOTH, signed=True),
    },
    "duty-dead-zone": {
        "vanish": Form({"dead_s": (4e-4, 1.4e-3)}, sides=("both",)),
        "on-pulses": Form({"dead_s": (4e-4, 1.4e-3)}, sides=("both",), flags={"use_dead": 1.0}),
        "shortened": Form({"dead_s": (2e-4, 7e-4)}, sides=("both",), flags={"use_dead": 2.0}),
        "partial": Form(
            {"dead_s": (4e-4, 1.4e-3)},
            {"dead_whole_ratio": (1.5, 2.5)},
            {"use_dead": 3.0},
            sides=("both",),
        ),
    },
    "sticking-valve": {
        "hyperbolic": Form({"stick_s": (1.5e-3, 3e-3)}, _STICK, sides=SIDES_OR_BOTH),
        "exponential": Form(
            {"stick_s": (1.5e-3, 3e-3)}, _STICK, {"use_stick": 1.0}, sides=SIDES_OR_BOTH
        ),
    },
    "coil-heating": {
        "both-delays": _one("heating_s", 5e-4, shapes={"heating_time_s": (15, 25)}),
        "on-delay": _one(
            "heating_s", 5e-4, shapes={"heating_time_s": (15, 25)}, flags={"use_on_only": 1.0}
        ),
    },
    "pressure-offset": {
        "constant": _one("pressure_offset_pa", 1.7e3, signed=True, sides=SIDES_OR_BOTH)
    },
    "pressure-gain": {
        "absolute": _one("pressure_gain", 0.005, signed=True, sides=SIDES_OR_BOTH),
        "gauge": _one(
            "pressure_gain", 0.01, signed=True, sides=SIDES_OR_BOTH, flags={"use_gauge": 1.0}
        ),
    },
    "pressure-lag": {
        "first-order": _one("pressure_lag_s", 0.002, sides=SIDES_OR_BOTH),
        "second-order": _one(
            "pressure_lag_s", 0.002, sides=SIDES_OR_BOTH, flags={"use_sensor_second": 1.0}
        ),
    },
    "time-skew": {"delay": _one("skew_s", 0.002, sides=SIDES_OR_BOTH)},
    "encoder-eccentricity": {
        "sine": _one("encoder_rad", 1e-3, shapes={"encoder_phase_rad": _PHASE})
    },
    "lost-counts": {
        "beyond": _one("lost_share", 0.1, shapes=_FAST),
        "all": _one("lost_share", 0.03, shapes=_FAST, flags={"use_lost_of_all": 1.0}),
    },
}

_OUTSIDE: dict[str, dict[str, Form]] = {
    "friction-warm-up": {"decay": _one("warm_up", 0.35, shapes={"warm_up_time_s": (1.5, 4.0)})},
    "magnetic-latch": {
        "bump": _one(
            "latch_nm",
            0.08,
            signed=True,
            shapes={"latch_angle_rad": (-0.4, 0.4), "latch_width_rad": (0.05, 0.12)},
        )
    },
    "torque-crosstalk": {
        "proportional": _one("crosstalk_pa_per_nm", 3e3, signed=True, sides=SIDES)
    },
    "mains-hum": {"sine": _one("hum_nm", 0.08, shapes={"hum_phase_rad": _PHASE})},
    "flow-hysteresis": {"direction": _one("flow_hysteresis", 0.1)},
    "eddy-brake": {"peak": _one("eddy_nm_s_per_rad", 0.1, shapes={"eddy_speed_rad_s": (0.5, 1.2)})},
    "payload-pendulum": {
        "hanging": _one(
            "pendulum_kg_m2",
            0.004,
            shapes={"pendulum_hz": (1.5, 4.0), "pendulum_damping_ratio": (0.02, 0.1)},
        )
    },
    "exhaust-icing": {"decay": _one("icing", 0.25, shapes={"icing_time_s": (1.0, 3.0)})},
}

_ALL = _FRICTION | _DRIVE | _GAS | _TIMING_AND_SENSORS | _OUTSIDE
OUT_OF_CATALOGUE: tuple[str, ...] = tuple(_OUTSIDE)
FORMS: dict[str, tuple[str, ...]] = {name: tuple(forms) for name, forms in _ALL.items()}


def name_of(id: str, form: str) -> str:
    """The catalogue's name of a form, which is another effect's where two are drawn as one."""
    return "laminar-leakage" if form == "laminar" else id


def law_keys(id: str, form: str) -> tuple[tuple[str, ...], bool]:
    """The keys of a form's values, and whether they belong to a side."""
    law = _found(id, form)
    return (*law.strengths, *law.shapes, *law.flags), law.sides != ("",)


def _found(id: str, form: str) -> Form:
    if id not in _ALL:
        raise ValueError(f"no effect {id!r}: the ids are {', '.join(_ALL)}")
    if form not in _ALL[id]:
        raise ValueError(f"{id} has no form {form!r}: its forms are {', '.join(_ALL[id])}")
    return _ALL[id][form]


def typical(id: str, form: str, rng: np.random.Generator, scale: float = 1.0) -> Injected:
    """An effect of the size that rigs show, times `scale`; side, sign and shape are drawn.

    Raises ValueError for an unknown id or form, and for a scale that is negative or not finite.
    """
    law = _found(id, form)
    if not (math.isfinite(scale) and scale >= 0.0):
        raise ValueError(f"the scale {scale!r} of {id} is not a number of 0 or more")
    side = str(rng.choice(law.sides))
    sign = float(rng.choice((-1.0, 1.0))) if law.signed else 1.0
    values = {}
    for key, (low, high) in law.strengths.items():
        share = rng.random()
        size = low if low == high else low * (high / low) ** share
        values[key] = scale * sign * size
    values |= {key: float(rng.uniform(*limits)) for key, limits in law.shapes.items()}
    return Injected(id, form, side, values | law.flags)


def parsed(text: str) -> tuple[str, str, float]:
    """Id, form and scale of `ID[:FORM][*SCALE]`; the form left out is the first. ValueError."""
    name, _, factor = text.partition("*")
    id, _, form = name.partition(":")
    try:
        scale = float(factor) if factor else 1.0
    except ValueError:
        raise ValueError(f"{factor!r} in {text!r} is not a number") from None
    if not (math.isfinite(scale) and scale >= 0.0):
        raise ValueError(f"{factor!r} in {text!r} is not a number of 0 or more")
    _found(id, form or next(iter(_ALL.get(id, {"": None}))))
    return id, form or FORMS[id][0], scale
