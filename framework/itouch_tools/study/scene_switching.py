"""Scene switching: the devices of a study stay open from trial to trial while the scene changes.

Twins wait while no tick runs.  Hardware can't: while the next scene is built it is at rest, with surfaces retracted and
drives off, and the loop goes on reading it under the previous scene.  Then, between two ticks, the devices go on with
their twins, calibrations, trips, doses and all that safety remembers (``succeed``); time goes on, too.
"""

from __future__ import annotations

import hashlib
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import TypeVar

import numpy as np

from itouch.loop import Clock, DeviceFaultError
from itouch.loop.engine import PARKINGS
from itouch.loop.release import in_turn
from itouch.plugin.discovery import Catalog
from itouch.safety import Trip
from itouch.session import Session, SessionError
from itouch.session.recorder import Continuation, Recorder
from itouch.world import DeviceModel, Model
from itouch_tools.study.machine import Sensed
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.study_store import StoredSession
from itouch_tools.study.touches import STILL, IntervalRecorder, Presented, TouchError, TouchRunner, felt_by, steer_hands

Result = TypeVar("Result")
#: Name of the mark in a session that a fault has stopped.
STOPPED = "stopped"
#: How long [s] work beside the loop may hold the interpreter at a time.
SHARE = 5e-4

#: How many recordings stay open at a time, each with a process that writes it.
OPEN = 8

#: Fields that go on besides the devices' own.
_GOES_ON = ("tick", "seed", "ready", "hold", "events.count", "events.table", "marks.count", "marks.table")

#: Fields that go on of a hand that waits for its skin: the skin's temperature at the session's start.
_BASELINE = ("baseline", "averaged")


