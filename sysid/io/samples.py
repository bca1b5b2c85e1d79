"""One test's samples, and the log that holds them (`docs/reference/log-format.md`)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.plots import legend, some_axes
from sysid.blocks.shown import Shown
from sysid.errors import InputError, input_error
from sysid.io.channels import SWITCHES, VALVE_COMMANDS
from sysid.io.exclusion import Excluded
from sysid.io.rig import Rig
from sysid.io.units import ColumnMap
from sysid.types import FloatArray

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Trial:
    """One test (`test` of the log format): its samples, SI, absolute pressures.

    `time` (n,) s, strictly increasing, as in the file. `channels` holds (n,) arrays by
    their names in the log format; position is always `theta_rad` (linear: `position_m`),
    and the motor command always `motor_torque_nm` (linear: `motor_force_n`) at the output
    shaft, whatever column the file gave. `source` names file and test for messages.
    `unusable` gives the faults of columns that only few kinds of test need. `row_period`: the
    samples are not as measured but between measured ones so many seconds apart (`sysid convert
    --resample`, `--join`, a sensor slower than the logger), and their noise is correlated; None: as
    measured. `slow`: where only some channels are so, their names with the period (s) of each.
    `is_readings`: a table without time, each row a reading by itself; `time` then counts the rows.
    `read_as` tells from which column a channel was read, and how; `contradictions` are those of its
    log (`Log`). `place_known` is False where the position is the integral of a measured speed.
    `begun_s`: how long after the test's first row this part of it begins, what was before being
    excluded (`sysid.io.exclusion`); what begins with a test (rest, valves off) does not begin with
    it. `payload_kg`: what was carried, kg (None: what the rig file says). `flow_control`: whether
    the valve's flow control, where it has one, was in place. `starts_at`, rad or m: where a
    designed test says that it begins, for a log of commands alone.
    """

    label: str
    time: FloatArray
    channels: Mapping[str, FloatArray]
    source: str
    unusable: Mapping[str, str] = field(default_factory=dict)
    row_period: float | None = None
    read_as: Mapping[str, ColumnMap] = field(default_factory=dict)
    contradictions: tuple[str, ...] = ()
    is_readings: bool = False
    slow: Mapping[str, float] = field(default_factory=dict)
    place_known: bool = True
    begun_s: float = 0.0
    payload_kg: float | None = None
    flow_control: bool = True
    starts_at: float = 0.0

    def __contains__(self, name: str) -> bool:
        return name in self.channels

    def __getitem__(self, name: str) -> FloatArray:
        return self.channels[name]

    def __len__(self) -> int:
        return len(self.time)

    @property
    def period(self) -> float:
        """Median sampling period, s."""
        return float(np.median(np.diff(self.time)))

    @property
    def since_start(self) -> FloatArray:
        """Time of each row (n,) since the test's first, excluded or not, s."""
        return np.asarray(self.time - self.time[0] + self.begun_s)

    @property
    def has_its_start(self) -> bool:
        """Whether the test's first row is the trial's: it starts at rest, with its valves off."""
        return self.begun_s == 0.0

    @cached_property
    def line_pressure_pa(self) -> float | None:
        """The supply as it was logged while no valve drew on it, Pa; None where it was not.

        What a flow takes from it is not the line's own pressure.
        """
        logged = self.channels.get("supply_pressure_pa")
        if logged is None:
            return None
        fills = [
            self[name] for name in VALVE_COMMANDS if name in self and not name.endswith("_bleed")
        ]
        drawn = np.any(np.array(fills) > 0.0, axis=0) if fills else np.zeros(len(self), dtype=bool)
        idle = logged[~drawn & np.isfinite(logged)]
        return float(np.median(idle)) if len(idle) else None

    @property
    def title(self) -> str:
        """The log's name without its folder, and the test where the log holds several."""
        suffix = f", test {self.label}"
        return Path(self.source.removesuffix(suffix)).name + (suffix if self.label else "")

    @property
    def stride(self) -> int:
        """Samples from one to the next whose errors are not shared: 1 where all are measured."""
        return 1 if self.row_period is None else max(1, math.ceil(self.row_period / self.period))

    def stride_of(self, channel: str) -> int:
        """`stride`, of one channel."""
        if not self.slow:
            return self.stride
        return max(1, math.ceil(self.slow.get(channel, 0.0) / self.period))

    @property
    def frame(self) -> pd.DataFrame:
        """The samples as a new DataFrame: `time_s`, one column per channel, one row per sample."""
        import pandas as pd

        return pd.DataFrame({"time_s": self.time, **self.channels})

    def reversed_map(self, name: str) -> str:
        """The --map entry that reads a channel with the other sign."""
        return self.read_as.get(name, ColumnMap(name, name)).reversed()

    def require(self, names: Sequence[str], why: str) -> None:
        """InputError that names the first channel of `names` that the log lacks."""
        for name in names:
            if name in self.unusable:
                raise InputError(self.unusable[name])
            if name not in self.channels:
                unit = "" if name in SWITCHES else ":UNIT"  # on and off have none
                raise input_error(
                    self.source,
                    f"column {name} is missing, {why}",
                    f'add it, or map it with --map "{name}=COLUMN{unit}"',
                )


