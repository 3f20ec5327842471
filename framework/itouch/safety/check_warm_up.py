"""Warm-up of checks and limits on a scratch copy of State, so that no tick has to load or compile anything for them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from itouch.monitors import DeviceFaultError, Trip, TripError
from itouch.plugin import Record
from itouch.safety.lifecycle import ENABLED
from itouch.safety.supervisor import Supervisor
from itouch.world import DeviceModel


def warm_up(model: DeviceModel, scratch: Record, period: float) -> None:
    """Call everything that a tick may call for a device, through the same methods, first untouched, then touched.

    Whatever trips meanwhile trips on scratch State; no device and no twin is there that anything could reach.
    """
    _Rehearsed(model, scratch, period).warm_up()


class _Rehearsed(Supervisor):
    """A supervisor without a device."""

    def warm_up(self) -> None:
        """Go through a reading, every monitor, and every command, then through a fault."""
        self.reset()
        for channel in self.model.reads:
            if channel.unit == "K":
                self.reading[channel.name][...] = self.model.ambient
        for touched in (False, True):
            moment = self.device_monitors.moment
            moment.gap, moment.calibrated, moment.touched = (-1e-3, True, True) if touched else (1.0, False, False)
            for act in self._acts(touched):
                self.become(ENABLED)
                with contextlib.suppress(TripError, DeviceFaultError):
                    act()
        self.fault(Trip.DEVICE_ERROR, 0)

    def _acts(self, touched: bool) -> Iterator[Callable[[], object]]:
        tick = int(touched)
        yield lambda: self._believe(tick, ENABLED)
        yield lambda: self.look(tick)
        yield lambda: self._wait(tick, ENABLED)
        yield lambda: self.watch_placed(tick)
        yield lambda: self.device_monitors.count_contact(tick, touched)
        yield lambda: self.device_monitors.closing(self.device_monitors.moment.gap, 0.0)
        yield lambda: self.device_monitors.follow(0.0, not touched, 0.0)
        yield lambda: self.guard(tick)
        yield lambda: self.glance(tick)
