"""The samples that the tests of `sysid convert` write in every format, and read back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import pandas as pd
import pytest

from sysid.errors import InputError
from sysid.io.conversion import convert
from sysid.io.tables import read_table

SAMPLES = 50
TIME = np.arange(SAMPLES) / 1000.0
PRESSURE_KPA = 200.0 + 50.0 * np.sin(2 * np.pi * 7.0 * TIME)  # gauge
ANGLE_DEG = 30.0 * np.cos(2 * np.pi * 3.0 * TIME)
ATMOSPHERE = 101325.0


def log_of(path: Path) -> pd.DataFrame:
    """A converted log as the log reader's own table reader sees it."""
    header = read_table(path, ()).header
    return read_table(path, header, ("test",)).frame


def expect_samples(path: Path) -> None:
    """The log holds TIME, PRESSURE_KPA and ANGLE_DEG in SI."""
    frame = log_of(path)
    assert list(frame.columns) == ["time_s", "pressure_a_pa", "theta_rad"]
    np.testing.assert_allclose(frame["time_s"], TIME, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(
        frame["pressure_a_pa"], PRESSURE_KPA * 1000.0 + ATMOSPHERE, rtol=1e-13
    )
    np.testing.assert_allclose(frame["theta_rad"], np.deg2rad(ANGLE_DEG), rtol=1e-13, atol=1e-15)


def maps(time: str, pressure: str, angle: str) -> list[str]:
    return [
        f"time_s={time}",
        f"pressure_a_pa={pressure}:kPa(g)",
        f"theta_rad={angle}:deg",
    ]


def plain(tmp_path: Path, **columns: Any) -> Path:
    path = tmp_path / "rec.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def text_of(delimiter: str, decimal: str, header: str | None, ending: str = "\n") -> str:
    lines = [] if header is None else header.split("\n")
    for row in zip(TIME * 1000.0, PRESSURE_KPA, ANGLE_DEG, strict=True):
        lines.append(delimiter.join(repr(float(v)).replace(".", decimal) for v in row))
    return ending.join(lines) + ending


def write_mat73(path: Path) -> None:
    """A MATLAB 7.3 file as MATLAB lays it out: user block, transposed arrays, references."""
    with h5py.File(path, "w", userblock_size=512) as file:
        store = file.create_group("#refs#")
        store["a"] = ANGLE_DEG[None, :]
        store["b"] = TIME[None, :]
        store["c"], store["d"] = ANGLE_DEG[None, :], TIME[None, :]
        for key in store:
            store[key].attrs["MATLAB_class"] = np.bytes_("double")
        rec = file.create_group("rec")
        rec.attrs["MATLAB_class"] = np.bytes_("struct")
        rec["P"] = np.vstack([TIME, PRESSURE_KPA])  # MATLAB's (n, 2)
        cells = rec.create_dataset("cells", (2, 1), dtype=h5py.ref_dtype)
        cells[0, 0], cells[1, 0] = store["a"].ref, store["b"].ref
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
        data = file.create_group("Y").create_dataset("Data", (1, 2), dtype=h5py.ref_dtype)
        data[0, 0], data[0, 1] = store["c"].ref, store["d"].ref
        name = file.create_dataset("name", data=np.array([[65], [66]], dtype=np.uint16))
        name.attrs["MATLAB_class"] = np.bytes_("char")
        void = file.create_dataset("void", data=np.array([0, 0], dtype=np.uint64))
        void.attrs["MATLAB_class"], void.attrs["MATLAB_empty"] = np.bytes_("double"), 1
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(508) + b"\x00\x02IM"
    with path.open("r+b") as raw:
        raw.write(header)


def write_tdms(path: Path, periods: tuple[float, float], with_time: bool = False) -> None:
    channels = []
    for name, values, period in (
        ("P", PRESSURE_KPA, periods[0]),
        ("angle", ANGLE_DEG, periods[1]),
    ):
        properties = {"wf_increment": period, "wf_start_offset": 0.0} if period else {}
        channels.append(nptdms.ChannelObject("run", name, values, properties=properties))
    if with_time:
        channels.append(nptdms.ChannelObject("run", "t", TIME))
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(channels)


def refused(foreign: Path, output: Path, what: str, **arguments: Any) -> None:
    """One line that says `what` and a fix, and nothing written."""
    with pytest.raises(InputError, match=what) as caught:
        convert(foreign, output, **arguments)
    assert "\n" not in str(caught.value)
    assert "; " in str(caught.value)
    assert not output.exists()
