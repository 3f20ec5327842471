"""The status machine round one device; the only caller of its methods.

CLOSED --open--> OPEN --enable--> ENABLED --disable--> OPEN --close--> CLOSED; any error, NaN or trip leads to FAULT,
which only closing leaves.  In OPEN and FAULT only safe commands are sent: a plugin can't forward a command while it
is disabled, because it never receives one.
"""

from __future__ import annotations

import contextlib
import enum
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from itouch.loop.frames import Frame, frame
from itouch.loop.safety import Guard, Trip, TripError, Watch
from itouch.plugin import Channel, Device, DeviceError, Record, Touch, Twin
from itouch.schema import ItouchError
from itouch.world import DeviceModel
from itouch.world import limits as default


class Status(enum.IntEnum):
    """What a device may do now."""

    CLOSED = 0
    OPEN = 1
    ENABLED = 2
    FAULT = 3


#: The same as plain numbers: an attribute of an enumeration costs a microsecond.
_CLOSED, _ENABLED, _FAULT = int(Status.CLOSED), int(Status.ENABLED), int(Status.FAULT)


class DeviceFaultError(ItouchError):
    """A device that was stopped while the loop ran: which, when, and why."""

    def __init__(self, device: str, tick: int, trip: Trip, cause: str) -> None:
        super().__init__(f"device '{device}' {cause} at tick {tick}")
        self.device, self.tick, self.trip, self.cause = device, tick, trip, cause


