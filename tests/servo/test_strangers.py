"""Processes of other users on the same machine: what they say to the parts of a session is not heard."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import itouch
from itouch.servo import wire
from itouch.servo.parent import gone, lives

SCENE = """<itouch version="1.0">
  <devices><device name="arm" plugin="usb-arm" twin="remote"/></devices>
</itouch>
"""
NOBODY = 65534
_SAY = """
import socket, sys
line = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
line.connect("\\0" + sys.argv[1])
line.settimeout(10)
try:
    line.send(b"S" + b"a stranger")
    line.send(b"W")
    print("heard" if line.recv(65536) else "hung up")
except OSError:
    print("hung up")
"""

needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can run a program as somebody else")


def said_by(user: int, address: str) -> str:
    words = [sys.executable, "-I", "-S", "-c", _SAY, address.removeprefix("\0")]
    return subprocess.run(words, user=user, cwd="/", capture_output=True, text=True, timeout=60, check=False).stdout


@needs_root
def test_a_stranger_can_not_stop_or_command_a_remote_twin(tmp_path: Path) -> None:
    (tmp_path / "s.xml").write_text(SCENE, encoding="utf-8")
    with itouch.launch(tmp_path / "s.xml", seconds=60.0, realtime=False) as handle:
        address = wire.address(handle.name, "arm")
        assert said_by(NOBODY, address).strip() == "hung up"
        before = handle.link.tick
        while handle.link.tick < before + 100:
            assert handle.running, "a stranger has ended the session"
        assert said_by(0, address).strip() == "heard"  # a second opener of the same user may make it safe
        with pytest.raises(itouch.DeviceFaultError, match="made itself safe"):
            handle.wait(30.0)


@needs_root
def test_a_session_does_not_talk_to_a_strangers_twin() -> None:
    name = f"itouch/test-{os.getpid()}/arm"
    code = (
        "import socket, sys\ns = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)\n"
        f"s.bind('\\0{name}')\ns.listen(1)\nprint('up', flush=True)\nsys.stdin.read()\n"
    )
    words = [sys.executable, "-I", "-S", "-c", code]
    with subprocess.Popen(words, user=NOBODY, cwd="/", stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"up\n"
        with pytest.raises(PermissionError, match="another user"):
            wire.connect("\0" + name, 5.0)
        process.kill()


def test_the_same_user_is_known_by_the_kernel() -> None:
    one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    assert wire.same_user(one)
    assert wire.same_user(other)
    one.close()
    other.close()


def test_a_parent_is_known_by_its_number() -> None:
    assert not gone(os.getppid())
    assert gone(os.getppid() + 1)
    assert lives(os.getpid())
    assert not lives((1 << 22) + 1)
    done = subprocess.Popen([sys.executable, "-c", ""])
    while lives(done.pid):  # it has ended, and is not yet buried
        threading.Event().wait(0.01)
    done.wait()
