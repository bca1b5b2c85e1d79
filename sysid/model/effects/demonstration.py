"""What one effect does to a rig: a short test simulated without it and with it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import InputError, input_error
from sysid.io.bundled import bundled_campaign
from sysid.io.rig import read_rig
from sysid.model.base import Parameters, ValveParameters, parameters_from_rig
from sysid.model.effects.entry import CatalogueEffect
from sysid.model.ports import Model
from sysid.model.sensors import measured_channels
from sysid.types import FloatArray

CHANNELS = (("theta_rad", "rad"), ("pressure_a_pa", "Pa"), ("pressure_b_pa", "Pa"))


# The rest of the rig that a demonstration runs on: the thesis' friction (Nm, Nm s/rad) and
# valves (kg/s, kg/s, kg/(s Pa^0.5), kg/(s Pa)), tables 3.4.1, 3.4.2 and 3.6.1.
_FRICTION = {"static_effort": 0.333, "coulomb_effort": 0.208, "viscous": 0.0488}


_VALVE_A = ValveParameters(7.8e-4, 3.5e-4, 1.5e-6, 3.7e-9)


_VALVE_B = ValveParameters(1.3e-3, 3.9e-4, 1.5e-6, 3.7e-9)


_ROUNDING = 1e-9


@dataclass(frozen=True)
class Demonstration:
    """Measured channels, (n,) each, of one test without and with an effect; time in s."""

    time: FloatArray
    base: dict[str, FloatArray]
    changed: dict[str, FloatArray]

    def difference(self, channel: str) -> FloatArray:
        """What the effect changes, (n,), in the channel's unit."""
        return self.changed[channel] - self.base[channel]

    def changes(self) -> dict[str, Any]:
        """What the effect changes in each channel: rms and largest, in the channel's unit."""
        return {
            channel: {
                "rms": float(np.sqrt(np.mean(self.difference(channel) ** 2))),
                "largest": float(np.abs(self.difference(channel)).max()),
                "unit": unit,
            }
            for channel, unit in CHANNELS
        }


def reference_parameters() -> Parameters:
    """The rig of a demonstration: the bundled campaign's, with the thesis' friction and valves."""
    rig = read_rig(bundled_campaign().parent / "rig.toml")
    return parameters_from_rig(rig, **_FRICTION, valve_a=_VALVE_A, valve_b=_VALVE_B)


def demonstrate(effect: type[CatalogueEffect]) -> Demonstration:
    """One short test of the reference rig, with the effect at neutral and at typical size.

    The motor swings the arm alone for 2 s, then for 2 s together with valves under PWM.
    """
    from sysid.model.simulator import simulate

    inputs = demonstration_inputs()
    parameters = reference_parameters()
    models = [Model(parameters) + effect.neutral(), Model(parameters) + effect.typical()]
    base, changed = (
        measured_channels(run, "theta_rad", model)
        for run, model in zip(simulate([inputs] * 2, models), models, strict=True)
    )
    return Demonstration(inputs.time, base, changed)


def demonstration_inputs() -> Any:
    """The short test: the motor alone for 2 s, then for 2 s together with valves under PWM."""
    from sysid.model.simulator import Inputs, ValveCommand

    time = np.linspace(0.0, 4.0, 4001)
    # Square and sine: reversals at full torque and slow ones.
    motor = np.where(time < 1.0, 0.6 * np.sign(np.cos(4.0 * np.pi * time)), 0.0)
    motor += np.where(time >= 1.0, 0.7 * np.cos(3.0 * np.pi * time), 0.0)
    swing = 0.42 * np.sin(4.0 * np.pi * time)
    pneumatic = time >= 2.0
    duties = [np.where(pneumatic, 0.45 + way * swing, 0.0) for way in (1.0, -1.0)]
    valve_a, valve_b = (ValveCommand(duty, is_duty=True) for duty in duties)
    return Inputs(time, motor, valve_a, valve_b)


def demonstrate_own(effect: type[CatalogueEffect], path: Path) -> Demonstration:
    """`demonstrate` for a user's effect: its faults are the file's, not the program's.

    Raises InputError where the effect's code fails, gives no finite numbers or is not neutral.
    """
    where = f"{path}, class {effect.__name__}"
    try:
        shown = demonstrate(effect)
        bare = _bare()
    except InputError:
        raise
    except Exception as error:
        reason = str(error).strip().partition("\n")[0][:200]
        what = f"does not simulate: {type(error).__name__}: {reason}"
        mend = "its ports receive numpy and jax arrays: use array_namespace instead of branches"
        raise input_error(where, what, mend) from None
    if not all(np.isfinite(values).all() for values in shown.changed.values()):
        raise input_error(
            where,
            "its simulation at typical size does not stay finite",
            "limit what its ports return",
        )
    for channel, _ in CHANNELS:
        # Neutral ports give the same bits, but the compiler may round differently between them.
        if not np.allclose(shown.base[channel], bare[channel], rtol=_ROUNDING, atol=_ROUNDING):
            mend = "make every port return the value it is given at strength 0"
            raise input_error(where, f"at neutral strength it changes {channel}", mend)
    return shown


def _bare() -> dict[str, FloatArray]:
    from sysid.model.simulator import simulate

    model = Model(reference_parameters())
    return measured_channels(simulate([demonstration_inputs()], [model])[0], "theta_rad", model)
