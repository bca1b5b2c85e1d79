"""A picture of what an effect changes in its demonstration."""

from __future__ import annotations

import io
from typing import Any

from sysid.plant.effects.demonstration import Demonstration
from sysid.plant.effects.entry import CatalogueEffect

PICTURES = (".png", ".svg")
"""Suffixes of the kinds of picture that can be drawn."""

# Shares of the figure, and of a panel, with room for labels of seven digits: to measure the labels,
# as a constrained layout does, takes as long as to draw all.
_MARGINS = {
    "left": 0.1, "right": 0.985, "bottom": 0.08, "top": 0.91, "wspace": 0.2, "hspace": 0.15,
}  # fmt: skip


def picture(effect: type[CatalogueEffect], shown: Demonstration, suffix: str) -> bytes:
    """The channels without and with the effect, and their difference: SVG or PNG by `suffix`."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    style: Any = {"svg.fonttype": "none", "svg.hashsalt": "sysid", "text.parse_math": False}
    buffer = io.BytesIO()
    with matplotlib.rc_context(style):
        figure = Figure(figsize=(10.0, 6.5))
        FigureCanvasAgg(figure)
        axes = figure.subplots(len(shown.channels), 2, sharex=True, gridspec_kw=_MARGINS)
        for row, (channel, unit) in zip(axes, shown.channels, strict=True):
            row[0].plot(shown.time, shown.base[channel], color="0.6", lw=2.0, label="base model")
            row[0].plot(shown.time, shown.changed[channel], color="C0", lw=1.0, label="with it")
            row[0].set_ylabel(channel if unit == "Pa" else f"{channel}, {unit}")
            row[1].axhline(0.0, color="0.6", lw=0.8)
            row[1].plot(shown.time, shown.difference(channel), color="C3", lw=1.0)
        axes[0, 0].legend()
        axes[0, 1].set_title("change by the effect", fontsize="medium")
        for ax in axes[-1]:
            ax.set_xlabel("time, s")
        sizes = ", ".join(f"{q.label} = {q.typical:.3g}" for q in effect.quantities)
        figure.suptitle(f"{effect.title}: {sizes}", fontsize="medium")
        metadata: Any = {"Date": None} if suffix == ".svg" else None
        figure.savefig(buffer, format=suffix[1:], dpi=120, metadata=metadata)
    return buffer.getvalue()
