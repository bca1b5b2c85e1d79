"""Mutated inputs: every command ends with exit 0, 2 or 3, soon, with whole and finite results.

    python benchmarks/fuzz.py [--count 10000] [--seed 0] [--jobs 2] [--case N]

Our own corpus (short logs of the bundled campaign in every format that is read, its rig and
campaign files, the bundles of `tests/golden`) is changed at random: bytes, cells, rows, columns,
headers, keys and values of TOML and JSON. Each case calls one command through its own `main` and
counts as a failure: another exit status, more than one line of error, a traceback, more than
60 s of processor time (600 s on the clock), a result file that is not whole, a number that is not
finite, a temporary file left.
`--case N` runs one case of the seed alone and shows what it printed.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import functools
import importlib.metadata
import io
import json
import math
import multiprocessing
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parent.parent
BUNDLED = ROOT / "datasets" / "bundled"
BUNDLES = ROOT / "tests" / "golden" / "bundles"
LIMIT_S = 60
ALLOWED = (0, 2, 3)
_NUMBERS = (
    *("NaN", "nan", "inf", "-inf", "1e300", "-1e300", "1e-300", "1e999", "0", "-1", "1e12", ""),
    *("1" + 30 * "0", "9223372036854775808", "0x10", "1,5", "1_000", "abc", "=1+1", "\x1b[31mred"),
    *("#N/A", "1e", "--", "٣", "\u202e12", "9" * 5000, "'", '"', "True", "1.2.3", "12:00:01"),
)
_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1e300, -1e300, 1e-300, 10**30, 10**400, 0.0, -0.0, 1e12, 1.5),
    *("NaN", "inf", "", "abc", "\x1b[31mred\x07", "x" * 3000, [], {}, [1, 2], [[]], {"value": 1}),
    *({"value": "NaN"}, {"value": None}, {"value": 1.0}, math.nan, math.inf, "\u202e", [None]),
)


@dataclass(frozen=True)
class Case:
    """One call: files to write into an empty folder, and the command's words."""

    name: str
    files: dict[str, bytes]
    words: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """What a call did; `faults` is empty for one that behaved."""

    number: int
    name: str
    code: int | None
    seconds: float
    faults: tuple[str, ...]
    said: str


# The corpus.