class SceneSwitcher:
    """One session after the other, each of which continues from the State of the one before.

    Parameters
    ----------
    file, catalog
        The study and the plugins.
    seed
        Of the twins' noise.
    clock
        The clock that paces the loop.
    record
        The file to which all sessions are recorded; those whose State has other fields share a file, ``NAME.2.mcap``.
    """

    def __init__(
        self, file: StudyFile, catalog: Catalog, *, seed: int, clock: Clock | None = None, record: Path | None = None
    ) -> None:
        #: The recordings that are open, by the layout of State, the one that was used last at the end; and how many
        #: there were.
        self._record, self._recorders, self._begun = record, dict[str, Recorder](), 0
        #: Called between two ticks if somebody else runs the loop; an exception that it raises ends the session.
        self.look: Callable[[], None] | None = None
        #: Called again and again while no tick runs because some work must be finished.
        self.on_idle: Callable[[], None] | None = None
        #: Called when hardware has come to rest.
        self.on_rest: Callable[[], None] | None = None
        #: Called with each session that replaces another, before it runs.
        self.on_change: Callable[[Session], None] | None = None
        #: Called between two ticks with what a person must do first: ``lift`` the finger, ``hold`` the switch.
        self.on_wait: Callable[[str], None] | None = None
        #: What of the recording is no longer being kept, a sentence each.
        self.losses: list[str] = []
        self._file, self._catalog, self._seed = file, catalog, seed
        #: The clock that paces the loop.
        self.clock = clock
        self._models = TouchRunner(file, catalog)
        self._session: Session | None = None
        self._feeling: IntervalRecorder | None = None
        self.condition: Mapping[str, str] = {}

    @property
    def session(self) -> Session:
        """The session that runs now.

        Raises
        ------
        ValueError
            If nothing was presented yet.
        """
        if self._session is None:
            raise ValueError("nothing was presented yet")
        return self._session

    @property
    def feeling(self) -> IntervalRecorder:
        """What is noted of the present interval.

        Raises
        ------
        ValueError
            If nothing was presented yet.
        """
        if self._feeling is None:
            raise ValueError("nothing was presented yet")
        return self._feeling

    def present(self, condition: Mapping[str, str]) -> IntervalRecorder:
        """Put a condition's scene over the devices; the hand of a twin waits at the start of its path.

        A twin's hand that is still moving ends its path first: no arm can be at another place at once.  Hardware rests
        until a person who still touches has lifted the finger and somebody holds the dead-man's switch.

        Raises
        ------
        SessionError
            If real devices differ between the scenes, or the hand of a twin does not leave what it touches.
        SceneError
            If the scene has problems.
        DeviceError, DeviceFaultError
            If a device can't be enabled, or failed.
        """
        before = self._session
        if before is None:
            self.prepare(condition)
        else:
            if self._under_way:
                self.run(lambda: before.done)
            self.rest()
            session, feeling, recorded = self.beside(lambda: self._made(condition))
            if self.real:
                self._await_person(before)
            succeed(session, before)
            self._take(session, condition, feeling)
            if recorded is not None and not self.losses:
                session.go_on_recording(*recorded)
            if self.real:
                session.leave_out(before.since)
                self._enable()
        self.begin()
        return self.feeling

    def wake(self) -> None:
        """Let commands through again to hardware at rest, under the same scene."""
        if self.real and not self.acting:
            self._await_person(self.session)
            self._enable()

    def _enable(self) -> None:
        if self.look is not None:
            self.look()  # the report that the switch is held is valid only for a moment
        self.session.enable(opens=False)

    def survey(self, conditions: Iterable[Mapping[str, str]]) -> None:
        """Compile the scenes of conditions before anything begins, and check that hardware is the same in all.

        Raises
        ------
        SessionError
            If it is not.
        SceneError
            If a scene has problems.
        """
        first: Model | None = None
        for condition in conditions:
            model = self._models.model(condition)
            found = differing(model, first or model)
            if found:
                raise SessionError(f"{found} (in the condition {', '.join(f'{k}={v}' for k, v in condition.items())})")
            first = first or model

    def prepare(self, condition: Mapping[str, str]) -> None:
        """Take a condition's scene as the first, without running it yet."""
        session = self._built(condition)
        self._take(session, condition, self._feel(session))
        self._begin_recording(session)

    def begin(self) -> None:
        """Run until the rig has found its heights and may give its full force; then the hand of a twin waits."""
        session = self.session
        if not int(session.state["ready"]):  # the rig finds its heights by touch
            self.run(lambda: bool(session.state["ready"]))
        driven = [one for one in session.runners if one.model.commands and not one.model.twin]

        def whole() -> bool:
            return all(session.state[f"{one.model.name}.ramp"].item() >= 1.0 for one in driven if one.latch.enabled)

        if not whole():  # an object that is touched before would feel too soft
            self.run(whole)
        self.hold()

    @property
    def real(self) -> bool:
        """Whether any device of the scene is hardware."""
        return self._session is not None and any(not runner.model.twin for runner in self._session.runners)

    def rest(self) -> None:
        """Put hardware to rest, surfaces retracted and drives off, until the next scene is presented.  Twins only wait.

        Raises
        ------
        DeviceFaultError
            If a device could not be seen to be safe.
        """
        if not self.acting:
            return
        session = self.session
        for _ in range(PARKINGS):
            outcome = session.park()
            stopped, unsafe = session.latched(), session.unsafe(outcome)
            if stopped is not None or not unsafe:
                break
        if stopped is None and not unsafe:
            if self.on_rest is not None:
                self.on_rest()
            return
        if stopped is None:
            seen = "; ".join(f"{name}: {outcome.devices[name]}" for name in unsafe)
            stopped = DeviceFaultError(
                unsafe[0], session.ticks, Trip.DEVICE_ERROR, f"could not be put to rest ({seen})"
            )
        session.make_safe(stopped)
        raise stopped

    @property
    def acting(self) -> bool:
        """Whether commands are passed on to hardware."""
        return self.real and any(one.latch.enabled and not one.model.twin for one in self.session.runners)

    def beside(self, work: Callable[[], Result], *, whole: bool = False) -> Result:
        """Do work that may take long while nothing acts; meanwhile hardware is read on, so that it knows we are there.

        Parameters
        ----------
        work
            The work; its result is returned.
        whole
            Whether the work must be finished even if a device fails meanwhile; else it is abandoned then.

        Raises
        ------
        DeviceFaultError
            If a device failed meanwhile.
        """
        if not self.real:
            return work()
        doing: Future[Result] = Future()

        def do() -> None:
            try:
                doing.set_result(work())
            except BaseException as error:
                doing.set_exception(error)

        thread, before = threading.Thread(target=do, name="itouch-study", daemon=True), sys.getswitchinterval()
        sys.setswitchinterval(SHARE)
        thread.start()
        try:
            self.run(doing.done)
        except BaseException:
            while whole and thread.is_alive() and self.on_idle is not None:
                self.on_idle()
                thread.join(0.01)
            raise
        finally:
            sys.setswitchinterval(before)
        return doing.result()

    def _made(
        self, condition: Mapping[str, str]
    ) -> tuple[Session, IntervalRecorder, tuple[Recorder, Continuation] | None]:
        """Return the next session, what will be noted of it, and the recording in which it goes on."""
        session = self._built(condition)
        return session, self._feel(session), self._recorded(session)

    def _recorded(self, session: Session) -> tuple[Recorder, Continuation] | None:
        """Return the recording of all sessions with this one's State, and what it needs to go on with this one."""
        if self._record is None or self.losses:
            return None
        layout = layout_of(session)
        if (recorder := self._recorders.pop(layout, None)) is None:
            if len(self._recorders) == OPEN:  # the first is not the present session's, which was used last
                self._recorders.pop(next(iter(self._recorders))).close()
            self._begun += 1
            recorder = session.open_recording(self._record.with_name(f"{self._record.stem}.{self._begun}.mcap"))
        self._recorders[layout] = recorder
        return recorder, recorder.onwards(session)

    def _begin_recording(self, session: Session) -> None:
        """Record the first session."""
        if self._record is not None and not self._begun:
            self._recorders[layout_of(session)], self._begun = session.record(self._record), 1

    def _end_recordings(self) -> None:
        """End all recordings, also those in which no session is going on.

        Raises
        ------
        RecordingError
            If one could not be finished.
        """
        in_turn(*(recorder.close for recorder in self._recorders.values()))

    def _await_person(self, session: Session) -> None:
        """Run, with everything at rest, until nothing is touched and the switch is held."""

        def so() -> bool:
            waits = "lift" if touching(session) else "" if session.held else "hold"
            if waits and self.on_wait is not None:
                self.on_wait(waits)
            return not waits

        self.run(so)

    def take_up(self, standing: StoredSession) -> bool:
        """Continue from the State in which a participant's session was left; tell whether that was possible.

        It is not if State has other fields in this program.

        Raises
        ------
        SessionError
            If what was kept is not a whole State.
        """
        session = self._built(standing.condition)
        if standing.layout != layout_of(session):
            return False
        try:
            session.adopt(standing.state)
        except (ValueError, TypeError) as error:
            raise SessionError(
                f"the State after trial {standing.place + 1} is damaged, nothing can go on from it ({error}); take "
                "trials.sqlite as a backup has it"
            ) from error
        _let_pass(session)
        session.settle(always=True)
        self._take(session, standing.condition, self._feel(session))
        self._begin_recording(session)
        return True

    def standing(self, place: int) -> StoredSession:
        """Return what is kept of the session after a trial, from which it can be continued."""
        session = self.session
        return StoredSession(place, dict(self.condition), layout_of(session), session.state.tobytes())

    @property
    def _under_way(self) -> bool:
        session = self.session
        hands = [f"{probe.name}.hand.steered" for probe in session.model.probes]
        let_go = any(name in session.state and not session.state[name] for name in hands)
        return session.scripted and let_go and not session.done

    def hold(self) -> None:
        """Let the hand of a twin wait on its path."""
        steer_hands(self.session, STILL)

    def go(self) -> None:
        """Let the hand of a twin move along its path."""
        steer_hands(self.session, None)

    def sensed(self) -> Sensed:
        """Return what the machine is told of the last tick."""
        return self.feeling.sensed(self.session)

    def felt(self, void: str) -> Presented:
        """Return the touch that has ended."""
        return self.feeling.presented(self.session, void)

    def run(self, until: Callable[[], bool]) -> None:
        """Run until ``until`` returns true; it is called after every tick.

        Raises
        ------
        SessionError
            If the session can't be recorded any more and its scene ends it then.
        """
        look = self.look

        def both() -> bool:
            if look is not None:
                look()
            return until()

        self.session.run(until=until if look is None else both)
        if self.session.failed:
            raise SessionError("the session can't be recorded any more, and its scene says that it ends then")

    def close(self) -> None:
        """End the present session, unless somebody else runs the loop and will end it."""
        if self._session is not None and self.look is None:
            self._session.close()

    def _built(self, condition: Mapping[str, str]) -> Session:
        model = self._models.model(condition)
        session = Session(model, seed=self._seed, catalog=self._catalog, clock=self.clock)
        session.records = False
        return session

    def _feel(self, session: Session) -> IntervalRecorder:
        """Return the object that will note what is felt in a session that has not begun."""
        try:
            truth = felt_by(session.model)
        except TouchError:  # a scene without heat, or hardware: the report's figures are taken for what was felt
            truth = None
        return IntervalRecorder(session.model, self._file.study.contact, truth)

    def _take(self, session: Session, condition: Mapping[str, str], feeling: IntervalRecorder) -> None:
        """Make a session the present one."""
        before, self._session, self.condition = self._session, session, dict(condition)
        self._feeling = feeling
        if self.on_change is not None:
            self.on_change(session)
        feeling.listen(session)
        if before is not None:
            before.hand_over()
        session.on.closed.append(self._end_recordings)
        if self._record is not None:
            session.loss_hooks.append(lambda loss: self.losses.append(str(loss["cause"])))


