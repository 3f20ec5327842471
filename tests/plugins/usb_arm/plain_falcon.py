"""A second emulator, as plain as can be, that shares no code with the package's own: written from the protocol alone.

It answers at once, knows no physics, and keeps everything that the host did.
"""

from __future__ import annotations

import array
import errno
import time
from collections import deque
from types import SimpleNamespace
from typing import Any

import usb.backend
import usb.core


def letters(number: int) -> bytes:
    number &= 0xFFFF
    return bytes(0x41 + (number >> shift & 15) for shift in (0, 4, 8, 12))


def number(text: bytes) -> int:
    value = sum((byte - 0x41) << 4 * place for place, byte in enumerate(text))
    return value - 65536 if value >= 32768 else value


class PlainFalcon(usb.backend.IBackend):
    def __init__(self, *, running: bool = False, empties: str = "status", needs_configuring: bool = False) -> None:
        self.mode = "run" if running else "cold"
        self.empties = empties
        self.config = 0 if needs_configuring else 1
        self.encoders = (0, 0, 0)
        self.grip = 0
        self.homed = 0
        self.homes = True
        self.gone = False
        self.queue: deque[int] = deque()
        self.requests: list[tuple[int, int]] = []
        self.motors: list[tuple[int, int, int]] = []
        self.infos: list[int] = []
        self.image = b""
        self.size = 0
        self.leading_zero = True
        self.echo_wrong_at: int | None = None
        self.spoil: deque[Any] = deque()
        self.baud = 0
        self.dtr = 1
        self.parrot = False

    def enumerate_devices(self) -> Any:
        return [] if self.gone else ["falcon"]

    def get_parent(self, dev: Any) -> Any:
        return None

    def get_device_descriptor(self, dev: Any) -> Any:
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x200, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0,
            bMaxPacketSize0=8, idVendor=0x0403, idProduct=0xCB48, bcdDevice=0x600, iManufacturer=1, iProduct=2,
            iSerialNumber=3, bNumConfigurations=1, bus=3, address=7, port_number=1, port_numbers=(1,), speed=2,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: Any, config: int) -> Any:
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=32, bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0,
            bmAttributes=0xA0, bMaxPower=45, extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(self, dev: Any, intf: int, alt: int, config: int) -> Any:
        if intf or alt:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=2,
            bInterfaceClass=255, bInterfaceSubClass=255, bInterfaceProtocol=255, iInterface=2, extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev: Any, ep: int, intf: int, alt: int, config: int) -> Any:
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=[0x81, 0x02][ep], bmAttributes=2, wMaxPacketSize=64,
            bInterval=0, bRefresh=0, bSynchAddress=0, extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev: Any) -> Any:
        self.check()
        return "handle"

    def close_device(self, dev_handle: Any) -> None:
        pass

    def get_configuration(self, dev_handle: Any) -> int:
        self.check()
        if not self.config:
            raise usb.core.USBError("Configuration not set")
        return self.config

    def set_configuration(self, dev_handle: Any, config_value: int) -> None:
        self.config = config_value

    def claim_interface(self, dev_handle: Any, intf: int) -> None:
        assert intf == 0
        self.check()

    def release_interface(self, dev_handle: Any, intf: int) -> None:
        pass

    def check(self) -> None:
        if self.gone:
            raise usb.core.USBError("No such device", -4, errno.ENODEV)

    def ctrl_transfer(
        self, dev_handle: Any, bmRequestType: int, bRequest: int, wValue: int, wIndex: int, data: Any, timeout: int
    ) -> int:
        self.check()
        assert bmRequestType == 0x40
        assert wIndex == 0
        self.requests.append((bRequest, wValue))
        if bRequest == 0 and wValue == 1:
            self.queue.clear()
        elif bRequest == 1 and wValue in (0x0100, 0x0101):
            rising = wValue == 0x0101 and not self.dtr
            self.dtr = wValue & 1
            if rising:
                self.mode = "monitor"
            elif self.mode == "knocked" and not self.dtr:
                self.mode = "autobaud"
        elif bRequest == 3:
            self.baud = wValue
        return 0

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        self.check()
        assert ep == 0x02
        assert timeout > 0
        data = bytes(data)
        if self.parrot and self.mode == "cold":
            self.queue += data
        elif self.mode == "run" and self.baud == 2:
            self.frame(data)
        elif self.mode == "monitor" and self.baud == 0x4138 and data == b"\x0a\x43\x0d":
            self.queue += b"\0" * self.leading_zero + b"\x0a\x44\x2c\x0d"
            self.mode = "knocked"
        elif self.mode == "autobaud" and self.baud == 0x15 and data == b"A":
            self.queue += b"A"
            self.mode = "load"
        elif self.mode == "load":
            assert len(data) <= 62
            begin = len(self.image)
            self.image += data
            echo = bytearray(data)
            if self.echo_wrong_at is not None and begin <= self.echo_wrong_at < len(self.image):
                echo[self.echo_wrong_at - begin] ^= 1
            self.queue += echo
            if len(self.image) == self.size:
                self.mode = "run"
        return len(data)

    def frame(self, data: bytes) -> None:
        assert len(data) == 16
        assert data[:1] == b"<"
        assert data[-1:] == b">"
        self.motors.append((number(data[1:5]), number(data[5:9]), number(data[9:13])))
        info = data[13] - 0x41
        self.infos.append(info)
        if not info & 1:
            self.homed = 0
        elif self.homes:
            self.homed = 7
        state = self.grip | self.homed << 4
        answer = b"<" + b"".join(map(letters, self.encoders)) + bytes((0x41 + state, 0x41)) + b">"
        self.queue += self.spoil.popleft()(answer) if self.spoil else answer

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        self.check()
        assert ep == 0x81
        assert timeout > 0
        if not self.queue:  # as the chip does: it answers when its latency timer ends, or not at all
            time.sleep(1e-3 * (timeout if self.empties == "timeout" else 1))
        if not self.queue and self.empties == "timeout":
            raise usb.core.USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
        data = b""
        while True:
            piece = bytes(self.queue.popleft() for _ in range(min(62, len(self.queue))))
            data += b"\x01\x60" + piece
            if len(piece) < 62 or len(data) + 64 > len(buff):
                break
        buff[: len(data)] = array.array("B", data)
        return len(data)
