"""An axis that a motor alone drives: no air, no cylinder, no valves, and a mass that no file tells.

The plant is that of the other rigs with chambers that exert no force; the files do not mention
them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from datasets.generator.campaign import stream
from datasets.generator.effects.catalogue import Injected
from datasets.generator.files import write_log, write_text
from datasets.generator.friction_tests import motion_test
from datasets.generator.rigs import GeneratedRig, ValveTruth, random_rig, rig_toml
from datasets.generator.runs import GeneratedTest

KIND = "friction-motion"
_NO_AREA_M2 = 1e-12
_NO_FLOW = ValveTruth(0.0, 0.0, 0.0, 0.0)
_DECLARED = ("rig", "motor", "sampling", "sensors")
_DURATION_S = 8.0


def motor_axis(seed: int, motion: str = "rotary", effects: Sequence[Injected] = ()) -> GeneratedRig:
    """A random axis in the horizontal; its chambers neither push nor leak."""
    rig = random_rig(stream(seed, "rig"), "horizontal", motion)
    content = {section: dict(table) for section, table in rig.content.items()}
    content["cylinder"] |= {"area_a_m2": _NO_AREA_M2, "area_b_m2": _NO_AREA_M2}
    truth = dataclasses.replace(rig.truth, valve_a=_NO_FLOW, valve_b=_NO_FLOW)
    return GeneratedRig(content, truth, tuple(effects))


def axis_tests(
    rig: GeneratedRig, seed: int, count: int, scatter: float = 0.0
) -> list[GeneratedTest]:
    """Clipped sines of the motor from rest, as an axis logs them: position and effort alone."""
    tests = []
    for i in range(count):
        rng: np.random.Generator = stream(seed, KIND, i)
        test = motion_test(rig, str(i + 1), _DURATION_S, scatter, 1.0, rng)
        columns = {k: v for k, v in test.columns.items() if "pressure" not in k}
        tests.append(dataclasses.replace(test, columns=columns))
    return tests


def axis_rig_toml(rig: GeneratedRig) -> str:
    """The rig file: neither pneumatics nor an inertia."""
    content = {name: dict(rig.content[name]) for name in _DECLARED}
    content["sensors"].pop("pressure_noise_pa", None)
    return rig_toml(content)


def write_axis_campaign(
    folder: Path, rig: GeneratedRig, tests: Sequence[GeneratedTest], held_out: int = 1
) -> Path:
    """The campaign file of these tests, the last `held_out` of them held out, beside its logs."""
    write_text(folder / "rig.toml", axis_rig_toml(rig))
    text = 'rig = "rig.toml"\n'
    fitted = len(tests) - held_out
    for use, own in (("fit", tests[:fitted]), ("holdout", tests[fitted:])):
        if own:
            write_log(folder / f"{use}.csv", own, rig)
            text += f'\n[[log]]\nkind = "{KIND}"\nfile = "{use}.csv"\nuse = "{use}"\n'
    path = folder / "campaign.toml"
    write_text(path, text)
    return path


__all__ = ["axis_rig_toml", "axis_tests", "motor_axis", "write_axis_campaign"]
