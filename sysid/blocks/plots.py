"""Axes to draw on: the caller's, or new ones. Matplotlib is imported when used."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from sysid.errors import input_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Matplotlib's backends that only write files.
_WITHOUT_WINDOWS = {"agg", "cairo", "pdf", "pgf", "ps", "svg", "template"}
# A legend with more lines than this hides the plot.
MOST_IN_LEGEND = 12


def some_axes(count: int, axes: Axes | Iterable[Axes] | None, share_x: bool = True) -> list[Axes]:
    """`count` axes: those given, or new ones one below the other.

    The figure of new ones is pyplot's where a window or a notebook shows it; else it belongs to
    its axes alone (`axes.figure.savefig`), so that a loop of plots leaves no figure open.
    Raises InputError where another number is given.
    """
    if axes is None:
        figure = _new_figure(figsize=(7.0, 2.2 * count), layout="constrained")
        return list(figure.subplots(count, 1, sharex=share_x, squeeze=False)[:, 0])
    given = flat(axes)
    if len(given) != count:
        raise input_error("axes", f"{len(given)} for {count} panels", f"pass {count} axes, or none")
    return given


def _new_figure(**options: Any) -> Figure:
    from matplotlib import get_backend

    if get_backend().lower() in _WITHOUT_WINDOWS:
        from matplotlib.figure import Figure

        return Figure(**options)
    import matplotlib.pyplot as plt

    return plt.figure(**options)


def flat(axes: Axes | Iterable[Axes]) -> list[Axes]:
    """Axes one after the other, from one, a sequence, or what `plt.subplots` gives."""
    import numpy as np

    return list(np.ravel(np.asarray(axes, dtype=object)))


def legend(ax: Axes) -> None:
    """A legend, where there are several lines, but not too many."""
    labels = ax.get_legend_handles_labels()[1]
    if 1 < len(labels) <= MOST_IN_LEGEND:
        ax.legend(fontsize="small")


__all__ = ["flat", "legend", "some_axes"]
