"""A third emulator, as somebody else might write one from the protocol's description: every legal habit is an option."""

from __future__ import annotations

import array
import errno
import random
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import usb.backend
import usb.core

REPLY_ENDPOINT, COMMAND_ENDPOINT = 0x81, 0x02


@dataclass
class Habits:
    """How this emulator uses the freedom that the protocol leaves."""

    running: bool = False
    chunk: int = 62  # bytes of data a packet
    status: bytes = b"\x31\x60"
    empty: str = "status"  # or "zero", "timeout", "110", "60", "10060", "text", "code"
    empties_before: int = 0  # empty reads before each answer
    behind: int = 0  # answers that are held back: each comes with a later frame
    echo: str = "block"  # or "byte"
    leading: bytes = b"\x00"
    control_returns: Any = 0
    short_writes: bool = False
    kernel: str = "none"  # or "active", "busy", "mute": a driver of the kernel holds it
    configured: str = "yes"  # or "no", "unknown"
    serials: tuple[Any, ...] = (None,)  # of the arms on the bus; an exception is raised
    held: tuple[bool, ...] = (False,)  # which arm another program has
    homes_after: int = 3  # frames with the homing bit


@dataclass
class Arm:
    """One arm on the bus."""

    number: int
    mode: str = "off"
    encoders: tuple[int, int, int] = (0, 0, 0)
    grip: int = 0
    homing: int = 0
    baud: int = 0
    dtr: int = 1
    line: bytearray = field(default_factory=bytearray)
    held_back: list[bytes] = field(default_factory=list)
    commands: list[tuple[tuple[int, ...], int]] = field(default_factory=list)
    part: bytearray = field(default_factory=bytearray)
    image: bytearray = field(default_factory=bytearray)
    wait: int = 0


