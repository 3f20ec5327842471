"""Replay: recorded readings are fed to the engine, and every command must come out the same."""

from __future__ import annotations

import base64
import os
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.loop import DeviceFaultError
from itouch.loop.ledger import Ledger
from itouch.plugin import Device, DeviceError, Record, Touch, Twin
from itouch.plugin.discovery import Catalog
from itouch.recording import Recording, RecordingError, read
from itouch.recording.tracks import Track
from itouch.safety import Trip
from itouch.session import layout
from itouch.session.arrays import load_bases, record_from
from itouch.session.building import rebuild
from itouch.session.engine import Session
from itouch.session.snapshot import Snapshot, checked_files, read_scene

#: Greatest State that a recording may hold [bytes].
_MAX_STATE = 64 << 20
#: Ticks that are compared at once.
_BLOCK = 1000

Path = str | os.PathLike[str]


@dataclass(frozen=True, slots=True)
class Mismatch:
    """A command that came out otherwise."""

    tick: int
    channel: str
    recorded: Any
    replayed: Any

    def __str__(self) -> str:
        recorded, replayed = (np.array2string(np.asarray(v), precision=17) for v in (self.recorded, self.replayed))
        return f"tick {self.tick}, {self.channel}: recorded {recorded}, replayed {replayed}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a replay went: ticks that were replayed, commands compared, and what differed."""

    ticks: int
    compared: int
    mismatches: int
    first: Mismatch | None
    skipped: int
    losses: tuple[str, ...]


class PlaybackTwin(Twin):
    """Gives recorded readings in a twin's place; the twin goes on stepping underneath."""

    def __init__(self, name: str, inner: Twin, feed: Feed) -> None:
        super().__init__(None)
        self._name, self._inner, self._feed = name, inner, feed

    def position(self, state: Record) -> NDArray[np.float64] | None:
        """Return the true position of the twin underneath."""
        return self._inner.position(state)

    def step(self, state: Record, command: Record, touch: Touch, period: float) -> None:
        """Step the twin underneath."""
        self._inner.step(state, command, touch, period)

    def read(self, state: Record, reading: Record) -> bool | None:
        """Give the reading of this tick; False if there was nothing new.

        Raises
        ------
        DeviceError
            If the device failed in this tick.
        """
        self._inner.read(state, reading.copy())
        return self._feed.give(self._name, reading)


class PlaybackDevice(Device):
    """Gives recorded readings in the place of hardware, and takes commands nowhere."""

    def __init__(self, name: str, feed: Feed) -> None:
        super().__init__(None)
        self._name, self._feed = name, feed

    def open(self) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""

    def read(self, reading: Record) -> bool | None:
        """Give the reading of this tick; False if there was nothing new.

        Raises
        ------
        DeviceError
            If the device failed in this tick.
        """
        return self._feed.give(self._name, reading)


class Feed:
    """The recorded rows, and which one is the present."""

    def __init__(self, recording: Recording, session: Session) -> None:
        self._tables = {name: recording[name] for name, t in recording.tracks.items() if t.replay}
        self._readings = {
            name: [c.name for c in device.reads if c.name in (self._tables[name].dtype.names or ())]
            for name, device in session.model.devices.items()
            if name in self._tables
        }
        self.ticks = recording.ticks
        self.at = 0
        self._errors = {
            (int(f["tick"]), str(f.get("device"))): str(f.get("cause", "")).removeprefix("failed: ")
            for f in recording.faults
            if f.get("trip") == "device-error" and f.get("optional")
        }
        inputs = self._tables.get("session")
        self._hold = inputs["hold"] if inputs is not None and "hold" in (inputs.dtype.names or ()) else None

    def error_of(self, device: str) -> str:
        """Return what a device said when it failed in this tick, or an empty string."""
        return self._errors.get((int(self.ticks[self.at]), device), "") if self.at < len(self.ticks) else ""

    def give(self, device: str, reading: Record) -> bool:
        """Fill a reading from the present row; tell whether it was new then.

        Raises
        ------
        DeviceError
            If the device failed in this tick, and the session went on without it.
        """
        if cause := self.error_of(device):
            raise DeviceError(cause)
        table, at = self._tables.get(device), self.at
        if table is None or at >= len(table):
            return False
        for name in self._readings[device]:
            reading[name][...] = table[name][at]
        return at == 0 or bool(table["sequence"][at] != table["sequence"][at - 1])

    def inputs(self, state: Record) -> None:
        """Write what else came from outside in this tick."""
        if self._hold is not None and "hold" in state and self.at < len(self._hold):
            state["hold"][...] = self._hold[self.at]


