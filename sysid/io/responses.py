"""What a log's channels say about one another: columns that were taken for other ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from sysid.io.channels import CHAMBER_PRESSURES, SIDES
from sysid.signals import MIN_SAMPLES
from sysid.types import FloatArray

# Standardized coefficients of a chamber's pressure on the valves' commands, over a log's rows.
_FOLLOWS = 0.3
_MORE = 1.5
_OPPOSED_ALONE = -0.5


def response_notices(
    where: str, columns: Mapping[str, FloatArray], position: str, effort: str, way: float = 1.0
) -> Iterator[str]:
    """Notices of columns, (n,) each, that hold another column's values or answer another's command.

    `position` and `effort` name the rig's channels; `way` is its `supply_way`.
    """
    for first, second in (CHAMBER_PRESSURES, (position, effort)):
        if first in columns and second in columns and _same(columns[first], columns[second]):
            yield (
                f"{where}: {first} and {second} hold the same values in every row: one column was "
                f"mapped twice; map {second} to its own column"
            )
    line = _answers(columns, way)
    if line:
        yield f"{where}: {line}"


def _same(first: FloatArray, second: FloatArray) -> bool:
    return bool(np.ptp(first) > 0.0 and np.array_equal(first, second))


def _answers(columns: Mapping[str, FloatArray], way: float) -> str | None:
    """Whether the chambers answer the other valve's command, or the opposite of their own."""
    if way < 0.0:
        mirrored = {name: -columns[name] for name in CHAMBER_PRESSURES if name in columns}
        columns = {**columns, **mirrored}
    for stem in ("valve", "duty"):
        commands = [f"{stem}_{side}" for side in SIDES]
        active = [c for c in commands if c in columns and np.ptp(columns[c]) > 0.0]
        own: list[float] = []
        cross: list[float] = []
        for side in SIDES:
            shares = _shares(columns, active, f"pressure_{side}_pa")
            for command, share in shares.items():
                (own if command[-1] == side else cross).append(share)
        if own and max(own) < -_FOLLOWS and _all_oppose(columns, active):
            return (
                f"the chambers' pressures {'fall' if way > 0.0 else 'rise'} while their valves are "
                f"on: {stem}_a and {stem}_b "
                "are inverted (1 connects the chamber to the supply) or swapped"
            )
        if own and cross and min(cross) > max(_FOLLOWS, _MORE * max(own)):
            return (
                "each chamber's pressure follows the other chamber's valve: "
                f"{stem}_a and {stem}_b, or the pressures, are swapped"
            )
    return None


def _all_oppose(columns: Mapping[str, FloatArray], commands: list[str]) -> bool:
    """Whether each command and its own chamber's pressure are opposed, taken alone."""
    return all(
        max(_shares(columns, [c], f"pressure_{c[-1]}_pa").values(), default=0.0) < _OPPOSED_ALONE
        for c in commands
    )


def _shares(
    columns: Mapping[str, FloatArray], commands: list[str], pressure: str
) -> dict[str, float]:
    """Each command's standardized regression coefficient on a pressure, 1 where it follows it."""
    if not commands or pressure not in columns:
        return {}
    p = columns[pressure]
    if len(p) < MIN_SAMPLES or np.ptp(p) == 0.0:
        return {}
    x = np.column_stack([_standard(columns[c]) for c in commands])
    solution, *_ = np.linalg.lstsq(x, _standard(p), rcond=1e-6)
    return dict(zip(commands, map(float, solution), strict=True))


def _standard(values: FloatArray) -> FloatArray:
    return np.asarray((values - values.mean()) / values.std())


__all__ = ["response_notices"]
