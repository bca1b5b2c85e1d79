"""Packed blocks, unpacked only as far as their file says: a small one may hold a huge one."""

from __future__ import annotations

import bz2
import zlib
from pathlib import Path

from sysid.errors import InputError, input_error
from sysid.io.bounds import VARIABLE, most_cells


def unpacked(path: Path, what: str, packed: bytes, method: str, declared: int | None) -> bytes:
    """The bytes of a block packed by `method`: "", "none", "zstd", "lz4", "bz2" or "zlib".

    `declared` is how many the file says they are, None where it does not. Raises InputError where
    they are more, or more than a block may have; what the method's library raises on damage.
    """
    most = most_cells() if declared is None else declared
    if most > most_cells():
        raise _too_large(path, what)
    found = packed if method in ("", "none") else _unpack(packed, method, most + 1)
    if len(found) > most:
        raise _too_large(path, what)
    if declared is not None and len(found) != declared:
        raise ValueError(f"{what} unpacks to {len(found):,} bytes, not {declared:,}")
    return found


def _unpack(packed: bytes, method: str, most: int) -> bytes:
    """At most so many bytes of a packed block."""
    if method == "zlib":
        return zlib.decompressobj().decompress(packed, most)
    if method == "bz2":
        return bz2.BZ2Decompressor().decompress(packed, most)
    if method == "lz4":
        import lz4.frame

        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, most))
    if method == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(packed) as stream:
            return bytes(stream.read(most))
    raise ValueError(f"packed by {method!r}, which is not known")


def _too_large(path: Path, what: str) -> InputError:
    return input_error(
        path,
        f"{what} unpacks to more than {most_cells():,} bytes, or to more than it says",
        f"copy the file again from where it was recorded, or raise {VARIABLE}",
    )


__all__ = ["unpacked"]
