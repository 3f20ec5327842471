"""The recorder's side in the loop: what copies a row per tick into a ring, and the process that empties it."""

from __future__ import annotations

import base64
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple
from weakref import WeakMethod

import numpy as np
from numpy.typing import NDArray

from itouch.loop import DeviceFaultError
from itouch.loop.compiled_listener import CompiledListener
from itouch.loop.engine_view import Running
from itouch.loop.timing import edges, percentile
from itouch.plugin import Bound, Contact
from itouch.recording import RecordingError
from itouch.recording.chunking import MESSAGE, SPEC, STATE, message
from itouch.recording.ring import ControlWord, Phase, Ring, Shape
from itouch.recording.spec import Spec
from itouch.recording.tracks import SCENE, Track
from itouch.scene import write
from itouch.session.arrays import pack_bases
from itouch.session.paths import without_folders
from itouch.session.row_layout import FULL, Rows, copy_row, count_row
from itouch.session.snapshot import Snapshot
from itouch.session.viewer_geometry import view_of
from itouch.world.state import EVENTS

#: How many rows the ring holds (8 s at 1 kHz), and its room for messages besides States [bytes].
ROWS, LETTERS = 8192, 1 << 20
#: Simulated time [s] between two whole States, and between two notes of the timing.
STATE_EVERY, TIMING_EVERY = 10.0, 1.0
#: Ticks between two checks of the writing process.
_LOOK = 64
#: How long [s] the writing process may take to begin, and to end.
_BEGIN, _END = 20.0, 60.0
#: How long [s] the loop waits on the virtual clock for a writing process that takes nothing.
_PATIENCE = 3600.0
#: How long [s] it waits for that process in all once the run has been asked to end.
_ENOUGH = 10.0


class Continuation(NamedTuple):
    """What a recorder needs to record another session into the same file: its rows, and what copies them."""

    rows: Rows
    tap: CompiledListener


@dataclass(frozen=True, slots=True)
class SessionCalls:
    """What a recorder calls of its session: for a snapshot or report now, at a loss of data, and when it has failed."""

    snapshot: Callable[[], Snapshot]
    report: Callable[[], dict[str, Any]]
    lost: Callable[[str, str], None]
    failed: Callable[[Recorder], None]


