"""Calls in processes that are forked from this one; whatever happens to one, the caller learns of it and never hangs.

A ``multiprocessing.Pool`` waits for ever for a worker that was killed or has exited, and for an error that can't be
unpickled.
"""

from __future__ import annotations

import multiprocessing
import pickle
import traceback
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from typing import Any

from itouch.session.session_error import SessionError

#: How long a process that has nothing left to do may take to end [s].
GRACE = 5.0
_DONE, _RAISED, _KEPT = range(3)  # kinds of a worker's answer: a result, an error, a result that can't be pickled
_LOST = "what `collect` returns for seed {seed} can't be handed from one process to another ({why}): return plain data"


def forked(call: Callable[[int], Any], seeds: Sequence[int], count: int) -> list[Any]:
    """Return what a call returns for each seed, in the order of the seeds, made by ``count`` forked processes.

    Raises
    ------
    TypeError
        If a result can't be pickled.
    SessionError
        If a process ends before its call does.
    BaseException
        What a call raises, with its traceback as a note; the other processes are ended.
    """
    crew, grace = _WorkerPool(call, count), 0.0
    try:
        found, grace = crew.work(seeds), GRACE
    finally:
        crew.end(grace)
    return found


class _WorkerPool:
    """Worker processes that make calls, and this process's end of the pipe to each."""

    def __init__(self, call: Callable[[int], Any], count: int) -> None:
        context = multiprocessing.get_context("fork")
        self._workers: dict[Connection, Any] = {}
        for _ in range(count):
            ours, theirs = context.Pipe()
            # A worker closes the ends of pipes that it inherits: the others' pipes must end when this process does.
            process = context.Process(target=_worker, args=(call, theirs, [*self._workers, ours]), daemon=True)
            process.start()
            theirs.close()
            self._workers[ours] = process

    def work(self, seeds: Sequence[int]) -> list[Any]:
        found: list[Any] = [None] * len(seeds)
        waiting = iter(range(len(seeds)))
        busy: dict[Connection, int] = {}
        for pipe, index in zip(self._workers, waiting, strict=False):
            self._give(pipe, seeds[index])
            busy[pipe] = index
        while busy:
            ready = wait(list(busy))
            for pipe in [pipe for pipe in busy if pipe in ready]:
                index = busy.pop(pipe)
                found[index] = self._take(pipe, seeds[index])
                following = next(waiting, None)
                if following is not None:
                    self._give(pipe, seeds[following])
                    busy[pipe] = following
        return found

    def _give(self, pipe: Connection, seed: int) -> None:
        try:
            pipe.send(seed)
        except OSError:
            raise self._ended(pipe, seed) from None

    def _take(self, pipe: Connection, seed: int) -> Any:
        try:
            kind, content, text = pipe.recv()
        except (EOFError, OSError):
            raise self._ended(pipe, seed) from None
        if kind == _KEPT:
            raise TypeError(_LOST.format(seed=seed, why=text))
        try:
            told = pickle.loads(content)
        except Exception as error:
            raise TypeError(_LOST.format(seed=seed, why=error)) from error
        if kind == _RAISED:
            told.add_note(f"in the process that ran seed {seed}:\n{text}")
            raise told
        return told

    def _ended(self, pipe: Connection, seed: int) -> SessionError:
        process = self._workers[pipe]
        process.join(1.0)
        code = process.exitcode
        how = f"was ended by signal {-code}" if code is not None and code < 0 else f"exited with code {code}"
        return SessionError(
            f"the process that ran seed {seed} {how} before its session had ended: if memory was short, "
            "run fewer at once with `workers`"
        )

    def end(self, grace: float) -> None:
        """Give each process this long [s] to end by itself, then kill it, whatever it does."""
        for pipe in self._workers:
            pipe.close()
        for process in self._workers.values():
            process.join(grace)
            process.kill()  # an inherited signal handler could survive a gentler signal
            process.join()


def _worker(call: Callable[[int], Any], pipe: Connection, others: Sequence[Connection]) -> None:
    """Make the calls that are requested over a pipe, until it ends."""
    for other in others:
        other.close()
    while True:
        try:
            seed = pipe.recv()
        except (EOFError, OSError, KeyboardInterrupt):
            return
        try:
            answer = _result(call(seed))
        except BaseException as error:  # also SystemExit: the caller gets it as if the call ran in its own process
            answer = (_RAISED, _error(error), "".join(traceback.format_exception(error)))
        try:
            pipe.send(answer)
        except OSError:
            return


def _result(result: Any) -> tuple[int, bytes, str]:
    try:
        return _DONE, pickle.dumps(result), ""
    except Exception as error:
        return _KEPT, b"", str(error)


def _error(error: BaseException) -> bytes:
    """Return an error as bytes that can be unpickled: the error itself, or else one that names it."""
    try:
        content = pickle.dumps(error)
        if type(pickle.loads(content)) is type(error):
            return content
    except Exception:
        pass
    return pickle.dumps(RuntimeError(f"{type(error).__name__}: {error}"))
