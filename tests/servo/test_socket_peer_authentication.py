"""Processes of other users on the same machine: what they say to the parts of a session is not heard."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest
from requirements import meant

from itouch.platforms import lives
from itouch.plugin import TwinInputs
from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch.servo import twin_protocol, twin_server
from itouch.servo.parent_process import ProcessEnd, gone
from itouch.servo.twin_server import TwinServer
from itouch.world.rig import build_devices

SCENE = """<itouch version="1.0">
  <devices><device name="arm" plugin="usb-arm" twin="remote"/></devices>
</itouch>
"""
NOBODY = 65534
_SAY = """
import os, socket, sys
os.setuid(int(sys.argv[2]))
line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
line.connect("\\0" + sys.argv[1])
line.settimeout(300)
try:
    line.send(b"S" + b"a stranger")
    line.send(b"W")
    print("heard" if line.recv(65536) else "hung up")
except OSError:
    print("hung up")
"""

needs_root = pytest.mark.skipif(os.geteuid() != 0, reason=meant("only root can run a program as somebody else"))


def said_by(user: int, address: str) -> str:
    words = [sys.executable, "-I", "-S", "-c", _SAY, address.removeprefix("\0"), str(user)]
    return subprocess.run(words, cwd="/", capture_output=True, text=True, timeout=600, check=False).stdout


@pytest.fixture
def server() -> Iterator[tuple[TwinServer, str]]:
    """Return a remote twin that steps when it is told to, and where it listens."""
    catalog = Catalog()
    model = build_devices(loads(SCENE.encode(), catalog), catalog, [])["arm"]
    address = twin_protocol.address(f"test-{os.getpid()}", "arm")
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(address)
    listener.listen(8)
    found = TwinServer(model, listener, watchdog=60.0, period=1e-3)
    yield found, address
    found.close()


@needs_root
@pytest.mark.parametrize(("user", "heard"), [(NOBODY, False), (0, True)])
def test_only_the_same_user_can_stop_a_remote_twin(server: tuple[TwinServer, str], user: int, heard: bool) -> None:
    twin, address = server
    told: list[str] = []
    stranger = threading.Thread(target=lambda: told.append(said_by(user, address).strip()))
    stranger.start()
    while stranger.is_alive():
        twin.step()
    stranger.join()
    flags = twin.flags
    assert told == ["heard" if heard else "hung up"]
    assert bool(flags & twin_protocol.LATCHED) is heard


def test_a_second_opener_does_not_take_a_twin_from_its_session(server: tuple[TwinServer, str]) -> None:
    twin, address = server
    first, second = twin_protocol.connect(address, 5.0), twin_protocol.connect(address, 5.0)
    begin = twin_protocol.head(twin_protocol.INIT, 0, 0) + twin.state.tobytes()
    first.send(begin)
    twin.step()
    twin.step()
    second.send(begin)
    second.send(
        twin_protocol.head(twin_protocol.COMMAND, 7, 0)
        + twin.command.tobytes()
        + twin_protocol.pack_touch(TwinInputs())
    )
    twin.step()
    assert not twin.flags & twin_protocol.BEGUN  # nobody's command was taken
    first.send(
        twin_protocol.head(twin_protocol.COMMAND, 1, 0)
        + twin.command.tobytes()
        + twin_protocol.pack_touch(TwinInputs())
    )
    twin.step()
    assert twin.flags & twin_protocol.BEGUN
    first.close()
    second.close()


@pytest.mark.parametrize("packet", [b"C", b"C" + bytes(20), b"C" + bytes(120), b"I" + bytes(3)])
def test_a_packet_that_is_cut_off_ends_its_sender_and_not_the_twin(
    server: tuple[TwinServer, str], packet: bytes
) -> None:  # fmt: skip
    twin, address = server
    first, second = twin_protocol.connect(address, 5.0), twin_protocol.connect(address, 5.0)
    if packet[:1] == twin_protocol.COMMAND:
        first.send(twin_protocol.head(twin_protocol.INIT, 0, 0) + twin.state.tobytes())
    second.send(twin_protocol.WATCH)
    twin.step()
    first.send(packet)
    for _ in range(3):
        twin.step()
    assert bool(twin.flags & twin_protocol.LATCHED) is (packet[:1] == twin_protocol.COMMAND)  # its session has gone
    assert second.recv(twin_protocol.PACKET)
    while first.recv(twin_protocol.PACKET):
        pass  # what it was told before; then it is hung up on
    first.close()
    second.close()


def test_a_client_that_floods_the_socket_does_not_hold_up_a_step(
    server: tuple[TwinServer, str], monkeypatch: pytest.MonkeyPatch
) -> None:  # fmt: skip
    twin, address = server
    monkeypatch.setattr(twin_server, "PACKETS", 3)
    line = twin_protocol.connect(address, 5.0)
    twin.step()
    heard = list[bytes]()
    monkeypatch.setattr(twin, "_hear", lambda client, packet: heard.append(packet))
    for number in range(7):
        line.send(bytes([number]))
    counts = []
    for _ in range(4):
        twin.step()
        counts.append(len(heard))
    assert counts == [3, 6, 7, 7]
    line.close()


def test_where_strangers_take_every_place_a_session_waits_for_one() -> None:
    address = twin_protocol.address(f"test-{os.getpid()}", "crowd")
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(address)
    listener.listen(1)
    crowd, found = list[socket.socket](), list[socket.socket]()
    with contextlib.suppress(BlockingIOError):
        while True:
            crowd.append(socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET))
            crowd[-1].setblocking(False)
            crowd[-1].connect(address)
    with pytest.raises(OSError):
        twin_protocol.connect(address, 0.05)
    session = threading.Thread(target=lambda: found.append(twin_protocol.connect(address, 60.0)))
    session.start()
    session.join(0.2)
    assert session.is_alive()  # it waits, and is not refused
    for _ in list(crowd):  # the one that found no place is not among them, the session is
        crowd.append(listener.accept()[0])
    session.join()
    assert len(found) == 1
    for line in (*crowd, *found, listener):
        line.close()


@needs_root
def test_a_session_does_not_talk_to_a_strangers_twin() -> None:
    name = f"itouch/test-{os.getpid()}/arm"
    code = (
        f"import os, socket, sys\nos.setuid({NOBODY})\ns = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)\n"
        f"s.bind('\\0{name}')\ns.listen(1)\nprint('up', flush=True)\nsys.stdin.read()\n"
    )
    words = [sys.executable, "-I", "-S", "-c", code]
    with subprocess.Popen(words, cwd="/", stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"up\n"
        with pytest.raises(PermissionError, match="another user"):
            twin_protocol.connect("\0" + name, 5.0)
        process.kill()


def test_the_same_user_is_known_by_the_kernel() -> None:
    one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    assert twin_protocol.same_user(one)
    assert twin_protocol.same_user(other)
    one.close()
    other.close()


def test_a_parent_is_known_by_its_number() -> None:
    assert not gone(os.getppid())
    assert gone(os.getppid() + 1)
    assert lives(os.getpid())
    assert not lives((1 << 22) + 1)
    done = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    end, unknown = ProcessEnd(lambda: done.pid), ProcessEnd(lambda: 0)
    assert not end.seen()
    assert not unknown.seen()
    done.kill()
    while lives(done.pid):  # it has ended, and is not yet buried
        threading.Event().wait(0.01)
    assert end.seen()
    done.communicate()
    assert ProcessEnd(lambda: (1 << 22) + 1).seen()
