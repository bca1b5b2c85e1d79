"""The results of a validation: errors per channel, test, log and valve model, and their pooling."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.drawing import plot_panels
from sysid.blocks.figures import Line, Panel, Scale, grouped_bars
from sysid.blocks.shown import Shown
from sysid.parameters import Validation
from sysid.types import FloatArray
from sysid.validation import residual_tests
from sysid.validation.residual_tests import CorrelationTest

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

HORIZONS_S = (0.1, 1.0)
"""Horizons in addition to the whole log, s."""


@dataclass(frozen=True)
class HorizonError:
    """Error of simulations over one horizon, each from a fresh start state.

    `rmse` is over all samples of the horizon and all `segments`; None where no segment fits.
    """

    horizon_s: float
    rmse: float | None
    segments: int

    def to_json(self) -> dict[str, Any]:
        return {"horizon_s": self.horizon_s, "rmse": self.rmse, "segments": self.segments}


@dataclass(frozen=True)
class Errors:
    """Sums from which errors are taken, so that tests can be pooled: over counted samples."""

    samples: int
    squares: float
    spread: float
    largest: float

    @classmethod
    def of(cls, measured: FloatArray, residual: FloatArray) -> Errors:
        """Errors of a test's counted samples (n,)."""
        return cls(
            samples=len(residual),
            squares=float(residual @ residual),
            spread=float(np.sum((measured - measured.mean()) ** 2)),
            largest=residual_tests.max_error(residual),
        )

    @classmethod
    def pooled(cls, parts: Sequence[Errors]) -> Errors:
        """Pooled errors of several tests; each one's spread is about its own mean."""
        return cls(
            samples=sum(p.samples for p in parts),
            squares=sum(p.squares for p in parts),
            spread=sum(p.spread for p in parts),
            largest=max(p.largest for p in parts),
        )

    @property
    def rmse(self) -> float:
        """RMSE in the channel's unit."""
        return math.sqrt(self.squares / self.samples)

    @property
    def fit_percentage(self) -> float | None:
        """100 (1 - NRMSE); None for a channel that does not vary."""
        return None if self.spread == 0.0 else 100.0 * (1.0 - math.sqrt(self.squares / self.spread))


@dataclass(frozen=True)
class ChannelResult:
    """One channel of one test (or, pooled, of one log) under one valve model.

    `noise_floor` is one standard deviation of a sample, in the channel's unit; `ratio` the
    RMSE over it. `whiteness` and `inputs` are those of the whole residual of one test (None
    and empty for a pooled log, or where no test applies). `horizons` are 0.1 s and
    1 s; the whole log's error is `errors`.
    """

    errors: Errors
    noise_floor: float
    horizons: tuple[HorizonError, ...]
    whiteness: CorrelationTest | None = None
    inputs: Mapping[str, CorrelationTest] = field(default_factory=dict)

    @property
    def ratio(self) -> float | None:
        """RMSE over the noise floor; None where no noise shows."""
        return self.errors.rmse / self.noise_floor if self.noise_floor > 0.0 else None

    def to_json(self, tests: bool = True) -> dict[str, Any]:
        content: dict[str, Any] = {
            "rmse": self.errors.rmse,
            "max_error": self.errors.largest,
            "fit_percent": self.errors.fit_percentage,
            "noise_floor": self.noise_floor,
            "rmse_to_noise": self.ratio,
            "samples": self.errors.samples,
            "horizons": [h.to_json() for h in self.horizons],
        }
        if tests:
            content["whiteness"] = None if self.whiteness is None else self.whiteness.to_json()
            content["cross_correlation"] = {k: t.to_json() for k, t in self.inputs.items()}
        return content


@dataclass(frozen=True)
class TestResult:
    """One test under one valve model, with the arrays that a report draws.

    `time` (n,) s from the first row; `measured` and `simulated` (n,) by channel, over the
    whole test; only the first `counted` rows enter the errors. `growth` (m,) by channel is
    the RMS error over the segments at each sample since their start. `initial_std` is the
    standard error of the start state: position, velocity, pressures A and B. `log` is the log's
    name, which no other log of the campaign has (`Campaign.name_of`); `file` that of its file.
    """

    # Keeps pytest from collecting this as a test.
    __test__ = False

    log: str
    file: str
    kind: str
    use: str
    test: str
    model: str
    time: FloatArray
    measured: Mapping[str, FloatArray]
    simulated: Mapping[str, FloatArray]
    counted: int
    channels: Mapping[str, ChannelResult]
    growth: Mapping[str, FloatArray]
    initial: FloatArray
    initial_std: FloatArray

    def residual(self, channel: str) -> FloatArray:
        """Measured less simulated, (n,)."""
        return self.measured[channel] - self.simulated[channel]

    @property
    def frame(self) -> pd.DataFrame:
        """`time_s`, and `..._measured` and `..._simulated` of each channel, one row per sample."""
        import pandas as pd

        columns = {"time_s": self.time}
        for name in self.measured:
            columns[f"{name}_measured"] = self.measured[name]
            columns[f"{name}_simulated"] = self.simulated[name]
        return pd.DataFrame(columns)

    def curves(self, channel: str, label: str = "simulated") -> tuple[Line, Line]:
        """A channel as measured and as simulated, SI."""
        return (
            Line(self.time, self.measured[channel], "measured", "measured"),
            Line(self.time, self.simulated[channel], "model", label),
        )

    def plot(self, axes: Axes | Iterable[Axes] | None = None) -> list[Axes]:
        """Each channel as measured and as simulated, one panel each; returns the axes."""
        panels = [Panel(Scale("time_s"), Scale(name), self.curves(name)) for name in self.measured]
        return plot_panels(panels, axes, f"{self.log}, test {self.test}, {self.model} valves")

    def to_json(self) -> dict[str, Any]:
        return {
            "test": self.test,
            "counted_s": float(self.time[self.counted - 1]),
            "initial_state": self.initial.tolist(),
            "initial_state_std": [s if math.isfinite(s) else None for s in self.initial_std],
            "channels": {name: c.to_json() for name, c in self.channels.items()},
        }


