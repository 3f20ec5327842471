"""Work in a child process: what ends or blocks a process ends or blocks that one."""

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
    """Do work in a child that has a copy of all there is here, and wait for it at most so many seconds.

    Where a process cannot go on as two it is done in a thread here: what it ends or changes ends or changes this one.
    """
    if not FORKS:
        return _beside(work, seconds)
    ours, theirs = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # other threads of ours do not go on in the child, and need not
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
    """Do work in a thread of this process."""
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
    """Do the work and tell how it went; never return."""
    faulthandler.disable()  # how it dies is told in a sentence
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
    """Return the kind of an error, its text, and the place where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f" at {frames[-1].filename}:{frames[-1].lineno}" if frames else ""
    text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return text + where


def _listen(pipe: int, deadline: float) -> bytes | None:
    """Return all that is told; None if it does not come in time."""
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
