"""The three servos of the table on their bus, with the unmodified ``moteus`` client; one call, one exchange.

Everything here is in the servo's own units: revolutions of its output, newton metres.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Coroutine, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

from itouch.plugin import DeviceError, Trace
from itouch_xyz_table.faults import FAULT, POSITION, TIMEOUT, fault_name, mode_name

AXES = "xyz"
#: Longest wait for the answers of all servos [s]; those that are missing are asked one by one, half as long, so often.
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
        self._loop = asyncio.new_event_loop()
        # What breaks is told by the exchange that it breaks.
        self._loop.set_exception_handler(lambda loop, context: None)
        self._transport: Any = None
        try:
            self._transport = self._run(_opened(moteus, port, self._patience, trace))
            self._servos = [moteus.Controller(id=number, transport=self._transport) for number in ids]
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
            If one does not answer.
        """
        return self._cycle([servo.make_query() for servo in self._servos])

    def stop(self, *, latched: bool = False) -> tuple[ServoState, ...]:
        """Stop all servos without force; that also ends a latched fault or time-out."""
        states = self._cycle([servo.make_stop(query=True) for servo in self._servos])
        return states if not latched else self.query()

    def command(self, goals: Sequence[Goal | None]) -> tuple[ServoState, ...]:
        """Command servos and ask all; None: only ask that one."""
        return self._cycle([self._make(servo, goal) for servo, goal in zip(self._servos, goals, strict=True)])

    def _make(self, servo: Any, goal: Goal | None) -> Any:
        if goal is None:
            return servo.make_query()
        return servo.make_position(
            position=goal.position, velocity=goal.velocity, feedforward_torque=goal.feedforward,
            maximum_torque=goal.torque_limit, watchdog_timeout=self._watchdog, velocity_limit=goal.velocity_limit,
            query=True,
        )  # fmt: skip

    def ready(self) -> None:
        """Do nothing: these servos obey their first command at once."""

    def set_position(self, axis: int, position: float) -> None:
        """Tell a servo where it is [rev]."""
        self._cycle_some([self._servos[axis].make_set_output_exact(position=position, query=True)], axis)

    def _cycle_some(self, commands: list[Any], axis: int) -> None:
        if not self._run(self._transport.cycle(commands), self._patience * 2):
            raise ServoError(f"servo {AXES[axis]} (id {self._servos[axis].id}) does not answer")

    def _cycle(self, commands: list[Any]) -> tuple[ServoState, ...]:
        """Exchange with all servos; a damaged or lost line is no reason to end a session: all are asked again."""
        states: dict[int, ServoState] = {}
        self._ask(commands, states, self._patience)
        for _ in range(TRIES):
            if len(states) == len(commands):
                return tuple(states[axis] for axis in range(len(commands)))
            self.repeated += 1
            for axis, command in enumerate(commands):
                if axis not in states:
                    self._ask([command], states, 0.5 * self._patience)
        axis = next(axis for axis in range(len(commands)) if axis not in states)
        number = self._servos[axis].id
        raise ServoError(f"servo {AXES[axis]} (id {number}) does not answer: check its cable and supply")

    def _ask(self, commands: list[Any], states: dict[int, ServoState], patience: float) -> None:
        """Exchange once, and keep what was answered."""
        try:
            results = self._run(self._transport.cycle(commands), patience)
        except ServoError as error:
            self._revive(error)
            return
        axes = {servo.id: axis for axis, servo in enumerate(self._servos)}
        for result in results:
            if result.id in axes:
                states[axes[result.id]] = _state(result.values)

    def _revive(self, error: ServoError) -> None:
        """Go on after answers that did not come, or a line that the client could not read; not after a lost bus.

        Raises
        ------
        ServoError
            The same, if the bus is gone.
        """
        if isinstance(error.__cause__, TimeoutError):
            return
        if isinstance(error.__cause__, OSError):
            raise error
        import moteus

        with contextlib.suppress(Exception):  # its reader has ended with the line that it could not read
            self._transport.close()
        self._transport = self._run(_opened(moteus, self._port, self._patience, self._trace))
        self._servos = [moteus.Controller(id=servo.id, transport=self._transport) for servo in self._servos]


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


def _state(values: Any) -> ServoState:
    import moteus

    at = moteus.Register
    return ServoState(
        int(values[at.MODE]), values[at.POSITION], values[at.VELOCITY], values[at.TORQUE], values[at.VOLTAGE],
        values[at.TEMPERATURE], int(values[at.FAULT]),
    )  # fmt: skip


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
