"""What differs between operating systems, in one place: what this system has, and what replaces what it lacks.

Simulated sessions run wherever Python does.  Hardware, the guardian and real-time priority need Linux, as they rely on
its process handles, its anonymous files and its scheduler; elsewhere they are refused.
"""

from __future__ import annotations

import contextlib
import itertools
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
#: Whether a process can fork.
FORKS: Final[bool] = hasattr(os, "fork")
#: Whether files have Unix locks, which end with the process.
FILE_LOCKS: Final[bool] = bool(fcntl)
#: Flags for every ``os.open``: child processes do not inherit the file, and no line ends are converted.
OPEN_FLAGS: Final[int] = getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
#: Flag of ``os.open`` with which opening and reading a pipe does not wait for a writer.
NO_WAIT: Final[int] = getattr(os, "O_NONBLOCK", 0)
#: States in /proc of a process that has ended.
_ENDED = frozenset("ZXx")
#: The system as a plain string: of ``sys.platform`` itself, type checkers conclude which code cannot be reached.
_SYSTEM = str(sys.platform)
#: From the Windows API: the right to wait for a process, and the result of waiting for one that still runs.
_SYNCHRONIZE, _WAIT_TIMEOUT = 0x100000, 0x102
#: Offset at which Windows locks a file [bytes]: far beyond its end, since others cannot read a locked region.
_FAR = 1 << 40


def hardware_refused(names: list[str]) -> str:
    """Return the message that refuses these devices, or an empty string if this system may drive hardware."""
    if SERVO_PROCESS or not names:
        return ""
    listed = ", ".join(f"'{name}'" for name in names)
    return (f"hardware needs Linux: nothing watches over {listed} on {_system()}, "
            "so run the scene on twins here (--twin all)")  # fmt: skip


def _system() -> str:
    return {"darwin": "macOS", "win32": "Windows"}.get(_SYSTEM, _SYSTEM)


def reading_advice(error: Exception, otherwise: str) -> str:
    """Return what to do about a file that cannot be read, by the cause; ``otherwise`` if it is not there."""
    if isinstance(error, PermissionError):
        return "it is there, but may not be read: change its permissions, or take a copy that is yours"
    if isinstance(error, FileNotFoundError | NotADirectoryError | ValueError):
        return _meant(error) or otherwise
    if "not a file" in str(error):
        return "name an ordinary file"
    return "the system cannot read it: look at its disk, or where its link leads"


def why_unread(error: OSError) -> str:
    """Return why a file can't be read, with the file that was probably meant, if there is one like it."""
    close = _meant(error)
    return f"{error.strerror or error}{'; ' if close else ''}{close}"


def _meant(error: Exception) -> str:
    """Ask for the file whose name is most like that of one that is not there, of those in its folder."""
    if not isinstance(error, FileNotFoundError) or not isinstance(error.filename, str):
        return ""
    from difflib import get_close_matches  # only for who has mistyped a name

    folder, name = os.path.split(error.filename)
    stem, ending = os.path.splitext(name)
    try:
        with os.scandir(folder or os.curdir) as entries:
            # a folder may hold anything: enough to find a name among some thousand
            names = sorted(entry.name for entry in itertools.islice(entries, 2000) if not entry.name.startswith("."))
    except OSError:
        return ""
    names.sort(key=lambda one: os.path.splitext(one)[1] == ending)  # of one stem, the last one counts
    stems = {os.path.splitext(one)[0]: one for one in names}  # endings are alike anyway
    close = get_close_matches(stem, stems, n=1, cutoff=0.7)
    return f"did you mean '{stems[close[0]]}', in the same folder?" if close else ""


