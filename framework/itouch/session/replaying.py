"""Replay: recorded readings are fed to the engine, and every command must come out the same."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from itouch.loop import DeviceFaultError
from itouch.plugin.discovery import Catalog
from itouch.recording import Recording, RecordingError, read
from itouch.recording.tracks import SCENE, Track
from itouch.safety import Trip
from itouch.session import layout_mapping
from itouch.session.building import rebuild
from itouch.session.from_recordings import snapshot_at, state_of
from itouch.session.manifest import host_facts
from itouch.session.playback import Feed, PlaybackDevice, PlaybackTwin
from itouch.session.session import Session

if TYPE_CHECKING:
    from itouch.session.session import Session


Path = str | os.PathLike[str]

#: How late [s] a tick of hardware is taken to have begun, which is not recorded: so late that no change of a reading is
#: too fast.  A reading that was not believed is a recorded fault.
LATE = 1e3

#: How many ticks are compared at once.
_BLOCK = 1000


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a replay went: ticks replayed, values compared, how many differ, rows skipped, losses.

    ``first`` and ``largest`` are the first and the largest difference.  ``elsewhere`` says what is another here than
    where it was recorded and may change last digits, as "numpy 2.4.6 (2.5.5 here)".
    """

    ticks: int
    compared: int
    mismatches: int
    first: Mismatch | None
    skipped: int
    losses: tuple[str, ...]
    largest: Mismatch | None = None
    elsewhere: tuple[str, ...] = ()


def session_of(recording: Recording, *, catalog: Catalog | None = None) -> Session:
    """Return the session of a recording, at its first State.

    Raises
    ------
    SessionError, RecordingError
        If the recording does not hold it whole, its scene changed, or it can't be built here.
    """
    plugins = catalog or Catalog()
    if any(letter["reason"] == SCENE for letter in recording.states):
        raise RecordingError(f"'{recording.path}' can't be replayed: its scene changed from trial to trial")
    if not recording.states:
        raise RecordingError(f"'{recording.path}' holds no State to begin from")
    snapshot = snapshot_at(recording, recording.states[0], plugins)
    return rebuild(snapshot, recording.path, plugins, None, replays=True)


@dataclass(frozen=True, slots=True)
class ReplayPosition:
    """Where a replay stands between two steps: the next row, the bytes of State, whether State belongs to that row.

    ``parks``: whether the session parks at that row.
    """

    at: int
    state: bytes
    going: bool
    parks: bool


