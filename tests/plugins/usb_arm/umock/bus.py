"""A usbfs that is not real, for the real libusb: run a command on a bus with one device that a USB/IP server has.

    umockdev-wrapper /usr/bin/python3 bus.py PORT COMMAND...

Needs the Debian packages umockdev, gir1.2-umockdev-1.0 and python3-gi, and nothing else: it runs on the system's
Python, the server on any.  Transfers go the whole way: pyusb, libusb, ioctls of usbfs, USB/IP, the emulator.
"""

import errno
import select
import socket
import struct
import subprocess
import sys
import threading

import gi

gi.require_version("UMockdev", "1.0")
from gi.repository import GLib, UMockdev  # noqa: E402

CLAIM, RELEASE, SET_CONFIGURATION, CLEAR_HALT = 0x8004550F, 0x80045510, 0x80045505, 0x80045515
CAPABILITIES, SUBMIT, DISCARD = 0x8004551A, 0x8038550A, 0x550B
REAP, REAP_NOW = 0x4008550C, 0x4008550D
NODE, URB_SIZE = "/dev/bus/usb/001/002", 56
DEVICE_ID = 1 << 16 | 2


class Remote:
    """The device behind a USB/IP server: transfers out, answers in when they come."""

    def __init__(self, port):
        self.line = socket.create_connection(("127.0.0.1", port), timeout=600)
        self.line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.line.sendall(struct.pack(">HHI", 0x0111, 0x8003, 0) + b"1-1".ljust(32, b"\0"))
        _, _, status = struct.unpack(">HHI", self.take(8))
        if status:
            sys.exit("the server does not give the device")
        self.take(312)
        self.sequence, self.buffer, self.gone = 0, b"", False

    def take(self, size):
        data = b""
        while len(data) < size:
            piece = self.line.recv(size - len(data))
            if not piece:
                raise ConnectionError
            data += piece
        return data

    def submit(self, endpoint, length, setup, data):
        self.sequence += 1
        inward = int(endpoint & 0x80 != 0)
        header = struct.pack(
            ">5I5i8s", 1, self.sequence, DEVICE_ID, inward, endpoint & 15, 0, length, 0, 0, 0, setup
        )  # fmt: skip
        try:
            self.line.sendall(header + data)
        except OSError:
            self.gone = True
        return self.sequence, inward

    def unlink(self, sequence):
        self.sequence += 1
        try:
            self.line.sendall(struct.pack(">6I24x", 2, self.sequence, DEVICE_ID, 0, 0, sequence))
        except OSError:
            self.gone = True

    def answers(self, wait):
        """Yield (command, sequence, status, data) of the answers that are here; wait a little for the first."""
        if not self.gone and select.select([self.line], [], [], wait)[0]:
            try:
                piece = self.line.recv(65536)
            except OSError:
                piece = b""
            self.gone = not piece
            self.buffer += piece
        while len(self.buffer) >= 48:
            command, sequence, _, _, _, status, length = struct.unpack_from(">5Iii", self.buffer)
            inward = INWARD.get(sequence, 0)
            size = length if command == 3 and inward else 0
            if len(self.buffer) < 48 + size:
                return
            data, self.buffer = self.buffer[48 : 48 + size], self.buffer[48 + size :]
            yield command, sequence, status, data, length


INWARD = {}


