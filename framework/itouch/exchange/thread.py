"""A blocking device, or an emulator, in a thread of its own: each side takes the newest of the other."""

from __future__ import annotations

import contextlib
import math
import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from itouch.exchange.exchanged import Exchanged, still_inside
from itouch.plugin import RETRACT, Channel, Device, DeviceError, Emulator, Field, Record, Timestamps
from itouch.plugin.device import is_new
from itouch.plugin.timestamps import ticks_of
from itouch.schema.diagnostics import named

#: A command with the time [s] at which it was requested, or at which it left.
Sent = tuple[float, bytes] | None
#: A reading with the times [s] at which its channels were measured.
_Reading = tuple[tuple[float, ...], bytes]

#: How long [s] closing waits for an exchange that is under way, times the device's patience; after that the thread is
#: left to end by itself.
CLOSE_TIME = 0.5
#: How long [s] opening waits for the first reading.
FIRST_TIME = 1.0
#: Least time [s] between exchanges with a device that is declared as blocking but does not make its caller wait.
_LEAST = 1e-4
#: Weight of one exchange in the running estimate of the time that a command takes to leave.
_LEARNT = 0.2
#: Over how many of the latest exchanges the figures are computed.
_LATEST = 5000

#: How long [s] closing waits for the thread to end.
_END = 1.0
#: How long [s] opening waits for an earlier thread that is about to end.
_ENDING = 0.1


