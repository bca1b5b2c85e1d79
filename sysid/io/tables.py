"""Reading a table of columns from CSV or Parquet, with errors that name the line.

pandas and pyarrow parse; this module finds out, once they have reported an error or left a
gap, which line is at fault.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import itertools
import json
import os
import stat
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from sysid.errors import InputError, escaped, input_error, shortened
from sysid.io.bounds import (
    TextCells,
    check_columns,
    check_device,
    check_length,
    check_rectangle,
    check_text,
    chunks,
)
from sysid.io.file_kinds import (
    FOREIGN_SUFFIXES,
    PARQUET_HEAD,
    PARQUET_SUFFIXES,
    decoded,
    read_as,
    reject_bag,
    reject_foreign,
)
from sysid.io.files import note_input, open_atomic
from sysid.io.parquet_columns import ParquetColumns
from sysid.io.units import ColumnMap, find_column

if TYPE_CHECKING:
    import pandas as pd

    from sysid.io.foreign.table import ForeignTable

_NOTED = b"sysid.comments"
# Comments are at the head of a file.
HEAD_BYTES = 1 << 16
_NOT_A_NUMBER = ["", "NaN", "nan", "NA", "N/A", "null", "NULL", "None", "-nan", "#N/A"]


@dataclass(frozen=True)
class LogTable:
    """The columns that were asked for, their file's SHA-256, and the place of each row.

    `comments` are the lines above the header, or what `write_table` put into Parquet's metadata.
    `rows` (n,) are the file's rows that are in the frame (None: all). A file of another format has
    its own `place_of` a row; until it is brought into the log format (`sysid.io.foreign_log`) it is
    `foreign`, and the frame empty.
    """

    path: Path
    sha256: str
    header: tuple[str, ...]
    frame: pd.DataFrame
    body: bytes | None
    header_line: int = 0
    comments: tuple[str, ...] = ()
    rows: NDArray[np.intp] | None = None
    place_of: Callable[[int], str] | None = None
    foreign: ForeignTable | None = None

    def place(self, row: int) -> str:
        """`line 17` of a CSV file (row 0 is the first data row), `row 17` of Parquet."""
        row = self._in_file(row)
        if self.place_of is not None:
            return self.place_of(row)
        if self.body is None:
            return f"row {row + 1}"
        return f"line {_data_lines(self.body)[row][0]}"

    def _in_file(self, row: int) -> int:
        return row if self.rows is None else int(self.rows[row])

    def column_of(self, target: str, maps: Mapping[str, ColumnMap]) -> str | None:
        """The column that holds one of the log format: as mapped, else by its name; None: none.

        Raises InputError where the mapped one is missing.
        """
        if target in maps:
            return self.header[find_column(self.header, maps[target], str(self.path))]
        return target if target in self.header else None

    def at_rows(self, kept: NDArray[np.intp]) -> LogTable:
        """The table of these rows alone."""
        rows = kept if self.rows is None else self.rows[kept]
        return replace(self, frame=self.frame.iloc[kept].reset_index(drop=True), rows=rows)

    def is_stamped(self, column: str) -> bool:
        """Whether a column holds time stamps or durations, as Parquet has them."""
        return bool(self.frame[column].dtype.kind in "mM")

    def empty(self, column: str) -> NDArray[np.bool_]:
        """Which cells (n,) of a column hold nothing."""
        return np.asarray(self.frame[column].isna(), dtype=bool)

    def numbers(self, column: str, absent: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """A column as (n,) floats; InputError at the first cell that is not a finite number.

        Time stamps count in seconds from the first, durations in seconds. In the rows `absent`
        (n,) the column need not hold anything: NaN.
        """
        import pandas as pd

        values = self.frame[column]
        if self.is_stamped(column):
            spans = values if values.dtype.kind == "m" else values - values.iloc[0]
            values = spans.dt.total_seconds()
        if values.dtype.kind not in "fiub":
            converted = pd.to_numeric(values, errors="coerce")
            bad = np.flatnonzero(converted.isna().to_numpy() & values.notna().to_numpy())
            if bad.size:
                text = str(values.iloc[bad[0]])
                fix = "fix the cell (decimal point, no units, no thousands separator)"
                first = pd.to_numeric(self.frame.iloc[0], errors="coerce")
                if bad[0] == 0 and len(values) > 1 and first.isna().all():
                    fix = (
                        "delete this row of units, if they are those of the columns' names; else "
                        "import the file with `sysid convert`"
                    )
                raise input_error(
                    f"{self.path}, {self.place(int(bad[0]))}",
                    f"{column} = {text[:40]!r} is not a number",
                    fix,
                )
            values = converted
        array = np.asarray(values.to_numpy(dtype=np.float64, na_value=np.nan))
        finite = np.isfinite(array)
        if absent is not None:
            finite |= absent & np.isnan(array)
        if not finite.all():
            raise self._not_finite(column, int(np.flatnonzero(~finite)[0]), array)
        return array

    def labels(self, column: str) -> tuple[NDArray[np.intp], list[str]]:
        """A column of labels: (n,) codes, and the label of each code in order of appearance.

        Long labels are shortened, and control characters in them escaped: they go into messages
        and reports. InputError at the first empty label.
        """
        import pandas as pd

        codes, found = pd.factorize(self.frame[column])
        names = [f"{v:g}" if isinstance(v, float) else str(v) for v in found]
        empty = codes < 0 if "" not in names else (codes < 0) | (codes == names.index(""))
        if empty.any():
            raise self._not_finite(column, int(np.flatnonzero(empty)[0]), None)
        return np.asarray(codes, dtype=np.intp), _short_labels(names)

    def _not_finite(self, column: str, row: int, array: NDArray[np.float64] | None) -> Exception:
        where = f"{self.path}, {self.place(row)}"
        if self.body is not None:
            lines = _data_lines(self.body)
            fields = len(next(csv.reader([lines[self._in_file(row)][1]])))
            # The first row is as long as the header: it was checked.
            whole = len(next(csv.reader([lines[0][1]])))
            if fields < whole:
                last = self._in_file(row) == len(lines) - 1
                return input_error(
                    where,
                    f"the row ends early: {fields} of {whole} fields",
                    "delete this last line: the recording was cut off there"
                    if last
                    else "complete the row or delete it",
                )
        if array is not None and np.isinf(array[row]):
            return input_error(where, f"{column} is infinite", "delete the row or fix the value")
        what, count = f"{column} is empty or not a number (NaN)", 0
        if array is not None and (count := int(np.count_nonzero(np.isnan(array)))) > 1:
            what += f" in {count} of {len(array)} rows, the first of them here"
        if not 1 < count < len(self.frame) - 1:
            return input_error(where, what, "delete the row or fill in the value")
        return input_error(
            where,
            what,
            "delete the rows or fill in the values; those of a channel that is slower than the "
            "others `sysid convert` fills in",
        )


def _short_labels(names: list[str]) -> list[str]:
    """Labels as they are shown; those that would then be the same are numbered."""
    short = [shortened(escaped(name)) for name in names]
    seen: Counter[str] = Counter()
    for i, name in enumerate(short):
        seen[name] += 1
        if seen[name] > 1:
            short[i] = f"{name} ({seen[name]})"
    return short


def read_bytes(path: Path, what: str, *, is_bundle: bool = False) -> bytes:
    """An input's bytes; InputError as `open_input` raises it."""
    with open_input(path, what, is_bundle=is_bundle) as file:
        return file.read()


