"""MATLAB files of version 7.3, and other HDF5 files, by h5py.

A file may ask its reader for more than it holds: bytes of other files, links back to where they
stand, values that were never written. So its links and sizes are checked first, each
object once, and nothing outside the file is opened.
"""

from __future__ import annotations

import math
import zlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from sysid.errors import input_error, shortened
from sysid.io.bounds import (
    MOST_COLUMNS,
    MOST_DEPTH,
    VARIABLE,
    Cells,
    check_columns,
    most_cells,
)
from sysid.io.file_kinds import read_as
from sysid.io.foreign.elements import gather_elements
from sysid.io.foreign.matlab_objects import only_objects, reason
from sysid.io.foreign.table import ForeignTable, ReadOptions

_OUTSIDE = "save the data in one file (in MATLAB: load, then save)"
# Attributes of the netCDF conventions for what stands for no value, and for packed values.
_NO_VALUE, _PACKED = (b"_FillValue", b"missing_value"), (b"scale_factor", b"add_offset")
# Bytes of MATLAB's attributes, of its names, and of what filters add to a chunk, are fewer.
_LONGEST_ATTRIBUTE = 1024
# Chunks that are read at once, some 40 MB of what the library keeps for them.
_MOST_CHUNKS = 10_000
# A chunk takes about as long to read as so many cells do.
_CELLS_A_CHUNK = 100


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Data sets by name, groups (structs) and fields of records by dots.

    See `sysid.io.foreign.matlab.read`. Of several names for one object the first is read; links and
    references come last. Raises InputError where values or objects are in other files, and beyond
    the bound of cells.
    """
    import h5py

    head = file.read(16)
    table = ForeignTable(path, "MATLAB 7.3" if head.startswith(b"MATLAB 7.3") else "HDF5")
    with read_as(path, f"an HDF5 ({table.format}) file"), h5py.File(file, "r") as content:
        found = _Objects(table, content)
        found.look_through()
        for name, node in found.wanted:
            _check_packed(path, name, node)
            if fields := _fields_of_numbers(node.dtype):
                _add_fields(table, name, _values(node, fields))
                if fields == ["real", "imag"]:
                    table.skip_complex(name)
            else:
                table.add(name, _unpacked(table, name, node, np.asarray(_values(node))).T)
            unit = _attribute(node, b"units") or _attribute(node, b"unit")
            if isinstance(unit, str) and unit.strip():
                _set_unit(table, name, unit.strip())
    gather_elements(table)
    if found.objects and not table.columns:
        raise only_objects(path, found.objects)
    return table


def _chunks(node: Any) -> list[int]:
    """How many chunks a data set has along each axis; none where it is in one piece."""
    if not node.chunks:
        return []
    return [-(-length // chunk) for length, chunk in zip(node.shape, node.chunks, strict=True)]


def _values(node: Any, fields: list[str] | None = None) -> Any:
    """A data set's values, of `fields` where it holds records.

    In parts along the axis of most chunks: the library keeps kilobytes for each chunk that one
    request touches, and a data set may have a chunk for each value.
    """
    content = node if fields is None else node.fields(fields)
    if not node.chunks or not node.size:
        return content[()]
    counts = _chunks(node)
    axis = int(np.argmax(counts))
    at_once = max(1, _MOST_CHUNKS * counts[axis] // math.prod(counts)) * node.chunks[axis]
    if at_once >= node.shape[axis]:
        return content[()]
    whole = (slice(None),) * axis
    parts = [
        content[(*whole, slice(at, at + at_once))] for at in range(0, node.shape[axis], at_once)
    ]
    return np.concatenate(parts, axis=axis)


def _unpacked(table: ForeignTable, name: str, node: Any, values: NDArray[Any]) -> NDArray[Any]:
    """Values as the attributes of the netCDF conventions mean them: without those that stand for
    none, scaled and shifted."""
    given = {}
    for key in (*_NO_VALUE, *_PACKED):
        one = np.asarray(_attribute(node, key))
        if one.size == 1 and one.dtype.kind in "fiu":
            given[key] = one.ravel()[0]
    none = {key: one for key, one in given.items() if key in _NO_VALUE and np.any(values == one)}
    used = none | {key: given[key] for key in _PACKED if key in given}
    if not used:
        return values
    out = values.astype(np.float64)
    for one in none.values():
        out[values == one] = np.nan
    out = out * float(used.get(_PACKED[0], 1.0)) + float(used.get(_PACKED[1], 0.0))
    said = ", ".join(f"{key.decode()} {float(one):g}" for key, one in used.items())
    table.notices.append(f"{table.path}: {name} is read by its attributes: {said}")
    return out


def _fields_of_numbers(dtype: Any) -> list[str]:
    """The fields of a compound type that are numbers, or records of their own; () of another."""
    parts = {name: dtype.fields[name][0] for name in dtype.names or ()}
    return [n for n, d in parts.items() if (d.names and not d.hasobject) or d.base.kind in "fiub"]


def _add_fields(table: ForeignTable, name: str, rows: NDArray[Any]) -> None:
    """The fields of records (n,), "name.field"; of a record within one by further dots."""
    for field_name in rows.dtype.names or ():
        full, values = _full(name, field_name), rows[field_name]
        if values.dtype.names:
            _add_fields(table, full, values)
        elif values.dtype.kind not in "fiub":
            table.skipped[full] = f"of type {values.dtype}"
        else:
            table.add(full, values)


def _set_unit(table: ForeignTable, name: str, unit: str) -> None:
    """A data set's unit, for all signals that it holds."""
    of_it = [n for n in table.columns if n == name or n.rpartition("#")[0] == name]
    table.units |= dict.fromkeys(of_it, unit)


