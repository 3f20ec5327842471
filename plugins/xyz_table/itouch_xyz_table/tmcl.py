"""Three steppers on a TMCL module: as `servos.Servos`, in frames of nine bytes over a serial port.

The module's own ramp generator moves each motor to the newest goal; the module counts microsteps and measures nothing:
neither a force nor lost steps.  Its heartbeat stops all motors when the host is silent; this is tested when the table
is opened.

The frames are built here.  Trinamic's own library (PyTrinamic) installs packages called ``tests``, ``docs`` and
``examples`` beside itself, depends on three more, and goes out of step with the frames after a lost byte.

An answer tells neither the parameter nor the motor that it is about, and one may come late or twice.  The module
answers in order, so requests that must not be confused are followed by one of another kind: if this is answered next,
and nothing was left over, each answer was that to its request.
"""

from __future__ import annotations

import contextlib
import errno
import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from itouch.plugin import DeviceError, Trace
from itouch.plugin.wire_claims import share
from itouch_xyz_table import tmclframes as tm
from itouch_xyz_table.faults import POSITION
from itouch_xyz_table.servos import AXES, Goal, ServoError, ServoState

#: Longest wait for an answer [s], and how often it is asked for; time [s] without a byte after which a line is quiet.
PATIENCE, TRIES, QUIET = 0.05, 8, 5e-3
#: The test of the heartbeat: greatest distance that a motor may turn without requests [m], and its speed [m/s].
TRIED, SLOWLY = 5e-4, 2e-3
#: By how much longer it is at most where time is simulated: a simulated module stops late on a busy machine.
LONGER = 6.0
#: How long the way back may take [s].
BACK = 1.0
#: Speeds of the search for an end and of leaving its switch [m/s], and time allowed beyond that of the travel [s].
SEARCH, LEAVE, GRACE = 0.02, 0.005, 3.0
#: An axis farther [m] than this beyond twice what its greatest speed allows has another zero.
FURTHER = 2e-3
_POLL = 2e-3
#: Most bytes of a line that are dropped at once.
_PIECE = 256
T = TypeVar("T")


