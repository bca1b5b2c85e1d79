"""What one effect does to a rig: a short test simulated without it and with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import InputError, input_error
from sysid.io.bundled import bundled_campaign
from sysid.io.rig import read_rig
from sysid.plant.base import Parameters, ValveParameters, parameters_from_rig
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model
from sysid.plant.sensors import measured_channels
from sysid.types import FloatArray

_PRESSURES = (("pressure_a_pa", "Pa"), ("pressure_b_pa", "Pa"))


# The rest of the rig that a demonstration runs on: the thesis' friction (Nm, Nm s/rad) and
# valves (kg/s, kg/s, kg/(s Pa^0.5), kg/(s Pa)), tables 3.4.1, 3.4.2 and 3.6.1.
_FRICTION = {"static_effort": 0.333, "coulomb_effort": 0.208, "viscous": 0.0488}


_VALVE_A = ValveParameters(7.8e-4, 3.5e-4, 1.5e-6, 3.7e-9)


_VALVE_B = ValveParameters(1.3e-3, 3.9e-4, 1.5e-6, 3.7e-9)


@dataclass(frozen=True)
class Demonstration:
    """Measured channels, (n,) each, of one test without and with an effect; time in s.

    `channels`: each one's name and unit, the position's first.
    """

    time: FloatArray
    base: dict[str, FloatArray]
    changed: dict[str, FloatArray]
    channels: tuple[tuple[str, str], ...]

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
            for channel, unit in self.channels
        }


def reference_parameters() -> Parameters:
    """The rig of a demonstration: the bundled campaign's, with the thesis' friction and valves."""
    rig = read_rig(bundled_campaign().parent / "rig.toml")
    return parameters_from_rig(rig, **_FRICTION, valve_a=_VALVE_A, valve_b=_VALVE_B)


def _linear_parameters(rotary: Parameters) -> Parameters:
    """The same rig as a linear axis: what its arm does, its rack does at the pinion's radius."""
    radius = float(rotary.pitch_radius)
    return rotary.replace(
        pitch_radius=1.0,
        inertia=rotary.inertia / radius**2,
        viscous=rotary.viscous / radius**2,
        gravity_moment=0.0,
        **{name: getattr(rotary, name) / radius for name in _EFFORTS},
    )


_EFFORTS = ("static_effort", "coulomb_effort", "offset", "max_effort")


@dataclass(frozen=True)
class ShortTest:
    """What a demonstration runs on: a rig's base model and the inputs of a short test.

    `channels`: name and unit of what its sensors show, the position's first.
    """

    model: Model
    inputs: Any
    channels: tuple[tuple[str, str], ...]

    def shown(self, models: Sequence[Model]) -> list[dict[str, FloatArray]]:
        """What the sensors show of the test with each model."""
        from sysid.plant.simulator import simulate

        position = self.channels[0][0]
        runs = simulate([self.inputs] * len(models), models)
        return [measured_channels(r, position, m) for r, m in zip(runs, models, strict=True)]


def short_test(*, linear: bool = False) -> ShortTest:
    """The reference rig, or the same as a linear axis, and the short test.

    The motor swings the arm alone for 2 s, then for 2 s together with valves under PWM.
    """
    from sysid.plant.simulator import Inputs, ValveCommand

    parameters = reference_parameters()
    time = np.linspace(0.0, 4.0, 4001)
    # Square and sine: reversals at full torque and slow ones.
    motor = np.where(time < 1.0, 0.6 * np.sign(np.cos(4.0 * np.pi * time)), 0.0)
    motor += np.where(time >= 1.0, 0.7 * np.cos(3.0 * np.pi * time), 0.0)
    if linear:
        motor = motor / float(parameters.pitch_radius)
        parameters = _linear_parameters(parameters)
    swing = 0.42 * np.sin(4.0 * np.pi * time)
    pneumatic = time >= 2.0
    duties = [np.where(pneumatic, 0.45 + way * swing, 0.0) for way in (1.0, -1.0)]
    valve_a, valve_b = (ValveCommand(duty, is_duty=True) for duty in duties)
    inputs = Inputs(time, motor, valve_a, valve_b)
    position = ("position_m", "m") if linear else ("theta_rad", "rad")
    return ShortTest(Model(parameters), inputs, (position, *_PRESSURES))


def demonstrate(effect: type[CatalogueEffect], *, linear: bool = False) -> Demonstration:
    """The short test with the effect at neutral and at typical size.

    `linear`: on a linear axis, for an effect in N and m.
    """
    return _demonstrated(effect, short_test(linear=linear))


def _demonstrated(effect: type[CatalogueEffect], on: ShortTest) -> Demonstration:
    base, changed = on.shown([on.model + effect.neutral(), on.model + effect.typical()])
    return Demonstration(on.inputs.time, base, changed, on.channels)


def demonstrate_own(
    effect: type[CatalogueEffect], path: Path, *, linear: bool = False
) -> Demonstration:
    """`demonstrate` for a user's effect: its faults are the file's, not the program's.

    Raises InputError where the effect's code fails, gives no finite numbers or is not neutral.
    """
    where, on = f"{path}, class {effect.__name__}", short_test(linear=linear)
    try:
        shown = _demonstrated(effect, on)
        (bare,) = on.shown([on.model])
    except InputError:
        raise
    except Exception as error:
        reason = str(error).strip().partition("\n")[0][:200]
        what = f"does not simulate: {type(error).__name__}: {reason}"
        fix = "its ports receive numpy and jax arrays: use array_namespace instead of branches"
        raise input_error(where, what, fix) from None
    if not all(np.isfinite(values).all() for values in shown.changed.values()):
        raise input_error(
            where,
            "its simulation at typical size does not stay finite",
            "limit what its ports return",
        )
    for channel, _ in shown.channels:
        # Neutral ports give the same bits, but the compiler may round differently between them.
        if not np.allclose(shown.base[channel], bare[channel], rtol=1e-9, atol=1e-9):
            fix = "make every port return the value it is given at strength 0"
            raise input_error(where, f"at neutral strength it changes {channel}", fix)
    return shown
