"""Sessions: an engine that can be saved, restored and marked, and that starts and ends the recording of its run."""

from __future__ import annotations

import contextlib
import os
import pathlib
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
from typing import Any, Protocol

from itouch.loop import Clock, Engine, engine_view
from itouch.loop.device_runner import Status
from itouch.plugin import DeviceError, Record
from itouch.plugin.bases import Bases, keeping
from itouch.plugin.discovery import Catalog
from itouch.recording import RecordingError
from itouch.safety import claim_wires, connect
from itouch.scene import Scene
from itouch.schema.notebook_display import Shown
from itouch.session import channel_selection, layout_mapping, marks, stored_limits
from itouch.session.document import to_xml
from itouch.session.participants import Participant
from itouch.session.recorder import Continuation, Recorder, SessionCalls
from itouch.session.session_error import SessionError, plainly
from itouch.session.snapshot import Saving, Snapshot, SnapshotWriter, write_snapshot
from itouch.session.state_validation import validate_state
from itouch.world import Model, accepted, survey

Path = str | os.PathLike[str]

#: How often [s of host time] the line of progress is written.
PROGRESS_EVERY = 0.2


class ExternalGuardian(Protocol):
    """A guardian that watches over a session from outside its process."""

    def rest(self) -> None:
        """Take note that all has been made safe."""

    def end(self) -> None:
        """Take note that the session has released its devices."""


