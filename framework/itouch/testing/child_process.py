"""Work in a child process: whatever ends or blocks its process ends or blocks only the child."""

from __future__ import annotations

import faulthandler
import os
import select
import signal
import threading
import time
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from itouch.platforms import FORKS, leave_no_core


@dataclass(frozen=True, slots=True)
class Ending:
    """How work in a child process ended; ``value`` is what it returned, ``text`` what it raised and where."""

    kind: Literal["returned", "raised", "exited", "killed", "hung"]
    value: bytes = b""
    text: str = ""


def apart(work: Callable[[], bytes], seconds: float) -> Ending:
    """Do work in a child process forked from this one, and wait for it for at most ``seconds`` [s].

    Where a process cannot fork, the work is done in a thread here: what it ends or changes is then this process.
    """
    if not FORKS:
        return _beside(work, seconds)
    ours, theirs = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # our other threads do not run in the child, and need not
        child = os.fork()
    if child == 0:
        os.close(ours)
        _work(work, theirs)
    os.close(theirs)
    try:
        told = _listen(ours, time.perf_counter() + seconds)
    finally:
        os.close(ours)
        status = _end(child)
    return _ending(told, status, seconds)


def _beside(work: Callable[[], bytes], seconds: float) -> Ending:
    """Do work in a thread of this process, and wait for it for at most ``seconds`` [s]."""
    endings: list[Ending] = []

    def run() -> None:
        try:
            endings.append(Ending("returned", value=work()))
        except SystemExit as error:
            endings.append(Ending("exited", text=f"the process is ended with exit code {error.code}"))
        except BaseException as error:  # the kind is what is examined
            endings.append(Ending("raised", text=described(error)))

    thread = threading.Thread(target=run, name="itouch-beside", daemon=True)
    thread.start()
    thread.join(seconds)
    return endings[0] if endings else Ending("hung", text=f"it does not come back within {seconds:g} s")


def _work(work: Callable[[], bytes], pipe: int) -> None:
    """Do the work and write its result to the pipe; never return."""
    faulthandler.disable()  # a sentence tells how it dies
    leave_no_core()
    try:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL if number != signal.SIGINT else signal.default_int_handler)
        told = b"=" + work()
    except BaseException as error:  # the kind is what is examined
        told = b"!" + described(error).encode()
    try:
        while told:
            told = told[os.write(pipe, told) :]
    finally:
        os._exit(0)


def described(error: BaseException) -> str:
    """Return the class of an error, its message, and the place where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f" at {frames[-1].filename}:{frames[-1].lineno}" if frames else ""
    text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return text + where


def _listen(pipe: int, deadline: float) -> bytes | None:
    """Return everything that is written to the pipe; None if it is not closed in time."""
    told = b""
    while True:
        ready, _, _ = select.select([pipe], [], [], max(0.0, deadline - time.perf_counter()))
        if not ready:
            return None
        part = os.read(pipe, 1 << 16)
        if not part:
            return told
        told += part


def _end(child: int) -> int:
    done, status = os.waitpid(child, os.WNOHANG)
    if not done:
        time.sleep(0.02)
        done, status = os.waitpid(child, os.WNOHANG)
    if not done:
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    return status


def _ending(told: bytes | None, status: int, seconds: float) -> Ending:
    if told is None:
        return Ending("hung", text=f"it does not come back within {seconds:g} s")
    if told[:1] == b"=":
        return Ending("returned", value=told[1:])
    if told[:1] == b"!":
        return Ending("raised", text=told[1:].decode("utf-8", "replace"))
    if os.WIFSIGNALED(status):
        return Ending("killed", text=f"the process is killed by {signal.Signals(os.WTERMSIG(status)).name}")
    return Ending("exited", text=f"the process is ended with exit code {os.waitstatus_to_exitcode(status)}")