def note_stop(session: Session) -> None:
    """Note the time of day at which a session was stopped by a fault, in its State."""
    session.mark(STOPPED, {"at": time.time()})


def _let_pass(session: Session) -> None:
    """Count the time since a stop in the limit on how often a device may be re-armed in a minute (W4)."""
    stops = [mark for mark in session.marks if mark["name"] == STOPPED]
    if not stops:
        return
    ticks = max(0, round((time.time() - float(stops[-1]["payload"]["at"])) / session.model.period))
    for runner in session.runners:
        rearmed = session.state[f"{runner.model.name}.rearmed"]
        rearmed[...] = np.where(rearmed >= 0, np.maximum(rearmed - ticks, -1), -1)


def layout_of(session: Session) -> str:
    """Return the SHA-256 of the fields of a session's State: their names, types and offsets."""
    return hashlib.sha256(repr(session.state.dtype).encode()).hexdigest()


def touching(session: Session) -> bool:
    """Tell whether anything is touched."""
    state = session.state
    return any(int(state[name]) >= 0 for name in state if name.endswith(".contact.object"))


def succeed(session: Session, before: Session) -> None:
    """Let a session that has not run yet go on from one with the same devices, in which nothing is touched.

    Hardware stays open and is handed from one session to the other: it is at rest meanwhile, and enabled anew.
    Objects, modalities, probes and the operator's hand begin as the new scene says; a modality's fields go on if it
    declares them to be the person's, as the heat in the finger.

    Parameters
    ----------
    session
        That of the new scene.
    before
        The session that ends; in its State only the status of hardware changes, which it no longer has.

    Raises
    ------
    SessionError
        If a device is not the same in both scenes, something is touched, or hardware is not at rest; both sessions are
        then as they were.
    """
    there, here = before.state.dtype, session.state.dtype
    known, wanted = set(there.names or ()), here.names or ()
    if touching(before):
        raise SessionError("the scene can't change while something is touched")
    _same_hardware(session, before)
    devices = tuple(f"{name}." for name in session.model.devices)
    persons = {f"{one.name}.{name}" for one in session.model.modalities for name in one.instance.persistent_fields}
    persons |= {f"{probe.name}.hand.{name}" for probe in session.model.probes for name in _BASELINE}
    merged = session.state.copy()
    for name in wanted:
        if name in persons:
            if name in known and there[name] == here[name]:
                merged[name] = before.state[name]
            continue
        if name not in _GOES_ON and not name.startswith(devices):
            continue
        if name not in known or there[name] != here[name]:
            raise SessionError(f"the scenes' devices differ in '{name}': only what is touched and asked may change")
        merged[name] = before.state[name]
    session.adopt(merged.tobytes())
    session.guarded = before.guarded
    session.settle(always=True)
    others = {runner.model.name: runner.lifecycle for runner in before.runners}
    for runner in session.runners:  # last, because from here on the new session has the hardware
        if not runner.model.twin:
            runner.lifecycle.take_over(others[runner.model.name])


