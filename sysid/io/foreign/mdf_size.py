"""What an MDF file (versions 3 and 4) declares, read before asammdf loads it.

asammdf follows each list of blocks to its end and unpacks each block whole. So the lists are
followed first: each block once, none in a ring, and no packed block may hold more than it says.

Source: ASAM MDF 4.1 and 3.3, layouts of the blocks HD, DG, CG, CN, HL, DL, LD, DZ.
"""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from sysid.io.bounds import Cells, check_columns
from sysid.io.file_kinds import damaged
from sysid.io.foreign.unpacking import unpacked

_FILE_HEAD = struct.Struct("<8s8s8sHHHH28sHH")  # ID; HD follows it
_BLOCK_HEAD = struct.Struct("<4sxxxxQQ")  # kind, length, number of links
# DZ: type of the packed block, how, and the two lengths.
_PACKED = struct.Struct("<2sBBIQQ")
_HOW = {0: "zlib", 1: "zlib", 2: "zstd", 3: "zstd", 4: "lz4", 5: "lz4"}
# CG: record's id, samples, flags, bytes of values and of validity; CN: type, synchronisation, data
# type, place in the record, length, flags, place of its validity.
_GROUP = struct.Struct("<QQHxxxxxxII")
_CHANNEL = struct.Struct("<BBBBIIII")


def check_size(path: Path, file: BinaryIO) -> None:
    """InputError where an MDF file has more cells than are read, or blocks that lead nowhere."""
    file.seek(0)
    head = file.read(_FILE_HEAD.size)
    size = file.seek(0, os.SEEK_END)
    blocks = _Blocks(path, file, size, Cells(path))
    major = struct.unpack_from("<H", head, 28)[0] // 100 if len(head) == _FILE_HEAD.size else 0
    if major >= 4:
        _Four(blocks).walk()
    else:
        _Three(blocks, "<" if head[24:26] == b"\0\0" else ">").walk()


@dataclass
class _Blocks:
    """An open file whose blocks are each visited once."""

    path: Path
    file: BinaryIO
    size: int
    cells: Cells
    channels: int = 0
    _seen: set[int] = field(default_factory=set)

    def at(self, place: int, count: int) -> bytes:
        """So many bytes from a place on."""
        if place < 0 or place + count > self.size:
            raise self.damage("a block lies beyond its end")
        self.file.seek(place)
        return self.file.read(count)

    def visit(self, place: int) -> None:
        """Note that the block at an offset was visited; InputError if it was before."""
        if place in self._seen:
            raise self.damage("its blocks form a loop")
        self._seen.add(place)

    def group(self, channels: int, cycles: int, where: str) -> None:
        """Count a group of channels with this number of samples each."""
        self.channels += channels
        check_columns(self.path, self.channels)
        self.cells.add(channels * cycles, where)

    def damage(self, reason: str) -> Exception:
        """The error for a file with such a fault."""
        return damaged(self.path, "an MDF file", reason)


@dataclass(frozen=True)
class _Record:
    """The bytes of values and of their validity in a group's record."""

    values: int
    invalid: int


