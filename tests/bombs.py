"""Small files that ask their reader for more than they hold, or for other files."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

MANY = 400_000_000
Maker = Callable[[Path], None]


def packed_zeros(head: bytes, zeros: int) -> bytes:
    """`head` and so many zeros, as one zlib stream (without its check sum)."""
    packing, size = zlib.compressobj(), 1 << 22
    start = packing.compress(head) + packing.flush(zlib.Z_FULL_FLUSH)
    # After a full flush every block is packed alike.
    block = packing.compress(bytes(size)) + packing.flush(zlib.Z_FULL_FLUSH)
    return start + block * (zeros // size)


# --- HDF5 --------------------------------------------------------------------------------------


def never_written(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("p", (MANY,), dtype="f8", compression="gzip", chunks=(1 << 20,))


def never_written_by_parts(path: Path) -> None:
    with h5py.File(path, "w") as file:
        for number in range(40):
            file.create_dataset(f"p{number}", (10_000_000,), dtype="u1", chunks=(1 << 20,))


def not_in_chunks(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("p", (2 * MANY,), dtype="f4")


def large_chunk(path: Path) -> None:
    with h5py.File(path, "w") as file:
        more = {"maxshape": (None,), "chunks": (MANY,), "compression": "gzip"}
        file.create_dataset("p", (3,), dtype="f4", **more)


def deflated_beyond_its_chunk(path: Path) -> None:
    with h5py.File(path, "w") as file:
        data = file.create_dataset("p", (100,), dtype="f8", chunks=(100,), compression="gzip")
        data.id.write_direct_chunk((0,), packed_zeros(b"", 1 << 31))


def many_objects(path: Path) -> None:
    with h5py.File(path, "w", libver="latest") as file:
        first = file.create_group("g0")
        for number in range(101_000):
            h5py.h5g.create(first.id, str(number).encode())


def many_records(path: Path) -> None:
    sample = np.dtype([("time", "f8"), ("p", "f8")])
    with h5py.File(path, "w") as file:
        file.create_dataset("compound", (MANY,), dtype=sample, chunks=(1 << 10,))


def many_chunks(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("p", (2_000_000,), dtype="f8", chunks=(1,))


HDF5_BOMBS: dict[str, Maker] = {
    "never-written": never_written,
    "never-written-by-parts": never_written_by_parts,
    "not-in-chunks": not_in_chunks,
    "large-chunk": large_chunk,
    "deflated": deflated_beyond_its_chunk,
    "many-objects": many_objects,
    "many-records": many_records,
    "many-chunks": many_chunks,
}


def other_raw_storage(path: Path) -> None:
    other = path.with_name("other.bin")
    other.write_bytes(np.full(100, 4711.5).tobytes())
    with h5py.File(path, "w") as file:
        whole = [(str(other), 0, h5py.h5f.UNLIMITED)]
        file.create_dataset("time_s", (100,), dtype="f8", external=whole)


def other_file(path: Path) -> Path:
    other = path.with_name("other.h5")
    with h5py.File(other, "w") as file:
        file["values"] = np.full(100, 4711.5)
    return other


def other_link(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["time_s"] = h5py.ExternalLink(str(other_file(path)), "/values")


def other_link_behind_a_link(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["#hidden/there"] = h5py.ExternalLink(str(other_file(path)), "/")
        file["time_s"] = h5py.SoftLink("/#hidden/there/values")


def other_virtual_source(path: Path) -> None:
    layout = h5py.VirtualLayout((100,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(other_file(path)), "values", (100,))
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("time_s", layout)


def other_behind_a_reference(path: Path) -> None:
    with h5py.File(path, "w") as file:
        store = file.create_group("#refs#")
        whole = [(str(path.with_name("other.bin")), 0, h5py.h5f.UNLIMITED)]
        store.create_dataset("a", (100,), dtype="f8", external=whole)
        cells = file.create_dataset("cells", (1, 1), dtype=h5py.ref_dtype)
        cells[0, 0] = store["a"].ref
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
    path.with_name("other.bin").write_bytes(np.full(100, 4711.5).tobytes())


OUTSIDE: dict[str, Maker] = {
    "raw-storage": other_raw_storage,
    "link": other_link,
    "link-behind-a-link": other_link_behind_a_link,
    "virtual": other_virtual_source,
    "reference": other_behind_a_reference,
}


def soft_ring(file: h5py.File) -> None:
    group = file.create_group("g")
    for number in range(8):
        group[f"again{number}"] = h5py.SoftLink("/g")
    file["one"], file["two"] = h5py.SoftLink("/two"), h5py.SoftLink("/one")
    file["nothing"] = h5py.SoftLink("/not/there")


def hard_ring(file: h5py.File) -> None:
    groups = [file.create_group(f"g{number}") for number in range(8)]
    for group in groups:
        for number, other in enumerate(groups):
            group[f"to{number}"] = other
        group["root"] = file["/"]


def reference_ring(file: h5py.File) -> None:
    cells = [file.create_dataset(f"c{n}", (8, 1), dtype=h5py.ref_dtype) for n in range(8)]
    for cell in cells:
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
        for number, other in enumerate(cells):
            cell[number, 0] = other.ref


def one_object_again_and_again(file: h5py.File) -> None:
    for name, count in (("cells", 90_000), ("many", MANY)):
        kind = {"dtype": h5py.ref_dtype, "chunks": (10_000,), "compression": "gzip"}
        cells = file.create_dataset(name, (count,), **kind)
        cells.attrs["MATLAB_class"] = np.bytes_("cell")
        cells[:1000] = np.full(1000, file["time_s"].ref, dtype=h5py.ref_dtype)


def virtual_ring(file: h5py.File) -> None:
    for here, there in (("v", "w"), ("w", "v"), ("self", "self")):
        layout = h5py.VirtualLayout((MANY,), dtype="f8")
        layout[:] = h5py.VirtualSource(".", there, (MANY,))
        file.create_virtual_dataset(here, layout)


def other_types(file: h5py.File) -> None:
    file.create_dataset("text", (MANY,), dtype="S1000", chunks=(1 << 10,))
    file.create_dataset("one-text", (1,), dtype=h5py.string_dtype(length=2_000_000_000))
    file.create_dataset("array", (MANY,), dtype=np.dtype(("f8", (1000,))), chunks=(1 << 10,))
    file["scalar"], file["none"] = 1.5, h5py.Empty("f8")
    file["time_s"].attrs.create("MATLAB_class", np.zeros(7000, dtype="u8"))
    file["scalar"].attrs.create("MATLAB_empty", ["x" * 1000] * 1000)


HARMLESS: dict[str, Callable[[h5py.File], None]] = {
    "soft-ring": soft_ring,
    "hard-ring": hard_ring,
    "reference-ring": reference_ring,
    "one-object": one_object_again_and_again,
    "virtual-ring": virtual_ring,
    "other-types": other_types,
}


def hdf5_with(path: Path, more: Callable[[h5py.File], None]) -> None:
    """A log of 100 rows, and what is to be left out."""
    with h5py.File(path, "w", libver="latest") as file:
        file["time_s"] = np.arange(100) / 1000.0
        more(file)


# --- Parquet -----------------------------------------------------------------------------------


def parquet_rows(path: Path, column: pa.Array, groups: int) -> None:
    """The same rows as so many row groups."""
    table = pa.table({"time_s": column})
    with parquet.ParquetWriter(path, table.schema, compression="zstd") as writer:
        for _ in range(groups):
            writer.write_table(table, row_group_size=len(table))


def parquet_dictionary(path: Path) -> None:
    parquet_rows(path, pa.array(np.zeros(20_000_000, dtype="f4")), 10)


def parquet_many_groups(path: Path) -> None:
    parquet_rows(path, pa.array(np.zeros(200_000, dtype="u1")), 1000)


def parquet_many_columns(path: Path) -> None:
    column = pa.array(np.zeros(1))
    parquet.write_table(pa.table({f"c{n}": column for n in range(101_000)}), path)


def parquet_recurring_text(path: Path) -> None:
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(1_000_000, "i4")), ["x" * 100_000])
    parquet.write_table(pa.table({"time_s": column}), path)


def parquet_recurring_plain_text(path: Path) -> None:
    """The same, without the note that the column was a dictionary."""
    column = pa.DictionaryArray.from_arrays(pa.array(np.zeros(1_000_000, "i4")), ["x" * 100_000])
    parquet.write_table(pa.table({"time_s": column}), path, store_schema=False)


PARQUET_BOMBS: dict[str, Maker] = {
    "dictionary": parquet_dictionary,
    "many-groups": parquet_many_groups,
    "many-columns": parquet_many_columns,
    "recurring-text": parquet_recurring_text,
    "recurring-plain-text": parquet_recurring_plain_text,
}


# --- MATLAB, version 5 -------------------------------------------------------------------------

HEAD = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<2I", kind, len(data)) + data + bytes(-len(data) % 8)


def array_head(kind: int, sizes: tuple[int, ...]) -> bytes:
    return (
        element(6, struct.pack("<2I", kind, 0))
        + element(5, struct.pack(f"<{len(sizes)}I", *sizes))
        + element(1, b"x")
    )


def matrix(content: bytes, zeros: int = 0) -> bytes:
    """A variable, and so many zeros behind it, packed."""
    head = struct.pack("<2I", 14, len(content) + zeros)
    packed = packed_zeros(head + content, zeros)
    return HEAD + struct.pack("<2I", 15, len(packed)) + packed


def mat_bytes(sizes: tuple[int, ...], zeros: int) -> bytes:
    """An array of doubles that is stored as bytes, all 0."""
    return matrix(array_head(6, sizes) + struct.pack("<2I", 2, zeros), zeros)


def mat_zeros(path: Path) -> None:
    path.write_bytes(mat_bytes((1 << 28, 1), 1 << 28))


def mat_beyond_its_sizes(path: Path) -> None:
    path.write_bytes(mat_bytes((3, 1), 1 << 30))


def mat_cells(path: Path) -> None:
    path.write_bytes(matrix(array_head(1, (MANY, 1))))


def mat_struct(path: Path) -> None:
    head = array_head(2, (MANY, 1)) + element(5, struct.pack("<I", 32)) + element(1, b"")
    path.write_bytes(matrix(head))


def mat_many_empty_arrays(path: Path) -> None:
    """So many tags of empty arrays follow."""
    content = array_head(1, (90_000_000, 1)) + struct.pack("<2I", 14, 0) * 1000
    path.write_bytes(matrix(content))


def mat_sparse(path: Path) -> None:
    empty = element(5, b"") + element(5, struct.pack("<2I", 0, 0)) + element(9, b"")
    path.write_bytes(matrix(array_head(5, (MANY, 1)) + empty))


def mat_within_a_cell(path: Path) -> None:
    inner = array_head(6, (1 << 28, 1)) + struct.pack("<2I", 2, 1 << 28)
    head = array_head(1, (1, 1)) + struct.pack("<2I", 14, len(inner) + (1 << 28))
    path.write_bytes(matrix(head + inner, 1 << 28))


def mat_version_4(path: Path) -> None:
    # A sparse matrix: the last row of its values gives its size.
    rows = np.array([[1.0, 1.0, 1.0], [2e4, 2e4, 0.0]])
    path.write_bytes(struct.pack("<5i", 2, 2, 3, 0, 2) + b"x\0" + rows.tobytes("F"))


MAT_BOMBS: dict[str, Maker] = {
    "zeros": mat_zeros,
    "beyond-its-sizes": mat_beyond_its_sizes,
    "cells": mat_cells,
    "struct": mat_struct,
    "many-empty-arrays": mat_many_empty_arrays,
    "sparse": mat_sparse,
    "within-a-cell": mat_within_a_cell,
    "version-4": mat_version_4,
}


# --- TDMS ---------------------------------------------------------------------------------------


def tdms_segment(values: int, kind: int, raw: bytes, offset: int | None = None) -> bytes:
    """One channel; `kind` 10: doubles, 0: nothing, 5: bytes."""
    name = b"/'run'/'p'"
    index = struct.pack("<IIIQ", 20, kind, 1, values)
    content = struct.pack("<II", 1, len(name)) + name + index + struct.pack("<I", 0)
    whole = len(content) + len(raw) if offset is None else offset
    return b"TDSm" + struct.pack("<IIQQ", 14, 4713, whole, len(content)) + content + raw


def tdms_of_nothing(path: Path) -> None:
    path.write_bytes(tdms_segment(10 * MANY, 0, b""))


def tdms_with_a_hole(path: Path) -> None:
    path.write_bytes(tdms_segment(MANY, 5, b"", MANY + 100))
    with path.open("r+b") as file:
        file.truncate(28 + MANY + 100)


TDMS_BOMBS: dict[str, Maker] = {
    "of-nothing": tdms_of_nothing,
    "with-a-hole": tdms_with_a_hole,
}


# --- Excel -------------------------------------------------------------------------------------

SHEET = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
PACKAGE = "http://schemas.openxmlformats.org/package/2006/relationships"


def workbook(path: Path, sheet: str) -> None:
    """A workbook of one sheet with this content."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(
            "xl/workbook.xml",
            f'<workbook xmlns="{SHEET}" xmlns:r="{OFFICE}">'
            '<sheets><sheet name="s" sheetId="1" r:id="r1"/></sheets></workbook>',
        )
        archive.writestr(
            "xl/_rels/workbook.xml.rels",
            f'<Relationships xmlns="{PACKAGE}"><Relationship Id="r1" Type="{OFFICE}/worksheet" '
            'Target="worksheets/sheet1.xml"/></Relationships>',
        )
        archive.writestr("xl/worksheets/sheet1.xml", f'<worksheet xmlns="{SHEET}">{sheet}')


