"""Tasks and answer devices that plugins bring by the entry point ``itouch.tasks``.

Both are classes that are made without arguments; they import nothing of the framework.  A task has ``right(self,
answer, trial)``, and optionally ``intervals``, ``question``, ``choices(self, levels)`` and ``simulated(self, observer,
felt, rng)``.  An answer device has ``poll(self)``, and optionally ``ask(self, words, choices)`` and ``close(self)``.
"""

from __future__ import annotations

import contextlib
import functools
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from itouch.plugin.discovery import PluginError, find
from itouch.schema import ItouchError
from itouch_tools.study.answer_sources import AnswerError, Question

GROUP = "itouch.tasks"
#: Most touches that a trial may have.
MOST = 3


class TaskError(ItouchError, ValueError):
    """A task or an answer device that does not exist, can't be loaded, or fails."""


@dataclass(frozen=True, slots=True)
class PluginTask:
    """A plugin's task: the object that it ``made``, and ``whose`` it is, for messages."""

    made: Any
    whose: str
    intervals: int
    question: str

    def choices(self, levels: Sequence[str]) -> tuple[tuple[str, str], ...]:
        """Return the possible answers, as pairs (as kept, as shown); none: any number is an answer.

        Raises
        ------
        TaskError
            If the plugin does not return a mapping of words.
        """
        ask = getattr(self.made, "choices", None)
        found = {} if ask is None else self._told("choices", ask, tuple(levels))
        words = found.items() if isinstance(found, Mapping) else [(None, None)]
        if not all(isinstance(word, str) and word.strip() for pair in words for word in pair):
            raise TaskError(f"{self.whose}: choices gave {found!r}; it must be a mapping of kept to shown words")
        return tuple(words)

    def right(self, answer: str, trial: Mapping[str, Any]) -> int | None:
        """Return 1 for the right answer, 0 for a wrong one, None if there is no right one."""
        found = self._told("right", self.made.right, answer, dict(trial))
        if found is not None and not isinstance(found, bool | int):
            raise TaskError(f"{self.whose}: right gave {found!r}; it must be True, False or None")
        return None if found is None else int(bool(found))

    def simulated(self, observer: Any, felt: Sequence[Any], rng: Any) -> str:
        """Return the answer of a simulated observer who felt these intervals."""
        ask = getattr(self.made, "simulated", None)
        if ask is None:
            raise TaskError(f"{self.whose} has no method simulated(self, observer, felt, rng): people alone can do it")
        return str(self._told("simulated", ask, observer, list(felt), rng))

    def _told(self, what: str, call: Any, *given: Any) -> Any:
        try:
            return call(*given)
        except Exception as error:  # a plugin's code may raise anything
            raise TaskError(f"{self.whose}: {what} raised {type(error).__name__}: {error}") from error


class Device:
    """A plugin's answer device, in place of a keyboard.  ``say`` prints what the participant reads."""

    def __init__(self, made: Any, whose: str, say: Callable[[str], None]) -> None:
        self._made, self._whose, self._say = made, whose, say

    def ask(self, question: Question) -> None:
        """Print the question, and pass it on to the device."""
        self._say(question.words)
        for choice in question.choices:
            self._say(f"  {choice}")
        self._call("ask", question.words, list(question.choices))

    def poll(self, waited: float) -> str | None:
        """Return the answer, or None if there is none yet."""
        found = self._call("poll")
        if found is not None and not isinstance(found, str | int | float):
            raise AnswerError(f"{self._whose}: poll gave {found!r}; it must be a word, a number or None")
        return None if found is None else str(found)

    def tell(self, words: str) -> None:
        """Print the message: the device has no screen."""
        self._say(words)

    def close(self) -> None:
        """Release the device."""
        self._call("close")

    def _call(self, what: str, *given: Any) -> Any:
        call = getattr(self._made, what, None)
        try:
            return None if call is None else call(*given)
        except Exception as error:  # a plugin's code may raise anything
            raise AnswerError(f"{self._whose}: {what} raised {type(error).__name__}: {error}") from error


def task_names() -> list[str]:
    """Return the names of the tasks that plugins bring, including those that can't be loaded."""
    names = []
    for name in sorted(find(GROUP)):
        with contextlib.suppress(TaskError, PluginError):
            if not _is_task(_made(name)[0]):
                continue
        names.append(name)
    return names


def offered(name: str) -> bool:
    """Tell whether a plugin brings a task or an answer device of that name."""
    return name in find(GROUP)


def task_of(name: str) -> PluginTask:
    """Return a plugin's task.

    Raises
    ------
    TaskError
        If there is nothing of that name, or it is not a task.
    PluginError
        If it can't be loaded.
    """
    return _task(name, tuple(sys.path))


@functools.lru_cache(maxsize=32)
def _task(name: str, path: tuple[str, ...]) -> PluginTask:
    made, whose = _made(name)
    if not _is_task(made):
        raise TaskError(f"{whose} is not a task: it has no method right(self, answer, trial)")
    intervals = getattr(made, "intervals", 1)
    if isinstance(intervals, bool) or not isinstance(intervals, int) or not 1 <= intervals <= MOST:
        raise TaskError(f"{whose}: intervals = {intervals!r} must be 1 to {MOST}")
    return PluginTask(made, whose, intervals, str(getattr(made, "question", "")) or "What was it?")


def device_of(name: str, say: Callable[[str], None] = lambda words: None) -> Device:
    """Return a new object of a plugin's answer device; ``say`` prints what the participant reads.

    Raises
    ------
    TaskError
        If there is nothing of that name, or it is not an answer device.
    PluginError
        If it can't be loaded.
    """
    made, whose = _made(name)
    if not callable(getattr(made, "poll", None)):
        raise TaskError(f"{whose} is not an answer device: it has no method poll(self)")
    return Device(made, whose, say)


def _is_task(made: Any) -> bool:
    return callable(getattr(made, "right", None))


def _made(name: str) -> tuple[Any, str]:
    found = find(GROUP).get(name)
    if found is None:
        known = ", ".join(sorted(find(GROUP))) or "none"
        raise TaskError(f"no plugin brings '{name}' ({GROUP}); there are: {known}")
    loaded, whose = found.load(), f"task '{name}' ({found.distribution} {found.version})"
    if not isinstance(loaded, type):
        raise TaskError(f"{whose} is not a class")
    try:
        return loaded(), whose
    except Exception as error:  # a plugin's code may raise anything
        raise TaskError(f"{whose}: it can't be made: {type(error).__name__}: {error}") from error
