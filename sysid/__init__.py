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

from importlib import import_module
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
    "read_bundle": "sysid.pipeline.files",
    "read_campaign": "sysid.pipeline.files",
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
    return sorted({*globals(), *__all__})
