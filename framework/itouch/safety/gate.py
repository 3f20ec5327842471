"""Stands between the loop and one device: in through it come readings, checked; out go commands, limited."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from typing import Protocol

from itouch.monitors import LOSSES, DeviceFaultError, Heat, Push, Trip, TripError
from itouch.plugin import Device, Record, Twin
from itouch.safety.acquisition import Acquisition
from itouch.safety.actuation import Actuation
from itouch.safety.device_link import DeviceLink, part
from itouch.safety.device_monitors import InstalledMonitor
from itouch.safety.latch import CLOSED, FAULT
from itouch.world import DeviceModel


class SharedFinger(Protocol):
    """A finger on which several plates act."""

    @property
    def plates(self) -> Sequence[InstalledMonitor]:
        """The monitors of its plates."""

    def spent(self) -> str:
        """Return the words for a budget of the finger that is used up; empty: none is."""


class Gate:
    """Stands between the loop and one device, or its twin, on its part of State.

    What comes in is the matter of ``acquisition``, what goes out that of ``actuation``; here both are made safe.
    """

    def __init__(
        self, model: DeviceModel, state: Record, period: float, *, device: Device | None = None,
        twin: Twin | None = None,
    ) -> None:  # fmt: skip
        self.model = model
        #: The device, or its twin, and its latch.
        self.link = DeviceLink(model, state, device, twin)
        self.latch, self.twin_state = self.link.latch, self.link.twin_state
        self.reading = part(state, f"{model.name}.", model.reads)
        self.command = part(state, f"{model.name}.command.", model.commands)
        self.sent = part(state, f"{model.name}.sent.", model.commands)
        self.acquisition = Acquisition(self.link, state, period, self.reading, self.sent, self._fail)
        self.actuation = Actuation(self.link, state, period, self.command, self.sent, self.acquisition, self._fail)
        #: The monitors in force.
        self.device_monitors = self.acquisition.device_monitors
        #: The monitors of its plates.
        self.heats = [post for post in self.device_monitors.installed if isinstance(post.monitor, Heat)]
        #: Whether it presses by a fluid, and measures the force.
        self.presses = any(isinstance(post.monitor, Push) for post in self.device_monitors.installed)
        #: What went wrong with it the last time that a stop met an error of it, in words.
        self.trouble = ""
        #: The fingers on which other plates act, too, and which therefore share a budget among them.
        self.shared: list[SharedFinger] = []
        #: Called at the loss of an optional device, without which the session goes on; None: its loss stops everything.
        self.on_loss: Callable[[DeviceFaultError], None] | None = None

    @property
    def device(self) -> Device | None:
        """The device; None: a twin stands in for it, or it is not there."""
        return self.link.device

    @device.setter
    def device(self, other: Device | None) -> None:
        self.link.device = other

    @property
    def twin(self) -> Twin | None:
        """The twin that stands in for the device, if one does."""
        return self.link.twin

    @twin.setter
    def twin(self, other: Twin | None) -> None:
        self.link.twin = other

    def reset(self) -> None:
        """Set what is remembered to its start."""
        if self.actuation.way is not None:
            self.actuation.way[:] = math.nan
        self.device_monitors.reset()

    def restore(self) -> None:
        """Go on from a State that was restored."""
        self.latch.recall()
        self.device_monitors.restore()

    def forget(self) -> None:
        """Drop what was read before: it tells nothing about the device as it is now."""
        self.acquisition.forget()
        self.actuation.forget_way()

    def opened(self) -> None:
        """Drop what was read before, and what was sent: the device may stand elsewhere since it was opened."""
        self.forget()
        self.actuation.opened()

    def begin(self) -> None:
        """Begin from where the device stands, with the ramp that its limits ask for."""
        self.actuation.begin()
        self.device_monitors.begin()

    def spent(self) -> str:
        """Return the words for a budget that is used up, of the device or of a finger on which others act; or none."""
        return next(
            (words for words in (self.device_monitors.spent(), *(one.spent() for one in self.shared)) if words), ""
        )

    def read_anew(self, tick: int, until: float = 0.0) -> None:
        """Take a reading as the first one, and check it; see `Acquisition.read_anew`.

        Raises
        ------
        TripError
            If it can't be believed or is too old, or the device failed; then the last one that was believed is put
            back.
        """
        self.forget()
        self.acquisition.read_anew(tick, until)

    def read(self, tick: int) -> None:
        """Take the newest reading and check it.

        Raises
        ------
        DeviceFaultError
            If the device failed, was silent for too long, or reads something impossible or beyond a limit.
        """
        self.acquisition.take(tick)
        self.acquisition.watch(tick)

    def write(self, tick: int) -> None:
        """Limit the commands and send them; unless ENABLED, send safe ones.

        Raises
        ------
        DeviceFaultError
            If a command is not a number, or the device failed.
        """
        self.actuation.guard(tick)
        self.actuation.send(tick)

    def _fail(self, error: TripError, tick: int) -> None:
        """Stop because of a fault: all devices, unless this one is optional and merely lost, or is at fault already."""
        if self.latch.number == FAULT:
            return
        fault = DeviceFaultError(self.model.name, tick, error.trip, str(error))
        if self.on_loss is not None and fault.trip in LOSSES:
            self.fault(fault.trip, fault.tick)
            self.on_loss(fault)
            return
        raise fault from error

    def fault(self, trip: Trip, tick: int) -> None:
        """Latch a trip and make the device safe now; what the device raises meanwhile is dropped."""
        self.latch.stop(trip, tick)
        self.actuation.ramp_in()
        if self.latch.number == CLOSED:  # a thread may be opening it
            return
        with contextlib.suppress(TripError):  # the device is lost; the others must still be made safe
            self.actuation.send_safe()

    def verify(self, tick: int) -> bool:
        """Take the newest reading to verify that the device is safe; tell whether it answered.

        A reading that can't be believed is a fault of its own here: it is latched, but nothing is raised.
        """
        answered, error = self.acquisition.verify(tick)
        if error is not None and self.latch.number != FAULT:
            self.trouble = str(error)
            self.fault(error.trip, tick)
        if not self.device_monitors.usable():
            self.device_monitors.mend()
        return answered
