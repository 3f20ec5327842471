"""The one style of what the program says: which words of a line are coloured on a terminal that has colours."""

from __future__ import annotations

import re

_RED, _GREEN, _YELLOW, _BLUE, _CYAN = "1;31", "32", "1;33", "34", "1;36"
#: How lines look -> the group that is coloured, and how.
_RULES: tuple[tuple[re.Pattern[str], str], ...] = (
    (re.compile(r"^((?:error|fault)(?:\[[^\]\n]*\])?:|.*: error:)", re.MULTILINE), _RED),
    (re.compile(r"^(warning(?:\[[^\]\n]*\])?:)", re.MULTILINE), _YELLOW),
    (re.compile(r"^((?:note|waiting|preparing)(?:\[[^\]\n]*\])?:)", re.MULTILINE), _CYAN),
    (re.compile(r"^(  = (?:help|note):)", re.MULTILINE), _CYAN),
    (re.compile(r"^(  --> |[ \d]{4} \| )", re.MULTILINE), _BLUE),
    (re.compile(r"^ {5}\| +(\^+.*)$", re.MULTILINE), _RED),
    (re.compile(r"^.*: (ok)(?= \(|$)", re.MULTILINE), _GREEN),
)


def coloured(text: str) -> str:
    """Return a text, in which nothing acts on a terminal, with the colours of its kinds of lines."""
    for pattern, code in _RULES:
        text = pattern.sub(lambda found, code=code: _painted(found, code), text)  # type: ignore[misc]
    return text


def _painted(found: re.Match[str], code: str) -> str:
    whole, start = found.group(0), found.start(1) - found.start(0)
    end = found.end(1) - found.start(0)
    return f"{whole[:start]}\x1b[{code}m{whole[start:end]}\x1b[0m{whole[end:]}"
