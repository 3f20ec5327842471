"""Three ODrive servos on a CAN bus, through the library python-can: as `servos.Servos`, with CAN Simple frames.

A servo broadcasts its state ten times a second; positions and currents are queried in every exchange, which also
feeds the servo's own watchdog.  The watchdog can be enabled over USB only, so it is tested when the bus is opened: each
servo holds its position, gets no frames, and must let go by its watchdog.  A lost answer is queried again; commands are
not acknowledged, so limits and modes are sent again and again.

An answer does not say which query it is to.  A query that was repeated may be answered twice, so before the next one
each servo that may still owe an answer is asked for something else (its supply): its answers come in order.
"""

from __future__ import annotations

import contextlib
import errno
import math
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from itouch.plugin import Trace
from itouch_xyz_table import canframes as can_
from itouch_xyz_table.faults import FAULT, POSITION
from itouch_xyz_table.servos import AXES, Goal, PortLock, ServoError, ServoState

#: Longest wait for answers [s], and how often missing ones are queried; longest time [s] without a heartbeat for which
#: a servo's state counts as known; how long [s] a change of state may take.
PATIENCE, TRIES, SILENT, CHANGE = 0.01, 8, 0.35, 0.6
#: Answers are waited for this many times as long as they usually take, but at most so long [s].
USUAL, LATEST = 2.0, 0.1
#: Weight of a new answer time in the usual one; a longer one counts at once if it is certain.
_FOLLOWS = 0.25
#: Without frames a servo must let go by itself within the first time [s], and report so within the second.
LONGEST_WATCHDOG, HEARTBEAT = 0.5, 0.25
#: One servo is sent its limits and mode again in every so many exchanges; one that has not started or stopped after
#: this time [s], longer than from one heartbeat to the next, is told again.
RENEWED, AGAIN = 4, 0.15
#: Longest time [s] spent on taking frames that have already arrived.
DRAIN = 2e-3
#: How long [s] to wait for room in an adaptor's full queue, and how often to check: by default an interface on Linux
#: has room for ten frames, and a cycle of three servos has up to fifteen.
ROOM, _LOOK = 20e-3, 2e-4
#: Bit rate [1/s] of a bus behind a serial adaptor.
_BITRATE = 1_000_000