class Replay:
    """One replay; ``step`` takes it one recorded tick further, so that a window can show it.

    With ``compares`` false nothing is compared, and it may be moved back and forth with ``go`` and ``begin_at``.
    """

    def __init__(self, recording: Recording, *, catalog: Catalog | None = None, compares: bool = True) -> None:
        self.recording = recording
        self.session = session_of(recording, catalog=catalog)
        self.session.records = False
        self.feed = Feed(recording, self.session)
        self.comparison = Comparison(recording, self.session)
        self._compares = compares
        self.ticks = self.skipped = 0
        self._starts, self._failed = _starts(recording), _failures(recording)
        self._marks = {int(m["tick"]): m for m in recording.marks}
        self._left_out = _by_tick(recording.left_out)
        for runner in self.session.runners:
            name = runner.model.name
            if runner.gate.twin is not None:
                runner.gate.twin = PlaybackTwin(name, runner.gate.twin, self.feed)
            else:
                runner.gate.device = PlaybackDevice(name, self.feed)
        self._real = [runner for runner in self.session.runners if not runner.model.twin]
        self.session.taps.append(self._after)
        self._going = self._parks = False
        self._changed = layout_mapping.changed_fields(self.session.model)

    def step(self) -> bool:
        """Replay the next recorded tick; false at the end."""
        feed = self.feed
        if feed.at >= len(feed.ticks):
            return False
        tick = int(feed.ticks[feed.at])
        if not self._ready(tick):
            return self._skip()
        feed.inputs(self.session.state)
        for runner in self._real:
            runner.gate.acquisition.slip[0] = LATE
        self._mark(tick)
        begin, failed = feed.at, self._failed.pop(tick, None)
        if failed is not None:
            return self._fail(tick, failed)
        self._leave_out(tick)
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
        """Replay a recorded fault: its cause never got into a row, so the fault itself is taken from the recording."""
        said = next((f for f in self.recording.faults if int(f["tick"]) == tick and not f.get("optional")), None)
        trip = next((t for t in Trip if said is not None and t.label == said.get("trip")), None)
        if said is None or trip is None or str(said["device"]) not in self.session.model.devices:
            return self._skip()
        begin = self.feed.at
        self.session.stand_at(layout_mapping.adopt(state_of(letter), self.session.state, {}, self._changed)[0])
        self.session.make_safe(DeviceFaultError(str(said["device"]), tick, trip, str(said.get("cause", ""))))
        self._going = self.feed.at > begin
        return self._going or self._skip()

    def _ready(self, tick: int) -> bool:
        """Take over a recorded State if a stretch begins at this tick; tell whether the engine stands at this tick."""
        letter = self._starts.pop(tick, None)
        if letter is not None:
            stored, _ = layout_mapping.adopt(state_of(letter), self.session.state, {}, self._changed)
            self.session.stand_at(stored)
            if letter["reason"] == "enable":
                self.session.settle()
            self._going, self._parks = True, letter["reason"] == "park"
        return self._going and int(self.session.state["tick"]) == tick

    def _skip(self) -> bool:
        """Skip a row that can't be replayed: one after a gap, before the next State."""
        self._going = False
        self.feed.at += 1
        self.skipped += 1
        return True

    def _mark(self, tick: int) -> None:
        mark = self._marks.get(tick)
        if mark is not None:
            from itouch.session import marks

            marks.put(self.session.state, str(mark["name"]).encode(), str(mark["payload"]).encode())

    def _leave_out(self, tick: int) -> None:
        """Leave out the time that the loop left out before this tick."""
        for said in self._left_out.get(tick, ()):
            self.session.leave_out(float(said["seconds"]), running=bool(said["running"]))

    def _after(self, tick: int) -> None:
        feed = self.feed
        if feed.at < len(feed.ticks) and int(feed.ticks[feed.at]) == tick:
            if self._compares:
                self.comparison.note(feed.at)
            feed.at += 1
            self.ticks += 1

    def place(self) -> ReplayPosition:
        """Return where the replay stands, to ``go`` there again."""
        return ReplayPosition(self.feed.at, self.session.state.tobytes(), self._going, self._parks)

    def go(self, place: ReplayPosition) -> None:
        """Stand at a place where this replay stood before."""
        self._turn_to(place.at)
        self.session.stand_at(place.state)
        self._going, self._parks = place.going, place.parks

    def begin_at(self, letter: Mapping[str, Any]) -> None:
        """Go to the row of a recorded State, one of ``recording.states`` that is not of a fault."""
        tick = int(letter["tick"])
        self._turn_to(int(np.searchsorted(self.feed.ticks, tick)))
        self._starts.setdefault(tick, letter)
        self._going = self._parks = False

    def _turn_to(self, row: int) -> None:
        """Make a row the next one; the recorded States of its tick and later ones count again."""
        ticks = self.feed.ticks
        first = int(ticks[row]) if row < len(ticks) else int(ticks[-1]) + 1 if len(ticks) else 0
        self.feed.at = row
        self._starts = {tick: s for tick, s in _starts(self.recording).items() if tick >= first}
        self._failed = {tick: s for tick, s in _failures(self.recording).items() if tick >= first}

    def outcome(self) -> Outcome:
        """Return how the replay has gone so far."""
        self.comparison.settle()
        found = self.comparison
        return Outcome(
            self.ticks, found.compared, found.mismatches, found.first, self.skipped, self.recording.losses,
            found.largest, elsewhere(self.recording),
        )  # fmt: skip


