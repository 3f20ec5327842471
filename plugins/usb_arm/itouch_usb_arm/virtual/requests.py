"""Control transfers of the virtual arm: standard USB requests and those of the serial chip, from setup packets."""

from __future__ import annotations

import struct

from itouch_usb_arm.virtual import descriptors
from itouch_usb_arm.virtual.virtual_falcon import StalledError, VirtualFalcon

_GET_STATUS, _CLEAR_FEATURE, _GET_DESCRIPTOR, _GET_CONFIGURATION = 0, 1, 6, 8
_SET_CONFIGURATION, _SET_INTERFACE = 9, 11
_VENDOR_OUT, _VENDOR_IN = 0x40, 0xC0


def control(arm: VirtualFalcon, setup: bytes) -> bytes:
    """Execute the request in a setup packet of eight bytes; return the data stage of an IN request.

    Raises
    ------
    StalledError
        For a request that the arm does not know.
    """
    kind, request, value, _, length = struct.unpack("<BBHHH", setup)
    if kind == _VENDOR_OUT:
        arm.control(request, value)
        return b""
    if kind == _VENDOR_IN:
        return b"\x01\x60"[:length]
    return _standard(arm, kind, request, value)[:length]


def _standard(arm: VirtualFalcon, kind: int, request: int, value: int) -> bytes:
    if request == _GET_DESCRIPTOR and kind == 0x80:
        if value >> 8 == 1:
            return descriptors.DEVICE
        if value >> 8 == 2:
            return descriptors.CONFIGURATION
    elif request == _GET_CONFIGURATION:
        return bytes((arm.configuration,))
    elif request == _GET_STATUS:
        return b"\0\0"
    elif request == _SET_CONFIGURATION:
        arm.configuration = value
        return b""
    elif request in (_SET_INTERFACE, _CLEAR_FEATURE):
        return b""
    raise StalledError(f"request {kind:#x} {request}")
