"""How well each law of a bundle follows its tests, as the fit judged it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from sysid.estimation.quality import WITH_LACK_OF_FIT, FitQuality
from sysid.parameters.base import Absent, Lenient, Number, Part, Unread


class LackOfFitRecord(Part):
    """Whether the residual is more than scatter: `repeats`, `scatter`, `runs` or `none`."""

    method: str
    statistic: Absent[Number] = None
    p_value: Absent[Number] = None


class QualityRecord(Part):
    """`sysid.estimation.quality.FitQuality` in a file.

    `rmse` and `scatter` (the measurement's own) in `unit`, `rmse_share` is RMSE over the
    signal's spread; `verdict` begins with "good", "usable", "poor" or "impossible"; `left_out` says
    what was given and not used.
    """

    signal: str
    unit: str
    samples: int
    left_out: Absent[list[str]] = None
    rmse: Number | None
    rmse_share: Number | None
    r2: Number | None
    scatter: Absent[Number | None] = None
    lack_of_fit: LackOfFitRecord
    verdict: str

    @staticmethod
    def of(found: FitQuality) -> QualityRecord:
        """A fit's own judgement."""
        return QualityRecord.model_validate(found.to_json())

    @property
    def is_doubtful(self) -> bool:
        """Whether the verdict is "poor" or "impossible"."""
        return self.verdict.startswith(("poor", "impossible"))

    @property
    def misses_little(self) -> bool:
        """Whether the law is good, or what it misses is significant alone, which a diagnosis
        explains."""
        return self.verdict in ("good", WITH_LACK_OF_FIT)


QualityByName = Lenient[dict[str, QualityRecord] | None]
Quality = Lenient[QualityRecord | None]


def records_of(found: Mapping[str, FitQuality]) -> dict[str, QualityRecord]:
    """The records of several judgements."""
    return {name: QualityRecord.of(quality) for name, quality in found.items()}


def quality_field(found: FitQuality | None, name: str = "") -> dict[str, Any]:
    """The field of a part that holds a judgement, under `name` where it holds several; {}: none."""
    if found is None:
        return {}
    record = QualityRecord.of(found)
    return {"quality": {name: record} if name else record}


def qualities_in(part: Part | None, path: str = "") -> Iterator[tuple[str, QualityRecord]]:
    """Every judgement in a part of a bundle and below it, by its place, in the file's order.

    A part's own `quality` comes under its place alone, or with the key that it has there.
    """
    for key in () if part is None else part.given():
        value = getattr(part, key, None)
        place = path if key == "quality" else ".".join(filter(None, (path, key)))
        yield from _found(value, place)


def _found(value: Any, place: str) -> Iterator[tuple[str, QualityRecord]]:
    if isinstance(value, Unread):
        return
    if isinstance(value, QualityRecord):
        yield place, value
    elif isinstance(value, Part):
        yield from qualities_in(value, place)
    elif isinstance(value, dict):
        for name, one in value.items():
            if isinstance(one, QualityRecord):
                yield f"{place}, {name}", one


__all__ = [
    "LackOfFitRecord",
    "Quality",
    "QualityByName",
    "QualityRecord",
    "qualities_in",
    "quality_field",
    "records_of",
]
