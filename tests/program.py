"""The program as a person calls it, but inside the process of the tests: no interpreter is started for it."""

from __future__ import annotations

import contextlib
import gc
import io
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from itouch_tools.cli import main

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE)


@dataclass(frozen=True, slots=True)
class Ended:
    """What a call of the program left: its exit code, and what it said."""

    returncode: int
    stdout: str
    stderr: str


def program(*words: str, cwd: Path | None = None, env: Mapping[str, str] | None = None) -> Ended:
    """Call ``itouch-py`` with some words, in a folder, with more in its environment."""
    out, err = Captured(), Captured()
    with _as_it_was(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        if cwd is not None:
            os.chdir(cwd)
        os.environ.update(env or {})
        try:
            code = main([str(word) for word in words])
        except SystemExit as error:
            code = _code(error)
        sys.stdout.flush()
    return Ended(code, out.text, err.text)


class Captured(io.TextIOWrapper):
    """A stream that is no terminal, of UTF-8, as a pipe would be."""

    def __init__(self) -> None:
        super().__init__(io.BytesIO(), encoding="utf-8", write_through=True)

    @property
    def text(self) -> str:
        """All that was written."""
        buffer = self.buffer
        assert isinstance(buffer, io.BytesIO)
        return buffer.getvalue().decode()


def _code(error: SystemExit) -> int:
    if error.code is None or isinstance(error.code, int):
        return error.code or 0
    print(error.code, file=sys.stderr)
    return 1


@contextlib.contextmanager
def _as_it_was() -> Iterator[None]:
    """Give back folder, environment, signals and the collector as they were before."""
    folder, environment, collects = os.getcwd(), dict(os.environ), gc.isenabled()
    handlers = {number: signal.getsignal(number) for number in _SIGNALS}
    try:
        yield
    finally:
        os.chdir(folder)
        os.environ.clear()
        os.environ.update(environment)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        if collects:
            gc.enable()
