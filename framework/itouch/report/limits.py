"""The limits in force, in words: what, how much, and who has set it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from itouch.world import DeviceModel
from itouch.world.limits import DEFAULT


class LimitRow(NamedTuple):
    """One limit in force for one device."""

    device: str
    name: str
    value: str
    source: str


_SHOWN: dict[str, tuple[float, str]] = {
    "force": (1.0, "N"), "speed": (1.0, "m/s"), "speed_near": (1.0, "m/s"), "current": (1.0, "A"),
    "plate_force": (1.0, "N"), "contact_time": (1.0, "s"), "plate_rate": (1.0, "K/s"), "flux": (1e-3, "kW/m^2"),
    "dose": (1.0 / 60.0, "min CEM43"), "watchdog": (1e3, "ms"),
}  # fmt: skip


def limit_rows(device: DeviceModel) -> Iterator[LimitRow]:
    """Yield the limits in force for a device."""
    for name, value in device.limits.table().items():
        source = device.limits.sources.get(name, DEFAULT)
        if isinstance(value, tuple):
            low, high = (kelvin - 273.15 for kelvin in value)
            shown = f"{low:.4g} to {high:.4g} degC"
        else:
            factor, unit = _SHOWN[name]
            shown = f"{value * factor:.4g} {unit}"
        yield LimitRow(device.name, name.replace("_", "-"), shown, source)


def limit_line(device: DeviceModel) -> str:
    """Return the limits in force for a device as one line."""
    listed = ", ".join(f"{row.name} {row.value} ({row.source})" for row in limit_rows(device))
    return f"limits of {device.name}: {listed}"
