"""The limits in force, in words: what, how much, and who has set it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from itouch.world import DeviceModel
from itouch.world.limits import DEFAULT
from itouch.world.limitwords import shown


class LimitRow(NamedTuple):
    """One limit in force for one device."""

    device: str
    name: str
    value: str
    source: str


def limit_rows(device: DeviceModel) -> Iterator[LimitRow]:
    """Yield the limits in force for a device."""
    for name, value in device.limits.table().items():
        source = device.limits.sources.get(name, DEFAULT)
        yield LimitRow(device.name, name.replace("_", "-"), shown(name, value), source)


def limit_line(device: DeviceModel) -> str:
    """Return the limits in force for a device as one line."""
    listed = ", ".join(f"{row.name} {row.value} ({row.source})" for row in limit_rows(device))
    return f"limits of {device.name}: {listed}"
