"""The three servos of the table on their bus, with the unmodified ``moteus`` client; each call is one exchange.

All values are in the servo's own units: revolutions of its output, newton metres.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import struct
import time
from collections.abc import Coroutine, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

from itouch.plugin import DeviceError, Trace
from itouch.plugin.wire_claims import share
from itouch_xyz_table.faults import FAULT, POSITION, TIMEOUT, fault_name, mode_name

AXES = "xyz"
#: Longest wait for the answers of all servos [s].  Those that are missing are then queried one by one with half that
#: wait, for as long as this many such waits take: an adaptor that refuses a line does so at once, and can be asked more
#: often.
PATIENCE, TRIES = 0.04, 5
#: Registers by which the answers of one exchange are told from late ones of another; the first asks for none.
MARKS = ("", "Q_CURRENT", "D_CURRENT")
#: How long [s] late answers are dropped before such an exchange.
FLUSH = 2e-3
#: What is said where a scene names no port and none is found.
NO_ADAPTOR = "no CAN-FD adaptor (fdcanusb) is attached: plug it in, or write port="
T = TypeVar("T")


class ServoError(DeviceError):
    """A servo is missing, does not answer, or has stopped; the message names the axis."""


class ServoFault(ServoError):  # noqa: N818
    """A servo has stopped by itself; the error holds its fault code."""

    def __init__(self, axis: str, code: int, words: str = "") -> None:
        super().__init__(f"servo {axis} stopped: {words or f'{fault_name(code)} (code {code})'}")
        self.axis, self.code = axis, code


class ServoTimeout(ServoError):  # noqa: N818
    """A servo got no command for longer than its watchdog; it stays stopped until it is sent a stop."""


class ServoState(NamedTuple):
    """A servo's report: position [rev], velocity [rev/s], torque [N m], supply [V], board temperature [degC].

    ``mode`` and ``fault`` are moteus's numbers; for another make, ``words`` say what the fault means.
    """

    mode: int
    position: float
    velocity: float
    torque: float
    voltage: float
    temperature: float
    fault: int
    words: str = ""


class PortLock:
    """Keeps other programs from a serial port whose client does not lock it, until ``release``.

    Raises
    ------
    ServoError
        If another program has locked it.
    """

    def __init__(self, port: str) -> None:
        self._handle: int | None = None
        if not port.startswith("/"):
            return
        try:
            handle = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:  # its client will say why
            return
        try:
            share(handle, port)
        except DeviceError as error:
            os.close(handle)
            raise ServoError(f"the servos' bus {error}") from error
        self._handle = handle

    def release(self) -> None:
        """Let others have the port."""
        handle, self._handle = self._handle, None
        if handle is not None:
            os.close(handle)


@dataclass(frozen=True, slots=True)
class Goal:
    """A command to one servo: position [rev] (NaN: by velocity), velocity and its limit [rev/s], torques [N m]."""

    position: float
    velocity: float
    feedforward: float
    torque_limit: float
    velocity_limit: float


class Servos:
    """An open bus.

    Parameters
    ----------
    port
        Serial port of the CAN-FD adaptor (fdcanusb); empty: the attached one.
    ids
        The servos' numbers on the bus.
    watchdog
        Seconds without a command after which a servo stops by itself; sent with every command.
    patience
        Factor on every waiting time for an answer.
    """

    def __init__(
        self, port: str, ids: Sequence[int], *, watchdog: float, patience: float = 1.0, trace: Trace | None = None
    ) -> None:
        try:
            import moteus
        except ImportError as error:
            raise ServoError("the table's servos need a package more: pip install 'itouch-py[moteus]'") from error
        self._watchdog, self._patience, self._port, self._trace = watchdog, PATIENCE * patience, port, trace
        #: Number of exchanges repeated because a line was lost or damaged.
        self.repeated = 0
        #: Whether answers may still come to commands that were sent again: none says which one it is to.
        self._owing = False
        self._ids, self._mark = list(ids), 0
        #: The client's message about a line that the adaptor refused or the client could not read.
        self._refused = ""
        self._loop = _new_loop()
        self._transport: Any = None
        self._lock: PortLock | None = None
        #: What each servo's position refers to (0 nothing, 1 its rotor, 2 a position it was given): as last reported,
        #: and as it was when the table was ready; None: not reported.
        self._anchors: list[int | None] = [None] * len(ids)
        self._ready: list[int | None] = []
        try:
            self._open(moteus, ids)
        except BaseException:
            self.close()
            raise

    def _open(self, moteus: Any, ids: Sequence[int]) -> None:
        found = _found(moteus, self._port)
        self._lock = PortLock(found)
        self._transport = self._run(_opened(moteus, found, self._patience, self._trace))
        self._servos = [_controllers(moteus, ids, self._transport, mark) for mark in MARKS]

    def _run(self, work: Coroutine[Any, Any, T], patience: float = 1.0) -> T:
        try:
            return self._loop.run_until_complete(asyncio.wait_for(work, patience))
        except TimeoutError as error:
            raise ServoError(f"the servos did not answer within {patience * 1e3:.0f} ms") from error
        except (OSError, RuntimeError) as error:
            advice = "; check its plug" if isinstance(error, OSError) else ""
            raise ServoError(f"the servos' bus {self._port or '(fdcanusb)'} failed: {error}{advice}") from error
        except (ValueError, LookupError, struct.error) as error:  # from a servo's invalid answer
            raise ServoError(f"the servos' bus delivered something that is not an answer: {error}") from error

    def close(self) -> None:
        """Release the bus; the servos keep their last command until their watchdogs end it."""
        if self._transport is not None:
            with contextlib.suppress(Exception):
                self._transport.close()
            self._transport = None
        if self._lock is not None:
            self._lock.release()
        if not self._loop.is_closed():
            tasks = asyncio.all_tasks(self._loop)
            for task in tasks:
                task.cancel()
            if tasks:
                self._loop.run_until_complete(asyncio.wait(tasks, timeout=1.0))
            self._loop.close()

    def query(self) -> tuple[ServoState, ...]:
        """Read the state of all servos.

        Raises
        ------
        ServoError
            If one does not answer, or has restarted.
        """
        states = self._cycle([servo.make_query() for servo in self._marked()])
        self._watch()
        return states

    def stop(self, *, latched: bool = False) -> tuple[ServoState, ...]:
        """Stop all servos without force, which clears latched faults; ``latched``: return the states after that."""
        states = self._cycle([servo.make_stop(query=True) for servo in self._marked()])
        return states if not latched else self.query()

    def command(self, goals: Sequence[Goal | None]) -> tuple[ServoState, ...]:
        """Command the servos that have a goal, and read the state of all.

        Raises
        ------
        ServoError
            If one does not answer, or has restarted: it would follow its goals from another zero.
        """
        states = self._cycle([self._make(servo, goal) for servo, goal in zip(self._marked(), goals, strict=True)])
        self._watch()
        return states

    def _watch(self) -> None:
        """Check that what every servo's position refers to has not changed since the table was ready."""
        for axis, (before, now) in enumerate(zip(self._ready, self._anchors, strict=False)):
            if before != now:
                raise ServoError(
                    f"servo {AXES[axis]} (id {self._ids[axis]}) has restarted and does not know its place any "
                    "more: check its supply, then connect it again"
                )

    def _make(self, servo: Any, goal: Goal | None) -> Any:
        if goal is None:
            return servo.make_query()
        return servo.make_position(
            position=goal.position, velocity=goal.velocity, feedforward_torque=goal.feedforward,
            maximum_torque=goal.torque_limit, watchdog_timeout=self._watchdog, velocity_limit=goal.velocity_limit,
            query=True,
        )  # fmt: skip

    def ready(self) -> None:
        """Store what each servo's position refers to; moteus servos follow their first command at once."""
        self.query()
        self._ready = list(self._anchors)

    def lost(self) -> tuple[int, ...]:
        """Return the axes whose servos say that their position refers to nothing: they count from where they began."""
        return tuple(axis for axis, anchor in enumerate(self._anchors) if anchor == 0)

    def set_position(self, axis: int, position: float) -> None:
        """Tell a servo that it is at ``position`` [rev]."""
        self._exchange({axis: self._marked()[axis].make_set_output_exact(position=position, query=True)})

    def _cycle(self, commands: list[Any]) -> tuple[ServoState, ...]:
        """Exchange one command with each servo."""
        states = self._exchange(dict(enumerate(commands)))
        return tuple(states[axis] for axis in range(len(commands)))

    def _exchange(self, commands: dict[int, Any]) -> dict[int, ServoState]:
        """Exchange a command with some servos, by axis.

        A damaged, lost or refused line need not end a session: every command states a goal, not a change, so it can be
        sent again.
        """
        states: dict[int, ServoState] = {}
        self._refused = ""
        self._ask(list(commands.values()), states, self._patience)
        longest = TRIES * 0.5 * self._patience * sum(axis not in states for axis in commands)
        end = time.monotonic() + longest
        while missing := [axis for axis in commands if axis not in states]:
            if time.monotonic() >= end:
                raise ServoError(
                    f"servo {AXES[missing[0]]} (id {self._ids[missing[0]]}) does not answer: check its cable and "
                    f"supply{self._refused}"
                )
            self.repeated += 1
            self._owing = True
            for axis in missing:
                self._ask([commands[axis]], states, 0.5 * self._patience)
        return states

    def _marked(self) -> list[Any]:
        """Return the client's servos for the next exchange, whose answers can be told from those that may still come.

        An answer has no number, but it names the registers that were asked for: after a repeated command, another one
        is asked for, and what has arrived meanwhile is dropped.
        """
        if self._owing:
            self._owing = False
            self._mark = self._mark % (len(self._servos) - 1) + 1
            try:
                self._run(self._transport.flush_read_queue(timeout=FLUSH), 1.0)
            except ServoError as error:
                self._revive(error)
        return self._servos[self._mark]

    def _ask(self, commands: list[Any], states: dict[int, ServoState], patience: float) -> None:
        """Exchange once, and store the states that were answered."""
        try:
            results = self._run(self._transport.cycle(commands), patience)
        except ServoError as error:
            self._revive(error)
            return
        axes = {number: axis for axis, number in enumerate(self._ids)}
        for result in results:
            mine = result.id in axes and self._bears_mark(result.values)
            state = _state(result.values) if mine else None
            if state is not None:
                axis = axes[result.id]
                states[axis] = state
                # An answer without this register says nothing new: a servo that has restarted reports it with the next.
                anchor = _anchor(result.values)
                self._anchors[axis] = self._anchors[axis] if anchor is None else anchor

    def _bears_mark(self, values: Any) -> bool:
        """Tell whether an answer is to this exchange, where there may be others."""
        import moteus

        mark = MARKS[self._mark]
        return not mark or getattr(moteus.Register, mark) in values

    def _revive(self, error: ServoError) -> None:
        """Recover from missing answers, or from a line that the client could not read; not from a lost bus.

        Raises
        ------
        ServoError
            The same error, if the bus is gone.
        """
        silent = isinstance(error.__cause__, TimeoutError)
        if silent and asyncio.all_tasks(self._loop):
            return  # the client's reader is still running
        if isinstance(error.__cause__, OSError) and not silent:
            raise error
        import moteus

        if isinstance(error.__cause__, RuntimeError):
            self._refused = f" (the client says: {error.__cause__})"
        # The client's reader may have ended with the line that it could not read.  Each client gets an event loop of
        # its own: the old one would take the port's descriptor for one that it watches, and hear nothing of the new
        # port.
        self.close()
        self._loop = _new_loop()
        self._open(moteus, self._ids)


