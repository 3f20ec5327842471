"""The exit of a process of ours: when its work is done, with its own exit code, and within some seconds after that.

Plugins run in the process.  Their code may try to end the program at once, which would look like an orderly end; and
it may leave behind what never ends: threads, functions registered with ``atexit``, locks that those wait for.
"""

from __future__ import annotations

import _thread
import atexit
import contextlib
import os
import sys
import sysconfig
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

#: How long [s] what plugins have left behind may take to end once all is done.
LONGEST = 5.0
#: For how long [s] after a signal further ones are the same wish to end: a terminal that is closed sends several, and a
#: second one would break off what the first one has begun, such as removing half a file.
AT_ONCE = 0.5
#: Functions that end the process at once, with each module that has them.
_ENDINGS = tuple(
    (module, name)
    for module in (os, sys.modules[os.name if os.name == "nt" else "posix"])
    for name in ("_exit", "execv", "execve")
    if hasattr(module, name)
)
_exit, _write, _sleep = os._exit, os.write, time.sleep
#: Attempts to end the program that were refused in threads other than the loop's, where no one sees the exception.
refused: list[str] = []
#: Holds the exit code once the program's work is done; empty until then.
_done: list[int] = []


def refuse_sudden_ends() -> None:
    """From now on, refuse calls that end this process at once or replace its program; processes that it forks may."""
    own, loop = os.getpid(), _thread.get_ident()
    for module, name in _ENDINGS:
        setattr(module, name, _refusing(name, getattr(module, name), own, loop))


def _refusing(name: str, true: Callable[..., Any], own: int, loop: int) -> Callable[..., Any]:
    def refusing(*words: Any, **named: Any) -> Any:
        if os.getpid() != own:
            return true(*words, **named)
        if _done:
            _flush()
            _exit(_done[0])
        what = f"os.{name}({', '.join(map(repr, words))[:60]}) was refused: a plugin does not end the program"
        if _thread.get_ident() != loop:
            refused.append(what + _place(sys._getframe()))  # noqa: SLF001 - who has called this
        raise SystemExit(what)

    refusing.__name__ = name
    return refusing


def end_now(code: int) -> None:
    """End this process at once."""
    _exit(code)


def end_in_order(code: int) -> None:
    """End this process as the interpreter does, but without finalizing its objects: call it when all is done.

    Finalizing would run what plugins have left in garbage (``__del__``, callbacks of the garbage collector) when no
    thread runs any more that could end the process.
    """
    if not _done:
        end_soon(code)
    with contextlib.suppress(BaseException):
        threading._shutdown()  # type: ignore[attr-defined]  # noqa: SLF001 - waits for threads that are no daemons
    atexit._run_exitfuncs()  # noqa: SLF001
    _flush()
    _exit(code)


def end_soon(code: int) -> None:
    """End the process with this exit code if it has not ended within ``LONGEST``: call it when all is done.

    The thread that waits is started without `threading`, because another thread may hold the locks of that module.
    """
    _done.append(code)
    _thread.start_new_thread(_end_late, (code, _thread.get_ident()))


def _end_late(code: int, waited_for: int) -> None:
    _sleep(LONGEST)
    frame = sys._current_frames().get(waited_for)  # noqa: SLF001 - what it waits in
    place = _place(frame) or _threads() or " (registered with atexit, or holding a lock)"
    said = f"note: what a plugin has left{place} does not end; all work is done, so the program ends anyway\n"
    with contextlib.suppress(Exception):
        _thread.start_new_thread(_flush, ())  # another thread may hold a stream: what cannot be written then is lost
        _sleep(0.1)
        _write(2, said.encode())
    _exit(code)


def _threads() -> str:
    """Return the names of the threads that the interpreter waits for, without taking the lock of their list."""
    listed = getattr(sys.modules.get("threading"), "_active", {})
    names = [f"'{one.name}'" for one in list(listed.values()) if not one.daemon and one.name != "MainThread"]
    return f" (thread {', '.join(names)})" if names else ""


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()


def _place(frame: FrameType | None) -> str:
    """Return file and line of the innermost frame, from this one outwards, that is not of Python or this program."""
    here = os.path.dirname(os.path.dirname(__file__))
    libraries = sysconfig.get_path("stdlib"), os.path.join(here, "itouch"), os.path.join(here, "itouch_tools")
    while frame is not None:
        file = frame.f_code.co_filename
        packages = "site-packages" in file and not file.startswith(libraries[1:])
        own = frame.f_globals.get("__name__") == "__main__" or file.startswith("<")
        if packages or not (own or file.startswith(libraries)):
            return f" ({os.path.basename(file)}, line {frame.f_lineno})"
        frame = frame.f_back
    return ""
