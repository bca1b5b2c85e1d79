"""The rig and the date of a campaign, and where each was read.

A campaign file has no key for either. The rig is the rig file's `name`; the date, in this order:
an ISO date (2024-03-17, 20240317) in the name of the campaign file or of a folder above it (the
nearest), in the campaign's `name`, and at last the day on which the newest log was changed, which
copying a folder may change too. Each row of a fleet says which of them it was.
"""

from __future__ import annotations

import datetime
import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.io.campaign import Campaign

# Searched from every position: in rig-0042-2024-03-17 a number before the date resembles its year.
_DATE = re.compile(r"(?<!\d)(?=(\d{4})-?(\d{2})-?(\d{2})(?!\d))")
# An eight-digit number that is a serial number is not taken for a date of another century.
_YEARS = range(1970, 2100)


@dataclass(frozen=True)
class Origin:
    """The rig and the date of a campaign; `rig_from`, `date_from`: where they were read."""

    rig: str
    date: datetime.date
    rig_from: str
    date_from: str

    def to_json(self) -> dict[str, Any]:
        """In JSON types."""
        return {
            "rig": self.rig,
            "date": self.date.isoformat(),
            "rig_from": self.rig_from,
            "date_from": self.date_from,
        }


def origin_of(campaign: Campaign) -> Origin:
    """Where a campaign belongs in a fleet."""
    for text, place in _names(campaign):
        date = date_in(text)
        if date is not None:
            return Origin(campaign.rig.name, date, "rig file", place)
    newest = max(entry.path.stat().st_mtime for entry in campaign.logs)
    date = datetime.datetime.fromtimestamp(newest, datetime.UTC).date()
    return Origin(campaign.rig.name, date, "rig file", "day of the newest log's last change")


def _names(campaign: Campaign) -> Iterator[tuple[str, str]]:
    path = campaign.path.resolve()
    yield path.stem, "name of the campaign file"
    for folder in list(path.parents)[:4]:
        yield folder.name, f"name of the folder {folder.name}"
    yield campaign.name, "the campaign's name"


def date_in(text: str) -> datetime.date | None:
    """The last ISO date in a text; None without one."""
    for year, month, day in reversed(_DATE.findall(text)):
        try:
            date = datetime.date(int(year), int(month), int(day))
        except ValueError:
            continue
        if date.year in _YEARS:
            return date
    return None


def result_folder(path: Path) -> str:
    """The name of a campaign's folder in a fleet's: readable, and its own by its whole path."""
    whole = path.resolve()
    last = [*whole.parts[-3:-1], *([] if whole.stem == "campaign" else [whole.stem])]
    slug = re.sub(r"[^\w.-]+", "-", "-".join(last)).strip("-.")[:80]
    return f"{slug}-{hashlib.sha256(str(whole).encode()).hexdigest()[:6]}"


__all__ = ["Origin", "date_in", "origin_of", "result_folder"]
