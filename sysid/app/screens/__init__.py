"""The screens of the workbench, one file each, in the order of the work.

`base` is what they have in common.
"""

from __future__ import annotations

from sysid.app.screens.base import Screen
from sysid.app.screens.compare import CompareScreen
from sysid.app.screens.effects import EffectsScreen
from sysid.app.screens.export import ExportScreen
from sysid.app.screens.files import FilesScreen
from sysid.app.screens.fit import FitScreen
from sysid.app.screens.identify import IdentifyScreen
from sysid.app.screens.look import LookScreen
from sysid.app.screens.residual import ResidualScreen

SCREENS: dict[str, type[Screen]] = {
    "files": FilesScreen,
    "look": LookScreen,
    "identify": IdentifyScreen,
    "fit": FitScreen,
    "residual": ResidualScreen,
    "effects": EffectsScreen,
    "compare": CompareScreen,
    "export": ExportScreen,
}
"""The screens by their names in addresses."""

__all__ = ["SCREENS", "Screen"]
