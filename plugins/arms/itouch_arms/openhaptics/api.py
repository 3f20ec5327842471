"""The part of OpenHaptics' device interface (HDAPI) that we use: names, constants and signatures as in its header."""

from __future__ import annotations

import ctypes
import sys
from ctypes import POINTER, c_char_p, c_double, c_int, c_uint, c_ulong, c_ushort, c_void_p
from typing import Any

from itouch_arms.errors import NotFound

INVALID_HANDLE = 0xFFFFFFFF
SUCCESS = 0
# Parameters to read and set.
BUTTONS, POSITION, FORCE = 0x2000, 0x2050, 0x2700
MODEL, SERIAL, CALIBRATION_STYLE = 0x2501, 0x2504, 0x2555
MAX_FORCE = 0x2603
# Capabilities to enable.
FORCE_OUTPUT, FORCE_CLAMPING = 0x4000, 0x4001
# State of the calibration, and ways to calibrate.
OK, NEEDS_UPDATE, NEEDS_HAND = 0x5000, 0x5001, 0x5002
ENCODER_RESET, AUTOMATIC, INKWELL = 1, 2, 4
# What a scheduled callback returns.
DONE, CONTINUE = 0, 1
PRIORITY = 0xFFFF
#: Error codes.
WARM_MOTORS, COMM_ERROR, COMM_CONFIG, DEVICE_FAULT, LICENSE = 0x0200, 0x0302, 0x0303, 0x0300, 0x0600
ERRORS = {
    0x0100: "invalid enumeration", 0x0101: "invalid value", 0x0102: "invalid operation", 0x0103: "invalid input type",
    0x0104: "bad handle", WARM_MOTORS: "motors too warm", 0x0201: "greatest force exceeded",
    0x0202: "greatest change of force exceeded", 0x0203: "greatest velocity exceeded", 0x0204: "force error",
    DEVICE_FAULT: "device fault", 0x0301: "device already initiated", COMM_ERROR: "communication error",
    COMM_CONFIG: "communication configuration error", 0x0304: "timer error", 0x0400: "illegal begin of a frame",
    0x0401: "illegal end of a frame", 0x0402: "frame error", 0x0500: "invalid priority", 0x0501: "scheduler full",
    LICENSE: "invalid licence",
}  # fmt: skip


class ErrorInfo(ctypes.Structure):
    """An error: its code, the device's internal code, and the device's handle."""

    _fields_ = (("code", c_uint), ("internal", c_int), ("handle", c_uint))


Callback = ctypes.CFUNCTYPE(c_uint, c_void_p)
Vector = c_double * 3

_SIGNATURES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "hdInitDevice": (c_uint, (c_char_p,)),
    "hdDisableDevice": (None, (c_uint,)),
    "hdMakeCurrentDevice": (None, (c_uint,)),
    "hdBeginFrame": (None, (c_uint,)),
    "hdEndFrame": (None, (c_uint,)),
    "hdEnable": (None, (c_uint,)),
    "hdDisable": (None, (c_uint,)),
    "hdGetDoublev": (None, (c_uint, POINTER(c_double))),
    "hdSetDoublev": (None, (c_uint, POINTER(c_double))),
    "hdGetIntegerv": (None, (c_uint, POINTER(c_int))),
    "hdGetString": (c_char_p, (c_uint,)),
    "hdGetError": (ErrorInfo, ()),
    "hdCheckCalibration": (c_uint, ()),
    "hdUpdateCalibration": (None, (c_uint,)),
    "hdScheduleAsynchronous": (c_ulong, (Callback, c_void_p, c_ushort)),
    "hdUnschedule": (None, (c_ulong,)),
    "hdStartScheduler": (None, ()),
    "hdStopScheduler": (None, ()),
}


def load(library: str) -> Any:
    """Load the library from a file; empty: by its usual name.

    Raises
    ------
    NotFound
        If it cannot be loaded, or is not OpenHaptics.
    """
    name = library or ("HD.dll" if sys.platform == "win32" else "libHD.so")
    try:
        loaded = ctypes.CDLL(name)
    except OSError as error:
        raise NotFound(
            f"OpenHaptics is not installed: {name} cannot be loaded ({error}); install the arm's device driver and "
            'OpenHaptics from its maker, or write library="PATH"'
        ) from error
    return declared(loaded, name)


def declared(loaded: Any, name: str) -> Any:
    """Declare to ctypes the signatures of the functions that are used.

    Raises
    ------
    NotFound
        If a function is missing.
    """
    for function, (result, arguments) in _SIGNATURES.items():
        try:
            found = getattr(loaded, function)
        except AttributeError as error:
            raise NotFound(f"{name} is not OpenHaptics: it has no function {function}") from error
        found.restype, found.argtypes = result, arguments
    return loaded
