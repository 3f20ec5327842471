"""The virtual arm as a pyusb backend, on every operating system; all other parts of pyusb are the real ones."""

from __future__ import annotations

import errno
import struct
from array import array
from types import SimpleNamespace
from typing import Any

import usb.backend
import usb.core

from itouch_usb_arm.link import IN, OUT, PACKET
from itouch_usb_arm.virtual import descriptors
from itouch_usb_arm.virtual.requests import control
from itouch_usb_arm.virtual.virtual_falcon import StalledError, UnpluggedError, VirtualFalcon
from itouch_usb_arm.wire import PRODUCT, VENDOR


class VirtualBackend(usb.backend.IBackend):
    """A bus with one virtual arm; if ``denied``, the user may not open it."""

    def __init__(self, arm: VirtualFalcon, *, denied: bool = False) -> None:
        self.arm, self.denied = arm, denied

    def enumerate_devices(self) -> Any:
        """Yield the arm if it is attached."""
        if self.arm.attached:
            yield self.arm

    def get_parent(self, dev: Any) -> None:
        """Return None: the arm is not behind a hub."""

    def get_device_descriptor(self, dev: Any) -> Any:
        """Return the device descriptor."""
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x200, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0,
            bMaxPacketSize0=8, idVendor=VENDOR, idProduct=PRODUCT, bcdDevice=0x600, iManufacturer=0, iProduct=0,
            iSerialNumber=0, bNumConfigurations=1, bus=1, address=1, port_number=1, port_numbers=(1,), speed=2,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: Any, config: int) -> Any:
        """Return the only configuration's descriptor."""
        if config:
            raise IndexError(config)
        raw = descriptors.CONFIGURATION
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=len(raw), bNumInterfaces=1, bConfigurationValue=1,
            iConfiguration=0, bmAttributes=raw[7], bMaxPower=raw[8], extra_descriptors=b"",
        )  # fmt: skip

    def get_interface_descriptor(self, dev: Any, intf: int, alt: int, config: int) -> Any:
        """Return the only interface's descriptor."""
        if intf or alt or config:
            raise IndexError(intf)
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=2,
            bInterfaceClass=0xFF, bInterfaceSubClass=0xFF, bInterfaceProtocol=0xFF, iInterface=0, extra_descriptors=b"",
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev: Any, ep: int, intf: int, alt: int, config: int) -> Any:
        """Return an endpoint's descriptor."""
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=(IN, OUT)[ep], bmAttributes=2, wMaxPacketSize=PACKET,
            bInterval=0, bRefresh=0, bSynchAddress=0, extra_descriptors=b"",
        )  # fmt: skip

    def open_device(self, dev: Any) -> Any:
        """Open the arm."""
        if self.denied:
            raise usb.core.USBError("Access denied (insufficient permissions)", -3, errno.EACCES)
        self._present()
        return dev

    def close_device(self, dev_handle: Any) -> None:
        """Close the arm."""

    def get_configuration(self, dev_handle: Any) -> int:
        """Return the active configuration."""
        self._present()
        return self.arm.configuration

    def set_configuration(self, dev_handle: Any, config_value: int) -> None:
        """Set the configuration."""
        self._present()
        self.arm.configuration = config_value

    def claim_interface(self, dev_handle: Any, intf: int) -> None:
        """Claim the interface."""
        self._present()

    def release_interface(self, dev_handle: Any, intf: int) -> None:
        """Release the interface."""
        self._present()

    def clear_halt(self, dev_handle: Any, ep: int) -> None:
        """Clear a stall."""
        self._present()

    def ctrl_transfer(
        self, dev_handle: Any, bmRequestType: int, bRequest: int, wValue: int, wIndex: int, data: Any, timeout: int
    ) -> int:
        """Perform a control transfer."""
        setup = struct.pack("<BBHHH", bmRequestType, bRequest, wValue, wIndex, len(data))
        try:
            answer = control(self.arm, setup)
        except (StalledError, UnpluggedError) as error:
            raise _usb_error(error) from error
        if bmRequestType & 0x80:
            data[: len(answer)] = array("B", answer)
            return len(answer)
        return len(data)

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        """Send bytes to the arm."""
        try:
            self.arm.bulk_out(bytes(data))
        except (StalledError, UnpluggedError) as error:
            raise _usb_error(error) from error
        return len(data)

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        """Wait for a packet from the serial chip."""
        time = self.arm.time
        end = time.now() + timeout / 1e3
        while True:
            try:
                packet = self.arm.bulk_in()
            except (StalledError, UnpluggedError) as error:
                raise _usb_error(error) from error
            if packet is not None:
                buff[: len(packet)] = array("B", packet)
                return len(packet)
            now = time.now()
            if now >= end:
                raise usb.core.USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
            time.sleep(min(max(self.arm.next_packet - now, 1e-5), end - now))

    def _present(self) -> None:
        if not self.arm.attached:
            raise _usb_error(UnpluggedError())


def _usb_error(error: Exception) -> Any:
    if isinstance(error, UnpluggedError):
        return usb.core.USBError("No such device (it may have been disconnected)", -4, errno.ENODEV)
    return usb.core.USBError("Pipe error", -9, errno.EPIPE)