class Comparison:
    """Compares what the engine sends with what was sent."""

    def __init__(self, recording: Recording, session: Session) -> None:
        self._columns = [
            (f"{track.name}.{column.name}", recording[track.name][column.name], session.state[column.field])
            for track in recording.tracks.values()
            if track.replay
            for column in track.columns
            if _is_outcome(track, column.name) and column.field in session.state
        ]
        self._ticks = recording.ticks
        self._seen: list[list[NDArray[Any]]] = [[] for _ in self._columns]
        self._begin = self.compared = self.mismatches = 0
        self.first: Mismatch | None = None

    def note(self, at: int) -> None:
        """Keep what is sent in this tick, which is row ``at``."""
        if not self._seen or not self._seen[0]:
            self._begin = at
        for (_, _, view), seen in zip(self._columns, self._seen, strict=True):
            seen.append(view.copy())
        if self._seen and len(self._seen[0]) >= _BLOCK:
            self.settle()

    def settle(self) -> None:
        """Compare what was kept."""
        for (name, recorded, _), seen in zip(self._columns, self._seen, strict=True):
            if not seen:
                continue
            ours = np.stack(seen)
            theirs = recorded[self._begin : self._begin + len(ours)].reshape(ours.shape)
            same = (ours == theirs) | ((ours != ours) & (theirs != theirs))
            wrong = ~same.reshape(len(ours), -1).all(axis=1)
            self.compared += len(ours)
            self.mismatches += int(wrong.sum())
            if wrong.any():
                index = int(np.argmax(wrong))
                tick = int(self._ticks[self._begin + index])
                if self.first is None or tick < self.first.tick:
                    self.first = Mismatch(tick, name, theirs[index], ours[index])
            seen.clear()


def _is_outcome(track: Track, name: str) -> bool:
    return track.name != "session" and (name.startswith(("command.", "sent.")) or name in ("status", "trip"))


def session_of(recording: Recording, *, catalog: Catalog | None = None) -> Session:
    """Return a session built from what a recording holds of it, with its first State.

    Raises
    ------
    SessionError, RecordingError
        If the recording lacks it, or it can't be built here.
    """
    plugins, said = catalog or Catalog(), recording.session
    if not recording.states:
        raise RecordingError(f"'{recording.path}' holds no State to begin from")
    try:
        manifest = dict(said["manifest"])
        stored = load_bases(base64.b64decode(said["bases"]), manifest.get("bases", {}).get("shapes", {}))
        data = {k[6:]: v for k, v in recording.attachments.items() if k.startswith("files/")}
        digests = dict(manifest.get("files", {}))
        files = checked_files(recording.path, manifest, {digests[n]: v for n, v in data.items() if n in digests})
        scene = read_scene(recording.path, str(said["scene"]).encode(), manifest, files, plugins)
        state = state_of(recording.states[0])
    except (ValueError, KeyError, TypeError, AttributeError, zlib.error) as error:
        raise RecordingError(f"'{recording.path}' does not hold a whole session: {error}") from error
    snapshot = Snapshot(scene, state, manifest, Ledger().dump(), stored, files)
    return rebuild(snapshot, recording.path, plugins, None)


def state_of(letter: Mapping[str, Any]) -> NDArray[Any]:
    """Return the State of a message, one record of shape (1,).

    Raises
    ------
    ValueError
        If it is none.
    """
    unpacker = zlib.decompressobj()
    data = unpacker.decompress(base64.b64decode(str(letter["npy"])), _MAX_STATE)
    return record_from(data)


