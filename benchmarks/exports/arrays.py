"""MATLAB, numpy, JSON, Parquet, HDF5: files of arrays."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import scipy.io

from benchmarks.exports.record import Channel, Record, Sheet, column, style, table


def _doubles(prefix: str = "", separator: str = "") -> tuple[Channel, ...]:
    """Time, a gauge pressure, a position and a force as doubles."""
    lead = f"{prefix}{separator}"
    return (
        column("time_s", f"{lead}t", "s", None),
        column("pressure_a_pa", f"{lead}pA", "bar(g)", None),
        column("position_m", f"{lead}y", "mm", None),
        column("motor_force_n", f"{lead}F", "N", None),
    )


def _arrays(record: Record, separator: str = ".") -> dict[str, np.ndarray]:
    return {c.name.rpartition(separator)[2]: record.doubles(c.target) for c in record.channels}


@style("MATLAB variables", "run.mat", _doubles())
def mat_variables(path: Path, record: Record) -> None:
    scipy.io.savemat(path, {k: v[:, None] for k, v in _arrays(record).items()})


@style("MATLAB struct", "rec.mat", _doubles("rec", "."))
def mat_struct(path: Path, record: Record) -> None:
    scipy.io.savemat(path, {"rec": {k: v[:, None] for k, v in _arrays(record).items()}})


@style(
    "MATLAB Simulink structure with time",
    "out.mat",
    [
        column("time_s", "out.time", "s", None),
        column("pressure_a_pa", "out.signals.values#1", "bar", None),
        column("position_m", "out.signals.values#2", "mm", None),
    ],
)
def mat_with_time(path: Path, record: Record) -> None:
    values = np.column_stack([record.doubles("pressure_a_pa"), record.doubles("position_m")])
    signals = {"values": values, "dimensions": 2.0, "label": "cylinder"}
    out = {"time": record.doubles("time_s")[:, None], "signals": signals, "blockName": "m/Scope"}
    scipy.io.savemat(path, {"out": out})


@style(
    "MATLAB matrix",
    "data.mat",
    [
        column("time_s", "data#1", "s", None),
        column("pressure_a_pa", "data#2", "bar", None),
        column("theta_rad", "data#3", "deg", None),
    ],
)
def mat_matrix(path: Path, record: Record) -> None:
    """To File: signals in rows, the time first."""
    scipy.io.savemat(path, {"data": np.vstack([record.doubles(c.target) for c in record.channels])})


@style("MATLAB 7.3", "run73.mat", _doubles("rec", "."))
def mat_hdf5(path: Path, record: Record) -> None:
    """As MATLAB lays it out: user block, transposed arrays, classes as attributes."""
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("rec")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        for name, values in _arrays(record).items():
            data = group.create_dataset(name, data=values[None, :])
            data.attrs["MATLAB_class"] = np.bytes_("double")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(508) + b"\x00\x02IM"
    with path.open("r+b") as raw:
        raw.write(head)


@style(
    "MATLAB writetable",
    "T.csv",
    [
        column("time_s", "Time", "s", 3),
        column("pressure_a_pa", "PressureA", "bar", 10),
        column("position_m", "Position_mm_", "mm", 11),
    ],
)
def writetable(path: Path, record: Record) -> Sheet:
    """The shortest of 15 digits: zeros at the end are not written."""
    sheet = table(record)
    for row in sheet.body:
        row[:] = [c.rstrip("0").rstrip(".") if "." in c else c for c in row]
    return sheet


@style(
    "MATLAB writematrix",
    "M.txt",
    [
        column("time_s", "#1", "s", 3),
        column("pressure_a_pa", "#2", "bar", 10),
        column("motor_force_n", "#3", "N", 10),
    ],
    "--no-header",
)
def writematrix(path: Path, record: Record) -> Sheet:
    sheet = table(record, names_row=None)
    sheet.heads = []
    return sheet


@style(
    "Simulink Data Inspector CSV",
    "sdi.csv",
    [
        column("time_s", "time", "s", 6),
        column("position_m", "position", "mm", 9),
        column("duty_a", "duty", "", 9, every=5),
    ],
)
def data_inspector(path: Path, record: Record) -> Sheet:
    """Names, then rows of `Unit:` and `Interp:`; a slower signal's cells are empty."""
    sheet = table(record, units_row=1)
    sheet.heads += [["", "Unit: mm", "Unit: 1"], ["", "Interp: linear", "Interp: zoh"]]
    return sheet


@style("numpy .npz", "run.npz", _doubles())
def npz(path: Path, record: Record) -> None:
    np.savez(path, **_arrays(record))


@style("numpy structured .npy", "run.npy", _doubles())
def npy(path: Path, record: Record) -> None:
    arrays = _arrays(record)
    found = np.zeros(record.truth.rows, [(name, "f8") for name in arrays])
    for name, values in arrays.items():
        found[name] = values
    np.save(path, found)


def _fixed() -> tuple[Channel, ...]:
    return (
        column("time_s", "t", "s", 3),
        column("pressure_a_pa", "p_a", "kPa", 6),
        column("position_m", "y", "mm", 7),
        column("valve_a", "valve", "", 0),
    )


def _json_columns(record: Record) -> dict[str, list[float]]:
    return {c.name: [float(v) for v in record.readings(c.target)] for c in record.channels}


@style("JSON object of arrays", "run.json", _fixed())
def json_arrays(path: Path, record: Record) -> None:
    path.write_text(json.dumps(_json_columns(record)))


@style("JSON lines", "run.jsonl", _fixed())
def json_lines(path: Path, record: Record) -> None:
    columns = _json_columns(record)
    lines = [
        json.dumps(dict(zip(columns, row, strict=True)))
        for row in zip(*columns.values(), strict=True)
    ]
    path.write_text("\n".join(lines) + "\n")


@style(
    "Parquet of pandas, DatetimeIndex",
    "run.parquet",
    [
        column("time_s", "time", "", 6, worth="s"),
        column("pressure_a_pa", "p_a", "bar", None),
        column("position_m", "y", "mm", None),
    ],
)
def parquet(path: Path, record: Record) -> None:
    stamps = pd.Timestamp("2024-05-14T13:29:30", tz="Europe/Berlin") + pd.to_timedelta(
        record.doubles("time_s"), unit="s"
    ).round("us")
    frame = pd.DataFrame(
        {"p_a": record.doubles("pressure_a_pa"), "y": record.doubles("position_m")},
        index=pd.DatetimeIndex(stamps, name="time"),
    )
    frame.to_parquet(path)


@style("HDF5 of h5py", "run.h5", _doubles("run1", "."))
def hdf5(path: Path, record: Record) -> None:
    with h5py.File(path, "w") as file:
        for name, values in _arrays(record).items():
            file.create_dataset(f"run1/{name}", data=values, compression="gzip")


@style(
    "HDF5 compound table",
    "table.h5",
    [
        column("time_s", "log.t", "s", None),
        column("pressure_a_pa", "log.pA", "bar(g)", None),
        column("motor_force_n", "log.F", "N", None),
    ],
)
def hdf5_table(path: Path, record: Record) -> None:
    """A data set of records, as pandas and PyTables keep a table."""
    names = [c.name.removeprefix("log.") for c in record.channels]
    found = np.zeros(record.truth.rows, [(name, "f8") for name in names])
    for name, channel in zip(names, record.channels, strict=True):
        found[name] = record.doubles(channel.target)
    with h5py.File(path, "w") as file:
        file.create_dataset("log", data=found)
