"""A serial line over a real port of the system: speeds, patience, a second opener, and ports that refuse or go away."""

from __future__ import annotations

import errno
import fcntl
import io
import os
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import serialx

from itouch.plugin import DeviceError, Terminal, Trace, read_trace, wire_claims
from itouch_thermal import ThermalDisplay
from itouch_thermal.drivers.serialport import SerialLine
from itouch_xyz_table import tmcl

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    yield made
    made.close()


def arrives(terminal: Terminal, count: int) -> bytes:
    """What the other end gets, however long the system takes."""
    got, limit = b"", time.monotonic() + 300.0
    while len(got) < count and time.monotonic() < limit:
        got += terminal.receive()
        time.sleep(1e-3)
    return got


def test_messages_are_taken_apart_at_their_ends_and_traced(terminal: Terminal) -> None:
    stream = io.StringIO()
    line = SerialLine(terminal.path, 115200, end=b"\r", trace=Trace(stream, "line"))
    line.send(b"?\r")
    assert arrives(terminal, 2) == b"?\r"
    terminal.send(b"one\rtwo\rthr")
    assert [line.receive(2.0), line.receive(2.0), line.receive(0.0)] == [b"one", b"two", None]
    terminal.send(b"ee\r")
    assert line.receive(2.0) == b"three"
    line.close()
    entries = [(entry.mark, entry.data) for entry in read_trace(stream.getvalue().splitlines())]
    assert entries == [(">", b"?\r"), ("<", b"one\r"), ("<", b"two\r"), ("<", b"three\r")]


def test_waiting_for_an_answer_ends(terminal: Terminal) -> None:
    line = SerialLine(terminal.path, 115200, end=b"\r")
    terminal.send(b"no end")
    begin = time.monotonic()
    assert line.receive(0.05) is None
    assert 0.05 <= time.monotonic() - begin < 60.0  # it ends
    line.close()


def test_what_came_before_is_dropped(terminal: Terminal) -> None:
    line = SerialLine(terminal.path, 115200, end=b"\r")
    terminal.send(b"late\ranswer")
    assert line.receive(2.0) == b"late"
    terminal.send(b" of before\r")
    time.sleep(0.05)
    line.clear()
    terminal.send(b"new\r")
    assert line.receive(2.0) == b"new"
    line.close()


def test_the_speed_is_changed_in_a_session(terminal: Terminal) -> None:
    line = SerialLine(terminal.path, 57600, end=b"\r")
    assert terminal.host_baud() == 57600
    line.set_baud(460800)
    assert terminal.host_baud() == 460800
    line.send(b"x\r")
    assert arrives(terminal, 2) == b"x\r"
    terminal.send(b"y\r")
    assert line.receive(2.0) == b"y"
    line.set_baud(123456)  # one that termios has no name for
    assert terminal.host_baud() == 0
    line.close()


