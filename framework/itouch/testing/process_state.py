"""State of the whole process that a plugin must not change: compared before and after, and restored."""

from __future__ import annotations

import builtins
import contextlib
import gc
import locale
import logging
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from itouch import platforms


def _handlers() -> dict[int, Any]:
    return {int(number): signal.getsignal(number) for number in signal.valid_signals()}


def _umask() -> int:
    mask = os.umask(0o022)
    os.umask(mask)
    return mask


def _broad_filters() -> list[Any]:
    """Return the warning filters that apply to everything; libraries may set narrower ones."""
    return [one[0] for one in warnings.filters if one[1] is None and one[2] is Warning and one[3] is None]


def _clock() -> dict[str, Any]:
    return {name: value for name, value in vars(time).items() if callable(value)}


#: What is compared, in words -> a function that reads it.
LOOKS: Mapping[str, Callable[[], Any]] = {
    "the working folder": os.getcwd,
    "the environment's variables": lambda: dict(os.environ),
    "the mask of new files' rights": _umask,
    "the handlers of signals": _handlers,
    "whether garbage is collected": lambda: (gc.isenabled(), gc.get_threshold()),
    "NumPy's treatment of errors": lambda: (np.geterr(), np.geterrcall()),
    "NumPy's way to print": np.get_printoptions,
    "the filters of warnings": _broad_filters,
    "the locale": lambda: locale.setlocale(locale.LC_ALL),
    "the time zone": lambda: time.tzname,
    "the recursion limit": sys.getrecursionlimit,
    "the interpreter's switch interval": sys.getswitchinterval,
    "the standard streams": lambda: (sys.stdin, sys.stdout, sys.stderr),
    "the hooks for errors": lambda: (sys.excepthook, sys.unraisablehook, threading.excepthook),
    "the tracing of calls": lambda: (sys.gettrace(), sys.getprofile()),
    "the search path of imports": lambda: list(sys.path),
    "the root logger": lambda: (logging.root.level, list(logging.root.handlers), logging.root.manager.disable),
    "the built-in functions": lambda: dict(vars(builtins)),
    "the functions of time": _clock,
    "the process's priority": platforms.priority,
    "the process's limits": lambda: [platforms.limit(name) for name in ("RLIMIT_NOFILE", "RLIMIT_CORE")],
}


class ProcessState:
    """The state of the process at the time when this object was made."""

    def __init__(self) -> None:
        self._seen = {name: look() for name, look in LOOKS.items()}

    def changes(self) -> list[str]:
        """Return what has changed since then, in words."""
        found = []
        for name, look in LOOKS.items():
            now, before = look(), self._seen[name]
            if now != before:
                found.append(name + _which(before, now))
        return found

    def put_back(self) -> None:
        """Undo the changes that can be undone, so that the next check does not run in a changed process."""
        seen = self._seen
        with contextlib.suppress(OSError):
            os.chdir(seen["the working folder"])
        if dict(os.environ) != seen["the environment's variables"]:
            os.environ.clear()
            os.environ.update(seen["the environment's variables"])
        os.umask(seen["the mask of new files' rights"])
        if threading.current_thread() is threading.main_thread():
            for number, handler in seen["the handlers of signals"].items():
                if handler is not None and signal.getsignal(number) != handler:
                    signal.signal(number, handler)
        enabled, threshold = seen["whether garbage is collected"]
        (gc.enable if enabled else gc.disable)()
        gc.set_threshold(*threshold)
        np.seterr(**seen["NumPy's treatment of errors"][0])
        locale.setlocale(locale.LC_ALL, seen["the locale"])
        sys.setrecursionlimit(seen["the recursion limit"])
        sys.setswitchinterval(seen["the interpreter's switch interval"])
        _, sys.stdout, sys.stderr = seen["the standard streams"]
        sys.path[:] = seen["the search path of imports"]
        for module, name in ((builtins, "the built-in functions"), (time, "the functions of time")):
            for key, value in seen[name].items():
                if vars(module).get(key) is not value and key != "_":
                    setattr(module, key, value)


def _which(before: Any, now: Any) -> str:
    """Return which entries have changed, if there are several; or the old and the new value."""
    if isinstance(before, dict) and isinstance(now, dict):
        keys = [key for key in {**before, **now} if before.get(key) != now.get(key)]
        named = [signal.Signals(key).name if isinstance(key, int) else str(key) for key in keys]
        return f" ({', '.join(named[:3])})"
    if isinstance(before, (str, int, float)):
        return f" ({before!r} is now {now!r})"
    return ""


def open_files() -> dict[str, str]:
    """Return the numbers of the open file descriptors, and what they refer to."""
    found = {}
    with contextlib.suppress(FileNotFoundError):  # a system without /proc
        for number in os.listdir("/proc/self/fd"):
            with contextlib.suppress(OSError):
                found[number] = os.readlink(f"/proc/self/fd/{number}")
    return found


def native_threads() -> set[int]:
    """Return the kernel's numbers of the process's threads, including those that Python does not know."""
    return {int(number) for number in os.listdir("/proc/self/task")}


def children() -> set[int]:
    """Return the numbers of the child processes."""
    found, own = set(), str(os.getpid())
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                words = (entry / "stat").read_text().rpartition(")")[2].split()
                if words[1] == own:
                    found.add(int(entry.name))
    return found
