"""How a run ends: signals that end it safely, their exit codes, and its report as a file."""

from __future__ import annotations

import atexit
import contextlib
import errno
import json
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, ParamSpec

from itouch import process_exit
from itouch.platforms import signals
from itouch.schema import ItouchError
from itouch.schema.terminal import PlainStream
from itouch_tools.cli.output_files import may_be_replaced, write_output

Words = ParamSpec("Words")


def stop_writing() -> None:
    """Discard the output that is still buffered: the interpreter would complain about it again at its end."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
            gone = isinstance(stream, PlainStream) and stream.closed_terminal
        except (OSError, ValueError):
            gone = True
        if gone:
            with contextlib.suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


#: How long [s] threads that a plugin left running may go on when everything is done.
_PATIENCE = 2.0


def end_threads(code: int) -> None:
    """End the process with this exit code if a thread that a plugin has left would keep it alive.

    Everything is safe and written by then; the interpreter would wait for every thread that is no daemon, for ever.
    """
    for what in process_exit.refused:
        with contextlib.suppress(OSError, ValueError):
            print(f"note: {what}", file=sys.stderr)
    process_exit.end_soon(code)
    due = time.monotonic() + _PATIENCE
    left = [thread for thread in threading.enumerate() if thread is not threading.current_thread()]
    pool = getattr(sys.modules.get("concurrent.futures.thread"), "_threads_queues", ())  # the interpreter ends these
    left = [thread for thread in left if not thread.daemon and thread not in pool]
    for thread in left:
        thread.join(max(0.0, due - time.monotonic()))
    names = [f"'{thread.name}'" for thread in left if thread.is_alive()]
    if not names:
        process_exit.end_in_order(code)
    verb = "threads still run" if len(names) > 1 else "thread still runs"
    with contextlib.suppress(OSError, ValueError):
        print(
            f"note: a plugin's {verb}: {', '.join(names)}; all work is done, so the program ends anyway",
            file=sys.stderr,
        )
    atexit._run_exitfuncs()  # noqa: SLF001 - what is to run when the interpreter ends
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    process_exit.end_now(code)


def code_of(number: int) -> int:
    """Return the exit code of a program that a signal has ended, as shells have it."""
    return 128 + number


class Interrupted(KeyboardInterrupt):
    """A signal came before anything ran."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number
        self.code = code_of(number)


class Stopping:
    """Lets Ctrl-C, SIGTERM and SIGHUP end a run safely while the context lasts.

    Until something runs (``bind``) a signal ends the preparation, by raising ``Interrupted``.  That may come at any
    instant: code that is being imported, or the interpreter itself, may make another error of it or drop it.  A SIGHUP
    that the program was told to ignore (``nohup``) stays ignored.
    """

    def __init__(self) -> None:
        self._stop: Callable[[], None] | None = None
        self._signal = 0
        self._raised = -math.inf
        self._before: dict[int, Any] = {}

    def bind(self, stop: Callable[[], None]) -> None:
        """Let signals from now on ask a run to end; ``stop`` is called from a signal handler.

        If a signal has come before, ``stop`` is called at once.
        """
        self._stop = stop
        if self._signal:
            stop()

    @property
    def unstarted(self) -> int:
        """The number of a signal that came before anything ran; 0: none did."""
        return self._signal if self._stop is None else 0

    def __enter__(self) -> Stopping:
        if threading.current_thread() is threading.main_thread():
            for number in signals("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
                if number in signals("SIGHUP") and signal.getsignal(number) == signal.SIG_IGN:
                    continue
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: object) -> None:
        self._signal = number
        if self._stop is not None:
            self._stop()
            return
        before, now = self._raised, time.monotonic()
        if now - before >= process_exit.AT_ONCE:  # else it would break off what the one before has begun: the report
            self._raised = now
            raise Interrupted(number)

    def listened(self, show: Callable[Words, None]) -> Callable[Words, None]:
        """Return ``show``, wrapped: when nobody reads the output any more, the run is asked to end, as by a signal."""

        def shown(*words: Words.args, **named: Words.kwargs) -> None:
            try:
                show(*words, **named)
            except BrokenPipeError:
                stop_writing()
                if self._stop is not None and not self._signal:
                    self._note(signal.SIGPIPE, None)
            except (OSError, ValueError) as error:
                if not sys.stdout.closed and getattr(error, "errno", None) != errno.EBADF:
                    raise
                # a plugin has closed the stream: that is reported at the end of the run, when it has been restored

        return shown

    def code(self, otherwise: int) -> int:
        """Return the exit code: that of the signal that ended the run, which is printed, or else ``otherwise``."""
        if not self._signal:
            return otherwise
        stop_writing()  # the terminal may have been closed
        print(f"stopped by {signal.Signals(self._signal).name}; the devices are safe", file=sys.stderr)
        return code_of(self._signal)


def unstarted(number: int, words: Mapping[str, Any], begun: float, path: str | None) -> int:
    """Print, and report, that a signal came before anything ran; return the exit code.

    Parameters
    ----------
    words
        What was asked for: entries of the report.
    begun
        When the start began, on the monotonic clock [s].
    path
        Path of the report, if one is asked for.
    """
    name = signal.Signals(number).name
    print(f"stopped by {name} during the start; nothing was enabled", file=sys.stderr)
    report = {**words, "simulated_s": 0.0, "wall_s": time.monotonic() - begun, "stopped_by": name}
    write_report(path, lambda: {**report, "contacts": [], "faults": []})
    return code_of(number)


def begin_report(path: str | None, words: Mapping[str, Any]) -> None:
    """Write a preliminary report: should anything kill the program, an earlier run's report can't be taken for its own.

    Parameters
    ----------
    path
        Path of the report, if one is asked for; anything but an ordinary file is written only at the end.
    words
        What was asked for: entries of the report.

    Raises
    ------
    ItouchError
        If the file can't be written.
    """
    if path and may_be_replaced(path):
        ended = "the program was ended before it had finished, and could not say by what"
        report = {**words, "simulated_s": 0.0, "ended_by": ended, "contacts": [], "faults": []}
        write_report(path, lambda: report)


def write_report(path: str | None, report: Callable[[], dict[str, Any]]) -> None:
    """Write a report as JSON, if a path is given.

    Raises
    ------
    ItouchError
        If the file can't be written.
    """
    if not path:
        return
    try:
        data = json.dumps(report(), indent=1, allow_nan=False).encode() + b"\n"  # before opening: no file is left half
    except ValueError as error:
        raise ItouchError(f"cannot write '{path}': the report holds a value that is not a number ({error})") from error
    write_output(path, data)
