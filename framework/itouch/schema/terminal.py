r"""What is printed on a terminal: escape of foreign text, quiet or verbose, colours.

What would move the cursor, change colours or a title, ring, hide text or turn its direction round is written as its
code, such as ``\x1b``.

>>> plain("a\x1b[31mred\u202e")
'a\\x1b[31mred\\u202e'
"""

from __future__ import annotations

import errno
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TextIO

#: Control characters but for the ends of lines and tabs, marks that turn the direction of writing, what can't be seen,
#: and halves of characters.
_UNSAFE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff"
    "\U000e0000-\U000e007f]"
)
_RED, _GREEN, _YELLOW, _BLUE, _CYAN = "1;31", "32", "1;33", "34", "1;36"
#: How lines look -> the group that is coloured, and how.
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
class Manner:
    """How the program speaks: ``quiet`` says results and errors only, ``verbose`` also what took how long.

    ``color`` is "auto" (on a terminal, unless ``NO_COLOR`` is set), "always" or "never".
    """

    quiet: bool = False
    verbose: bool = False
    color: str = "auto"


#: The manner of this process; the command line sets it.
MANNER = Manner()


def note(words: str) -> None:
    """Say what the person should know, and can do without, on the stream of errors."""
    if not MANNER.quiet:
        print(f"note: {words}", file=sys.stderr, flush=True)


def did(words: str) -> None:
    """Say what was done, such as which file was written."""
    if not MANNER.quiet:
        print(words)


def detail(words: str) -> None:
    """Say what only ``--verbose`` asks for, on the stream of errors."""
    if MANNER.verbose and not MANNER.quiet:
        print(words, file=sys.stderr, flush=True)


def colours(stream: TextIO) -> bool:
    """Tell whether colours are written to a stream."""
    if MANNER.color != "auto":
        return MANNER.color == "always"
    inner: TextIO = getattr(stream, "inner", stream)
    return not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb" and is_terminal(inner)


def is_terminal(stream: TextIO) -> bool:
    """Tell whether a stream is a terminal; a closed one is none."""
    try:
        return stream.isatty()
    except (ValueError, OSError):
        return False


def plain(text: str) -> str:
    """Return a text in which nothing can act on a terminal; ends of lines and tabs stay."""
    return _UNSAFE.sub(_code, text)


def _code(match: re.Match[str]) -> str:
    code = ord(match.group())
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


class PlainStream:
    """A stream that escapes all that is written to it; ``inner`` is the terminal itself, for what is our own.

    A terminal that was closed is told as a reader that has gone: ``BrokenPipeError``.
    """

    #: Called before anything is written: what moves on the terminal makes room.
    before: Callable[[], None] | None = None

    def __init__(self, inner: TextIO) -> None:
        self.inner = inner
        self._terminal, self._colours = is_terminal(inner), colours(inner)

    def write(self, text: str) -> int:
        """Write a text, escaped."""
        if PlainStream.before is not None:
            PlainStream.before()
        safe = plain(text)
        with self.reached():
            self.inner.write(coloured(safe) if self._colours else safe)
        return len(text)

    def flush(self) -> None:
        """Let what was written appear."""
        with self.reached():
            self.inner.flush()

    @property
    def closed_terminal(self) -> bool:
        """Whether it was a terminal, and that is gone."""
        return self._terminal and not is_terminal(self.inner)

    @contextmanager
    def reached(self) -> Iterator[None]:
        """Write to the terminal itself; that it was closed is told as a reader that has gone."""
        try:
            yield
        except OSError as error:
            if self._terminal and error.errno in (errno.EIO, errno.ENXIO):
                raise BrokenPipeError(errno.EPIPE, "the terminal was closed") from None
            raise

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


def control(stream: TextIO, sequence: str) -> None:
    """Write a sequence of the program's own that is to act on the terminal."""
    if isinstance(stream, PlainStream):
        with stream.reached():
            stream.inner.write(sequence)
    else:
        stream.write(sequence)


@contextmanager
def escaped() -> Iterator[None]:
    """Let all that is printed be escaped while the context lasts."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (PlainStream(one) if not isinstance(one, PlainStream) else one for one in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def coloured(text: str) -> str:
    """Return a text, in which nothing acts on a terminal, with the colours of its kinds of lines."""
    for pattern, code in _RULES:
        text = pattern.sub(lambda found, code=code: _painted(found, code), text)  # type: ignore[misc]
    return text


def _painted(found: re.Match[str], code: str) -> str:
    whole, start = found.group(0), found.start(1) - found.start(0)
    end = found.end(1) - found.start(0)
    return f"{whole[:start]}\x1b[{code}m{whole[start:end]}\x1b[0m{whole[end:]}"
