"""Warm-up of checks and limits on a scratch copy of State, so that no tick has to load or compile anything for them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from itouch.monitors import DeviceFaultError, Trip, TripError
from itouch.plugin import Record
from itouch.safety.gate import Gate
from itouch.safety.latch import ENABLED
from itouch.world import DeviceModel


def warm_up(model: DeviceModel, scratch: Record, period: float) -> None:
    """Call everything that a tick may call for a device, through the same methods, first untouched, then touched.

    Whatever trips meanwhile trips on scratch State; no device and no twin is there that anything could reach.
    """
    gate = Gate(model, scratch, period)
    gate.reset()
    for channel in model.reads:
        if channel.unit == "K":
            gate.reading[channel.name][...] = model.ambient
    for touched in (False, True):
        moment = gate.device_monitors.moment
        moment.gap, moment.calibrated, moment.touched = (-1e-3, True, True) if touched else (1.0, False, False)
        for act in _acts(gate, touched):
            gate.latch.become(ENABLED)
            with contextlib.suppress(TripError, DeviceFaultError):
                act()
    gate.fault(Trip.DEVICE_ERROR, 0)


def _acts(gate: Gate, touched: bool) -> Iterator[Callable[[], object]]:
    """Yield what a tick may call: a reading, every monitor, and every command."""
    tick = int(touched)
    yield lambda: gate.acquisition.believe(tick, ENABLED)
    yield lambda: gate.acquisition.look(tick)
    yield lambda: gate.acquisition.wait(tick, ENABLED)
    yield lambda: gate.acquisition.watch_placed(tick)
    yield lambda: gate.device_monitors.count_contact(tick, touched)
    yield lambda: gate.device_monitors.closing(gate.device_monitors.moment.gap, 0.0)
    yield lambda: gate.device_monitors.follow(0.0, not touched, 0.0)
    yield lambda: gate.actuation.guard(tick)
    yield lambda: gate.verify(tick)