def keep_standard_numbers() -> None:
    """Open the null device on those of the file descriptors 0, 1 and 2 that are closed; child processes inherit it.

    Otherwise the next files that are opened would get these numbers, and a device could receive what a program prints
    or what a library complains.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # gets the lowest free number: this one


def signals(*names: str) -> list[signal.Signals]:
    """Return those of the named signals that this system has."""
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


def cores() -> int:
    """Return how many processor cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def limit(name: str) -> int:
    """Return the soft limit of a resource such as ``RLIMIT_RTPRIO`` for this process; -1: unlimited, 0: unknown."""
    if resource is None or not hasattr(resource, name):
        return 0
    found = resource.getrlimit(getattr(resource, name))[0]
    return -1 if found == resource.RLIM_INFINITY else found


def priority() -> tuple[Any, ...]:
    """Return this process's priority and the cores that it may use, as far as the system tells."""
    nice = os.getpriority(os.PRIO_PROCESS, 0) if hasattr(os, "getpriority") else 0
    return nice, os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()


def waits() -> int:
    """Return how often this thread has given up its processor to wait (voluntary context switches); 0 if unknown."""
    if resource is None or not hasattr(resource, "RUSAGE_THREAD"):
        return 0
    return resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw


def leave_no_core() -> None:
    """Let this process die without a core dump."""
    if resource is not None:
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))


def lives(process: int) -> bool:
    """Tell whether a process exists and has not ended; a zombie has ended."""
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
    """Lock an open file for this process alone until it is closed; where files cannot be locked, do nothing.

    Raises
    ------
    BlockingIOError
        If another process has locked it.
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
    """Memory shared with a child process: an anonymous file where the system has these, otherwise a temporary file.

    Attributes
    ----------
    word
        What the child is told, and passes to ``Memory.opened``.
    passed
        File descriptors that the child must inherit.
    """

    def __init__(self, handle: int, path: str) -> None:
        self.handle, self._path = handle, path
        self.word = path or str(handle)
        self.passed = () if path else (handle,)

    @classmethod
    def create(cls, label: str, size: int) -> Memory:
        """Make ``size`` bytes of memory, all zero."""
        if hasattr(os, "memfd_create"):
            memory = cls(os.memfd_create(label, 0), "")
        else:
            memory = cls(*tempfile.mkstemp(prefix=f"{label}-", suffix=".memory"))
        os.ftruncate(memory.handle, size)
        return memory

    @classmethod
    def opened(cls, word: str) -> Memory:
        """Open the memory that the parent process has made, given its ``word``."""
        if word.isdigit():
            return cls(int(word), "")
        memory = cls(os.open(word, os.O_RDWR | OPEN_FLAGS), word)
        memory._unlink()
        return memory

    def map(self, size: int) -> mmap.mmap:
        """Map the first ``size`` bytes."""
        return mmap.mmap(self.handle, size)

    def forget(self) -> None:
        """Close the file descriptor; existing mappings stay valid."""
        if self.handle >= 0:
            os.close(self.handle)
            self.handle = -1

    def _unlink(self) -> None:
        """Remove the temporary file, if there is one; on Windows this works only once no process has it open."""
        if self._path:
            with contextlib.suppress(OSError):
                os.unlink(self._path)

    def close(self) -> None:
        """Close the memory and leave no file behind; call it when nothing maps it any more."""
        self.forget()
        self._unlink()


class Ended:
    """Detects the end of a pipe, such as a child's standard input when its parent dies; works on every system."""

    def __init__(self, handle: int) -> None:
        self._over = threading.Event()
        threading.Thread(target=self._read, args=(handle,), name="itouch-pipe", daemon=True).start()

    def _read(self, handle: int) -> None:
        with contextlib.suppress(OSError):
            while os.read(handle, 64):
                pass
        self._over.set()

    def wait(self, seconds: float) -> bool:
        """Wait up to ``seconds`` [s] for the end; tell whether the pipe has ended."""
        return self._over.wait(seconds)


@contextlib.contextmanager
def answering(handlers: dict[signal.Signals, Any]) -> Iterator[None]:
    """Handle signals with ``handlers`` inside the context if this is the main thread; in another thread do nothing."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
