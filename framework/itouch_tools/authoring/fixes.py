"""Fixes a scene's text: misspelt words that can have meant one thing only, and nothing that bears on safety."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from xml.parsers import expat

from itouch.schema.diagnostics import Place, Problem

#: These elements, and anything in them, are never fixed: there a person must say what was meant.
UNTOUCHED = frozenset({"safety", "devices", "device", "limits"})
_NAME = re.compile(rb"[^\s/><=]+")
_EMPTY = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=<>/]+\s*=\s*(?:"[^"]*"|'[^']*'))*\s*/>""")
_VALUE = re.compile(rb"""([^\s=<>/]+)\s*=\s*(["'])""")


@dataclass(frozen=True, slots=True)
class Edit:
    """A word to replace: its line and column, from 1, its number of letters, and the new text."""

    line: int
    column: int
    length: int
    text: str


@dataclass(frozen=True, slots=True)
class _Element:
    """Where an element and its end tag, if it has one, begin [bytes], and the tags from the root down to it."""

    start: int
    end: int
    names: tuple[str, ...]


def mended(data: bytes, file: str, problems: Iterable[Problem]) -> tuple[bytes, list[Problem]]:
    """Fix what is unambiguous in the text of a file.

    Parameters
    ----------
    data
        The file as read: UTF-8, well-formed.
    file
        Its name in the problems' places; problems of other files are passed over.
    problems
        The problems that were found in it.

    Returns
    -------
    tuple
        The text with each word replaced for which a problem names the only one that can have been meant, and those
        problems.  An element or attribute that limits, or that is inside one of ``UNTOUCHED``, is left as it is.
    """
    elements = _elements(data)
    changes: dict[int, tuple[int, bytes]] = {}
    done = []
    for problem in problems:
        if problem.mend is None or problem.place is None or problem.place.file != file:
            continue
        found = _changes(data, problem.place, problem.mend, problem.code, elements)
        if found and not any(at in changes for at, _, _ in found):
            changes.update({at: (length, new) for at, length, new in found})
            done.append(problem)
    for at in sorted(changes, reverse=True):
        length, new = changes[at]
        data = data[:at] + new + data[at + length :]
    return data, done


def edits(data: bytes, file: str, problem: Problem) -> list[Edit]:
    """Return what ``mended`` replaces for one problem of a file, columns in letters; nothing where it leaves it."""
    if problem.mend is None or problem.place is None or problem.place.file != file:
        return []
    found = []
    for at, length, new in _changes(data, problem.place, problem.mend, problem.code, _elements(data)):
        start = data.rfind(b"\n", 0, at) + 1
        column = len(data[start:at].decode("utf-8")) + 1
        gone = len(data[at : at + length].decode("utf-8"))
        found.append(Edit(data.count(b"\n", 0, at) + 1, column, gone, new.decode("utf-8")))
    return sorted(found, key=lambda edit: (edit.line, edit.column))


def _changes(
    data: bytes, place: Place, mend: tuple[str, str], code: str, elements: list[_Element]
) -> list[tuple[int, int, bytes]]:
    """Return the bytes to replace: where, how many, by what; none where that is not allowed or the word is missing."""
    wrong, right = (word.encode() for word in mend)
    at = _offset(data, place)
    element = max((one for one in elements if one.start <= at), key=lambda one: one.start, default=None)
    words = " ".join((*mend, *(element.names if element else ()))).lower()
    if element is None or UNTOUCHED & {*mend, *element.names} or "limit" in words:
        return []
    if code == "unknown-element":
        places = [element.start + 1, *([] if _EMPTY.match(data, element.start) else [element.end + 2])]
        return [(one, len(wrong), right) for one in places] if all(_word(data, one) == wrong for one in places) else []
    if code == "unknown-attribute":
        return [(at, len(wrong), right)] if _word(data, at) == wrong else []
    value = _VALUE.match(data, at)
    if value is None or b"limit" in value.group(1).lower():
        return []
    end = data.index(value.group(2), value.end())
    return [(value.end(), len(wrong), right)] if data[value.end() : end] == wrong else []


def _word(data: bytes, at: int) -> bytes:
    found = _NAME.match(data, at)
    return found.group() if found else b""


def _offset(data: bytes, place: Place) -> int:
    """Return the byte at which a place begins."""
    start = 0
    for _ in range(place.line - 1):
        start = data.index(b"\n", start) + 1
    line = data[start:].split(b"\n", 1)[0].decode("utf-8", "replace")
    return start + len(line[: place.column - 1].encode())


def _elements(data: bytes) -> list[_Element]:
    """Return the elements of a well-formed text, in the order in which they end."""
    parser = expat.ParserCreate()
    opened: list[tuple[int, str]] = []
    found: list[_Element] = []

    def start(name: str, _: object) -> None:
        opened.append((parser.CurrentByteIndex, name))

    def end(_: str) -> None:
        names = tuple(name for _, name in opened)
        begin, _name = opened.pop()
        found.append(_Element(begin, parser.CurrentByteIndex, names))

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(data, True)
    return found