class Replay:
    """One replay; ``step`` takes it one recorded tick further, so that a window can show it."""

    def __init__(self, recording: Recording, *, catalog: Catalog | None = None) -> None:
        self.recording = recording
        self.session = session_of(recording, catalog=catalog)
        self.session.records = False
        self.feed = Feed(recording, self.session)
        self.comparison = Comparison(recording, self.session)
        self.ticks = self.skipped = 0
        self._starts = _starts(recording)
        self._failed = {int(s["tick"]): s for s in recording.states if s["reason"] == "fault"}
        self._marks = {int(m["tick"]): m for m in recording.marks}
        for runner in self.session.runners:
            name = runner.model.name
            if runner.twin is not None:
                runner.twin = PlaybackTwin(name, runner.twin, self.feed)
            else:
                runner.device = PlaybackDevice(name, self.feed)
        self.session.taps.append(self._after)
        self._going = self._parks = False

    def step(self) -> bool:
        """Replay the next recorded tick; false at the end."""
        feed = self.feed
        if feed.at >= len(feed.ticks):
            return False
        tick = int(feed.ticks[feed.at])
        if not self._ready(tick):
            return self._skip()
        feed.inputs(self.session.state)
        self._mark(tick)
        begin, failed = feed.at, self._failed.pop(tick, None)
        if failed is not None:
            return self._fail(tick, failed)
        if self._parks:
            self._parks = False
            self.session.park()
            self._going = feed.at > begin
            return self._going or self._skip()
        try:
            self.session.tick()
        except DeviceFaultError:
            self._going = feed.at > begin  # the safe sequence has been replayed, too
        return True

    def _fail(self, tick: int, letter: Mapping[str, Any]) -> bool:
        """Replay what a fault did.  What was wrong in that tick never got into State: the fault itself is given."""
        said = next((f for f in self.recording.faults if int(f["tick"]) == tick and not f.get("optional")), None)
        trip = next((t for t in Trip if said is not None and t.label == said.get("trip")), None)
        if said is None or trip is None or str(said["device"]) not in self.session.model.devices:
            return self._skip()
        begin = self.feed.at
        self.session.stand_at(layout.adopt(state_of(letter), self.session.state, {})[0])
        self.session.make_safe(DeviceFaultError(str(said["device"]), tick, trip, str(said.get("cause", ""))))
        self._going = self.feed.at > begin
        return self._going or self._skip()

    def _ready(self, tick: int) -> bool:
        """Take up a recorded State where one begins at this tick; tell whether the engine stands at it."""
        letter = self._starts.pop(tick, None)
        if letter is not None:
            stored, _ = layout.adopt(state_of(letter), self.session.state, {})
            self.session.stand_at(stored)
            if letter["reason"] == "enable":
                self.session.settle()
            self._going, self._parks = True, letter["reason"] == "park"
        return self._going and int(self.session.state["tick"]) == tick

    def _skip(self) -> bool:
        """Pass rows that nothing can be said of: after a gap, up to the next State."""
        self._going = False
        self.feed.at += 1
        self.skipped += 1
        return True

    def _mark(self, tick: int) -> None:
        mark = self._marks.get(tick)
        if mark is not None:
            from itouch.session import marks

            marks.put(self.session.state, str(mark["name"]).encode(), str(mark["payload"]).encode())

    def _after(self, tick: int) -> None:
        feed = self.feed
        if feed.at < len(feed.ticks) and int(feed.ticks[feed.at]) == tick:
            self.comparison.note(feed.at)
            feed.at += 1
            self.ticks += 1

    def outcome(self) -> Outcome:
        """Return how it went so far."""
        self.comparison.settle()
        found = self.comparison
        return Outcome(self.ticks, found.compared, found.mismatches, found.first, self.skipped, self.recording.losses)


def _starts(recording: Recording) -> dict[int, Mapping[str, Any]]:
    """Return by tick the States that a replay must begin from: the first, after what came from outside, after gaps."""
    after_gap = {int(t) for t in recording.ticks[1:][np.diff(recording.ticks) != 1]} if len(recording.ticks) else set()
    found: dict[int, Mapping[str, Any]] = {}
    gap = -1
    for letter in recording.states:
        tick = int(letter["tick"])
        lost = any(gap < t <= tick for t in after_gap)
        if letter["reason"] not in ("every", "fault") or (letter["reason"] == "every" and lost):
            found[tick] = letter
        gap = tick
    return found


def replay(path: Path | Recording, *, catalog: Catalog | None = None,
           each: Callable[[Replay], None] | None = None) -> Outcome:  # fmt: skip
    """Replay a recording as fast as it can be computed.

    Parameters
    ----------
    path
        The recording, or its file.
    catalog
        The plugins; default: those of this environment.
    each
        Called after every tick, for progress.

    Raises
    ------
    RecordingError, SessionError
        If it can't be read, or the session can't be built here.
    """
    recording = path if isinstance(path, Recording) else read(path)
    work = Replay(recording, catalog=catalog)
    while work.step():
        if each is not None:
            each(work)
    return work.outcome()