def elsewhere(recording: Recording) -> tuple[str, ...]:
    """Return what may change last digits and is another here than where the recording was made, with both values."""
    then, now = recording.session.get("manifest", {}).get("host") or {}, host_facts()
    return tuple(
        f"{name} {then[name]} ({now[name]} here)"
        for name in ("python", "numpy", "numba", "machine", "processor")
        if name in then and then[name] != now[name]
    )


def _by_tick(letters: Iterable[Mapping[str, Any]]) -> dict[int, list[Mapping[str, Any]]]:
    """Return messages by tick, in their order."""
    found: dict[int, list[Mapping[str, Any]]] = {}
    for letter in letters:
        found.setdefault(int(letter["tick"]), []).append(letter)
    return found


def _failures(recording: Recording) -> dict[int, Mapping[str, Any]]:
    """Return the States of ticks that failed, by tick."""
    return {int(letter["tick"]): letter for letter in recording.states if letter["reason"] == "fault"}


def _starts(recording: Recording) -> dict[int, Mapping[str, Any]]:
    """Return, by tick, the States from which a replay begins anew: the first, after acts from outside, after gaps."""
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


@dataclass(frozen=True, slots=True)
class Mismatch:
    """A command (or status) that differs in a replay."""

    tick: int
    channel: str
    recorded: Any
    replayed: Any

    @property
    def share(self) -> float:
        """Its difference over its size: see `differences`."""
        recorded, replayed = (np.asarray(v)[None] for v in (self.recorded, self.replayed))
        return float(differences(recorded, replayed)[0])

    def __str__(self) -> str:
        recorded, replayed = (np.array2string(np.asarray(v), precision=17) for v in (self.recorded, self.replayed))
        return f"tick {self.tick}, {self.channel}: recorded {recorded}, replayed {replayed}"


def differences(recorded: NDArray[Any], replayed: NDArray[Any]) -> NDArray[np.float64]:
    """Return, for each row, the largest difference of its numbers over the largest of them [1], shape (rows,).

    Both are (rows, ...), in any unit.  Equal rows give 0; where one of the two alone is no finite number the result is
    infinite.
    """
    theirs, ours = (np.asarray(v, dtype=np.float64).reshape(len(v), -1) for v in (recorded, replayed))
    same = (theirs == ours) | (np.isnan(theirs) & np.isnan(ours))
    size = np.nan_to_num(np.maximum(np.abs(theirs), np.abs(ours)), posinf=0.0).max(axis=1, initial=0.0)
    with np.errstate(invalid="ignore"):  # infinite less infinite
        off = np.where(same, 0.0, np.abs(theirs - ours))
    off = np.where(np.isfinite(off), off, np.inf).max(axis=1, initial=0.0)
    found: NDArray[np.float64] = np.where(off > 0.0, np.inf, 0.0)
    np.divide(off, size, out=found, where=size > 0.0)
    return found


class Comparison:
    """Compares what the engine commands in a replay with what is recorded."""

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
        self.largest: Mismatch | None = None

    def note(self, at: int) -> None:
        """Keep what is commanded in this tick, which is row ``at`` of the recording."""
        if not self._seen or not self._seen[0]:
            self._begin = at
        for (_, _, view), seen in zip(self._columns, self._seen, strict=True):
            seen.append(view.copy())
        if self._seen and len(self._seen[0]) >= _BLOCK:
            self.settle()

    def settle(self) -> None:
        """Compare what has been kept so far."""
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
                index = int(np.argmax(differences(theirs, ours)))
                worst = Mismatch(int(self._ticks[self._begin + index]), name, theirs[index], ours[index])
                if self.largest is None or worst.share > self.largest.share:
                    self.largest = worst
            seen.clear()


def _is_outcome(track: Track, name: str) -> bool:
    return track.name != "session" and (name.startswith(("command.", "sent.")) or name in ("status", "trip"))
