"""Tracking errors over draws of what is not known: their distribution, and bands over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.numbers import number
from sysid.blocks.tables import Table, table
from sysid.controllers.cases import ClosedLoopRun
from sysid.io.files import make_folder
from sysid.io.tables import write_table
from sysid.types import FloatArray

if TYPE_CHECKING:
    import pandas as pd

DRAWS_NAME, BANDS_NAME = "draws.csv", "bands.csv"
LEVELS = {"p05": 0.05, "median": 0.5, "p95": 0.95}
"""The quantiles that are shown: between the outer ones lie 90 %."""
_METRICS = {"rmse": "RMSE", "mae": "MAE, largest error"}


@dataclass(frozen=True)
class TrackingDraws:
    """A closed loop on plants drawn about a bundle's: arrays by draw (n,).

    `names` (k,) and `values` (n, k) of the drawn numbers; `rmse` and `mae` rad; `faults` that each
    loop reported; `time` (t,) s, `errors` (n, t) reference less position, rad.
    """

    seed: int
    names: tuple[str, ...]
    values: FloatArray
    rmse: FloatArray
    mae: FloatArray
    faults: tuple[tuple[str, ...], ...]
    time: FloatArray
    errors: FloatArray

    @classmethod
    def of(
        cls,
        seed: int,
        names: Sequence[str],
        values: FloatArray,
        runs: Sequence[ClosedLoopRun],
    ) -> TrackingDraws:
        """Those of the runs on the drawn plants."""
        metrics = [run.metrics for run in runs]
        return cls(
            seed,
            tuple(names),
            values,
            np.array([m.rmse for m in metrics]),
            np.array([m.mae for m in metrics]),
            tuple(run.faults for run in runs),
            runs[0].time,
            np.array([run.reference[:, 0] - run.position for run in runs]),
        )

    def __len__(self) -> int:
        return len(self.rmse)

    @property
    def faulty(self) -> int:
        """In how many draws the loop reported a fault."""
        return sum(bool(lines) for lines in self.faults)

    def quantiles(self, name: str) -> dict[str, float]:
        """Those of a metric, rad."""
        found = quantiles(getattr(self, name), tuple(LEVELS.values()))
        return dict(zip(LEVELS, map(float, found), strict=True))

    def table(self) -> Table:
        """Quantiles of each metric, mrad."""
        rows = [
            (text, *(number(1e3 * v) for v in self.quantiles(name).values()))
            for name, text in _METRICS.items()
        ]
        head = ("Metric, mrad", "5 %", "median", "95 %")
        return table(f"Over {len(self)} draws of the plant", head, rows)

    def to_json(self) -> dict[str, Any]:
        """Count, seed, quantiles and the draws themselves, rad."""
        own = {
            f"{name}_rad": {**self.quantiles(name), "values": getattr(self, name).tolist()}
            for name in _METRICS
        }
        return {"count": len(self), "seed": self.seed, **own, "with_faults": self.faulty}

    def draws_frame(self) -> pd.DataFrame:
        """One row per draw: its numbers, in the bundle's units, RMSE and MAE, rad, its faults."""
        import pandas as pd

        columns = {name: self.values[:, i] for i, name in enumerate(self.names)}
        own = {f"{name}_rad": getattr(self, name) for name in _METRICS}
        faults = ["; ".join(lines) for lines in self.faults]
        return pd.DataFrame({"draw": np.arange(1, len(self) + 1), **columns, **own}).assign(
            faults=faults
        )

    def bands_frame(self) -> pd.DataFrame:
        """One row per tick: quantiles of the tracking error over the draws, rad."""
        import pandas as pd

        found = quantiles(self.errors, tuple(LEVELS.values()))
        named = {f"error_rad_{name}": row for name, row in zip(LEVELS, found, strict=True)}
        return pd.DataFrame({"time_s": np.round(self.time, 9), **named})

    def write(self, folder: Path, comments: Sequence[str]) -> list[Path]:
        """Write `draws.csv` and `bands.csv`; the paths. Raises InputError."""
        make_folder(folder)
        own = [*comments, f"{len(self)} draws of the plant, seed {self.seed}"]
        write_table(self.draws_frame(), folder / DRAWS_NAME, own)
        write_table(self.bands_frame(), folder / BANDS_NAME, own)
        return [folder / DRAWS_NAME, folder / BANDS_NAME]


def quantiles(values: FloatArray, levels: Sequence[float]) -> FloatArray:
    """Quantiles (levels, ...) over the first axis such that a further draw keeps to them.

    With n draws it lies below the k-th smallest with a probability of k/(n + 1).
    """
    return np.asarray(np.quantile(values, levels, axis=0, method="weibull"))


__all__ = ["BANDS_NAME", "DRAWS_NAME", "LEVELS", "TrackingDraws", "quantiles"]