class Usbfs(UMockdev.IoctlBase):
    def __init__(self, remote, unplugged):
        super().__init__()
        self.remote, self.unplugged = remote, unplugged
        self.waiting, self.done = {}, []

    def do_handle_ioctl(self, client):
        request = client.get_request() & 0xFFFFFFFF
        if self.remote.gone:
            self.unplugged()
            if request not in (REAP, REAP_NOW) or not (self.waiting or self.done):
                client.complete(-1, errno.ENODEV)
                return True
        if request == CAPABILITIES:
            client.get_arg().resolve(0, 4).update(0, list(struct.pack("<I", 0x01)))
            client.complete(0, 0)
        elif request in (CLAIM, RELEASE, CLEAR_HALT):
            client.complete(0, 0)
        elif request == SET_CONFIGURATION:
            value = bytes(client.get_arg().resolve(0, 4).retrieve())[0]
            self.control_now(struct.pack("<BBHHH", 0, 9, value, 0, 0))
            client.complete(0, 0)
        elif request == SUBMIT:
            self.submit(client)
        elif request == DISCARD:
            self.discard(client)
        elif request in (REAP, REAP_NOW):
            self.reap(client)
        else:
            client.complete(-1, errno.ENOTTY)
        return True

    def control_now(self, setup):
        sequence, _ = self.remote.submit(0, 0, setup, b"")
        self.waiting[sequence] = None

    def submit(self, client):
        urb = client.get_arg().resolve(0, URB_SIZE)
        raw = bytes(urb.retrieve())
        kind, endpoint = raw[0], raw[1]
        (length,) = struct.unpack_from("<i", raw, 24)
        buffer = urb.resolve(16, length) if length else None
        data = bytes(buffer.retrieve()) if buffer is not None else b""
        setup, offset = b"\0" * 8, 0
        if kind == 2:  # control: the setup packet goes before the data
            setup, data, offset = data[:8], data[8:], 8
            length -= 8
            endpoint = setup[0] & 0x80
        inward = endpoint & 0x80
        sequence, is_in = self.remote.submit(endpoint, length, setup, b"" if inward else data)
        INWARD[sequence] = is_in
        self.waiting[sequence] = (urb, buffer, offset, client.get_arg())
        client.complete(0, 0)

    def discard(self, client):
        address = client.get_arg().client_addr
        for sequence, entry in self.waiting.items():
            if entry is not None and entry[0].client_addr == address:
                self.remote.unlink(sequence)
                self.done.append((entry, -errno.ENOENT, b"", 0))
                del self.waiting[sequence]
                client.complete(0, 0)
                return
        client.complete(-1, errno.EINVAL)

    def collect(self, wait):
        for command, sequence, status, data, length in self.remote.answers(wait):
            entry = self.waiting.pop(sequence, None)
            if command == 3 and entry is not None:
                self.done.append((entry, status, data, length))
        if self.remote.gone:
            self.done += [(entry, -errno.ENODEV, b"", 0) for entry in self.waiting.values() if entry is not None]
            self.waiting.clear()

    def reap(self, client):
        if not self.done:
            self.collect(0.0005)
        if not self.done:
            client.complete(-1, errno.ENODEV if self.remote.gone else errno.EAGAIN)
            return
        (urb, buffer, offset, _), status, data, length = self.done.pop(0)
        if data and buffer is not None:
            buffer.update(offset, list(data))
        urb.update(4, list(struct.pack("<i", status)))
        urb.update(28, list(struct.pack("<i", length)))
        client.get_arg().resolve(0, 8).set_ptr(0, urb)
        client.complete(0, 0)


def main():
    port, command = int(sys.argv[1]), sys.argv[2:]
    remote = Remote(port)
    descriptors = bytes.fromhex(
        "120100020000000803044 8cb000600000001".replace(" ", "")
        + "09022000010100a032" + "0904000002ffffff00" + "07058102400000" + "07050202400000"
    )  # fmt: skip
    bed = UMockdev.Testbed.new()
    bed.add_from_string(
        "P: /devices/pci0000:00/0000:00:14.0/usb1\nN: bus/usb/001/001\nE: SUBSYSTEM=usb\nE: DEVTYPE=usb_device\n"
        "E: DEVNAME=/dev/bus/usb/001/001\nA: busnum=1\\n\nA: devnum=1\\n\nA: speed=480\\n\nA: bConfigurationValue=1\\n\n"
        "H: descriptors=120100020900014" + "06b1d020006050302010109021900010100e0000904000001090000000705810304000c\n"
    )
    path = "/devices/pci0000:00/0000:00:14.0/usb1/1-1"
    bed.add_from_string(
        f"P: {path}\nN: bus/usb/001/002\nE: SUBSYSTEM=usb\nE: DEVTYPE=usb_device\nE: DEVNAME={NODE}\n"
        "E: BUSNUM=001\nE: DEVNUM=002\nA: busnum=1\\n\nA: devnum=2\\n\nA: speed=12\\n\nA: bConfigurationValue=1\\n\n"
        f"A: idVendor=0403\\n\nA: idProduct=cb48\\n\nH: descriptors={descriptors.hex()}\n"
    )
    state = {"there": True}

    def unplugged():
        if state["there"]:
            state["there"] = False
            bed.uevent("/sys" + path, "remove")
            bed.remove_device("/sys" + path)

    usbfs = Usbfs(remote, unplugged)
    bed.attach_ioctl(NODE, usbfs)
    loop, code = GLib.MainLoop(), []

    def work():
        code.append(subprocess.call(command))
        GLib.idle_add(loop.quit)

    threading.Thread(target=work, daemon=True).start()
    loop.run()
    sys.exit(code[0])


main()
