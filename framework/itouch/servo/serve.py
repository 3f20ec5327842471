"""The servo process's work with an engine: pacing it, obeying commands, publishing State and report to the end."""

from __future__ import annotations

import base64
import contextlib
import os
import time
from typing import Any

from itouch.loop import DeviceFaultError, LatchedError, WallClock, builtins_guard
from itouch.loop.builtins_guard import LoadedModules
from itouch.loop.device_runner import Status
from itouch.loop.fault_attribution import changed_python, ended_by
from itouch.loop.release import in_turn
from itouch.platforms import hardware_refused, lives
from itouch.plugin import Role
from itouch.scene import write
from itouch.servo import control_block as at
from itouch.servo import realtime
from itouch.servo.command_queue import Inbox
from itouch.servo.deadman_holders import Switch
from itouch.servo.error_transport import let_go
from itouch.servo.launcher_pipe import Outbox
from itouch.servo.operator_requests import Commands, OperatorRequests
from itouch.servo.parent_process import ProcessEnd, gone
from itouch.servo.prepare import prepare, prepare_text
from itouch.servo.publish import ORDERED, TIMING_EVERY, Publisher, slots_for
from itouch.servo.remote import Remotes
from itouch.servo.shared_memory import ServoError, SharedMemory, monotonic
from itouch.session import Session
from itouch.session.outputs import Outputs, open_outputs

#: How often [s] the servo process checks for commands and the like while the engine rests.
IDLE = 1e-3
#: How often [s] it reads hardware while it waits for somebody to enable it.
LOOK = 0.2
#: How long [s] the guardian may take to start: it may have to load drivers.
GUARDIAN_START = 30.0
#: Silence [ns] of the guardian that ends a session whose devices obey.
GUARDIAN_SILENCE = 500_000_000
#: For how many devices a control word has bits.
MOST_DEVICES = 62
CLOSED = int(Status.CLOSED)
_LEFT_ALONE = "the guardian process has died or hangs: the devices have been made safe"
_NEVER_ALONE = "the guardian process died while the session began: nothing is enabled without it"


def build(config: dict[str, Any]) -> Session:
    """Build the engine that the launcher asks for.

    Raises
    ------
    ItouchError
        If the scene, the session or the rig is wrong.
    """
    if config.get("scene_xml") is not None:
        files = config["files"]
        content = None if files is None else {name: base64.b64decode(text) for name, text in files.items()}
        return prepare_text(
            config["scene_xml"], shown=config["scene"], seed=config["seed"], folder=config["folder"], files=content
        )
    return prepare(config["scene"], seed=config["seed"], twin=config["twin"], rig=config["rig"])


def serve(segment: SharedMemory, outbox: Outbox, config: dict[str, Any]) -> tuple[dict[str, Any], BaseException | None]:
    """Build and run the session that the launcher asks for; return its report, and the error that ended it, if any."""
    return Servo(build(config), segment, outbox, config).run()


def meta_of(session: Session, remotes: dict[str, str], sys_path: list[str]) -> dict[str, Any]:
    """Return the description of a session for its memory.

    ``remotes``: device -> address of its remote twin; ``sys_path``: where another process finds plugins.
    """
    model = session.model
    hardware = [device.name for device in model.devices.values() if not device.twin]
    return {
        "source": model.scene.source,
        "scene_xml": write(model.scene),
        "folder": model.scene.folder,
        "period": model.period,
        "dtype": repr(session.state.dtype.descr),
        "parts": list(session.times.parts),
        "objects": list(model.objects),
        "probes": [probe.name for probe in model.probes],
        "devices": list(model.devices),
        "notices": list(session.notices),
        "remotes": remotes,
        "hardware": hardware,
        "second_openers": [
            name for name in hardware if model.devices[name].cls.second_opener_for(model.devices[name].params)
        ],
        "sys_path": [entry for entry in sys_path if entry],
    }


def unsent(session: Session) -> int:
    """Return, a bit each, the devices whose last command could not be written; another process may reach them."""
    found = 0
    for index, runner in enumerate(session.runners[:MOST_DEVICES]):
        if runner.gate.actuation.unsent and runner.latch.number != CLOSED:
            found |= 1 << index
    return found