@contextlib.contextmanager
def open_input(path: Path, what: str, *, is_bundle: bool = False) -> Iterator[BinaryIO]:
    """An input, open at its start, that can be searched; what comes from a pipe is kept.

    Raises InputError where it is missing, a folder, a device, empty, not readable, longer than
    `sysid.io.bounds.most_bytes`, or changed within the block.
    """
    try:
        file = _opened(path)
        note_input(path, is_bundle=is_bundle)
    except FileNotFoundError:
        raise input_error(path, "no such file", f"give the path of {what}") from None
    except IsADirectoryError:
        raise input_error(path, "is a directory", f"give the path of {what} in it") from None
    except PermissionError:
        raise input_error(path, "may not be read", "change its permissions (chmod +r)") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        short = str(path) if len(str(path)) < 200 else str(path)[:80] + "..."
        raise input_error(
            short, f"cannot be opened: {reason}", f"give the path of {what}"
        ) from None
    with file:
        before = _state(file)
        if _is_blank(file):
            raise input_error(
                path, "the file is empty", "record the log again or give another file"
            )
        file.seek(0)
        yield file
        if _state(file) != before:
            raise input_error(path, "changed while it was read", "wait until it is complete")


def _opened(path: Path) -> BinaryIO:
    found = path.stat()
    check_device(path, found.st_mode)
    file = path.open("rb")
    if stat.S_ISREG(found.st_mode):
        try:
            check_length(path, os.fstat(file.fileno()).st_size)
        except InputError:
            file.close()
            raise
        return file
    with file:
        return _kept(path, file)


