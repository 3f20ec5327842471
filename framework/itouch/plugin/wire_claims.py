"""Claims of wires: while a session drives a device, no other session on this machine may use its wire.

A claim is a name in the kernel's list of local sockets.  The kernel gives it to one process at a time, tells which one
that is, and takes it back when that process ends, however it dies.  No file can be left behind, and the name does not
depend on the user, the folder, or the link to the port by which it is claimed.
"""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import struct
import sys
import time
import weakref
from collections.abc import Iterable

from itouch.plugin.device import DeviceError

try:
    import fcntl
except ImportError:  # no hardware is driven there
    fcntl = None  # type: ignore[assignment]

#: How many times others can ask who holds a wire before no answer is given any more; the kernel may allow fewer.
_ASKED = 4096
#: How long, and how often [s], to look for a guardian still at work: it outlives the end of its session a little.
_PATIENCE, _LOOK = 3.0, 0.05
#: What the kernel tells of a peer: process, user, group.
_PEER = struct.Struct("3i")
#: Prefixes of our modules that run as helper processes: messages name the process that started them.
_OURS = ("itouch.", "itouch_tools.")
#: Longest command line in a message [characters].
_LONGEST = 80
_ADVICE = "end that first, or each would take the other's answers, and go on driving what the other has stopped"


class WireHeldError(DeviceError):
    """A wire is in use, by another process or by another session of this one."""


def same(wire: str) -> str:
    """Return the canonical name of a wire: for a link to a port, the port itself."""
    return os.path.realpath(wire) if os.path.isabs(wire) else wire.strip().casefold()


def share(handle: int, port: str) -> None:
    """Lock an open serial port against other programs until it is closed; our own second opener may still open it.

    Terminal programs, and programs that open a port exclusively, lock it as a file (``flock``), because two programs on
    one line take each other's answers.  A guardian uses a locked port all the same: a finger may be on the device that
    it makes safe.

    Raises
    ------
    WireHeldError
        If another program has locked it exclusively.
    """
    if fcntl is None or same(port) in _GUARDED:
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise WireHeldError(f"'{port}' is in use by another program, which has locked it: end that first") from error
    except OSError:  # not a file that can be locked
        return


class WireClaims:
    """The wires of one device, held until ``release``, until this object is deleted, or until the process ends."""

    def __init__(self) -> None:
        self._sockets: list[socket.socket] = []
        weakref.finalize(self, _close, self._sockets)

    def take(self, wires: Iterable[str], guardian: int = 0) -> None:
        """Claim wires for a session, all of them or none; if this object holds wires already, do nothing.

        ``guardian`` is the process that watches over this very session: it guards them for as long as it lives.

        Raises
        ------
        WireHeldError
            If one is in use; the message says by whom, and what to do.
        """
        if self._sockets:
            return
        try:
            for key, wire in sorted({same(wire): wire for wire in wires}.items()):
                self._bind(_name(key), wire)
                _await_guardian(_name(key, "guarded wire"), wire, guardian)
        except BaseException:
            self.release()
            raise

    def guard(self, wires: Iterable[str]) -> None:
        """Claim wires for a guardian, beside the session that it watches over, and beyond the end of that session.

        Raises
        ------
        WireHeldError
            If another guardian has one.
        """
        for key, wire in sorted({same(wire): wire for wire in wires}.items()):
            self._bind(_name(key, "guarded wire"), wire)
            _GUARDED.add(key)

    def stand_in(self, place: str) -> None:
        """Claim the path of a link that stands in for a device's port, since two would replace each other's link.

        Raises
        ------
        WireHeldError
            If something stands in there already; the message says in which process.
        """
        folder, base = os.path.split(os.path.abspath(place))
        self._bind(_name(os.path.join(os.path.realpath(folder), base), "stand-in"), place)

    def release(self) -> None:
        """Release all wires."""
        _close(self._sockets)

    def _bind(self, name: str, wire: str) -> None:
        if not sys.platform.startswith("linux"):  # no hardware is driven there
            return
        claimed = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            claimed.bind(name)
        except OSError as error:
            claimed.close()
            if error.errno != errno.EADDRINUSE:
                raise
            raise WireHeldError(f"'{wire}' is in use by {_told(_holder(name) or 0)}; {_ADVICE}") from error
        claimed.listen(_ASKED)  # from here on the kernel tells who holds it
        self._sockets.append(claimed)
        _CLAIMED.add(claimed)


#: The wires that this process guards, if it is a guardian, which does nothing else.
_GUARDED: set[str] = set()
#: All claims of this process; a forked child closes its copies of them.
_CLAIMED: weakref.WeakSet[socket.socket] = weakref.WeakSet()


def _close(sockets: list[socket.socket]) -> None:
    while sockets:
        sockets.pop().close()


def _forget() -> None:
    for claimed in list(_CLAIMED):
        claimed.close()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)


def _name(key: str, what: str = "wire") -> str:
    digest = hashlib.sha256(key.encode(errors="surrogateescape")).hexdigest()
    return f"\0itouch/{what}/{digest}"


def _await_guardian(name: str, wire: str, own: int = 0) -> None:
    """Wait for the guardian of a session that has ended, which may still be making the device on the wire safe.

    Not for one's ``own``, which is a process; 0: there is none.
    """
    if not sys.platform.startswith("linux"):
        return
    deadline = time.monotonic() + _PATIENCE
    while (holder := _holder(name)) is not None and holder != own:
        if time.monotonic() > deadline:
            raise WireHeldError(
                f"'{wire}' is in use by {_told(holder)}, the guardian of a session that has ended; {_ADVICE}"
            )
        time.sleep(_LOOK)


def _holder(name: str) -> int | None:
    """Return the process that holds a name; 0: a process holds it, unknown which; None: nobody does."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
        asking.setblocking(False)
        try:
            asking.connect(name)
        except ConnectionRefusedError:  # nobody, or it does not listen yet
            return None
        except OSError:  # more have asked than the kernel queues
            return 0
        return int(_PEER.unpack(asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size))[0])


def _told(process: int) -> str:
    """Return a process in words; for one of our helper processes, the process that started it, which a user knows."""
    if process == os.getpid():
        return "another session of this process"
    if process <= 0:
        return "another process"
    words, parent = _words(process), _parent(process)
    if words[1:2] == ["-P"] and any(word.startswith(_OURS) for word in words[2:4]) and parent > 1:
        return f"process {parent} ({_line(_words(parent))}) and its process {process}"
    return f"process {process} ({_line(words)})"


def _line(words: list[str]) -> str:
    """Return a command line without the folders of program and script."""
    if not words:
        return "its name can't be read"
    text = " ".join([os.path.basename(word) for word in words[:2]] + words[2:])
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def _words(process: int) -> list[str]:
    try:
        with open(f"/proc/{process}/cmdline", "rb") as stream:
            return [word.decode(errors="replace") for word in stream.read(4096).split(b"\0") if word]
    except OSError:
        return []


def _parent(process: int) -> int:
    try:
        with open(f"/proc/{process}/stat", encoding="utf-8", errors="replace") as stream:
            return int(stream.read(512).rpartition(")")[2].split()[1])
    except (OSError, ValueError, IndexError):
        return 0
