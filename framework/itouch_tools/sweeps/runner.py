"""The runner process beside a worker (`python -m itouch_tools.sweeps.runner`): no run can end the worker.

It reads work and runs from standard input and answers on standard output, one pickle after the other; it ends when its
input ends.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import shutil
import signal
import sys
import time
from pathlib import Path
from typing import Any, BinaryIO

from itouch.gc_policy import keep_collections_rare

_PR_SET_PDEATHSIG = 1


def main() -> int:
    """Run what comes on standard input until it ends, in the folder that is given, which goes with the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # only the client may end a sweep, not Ctrl-C at the terminal
    _end_with_parent()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what plugins print must not get among the answers
    folder = Path(sys.argv[1])
    try:
        serve(sys.stdin.buffer, answers, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return 0


def serve(asked: BinaryIO, answers: BinaryIO, folder: Path) -> None:
    """Answer requests until ``asked`` ends: first one with the work, then lists of runs, each run with its row."""
    running: Any = None
    while True:
        try:
            what, given = pickle.load(asked)
        except EOFError:
            return
        if what == "work":
            running = _prepared(given, folder, answers)
            continue
        for run in given:
            _answer(answers, *_one(running, run, what == "report"))


def _prepared(work: Any, folder: Path, answers: BinaryIO) -> Any:
    from itouch_tools.sweeps.provenance import differences, identity
    from itouch_tools.sweeps.running import Running

    try:
        running = Running(work, folder)
        different = differences(work.identity, identity(work.packages))
        if different:
            _answer(answers, "refused", "; ".join(different), 0.0)
            return None
    except OSError as error:
        _answer(answers, "machine", f"{type(error).__name__}: {error}", 0.0)
        return None
    except Exception as error:  # whatever a function's file raises
        _answer(answers, "refused", f"{type(error).__name__}: {error}", 0.0)
        return None
    _answer(answers, "ready", None, 0.0)
    return running


def _one(running: Any, run: Any, report: bool) -> tuple[str, Any, float]:
    from itouch_tools.sweeps.running import MachineError

    begin = time.perf_counter()
    try:
        if report:
            return "report", running.report(run), time.perf_counter() - begin
        row = running.row(run)
    except MachineError as error:
        return "machine", str(error), time.perf_counter() - begin
    return "row", row, time.perf_counter() - begin


def _answer(answers: BinaryIO, kind: str, what: Any, seconds: float) -> None:
    pickle.dump((kind, what, seconds), answers)
    answers.flush()


def _end_with_parent() -> None:
    """Let the system end this process together with the thread that started it, where it can."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() == 1:
            os._exit(0)


if __name__ == "__main__":
    keep_collections_rare()
    sys.exit(main())
