"""The USB side of the arm: a serial chip (FT232R) driven through pyusb, found by its USB ids; one error per cause."""

from __future__ import annotations

import contextlib
import errno
import math
from types import TracebackType
from typing import Any, Self

from itouch.plugin import Trace, schema
from itouch_usb_arm.errors import Disconnected, FalconError, NotFound, PermissionDenied, ProtocolError, Timeout
from itouch_usb_arm.wire import PRODUCT, VENDOR

#: The arm's endpoints.
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


def find(backend: Any, serial: str = "any") -> list[Any]:
    """Return the pyusb devices of the attached arms, at least one.

    Raises
    ------
    NotFound
        If none is attached, or there is no USB library to look for one.
    PermissionDenied
        If a serial number is asked for and this user may not read it.
    """
    import usb.core

    try:
        devices = list(usb.core.find(find_all=True, idVendor=VENDOR, idProduct=PRODUCT, backend=backend))
    except usb.core.NoBackendError as error:
        raise NotFound("there is no USB library: install libusb-1.0 (Debian: apt install libusb-1.0-0)") from error
    except TimeoutError as error:  # of a server: the system's own bus answers at once
        raise NotFound("no answer in time: is a USB/IP server running there?") from error
    except OSError as error:
        raise NotFound(f"the USB bus cannot be searched: {error.strerror or error}") from error
    if serial != "any":
        devices = _with_serial(devices, serial)
    if not devices:
        wanted = "" if serial == "any" else f" with serial number '{serial}'"
        raise NotFound(f"no arm ({VENDOR:04x}:{PRODUCT:04x}){wanted} is attached: plug it in and power it")
    return devices


def _with_serial(devices: list[Any], wanted: str) -> list[Any]:
    """Return the devices with a serial number; an unreadable one is an error only if no other device has it."""
    found, refused = [], None
    for device in devices:
        try:
            if (device.serial_number or "") == wanted:
                found.append(device)
        except (OSError, ValueError, NotImplementedError) as error:
            if kind_of(error) == "access" or isinstance(error, ValueError):  # pyusb: "has no langid (permission issue)"
                refused = error
    if refused is not None and not found:
        raise PermissionDenied(str(refused)) from refused
    return found


#: Meaning of error numbers on any system, and of libusb's codes where a backend gives no errno.
_NUMBERS = {
    errno.ETIMEDOUT: "timeout", 110: "timeout", 60: "timeout", 10060: "timeout", errno.EPIPE: "stall", 32: "stall",
    errno.EACCES: "access", errno.EPERM: "access", errno.EBUSY: "busy", errno.ENODEV: "gone", errno.ENOENT: "gone",
    errno.EINTR: "again", errno.EAGAIN: "again",
}  # fmt: skip
_LIBUSB = {-3: "access", -4: "gone", -5: "gone", -6: "busy", -7: "timeout", -9: "stall", -10: "again"}


def kind_of(error: BaseException) -> str:
    """Classify an error: timeout, stall, access, busy, gone, again (nothing yet), or other."""
    if type(error).__name__ == "USBTimeoutError":
        return "timeout"
    number = getattr(error, "errno", None)
    if number in _NUMBERS:
        return _NUMBERS[number]
    if number is None:
        found = _LIBUSB.get(getattr(error, "backend_error_code", None) or 0)
        if found is not None:
            return found
        if "timed out" in str(error).lower() or "timeout" in str(error).lower():
            return "timeout"
    return "other"


