"""A check: one property that a plugin must have, with a message that names the likely cause."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from types import FrameType
from typing import Any, Literal

from itouch.testing.child_process import described
from itouch.testing.process_state import Surroundings

#: How long a check may take [s]; what takes longer hangs.
LIMIT = 45.0
#: The checks after which nothing else is examined: a plugin that lacks one is none, or would end or block the process.
VITAL = ("contract", "survives")


class CheckError(AssertionError):
    """A property that a plugin lacks.

    Parameters
    ----------
    seen
        What was seen.
    cause
        The likely cause.
    advice
        What to do.
    """

    def __init__(self, seen: str, *, cause: str, advice: str) -> None:
        super().__init__(f"{seen}\n  likely cause: {cause}\n  what to do:   {advice}")
        self.seen, self.cause, self.advice = seen, cause, advice


class NotApplicableError(Exception):
    """The property has no meaning for this plugin, or can't be seen here; the text says why."""


class _Hang(BaseException):
    """A check that takes too long; no handler of a plugin's for ordinary errors catches it."""


@dataclass(frozen=True, slots=True)
class Check:
    """A named property; ``run`` raises CheckError if the subject lacks it."""

    name: str
    title: str
    run: Callable[[Any], str | None]

    def examine(self, subject: Any) -> Finding:
        """Run the check; an error of the plugin's own is a failure, with the place where it was raised."""
        begin = time.perf_counter()
        outcome: Literal["passed", "failed", "left out"]
        with _limited() as interrupted:
            before = Surroundings()
            try:
                note, outcome = self.run(subject) or "", "passed"
            except NotApplicableError as reason:
                note, outcome = str(reason), "left out"
            except CheckError as error:
                note, outcome = str(error), "failed"
            except BaseException as error:  # whatever a stranger's code raises
                if interrupted:
                    raise
                note, outcome = self._told(subject, error)
            finally:
                before.put_back()
        return Finding(self, outcome, note, time.perf_counter() - begin)

    def _told(self, subject: Any, error: BaseException) -> tuple[str, Literal["passed", "failed", "left out"]]:
        """Return how an error is told; where the subject thinks that it was bad luck, the check is run again."""
        for _ in range(2):
            if not getattr(subject, "unlucky", lambda error: False)(error):
                break
            try:
                return self.run(subject) or "", "passed"
            except Exception as again:
                error = again
        return str(error if isinstance(error, CheckError) else escaped(error)), "failed"


@dataclass(frozen=True, slots=True)
class Finding:
    """How a check went; ``note`` is the message of a failure, or a figure that was measured."""

    check: Check
    outcome: Literal["passed", "failed", "left out"]
    note: str
    seconds: float


def check(name: str, title: str) -> Callable[[Callable[[Any], str | None]], Check]:
    """Make a check of a function; its name is what a failure is called by."""
    return lambda function: Check(name, title, function)


def examine(checks: Iterable[Check], subject: Any) -> Iterator[Finding]:
    """Run checks one after the other; none after one that shows that the plugin ends or blocks its process."""
    lacking = ""
    for one in checks:
        finding = unexamined(one, lacking) if lacking else one.examine(subject)
        lacking = one.name if one.name in VITAL and finding.outcome == "failed" else lacking
        yield finding


def unexamined(one: Check, lacking: str) -> Finding:
    """Return the finding of a check that is left out because of an earlier one."""
    return Finding(one, "left out", f"not examined: first '{lacking}' must pass", 0.0)


def escaped(error: BaseException) -> CheckError:
    """Turn an error that came out of the plugin into a failure that says where it was raised."""
    if isinstance(error, _Hang):
        return CheckError(
            f"it does not end within {LIMIT:g} s; it is in {described(error).rpartition(' at ')[2]}",
            cause="a wait without a time limit, or a loop without an end",
            advice="give every wait a timeout",
        )
    return CheckError(
        described(error),
        cause="the plugin's code raised where the framework needs an answer",
        advice="handle it there; what a device or a person can cause is a DeviceError with what to do",
    )


@contextlib.contextmanager
def _limited() -> Iterator[list[bool]]:
    """Limit the time of what is done within; the list is not empty once a person has interrupted it."""
    interrupted: list[bool] = []
    if threading.current_thread() is not threading.main_thread():
        yield interrupted
        return

    def give_up(number: int, frame: FrameType | None) -> None:
        raise _Hang

    def interrupt(number: int, frame: FrameType | None) -> None:
        interrupted.append(True)
        raise KeyboardInterrupt

    before = {signal.SIGALRM: signal.signal(signal.SIGALRM, give_up)}
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        before[signal.SIGINT] = signal.signal(signal.SIGINT, interrupt)
    left, _ = signal.setitimer(signal.ITIMER_REAL, LIMIT, 1.0)
    begin = time.perf_counter()
    try:
        yield interrupted
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)
        if left:  # somebody else's alarm, such as that of a test's time limit
            signal.setitimer(signal.ITIMER_REAL, max(0.01, left - (time.perf_counter() - begin)))
