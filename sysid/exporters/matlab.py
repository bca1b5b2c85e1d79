"""A bundle's content as a MAT 5 file: one struct `sysid`, matrices in their natural shape.

Unknown numbers are NaN (a surface: an empty matrix); `sysid.not_identified` says why. The
same names as in the JSON, except for the surfaces: of a bipolynomial `C` (3, 3), C(i, j)
multiplying u^(i-1) P^(j-1), and `C_scaled` (3, 3) over Chebyshev polynomials of the scaled
inputs; of a network `W1` (H, 2), `b1` (H, 1), `W2` (1, H) and `b2`, for
u = centre + half (W2 tanh(W1 x + b1) + b2), x the scaled (flow; pressure).
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from sysid import __version__
from sysid.exporters.flat import DIRECTIONS, Flat
from sysid.exporters.json_file import content
from sysid.exporters.surface_tables import ExportedSurface
from sysid.surfaces.kinds import SURFACES

_HEADER = 116  # bytes of descriptive text at the start of a MAT 5 file


def encode(flat: Flat) -> bytes:
    """The file's bytes, the same for the same bundle."""
    from scipy.io import savemat

    buffer = io.BytesIO()
    struct = _struct(flat)
    savemat(buffer, {"sysid": struct}, format="5", oned_as="column", long_field_names=True)
    data = buffer.getvalue()
    # scipy writes the time and the platform there.
    text = f"MATLAB 5.0 MAT-file, sysid {__version__}, bundle {flat.provenance['bundle_sha256']}"
    return text[:_HEADER].ljust(_HEADER).encode("ascii") + data[_HEADER:]


def _struct(flat: Flat) -> dict[str, Any]:
    tree = content(flat)
    reasons = tree.pop("not_identified")
    for side, valve in flat.valves.items():
        for direction in DIRECTIONS:
            for part, fill in ((tree, _surface), (tree["units"], _surface_units)):
                slots = part["valves"][side]["pwm"][direction]
                for kind in SURFACES:
                    slots[kind] = fill(valve.pwm[direction].surfaces[kind], slots[kind])
    tree["effects"] = _cells(tree["effects"])
    tree["units"]["effects"] = _cells(tree["units"]["effects"])
    struct = {key: _matlab(value) for key, value in tree.items()}
    struct["not_identified"] = _cells([{"name": n, "reason": r} for n, r in reasons.items()])
    return struct


def _surface(surface: ExportedSurface | None, numbers: dict[str, Any] | None) -> Any:
    """A surface's struct: matrices in place of the JSON's lists."""
    if surface is None or numbers is None:
        return np.empty((0, 0))
    rest = {key: numbers[key] for key in ("scaling", "domain", "errors")}
    matrices = {
        part.matlab: np.reshape(part.values, part.shape)[()]
        for part in surface.model.exported()
        if part.matlab
    }
    return {**matrices, **rest}


def _surface_units(surface: ExportedSurface | None, table: dict[str, Any] | None) -> Any:
    if surface is None or table is None:
        return np.empty((0, 0))
    rest = {key: table[key] for key in ("scaling", "domain", "errors")}
    cells = {
        part.matlab: np.array(part.unit, dtype=object).reshape(part.shape)
        if isinstance(part.unit, list)
        else part.unit
        for part in surface.model.exported()
        if part.matlab
    }
    return {**cells, **rest}


def _cells(items: list[Any]) -> Any:
    """A cell array, a column (empty: 0 x 1)."""
    cells = np.empty((len(items), 1), dtype=object)
    for row, item in enumerate(items):
        cells[row, 0] = _matlab(item)
    return cells


def _matlab(value: Any) -> Any:
    """A value that savemat accepts: NaN for None, columns for lists, structs for objects."""
    if value is None:
        return np.nan
    if isinstance(value, dict):
        return {key: _matlab(item) for key, item in value.items()}
    if isinstance(value, list):
        return np.array([np.nan if item is None else item for item in value], dtype=float)
    return value
