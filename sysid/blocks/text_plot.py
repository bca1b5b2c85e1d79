"""A curve as text, in braille characters."""

from __future__ import annotations

import numpy as np

from sysid.types import FloatArray

WIDTH = 64
"""Characters of a line."""
_BRAILLE = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))  # dots by row and column


def text_plot(values: FloatArray, width: int = WIDTH, rows: int = 4) -> list[str]:
    """A curve (n,) in braille, `rows` lines of `width` characters; dots mark its zero line.

    Each column of dots spans the values that fall into it.
    """
    height = 4 * rows
    low, high = min(float(values.min()), 0.0), max(float(values.max()), 0.0)
    span = high - low or 1.0
    cells = np.zeros((rows, width), dtype=int)

    def mark(column: int, value: float, to: float) -> None:
        first, last = sorted(round((high - v) / span * (height - 1)) for v in (value, to))
        for dot in range(first, last + 1):
            cells[dot // 4, column // 2] |= _BRAILLE[dot % 4][column % 2]

    parts = np.array_split(values, min(2 * width, len(values)))
    for column, part in enumerate(parts):
        mark(column, float(part.min()), float(part.max()))
        if column % 4 == 0:
            mark(column, 0.0, 0.0)
    return ["".join(chr(0x2800 + int(cell)) for cell in line) for line in cells]
