"""`Handle`: a session that runs in a servo process, as its launcher has it: read, command, wait, stop."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import threading
from queue import SimpleQueue
from types import TracebackType
from typing import Any

from itouch.loop.timing import Timing
from itouch.plugin import Record
from itouch.servo import control_block as at
from itouch.servo.guardian_link import Guarded
from itouch.servo.launcher_pipe import messages
from itouch.servo.link import Link
from itouch.servo.shared_memory import ServoError, SharedMemory
from itouch.servo.thread_session import NoGuardian, ThreadProcess

#: How long [s] the devices may take to be safe at the end of a session before the servo process is killed, as its
#: guardian does long before; and how long it may take in all if they are, because then it finishes files.
END_TIME, FILES_TIME = 10.0, 90.0


class Handle:
    """A session in its servo process; also a context manager that ends it.

    Attributes
    ----------
    link
        The view of the session that any process can have: ``itouch.servo.attach(handle.name)`` gives another one.
    contacts
        Report entries of the contacts that have ended so far.
    efforts
        What was tried for punctuality: what, whether it worked, what was found.
    faults
        Faults that the session has survived, as they stand in the report; see ``linger`` of ``launch``.
    losses
        Losses of the recording or of snapshots, as they stand in the report, known at once.
    refused
        Commands that could not be obeyed, and why.
    others
        Messages of kinds that are not the servo process's own, but of whatever else it ``serves`` (see ``start``).
    notices
        What is rendered otherwise than the scene says, and what could not be done for punctuality, once each.
    """

    def __init__(
        self, process: subprocess.Popen[bytes] | ThreadProcess, segment: SharedMemory, line: socket.socket,
        guarded: Guarded | NoGuardian,
    ) -> None:  # fmt: skip
        self._process, self._segment, self._line, self._guarded = process, segment, line, guarded
        self.contacts: list[dict[str, Any]] = []
        self.efforts: list[tuple[str, bool, str]] = []
        self.refused: list[str] = []
        self.others: SimpleQueue[dict[str, Any]] = SimpleQueue()
        self.faults: list[dict[str, Any]] = []
        self.losses: list[dict[str, Any]] = []
        self._report: dict[str, Any] | None = None
        self._answers = threading.Condition()
        self._answered = 0
        self._error: Exception | None = None
        self._raised = False
        self._ready, self._over = threading.Event(), threading.Event()
        self._link: Link | None = None
        self._got_ready = False
        self._listener = threading.Thread(target=self._listen, name="itouch-listener", daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        """Take the messages of the servo process; runs in a thread until that has ended."""
        ended = False
        end = os.pidfd_open(self._process.pid) if isinstance(self._process, subprocess.Popen) else None
        for message in messages(self._line, end):
            kind = message["kind"]
            if kind == "ready":
                self.efforts = [(what, done, said) for what, done, said in message["efforts"]]
                self._got_ready = True
                self._ready.set()
            elif kind == "contacts":
                self.contacts += message["contacts"]
            elif kind == "fault":
                self.faults.append(message["fault"])
            elif kind == "loss":
                self.losses.append(message["loss"])
            elif kind == "refused":
                self.refused.append(f"{message['what']}: {message['cause']}")
            elif kind == "report":
                self._answer(message["report"])
            elif kind == "end":
                ended = True
                self._finish(message)
            else:
                self.others.put(message)
        self._line.close()
        if end is not None:
            os.close(end)
        code = self._process.wait()
        self._guarded.wait()
        if not ended:
            self._error = ServoError(_death(code, self._guarded.said))
        elif self._guarded.said:
            self._error = _account(self._guarded.said, self._error)
            if self._report is not None:
                self._report["ended_by"] = self._guarded.said
        self._over.set()
        self._ready.set()
        with self._answers:
            self._answers.notify_all()

    def _answer(self, report: dict[str, Any]) -> None:
        with self._answers:
            self._report = report
            self._answered += 1
            self._answers.notify_all()

    def _finish(self, message: dict[str, Any]) -> None:
        told, self._report = message["error"], message["report"]
        if told is not None and not told["traceback"]:  # raised before anything was loaded there; load nothing here
            self._error = ServoError(told["message"])
        elif told is not None:
            try:
                from itouch.servo.error_transport import decode
            except ImportError:  # the program has been upgraded in place, or removed, meanwhile
                self._error = ServoError(f"{told['message']} (the program was changed while it ran)")
                return
            self._error = decode(told)

    def await_ready(self) -> None:
        """Wait until the engine is built.

        Raises
        ------
        SceneError, SessionError, ServoError
            If it can't be built.
        """
        self._ready.wait()
        if self._error is not None and not self._got_ready:
            self._raised = True
            self._segment.close()
            raise self._error

    @property
    def link(self) -> Link:
        """The view of the session that any process can have."""
        if self._link is None:
            self._link = Link(self._segment)
        return self._link

    @property
    def name(self) -> str:
        """The session's name, for ``itouch.servo.attach``."""
        return self._segment.name

    @property
    def pid(self) -> int:
        """The id of the servo process."""
        return self._process.pid

    @property
    def guardian_pid(self) -> int:
        """The id of the guardian process."""
        return self._guarded.pid

    @property
    def built(self) -> bool:
        """Whether the session has been built, after which devices may have been enabled."""
        known = self._got_ready or self._report is not None
        return known or at.READY <= self._segment.phase < at.ENDED

    @property
    def running(self) -> bool:
        """Whether the servo process has not ended yet."""
        return not self._over.is_set()

    @property
    def state(self) -> Record:
        """A copy of the last published State, with the field names of ``Engine.state``."""
        return self.link.state

    @property
    def timing(self) -> Timing:
        """A copy of Timing, at most 20 ticks old while the loop runs."""
        return self.link.timing

    @property
    def seconds(self) -> float:
        """Simulated time of the last published State [s]."""
        return self.link.seconds

    @property
    def notices(self) -> tuple[str, ...]:
        """What is rendered otherwise than the scene says, and what was not granted for punctuality."""
        lacking = [f"{what}: {said}" for what, done, said in self.efforts if not done]
        return (*self.link.notices, *lacking)

    def command(self, what: str, value: Any = None) -> None:
        """Ask for something between two ticks; see ``Link.command``.

        Raises
        ------
        ServoError
            If the session has ended, or takes no commands.
        """
        self._raise()
        self.link.command(what, value)

    def enable(self) -> None:
        """Let hardware move or heat; the operator's decision."""
        self.command("enable")

    def hold(self, held: bool = True) -> None:
        """Hold the dead-man's switch for the next 80 ms, or let it go."""
        self.link.hold(held)

    def request_stop(self) -> None:
        """Ask for the end of the session and return at once; may be called from a signal handler.

        A session that is still being built, where nothing can act yet, ends without being built.
        """
        self._segment.words[at.STOP] = 1
        if self._segment.phase < at.READY and isinstance(self._process, subprocess.Popen):
            self._process.terminate()

    def stop(self) -> None:
        """Make the devices safe, end the session and wait for its end.

        Raises
        ------
        DeviceFaultError, ServoError, ...
            The error that ended the session before, if one did and it has not been raised yet.
        """
        self.end()
        self._raise()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for the session's end; return whether it has ended.

        Raises
        ------
        DeviceFaultError, ServoError, ...
            The error that ended it, with the servo process's traceback as its cause; once.
        """
        if not self._over.wait(timeout):
            return False
        self._raise()
        return True

    def report(self) -> dict[str, Any]:
        """Return the report, of the whole session if it has ended, else of what has happened so far.

        Raises
        ------
        ServoError
            If the servo process died without a report.
        """
        if not self._over.is_set():
            with self._answers:
                before = self._answered
                try:
                    self.link.command("report")
                except ServoError:
                    if self.link.alive:  # it takes no commands
                        raise
                # else it is ending: its last message, which has the report, may not have been read yet
                self._answers.wait_for(lambda: self._answered > before or self._over.is_set(), END_TIME)
        if self._report is None:
            self._raised = True
            raise self._error or ServoError("the servo process left no report")
        return self._report

    def _raise(self) -> None:
        if self._error is not None and self._over.is_set() and not self._raised:
            self._raised = True
            raise self._error

    def close(self) -> None:
        """End the session if it runs, and release its memory; the last State stays readable."""
        self.end()
        self._segment.close()

    def end(self) -> None:
        """Do what ``stop`` does, but raise nothing; a servo process that does not get there is killed."""
        self.request_stop()
        if self._over.wait(END_TIME):
            return
        safe = self._segment.phase >= at.ENDING and not self._segment.words[at.ARMED]
        if not safe or not self._over.wait(FILES_TIME - END_TIME):
            self._process.kill()
            self._over.wait()

    def __enter__(self) -> Handle:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        if kind is None:
            self._raise()


def _account(said: str, error: Exception | None) -> Exception:
    """Join what the guardian had to do with what the servo process told once it had recovered."""
    told = ServoError(f"{said}; then the servo process ended in order{f': {error}' if error is not None else ''}")
    told.__cause__ = error
    return told


def _death(code: int, said: str) -> str:
    how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"
    return f"the servo process {how}{'; ' + said if said else ''}"
