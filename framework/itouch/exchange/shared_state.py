"""The State of a virtual rig's twins, in a file that another process on this machine maps to read the newest values.

Neither side waits for the other.  The writer cycles through a few slots; a reader checks afterwards that the slot it
has read was not overwritten meanwhile.
"""

from __future__ import annotations

import ast
import json
import mmap
import os
import struct
from collections.abc import Mapping

import numpy as np

from itouch.plugin import Record

#: Number of records kept: copying one must not take longer than this many periods, or it is not valid.
SLOTS = 16
#: The file's head: records written so far, bytes of one with its time, bytes of the description that follows.
_HEAD = struct.Struct("<QQQ")
_COUNT, _TIME = struct.Struct("<Q"), struct.Struct("<d")


class TruthWriter:
    """Makes the file, and writes the twins' State to it.

    Parameters
    ----------
    path
        The file; it must not exist.
    states
        State of each device's twin, by the device's name; read at each ``write``.
    """

    def __init__(self, path: str, states: Mapping[str, Record]) -> None:
        self._states = [state.raw for state in states.values() if state.nbytes]
        described = {name: repr(state.dtype.descr) for name, state in states.items() if state.nbytes}
        text = json.dumps(described).encode()
        self._size = _TIME.size + sum(len(raw.data) for raw in self._states)
        self._begin = _HEAD.size + len(text)
        with open(path, "xb") as file:
            file.truncate(self._begin + SLOTS * self._size)
            os.chmod(path, 0o600)
        with open(path, "r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)
        self._map[_HEAD.size : self._begin] = text
        self._count = 0
        self._map[: _HEAD.size] = _HEAD.pack(0, self._size, len(text))

    def write(self, now: float) -> None:
        """Write the twins' State at the simulated time ``now`` [s]."""
        at = self._begin + self._count % SLOTS * self._size
        self._map[at : at + self._size] = _TIME.pack(now) + b"".join(bytes(raw.data) for raw in self._states)
        self._count += 1
        self._map[: _COUNT.size] = _COUNT.pack(self._count)

    def close(self) -> None:
        """Let go of the file."""
        self._map.close()


class TruthReader:
    """Reads the file of a ``TruthWriter``.

    Attributes
    ----------
    states
        The State of the twins read last, by the device's name.
    now
        The rig's simulated time of that State [s].
    """

    def __init__(self, path: str) -> None:
        with open(path, "rb") as file:
            self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        _, self._size, length = _HEAD.unpack_from(self._map)
        self._begin = _HEAD.size + length
        described = json.loads(self._map[_HEAD.size : self._begin])
        self.states = {name: Record(np.dtype(ast.literal_eval(text))) for name, text in described.items()}
        self.now = 0.0

    def read(self) -> bool:
        """Read the newest record; tell whether there was a valid one."""
        (count,) = _COUNT.unpack_from(self._map)
        if not count:
            return False
        at = self._begin + (count - 1) % SLOTS * self._size
        data = self._map[at : at + self._size]
        (after,) = _COUNT.unpack_from(self._map)
        if after - count >= SLOTS - 1:
            return False
        (self.now,) = _TIME.unpack_from(data)
        at = _TIME.size
        for state in self.states.values():
            state.raw.data[:] = data[at : at + state.nbytes]
            at += state.nbytes
        return True

    def close(self) -> None:
        """Let go of the file."""
        self._map.close()
