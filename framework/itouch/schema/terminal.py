r"""What is printed on a terminal: escaping of foreign text, quiet or verbose, colours.

Characters that would move the cursor, change colours or the title, ring the bell, hide text or reverse its direction
are written as their codes, such as ``\x1b``.  What the encoding of the output does not have is written as in a scene,
such as ``degC`` and ``W/m^2``, or as its code.

>>> plain("a\x1b[31mred\u202e")
'a\\x1b[31mred\\u202e'
"""

from __future__ import annotations

import codecs
import errno
import io
import json
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, TextIO

#: Control characters except line ends and tabs, marks that change the writing direction, invisible characters, and lone
#: surrogates.
_UNSAFE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff"
    "\U000e0000-\U000e007f]"
)
#: What is written for a sign that the encoding of the output does not have: as in a scene, where that has a spelling.
_SPELLED = {"°": "deg", "²": "^2", "³": "^3", "µ": "u", "μ": "u", "×": "x", "≤": "<=", "≥": ">=", "–": "-", "…": "..."}
_RED, _GREEN, _YELLOW, _BLUE, _CYAN = "1;31", "32", "1;33", "34", "1;36"
#: Pattern of a line, whose group is coloured, and its colour.
_RULES: tuple[tuple[re.Pattern[str], str], ...] = (
    (re.compile(r"^((?:error|fault)(?:\[[^\]\n]*\])?:|.*: error:)", re.MULTILINE), _RED),
    (re.compile(r"^(warning(?:\[[^\]\n]*\])?:)", re.MULTILINE), _YELLOW),
    (re.compile(r"^((?:note|waiting|preparing)(?:\[[^\]\n]*\])?:)", re.MULTILINE), _CYAN),
    (re.compile(r"^(  = (?:help|note):)", re.MULTILINE), _CYAN),
    (re.compile(r"^ {5}\| +(\^+.*)$", re.MULTILINE), _RED),  # before the bar gets its colour
    (re.compile(r"^(  --> |[ \d]{4} \| )", re.MULTILINE), _BLUE),
    (re.compile(r"^.*: (ok)(?= \(|$)", re.MULTILINE), _GREEN),
)


@dataclass(slots=True)
class Verbosity:
    """How much the program prints: ``quiet`` only results and errors, ``verbose`` also how long things took.

    ``color`` is "auto" (on a terminal, unless ``NO_COLOR`` is set), "always" or "never".
    """

    quiet: bool = False
    verbose: bool = False
    color: str = "auto"


#: How this process prints; the command line sets it.
VERBOSITY = Verbosity()


def number_of(count: int, noun: str, many: str = "") -> str:
    """Return a number and what it counts, in singular or plural; default: with an ``s``.

    >>> number_of(1, "trial"), number_of(0, "trial"), number_of(2, "catch", "catches")
    ('1 trial', '0 trials', '2 catches')
    """
    return f"{count} {noun}" if count == 1 else f"{count} {many or noun + 's'}"


def note(words: str) -> None:
    """Print a note on standard error: worth knowing, but not essential."""
    if not VERBOSITY.quiet:
        print(f"note: {words}", file=sys.stderr, flush=True)


def did(words: str) -> None:
    """Print what was done, such as which file was written."""
    if not VERBOSITY.quiet:
        print(words)


def detail(words: str) -> None:
    """Print a detail on standard error, with ``--verbose`` only."""
    if VERBOSITY.verbose and not VERBOSITY.quiet:
        print(words, file=sys.stderr, flush=True)


def colours(stream: TextIO) -> bool:
    """Tell whether colours are written to a stream."""
    if VERBOSITY.color != "auto":
        return VERBOSITY.color == "always"
    inner: TextIO = getattr(stream, "inner", stream)
    return not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb" and is_terminal(inner)


def is_terminal(stream: TextIO) -> bool:
    """Tell whether a stream is a terminal; a closed stream is not."""
    try:
        return stream.isatty()
    except (ValueError, OSError):
        return False