class Session(Shown, Engine):
    """An engine that can be saved, and restored to go on as if it had not stopped."""

    #: Shows the session in a notebook; given by name, because the core imports nothing of the tools.
    PAGE = "itouch_tools.report.notebook:session"
    #: Makes the guardian of hardware that the caller's own process drives; given by name, as it is in a higher layer.
    GUARDIAN = "itouch.servo.own_guardian:watch"

    def __init__(
        self,
        model: Model,
        *,
        seed: int = 0,
        clock: Clock | None = None,
        catalog: Catalog | None = None,
        bases: Bases | None = None,
    ) -> None:
        self._bases, self._catalog, self._whole = bases or Bases(), catalog, bases is not None
        #: The limits that were stored with the session from which this one goes on.
        self._limits: dict[str, Any] | None = None
        self._writer: SnapshotWriter | None = None
        #: The recorder that is at work, if any; ``records``: whether a run heeds the scene's ``<record>``.
        self.recorder: Recorder | None = None
        self.records = True
        #: Whether the session was ended because it could not be recorded.
        self.failed = False
        #: The guardian of this session, if it runs in its caller's process and its hardware needs one.
        self._guardian: ExternalGuardian | None = None
        self._posted: deque[tuple[str, Any]] = deque()
        #: Called at once with each loss of a recording or a snapshot, as it stands in the report.
        self.loss_hooks: list[Callable[[dict[str, Any]], None]] = []
        #: Called at once with name and payload of each mark, in the thread that sets it; they must not block.
        self.mark_hooks: list[Callable[[str, Any], None]] = []
        with keeping(self._bases):
            super().__init__(model, seed=seed, clock=clock)
        self._participant = Participant(self, model.scene, self.note_fault) if model.scene.safety.participant else None
        self.on.begin.extend((self._carry_in, self._record_as_asked))
        self.on.act.extend((self._carry_in, self._get_guarded))
        self.on.outside.append(self.note_outside)
        self.on.left_out.append(self._note_left_out)
        self.on.safe.append(self._rest)
        self.on.closed.extend((self._end_guardian, self._end_participant, self.end_recording))

    @classmethod
    def of(cls, scene: Scene, *, catalog: Catalog, seed: int = 0, clock: Clock | None = None) -> Session:
        """Build a session from a scene; the results of eigen-solves are kept for its snapshots."""
        bases = Bases()
        with keeping(bases):
            found = survey(scene, catalog)
            model = accepted(found, channel_selection.recording_problems(found) if found.model is None else ())
            return cls(model, seed=seed, clock=clock, catalog=catalog, bases=bases)

    def tell(self, notice: str) -> None:
        """Add a notice."""
        self.notes += (notice,)

    def _snapshots(self) -> SnapshotWriter:
        if self._writer is None:
            if self._catalog is None:
                self._catalog = Catalog()
            if not self._whole:  # the model was compiled elsewhere: collect the results of its eigen-solves
                with keeping(self._bases):
                    Model.of(self.model.scene, self._catalog)
            self._writer = SnapshotWriter(self.model, self.state, self._bases, self._catalog, self._limits)
        return self._writer

    def pack(self, state: Record | None = None, ledger: dict[str, Any] | None = None) -> bytes:
        """Return the bytes of a snapshot: of the session now, or of a State and a ledger that were taken before."""
        return self._snapshots().pack(state if state is not None else self.state, ledger or self.statistics.dump())

    def saving(self, path: Path, every: float) -> Saving:
        """Return a context in which the session is saved every ``every`` seconds while it runs.

        Raises
        ------
        SessionError
            If the session is being recorded to that file.
        """
        self._refuse_recording(path)
        return Saving(self, self.pack, self.note_fault, os.fspath(path), every)

    def save(self, path: Path) -> None:
        """Write a snapshot; never half a file: the old one stays until the new one is whole.

        Raises
        ------
        SessionError
            If it can't be written, or the session is being recorded to that file.
        """
        self._refuse_recording(path)
        write_snapshot(path, self.pack())

    def _refuse_recording(self, path: Path) -> None:
        """Refuse to put a snapshot in the place of the recording that is being written: it would be lost."""
        with contextlib.suppress(OSError):  # there is no such file yet
            if self.recorder is not None and os.path.samefile(path, self.recorder.path):
                raise SessionError(f"cannot write '{os.fspath(path)}': the session is being recorded to it")

    def snapshot(self) -> Snapshot:
        """Return the content of a snapshot of the session now."""
        record = Record.__array__(self.state, copy=True).reshape(1)
        manifest = self._snapshots().manifest(self.state)
        files = {file.file: file.data for file in self.model.files}
        return Snapshot(self.model.scene, record, manifest, self.statistics.dump(), dict(self._bases.used), files)

    def to_xml(self) -> str:
        """Return the whole session as one XML document, from which ``restore`` gets the same bytes back."""
        return to_xml(self.snapshot())

    def run(
        self,
        seconds: float | None = None,
        *,
        until: Callable[[], bool] | None = None,
        each: Callable[[], None] | None = None,
        every: int = 1,
        progress: bool = False,
    ) -> None:
        """Run as ``Engine.run`` says; if the scene has a ``<record>``, it is recorded from the first run to ``close``.

        With ``progress`` a line on the standard error shows how far the run is; the State is the same as without.

        Raises
        ------
        RecordingError
            If the recording that the scene asks for can't begin.
        """
        if not progress:
            super().run(seconds, until=until, each=each, every=every)
            return
        with progress_shown(lambda: self.seconds, seconds) as tell:

            def both() -> None:
                tell()
                if each is not None:
                    each()

            often = every if each is not None else max(1, round(0.02 / self.model.period))
            super().run(seconds, until=until, each=both, every=often)

    def _record_as_asked(self) -> None:
        element = self.model.scene.record
        if element is not None and self.records and self.recorder is None:
            self.record(channel_selection.file_name(element.to, self.model.scene.source, int(self.state["seed"])))

    def _carry_in(self) -> None:
        """Count the participant's earlier sessions before anything acts, and begin to note what this session uses."""
        if self._participant is not None:
            before = self.state.tobytes()
            told = self._participant.carry_in()
            if self.state.tobytes() != before:
                self.note_outside("participant")
            self.notes += tuple(text for text in told if text not in self.notes)
            self._participant.begin()

    def record(self, path: Path) -> Recorder:
        """Record from now on into a file, until ``close``.

        Raises
        ------
        RecordingError
            If the file can't be written, or the session is being recorded already.
        SceneError
            If the scene chooses a channel that does not exist.
        """
        if self.recorder is not None:
            raise RecordingError(f"the session is being recorded to '{self.recorder.path}'")
        recorder = self.open_recording(path)
        self._record_by(recorder)
        return recorder

    def open_recording(self, path: Path) -> Recorder:
        """Begin a recording in which a session will go on, this one or another whose State has the same fields.

        Raises
        ------
        RecordingError, SceneError
            As `record` says.
        """
        target = os.fspath(path)
        tracks = channel_selection.tracks_of(self.model, self.state)
        self.notes += tuple(note for note in channel_selection.recording_notes(self.model) if note not in self.notes)
        try:
            os.makedirs(os.path.dirname(target) or ".", exist_ok=True)
        except OSError as error:
            raise RecordingError(f"cannot write '{target}': {error.strerror or error}") from error
        if pathlib.Path(target).is_fifo():  # the recorder's process would wait for a reader, even after this one's end
            raise RecordingError(f"cannot write '{target}': it is a pipe, not a file")
        return Recorder(self, self._asked, target, tracks)

    @property
    def _asked(self) -> SessionCalls:
        return SessionCalls(self.snapshot, self.report, self.note_fault, self.recording_failed)

    def _record_by(self, recorder: Recorder) -> None:
        self.recorder, self.records = recorder, False
        self.taps.append(recorder.tap)
        self.on.fault.append(recorder.hear)

    def go_on_recording(self, recorder: Recorder, onwards: Continuation) -> None:
        """Go on in a recording of sessions whose States have the same fields as this one's.

        Parameters
        ----------
        recorder
            One with which no other session is recorded now.
        onwards
            What the recorder's ``onwards`` returned for this session.
        """
        recorder.follow(self, self._asked, onwards)
        self._record_by(recorder)

    def hand_over(self) -> Recorder | None:
        """Let go of the recording, if there is one: it is neither written to nor ended any more by this session."""
        recorder, self.recorder = self.recorder, None
        if recorder is not None:
            self._let_go(recorder)
        return recorder

    def end_recording(self) -> None:
        """End the recording, if there is one; the session goes on.

        Raises
        ------
        RecordingError
            If it could not be finished.
        """
        recorder = self.hand_over()
        if recorder is not None:
            try:
                recorder.close()
            except RecordingError as error:
                self.note_fault("recording", str(error))
                raise

    def recording_failed(self, recorder: Recorder) -> None:
        """Note that recording has stopped; the session goes on, or ends after this tick, as the scene says."""
        self._let_go(recorder)
        self.note_fault("recording", recorder.failure)

    def note_fault(self, trip: str, cause: str) -> None:
        """Note a loss of the session's data, ``trip`` being "recording" or "saving", and call the loss hooks at once.

        If the scene's ``<record>`` says so, the session ends after this tick.  The same loss again is only counted.
        """
        element, tick = self.model.scene.record, int(self.state["tick"])
        seconds = tick * self.model.period
        last = next((fault for fault in reversed(self.statistics.faults) if fault.get("trip") == trip), None)
        if last is not None and last["cause"] == cause:
            last["times"], last["until_s"] = int(last.get("times", 1)) + 1, seconds
            return
        place = self.model.scene.places.of(element) if element is not None and trip == "recording" else None
        entry: dict[str, Any] = {"device": "recorder" if trip == "recording" else "session", "tick": tick}
        entry |= {"time_s": seconds, "trip": trip, "cause": cause}
        entry |= {"scene": str(place) if place is not None else None}
        entry["ends"] = element is not None and element.on_failure == "stop"
        self.statistics.faults.append(entry)
        for hook in self.loss_hooks:
            hook(entry)
        if entry["ends"]:
            self.failed = True
            self.stop()

    def _note_left_out(self, seconds: float, running: bool) -> None:
        """Note it in a recording: a replay does the same."""
        if self.recorder is not None:
            self.recorder.tell("/log/left_out", self.ticks, seconds=seconds, running=int(running))

    def _get_guarded(self) -> None:
        """Start a guardian over hardware, which would keep its last command if this process died, unless one is there.

        Raises
        ------
        DeviceError
            If there can be none.
        """
        if self.guarded or self._guardian is not None or all(device.twin for device in self.model.devices.values()):
            return
        self.claim_wires()  # before its guardian guards them: who else has one is told by name
        module, _, name = self.GUARDIAN.partition(":")
        self._guardian = getattr(import_module(module), name)(self)

    def _rest(self) -> None:
        if self._guardian is not None:
            self._guardian.rest()

    def _end_guardian(self) -> None:
        guardian, self._guardian = self._guardian, None
        if guardian is not None:
            guardian.end()

    def note_outside(self, reason: str) -> None:
        """Tell a recording that the State was changed from outside the loop: a replay starts again from it."""
        if self.recorder is not None:
            self.recorder.note_state(reason)

    def mark(self, name: str, payload: Any = None) -> None:
        """Note a mark, such as the start of a trial, before the next tick: in State, and in the recording.

        Parameters
        ----------
        name
            1 to 32 bytes of printable text.
        payload
            Anything that is JSON, at most 512 bytes of it.

        Raises
        ------
        ValueError
            If name or payload can't be kept.
        """
        stored, text = marks.encode(name, payload)
        tick = marks.put(self.state, stored, text)
        for hook in self.mark_hooks:
            hook(name, payload)
        if self.recorder is not None:
            self.recorder.tell("/log/marks", tick, name=name, payload=text.decode())

    def post_mark(self, name: str, payload: Any = None) -> None:
        """Note a mark from another thread or a signal handler: it is set between this tick and the next.

        Raises
        ------
        ValueError
            If name or payload can't be kept.
        """
        marks.encode(name, payload)
        self._posted.append((name, payload))
        if self._take_marks not in self.taps:
            self.taps.append(self._take_marks)

    def _take_marks(self, tick: int) -> None:
        while self._posted:
            self.mark(*self._posted.popleft())

    @property
    def marks(self) -> list[dict[str, Any]]:
        """The last marks, oldest first: tick, name, payload."""
        return marks.remembered(self.state)

    def _end_participant(self) -> None:
        if self._participant is not None:
            self._participant.end()

    def _let_go(self, recorder: Recorder) -> None:
        if recorder.tap in self.taps:
            self.taps.remove(recorder.tap)
            self.on.fault.remove(recorder.hear)

    def open_readable(self) -> None:
        """Open the hardware that opening does not move, so that it can be read; enabling it stays an explicit step."""
        held = claim_wires([one.lifecycle for one in self.runners if not one.model.cls.moves_on_open])
        self.notes += tuple(f"device '{name}' stays closed: {why}" for name, why in held.items())
        if any(not self.model.devices[name].optional for name in held):  # then open no other either: all are needed
            return
        for runner in self.runners:
            model = runner.model
            if model.twin or model.name in held or runner.latch.status is not Status.CLOSED:
                continue
            if model.cls.moves_on_open:
                self.notes += (f"device '{model.name}' stays closed until it is enabled: opening it moves it",)
                continue
            try:
                runner.lifecycle.open()
            except DeviceError as error:
                self.notes += (f"device '{model.name}' stays closed: {error}",)

    def claim_wires(self) -> None:
        """Claim the wires of all hardware for this session, before anything is opened.

        Raises
        ------
        DeviceError
            If another process, or another session, has one; nothing is claimed or open then.
        """
        needed = [one for one in self.runners if not one.model.optional]
        if held := claim_wires([one.lifecycle for one in needed]):
            self.release()
            raise DeviceError("\n".join(f"device '{name}': {why}" for name, why in held.items()))

    def find_hardware(self) -> None:
        """Open the hardware that opening does not move, all at once: what is missing is told before anybody waits.

        It may be called again while somebody waits: devices that are open are then read once more.

        Raises
        ------
        DeviceError
            With every device that is not optional and is missing, or has failed since.
        """
        hardware = [one for one in self.runners if not one.model.twin and not one.lifecycle.awaited]
        wanted = [one for one in hardware if not one.model.optional]
        moving = [one.model for one in wanted if one.model.cls.moves_on_open and one.latch.status is Status.CLOSED]
        failures = {model.name: why for model in moving if (why := model.unavailable_reason())}
        standing = [one.lifecycle for one in wanted if not one.model.cls.moves_on_open]
        try:
            failures |= connect(standing, self.ticks, meanwhile=lambda: engine_view.tell(self.on.waiting))
        except BaseException:  # nobody waits any more
            self.release()
            raise
        if failures:
            self.release()
            raise DeviceError("\n".join(f"device '{name}': {why}" for name, why in failures.items()))

    def take_up(self, snapshot: Snapshot, *, replays: bool = False) -> None:
        """Go on from a snapshot of the same scene.

        Raises
        ------
        SessionError
            If its State can't be mapped to this program's, or is not a possible one; or, unless it only ``replays``, if
            a limit would be looser than it was.
        """
        told = self._compare_limits(snapshot, replays=replays)
        stored, said = layout_mapping.adopt(
            snapshot.state, self.state, snapshot.manifest.get("plugins", {}), layout_mapping.changed_fields(self.model)
        )
        before = self.state.tobytes()
        self.adopt(stored)
        try:
            with keeping(self._bases):  # the layout of twins' fields depends on their bases
                validate_state(self.model, self.state)
            self.statistics.load(snapshot.ledger)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            self.adopt(before)
            raise SessionError(f"the session can't be resumed: {plainly(error)}") from error
        self.notes = (*told, *said, *self.statistics.notices())
        here = self._snapshots().manifest(self.state)
        other = any(snapshot.manifest.get(key) not in (None, here[key]) for key in ("model", "contact"))
        if other or snapshot.edited:
            self.notes += (
                "the scene compiles to other numbers here than where the session was saved (another version or "
                "machine, or the file was edited): it goes on, but not byte for byte",
            )

    def _compare_limits(self, snapshot: Snapshot, *, replays: bool) -> list[str]:
        """Return a notice for each limit that differs from that with which the session was stored.

        Raises
        ------
        SessionError
            If one is looser here, unless it only ``replays``, or if the stored limits are missing.
        """
        stored = snapshot.manifest.get("limits")
        if stored is None:
            if snapshot.manifest.get("format") in ("1.0", "1.1"):
                return ["the session was stored by a version that did not note its limits: those of its scene hold"]
            raise SessionError("the session does not say which limits were in force: it is not whole, or was edited")
        looser, tighter = stored_limits.compared(stored, self.model)
        if looser and not replays:
            listed = "\n".join(f"  {line}" for line in looser)
            raise SessionError(
                f"the session would run under looser limits than it was stored with:\n{listed}\n"
                "it was edited, or another version has other defaults; start a new session from the scene"
            )
        self._limits = stored
        return [f"limit of {line}" for line in (*looser, *tighter)]


@contextmanager
def progress_shown(now: Callable[[], float], seconds: float | None) -> Iterator[Callable[[], None]]:
    """Yield a function to be called often during a run, which writes the progress line; the context ends the line.

    Parameters
    ----------
    now
        Returns the simulated time [s].
    seconds
        How long the run will be [s]; None: not known.
    """
    began, begin = time.monotonic(), now()
    last = [0.0]

    def line() -> str:
        done, took = now() - begin, time.monotonic() - began
        of = f" of {seconds:.1f}" if seconds is not None else ""
        return f"{done:.1f}{of} s simulated, {done / max(took, 1e-9):.1f} x real time"

    def write(end: str) -> None:
        with suppress(OSError, ValueError):  # the reader of the stream may be gone: the run goes on
            print(f"\r{line()}   ", end=end, file=sys.stderr, flush=True)

    def tell() -> None:
        if time.monotonic() - last[0] >= PROGRESS_EVERY:
            last[0] = time.monotonic()
            write("")

    try:
        yield tell
    finally:
        write("\n")
