"""Errors in a plugin's code while a scene is built: reported as problems at the plugin's place in the scene."""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import PurePath

from itouch import ending
from itouch.schema import ItouchError, Problem, SceneError
from itouch.schema.diagnostics import Place, class_of, raised_at, spoken


def said(error: BaseException) -> str:
    """Return what an error in a plugin says, and where it was raised: ``ValueError: text (file.py, line 7)``."""
    stack = [frame for frame in traceback.extract_tb(raised_at(error)) if frame.filename != ending.__file__]
    where = f" ({PurePath(stack[-1].filename).name}, line {stack[-1].lineno})" if stack else ""
    text = spoken(error).partition("\n")[0]
    return f"{class_of(error)}{': ' if text else ''}{text}{where}"


def written_at(method: object) -> str:
    """Return where a plugin's method is written, for a fault of what it returned: `` (file.py, line 7)``."""
    code = getattr(method, "__code__", None)
    return f" ({PurePath(code.co_filename).name}, line {code.co_firstlineno})" if code is not None else ""


def failure(what: str, method: str, error: BaseException, place: Place | None) -> Problem:
    """Return the problem that ``what``, such as "modality 'heat'", has failed in one of its methods."""
    return Problem(
        "plugin-failed", f"{what} failed in {method}: {said(error)}", place, "report it to the plugin's author"
    )


@contextmanager
def failing(what: str, method: str, place: Place | None) -> Iterator[None]:
    """Turn an error in a plugin's code into a problem of the scene.

    Raises
    ------
    SceneError
        If anything is raised inside but an ``ItouchError`` or a KeyboardInterrupt, which are passed on.
    """
    try:
        yield
    except ItouchError:
        raise
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a plugin that exits does not end the program
        raise SceneError([failure(what, method, error, place)]) from error
