"""An emulator in a thread of its own: a wire that has to wait delays neither the simulation nor another wire."""

from __future__ import annotations

import select
import threading

from itouch.exchange.thread import keep_up, told
from itouch.plugin import Emulator, Record

#: How long [s] closing waits for the thread to end.
_END = 1.0


class ServedEmulator:
    """Runs ``serve`` whenever the host has sent a request, or the emulator has something due.

    The simulation deposits the newest reading and takes the newest command; neither side waits for the other.  (A
    pseudo-terminal, for example, answers only after a kernel thread has run, which a busy machine delays.)

    Parameters
    ----------
    emulator
        An open emulator.
    reading, command
        The twin's present reading and command; copied.
    """

    def __init__(self, emulator: Emulator, reading: Record, command: Record) -> None:
        self._emulator = emulator
        self._reading, self._command = reading.copy(), command.copy()
        self._shown: tuple[float, bytes] = 0.0, reading.tobytes()
        self._asked: tuple[bool, bytes] = False, command.tobytes()
        self._error: Exception | None = None
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve, name=f"itouch-{type(emulator).__name__}", daemon=True)
        self._thread.start()

    def show(self, now: float, reading: Record) -> None:
        """Deposit the twin's reading at the simulated time ``now`` [s]."""
        self._shown = now, reading.tobytes()

    def take(self, command: Record) -> bool:
        """Copy the host's last command; tell whether the host drives the device.

        Raises
        ------
        Exception
            The exception that the emulator has raised, if any.
        """
        if self._error is not None:
            raise self._error
        driven, asked = self._asked
        command.raw.data[:] = asked
        return driven

    def close(self) -> None:
        """End the thread."""
        self._ending.set()
        self._thread.join(_END)

    def _serve(self) -> None:
        keep_up()
        emulator = self._emulator
        try:
            while not self._ending.is_set():
                now, shown = self._shown
                self._reading.raw.data[:] = shown
                driven = emulator.serve(now, self._reading, self._command)
                self._asked = driven, self._command.tobytes()
                select.select(emulator.handles(), [], [], max(0.0, emulator.patience()))
        except BaseException as error:
            self._error = told(error)
