"""A bundle's validation: errors of the open-loop simulation, by log and channel."""

from __future__ import annotations

from pydantic import Field, JsonValue

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


__all__ = ["ValidatedChannel", "ValidatedLog", "Validation"]