def _kept(path: Path, pipe: BinaryIO) -> BinaryIO:
    """The content of a pipe, in memory; InputError beyond the bounds."""
    kept, counted = io.BytesIO(), TextCells(path)
    for chunk in chunks(pipe):
        counted.add(chunk)
        kept.write(chunk)
        check_length(path, kept.tell())
    kept.seek(0)
    return kept


def _state(file: BinaryIO) -> tuple[int, int]:
    """Size and time of the last change; of what is kept in memory always the same."""
    if isinstance(file, io.BytesIO):
        return 0, 0
    found = os.fstat(file.fileno())
    return found.st_size, found.st_mtime_ns


def _is_blank(file: BinaryIO) -> bool:
    return all(map(bytes.isspace, chunks(file)))


def require_log(path: Path) -> None:
    """InputError for a missing file; checked before anything else."""
    if not path.exists():
        fix = "give the path of a log"
        if path.suffix.lower() in FOREIGN_SUFFIXES:
            fix += f"; what other programs write, as {path.suffix}, goes through `sysid convert`"
        raise input_error(path, "no such file", fix)


def read_table(path: Path, wanted: Collection[str], text: Collection[str] = ()) -> LogTable:
    """The `wanted` columns that the file has (CSV or Parquet, by its suffix).

    `text` names those that are labels, not numbers. Raises InputError.
    """
    if path.suffix.lower() == ".toml":
        raise input_error(
            path,
            "is a TOML file, not a log",
            "give the path of a log; all logs of a campaign are fitted by `sysid fit CAMPAIGN`",
        )
    reject_bag(path)
    try:
        with open_input(path, "a log") as file:
            if path.suffix.lower() in PARQUET_SUFFIXES:
                return _read_parquet(path, file, wanted)
            reject_foreign(path, file)
            check_text(path, file)
            return _read_csv(path, file.read(), wanted, text)
    except csv.Error as error:
        raise input_error(
            path,
            f"cannot be read as CSV ({error})",
            "save it again with a line feed after each row",
        ) from None


def write_table(frame: pd.DataFrame, path: Path, comments: Sequence[str]) -> None:
    """Write columns as CSV (RFC 4180) under `#` comment lines, or as Parquet by the suffix.

    Numbers are written so that they read back as the same doubles; whole or not at all.
    """
    with open_atomic(path) as file:
        if path.suffix.lower() in PARQUET_SUFFIXES:
            import pyarrow as pa
            import pyarrow.parquet as parquet

            content = pa.Table.from_pandas(frame, preserve_index=False)
            note = json.dumps(list(comments), ensure_ascii=False).encode()
            metadata = {**(content.schema.metadata or {}), _NOTED: note}
            parquet.write_table(content.replace_schema_metadata(metadata), file)
            return
        for line in comments:
            file.write(f"# {' '.join(line.split())}\r\n".encode("utf-8", errors="replace"))
        # pandas writes the shortest decimal that reads back as the same double.
        file.write(frame.to_csv(index=False, lineterminator="\r\n").encode("utf-8"))


def _chosen(header: Sequence[str], wanted: Collection[str]) -> list[str]:
    """The columns asked for, by name or by number (`#3` is the third)."""
    return [c for i, c in enumerate(header, start=1) if c in wanted or f"#{i}" in wanted]


def _read_parquet(path: Path, file: BinaryIO, wanted: Collection[str]) -> LogTable:
    with read_as(path, "Parquet", "write it again, or save it as CSV"):
        content = ParquetColumns.of(path, file)
        header = tuple(content.schema.names)
        _reject_doubled(path, header, "the schema", wanted)
        # The column that pandas stored as its index is a column like any other.
        used, unread = _chosen(header, wanted), content.unread()
        if bad := [name for name in used if name in unread]:
            raise input_error(path, f"{bad[0]} is {unread[bad[0]]}", "save it as plain numbers")
        frame = content.read(used).to_pandas(ignore_metadata=True)
        for name in frame.select_dtypes("category"):
            frame[name] = frame[name].astype(object)
        comments = _comments_of(content.schema.metadata)
    digest = sha256_of(file)
    return LogTable(path, digest, header, frame.reset_index(drop=True), None, comments=comments)


