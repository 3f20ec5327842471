"""Checks of how a plugin treats the process in which it is a guest, for devices and modalities alike."""

from __future__ import annotations

import copy
import gc
import json
import logging
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from itouch.plugin import DeviceError, Record
from itouch.testing.checks import CheckError, NotApplicableError, check
from itouch.testing.child_process import apart, described
from itouch.testing.harness import DeviceHarness
from itouch.testing.process_state import ProcessState, children, open_files
from itouch.testing.scenario import ModalityHarness
from itouch.testing.workload import Call, Workload, workloads

Harness = DeviceHarness | ModalityHarness
#: How long a plugin may take for a short run in a process of its own [s].
_SHORT = 15.0


def _fail(seen: str, cause: str, advice: str) -> CheckError:
    return CheckError(seen, cause=cause, advice=advice)


@check("survives", "every call comes back")
def survives(harness: Harness) -> None:
    """Let the plugin work in a child process, and see how that ends."""
    shared = isinstance(harness, DeviceHarness) and harness.shared is not None
    for make in workloads(harness)[: 1 if shared else None]:
        limit = _SHORT if isinstance(harness, DeviceHarness) else 2 * _SHORT
        ending = apart(lambda make=make: _short(make), limit)  # type: ignore[misc]
        told = ending.text
        if ending.kind == "hung":
            raise _fail(
                f"a call of the plugin {told.removeprefix('it ')}",
                "a wait without a time limit, or a loop without an end",
                "give every wait a timeout; a call that must wait needs blocking = True and still an end",
            )
        if ending.kind in ("exited", "killed"):
            raise _fail(
                f"a call of the plugin does not return: {told}",
                "os._exit, a crash in compiled code, or memory that is written where it must not be",
                "raise DeviceError; look into the compiled library that it calls",
            )
        if ending.value:
            raise _fail(
                f"a plain call of {ending.value.decode('utf-8', 'replace')}",
                "a mistake in the plugin's code",
                "mend it first; all else is examined then",
            )
        if ending.kind == "raised" and told.split(":")[0].split(" ")[0] in _ENDS:
            raise _fail(
                f"a call of the plugin raised {told}",
                "sys.exit, or an exception that is not an Exception",
                "a plugin never ends the program: raise DeviceError, and safety does the rest",
            )


_ENDS = ("SystemExit", "KeyboardInterrupt", "GeneratorExit", "CancelledError", "BaseException", "PlainlyBase")


def _short(make: Callable[[], Workload]) -> bytes:
    told = b""
    try:
        with make() as workload:
            try:
                for _ in range(min(workload.ticks, 300)):
                    workload.tick()
            except (CheckError, DeviceError):
                raise
            except Exception as error:
                told = f"{workload.what} raised {described(error)}".encode()
    except Exception:  # other checks examine what open and close raise
        return told
    except BaseException as error:
        if type(error).__name__ not in _ENDS:  # a kind of its own
            raise type("PlainlyBase", (BaseException,), {})(f"{type(error).__name__}: {error}") from error
        raise
    return told


@check("quiet", "it writes nothing to the terminal")
def quiet(harness: Harness) -> None:
    """Capture what is written to standard output and standard error."""
    for make in workloads(harness):
        logged = _Logged()
        with _caught() as said, logged, make() as workload:
            for _ in range(min(workload.ticks, 300)):
                workload.tick()
        text = said()
        if logged.count > 0.1 * min(workload.ticks, 300):
            raise _fail(
                f"{workload.what} logs a warning again and again: {logged.last[:60]!r}",
                "a message for every tick",
                "tell a person once, by a DeviceError or a modality's notices(); log at level DEBUG, if at all",
            )
        if text.strip():
            raise _fail(
                f"{workload.what} writes {text.strip().splitlines()[0][:60]!r} to the terminal",
                "a print that was left in; it costs more than a tick may last, and spoils the live screen",
                "remove it; what a person must know is a DeviceError or a modality's notices()",
            )