class Steppers:
    """An open module.

    Parameters
    ----------
    port
        Serial port of the module, or its USB port.
    baud
        Speed of the port.
    address
        The module's address on the line.
    motors
        The module's numbers for the motors of x, y and z.
    microsteps
        Microsteps per turn of each motor.
    leads
        Travel per turn [m], with sign.
    speed, acceleration
        Greatest speed and acceleration of an axis [m/s, m/s2].
    watchdog
        Seconds of silence after which the module stops all motors; None: it has no heartbeat and does not stop.
    patience
        Factor on every waiting time for an answer.
    """

    def __init__(
        self,
        port: str,
        *,
        baud: int,
        address: int,
        motors: Sequence[int],
        microsteps: Sequence[float],
        leads: Sequence[float],
        speed: float,
        acceleration: float,
        watchdog: float | None,
        patience: float = 1.0,
        trace: Trace | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._address, self._motors, self._microsteps = address, list(motors), list(microsteps)
        self._leads, self._speed, self._acceleration = list(leads), speed, acceleration
        self._watchdog, self._patience, self._trace, self._clock = watchdog, patience, trace, clock
        #: Number of requests repeated because a frame was lost or damaged.
        self.repeated = 0
        #: Whether a late answer that is no longer waited for may still arrive.
        self._owing = False
        #: The last answer; whether an answer of the requests since `_surely` began may be that to another one of them;
        #: and how long the line must be quiet before each of these [s].
        self._latest, self._crossed, self._quiet = b"", False, 0.0
        #: Another host that the module has answered, or -1; and whether the module last reported a damaged request.
        self._other, self._garbled = -1, False
        #: The status with which the module answers when it is asked for its heartbeat; 0: not known yet.
        self._tells = 0
        self._driven, self._count = False, 0
        self._limits: list[int] = [0] * len(self._motors)
        self._last: list[tuple[float, float]] = []
        self._port, self._serial = port, _opened(port, baud)
        try:
            self._settle()
            self.stop()
            self._limit()
            self._arm()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Release the port; the module's heartbeat stops the motors."""
        with contextlib.suppress(Exception):
            self._serial.close()

    # --- the interface `Drives` -----------------------------------------------------------------------------------

    def query(self) -> tuple[ServoState, ...]:
        """Read the positions of all motors.

        Raises
        ------
        ServoError
            If the module does not answer, or has restarted.
        """
        states, _ = self._read()
        return states

    def command(self, goals: Sequence[Goal | None]) -> tuple[ServoState, ...]:
        """Read all positions, check that the module has not restarted, then command the motors that have a goal."""
        self._driven = True
        states, beats = self._read()
        self._watch(beats)
        for axis, goal in enumerate(goals):
            if goal is not None:
                self._go(axis, goal)
        return states

    def stop(self, *, latched: bool = False) -> tuple[ServoState, ...]:
        """Stop all motors; they hold their positions.

        Raises
        ------
        ServoError
            If a motor does not accept the stop; the others have been stopped all the same.
        """
        self._driven, self._last = False, []
        self._surely(self._halt)
        return self.query()

    def _halt(self) -> None:
        failed = list[ServoError]()
        for axis in range(len(self._motors)):
            try:
                if self._owing:  # what is asked first to hear late answers out may never be answered; this must leave
                    self._send(tm.request(tm.Request(self._address, tm.STOP, 0, self._motors[axis], 0)))
                self._ask(axis, tm.STOP)
            except ServoError as error:
                failed.append(error)
        if failed:
            raise ServoError("; ".join(map(str, failed))) from failed[0]

    def set_position(self, axis: int, position: float) -> None:
        """Tell the module that a motor is at ``position`` [rev]."""
        self._last = []
        steps = self._steps(axis, position)
        for parameter in (tm.TARGET, tm.ACTUAL):  # the two must not differ at any moment, or a ramp would begin
            self._ask(axis, tm.STOP)
            self._ask(axis, tm.SET_AXIS, parameter, steps)

    def ready(self) -> None:
        """Test the heartbeat: a motor that turns while the host is silent must stop.

        Raises
        ------
        ServoError
            If it does not stop, or does not come back.
        """
        with self._stopped_after_failure():
            self._try_out()

    @contextlib.contextmanager
    def _stopped_after_failure(self) -> Iterator[None]:
        """Stop all motors if the body raises: there may be no heartbeat to stop what it has started."""
        try:
            yield
        except BaseException:
            with contextlib.suppress(ServoError):
                self.stop()
            raise

    def _try_out(self) -> None:
        """Let one motor turn in silence, check that it has stopped, and bring it back."""
        axis, began = 0, self.query()[0].position
        if self._watchdog is None:
            self._hold(axis, began)
            return
        lead = self._leads[axis]
        away = self._microsteps[axis] * SLOWLY / abs(lead)
        # Towards the middle of the travel: a homed axis is at its low end.
        right = (began * lead < 0.0) == (lead > 0.0)
        self._ask(axis, tm.ROTATE_RIGHT if right else tm.ROTATE_LEFT, value=max(1, round(away)))
        end = self._clock() + TRIED / SLOWLY * min(max(1.0, self._patience / 5.0), LONGER)
        while self._clock() < end:
            time.sleep(_POLL)
        speed = self._ask(axis, tm.GET_AXIS, tm.ACTUAL_SPEED)
        self.stop()
        if speed:
            raise ServoError(
                f"motor {AXES[axis]} keeps turning without a request for {TRIED / SLOWLY:g} s: the module's heartbeat "
                f"(global parameter {tm.HEARTBEAT}) does not stop it, so nothing would if this program died"
            )
        self._hold(axis, began)
        end = self._clock() + BACK * max(1.0, self._patience)
        while self._ask(axis, tm.GET_AXIS, tm.ACTUAL) != self._steps(axis, began):
            if self._clock() > end:
                raise ServoError(f"motor {AXES[axis]} does not go where it is told")
            time.sleep(_POLL)
        self._last = []

    def _hold(self, axis: int, place: float) -> None:
        """Let each motor hold its position; motor ``axis``, which has turned, goes back to ``place`` [rev]."""
        self._driven = True
        for one, state in enumerate(self.query()):
            self._ask(one, tm.MOVE, tm.ABSOLUTE, self._steps(one, place if one == axis else state.position))

    # --- homing --------------------------------------------------------------------------------------------------

    def search(self, travel: Sequence[float], low: Sequence[float]) -> None:
        """Find the low end of z, then of x and y, with the module's own search for the end switch.

        Parameters
        ----------
        travel, low
            Length of each axis, and position of its low end [m].

        Raises
        ------
        ServoError
            If an axis does not find its switch.
        """
        with self._stopped_after_failure():
            self._search(travel, low)

    def _search(self, travel: Sequence[float], low: Sequence[float]) -> None:
        for axis in (2, 0, 1):
            lead = self._leads[axis]
            turn = self._microsteps[axis] / abs(lead)
            self._ask(axis, tm.SET_AXIS, tm.SEARCH_MODE, tm.LEFT_SWITCH + (tm.RIGHT_INSTEAD if lead < 0.0 else 0))
            self._ask(axis, tm.SET_AXIS, tm.SEARCH_SPEED, max(1, round(SEARCH * turn)))
            self._ask(axis, tm.SET_AXIS, tm.SWITCH_SPEED, max(1, round(LEAVE * turn)))
            self._ask(axis, tm.SEARCH, tm.SEARCH_START)
            self._owing = True  # the same answer once more would be taken for the end of the search
            end = self._clock() + travel[axis] / SEARCH + GRACE
            while self._ask(axis, tm.SEARCH, tm.SEARCH_STATUS):
                if self._clock() > end:
                    self._ask(axis, tm.SEARCH, tm.SEARCH_STOP)
                    raise ServoError(f"axis {AXES[axis]} found no end switch: check its lead, direction and switch")
                time.sleep(_POLL)
            self.set_position(axis, low[axis] / lead)

    # --- the module ----------------------------------------------------------------------------------------------

    def _limit(self) -> None:
        """Set each motor's greatest speed and acceleration, and check that the module accepts them.

        Raises
        ------
        ServoError
            If the module refuses them, or keeps other values.
        """
        for axis, lead in enumerate(self._leads):
            turn = self._microsteps[axis] / abs(lead)
            wanted = {
                tm.MAX_SPEED: max(1, round(self._speed * turn)),
                tm.MAX_ACCELERATION: max(1, round(self._acceleration * turn)),
            }
            for parameter, value in wanted.items():
                if value >= 1 << 31:
                    raise ServoError(
                        f"motor {AXES[axis]}: {value} microsteps a second (squared) are needed, which no module "
                        "accepts: reduce speed, acceleration or the microsteps"
                    )
                try:
                    self._ask(axis, tm.SET_AXIS, parameter, value)
                    found = self._ask(axis, tm.GET_AXIS, parameter)
                except ServoError as error:
                    raise ServoError(
                        f"{error}; {value} microsteps a second (squared) are needed: reduce speed, acceleration or "
                        "the microsteps, or the module counts in other units and cannot be used"
                    ) from error
                if abs(found - value) > 0.02 * value:
                    raise ServoError(
                        f"motor {AXES[axis]} keeps parameter {parameter} at {found} where {value} was written: reduce "
                        "speed, acceleration or the microsteps"
                    )
            self._limits[axis] = wanted[tm.MAX_SPEED]

    def _arm(self) -> None:
        """Set the module's heartbeat, and check that the module keeps it.

        Raises
        ------
        ServoError
            If the module has no heartbeat.
        """
        if self._watchdog is None:
            return
        advice = (
            "a module without it would go on if this program died; "
            'heartbeat="no" lets it run with the guardian and hold-to-run only'
        )
        try:
            self._ask(0, tm.SET_GLOBAL, tm.HEARTBEAT, round(1e3 * self._watchdog), bank=0)
            found = self._ask(0, tm.GET_GLOBAL, tm.HEARTBEAT, bank=0)
        except ServoError as error:
            raise ServoError(f"the module's heartbeat cannot be set: {error}; {advice}") from error
        if found != round(1e3 * self._watchdog):
            raise ServoError(f"the module keeps its heartbeat at {found} ms: {advice}")

    def _watch(self, beats: int) -> None:
        """Check what a restarted module has forgotten: its heartbeat, and each motor's speed limit in turn.

        ``beats`` [ms] is its heartbeat.

        Raises
        ------
        ServoError
            If it has forgotten them.
        """
        turn = self._count % len(self._motors)
        self._count += 1
        if self._watchdog is not None and beats != round(1e3 * self._watchdog):
            raise self._anew()
        if abs(self._ask(turn, tm.GET_AXIS, tm.MAX_SPEED) - self._limits[turn]) > 0.02 * self._limits[turn]:
            raise self._anew()

    @staticmethod
    def _anew() -> ServoError:
        return ServoError(
            "the module has restarted: its limits and the positions of its motors are lost; check its supply, then "
            "connect it again"
        )

    def _go(self, axis: int, goal: Goal) -> None:
        self._ask(axis, tm.MOVE, tm.ABSOLUTE, self._steps(axis, goal.position))

    def _read(self) -> tuple[tuple[ServoState, ...], int]:
        """Return the states of all motors, and the module's heartbeat [ms]."""
        found, beats = self._surely(
            lambda: [(self._ask(axis, tm.GET_AXIS, tm.ACTUAL), self._clock()) for axis in range(len(self._motors))]
        )
        return tuple(self._place(axis, steps, now) for axis, (steps, now) in enumerate(found)), beats

    def _place(self, axis: int, steps: int, now: float) -> ServoState:
        place = steps / self._microsteps[axis]
        if len(self._last) == len(self._motors):
            before, when = self._last[axis]
            lead = abs(self._leads[axis])
            if abs(place - before) * lead > FURTHER + 2.0 * self._speed * (now - when):
                raise self._anew()
            self._last[axis] = place, now
        elif axis == len(self._last):
            self._last.append((place, now))
        else:
            self._last = []
        return ServoState(POSITION if self._driven else 0, place, math.nan, math.nan, math.nan, math.nan, 0)

    def _steps(self, axis: int, position: float) -> int:
        if not math.isfinite(position):
            raise ServoError(f"motor {AXES[axis]} cannot go to {position}")
        return round(position * self._microsteps[axis])

    def _surely(self, requests: Callable[[], T]) -> tuple[T, int]:
        """Make requests until each answer is surely its own; return what they return, and the module's heartbeat [ms].

        Raises
        ------
        ServoError
            If answers never come once each, or as the requests do.
        """
        self._quiet = 0.0
        for turn in range(TRIES):
            self._crossed = False
            found = requests()
            beats = self._catch_up()
            if beats is not None and not self._crossed:
                self._quiet = 0.0
                return found, beats
            self.repeated += 1
            self._quiet = QUIET * 2**turn
        self._quiet = 0.0
        raise ServoError(
            f"the answers of module {self._address} on {self._port} do not come once each: check its cable and adaptor"
        )

    def _ask(self, axis: int, command: int, kind: int = 0, value: int = 0, *, bank: int | None = None) -> int:
        """Send a request until a valid answer comes, and return its value.

        Every request may be sent twice: it states a goal, not a change.

        Raises
        ------
        ServoError
            If no valid answer comes, or the module refuses.
        """
        asked = tm.Request(self._address, command, kind, self._motors[axis] if bank is None else bank, value)
        self._other, self._garbled = -1, False
        for turn in range(TRIES):
            self.repeated += turn > 0
            if turn or self._quiet:
                self._settle()
            if self._owing and self._catch_up() is None:
                continue
            said = self._exchange(tm.request(asked))
            self._garbled = said is not None and said.status == tm.WRONG_SUM
            if said is None or self._garbled:
                continue
            if said.command != command:
                self._crossed = self._owing = True
                continue
            if said.status != tm.OK:  # nor LOADED: a command stored in a program is not executed
                what = f"motor {AXES[axis]}" if bank is None else "the module"
                raise self._refusal(what, command, kind, value, said.status)
            return said.value
        raise ServoError(f"motor {AXES[axis]} (module {self._address}) {self._unheard()}")

    @staticmethod
    def _refusal(what: str, command: int, kind: int, value: int, status: int) -> ServoError:
        why = tm.STATUS.get(status, f"status {status}")
        return ServoError(f"{what} refuses command {command}, type {kind}, value {value}: {why}")

    def _unheard(self) -> str:
        """Return what is wrong with a module that gives no valid answer, and what to do."""
        if self._garbled:
            return "says that requests reach it damaged: check its cable, and the line's speed (baud)"
        if self._other >= 0:
            return (
                f"answers to host {self._other} only: set its global parameter {tm.HOST_ADDRESS} to {tm.HOST} with the "
                "maker's program"
            )
        return "does not answer: check its cable, supply and address"

    def _exchange(self, frame: bytes) -> tm.Answer | None:
        """Send a request and return the answer if it comes in time; None if none does, or if a frame is damaged.

        Answers of other modules and answers to other hosts are skipped.  A damaged frame ends the wait at once, as the
        start of the next frame is then unknown.
        """
        self._send(frame)
        end = self._clock() + PATIENCE * self._patience
        while data := self._receive(end):
            if data == frame:  # an adaptor's echo: no answer equals a request
                continue
            said = tm.told(data)
            if said is not None and data == self._latest and said.command != frame[1]:  # the last one once more
                continue
            if said is None or self._mine(said):
                self._latest = data
                return said
        self._owing = True
        return None

    def _mine(self, said: tm.Answer) -> bool:
        """Tell whether an answer is from our module and to this host, not to requests of another host."""
        if said.module == self._address and said.host != tm.HOST:
            self._other = said.host
        return said.module == self._address and said.host == tm.HOST

    def _catch_up(self) -> int | None:
        """Drop late answers; return the module's heartbeat [ms] if none can be outstanding any more.

        An answer does not say which parameter or motor it is about, so a late one would be taken for that to the next
        request: one axis's position for another's.  The module answers its requests in order; once it has answered a
        request of another kind, no older answer is outstanding.
        """
        asked = tm.request(tm.Request(self._address, tm.GET_GLOBAL, tm.HEARTBEAT, 0, 0))
        self._send(asked)
        end = self._clock() + PATIENCE * self._patience
        while data := self._receive(end):
            said = tm.told(data) if data != asked else None
            if said is not None and self._mine(said) and said.command == tm.GET_GLOBAL:
                self._garbled = said.status == tm.WRONG_SUM
                if self._garbled:
                    return None
                self._owing, self._latest = False, data
                self._known(said.status)
                return said.value
            self._pass_over(data)
        return None

    def _known(self, status: int) -> None:
        """Check that a module without a heartbeat goes on refusing to tell it, and that one with a heartbeat tells it.

        Raises
        ------
        ServoError
            If it once tells its heartbeat and once refuses.
        """
        self._tells = self._tells or status
        if status != self._tells:
            raise self._refusal(
                "the module", tm.GET_GLOBAL, tm.HEARTBEAT, 0, self._tells if status == tm.OK else status
            )

    def _pass_over(self, data: bytes) -> None:
        """Note what was left over: a copy of the last answer does no harm, another answer is one to some request."""
        for at in range(0, len(data), tm.SIZE):
            frame = data[at : at + tm.SIZE]
            said = tm.told(frame)
            if said is not None and frame != self._latest and self._mine(said):
                self._crossed = self._owing = True

    def _failed(self, error: OSError) -> ServoError:
        return ServoError(f"the module's port {self._port} failed: {error}; check its plug")

    def _send(self, frame: bytes) -> None:
        if self._trace is not None:
            self._trace.sent(frame.hex().encode())
        self._drop()
        try:
            self._serial.write(frame)
        except OSError as error:
            raise self._failed(error) from error

    def _drop(self) -> None:
        """Drop what has arrived before a request: it cannot be the answer."""
        piece = bytearray(_PIECE)
        try:
            data = bytes(piece[: self._serial.readinto(piece, timeout=0.0)])
        except OSError as error:
            raise self._failed(error) from error
        if data and self._trace is not None:
            self._trace.received(data.hex().encode())
        self._crossed |= len(data) % tm.SIZE > 0
        self._pass_over(data)

    def _receive(self, end: float) -> bytes:
        """Return the bytes of a frame, or those that have arrived by a time [s]."""
        data = b""
        try:
            while len(data) < tm.SIZE and self._clock() < end:
                data += self._serial.read(tm.SIZE - len(data))
        except OSError as error:
            raise self._failed(error) from error
        if data and self._trace is not None:
            self._trace.received(data.hex().encode())
        return data

    def _settle(self) -> None:
        """Wait until the line is quiet and drop the bytes that arrive: frames have no start mark."""
        dropped = b""
        try:
            end, quiet = self._clock() + PATIENCE * self._patience, self._clock()
            while self._clock() - quiet < max(QUIET, self._quiet) and self._clock() < end:
                if data := self._serial.read(_PIECE):
                    dropped, quiet = dropped + data, self._clock()
        except OSError as error:
            raise self._failed(error) from error
        self._pass_over(dropped)


def _opened(port: str, baud: int) -> Any:
    """Open a serial port.

    Raises
    ------
    ServoError
        If the package is missing, or the port cannot be opened.
    """
    try:
        import serialx
    except ImportError as error:
        raise ServoError("a TMCL module needs another package: pip install 'itouch-py[tmcl]'") from error
    try:
        line: Any = serialx.serial_for_url(port, baud, read_timeout=_POLL, write_timeout=0.5, exclusive=False)
        line.open()
    except (OSError, ValueError, serialx.SerialException) as error:
        busy = "; another program has it, end that first" if getattr(error, "errno", 0) == errno.EBUSY else ""
        raise ServoError(f"the module's port {port} cannot be opened: {error}{busy}") from error
    if "://" not in port:
        try:
            share(line.fileno(), port)
        except DeviceError as error:
            line.close()
            raise ServoError(f"the module's port {error}") from error
    return line
