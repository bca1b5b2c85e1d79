"""sysid: from logged tests of a pneumatic actuator to a model that controllers can trust.

>>> import sysid as si

==============================  ============================================================
`read_campaign`, `read_rig`     a rig's tests, and its constants: a `Campaign`, a `Rig`
`read_log`                      one log's tests: a `Log`
`check`                         what the logs can be used for, and what is wrong with them
`fit`                           all that the tests identify, with 95 % intervals: a `Bundle`
`fit_friction`                  one part alone: friction,
`fit_valve_discrete`            the on/off valves,
`fit_valve_pwm`                 the PWM valves
`diagnose`, `read_diagnosis`    what the model lacks; what `sysid diagnose` wrote of it
`refine`                        all parameters together, by simulation error
`validate`                      how well the model predicts the motion tests
`advise`                        which test to run next
`simulate`, `effects`           a `Model` on a log's inputs, with the catalogue's effects
`control`                       a controller on it, in a closed loop
`compare`                       several bundles: what moved; valves over one another
`pwm_frequency`                 which PWM frequency to run at, from logs at several
`monitor`                       whether a machine, by its logs, still obeys its bundle
`read_bundle`, `write_bundle`   a bundle in a file
`report`, `export`              a page; C, MATLAB, JSON, FMU, MJCF
`components`                    what a component of your own derives from
==============================  ============================================================

`help(si.fit)` says more of one of them. Values are SI, pressures absolute. Results print as tables,
are displayed in a notebook, convert to a DataFrame (`to_frame`) and plot themselves on given or
new axes (`plot`).

An error that a user can fix is an `InputError`, data that cannot identify what was asked a
`NotIdentifiedError`; both are `SysidError`s. Long tasks take `progress`, a function that is called
with one line for each step; by default a terminal or a notebook shows it, and a script does not.

The examples in the docstrings run as tests in a folder with the bundled campaign's files; there
`campaign` is that campaign, `log` its friction tests in one file, `run.csv`, `bundle` what `fit`
gives, `found` what `diagnose` gives, and `checked` what `validate` gives.
"""

import sys
from importlib import import_module
from types import FrameType
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

if TYPE_CHECKING:
    from sysid import components
    from sysid.errors import InputError, NotIdentifiedError, SysidError
    from sysid.io.campaign import Campaign
    from sysid.io.rig import Rig
    from sysid.io.samples import Log
    from sysid.parameters import Bundle
    from sysid.pipeline.advise import advise
    from sysid.pipeline.check import check
    from sysid.pipeline.compare import compare
    from sysid.pipeline.control import control
    from sysid.pipeline.diagnose import diagnose
    from sysid.pipeline.diagnosed import read_diagnosis
    from sysid.pipeline.export import export
    from sysid.pipeline.files import (
        read_bundle,
        read_campaign,
        read_log,
        read_rig,
        write_bundle,
    )
    from sysid.pipeline.fit import fit
    from sysid.pipeline.fit_part import fit_friction, fit_valve_discrete, fit_valve_pwm
    from sysid.pipeline.monitor import monitor
    from sysid.pipeline.pwm_frequency import pwm_frequency
    from sysid.pipeline.refine import refine
    from sysid.pipeline.report import report
    from sysid.pipeline.simulate import simulate
    from sysid.pipeline.validate import validate
    from sysid.plant import effects
    from sysid.plant.ports import Model

__all__ = [
    "Bundle",
    "Campaign",
    "InputError",
    "Log",
    "Model",
    "NotIdentifiedError",
    "Rig",
    "SysidError",
    "advise",
    "check",
    "compare",
    "components",
    "control",
    "diagnose",
    "effects",
    "export",
    "fit",
    "fit_friction",
    "fit_valve_discrete",
    "fit_valve_pwm",
    "monitor",
    "pwm_frequency",
    "read_bundle",
    "read_campaign",
    "read_diagnosis",
    "read_log",
    "read_rig",
    "refine",
    "report",
    "simulate",
    "validate",
    "write_bundle",
]

# The module that each name is loaded from at first use: `import sysid` itself stays quick.
_HOMES = {
    "Bundle": "sysid.parameters",
    "Campaign": "sysid.io.campaign",
    "InputError": "sysid.errors",
    "Log": "sysid.io.samples",
    "Model": "sysid.plant.ports",
    "NotIdentifiedError": "sysid.errors",
    "Rig": "sysid.io.rig",
    "SysidError": "sysid.errors",
    "advise": "sysid.pipeline.advise",
    "check": "sysid.pipeline.check",
    "compare": "sysid.pipeline.compare",
    "control": "sysid.pipeline.control",
    "diagnose": "sysid.pipeline.diagnose",
    "export": "sysid.pipeline.export",
    "fit": "sysid.pipeline.fit",
    "fit_friction": "sysid.pipeline.fit_part",
    "fit_valve_discrete": "sysid.pipeline.fit_part",
    "fit_valve_pwm": "sysid.pipeline.fit_part",
    "monitor": "sysid.pipeline.monitor",
    "pwm_frequency": "sysid.pipeline.pwm_frequency",
    "read_bundle": "sysid.pipeline.files",
    "read_campaign": "sysid.pipeline.files",
    "read_diagnosis": "sysid.pipeline.diagnosed",
    "read_log": "sysid.pipeline.files",
    "read_rig": "sysid.pipeline.files",
    "refine": "sysid.pipeline.refine",
    "report": "sysid.pipeline.report",
    "simulate": "sysid.pipeline.simulate",
    "validate": "sysid.pipeline.validate",
    "write_bundle": "sysid.pipeline.files",
}


_PACKAGES = {"components": "sysid.components", "effects": "sysid.plant.effects"}


def __getattr__(name: str) -> Any:
    """A public name, loaded at first use."""
    if name in _PACKAGES:
        value: Any = import_module(_PACKAGES[name])
    elif name in _HOMES:
        value = getattr(import_module(_HOMES[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """What is public. `help(sysid)` prints every class that it finds here whole, 1,700 lines: it
    gets the docstring's table alone."""
    caller: FrameType | None = sys._getframe(1)
    for _ in range(3):  # pydoc asks through inspect.getmembers, which asks dir
        if caller is not None and caller.f_globals.get("__name__") == "pydoc":
            return ["__version__"]
        caller = caller.f_back if caller is not None else None
    return sorted([*__all__, "__version__"])
