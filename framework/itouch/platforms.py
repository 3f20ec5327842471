"""What differs between operating systems, in one place: what this one has, and what takes its place where it has not.

Simulated sessions run wherever Python does.  Hardware, the guardian and real-time priority need Linux: they stand on
its process handles, its anonymous files and its scheduler, and what cannot be relied on is refused.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator
from typing import Any, Final

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]
try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

#: Whether a session can run in a servo process with a guardian; elsewhere it runs in a thread, on twins only.
SERVO_PROCESS: Final[bool] = hasattr(os, "memfd_create") and hasattr(os, "pidfd_open")
#: Whether a process can go on as two.
FORKS: Final[bool] = hasattr(os, "fork")
#: Whether files are locked as on Unix, by a lock that ends with the process.
FILE_LOCKS: Final[bool] = bool(fcntl)
#: Flags for every ``os.open``: children do not inherit the file, and bytes stay bytes.
OPEN_FLAGS: Final[int] = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
#: With it a pipe that nobody writes is not waited for.
NO_WAIT: Final[int] = getattr(os, "O_NONBLOCK", 0)
#: What the kernel says of a process that has ended.
_ENDED = frozenset("ZXx")
#: The system as a plain text: checkers of types decide by ``sys.platform`` what can be reached.
_SYSTEM = str(sys.platform)
#: From the Windows API: the right to wait for a process, and what waiting says of one that runs.
_SYNCHRONIZE, _WAIT_TIMEOUT = 0x100000, 0x102
#: Where Windows locks a file [bytes]: far behind its end, for what is locked cannot be read by others.
_FAR = 1 << 40


def hardware_refused(names: list[str]) -> str:
    """Return the sentence that refuses hardware, or an empty one where it may be driven."""
    if SERVO_PROCESS or not names:
        return ""
    listed = ", ".join(f"'{name}'" for name in names)
    return (f"hardware needs Linux: nothing watches over {listed} on {_system()}, "
            "so run the scene on twins here (--twin all)")  # fmt: skip


def _system() -> str:
    return {"darwin": "macOS", "win32": "Windows"}.get(_SYSTEM, _SYSTEM)


def keep_standard_numbers() -> None:
    """Open onto nothing what is closed of the files 0, 1 and 2, for this process and those that it starts.

    Else the next files that are opened would get these numbers: a device what a program prints, or a library complains.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest number that is free: this one


def signals(*names: str) -> list[signal.Signals]:
    """Return the signals that this system has, of those named."""
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


def cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def limit(name: str) -> int:
    """Return a limit of this process as it is in force, such as ``RLIMIT_RTPRIO``; -1 without one, 0 if unknown."""
    if resource is None or not hasattr(resource, name):
        return 0
    found = resource.getrlimit(getattr(resource, name))[0]
    return -1 if found == resource.RLIM_INFINITY else found


def priority() -> tuple[Any, ...]:
    """Return this process's priority and the cores that it may use, as far as the system tells."""
    nice = os.getpriority(os.PRIO_PROCESS, 0) if hasattr(os, "getpriority") else 0
    return nice, os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()


def waits() -> int:
    """Return how often this thread has given its processor away, to wait for something; 0 if that is not told."""
    if resource is None or not hasattr(resource, "RUSAGE_THREAD"):
        return 0
    return resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw


def leave_no_core() -> None:
    """Let this process die without writing its memory to the disk."""
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))


def lives(process: int) -> bool:
    """Tell whether a process exists and has not ended; one that nobody has buried yet has ended."""
    if process == os.getpid():
        return True
    try:
        with open(f"/proc/{process}/stat", encoding="utf-8", errors="replace") as stream:
            return stream.read(512).rpartition(")")[2].split()[0] not in _ENDED
    except (OSError, IndexError):
        return False if os.path.exists("/proc/self/stat") else _lives_elsewhere(process)


def _lives_elsewhere(process: int) -> bool:
    if _SYSTEM == "win32":  # where signal 0 would end it
        import ctypes

        windows: Any = getattr(ctypes, "windll", None)
        handle = windows.kernel32.OpenProcess(_SYNCHRONIZE, 0, process) if windows else 0
        if not handle:
            return False
        try:
            return bool(windows.kernel32.WaitForSingleObject(handle, 0) == _WAIT_TIMEOUT)
        finally:
            windows.kernel32.CloseHandle(handle)
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def claim(handle: int) -> None:
    """Claim an open file for this process alone, until it is closed; where that is not known nothing happens.

    Raises
    ------
    BlockingIOError
        If another process has it.
    """
    if FILE_LOCKS:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:  # a file system without locks
            pass
        return
    try:
        import msvcrt
    except ImportError:
        return
    lock: Any = msvcrt
    try:
        os.lseek(handle, _FAR, os.SEEK_SET)
        lock.locking(handle, lock.LK_NBLCK, 1)
    except OSError as error:
        raise BlockingIOError(error.errno, "another process has it") from error
    finally:
        os.lseek(handle, 0, os.SEEK_SET)


class Memory:
    """Memory that a child process maps, too: without a name where the system has that, else a temporary file.

    Attributes
    ----------
    word
        What the child is told, for ``Memory.opened``.
    passed
        File descriptors that the child must inherit.
    """

    def __init__(self, handle: int, path: str) -> None:
        self.handle, self._path = handle, path
        self.word = path or str(handle)
        self.passed = () if path else (handle,)

    @classmethod
    def create(cls, label: str, size: int) -> Memory:
        """Make memory of so many bytes, all zero."""
        if hasattr(os, "memfd_create"):
            memory = cls(os.memfd_create(label, 0), "")
        else:
            memory = cls(*tempfile.mkstemp(prefix=f"{label}-", suffix=".memory"))
        os.ftruncate(memory.handle, size)
        return memory

    @classmethod
    def opened(cls, word: str) -> Memory:
        """Open what a parent has made, by what it told."""
        if word.isdigit():
            return cls(int(word), "")
        memory = cls(os.open(word, os.O_RDWR | OPEN_FLAGS), word)
        memory._unlink()
        return memory

    def map(self, size: int) -> mmap.mmap:
        """Map it."""
        return mmap.mmap(self.handle, size)

    def forget(self) -> None:
        """Close the descriptor; what is mapped stays."""
        if self.handle >= 0:
            os.close(self.handle)
            self.handle = -1

    def _unlink(self) -> None:
        """Let go of the name; on Windows that must wait until nobody has it open."""
        if self._path:
            with contextlib.suppress(OSError):
                os.unlink(self._path)

    def close(self) -> None:
        """Leave nothing behind, once it is not mapped any more."""
        self.forget()
        self._unlink()


class Ended:
    """Sees the end of a pipe, such as a child's standard input when its parent dies; works on every system."""

    def __init__(self, handle: int) -> None:
        self._over = threading.Event()
        threading.Thread(target=self._read, args=(handle,), name="itouch-pipe", daemon=True).start()

    def _read(self, handle: int) -> None:
        with contextlib.suppress(OSError):
            while os.read(handle, 64):
                pass
        self._over.set()

    def wait(self, seconds: float) -> bool:
        """Wait a little; tell whether it has ended."""
        return self._over.wait(seconds)


@contextlib.contextmanager
def answering(handlers: dict[signal.Signals, Any]) -> Iterator[None]:
    """Answer signals while the context lasts, where this is the main thread; elsewhere nothing happens."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
