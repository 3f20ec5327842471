"""Problems of a file: what is wrong, where, and what to do; all of them are collected before any is reported."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher, get_close_matches
from types import TracebackType

#: How alike a misspelt word and a known one must be for the known one to be proposed, 0 to 1.
ALIKE = 0.6
#: How much of the message of a plugin's error is shown [characters].
LONGEST = 1000


class ItouchError(Exception):
    """Any fault that a user or a device can cause."""

    #: Exit code of a command that ends with it: 2, wrong input; 1 for what happens while a device is driven.
    exit_code = 2


#: Attributes that every class and every error has, read so that a plugin's author cannot have overridden them.
_NAME, _TRACEBACK = type.__dict__["__name__"], BaseException.__dict__["__traceback__"]


def spoken(error: BaseException) -> str:
    """Return the message of an error, at most ``LONGEST`` characters, even if the error fails when it is asked."""
    try:
        text = str(error)
    except BaseException:  # a plugin's error must neither hide a message nor keep a device from being made safe
        return "it fails to say why"
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def class_of(error: BaseException) -> str:
    """Return the name of an error's class, even if the class hides it."""
    name: str = _NAME.__get__(type(error))
    return name


def raised_at(error: BaseException) -> TracebackType | None:
    """Return the traceback of an error, even if the error hides it."""
    found: TracebackType | None = _TRACEBACK.__get__(error)
    return found


def reason(error: BaseException) -> str:
    """Return the message of an error, or the name of its class if it has none."""
    return spoken(error) or class_of(error)


def named(error: BaseException) -> str:
    """Return the name of an error's class, and its message if it has one."""
    text = spoken(error)
    return f"{class_of(error)}: {text}" if text else class_of(error)


@dataclass(frozen=True, slots=True)
class Place:
    """A span in a file: 1-based line and column, its length, and the text of the line."""

    file: str
    line: int
    column: int
    length: int = 1
    text: str = ""

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


@dataclass(frozen=True, slots=True)
class Problem:
    """One fault of a file.

    ``code`` is stable and documented, ``sentence`` is understood by itself, ``related`` has other places, each with a
    label.  ``mend`` is the word as written and the only one that can have been meant, if there is one.
    """

    code: str
    sentence: str
    place: Place | None = None
    advice: str = ""
    related: tuple[tuple[Place, str], ...] = ()
    severity: str = "error"
    mend: tuple[str, str] | None = None

    def render(self) -> str:
        """Return the problem as text, with its source line, a caret and the advice."""
        lines = [f"{self.severity}[{self.code}]: {self.sentence}"]
        if self.place is not None:
            lines += _span(self.place, "")
        for place, label in self.related:
            lines += _span(place, label)
        if self.advice:
            lines.append(f"  = help: {self.advice}")
        return "\n".join(lines)


def _span(place: Place, label: str) -> list[str]:
    lines = [f"  --> {place}"]
    if place.text:
        text, column, length = _window(place)
        carets = "^" * max(1, min(length, len(text) - column + 1))
        lines.append(f"{place.line:4d} | {text}")
        lines.append(f"     | {' ' * (column - 1)}{carets}{' ' + label if label else ''}")
    elif label:
        lines[-1] += f" {label}"
    return lines


def _window(place: Place, width: int = 160) -> tuple[str, int, int]:
    """Cut a long line to the surroundings of the span; tabs become spaces so that the caret stays below it."""
    start = 0
    if len(place.text) > width:
        start = max(0, min(place.column - 1 - width // 3, len(place.text) - width))
    text = "".join(c if c.isprintable() else " " for c in place.text[start : start + width])
    return text, place.column - start, min(place.length, width) if start or len(place.text) > width else place.length


class SceneError(ItouchError):
    """A scene, rig or session file is wrong; ``problems`` has everything that was found."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__(render(self.problems))


def render(problems: Iterable[Problem]) -> str:
    """Return problems as text, in the order given; if there are errors, their number follows at the end."""
    listed = list(problems)
    blocks = [problem.render() for problem in listed]
    errors = sum(problem.severity == "error" for problem in listed)
    if errors:
        noun = "problem" if errors == 1 else "problems"
        blocks.append(f"{errors} {noun}; nothing was started.")
    return "\n\n".join(blocks)


def nearest(word: str, known: Iterable[str]) -> str:
    """Return the known word most like the given one, or an empty string."""
    candidates = sorted(set(known))
    matches = get_close_matches(word, candidates, n=1, cutoff=ALIKE)
    if not matches:
        matches = [name for name in candidates if name.lower() == word.lower()]
    return matches[0] if matches else ""


def meant(word: str, known: Iterable[str]) -> tuple[str, str] | None:
    """Return the word and the only one that can have been meant: one much like it, when no other is nearly as alike.

    A name that differs only in digits is not taken for it: it means another of its kind, as the second of two fingers.
    """
    names = sorted(name for name in set(known) if _letters(name) != _letters(word) or name.lower() == word.lower())
    same = [name for name in names if name.lower() == word.lower()]
    if len(same) == 1:
        return word, same[0]
    close = get_close_matches(word, names, n=2, cutoff=ALIKE)
    likeness = [SequenceMatcher(None, name, word).ratio() for name in close]
    if not close or likeness[0] < 0.75 or (len(close) > 1 and likeness[0] - likeness[1] < 0.1):
        return None
    return word, close[0]


def _letters(word: str) -> str:
    return "".join(letter for letter in word if not letter.isdigit()).rstrip("-_")


def did_you_mean(word: str, known: Iterable[str], what: str = "known") -> str:
    """Advise the nearest known word, or list the known ones."""
    names = sorted(set(known))
    close = nearest(word, names)
    if close:
        return f"did you mean '{close}'?"
    if not names:
        return ""
    shown = ", ".join(f"'{name}'" for name in names[:12])
    return f"{what}: {shown}{', ...' if len(names) > 12 else ''}"


class Suggestions:
    """Suggestions like those of ``did_you_mean``, for many words, in a limited number of comparisons."""

    #: Greatest number of comparisons: about a second's work.
    ENOUGH = 100_000

    def __init__(self, known: Collection[str], what: str) -> None:
        self._known, self._what = known, what
        self._left = max(3, self.ENOUGH // (1 + len(known)))

    def advise(self, word: str) -> str:
        """Advise the nearest known word, or list the known ones; an empty string once the comparisons are used up."""
        self._left -= 1
        return did_you_mean(word, self._known, self._what) if self._left >= 0 else ""

    def mend(self, word: str) -> tuple[str, str] | None:
        """Return the only word that can have been meant, as ``meant`` does; None once the comparisons are used up."""
        return meant(word, self._known) if self._left >= 0 else None
