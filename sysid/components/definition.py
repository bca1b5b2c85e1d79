"""What a user derives a component from: its columns, parameters, law, and the terms it may lack."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from sysid.estimation.nonlinear import Parameter
from sysid.plant.effects.entry import Quantity

Named = Mapping[str, Any]
"""Numbers or arrays, of numpy or jax, by name."""


@dataclass(frozen=True)
class LogColumn:
    """A column of the component's logs: its unit, and whether it drives or is predicted.

    An input holds from its row to the next, as a command does; `between="line"` joins its rows by
    straight lines, as a measured input asks. `lower` and `upper`: what can be measured, in `unit`.
    """

    unit: str
    role: Literal["input", "output"]
    between: Literal["held", "line"] = "held"
    lower: float = -math.inf
    upper: float = math.inf


@dataclass(frozen=True)
class Term:
    """An effect that the law may lack: what is added to it, 0 where all strengths are 0.

    `adds(columns, values)` of a static component gives what is added to the prediction: an
    array, or arrays by output. `adds(state, inputs, values)` of a dynamic one gives, by state,
    what is added to its rate. `values` holds the component's parameters and the term's own
    quantities by name. `tie_breaker`: the test that distinguishes it from its rivals.
    """

    id: str
    title: str
    quantities: tuple[Quantity, ...]
    adds: Callable[..., Any]
    tie_breaker: str = ""


class OwnComponent(ABC):
    """What static and dynamic components have in common; derive from one of these two.

    `kind` is what a campaign's logs of it are called; `columns` and `parameters` (start, unit,
    bounds) are by name, each with its unit in its own declaration.
    """

    kind: ClassVar[str]
    title: ClassVar[str] = ""
    columns: ClassVar[Mapping[str, LogColumn]]
    parameters: ClassVar[tuple[Parameter, ...]]
    terms: ClassVar[tuple[Term, ...]] = ()

    @property
    def inputs(self) -> tuple[str, ...]:
        """The columns that drive it."""
        return tuple(n for n, c in self.columns.items() if c.role == "input")

    @property
    def outputs(self) -> tuple[str, ...]:
        """The columns that it predicts."""
        return tuple(n for n, c in self.columns.items() if c.role == "output")


class StaticComponent(OwnComponent):
    """A law in the logged columns, without memory.

    >>> from sysid.components import LogColumn, Parameter, StaticComponent
    >>> class Spring(StaticComponent):
    ...     kind = "spring"
    ...     columns = {"position_m": LogColumn("m", "input"), "force_n": LogColumn("N", "output")}
    ...     parameters = (Parameter("stiffness_n_per_m", 100.0, "N/m", 0.0),)
    ...     def predict(self, columns, values):
    ...         return values["stiffness_n_per_m"] * columns["position_m"]
    """

    @abstractmethod
    def predict(self, columns: Named, values: Named) -> Any:
        """The predicted output (n,), or outputs by name; `columns`: the inputs and `time_s`, (n,).

        `values` are the parameters.
        """

    def regressors(self, columns: Named) -> Named:
        """What a residual may depend on, (n,) by name; by default the inputs."""
        return {name: columns[name] for name in self.inputs}


class DynamicComponent(OwnComponent):
    """A right-hand side, simulated open loop by implicit steps of order 3 from row to row.

    `states` names them; everything that depends on them is written with `jax.numpy`, without
    branches on values. `substeps` of the integration lie between two rows. With `segment_s` the fit
    and the diagnosis simulate stretches of that length, each from its own measured start, rather
    than whole tests: for a state that drifts, as the position of an axis under friction.
    """

    states: ClassVar[tuple[str, ...]]
    substeps: ClassVar[int] = 1
    segment_s: ClassVar[float | None] = None

    @abstractmethod
    def start(self, first: Named, rates: Named, values: Named) -> Named:
        """The states at the first row, by name: `first` its columns, smoothed where measured.

        `rates` are their time derivatives there, `values` the parameters.
        """

    @abstractmethod
    def derivative(self, state: Named, inputs: Named, values: Named) -> Named:
        """The time derivative of each state, by name; `inputs` and `time_s` at that time."""

    @abstractmethod
    def measure(self, state: Named, inputs: Named, values: Named) -> Named:
        """What the sensors show: each output, by name."""


def outputs_of(found: Any, made: OwnComponent) -> dict[str, Any]:
    """What a law or term returned, by output: an array is that of the only one."""
    return dict(found) if isinstance(found, Mapping) else {made.outputs[0]: found}


__all__ = ["DynamicComponent", "LogColumn", "Named", "OwnComponent", "StaticComponent", "Term"]
