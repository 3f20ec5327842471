"""A pyusb backend that plays a trace: what the driver sends must be what the trace says, and gets what came then."""

from __future__ import annotations

import array
import errno
from typing import Any

import usb.core
from plain_falcon import PlainFalcon

from itouch.plugin.trace import RECEIVED, REMARK, SENT, Entry
from itouch_usb_arm.virtual import VirtualTime


class PlayedFalcon(PlainFalcon):
    """``time`` goes on to when each transfer was, at least."""

    def __init__(self, entries: list[Entry], time: VirtualTime) -> None:
        super().__init__()
        self.time = time
        self.left = [entry for entry in entries if entry.mark in (SENT, RECEIVED)]
        self.controls = [entry.data.decode() for entry in entries if entry.mark == REMARK]

    def ctrl_transfer(
        self, dev_handle: Any, bmRequestType: int, bRequest: int, wValue: int, wIndex: int, data: Any, timeout: int
    ) -> int:
        names = {0: "purge", 1: "modem", 2: "flow", 3: "baud", 4: "data bits", 9: "latency"}
        assert self.controls.pop(0) == f"{names[bRequest]} 0x{wValue:04x}"
        return 0

    def bulk_write(self, dev_handle: Any, ep: int, intf: int, data: Any, timeout: int) -> int:
        due = self._next()
        assert (due.mark, due.data) == (SENT, bytes(data)), f"{bytes(data)!r} was sent, the trace has {due.data!r}"
        return len(data)

    def bulk_read(self, dev_handle: Any, ep: int, intf: int, buff: Any, timeout: int) -> int:
        if self.left and self.left[0].mark == RECEIVED:
            data = b"\x01\x60" + self._next().data
            buff[: len(data)] = array.array("B", data)
            return len(data)
        raise usb.core.USBTimeoutError("Operation timed out", -7, errno.ETIMEDOUT)

    def _next(self) -> Entry:
        due = self.left.pop(0)
        self.time.sleep(due.seconds - self.time.now())
        return due