@dataclass
class _Objects:
    """Traverses a file: `wanted` are the data sets to read, `objects` the classes of MATLAB's
    own objects, by name.

    `_seen` has the names of the objects that were met, `_searched` the groups whose links were
    found to stay within the file, both by the objects' addresses.
    """

    table: ForeignTable
    file: Any
    wanted: list[tuple[str, Any]] = field(default_factory=list)
    objects: dict[str, str] = field(default_factory=dict)
    _seen: dict[int, str] = field(default_factory=dict)
    _searched: set[int] = field(default_factory=set)
    _later: deque[Callable[[], None]] = field(default_factory=deque)

    def __post_init__(self) -> None:
        self.cells, self._names, self._chunks = Cells(self.table.path), 0, 0

    def look_through(self) -> None:
        """All that the root's groups, links and references lead to."""
        self._refuse_outside(self.file.id)
        self._seen[_address(self.file.id)] = "the file's root"
        self._enter(self.file.id, "", 0)
        while self._later:
            self._later.popleft()()

    def _refuse_outside(self, group: Any) -> None:
        """InputError for a link into another file, in the group or in a group below it."""
        import h5py

        inside = (h5py.h5l.TYPE_HARD, h5py.h5l.TYPE_SOFT)
        waiting = [group]
        while waiting:
            group = waiting.pop()
            if (address := _address(group)) in self._searched:
                continue
            self._searched.add(address)
            self._names += group.get_num_objs()
            check_columns(self.table.path, self._names)
            for link in group:
                kind = group.links.get_info(link).type
                if kind not in inside:
                    where = f"{_shown(h5py.h5i.get_name(group)).rstrip('/')}/{_shown(link)}"
                    raise input_error(
                        self.table.path, f"{where!r} is a link to another file", _OUTSIDE
                    )
                if kind == h5py.h5l.TYPE_HARD:
                    about = h5py.h5o.get_info(group, link)
                    if about.type == h5py.h5o.TYPE_GROUP and about.addr not in self._searched:
                        waiting.append(h5py.h5o.open(group, link))

    def _follow_link(self, name: str, parent: str, group: Any, link: bytes, depth: int) -> None:
        """The target of a symbolic link; none where the links form a loop."""
        import h5py

        try:
            node = h5py.h5o.open(group, link)
        except (KeyError, OSError, RuntimeError, ValueError):
            self.table.skipped[_full(parent, name)] = "a link to nothing"
        else:
            self._visit(name, parent, node, depth)

    def _enter(self, group: Any, parent: str, depth: int) -> None:
        import h5py

        for link in group:
            name = _shown(link)
            if not parent and name.startswith("#"):  # #refs#, #subsystem#: MATLAB's internal data
                continue
            if len(link) > _LONGEST_ATTRIBUTE:
                self.table.skipped[_full(parent, shortened(name))] = "its name is too long"
            elif group.links.get_info(link).type == h5py.h5l.TYPE_SOFT:
                self._later.append(partial(self._follow_link, name, parent, group, link, depth))
            else:
                self._visit(name, parent, h5py.h5o.open(group, link), depth)

    def _visit(self, name: str, parent: str, node: Any, depth: int) -> None:
        import h5py

        full, skipped = _full(parent, name), self.table.skipped
        address = _address(node)
        if address in self._seen:
            skipped[full] = f"the same object as {self._seen[address]}"
            return
        self._seen[address] = full
        if h5py.h5a.exists(node, b"MATLAB_object_decode"):
            is_group = isinstance(node, h5py.h5g.GroupID)
            whole = h5py.Group(node) if is_group else h5py.Dataset(node)
            kind = str(_attribute(whole, b"MATLAB_class") or "")
            self.objects[full] = kind
            skipped[full] = reason(full, kind, self.table.path)
        elif depth > MOST_DEPTH:
            skipped[full] = "nested too deep"
        elif isinstance(node, h5py.h5g.GroupID):
            self._refuse_outside(node)
            self._enter(node, full, depth + 1)
        elif isinstance(node, h5py.h5d.DatasetID):
            self._take(name, parent, h5py.Dataset(node), depth)

    def _take(self, name: str, parent: str, node: Any, depth: int) -> None:
        """A data set: to be read, followed where it holds references, or skipped."""
        import h5py

        full, skipped, path = _full(parent, name), self.table.skipped, self.table.path
        if node.external:
            raise input_error(path, f"the values of {full!r} are in another file", _OUTSIDE)
        if node.is_virtual:
            if any(source.file_name != "." for source in node.virtual_sources()):
                raise input_error(path, f"{full!r} gathers values of other files", _OUTSIDE)
            skipped[full] = "virtual: its values are those of other data sets"
            return
        try:
            dtype = node.dtype
        except TypeError:  # numpy has no such type
            skipped[full] = "of an unknown type"
            return
        kind = _attribute(node, b"MATLAB_class")
        if node.shape is None or _attribute(node, b"MATLAB_empty") not in (None, 0):
            skipped[full] = "empty"
        elif h5py.check_ref_dtype(dtype) is h5py.Reference:
            self._later.append(partial(self._follow, name, parent, node, depth, kind == "cell"))
        elif fields := _fields_of_numbers(dtype):
            others = [field_name for field_name in dtype.names if field_name not in fields]
            skipped |= {_full(full, field_name): "no number" for field_name in others}
            self._count_records(full, node, fields)
            self.wanted.append((full, node))
        elif kind == "char" or dtype.kind not in "fiub":
            skipped[full] = "text" if kind == "char" else f"of type {_kind(dtype)}"
        else:
            self._count(full, node)
            self.wanted.append((full, node))

    def _follow(self, name: str, parent: str, node: Any, depth: int, is_cell: bool) -> None:
        """Targets of a data set's references: a cell's elements, or a field of structs."""
        import h5py

        full = _full(parent, name)
        if node.size > MOST_COLUMNS:  # each would be a column of its own
            self.table.skipped[full] = f"of more than {MOST_COLUMNS:,} elements"
            return
        self._count(full, node)
        _check_packed(self.table.path, full, node)
        addresses = np.zeros(node.shape, dtype=f"V{h5py.h5t.STD_REF_OBJ.get_size()}")
        every = h5py.h5s.ALL
        # As addresses: an object for each of a cell's elements would be large.
        node.id.read(every, every, addresses, h5py.h5t.STD_REF_OBJ)
        # MATLAB's (n, m) is stored as (m, n): C order here is the order of its elements.
        known, first, times = np.unique(
            addresses.view(np.uint64).ravel(), return_index=True, return_counts=True
        )
        again = int(np.sum(times[known != 0] - 1))
        for index in sorted(first[known != 0].tolist()):
            reference = node[np.unravel_index(index, node.shape)]
            target = h5py.h5r.dereference(reference, self.file.id)
            if is_cell:
                self._visit(f"{name}{{{index + 1}}}", parent, target, depth + 1)
            else:
                self._visit(name, f"{parent}({index + 1})", target, depth + 1)
        if again:
            self.table.skipped[full] = f"{again} of its elements are the same again"

    def _count(self, full: str, node: Any) -> None:
        """InputError where a data set, or one of its chunks, is beyond the bound of cells."""
        if node.chunks is not None:  # a chunk is read whole, and may be larger than its data set
            Cells(self.table.path).add(math.prod(node.chunks), f"a chunk of data set {full}")
            self._count_chunks(full, node)
        self.cells.add(node.size, f"data set {full}")

    def _count_chunks(self, full: str, node: Any) -> None:
        """InputError where chunks, each of which takes its time however small, are too many."""
        self._chunks += math.prod(_chunks(node))
        if self._chunks > (most := most_cells() // _CELLS_A_CHUNK):
            raise input_error(
                self.table.path,
                f"has {self._chunks:,} chunks up to data set {full}, more than the {most:,} that "
                "are read",
                f"save it with larger chunks (h5py: chunks=True), or raise {VARIABLE}",
            )

    def _count_records(self, full: str, node: Any, fields: list[str]) -> None:
        """InputError where the fields of a compound data set are beyond the bound of cells."""
        check_columns(self.table.path, len(node.dtype.names))
        if node.chunks is not None:
            width = _eighths(node.dtype.itemsize)
            Cells(self.table.path).add(math.prod(node.chunks) * width, f"a chunk of {full}")
            self._count_chunks(full, node)
        width = sum(_eighths(node.dtype.fields[name][0].itemsize) for name in fields)
        self.cells.add(node.size * width, f"data set {full}")


def _eighths(size: int) -> int:
    """Bytes as cells."""
    return -(-size // np.dtype(np.float64).itemsize)


def _check_packed(path: Path, name: str, node: Any) -> None:
    """InputError where a chunk unpacks to more than a chunk: the library would unpack it all."""
    import h5py

    made = node.id.get_create_plist()
    filters = [made.get_filter(number)[0] for number in range(made.get_nfilters())]
    if h5py.h5z.FILTER_DEFLATE not in filters:
        return
    last = len(filters) - 1 - filters[::-1].index(h5py.h5z.FILTER_DEFLATE)
    most = math.prod(node.chunks) * node.id.get_type().get_size()
    if h5py.h5z.FILTER_DEFLATE in filters[:last] or set(filters[last + 1 :]) - {
        h5py.h5z.FILTER_FLETCHER32
    }:
        raise input_error(path, f"data set {name} is packed twice", "save it with one filter")

    stored: list[Any] = []
    node.id.chunk_iter(stored.append)
    for chunk in stored:
        if chunk.filter_mask & (1 << last):
            continue
        unpacking = zlib.decompressobj()
        unpacking.decompress(
            node.id.read_direct_chunk(chunk.chunk_offset)[1], most + _LONGEST_ATTRIBUTE
        )
        if unpacking.unconsumed_tail:
            raise input_error(
                path,
                f"a chunk of data set {name} unpacks to more than its {most:,} bytes",
                "copy the file again from where it was recorded",
            )


def _attribute(node: Any, name: bytes) -> Any:
    """The one text or number of an attribute; None without it, or where it is anything else."""
    import h5py

    if not h5py.h5a.exists(node.id, name):
        return None
    attribute = h5py.h5a.open(node.id, name)
    is_one = attribute.get_space().get_simple_extent_npoints() == 1
    if not is_one or attribute.get_storage_size() > _LONGEST_ATTRIBUTE:
        return None
    value = node.attrs[name.decode()]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value


def _address(node: Any) -> int:
    import h5py

    return int(h5py.h5o.get_info(node).addr)


def _full(parent: str, name: str) -> str:
    return f"{parent}.{name}" if parent else name


def _shown(name: bytes) -> str:
    return name.decode("utf-8", "surrogateescape")


def _kind(dtype: Any) -> str:
    """A type in words, without a compound type's fields."""
    return "compound" if dtype.names else str(dtype)
