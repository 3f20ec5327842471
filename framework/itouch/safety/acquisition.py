"""The way in through a gate: the newest reading of a device is taken, stamped with its age, and checked.

A reading counts only once the device's monitors believe it.  Until then, and if they do not, the last one that was
believed stands in State.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from itouch.exchange import failed_in
from itouch.joining import is_newest
from itouch.monitors import DeviceFaultError, Heat, Readings, Trip, TripError
from itouch.monitors.default_limits import TIMELY
from itouch.plugin import Bound, Device, DeviceError, Record, Role
from itouch.plugin.bound import bound_by
from itouch.plugin.device import is_new
from itouch.plugin.timestamps import Timestamped
from itouch.safety import monitor_step
from itouch.safety.departures import Departures
from itouch.safety.device_link import DeviceLink, part
from itouch.safety.device_monitors import DeviceMonitors, InstalledMonitor
from itouch.safety.latch import CLOSED, ENABLED, FAULT
from itouch.schema.diagnostics import spoken
from itouch.schema.plugin_errors import error_text, failing

#: How often [s] hardware is asked that has no recent reading while nothing ticks.
_POLL = 1e-3


class Acquisition:
    """Takes the readings of one device, or of its twin, into its part of State.

    ``fail`` is called, with the tick, for whatever trips; it raises unless the device was at fault before.
    """

    def __init__(
        self, link: DeviceLink, state: Record, period: float, reading: Record, sent: Record,
        fail: Callable[[TripError, int], None],
    ) -> None:  # fmt: skip
        self._link, self._period, self.reading, self._fail = link, period, reading, fail
        model = link.model
        self._age, self._sequence = (state[f"{model.name}.{field}"] for field in ("age", "sequence"))
        self._measured, self._left = state[f"{model.name}.measured"], state.get(f"{model.name}.left")
        self._out = part(state, f"{model.name}.out.", model.commands) if self._left is not None else sent
        # A reading over a wire may come in any tick, depending on when an exchange began.
        self._every = max(1, round(model.cls.period / period)) if self._left is None else 1
        pose = next((channel for channel in model.reads if channel.role is Role.TRACKED_POSE), None)
        #: Name of the reading that tells where the device stands, if there is one.
        self.pose = pose.name if pose is not None else None
        self._tick, self._sent = state["tick"], sent
        #: The monitors in force.
        self.device_monitors = DeviceMonitors(model, state, reading, sent, period)
        #: Numbers of the readings that must be recent for the supervision, where the wire tells when each was measured.
        stamped = isinstance(link.source, Timestamped)
        self._timely = [i for i, c in enumerate(model.reads) if c.role in TIMELY] if stamped else []
        #: Behind a wire: where the commands that have left have sent a surface.
        self.departures = Departures(model, state, self._out)
        #: How much more time [s] has passed since the reading before than ticks say, shape (1,): in real time a tick
        #: may begin late or be held up, and hardware goes on meanwhile.
        self.slip = np.zeros(1)
        #: Whether that is measured, by the host's clock, and when the last reading was taken.
        self.timed = False
        self._came = math.inf
        #: The copy that a driver fills in: it may keep it, or write to it whenever it likes.
        self._filled = reading.copy()
        #: 1 if a new reading was taken that is not checked yet, shape (1,).
        self._taken = np.zeros(1, np.int64)

    @property
    def heard(self) -> bool:
        """Whether a reading was checked since the device was opened."""
        return bool(self._sequence.item())

    def forget(self) -> None:
        """Drop what was read before: it tells nothing about the device as it is now."""
        self.device_monitors.forget()
        self._age[...] = 0
        self._sequence[...] = 0

    def read_anew(self, tick: int, until: float = 0.0) -> None:
        """Take a reading as the first one, and check it.

        Parameters
        ----------
        tick
            The number of the tick that comes next.
        until
            Time [host s] until which hardware that has nothing new is waited for.

        Raises
        ------
        TripError
            If it can't be believed or is too old, or the device failed; then the last one that was believed is put
            back.
        """
        try:
            self._take_recent(tick, until)
            self.device_monitors.believe(tick, 0.0)
        except TripError:
            self.device_monitors.put_back()
            raise
        self._sequence[...] = 1

    def _take_recent(self, tick: int, until: float) -> None:
        """Take a reading of hardware that is no older than it may be while enabled; of a twin, the one it has.

        Raises
        ------
        TripError
            If the device failed, or does not answer (W1).
        """
        new, device = self._take(), self._link.device
        while device is not None and self._link.model.reads:
            if new:
                self._came = time.monotonic()
            try:
                self.device_monitors.wait(tick, self._age_by_clock(device, tick, new))
            except TripError:
                if time.monotonic() > until:
                    raise
            else:
                return
            time.sleep(_POLL)
            new = self._take()

    def _age_by_clock(self, device: Device, tick: int, new: bool) -> float:
        """Return the age [s] of the newest reading of hardware, also while no ticks are run."""
        source: object = device
        if isinstance(source, Timestamped):
            source.measured(self._link.twin_state, tick, self._measured)
            return (self._oldest(tick) if self._timely else tick - int(self._measured.max())) * self._period
        return time.monotonic() - self._came if self.timed and not new else 0.0

    def take(self, tick: int) -> None:
        """Take the newest reading, if there is one; ``watch`` must follow before anybody works with it.

        Raises
        ------
        DeviceFaultError
            If the device failed, or was silent for too long.
        """
        status = self._link.latch.number
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

    def watch(self, tick: int) -> None:
        """Check the reading that was taken in this tick, and ask the monitors whose turn it is.

        Raises
        ------
        DeviceFaultError
            If the device reads something impossible or beyond a limit.
        """
        status = self._link.latch.number
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
        link, twin = self._link, self._link.twin
        if twin is None or isinstance(twin, Timestamped) or not is_newest(type(twin), "bound_read", "read"):
            return ()
        with failing(f"device '{link.model.name}'", "the reading of its twin", link.model.place):
            sensed = bound_by(twin.bound_read, link.twin_state, self.reading)
        if not sensed:
            return ()
        due = Bound(
            monitor_step.due,
            link.latch.seen,
            self._sequence,
            self._tick,
            self._taken,
            link.replaced,
            CLOSED,
            self._every,
        )
        return due, *sensed, Bound(monitor_step.came, self._tick, self._measured, self._taken)

    def bound_watch(self) -> tuple[Bound, ...]:
        """Return ``watch`` as compiled calls, which leave what is unusual to Python; none: all is Python's."""
        panel, post = self.device_monitors, self.device_monitors.readings
        turns = panel.turns()
        if post is None or not isinstance(post.monitor, Readings) or turns is None:
            return ()
        words, places = turns
        watched = monitor_step.Watched(
            self._link.latch.seen, self._taken, self._age, self._sequence, self.slip, *panel.clocks, post.checked,
            post.share, panel.due, self.reading.numbers, panel.seen.numbers, words, places,
        )  # fmt: skip
        rhythm = monitor_step.CheckSchedule(self._every, panel.apart, panel.clock, self._period)
        memory = post.monitor.memory(post.state)
        first = Bound(monitor_step.watch, watched, post.monitor.plausibility, memory, rhythm, self._tick, CLOSED, FAULT)
        return first, *(self._bound_look(number, *one, rhythm) for number, one in enumerate(panel.heats))

    def _bound_look(self, number: int, post: InstalledMonitor, heat: Heat, rhythm: monitor_step.CheckSchedule) -> Bound:
        """Return the call that asks the monitor of a plate when it is its turn."""
        panel, touched = self.device_monitors, self.device_monitors.touching
        asked = monitor_step.Asked(post.checked, post.share, post.said, panel.due, touched)
        return Bound(
            monitor_step.ask, asked, panel.times, rhythm, self._link.latch.seen, self._tick, heat.stands, heat.allowed,
            heat.checks, heat.memory(post.state), heat.numbers(panel.seen), heat.numbers(self._sent), number, CLOSED,
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
            raise DeviceFaultError(self._link.model.name, tick, error.trip, str(error)) from error

    def verify(self, tick: int) -> tuple[bool, TripError | None]:
        """Take the newest reading while all stops, and check it unless the device is at fault.

        Returns
        -------
        tuple
            Whether the device answered, and what is wrong with it or its reading, if anything is.
        """
        status, answered = self._link.latch.number, False
        try:
            answered = status != CLOSED and self._take()
            self._stamp(tick, answered)
            if answered and self.timed:
                self._measure_slip()
            if answered and status != FAULT:
                slip, self.slip[0] = self.slip[0].item(), 0.0
                self.device_monitors.believe(tick, self._every * self._period + slip)
        except TripError as error:
            return answered, error
        return answered, None

    def wait(self, tick: int, status: int) -> None:
        """Count the age of the last reading; an enabled device may not be silent for long (W1)."""
        age = self._age.item() + self._every
        self._age[...] = age
        if self._timely:
            age = max(age, self._oldest(tick))
        if status == ENABLED:
            self.device_monitors.wait(tick, age * self._period)

    def measured_at(self, role: Role) -> int:
        """Return the tick at which the newest reading of a role was measured, -1 if there is none."""
        when = self.measured_of(role)
        return int(when[0]) if when.size else -1

    def measured_of(self, role: Role) -> NDArray[np.int64]:
        """Return the view (1,) of State that has this tick, for compiled calls; (0,): no reading has the role."""
        reads = self._link.model.reads
        index = next((i for i, channel in enumerate(reads) if channel.role is role), len(reads))
        return self._measured[index : index + 1]

    def knows(self, reading: int, since: int) -> bool:
        """Tell whether the device is not CLOSED, and has measured reading number ``reading`` in this tick or later."""
        return self._link.latch.number != CLOSED and bool(self._measured[reading] >= since)

    def tracking_error(self, distance: float) -> float:
        """Return how far [m] a surface was from its command when measured; ``distance``: from the newest command [m].

        Behind a wire the newest reading is older than the newest command: it is compared with the one that acted then.
        """
        goal = self.departures.acting(self.measured_at(Role.TRACKED_POSE))
        if goal is None or self.pose is None:
            return distance
        return math.dist(goal, self.reading[self.pose][:3].tolist())

    def _disbelieve(self, tick: int, error: TripError) -> None:
        self._keep_sane()
        self._fail(error, tick)

    def _keep_sane(self) -> None:
        """Put the last believed reading back if the newest has numbers that mean nothing, so that nobody uses them."""
        if not self.device_monitors.usable():
            self.device_monitors.put_back()

    def _measure_slip(self) -> None:
        """Note how much more time has passed since the reading before than ticks say."""
        before, self._came = self._came, time.monotonic()
        passed = self._came - before - (self._age.item() + self._every) * self._period
        self.slip[0] = passed if 0.0 < passed < math.inf else 0.0

    def _stamp(self, tick: int, new: bool) -> None:
        """Note when the reading that has come was measured, and which command has left."""
        source = self._link.source
        if not isinstance(source, Timestamped):
            if new:
                self._measured[...] = tick
            return
        if new:
            source.measured(self._link.twin_state, tick, self._measured)
        if self._left is not None:
            left = source.departed(self._link.twin_state, tick, self._out)
            if left is not None:
                self._left[...] = left
                self.departures.note(left)

    def _take(self) -> bool:
        """Read the twin or the device, and tell whether there was a new reading; whatever goes wrong is a trip."""
        twin, device, twin_state = self._link.bound, self._link.device, self._link.twin_state
        try:
            if twin is not None:
                return self._take_whole(lambda filled: twin.read(twin_state, filled))
            if device is not None:
                return self._take_whole(device.read)
        except DeviceError as error:
            raise TripError(Trip.DEVICE_ERROR, f"failed: {spoken(error)}") from error
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plugin that exits does not end the program
            raise TripError(Trip.DEVICE_ERROR, f"failed in {failed_in(device, 'read')}: {error_text(error)}") from error
        return False

    def _take_whole(self, read: Callable[[Record], object]) -> bool:
        """Read; nobody sees what a driver or a twin has filled in without telling that there is a new reading."""
        filled = self._filled
        filled.raw[:] = self.reading.raw
        new = is_new(read(filled))
        if new:
            self.reading.raw[:] = filled.raw
        return new

    def _doubt_age(self, tick: int) -> None:
        """Count the age of a new reading from when it was measured: a reading that comes late is no news (W1)."""
        age = self._oldest(tick)
        if age > 0:
            self.device_monitors.wait(tick, age * self._period)

    def _oldest(self, tick: int) -> int:
        """Return how many ticks ago the oldest of the readings that must be recent was measured."""
        return tick - min(int(self._measured[index]) for index in self._timely)