def sha256_of(*files: BinaryIO) -> str:
    """The SHA-256 of a whole file, or of several one after the other, as hexadecimal digits."""
    digest = hashlib.sha256()
    for file in files:
        file.seek(0)
        for chunk in chunks(file):
            digest.update(chunk)
    return digest.hexdigest()


def comments_in(file: BinaryIO) -> tuple[str, ...]:
    """The comments of a file that `write_table` wrote; none of any other file."""
    file.seek(0)
    head = file.read(HEAD_BYTES)
    if head.startswith(PARQUET_HEAD):
        import pyarrow.parquet as parquet

        return _comments_of(parquet.read_schema(file).metadata)
    lines = head.splitlines()
    above = itertools.takewhile(lambda line: line.startswith(b"#"), lines)
    return tuple(line.decode("utf-8", "replace").strip("# \r") for line in above)


def _comments_of(metadata: Mapping[bytes, bytes] | None) -> tuple[str, ...]:
    """The comments that `write_table` stored in a Parquet file; none in other files."""
    try:
        noted = json.loads((metadata or {}).get(_NOTED, b"[]"))
    except ValueError:
        return ()
    return tuple(map(str, noted)) if isinstance(noted, list) else ()


def _read_csv(path: Path, raw: bytes, wanted: Collection[str], text: Collection[str]) -> LogTable:
    import pandas as pd

    digest = hashlib.sha256(raw).hexdigest()
    body = _plain(path, raw)
    header_line, header = _header(path, body)
    _reject_doubled(f"{path}, line {header_line}", header, "the header", wanted)
    header = _distinguished(header)
    used = _chosen(header, wanted)
    text = _chosen(header, text)
    if not used:
        _reject_preamble(path, body, wanted)
    check_rectangle(path, max(body.count(b"\n"), body.count(b"\r")), len(header))
    _check_first_row(path, body, header, is_log=bool(used))
    try:
        frame = pd.read_csv(
            io.BytesIO(body),
            header=None,
            names=list(header),
            skiprows=header_line,
            usecols=used,
            dtype={c: str for c in used if c in text},
            index_col=False,
            keep_default_na=False,
            na_values={c: _NOT_A_NUMBER for c in used if c not in text},
            skipinitialspace=True,
            low_memory=False,
        )
    except pd.errors.ParserError as error:
        raise input_error(
            path, f"cannot be read as CSV ({error})", "fix that line, or save it again as CSV"
        ) from None
    above = body.split(b"\n", header_line - 1)[: header_line - 1]
    comments = tuple(line.decode("utf-8").strip("# \r") for line in above)
    table = LogTable(path, digest, header, frame, body, header_line, comments)
    _reject_surplus(table, is_log=bool(used))
    _reject_cut_off(table)
    return table


