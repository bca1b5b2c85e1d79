"""Components of the user's own: a class in a Python file, fitted and diagnosed like ours.

`import sysid as si` shows it as `si.components`. A static component is a law in the logged columns
(`StaticComponent.predict`), a dynamic one a right-hand side in jax (`DynamicComponent.derivative`
and `measure`), simulated open loop. Columns, parameters with units and bounds, and the terms that
the law may lack are declared in the class; docs/own-components.md shows how.

`definition` holds the classes that a user derives from, `loading` checks one of a file; `static`
and `dynamic` make a `sysid.diagnosis.bench.component.Component` of it and its tests; `starts`
checks that a law gives numbers where it starts, `own_tests` reads the tests of one, `validation`
simulates whole tests, `refinement` estimates on them, `log_check` says what its logs are good for.

>>> si.components.LogColumn("V", "input").between
'held'
"""

from sysid.components.definition import DynamicComponent, LogColumn, StaticComponent, Term
from sysid.components.loading import with_component
from sysid.estimation.nonlinear import Parameter
from sysid.plant.effects.entry import Quantity

__all__ = [
    "DynamicComponent",
    "LogColumn",
    "Parameter",
    "Quantity",
    "StaticComponent",
    "Term",
    "with_component",
]
