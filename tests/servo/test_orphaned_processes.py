"""Processes without a duty end with the one that started them from their first instruction; a plate on its way down."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator

import pytest

from itouch.plugin import Field, Record, TwinInputs
from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch.servo import twin_protocol
from itouch.servo.twin_server import TwinServer
from itouch.world.rig import build_devices
from itouch_tools.cli.doctor.touch_scene import scene


@pytest.mark.parametrize(
    "words", [("itouch.servo.twin_process", "0", "1"), ("itouch.servo.compile_ahead", "no such scene", "--parent", "1")]
)
def test_a_process_whose_parent_has_gone_does_not_begin(words: tuple[str, ...]) -> None:
    """It neither waits for what it is to do, which never comes here, nor looks at it."""
    assert os.getpid() != 1
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", *words], stdin=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.wait(300) == 1
        assert process.stderr is not None
        assert process.stderr.read() == ""
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def table() -> Iterator[tuple[TwinServer, socket.socket]]:
    """Return a remote table with a watchdog of 100 ms of its own clock, and who commands it."""
    catalog = Catalog()
    model = build_devices(loads(scene().encode(), catalog), catalog, [])["table"]
    address = twin_protocol.address(f"alone-{os.getpid()}", "table")
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(address)
    listener.listen(8)
    server = TwinServer(model, listener, watchdog=0.1, period=1e-3)
    server._heard = 1 << 62  # its watchdog looks at the clock on the wall, which is not what is tried here
    line = twin_protocol.connect(address)
    line.send(twin_protocol.head(twin_protocol.INIT, 0, 0) + server.state.tobytes())
    server.step()
    yield server, line
    line.close()
    server.close()


def test_a_plate_whose_next_step_down_is_late_is_still_on_its_way_down(
    table: tuple[TwinServer, socket.socket],
) -> None:
    server, line = table
    command = Record.of(Field.of(channel) for channel in server.model.commands)
    (name,) = (channel.name for channel in server.model.commands)

    def safe(height: float | None, steps: int = 1) -> bool:
        for _ in range(steps):
            if height is not None:
                command[name][2] = height
                line.send(
                    twin_protocol.head(twin_protocol.COMMAND, 1, 0)
                    + command.tobytes()
                    + twin_protocol.pack_touch(TwinInputs())
                )
            server.step()
            server._heard = 1 << 62
        return bool(server.flags & twin_protocol.OUTPUTS_SAFE)

    assert not safe(0.03)  # the first height is no way down
    assert not safe(0.03, 5) and safe(0.029)
    assert safe(None, 20) and safe(0.028)  # the servo process was held up for 20 ms
    assert not safe(0.028, 100)  # a plate that stands is not safe
    assert safe(0.027) and not safe(0.0275)  # nor one that rises


_IMPORTING = """
import socket, subprocess, sys, threading
from itouch.servo import control_block, process
from itouch.servo.launcher_pipe import Outbox
from itouch.servo.shared_memory import SharedMemory

class Endless:
    def find_spec(self, name, path=None, target=None):
        if name in ("itouch.servo.error_transport", "itouch.loop"):
            threading.Event().wait()

sys.meta_path.insert(0, Endless())
guardian = subprocess.Popen([sys.executable, "-c", ""])
guardian.wait()
segment = SharedMemory.create("importing")
segment.words[control_block.GUARDIAN] = guardian.pid
process._end_without_guardian(segment, Outbox(socket.socket(fileno=int(sys.argv[1]))))
threading.Event().wait()
"""


def test_a_dead_guardian_is_told_while_the_servo_process_still_imports() -> None:
    near, far = socket.socketpair()
    with near, far:
        words = [sys.executable, "-c", _IMPORTING, str(far.fileno())]
        servo = subprocess.Popen(words, pass_fds=(far.fileno(),))
        far.close()
        near.settimeout(300.0)
        try:
            said = near.recv(65536).decode()
            assert "nothing is enabled without it" in said
            assert servo.wait(300) == 1
        finally:
            servo.kill()
            servo.wait()
