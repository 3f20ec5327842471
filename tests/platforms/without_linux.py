"""Takes away what only Linux has: the interpreter then is as on a Mac or a Windows machine, as far as Python shows it.

``mac/sitecustomize.py`` and ``win/sitecustomize.py`` call it when an interpreter starts, so that processes that are
started from there are alike.  What is missing on a system is from the documentation of Python's standard library
("Availability").  Files of ``/proc`` and ``/sys`` do not exist there either.
"""

from __future__ import annotations

import builtins
import importlib.abc
import io
import multiprocessing
import multiprocessing.connection  # before it looks for what only a real Windows has
import multiprocessing.context
import os
import pathlib
import platform
import select
import signal
import socket
import subprocess
import sys
import time
import types
from typing import Any

#: Names of each module that neither system has, and those that Windows has not.
LINUX_ONLY = {
    os: ["memfd_create", "pidfd_open", "sched_getaffinity", "sched_setaffinity", "sched_getscheduler", "SCHED_FIFO",
         "sched_setscheduler", "sched_getparam", "sched_param", "SCHED_OTHER", "SCHED_RESET_ON_FORK", "posix_fadvise",
         "copy_file_range", "splice", "eventfd", "getrandom", "MFD_CLOEXEC", "posix_fallocate"],
    signal: ["pidfd_send_signal", "sigtimedwait", "sigwaitinfo", "SIGRTMIN", "SIGRTMAX"],
    select: ["epoll"],
    socket: ["SOCK_SEQPACKET", "SO_PEERCRED", "AF_NETLINK", "AF_PACKET", "AF_CAN", "SOCK_CLOEXEC", "SOCK_NONBLOCK"],
    time: ["clock_nanosleep", "CLOCK_BOOTTIME"],
}  # fmt: skip
POSIX_ONLY = {
    os: ["fork", "forkpty", "killpg", "getuid", "geteuid", "getgid", "getegid", "nice", "getpgid",
         "setsid", "openpty", "ttyname", "getpriority", "setpriority", "PRIO_PROCESS",
         "statvfs", "fchmod", "mkfifo", "chown", "O_CLOEXEC", "O_NONBLOCK", "O_NOFOLLOW", "O_DIRECTORY",
         "getpgrp", "getloadavg"],
    signal: ["SIGHUP", "SIGUSR1", "SIGUSR2", "SIGKILL", "SIGALRM", "SIGPIPE", "SIGTSTP", "SIGQUIT", "SIGSTOP",
             "SIGCONT", "SIGCHLD", "setitimer", "alarm", "pthread_sigmask", "sigwait", "ITIMER_REAL", "pthread_kill"],
    select: ["poll", "kqueue"],
    socket: ["AF_UNIX"],
    time: ["clock_gettime", "clock_gettime_ns", "CLOCK_MONOTONIC", "CLOCK_MONOTONIC_RAW", "CLOCK_REALTIME", "tzset"],
}  # fmt: skip
MODULES = {
    "mac": {"spwd", "_posixsubprocess_linux"},
    "win": {"fcntl", "resource", "pwd", "grp", "termios", "tty", "pty"},
}
#: What the interpreter was told to be, for tests that must know.
MARK = "ITOUCH_TEST_ELSEWHERE"
#: Set for an interpreter that draws: the library for that looks at the system when it is imported.
DRAWS = "ITOUCH_TEST_DRAWS"


class _Missing(importlib.abc.MetaPathFinder):
    def __init__(self, names: set[str]) -> None:
        self._names = names

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name in self._names:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


#: What looks at the system when it is imported, and cannot be told another: it is imported before.
LOOKING = (
    "asyncio",
    "tempfile",
    "uuid",
    "urllib.request",
    "shutil",
    "numpy",
    "llvmlite.binding",
    "numba",
    "lxml.etree",
)
DRAWING = ("pyglet.window", "pyglet.text", "pyglet.font", "pyglet.image.codecs.png")


