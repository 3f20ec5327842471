"""The USB descriptors of the virtual arm: an FT232R with the arm's USB ids, full speed, two bulk endpoints."""

from __future__ import annotations

from itouch_usb_arm.link import IN, OUT, PACKET
from itouch_usb_arm.wire import PRODUCT, VENDOR

CONFIGURATION_VALUE = 1
_CURRENT = 50  # in units of 2 mA

DEVICE = bytes(
    (18, 1, 0x00, 0x02, 0, 0, 0, 8)
    + (VENDOR & 255, VENDOR >> 8, PRODUCT & 255, PRODUCT >> 8, 0x00, 0x06)
    + (0, 0, 0, 1)
)
_INTERFACE = bytes((9, 4, 0, 0, 2, 0xFF, 0xFF, 0xFF, 0))
_ENDPOINTS = bytes((7, 5, IN, 2, PACKET, 0, 0)) + bytes((7, 5, OUT, 2, PACKET, 0, 0))
CONFIGURATION = (
    bytes((9, 2, 9 + len(_INTERFACE) + len(_ENDPOINTS), 0, 1, CONFIGURATION_VALUE, 0, 0xA0, _CURRENT))
    + _INTERFACE
    + _ENDPOINTS
)