class _Logged(logging.Handler):
    """Counts warnings that are logged."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.count, self.last = 0, ""

    def emit(self, record: logging.LogRecord) -> None:
        """Count a warning."""
        self.count, self.last = self.count + 1, record.getMessage()

    def __enter__(self) -> None:
        logging.root.addHandler(self)

    def __exit__(self, *_: object) -> None:
        logging.root.removeHandler(self)


@contextmanager
def _caught() -> Iterator[Callable[[], str]]:
    """Capture standard output and standard error, both Python's streams and the process's file descriptors."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(number) for number in (1, 2)]
    streams = sys.stdout, sys.stderr
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as file:
        for number in (1, 2):
            os.dup2(file.fileno(), number)
        sys.stdout = sys.stderr = file

        texts: list[str] = []
        try:
            yield lambda: "".join(texts)
        finally:
            sys.stdout, sys.stderr = streams
            file.flush()
            for number, copy_ in zip((1, 2), kept, strict=True):
                os.dup2(copy_, number)
                os.close(copy_)
            file.seek(0)
            texts.append(file.read())


@check("surroundings", "it leaves the process as it was")
def surroundings(harness: Harness) -> None:
    """Compare the process before, while and after the plugin works."""
    for make in workloads(harness):
        before = ProcessState()
        with make() as warm:  # what a library opens once and for all is opened now
            warm.tick()
        files, threads, born = open_files(), set(threading.enumerate()), children()
        with make() as workload:
            for _ in range(min(workload.ticks, 200)):
                workload.tick()
            changes = before.changes()
            if workload.what != "the driver":  # a driver holds what it needs while it is open
                changes += _kept(files, threads, born)
        changes += [change for change in before.changes() if change not in changes]
        if changes:
            raise _fail(
                f"{workload.what} changes {changes[0]}",
                "a call that affects the whole process, and so everything in it",
                "leave it as it is, or change it within a call and put it back: with np.errstate(...), for instance",
            )


def _kept(files: dict[str, str], threads: set[threading.Thread], born: set[int]) -> list[str]:
    found = [f"the threads ({thread.name} was started)" for thread in threading.enumerate() if thread not in threads]
    found += [f"the open files ({what})" for number, what in open_files().items() if number not in files]
    return found + [f"the processes ({number} was started)" for number in children() - born]


class _ProbeError(Exception):
    """An error in the middle of a call."""


class _AccessProbe(Record):
    """A record that raises an error at its ``at``-th look-up, if one is given, and counts look-ups."""

    def __init__(self, record: Record, error: BaseException | None, at: int) -> None:
        super().__init__(record.dtype, record.raw)
        self.looks, self._error, self._at = 0, error, at

    def __getitem__(self, name: str) -> Any:
        self.looks += 1
        if self._error is not None and self.looks >= self._at:
            raise self._error
        return super().__getitem__(name)


@check("errors-come-through", "errors and Ctrl-C come out of its calls")
def errors_come_through(harness: Harness) -> str:
    """Let records raise an error or KeyboardInterrupt at each look-up in turn."""
    tried = 0
    for make in workloads(harness):
        with make() as workload:
            for _ in range(5):
                workload.tick()
            for call in workload.calls():
                tried += _come_through(workload, call)
    if not tried:
        raise NotApplicableError("no call looks anything up in its record")
    return f"{tried} errors"


def _come_through(workload: Workload, call: Call) -> int:
    name, record, function = call
    clean = _AccessProbe(record, None, 0)
    deadline = time.perf_counter() + 0.5
    while not clean.looks and time.perf_counter() < deadline:  # a driver has a new reading only now and then
        function(clean)
    for at in range(1, min(clean.looks, 8) + 1):
        for error in (_ProbeError("an error that the suite made"), KeyboardInterrupt()):
            _provoke(workload.what, name, record, function, error, at)
    return 2 * min(clean.looks, 8)


def _provoke(what: str, name: str, record: Record, function: Callable[[Record], Any], error: Any, at: int) -> None:
    plain = isinstance(error, _ProbeError)
    deadline = time.perf_counter() + 0.5
    while time.perf_counter() < deadline:
        probe = _AccessProbe(record, error, at)
        try:
            function(probe)
        except BaseException as seen:
            if plain or not isinstance(seen, Exception):
                return
        else:
            if probe.looks < at:  # this time it made fewer look-ups
                continue
        raise _fail(
            f"{what}'s {name} swallows {'an error' if plain else 'KeyboardInterrupt (Ctrl-C)'} from within it",
            f"`except{' Exception' if plain else ''}: pass`, or contextlib.suppress, around too much",
            "catch the one error that you expect, where you expect it; safety must hear of all others",
        )