def _plain(path: Path, raw: bytes) -> bytes:
    """The file without its byte order mark, checked to be UTF-8 text."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise input_error(path, "is UTF-16 text", "save it as UTF-8")
    body = raw.removeprefix(b"\xef\xbb\xbf")
    if b"\0" in body[:65536]:
        raise input_error(path, "is a binary file, not CSV", "import it with `sysid convert`")
    if not body.isascii():
        decoded(path, body)
    return body


def _header(path: Path, body: bytes) -> tuple[int, tuple[str, ...]]:
    """How many lines precede the data, and the column names."""
    for number, line in enumerate(io.BytesIO(body), start=1):
        text = line.decode("utf-8").strip()
        if not text or text.startswith("#"):
            continue
        where = f"{path}, line {number}"
        check_columns(path, text.count(",") + 1)
        names = tuple(name.strip() for name in next(csv.reader([text])))
        _reject_wrong_delimiter(where, text, names)
        if all(is_number(n) for n in names):
            raise input_error(
                where,
                "numbers where the column names should be",
                "add a header row, or import the file with `sysid convert --no-header`",
            )
        return number, names
    raise input_error(path, "holds comments only", "add a header row and samples")


def _reject_wrong_delimiter(where: str, text: str, names: tuple[str, ...]) -> None:
    for delimiter, name in ((";", "semicolons"), ("\t", "tabs"), (" ", "blanks"), ("|", "bars")):
        if len(names) == 1 and len(text.split(delimiter)) > 1:
            raise input_error(
                where,
                f"the columns are separated by {name}, not commas",
                "import the file with `sysid convert`, or save it with commas",
            )


def _distinguished(names: tuple[str, ...]) -> tuple[str, ...]:
    """Columns that are not asked for may share a name, or have none."""
    counts = Counter(names)
    return tuple(
        f"{name} ({i})" if counts[name] > 1 else name for i, name in enumerate(names, start=1)
    )


def _reject_doubled(
    where: str | Path, names: tuple[str, ...], what: str, wanted: Collection[str]
) -> None:
    doubled = sorted(n for n, count in Counter(names).items() if count > 1 and n in wanted)
    if doubled:
        raise input_error(
            where, f"{what} contains {doubled[0]} twice", "rename or delete one of the two columns"
        )


# Where the first line names no column of a log, the file is no damaged log.
_IMPORT = "import the file with `sysid convert`, which passes over lines above a table"


def _reject_preamble(path: Path, body: bytes, wanted: Collection[str]) -> None:
    """InputError where columns that are wanted are named below the first line."""
    for number, line in _data_lines(body[:200_000])[:1000]:
        cells = {cell.strip() for cell in next(csv.reader([line]), [])}
        if "time_s" in cells and len(cells.intersection(wanted)) > 1:
            raise input_error(
                f"{path}, line {number}",
                "the columns' names are below other lines",
                "delete the lines above, or begin them with #",
            )


def _check_first_row(path: Path, body: bytes, header: tuple[str, ...], *, is_log: bool) -> None:
    rows = _data_lines(body[:200_000]) or _data_lines(body)
    if not rows:
        raise input_error(path, "has a header but no samples", "record the log again")
    number, line = rows[0]
    check_columns(path, line.count(",") + 1)
    fields = len(next(csv.reader([line])))
    if fields != len(header):
        raise input_error(
            f"{path}, line {number}",
            f"{fields} fields under {len(header)} column names",
            "make header and rows agree (a comma too many at the end of the lines?)"
            if is_log
            else _IMPORT,
        )


def _reject_surplus(table: LogTable, *, is_log: bool) -> None:
    """Fields beyond the header's, which pandas drops silently."""
    body, header = table.body or b"", table.header
    # Counting commas is quick and decides every file that quotes nothing.
    data = body.split(b"\n", table.header_line)[-1]
    if b'"' not in data and data.count(b",") == len(table.frame) * (len(header) - 1):
        return
    for number, line in _data_lines(body):
        check_columns(table.path, line.count(",") + 1)
        fields = len(next(csv.reader([line])))
        if fields > len(header):
            raise input_error(
                f"{table.path}, line {number}",
                f"{fields} fields under {len(header)} column names",
                "delete the surplus fields (a decimal comma, or two lines run together?)"
                if is_log
                else _IMPORT,
            )


def _reject_cut_off(table: LogTable) -> None:
    """A last line cut off within its last number would silently give a wrong value."""
    body = table.body
    if body is None or body.endswith((b"\n", b"\r")) or len(table.frame) < 20:
        return
    start = max(0, len(body) - 20_000)
    lines = body[start:].decode("utf-8", errors="ignore").splitlines()[1:]
    last = [line.rsplit(",", 1)[-1] for line in lines if line.strip()]
    if len(last) > 10 and looks_cut(last):
        raise input_error(
            f"{table.path}, {table.place(len(table.frame) - 1)}",
            "the last line has no line end and its last number is shorter than all before it: "
            "it looks cut off",
            "delete the line, or end it with a line break if it is whole",
        )


def looks_cut(cells: Sequence[str], decimal: str = ".") -> bool:
    """Whether the last of cells is shorter than all before it, as a whole or after its point."""
    lengths = [len(cell) for cell in cells]
    digits = [len(cell.partition(decimal)[2]) for cell in cells]
    return any(n[-1] < min(n[:-1]) for n in (lengths, digits))


def _data_lines(body: bytes) -> list[tuple[int, str]]:
    """(line number, text) of every data row: what follows the header and is not blank."""
    numbered = [
        (number, line)
        for number, line in enumerate(body.decode("utf-8", errors="replace").splitlines(), start=1)
        if line.strip()
    ]
    head = 0
    while head < len(numbered) and numbered[head][1].lstrip().startswith("#"):
        head += 1
    return numbered[head + 1 :]


def is_number(text: str) -> bool:
    """Whether a cell of the log format is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


__all__ = [
    "HEAD_BYTES",
    "LogTable",
    "comments_in",
    "is_number",
    "looks_cut",
    "open_input",
    "read_bytes",
    "read_table",
    "require_log",
    "sha256_of",
    "write_table",
]
