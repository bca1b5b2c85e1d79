"""A bundle's validation: errors of the open-loop simulation, by log and channel."""

from __future__ import annotations

from pydantic import Field, JsonValue

from sysid.blocks.tables import Table, table
from sysid.parameters.base import Lenient, Number, Part


class ValidatedChannel(Part):
    """RMSE, largest error and noise floor in the channel's unit, fit percentage, and more."""

    rmse: Number
    fit_percent: Number | None
    noise_floor: Number
    max_error: Number | None = None
    rmse_to_noise: Number | None = None
    samples: int | None = None
    horizons: JsonValue = None


class ValidatedLog(Part):
    """One log under one valve model."""

    file: str
    use: str
    valve_model: str
    channels: dict[str, ValidatedChannel]
    sha256: str | None = None
    kind: str | None = None
    tests: JsonValue = None


class Validation(Part):
    """Every validated log; `alarm_rate`: false alarms of the tests for residual structure."""

    logs: Lenient[list[ValidatedLog]] = Field(default_factory=list)
    alarm_rate: Lenient[Number | None] = None

    def validated(self) -> list[ValidatedLog]:
        """The logs; none where they have another form than sysid's."""
        return self.logs if isinstance(self.logs, list) else []

    def table(self) -> Table:
        """One row per log, valve model and channel."""
        rows = [
            (
                log.file,
                log.use,
                log.valve_model,
                name,
                f"{channel.rmse:.4g}",
                "-" if channel.fit_percent is None else f"{channel.fit_percent:.1f}",
                f"{channel.noise_floor:.3g}",
            )
            for log in self.validated()
            for name, channel in log.channels.items()
        ]
        columns = ("log", "use", "valve model", "channel", "RMSE", "fit, %", "sensor noise")
        return table("Open-loop validation", columns, rows)


__all__ = ["ValidatedChannel", "ValidatedLog", "Validation"]