class ThreadedDevice(Exchanged):
    """Runs another device's ``open``, ``write``, ``read`` and ``close`` in one thread, one after the other.

    An exchange writes the newest command, if one has come since the last exchange, and reads; the next one follows
    after the device's period.  With a device that declares a ``command_wait``, an exchange begins as soon as there is a
    different command to send, or without one after that time.  A command that has not been renewed for ``patience`` [s]
    is replaced by the safe one: a loop that hangs must not leave its last force in effect.  A surface retracts then no
    further than to ``lowest``: a safe sequence may have found that retracting brings it nearer to the finger.
    """

    def __init__(
        self, device: Device, *, patience: float, servo_period: float = 1e-3, commands: tuple[Channel, ...] = ()
    ) -> None:
        super().__init__(device)
        self._period = servo_period
        self._reads, declared = type(device).channels(device.params)
        #: The commands with their safe values, which the plugin may have left open.
        self._commands = commands or declared
        self._patience = patience
        self._reading, self._command = _record(self._reads), _record(self._commands)
        self._newest: _Reading | None = None
        self._taken: _Reading | None = None
        self._wanted: Sent = None
        self._gone: Sent = None
        self._told: Sent = None
        self._stamps = Timestamps([channel.name for channel in self._reads])
        self._waits, self._woken = type(device).command_wait, threading.Event()
        self._error: Raised | None = None
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None
        #: The thread that was told to end last: until it has, it alone may call the device.
        self._left: threading.Thread | None = None
        #: Whether a thread closes the device now, or did so last.
        self._closes = False
        #: Number of exchanges, and duration of the longest [s].
        self.exchanges, self.longest = 0, 0.0
        self._latest: deque[tuple[float, float]] = deque(maxlen=_LATEST)

    def open(self) -> None:
        """Open the device and begin to exchange; return with the first reading, or after ``FIRST_TIME`` without one.

        Raises
        ------
        DeviceError
            If an earlier thread is still inside the device, which it closes when it gets out.
        """
        for thread in (self._thread, self._left):
            if thread is not None:
                thread.join(_ENDING)  # it may have closed the device already, and be about to end
                if thread.is_alive():
                    raise DeviceError(still_inside(self._method))
        self._newest = self._taken = self._wanted = self._gone = self._told = self._error = None
        self.device.trace, self.device.timestamps = self.trace, self._stamps
        self.lowest, self._closes = math.nan, False
        opened, read, self._ending = threading.Event(), threading.Event(), threading.Event()
        self.called = "open"
        self._thread = threading.Thread(target=self._live, args=(opened, read, self._ending), daemon=True)
        self._thread.name = f"itouch-{type(self.device).__name__}"
        self._thread.start()
        opened.wait()
        read.wait(FIRST_TIME)
        self._raise()

    def _raise(self) -> None:
        if self._error is not None:
            raise again(self._error)

    def read(self, reading: Record) -> bool | None:
        """Take the newest reading; return False if there is no new one since the last call."""
        newest = self._newest
        if newest is None or newest is self._taken:
            self._raise()
            return False
        self._taken = newest
        reading.raw.data[:] = newest[1]
        return True

    def measured(self, state: Record, tick: int, ticks: NDArray[np.int64]) -> None:
        """Fill in when the reading that was taken last was measured.

        ``ticks`` (channels,), written: the number of a tick for each reading.
        """
        if self._taken is None:
            ticks[...] = tick
            return
        now = time.monotonic()
        for index, moment in enumerate(self._taken[0]):
            ticks[index] = tick - max(0, ticks_of(now - moment, self._period))

    def departed(self, state: Record, tick: int, command: Record) -> int | None:
        """Fill in, once, the command that has left last or is on its way, and return its tick; None: nothing new."""
        gone = self._gone
        if gone is None or gone is self._told:
            return None
        self._told = gone
        command.raw.data[:] = gone[1]
        return tick + ticks_of(gone[0] - time.monotonic(), self._period)

    def write(self, command: Record) -> None:
        """Deposit a command for the next exchange; it replaces one that was not sent yet."""
        before, asked = self._wanted, command.tobytes()
        self._wanted = time.monotonic(), asked
        if self._waits and (before is None or before[1] != asked):
            self._woken.set()

    def figures(self) -> dict[str, float] | None:
        """Return rate [1/s] and durations [ms] of the latest exchanges, and the number of all; None before two."""
        latest = list(self._latest)
        if len(latest) < 2:
            return None
        durations = sorted(took for _, took in latest)
        span = latest[-1][0] - latest[0][0]
        return {
            "count": self.exchanges,
            "rate_hz": (len(latest) - 1) / span if span > 0.0 else 0.0,
            "p50_ms": durations[len(durations) // 2] * 1e3,
            "p99_ms": durations[len(durations) * 99 // 100] * 1e3,
            "max_ms": self.longest * 1e3,
        }

    def close(self) -> None:
        """Send the last command, close the device, and end the thread.

        Raises
        ------
        DeviceError
            If the exchange under way does not end; the thread closes the device when it does, and moves no surface.
        """
        thread, self._thread = self._thread, None
        self._left = thread or self._left
        self._ending.set()
        self._woken.set()
        if thread is None:
            return
        thread.join(CLOSE_TIME * max(1.0, self.device.timeout_factor))
        if thread.is_alive():
            self.lowest = math.inf
            raise DeviceError("does not answer; it will be closed when its exchange ends")

    @property
    def hangs_in(self) -> str:
        """The device's method in which the thread that was told to end still is; empty: it has ended."""
        return self._method if self._left is not None and self._left.is_alive() else ""

    @property
    def _method(self) -> str:
        return "close" if self._closes else self.called

    def _live(self, opened: threading.Event, read: threading.Event, ending: threading.Event) -> None:
        keep_up()
        try:
            self.device.open()
        except BaseException as error:
            self._error = told(error)
            read.set()
            return
        finally:
            opened.set()
        try:
            self._exchange(read, ending)
        except BaseException as error:
            self._error = told(error)
        finally:
            self._closes = True
            self._call(self.device.close)
            read.set()

    def _call(self, act: Callable[[], None]) -> None:
        try:
            act()
        except BaseException as error:
            self._error = self._error or told(error)

    def _exchange(self, read: threading.Event, ending: threading.Event) -> None:
        period, sent, stamps, way = type(self.device).period, None, self._stamps, 0.0
        due = time.monotonic()
        while not ending.is_set():
            begin = time.monotonic()
            self._woken.clear()
            before = sent
            stamps.begin()
            sent = self._send(sent, begin)
            otherwise = time.monotonic()
            if sent is not before:
                self._gone = begin + way, self._command.tobytes()
            self.called = "read"
            if is_new(self.device.read(self._reading)):
                self._newest = stamps.measurement_times(), self._reading.tobytes()
                read.set()
            if sent is not before:
                took = stamps.departure(otherwise) - begin
                way = took if way == 0.0 else way + _LEARNT * (min(took, 2.0 * way) - way)
            took = time.monotonic() - begin
            self.exchanges += 1
            self.longest = max(self.longest, took)
            self._latest.append((begin, took))
            due = max(due + period, begin)
            rest = max(due - time.monotonic(), _LEAST - took)
            if rest > 0.0:
                ending.wait(rest)
            if self._waits:
                self._woken.wait(self._waits)
        self._send(sent, time.monotonic())

    def _send(self, sent: Sent, now: float) -> Sent:
        """Write a new command, or the safe one if none came for too long; return the command that is dealt with."""
        wanted = self._wanted
        if wanted is None:
            return sent
        old = now - wanted[0] > self._patience
        if wanted is sent and not old:
            return sent
        self._command.raw.data[:] = wanted[1]
        if old:
            make_safe(self._command, self._commands, self.lowest)
            self._wanted = None if self._wanted is wanted else self._wanted
        self.called = "write"
        self.device.write(self._command)
        return wanted


class ServedEmulator:
    """Runs an emulator in a thread of its own: a wire that has to wait delays neither the simulation nor another wire.

    ``serve`` runs whenever the host has sent a request, or the emulator has something due.

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
        self._error: Raised | None = None
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
            raise again(self._error)
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
                select.select(emulator.file_descriptors(), [], [], max(0.0, emulator.service_interval()))
        except BaseException as error:
            self._error = told(error)


#: An error in a thread, and where it was raised there.
Raised = tuple[Exception, TracebackType | None]


def told(error: BaseException) -> Raised:
    """Return the exception for the loop to raise: a driver that tries to end the program has failed like any other."""
    if isinstance(error, Exception):
        return error, error.__traceback__
    return DeviceError(f"has tried to end the program: {named(error)}"), None


def again(error: Raised) -> Exception:
    """Return an error to be raised once more, where it was raised first.

    The loop meets it in every tick of a safe sequence.  Raised as it is, it would keep the lines of all times before:
    its words would take longer from tick to tick, and the sequence with them.
    """
    return Exception.with_traceback(*error)


def keep_up() -> None:
    """Give this thread a real-time priority one below that of the main thread: the loop must never wait for it."""
    with contextlib.suppress(OSError, AttributeError):
        policy = os.sched_getscheduler(os.getpid())
        if policy & os.SCHED_FIFO:
            priority = max(1, os.sched_getparam(os.getpid()).sched_priority - 1)
            os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))


def make_safe(command: Record, channels: tuple[Channel, ...], lowest: float = math.nan) -> None:
    """Turn a command that was sent into the safe one: each channel's safe value, hold, or retract.

    ``lowest``: height [m] below which no surface is sent that was not sent there already, NaN: the end of its travel.
    """
    for channel in channels:
        if isinstance(channel.safe, tuple):
            command[channel.name] = channel.safe
        elif channel.safe is RETRACT and channel.low and math.isfinite(channel.low[2]):
            sent, end = command[channel.name], channel.low[2]
            sent[2] = end if math.isnan(lowest) else min(sent[2].item(), max(end, lowest))


def _record(channels: tuple[Channel, ...]) -> Record:
    return Record.of(Field.of(channel) for channel in channels)