@dataclass(frozen=True, repr=False)
class Log(Shown):
    """A log file as read: its trials, its SHA-256, and the reader's notices.

    `rig` is the rig that it was read with; `excluded` is what is not in its trials. Values are SI,
    pressures absolute. `len(log)` counts its tests, `log[label]` is one of them. `contradictions`
    are the notices, the first of them, of what the log and the rig file say differently: one of the
    two is wrong. `comments` are the lines above its columns.

    >>> log.frame.columns[:3].tolist()
    ['test', 'time_s', 'motor_torque_nm']
    >>> log.trials[0]["motor_torque_nm"].shape == log.trials[0].time.shape
    True
    """

    path: Path
    sha256: str
    trials: tuple[Trial, ...]
    notices: tuple[str, ...] = field(default=())
    rig: Rig | None = None
    contradictions: tuple[str, ...] = ()
    excluded: tuple[Excluded, ...] = ()
    comments: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.trials)

    def __getitem__(self, label: str) -> Trial:
        for trial in self.trials:
            if trial.label == label:
                return trial
        raise KeyError(label)

    @property
    def frame(self) -> pd.DataFrame:
        """All samples as a new DataFrame: `test` (its label), `time_s`, one column per channel."""
        import pandas as pd

        return pd.concat([t.frame.assign(test=t.label) for t in self.trials], ignore_index=True)[
            ["test", "time_s", *self.channels]
        ]

    @property
    def channels(self) -> tuple[str, ...]:
        """The names of all channels of its tests, as in the log format."""
        return tuple(dict.fromkeys(name for t in self.trials for name in t.channels))

    def to_frame(self) -> pd.DataFrame:
        """The samples, as `frame`."""
        return self.frame

    def headline(self) -> str:
        """The file, its number of tests and of samples."""
        rows, tests = sum(map(len, self.trials)), len(self.trials)
        return f"{self.path.name}, {tests} test{'s' * (tests > 1)}, {rows} samples"

    def records(self) -> list[dict[str, Any]]:
        """One record per test: its label, samples, length, period and channels."""
        return [
            {
                "test": t.label,
                "samples": len(t),
                "length_s": float(t.time[-1] - t.time[0]),
                "period_s": t.period,
                "channels": ", ".join(t.channels),
            }
            for t in self.trials
        ]

    def plot(self, axes: Axes | Iterable[Axes] | None = None) -> list[Axes]:
        """Every channel over time, one panel each, the tests overlaid; returns the axes."""
        panels = some_axes(len(self.channels), axes)
        for ax, name in zip(panels, self.channels, strict=True):
            for t in self.trials:
                if name in t:
                    ax.plot(t.time, t[name], linewidth=0.8, label=t.label)
            ax.set_ylabel(name)
        legend(panels[0])
        panels[-1].set_xlabel("time_s")
        return panels


def any_contradiction(trials: Iterable[Trial]) -> bool:
    """Whether the log of one of these trials contradicts its rig file."""
    return any(trial.contradictions for trial in trials)


def with_channels(trial: Trial, **channels: FloatArray) -> Trial:
    """A copy of a trial with channels replaced or added, each (n,)."""
    return replace(trial, channels={**trial.channels, **channels})


__all__ = ["Log", "Trial", "any_contradiction", "with_channels"]
