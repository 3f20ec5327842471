"""The three servos of the table on their bus, with the unmodified ``moteus`` client; one call, one exchange.

Everything here is in the servo's own units: revolutions of its output, newton metres.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import struct
import time
from collections.abc import Coroutine, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

from itouch.plugin import DeviceError, Trace
from itouch_xyz_table.faults import FAULT, POSITION, TIMEOUT, fault_name, mode_name

AXES = "xyz"
#: Longest wait for the answers of all servos [s]; those that are missing are asked one by one, half as long, for as
#: long as so many such waits take: an adaptor that refuses a line does so at once, and can be asked more often.
PATIENCE, TRIES = 0.04, 5
T = TypeVar("T")


class ServoError(DeviceError):
    """A servo is missing, does not answer, or has stopped; the message names the axis."""


class ServoFault(ServoError):  # noqa: N818
    """A servo has stopped by itself, with its code."""

    def __init__(self, axis: str, code: int, words: str = "") -> None:
        super().__init__(f"servo {axis} stopped: {words or f'{fault_name(code)} (code {code})'}")
        self.axis, self.code = axis, code


class ServoTimeout(ServoError):  # noqa: N818
    """A servo was without command for longer than its watchdog, and stays stopped until it is told to stop."""


class ServoState(NamedTuple):
    """What a servo says of itself: position [rev], velocity [rev/s], torque [N m], supply [V], board [degC].

    ``mode`` and ``fault`` are numbers of moteus; ``words`` say what the fault of another make means.
    """

    mode: int
    position: float
    velocity: float
    torque: float
    voltage: float
    temperature: float
    fault: int
    words: str = ""


@dataclass(frozen=True, slots=True)
class Goal:
    """A command to one servo: where to [rev] (NaN: stay), how fast [rev/s], with which torques [N m]."""

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
        Serial port of the CAN-FD adaptor (fdcanusb); empty: the one that is attached.
    ids
        The servos' numbers on the bus.
    watchdog
        Seconds without a command after which a servo stops by itself; goes with every command.
    patience
        Factor on how long answers are waited for.
    """

    def __init__(
        self, port: str, ids: Sequence[int], *, watchdog: float, patience: float = 1.0, trace: Trace | None = None
    ) -> None:
        try:
            import moteus
        except ImportError as error:
            raise ServoError("the table's servos need a package more: pip install 'itouch-py[moteus]'") from error
        self._watchdog, self._patience, self._port, self._trace = watchdog, PATIENCE * patience, port, trace
        #: Exchanges that were made again because a line was lost or damaged.
        self.repeated = 0
        #: What the client said of a line that the adaptor refused or that it could not read.
        self._refused = ""
        self._loop = _new_loop()
        self._transport: Any = None
        #: By what each servo knows its place (0 nothing, 1 its rotor, 2 what it was told), as it said last, and as it
        #: was when the table was ready; None: it does not say.
        self._anchors: list[int | None] = [None] * len(ids)
        self._ready: list[int | None] = []
        try:
            self._transport = self._run(_opened(moteus, port, self._patience, trace))
            self._servos = _controllers(moteus, ids, self._transport)
        except BaseException:
            self.close()
            raise

    def _run(self, work: Coroutine[Any, Any, T], patience: float = 1.0) -> T:
        try:
            return self._loop.run_until_complete(asyncio.wait_for(work, patience))
        except TimeoutError as error:
            raise ServoError(f"the servos did not answer within {patience * 1e3:.0f} ms") from error
        except (OSError, RuntimeError) as error:
            raise ServoError(f"the servos' bus failed: {error}") from error
        except (ValueError, LookupError, struct.error) as error:  # of a servo's answer that is none
            raise ServoError(f"the servos' bus brought what is no answer: {error}") from error

    def close(self) -> None:
        """Let go of the bus; the servos keep their last command until their watchdog ends it."""
        if self._transport is not None:
            with contextlib.suppress(Exception):
                self._transport.close()
            self._transport = None
        if not self._loop.is_closed():
            tasks = asyncio.all_tasks(self._loop)
            for task in tasks:
                task.cancel()
            if tasks:
                self._loop.run_until_complete(asyncio.wait(tasks, timeout=1.0))
            self._loop.close()

    def query(self) -> tuple[ServoState, ...]:
        """Ask all servos how they are.

        Raises
        ------
        ServoError
            If one does not answer, or has started anew.
        """
        states = self._cycle([servo.make_query() for servo in self._servos])
        self._watch()
        return states

    def stop(self, *, latched: bool = False) -> tuple[ServoState, ...]:
        """Stop all servos without force; that also ends a latched fault or time-out."""
        states = self._cycle([servo.make_stop(query=True) for servo in self._servos])
        return states if not latched else self.query()

    def command(self, goals: Sequence[Goal | None]) -> tuple[ServoState, ...]:
        """Command servos and ask all; None: only ask that one.

        Raises
        ------
        ServoError
            If one does not answer, or has started anew: it would follow its goals from another zero.
        """
        states = self._cycle([self._make(servo, goal) for servo, goal in zip(self._servos, goals, strict=True)])
        self._watch()
        return states

    def _watch(self) -> None:
        """See that every servo still knows its place as it did when the table was ready."""
        for axis, (before, now) in enumerate(zip(self._ready, self._anchors, strict=False)):
            if before != now:
                raise ServoError(
                    f"servo {AXES[axis]} (id {self._servos[axis].id}) has started anew and does not know its place any "
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
        """Note by what each servo knows its place; they obey their first command at once."""
        self.query()
        self._ready = list(self._anchors)

    def lost(self) -> tuple[int, ...]:
        """Return the axes whose servos say that they know nothing of their places: they count from where they began."""
        return tuple(axis for axis, anchor in enumerate(self._anchors) if anchor == 0)

    def set_position(self, axis: int, position: float) -> None:
        """Tell a servo where it is [rev]."""
        self._exchange({axis: self._servos[axis].make_set_output_exact(position=position, query=True)})

    def _cycle(self, commands: list[Any]) -> tuple[ServoState, ...]:
        """Exchange with all servos."""
        states = self._exchange(dict(enumerate(commands)))
        return tuple(states[axis] for axis in range(len(commands)))

    def _exchange(self, commands: dict[int, Any]) -> dict[int, ServoState]:
        """Exchange with these servos, by axis.

        A damaged, lost or refused line is no reason to end a session: every command says what shall be, so it can be
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
                    f"servo {AXES[missing[0]]} (id {self._servos[missing[0]].id}) does not answer: check its cable and "
                    f"supply{self._refused}"
                )
            self.repeated += 1
            for axis in missing:
                self._ask([commands[axis]], states, 0.5 * self._patience)
        return states

    def _ask(self, commands: list[Any], states: dict[int, ServoState], patience: float) -> None:
        """Exchange once, and keep what was answered."""
        try:
            results = self._run(self._transport.cycle(commands), patience)
        except ServoError as error:
            self._revive(error)
            return
        axes = {servo.id: axis for axis, servo in enumerate(self._servos)}
        for result in results:
            state = _state(result.values) if result.id in axes else None
            if state is not None:
                axis = axes[result.id]
                states[axis] = state
                # An answer without it says nothing new: one that has started anew says it with the next.
                anchor = _anchor(result.values)
                self._anchors[axis] = self._anchors[axis] if anchor is None else anchor

    def _revive(self, error: ServoError) -> None:
        """Go on after answers that did not come, or a line that the client could not read; not after a lost bus.

        Raises
        ------
        ServoError
            The same, if the bus is gone.
        """
        silent = isinstance(error.__cause__, TimeoutError)
        if silent and asyncio.all_tasks(self._loop):
            return  # its reader goes on
        if isinstance(error.__cause__, OSError) and not silent:
            raise error
        import moteus

        if isinstance(error.__cause__, RuntimeError):
            self._refused = f" (the client says: {error.__cause__})"
        # The client's reader may have ended with the line that it could not read.  A loop of its own goes with each
        # client: in the old one the port's number would count as watched, and of the new port nothing would be heard.
        self.close()
        self._loop = _new_loop()
        self._transport = self._run(_opened(moteus, self._port, self._patience, self._trace))
        self._servos = _controllers(moteus, [servo.id for servo in self._servos], self._transport)


def _new_loop() -> asyncio.AbstractEventLoop:
    """Return a loop for a client; what breaks in it is told by the exchange that it breaks."""
    loop = asyncio.new_event_loop()
    loop.set_exception_handler(lambda loop, context: None)
    return loop


async def _opened(moteus: Any, port: str, patience: float, trace: Trace | None) -> Any:
    found = port
    if not found:
        ports = moteus.Fdcanusb.detect_fdcanusb
        try:
            found = ports()
        except (IndexError, OSError) as error:
            raise ServoError("no CAN-FD adaptor (fdcanusb) is attached: plug it in, or write port=") from error
    try:
        log = _Log(trace) if trace is not None else None
        return moteus.Fdcanusb(found, debug_log=log, command_timeout=patience, response_timeout=patience)
    except OSError as error:
        raise ServoError(f"the servos' bus {found} cannot be opened: {error.strerror or error}") from error


class _Log:
    """The client's log as a trace: lines of a time stamp, ``>`` or ``<``, and the text."""

    def __init__(self, trace: Trace) -> None:
        self._trace = trace

    def write(self, line: bytes) -> None:
        """Take one line of the client's log."""
        mark, _, text = line.rstrip(b"\n").split(b" ", 1)[1].partition(b" ")
        (self._trace.sent if mark == b">" else self._trace.received)(text)


def _controllers(moteus: Any, ids: Sequence[int], transport: Any) -> list[Any]:
    """Return the client's servos, which are asked by what they know their places, too."""
    asked = moteus.QueryResolution()
    asked.home_state = moteus.INT8
    return [moteus.Controller(id=number, transport=transport, query_resolution=asked) for number in ids]


def _state(values: Any) -> ServoState | None:
    """Return what a servo says; None if a part of it is missing."""
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
    """Check that all servos are well; ``driven``: and that they obey position commands.

    Raises
    ------
    ServoFault, ServoTimeout, ServoError
        Naming the axis.
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
