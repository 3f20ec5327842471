"""Records of a device's channels, for tests that call a driver without an engine."""

from __future__ import annotations

from typing import Any

from itouch.plugin import Device, Field, Record


def records(device: Device | type[Device], params: Any = None) -> tuple[Record, Record]:
    """Return a new reading and a new command of a device; of a class, with these parameters."""
    reads, commands = device.channels(device.params if isinstance(device, Device) else params)
    return Record.of(Field.of(c) for c in reads), Record.of(Field.of(c) for c in commands)
