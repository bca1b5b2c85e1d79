"""Writes logs, rig and campaign files; the dialects that labs write."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from datasets.generator.campaign import GeneratedCampaign, GeneratedLog
from datasets.generator.plant import FloatArray
from datasets.generator.rigs import GeneratedRig, rig_toml
from datasets.generator.runs import GeneratedTest

# Decimals that hold what a channel resolves, by the column's name.
_DECIMALS = {
    "time_s": 4,
    "theta_rad": 7,
    "position_m": 8,
    "pressure_a_pa": 0,
    "pressure_b_pa": 0,
    "supply_pressure_pa": 0,
    "motor_torque_nm": 5,
    "motor_force_n": 5,
    "motor_volts": 7,
    "duty_a": 4,
    "duty_b": 4,
    "valve_a": 0,
    "valve_b": 0,
    "encoder_counts": 0,
    "duty_a_fill": 4,
    "duty_a_bleed": 4,
    "valve_a_fill": 0,
    "valve_a_bleed": 0,
}


@dataclass(frozen=True)
class Dialect:
    """How a lab writes its logs; the defaults are the log format's plain form.

    `counts`: the encoder's counts in place of the position; `volts`: the motor's command in volts;
    `text_labels`: `t1`, `t2` in place of numbers; `comments`: `#` lines on top; `running_time`:
    time goes on from test to test; `supply`: the measured supply as a column; `parquet`: Parquet
    in place of CSV.
    """

    counts: bool = False
    volts: bool = False
    text_labels: bool = False
    comments: bool = False
    running_time: bool = False
    supply: bool = False
    parquet: bool = False

    @property
    def suffix(self) -> str:
        return ".parquet" if self.parquet else ".csv"


PLAIN = Dialect()


def log_columns(test: GeneratedTest, rig: GeneratedRig, dialect: Dialect) -> dict[str, FloatArray]:
    """A test's columns as the dialect names them, rounded to what the file will hold."""
    columns: dict[str, FloatArray] = {}
    for name, values in test.columns.items():
        if name in ("theta_rad", "position_m") and dialect.counts:
            name, values = "encoder_counts", values / rig.position_per_count
        elif name in ("motor_torque_nm", "motor_force_n") and dialect.volts:
            name, values = "motor_volts", values / rig.effort_per_volt
        elif name == "supply_pressure_pa" and not dialect.supply:
            continue
        columns[name] = np.round(values, _DECIMALS[name]) + 0.0
    return columns


def log_frame(
    tests: Sequence[GeneratedTest], rig: GeneratedRig, dialect: Dialect = PLAIN
) -> pd.DataFrame:
    """All tests of a log as one table; a single test has no `test` column."""
    parts, offset = [], 0.0
    for test in tests:
        columns: dict[str, Any] = dict(log_columns(test, rig, dialect))
        if dialect.running_time:
            columns["time_s"] = np.round(columns["time_s"] + offset, _DECIMALS["time_s"])
            offset = columns["time_s"][-1] + 1.0  # s between the end of a test and the next
        frame = pd.DataFrame(columns)
        if len(tests) > 1:
            text = dialect.text_labels
            label: Any = f"t{test.label}" if text and test.label.isdigit() else test.label
            frame.insert(1, "test", int(label) if str(label).isdigit() else label)
        parts.append(frame)
    return pd.concat(parts, ignore_index=True)


def write_log(
    path: Path, tests: Sequence[GeneratedTest], rig: GeneratedRig, dialect: Dialect = PLAIN
) -> None:
    """One log file: CSV, or Parquet if the dialect says so."""
    frame = log_frame(tests, rig, dialect)
    with _whole(path) as partial:
        if dialect.parquet:
            _write_parquet(partial, frame)
        else:
            _write_csv(partial, frame, rig, dialect)


def _write_csv(path: Path, frame: pd.DataFrame, rig: GeneratedRig, dialect: Dialect) -> None:
    lines = ["# generated log", f"# rig: {rig.content['rig']['name']}"] if dialect.comments else []
    lines.append(",".join(frame.columns))
    texts = [_texts(frame[name], name) for name in frame.columns]
    lines += [",".join(row) for row in zip(*texts, strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


@contextlib.contextmanager
def _whole(path: Path) -> Iterator[Path]:
    """A temporary name next to `path`, renamed to it only when everything is written."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """A text file, whole or not at all."""
    with _whole(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def _texts(values: Any, name: str) -> list[str]:
    if name == "test":
        return [str(value) for value in values]
    return [f"{value:.{_DECIMALS[name]}f}" for value in values.to_numpy()]


def _write_parquet(path: Path, frame: pd.DataFrame) -> None:
    """Compact Parquet; whole numbers as integers, the rest as numbers with few distinct values."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    whole = [name for name in frame.columns if _DECIMALS.get(name) == 0]
    table = pa.Table.from_pandas(
        frame.astype(dict.fromkeys(whole, "int32")), preserve_index=False
    ).replace_schema_metadata(None)
    delta = dict.fromkeys(whole, "DELTA_BINARY_PACKED")
    pq.write_table(
        table,
        path,
        compression="zstd",
        compression_level=19,
        use_dictionary=[name for name in frame.columns if name not in whole],
        column_encoding=delta,
    )


def campaign_toml(campaign: GeneratedCampaign, names: dict[str, str], command: str) -> str:
    """The campaign file's text; `names` gives each log's file by its stem."""
    lines = [f"# {command}", 'rig = "rig.toml"', ""]
    for log in campaign.logs:
        lines += ["[[log]]", f'kind = "{log.kind}"', f'file = "{names[log.stem]}"']
        if log.valve is not None:
            lines.append(f'valve = "{log.valve}"')
        lines += [f'use = "{log.use}"', ""]
    return "\n".join(lines)


def write_campaign(
    folder: Path,
    campaign: GeneratedCampaign,
    command: str,
    dialect: Dialect | Callable[[GeneratedLog], Dialect] = PLAIN,
) -> list[Path]:
    """Rig file, logs and campaign file; returns what was written. The truth is not among it.

    `command` is the line that makes them again, kept as a comment. `dialect` may depend on the log.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written, names = [], {}
    for log in campaign.logs:
        own = dialect if isinstance(dialect, Dialect) else dialect(log)
        names[log.stem] = log.stem + own.suffix
        written.append(folder / names[log.stem])
        write_log(written[-1], log.tests, campaign.rig, own)
    for name, text in (
        ("rig.toml", rig_toml(campaign.rig.content)),
        ("campaign.toml", campaign_toml(campaign, names, command)),
    ):
        written.append(folder / name)
        write_text(written[-1], text)
    return written