class StrangerBus(usb.backend.IBackend):
    def __init__(self, habits: Habits, image: bytes = b"") -> None:
        self.habits, self.image = habits, image
        self.arms = [Arm(n, "run" if habits.running else "off") for n in range(len(habits.serials))]
        self.random = random.Random(5)
        self.detached = habits.kernel == "none"
        self.attached_again = False
        self.configuration = 1 if habits.configured == "yes" else 0
        self.gone = False

    # --- descriptors ----------------------------------------------------------------------------------------------

    def enumerate_devices(self) -> Any:
        yield from () if self.gone else self.arms

    def get_device_descriptor(self, dev: Any) -> Any:
        known = isinstance(self.habits.serials[dev.number], (str, Exception))
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x110, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0,
            bMaxPacketSize0=8, idVendor=0x0403, idProduct=0xCB48, bcdDevice=0x400, iManufacturer=1, iProduct=2,
            iSerialNumber=3 if known else 0, bNumConfigurations=1, bus=None, address=dev.number + 2,
            port_number=None, port_numbers=None, speed=None,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: Any, config: int) -> Any:
        if config >= 1:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=32, bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0,
            bmAttributes=0x80, bMaxPower=200, extra_descriptors=None,
        )  # fmt: skip

    def get_interface_descriptor(self, dev: Any, intf: int, alt: int, config: int) -> Any:
        if intf >= 1 or alt >= 1:
            raise IndexError
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=2,
            bInterfaceClass=0xFF, bInterfaceSubClass=0, bInterfaceProtocol=0, iInterface=0, extra_descriptors=None,
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev: Any, ep: int, intf: int, alt: int, config: int) -> Any:
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=(COMMAND_ENDPOINT, REPLY_ENDPOINT)[ep], bmAttributes=2,
            wMaxPacketSize=64, bInterval=0, bRefresh=0, bSynchAddress=0, extra_descriptors=None,
        )  # fmt: skip

    # --- the host's side of a device ------------------------------------------------------------------------------

    def open_device(self, dev: Any) -> Any:
        return dev

    def close_device(self, dev_handle: Any) -> None:
        pass

    def get_configuration(self, dev_handle: Any) -> Any:
        if self.habits.configured == "unknown":
            raise NotImplementedError("get_configuration")
        return self.configuration

    def set_configuration(self, dev_handle: Any, config_value: int) -> None:
        self.configuration = config_value

    def is_kernel_driver_active(self, dev_handle: Any, intf: int) -> bool:
        if self.habits.kernel in ("busy", "mute"):
            raise NotImplementedError("is_kernel_driver_active")
        return not self.detached

    def detach_kernel_driver(self, dev_handle: Any, intf: int) -> None:
        if self.habits.kernel == "mute":
            raise NotImplementedError("detach_kernel_driver")
        self.detached = True

    def attach_kernel_driver(self, dev_handle: Any, intf: int) -> None:
        self.attached_again = True

    def claim_interface(self, dev_handle: Any, intf: int) -> None:
        if intf != 0:  # it has one
            raise usb.core.USBError("Entity not found", -5, errno.ENOENT)
        if not self.detached or self.habits.held[dev_handle.number % len(self.habits.held)]:
            raise usb.core.USBError("Resource busy", -6, errno.EBUSY)

    def release_interface(self, dev_handle: Any, intf: int) -> None:
        raise NotImplementedError("release_interface")

    def ctrl_transfer(
        self, dev_handle: Any, bmRequestType: int, bRequest: int, wValue: int, wIndex: int, data: Any, timeout: int
    ) -> Any:
        if bmRequestType & 0x80:
            return self._string(dev_handle, data)
        if self.gone:
            raise usb.core.USBError("No such device")
        assert (bmRequestType, wIndex, len(data)) == (0x40, 0, 0)
        arm = dev_handle
        if bRequest == 0 and wValue in (0, 1):
            arm.line.clear()
        elif bRequest == 3:
            arm.baud = wValue
        elif bRequest == 1 and wValue >> 8 & 1:
            if arm.dtr == 0 and wValue & 1 and arm.baud == 0x4138:
                arm.mode, arm.homing = "boot", 0
            if arm.mode == "greeted" and not wValue & 1:
                arm.mode = "autobaud"
            arm.dtr = wValue & 1
        return self.habits.control_returns

    def _string(self, arm: Arm, data: Any) -> int:
        serial = self.habits.serials[arm.number]
        if isinstance(serial, Exception):
            raise serial
        text = b"\x04\x03\x09\x04" if not getattr(self, "asked", False) else b""
        self.asked = not getattr(self, "asked", False)
        if not text:
            raw = str(serial).encode("utf-16-le")
            text = bytes((len(raw) + 2, 3)) + raw
        data[: len(text)] = array.array("B", text)
        return len(text)

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        if self.gone:
            raise usb.core.USBError("No such device")
        assert ep == COMMAND_ENDPOINT
        arm, taken = dev_handle, bytes(data)
        if self.habits.short_writes and len(taken) > 1:
            taken = taken[: self.random.randrange(1, len(taken))]
        if arm.mode == "run":
            self._frames(arm, taken)
        else:
            for byte in taken:
                self._boot(arm, byte)
        return len(taken)

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        if self.gone:
            raise usb.core.USBError("No such device")
        assert ep == REPLY_ENDPOINT
        arm = dev_handle
        if not arm.line or arm.wait > 0:
            arm.wait -= 1
            return self._nothing(buff)
        size = min(len(arm.line), self.habits.chunk, len(buff) - 2)
        packet = self.habits.status + bytes(arm.line[:size])
        del arm.line[:size]
        buff[: len(packet)] = array.array("B", packet)
        return len(packet)

    def _nothing(self, buff: Any) -> int:
        how = self.habits.empty
        if how == "zero":
            return 0
        if how == "timeout":
            raise usb.core.USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)
        if how == "text":
            raise usb.core.USBError("Operation timed out")
        if how == "code":
            raise usb.core.USBError("", -7)
        if how.isdigit():
            raise usb.core.USBError("no answer", -116, int(how))
        buff[:2] = array.array("B", self.habits.status)
        return 2

    # --- the arm's side -------------------------------------------------------------------------------------------

    def _boot(self, arm: Arm, byte: int) -> None:
        arm.part.append(byte)
        if arm.mode == "boot" and arm.part.endswith(b"\x0a\x43\x0d"):
            arm.line += self.habits.leading + b"\x0a\x44\x2c\x0d"
            arm.mode = "greeted"
        elif arm.mode == "autobaud" and arm.baud == 0x15 and byte == 0x41:
            arm.line += b"A"
            arm.mode, arm.wait = "load", self.habits.empties_before
        elif arm.mode == "load":
            arm.image.append(byte)
            arm.line.append(byte)
            if self.habits.echo == "byte":
                arm.wait = 1
            if len(arm.image) == len(self.image):
                arm.mode = "run"
                arm.part.clear()

    def _frames(self, arm: Arm, data: bytes) -> None:
        if arm.baud != 2:
            return
        arm.part += data
        while len(arm.part) >= 16:
            frame, arm.part = bytes(arm.part[:16]), arm.part[16:]
            assert frame[:1] + frame[-1:] == b"<>"
            nibbles = [byte - 0x41 for byte in frame[1:13]]
            words = [sum(n << 4 * k for k, n in enumerate(nibbles[i : i + 4])) for i in (0, 4, 8)]
            motors = tuple(word - 0x10000 if word & 0x8000 else word for word in words)
            info = frame[13] - 0x41
            arm.commands.append((motors, info))
            arm.homing = arm.homing + 1 if info & 1 else 0
            self._answer(arm)

    def _answer(self, arm: Arm) -> None:
        homed = 0b111 if arm.homing >= self.habits.homes_after else 0b011 if arm.homing == 2 else 0
        letters = b"".join(bytes(0x41 + (word >> 4 * k & 15) for k in range(4)) for word in arm.encoders)
        arm.held_back.append(b"<" + letters + bytes((0x41 + (homed << 4 | arm.grip), 0x41)) + b">")
        if len(arm.held_back) > self.habits.behind:
            arm.line += arm.held_back.pop(0)
        arm.wait = self.habits.empties_before
