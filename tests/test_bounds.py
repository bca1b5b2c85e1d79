"""Files that ask for more than they hold are refused at once, in little memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import bombs
import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as parquet
import pytest
from foreign_files import refused
from scipy.io import savemat

from sysid.errors import InputError
from sysid.io.bounds import MOST_CELLS, VARIABLE, most_cells
from sysid.io.conversion import convert
from sysid.io.foreign import hdf5
from sysid.io.tables import read_bytes, read_table

MOST_MB, MOST_S = 500, 10
# One process for all files: its peak is that of the worst of them.
READS_ALL = """
import contextlib, io, json, resource, sys, time
from pathlib import Path
from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io.tables import read_table

def peak():
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmHWM"):  # getrusage counts what the parent had before exec
            return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

kind, *paths = sys.argv[1:]
for path in paths:
    begun, said = time.monotonic(), io.StringIO()
    with contextlib.redirect_stderr(said):
        if kind == "convert":
            words = ["--map", "time_s=time_s:s", "--map", "pressure_a_pa=p:kPa"]
            code = main(["convert", path, "-o", path + ".csv", *words])
        else:
            try:
                code = 0
                read_table(Path(path), ("time_s", "p"))
            except InputError as error:
                code = error.exit_code
                print(error, file=sys.stderr)
    found = {"code": code, "said": said.getvalue(), "s": time.monotonic() - begun, "mb": peak()}
    print(json.dumps(found))
"""


def read_all(kind: str, paths: list[Path], **environment: str) -> list[dict[str, Any]]:
    """How each file was read by `sysid convert`, or as a log."""
    done = subprocess.run(
        [sys.executable, "-c", READS_ALL, kind, *map(str, paths)],
        env={**os.environ, "OMP_NUM_THREADS": "1", **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return [json.loads(line) for line in done.stdout.splitlines()]


def made(folder: Path, makers: dict[str, bombs.Maker], suffix: str) -> list[Path]:
    paths = [folder / f"{name}{suffix}" for name in makers]
    for path, make in zip(paths, makers.values(), strict=True):
        make(path)
    return paths


def expect_refused(kind: str, paths: list[Path], what: str, **environment: str) -> None:
    for path, found in zip(paths, read_all(kind, paths, **environment), strict=True):
        assert found["code"] == 2, (path, found)
        lines = found["said"].splitlines()
        assert len(lines) == 1 and str(path) in lines[0], (path, found)
        assert any(word in lines[0] for word in what.split("|")), (path, found)
        assert found["mb"] < MOST_MB and found["s"] < MOST_S, (path, found)


@pytest.mark.parametrize(
    ("makers", "suffix", "what"),
    [
        (
            bombs.HDF5_BOMBS,
            ".h5",
            "SYSID_MAX_CELLS|than its 800 bytes|100,000 columns",
        ),
        (bombs.OUTSIDE, ".h5", "another file|other files"),
        (bombs.MAT_BOMBS, ".mat", "SYSID_MAX_CELLS|values beyond an array's|100,000 columns"),
        (bombs.TDMS_BOMBS, ".tdms", "SYSID_MAX_CELLS|is damaged or not a TDMS file"),
        (bombs.EXCEL_BOMBS, ".xlsx", "unpacks to more than is read"),
        (bombs.PARQUET_BOMBS, ".parquet", "SYSID_MAX_CELLS|more than 100,000 columns"),
        (
            bombs.TEXT_BOMBS,
            ".csv",
            "SYSID_MAX_CELLS|more than 100,000 columns|the row ends early: 1 of 10000",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) and value.startswith(".") else "",
)
def test_bombs_are_refused(
    tmp_path: Path, makers: dict[str, bombs.Maker], suffix: str, what: str
) -> None:
    expect_refused("convert", made(tmp_path, makers, suffix), what)


def test_a_chunk_for_each_value_takes_no_memory_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Read in parts, along either axis and of records, the values are those written."""
    monkeypatch.setattr(hdf5, "_MOST_CHUNKS", 100)
    values = np.arange(1200.0)
    records = np.zeros(1200, dtype=[("a", "f8"), ("b", "i4")])
    records["a"] = 5.0 * values
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        file.create_dataset("t", data=values, chunks=(1,))
        file.create_dataset("m", data=np.stack([values, 2.0 * values]), chunks=(1, 1))
        file.create_dataset("n", data=np.stack([values, 3.0 * values]).T, chunks=(7, 1))
        file.create_dataset("r", data=records, chunks=(1,), compression="gzip")
    maps = ["time_s=t", "position_m=m#2", "motor_force_n=n#2", "velocity_m_per_s=r.a"]
    convert(tmp_path / "rec.h5", tmp_path / "log.csv", maps=maps)
    log = pd.read_csv(tmp_path / "log.csv", comment="#")
    assert log["time_s"].tolist() == values.tolist()
    assert log["position_m"].tolist() == (2.0 * values).tolist()
    assert log["motor_force_n"].tolist() == (3.0 * values).tolist()
    assert log["velocity_m_per_s"].tolist() == (5.0 * values).tolist()
    # 190 kB of chunks for each of these, in one request 3.8 GB for a million.
    with h5py.File(tmp_path / "large.h5", "w") as file:
        file.create_dataset("p", (300_000,), dtype="f8", chunks=(1,))
    (found,) = read_all("convert", [tmp_path / "large.h5"])
    assert found["mb"] < MOST_MB


def test_logs_are_held_to_the_same_bound(tmp_path: Path) -> None:
    small = {name: bombs.PARQUET_BOMBS[name] for name in ("dictionary", "many-groups")}
    paths = made(tmp_path, small, ".parquet") + made(tmp_path, bombs.TEXT_BOMBS, ".csv")
    expect_refused("log", paths, "SYSID_MAX_CELLS|more than 100,000 columns")


