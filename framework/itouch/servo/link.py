"""Attaching to running sessions: the view that a window, a recorder or a terminal has of a servo process."""

from __future__ import annotations

import ast
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from itouch.loop.timing import Timing, timing_fields
from itouch.platforms import SERVO_PROCESS, lives
from itouch.plugin import Record
from itouch.servo import command_queue
from itouch.servo import control_block as at
from itouch.servo.deadman_holders import Holder
from itouch.servo.published_state import Follower, Ring, copy_timing
from itouch.servo.shared_memory import PREFIX, ServoError, SharedMemory, monotonic

if TYPE_CHECKING:
    from itouch.scene import Scene

#: Silence [s] after which a servo process counts as hung.
SILENCE = 1.0


@dataclass(frozen=True, slots=True)
class SessionInfo:
    """A running session: its name, the ids of its servo process and of its launcher, its scene file, its phase."""

    name: str
    pid: int
    owner: int
    scene: str
    phase: str


class Link:
    """Reads a running session without the servo process noticing; also a context manager."""

    def __init__(self, segment: SharedMemory) -> None:
        segment.check()
        if not int(segment.words[at.SIZE]):
            raise ServoError(f"session '{segment.name}' is still being built")
        segment.map()
        self._segment, self._words = segment, segment.words
        meta = segment.meta()
        self.name: str = segment.name
        self.source: str = meta["source"]
        self.period: float = meta["period"]
        self.objects: tuple[str, ...] = tuple(meta["objects"])
        self.probes: tuple[str, ...] = tuple(meta["probes"])
        self.devices: tuple[str, ...] = tuple(meta["devices"])
        self.notices: tuple[str, ...] = tuple(meta["notices"])
        #: The canonical scene as text.
        self.scene_xml: str = meta["scene_xml"]
        #: All that the memory's description holds, for programs that need more of it.
        self.meta: dict[str, Any] = meta
        self.dtype: np.dtype[Any] = np.lib.format.descr_to_dtype(ast.literal_eval(meta["dtype"]))
        self._parts = tuple(meta["parts"])
        self._ring = Ring(segment)
        self._copy = Record(self.dtype)
        self._holder = Holder(segment)

    def scene(self) -> Scene:
        """Return the scene, with the files that it names.

        Raises
        ------
        SceneError
            If a plugin that it needs is missing here.
        """
        from itouch.plugin.discovery import Catalog
        from itouch.scene import loads

        places = self.meta["files"]
        files = None
        if places is not None:
            files = {name: self._segment.part(start, size).tobytes() for name, (start, size) in places.items()}
        found = loads(self.scene_xml.encode(), Catalog(), shown=self.source, files=files)
        return replace(found, folder=self.meta["folder"])

    @property
    def pid(self) -> int:
        """The id of the servo process."""
        return int(self._words[at.SERVO])

    @property
    def phase(self) -> str:
        """The phase that the servo process states: building, ready, running, ending or ended."""
        return at.PHASES[self._segment.phase]

    @property
    def losses(self) -> tuple[str, ...]:
        """Which data are no longer kept: ``recording``, ``saving``."""
        lost = int(self._words[at.LOST])
        return tuple(name for bit, name in ((1, "recording"), (2, "saving")) if lost & bit)

    @property
    def alive(self) -> bool:
        """Whether the servo process exists, and has not been silent for longer than a second."""
        silent = (monotonic() - int(self._words[at.BEAT])) * 1e-9
        return self._segment.phase < at.ENDED and lives(self.pid) and silent < SILENCE

    @property
    def state(self) -> Record:
        """A copy of the newest State, with the field names of ``Engine.state``.

        Raises
        ------
        ServoError
            If none has been published.
        """
        record = Record(self.dtype)
        if not self.refresh(record):
            raise ServoError(f"session '{self.name}' has not published a State yet")
        return record

    def refresh(self, record: Record) -> bool:
        """Copy the newest State into a record of this layout; return false if none has been published."""
        return self._ring.newest(record.raw) is not None

    @property
    def tick(self) -> int:
        """The tick count of the newest State; 0 before the first."""
        return int(self._copy["tick"]) if self.refresh(self._copy) else 0

    @property
    def seconds(self) -> float:
        """Simulated time of the newest State [s]."""
        return self.tick * self.period

    @property
    def timing(self) -> Timing:
        """A copy of Timing, at most 20 ticks old."""
        record = Record.of(timing_fields(len(self._parts)))
        copy_timing(self._segment, record.raw)
        return Timing(self._parts, record)

    def skim(self, after: int, every: int, record: Record) -> Iterator[int]:
        """Copy every ``every``-th State that was published after a given one, oldest first, into a record.

        Parameters
        ----------
        after
            Number of the publication after which to begin: the last one that was yielded before.
        every
            Distance, in publications, between two States that are copied.
        record
            Receives each State before its number is yielded.
        """
        head, slots = self._ring.head, self._ring.slots
        first = max(after + 1, head - slots + slots // 8 + 2, 1)
        for sequence in range(first + -first % every, head + 1, every):
            if self._ring.copy(sequence, record.raw) is not None:
                yield sequence

    def follow(self) -> Follower:
        """Return a reader that takes every State from the next one on, and counts those that it was too slow for."""
        return Follower(self._ring)

    def command(self, what: str, value: Any = None) -> None:
        """Ask the servo process for something between two ticks.

        Parameters
        ----------
        what
            ``pause``, ``resume``, ``enable``, ``rearm``, ``reconnect``, ``steer``, ``inject``, or ``DEVICE.CHANNEL``
            for a command channel that nothing in the scene writes.
        value
            What goes with it: for ``reconnect`` a device; for ``steer`` a dictionary of ``probe`` and ``step`` ([m], or
            None); for ``inject`` a dictionary of the arguments of ``Engine.inject``; for a channel its numbers.

        Raises
        ------
        ServoError
            If the session has ended, or takes no commands.
        """
        if not self.alive:
            raise ServoError(f"session '{self.name}' has ended")
        command_queue.put(self._segment, {"what": what, "value": value})

    def stop(self) -> None:
        """Ask for the end of the session; the devices are made safe first."""
        self._words[at.STOP] = 1

    def hold(self, held: bool = True) -> None:
        """Hold the dead-man's switch for a time `HOLD`, or let it go; a process that dies or hangs lets go by itself.

        Each link has a word of its own for this: if one lets go, the session stops, whoever else still holds.

        Raises
        ------
        ServoError
            If too many hold it.
        """
        self._holder.say(held)

    def close(self) -> None:
        """Let go of the switch, and detach."""
        self._holder.release()
        self._segment.close()

    def __enter__(self) -> Link:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def sessions() -> list[SessionInfo]:
    """Return the running sessions of this user, by the ids of their servo processes."""
    found = []
    for segment in _segments():
        source = segment.meta()["source"] if int(segment.words[at.SIZE]) else ""
        pid, phase = int(segment.words[at.SERVO]), at.PHASES[segment.phase]
        found.append(SessionInfo(segment.name, pid, int(segment.words[at.OWNER]), source, phase))
        segment.close()
    return sorted(found, key=lambda info: info.pid)


def attach(name: str | None = None) -> Link:
    """Attach to a running session.

    Parameters
    ----------
    name
        Its name, or the id of its servo process; None if only one runs.

    Raises
    ------
    ServoError
        If there is no such session, or several to choose from.
    """
    segments = [s for s in _segments() if name is None or name in (s.name, str(int(s.words[at.SERVO])))]
    ready = [segment for segment in segments if int(segment.words[at.SIZE])]
    if len(ready) == 1:
        link = Link(ready[0])
        if link.meta.get("blind"):
            link.close()
            raise ServoError(f"session '{link.name}' runs a study: nobody may see what is touched")
        return link
    for segment in segments:
        segment.close()
    if not segments:
        raise ServoError("no session is running" if name is None else f"there is no running session named '{name}'")
    if not ready:
        raise ServoError(f"session '{segments[0].name}' is still being built")
    listed = ", ".join(f"'{segment.name}'" for segment in ready)
    raise ServoError(f"several sessions run: {listed}; name one")


def _segments() -> Iterator[SharedMemory]:
    """Yield the memory of every session whose servo process lives, each once."""
    seen: set[int] = set()
    for link in _links():
        try:
            name = os.readlink(link)
            if not name.startswith(f"/memfd:{PREFIX}"):
                continue
            inode = os.stat(link).st_ino
            if inode in seen:
                continue
            seen.add(inode)
            handle = os.open(link, os.O_RDWR | os.O_CLOEXEC)
        except OSError:
            continue
        segment = _usable(handle, name[len(f"/memfd:{PREFIX}") :].removesuffix(" (deleted)"))
        if segment is not None:
            yield segment


def _links() -> Iterator[str]:
    if not SERVO_PROCESS:  # no other process can have a session that is visible here
        return
    user = os.geteuid()
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            if folder.stat().st_uid != user:
                continue
            names = os.listdir(folder / "fd")
        except OSError:
            continue
        yield from (f"{folder}/fd/{name}" for name in names)


def _usable(handle: int, name: str) -> SharedMemory | None:
    try:
        segment = SharedMemory(handle, name)
    except (ServoError, OSError, ValueError):
        os.close(handle)
        return None
    pid = int(segment.words[at.SERVO])
    whole = int(segment.words[at.MAGIC]) == at.MAGIC_VALUE and int(segment.words[at.FORMAT]) == at.FORMAT_VALUE
    if whole and pid > 0 and lives(pid) and segment.phase < at.ENDED:
        return segment
    segment.close()
    return None
