"""A USB haptic arm (Novint Falcon): its driver, the device plugin, and a virtual arm to test them with."""

from itouch_usb_arm.arm import UsbArm, UsbArmParams, UsbArmTwin
from itouch_usb_arm.errors import (
    Disconnected,
    FalconError,
    FirmwareError,
    HomingTimeout,
    NotFound,
    NotHomed,
    PermissionDenied,
    ProtocolError,
    Timeout,
)
from itouch_usb_arm.falcon import FORCE_SCALE, Falcon
from itouch_usb_arm.reading import Reading
from itouch_usb_arm.wire import Buttons, Leds

__all__ = [
    "FORCE_SCALE",
    "Buttons",
    "Disconnected",
    "Falcon",
    "FalconError",
    "FirmwareError",
    "HomingTimeout",
    "Leds",
    "NotFound",
    "NotHomed",
    "PermissionDenied",
    "ProtocolError",
    "Reading",
    "Timeout",
    "UsbArm",
    "UsbArmParams",
    "UsbArmTwin",
]