class _EndAsked(BaseException):
    """The session is to end while devices are being opened."""


class Servo:
    """Runs one session in this process."""

    def __init__(self, session: Session, segment: SharedMemory, outbox: Outbox, config: dict[str, Any]) -> None:
        self.session, self.outbox, self._config = session, outbox, config
        session.clock, session.guarded = WallClock(), True
        if refused := hardware_refused(self._hardware()):
            raise ServoError(refused)
        session.claim_wires()
        self.remotes = Remotes(session, segment.name)
        state, timing = session.state, session.times
        segment.grow(
            self._meta(), state.nbytes, timing.record.nbytes, slots_for(state.nbytes, session.model.period),
            not ORDERED, session.model.scene.files,
        )  # fmt: skip
        self.words = segment.words
        self._publisher = Publisher(segment, state, timing)
        self._inbox = Inbox(segment)
        self._switch = Switch(segment.words)
        self._end_of_guardian = ProcessEnd(lambda: int(segment.words[at.GUARDIAN]))
        for runner in session.runners:
            runner.lifecycle.guardian = lambda: int(segment.words[at.GUARDIAN])
        self._asked = OperatorRequests(bool(config["enable"]) or not self._hardware())
        self._commands = Commands(session, outbox, self._asked, self.report)
        self._told = len(session.statistics.contacts)
        self._launcher = int(config.get("launcher", os.getppid()))
        self._held = self._armed = False
        self._kept = contextlib.ExitStack()
        self._failure: BaseException | None = None
        #: Whether any device obeys that would outlive this process: then the guardian must live, too.
        self._obeyed = bool(self._hardware() or self.remotes.addresses)

    def _hardware(self) -> list[str]:
        return [device.name for device in self.session.model.devices.values() if not device.twin]

    def _meta(self) -> dict[str, Any]:
        return meta_of(self.session, self.remotes.addresses, self._config["sys_path"])

    def run(self) -> tuple[dict[str, Any], BaseException | None]:
        """Run to the end; return the report, and the error that ended the run if one did."""
        error: BaseException | None = None
        modules = LoadedModules()
        try:
            self._kept.enter_context(open_outputs(self.session, Outputs(**self._config["keep"])))
            self.session.on.waiting.append(self._look_while_opening)
            with contextlib.suppress(_EndAsked):
                self._begin()
            self._run()
            error = self._failure
        except BaseException as raised:
            builtins_guard.put_back()
            error = ended_by(self.session.fault, raised)
            let_go(raised)
        builtins_guard.put_back()
        harmed = modules.put_back()
        if harmed and error is None and self.session.runners:
            error = changed_python(self.session.model, self.session.ticks, harmed)
            self.session.make_safe(error)
        begun = self.words[at.PHASE] >= at.READY
        self.words[at.PHASE] = at.ENDING
        # a session that was ended before it was ready replaces no saved one
        last = (self._save, self._publish_last) if begun else (self._publish_last,)
        for act in (self._park, self._release, self._finish, *last):
            try:
                act()
            except BaseException as raised:
                error = error or raised
        return self.report(), error

    def _publish_last(self) -> None:
        """Publish the State at the end, Timing, and the last contact."""
        self._tell_contacts(self.session.statistics.contacts)
        self._publish(0.0, 0.0)
        self._publisher.publish_timing()

    def _save(self) -> None:
        """Save the session at its end, if that is asked for; an error that ended it counts more than one here."""
        if self._config["save"]:
            self.session.save(self._config["save"])

    def _park(self) -> None:
        """Make devices that are not simulated in this process safe, in the rig's order, unless a fault has done so."""
        enabled = any(runner.latch.enabled for runner in self.session.runners)
        if self.words[at.ARMED] and (self.session.fault is None or enabled):
            self.session.shut_down()
        self.words[at.ARMED] = 0  # all is safe: releasing the devices may take its time

    def _release(self) -> None:
        """Release the devices; if one can't even be closed, the guardian makes it safe."""
        try:
            self.session.release()
        finally:
            self.remotes.hang_up()
            hardware = [runner for runner in self.session.runners if not runner.model.twin]
            if all(runner.latch.status is Status.CLOSED for runner in hardware):
                self.words[at.ARMED] = 0

    def _finish(self) -> None:
        """End what takes long to end: recordings, and the twins' processes."""
        in_turn(self._kept.close, self.session.close, self.remotes.close)

    def _begin(self) -> None:
        """Become punctual, tell the launcher, and enable the devices once the operator wants that."""
        efforts = realtime.be_punctual() if self._config["realtime"] else (realtime.sharpen_timer(),)
        self._publish(0.0, 0.0)
        self.words[at.PHASE] = at.READY
        ready = {"efforts": [[effort.what, effort.done, effort.said] for effort in efforts]}
        self._await_guardian()
        self.remotes.connect()
        if self._hardware():
            self.session.find_hardware()
        self._watch_others()
        if self._waits():  # the operator must see the session before anything may move
            self.outbox.tell("ready", ready)
        looked = time.monotonic()
        while self._waits() and not self.words[at.STOP]:
            self._rest()
            if self._hardware() and time.monotonic() > looked + LOOK:
                self.session.find_hardware()  # so that nobody goes on holding a switch for a device that is lost
                looked = time.monotonic()
        if self.words[at.STOP]:
            return
        # opening and homing may take long, and remote twins may be lost; twins in this process need no enabling here
        if self._obeyed:
            self._enable()
            self._watch_others()  # the launcher or the guardian may have died meanwhile
        self.outbox.tell("ready", ready)

    def _enable(self) -> None:
        """Enable; with ``linger``, a restored session whose trip is latched rests until somebody re-arms it."""
        try:
            self.session.enable()
        except LatchedError:
            if not self._config.get("linger"):
                raise
            self.session.fault = self.session.latched()
            self._tell_fault()

    def _waits(self) -> bool:
        """Tell whether the operator has not enabled the devices yet, or does not hold the switch that they need."""
        model = self.session.model
        needed = model.scene.safety.hold_to_run or bool(self._hardware())
        switch = any(device.reading(Role.DEADMAN) is not None for device in model.devices.values())
        return (
            not self._asked.enabled or bool(self._commands.reconnecting) or (needed and not switch and not self._held)
        )

    def _await_guardian(self) -> None:
        """Wait for the guardian, which must live before devices that obey are enabled.

        Raises
        ------
        ServoError
            If it does not start.
        """
        deadline = time.monotonic() + GUARDIAN_START
        while self._obeyed and not self.words[at.GUARDIAN_BEAT] and not self.words[at.STOP]:
            guardian = int(self.words[at.GUARDIAN])
            if time.monotonic() > deadline or (guardian and not lives(guardian)):
                raise ServoError("the guardian process did not start: nothing is enabled without it")
            self._rest()

    def _run(self) -> None:
        session, seconds = self.session, self._config["seconds"]
        last = None if seconds is None else session.ticks + round(seconds / session.model.period)
        self._scripted = last is None and session.scripted
        session.taps.append(self._tap)
        session.loss_hooks.append(self._tell_loss)
        self._follow_once()
        self.words[at.BEAT] = monotonic()
        self.words[at.PHASE] = at.RUNNING
        with contextlib.suppress(_EndAsked):
            self._tick_to_the_end(last)
        if session.fault is not None:
            raise session.fault

    def _tick_to_the_end(self, last: int | None) -> None:
        """Run until the session is over or is to end; rest while it is paused or stopped by a fault."""
        session = self.session
        while not self.words[at.STOP] and not self._over(last):
            if self._asked.paused or session.fault is not None:
                self._rest()
                continue
            left = None if last is None else (last - session.ticks) * session.model.period
            try:
                session.run(left, until=self._interrupted)
            except DeviceFaultError:
                if not self._config.get("linger"):
                    raise
                self._tell_fault()

    def _follow_once(self) -> None:
        """Do once, before the first tick, what follows each: the first time takes longer than a period at 4 kHz."""
        unsent(self.session)
        self._publish_last()
        self.outbox.flush()
        self._watch_others()

    def _tell_loss(self, loss: dict[str, Any]) -> None:
        self.words[at.LOST] |= 1 if loss["trip"] == "recording" else 2
        self.outbox.tell("loss", {"loss": loss})

    def _tell_fault(self) -> None:
        met = [fault for fault in self.session.statistics.faults if not fault.get("optional")]
        if met:
            self.outbox.tell("fault", {"fault": met[-1]})

    def _over(self, last: int | None) -> bool:
        return self.session.ticks >= last if last is not None else self._scripted and self.session.done

    def _interrupted(self) -> bool:
        """Check the control words after a tick; return true if the run must pause or end."""
        words = self.words
        if words[at.ASKED] != words[at.TAKEN]:
            for message in self._inbox.take():
                self._commands.carry_out(message)
        if self._commands.reconnecting:
            self._commands.settle()
        self._hold()
        return bool(words[at.STOP]) or self._asked.paused or (self._scripted and self.session.done)

    def _rest(self) -> None:
        """Do what the loop does between ticks while it does not tick, and sleep a little."""
        self.words[at.BEAT] = monotonic()
        for message in self._inbox.take():
            self._commands.carry_out(message)
        if self._commands.settle():
            self._publish(0.0, 0.0)  # no tick shows what the device may do now
        self._hold()
        self.outbox.flush()
        self._watch_others()
        time.sleep(IDLE)

    def _look_while_opening(self) -> None:
        """Do what cannot wait while devices are being opened, which may take long.

        Raises
        ------
        _EndAsked
            If the session is to end.
        """
        self.words[at.BEAT] = monotonic()
        self.outbox.flush()
        self._watch_others()
        if self.words[at.STOP]:
            raise _EndAsked

    def _hold(self) -> None:
        """Pass on to the engine whether somebody holds the dead-man's switch, and whether a holder has let go."""
        held, released = self._switch.look()
        if released:
            self.session.hold(False, shared=held)
        elif held:
            self.session.hold()
        self._held = held

    def _tap(self, tick: int) -> None:
        """Publish; called after every tick, also in the safe sequence."""
        if not self._armed:  # nothing was commanded before the first tick
            self._armed = True
            self.words[at.BEAT] = monotonic()
            self.words[at.ARMED] = int(self._obeyed)
        self.words[at.UNSENT] = unsent(self.session)
        times, stamps = self.session.times, self.session.stamps
        self._publish(times.late, float(stamps[-1] - stamps[0]))
        self._tell_contacts(self.session.statistics.closed)  # not what a tick would first have to put together
        if tick % TIMING_EVERY == 0:
            self._publisher.publish_timing()
            self.outbox.flush()
            self._watch_others()

    def _tell_contacts(self, contacts: list[dict[str, Any]]) -> None:
        """Tell the launcher of contacts that have ended since it was told last."""
        if len(contacts) > self._told:
            self.outbox.tell("contacts", {"contacts": contacts[self._told :]})
            self._told = len(contacts)

    def _watch_others(self) -> None:
        """End the session if its launcher is gone, or if no guardian watches over devices that obey or are about to.

        A guardian that only hangs ends it once devices obey; before that, both processes are busy with their start.
        """
        words = self.words
        if gone(self._launcher):
            words[at.STOP] = 1
        armed = bool(words[at.ARMED])
        silent = armed and monotonic() - int(words[at.GUARDIAN_BEAT]) > GUARDIAN_SILENCE
        if self._obeyed and not words[at.STOP] and (silent or self._end_of_guardian.seen()):
            self._failure = ServoError(_LEFT_ALONE if armed else _NEVER_ALONE)
            words[at.STOP] = 1

    def _publish(self, late: float, duration: float) -> None:
        self.words[at.BEAT] = monotonic()
        self._publisher.publish(self.session.ticks, late, duration)

    def report(self) -> dict[str, Any]:
        """Return the session's report, with what only the servo process knows: commands obeyed, States published."""
        return {**self.session.report(), "commands": self._commands.log, "publication": self._figures()}

    def _figures(self) -> dict[str, Any]:
        return {"published": int(self.words[at.HEAD]), "slots": int(self.words[at.SLOTS])}
