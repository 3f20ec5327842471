"""A participant's session on a rig with hardware: the same trials, in the servo process, led from the desk.

Nothing about what is touched is published: a program attached to the session would see the condition.
"""

from __future__ import annotations

import contextlib
import gc
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from itouch.loop import DeviceFaultError, LatchedError, Status, WallClock
from itouch.plugin import Record
from itouch.plugin.discovery import Catalog
from itouch.servo import control_block as at
from itouch.servo.launcher_pipe import Outbox
from itouch.servo.publish import TIMING_EVERY, Publisher
from itouch.servo.serve import IDLE, Servo
from itouch.servo.shared_memory import ServoError, SharedMemory, monotonic
from itouch.session import Session
from itouch_tools.study.answer_sources import Question, Stopped
from itouch_tools.study.external_control import Served
from itouch_tools.study.participant_session import Run
from itouch_tools.study.reading import each_level_once, load_study
from itouch_tools.study.scene_switching import SceneSwitcher
from itouch_tools.study.server import StudyServer
from itouch_tools.study.session_display import Shown
from itouch_tools.study.study_store import Store, StoreError


class PostedAnswers:
    """Answers that come from the desk."""

    def __init__(self, outbox: Outbox) -> None:
        self._outbox, self._place = outbox, -1
        self._answer: str | None = None

    def ask(self, question: Question) -> None:
        """Send a question to the desk; answers to other questions do not count."""
        self._place, self._answer = question.place, None
        self._outbox.tell("ask", asdict(question))

    def poll(self, waited: float) -> str | None:
        """Return the answer, once."""
        answer, self._answer = self._answer, None
        return answer

    def tell(self, words: str) -> None:
        """Send a message for the participant to the desk."""
        self._outbox.tell("tell", {"words": words})

    def take(self, place: int, answer: str) -> None:
        """Take an answer that has come from the desk."""
        if place == self._place:
            self._answer = answer


class PostedOperator:
    """The operator at the desk."""

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self.paused = self.stopped = self.held = False

    def show(self, face: Shown, lines: Sequence[tuple[str, bool]]) -> None:
        """Send the desk what to show to the participant and to the operator."""
        self._outbox.tell("shown", {"face": asdict(face), "lines": [list(line) for line in lines]})

    def notes(self) -> list[str]:
        """Return none: the desk keeps the notes that are written there."""
        return []


class RigSession(Servo):
    """Runs the work with a scene switcher in this servo process: session after session, on the same open devices.

    Parameters
    ----------
    switcher
        The scene switcher; it has its first session, which has not run yet.
    work
        Runs the work to its end.
    obey
        Takes what comes from the desk, between two ticks.

    Raises
    ------
    ServoError
        If a twin is remote: its process would not know of the next scene.
    """

    def __init__(
        self, switcher: SceneSwitcher, work: Callable[[], None], obey: Callable[[str, Any], None],
        segment: SharedMemory, outbox: Outbox, config: dict[str, Any],
    ) -> None:  # fmt: skip
        session = switcher.session
        remote = [runner.model.name for runner in session.runners if runner.model.remote]
        if remote:
            raise ServoError(f"'{remote[0]}' is a remote twin: a study changes its scene; use twin=\"yes\"")
        super().__init__(session, segment, outbox, config)
        self._work, self._obey = work, obey
        #: What is published: what was sent to the devices, for the guardian, and the tick.
        self._told_of = Record(session.state.dtype)
        self._publisher = Publisher(segment, self._told_of, session.times)
        switcher.clock = session.clock
        switcher.look, switcher.on_change, switcher.on_rest, switcher.on_idle = (
            self._look,
            self._follow,
            self._rested,
            self._beat,
        )
        self._attach(session)

    def _meta(self) -> dict[str, Any]:
        return {**super()._meta(), "blind": True}

    def _attach(self, session: Session) -> None:
        session.guarded = True
        state, told = session.state, self._told_of
        named = [name for name in told if name == "tick" or ".sent." in name]
        self._copied = [(told[name], state[name]) for name in named if name in state]
        session.taps.append(self._tap)

    def _follow(self, session: Session) -> None:
        """Go on with the session of the next scene, to which the devices, now at rest, are handed over."""
        self.session = session
        self._attach(session)

    def _rested(self) -> None:
        """Note that all is safe: until commands flow again the guardian need not act, and memory can be collected."""
        self.words[at.ARMED] = 0
        self._armed = False
        gc.collect()

    def _beat(self) -> None:
        self.words[at.BEAT] = monotonic()

    def _rest(self) -> None:
        """Do what the loop does between ticks, while it does not tick yet; messages from the desk are handled, too."""
        self._beat()
        for message in self._inbox.take():
            if message.get("what") == "enable":
                self._commands.carry_out(message)
            else:
                self._obey(str(message.get("what")), message.get("value"))
        self._hold()
        self.outbox.flush()
        self._watch_others()
        time.sleep(IDLE)

    def _enable(self) -> None:
        """Enable; starting a participant's session again after a trip re-arms it, if the cause of the trip is gone."""
        try:
            self.session.enable()
        except LatchedError:
            self.session.rearm()
        if any(one.model.twin and one.latch.status is Status.FAULT for one in self.session.runners):  # beside hardware
            self.session.rearm()

    def _run(self) -> None:
        if self.words[at.STOP]:
            return
        self.words[at.BEAT] = monotonic()
        self.words[at.PHASE] = at.RUNNING
        gc.freeze()
        gc.disable()  # a collection would hold up a tick for longer than a device may wait; see ``_rested``
        self._work()

    def _look(self) -> None:
        """Take what comes from the desk.

        Raises
        ------
        Stopped
            If the session is to end.
        """
        words = self.words
        if words[at.ASKED] != words[at.TAKEN]:
            for message in self._inbox.take():
                self._obey(str(message.get("what")), message.get("value"))
        self._hold()
        if words[at.STOP]:
            raise Stopped

    def _tap(self, tick: int) -> None:
        """Tell the guardian that the loop runs; called after every tick, also in the safe sequence."""
        words = self.words
        words[at.BEAT] = monotonic()
        if not self._armed and any(runner.latch.enabled for runner in self.session.runners):
            self._armed = True
            words[at.ARMED] = int(self._obeyed)
        for told, state in self._copied:
            told[...] = state
        self._publish(0.0, 0.0)
        if tick % TIMING_EVERY == 0:
            self.outbox.flush()
            self._watch_others()