class Runner:
    """Runs one device, or its twin, on its part of State."""

    def __init__(self, model: DeviceModel, state: Record, period: float) -> None:
        self.model, self._state, self._period = model, state, period
        name = model.name
        self.reading = _part(state, f"{name}.", model.reads)
        self.command = _part(state, f"{name}.command.", model.commands)
        self.sent = _part(state, f"{name}.sent.", model.commands)
        self._status, self._trip = state[f"{name}.status"], state[f"{name}.trip"]
        self._ramp, self._age, self._sequence = state[f"{name}.ramp"], state[f"{name}.age"], state[f"{name}.sequence"]
        self._clamped, self._dropped = state[f"{name}.clamped"], state[f"{name}.dropped"]
        self._strayed, self._calibration = state[f"{name}.strayed"], state[f"{name}.calibration"]
        self.guards = [(c.name, Guard(c, model.limits)) for c in model.commands]
        self._lanes = [(self.command[name], self.sent[name], guard) for name, guard in self.guards]
        self._watch = Watch(model.reads, self.reading)
        self._patience = max(1, round(model.limits.watchdog / period))
        self._every = max(1, round(model.cls.period / period))
        self._mount = self._frame = frame(model.mount)
        self._framed_for: list[float] = []
        error = model.mount_error
        self._true_frame = self._mount.moved((-error[0], -error[1], -error[2]))
        self.touch = Touch(ambient=model.ambient)
        self.twin: Twin | None = model.make_twin() if model.twin else None
        self.device: Device | None = None if model.twin else model.cls(model.params)
        has_twin_state = model.twin and any(n.startswith(f"{name}.twin.") for n in state)
        self.twin_state = state.part(f"{name}.twin.") if has_twin_state else Record(np.dtype([]))
        self.closing = 0.0

    @property
    def enabled(self) -> bool:
        """Whether commands are let through."""
        return bool(self._status.item() == _ENABLED)

    @property
    def status(self) -> Status:
        """What the device may do now."""
        return Status(int(self._status))

    def reset(self, seed: int) -> None:
        """Set the device's part of State to its start."""
        self._calibration[:] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        if self.twin is not None:
            words = [seed, *self.model.name.encode()]
            self.twin.reset(self.twin_state, np.random.default_rng(words))

    def open(self) -> None:
        """Open the device; CLOSED -> OPEN.

        Raises
        ------
        DeviceError
            If the device is missing or refuses.
        """
        if self.device is not None:
            self.device.open()
        self._status[...] = Status.OPEN

    def enable(self) -> None:
        """Let commands through from the state that was measured; OPEN -> ENABLED."""
        if self.status is not Status.OPEN:
            raise DeviceError(f"device '{self.model.name}' is {self.status.name}, it can't be enabled")
        self.rest_at_measured()
        self._status[...] = Status.ENABLED
        self._ramp[...] = 1.0 if self.model.twin else 0.0

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
        if self.status is Status.ENABLED:
            self._status[...] = Status.OPEN

    def close(self) -> None:
        """Send the safe command and release the device; any status -> CLOSED."""
        if self.status is Status.CLOSED:
            return
        try:
            self._send_safe()
        finally:
            self._status[...] = Status.CLOSED
            if self.device is not None:
                self.device.close()

    def read(self, tick: int) -> None:
        """Take the newest reading and check it."""
        status = self._status.item()
        if status == _CLOSED or tick % self._every:
            return
        try:
            if self.twin is not None:
                new = self.twin.read(self.twin_state, self.reading)
            elif self.device is not None:
                new = self.device.read(self.reading)
        except DeviceError as error:
            raise DeviceFaultError(self.model.name, tick, Trip.DEVICE_ERROR, f"failed: {error}") from error
        except Exception as error:
            cause = f"failed in read: {type(error).__name__}: {error}"
            raise DeviceFaultError(self.model.name, tick, Trip.DEVICE_ERROR, cause) from error
        if new is False:
            age = self._age.item() + self._every
            self._age[...] = age
            if age > self._patience and status == _ENABLED:
                cause = f"was silent for {age * self._period:.3f} s"
                raise DeviceFaultError(self.model.name, tick, Trip.SILENT, cause)
            return
        if self._age.item():
            self._age[...] = 0
        self._sequence[...] = self._sequence.item() + 1
        if status != _FAULT:
            try:
                self._watch.check()
            except TripError as error:
                raise DeviceFaultError(self.model.name, tick, error.trip, str(error)) from error

    def write(self, tick: int) -> None:
        """Send the commands through the guards; only safe ones unless ENABLED."""
        status = self._status.item()
        if status == _CLOSED:
            return
        if status != _ENABLED:
            self._send_safe()
            return
        ramp = self._ramp.item()
        if ramp < 1.0:
            ramp = min(1.0, ramp + self._period / default.RAMP)
            self._ramp[...] = ramp
        try:
            for wanted, sent, guard in self._lanes:
                clamped, dropped = guard.limit(wanted, sent, ramp, self._period, self.closing)
                if clamped:
                    self._clamped += clamped
                if dropped:
                    self._dropped += dropped
            if self.device is not None:
                self.device.write(self.sent)
        except TripError as error:
            raise DeviceFaultError(self.model.name, tick, error.trip, str(error)) from error
        except DeviceError as error:
            raise DeviceFaultError(self.model.name, tick, Trip.DEVICE_ERROR, f"failed: {error}") from error
        except Exception as error:
            cause = f"failed in write: {type(error).__name__}: {error}"
            raise DeviceFaultError(self.model.name, tick, Trip.DEVICE_ERROR, cause) from error

    def fault(self, trip: Trip) -> None:
        """Latch a trip and make the device safe now; what the device raises meanwhile can't help any more."""
        self._status[...] = Status.FAULT
        self._trip[...] = trip
        with contextlib.suppress(Exception):  # the device is lost; the others must still be made safe
            self._send_safe()

    def _send_safe(self) -> None:
        for name, guard in self.guards:
            guard.safe(self.sent[name], self._period)
        if self.device is not None:
            self.device.write(self.sent)

    def check_tracking(self, tick: int, distance: float) -> None:
        """Trip if a carried surface stays too far from its command for too long."""
        if distance <= default.TRACKING_TRIP:
            if self._strayed.item():
                self._strayed[...] = 0
            return
        self._strayed[...] = self._strayed.item() + 1
        if self._strayed.item() * self._period > default.TRACKING_TIME:
            cause = f"is {distance * 1e3:.1f} mm from its command"
            raise DeviceFaultError(self.model.name, tick, Trip.TRACKING, cause)

    def base_frame(self) -> Frame:
        """Return the device's frame in its carrier, as mount and calibration say."""
        calibration = self._calibration.tolist()
        if calibration != self._framed_for:  # composed anew only when a calibration has changed
            self._framed_for = calibration
            self._frame = self._mount.compose(frame(calibration))
        return self._frame

    def true_frame(self) -> Frame:
        """Return the twin's true frame in its carrier."""
        return self._true_frame

    def step_twin(self) -> None:
        """Advance the twin by one period under what was sent."""
        if self.twin is not None:
            self.twin.step(self.twin_state, self.sent, self.touch, self._period)

    def true_position(self) -> NDArray[np.float64] | None:
        """Return the view of State that is the true position of what the twin carries, in its frame."""
        return self.twin.position(self.twin_state) if self.twin is not None else None


def _part(state: Record, prefix: str, channels: Sequence[Channel]) -> Record:
    names = [channel.name for channel in channels]
    return state.part(prefix, names) if names else Record(np.dtype([]))
