"""``itouch-py check --fix``: what can have meant one thing only is mended in the scene's file."""

from __future__ import annotations

import difflib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from itouch.schema import ItouchError
from itouch.schema.diagnostics import Problem
from itouch_tools.authoring.fixes import mended

#: Most rounds of fixing and checking again: what is inside a misspelt element is only seen once that is fixed.
_ROUNDS = 10


@dataclass(frozen=True, slots=True)
class Fixed:
    """A scene's text before and after, and the problems that were mended."""

    before: str
    after: str
    problems: tuple[Problem, ...]

    def diff(self, path: str) -> str:
        """Return the change as a unified diff."""
        lines = (self.before.splitlines(keepends=True), self.after.splitlines(keepends=True))
        return "".join(difflib.unified_diff(*lines, fromfile=path, tofile=f"{path} (fixed)"))


def fixed(path: str, examine: Callable[[str], Sequence[Problem]]) -> Fixed | None:
    """Fix a copy of a scene in its folder until nothing more can be fixed; None if there is nothing to fix.

    A change after which there are more errors than before is dropped, unless it mended an element: the errors inside
    that element could not be seen before.

    Raises
    ------
    ItouchError
        If no copy can be made in the scene's folder.
    """
    problems = examine(path)
    if not any(problem.mend for problem in problems):
        return None
    before = Path(path).read_bytes()
    data, done = before, []
    with temporary_copy(path) as copy:
        shown = path
        for _ in range(_ROUNDS):
            data_then, now = mended(data, shown, problems)
            if not now:
                break
            _write(copy, data_then, path)
            problems_then = examine(copy)
            if _errors(problems_then) > _errors(problems) and not _nested(now):
                break
            data, problems, shown = data_then, problems_then, copy
            done += now
    return Fixed(before.decode("utf-8"), data.decode("utf-8"), tuple(done)) if done else None


def _errors(problems: Sequence[Problem]) -> int:
    return sum(problem.severity == "error" for problem in problems)


def _nested(problems: Sequence[Problem]) -> bool:
    """Tell whether an element was mended: what is wrong inside it is seen only then."""
    return any(problem.code == "unknown-element" for problem in problems)


def _write(copy: str, data: bytes, path: str) -> None:
    try:
        Path(copy).write_bytes(data)
    except OSError as error:
        raise ItouchError(f"cannot mend '{path}': {error.strerror}") from None


class temporary_copy:  # noqa: N801 - used as a context, like those of contextlib
    """The name of a copy in a scene's folder, so that its relative paths still hold; the copy is removed afterwards."""

    def __init__(self, path: str) -> None:
        self._path = path

    def __enter__(self) -> str:
        try:
            handle, self._copy = tempfile.mkstemp(".xml", ".itouch-fix-", os.path.dirname(self._path) or ".")
        except OSError as error:
            raise ItouchError(f"cannot mend '{self._path}': {error.strerror}") from None
        os.close(handle)
        return self._copy

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):
            os.unlink(self._copy)


def show_and_write(path: str, found: Fixed | None, *, write: bool) -> None:
    """Show the changes to a scene as a diff, then write them unless only the diff is wanted.

    Raises
    ------
    ItouchError
        If the file cannot be replaced; it is unchanged then.
    """
    if found is None:
        return
    print(found.diff(path), end="", flush=True)
    words = "1 problem" if len(found.problems) == 1 else f"{len(found.problems)} problems"
    if not write:
        print(f"{path}: {words} can be fixed; nothing was written", file=sys.stderr)
        return
    target = os.path.realpath(path)  # a symbolic link stays a link
    with temporary_copy(target) as copy:
        _write(copy, found.after.encode("utf-8"), path)
        try:
            shutil.copymode(target, copy)
            os.replace(copy, target)
        except OSError as error:
            raise ItouchError(f"cannot write '{path}': {error.strerror}; it is as it was") from None
    print(f"{path}: {words} fixed", file=sys.stderr)
