"""sysid: from logged tests of a pneumatic actuator to a model that controllers can trust.

>>> import sysid as si

Read measurements (`read_campaign`, `read_rig`, `read_log`), see what they can be used for
(`check`), fit them (`fit`, or one part: `fit_friction`, `fit_valve_discrete`,
`fit_valve_pwm`), use the model (`simulate`, `control`, `effects`), find what it lacks
(`diagnose`), fit it as a whole (`refine`), see how well it predicts (`validate`) and which test
to run next (`advise`), compare several (`compare`), and write it out (`write_bundle`, `report`,
`export`). `components` holds what a component of your own derives from.
Values are SI, pressures absolute. Results print as tables, are displayed in a notebook, convert
to a DataFrame (`to_frame`) and plot themselves on given or new axes (`plot`).

An error that a user can fix is an `InputError`, data that cannot identify what was asked a
`NotIdentifiedError`; both are `SysidError`s. Long tasks take `progress`, a function that is called
with one line for each step; by default a terminal or a notebook shows it, and a script does not.

The examples in the docstrings run as tests in a folder with the bundled campaign's files; there
`campaign` is that campaign, `log` its friction tests in one file, `run.csv`, `bundle` what `fit`
gives, and `checked` what `validate` gives.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from sysid import components
    from sysid.bundle import Bundle
    from sysid.errors import InputError, NotIdentifiedError, SysidError
    from sysid.io.campaign import Campaign
    from sysid.io.rig import Rig
    from sysid.io.samples import Log
    from sysid.model import effects
    from sysid.model.ports import Model
    from sysid.workflows.advising import advise
    from sysid.workflows.comparing import compare
    from sysid.workflows.controlling import control
    from sysid.workflows.diagnosing import diagnose
    from sysid.workflows.fitting import fit, fit_friction, fit_valve_discrete, fit_valve_pwm
    from sysid.workflows.judging import check, validate
    from sysid.workflows.reading import (
        read_bundle,
        read_campaign,
        read_log,
        read_rig,
        write_bundle,
    )
    from sysid.workflows.refining import refine
    from sysid.workflows.simulation import simulate
    from sysid.workflows.writing import export, report

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
    "read_bundle",
    "read_campaign",
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
    "Bundle": "sysid.bundle",
    "Campaign": "sysid.io.campaign",
    "InputError": "sysid.errors",
    "Log": "sysid.io.samples",
    "Model": "sysid.model.ports",
    "NotIdentifiedError": "sysid.errors",
    "Rig": "sysid.io.rig",
    "SysidError": "sysid.errors",
    "advise": "sysid.workflows.advising",
    "check": "sysid.workflows.judging",
    "compare": "sysid.workflows.comparing",
    "control": "sysid.workflows.controlling",
    "diagnose": "sysid.workflows.diagnosing",
    "export": "sysid.workflows.writing",
    "fit": "sysid.workflows.fitting",
    "fit_friction": "sysid.workflows.fitting",
    "fit_valve_discrete": "sysid.workflows.fitting",
    "fit_valve_pwm": "sysid.workflows.fitting",
    "read_bundle": "sysid.workflows.reading",
    "read_campaign": "sysid.workflows.reading",
    "read_log": "sysid.workflows.reading",
    "read_rig": "sysid.workflows.reading",
    "refine": "sysid.workflows.refining",
    "report": "sysid.workflows.writing",
    "simulate": "sysid.workflows.simulation",
    "validate": "sysid.workflows.judging",
    "write_bundle": "sysid.workflows.reading",
}


_PACKAGES = {"components": "sysid.components", "effects": "sysid.model.effects"}


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
    return sorted({*globals(), *__all__})


class _Face(ModuleType):
    """Keeps `report` the function.

    Importing the package of that name would replace the function; import from it by its full
    name, `from sysid.report import write_report`.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOMES and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Face
