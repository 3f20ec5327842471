"""The USB side of the arm: a serial chip (FT232R) behind pyusb, found by its numbers, with its errors by name."""

from __future__ import annotations

import contextlib
import errno
import math
from typing import Any

from itouch.plugin import Trace
from itouch_usb_arm.errors import Disconnected, FalconError, NotFound, PermissionDenied, ProtocolError, Timeout

VENDOR, PRODUCT = 0x0403, 0xCB48
OUT, IN = 0x02, 0x81
#: A packet from the chip: two bytes of modem status, then at most this many bytes of data.
PACKET, STATUS = 64, 2
PAYLOAD = PACKET - STATUS

# Requests of the serial chip.
RESET, MODEM, FLOW, BAUD, DATA, LATENCY = 0, 1, 2, 3, 4, 9
PURGE_RECEIVED, PURGE_SENT = 1, 2
RTS_LOW, DTR_LOW, DTR_HIGH = 0x0200, 0x0100, 0x0101
BAUD_9600, BAUD_142857, BAUD_RUN = 0x4138, 0x0015, 0x0002
_TO_CHIP = 0x40
_WRITE_MS, _CONTROL_MS = 200, 500
_NAMES = {RESET: "purge", MODEM: "modem", FLOW: "flow", BAUD: "baud", DATA: "data bits", LATENCY: "latency"}


def find(backend: Any, serial: str) -> Any:
    """Return the pyusb device of the arm.

    Raises
    ------
    NotFound
        If none is attached, or there is no USB library to look for one.
    PermissionDenied
        If its serial number is asked for and may not be read.
    """
    import usb.core

    try:
        devices = list(usb.core.find(find_all=True, idVendor=VENDOR, idProduct=PRODUCT, backend=backend))
    except usb.core.NoBackendError as error:
        raise NotFound("there is no USB library: install libusb-1.0 (Debian: apt install libusb-1.0-0)") from error
    except OSError as error:
        raise NotFound(f"the USB bus cannot be searched: {error.strerror or error}") from error
    if serial != "any":
        devices = [device for device in devices if _serial(device) == serial]
    if not devices:
        wanted = "" if serial == "any" else f" with serial number '{serial}'"
        raise NotFound(f"no arm ({VENDOR:04x}:{PRODUCT:04x}){wanted} is attached: plug it in and power it")
    return devices[0]


def _serial(device: Any) -> str:
    try:
        return device.serial_number or ""
    except (OSError, ValueError, NotImplementedError) as error:
        if getattr(error, "errno", None) == errno.EACCES or isinstance(error, ValueError):
            raise PermissionDenied(str(error)) from error
        return ""


class Link:
    """An open arm: control requests, bytes out, bytes in."""

    def __init__(self, device: Any, trace: Trace | None = None) -> None:
        self._device, self._trace = device, trace
        try:
            self._claim()
        except OSError as error:
            self.close()
            raise _opening(error) from error

    def _claim(self) -> None:
        import usb.core
        import usb.util

        try:
            self._device.get_active_configuration()
        except (usb.core.USBError, NotImplementedError) as error:
            if getattr(error, "errno", None) in (errno.EACCES, errno.EPERM, errno.ENODEV):
                raise
            self._device.set_configuration()
        try:
            usb.util.claim_interface(self._device, 0)
        except usb.core.USBError as error:
            if error.errno != errno.EBUSY:
                raise
            with contextlib.suppress(NotImplementedError):
                self._device.detach_kernel_driver(0)
            usb.util.claim_interface(self._device, 0)

    def close(self) -> None:
        """Release the interface; an arm that is gone is no error here."""
        import usb.util

        with contextlib.suppress(Exception):
            usb.util.release_interface(self._device, 0)
        with contextlib.suppress(Exception):
            usb.util.dispose_resources(self._device)

    def control(self, request: int, value: int) -> None:
        """Send a request to the serial chip.

        Raises
        ------
        FalconError
            If it fails.
        """
        if self._trace:
            self._trace.remark(f"{_NAMES.get(request, request)} 0x{value:04x}")
        try:
            self._device.ctrl_transfer(_TO_CHIP, request, value, 0, None, _CONTROL_MS)
        except OSError as error:
            raise self._failure(error, "a control request") from error

    def send(self, data: bytes) -> None:
        """Write bytes to the arm.

        Raises
        ------
        FalconError
            If it fails or takes too long.
        """
        if self._trace:
            self._trace.sent(data)
        try:
            written = self._device.write(OUT, data, _WRITE_MS)
        except OSError as error:
            raise self._failure(error, "writing") from error
        if written != len(data):
            raise ProtocolError(f"only {written} of {len(data)} bytes could be sent to the arm")

    def receive(self, wait: float) -> bytes:
        """Return what came within ``wait`` seconds without the status bytes; nothing is no error.

        The chip answers with its status alone at each tick of its latency timer.

        Raises
        ------
        FalconError
            If it fails.
        """
        import usb.core

        try:
            packets = bytes(self._device.read(IN, PACKET, max(1, math.ceil(wait * 1e3))))
        except usb.core.USBTimeoutError:
            return b""
        except OSError as error:
            if error.errno == errno.ETIMEDOUT:
                return b""
            raise self._failure(error, "reading") from error
        data = b"".join(packets[at + STATUS : at + PACKET] for at in range(0, len(packets), PACKET))
        if data and self._trace:
            self._trace.received(data)
        return data

    def _failure(self, error: OSError, what: str) -> FalconError:
        if error.errno == errno.ETIMEDOUT or type(error).__name__ == "USBTimeoutError":
            return Timeout(f"{what} to the arm took too long")
        if error.errno == errno.EPIPE:
            for endpoint in (OUT, IN):
                with contextlib.suppress(Exception):
                    self._device.clear_halt(endpoint)
            return ProtocolError(f"the arm refused {what} (stalled endpoint)")
        if self._trace:
            self._trace.remark(f"lost: {error}")
        return Disconnected(f"the arm is gone: {what} failed ({error.strerror or error})")


def _opening(error: OSError) -> FalconError:
    if error.errno in (errno.EACCES, errno.EPERM):
        return PermissionDenied(error.strerror or str(error))
    if error.errno == errno.EBUSY:
        return FalconError("another program uses the arm; end it first")
    if error.errno in (errno.ENODEV, errno.ENOENT):
        return Disconnected("the arm was unplugged while it was opened")
    return FalconError(f"the arm cannot be opened: {error.strerror or error}")
