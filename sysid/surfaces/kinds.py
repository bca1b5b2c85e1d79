"""The kinds of surface that a bundle can hold: where a further one is added."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class SurfaceKind:
    """A kind of surface: its estimator, `module` (of this room) and class, and its names in C.

    The functions of its header have `c_suffix` between the slot's name and `_flow` or `_duty`.
    """

    module: str
    estimator: str
    c_name: str
    c_suffix: str

    def load(self) -> Any:
        """The estimator's class."""
        return getattr(importlib.import_module(f"sysid.surfaces.{self.module}"), self.estimator)


SURFACES = {
    "bipolynomial": SurfaceKind("bipolynomial", "Bipolynomial", "bipolynomial", ""),
    "ann": SurfaceKind("ann", "DutyNetwork", "network", "_network"),
}
"""The kinds by their names in bundles, in the order of the thesis."""

__all__ = ["SURFACES", "SurfaceKind"]
