"""The command queue of a session: any process that has its memory may add a command, the servo process takes them.

Writers exclude one another by a file lock, which the kernel releases if they die; the servo process takes no lock.
"""

from __future__ import annotations

import json
import struct
import time
from typing import Any

from itouch.servo import control_block as at
from itouch.servo.shared_memory import ServoError, SharedMemory

_LENGTH = struct.Struct("<q")
_PATIENCE = 1.0


def put(segment: SharedMemory, message: dict[str, Any]) -> None:
    """Put a command into the queue.

    Raises
    ------
    ServoError
        If the queue stays full, which means that the servo process no longer takes any.
    ValueError
        If the command is too long.
    """
    text = json.dumps(message).encode()
    if len(text) > at.BOX_SLOT_SIZE - _LENGTH.size:
        raise ValueError(f"a command of {len(text)} bytes is too long, at most {at.BOX_SLOT_SIZE - _LENGTH.size}")
    deadline = time.monotonic() + _PATIENCE
    while not _try_put(segment, text):
        if time.monotonic() > deadline:
            raise ServoError("the servo process does not take commands any more")
        time.sleep(0.002)


def _try_put(segment: SharedMemory, text: bytes) -> bool:
    with segment.alone(wait=False) as alone:
        words = segment.words
        asked = int(words[at.ASKED])
        if not alone or asked - int(words[at.TAKEN]) >= at.BOX_SLOTS:
            return False
        where = at.BOX_AT + asked % at.BOX_SLOTS * at.BOX_SLOT_SIZE
        _LENGTH.pack_into(segment.bytes.data, where, len(text))
        segment.bytes[where + _LENGTH.size : where + _LENGTH.size + len(text)] = memoryview(text)
        words[at.ASKED] = asked + 1
        return True


class Inbox:
    """The servo process's end of the queue."""

    def __init__(self, segment: SharedMemory) -> None:
        self._segment = segment
        self._taken = int(segment.words[at.TAKEN])
        self._words = segment.words

    def take(self) -> list[dict[str, Any]]:
        """Return the new commands; what is not a command is left out."""
        asked = self._words[at.ASKED].item()
        found: list[dict[str, Any]] = []
        while self._taken < asked and len(found) < at.BOX_SLOTS:
            where = at.BOX_AT + self._taken % at.BOX_SLOTS * at.BOX_SLOT_SIZE
            (length,) = _LENGTH.unpack_from(self._segment.bytes.data, where)
            length = max(0, min(length, at.BOX_SLOT_SIZE - _LENGTH.size))
            self._taken += 1
            try:
                text = self._segment.bytes[where + _LENGTH.size : where + _LENGTH.size + length].tobytes()
                message = json.loads(text)
            except ValueError:
                continue
            if isinstance(message, dict):
                found.append(message)
        if found or self._taken != int(self._words[at.TAKEN]):
            self._words[at.TAKEN] = self._taken
        return found