def test_packed_text_is_held_to_the_bound_of_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = pa.table({"time_s": ["x" * 30_000_000], "p": [1.0]})
    parquet.write_table(table, tmp_path / "rec.parquet", compression="zstd")
    monkeypatch.setenv(VARIABLE, "1_000_000")
    what = "unpacks to .* bytes, more than the 25,000,000 that are read"
    refused(tmp_path / "rec.parquet", tmp_path / "x.csv", what, maps=["pressure_a_pa=p:kPa"])
    assert len(read_table(tmp_path / "rec.parquet", ("p",)).frame) == 1


def test_columns_that_are_no_numbers(tmp_path: Path) -> None:
    path = tmp_path / "rec.parquet"
    names = pa.array([b"ab"] * 100, pa.binary(2))
    lists = pa.array([[1.0] * 10] * 100)
    table = {"time_s": np.arange(100.0), "p": np.ones(100), "names": names, "theta_rad": lists}
    parquet.write_table(pa.table(table), path)
    maps = ["time_s=time_s:s", "pressure_a_pa=p:kPa"]
    assert convert(path, tmp_path / "log.csv", maps=maps).rows == 100
    refused(path, tmp_path / "x.csv", "nested", maps=["time_s=time_s", "theta_rad=theta_rad"])
    with pytest.raises(InputError, match=r"theta_rad is nested \(list.*; save it as plain numbers"):
        read_table(path, ("time_s", "theta_rad"))


@pytest.mark.parametrize("name", bombs.HARMLESS)
def test_what_leads_nowhere_is_left_out(tmp_path: Path, name: str) -> None:
    foreign, out = tmp_path / "rec.h5", tmp_path / "log.csv"
    bombs.hdf5_with(foreign, bombs.HARMLESS[name])
    found = convert(foreign, out, maps=["time_s=time_s:s", "pressure_a_pa=time_s:kPa"])
    assert found.rows == 100


def test_an_object_is_read_by_its_first_name(tmp_path: Path) -> None:
    foreign, out = tmp_path / "rec.h5", tmp_path / "log.csv"
    with h5py.File(foreign, "w") as file:
        file["time_s"] = np.arange(100.0)
        file["also"], file["a-link"] = file["time_s"], h5py.SoftLink("/time_s")
    assert convert(foreign, out, maps=["time_s=also:s", "pressure_a_pa=also:kPa"]).rows == 100
    out.unlink()
    for name in ("a-link", "time_s"):
        what = "is not a column: the same object as also"
        refused(foreign, out, what, maps=[f"time_s={name}:s", "pressure_a_pa=also:kPa"])


def test_the_environment_sets_the_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    columns = {"time_s": np.arange(100.0), "a.b": np.ones(100)}
    pd.DataFrame(columns).to_csv(tmp_path / "rec.csv", index=False)
    pd.DataFrame(columns).to_parquet(tmp_path / "rec.parquet")
    savemat(tmp_path / "rec.mat", {"time_s": columns["time_s"], "b": columns["a.b"] * (1 + 1j)})
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        file["time_s"], file["b"] = columns["time_s"], columns["a.b"]
    assert most_cells() == MOST_CELLS
    for suffix in ("csv", "parquet", "mat", "h5"):
        path, out = tmp_path / f"rec.{suffix}", tmp_path / f"{suffix}.csv"
        monkeypatch.setenv(VARIABLE, "150")
        refused(path, out, "cells.*raise SYSID_MAX_CELLS", maps=["pressure_a_pa=time_s:kPa"])
        monkeypatch.setenv(VARIABLE, "1_000")
        assert convert(path, out, maps=["time_s=time_s", "pressure_a_pa=time_s:kPa"]).rows == 100
    monkeypatch.setenv(VARIABLE, "150")
    for suffix in ("csv", "parquet"):
        with pytest.raises(InputError, match="raise SYSID_MAX_CELLS"):
            read_table(tmp_path / f"rec.{suffix}", ("time_s", "a.b"))
    monkeypatch.setenv(VARIABLE, "many")
    refused(tmp_path / "rec.csv", tmp_path / "x.csv", "'many' is not a number of cells")


def test_what_never_ends_is_not_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="/dev/zero: is a device, not a file"):
        read_bytes(Path("/dev/zero"), "a log")
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)

    def fill() -> None:
        with pipe.open("wb") as file, pytest.raises(BrokenPipeError):
            while True:
                file.write(b"1,2\n" * 100_000)

    writer = threading.Thread(target=fill)
    writer.start()
    with pytest.raises(InputError, match=r"pipe: has .* cells"):
        read_bytes(pipe, "a log")
    writer.join()


def test_a_pipe_is_read(tmp_path: Path) -> None:
    pipe, out = tmp_path / "pipe", tmp_path / "log.csv"
    os.mkfifo(pipe)
    rows = "time_s,p\n" + "".join(f"{i / 1000},{i}\n" for i in range(100))
    writer = threading.Thread(target=pipe.write_text, args=(rows,))
    writer.start()
    assert convert(pipe, out, maps=["time_s=time_s", "pressure_a_pa=p:kPa"]).rows == 100
    writer.join()


def test_a_file_that_changes_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time_s,p\n0,1\n")

    def meanwhile(*_: Any) -> None:
        with path.open("a") as file:
            file.write("1,1\n")

    monkeypatch.setattr("sysid.io.tables.check_text", meanwhile)
    with pytest.raises(InputError, match="changed while it was read; wait until it is complete"):
        read_table(path, ("time_s",))
