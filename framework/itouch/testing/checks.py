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
from itouch.testing.process_state import ProcessState

#: How long a check may take [s]; one that takes longer counts as hanging.
LIMIT = 45.0
#: Checks that end the examination if they fail: the class is then no plugin, or would end or block the process.
VITAL = ("contract", "survives")


class CheckError(AssertionError):
    """A plugin lacks a property.

    Parameters
    ----------
    seen
        What was observed.
    cause
        The likely cause.
    advice
        What to do.
    """

    def __init__(self, seen: str, *, cause: str, advice: str) -> None:
        super().__init__(f"{seen}\n  likely cause: {cause}\n  what to do:   {advice}")
        self.seen, self.cause, self.advice = seen, cause, advice


class NotApplicableError(Exception):
    """The property has no meaning for this plugin, or cannot be examined here; the text says why."""


class _Hang(BaseException):
    """A check takes too long; a plugin's handlers for ordinary exceptions do not catch it."""


@dataclass(frozen=True, slots=True)
class Check:
    """A named property; ``run`` raises CheckError if the plugin lacks it."""

    name: str
    title: str
    run: Callable[[Any], str | None]

    def examine(self, harness: Any) -> CheckResult:
        """Run the check; an exception from the plugin is a failure, with the place where it was raised."""
        begin = time.perf_counter()
        outcome: Literal["passed", "failed", "left out"]
        with _limited() as interrupted:
            before = ProcessState()
            try:
                note, outcome = self.run(harness) or "", "passed"
            except NotApplicableError as reason:
                note, outcome = str(reason), "left out"
            except CheckError as error:
                note, outcome = str(error), "failed"
            except BaseException as error:  # whatever the plugin's code raises
                if interrupted:
                    raise
                note, outcome = self._told(harness, error)
            finally:
                before.put_back()
        return CheckResult(self, outcome, note, time.perf_counter() - begin)

    def _told(self, harness: Any, error: BaseException) -> tuple[str, Literal["passed", "failed", "left out"]]:
        """Return note and outcome for an error; if the harness says that it may be bad luck, run the check again."""
        for _ in range(2):
            if not getattr(harness, "unlucky", lambda error: False)(error):
                break
            try:
                return self.run(harness) or "", "passed"
            except Exception as again:
                error = again
        return str(error if isinstance(error, CheckError) else escaped(error)), "failed"


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of a check; ``note`` is the message of a failure, or a figure that was measured; ``seconds`` [s]."""

    check: Check
    outcome: Literal["passed", "failed", "left out"]
    note: str
    seconds: float


def check(name: str, title: str) -> Callable[[Callable[[Any], str | None]], Check]:
    """Make a check from a function; failures are reported under ``name``."""
    return lambda function: Check(name, title, function)


def examine(checks: Iterable[Check], harness: Any) -> Iterator[CheckResult]:
    """Run checks one after the other; leave out all others once one of the `VITAL` checks has failed."""
    lacking = ""
    for one in checks:
        finding = unexamined(one, lacking) if lacking else one.examine(harness)
        lacking = one.name if one.name in VITAL and finding.outcome == "failed" else lacking
        yield finding


def unexamined(one: Check, lacking: str) -> CheckResult:
    """Return the finding of a check that is left out because an earlier one has failed."""
    return CheckResult(one, "left out", f"not examined: first '{lacking}' must pass", 0.0)


def escaped(error: BaseException) -> CheckError:
    """Turn an exception from the plugin into a failure that says where it was raised."""
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
    """Limit the time spent inside the context to `LIMIT`; the list is not empty once a person has pressed Ctrl-C."""
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
        if left:  # another alarm was set, such as that of a test's time limit
            signal.setitimer(signal.ITIMER_REAL, max(0.01, left - (time.perf_counter() - begin)))
