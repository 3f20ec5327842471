r"""The one escape for text from a file or a device on its way to a terminal.

What would move the cursor, change colours or a title, ring, hide text or turn its direction round is written as its
code, such as ``\x1b``.

>>> plain("a\x1b[31mred\u202e")
'a\\x1b[31mred\\u202e'
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

#: Control characters but for the ends of lines and tabs, marks that turn the direction of writing, what can't be seen,
#: and halves of characters.
_UNSAFE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff"
    "\U000e0000-\U000e007f]"
)


def plain(text: str) -> str:
    """Return a text in which nothing can act on a terminal; ends of lines and tabs stay."""
    return _UNSAFE.sub(_code, text)


def _code(match: re.Match[str]) -> str:
    code = ord(match.group())
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


class PlainStream:
    """A stream that escapes all that is written to it; ``inner`` is the terminal itself, for what is our own."""

    def __init__(self, inner: TextIO) -> None:
        self.inner = inner

    def write(self, text: str) -> int:
        """Write a text, escaped."""
        self.inner.write(plain(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


def control(stream: TextIO, sequence: str) -> None:
    """Write a sequence of the program's own that is to act on the terminal."""
    inner: TextIO = getattr(stream, "inner", stream)
    inner.write(sequence)


@contextmanager
def escaped() -> Iterator[None]:
    """Let all that is printed be escaped while the context lasts."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (PlainStream(one) if not isinstance(one, PlainStream) else one for one in before)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