def _same_hardware(session: Session, before: Session) -> None:
    """Check that each real device is the same in both sessions, and at rest.

    Raises
    ------
    SessionError
        If one is not.
    """
    found = differing(session.model, before.model)
    if found:
        raise SessionError(found)
    acting = [runner.model.name for runner in before.runners if runner.latch.enabled and not runner.model.twin]
    if acting:
        raise SessionError(f"'{acting[0]}' is real and not at rest: the scene can't change under it")


def differing(model: Model, before: Model) -> str:
    """Return the sentence on a real device, or on safety, that is not the same in two scenes; empty: all are."""
    for name in {**before.devices, **model.devices}:
        here, there = model.devices.get(name), before.devices.get(name)
        if all(one is None or one.twin for one in (here, there)):
            continue
        if here is None or there is None or _driven(here) != _driven(there):
            return f"'{name}' is real: a study may not change it, its place, settings or limits, nor leave it out"
    real = any(not device.twin for device in model.devices.values())
    if real and model.scene.safety != before.scene.safety:
        return "devices are real: a study may not change <safety>"
    return ""


def _driven(model: DeviceModel) -> tuple[object, ...]:
    """Return all that the driver of a device depends on."""
    return (
        model.twin, model.cls, model.params, model.reads, model.commands, model.limits, model.servo_period, model.mount,
        model.mount_error, model.carrier, model.touch_off, model.optional, [type(one) for one in model.monitors],
    )  # fmt: skip