def _short(name: str, tests: int, rows: int) -> pd.DataFrame:
    frame = pd.read_parquet(BUNDLED / f"{name}.parquet")
    labels = list(dict.fromkeys(frame["test"]))
    chosen = labels[:: max(1, len(labels) // tests)][:tests]
    parts = [frame[frame["test"] == label].head(rows) for label in chosen]
    return pd.concat(parts, ignore_index=True)


def _csv(frame: pd.DataFrame) -> bytes:
    return frame.to_csv(index=False, float_format="%.7g").encode()


@dataclass(frozen=True)
class Corpus:
    """Sound inputs: logs by kind, rig, campaign and bundles."""

    logs: dict[str, pd.DataFrame]
    rig: bytes
    bundles: dict[str, bytes]

    @classmethod
    def read(cls) -> Corpus:
        """The bundled campaign's logs, shortened, and the bundles of the golden files."""
        logs = {
            "friction-static": _short("friction_static", 4, 4000),
            "friction-sliding": _short("friction_sliding", 4, 3000),
            "friction-motion": _short("friction_motion", 1, 3000),
            "valve-discrete": _short("valve_discrete_a", 1, 6000),
            "valve-pwm": _short("valve_pwm_a", 16, 1500),
            "motion-pwm": _short("motion_pwm_2", 1, 1500),
            "motion-motor": _short("motion_motor", 1, 1500),
        }
        bundles = {path.stem: path.read_bytes() for path in sorted(BUNDLES.glob("*.json"))}
        return cls(logs, (BUNDLED / "rig.toml").read_bytes(), bundles)


# Mutations of bytes, tables, TOML and JSON.


def mutate_bytes(draw: random.Random, data: bytes) -> bytes:
    """A few bits, bytes, cuts, repeats or insertions."""
    changed = bytearray(data)
    for _ in range(draw.choice((1, 1, 1, 2, 4, 16))):
        if not changed:
            break
        place, length = draw.randrange(len(changed)), draw.choice((1, 2, 7, 40, 400))
        match draw.randrange(7):
            case 0:
                changed[place] ^= 1 << draw.randrange(8)
            case 1:
                changed[place] = draw.choice(b"\x00\xff\n\r,;\"'\\ \t#0-e.[]{}")
            case 2:
                del changed[place : place + length]
            case 3:
                changed[place:place] = changed[place : place + length]
            case 4:
                changed[place:place] = draw.randbytes(length)
            case 5:
                del changed[place:]
            case _:
                other = draw.randrange(len(changed))
                changed[place : place + length] = changed[other : other + length]
    return bytes(changed)


def mutate_csv(draw: random.Random, frame: pd.DataFrame) -> bytes:
    """Cells, rows, columns, headers, delimiters of the table's text."""
    lines = _csv(frame).decode().split("\n")
    rows = [line.split(",") for line in lines if line] or [[""]]
    for _ in range(draw.choice((1, 1, 2, 3))):
        _change_rows(draw, rows)
    separator = "," if draw.random() < 0.9 else draw.choice((";", "\t", " ", "|"))
    ending = draw.choice(("\n", "\n", "\n", "\r\n", "\r"))
    text = ending.join(separator.join(row) for row in rows) + draw.choice(("", ending))
    if draw.random() < 0.1:
        text = draw.choice(("# note\n", "%\n\n", "\ufeff", "\n", "sep=,\n", '"')) + text
    encoding = "utf-8" if draw.random() < 0.9 else draw.choice(("utf-16", "cp1252"))
    return text.encode(encoding, "replace")


def mutate_values(draw: random.Random, frame: pd.DataFrame) -> pd.DataFrame:
    """Well-formed numbers that are wrong: what a reader accepts and a fit has to judge."""
    changed = frame.copy()
    rng = np.random.default_rng(draw.randrange(1 << 30))
    for _ in range(draw.choice((1, 1, 2, 3))):
        name = draw.choice([n for n in changed.columns if n != "test"])
        values = changed[name].to_numpy(float).copy()
        if not len(values):
            return frame.head(2)
        match draw.randrange(13):
            case 0:
                values = values * draw.choice((-1.0, 0.5, 2.0, 10.0, 0.1, 1e3, 1e-3, 1e-6, 1e-12))
            case 1:
                values = values + draw.choice((0.1, -0.1, 1.0, 1e5, -1e5)) * draw.random()
            case 2:
                values = np.full_like(values, draw.choice((0.0, 1.0, values[0], 1e5)))
            case 3:
                values = values + draw.choice((1e-6, 0.01, 1.0, 1e3)) * rng.standard_normal(
                    len(values)
                )
            case 4:
                values = np.roll(values, draw.choice((1, 10, 1000)))
            case 5:
                values = values[::-1].copy()
            case 6:
                values = np.cumsum(np.abs(rng.standard_normal(len(values)))) * 0.001
            case 7:
                step = draw.choice((1e-9, 1e-3, 0.1, 10.0, 1e5))
                values = np.round(values / step) * step
            case 8:
                values[draw.randrange(len(values))] = draw.choice((0.0, 1e6, -1e6, 1e11, 1e-300))
            case 9:
                other = draw.choice([n for n in changed.columns if n != "test"])
                values = changed[other].to_numpy(float)
            case 10:
                changed = changed[rng.random(len(changed)) < draw.choice((0.1, 0.5, 0.95))]
                changed = changed if len(changed) > 2 else frame.head(3)
                continue
            case 11:
                first = draw.randrange(len(changed))
                changed = changed.iloc[first : first + draw.choice((2, 3, 20, 200, 2000))]
                continue
            case _:
                values = np.interp(
                    rng.random(len(values)), (0, 1), (np.min(values), np.max(values))
                )
        changed[name] = values
    return changed


def _change_rows(draw: random.Random, rows: list[list[str]]) -> None:
    width = max(1, *map(len, rows))
    row, column = draw.randrange(len(rows)), draw.randrange(width)
    whole = range(1, len(rows))
    match draw.randrange(12):
        case 0 | 1:
            if column < len(rows[row]):
                rows[row][column] = draw.choice(_NUMBERS)
        case 2:
            value = draw.choice(_NUMBERS)
            for i in whole:
                rows[i][column:][:1] and rows[i].__setitem__(column, value)
        case 3:
            factor = draw.choice((1e300, 1e-300, 0.0, -1.0, 1e3, 1e9, 1e-9, math.nan))
            for i in whole:
                with contextlib.suppress(ValueError, IndexError):
                    rows[i][column] = repr(float(rows[i][column]) * factor)
        case 4:
            del rows[row : row + draw.choice((1, 1, 10, 100_000))]
            if not rows:
                rows.append([""])
        case 5:
            rows[row:row] = [list(r) for r in rows[row : row + draw.choice((1, 1, 20))]]
        case 6:
            for each in rows:
                del each[column : column + 1]
        case 7:
            for each in rows:
                each.insert(column, each[column] if column < len(each) else "")
        case 8:
            if column < len(rows[0]):
                names = (
                    "",
                    "time_s",
                    "theta_rad",
                    "position_m",
                    "test",
                    "x" * 500,
                    "\x1b[2J",
                    "#1",
                )
                rows[0][column] = draw.choice(names)
        case 9:
            draw.shuffle(rows[row])
        case 10:
            rows[1:] = rows[1:][:: draw.choice((-1, 2, 7, 500))]
        case _:
            del rows[row][column:]


def mutate_frame(draw: random.Random, frame: pd.DataFrame) -> pd.DataFrame:
    """Types, values, rows and columns of a table for the binary formats."""
    changed = frame.copy()
    name = draw.choice(list(changed.columns))
    match draw.randrange(9):
        case 0:
            changed[name] = changed[name].astype(str)
        case 1:
            changed[name] = changed[name].astype(object)
            changed.loc[draw.randrange(len(changed)), name] = draw.choice((None, "x", 10**12, True))
            changed[name] = changed[name].map(str)
        case 2:
            changed[name] = pd.to_datetime(changed.index, unit="ms")
        case 3:
            changed = changed.drop(columns=name)
        case 4:
            changed = changed.head(draw.choice((0, 1, 2, 5, 60)))
        case 5:
            changed[name] = draw.choice((0.0, 1e300, -1e300, 1e-300, math.nan, math.inf, 5))
        case 6:
            changed = changed.rename(columns={name: draw.choice(("", "time_s", "\x1b[2J", "t"))})
            changed = changed.loc[:, ~changed.columns.duplicated()]
        case 7:
            changed.loc[draw.randrange(len(changed)), name] = math.nan
        case _:
            changed[name] = pd.timedelta_range(0, periods=len(changed), freq="ms")
    return changed


def binary(draw: random.Random, frame: pd.DataFrame, kind: str) -> bytes:
    """The table as a file of the format `kind`; a table that it cannot hold as CSV."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"log.{kind}"
        try:
            _write(path, frame, kind)
        except Exception:  # not every mutated table fits every format
            return _csv(frame)
        return path.read_bytes()


def _write(path: Path, frame: pd.DataFrame, kind: str) -> None:
    if kind == "parquet":
        frame.to_parquet(path)
    elif kind == "xlsx":
        frame.head(300).to_excel(path, index=False)
    elif kind == "mat":
        from scipy.io import savemat

        savemat(path, {name or "_": frame[name].to_numpy() for name in frame.columns})
    elif kind == "h5":
        import h5py

        with h5py.File(path, "w") as file:
            for name in frame.columns:
                file[name or "_"] = frame[name].to_numpy()
    else:
        import nptdms

        with nptdms.TdmsWriter(path) as writer:
            writer.write_segment(
                [nptdms.ChannelObject("log", n, frame[n].to_numpy()) for n in frame.columns]
            )


def mutate_toml(draw: random.Random, data: bytes) -> bytes:
    """Keys, values, sections and lines of a TOML file."""
    if draw.random() < 0.15:
        return mutate_bytes(draw, data)
    lines = data.decode().split("\n")
    for _ in range(draw.choice((1, 1, 2, 3))):
        place = draw.randrange(len(lines))
        key, equals, _ = lines[place].partition("=")
        values = (*map(repr, (1e300, 0.0, -1.0, 1e-300, True, 10**30, [], "x", 1)), "{}", "nan")
        match draw.randrange(9):
            case 6 | 7 | 8:
                with contextlib.suppress(ValueError):
                    scaled = float(lines[place].partition("=")[2]) * draw.choice(
                        (0.3, 0.9, 2.0, 10.0)
                    )
                    lines[place] = f"{key}= {scaled!r}"
            case 0 | 1:
                long = draw.choice(
                    ("inf", "[" * 2000, "9" * 5000, '"\\u001b[31m"', "1979-05-27", "")
                )
                value = draw.choice((*(v.replace("True", "true") for v in values), long))
                lines[place] = f"{key}= {value}" if equals else lines[place]
            case 2:
                lines[place] = ""
            case 3:
                lines.insert(place, lines[draw.randrange(len(lines))])
            case 4:
                lines[place] = lines[place][1:]
            case _:
                lines[place] = draw.choice(("[x]", "[rig]", "= 1", "\x00", "[[log]]", 'a."b" = 1'))
    return "\n".join(lines).encode("utf-8", "replace")


def mutate_json(draw: random.Random, data: bytes) -> bytes:
    """Keys and values of a JSON bundle."""
    if draw.random() < 0.15:
        return mutate_bytes(draw, data)
    content = json.loads(data)
    for _ in range(draw.choice((1, 1, 1, 2, 3))):
        _change_json(draw, content)
    if draw.random() < 0.9:
        content["schema"] = "sysid-bundle/1"
    return json.dumps(content).encode("utf-8", "replace")


def _change_json(draw: random.Random, content: Any) -> None:
    node = content
    while True:
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        if not keys:
            return
        key = draw.choice(keys)
        deeper = isinstance(node[key], dict | list) and node[key] and draw.random() < 0.85
        if not deeper:
            break
        node = node[key]
    if isinstance(node[key], float) and draw.random() < 0.5:
        node[key] *= draw.choice((-1, 0, 2, 1e3, 1e-3, 1e30, 1e-30, 1e150))
        return
    match draw.randrange(6):
        case 0:
            del node[key]
        case 2 if isinstance(node, dict):
            node[draw.choice(("", "value", "\x1b", "x"))] = node.pop(key)
        case 3 if isinstance(node[key], list) and node[key]:
            node[key] = node[key][: draw.randrange(len(node[key]))] or node[key] * 3
        case _:
            node[key] = draw.choice(_VALUES)


# Cases.


def case(corpus: Corpus, seed: int, number: int) -> Case:
    """Case `number` of a seed: always the same."""
    draw = random.Random(f"{seed}/{number}")
    make = draw.choices(list(_MAKERS), weights=list(_MAKERS.values()))[0]
    return make(draw, corpus)


_FITS = {
    "friction-static": ("fit", "friction"),
    "friction-sliding": ("fit", "friction"),
    "friction-motion": ("fit", "friction"),
    "valve-discrete": ("fit", "valve-discrete"),
    "valve-pwm": ("fit", "valve-pwm", "--surface", "bipolynomial"),
}


def _log(draw: random.Random, frame: pd.DataFrame) -> tuple[str, bytes]:
    """A log's name and its mutated bytes, CSV or Parquet."""
    kind = draw.randrange(10)
    if kind > 4:
        frame = mutate_values(draw, frame)
        return "log.csv", mutate_csv(draw, frame) if kind > 8 else _csv(frame)
    if kind == 0:
        return "log.parquet", mutate_bytes(draw, binary(draw, frame, "parquet"))
    if kind == 1:
        return "log.parquet", binary(draw, mutate_frame(draw, frame), "parquet")
    if kind == 2:
        return "log.csv", mutate_bytes(draw, _csv(frame))
    return "log.csv", mutate_csv(draw, frame)


def _check(draw: random.Random, corpus: Corpus) -> Case:
    kind = draw.choice(list(corpus.logs))
    name, data = _log(draw, corpus.logs[kind])
    more = ("--json",) if draw.random() < 0.5 else ()
    return Case(f"check {kind}", {name: data, "rig.toml": corpus.rig}, ("check", name, *more))


def _fit(draw: random.Random, corpus: Corpus) -> Case:
    kind = draw.choice(list(_FITS))
    frame, rig, name, data = corpus.logs[kind], corpus.rig, "log.csv", b""
    if draw.random() < 0.3:
        data, rig = _csv(frame), mutate_toml(draw, rig)
    else:
        name, data = _log(draw, frame)
    words = (*_FITS[kind], name, "-o", "bundle.json", "--json")
    return Case(f"fit {kind}", {name: data, "rig.toml": rig}, words)


_FOREIGN = ("csv", "csv", "parquet", "xlsx", "mat", "h5", "tdms")


def _convert(draw: random.Random, corpus: Corpus) -> Case:
    frame = corpus.logs[draw.choice(list(corpus.logs))].head(300)
    kind = draw.choice(_FOREIGN)
    if kind == "csv":
        data = draw.choice((mutate_csv, lambda d, f: mutate_bytes(d, _csv(f))))(draw, frame)
    elif draw.random() < 0.5:
        data = mutate_bytes(draw, binary(draw, frame, kind))
    else:
        data = binary(draw, mutate_frame(draw, frame), kind)
    column = draw.choice(list(frame.columns))
    maps = (
        *("time_s=time_s:ms", "time_s=#1:s", "theta_rad=#3:deg", f"theta_rad={column}:turn"),
        *("pressure_a_pa=#4:bar(g)", "temperature_k=#2:degC", "test=#2", "time_s=#1:1e300 s"),
        *(f"{draw.choice(_NUMBERS)}={column}", f"theta_rad={draw.choice(_NUMBERS)}", "#9=#9:m"),
    )
    words = ["convert", f"foreign.{kind}", "-o", draw.choice(("out.csv", "out.parquet"))]
    for text in draw.sample(maps, draw.choice((0, 1, 2))):
        words += ["--map", text]
    extras: tuple[list[str], ...] = (
        *([], [], [], ["--unwrap"], ["--trim", "0.05:0.2"], ["--resample", "0.002"]),
        *(["--rows", "::3"], ["--skip-rows", "2"], ["--no-header"], ["--set", "temperature_k=293"]),
        *(["--atmosphere", "1e5"], ["--period", "0.001"], ["--resample", "1e-300"], ["--json"]),
    )
    return Case(f"convert {kind}", {f"foreign.{kind}": data}, (*words, *draw.choice(extras)))


def _export(draw: random.Random, corpus: Corpus) -> Case:
    name = draw.choice(list(corpus.bundles))
    kind, file = draw.choice(
        (("c", "m.h"), ("mat", "m.mat"), ("json", "m.json"), ("json", "m.json"))
    )
    words = ("export", "bundle.json", "--format", kind, "-o", file)
    data = mutate_json(draw, corpus.bundles[name])
    return Case(f"export {kind} {name}", {"bundle.json": data}, words)


_WHOLE_BUNDLES = ("diagnosed", "validated")


def _simulate(draw: random.Random, corpus: Corpus) -> Case:
    bundle = corpus.bundles[draw.choice(_WHOLE_BUNDLES)]
    frame = corpus.logs[draw.choice(("motion-pwm", "motion-motor"))]
    name, data = "log.csv", _csv(frame)
    if draw.random() < 0.5:
        bundle = mutate_json(draw, bundle)
    else:
        name, data = _log(draw, frame)
    files = {name: data, "bundle.json": bundle}
    words = ("simulate", name, "--bundle", "bundle.json", "-o", "out.csv", "--json")
    return Case("simulate", files, words)


_ENTRY = '\n[[log]]\nkind = "{kind}"\nfile = "{file}"\nuse = "{use}"\n'


def _validate(draw: random.Random, corpus: Corpus) -> Case:
    files = _campaign_files(corpus, ("motion-pwm", "motion-motor"))
    files["bundle.json"] = corpus.bundles[draw.choice(_WHOLE_BUNDLES)]
    _mutate_one(draw, corpus, files)
    words = ("validate", "campaign.toml", "--bundle", "bundle.json", "-o", "out.json")
    return Case("validate", files, (*words, "--report", "out.html", "--json"))


def _run(draw: random.Random, corpus: Corpus) -> Case:
    kinds = ("friction-static", "friction-sliding", "motion-motor")
    files = _campaign_files(corpus, kinds)
    _mutate_one(draw, corpus, files)
    words = ("run", "campaign.toml", "-o", "results", "--no-diagnose", "--surface", "bipolynomial")
    return Case("run", files, words)


def _campaign_files(corpus: Corpus, kinds: tuple[str, ...]) -> dict[str, bytes]:
    text = 'rig = "rig.toml"\n' + "".join(
        _ENTRY.format(kind=k, file=f"{k}.csv", use="holdout" if k == "motion-pwm" else "fit")
        for k in kinds
    )
    logs = {f"{k}.csv": _csv(corpus.logs[k]) for k in kinds}
    return {"rig.toml": corpus.rig, "campaign.toml": text.encode(), **logs}


def _mutate_one(draw: random.Random, corpus: Corpus, files: dict[str, bytes]) -> None:
    name = draw.choice(sorted(files))
    if name.endswith(".toml"):
        files[name] = mutate_toml(draw, files[name])
    elif name.endswith(".json"):
        files[name] = mutate_json(draw, files[name])
    elif draw.random() < 0.8:
        files[name] = _csv(mutate_values(draw, corpus.logs[name.removesuffix(".csv")]))
    elif draw.random() < 0.5:
        files[name] = mutate_csv(draw, corpus.logs[name.removesuffix(".csv")])
    else:
        files[name] = mutate_bytes(draw, files[name])


_MAKERS: dict[Callable[[random.Random, Corpus], Case], float] = {
    _check: 20.0,
    _fit: 20.0,
    _convert: 30.0,
    _export: 20.0,
    _simulate: 4.0,
    _validate: 4.0,
    _run: 2.0,
}


# Running and judging.


class _TooSlowError(BaseException):
    """Past the limit; no `except Exception` may swallow it."""


def run(corpus: Corpus, seed: int, number: int) -> Outcome:
    """One case in a folder of its own, in this process."""
    main = _command()
    one = case(corpus, seed, number)
    before = Path.cwd()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        os.chdir(folder)
        try:
            for name, data in one.files.items():
                Path(name).write_bytes(data)
            out, err = io.StringIO(), io.StringIO()
            start, code, faults = time.process_time(), None, []
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                try:
                    with _limited(LIMIT_S):
                        code = main(list(one.words))
                except _TooSlowError:
                    faults.append(f"slow: more than {LIMIT_S} s")
                except BaseException as error:  # whatever it is, it should not come out
                    faults.append(f"escaped: {type(error).__name__}: {error}")
            seconds = time.process_time() - start
            faults += _faults(one, code, out.getvalue(), err.getvalue())
        finally:
            os.chdir(before)
    said = err.getvalue()
    return Outcome(number, one.name, code, seconds, tuple(faults), said)


@functools.cache
def _command() -> Callable[[list[str]], int]:
    """`sysid` as it is installed."""
    (entry,) = importlib.metadata.entry_points(group="console_scripts", name="sysid")
    main: Callable[[list[str]], int] = entry.load()
    return main


@contextlib.contextmanager
def _limited(seconds: int) -> Iterator[None]:
    """Stops after so many seconds of processor time, or ten times as many on the clock."""

    def stop(*_: object) -> None:
        raise _TooSlowError

    timers = ((signal.SIGPROF, signal.ITIMER_PROF, 1), (signal.SIGALRM, signal.ITIMER_REAL, 10))
    before = [signal.signal(number, stop) for number, _, _ in timers]
    for _, timer, factor in timers:
        signal.setitimer(timer, factor * seconds)
    try:
        yield
    finally:
        for (number, timer, _), handler in zip(timers, before, strict=True):
            signal.setitimer(timer, 0.0)
            signal.signal(number, handler)


_RAW = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def _faults(one: Case, code: int | None, out: str, err: str) -> list[str]:
    found = [] if code in (*ALLOWED, None) else [f"exit {code}: {_last(err)}"]
    lines = err.splitlines()
    errors = [line for line in lines if line.startswith(("sysid: error:", "sysid: fault:"))]
    if code in (2, 3) and (len(errors) != 1 or errors[0] != lines[-1]):
        found.append(f"not one line of error: {err[-200:]!r}")
    if strange := [line for line in lines if not line.startswith("sysid: ")]:
        found.append(f"another's line: {strange[0][:160]!r}")
    if _RAW.search(out + err):
        found.append("a raw control character")
    if longest := [line for line in lines if len(line) > 5000]:
        found.append(f"a line of {len(longest[0])} characters")
    if "--json" in one.words and code == 0:
        found += _not_finite("standard output", out)
    new = [p for p in Path().rglob("*") if p.is_file() and str(p) not in one.files]
    return found + [fault for path in new for fault in _file_faults(path, code)]


def _last(err: str) -> str:
    lines = err.strip().splitlines()
    return lines[-1][:200] if lines else ""


def _file_faults(path: Path, code: int | None) -> list[str]:
    if path.name.startswith(".sysid-"):
        return [f"temporary file {path}"]
    if path.parts[0] != "results" and code in (2, 3) and path.suffix != ".json":
        return [f"exit {code}, but {path} was written"]
    data = path.read_bytes()
    if path.suffix == ".json":
        return _not_finite(str(path), data.decode("utf-8", "replace"))
    if path.suffix == ".csv":
        table = pd.read_csv(path, comment="#")
        numbers = (
            table.drop(columns="test", errors="ignore").select_dtypes("number").to_numpy(float)
        )
        return [] if np.isfinite(numbers).all() else [f"{path}: not finite"]
    if path.suffix == ".html" and not data.rstrip().endswith(b"</html>"):
        return [f"{path} is not whole"]
    if path.name == "m.h" and not data.rstrip().endswith(b"*/"):
        return [f"{path} is not whole"]
    if path.suffix == ".h" and re.search(rb"\b(nan|inf)\b(?![a-z ])", data):
        return [f"{path}: not finite"]
    return []


def _not_finite(name: str, text: str) -> list[str]:
    def reject(constant: str) -> float:
        raise ValueError(constant)

    def number(digits: str) -> float:
        value = float(digits)
        return value if math.isfinite(value) else reject(digits)

    try:
        json.loads(text, parse_constant=reject, parse_float=number)
    except ValueError as error:
        return [f"{name}: no finite JSON ({str(error)[:80]})"]
    return []


_corpus: Corpus | None = None


def _prepare() -> None:
    global _corpus
    _corpus = Corpus.read()
    os.environ["SYSID_JOBS"] = "1"


def _one(job: tuple[int, int]) -> Outcome:
    assert _corpus is not None
    try:
        return run(_corpus, *job)
    except Exception:
        return Outcome(job[1], "?", None, 0.0, (f"harness: {traceback.format_exc()[-300:]}",), "")


def outcomes(seed: int, numbers: range, jobs: int) -> Iterator[Outcome]:
    """The outcomes of these cases, in any order, by `jobs` processes."""
    if jobs == 1:
        _prepare()
        yield from (_one((seed, n)) for n in numbers)
        return
    context = multiprocessing.get_context("spawn")
    with context.Pool(jobs, _prepare) as pool:
        yield from pool.imap_unordered(_one, ((seed, n) for n in numbers), chunksize=10)


def main() -> None:
    """Run the cases; print the failures and a table of exits."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--case", type=int)
    options = parser.parse_args()
    if options.case is not None:
        _show(options.seed, options.case)
        return
    exits: collections.Counter[str] = collections.Counter()
    failed, slowest, start = 0, Outcome(-1, "", None, 0.0, (), ""), time.perf_counter()
    numbers = range(options.first, options.first + options.count)
    for outcome in outcomes(options.seed, numbers, options.jobs):
        exits[f"{outcome.name.split()[0]} {outcome.code}"] += 1
        failed += bool(outcome.faults)
        slowest = max(slowest, outcome, key=lambda o: o.seconds)
        for fault in outcome.faults:
            print(f"case {outcome.number} ({outcome.name}): {fault}", flush=True)
    for key, count in sorted(exits.items()):
        print(f"{key}: {count}")
    print(
        f"{options.count} cases, seed {options.seed}: {failed} failed; slowest "
        f"{slowest.seconds:.1f} s (case {slowest.number}); {time.perf_counter() - start:.0f} s"
    )
    sys.exit(bool(failed))


def _show(seed: int, number: int) -> None:
    _prepare()
    assert _corpus is not None
    one = case(_corpus, seed, number)
    folder = Path(tempfile.gettempdir()) / f"fuzz-{seed}-{number}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name, data in one.files.items():
        (folder / name).write_bytes(data)
    print(f"cd {folder} && sysid {' '.join(map(repr, one.words))}")
    outcome = run(_corpus, seed, number)
    print(replace(outcome, said=""), outcome.said, sep="\n")


if __name__ == "__main__":
    main()
