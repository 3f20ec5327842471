"""Both ends of what goes between a session's processes, in this one: commands, States, flags of a remote twin."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch.plugin import DeviceError, Field, Record, Role, Twin
from itouch.plugin.discovery import Catalog
from itouch.scene import loads
from itouch.servo import control_block as control
from itouch.servo import twin_protocol
from itouch.servo.link import Link
from itouch.servo.operator_requests import Commands, OperatorRequests
from itouch.servo.remote import RemoteTwin
from itouch.servo.serve import Servo
from itouch.servo.twin_server import TwinServer
from itouch.world.rig import build_devices

TABLE = """<itouch version="1.0">
  <devices><device name="table" plugin="xyz-table" twin="remote"/></devices>
</itouch>
"""


def commands(*, twin: bool) -> tuple[Commands, OperatorRequests, list[Any]]:
    told, asked = list[Any](), OperatorRequests()
    session: Any = SimpleNamespace(ticks=5, model=SimpleNamespace(devices={"arm": SimpleNamespace(twin=twin)}))
    outbox: Any = SimpleNamespace(tell=lambda what, content: told.append((what, content)))
    return Commands(session, outbox, asked, dict), asked, told


def test_a_session_of_twins_pauses_and_goes_on() -> None:
    obeyed, asked, told = commands(twin=True)
    obeyed.carry_out({"what": "pause"})
    assert asked.paused
    obeyed.carry_out({"what": "resume"})
    assert not asked.paused
    assert not told
    assert [entry["what"] for entry in obeyed.log] == ["pause", "resume"]


def test_a_session_with_hardware_does_not_pause() -> None:
    obeyed, asked, told = commands(twin=False)
    obeyed.carry_out({"what": "pause"})
    assert not asked.paused
    assert told == [("refused", {"what": "pause", "cause": "a session with hardware can't pause; stop it"})]
    assert not obeyed.log


class Places:
    """A ring of eight places that holds the newest States, each by its number."""

    head, slots = 21, 8

    def copy(self, sequence: int, into: Any) -> tuple[int, int, int, int] | None:
        into[:] = sequence
        return None if sequence <= self.head - self.slots else (sequence, 0, 0, 0)


@pytest.mark.parametrize(
    ("after", "every", "found"),
    [(15, 1, [16, 17, 18, 19, 20, 21]), (18, 1, [19, 20, 21]), (15, 4, [16, 20]), (0, 3, [18, 21])],
)
def test_every_so_manieth_state_is_taken_of_those_that_are_still_there(
    after: int, every: int, found: list[int]
) -> None:
    link: Any = SimpleNamespace(_ring=Places())
    state = Record.of([Field("a", "u1", 4)])
    assert [(number, state["a"][0]) for number in Link.skim(link, after, every, state)] == [(n, n) for n in found]


class Still(Twin):
    """A twin with one number."""

    def fields(self) -> tuple[Field, ...]:
        return (Field("height"),)

    def step(self, *_: Any) -> None:
        raise AssertionError("it is stepped elsewhere")

    read = step  # type: ignore[assignment]


def test_the_newest_of_a_remote_twin_counts_until_it_makes_itself_safe() -> None:
    near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    near.setblocking(False)
    twin = RemoteTwin(Still(None))
    twin._line = near
    state, reading = Record.of([Field("height")]), Record.of([Field("pose")])

    def says(height: float, flags: int) -> None:
        far.send(twin_protocol.head(twin_protocol.TELL, 1, flags) + np.array([height, -height]).tobytes())

    assert twin.read(state, reading) is False
    says(1.0, twin_protocol.BEGUN)
    says(2.0, twin_protocol.BEGUN | twin_protocol.OUTPUTS_SAFE | twin_protocol.CLEAR)
    assert twin.read(state, reading) is True
    assert (state["height"].item(), reading["pose"].item()) == (2.0, -2.0)
    says(3.0, twin_protocol.BEGUN | twin_protocol.LATCHED)
    with pytest.raises(DeviceError, match="made itself safe"):
        twin.read(state, reading)
    far.close()
    with pytest.raises(DeviceError, match="closed the connection"):
        twin.read(state, reading)
    near.close()


@pytest.fixture
def table() -> Iterator[TwinServer]:
    catalog = Catalog()
    model = build_devices(loads(TABLE.encode(), catalog), catalog, [])["table"]
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(twin_protocol.address(f"test-{os.getpid()}", "table"))
    found = TwinServer(model, listener, watchdog=0.1, period=1e-3)
    yield found
    found.close()


def test_a_plate_is_safe_as_it_sinks_and_at_the_bottom_and_not_where_it_stands(table: TwinServer) -> None:
    target = table.model.command(Role.SURFACE_POSE)
    assert target is not None
    bottom, goal = target.low[2], table.acting[target.name]

    def safe(height: float) -> bool:
        goal[2] = height
        table._steps += 1
        return bool(table._judge() & twin_protocol.OUTPUTS_SAFE)

    assert not safe(bottom + 0.02)
    assert safe(bottom + 0.019)  # it sinks
    table._steps += 200
    assert not safe(bottom + 0.019)  # for longer than its watchdog it has not
    assert not safe(bottom + 0.02)
    goal[2] = table._last_target = bottom
    assert safe(bottom)


@pytest.mark.parametrize(
    ("stop", "paused", "scripted", "done", "ends"),
    [
        (0, False, False, False, False),
        (1, False, False, False, True),
        (0, True, False, False, True),
        (0, False, True, False, False),
        (0, False, False, True, False),
        (0, False, True, True, True),
    ],
)
def test_a_run_is_interrupted_by_a_word_a_pause_or_the_end_of_its_script(
    stop: int, paused: bool, scripted: bool, done: bool, ends: bool
) -> None:
    words = dict.fromkeys((control.ASKED, control.TAKEN), 0) | {control.STOP: stop}
    servo: Any = SimpleNamespace(
        words=words, _hold=lambda: None, _asked=SimpleNamespace(paused=paused), _scripted=scripted,
        session=SimpleNamespace(done=done), _commands=SimpleNamespace(reconnecting=[]),
    )  # fmt: skip
    assert Servo._interrupted(servo) is ends
