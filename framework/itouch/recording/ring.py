"""Shared memory between the loop and the writing process: a ring of rows of fixed size, one of messages of any size.

The loop writes, the other process reads; there are no locks.  Each side owns its counters, which only increase, and
writes them after the data (stores keep their order on the processors that we run on).
"""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass

from itouch.platforms import Memory

_PAGE = 4096
_ALIGN = 8
#: Kind of a letter that only fills the rest of the ring.
_FILL = 0xFFFFFFFF


class ControlWord(enum.IntEnum):
    """Places of the numbers in the first page."""

    ROWS_IN = 0
    ROWS_OUT = 1
    LETTERS_IN = 2
    LETTERS_OUT = 3
    CLOSING = 4
    LOST = 5
    STATUS = 6
    ERRNO = 7
    ROWS_WRITTEN = 8
    BYTES_WRITTEN = 9
    PROCESS = 10


class Phase(enum.IntEnum):
    """State of the writing process."""

    STARTING = 0
    RECORDING = 1
    FAILED = 2
    DONE = 3


_TEXT = 1024


@dataclass(frozen=True, slots=True)
class Shape:
    """Sizes: number of rows, bytes of a row, bytes for letters; all are powers of two or multiples of eight."""

    rows: int
    row: int
    letters: int

    @property
    def total(self) -> int:
        """Bytes in all."""
        return _PAGE + self.rows * (8 + self.row) + self.letters


class Ring:
    """One block of shared memory that both processes map."""

    def __init__(self, shape: Shape, memory: Memory) -> None:
        self.shape, self.shared = shape, memory
        self._memory = memory.map(shape.total)
        self.view = memoryview(self._memory)
        self.words = self.view[:_PAGE].cast("Q")
        ticks = _PAGE + shape.rows * 8
        self.ticks = self.view[_PAGE:ticks].cast("q")
        self.rows = self.view[ticks : ticks + shape.rows * shape.row]
        self.letters = self.view[ticks + shape.rows * shape.row : shape.total]

    @classmethod
    def create(cls, shape: Shape) -> Ring:
        """Make the memory; it leaves nothing behind when both processes have ended."""
        ring = cls(shape, Memory.create("itouch-recording", shape.total))
        ring.view[::_PAGE] = bytes(len(range(0, shape.total, _PAGE)))  # page faults now, not in a tick
        return ring

    def close(self) -> None:
        """Release the memory."""
        for view in (self.words, self.ticks, self.rows, self.letters, self.view):
            view.release()
        self._memory.close()
        self.shared.close()

    def forget(self) -> None:
        """Close the file descriptor, once the other process has it; the memory stays."""
        self.shared.forget()

    def post(self, kind: int, data: bytes) -> bool:
        """Add a letter; return False if there is no room for it."""
        size = (8 + len(data) + _ALIGN - 1) // _ALIGN * _ALIGN
        begin, room = self.words[ControlWord.LETTERS_IN], self.shape.letters
        free = room - (begin - self.words[ControlWord.LETTERS_OUT])
        rest = room - begin % room
        if size > (free if size <= rest else free - rest):
            return False
        if size > rest:
            struct.pack_into("<II", self.letters, begin % room, rest - 8, _FILL)
            begin += rest
        at = begin % room
        struct.pack_into("<II", self.letters, at, len(data), kind)
        self.letters[at + 8 : at + 8 + len(data)] = data
        self.words[ControlWord.LETTERS_IN] = begin + size
        return True

    def take(self) -> tuple[int, bytes] | None:
        """Take the oldest letter, or None if there is none."""
        begin, room = self.words[ControlWord.LETTERS_OUT], self.shape.letters
        while begin < self.words[ControlWord.LETTERS_IN]:
            at = begin % room
            length, kind = struct.unpack_from("<II", self.letters, at)
            data = bytes(self.letters[at + 8 : at + 8 + length]) if kind != _FILL else b""
            begin += (8 + length + _ALIGN - 1) // _ALIGN * _ALIGN
            self.words[ControlWord.LETTERS_OUT] = begin
            if kind != _FILL:
                return kind, data
        return None

    @property
    def phase(self) -> Phase:
        """State of the writing process."""
        return Phase(self.words[ControlWord.STATUS])

    def say(self, phase: Phase, errno: int = 0, text: str = "") -> None:
        """Report the state of the writing process to the other side, with the cause if it failed."""
        data = text.encode()[: _PAGE - _TEXT - 2]
        self.view[_TEXT : _TEXT + 2 + len(data)] = struct.pack("<H", len(data)) + data
        self.words[ControlWord.ERRNO] = errno
        self.words[ControlWord.STATUS] = phase

    @property
    def text(self) -> str:
        """Why writing failed."""
        (length,) = struct.unpack_from("<H", self.view, _TEXT)
        return bytes(self.view[_TEXT + 2 : _TEXT + 2 + length]).decode(errors="replace")
