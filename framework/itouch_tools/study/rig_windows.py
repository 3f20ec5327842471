"""What people see and answer in a session on a rig with hardware: windows, answers, notes and the dead-man's switch.

The trials run in the servo process (`itouch_tools.study.rig_session`); here a person is shown what to do, and asked.
However slow the drawing is here, it does not delay the loop.
"""

from __future__ import annotations

import os
import queue
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from itouch.plugin import Role
from itouch.plugin.discovery import Catalog
from itouch.scene import Scene
from itouch.schema import ItouchError
from itouch.servo import Handle, ServoError
from itouch.servo.launching import start
from itouch.session.outputs import Outputs
from itouch_tools.study.answer_sources import Answers, Question, Stopped
from itouch_tools.study.operating import Operator
from itouch_tools.study.reading import StudyFile
from itouch_tools.study.session_display import Show, Shown
from itouch_tools.viewer.deadman_switch import DeadMansSwitch

#: Period [s] at which windows, keys and messages are handled.
LOOK = 0.01
#: Longest answer that is passed on [letters].
LONGEST = 200


def scene_of(file: StudyFile, catalog: Catalog) -> Scene:
    """Return the scene of the first condition, which has the devices of all conditions."""
    return file.scene(_first(file), catalog)[0]


def _first(file: StudyFile) -> dict[str, str]:
    first = file.conditions()[0] if file.study.factors else {}
    return {**first, **{one.name: f"{one.standard:.9g}" for one in file.study.staircases}}


def hardware_of(file: StudyFile, catalog: Catalog) -> list[str]:
    """Return the names of the devices that are hardware."""
    return [device.name for device in scene_of(file, catalog).devices if not device.twin]


def has_switch(file: StudyFile, catalog: Catalog) -> bool:
    """Tell whether a device of the rig has a dead-man's switch."""
    model = file.model(_first(file), catalog)
    return any(device.reading(Role.DEADMAN) is not None for device in model.devices.values())


def launch(
    file: StudyFile, participant: str, folder: Path, *, record: bool = False, realtime: bool = True
) -> Handle:  # fmt: skip
    """Start a participant's session in a servo process; hardware waits for the operator's act, ``Handle.enable``.

    Raises
    ------
    SceneError, SessionError, ServoError, ItouchError
        If it can't begin.
    """
    asked = {"folder": os.path.abspath(folder), "participant": participant, "record": record}
    return _start(file, "itouch_tools.study.rig_session:serve", f"{file.name}-{participant}", asked, realtime=realtime)


def launch_server(file: StudyFile, key: Path, port: int, *, realtime: bool = True) -> Handle:
    """Start a study led by another program, in a servo process; the first message of ``Handle.others`` has the port.

    Raises
    ------
    SceneError, SessionError, ServoError, ItouchError
        If it can't begin.
    """
    asked = {"key": os.path.abspath(key), "port": port}
    return _start(file, "itouch_tools.study.rig_session:serve_study", f"{file.name}-served", asked, realtime=realtime)


def _start(file: StudyFile, serves: str, name: str, asked: dict[str, Any], *, realtime: bool) -> Handle:
    config = {
        "serves": serves, "scene": file.scene_path, "scene_xml": None, "twin": None, "rig": None, "seed": 0,
        "seconds": None, "enable": False, "linger": False, "save": None, "realtime": realtime, "sys_path": sys.path,
        "keep": Outputs().dump(), "study": {"path": os.path.abspath(file.path), **asked},
    }  # fmt: skip
    return start(f"{name}-{os.getpid()}", config)