def become(system: str) -> None:
    """Make this interpreter look like one on ``mac`` or ``win``."""
    import ctypes.util  # noqa: F401 - looks at the system when it is imported

    import pyglet

    pyglet.options.headless = True  # pictures are drawn by what this machine has
    for heavy in (*LOOKING, *(DRAWING if os.environ.get(DRAWS) else ())):
        __import__(heavy)
    gone = {module: [*names, *(POSIX_ONLY.get(module, []) if system == "win" else [])]
            for module, names in LINUX_ONLY.items()}  # fmt: skip
    _without_files()
    _without_fork()
    if system == "win":
        _without_passing()
        _with_free_space()
    for module, names in gone.items():
        for name in names:
            if hasattr(module, name):
                delattr(module, name)
    for name in MODULES[system]:
        sys.modules.pop(name, None)
    sys.meta_path.insert(0, _Missing(MODULES[system]))
    sys.platform = "darwin" if system == "mac" else "win32"
    named = "Darwin" if system == "mac" else "Windows"
    platform.system = lambda: named
    os.environ[MARK] = system


def _with_free_space() -> None:
    """Let ``shutil.disk_usage`` go on: on Windows it asks the system in another way, which this machine has not."""
    import shutil

    asked = os.statvfs

    def usage(path: Any) -> Any:
        found = asked(path)
        total, free = found.f_blocks * found.f_frsize, found.f_bavail * found.f_frsize
        return types.SimpleNamespace(total=total, used=total - free, free=free)

    shutil.disk_usage = usage


def _foreign(path: Any) -> bool:
    return isinstance(path, (str, os.PathLike)) and os.fspath(path).__str__().startswith(("/proc", "/sys/"))


def _without_files() -> None:
    def guarded(function: Any) -> Any:
        def call(path: Any, *rest: Any, **named: Any) -> Any:
            if _foreign(path):
                raise FileNotFoundError(2, "No such file or directory", str(path))
            return function(path, *rest, **named)

        return call

    for module, names in (
        (builtins, ["open"]),
        (io, ["open"]),
        (os, ["open", "listdir", "scandir", "stat", "readlink"]),
    ):
        for name in names:
            setattr(module, name, guarded(getattr(module, name)))
    exists = os.path.exists
    os.path.exists = lambda path: not _foreign(path) and exists(path)
    iterate = pathlib.Path.iterdir

    def iterdir(self: pathlib.Path) -> Any:
        if _foreign(self):
            raise FileNotFoundError(2, "No such file or directory", str(self))
        return iterate(self)

    pathlib.Path.iterdir = iterdir  # type: ignore[method-assign]


def _without_fork() -> None:
    multiprocessing.set_start_method("spawn")
    spawn = multiprocessing.get_context("spawn")
    multiprocessing.get_all_start_methods = lambda: ["spawn"]
    for context in (multiprocessing, multiprocessing.context.BaseContext):
        context.get_all_start_methods = lambda *_: ["spawn"]
    get_context = multiprocessing.get_context

    def only(method: str | None = None) -> Any:
        if method not in (None, "spawn"):
            raise ValueError(f"cannot find context for {method!r}")
        return spawn if method == "spawn" else get_context(None)

    multiprocessing.get_context = only


def _over_tcp(*_: Any) -> tuple[socket.socket, socket.socket]:
    """Return two connected sockets as Python makes them on Windows."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        near = socket.create_connection(listener.getsockname())
        far, _ = listener.accept()
    return near, far


def _without_passing() -> None:
    begin, send = subprocess.Popen.__init__, subprocess.Popen.send_signal
    last = signal.SIGKILL  # what ends a process there has no number

    def checked(self: Any, *rest: Any, **named: Any) -> None:
        if named.get("pass_fds") or named.get("preexec_fn"):
            raise ValueError("pass_fds and preexec_fn are not supported on Windows platforms")
        begin(self, *rest, **named)

    subprocess.Popen.__init__ = checked  # type: ignore[method-assign]
    subprocess.Popen.kill = lambda self: send(self, last)  # type: ignore[method-assign]
    socket.socketpair = _over_tcp
    killed = os.kill

    def kill(process: int, number: int) -> None:
        if number not in (signal.SIGTERM, signal.SIGINT, 9):
            raise AssertionError(f"os.kill({process}, {number}) ends the process on Windows")
        killed(process, number)

    os.kill = kill
    wait = select.select

    def sockets_only(*lists: Any) -> Any:
        for one in lists[:3]:
            if not all(isinstance(item, socket.socket) for item in one):
                raise OSError(10038, "An operation was attempted on something that is not a socket")
        return wait(*lists)

    select.select = sockets_only
