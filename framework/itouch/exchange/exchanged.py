"""What stands for a device and calls its methods at another time than it is called itself."""

from __future__ import annotations

import math

from itouch.plugin import Device
from itouch.plugin.timestamps import Timestamped


class Exchanged(Device, Timestamped):
    """Stands for ``device``: what that raises comes up later, in whichever method is called next."""

    def __init__(self, device: Device) -> None:
        super().__init__(device.params)
        self.device = device
        #: The method of the device that was called last, by its name: the one that has failed, if one has.
        self.called = "open"
        #: Lowest height [m] to which a surface may retract by itself once its commands are no longer renewed; infinite:
        #: it stays where it was sent last; NaN: to the end of its travel.
        self.lowest = math.nan

    @property
    def hangs_in(self) -> str:
        """The device's method that has not returned and is no longer waited for: until then nobody may call it."""
        return ""


def failed_in(device: Device | None, method: str) -> str:
    """Return the method of the driver that has failed, where ``method`` has raised."""
    return device.called if isinstance(device, Exchanged) else method


def still_inside(method: str) -> str:
    """Return why a device can't be opened while its driver has not returned from a method that was given up."""
    return (
        f"has not returned from its driver's `{method}` yet, and nobody waits for that any longer: open it again when "
        "it has returned, or end the session"
    )