class RigWindows:
    """Shows a session to people, and passes on what they answer, write and hold.

    Parameters
    ----------
    handle
        The handle on the session.
    answers
        The source of answers.
    show, operator
        Shows a face to the participant; and the operator's window.
    note
        Keeps a note of the operator, given the number of the trial and the words.
    """

    def __init__(
        self, handle: Handle, answers: Answers, *, show: Show | None = None, operator: Operator | None = None,
        note: Callable[[int, str], None] | None = None,
    ) -> None:  # fmt: skip
        self._handle, self._answers, self._show, self._operator = handle, answers, show, operator
        self._note = note
        self._holding = DeadMansSwitch(handle.link)
        self._asked: tuple[int, float] | None = None
        self._given = self._paused = self._held = self._ending = False
        self._face = Shown("hold"), list[tuple[str, bool]]()
        #: Whether the session was ended before the last trial, and why, if there is more to say than that.
        self.stopped, self.why = False, ""

    def attend(self) -> Iterator[dict[str, Any]]:
        """Attend until the session has ended; yield its messages about trials and losses.

        Raises
        ------
        DeviceFaultError, ServoError, ...
            Whatever ended the session.
        """
        handle = self._handle
        try:
            if self._show is not None:
                self._show(Shown("hold"))  # instructions are shown until a key is pressed
            handle.enable()
            over = False
            while not over:
                try:
                    over = handle.wait(LOOK)
                finally:  # messages that came before it failed
                    yield from self._listen()
                if not over:
                    self._turn()
        except Stopped as why:
            self.stopped, self.why = True, str(why)
            handle.stop()
            yield from self._listen()
        finally:
            self._holding.close()

    def _listen(self) -> Iterator[dict[str, Any]]:
        while True:
            try:
                message = self._handle.others.get_nowait()
            except queue.Empty:
                return
            kind = message["kind"]
            if kind == "shown":
                self._face = _face(message["face"]), [(str(words), bool(well)) for words, well in message["lines"]]
            elif kind == "ask":
                question = Question(message["place"], message["words"], tuple(message["choices"]))
                self._answers.ask(question)
                self._asked, self._given = (question.place, time.monotonic()), False
            elif kind == "tell":
                self._answers.tell(message["words"])
                self._given = False  # the message may be that the answer was not accepted
            elif kind == "stopped":
                self.stopped = True
            else:
                yield message

    def _turn(self) -> None:
        """Handle windows and keys once."""
        face, lines = self._face
        if self._show is not None:
            self._show(face)
        if self._asked is not None and not self._given:
            place, since = self._asked
            answer = self._answers.poll(time.monotonic() - since)
            if answer is not None:
                self._given = True
                self._pass_on("answer", {"place": place, "answer": answer[:LONGEST]})
        operator = self._operator
        if operator is not None:
            operator.show(face, lines)
            self._hold(operator.held)
            if operator.paused != self._paused:
                self._paused = operator.paused
                self._pass_on("pause", self._paused)
            for words in operator.notes():
                if self._note is not None:
                    self._note(face.trial, words)
            if operator.stopped and not self._ending:  # after this trial, as on twins
                self._ending = True
                self._pass_on("end", None)

    def _hold(self, held: bool) -> None:
        self._holding.beat()
        if held or self._held:
            self._holding.hold(held)
        self._held = held

    def _pass_on(self, what: str, value: Any) -> None:
        try:
            self._handle.command(what, value)
        except ServoError:
            if self._handle.running:
                raise


def _face(told: dict[str, Any]) -> Shown:
    window = told["window"]
    pair = None if window is None else (float(window[0]), float(window[1]))
    return Shown(**{**told, "choices": tuple(told["choices"]), "window": pair})


def refuse(file: StudyFile, catalog: Catalog, *, switch: bool, fast: bool) -> None:
    """Raise an error if the study can't be run on hardware in this way.

    Raises
    ------
    ItouchError
        If it can't; it says what to do.
    """
    names = ", ".join(f"'{name}'" for name in hardware_of(file, catalog))
    if fast:
        raise ItouchError(f"{names}: hardware runs in real time; omit --pace fast")
    if not switch and not has_switch(file, catalog):
        raise ItouchError(
            f"{names} will move or heat for real, and nobody could hold a dead-man's switch: give a device a switch of "
            'its own (deadman="centre" on <usb-arm:hardware>), or, with `study run`, --operator: Space in its window'
        )
