"""Errors of the USB arm, one class for each cause."""

from __future__ import annotations

from itouch.plugin import DeviceError
from itouch.plugin.usb_permission import permission_advice
from itouch_usb_arm.wire import PRODUCT, VENDOR


class FalconError(DeviceError):
    """The arm is missing, refuses, or has failed."""


class NotFound(FalconError):  # noqa: N818
    """No arm is attached, or there is no USB library to look for one."""


class PermissionDenied(FalconError):  # noqa: N818
    """The arm is attached but this user may not open it; the message holds the udev rule."""

    def __init__(self, reason: str) -> None:
        super().__init__(
            f"no permission to open the arm ({reason}); {permission_advice(f'{VENDOR:04x}', f'{PRODUCT:04x}')}"
        )


class Disconnected(FalconError):  # noqa: N818
    """The arm was unplugged; open it again after plugging it in."""


class Timeout(FalconError, TimeoutError):  # noqa: N818
    """The arm did not answer in time."""


class ProtocolError(FalconError):
    """The arm sent an invalid frame, or an impossible position."""


class FirmwareError(FalconError):
    """The firmware is missing, its file is not valid, or it could not be uploaded."""


class NotHomed(FalconError):  # noqa: N818
    """Not all axes are homed: positions mean nothing yet, and no force may be sent."""


class HomingTimeout(NotHomed, Timeout):
    """The grip was not pulled out and pushed in within the time allowed."""