def serve(segment: SharedMemory, outbox: Outbox, config: dict[str, Any]) -> tuple[dict[str, Any], BaseException | None]:
    """Run the remaining trials of a participant, as ``config["study"]`` says; return the report, and what ended it.

    Raises
    ------
    SceneError, SessionError, StoreError
        If study, scene or data are wrong.
    """
    asked, catalog = config["study"], Catalog()
    file = load_study(asked["path"], catalog)
    answers, operator = PostedAnswers(outbox), PostedOperator(outbox)
    with Store.open(Path(asked["folder"])) as store:
        run = Run(
            file, asked["participant"], store, answers, catalog, clock=WallClock(), record=asked["record"],
            operator=operator,
        )  # fmt: skip
        run.switcher.survey(each_level_once(file))
        if not run.prepare():
            return {}, None
        work = partial(_make, run, outbox)
        sitting = RigSession(run.switcher, work, partial(_obey, answers, operator), segment, outbox, config)
        report, error = sitting.run()
        if isinstance(error, DeviceFaultError):  # all devices are safe, and released
            try:
                run.stand()
            except StoreError as other:
                error.add_note(str(other))
        return report, error


def serve_study(
    segment: SharedMemory, outbox: Outbox, config: dict[str, Any]
) -> tuple[dict[str, Any], BaseException | None]:
    """Serve a study to another program, as ``config["study"]`` says; see `itouch_tools.study.external_control`.

    Raises
    ------
    SceneError, SessionError, StudyServerError
        If study or scene are wrong, or the server can't be opened.
    """
    asked, catalog = config["study"], Catalog()
    file = load_study(asked["path"], catalog)
    with StudyServer(Path(asked["key"]), asked["port"]) as server:
        served = Served(file, catalog, server, clock=WallClock())
        served.switcher.survey(each_level_once(file))

        def work() -> None:
            with contextlib.suppress(Stopped):
                served.run()

        sitting = RigSession(served.switcher, work, lambda what, value: None, segment, outbox, config)
        outbox.tell("server", {"port": server.port})
        return sitting.run()


def _make(run: Run, outbox: Outbox) -> None:
    """Run trials until none is left, or somebody ends the session."""
    told = 0
    try:
        for row in run.trials():
            outbox.tell("trial", {"place": row.place, "void": row.void, "again": run.course.comes_again(row)})
            for loss in run.switcher.losses[told:]:
                outbox.tell("lost", {"words": loss})
            told = len(run.switcher.losses)
    except Stopped:
        outbox.tell("stopped", {})


def _obey(answers: PostedAnswers, operator: PostedOperator, what: str, value: Any) -> None:
    """Do what the desk asks for; an unknown request is ignored."""
    if what == "answer" and isinstance(value, dict):
        answers.take(int(value.get("place", -1)), str(value.get("answer", "")))
    elif what == "pause":
        operator.paused = bool(value)
    elif what == "end":
        operator.stopped = True
