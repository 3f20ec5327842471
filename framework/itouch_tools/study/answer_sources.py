"""Where answers come from: a person at a terminal, a window, or a written script of a session."""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, TextIO

from itouch.schema import ItouchError
from itouch.schema.terminal import number_of


class AnswerError(ItouchError):
    """An answer that can't be used, from a source that can't be asked again."""


class Stopped(Exception):  # noqa: N818  - not an error: the participant goes on another time
    """The person who answers wants to end the session, or a script is over, as its words say; the trials are kept."""


@dataclass(frozen=True, slots=True)
class Question:
    """A question: the trial's ``place``, the words, and the choices as they are shown (none: a number is asked for)."""

    place: int
    words: str
    choices: tuple[str, ...]


class Answers(Protocol):
    """A source of answers.  All methods are called between two ticks and return at once."""

    def ask(self, question: Question) -> None:
        """Put a question; earlier answers do not count."""

    def poll(self, waited: float) -> str | None:
        """Return the answer, or None if there is none yet; ``waited`` [s] is the time since the question.

        Raises
        ------
        Stopped
            If the session is to end here.
        """

    def tell(self, words: str) -> None:
        """Show the participant a message."""


class FirstAnswer:
    """Two sources of answers at once, such as a pedal and a window: the first that answers counts."""

    def __init__(self, first: Answers, second: Answers) -> None:
        self._both = (first, second)

    def ask(self, question: Question) -> None:
        """Put the question to both."""
        for one in self._both:
            one.ask(question)

    def poll(self, waited: float) -> str | None:
        """Return the answer of the first source that has one; either may end the session."""
        found = [one.poll(waited) for one in self._both]
        return next((answer for answer in found if answer is not None), None)

    def tell(self, words: str) -> None:
        """Pass the message to both."""
        for one in self._both:
            one.tell(words)


class Script:
    """Answers that were written beforehand: a line per trial, ``ANSWER [SECONDS]``; what follows ``#`` is ignored.

    Line n answers trial n, so that a stopped session goes on with the same answers.  The session ends with the last
    line.
    """

    def __init__(self, lines: Iterable[str]) -> None:
        written = (line.split("#")[0].strip() for line in lines)
        self._written = [line for line in written if line]
        self._lines = [_parsed(number, line) for number, line in enumerate(self._written, 1)]
        self._now: tuple[str, float] = ("", 0.0)
        self._asked: Question | None = None
        self._given = False

    def ask(self, question: Question) -> None:
        """Find the line of this trial; an answer may itself end with a number."""
        if question.place >= len(self._lines):
            have = number_of(len(self._lines), "answer")
            raise Stopped(f"the script has {have}, and line {question.place + 1} would be that of this trial")
        whole = self._written[question.place]
        named = whole.casefold() in (choice.casefold() for choice in question.choices)
        self._now = (whole, 0.5) if named else self._lines[question.place]
        self._asked, self._given = question, False

    def poll(self, waited: float) -> str | None:
        """Return the line's answer when its time has come.

        Raises
        ------
        AnswerError
            If the answer was given and not accepted: nobody could give another.
        """
        answer, after = self._now
        if waited < after:
            return None
        if self._given and self._asked is not None:
            if _fits(answer, self._asked.choices):
                return None  # it was accepted; the trial goes on for another reason
            choices = ", ".join(self._asked.choices) or "numbers"
            raise AnswerError(f"answer {self._asked.place + 1}: '{answer}' is none of the answers: {choices}")
        self._given = True
        return answer

    def tell(self, words: str) -> None:
        """Do nothing: nobody reads."""


def _fits(answer: str, choices: Sequence[str]) -> bool:
    """Tell whether an answer is one of the choices, by its words or number, or a number where there are none."""
    try:
        number = float(answer)
    except ValueError:
        number = math.nan
    if not choices:
        return math.isfinite(number)
    return answer.casefold() in (choice.casefold() for choice in choices) or number in range(1, len(choices) + 1)


def _parsed(number: int, line: str) -> tuple[str, float]:
    words, _, last = line.rpartition(" ")
    try:
        seconds = float(last)
    except ValueError:
        return line, 0.5
    if not words:  # a number alone is an answer
        return line, 0.5
    if not 0.0 <= seconds < 3600.0:
        raise AnswerError(f"answer {number}: '{line}' must be ANSWER [SECONDS], with 0 to 3600 s")
    return words.strip(), seconds


class Typed:
    """Answers that a person types, one per line; ``stop``, ``quit`` or the end of the input ends the session.

    Parameters
    ----------
    stream
        The stream of lines, read by a thread.
    say
        Prints a line.
    """

    def __init__(self, stream: TextIO, say: Callable[[str], None]) -> None:
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._say, self._stream = say, stream
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self._stream:
            self._lines.put(line.strip())
        self._lines.put(None)

    def ask(self, question: Question) -> None:
        """Print the question; what was typed before is dropped."""
        self._say(question.words)
        for number, choice in enumerate(question.choices, 1):
            self._say(f"  {number}  {choice}")
        while not self._lines.empty():
            if self._lines.get() is None:
                self._lines.put(None)
                return

    def poll(self, waited: float) -> str | None:
        """Return the line that was typed, if any."""
        if self._lines.empty():
            return None
        line = self._lines.get()
        if line is None or line.casefold() in ("stop", "quit"):
            raise Stopped
        return line or None

    def tell(self, words: str) -> None:
        """Print the message."""
        self._say(words)
