"""The error of sessions, and what is wrong with a stored one in the user's terms."""

from __future__ import annotations

import json
import zipfile
import zlib
from typing import Any

from itouch.schema import ItouchError

#: What to do with a session that is not whole.
ADVICE = "take an earlier copy of it, or its recording"


class SessionError(ItouchError):
    """A snapshot that can't be written, read, or used here, or a session whose process has ended before it."""


def plainly(error: BaseException) -> str:
    """Return what an error in reading a session means; those of our own checks say it themselves.

    >>> plainly(KeyError("tick"))
    "'tick' is missing"
    """
    if isinstance(error, zipfile.BadZipFile):
        return "the file is cut off or damaged"
    if isinstance(error, zlib.error | EOFError):
        return "its content is damaged"
    if isinstance(error, json.JSONDecodeError):
        return f"a document of it is not JSON from line {error.lineno}, column {error.colno} on"
    if isinstance(error, UnicodeDecodeError):
        return "a document of it is not UTF-8 text"
    if isinstance(error, KeyError):
        return f"{error} is missing"
    if isinstance(error, ValueError):
        return str(error)
    return "something in it is of another kind than it must be"


def check_ledger(ledger: Any) -> None:
    """Check what everybody who reads a ledger relies on: the lists of closed contacts and of faults.

    Raises
    ------
    ValueError
        If it is otherwise.
    """
    if not isinstance(ledger, dict):
        raise ValueError("its ledger is not a JSON object")
    for name in ("contacts", "faults"):
        found = ledger.get(name)
        if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
            raise ValueError(f"'{name}' of its ledger is not a list of objects")
    for number, entry in enumerate(ledger["contacts"], 1):
        for name, kinds in _CONTACT.items():
            if name not in entry or not isinstance(entry[name], kinds) or isinstance(entry[name], bool):
                raise ValueError(f"contact {number} of its ledger has no '{name}' that can be read")


_CONTACT: dict[str, tuple[type, ...]] = {
    "probe": (str,), "object": (str,), "begin_s": (int, float), "end_s": (int, float, type(None)),
}  # fmt: skip