class Odrives:
    """An open bus.

    Parameters
    ----------
    bus
        INTERFACE:CHANNEL of python-can: ``socketcan:can0``, ``slcan:/dev/ttyACM0``.
    ids
        The servos' numbers on the bus.
    torque_constants
        Torque constant of each motor [N m/A].
    patience
        Factor on every waiting time for an answer.
    """

    def __init__(
        self,
        bus: str,
        ids: Sequence[int],
        *,
        torque_constants: Sequence[float],
        patience: float = 1.0,
        trace: Trace | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._ids, self._constants, self._patience = list(ids), list(torque_constants), patience
        self._trace, self._clock = trace, clock
        #: Number of exchanges repeated because a frame was lost.
        self.repeated = 0
        self._exchanges = 0
        #: Whether the servos are driven: from then on, one that is no longer driven has restarted, and is not driven
        #: again.
        self._armed = False
        self._zero = [0.0] * len(self._ids)
        self._state, self._error = [0] * len(self._ids), [0] * len(self._ids)
        self._heard = [-math.inf] * len(self._ids)
        self._mode: list[int | None] = [None] * len(self._ids)
        self._limits: list[tuple[float, float] | None] = [None] * len(self._ids)
        self._found: dict[tuple[int, int], tuple[float, ...]] = {}
        #: Usual time that answers take [s]; the axes of which late answers may still come; and those whose servos tell
        #: their supply.
        self._usual = 0.0
        self._owing: set[int] = set()
        self._ordered: set[int] = set()
        interface, _, channel = bus.partition(":")
        self._lock = PortLock(channel.partition("@")[0] if interface == "slcan" else "")
        try:
            self._name, self._bus = bus, _opened(bus)
        except BaseException:
            self._lock.release()
            raise
        try:
            self._await("sends no heartbeat: check its cable and supply", lambda axis: self._heard[axis] > -math.inf)
            self._ordered = set(range(len(self._ids)))
            self._hear_out(self._ordered)
            self._ordered = {axis for axis, what in self._found if what == can_.SUPPLY}
            self._prove_watchdog()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Release the bus; the servos keep their last command until their watchdogs end it."""
        with contextlib.suppress(Exception):
            self._bus.shutdown()
        self._lock.release()

    # --- the interface `Drives` -----------------------------------------------------------------------------------

    def query(self) -> tuple[ServoState, ...]:
        """Read the state of all servos.

        Raises
        ------
        ServoError
            If one does not answer or sends no heartbeat.
        """
        self._listen(0.0)
        if self._owing:
            self._hear_out(self._owing)
        wanted = {(axis, what) for axis in range(len(self._ids)) for what in (can_.ESTIMATES, can_.CURRENTS)}
        self._found.clear()
        for turn in range(TRIES):
            begin = self._clock()
            for axis, what in sorted(wanted - set(self._found)):
                self._ask(axis, what)
            end = begin + self._wait()
            while not wanted <= set(self._found) and self._clock() < end:
                self._listen(end - self._clock())
            if wanted <= set(self._found):
                if not turn:  # else nobody knows to which query the answer was
                    self._took(self._clock() - begin)
                return tuple(self._shown(axis) for axis in range(len(self._ids)))
            self.repeated += 1
            self._owing.update(axis for axis, _ in wanted - set(self._found))
        axis = min(axis for axis, _ in wanted - set(self._found))
        raise ServoError(f"servo {AXES[axis]} (id {self._ids[axis]}) does not answer: check its cable and supply")

    def _hear_out(self, axes: Iterable[int]) -> None:
        """Let late answers pass: each servo's have all come once it has answered what is asked after them.

        Of a servo that never answers that, late answers are waited for as long as those to any query.
        """
        self._found.clear()
        wanted = {(axis, can_.SUPPLY) for axis in axes}
        longest = LATEST * self._patience if self._ordered >= set(axes) else self._wait()
        begin, asked = self._clock(), 0
        while not wanted <= set(self._found) and (left := begin + longest - self._clock()) > 0.0:
            for axis, what in sorted(wanted - set(self._found)):
                self._ask(axis, what)
            asked += 1
            end = self._clock() + min(left, self._wait())
            while not wanted <= set(self._found) and self._clock() < end:
                self._listen(end - self._clock())
        if wanted <= set(self._found):
            self._took(self._clock() - begin, sure=asked == 1)
        self._owing.clear()

    def _wait(self) -> float:
        """Return how long to wait for an answer before it is asked for again [s]."""
        return self._patience * min(LATEST, max(PATIENCE, USUAL * self._usual))

    def _took(self, seconds: float, *, sure: bool = True) -> None:
        """Note how long answers took [s]; ``sure``: they were asked for once, so they are no answers to another try."""
        took = seconds / self._patience
        learnt = self._usual + _FOLLOWS * (took - self._usual)
        self._usual = max(took, learnt) if sure else learnt

    def command(self, goals: Sequence[Goal | None]) -> tuple[ServoState, ...]:
        """Command the servos that have a goal, and read the state of all."""
        self._exchanges += 1
        for axis, goal in enumerate(goals):
            if goal is not None:
                self._go(axis, goal)
        return self.query()

    def stop(self, *, latched: bool = False) -> tuple[ServoState, ...]:
        """Stop all servos without force, which also clears latched errors."""
        self._armed = False
        for axis in range(len(self._ids)):
            self._let_go(axis)
        self._await(
            "does not stop", lambda axis: self._state[axis] == can_.IDLE and not self._error[axis], self._let_go
        )
        return self.query()

    def set_position(self, axis: int, position: float) -> None:
        """Store that a servo is at ``position`` [rev]; the servo itself goes on counting as before."""
        self._zero[axis] += position - self.query()[axis].position

    def ready(self) -> None:
        """Let all servos hold their positions, so that the first command finds them driven."""
        for axis, state in enumerate(self.query()):
            limit = self._limits[axis] or (1.0, 1.0)
            self._go(axis, Goal(state.position, 0.0, 0.0, limit[1] * self._constants[axis], limit[0]))
        self._armed = True

    # --- the bus -----------------------------------------------------------------------------------------------------

    def _let_go(self, axis: int) -> None:
        self._send(axis, can_.SET_STATE, can_.IDLE)
        self._send(axis, can_.CLEAR_ERRORS, 0)

    def _drive(self, axis: int) -> None:
        self._send(axis, can_.SET_STATE, can_.CLOSED_LOOP)

    def _go(self, axis: int, goal: Goal) -> None:
        """Send a goal; a servo that is not driven yet gets its limits, mode and goal before it is started."""
        by_velocity = math.isnan(goal.position)
        limits = (goal.velocity_limit, goal.torque_limit / self._constants[axis])
        turn = self._exchanges % (RENEWED * len(self._ids))
        renewed = not self._armed or turn == RENEWED * axis
        if renewed or limits != self._limits[axis]:
            self._send(axis, can_.SET_LIMITS, *limits)
            self._limits[axis] = limits
        mode = can_.BY_VELOCITY if by_velocity else can_.BY_POSITION
        if renewed or mode != self._mode[axis]:
            self._send(axis, can_.SET_MODE, mode, can_.FOLLOW)
            self._mode[axis] = mode
        if by_velocity:
            self._send(axis, can_.SET_VELOCITY, goal.velocity, goal.feedforward)
        else:
            forward = can_.milli(goal.velocity), can_.milli(goal.feedforward)
            self._send(axis, can_.SET_POSITION, goal.position - self._zero[axis], *forward)
        if not self._armed and self._state[axis] != can_.CLOSED_LOOP and not self._error[axis]:
            self._drive(axis)
            self._await(
                "does not follow",
                lambda one: one != axis or self._state[one] == can_.CLOSED_LOOP or self._error[one],
                self._drive,
            )

    def _prove_watchdog(self) -> None:
        """Send no frames while the servos hold their positions: each must let go by its own watchdog.

        Raises
        ------
        ServoError
            If one cannot be driven, does not let go, or lets go for another reason: its watchdog is off, or in doubt.
        """
        self.stop()
        for axis, state in enumerate(self.query()):
            self._go(axis, Goal(state.position, 0.0, 0.0, 0.01 * self._constants[axis], 0.1))
        for axis, state_now in enumerate(self._state):
            if state_now != can_.CLOSED_LOOP and not self._ended(axis):  # else this host was held up
                self._turn_down(axis, f"cannot be driven, so its own watchdog cannot be tried out{self._why(axis)}")
        end = self._clock() + (LONGEST_WATCHDOG + HEARTBEAT) * max(1.0, self._patience / 5.0)
        late = False  # a host that was held up until then has not heard yet what the servos have told meanwhile
        while not late and not all(
            error and state != can_.CLOSED_LOOP for error, state in zip(self._error, self._state, strict=True)
        ):
            late = self._clock() >= end
            self._listen(0.05)
        advice = "set enable_watchdog and watchdog_timeout (0.1 s) with the maker's program"
        for axis, state_now in enumerate(self._state):
            if state_now == can_.CLOSED_LOOP:
                self._turn_down(
                    axis,
                    f"goes on without being commanded for {LONGEST_WATCHDOG:g} s: its own watchdog is off; {advice}",
                )
            if not self._ended(axis):
                why = self._why(axis) or ": it tells no error"
                self._turn_down(
                    axis, f"let go in silence, but not by its own watchdog{why}; find out why that was, and {advice}"
                )
        self.stop()

    def _ended(self, axis: int) -> bool:
        """Tell whether a servo has let go because its watchdog ended."""
        return self._state[axis] != can_.CLOSED_LOOP and bool(self._error[axis] & can_.WATCHDOG_ENDED)

    def _turn_down(self, axis: int, words: str) -> None:
        """Stop all servos that can be stopped, and raise a `ServoError`."""
        with contextlib.suppress(ServoError):
            self.stop()
        raise ServoError(f"servo {AXES[axis]} (id {self._ids[axis]}) {words}")

    def _await(
        self, otherwise: str, done: Callable[[int], object], again: Callable[[int], None] = lambda axis: None
    ) -> None:
        """Feed and listen until ``done`` holds for all servos; repeat ``again`` for those for which it does not yet.

        Raises
        ------
        ServoError
            If it does not hold in time.
        """
        begin = told = self._clock()
        end, late = begin + CHANGE * self._patience, False
        while not all(done(axis) for axis in range(len(self._ids))):
            if late:
                axis = next(axis for axis in range(len(self._ids)) if not done(axis))
                raise ServoError(f"servo {AXES[axis]} (id {self._ids[axis]}) {otherwise}{self._why(axis)}")
            late = self._clock() > end  # a host that was held up hears out what has come meanwhile
            renewed = self._clock() - told > AGAIN
            told = self._clock() if renewed else told
            for axis in range(len(self._ids)):
                if renewed and not done(axis):
                    again(axis)
                self._ask(axis, can_.HEARTBEAT)  # not every firmware answers it; heartbeats also come unasked
            self._listen(0.02)

    def _why(self, axis: int) -> str:
        code = self._error[axis]
        return f": {can_.error_name(code)} (0x{code:x})" if code else ""

    def _shown(self, axis: int) -> ServoState:
        """Return a servo's state in the terms of moteus."""
        if self._clock() - self._heard[axis] > SILENT * self._patience:
            raise ServoError(f"servo {AXES[axis]} (id {self._ids[axis]}) sends no heartbeat any more: check its cable")
        place, speed = self._found[axis, can_.ESTIMATES]
        current = self._found[axis, can_.CURRENTS][1]
        code = self._error[axis]
        mode = FAULT if code else POSITION if self._state[axis] == can_.CLOSED_LOOP else 0
        words = f"{can_.error_name(code)} (error 0x{code:x})" if code else ""
        return ServoState(
            mode, place + self._zero[axis], speed, current * self._constants[axis], math.nan, math.nan, code, words
        )

    def _ask(self, axis: int, what: int) -> None:
        self._put(can_.number(self._ids[axis], what), b"", remote=True)

    def _send(self, axis: int, what: int, *values: float) -> None:
        self._put(can_.number(self._ids[axis], what), can_.pack(what, *values))

    def _put(self, number: int, data: bytes, *, remote: bool = False) -> None:
        import can

        if self._trace is not None:
            self._trace.sent(b"%03x %s" % (number, b"?" if remote else data.hex().encode()))
        message = can.Message(
            arbitration_id=number, data=data, is_remote_frame=remote, dlc=8 if remote else None, is_extended_id=False
        )
        end = self._clock() + ROOM * self._patience
        while True:
            try:
                self._bus.send(message)
            except (can.CanError, OSError) as error:
                full = getattr(error, "error_code", None) == errno.ENOBUFS
                if full and self._clock() < end:
                    time.sleep(_LOOK)
                    continue
                why = "; no frame leaves it: check its cable, its terminators and the servos' supply" if full else ""
                raise self._failed(error, why) from error
            return

    def _failed(self, error: Exception, why: str = "") -> ServoError:
        return ServoError(f"the servos' bus {self._name} failed: {error}{why or '; check its plug'}")

    def _listen(self, wait: float) -> None:
        """Process frames: the first if it comes within ``wait`` seconds, and those that have arrived with it.

        On a bus that others keep busy there is always one more, so it stops after that time, too.
        """
        import can

        wait = max(0.0, wait)
        end = self._clock() + max(wait, DRAIN)
        while self._clock() < end:
            try:
                message = self._bus.recv(wait)
            except (ValueError, IndexError):  # the adaptor's line was damaged: a frame is lost
                wait = 0.0
                continue
            except (can.CanError, OSError) as error:
                raise self._failed(error) from error
            if message is None:
                return
            if wait:  # the first one
                wait, end = 0.0, min(end, self._clock() + DRAIN)
            if not (message.is_remote_frame or message.is_error_frame or message.is_extended_id):
                self._take(message.arbitration_id, bytes(message.data))

    def _take(self, number: int, data: bytes) -> None:
        if self._trace is not None:
            self._trace.received(b"%03x %s" % (number, data.hex().encode()))
        node, what = number >> 5, number & 31
        if node not in self._ids:
            return
        axis = self._ids.index(node)
        with contextlib.suppress(ValueError):
            if what == can_.HEARTBEAT:
                self._error[axis], self._state[axis] = can_.heartbeat(data)
                self._heard[axis] = self._clock()
            elif what in (can_.ESTIMATES, can_.CURRENTS, can_.SUPPLY):
                values = can_.unpack(what, data)
                if all(math.isfinite(value) for value in values):
                    self._found[axis, what] = values


def _opened(bus: str) -> Any:
    """Open a bus of python-can.

    Raises
    ------
    ServoError
        If the package is missing, or there is no such bus.
    """
    try:
        import can
    except ImportError as error:
        raise ServoError("ODrive servos need a package more: pip install 'itouch-py[odrive]'") from error
    interface, _, channel = bus.partition(":")
    if not channel:
        raise ServoError(f"bus = '{bus}' must be INTERFACE:CHANNEL, such as socketcan:can0 or slcan:/dev/ttyACM0")
    more: dict[str, Any] = {"bitrate": _BITRATE, "sleep_after_open": 0.05} if interface == "slcan" else {}
    try:
        return can.Bus(interface=interface, channel=channel, **more)
    except (can.CanError, OSError, ValueError, NotImplementedError) as error:
        raise ServoError(f"the servos' bus '{bus}' cannot be opened: {error}") from error