def excel_far_cell(path: Path) -> None:
    cell = '<row r="{0}"><c r="{1}{0}"><v>1</v></c></row>'
    rows = cell.format(1, "A") + cell.format(1_048_576, "XFD")
    workbook(path, f'<dimension ref="A1:XFD1048576"/><sheetData>{rows}</sheetData></worksheet>')


def excel_many_rows(path: Path) -> None:
    workbook(path, f"<sheetData>{'<row/>' * 2_000_000}</sheetData></worksheet>")


def excel_long_text(path: Path) -> None:
    text = f'<c t="inlineStr"><is><t>{"x" * 200_000_000}</t></is></c>'
    workbook(path, f"<sheetData><row>{text}</row></sheetData></worksheet>")


EXCEL_BOMBS: dict[str, Maker] = {
    "far-cell": excel_far_cell,
    "many-rows": excel_many_rows,
    "long-text": excel_long_text,
}


# --- text --------------------------------------------------------------------------------------


def text_with_a_hole(path: Path) -> None:
    path.write_bytes(b"time_s,p\n0,1\n")
    with path.open("r+b") as file:
        file.truncate(50_000_000_000)


def text_of_one_line(path: Path) -> None:
    path.write_bytes(b"time_s,p\n0,1\n" + b"1," * 20_000_000)


def text_of_line_ends(path: Path) -> None:
    path.write_bytes(b"time_s,p\n0,1\n" + b"\n" * 101_000_000)


def text_of_short_rows(path: Path) -> None:
    names = ["time_s", "p", *(f"c{number}" for number in range(2, 10_000))]
    wide = [",".join(names), ",".join(["1"] * 10_000)]
    path.write_text("\n".join([*wide, *[wide[1]] * 300, *["1"] * 20_000, ""]))


TEXT_BOMBS: dict[str, Maker] = {
    "with-a-hole": text_with_a_hole,
    "of-one-line": text_of_one_line,
    "of-line-ends": text_of_line_ends,
    "of-short-rows": text_of_short_rows,
}