@check("opens-nothing", "no file, port, process or sleep in a tick")
def opens_nothing(harness: Harness) -> None:
    """Watch the system calls of a twin or a modality, in a child process."""
    make = workloads(harness)[0]
    ending = apart(lambda: _watched(make), 2 * _SHORT)
    if ending.kind != "returned":
        raise NotApplicableError(f"it can't be watched: {ending.text}")
    told = json.loads(ending.value)
    if told:
        raise _fail(
            f"{told['what']} calls {told['event']}{told['words']} within a tick, at {told['where']}",
            "a log, a settings file, or a message to another program",
            "it is arithmetic on its State only: read files in compile(), or when the device is opened",
        )


_ASKS = (
    "open",
    "time.sleep",
    "subprocess.Popen",
    "os.",
    "socket.",
    "ctypes.dlopen",
    "tempfile.",
    "shutil.",
    "sqlite3.",
    "urllib.",
)
_CACHES = (".py", ".pyc", ".nbi", ".nbc")


def _watched(make: Callable[[], Workload]) -> bytes:
    told: dict[str, str] = {}
    with make() as workload:
        for _ in range(300):  # what is read or compiled once does not count
            workload.tick()
        watching = True

        def watch(event: str, words: tuple[Any, ...]) -> None:
            if not watching or told or not event.startswith(_ASKS) or (words and str(words[0]).endswith(_CACHES)):
                return
            frame = sys._getframe(1)  # noqa: SLF001
            while frame.f_code.co_filename == __file__ and frame.f_back is not None:
                frame = frame.f_back
            where = f"{frame.f_code.co_filename}:{frame.f_lineno}"
            told.update(what=workload.what, event=event, words=f"({', '.join(map(repr, words[:1]))})", where=where)

        sys.addaudithook(watch)
        time.sleep = _watched_sleep(watch)  # type: ignore[assignment]
        for _ in range(max(300, workload.ticks - 300)):
            workload.tick()
        watching = False
    return json.dumps(told).encode()


def _watched_sleep(watch: Callable[[str, tuple[Any, ...]], None]) -> Callable[[float], None]:
    """Return a ``time.sleep`` that reports itself, as not every version of Python audits it."""

    def sleep(seconds: float, real: Callable[[float], None] = time.sleep) -> None:
        watch("time.sleep", (seconds,))
        real(seconds)

    return sleep


@check("params-untouched", "parameters stay as they were given")
def params_untouched(harness: Harness) -> None:
    """Compare the parameters before and after the plugin works."""
    for make in workloads(harness):
        with make() as workload:
            before = copy.deepcopy(workload.params)
            for _ in range(min(workload.ticks, 300)):
                workload.tick()
            if workload.params != before or repr(workload.params) != repr(before):
                raise _fail(
                    f"{workload.what} changes its parameters from {before!r} to {workload.params!r}",
                    "object.__setattr__, or a list or array within the parameters that is written to",
                    "parameters are what the scene says, and shared; what changes is State",
                )


@check("steady", "a tick takes no longer after a while")
def steady(harness: Harness) -> str:
    """Compare the processor time of early and late calls, and count the objects that only the collector can free."""
    make = workloads(harness)[0]
    with make() as workload:
        for _ in range(300):
            workload.tick()
        early = _cost(workload)
        calls = workload.calls()
        for _ in range(4000):
            for _, record, function in calls:
                function(record)
        late = _cost(workload)
        if late > 1.6 * early + 15e-6:
            raise _fail(
                f"the calls of a tick take {1e6 * early:.0f} us at first, and {1e6 * late:.0f} us 4000 ticks later",
                "it works through a list that grows",
                "keep what must be kept in State, which has a fixed size",
            )
        circles = _circles(calls)
    if circles > 0.9:
        raise _fail(
            f"{circles:.0f} objects a tick are left that refer to each other in a circle",
            "a closure that names itself, or an exception that is kept",
            "break the circle: in real time the garbage collector is off, and they would stay",
        )
    return f"{1e6 * early:.0f} us, then {1e6 * late:.0f} us"


def _cost(workload: Workload) -> float:
    """Return the processor time of a tick's calls [s]: the least of several means, as other programs run too."""
    means = []
    calls = workload.calls()
    for _ in range(10):
        begin = time.thread_time()
        for _ in range(20):
            for _, record, function in calls:
                function(record)
        means.append((time.thread_time() - begin) / 20)
    return min(means)


def _circles(calls: Any) -> float:
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        for _ in range(200):
            for _, record, function in calls:
                function(record)
        return gc.collect() / 200
    finally:
        if enabled:
            gc.enable()
