"""The monitors of one device in use: each with its part of State, asked on a clock, its answer never trusted blindly.

The smallest share and the first trip count.  A monitor that raises, or returns what is neither a share nor a trip,
stops the device.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from itouch.monitors import OWN, DeviceFaultError, Heat, Ordinary, Readings, Surface, Trip, TripError
from itouch.plugin import Moment, Monitor, Record
from itouch.safety.monitor_step import Clocks, clocked
from itouch.safety.monitor_step import moment as clocks_at
from itouch.schema.diagnostics import named
from itouch.world import DeviceModel

#: Longest time [s] between two checks of an open device, even without a new reading.
CLOCK = 0.010
#: A reading that comes at least this long [s] after the one before is checked at once, faster ones when ``CLOCK`` says.
APART = 0.005


class InstalledMonitor:
    """One monitor of one device, with its part of State."""

    __slots__ = ("checked", "monitor", "own", "said", "share", "state")

    def __init__(self, monitor: Monitor, state: Record, device: str) -> None:
        self.monitor = monitor
        name = f"{device}.{monitor.name}"
        fields = [field.name for field in monitor.fields()]
        self.state = state.part(f"{name}.", fields) if fields else Record.of(())
        self.share, self.checked = state[f"{name}.share"], state[f"{name}.checked"]
        #: Whether it is one of the framework's own.
        self.own = type(monitor) in OWN
        #: What a compiled look has found and Python is to act on, shape (1,).
        self.said = np.zeros(1)


class DeviceMonitors:
    """The monitors of one device; everything that they remember is State."""

    def __init__(self, model: DeviceModel, state: Record, reading: Record, sent: Record, period: float) -> None:
        self._period = period
        #: A copy of the reading, taken before any other plugin could write to it.
        self.seen = reading.copy()
        self._reading, self._sent = reading, sent
        self._read, self._seen = reading.raw, self.seen.raw
        self._name = name = model.name
        self.moment = Moment()
        self._clamped = state[f"{name}.clamped"]
        self._missed, self._heard = self.clocks = state[f"{name}.missed"], state[f"{name}.heard"]
        self._state = state
        self._measured = state[f"{name}.measured"]
        #: The times of the device, for compiled code.
        self.times = Clocks(self._missed.reshape(1), self._heard.reshape(1), self._measured.reshape(-1))
        self._touched, self._felt = state[f"{name}.touched"], state[f"{name}.felt"]
        #: 1 while a finger touches the device, as far as is known, shape (1,).
        self.touching = self._touched.reshape(1)
        installed = [InstalledMonitor(monitor, state, name) for monitor in model.monitors]
        #: The monitor that is asked first: whether the reading can be believed.
        self.readings = next((post for post in installed if isinstance(post.monitor, Readings)), None)
        self._watchdog = next((post for post in installed if isinstance(post.monitor, Ordinary)), None)
        #: The monitor of the surface that the device carries to the finger, if it carries one.
        self.surface = next((post for post in installed if isinstance(post.monitor, Surface)), None)
        others = [post for post in installed if post is not self.readings and post is not self._watchdog]
        self.installed: Sequence[InstalledMonitor] = installed
        self._timed = [post for post in others if not post.monitor.needs_finger_position]
        self._placed = [post for post in others if post.monitor.needs_finger_position]
        self.clock = max(1, math.floor(CLOCK / period + 1e-6))
        self.apart = max(1, math.ceil(APART / period - 1e-6))  # closer ones would not all be remembered for a second
        #: The time of the reading that must be checked at once, in ticks, shape (1,).
        self.due = np.full(1, -1, np.int64)
        #: The share of force, current or speed that all monitors allow, shape (1,).
        self.left = np.ones(1)
        #: Finger -> the share that is allowed because of what else acts on it.
        self._others: dict[str, float] = {}

    def reset(self) -> None:
        """Begin a session: nothing is remembered, the share is 1; until a rig says otherwise a touch is assumed."""
        self._touched[...] = 1
        self._felt[...] = math.nan
        for post in self.installed:
            post.monitor.reset(post.state)
            post.share[...] = 1.0
        self.forget()

    def forget(self) -> None:
        """Forget what was measured; budgets stay."""
        for post in self.installed:
            post.monitor.clear_history(post.state)
            post.checked[...] = -1
        self._heard[...] = -1
        self._gather()

    def begin(self) -> None:
        """Forget where the finger was: a device that is enabled now has not been watched for a while."""
        for post in self._placed:
            post.monitor.clear_history(post.state)
            post.checked[...] = -1

    def restore(self) -> None:
        """Go on from a State that was restored."""
        self._seen[:] = self._read
        self._gather()

    def spent(self) -> str:
        """Return the words for a budget that is used up; empty: none is."""
        return next((said for post in self.installed if (said := post.monitor.exhausted_budget(post.state))), "")

    @property
    def share(self) -> float:
        """The share of force, current or speed that all monitors allow."""
        found: float = self.left[0].item()
        return found

    def _gather(self) -> None:
        self.left[0] = min((post.share.item() for post in self.installed), default=1.0)
        self.left[0] = min(self.left[0], *self._others.values(), 1.0)

    def limit_share(self, finger: str, part: float) -> None:
        """Allow at most this share of force, current or speed, because of what else acts on a finger."""
        if part != self._others.get(finger, 1.0):
            self._others[finger] = part
            self._gather()

    @property
    def values(self) -> list[float]:
        """All numbers of the newest reading."""
        found: list[float] = self._reading.numbers.tolist()
        return found

    def put_back(self) -> None:
        """Replace a reading that is not believed by the last one that was."""
        if self.readings is not None and isinstance(self.readings.monitor, Readings):
            self.readings.monitor.put_back(self.readings.state, self._reading)

    def mend(self) -> None:
        """Replace, channel by channel, numbers that can't be worked with at all by the last ones that were believed."""
        if self.readings is not None and isinstance(self.readings.monitor, Readings):
            self.readings.monitor.mend(self.readings.state, self._reading)

    def usable(self) -> bool:
        """Tell whether the newest reading can be worked with at all, even if it passes a limit."""
        return self.readings is None or Readings.usable(self.readings.monitor, self._reading)  # type: ignore[arg-type]

    # --- readings ------------------------------------------------------------------------------------------------

    def believe(self, tick: int, seconds: float) -> None:
        """Check a new reading, and copy it out of reach of everybody who could write to it.

        ``seconds``: the time since the reading before [s], as far as the caller knows.

        Raises
        ------
        TripError
            If it cannot be believed.
        """
        now = tick + self._missed.item()
        since = self.apart
        if self._heard.item() >= 0:  # the device may have gone on in periods that were left out
            since = now - self._heard.item()
            seconds = max(seconds, since * self._period)
        self._heard[...] = now
        if since >= self.apart:
            self.due[0] = now
        if self.readings is not None:
            self._ask(self.readings, self._reading, now, seconds)
        self._seen[:] = self._read

    def leave_out(self, ticks: int) -> None:
        """Count this many ticks that were not run as time that has passed."""
        self._missed += ticks

    def turns(self) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
        """Return State as integers, and the indices in it of the times at which Python last asked each monitor.

        No index where compiled code asks the monitors, those of plates.  None: State can't be read so.
        """
        begin = self._state.raw.ctypes.data
        places = [post.checked.ctypes.data - begin for post in self._timed] if not self.heats else []
        if any(place % 8 for place in places) or begin % 8 or self._state.nbytes % 8:
            return None
        return self._state.raw.view(np.int64), np.array(places, np.int64) // 8

    def take(self, tick: int) -> None:
        """Take over the reading of a stopped device without checking it: budgets run on."""
        self._heard[...] = tick + self._missed.item()
        self._seen[:] = self._read

    def wait(self, tick: int, age: float) -> None:
        """Ask the watchdog about the age [s] of the newest reading.

        Raises
        ------
        TripError
            If it is too old.
        """
        self.moment.age = age
        if self._watchdog is not None:
            self._ask(self._watchdog, self.seen, tick + self._missed.item(), None)

    def look(self, tick: int, age: float) -> None:
        """Ask the monitors whose turn it is.

        Raises
        ------
        TripError
            The first trip.
        """
        if self._timed and self._heard.item() >= 0:
            self._look(self._timed, tick, age)

    def _look(self, listed: Sequence[InstalledMonitor], tick: int, age: float) -> None:
        now = tick + self._missed.item()
        for post in listed:
            checked = post.checked.item()
            if checked < 0 or now - checked >= self.clock or self.due[0] == now:
                self.moment.age = age
                self.moment.touched, self.moment.force = bool(self._touched.item()), self._felt.item()
                self._ask(post, self.seen, now, None)

    @property
    def heats(self) -> Sequence[tuple[InstalledMonitor, Heat]]:
        """The monitors of plates, if they are the only ones asked on the clock; else none."""
        found = [(post, post.monitor) for post in self._timed if isinstance(post.monitor, Heat) and post.own]
        return found if len(found) == len(self._timed) else ()

    def told_timed(self, number: int, tick: int, age: float) -> None:
        """Act on what the compiled look of a monitor on the clock has found, and ask the monitors after it.

        Raises
        ------
        TripError
            The first trip.
        """
        self.told(self._timed[number])
        self._look(self._timed[number + 1 :], tick, age)

    def look_placed(self, tick: int) -> None:
        """Ask the monitors that need to know where the finger is now, which ``moment`` tells them.

        Raises
        ------
        TripError
            The first trip.
        """
        now = tick + self._missed.item()
        for post in self._placed:
            self._ask(post, self.seen, now, None)
        surface = self.surface
        if surface is not None and surface.state["looked"].item() == self.moment.now:
            self.touch(self.moment.touched, self.moment.force)

    def touch(self, touched: bool, force: float) -> None:
        """Set whether a finger touches the device, and with what force [N]; NaN: not measured."""
        self._touched[...], self._felt[...] = touched, force

    @property
    def force(self) -> float:
        """Felt force between finger and device [N]; NaN: not measured."""
        return float(self._felt.item())

    @property
    def withdrawn(self) -> bool:
        """Whether the surface is withdrawn because of T4."""
        return self.surface is not None and bool(self.surface.state["withdrawn"].item())

    def closing(self, gap: float, tracking_error: float) -> float:
        """Return how fast [m/s] the surface may approach the finger now; ``gap`` and ``tracking_error`` in [m]."""
        post = self.surface
        if post is None or not isinstance(post.monitor, Surface):
            return 0.0
        found = post.monitor.closing(gap, tracking_error)
        if not found:
            self._clamped += 1
        return found

    def follow(self, target: float, lifted: bool, leaves: float = -math.inf) -> float:
        """Return the height [m] to command to a surface that is, or was, withdrawn.

        ``target``: the height that its modality commands [m]; ``lifted``: whether no virtual contact is left;
        ``leaves``: how low the surface may go in this tick [m].
        """
        post = self.surface
        if post is None or not isinstance(post.monitor, Surface):
            return target
        found = post.monitor.follow(post.state, target, lifted, leaves)
        if post.state["withdrawn"].item():
            self._clamped += 1
        return found

    def count_contact(self, tick: int, touched: bool) -> None:
        """Run the clock of T4: ``touched`` tells whether the finger touches this surface or another now.

        Raises
        ------
        DeviceFaultError
            If it was touched for too long.
        """
        post = self.surface
        if post is None or not isinstance(post.monitor, Surface):
            return
        now = clocked(tick + self._missed.item(), self._period)
        post.said[0] = found = post.monitor.count(post.state, now, touched)
        if found < 0.0:
            self.told_at(post, tick)

    def told_of_contact(self, tick: int) -> None:
        """Act on what the compiled clock of T4 has found for the surface that the device carries, if it carries one.

        Raises
        ------
        DeviceFaultError
            If it was touched for too long.
        """
        if self.surface is not None:
            self.told_at(self.surface, tick)

    def told_at(self, post: InstalledMonitor, tick: int) -> None:
        """Act on what the compiled look of a monitor has found in a tick.

        Raises
        ------
        DeviceFaultError
            If it is a trip.
        """
        try:
            self.told(post)
        except TripError as error:
            raise DeviceFaultError(self._name, tick, error.trip, str(error)) from error

    @property
    def touched(self) -> bool:
        """Whether a finger touches the device, as far as is known."""
        return bool(self._touched.item())

    def _ask(self, post: InstalledMonitor, reading: Record, now: int, seconds: float | None) -> None:
        moment, checked = self.moment, post.checked.item()
        tick = now - self._missed.item()
        moment.now, moment.time, passed = clocks_at(self.times, checked, tick, self._period)
        moment.seconds = passed if seconds is None else seconds
        moment.fresh = self._heard.item() > checked
        post.checked[...] = now
        sent = self._sent
        if not post.own:  # a plugin gets copies: what it writes there changes nothing that others see
            reading, sent, moment = reading.copy(), sent.copy(), copy(moment)
        try:
            said: object = post.monitor.check(post.state, reading, sent, moment)
            if isinstance(said, str | bytes):
                raise TypeError(f"{said!r} is not a number")
            found = float(said)  # type: ignore[arg-type]  # whatever else it is, this raises
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plugin that exits does not end the program
            cause = f"was stopped because its monitor '{post.monitor.name}' failed: {named(error)}"
            raise TripError(Trip.MONITOR_ERROR, cause) from error
        self._judge(post, found, reading)

    def told(self, post: InstalledMonitor) -> None:
        """Act on what the compiled look of a monitor has found.

        Raises
        ------
        TripError
            If it is a trip.
        """
        self._judge(post, post.said[0].item(), self.seen)

    def _judge(self, post: InstalledMonitor, found: float, reading: Record) -> None:
        if found != post.share.item():
            if not 0.0 <= found <= 1.0:
                self._trip(post, found, reading)
            post.share[...] = found
            self._gather()

    def _trip(self, post: InstalledMonitor, found: float, reading: Record) -> None:
        """Raise the trip that a monitor has returned."""
        monitor = post.monitor
        code = int(-found) if -1e6 < found < 0.0 and found == int(found) else 0
        if code not in monitor.trips:
            cause = f"was stopped because its monitor '{monitor.name}' returned {found!r}: neither a share nor a trip"
            raise TripError(Trip.MONITOR_ERROR, cause)
        try:
            sentence = monitor.sentence(code, post.state, reading, self.moment)
            number = monitor.rule(code, reading)
            every = [*monitor.rules(), *(rule for other in self.installed for rule in other.monitor.rules())]
            quoted = next((rule for rule in every if number in (rule.number, rule.quantity) and rule.trip), None)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            sentence, quoted = (
                f"was stopped by {monitor.trips[code]} ({type(error).__name__} while it was reported)",
                None,
            )
        if quoted is not None:
            sentence += f" ({quoted.number + ' ' if quoted.number else ''}{quoted.quantity}: trips at {quoted.trip})"
        raise TripError(Trip(code) if post.own else Trip.MONITOR, sentence)