class Link:
    """An open arm: control requests, and bytes in both directions; ``patience`` is a factor on its timeouts."""

    def __init__(self, device: Any, trace: Trace | None = None, *, patience: float = 1.0) -> None:
        self._device, self._trace, self._detached = device, trace, False
        self._write_ms, self._control_ms = round(_WRITE_MS * patience), round(_CONTROL_MS * patience)
        try:
            self._claim()
        except (OSError, NotImplementedError) as error:
            self.close()
            raise _opening(error) from error

    def _claim(self) -> None:
        import usb.util

        self._detach()
        try:
            self._device.get_active_configuration()
        except (OSError, NotImplementedError) as error:
            if kind_of(error) in ("access", "gone"):
                raise
            self._device.set_configuration()
        try:
            usb.util.claim_interface(self._device, 0)
        except OSError as error:
            if kind_of(error) != "busy":
                raise
            with contextlib.suppress(NotImplementedError, OSError):  # a kernel driver that the system does not report
                self._device.detach_kernel_driver(0)
                self._detached = True
            usb.util.claim_interface(self._device, 0)

    def _detach(self) -> None:
        """Detach the kernel driver that holds the arm, if any; closing the link attaches it again."""
        with contextlib.suppress(NotImplementedError, OSError):
            if self._device.is_kernel_driver_active(0):
                self._device.detach_kernel_driver(0)
                self._detached = True

    def close(self) -> None:
        """Release the interface; an arm that is already gone is no error."""
        import usb.util

        with contextlib.suppress(Exception):
            usb.util.release_interface(self._device, 0)
        if self._detached:
            self._detached = False
            with contextlib.suppress(Exception):
                self._device.attach_kernel_driver(0)
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
            self._device.ctrl_transfer(_TO_CHIP, request, value, 0, None, self._control_ms)
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
        sent = 0
        while sent < len(data):  # a short write is legal: the rest follows
            try:
                written = self._device.write(OUT, data[sent:], self._write_ms)
            except OSError as error:
                raise self._failure(error, "writing") from error
            if not written:
                raise ProtocolError(f"only {sent} of {len(data)} bytes could be sent to the arm")
            sent += written

    def receive(self, wait: float) -> bytes:
        """Return the bytes that arrive within ``wait`` seconds, without status bytes; receiving none is no error.

        The chip sends its status alone whenever its latency timer expires.

        Raises
        ------
        FalconError
            If it fails.
        """
        try:
            packets = bytes(self._device.read(IN, PACKET, max(1, math.ceil(wait * 1e3))))
        except OSError as error:
            if kind_of(error) in ("timeout", "again"):
                return b""
            raise self._failure(error, "reading") from error
        data = b"".join(packets[at + STATUS : at + PACKET] for at in range(0, len(packets), PACKET))
        if data and self._trace:
            self._trace.received(data)
        return data

    def _failure(self, error: OSError, what: str) -> FalconError:
        kind = kind_of(error)
        if kind in ("timeout", "again"):
            return Timeout(f"{what} to the arm took too long")
        if kind == "stall":
            for endpoint in (OUT, IN):
                with contextlib.suppress(Exception):
                    self._device.clear_halt(endpoint)
            return ProtocolError(f"the arm refused {what} (stalled endpoint)")
        if self._trace:
            self._trace.remark(f"lost: {error}")
        return Disconnected(f"the arm is gone: {what} failed ({error.strerror or error})")


def _opening(error: Exception) -> FalconError:
    kind, reason = kind_of(error), getattr(error, "strerror", None) or str(error)
    if kind == "access":
        return PermissionDenied(reason)
    if kind == "busy":
        return FalconError("another program uses the arm; end it first")
    if kind == "gone":
        return Disconnected("the arm was unplugged while it was opened")
    return FalconError(f"the arm cannot be opened: {reason}")


class Remote:
    """An arm on another machine, or a virtual one: pyusb over USB/IP, with the package ``pyusb-usbip-backend``.

    It is the connection to a USB/IP server; `Falcon` takes its ``backend``.

    Raises
    ------
    FalconError
        If the address is malformed, or the package is missing.
    """

    def __init__(self, address: str) -> None:
        try:
            host, port = schema.host_port(address)
        except ValueError as error:
            raise FalconError(f"usbip = {error}, for example 127.0.0.1:3240") from error
        try:
            from usbip_backend import get_backend
        except ImportError as error:
            raise FalconError("an arm over USB/IP needs another package: pip install pyusb-usbip-backend") from error
        self.backend: Any = get_backend(host, port)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections: the package would keep them open, and a server lends an arm to one host at a time."""
        connections: dict[Any, Any] = getattr(self.backend, "_conns", {})
        for connection in connections.values():
            with contextlib.suppress(OSError):
                connection.close()
        connections.clear()
