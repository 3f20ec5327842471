"""Discovery: which arms are attached, whether they can be used, and how fast they answer."""

from __future__ import annotations

from typing import Any

from itouch.plugin import Attached
from itouch_usb_arm.errors import FalconError, FirmwareError, NotFound
from itouch_usb_arm.falcon import Falcon
from itouch_usb_arm.link import find
from itouch_usb_arm.wire import PRODUCT, VENDOR

#: Number of frames without force over which the latency is measured.
FRAMES = 200


def look(backend: Any = None) -> tuple[Attached, ...]:
    """Open each arm on the bus and exchange frames without force; its homing is kept."""
    try:
        devices = find(backend)
    except NotFound as error:
        return () if "is attached" in str(error) else (Attached("USB", False, str(error)),)
    return tuple(_look_at(device, several=len(devices) > 1) for device in devices)


def _look_at(device: Any, *, several: bool) -> Attached:
    where = f"Novint Falcon {VENDOR:04x}:{PRODUCT:04x}"
    if several:
        where += f" (bus {device.bus}, device {device.address})"
    try:
        with Falcon(device=device, resume=True) as arm:
            homed = False
            for _ in range(FRAMES):
                homed = arm.read().valid
            note = f"{arm.timing}, {'homed' if homed else 'not homed: pull the grip out, then push it in'}"
            return Attached(where, True, note)
    except FirmwareError:
        note = 'it was powered on and waits for its firmware: write firmware="FILE" in its <usb-arm:hardware>'
        return Attached(where, True, note)
    except FalconError as error:
        return Attached(where, False, str(error))
