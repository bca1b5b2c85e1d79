"""Catalogues other than the project's own: a few of its effects, or a file with one more."""

from __future__ import annotations

import importlib
from collections.abc import Collection
from types import SimpleNamespace

import pytest

from sysid.plant.effects.catalogue import catalogue

# As a user writes it: `load_user_effects` runs it.
USER_EFFECT = '''
from dataclasses import dataclass
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.entry import CatalogueEffect, Quantity


@dataclass(frozen=True)
class Wind(CatalogueEffect):
    """A torque that blows."""

    wind_nm: float = 0.0
    id = "wind"
    title = "Wind"
    subsystem = "mechanics"
    quantities = (Quantity("wind_nm", "Nm", 0.1, -2.0, 2.0, "torque"),)
    signature = "torque"
    source = "none"

    def external_effort(self, effort, point):
        return effort + self.wind_nm
'''


def only(names: Collection[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """The catalogue holds these effects alone: fewer are tried."""
    some = SimpleNamespace(EFFECTS=[catalogue()[name] for name in names])
    module = importlib.import_module("sysid.plant.effects.catalogue")
    monkeypatch.setattr(module, "_MODULES", (some,))
