"""Options of all commands: `--quiet`, `--verbose`, `--color`; how a help lists names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from itouch.schema import ItouchError
from itouch.schema.terminal import VERBOSITY

COLORS = ("auto", "always", "never")
#: These options in the help of the program and of each command.
HELP = """\
options of every command:
  -q, --quiet     results and errors only
  -v, --verbose   also what took how long
  --color WHEN    auto (the default; NO_COLOR is obeyed), always or never
"""


def in_columns(rows: Mapping[str, str]) -> str:
    """Return names, each beside what it is, in the width of the terminal, as the help of options is."""
    from shutil import get_terminal_size
    from textwrap import wrap

    name_width = max(map(len, rows), default=0)
    width = max(get_terminal_size().columns - 2, name_width + 24)
    indent = " " * (name_width + 4)
    entries = (
        wrap(text, width, initial_indent=f"  {name:<{name_width}}  ", subsequent_indent=indent)
        for name, text in rows.items()
    )
    return "\n".join(line for entry in entries for line in entry)


def taken(words: list[str]) -> tuple[list[str], dict[str, object]]:
    """Take the common options out of the words of a command line, wherever they are before ``--``.

    Returns
    -------
    tuple
        The other words, and the options by name, as ``speaking`` takes them.

    Raises
    ------
    ItouchError
        If the value of ``--color`` is none of its words.
    """
    left: list[str] = []
    found: dict[str, object] = {}
    rest = iter(words)
    for word in rest:
        if word == "--":
            left += [word, *rest]
        elif word in ("-q", "--quiet"):
            found["quiet"] = True
        elif word in ("-v", "--verbose"):
            found["verbose"] = True
        elif word in ("--color", "--colour"):
            found["color"] = _color(next(rest, ""))
        elif word.startswith(("--color=", "--colour=")):
            found["color"] = _color(word.partition("=")[2])
        else:
            left.append(word)
    return left, found


def _color(word: str) -> str:
    if word not in COLORS:
        raise ItouchError(f"error: --color is {', '.join(COLORS[:-1])} or {COLORS[-1]}, not '{word}'")
    return word


@contextmanager
def speaking(found: dict[str, object]) -> Iterator[None]:
    """Apply common options (``quiet``, ``verbose``, ``color``) while the context lasts."""
    before = VERBOSITY.quiet, VERBOSITY.verbose, VERBOSITY.color
    VERBOSITY.quiet, VERBOSITY.verbose = bool(found.get("quiet")), bool(found.get("verbose"))
    VERBOSITY.color = str(found.get("color", "auto"))
    try:
        yield
    finally:
        VERBOSITY.quiet, VERBOSITY.verbose, VERBOSITY.color = before