def plain(text: str) -> str:
    """Return a text in which nothing can act on a terminal; line ends and tabs stay."""
    return _UNSAFE.sub(_code, text)


def _code(match: re.Match[str]) -> str:
    code = ord(match.group())
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def _spelled(error: UnicodeError) -> tuple[str, int]:
    """Return what is written for characters that an encoding does not have; their codes are those of JSON, too."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    found = error.object[error.start : error.end]
    return "".join(_SPELLED.get(each) or json.dumps(each)[1:-1] for each in found), error.end


codecs.register_error("itouch.spelled", _spelled)


class PlainStream:
    """A stream that escapes all that is written to it; ``inner`` is the terminal itself, for the program's own output.

    A terminal that was closed is reported like a reader that has gone: ``BrokenPipeError``.  With ``spare`` what finds
    no room on a full disk is lost: of messages nobody could be told, and no session ends for one.
    """

    #: Called before anything is written, so that a moving line on the terminal makes room.
    before: Callable[[], None] | None = None
    #: Called with each text after it was written, so that the line can come back.
    after: Callable[[str], None] | None = None

    def __init__(self, inner: TextIO, *, spare: bool = False) -> None:
        self.inner, self._spare = inner, spare
        self._terminal, self._colours = is_terminal(inner), colours(inner)

    def write(self, text: str) -> int:
        """Escape a text and write it."""
        if PlainStream.before is not None:
            PlainStream.before()
        safe = plain(text)
        with self.reached():
            self.inner.write(coloured(safe) if self._colours else safe)
        if PlainStream.after is not None:
            PlainStream.after(text)
        return len(text)

    def flush(self) -> None:
        """Flush the terminal."""
        with self.reached():
            self.inner.flush()

    @property
    def closed_terminal(self) -> bool:
        """Whether it was a terminal that has been closed since."""
        return self._terminal and not is_terminal(self.inner)

    @contextmanager
    def reached(self) -> Iterator[None]:
        """Raise ``BrokenPipeError`` if a write inside the context finds the terminal closed; lose what may be lost."""
        try:
            yield
        except OSError as error:
            if self._terminal and error.errno in (errno.EIO, errno.ENXIO):
                raise BrokenPipeError(errno.EPIPE, "the terminal was closed") from None
            if not self._spare or error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


def control(stream: TextIO, sequence: str) -> None:
    """Write one of the program's own control sequences, which is to act on the terminal."""
    if isinstance(stream, PlainStream):
        with stream.reached():
            stream.inner.write(sequence)
    else:
        stream.write(sequence)


@contextmanager
def escaped() -> Iterator[None]:
    """Escape all that is printed inside the context, and spell what the encoding of an output does not have."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (
        one if isinstance(one, PlainStream) else PlainStream(one, spare=one is before[1]) for one in before
    )
    with spelled(before[0]), spelled(before[1]):
        try:
            yield
        finally:
            sys.stdout, sys.stderr = before


@contextmanager
def spelled(stream: TextIO) -> Iterator[None]:
    """Inside the context, spell what the encoding of a stream does not have, whoever writes it; or write its code.

    >>> "20 °C, 3 W/m²".encode("ascii", "itouch.spelled")
    b'20 degC, 3 W/m^2'
    """
    if not isinstance(stream, io.TextIOWrapper) or stream.closed:
        yield
        return
    before = stream.errors
    stream.reconfigure(errors="itouch.spelled")
    try:
        yield
    finally:
        if not stream.closed:
            with suppress(OSError):  # it flushes what is left, which a reader that has gone does not take
                stream.reconfigure(errors=before)


def coloured(text: str) -> str:
    """Return a plain text with each kind of line coloured."""
    for pattern, code in _RULES:
        text = pattern.sub(lambda found, code=code: _painted(found, code), text)  # type: ignore[misc]
    return text


def _painted(found: re.Match[str], code: str) -> str:
    whole, start = found.group(0), found.start(1) - found.start(0)
    end = found.end(1) - found.start(0)
    return f"{whole[:start]}\x1b[{code}m{whole[start:end]}\x1b[0m{whole[end:]}"
