"""Gamepads: read from the kernel, and through pyglet, with fakes of what only a machine with one has."""

from __future__ import annotations

import json
import logging
import os
import struct
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from requirements import need_program

from itouch.arms import evdev, gamepad
from itouch.arms.evdev import Description
from itouch.arms.gamepad import Pad, PadError, find_pad

STICKS = Description("a pad", frozenset({evdev.GAMEPAD, 0x131}), {0: (-32768, 32767), 1: (0, 255), 4: (0, 255)})
MOUSE = Description("a mouse", frozenset({0x110}), {})


def event(kind: int, code: int, value: int) -> bytes:
    return struct.pack("@llHHi", 12, 34, kind, code, value)


@pytest.fixture
def wire(tmp_path: Path) -> Any:
    """A folder of input devices: a mouse and a gamepad, which are pipes; the writing end of the gamepad."""
    for name in ("event0", "event1"):
        os.mkfifo(tmp_path / name)
    (tmp_path / "mice").touch()
    readers = [os.open(tmp_path / name, os.O_RDONLY | os.O_NONBLOCK) for name in ("event0", "event1")]
    writer = os.open(tmp_path / "event1", os.O_WRONLY)
    yield tmp_path, writer
    for descriptor in (*readers, writer):
        try:
            os.close(descriptor)
        except OSError:
            continue


def look(descriptor: int) -> Description:
    return STICKS if os.readlink(f"/proc/self/fd/{descriptor}").endswith("event1") else MOUSE


def test_the_kernels_gamepad_is_found_among_others_and_read(wire: Any) -> None:
    folder, writer = wire
    found, refused = evdev.find(str(folder), look=look)
    assert found is not None and found.name == "a pad" and not refused
    sticks = Pad(found)
    assert sticks.sticks() == (0.0, 0.0, 0.0)
    os.write(writer, event(3, 0, 32767) + event(3, 1, 0) + event(3, 4, 255) + event(1, 0x130, 1) + event(0, 0, 0))
    assert sticks.sticks() == (1.0, 1.0, -1.0)  # right, up, down
    os.write(writer, event(3, 0, 2000) + event(3, 4, 127))
    assert sticks.sticks() == (0.0, 1.0, 0.0)  # near their middle they rest
    os.write(writer, event(0, 3, 0))  # the kernel has lost some
    assert sticks.sticks() == (0.0, 0.0, 0.0)
    sticks.close()
    sticks.close()


def test_an_unplugged_gamepad_reads_rest_and_is_told_once(wire: Any, caplog: pytest.LogCaptureFixture) -> None:
    folder, writer = wire
    found, _ = evdev.find(str(folder), look=look)
    assert found is not None
    sticks = Pad(found)
    os.write(writer, event(3, 0, 32767))
    assert sticks.sticks()[0] == 1.0
    os.close(writer)
    with caplog.at_level(logging.WARNING):
        assert sticks.sticks() == (0.0, 0.0, 0.0)
        assert sticks.sticks() == (0.0, 0.0, 0.0)
    assert not sticks.connected
    assert caplog.text.count("unplugged") == 1
    sticks.close()


def test_files_that_are_no_input_devices_are_skipped(tmp_path: Path) -> None:
    (tmp_path / "event3").write_bytes(b"plain")
    assert evdev.find(str(tmp_path)) == (None, [])
    with pytest.raises(FileNotFoundError):
        evdev.find(str(tmp_path / "nowhere"))


def test_a_missing_gamepad_is_told_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")

    def nowhere() -> Any:
        raise FileNotFoundError("/dev/input")

    for found, words in (
        (nowhere, "no folder /dev/input"),
        (lambda: (None, []), "none is attached"),
        (lambda: (None, ["/dev/input/event5"]), "event5.*join the group 'input'"),
    ):
        monkeypatch.setattr(evdev, "find", found)
        with pytest.raises(PadError, match=words):
            find_pad()


class Device:
    """What pyglet has of an evdev device: nothing is read unless it is polled and selected."""

    def __init__(self) -> None:
        self.waiting: list[dict[str, float]] = []
        self.is_open = self.connected = True
        self.owner: Any = None

    def poll(self) -> bool:
        return bool(self.waiting)

    def select(self) -> None:
        for name, value in self.waiting.pop(0).items():
            setattr(self.owner, name, value)


def controller() -> Any:
    made = SimpleNamespace(name="of pyglet", device=Device(), leftx=0.0, lefty=0.0, righty=0.0, opened=0, closed=0)
    made.device.owner = made
    made.open = lambda: setattr(made, "opened", made.opened + 1)
    made.close = lambda: setattr(made, "closed", made.closed + 1)
    return made


def with_pyglet(monkeypatch: pytest.MonkeyPatch, controllers: Any) -> None:
    module = ModuleType("pyglet.input")
    module.get_controllers = controllers  # type: ignore[attr-defined]
    import pyglet

    monkeypatch.setitem(sys.modules, "pyglet.input", module)
    monkeypatch.setattr(pyglet, "input", module, raising=False)
    monkeypatch.setenv("DISPLAY", ":9")


def test_pyglet_reports_a_missing_display(monkeypatch: pytest.MonkeyPatch) -> None:
    made = controller()
    with_pyglet(monkeypatch, lambda: [made])
    sticks = find_pad()
    assert sticks.name == "of pyglet" and made.opened == 1
    made.device.waiting = [{"leftx": 0.5}, {"lefty": -1.0, "righty": 0.25}]
    assert sticks.sticks() == (0.5, 1.0, -0.25)
    made.device.is_open = False
    assert sticks.sticks() == (0.0, 0.0, 0.0)
    sticks.close()


