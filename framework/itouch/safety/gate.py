"""What passes between the loop and one device: readings are checked, commands limited; the only caller of ``write``."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from itouch.exchange import failed_in
from itouch.joining import is_newest
from itouch.monitors import LOSSES, DeviceFaultError, Heat, Push, Readings, Trip, TripError
from itouch.monitors.default_limits import TIMELY
from itouch.plugin import Bound, Channel, Device, DeviceError, Record, Role, Twin
from itouch.plugin.bound import bound_by
from itouch.plugin.device import is_new
from itouch.plugin.stamps import Stamped
from itouch.safety import limiting, monitor_step
from itouch.safety.departures import Departures
from itouch.safety.device_monitors import DeviceMonitors, InstalledMonitor
from itouch.safety.guard import ANYWHERE, Guard
from itouch.safety.latch import CLOSED, ENABLED, FAULT, Latch
from itouch.schema.diagnostics import spoken
from itouch.schema.plugin_errors import error_text, failing
from itouch.world import DeviceModel
from itouch.world import limits as default

#: Values of ``Gate.stopped``.
HELD, BACKWARDS = 1, 2


class SharedFinger(Protocol):
    """A finger on which several plates act."""

    @property
    def plates(self) -> Sequence[InstalledMonitor]:
        """The monitors of its plates."""

    def spent(self) -> str:
        """Return the words for a budget of the finger that is used up; empty: none is."""


class Gate:
    """Stands between the loop and one device, or its twin, on its part of State."""

    def __init__(
        self, model: DeviceModel, state: Record, period: float, *, device: Device | None = None,
        twin: Twin | None = None,
    ) -> None:  # fmt: skip
        self.model, self._period = model, period
        self.device, self._twin = device, twin
        #: 1 once the twin was replaced by another one, so that what was compiled for the first is not used, shape (1,).
        self.replaced = np.zeros(1, np.int64)
        name = model.name
        #: What the device may do now: unless it is enabled, only safe commands pass.
        self.latch = Latch(state, name)
        self.reading = _part(state, f"{name}.", model.reads)
        self.command = _part(state, f"{name}.command.", model.commands)
        self.sent = _part(state, f"{name}.sent.", model.commands)
        has_twin_state = twin is not None and any(n.startswith(f"{name}.twin.") for n in state)
        self.twin_state = state.part(f"{name}.twin.") if has_twin_state else Record(np.dtype([]))
        self._ramp, self._age, self._sequence = (state[f"{name}.{field}"] for field in ("ramp", "age", "sequence"))
        self._measured, self._left = state[f"{name}.measured"], state.get(f"{name}.left")
        self._out = _part(state, f"{name}.out.", model.commands) if self._left is not None else self.sent
        #: How a surface retracts (None: it can't): 0, as it should; HELD where it is, because it came nearer when told
        #: to retract; BACKWARDS, because it still pressed when it was held.
        self.stopped = state.get(f"{name}.stopped")
        #: Height to which a surface was sent when all stopped, and the lowest and highest one to which its safe command
        #: may lead [m], shape (3,); NaN: not known, or as far as it travels.
        self.way = state.get(f"{name}.way")
        # A reading over a wire may come in any tick, depending on when an exchange began.
        self._every = max(1, round(model.cls.period / period)) if self._left is None else 1
        pose = next((channel for channel in model.reads if channel.role is Role.TRACKED_POSE), None)
        self._pose = pose.name if pose is not None else None
        self._tick = state["tick"]
        #: The monitors in force.
        self.device_monitors = DeviceMonitors(model, state, self.reading, self.sent, period)
        #: The monitors of its plates.
        self.heats = [post for post in self.device_monitors.installed if isinstance(post.monitor, Heat)]
        #: Whether it presses by a fluid, and measures the force.
        self.presses = any(isinstance(post.monitor, Push) for post in self.device_monitors.installed)
        #: Whether its last command could not be written: the one before may still act.
        self.unsent = False
        #: What went wrong with it the last time that a stop met an error of it, in words.
        self.trouble = ""
        #: The fingers on which other plates act, too, and which therefore share a budget among them.
        self.shared: list[SharedFinger] = []
        #: How many limits were applied, and how many locked components dropped, shape (1,).
        self.clamped, self.dropped = (state[f"{model.name}.{field}"].reshape(1) for field in ("clamped", "dropped"))
        self.guards = [(channel.name, Guard(channel, model.limits)) for channel in model.commands]
        #: The commands that hold or retract: their safe value begins at the one that was sent last.
        self._relative = [channel for channel in model.commands if not isinstance(channel.safe, tuple)]
        #: Whether that one is true of the device as it is now.
        self._known = device is None or not self._relative
        #: What is set anew in each tick: share, closing speed, room.
        self.moving = limiting.TickLimits.of()
        forces = max(1, sum(channel.role is Role.FORCE_ON_OPERATOR for channel in model.commands))
        counts = self.clamped, self.dropped, period, forces
        self._lanes = [
            (guard, guard.bound(self.moving, self.command[name], self.sent[name], *counts))
            for name, guard in self.guards
        ]
        self._growth = period / (model.limits.ramp or default.RAMP)
        #: Reduces this arm's force to what the others on the same finger leave, just before its command is limited.
        self.leave_room: Callable[[], None] | None = None
        #: Keep the last command instead of the safe one: a plate that is being taken from the finger keeps its drive.
        self.keeping = False
        #: Numbers of the readings that must be recent for the supervision, where the wire tells when each was measured.
        source: object = device if twin is None else twin
        self._timely = [i for i, c in enumerate(model.reads) if c.role in TIMELY] if isinstance(source, Stamped) else []
        #: Behind a wire: where the commands that have left have sent a surface.
        self.departures = Departures(model, state, self._out)
        #: How much more time [s] has passed since the reading before than ticks say, shape (1,): in real time a tick
        #: may begin late or be held up, and hardware goes on meanwhile.
        self.slip = np.zeros(1)
        #: Whether that is measured, by the host's clock, and when the last reading was taken.
        self.timed = False
        self._came = math.inf
        #: The copies that a driver fills in and is handed: it may keep them, or write to them whenever it likes.
        self._filled, self._handed = self.reading.copy(), self.sent.copy()
        #: 1 if a new reading was taken that is not checked yet, shape (1,).
        self._taken = np.zeros(1, np.int64)
        #: Called at the loss of an optional device, without which the session goes on; None: its loss stops everything.
        self.on_loss: Callable[[DeviceFaultError], None] | None = None

    @property
    def twin(self) -> Twin | None:
        """The twin that stands in for the device, if one does."""
        return self._twin

    @twin.setter
    def twin(self, other: Twin | None) -> None:
        self._twin = other
        self.replaced[0] = 1

    def reset(self) -> None:
        """Set what is remembered to its start."""
        if self.way is not None:
            self.way[:] = math.nan
        self.device_monitors.reset()

    def restore(self) -> None:
        """Go on from a State that was restored."""
        self.latch.recall()
        self.device_monitors.restore()

    def forget(self) -> None:
        """Drop what was read before: it tells nothing about the device as it is now."""
        self.device_monitors.forget()
        self._age[...] = 0
        self._sequence[...] = 0
        if self.stopped is not None and self.way is not None:
            self.stopped[...], self.way[:] = 0, math.nan

    def opened(self) -> None:
        """Drop what was read before, and what was sent: the device may stand elsewhere since it was opened."""
        self.forget()
        self._known = self.device is None or not self._relative

    @property
    def heard(self) -> bool:
        """Whether a reading was checked since the device was opened."""
        return bool(self._sequence.item())

    def knows(self, reading: int, since: int) -> bool:
        """Tell whether the device is not CLOSED, and has measured reading number ``reading`` in this tick or later."""
        return self.latch.number != CLOSED and bool(self._measured[reading] >= since)

    def spent(self) -> str:
        """Return the words for a budget that is used up, of the device or of a finger on which others act; or none."""
        return next(
            (words for words in (self.device_monitors.spent(), *(one.spent() for one in self.shared)) if words), ""
        )

    def begin(self) -> None:
        """Begin from where the device stands, with the ramp that its limits ask for."""
        self.rest_at_measured()
        self._known = True
        self.device_monitors.begin()
        self._ramp[...] = 0.0 if self.model.limits.ramp > 0.0 else 1.0

    def rest_at_measured(self) -> None:
        """Begin each command at its safe value, or where the device stands."""
        for channel in self.model.commands:
            if isinstance(channel.safe, tuple):
                self.sent[channel.name] = channel.safe
            elif channel.role is Role.SURFACE_POSE and self._pose is not None:
                self.sent[channel.name] = self.reading[self._pose]
            self.command[channel.name] = self.sent[channel.name]

    def ramp_in(self) -> None:
        """Begin with a share of zero and let it grow, as after every re-arming."""
        self._ramp[...] = 0.0

    def rest_at_safe(self) -> None:
        """Set commands to their safe values, so that nothing that was requested before is ever sent again."""
        for channel in self.model.commands:
            if isinstance(channel.safe, tuple):
                self.command[channel.name] = self.sent[channel.name] = np.array(channel.safe)

    def read_anew(self, tick: int) -> None:
        """Take a reading as the first one, and check it.

        Raises
        ------
        TripError
            If it can't be believed, or the device failed; then the last one that was believed is put back.
        """
        self.forget()
        try:
            self._take()
            self.device_monitors.believe(tick, 0.0)
        except TripError:
            self.device_monitors.put_back()
            raise
        self._sequence[...] = 1

    @property
    def closing(self) -> float:
        """Greatest speed [m/s] at which a surface may approach the finger in this tick."""
        found: float = self.moving.closing[0].item()
        return found

    @closing.setter
    def closing(self, speed: float) -> None:
        self.moving.closing[0] = speed

    def read(self, tick: int) -> None:
        """Take the newest reading and check it.

        Raises
        ------
        DeviceFaultError
            If the device failed, was silent for too long, or reads something impossible or beyond a limit.
        """
        self.take(tick)
        self.watch_reading(tick)

    def take(self, tick: int) -> None:
        """Take the newest reading, if there is one; ``watch_reading`` must follow before anybody works with it.

        Raises
        ------
        DeviceFaultError
            If the device failed, or was silent for too long.
        """
        status = self.latch.number
        self._taken[0] = 0
        if status == CLOSED or (tick % self._every and self._sequence.item()):
            return
        try:
            new = self._take()
            self._taken[0] = new
            if new and self.timed:
                self._measure_slip()
            self._stamp(tick, new)
            if not new:
                self.wait(tick, status)
            elif status == ENABLED and self._timely:
                self._doubt_age(tick)
        except TripError as error:
            self._disbelieve(tick, error)

    def not_taken(self, error: BaseException, which: int, tick: int) -> None:
        """Act on an error of the twin's compiled reading; ``which`` of the calls it was makes no difference.

        Raises
        ------
        DeviceFaultError
            Always.
        """
        failed = TripError(Trip.DEVICE_ERROR, f"failed in read: {error_text(error)}")
        failed.__cause__ = error
        self._disbelieve(tick, failed)

    def _measure_slip(self) -> None:
        """Note how much more time has passed since the reading before than ticks say."""
        before, self._came = self._came, time.monotonic()
        passed = self._came - before - (self._age.item() + self._every) * self._period
        self.slip[0] = passed if 0.0 < passed < math.inf else 0.0

    def watch_reading(self, tick: int) -> None:
        """Check the reading that was taken in this tick, and ask the monitors whose turn it is.

        Raises
        ------
        DeviceFaultError
            If the device reads something impossible or beyond a limit.
        """
        status = self.latch.number
        if status == CLOSED:
            return
        try:
            if self._taken[0]:
                self._taken[0] = 0
                self.believe(tick, status)
            self.device_monitors.look(tick, self._age.item() * self._period)
        except TripError as error:
            self._disbelieve(tick, error)

    def look(self, tick: int) -> None:
        """Ask the monitors whose turn it is.

        Raises
        ------
        DeviceFaultError
            If a monitor trips.
        """
        try:
            self.device_monitors.look(tick, self._age.item() * self._period)
        except TripError as error:
            self._disbelieve(tick, error)

    def told(self, number: int, tick: int) -> None:
        """Act on what the compiled look of a monitor, by its number, has found, and ask the monitors after it.

        Raises
        ------
        DeviceFaultError
            If a monitor trips.
        """
        try:
            self.device_monitors.told_timed(number, tick, self._age.item() * self._period)
        except TripError as error:
            self._disbelieve(tick, error)

    def bound_take(self) -> tuple[Bound, ...]:
        """Return ``take`` as compiled calls, which leave a twin without a new reading to Python; none: Python's."""
        twin = self.twin
        if twin is None or isinstance(twin, Stamped) or not is_newest(type(twin), "bound_read", "read"):
            return ()
        with failing(f"device '{self.model.name}'", "the reading of its twin", self.model.place):
            sensed = bound_by(twin.bound_read, self.twin_state, self.reading)
        if not sensed:
            return ()
        due = Bound(
            monitor_step.due,
            self.latch.seen,
            self._sequence,
            self._tick,
            self._taken,
            self.replaced,
            CLOSED,
            self._every,
        )
        return due, *sensed, Bound(monitor_step.came, self._tick, self._measured, self._taken)

    def bound_watch(self) -> tuple[Bound, ...]:
        """Return ``watch_reading`` as compiled calls, which leave what is unusual to Python; none: all is Python's."""
        panel, post = self.device_monitors, self.device_monitors.readings
        turns = panel.turns()
        if post is None or not isinstance(post.monitor, Readings) or turns is None:
            return ()
        words, places = turns
        watched = monitor_step.Watched(
            self.latch.seen, self._taken, self._age, self._sequence, self.slip, *panel.clocks, post.checked, post.share,
            panel.due, self.reading.numbers, panel.seen.numbers, words, places,
        )  # fmt: skip
        rhythm = monitor_step.CheckSchedule(self._every, panel.apart, panel.clock, self._period)
        memory = post.monitor.memory(post.state)
        first = Bound(monitor_step.watch, watched, post.monitor.able, memory, rhythm, self._tick, CLOSED, FAULT)
        return first, *(self._bound_look(number, *one, rhythm) for number, one in enumerate(panel.heats))

    def _bound_look(self, number: int, post: InstalledMonitor, heat: Heat, rhythm: monitor_step.CheckSchedule) -> Bound:
        """Return the call that asks the monitor of a plate when it is its turn."""
        panel, touched = self.device_monitors, self.device_monitors.touching
        asked = monitor_step.Asked(post.checked, post.share, post.said, panel.due, touched)
        return Bound(
            monitor_step.ask, asked, panel.times, rhythm, self.latch.seen, self._tick, heat.stands, heat.allowed,
            heat.trust, heat.memory(post.state), heat.numbers(panel.seen), heat.numbers(self.sent), number, CLOSED,
        )  # fmt: skip

    def believe(self, tick: int, status: int) -> None:
        """Check the newest reading of a device of this status.

        Raises
        ------
        TripError
            If it reads something impossible or beyond a limit.
        """
        age, slip = self._age.item(), self.slip[0].item()
        self.slip[0] = 0.0
        if age:
            self._age[...] = 0
        self._sequence[...] = self._sequence.item() + 1
        if status == FAULT:
            self._keep_sane()
            self.device_monitors.take(tick)
            return
        self.device_monitors.believe(tick, (age + self._every) * self._period + slip)

    def watch_placed(self, tick: int) -> None:
        """Ask the monitors that need to know where the finger is.

        Raises
        ------
        DeviceFaultError
            Naming the limit and the value.
        """
        try:
            self.device_monitors.look_placed(tick)
        except TripError as error:
            raise DeviceFaultError(self.model.name, tick, error.trip, str(error)) from error

    def leave_out(self, ticks: int) -> None:
        """Count this many periods that were left out as time that has passed."""
        self.device_monitors.leave_out(ticks)

    def measured_at(self, role: Role) -> int:
        """Return the tick at which the newest reading of a role was measured, -1 if there is none."""
        when = self.measured_of(role)
        return int(when[0]) if when.size else -1

    def measured_of(self, role: Role) -> NDArray[np.int64]:
        """Return the view (1,) of State that has this tick, for compiled calls; (0,): no reading has the role."""
        index = next((i for i, channel in enumerate(self.model.reads) if channel.role is role), len(self.model.reads))
        return self._measured[index : index + 1]

    def _disbelieve(self, tick: int, error: TripError) -> None:
        self._keep_sane()
        if self.latch.number != FAULT:
            self._fail(DeviceFaultError(self.model.name, tick, error.trip, str(error)), error)

    def _stamp(self, tick: int, new: bool) -> None:
        """Note when the reading that has come was measured, and which command has left."""
        source: object = self.device if self.twin is None else self.twin
        if not isinstance(source, Stamped):
            if new:
                self._measured[...] = tick
            return
        if new:
            source.measured(self.twin_state, tick, self._measured)
        if self._left is not None:
            left = source.departed(self.twin_state, tick, self._out)
            if left is not None:
                self._left[...] = left
                self.departures.note(left)

    def strayed(self, distance: float) -> float:
        """Return how far [m] a surface was from its command when measured; ``distance``: from the newest command [m].

        Behind a wire the newest reading is older than the newest command: it is compared with the one that acted then.
        """
        goal = self.departures.acting(self.measured_at(Role.TRACKED_POSE))
        if goal is None or self._pose is None:
            return distance
        return math.dist(goal, self.reading[self._pose][:3].tolist())

    def _keep_sane(self) -> None:
        """Put the last believed reading back if the newest has numbers that mean nothing, so that nobody uses them."""
        if not self.device_monitors.sane():
            self.device_monitors.put_back()

    def _take(self) -> bool:
        """Read the twin or the device, and tell whether there was a new reading; whatever goes wrong is a trip."""
        try:
            twin, device = self.twin, self.device
            if twin is not None:
                return self._take_whole(lambda filled: twin.read(self.twin_state, filled))
            if device is not None:
                return self._take_whole(device.read)
        except DeviceError as error:
            raise TripError(Trip.DEVICE_ERROR, f"failed: {spoken(error)}") from error
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plugin that exits does not end the program
            raise TripError(
                Trip.DEVICE_ERROR, f"failed in {failed_in(self.device, 'read')}: {error_text(error)}"
            ) from error
        return False

    def _take_whole(self, read: Callable[[Record], object]) -> bool:
        """Read; nobody sees what a driver or a twin has filled in without telling that there is a new reading."""
        filled = self._filled
        filled.raw[:] = self.reading.raw
        new = is_new(read(filled))
        if new:
            self.reading.raw[:] = filled.raw
        return new

    def wait(self, tick: int, status: int) -> None:
        """Count the age of the last reading; an enabled device may not be silent for long (W1)."""
        age = self._age.item() + self._every
        self._age[...] = age
        if self._timely:
            age = max(age, self._oldest(tick))
        if status == ENABLED:
            self.device_monitors.wait(tick, age * self._period)

    def _doubt_age(self, tick: int) -> None:
        """Count the age of a new reading from when it was measured: a reading that comes late is no news (W1)."""
        age = self._oldest(tick)
        if age > 0:
            self.device_monitors.wait(tick, age * self._period)

    def _oldest(self, tick: int) -> int:
        """Return how many ticks ago the oldest of the readings that must be recent was measured."""
        return tick - min(int(self._measured[index]) for index in self._timely)

    def write(self, tick: int) -> None:
        """Limit the commands and send them; unless ENABLED, send safe ones.

        Raises
        ------
        DeviceFaultError
            If a command is not a number, or the device failed.
        """
        self.guard(tick)
        self.send(tick)

    def guard(self, tick: int) -> None:
        """Limit the commands to what may be sent; ``send`` passes that on to the device.

        Raises
        ------
        DeviceFaultError
            If a command is not a number.
        """
        status = self.latch.number
        if status == CLOSED:
            return
        if status != ENABLED:
            self._rest()
            return
        try:
            self._limit()
        except TripError as error:
            self._fail(DeviceFaultError(self.model.name, tick, error.trip, str(error)), error)

    def send(self, tick: int) -> None:
        """Write to the device what was let through.

        Raises
        ------
        DeviceFaultError
            If the device failed, or something has overwritten its status in State.
        """
        if self.device is None or self.latch.number == CLOSED:
            return
        try:
            if forged := self.latch.forged():
                if self.latch.number != FAULT:
                    raise TripError(Trip.MODALITY_ERROR, f"was stopped: {forged}")
                self._rest()  # compiled code may have followed the status that was written there
            self._put()
        except TripError as error:
            self._fail(DeviceFaultError(self.model.name, tick, error.trip, str(error)), error)

    def _limit(self) -> None:
        share = self._ramp.item()
        if share < 1.0:
            share = min(1.0, share + self._growth)
            self._ramp[...] = share
        moving = self.moving
        moving.share[0], moving.taken[0], moving.turned[0] = share * self.device_monitors.share, 0.0, 0.0
        if self.leave_room is not None:
            self.leave_room()
        for guard, lane in self._lanes:
            if lane():
                raise guard.refusal(self.command[guard.channel.name])

    def bound_guard(self) -> tuple[Bound, ...]:
        """Return ``guard`` as compiled calls, which leave a device that is not enabled to Python; none: Python's."""
        if self.leave_room is not None:
            return ()
        sizes = [channel.size for channel in self.model.commands]
        begin = Bound(
            limiting.begin, self.latch.seen, ENABLED, CLOSED, self.command.numbers, np.cumsum(sizes, dtype=np.int64),
            self._ramp, self.device_monitors.left, self.moving, self._growth,
        )  # fmt: skip
        return (begin, *(lane for _, lane in self._lanes))

    def send_safe(self) -> None:
        """Send the safe command of every channel.

        Raises
        ------
        TripError
            If the device failed.
        """
        self._rest()
        self._put()

    def _rest(self) -> None:
        """Write the safe command of every channel, unless the last one is kept or nothing is known to begin at."""
        if not self._known and not self._begins_here():
            return
        stopped = self.stopped.item() if self.stopped is not None else 0
        if not self.keeping and stopped != HELD:
            ends = ANYWHERE if self.way is None else (self.way[1].item(), self.way[2].item())
            for name, guard in self.guards:
                guard.safe(self.sent[name], self._period, backwards=stopped == BACKWARDS, ends=ends)

    def _begins_here(self) -> bool:
        """Let what holds or retracts begin where the device stands; tell whether that is known."""
        pose = self._pose
        if pose is None or not self.heard or any(one.role is not Role.SURFACE_POSE for one in self._relative):
            return False
        for channel in self._relative:
            self.sent[channel.name] = self.reading[pose]
        self._known = True
        return True

    def _put(self) -> None:
        """Pass what was let through on to the device: the only call of its ``write``.

        A device that holds or retracts, and of which nothing is known yet, was told nothing and is left where it is.
        """
        if self.device is None or not self._known:
            return
        self.unsent = True
        try:
            self._handed.raw[:] = self.sent.raw
            self.device.write(self._handed)
            self.unsent = False
        except DeviceError as error:
            raise TripError(Trip.DEVICE_ERROR, f"failed: {spoken(error)}") from error
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plugin that exits does not end the program
            raise TripError(Trip.DEVICE_ERROR, f"failed in write: {error_text(error)}") from error

    def _fail(self, fault: DeviceFaultError, error: TripError) -> None:
        """Stop because of a fault: all devices, unless this one is optional and merely lost."""
        if self.latch.number == FAULT:
            return
        if self.on_loss is not None and fault.trip in LOSSES:
            self.fault(fault.trip, fault.tick)
            self.on_loss(fault)
            return
        raise fault from error

    def fault(self, trip: Trip, tick: int) -> None:
        """Latch a trip and make the device safe now; what the device raises meanwhile is dropped."""
        self.latch.stop(trip, tick)
        self._ramp[...] = 0.0
        with contextlib.suppress(TripError):  # the device is lost; the others must still be made safe
            self.send_safe()

    def verify(self, tick: int) -> bool:
        """Take the newest reading to verify that the device is safe; tell whether it answered.

        A reading that can't be believed is a fault of its own here: it is latched, but nothing is raised.
        """
        status, answered = self.latch.number, False
        try:
            answered = status != CLOSED and self._take()
            self._stamp(tick, answered)
            if answered and self.timed:
                self._measure_slip()
            if answered and status != FAULT:
                slip, self.slip[0] = self.slip[0].item(), 0.0
                self.device_monitors.believe(tick, self._every * self._period + slip)
        except TripError as error:
            if status != FAULT:
                self.trouble = str(error)
                self.fault(error.trip, tick)
        if not self.device_monitors.sane():
            self.device_monitors.mend()
        return answered


def _part(state: Record, prefix: str, channels: Sequence[Channel]) -> Record:
    names = [channel.name for channel in channels]
    return state.part(prefix, names) if names else Record(np.dtype([]))
