"""A check: one property that a plugin must have, with a message that names the likely cause."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal


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


@dataclass(frozen=True, slots=True)
class Check:
    """A named property; ``run`` raises CheckError if the subject lacks it."""

    name: str
    title: str
    run: Callable[[Any], str | None]

    def examine(self, subject: Any) -> Finding:
        """Run the check; an error of the plugin's own is a failure, with the place where it was raised."""
        begin = time.perf_counter()
        try:
            note, outcome = self.run(subject) or "", "passed"
        except NotApplicableError as reason:
            note, outcome = str(reason), "left out"
        except CheckError as error:
            note, outcome = str(error), "failed"
        except Exception as error:  # whatever a stranger's code raises
            note, outcome = str(escaped(error)), "failed"
        return Finding(self, outcome, note, time.perf_counter() - begin)  # type: ignore[arg-type]


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


def examine(checks: Iterable[Check], subject: Any) -> list[Finding]:
    """Run checks one after the other."""
    return [one.examine(subject) for one in checks]


def escaped(error: Exception) -> CheckError:
    """Turn an error that came out of the plugin into a failure that says where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    last = frames[-1] if frames else None
    where = f" at {last.filename}:{last.lineno}" if last else ""
    return CheckError(
        f"{type(error).__name__}: {error}{where}",
        cause="the plugin's code raised where the framework needs an answer",
        advice="handle it there; what a device or a person can cause is a DeviceError with what to do",
    )
