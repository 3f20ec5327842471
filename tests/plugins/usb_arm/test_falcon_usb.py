"""The driver through real transports: USB/IP on loopback, and libusb on a bus that umockdev makes."""

from __future__ import annotations

import json
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import usb.core
from requirements import need_program

from itouch_usb_arm import Disconnected, Falcon, FalconError, NotFound, boot
from itouch_usb_arm.arm import UsbArm, UsbArmParams
from itouch_usb_arm.link import Remote
from itouch_usb_arm.virtual import VirtualFalcon
from itouch_usb_arm.virtual.usbip import UsbipServer

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

IMAGE = boot.build([boot.Block(0x3F8000, tuple(range(200)))], entry=0x3F8002)
HERE = Path(__file__).parent


class Served:
    """A virtual arm on a server in a thread."""

    def __init__(self) -> None:
        self.arm = VirtualFalcon()
        self.server = UsbipServer(self.arm, ("127.0.0.1", 0))
        self._stop = False
        self.remotes: list[Remote] = []
        self.thread = threading.Thread(target=self.server.serve, args=(lambda: self._stop,))
        self.thread.start()

    def backend(self) -> Any:
        host, port = self.server.address
        self.remotes.append(Remote(f"{host}:{port}"))
        return self.remotes[-1].backend

    def close(self) -> None:
        for remote in self.remotes:
            remote.close()
        self._stop = True
        self.thread.join()
        self.server.close()


@pytest.fixture
def served() -> Iterator[Served]:
    server = Served()
    yield server
    server.close()


def test_over_usbip_load_home_push_unplug_and_replug(served: Served) -> None:
    backend = served.backend()
    falcon = Falcon(IMAGE, backend)
    with falcon:
        falcon.home(10.0)
        falcon.write((0.0, 0.0, 1.0))
        for _ in range(400):
            reading = falcon.read()
        assert reading.position[2] == pytest.approx(served.arm.mechanics.position[2], abs=1e-4)
        assert reading.position[2] > 0.1265  # pushed out of its rest at 125 mm against 300 N/m
        served.arm.faults.unplug_after = 5
        with pytest.raises(Disconnected):
            falcon.read()
    with pytest.raises(FalconError):
        falcon.open()
    served.arm.plug(running=True)
    with falcon:
        assert falcon.home(10.0).valid
    assert served.arm.commands[-1].values == (0, 0, 0)


def test_a_second_host_is_refused_and_a_new_one_served(served: Served) -> None:
    first, second = Falcon(IMAGE, served.backend()), Falcon(IMAGE, served.backend())
    first.open()
    with pytest.raises(FalconError):
        second.open()
    assert first.read().homed == (False, False, False)
    assert usb.core.find(idVendor=0x0403, idProduct=0xCB48, backend=served.backend()) is not None
    first.close()


def test_no_server_is_no_arm() -> None:
    with pytest.raises(NotFound, match="cannot be searched"):
        Falcon(IMAGE, Remote("127.0.0.1:1").backend).open()


def test_what_listens_and_says_nothing_is_told_as_that() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        where = f"127.0.0.1:{server.getsockname()[1]}"
        said = UsbArm.unavailable_reason(UsbArmParams(usbip=where))
        assert said == f"USB/IP server {where}: no answer in time: is a USB/IP server running there?"


@pytest.mark.parametrize(
    "garbage", [b"\0" * 100, b"GET / HTTP/1.0\r\n\r\n", struct.pack(">HHI", 0x111, 0x8003, 0) + b"x" * 32]
)
def test_garbage_does_not_end_the_server(served: Served, garbage: bytes) -> None:
    with socket.create_connection(served.server.address, timeout=600) as line:
        line.sendall(garbage)
        line.settimeout(300)
        line.recv(100)
    assert usb.core.find(idVendor=0x0403, idProduct=0xCB48, backend=served.backend()) is not None


