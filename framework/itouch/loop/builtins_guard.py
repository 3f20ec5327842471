"""The guard of Python's own functions: which of them code in this process has replaced, noticed, put back and named.

The safe sequence is Python.  A plugin that has replaced ``len`` would stop it halfway; so before it is carried out,
everything is put back as it was when this module was loaded, which is before any plugin is.
"""

from __future__ import annotations

import builtins
import io
import json
import os
import shutil
import struct
import sys
import tempfile
import zipfile
import zlib
from operator import itemgetter
from types import ModuleType
from typing import Any

from itouch.schema.terminal import PlainStream

#: What programs such as notebooks replace by something that does the same and more, which is harmless.
_WRAPPED = frozenset(
    ("print", "open", "input", "help", "exit", "quit", "copyright", "credits", "license", "breakpoint", "__import__")
)
_THERE: dict[str, Any] = vars(builtins)
_OWN = {name: value for name, value in _THERE.items() if name not in _WRAPPED and not name.startswith("_")}
_OWN["__build_class__"] = _THERE["__build_class__"]
_WRAPS = {name: _THERE[name] for name in _WRAPPED if name in _THERE}
_taken, _MISSING, _callable = itemgetter(*_OWN), KeyError, callable
_FUNCTIONS = _taken(_THERE)
#: Any error, under a name that a plugin cannot have replaced among the built-ins.
ANY_ERROR = BaseException
_DEEP = sys.getrecursionlimit()


def changed() -> bool:
    """Tell whether one of Python's own functions has been replaced."""
    try:
        return bool(_taken(_THERE) != _FUNCTIONS)
    except _MISSING:
        return True


def put_back() -> tuple[str, ...]:
    """Put back Python's own functions, and a recursion limit that was lowered; return the names of what had changed.

    Until they are back, nothing here uses one of them.
    """
    was = _THERE.copy()
    _THERE.update(_OWN)
    for name in _WRAPS:
        if not _callable(was.get(name)):
            _THERE[name] = _WRAPS[name]
    found = [name for name, value in (_OWN | _WRAPS).items() if was.get(name) is not _THERE[name]]
    if sys.getrecursionlimit() < _DEEP:
        sys.setrecursionlimit(_DEEP)
        found.append("sys.setrecursionlimit")
    return tuple(found)


def blamed(names: tuple[str, ...]) -> str:
    """Return the sentence about what was put back; empty if nothing was."""
    if not names:
        return ""
    how = "replaced or closed" if any(name.startswith(("file ", "sys.std")) for name in names) else "replaced"
    listed = ", ".join(f"'{name}'" for name in names[:3])
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    back = "it was" if len(names) == 1 else "they were"
    return f"a plugin had {how} {listed}{more} for the whole Python process; {back} restored"


#: The modules and classes whose functions are needed to end a session.
_NEEDED: tuple[ModuleType | type, ...] = (
    json, json.encoder, json.JSONEncoder, os, io, shutil, struct, tempfile, zipfile, zipfile.ZipFile, zlib
)  # fmt: skip
#: What a program replaces on purpose, to refuse to be ended.
_ENDINGS = ("_exit", "execv", "execve")
_STREAMS = (("stdout", 1), ("stderr", 2))


class LoadedModules:
    """What ending a session needs of its process, as it is now: modules, their functions, and standard streams.

    What a plugin has removed or replaced by then is put back.
    """

    def __init__(self) -> None:
        self._modules = sys.modules.copy()
        self._contents = [(owner, dict(filter(_is_function, vars(owner).items()))) for owner in _NEEDED]
        self._wraps = {name: _THERE[name] for name in _WRAPS if name in _THERE}
        numbered = [(name, getattr(sys, name), number) for name, number in _STREAMS]
        self._streams = [one for one in numbered if one[1] is not None]  # the process may have been started without it
        begun_with = (sys.__stdin__, sys.__stdout__, sys.__stderr__)  # a missing one's number may be another file's
        self._files = [_File(number) for number, stream in enumerate(begun_with) if stream is not None]

    def put_back(self) -> tuple[str, ...]:
        """Put all back; return the names of files and streams that were closed, and of functions that were gone.

        A function in whose place there was another one is put back but not named: that one may have done the same and
        more, which is harmless.
        """
        sys.modules.update(self._modules)
        _THERE.update(self._wraps)
        found = []
        for owner, functions in self._contents:
            there = vars(owner)
            for name, value in functions.items():
                now = there.get(name)
                if now is not value:
                    setattr(owner, name, value)
                    found += [f"{owner.__name__}.{name}"] if not _callable(now) else []
        found += [f"file {one.number}" for one in self._files if one.put_back()]
        for name, stream, number in self._streams:
            there, gone = getattr(sys, name), stream.closed
            if gone:
                stream = _reopened(stream, number)
            if gone or there is None:
                found.append(f"sys.{name}")
            setattr(sys, name, stream)
        return tuple(found)


class _File:
    """A file of the process by its number (descriptor), kept open under a second number until it is put back."""

    def __init__(self, number: int) -> None:
        self.number, self._kept, self._which = number, -1, self._identity(number)
        if self._which:
            self._kept = os.dup(number)

    @staticmethod
    def _identity(number: int) -> tuple[int, int] | None:
        try:
            found = os.fstat(number)
        except OSError:
            return None
        return found.st_dev, found.st_ino

    def put_back(self) -> bool:
        """Open it again if it was closed, and tell whether it was; onto the null device if its copy was closed, too."""
        if self._which is None:
            return False
        there, closed = self._identity(self._kept) == self._which, self._identity(self.number) is None
        if closed:
            source = self._kept if there else os.open(os.devnull, os.O_RDWR)
            if source != self.number:  # os.open takes the lowest free number, which may be its own
                os.dup2(source, self.number)
        if there:
            os.close(self._kept)
            self._which = None
        return closed


def _is_function(entry: tuple[str, Any]) -> bool:
    return _callable(entry[1]) and entry[0] not in _ENDINGS and entry[0] != "__class__"


def _reopened(stream: Any, number: int) -> Any:
    """Return a closed standard stream, opened again: the same object if it only wraps another stream."""
    fresh = open(number, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - to the end of the program
    if isinstance(stream, PlainStream):
        stream.inner = fresh
        return stream
    return fresh
