"""Errors in a plugin's code: where they were raised, and while a scene is built problems at the plugin's place."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import PurePath
from types import FrameType, TracebackType

from itouch import process_exit
from itouch.schema.diagnostics import ItouchError, Place, Problem, SceneError, class_of, raised_at, spoken

#: The core's own folder: what it raises for a plugin is put down to the plugin's line that called it.
_CORE = PurePath(__file__).parent.parent


#: Packages of which a line says nothing to a plugin's author.
_LIBRARIES = frozenset({*sys.stdlib_module_names, "numpy", "scipy"})


class ReturnedError(ValueError):
    """A plugin's ``method`` has returned what cannot be used: a sentence on it, and where the method is written."""

    def __init__(self, method: object, sentence: str) -> None:
        super().__init__(f"{sentence}{written_at(method)}")


def error_text(error: BaseException) -> str:
    """Return what an error in a plugin says, and where it was raised: ``ValueError: text (file.py, line 7)``."""
    if issubclass(type(error), ReturnedError):  # not isinstance: an error may fail when its class is asked for
        return spoken(error)
    where = _where(raised_at(error))
    text = spoken(error).partition("\n")[0]
    return f"{class_of(error)}{': ' if text else ''}{text}{where}"


def _where(raised: TracebackType | None) -> str:
    """Return the plugin's line that an error came through last: `` (file.py, line 7)``; empty if there is none.

    What Python's own modules and NumPy raise is put down to the line that calls them.
    """
    frames = [(frame.f_code.co_filename, line, _package(frame)) for frame, line in traceback.walk_tb(raised)]
    frames = [one for one in frames if one[0] != process_exit.__file__]
    frames = [one for one in frames if not _is_core(one[0])] or frames
    frames = [one for one in frames if one[2] not in _LIBRARIES] or frames
    return f" ({PurePath(frames[-1][0]).name}, line {frames[-1][1]})" if frames else ""


@cache
def _is_core(file: str) -> bool:
    """Tell whether a file is one of the core's: what fails is told in every tick of a safe sequence."""
    return _CORE in PurePath(file).parents


def _package(frame: FrameType) -> str:
    """Return the outermost package of the code that a frame runs."""
    return str(frame.f_globals.get("__name__", "")).partition(".")[0]


def written_at(method: object) -> str:
    """Return where a plugin's method is written, for a fault of what it returned: `` (file.py, line 7)``."""
    code = getattr(method, "__code__", None)
    return f" ({PurePath(code.co_filename).name}, line {code.co_firstlineno})" if code is not None else ""


def failure(what: str, method: str, error: BaseException, place: Place | None) -> Problem:
    """Return the problem that ``what``, such as "modality 'heat'", has failed in one of its methods.

    An error that explains itself, such as a DeviceError, is told in its own words.
    """
    if issubclass(type(error), ItouchError):
        return Problem("plugin-failed", f"{what}: {spoken(error)}", place)
    return Problem(
        "plugin-failed", f"{what} failed in {method}: {error_text(error)}", place, "report it to the plugin's author"
    )


@contextmanager
def gathering(problems: list[Problem]) -> Iterator[None]:
    """Put the problems with which something inside is given up to the others, so that what comes after is checked."""
    try:
        yield
    except SceneError as error:
        problems += error.problems


@contextmanager
def failing(what: str, method: str, place: Place | None) -> Iterator[None]:
    """Turn an error in a plugin's code into a problem of the scene.

    Raises
    ------
    SceneError
        If anything is raised inside but a KeyboardInterrupt, which is passed on, as is a SceneError.
    """
    try:
        yield
    except (SceneError, KeyboardInterrupt):
        raise
    except BaseException as error:  # a plugin that exits does not end the program
        raise SceneError([failure(what, method, error, place)]) from error