def _new_loop() -> asyncio.AbstractEventLoop:
    """Return an event loop for a client; its errors are reported by the exchange in which they occur."""
    loop = asyncio.new_event_loop()
    loop.set_exception_handler(lambda loop, context: None)
    return loop


def _found(moteus: Any, port: str) -> str:
    """Return the adaptor's port: the one that is named, or else the one that is attached."""
    if port:
        return port
    try:
        found: str = moteus.Fdcanusb.detect_fdcanusb()
    except (IndexError, OSError) as error:
        raise ServoError(NO_ADAPTOR) from error
    return found


async def _opened(moteus: Any, found: str, patience: float, trace: Trace | None) -> Any:
    try:
        log = _Log(trace) if trace is not None else None
        return moteus.Fdcanusb(found, debug_log=log, command_timeout=patience, response_timeout=patience)
    except OSError as error:
        raise ServoError(f"the servos' bus {found} cannot be opened: {error.strerror or error}") from error


class _Log:
    """The client's log as a trace: each line is a time stamp, ``>`` or ``<``, and the text."""

    def __init__(self, trace: Trace) -> None:
        self._trace = trace

    def write(self, line: bytes) -> None:
        """Take one line of the client's log."""
        mark, _, text = line.rstrip(b"\n").split(b" ", 1)[1].partition(b" ")
        (self._trace.sent if mark == b">" else self._trace.received)(text)


