"""The firmware file: the boot stream that the boot loader of a TI C28x processor takes over its serial line.

Numbers are 16-bit words, low byte first: the key 0x08AA, eight reserved words, the entry address, then blocks of
(size, address, words...) until a size of zero, which ends it.  The arm's firmware belongs to its maker and is not part
of this package; users name their own file.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

KEY = b"\xaa\x08"
_RESERVED = 16


class Block(NamedTuple):
    """A piece of memory: its address and its words."""

    address: int
    words: tuple[int, ...]


class Image(NamedTuple):
    """A whole boot stream: its bytes as they are sent, the entry address, and its blocks."""

    data: bytes
    entry: int
    blocks: tuple[Block, ...]


def parse(data: bytes) -> Image:
    """Check a boot stream from its key to its last byte.

    Raises
    ------
    ValueError
        If the stream is not valid; the message says at which byte.
    """
    if data[:1] == b"A" and data[1:3] == KEY:  # some files begin with the autobaud letter, which is sent separately
        data = data[1:]
    if data[:2] != KEY:
        raise ValueError(f"it begins with {data[:2].hex(' ') or 'nothing'}, a C28x boot stream begins with aa 08")
    at = 2 + _RESERVED
    entry, at = _address(data, at)
    blocks: list[Block] = []
    while True:
        (size,) = _words(data, at, 1)
        at += 2
        if not size:
            break
        address, at = _address(data, at)
        blocks.append(Block(address, _words(data, at, size)))
        at += 2 * size
    if at != len(data):
        raise ValueError(f"{len(data) - at} bytes follow the end of the boot stream at byte {at}")
    if not blocks:
        raise ValueError("the boot stream holds no block")
    return Image(data, entry, tuple(blocks))


def _words(data: bytes, at: int, count: int) -> tuple[int, ...]:
    if at + 2 * count > len(data):
        raise ValueError(f"it ends at byte {len(data)} in the middle of a block, {at + 2 * count} are due")
    return struct.unpack_from(f"<{count}H", data, at)


def _address(data: bytes, at: int) -> tuple[int, int]:
    high, low = _words(data, at, 2)
    return high << 16 | low, at + 4


def build(blocks: Sequence[Block], *, entry: int) -> bytes:
    """Return the boot stream of some blocks; tests build images without code with it."""
    parts = [KEY, bytes(_RESERVED), struct.pack("<2H", entry >> 16, entry & 0xFFFF)]
    for block in blocks:
        size = len(block.words)
        parts.append(struct.pack(f"<3H{size}H", size, block.address >> 16, block.address & 0xFFFF, *block.words))
    return b"".join((*parts, b"\0\0"))


def load(firmware: str | Path | bytes) -> Image:
    """Read and check a firmware file, or the bytes of one.

    Raises
    ------
    ValueError
        If it can't be read or is not a boot stream; the message names the file.
    """
    if isinstance(firmware, bytes):
        name, data = "the firmware", firmware
    else:
        name = f"firmware file '{firmware}'"
        if not Path(firmware).is_file() and Path(firmware).exists():
            raise ValueError(f"{name} cannot be read: it is a folder, a pipe, a device or a socket, not a file")
        try:
            data = Path(firmware).read_bytes()
        except OSError as error:
            raise ValueError(f"{name} cannot be read: {error.strerror or error}") from error
    try:
        return parse(data)
    except ValueError as error:
        raise ValueError(f"{name} is not valid: {error}") from error
