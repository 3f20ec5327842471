"""The protocol of a remote twin: packets on a local socket between a twin in its own process and those who use it.

Each packet begins with one byte for its kind.  The servo process sends I (begin from this State), C (command and
touch), B (the end); a second opener sends S (be safe, and stay so); an observer sends W (watch).  The twin answers the
servo process with T (State and reading) after each of its steps, and observers with O (what acts) and E (an event).
"""

from __future__ import annotations

import errno
import os
import socket
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from itouch.plugin import TwinInputs

INIT, COMMAND, BYE, SAFE, WATCH = b"I", b"C", b"B", b"S", b"W"
TELL, OBSERVED, EVENT = b"T", b"O", b"E"
#: Flags of a twin: it refuses commands, what acts is safe, nothing presses on the finger.
LATCHED: Final = 1
OUTPUTS_SAFE: Final = 2
CLEAR: Final = 4
#: Set from the first command on: before it nothing acts on the twin.
BEGUN: Final = 8

#: Largest packet [bytes].
PACKET = 1 << 16
#: How many connections may wait to be accepted: strangers' may be among them.
WAITING = 64
_HEAD = struct.Struct("<cqq")
#: What the kernel tells of a peer: process, user, group.
_PEER = struct.Struct("3i")
#: A span of time for the kernel: seconds and microseconds.
_TIME = struct.Struct("@ll")
_TOUCH = struct.Struct("<7d6d6d4d")


def address(session: str, device: str) -> str:
    """Return the address of a twin: an abstract local socket, which leaves no file behind."""
    return f"\0itouch/{session}/{device}"


def connect(where: str, timeout: float | None = None) -> socket.socket:
    """Connect to a twin.

    Raises
    ------
    OSError
        If nobody listens there, or another user does.
    """
    line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        # The kernel waits here: if strangers fill the queue of connections, a non-blocking connect would be refused.
        line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _span(timeout))
        line.connect(where)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _span(None))
        line.settimeout(timeout)
        if not same_user(line):
            raise PermissionError(errno.EPERM, "another user listens there")
    except OSError:
        line.close()
        raise
    return line


def _span(seconds: float | None) -> bytes:
    """Return a time [s] as the kernel takes it; None: unlimited."""
    whole = 0.0 if seconds is None else max(seconds, 1e-3)
    return _TIME.pack(int(whole), int(whole % 1.0 * 1e6))


def same_user(line: socket.socket) -> bool:
    """Tell whether the process at the other end of a local socket runs as this user, by what the kernel says."""
    told = line.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
    return bool(_PEER.unpack(told)[1] == os.geteuid())


def head(kind: bytes, first: int, second: int) -> bytes:
    """Return the head of a packet with two numbers."""
    return _HEAD.pack(kind, first, second)


def split(packet: bytes) -> tuple[int, int, memoryview]:
    """Return the two numbers of a packet's head, and what follows."""
    _, first, second = _HEAD.unpack_from(packet)
    return first, second, memoryview(packet)[_HEAD.size :]


def pack_touch(touch: TwinInputs) -> bytes:
    """Return what the simulated world presents to the twin, as bytes."""
    return _TOUCH.pack(
        *touch.finger_pose.tolist(), *touch.finger_twist.tolist(), *touch.wrench.tolist(),
        touch.force, touch.gap, touch.ambient, float(touch.finger_attached),
    )  # fmt: skip


def unpack_touch(data: memoryview, touch: TwinInputs) -> None:
    """Write what ``pack_touch`` returned into a twin's inputs."""
    numbers: NDArray[np.float64] = np.frombuffer(data, np.float64, 23)
    touch.finger_pose[:], touch.finger_twist[:], touch.wrench[:] = numbers[:7], numbers[7:13], numbers[13:19]
    touch.force, touch.gap, touch.ambient = (float(number) for number in numbers[19:22])
    touch.finger_attached = bool(numbers[22])


@dataclass(frozen=True, slots=True)
class Observation:
    """What acted on a twin at a time of the monotonic clock [ns]: ``flags`` are LATCHED, OUTPUTS_SAFE, CLEAR."""

    host_ns: int
    flags: int