@dataclass(frozen=True)
class LogResult:
    """One log under one valve model: its tests, and their errors pooled.

    `name` is one that no other log of the campaign has, `file` that of its file alone.
    """

    name: str
    file: str
    sha256: str
    kind: str
    use: str
    model: str
    channels: Mapping[str, ChannelResult]
    tests: tuple[TestResult, ...]

    def to_json(self) -> dict[str, Any]:
        return {
            "file": self.file,
            "sha256": self.sha256,
            "kind": self.kind,
            "use": self.use,
            "valve_model": self.model,
            "channels": {name: c.to_json(tests=False) for name, c in self.channels.items()},
            "tests": [t.to_json() for t in self.tests],
        }


@dataclass(frozen=True, repr=False)
class ValidationResult(Shown):
    """Every motion log under every valve model that applies, in the campaign's order.

    Fit percentage: 100 (1 - NRMSE), 100 where simulation and measurement agree. The curves
    behind it: `result.logs[0].tests[0].plot()`.
    """

    logs: tuple[LogResult, ...]
    notices: tuple[str, ...]

    def select(self, use: str | None = None, model: str | None = None) -> tuple[LogResult, ...]:
        """The logs of this use and this valve model (None: any)."""
        return tuple(
            log for log in self.logs if use in (None, log.use) and model in (None, log.model)
        )

    @property
    def fit_percent(self) -> pd.DataFrame:
        """Fit percentage: one row per log and valve model, one column per channel."""
        import pandas as pd

        names = [(log.name, log.use, log.model) for log in self.logs]
        frame = pd.DataFrame.from_records(
            [{n: c.errors.fit_percentage for n, c in log.channels.items()} for log in self.logs]
        )
        frame.index = pd.MultiIndex.from_tuples(names, names=["file", "use", "valve_model"])
        return frame

    def headline(self) -> str:
        """The number of tests, logs and valve models."""
        tests = sum(len(log.tests) for log in self.logs)
        return f"open-loop validation: {tests} tests of {len(self.logs)} logs and valve models"

    def records(self) -> list[dict[str, Any]]:
        """One row per log, valve model and channel; errors in the channel's unit."""
        return [
            {
                "file": log.name,
                "use": log.use,
                "valve_model": log.model,
                "channel": name,
                "rmse": channel.errors.rmse,
                "fit_percent": channel.errors.fit_percentage,
                "noise_floor": channel.noise_floor,
                "max_error": channel.errors.largest,
                "samples": channel.errors.samples,
            }
            for log in self.logs
            for name, channel in log.channels.items()
        ]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Fit percentage by channel, one bar per log and valve model; returns the axes."""
        names = list(dict.fromkeys(name for log in self.logs for name in log.channels))
        fits: dict[str, Sequence[float]] = {}
        for log in self.logs:
            found = [log.channels.get(name) for name in names]
            known = [None if c is None else c.errors.fit_percentage for c in found]
            label = f"{log.name}, {log.model}"
            while label in fits:
                label += "'"
            fits[label] = [math.nan if v is None else v for v in known]
        shown, ticks = grouped_bars(names, fits)
        panel = Panel(Scale(ticks=ticks), Scale("fit", "%"), shown, legend="right")
        return plot_panels((panel,), ax)[0]

    def record(self) -> Validation:
        """The bundle's `validation`."""
        logs = [log.to_json() for log in self.logs]
        return Validation.model_validate({"alarm_rate": residual_tests.ALARM_RATE, "logs": logs})


def pooled_channels(tests: Sequence[TestResult]) -> dict[str, ChannelResult]:
    """Each channel over all tests of a log: errors pooled, the median of the noise floors."""
    names = dict.fromkeys(name for t in tests for name in t.channels)
    pooled = {}
    for name in names:
        parts = [t.channels[name] for t in tests if name in t.channels]
        pooled[name] = ChannelResult(
            errors=Errors.pooled([p.errors for p in parts]),
            noise_floor=float(np.median([p.noise_floor for p in parts])),
            horizons=tuple(
                _pooled_horizon([p.horizons[i] for p in parts]) for i in range(len(HORIZONS_S))
            ),
        )
    return pooled


def _pooled_horizon(parts: Sequence[HorizonError]) -> HorizonError:
    known = [p for p in parts if p.rmse is not None]
    segments = sum(p.segments for p in known)
    if not segments:
        return HorizonError(parts[0].horizon_s, None, 0)
    squares = sum(p.segments * p.rmse**2 for p in known if p.rmse is not None)
    return HorizonError(parts[0].horizon_s, math.sqrt(squares / segments), segments)


__all__ = [
    "HORIZONS_S",
    "ChannelResult",
    "Errors",
    "HorizonError",
    "LogResult",
    "TestResult",
    "ValidationResult",
    "pooled_channels",
]