@pytest.mark.parametrize("error", [OSError(19, "No such device"), ValueError("negative descriptor"), TypeError("None")])
def test_a_gamepad_that_fails_when_polled_counts_as_unplugged(
    error: Exception, caplog: pytest.LogCaptureFixture
) -> None:  # fmt: skip
    made = controller()
    made.leftx = 1.0

    def poll() -> bool:
        raise error

    made.device.poll = poll
    sticks = Pad(made)
    assert sticks.sticks() == (0.0, 0.0, 0.0)
    assert not sticks.connected
    assert "of pyglet was unplugged" in caplog.text


def test_the_kernels_bits_are_numbered_from_the_lowest_of_each_byte() -> None:
    assert evdev._bits(bytes((0b101, 0, 0x80))) == {0, 2, 23}


def test_the_kernel_is_asked_by_its_own_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """The numbers of EVIOCGNAME(256), EVIOCGBIT and EVIOCGABS as its headers make them."""
    keys, axes = bytearray(96), bytearray(8)
    keys[evdev.GAMEPAD // 8], axes[0] = 1 << evdev.GAMEPAD % 8, 0b10011
    answers = {0x81004506: b"Mock Pad".ljust(256, b"\0"), 0x80604521: keys, 0x80084523: axes}
    answers |= {0x80184540 + code: struct.pack("6i", 0, -code, 100 + code, 0, 0, 0) for code in (0, 1, 4)}

    def ioctl(descriptor: int, request: int, buffer: bytearray) -> None:
        assert descriptor == 9
        buffer[:] = answers.pop(request)

    monkeypatch.setattr("fcntl.ioctl", ioctl)
    ranges = {0: (0, 100), 1: (-1, 101), 4: (-4, 104)}
    assert evdev.describe(9) == Description("Mock Pad", frozenset({evdev.GAMEPAD}), ranges)
    assert not answers


def test_a_gamepad_that_pyglet_does_not_find_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails() -> Any:
        raise RuntimeError("no such thing here")

    for found, words in ((list, "none is attached"), (fails, "no such thing here")):
        with_pyglet(monkeypatch, found)
        monkeypatch.setattr(sys, "platform", "win32")
        with pytest.raises(PadError, match=words):
            find_pad()
        monkeypatch.setattr(sys, "platform", "linux")
        monkeypatch.setattr(evdev, "find", lambda: (None, []))
        with pytest.raises(PadError, match="none is attached"):
            find_pad()
        kernels = controller()
        monkeypatch.setattr(evdev, "find", lambda kernels=kernels: (kernels, []))
        assert find_pad().name == "of pyglet" and kernels.opened == 1


def test_a_gamepad_that_cannot_be_opened_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    made = controller()

    def refuse() -> None:
        raise OSError("busy")

    made.open = refuse
    monkeypatch.setattr(gamepad, "_of_pyglet", lambda: made)
    monkeypatch.setenv("DISPLAY", ":9")
    with pytest.raises(PadError, match="busy"):
        find_pad()


READ = """
import json, sys, time
from itouch.arms.gamepad import find_pad
sticks = find_pad()
end = time.monotonic() + 300.0
while sticks.sticks() != (1.0, 0.0, 1.0) and time.monotonic() < end:
    time.sleep(0.01)
print(json.dumps([sticks.name, sticks.sticks()]))
"""
DEVICE = """P: /devices/virtual/input/input9/event9
N: input/event9
E: DEVNAME=/dev/input/event9
E: SUBSYSTEM=input
A: dev=13:73
"""
EVENTS = """E: 0.000000 0003 0000 32767
E: 0.010000 0003 0004 -32768
E: 0.010000 0000 0000 0
"""


def test_the_kernels_own_numbers_by_a_tool_that_emulates_it(tmp_path: Path) -> None:
    """umockdev answers the ioctls that it knows by their numbers, and plays events into the device."""
    need_program("umockdev-run", package="umockdev")
    keys, axes = bytearray(96), bytearray(8)
    keys[evdev.GAMEPAD // 8] |= 1 << evdev.GAMEPAD % 8
    axes[0] = 0b111111
    ranges = [f"EVIOCGABS({code}) 0 {struct.pack('6i', 0, -32768, 32767, 16, 128, 0).hex()}" for code in (0, 1, 4)]
    name = b"Mock Pad".ljust(256, b"\0")
    answers = [f"EVIOCGNAME 256 {name.hex()}", f"EVIOCGBIT(1) 96 {keys.hex()}", f"EVIOCGBIT(3) 8 {axes.hex()}", *ranges]
    for file, text in (
        ("device", DEVICE),
        ("ioctls", "\n".join(["@DEV /dev/input/event9", *answers, ""])),
        ("events", EVENTS),
        ("read.py", READ),
    ):
        (tmp_path / file).write_text(text)
    path, node = str(tmp_path) + "/", "/dev/input/event9="
    words = ["umockdev-run", "-d", path + "device", "-i", f"{node}{path}ioctls", "-e", f"{node}{path}events", "--"]
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [*words, sys.executable, path + "read.py"], capture_output=True, text=True, timeout=600, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == ["Mock Pad", [1.0, 0.0, 1.0]]


def test_a_gamepad_whose_open_state_pyglet_does_not_tell_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not every kind of device of pyglet says so."""
    made = controller()
    del made.device.is_open
    del made.device.connected
    made.device.waiting = [{"leftx": 0.5}]
    sticks = Pad(made)
    assert sticks.sticks() == (0.5, 0.0, 0.0)
    assert sticks.connected