def _controllers(moteus: Any, ids: Sequence[int], transport: Any, mark: str) -> list[Any]:
    """Return the client's servos, with queries that also ask what their positions refer to, and for a mark."""
    asked = moteus.QueryResolution()
    asked.home_state = moteus.INT8
    if mark:
        setattr(asked, mark.lower(), moteus.INT8)
    return [moteus.Controller(id=number, transport=transport, query_resolution=asked) for number in ids]


def _state(values: Any) -> ServoState | None:
    """Return a servo's state from an answer; None if a part of it is missing."""
    import moteus

    at = moteus.Register
    wanted = (at.MODE, at.POSITION, at.VELOCITY, at.TORQUE, at.VOLTAGE, at.TEMPERATURE, at.FAULT)
    found = [float(values.get(register, math.nan)) for register in wanted]
    mode, place, speed, torque, voltage, temperature, fault = found
    if not (math.isfinite(mode) and math.isfinite(fault)) or at.POSITION not in values or at.TORQUE not in values:
        return None
    return ServoState(int(mode), place, speed, torque, voltage, temperature, int(fault))


def _anchor(values: Any) -> int | None:
    import moteus

    found = float(values.get(moteus.Register.HOME_STATE, math.nan))
    return int(found) if found >= 0.0 else None  # the least number is "none"


def check(states: Sequence[ServoState], *, driven: bool) -> None:
    """Check that all servos are well, and, if ``driven``, that they follow position commands.

    Raises
    ------
    ServoFault, ServoTimeout, ServoError
        If one is not; the message names the axis.
    """
    for axis, state in zip(AXES, states, strict=True):
        if state.mode == FAULT:
            raise ServoFault(axis, state.fault, state.words)
        if state.mode == TIMEOUT:
            raise ServoTimeout(f"servo {axis} was without command for longer than its watchdog and has stopped")
        if driven and state.mode != POSITION:
            raise ServoError(f"servo {axis} does not follow its commands: it is in mode '{mode_name(state.mode)}'")
        if not math.isfinite(state.position):
            raise ServoError(f"servo {axis} does not know its position")
