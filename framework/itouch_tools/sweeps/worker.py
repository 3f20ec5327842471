"""A task of the engine: some runs, handed to a runner process; a run that ends the runner still gets a row."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, BinaryIO, cast

from itouch import platforms
from itouch.servo.prepare import sweep
from itouch_tools.sweeps.provenance import cpu_model
from itouch_tools.sweeps.run_plan import Run
from itouch_tools.sweeps.work import Work

#: How often a run is tried if the machine was at fault, and if the run ended its process.
TRIES_MACHINE, TRIES_CRASH = 3, 2
#: Seconds that a runner may take to begin: it may have to compile.
BEGINS = 1800.0
#: How the names of the folders of runners begin; the process number of the worker follows.
FOLDER = "itouch-runner-"
#: Signals by which a machine ends a process: for lack of memory, or because somebody wants it to end.
_FROM_OUTSIDE = tuple(platforms.signals("SIGKILL", "SIGTERM", "SIGHUP"))


@dataclass(slots=True)
class Done:
    """The result of a task: rows, seconds of each, the number of failed tries; or why the worker is refused."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    retries: int = 0
    refused: str = ""
    key: int = 0


class DeadError(Exception):
    """A runner process has ended, or took too long."""

    def __init__(self, status: str, reason: str, *, outside: bool) -> None:
        super().__init__(reason)
        self.status, self.outside = status, outside


class Runner:
    """A runner process."""

    def __init__(self, work: Work) -> None:
        self.digest, self._patience = work.digest, float(work.rule["patience"])
        sweep(FOLDER)
        try:
            self._folder = tempfile.mkdtemp(prefix=f"{FOLDER}{os.getpid()}-")
        except OSError as error:
            raise DeadError("machine", f"{type(error).__name__}: {error}", outside=True) from None
        command = [sys.executable, "-m", "itouch_tools.sweeps.runner", self._folder]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        except BaseException:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise
        try:
            self._send(("work", work))
            kind, what, _ = self._receive(BEGINS)
            self.refused = str(what) if kind == "refused" else ""
            if kind == "machine":
                raise DeadError("machine", str(what), outside=True)
        except BaseException:
            self.close()  # nobody else has it
            raise

    def run(self, run: Run) -> tuple[str, Any, float]:
        """Return ("row", row, seconds), or ("machine", why, seconds).

        Raises
        ------
        DeadError
            If the run ends the process, or takes too long.
        """
        self._send(("runs", [run]))
        return self._receive(self._patience)

    def report(self, run: Run) -> tuple[str, Any, float]:
        """Return ("report", the session's report, seconds), or ("machine", why, seconds).

        Raises
        ------
        DeadError
            If the run ends the process, or takes too long.
        """
        self._send(("report", [run]))
        return self._receive(self._patience)

    def close(self) -> None:
        """End the process, and remove its folder: what is killed leaves it."""
        with contextlib.suppress(OSError):
            self._process.kill()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            if stream is not None:
                with contextlib.suppress(OSError):
                    stream.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _send(self, what: Any) -> None:
        stream = cast("BinaryIO", self._process.stdin)
        try:
            pickle.dump(what, stream)
            stream.flush()
        except OSError:
            raise self._dead() from None

    def _receive(self, patience: float) -> tuple[str, Any, float]:
        stream = cast("BinaryIO", self._process.stdout)
        late = threading.Event()
        watch = threading.Timer(patience, self._end, (late,))
        watch.start()
        try:
            answer: tuple[str, Any, float] = pickle.load(stream)
        except (EOFError, OSError, pickle.UnpicklingError):
            if late.is_set():
                raise DeadError("hung", f"took longer than {patience:g} s", outside=True) from None
            raise self._dead() from None
        finally:
            watch.cancel()
        return answer

    def _end(self, late: threading.Event) -> None:
        late.set()
        self._process.kill()

    def _dead(self) -> DeadError:
        code = self._process.wait()
        if code >= 0:
            return DeadError("crashed", f"ended its process with exit code {code}", outside=False)
        name = signal.Signals(-code).name
        outside = -code in _FROM_OUTSIDE
        why = f"its process was ended by {name}" + (" (out of memory?)" if name == "SIGKILL" else "")
        return DeadError("machine" if outside else "crashed", why, outside=outside)


#: Idle runners; as many as threads worked here at the same time.
_idle: list[Runner] = []
_lock = threading.Lock()


def work_on(work: Work, runs: Sequence[Run], key: int = 0) -> Done:
    """Do a task: run some runs, and return their rows in order, with its key.  Called in a worker of the engine."""
    with contextlib.suppress(ValueError):  # only the main thread may set a signal handler
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    done = Done(key=key)
    for run in runs:
        row = _tried(work, run, done)
        if row is None:
            return done
        done.rows.append(row)
    return done


def _tried(work: Work, run: Run, done: Done) -> dict[str, Any] | None:
    """Return the row of a run, which is tried again after a failure; None: this worker is refused."""
    crashes = machine = 0
    while True:
        runner = None
        try:
            runner = _taken(work)
            if runner.refused:
                done.refused = f"worker {socket.gethostname()}:{os.getpid()}: {runner.refused}"
                runner.close()
                return None
            kind, what, seconds = runner.run(run)
            if kind == "row":
                _give_back(runner)
                done.seconds.append(seconds)
                return dict(what)
            runner.close()  # which frees what it holds, such as memory
            status, reason, outside = "machine", str(what), True
        except DeadError as dead:
            status, reason, outside = dead.status, str(dead), dead.outside
            if runner is not None:
                runner.close()
        crashes, machine = crashes + (not outside), machine + outside
        done.retries += 1
        if crashes >= TRIES_CRASH or machine >= TRIES_MACHINE:
            done.seconds.append(0.0)
            return failed(run, status, reason)


def failed(run: Run, status: str, reason: str) -> dict[str, Any]:
    """Return the row of a run that did not come to its end."""
    row: dict[str, Any] = {**run.values, "seed": run.seed, "digest": run.digest, "cpu": cpu_model()}
    return row | {"sets": json.dumps(run.sets), "status": status, "reason": reason, "simulated_s": None, "state": ""}


def _taken(work: Work) -> Runner:
    with _lock:
        while _idle:
            runner = _idle.pop()
            if runner.digest == work.digest:
                return runner
            runner.close()
    return Runner(work)


def _give_back(runner: Runner) -> None:
    with _lock:
        _idle.append(runner)


def close_runners() -> None:
    """End the runners that this process has started."""
    with _lock:
        while _idle:
            _idle.pop().close()