def test_an_unlinked_read_keeps_what_the_arm_says(served: Served) -> None:
    """A kernel takes a read back when its program gives up; the bytes must come with the next read."""
    served.arm.plug(running=True)
    header = struct.Struct(">5I5i8s")

    def take(line: socket.socket, size: int) -> bytes:
        data = b""
        while len(data) < size:
            piece = line.recv(size - len(data))
            assert piece
            data += piece
        return data

    with socket.create_connection(served.server.address, timeout=600) as line:
        line.sendall(struct.pack(">HHI", 0x0111, 0x8003, 0) + b"1-1".ljust(32, b"\0"))
        take(line, 8 + 312)
        nothing = b"\0" * 8

        def control(number: int, request: int, value: int) -> None:
            line.sendall(
                header.pack(1, number, 0x10002, 0, 0, 0, 0, 0, 0, 0, struct.pack("<BBHHH", 0x40, request, value, 0, 0))
            )
            assert struct.unpack(">Iii", take(line, 48)[16:28])[1] == 0

        control(1, 3, 2)
        control(2, 9, 255)  # a long latency: the read will wait
        line.sendall(header.pack(1, 3, 0x10002, 1, 1, 0, 64, 0, 0, 0, nothing))
        first = take(line, 48)  # the timer of before ends once
        take(line, struct.unpack(">i", first[24:28])[0])
        line.sendall(header.pack(1, 4, 0x10002, 1, 1, 0, 64, 0, 0, 0, nothing))
        line.sendall(header.pack(1, 5, 0x10002, 0, 2, 0, 16, 0, 0, 0, nothing) + b"<AAAAAAAAAAAAAA>")
        assert struct.unpack(">II", take(line, 48)[:8]) == (3, 5)
        line.sendall(struct.pack(">6I24x", 2, 6, 0x10002, 0, 0, 4))
        answer = take(line, 48)
        assert struct.unpack(">II12xi", answer[:24]) == (4, 6, -104)
        line.sendall(struct.pack(">6I24x", 2, 9, 0x10002, 0, 0, 4))
        assert struct.unpack(">II12xi", take(line, 48)[:24]) == (4, 9, 0), "that one is not there any more"
        control(7, 9, 1)
        line.sendall(header.pack(1, 8, 0x10002, 1, 1, 0, 64, 0, 0, 0, nothing))
        got = take(line, 48)
        assert struct.unpack(">II", got[:8]) == (3, 8)
        data = take(line, struct.unpack(">i", got[24:28])[0])
        assert data[2:3] == b"<"
        assert data[-1:] == b">"
        assert len(data) == 18


def test_the_command_serves_until_it_is_told_to_end() -> None:
    command = [
        sys.executable,
        "-m",
        "itouch_tools.cli",
        "virtual-arm",
        "--usbip",
        "127.0.0.1:0",
        "--running",
        "--homed",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        port = int(line.split(":")[1].split(",")[0])
        with Remote(f"127.0.0.1:{port}") as remote, Falcon(backend=remote.backend, resume=True) as falcon:
            assert falcon.read().valid
        process.terminate()
        assert process.wait(300) == 0
    taken = subprocess.run([*command[:-3], "nowhere"], capture_output=True, text=True, check=False)
    assert taken.returncode == 2
    assert "write for example" in taken.stderr


def test_through_libusb_and_usbfs(served: Served, tmp_path: Path) -> None:
    """Real libusb and its ioctls; needs umockdev, gir1.2-umockdev-1.0 and python3-gi."""
    need_program("umockdev-wrapper", package="umockdev gir1.2-umockdev-1.0 python3-gi")
    firmware = tmp_path / "firmware.bin"
    firmware.write_bytes(IMAGE)
    served.arm.faults.unplug_after = len(IMAGE) + 16 * 1200
    done = subprocess.run(
        ["umockdev-wrapper", "/usr/bin/python3", str(HERE / "umock/bus.py"), str(served.server.address[1]),
         sys.executable, str(HERE / "umock/session.py"), str(firmware), "300"],
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["backend"] == "usb.backend.libusb1"
    assert 0.125 < found["z"] < 0.14
    assert "gone" in found["error"]
    assert "no arm" in found["after"]
