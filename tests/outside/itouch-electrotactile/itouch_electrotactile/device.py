"""The device 'electrotactile': pulses of current through the skin; it measures what really flows."""

from dataclasses import dataclass

from itouch.plugin import Channel, Device, Role, schema


@dataclass(frozen=True)
class ElectrotactileParams:
    """What <electrotactile:hardware .../> may hold."""

    width: float = schema.quantity("s", low=1e-5, high=1e-3, default=2e-4, doc="width of a pulse")


class Electrotactile(Device):
    """One electrode: amplitude and rate of its pulses are commanded, the current that flows is read."""

    Params = ElectrotactileParams
    reads = (
        Channel("amplitude", 1, "A", (0.0,), (0.02,), role=Role.DELIVERED_DRIVE, doc="amplitude that really flows"),
    )
    commands = (
        Channel("amplitude", 1, "A", (0.0,), (0.01,), safe=(0.0,), role=Role.ELECTRODE, doc="amplitude of a pulse"),
        Channel("rate", 1, "Hz", (0.0,), (200.0,), safe=(0.0,), doc="pulses a second"),
    )
    watchdog = 0.1

    def open(self):
        """Nothing is behind this example but its ideal twin."""

    def close(self):
        """Nothing to release."""

    def read(self, reading):
        """Say that nothing flows."""
        reading["amplitude"] = 0.0
        return True
