"""The controllers of a batch by structure: those that differ in numbers only run together."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sysid.controllers.interface import Controller
from sysid.plant.arrays import stacked, take_apart
from sysid.plant.base import Array


class Group(NamedTuple):
    """Lanes whose controllers share a structure, or are one object."""

    structure: Any
    lanes: tuple[int, ...]


def grouped(controllers: list[Controller]) -> tuple[tuple[Group, ...], list[list[Array]]]:
    """Controllers by structure, in the order of their first lane, and their stacked numbers."""
    members: dict[Any, list[int]] = {}
    parts: list[list[Array]] = []
    for lane, controller in enumerate(controllers):
        structure, numbers = take_apart(controller)
        parts.append(numbers)
        shapes = tuple(np.shape(n) for n in numbers)
        members.setdefault((structure, shapes), []).append(lane)
    groups = []
    for structure, _ in members:
        groups.append(Group(structure, tuple(members[structure, _])))
    numbers_by_group = [stacked([parts[lane] for lane in g.lanes]) for g in groups]
    return tuple(groups), numbers_by_group


__all__ = ["Group", "grouped"]