class Recorder:
    """Records one session into one file; ``tap`` is to be among the engine's taps."""

    def __init__(self, session: Running, asked: SessionCalls, path: str, tracks: Sequence[Track]) -> None:
        self.session, self._asked, self.path, self.tracks = session, asked, path, tuple(tracks)
        self.failure = ""
        #: When a wait for the writing process first saw that the run was asked to end [s]; None: it made room since.
        self._ended: float | None = None
        self._view = view_of(session.model, session.state)
        self._rows = Rows(session.state, tracks, self._view.fields)
        spec = self._spec()
        room = LETTERS + 8 * session.state.nbytes + len(spec)
        self._ring = Ring.create(Shape(ROWS, self._rows.size, 1 << (room - 1).bit_length()))
        self._ring.post(SPEC, spec)
        self.note_state("start")  # before the process runs: the head of the file holds it, wherever the file is cut
        self._process = self._start()
        self._period = session.model.period
        self._faults, self._lost = len(session.statistics.faults), 0
        self._counted = session.times.record["counts"][:2].copy()
        self._begun = int(session.state["tick"])
        self._wait(lambda: self._ring.phase is not Phase.STARTING, _BEGIN)
        if self._ring.phase is Phase.FAILED:
            self._end()
            raise RecordingError(self._ring_text)
        #: How many events are in the file.
        self._seen = session.state["events.count"].reshape(1).copy()
        self.tap = self._tap(session, self._rows)

    def _spec(self) -> bytes:
        session, snapshot = self.session, self._asked.snapshot()
        scene = write(snapshot.scene)
        described = {
            "manifest": snapshot.manifest,
            "layout": session.state.dtype.descr,
            "scene": scene,
            "bases": base64.b64encode(pack_bases(snapshot.bases)[0]).decode(),
            "timing_edges_us": [round(1e6 * edge, 3) for edge in edges().tolist()],
        }
        places = self._rows.places
        statuses = {name: places[f"{name}.status"] for name in session.model.devices}
        period = session.model.period
        start = time.time_ns() - round(int(session.state["tick"]) * period * 1e9)
        attached = {"scene.xml": ("application/xml", scene.encode())}
        attached |= {f"files/{name}": ("application/octet-stream", data) for name, data in snapshot.files.items()}
        return Spec(self.tracks, places, statuses, period, start, described, attached, self._view).dump()

    def _start(self) -> subprocess.Popen[bytes]:
        shape, memory = self._ring.shape, self._ring.shared
        words = [memory.word, *(str(n) for n in (shape.rows, shape.row, shape.letters))]
        process = subprocess.Popen(
            [sys.executable, "-m", "itouch.recording.writing_process", *words, os.path.abspath(self.path)],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, pass_fds=memory.passed,
            start_new_session=True,
        )  # fmt: skip
        self._ring.forget()
        return process

    def _wait(self, done: Callable[[], bool], seconds: float) -> bool:
        until = time.monotonic() + seconds
        while not done() and time.monotonic() < until:
            if self._process.poll() is not None and not done():
                if self._ring.phase not in (Phase.DONE, Phase.FAILED):
                    code = self._process.returncode
                    self._ring.say(Phase.FAILED, 1, f"cannot write '{self.path}': the writing process died ({code})")
                return done()
            time.sleep(0.002)
        return done()

    def _await(self, done: Callable[[], bool]) -> bool:
        """Wait, on the virtual clock, until the writing process has made room; tell whether it has.

        It may hang, as with its disk: somebody who ends the run waits for it only for ``_ENOUGH``.  Ctrl-C is raised
        after that, for what is to be written comes from a tick that is over; at the second time it is raised at once.
        """
        try:
            return self._await_it(done)
        except KeyboardInterrupt:
            self._ended = time.monotonic()
            self._await_it(done)
            raise

    def _await_it(self, done: Callable[[], bool]) -> bool:
        found = False

        def over() -> bool:
            nonlocal found
            found = done()
            if not found and self._ended is None and self.session.stopping:
                self._ended = time.monotonic()
            return found or (self._ended is not None and time.monotonic() - self._ended > _ENOUGH)

        self._wait(over, _PATIENCE)
        if found:
            self._ended = None
        return found

    @property
    def process_id(self) -> int:
        """The process id of the writing process."""
        return self._process.pid

    @property
    def lost(self) -> int:
        """How many samples were lost because the writing process was too slow."""
        return int(self._ring.words[ControlWord.LOST])

    @property
    def waiting(self) -> int:
        """How many rows in the ring have not been written yet."""
        return int(self._ring.words[ControlWord.ROWS_IN] - self._ring.words[ControlWord.ROWS_OUT])

    @property
    def written(self) -> int:
        """How many bytes have been written to the file."""
        return int(self._ring.words[ControlWord.BYTES_WRITTEN])

    def _tap(self, session: Running, rows: Rows) -> CompiledListener:
        """Return what copies a row into the ring after each tick, and counts it: two calls, so that it is counted last.

        A compiler may move what one function writes.
        """
        ring, state, shape = self._ring, session.state, self._ring.shape
        words = np.frombuffer(ring.words, np.int64)
        slots = np.frombuffer(ring.rows, np.int64).reshape(shape.rows, -1)
        ticks, count = np.frombuffer(ring.ticks, np.int64), state["events.count"]
        copied = Bound(copy_row, words, state.words, rows.pieces, slots)
        counted = Bound(count_row, words, ticks, state["tick"], count, self._seen, _LOOK)
        answer = WeakMethod(self._answer)  # else the two held each other, and the ring, until a garbage collection

        def told(found: int, tick: int) -> None:
            if (method := answer()) is not None:
                method(found, tick)

        return CompiledListener((copied, counted), told)

    def _answer(self, found: int, tick: int) -> None:
        """Do what copying a row has left to Python: wait for room, tell of events, and look round."""
        if found == FULL:
            try:
                self._wait_for_room()
            finally:  # after Ctrl-C, too: its tick is over, and no tick is to be missing
                self._go_on(tick)
            return
        count, seen = int(self.session.state["events.count"]), self._seen.item()
        if count != seen:
            self._tell_events(seen, count)
            self._seen[0] = count
        if not tick % _LOOK:
            self._look(tick)

    @property
    def _room(self) -> bool:
        return self._ring.words[ControlWord.ROWS_OUT] + self._ring.shape.rows > self._ring.words[ControlWord.ROWS_IN]

    def _wait_for_room(self) -> None:
        """Wait for room in the ring, on the virtual clock."""
        if self.session.clock.pace != "real":
            self._await(lambda: self._room or self._over)

    def _go_on(self, tick: int) -> None:
        """Copy the row for which there was no room; count it as lost if there is still none."""
        if self._room:
            self.tap(tick)
            return
        self._ring.words[ControlWord.LOST] += 1
        if self._over or not tick % _LOOK:  # nothing more is copied, so that nothing else asks for a look
            self._look(tick)

    @property
    def _over(self) -> bool:
        return self._ring.phase in (Phase.FAILED, Phase.DONE)

    def _look(self, tick: int) -> None:
        """Do what is due from time to time: check that the process lives, and note State and timing."""
        if self._ring.phase is Phase.FAILED or self._process.poll() is not None:
            self._fail()
            return
        state_every, timing_every = (round(s / self._period) for s in (STATE_EVERY, TIMING_EVERY))
        self._tell_faults()
        if tick - self._begun >= state_every and tick // state_every != (tick - _LOOK) // state_every:
            self.note_state("every")
        if tick // timing_every != (tick - _LOOK) // timing_every:
            self._note_timing(tick)
        if self.lost != self._lost:
            self._lost = self.lost
            said = f"samples are lost: the process that writes '{self.path}' is too slow, or hangs"
            self._asked.lost("recording", said)

    def _fail(self) -> None:
        self._wait(lambda: False, 0.01)
        self.failure = self._ring_text or f"cannot write '{self.path}': the writing process died"
        self._asked.failed(self)

    @property
    def _ring_text(self) -> str:
        return self._ring.text

    def _post(self, kind: int, tick: int, topic: str, body: bytes) -> None:
        data = tick.to_bytes(8, "little", signed=True) + topic.encode() + b"\n" + body
        if self._ring.post(kind, data) or self._over:
            return
        if self.session.clock.pace != "real" and self._await(lambda: self._ring.post(kind, data) or self._over):
            return
        self._ring.words[ControlWord.LOST] += 1

    def note_state(self, reason: str) -> None:
        """Record the whole State: ``start``, ``every``, ``enable`` (a replay starts again from it) or ``fault``."""
        self._post(STATE, int(self.session.state["tick"]), reason, self.session.state.tobytes())

    def onwards(self, session: Running) -> Continuation:
        """Return what is needed to go on with another scene; nothing changes by that."""
        rows = Rows(session.state, self.tracks, self._view.fields)
        return Continuation(rows, self._tap(session, rows))

    def follow(self, session: Running, asked: SessionCalls, onwards: Continuation) -> None:
        """Go on with another scene under the same devices, whose State has the same fields; ``tap`` is then a new one.

        Such a recording can't be replayed: the file holds only the first scene, and the State of the others.
        """
        self._tell_faults()
        self.session, self._asked = session, asked
        self._rows, self.tap = onwards
        self._seen[0], self._faults = session.state["events.count"], len(session.statistics.faults)
        self._counted = session.times.record["counts"][:2].copy()
        self.note_state(SCENE)

    def hear(self, fault: DeviceFaultError) -> None:
        """Record the State of a tick that has failed, because its readings never get into a row."""
        self.note_state("fault")

    def tell(self, topic: str, tick: int, **content: Any) -> None:
        """Record a message."""
        self._post(MESSAGE, tick, topic, message(tick, self._period, **content))

    def _note_timing(self, tick: int) -> None:
        """Record the loop's timing: percentiles of all ticks, and histograms of the ticks since the last note."""
        times, waiting = self.session.times, self.waiting
        counts = times.record["counts"][1]
        greatest = float(times.record["greatest"][1])
        p50, p99 = (1e6 * (percentile(counts, percent, greatest) or 0.0) for percent in (50, 99))
        longest = 1e6 * greatest
        late, spent = times.record["counts"][:2] - self._counted
        self._counted = times.record["counts"][:2].copy()
        self.tell("/log/timing", tick, p50=p50, p99=p99, max=longest, overruns=times.overruns, lost=self.lost,
                  waiting=waiting, lateness=_filled(late), ticks=_filled(spent))  # fmt: skip

    def _tell_report(self) -> None:
        """Record the report as it is now; if it is too large, without the contacts or not at all: a replay gives it."""
        report = self._asked.report()
        report["scene"] = without_folders(str(report["scene"]))
        if len(json.dumps(report)) > LETTERS // 2:
            report = {**report, "contacts": None}
        if len(json.dumps(report)) > LETTERS // 2:  # by its faults, as of a campaign: the ring may never have room
            return
        self.tell("/log/report", int(self.session.state["tick"]), report=report)

    def _tell_events(self, seen: int, count: int) -> None:
        model, table = self.session.model, self.session.state["events.table"]
        probes = {probe.index: probe.name for probe in model.probes}
        names = table.dtype.names or ()
        for number in range(max(seen, count - EVENTS), count):
            row = dict(zip(names, (v.tolist() for v in table[number % EVENTS]), strict=True))
            kind, tick, probe, index = (row.pop(name) for name in ("kind", "tick", "probe", "object"))
            finite = {name: value for name, value in row.items() if np.isfinite(value).all()}
            self.tell(
                "/log/events", tick, kind=Contact(kind).name, probe=probes[probe], object=model.objects[index], **finite
            )

    def _tell_faults(self) -> None:
        known = self.session.statistics.faults
        for fault in known[self._faults :]:
            content = {key: value for key, value in fault.items() if key not in ("tick", "time")}
            self.tell("/log/faults", int(fault["tick"]), **content)
        self._faults = len(known)

    def close(self) -> None:
        """End the recording; wait until the file is whole.

        Raises
        ------
        RecordingError
            If it could not be finished.
        """
        if self.failure:  # which has been told
            self._end()
            return
        self._tell_faults()
        self._note_timing(int(self.session.state["tick"]))
        self._tell_report()
        self._ring.words[ControlWord.CLOSING] = 1
        done = self._wait(lambda: self._over, _END)
        text = self._ring_text if self._ring.phase is Phase.FAILED else ""
        self._end()
        if text or not done:
            raise RecordingError(text or f"cannot finish '{self.path}': the writing process does not answer")

    def _end(self) -> None:
        if self._process.stdin is not None:
            self._process.stdin.close()
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _filled(counts: NDArray[Any]) -> list[list[int]]:
    """Return index and count of the bins that are not empty."""
    used = np.flatnonzero(counts)
    return np.stack((used, counts[used]), axis=1).tolist()  # type: ignore[no-any-return]