class _Four:
    """The blocks of MDF 4: an identifier, the number of links, the links, the data."""

    def __init__(self, blocks: _Blocks) -> None:
        self._blocks = blocks

    def walk(self) -> None:
        """All groups, their channels and their data."""

        from asammdf.blocks.v4_constants import FLAG_CG_REMOTE_MASTER, FLAG_CG_VLSD

        links, _ = self._block(_FILE_HEAD.size, b"##HD", 0)
        groups = 0
        self._record = _Record(0, 0)
        for dg, _ in self._chain(links[0], b"##DG", 0):
            wanted, is_whole = 0, True
            for cg, data in self._chain(dg[1], b"##CG", _GROUP.size):
                groups += 1
                _, cycles, flags, values, invalid = _GROUP.unpack(data)
                self._record = _Record(values, invalid)
                channels = self._channels(cg[1], 0)
                self._blocks.group(channels, cycles, f"group {groups}")
                wanted += cycles * (values + invalid)
                is_whole = is_whole and not flags & (FLAG_CG_VLSD | FLAG_CG_REMOTE_MASTER)
            total = self._data(dg[2])
            # Those of varying length, or with their master elsewhere, are counted otherwise.
            if is_whole and total < wanted:
                raise self._blocks.damage(f"group {groups} has fewer samples than it says")
        for chain in (links[1], links[3], links[4]):  # history, attachments, events
            for _ in self._chain(chain, b"##", 0):
                pass

    def _block(self, place: int, kind: bytes, count: int) -> tuple[tuple[int, ...], bytes]:
        """A block's links, and the first `count` bytes of its data."""
        blocks = self._blocks
        head = blocks.at(place, _BLOCK_HEAD.size)
        number = struct.unpack_from("<Q", head, 16)[0]
        if not head.startswith(kind):
            raise blocks.damage(f"a block {head[:4]!r} where {kind.decode()} is due")
        if number > (1 << 20):
            raise blocks.damage("a block has too many links")
        body = blocks.at(place + _BLOCK_HEAD.size, 8 * number + count)
        links = struct.unpack_from(f"<{number}Q", body)
        return links + (0,) * (6 - len(links)), body[8 * number :]

    def _chain(self, place: int, kind: bytes, count: int) -> list[tuple[tuple[int, ...], bytes]]:
        """The blocks of a list, each of which links to the next."""
        found = []
        while place:
            self._blocks.visit(place)
            found.append(self._block(place, kind, count))
            place = found[-1][0][0]
        return found

    def _channels(self, place: int, depth: int) -> int:
        """How many channels a list has, with those that are made up of others."""
        from asammdf.blocks import v4_constants as v4

        if depth > 16:
            raise self._blocks.damage("its channels are nested too deep")
        found = 0
        for links, data in self._chain(place, b"##CN", _CHANNEL.size):
            found += 1
            kind, _, _, bit, byte, bits, flags, invalid = _CHANNEL.unpack(data)
            in_record = kind not in (v4.CHANNEL_TYPE_VIRTUAL, v4.CHANNEL_TYPE_VIRTUAL_MASTER)
            if in_record and byte + (bit + bits + 7) // 8 > self._record.values:
                raise self._blocks.damage("a channel lies beyond its record")
            may_be_invalid = flags & v4.FLAG_CN_INVALIDATION_PRESENT
            if may_be_invalid and invalid >= 8 * self._record.invalid:
                raise self._blocks.damage("a channel's validity lies beyond its record")
            if links[1]:
                found += self._parts(links[1], depth)
        return found

    def _parts(self, place: int, depth: int) -> int:
        """The elements of a structure, or of an array (CA)."""
        if self._blocks.at(place, 4) == b"##CN":
            return self._channels(place, depth + 1)
        self._blocks.visit(place)
        links, data = self._block(place, b"##CA", 16)
        dimensions = struct.unpack_from("<H", data, 2)[0]
        head = self._blocks.at(place, _BLOCK_HEAD.size)
        start = place + _BLOCK_HEAD.size + 8 * struct.unpack_from("<Q", head, 16)[0] + 16
        sizes = struct.unpack(f"<{dimensions}Q", self._blocks.at(start, 8 * dimensions))
        count = 1
        for size in sizes:
            count *= size
            check_columns(self._blocks.path, count)
        return count + (self._parts(links[0], depth + 1) if links[0] else 0)

    def _data(self, place: int) -> int:
        """The bytes of a group's data: of one block, or of lists of them, some of them packed."""
        waiting, total = [place], 0
        while waiting:
            place = waiting.pop()
            if not place:
                continue
            self._blocks.visit(place)
            kind = self._blocks.at(place, 4)
            if kind == b"##DZ":
                total += self._packed(place)
            elif kind in (b"##HL", b"##DL", b"##LD"):
                links, _ = self._block(place, kind, 0)
                waiting += links
            elif kind in (b"##DT", b"##DV", b"##DI", b"##RD", b"##RV", b"##RI", b"##SD"):
                length = struct.unpack_from("<Q", self._blocks.at(place, _BLOCK_HEAD.size), 8)[0]
                self._blocks.at(place + max(length, 1) - 1, 1)
                total += max(length - _BLOCK_HEAD.size, 0)
            else:
                raise self._blocks.damage(f"a block {kind!r} where data are due")
        Cells(self._blocks.path).add(total // struct.calcsize("d"), "its data")
        return total

    def _packed(self, place: int) -> int:
        """The bytes of a packed block, of which it holds no more than it says."""
        head = self._blocks.at(place + _BLOCK_HEAD.size, _PACKED.size)
        _, method, _, _, length, stored = _PACKED.unpack(head)
        packed = self._blocks.at(place + _BLOCK_HEAD.size + _PACKED.size, stored)
        try:
            unpacked(self._blocks.path, "a block", packed, _HOW[method], length)
        except KeyError:
            raise self._blocks.damage(f"a block is packed in way {method}") from None
        return int(length)


class _Three:
    """The blocks of MDF 3: two letters, a length, links of four bytes and data."""

    def __init__(self, blocks: _Blocks, order: str) -> None:
        self._blocks, self._order = blocks, order

    def walk(self) -> None:
        """All groups and their channels."""
        place = self._at(_FILE_HEAD.size, b"HD", "I", 4)
        groups = 0
        while place:
            self._blocks.visit(place)
            following, group = self._at(place, b"DG", "I", 4), self._at(place, b"DG", "I", 8)
            while group:
                self._blocks.visit(group)
                groups += 1
                channels, channel = 0, self._at(group, b"CG", "I", 8)
                width, cycles = self._at(group, b"CG", "H", 20), self._at(group, b"CG", "I", 22)
                while channel:
                    self._blocks.visit(channel)
                    channels += 1
                    bit = self._at(channel, b"CN", "H", 186)
                    bits = self._at(channel, b"CN", "H", 188)
                    length = self._at(channel, b"CN", "H", 2)
                    more = self._at(channel, b"CN", "H", 226) if length >= 228 else 0
                    if more + (bit + bits + 7) // 8 > width:
                        raise self._blocks.damage("a channel lies beyond its record")
                    channel = self._at(channel, b"CN", "I", 4)
                self._blocks.group(channels, cycles, f"group {groups}")
                if cycles and self._at(place, b"DG", "I", 16) + width * cycles > self._blocks.size:
                    raise self._blocks.damage(f"group {groups} has fewer samples than it says")
                group = self._at(group, b"CG", "I", 4)
            place = following

    def _at(self, place: int, kind: bytes, form: str, offset: int) -> int:
        """A number of a block of a kind."""
        if self._blocks.at(place, 2) != kind:
            raise self._blocks.damage(f"another block where {kind.decode()} is due")
        data = self._blocks.at(place + offset, struct.calcsize(f"{self._order}{form}"))
        return int(struct.unpack(f"{self._order}{form}", data)[0])


__all__ = ["check_size"]
