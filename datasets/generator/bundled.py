"""The small campaign that ships in `datasets/bundled/`, and how to regenerate it bit for bit."""

from __future__ import annotations

from pathlib import Path

from datasets.generator.campaign import (
    SMALL,
    GeneratedCampaign,
    GeneratedLog,
    drawn_effects,
    make_campaign,
)
from datasets.generator.files import Dialect, write_campaign

BUNDLED_SEED = 20
BUNDLED_EFFECT = ("seal-friction", "sum", 1.5)  # id, form, times the usual size
BUNDLED_COMMAND = "python -m datasets.generator --bundled"
BUNDLED_FOLDER = Path(__file__).resolve().parents[1] / "bundled"
LARGEST_CSV_ROWS = 10_000  # longer logs are kept as Parquet, a quarter of the size


def bundled_campaign(stems: tuple[str, ...] | None = None) -> GeneratedCampaign:
    """The bundled campaign in memory, or only the logs named: a random horizontal rotary rig.

    It has an effect that its rig file does not declare.
    """
    effects = drawn_effects(BUNDLED_SEED, [BUNDLED_EFFECT])
    return make_campaign(BUNDLED_SEED, size=SMALL, stems=stems, effects=effects)


def bundled_dialect(log: GeneratedLog) -> Dialect:
    """CSV for the short logs, Parquet for the long ones."""
    return Dialect(parquet=sum(map(len, log.tests)) > LARGEST_CSV_ROWS)


def write_bundled(
    folder: Path = BUNDLED_FOLDER, stems: tuple[str, ...] | None = None
) -> list[Path]:
    """Write the bundled campaign, or the part of it named by `stems`."""
    return write_campaign(folder, bundled_campaign(stems), BUNDLED_COMMAND, bundled_dialect)
