"""Budgets of a participant that outlast a session: thermal dose, and time on cold plates.

The program keeps a file for each participant that a scene names, in two copies.  What was used counts in every later
session, whatever its devices are called; if the copies differ, the larger figure counts.  Budgets begin anew a day
after the last use.  The files keep budgets across processes, crashes and older session files, and reveal an edit; they
are no lock against somebody who is set on deceiving the program.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import queue
import re
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from itouch.loop.engine_view import Running
from itouch.platforms import claim
from itouch.safety.device_monitors import InstalledMonitor
from itouch.schema import Problem, SceneError
from itouch.schema.durable import write_whole
from itouch.session.session_error import SessionError

if TYPE_CHECKING:
    from itouch.scene import Scene

FORMAT = "itouch-py participant 1"
#: Time [s] after the last use from which budgets begin anew: the project's choice, a day.
LASTS = 86_400.0
#: Shortest time [s of the session] between two writes of what was used; how much of a file is read at most [bytes].
EVERY, MOST = 1.0, 1 << 16
#: What a participant's code may be: it becomes the name of a file.
CODE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
#: The budgets that are kept, by the names of the fields in every monitor of heat.
BUDGETS = ("dose", "cold_time")


@dataclass(frozen=True, slots=True)
class BudgetUse:
    """What a participant has used of the budgets [s], and when [s since 1970] that was written last."""

    dose: float = 0.0
    cold_time: float = 0.0
    at: float = 0.0

    def larger(self, other: BudgetUse) -> BudgetUse:
        """Return the larger use of each budget."""
        return BudgetUse(*(max(a, b) for a, b in zip(self.values, other.values, strict=True)))

    @property
    def values(self) -> tuple[float, float, float]:
        """The numbers in order."""
        return self.dose, self.cold_time, self.at


def folder() -> Path:
    """Return the folder of participants' files, in ``XDG_STATE_HOME`` or ``~/.local/state``.

    A relative ``XDG_STATE_HOME`` does not count, as its standard says: each folder would have a count of its own.
    """
    state = Path(os.environ.get("XDG_STATE_HOME", ""))
    return (state if state.is_absolute() else Path.home() / ".local" / "state") / "itouch-py" / "participants"


def read(code: str, now: float | None = None) -> tuple[BudgetUse, tuple[str, ...]]:
    """Return what a participant has used, and notices about the files.

    Raises
    ------
    SessionError
        If the copies that exist can't be read: then nobody knows what was used.
    """
    found, told, bad = [], [], []
    for path in _paths(code):
        try:
            used, edited = _read(path, code)
        except FileNotFoundError:
            continue
        except Exception as error:  # whatever the file contains
            bad.append(f"'{path}': {str(error) or type(error).__name__}")
            continue
        found.append(used)
        if edited:
            told.append(f"participant '{code}': '{path}' was edited by somebody; the larger use counts")
    if bad and not found:
        advice = "find out what happened to it; remove it only if you are sure that nothing was used"
        raise SessionError(f"what participant '{code}' has used can't be read: {'; '.join(bad)}: {advice}")
    told += [f"participant '{code}': {text}; the other copy counts" for text in bad]
    if len({used.values[:2] for used in found}) > 1 and not told:
        told.append(f"participant '{code}': the two copies of what was used differ; the larger use counts")
    whole = BudgetUse()
    for used in found:
        whole = whole.larger(used)
    if (time.time() if now is None else now) - whole.at > LASTS:
        return BudgetUse(), ()
    return whole, tuple(told)


def write(code: str, used: BudgetUse) -> None:
    """Write what a participant has used, where it is more than what is written already, into both copies in turn.

    Raises
    ------
    SessionError
        If it can't be written.
    """
    whole, _ = read(code, used.at)
    used = used.larger(whole)
    body = {"format": FORMAT, "participant": code, "dose_s": used.dose, "cold_s": used.cold_time, "at": used.at}
    data = json.dumps({**body, "digest": _digest(body)}, indent=1, allow_nan=False).encode() + b"\n"
    for path in _paths(code):
        try:
            write_whole(str(path), data)
        except OSError as error:
            raise SessionError(f"what participant '{code}' has used can't be kept: '{path}': {error}") from error


def _paths(code: str) -> tuple[Path, Path]:
    return folder() / f"{code}.json", folder() / f".{code}.copy.json"


def _digest(body: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def _read(path: Path, code: str) -> tuple[BudgetUse, bool]:
    """Return the use that a file tells, and whether somebody has edited it."""
    if not path.is_file() and path.exists():
        raise ValueError("it is not a file")
    with path.open("rb") as stream:
        data = json.loads(stream.read(MOST))
    if not isinstance(data, dict):
        raise ValueError("it is not a record of a participant")
    digest = data.pop("digest", "")
    if data["format"] != FORMAT or data["participant"] != code:
        raise ValueError(f"it is not a record of '{code}' in the format '{FORMAT}'")
    used = BudgetUse(*(float(data[name]) for name in ("dose_s", "cold_s", "at")))
    if not all(math.isfinite(value) and value >= 0.0 for value in used.values):
        raise ValueError("it holds a time that cannot be read")
    return used, digest != _digest(data)


class Participant:
    """Carries what one participant has used into a session, and what the session uses out of it."""

    def __init__(
        self, session: Running, scene: Scene, lost: Callable[[str, str], None], *,
        clock: Callable[[], float] = time.time,
    ) -> None:  # fmt: skip
        self.code, self._session, self._lost, self._clock = scene.safety.participant, session, lost, clock
        if not CODE.fullmatch(self.code):
            sentence = f"participant = '{self.code}' is not a code: 1 to 64 letters, digits, '-' and '_'"
            raise SceneError([Problem("bad-value", sentence, scene.places.of(scene.safety, "participant"))])
        #: Budget -> for each finger, the fields of State with the uses by its plates, which count together.
        self._views = {
            name: [[post.state[name] for post in plates] for plates in _by_finger(session)] for name in BUDGETS
        }
        self._ticks = max(1, round(EVERY / session.model.period))
        self._noted = BudgetUse()
        self._work: queue.Queue[BudgetUse | None] = queue.Queue(1)
        self._thread: threading.Thread | None = None
        self._failure = ""
        #: The lock file that tells other sessions that the participant is in this one; -1: none is open.
        self._claimed = -1

    def carry_in(self) -> tuple[str, ...]:
        """Raise every finger's use to what was used before; return notices about the files.

        Raises
        ------
        SessionError
            If nobody knows what was used, or another session on hardware has the participant: each of the two would
            count its own use alone.
        """
        self._claim()
        used, told = read(self.code, self._clock())
        self._noted = used
        for name, value in zip(BUDGETS, used.values, strict=False):
            for views in self._views[name]:
                views[0][...] += max(0.0, value - _sum(views))
        return told

    def begin(self) -> None:
        """Begin to write down what is used while the session runs."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._write, name="participant", daemon=True)
            self._thread.start()
            self._session.taps.append(self._tap)

    def _claim(self) -> None:
        if self._claimed >= 0 or all(runner.model.twin for runner in self._session.runners):
            return
        path = folder() / f".{self.code}.lock"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise SessionError(f"what participant '{self.code}' has used can't be kept: '{path}': {error}") from error
        try:
            claim(handle)
        except BlockingIOError as error:
            os.close(handle)
            sentence = f"participant '{self.code}' is in another running session: end that one first"
            raise SessionError(f"{sentence}, or each would count its own thermal dose alone") from error
        self._claimed = handle

    def used(self) -> BudgetUse:
        """Return what has been used by now."""
        dose, cold = (self._most(name) for name in BUDGETS)
        return BudgetUse(dose, cold, self._clock())

    def _most(self, name: str) -> float:
        return max((_sum(views) for views in self._views[name]), default=0.0)

    def end(self) -> None:
        """Write down the last use, and wait until it is on the disk.

        Raises
        ------
        SessionError
            If it can't be kept.
        """
        try:
            self._note_last()
        finally:
            handle, self._claimed = self._claimed, -1
            if handle >= 0:
                os.close(handle)

    def _note_last(self) -> None:
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._session.taps.remove(self._tap)
        self._work.put(None)
        thread.join()
        if self._grown(self.used()):
            write(self.code, self.used())

    def _grown(self, used: BudgetUse) -> bool:
        return used.dose > self._noted.dose or used.cold_time > self._noted.cold_time

    def _tap(self, tick: int) -> None:
        if self._failure:
            said, self._failure, self._noted = self._failure, "", BudgetUse()  # it was not written: try again
            self._lost("saving", said)
        if (tick + 1) % self._ticks:
            return
        used = self.used()
        if not self._grown(used):
            return
        try:
            self._work.put(used, block=self._session.clock.pace != "real")
        except queue.Full:  # the disk has not taken the last one yet
            return
        self._noted = used

    def _write(self) -> None:
        while (used := self._work.get()) is not None:
            try:
                write(self.code, used)
            except Exception as error:  # without this thread nothing would be written, and ``end`` would hang
                said = f"what participant '{self.code}' has used can't be kept: {type(error).__name__}: {error}"
                self._failure = str(error) if isinstance(error, SessionError) else said


def _by_finger(session: Running) -> list[list[InstalledMonitor]]:
    """Return the monitors of plates, those on one finger together; a plate that is alone has a list of its own."""
    shared = {id(finger): finger for runner in session.runners for finger in runner.gate.shared}
    alone = [[post] for runner in session.runners if not runner.gate.shared for post in runner.gate.heats]
    return [*(list(finger.plates) for finger in shared.values()), *alone]


def _sum(views: Sequence[NDArray[np.float64]]) -> float:
    return float(sum(view.item() for view in views))
