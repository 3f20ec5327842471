"""The transfers on a device's wire, as readable text, one line per transfer, so that anyone can send us a trace.

A line has the time [s] since the trace began, the device's name, ``>`` for sent, ``<`` for received or ``#`` for a
remark, and the bytes: quoted if they are plain text, otherwise as hexadecimal pairs.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from typing import NamedTuple, TextIO

SENT, RECEIVED, REMARK = ">", "<", "#"
_PLAIN = frozenset(range(0x20, 0x7F)) - {ord('"'), ord("\\")}
_ESCAPES = {0x0A: "\\n", 0x0D: "\\r", ord('"'): '\\"', ord("\\"): "\\\\"}


#: Environment variable with the file to which devices write their traces; child processes inherit it.
VARIABLE = "ITOUCH_TRACE"


class Entry(NamedTuple):
    """One line of a trace."""

    seconds: float
    device: str
    mark: str
    data: bytes


class Trace:
    """Writes the transfers of one device; several devices may share a stream."""

    def __init__(self, stream: TextIO, device: str, *, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream, self._device, self._clock = stream, device, clock
        self._begin = clock()

    def sent(self, data: bytes) -> None:
        """Record bytes that were sent to the device."""
        self._line(SENT, shown(data))

    def received(self, data: bytes) -> None:
        """Record bytes that were received from the device."""
        self._line(RECEIVED, shown(data))

    def remark(self, text: str) -> None:
        """Record a remark on what else happened."""
        self._line(REMARK, " ".join(text.split()))

    def _line(self, mark: str, text: str) -> None:
        self._stream.write(f"{self._clock() - self._begin:.6f} {self._device} {mark} {text}\n")


def wanted(device: str) -> Trace | None:
    """Return the trace to which a device writes if ``--trace FILE`` was given, else None."""
    path = os.environ.get(VARIABLE)
    return Trace(open(path, "a", encoding="utf-8", buffering=1), device) if path else None


def begin(path: str) -> None:
    """Let the devices of this process and its child processes write their traces to a new file."""
    with open(path, "w", encoding="utf-8"):
        os.environ[VARIABLE] = os.path.abspath(path)


def shown(data: bytes) -> str:
    """Return bytes as a trace shows them."""
    if data and all(byte in _PLAIN or byte in _ESCAPES for byte in data):
        return '"' + "".join(_ESCAPES.get(byte) or chr(byte) for byte in data) + '"'
    return data.hex(" ")


def read_trace(lines: Iterable[str]) -> list[Entry]:
    """Return the entries of a trace; a remark's data is its text in UTF-8.

    Raises
    ------
    ValueError
        Naming the first line that does not belong to a trace.
    """
    entries = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        parts = line.rstrip("\n").split(" ", 3)
        try:
            seconds, device, mark = float(parts[0]), parts[1], parts[2]
            text = parts[3] if len(parts) > 3 else ""
            if mark not in (SENT, RECEIVED, REMARK):
                raise ValueError(mark)
            data = text.encode() if mark == REMARK else _bytes(text)
        except (ValueError, IndexError, KeyError) as error:
            raise ValueError(f"line {number} is none of a trace: {line.rstrip()!r}") from error
        entries.append(Entry(seconds, device, mark, data))
    return entries


def _bytes(text: str) -> bytes:
    if not text.startswith('"'):
        return bytes.fromhex(text)
    back = {escape: byte for byte, escape in _ESCAPES.items()}
    out, at, plain = bytearray(), 0, text[1:-1]
    while at < len(plain):
        step = 2 if plain[at] == "\\" else 1
        out.append(back[plain[at : at + 2]] if step == 2 else ord(plain[at]))
        at += step
    return bytes(out)
