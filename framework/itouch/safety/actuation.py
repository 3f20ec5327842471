"""The way out through a gate: commands are limited and sent, or safe ones in their place; the only caller of ``write``.

Unless a device is enabled nothing that was requested passes: each channel gets its safe command.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from itouch.exchange import Exchanged
from itouch.monitors import Trip, TripError
from itouch.plugin import Bound, DeviceError, Record, Role
from itouch.safety import limiting
from itouch.safety.acquisition import Acquisition
from itouch.safety.device_link import DeviceLink
from itouch.safety.guard import ANYWHERE, Guard
from itouch.safety.latch import CLOSED, ENABLED, FAULT
from itouch.schema.diagnostics import spoken
from itouch.schema.plugin_errors import error_text
from itouch.world import limits as default

#: Values of ``Actuation.stopped``.
HELD, BACKWARDS = 1, 2


def lowest_retreat(status: int, stopped: int, leg: float) -> float:
    """Return the lowest height [m] to which a surface may retract unwatched, when the loop hangs or has died.

    Infinite: it stays where it was sent last, because a stop has found that retracting may bring it nearer to the
    finger; NaN: to the end of its travel.  ``status`` and ``stopped`` are those of State; ``leg`` is the lowest height
    [m] to which the safe sequence itself may send it, NaN: the end of its travel.
    """
    if status == ENABLED:  # what an earlier stop has found counts no longer
        return math.nan
    return math.inf if stopped else leg


class Actuation:
    """Limits the commands of one device and sends them.

    ``fail`` is called, with the tick, for whatever trips; it raises unless the device was at fault before.
    ``acquired``: the readings, for a safe command that begins where the device stands.
    """

    def __init__(
        self, link: DeviceLink, state: Record, period: float, command: Record, sent: Record, acquired: Acquisition,
        fail: Callable[[TripError, int], None],
    ) -> None:  # fmt: skip
        self._link, self._period, self._acquired, self._fail = link, period, acquired, fail
        self.command, self.sent = command, sent
        model = link.model
        self._ramp, self._monitors = state[f"{model.name}.ramp"], acquired.device_monitors
        #: How a surface retracts (None: it can't): 0, as it should; HELD where it is, because it came nearer when told
        #: to retract; BACKWARDS, because it still pressed when it was held.
        self.stopped = state.get(f"{model.name}.stopped")
        #: Height to which a surface was sent when all stopped, and the lowest and highest one to which its safe command
        #: may lead [m], shape (3,); NaN: not known, or as far as it travels.
        self.way = state.get(f"{model.name}.way")
        #: Whether its last command could not be written: the one before may still act.
        self.unsent = False
        #: How many limits were applied, and how many locked components dropped, shape (1,).
        self.clamped, self.dropped = (state[f"{model.name}.{field}"].reshape(1) for field in ("clamped", "dropped"))
        self.guards = [(channel.name, Guard(channel, model.limits)) for channel in model.commands]
        #: The commands that hold or retract: their safe value begins at the one that was sent last.
        self._relative = [channel for channel in model.commands if not isinstance(channel.safe, tuple)]
        #: Whether that one is true of the device as it is now.
        self._known = link.device is None or not self._relative
        #: What is set anew in each tick: share, closing speed, room.
        self.moving = limiting.TickLimits.of()
        forces = max(1, sum(channel.role is Role.FORCE_ON_OPERATOR for channel in model.commands))
        counts = self.clamped, self.dropped, period, forces
        self._lanes = [
            (guard, guard.bound(self.moving, command[name], sent[name], *counts)) for name, guard in self.guards
        ]
        self._growth = period / (model.limits.ramp or default.RAMP)
        #: Reduces this arm's force to what the others on the same finger leave, just before its command is limited.
        self.leave_room: Callable[[], None] | None = None
        #: Keep the last command instead of the safe one: a plate that is being taken from the finger keeps its drive.
        self.keeping = False
        #: Whether a safe sequence is over: what was sent last is the safe state, and nobody watches where it goes.
        self._settled = False
        #: The copy that a driver is handed: it may keep it, or write to it whenever it likes.
        self._handed = sent.copy()

    def forget_way(self) -> None:
        """Forget how a surface retracted, and how far it was led."""
        if self.stopped is not None and self.way is not None:
            self.stopped[...], self.way[:] = 0, np.nan

    def opened(self) -> None:
        """Forget what was sent: the device may stand elsewhere since it was opened."""
        self._settled = False
        self._known = self._link.device is None or not self._relative

    def begin(self) -> None:
        """Begin from where the device stands, with the ramp that its limits ask for."""
        self.rest_at_measured()
        self._known, self._settled = True, False
        self._ramp[...] = 0.0 if self._link.model.limits.ramp > 0.0 else 1.0

    def settle(self, over: bool = True) -> None:
        """Leave the device as it is: a safe sequence is ``over``, and no surface may move on unwatched; or it begins.

        A thread that exchanges with the device goes on by itself when no tick writes any more.
        """
        self._settled = over
        self._tell_lowest()

    def _tell_lowest(self) -> None:
        if isinstance(self._link.device, Exchanged):
            self._link.device.lowest = self._lowest

    @property
    def _lowest(self) -> float:
        """The lowest height [m] to which the device may retract unwatched, see ``lowest_retreat``."""
        status = self._link.latch.number
        if self.stopped is None or self.way is None:
            return math.nan
        found = lowest_retreat(status, self.stopped.item(), self.way[1].item())
        return math.inf if self._settled and status != ENABLED else found

    def rest_at_measured(self) -> None:
        """Begin each command at its safe value, or where the device stands."""
        for channel in self._link.model.commands:
            if isinstance(channel.safe, tuple):
                self.sent[channel.name] = channel.safe
            elif channel.role is Role.SURFACE_POSE and self._acquired.pose is not None:
                self.sent[channel.name] = self._acquired.reading[self._acquired.pose]
            self.command[channel.name] = self.sent[channel.name]

    def ramp_in(self) -> None:
        """Begin with a share of zero and let it grow, as after every re-arming."""
        self._ramp[...] = 0.0

    def rest_at_safe(self) -> None:
        """Set commands to their safe values, so that nothing that was requested before is ever sent again."""
        for channel in self._link.model.commands:
            if isinstance(channel.safe, tuple):
                self.command[channel.name] = self.sent[channel.name] = np.array(channel.safe)

    @property
    def closing(self) -> float:
        """Greatest speed [m/s] at which a surface may approach the finger in this tick."""
        found: float = self.moving.closing[0].item()
        return found

    @closing.setter
    def closing(self, speed: float) -> None:
        self.moving.closing[0] = speed

    def guard(self, tick: int) -> None:
        """Limit the commands to what may be sent; ``send`` passes that on to the device.

        Raises
        ------
        DeviceFaultError
            If a command is not a number.
        """
        status = self._link.latch.number
        if status == CLOSED:
            return
        if status != ENABLED:
            self._rest()
            return
        try:
            self._limit()
        except TripError as error:
            self._fail(error, tick)

    def send(self, tick: int) -> None:
        """Write to the device what was let through.

        Raises
        ------
        DeviceFaultError
            If the device failed, or something has overwritten its status in State.
        """
        latch = self._link.latch
        if self._link.device is None or latch.number == CLOSED:
            return
        try:
            if forged := latch.forged():
                if latch.number != FAULT:
                    raise TripError(Trip.MODALITY_ERROR, f"was stopped: {forged}")
                self._rest()  # compiled code may have followed the status that was written there
            self._put()
        except TripError as error:
            self._fail(error, tick)

    def _limit(self) -> None:
        share = self._ramp.item()
        if share < 1.0:
            share = min(1.0, share + self._growth)
            self._ramp[...] = share
        moving = self.moving
        moving.share[0], moving.taken[0], moving.turned[0] = share * self._monitors.share, 0.0, 0.0
        if self.leave_room is not None:
            self.leave_room()
        for guard, lane in self._lanes:
            if lane():
                raise guard.refusal(self.command[guard.channel.name])

    def bound_guard(self) -> tuple[Bound, ...]:
        """Return ``guard`` as compiled calls, which leave a device that is not enabled to Python; none: Python's."""
        if self.leave_room is not None:
            return ()
        sizes = [channel.size for channel in self._link.model.commands]
        begin = Bound(
            limiting.begin, self._link.latch.seen, ENABLED, CLOSED, self.command.numbers,
            np.cumsum(sizes, dtype=np.int64), self._ramp, self._monitors.left, self.moving, self._growth,
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
        pose = self._acquired.pose
        if pose is None or not self._acquired.heard or any(c.role is not Role.SURFACE_POSE for c in self._relative):
            return False
        for channel in self._relative:
            self.sent[channel.name] = self._acquired.reading[pose]
        self._known = True
        return True

    def _put(self) -> None:
        """Pass what was let through on to the device: the only call of its ``write``.

        A device that holds or retracts, and of which nothing is known yet, was told nothing and is left where it is.
        """
        device = self._link.device
        if device is None or not self._known:
            return
        self.unsent = True
        try:
            self._handed.raw[:] = self.sent.raw
            self._tell_lowest()
            device.write(self._handed)
            self.unsent = False
        except DeviceError as error:
            raise TripError(Trip.DEVICE_ERROR, f"failed: {spoken(error)}") from error
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a plugin that exits does not end the program
            raise TripError(Trip.DEVICE_ERROR, f"failed in write: {error_text(error)}") from error
