"""The status machine round one device, and the only caller of ``Device.write``.

CLOSED --open--> OPEN --enable--> ENABLED --disable--> OPEN --close--> CLOSED; any error, NaN or trip leads to FAULT,
which latches until an operator re-arms.  In OPEN and FAULT only safe commands are sent: a plugin can't forward a
command while it is disabled, because it never receives one.
"""

from __future__ import annotations

import contextlib
import enum
from collections.abc import Callable, Sequence

import numpy as np

from itouch.plugin import Channel, Device, DeviceError, Record, Twin
from itouch.safety.guard import Guard
from itouch.safety.heat import Heat
from itouch.safety.readings import Watch
from itouch.safety.trips import LOSSES, DeviceFaultError, Trip, TripError
from itouch.world import DeviceModel
from itouch.world import limits as default
from itouch.world.supervision import SLOW, heats


class Status(enum.IntEnum):
    """What a device may do now."""

    CLOSED = 0
    OPEN = 1
    ENABLED = 2
    FAULT = 3


#: The same as plain numbers: an attribute of an enumeration costs a microsecond.
_CLOSED, _OPEN, _ENABLED, _FAULT = (int(status) for status in Status)


class Supervisor:
    """Supervises one device, or its twin, on its part of State."""

    def __init__(
        self,
        model: DeviceModel,
        state: Record,
        period: float,
        *,
        device: Device | None = None,
        twin: Twin | None = None,
    ) -> None:
        self.model, self._period = model, period
        self.device, self.twin = device, twin
        name = model.name
        self.reading = _part(state, f"{name}.", model.reads)
        self.command = _part(state, f"{name}.command.", model.commands)
        self.sent = _part(state, f"{name}.sent.", model.commands)
        has_twin_state = twin is not None and any(n.startswith(f"{name}.twin.") for n in state)
        self.twin_state = state.part(f"{name}.twin.") if has_twin_state else Record(np.dtype([]))
        self._status, self._trip, self._tripped = (state[f"{name}.{field}"] for field in ("status", "trip", "tripped"))
        self._ramp, self._age, self._sequence = (state[f"{name}.{field}"] for field in ("ramp", "age", "sequence"))
        self._clamped, self._dropped = state[f"{name}.clamped"], state[f"{name}.dropped"]
        self.guards = [(channel.name, Guard(channel, model.limits)) for channel in model.commands]
        self._lanes = [(self.command[name], self.sent[name], guard) for name, guard in self.guards]
        self.watch = Watch(model.reads, self.reading, model.limits, model.commands)
        self._patience = max(1, round(model.limits.watchdog / period))
        self._every = 1 if model.cls.blocking else max(1, round(model.cls.period / period))
        self._slow = max(self._every, round(SLOW / period))
        self.heat: Heat | None = None
        if heats(model.reads):
            self.heat = Heat(model, state, self.reading, self.sent, self._slow * period)
        #: Greatest speed [m/s] at which a surface may approach the finger in this tick.
        self.closing = 0.0
        #: Part of a force that the finger's speed leaves in this tick (K2).
        self.fade = 1.0
        #: Keep the last command instead of the safe one: a plate that is on its way from the finger stays as it is.
        self.keeping = False
        #: Told of the loss of an optional device, without which the session goes on; None: its loss stops everything.
        self.on_loss: Callable[[DeviceFaultError], None] | None = None

    @property
    def enabled(self) -> bool:
        """Whether commands are let through."""
        return bool(self._status.item() == _ENABLED)

    @property
    def status(self) -> Status:
        """What the device may do now."""
        return Status(self._status.item())

    @property
    def trip(self) -> Trip:
        """Why the device was stopped, latched until it is re-armed."""
        return Trip(self._trip.item())

    def reset(self) -> None:
        """Set what is remembered to its start."""
        self.watch.forget()
        self._tripped[...] = -1
        if self.heat is not None:
            self.heat.reset()

    def restore(self) -> None:
        """Go on from a State that was put in place."""
        if self._sequence.item():
            self.watch.recall()
        else:
            self.watch.forget()

    # --- lifecycle ------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Open the device; CLOSED -> OPEN.

        Raises
        ------
        DeviceError
            If the device is missing or refuses.
        """
        if self.device is not None:
            self.device.open()
        self._forget()
        self._status[...] = _OPEN

    def _forget(self) -> None:
        """Drop what was read before: it says nothing of the device as it is now."""
        self.watch.forget()
        self._age[...] = 0
        self._sequence[...] = 0
        if self.heat is not None:
            self.heat.forget()

    def enable(self) -> None:
        """Let commands through from the state that was measured; OPEN -> ENABLED.

        Raises
        ------
        DeviceError
            If the device is not OPEN.
        """
        if self._status.item() != _OPEN:
            raise DeviceError(f"device '{self.model.name}' is {self.status.name}, it can't be enabled")
        self.rest_at_measured()
        self._status[...] = _ENABLED
        self._ramp[...] = 0.0 if self.model.limits.ramp > 0.0 else 1.0

    def rest_at_measured(self) -> None:
        """Begin each command where it is safe: at its safe value, or where the device stands."""
        for channel in self.model.commands:
            if isinstance(channel.safe, tuple):
                self.sent[channel.name] = channel.safe
            elif channel.name == "pose_target" and "pose" in self.reading:
                self.sent[channel.name] = self.reading["pose"]
            self.command[channel.name] = self.sent[channel.name]

    def disable(self) -> None:
        """Stop commands; ENABLED -> OPEN."""
        if self._status.item() == _ENABLED:
            self._status[...] = _OPEN

    def rearm(self) -> None:
        """Release the latched trip: FAULT -> OPEN; commands wait for ``enable``.

        Raises
        ------
        DeviceError
            If what stopped the device is not over: its reading is still wrong, or its thermal dose is used up.
        """
        if self._status.item() != _FAULT:
            return
        if self._trip.item() == Trip.DOSE:
            raise DeviceError(f"device '{self.model.name}' has given the whole thermal dose of a session")
        self._forget()
        try:
            self._take()
            self.watch.check(0.0)
        except (DeviceFaultError, TripError, DeviceError) as error:
            raise DeviceError(f"device '{self.model.name}' can't be re-armed: it {_cause(error)}") from error
        self._sequence[...] = 1
        self._trip[...] = Trip.NONE
        self._status[...] = _OPEN

    def ramp_in(self) -> None:
        """Begin with nothing and let commands grow, as after every re-arming."""
        self._ramp[...] = 0.0

    def reconnect(self) -> None:
        """Close and open the device anew; FAULT or CLOSED -> OPEN, with nothing remembered of before.

        Raises
        ------
        DeviceError
            If the device is missing or refuses; it stays CLOSED.
        """
        with contextlib.suppress(Exception):  # a lost device may refuse to be closed
            self.close()
        self.open()
        self._trip[...] = Trip.NONE
        self.rest_at_safe()

    def rest_at_safe(self) -> None:
        """Forget every command: nothing that was asked for before is ever sent again."""
        for channel in self.model.commands:
            if isinstance(channel.safe, tuple):
                self.command[channel.name] = self.sent[channel.name] = np.array(channel.safe)

    def close(self) -> None:
        """Send the safe command and release the device; any status -> CLOSED."""
        if self._status.item() == _CLOSED:
            return
        try:
            self._send_safe()
        finally:
            self._status[...] = _CLOSED
            if self.device is not None:
                self.device.close()

    # --- a tick ---------------------------------------------------------------------------------------------------

    def read(self, tick: int) -> None:
        """Take the newest reading and check it.

        Raises
        ------
        DeviceFaultError
            If the device failed, was silent for too long, or reads what can't be or may not be.
        """
        status = self._status.item()
        if status == _CLOSED or tick % self._every:
            return
        try:
            if self._take() is False:
                self._wait(status)
                return
            age = self._age.item()
            if age:
                self._age[...] = 0
            self._sequence[...] = self._sequence.item() + 1
            if status != _FAULT:
                self.watch.check((age + self._every) * self._period)
                if self.heat is not None and tick % self._slow == 0:
                    self.heat.check()
        except TripError as error:
            if status != _FAULT:
                self._fail(DeviceFaultError(self.model.name, tick, error.trip, str(error)), error)

    def _take(self) -> bool | None:
        """Read the twin or the device; whatever goes wrong is a trip."""
        try:
            if self.twin is not None:
                return self.twin.read(self.twin_state, self.reading)
            if self.device is not None:
                return self.device.read(self.reading)
        except DeviceError as error:
            raise TripError(Trip.DEVICE_ERROR, f"failed: {error}") from error
        except Exception as error:
            raise TripError(Trip.DEVICE_ERROR, f"failed in read: {type(error).__name__}: {error}") from error
        return False

    def _wait(self, status: int) -> None:
        """Count the age of the last reading; an enabled device may not be silent for long (W1)."""
        age = self._age.item() + self._every
        self._age[...] = age
        if age > self._patience and status == _ENABLED:
            raise TripError(Trip.SILENT, f"was silent for {age * self._period:.3f} s")

    def write(self, tick: int) -> None:
        """Send the commands through the guards; only safe ones unless ENABLED.

        Raises
        ------
        DeviceFaultError
            If a command is not a number, or the device failed.
        """
        status = self._status.item()
        if status == _CLOSED:
            return
        try:
            if status == _ENABLED:
                self._send()
            else:
                self._send_safe()
        except TripError as error:
            self._fail(DeviceFaultError(self.model.name, tick, error.trip, str(error)), error)

    def _send(self) -> None:
        share = self._ramp.item()
        if share < 1.0:
            share = min(1.0, share + self._period / max(self.model.limits.ramp, default.RAMP))
            self._ramp[...] = share
        if self.heat is not None:
            share *= self.heat.share.item()
        share *= self.fade
        for wanted, sent, guard in self._lanes:
            clamped, dropped = guard.limit(wanted, sent, share, self._period, self.closing)
            if clamped:
                self._clamped += clamped
            if dropped:
                self._dropped += dropped
        self._put()

    def _send_safe(self) -> None:
        if not self.keeping:
            for name, guard in self.guards:
                guard.safe(self.sent[name], self._period)
        self._put()

    def _put(self) -> None:
        """Hand what was let through to the device: the only call of its ``write``."""
        if self.device is None:
            return
        try:
            self.device.write(self.sent)
        except DeviceError as error:
            raise TripError(Trip.DEVICE_ERROR, f"failed: {error}") from error
        except Exception as error:
            raise TripError(Trip.DEVICE_ERROR, f"failed in write: {type(error).__name__}: {error}") from error

    def _fail(self, fault: DeviceFaultError, error: TripError) -> None:
        """Stop because of a fault: all devices, unless this one is optional and merely lost."""
        if self._status.item() == _FAULT:
            return
        if self.on_loss is not None and fault.trip in LOSSES:
            self.fault(fault.trip, fault.tick)
            self.on_loss(fault)
            return
        raise fault from error

    def fault(self, trip: Trip, tick: int) -> None:
        """Latch a trip and make the device safe now; what the device raises meanwhile can't help any more."""
        self._status[...] = _FAULT
        self._trip[...] = trip
        self._tripped[...] = tick
        self._ramp[...] = 0.0
        with contextlib.suppress(TripError):  # the device is lost; the others must still be made safe
            self._send_safe()

    def glance(self) -> bool:
        """Take the newest reading without judging it, to verify that the device is safe; tell whether it answered."""
        try:
            return self._status.item() != _CLOSED and self._take() is not False
        except TripError:
            return False


def _cause(error: Exception) -> str:
    return error.cause if isinstance(error, DeviceFaultError) else str(error)


def _part(state: Record, prefix: str, channels: Sequence[Channel]) -> Record:
    names = [channel.name for channel in channels]
    return state.part(prefix, names) if names else Record(np.dtype([]))
