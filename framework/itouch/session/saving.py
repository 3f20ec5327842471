"""Periodic snapshots (`--save-every`) while a session runs, without holding up its loop."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Any, Protocol

from itouch.loop.engine_view import Running
from itouch.plugin import Record
from itouch.session.errors import SessionError
from itouch.session.snapshot import write_snapshot

#: Called at each loss of data: with its kind (``saving``), and why.
Lost = Callable[[str, str], None]


class Pack(Protocol):
    """Makes the bytes of a snapshot."""

    def __call__(self, state: Record | None = None, ledger: dict[str, Any] | None = None) -> bytes:
        """Return those of the session now, or of a State and a ledger that were taken before."""


class Saving:
    """Saves a session every ``every`` seconds: a tap takes the State, a thread packs and writes it.

    On the virtual clock the loop waits for the thread, so that no snapshot is left out; in real time a snapshot is left
    out if the one before is not on the disk yet.
    """

    def __init__(self, session: Running, pack: Pack, lost: Lost, path: str, every: float) -> None:
        self._session, self._pack, self._lost, self._path = session, pack, lost, path
        self._ticks = max(1, round(every / session.model.period))
        self._work: queue.Queue[tuple[bytes, dict[str, Any]] | None] = queue.Queue(1)
        self._thread = threading.Thread(target=self._write, name="saving", daemon=True)
        self.failure = ""

    def __enter__(self) -> Saving:
        self._pack()  # packs now what never changes, not in a tick
        self._thread.start()
        self._session.taps.append(self._tap)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.taps.remove(self._tap)
        self._work.put(None)
        self._thread.join()
        self._tell()

    def _tap(self, tick: int) -> None:
        if self.failure:
            self._tell()
        if (tick + 1) % self._ticks:
            return
        ledger = self._session.statistics.dump()
        taken = self._session.state.tobytes(), {**ledger, "contacts": list(ledger["contacts"])}
        with suppress(queue.Full):  # the one before is not on the disk yet
            self._work.put(taken, block=self._session.clock.pace != "real")

    def _write(self) -> None:
        state = self._session.state.copy()
        while (work := self._work.get()) is not None:
            state.raw[:] = memoryview(work[0])
            try:
                write_snapshot(self._path, self._pack(state, work[1]))
            except SessionError as error:
                self.failure = str(error)

    def _tell(self) -> None:
        """Report a failure as a loss; the session goes on, and so does the saving."""
        if self.failure:
            self._lost("saving", self.failure)
            self.failure = ""