def test_a_speed_that_a_port_refuses_is_told(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:  # as on systems with a fixed list of speeds
        raise serialx.UnsupportedSetting("Unsupported baudrate 123456")

    line = SerialLine(terminal.path, 57600, end=b"\r")
    monkeypatch.setattr(type(line._serial), "_reconfigure_port", refuse)
    with pytest.raises(DeviceError) as caught:
        line.set_baud(123456)
    assert str(caught.value).endswith("does not take 123456 baud: Unsupported baudrate 123456")
    line.close()


def test_a_second_opener_reaches_the_port_of_one_that_hangs(terminal: Terminal) -> None:
    hangs = SerialLine(terminal.path, 57600, end=b"\r")
    second = SerialLine(terminal.path, 57600, end=b"\r")
    second.send(b"off\r")
    assert arrives(terminal, 4) == b"off\r"
    second.close()
    hangs.close()


def openers() -> list[Callable[[str], object]]:
    return [lambda port: SerialLine(port, 57600, end=b"\r"), lambda port: tmcl._opened(port, 9600)]


@pytest.mark.parametrize("opener", openers())
def test_a_port_that_another_program_has_locked_is_left_alone(
    terminal: Terminal, opener: Callable[[str], object]
) -> None:
    """As terminal programs do, and whoever opens it for itself alone."""
    other = os.open(terminal.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(other, fcntl.LOCK_EX)
    before = len(os.listdir("/proc/self/fd"))
    with pytest.raises(DeviceError, match=f"'{terminal.path}' is in use by another program, .*: end that first$"):
        opener(terminal.path)
    assert len(os.listdir("/proc/self/fd")) == before
    assert terminal.receive() == b""
    os.close(other)


@pytest.mark.parametrize("opener", openers())
def test_who_has_a_port_open_keeps_other_programs_from_it(terminal: Terminal, opener: Callable[[str], Any]) -> None:
    ours, second = opener(terminal.path), opener(terminal.path)  # the guardian's
    other = os.open(terminal.path, os.O_RDWR | os.O_NOCTTY)
    for one in (ours, second):
        with pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        one.close()
    fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(other)


@pytest.mark.parametrize("opener", openers())
def test_a_guardian_speaks_on_a_port_that_another_program_has_locked(
    terminal: Terminal, opener: Callable[[str], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The program may have come between a session's death and what makes its devices safe."""
    monkeypatch.setattr(wire_claims, "_GUARDED", set[str]())
    claims = wire_claims.WireClaims()
    claims.guard([terminal.path])
    other = os.open(terminal.path, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(other, fcntl.LOCK_EX)
    opener(terminal.path).close()
    os.close(other)
    claims.release()


def test_a_port_that_the_system_keeps_for_another_program_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def busy(self: object) -> None:  # TIOCEXCL, which holds for everybody but root
        raise OSError(errno.EBUSY, os.strerror(errno.EBUSY), "/dev/bench")

    monkeypatch.setattr(type(serialx.serial_for_url("/dev/bench", 9600)), "_open", busy)
    for opener, words in zip(
        openers(), (": another program has it; end that first", "; another program has it, "), strict=True
    ):
        with pytest.raises(DeviceError, match=f"Device or resource busy.*{words}"):
            opener("/dev/bench")


def test_a_port_that_a_user_may_not_open_says_who_may(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(self: object) -> None:  # root may open any
        raise OSError(errno.EACCES, os.strerror(errno.EACCES), "/dev/bench")

    monkeypatch.setattr(type(serialx.serial_for_url("/dev/bench", 9600)), "_open", refused)
    with pytest.raises(DeviceError, match="'/dev/bench' cannot be opened: Permission denied: its group may open it, "):
        SerialLine("/dev/bench", 57600, end=b"\r")


def test_a_port_that_is_unplugged_is_named() -> None:
    terminal = Terminal()
    line = SerialLine(terminal.path, 57600, end=b"\r")
    terminal.close()
    for touched in (lambda: line.send(b"x\r"), lambda: line.receive(0.5), line.clear):
        with pytest.raises(DeviceError, match=f"^serial port '{terminal.path}' is gone: "):
            touched()
    with pytest.raises(DeviceError, match=f"^serial port '{terminal.path}' does not take 9600 baud: "):
        line.set_baud(9600)
    line.close()
    line.close()


@pytest.mark.parametrize(
    ("port", "said"),
    [
        ("/dev/no-such-port", "No such file or directory: check its plug"),
        ("/", "Is a directory: it is not a serial port"),
        ("FILE", "Inappropriate ioctl for device: it is not a serial port"),
        ("nonsense://here", "No handler registered for URI scheme 'nonsense://'"),
        ("socket://127.0.0.1", "Invalid socket URI, expected both host and port: socket://127.0.0.1"),
        ("socket://127.0.0.1:1", "Connection refused: nothing listens there; start its server first"),
    ],
)
def test_a_port_that_cannot_be_opened_says_why(tmp_path: Path, port: str, said: str) -> None:
    plain = tmp_path / "plain"
    plain.write_bytes(b"")
    port = str(plain) if port == "FILE" else port
    with pytest.raises(DeviceError) as caught:
        SerialLine(port, 57600, end=b"\r")
    assert str(caught.value) == f"serial port '{port}' cannot be opened: {said}"


def test_a_socket_is_a_line_until_its_other_end_closes() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        line = SerialLine(f"socket://127.0.0.1:{server.getsockname()[1]}", 57600, end=b"\r")
        other, _ = server.accept()
        line.send(b"?\r")
        assert other.recv(10) == b"?\r"
        other.sendall(b"one\rtwo\r")
        assert [line.receive(2.0), line.receive(2.0), line.receive(0.01)] == [b"one", b"two", None]
        other.close()
        with pytest.raises(DeviceError, match=r"is gone: .*socket closed by peer"):
            line.receive(2.0)
        line.close()


def test_ports_with_a_plug_are_listed_under_the_name_that_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    def port(device: str, vid: int | None, product: str | None) -> serialx.SerialPortInfo:
        return serialx.SerialPortInfo(device, "/dev/ttyUSB0", vid, vid, None, None, product, None, None, None)

    wired = [("/dev/serial/by-id/tec", 0x0403, "TEC"), ("/dev/ttyUSB1", 0x0403, None), ("/dev/ttyS0", None, None)]
    found = [port(*words) for words in wired]
    monkeypatch.setattr(serialx, "list_serial_ports", lambda: found)
    told = ThermalDisplay.discover()
    assert [part.where for part in told] == ["/dev/serial/by-id/tec", "/dev/ttyUSB1"]
    assert [part.note.split(";")[0] for part in told] == ["a serial port (TEC)", "a serial port (it tells no name)"]
