"""Two FMUs in a loop through FMPy: controllers and plant, a millisecond at a time."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sysid.types import FloatArray

STEP = 1e-3


class Unit:
    """An instance of an FMU, read and set by names."""

    def __init__(self, path: Path, start: Mapping[str, Any]) -> None:
        import fmpy
        from fmpy import fmi2, fmi3

        self.folder = fmpy.extract(str(path))
        about = fmpy.read_model_description(path)
        self.variables = {v.name: v for v in about.modelVariables}
        self.is_3 = about.fmiVersion == "3.0"
        make = fmi3.FMU3Slave if self.is_3 else fmi2.FMU2Slave
        own: dict[str, Any] = {
            "guid": about.guid,
            "unzipDirectory": self.folder,
            "modelIdentifier": about.coSimulation.modelIdentifier,
            "instanceName": path.stem,
        }
        self.fmu = make(**own)
        self.fmu.instantiate()
        if not self.is_3:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        for name, value in start.items():
            self[name] = value
        self.fmu.exitInitializationMode()

    def __setitem__(self, name: str, value: Any) -> None:
        v = self.variables[name]
        getattr(self.fmu, f"set{v.type}")([v.valueReference], [value])

    def __getitem__(self, name: str) -> Any:
        v = self.variables[name]
        return getattr(self.fmu, f"get{v.type}")([v.valueReference])[0]

    def step(self, time: float) -> None:
        """From `time` on."""
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=STEP)

    def close(self) -> None:
        """End it, and remove what was unpacked."""
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder)


def loop(plant: Unit, controllers: Unit, reference: FloatArray, uses_duty: bool) -> FloatArray:
    """(n, 6): position, pressures and commands, the motor's first, at each tick of a reference
    (n, 4).
    """
    names = ("position", "velocity", "acceleration", "jerk")
    valves = [f"{'duty' if uses_duty else 'valve'}_{side}" for side in "ab"]
    seen = ("theta_rad", "pressure_a_pa", "pressure_b_pa")
    found = np.empty((len(reference), 6))
    for k, row in enumerate(reference):
        for name in seen:
            controllers[name] = plant[name]
        for name, value in zip(names, row, strict=True):
            controllers[f"reference.{name}"] = value
        controllers.step(k * STEP)
        commands = {name: controllers[name] for name in ("motor_torque_nm", *valves)}
        for name, value in commands.items():
            plant[name] = value
        found[k] = [*(plant[name] for name in seen), *map(float, commands.values())]
        plant.step(k * STEP)
    return found
