"""The Inverse3's driver against the virtual service: positions, forces, and each thing that can go wrong."""

from __future__ import annotations

import contextlib
import io
import json
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from channel_records import records
from hypothesis import given, settings
from hypothesis import strategies as st
from virtual_service import ServedService

from itouch.plugin import DeviceError, Trace, read_trace
from itouch.testing import DeviceTests, EmulatorTests
from itouch_arms.errors import ArmError, Disconnected, NotCalibrated, NotFound, ProtocolError, Refused, Timeout
from itouch_arms.haply import Haply, HaplyParams, Inverse3, messages
from itouch_arms.haply.haply_device import look
from itouch_arms.haply.line import Line
from itouch_arms.haply.virtual import CENTRE, VirtualService

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

GOLDEN = Path(__file__).parent / "haply.trace"


@pytest.fixture
def rig() -> Iterator[ServedService]:
    with ServedService() as served:
        yield served


class TestHaplyEmulator(EmulatorTests):
    device, name = Haply, "haply"


class TestHaplyServed(DeviceTests):
    """The whole suite with the driver on the virtual service."""

    device, name, hardware = Haply, "haply", True
    # These two let a virtual clock run past a thread that waits for a wire; test_haply_engine does it in step.
    test_lifecycle = test_safe_on_exception = None

    @pytest.fixture(autouse=True)
    def serve(self, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
        service = VirtualService(buttons={"a": True})
        with ServedService(service) as served:
            monkeypatch.setattr(type(self), "params", HaplyParams(service=served.address, deadman="a"))
            yield
            assert service.force == (0.0, 0.0, 0.0)


def test_position_and_force_go_through_the_wire(rig: ServedService) -> None:
    finger = rig.service.finger
    with Inverse3(rig.address) as arm:
        assert arm.device == "049D"
        arm.write((0.3, -0.6, 1.2))
        state = arm.read()
        for _ in range(400):
            finger.hand = (0.02, -0.13, 0.17)
            state = arm.read()
        assert state is not None
        assert rig.service.force == (0.3, -0.6, 1.2)
        arm.write((0.0, 0.0, 0.0))
    assert rig.service.force == (0.0, 0.0, 0.0)


def test_the_finger_yields_to_the_motors_as_far_as_its_hand_lets_it() -> None:
    service = VirtualService()
    for tick in range(2000):
        service.answer(messages.force("049D", (0.0, 0.0, 1.5)), 1e-3 * tick)
    assert service.finger.position == pytest.approx((CENTRE[0], CENTRE[1], CENTRE[2] + 1.5 / 300.0), abs=1e-6)


def test_zero_force_on_every_exit(rig: ServedService) -> None:
    for error in (RuntimeError, KeyboardInterrupt, SystemExit):
        with pytest.raises(error), Inverse3(rig.address) as arm:
            arm.write((0.0, 0.0, 2.0))
            arm.read()
            assert rig.service.force == (0.0, 0.0, 2.0)
            raise error
        assert rig.service.force == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("fault", "value", "error", "words"),
    [
        ("mute", 1, Timeout, "in time"),
        ("late", 5.0, Timeout, "in time"),
        ("garbage", 1, ProtocolError, "not JSON"),
        ("odd", 1, ProtocolError, "'y'.*no finite number"),
        ("nan", 1, ProtocolError, "'z'.*no finite number"),
        ("far", 1, ProtocolError, "no such arm reaches"),
        ("hang_up", True, Disconnected, "gone"),
        ("unplugged", True, Disconnected, "does not list it"),
        ("unpowered", True, Refused, "no power"),
        ("uncalibrated", True, NotCalibrated, "not calibrated"),
    ],
)
def test_each_fault_has_a_name_ends_the_force_and_can_be_got_over(
    rig: ServedService, fault: str, value: Any, error: type[ArmError], words: str
) -> None:
    service = rig.service
    arm = Haply(HaplyParams(service=rig.address))
    reading, command = records(arm)
    arm.open()
    command["wrench"][2] = 2.0
    arm.write(command)
    arm.read(reading)
    before = reading.tobytes()
    setattr(service.faults, fault, value)
    with pytest.raises(error, match=words):
        arm.read(reading)
    assert reading.tobytes() == before  # nothing that is wrong was passed on
    arm.close()
    if fault in ("hang_up", "unplugged"):
        assert service.force == (0.0, 0.0, 2.0)  # nobody could tell it; what the service does then is its own
    else:
        assert service.force == (0.0, 0.0, 0.0)
    service.faults = type(service.faults)()
    arm.open()
    assert service.force == (0.0, 0.0, 0.0)
    assert arm.read(reading)
    arm.close()


@pytest.mark.parametrize("fault", ["unpowered", "uncalibrated", "unplugged", "garbage", "mute"])
def test_no_force_is_sent_to_an_arm_that_is_not_fit_for_it(rig: ServedService, fault: str) -> None:
    setattr(rig.service.faults, fault, 1)
    arm = Haply(HaplyParams(service=rig.address, calibration_time=0.1))
    with pytest.raises(DeviceError):
        arm.open()
    arm.close()
    assert not any(any(force) for force in rig.service.asked)


def test_an_arm_is_waited_for_until_it_is_calibrated(rig: ServedService, caplog: pytest.LogCaptureFixture) -> None:
    rig.service.faults.uncalibrated = True
    looks = []

    def sleep(seconds: float) -> None:
        looks.append(seconds)
        rig.service.faults.uncalibrated = len(looks) < 5

    arm = Inverse3(rig.address, calibration_time=60.0, sleep=sleep)
    arm.open()
    assert len(looks) == 5
    assert "not calibrated" in caplog.text
    arm.close()


def test_a_half_said_position_is_completed_and_an_unsaid_one_is_not_new(rig: ServedService) -> None:
    rig.service.finger.led = True
    with Inverse3(rig.address) as arm:
        arm.read()
        rig.service.finger.position = (0.05, 0.0, 0.0)
        rig.service.faults.halved = 1
        state = arm.read()
        assert state is not None and state.position == (0.05, CENTRE[1], CENTRE[2])
        rig.service.faults.bare = 1
        assert arm.read() is None


def test_messages_that_nobody_asked_for_do_not_put_it_behind(rig: ServedService) -> None:
    rig.service.finger.led = True
    with Inverse3(rig.address) as arm:
        rig.service.faults.extra = 3
        for step in range(20):
            rig.service.finger.position = (1e-3 * step, 0.0, 0.1)
            state = arm.read()
            assert state is not None and state.position[0] == 1e-3 * step


def test_of_several_arms_one_must_be_named(rig: ServedService) -> None:
    rig.service.others = ("0001", "0002")
    with pytest.raises(ArmError, match="several arms.*0001.*device="):
        Inverse3(rig.address).open()
    with Inverse3(rig.address, "049D") as arm:
        arm.write((1.0, 0.0, 0.0))
        arm.read()
        assert rig.service.force == (1.0, 0.0, 0.0)
        rig.service.others = ()  # another one is unplugged: nothing to us
        assert arm.read() is not None
    with pytest.raises(NotFound, match="'0003'.*049D"):
        Inverse3(rig.address, "0003").open()


def test_the_service_is_ended_and_started_again(rig: ServedService) -> None:
    arm = Haply(HaplyParams(service=rig.address))
    reading, _ = records(arm)
    arm.open()
    rig.end()
    with pytest.raises(Disconnected, match="gone"):
        for _ in range(3):
            arm.read(reading)
    arm.close()
    with pytest.raises(NotFound, match="no Inverse Service answers.*Haply Hub"):
        arm.open()
    rig.start()
    arm.open()
    assert arm.read(reading)
    arm.close()


def test_a_second_process_takes_the_force_away(rig: ServedService) -> None:
    first = Haply(HaplyParams(service=rig.address))
    reading, command = records(first)
    first.open()
    command["wrench"][:3] = (0.0, 1.0, 1.0)
    first.write(command)
    first.read(reading)
    assert any(rig.service.force)
    for fault in ("", "uncalibrated", "unpowered"):
        rig.service.force = (0.0, 1.0, 1.0)
        if fault:
            setattr(rig.service.faults, fault, True)
        Haply(HaplyParams(service=rig.address)).make_safe(command)
        assert rig.service.force == (0.0, 0.0, 0.0)
    first.close()


def test_a_torque_is_refused_and_so_is_what_is_no_force(rig: ServedService) -> None:
    arm = Haply(HaplyParams(service=rig.address))
    _, command = records(arm)
    arm.open()
    command["wrench"] = (0, 0, 1.0, 0, 0.1, 0)
    with pytest.raises(ValueError, match="locked"):
        arm.write(command)
    command["wrench"] = (0, float("nan"), 1.0, 0, 0, 0)
    with pytest.raises(ValueError, match="finite"):
        arm.write(command)
    arm.close()
    with pytest.raises(DeviceError, match="not open"):
        arm.write(command)
    assert not any(any(force) for force in rig.service.asked)


def test_the_grip_offsets_the_pose_and_its_button_is_the_switch(rig: ServedService) -> None:
    rig.service.finger.led = True
    arm = Haply(HaplyParams(service=rig.address, grip=(0.0, 0.0, -0.03), deadman="b"))
    reading, _ = records(arm)
    arm.open()
    arm.read(reading)
    assert reading["pose"][:3] == pytest.approx((CENTRE[0], CENTRE[1], CENTRE[2] - 0.03))
    assert reading["deadman"].item() == 0.0
    rig.service.buttons = {"a": False, "b": True}
    arm.read(reading)
    assert reading["deadman"].item() == 1.0
    arm.close()


def test_axes_that_another_program_has_turned_are_refused() -> None:
    with pytest.raises(Refused, match="'XZY'"):
        messages.check({"device_id": "1", "config": {"basis": {"permutation": "XZY"}}})


@pytest.mark.parametrize(
    "service", ["", "localhost", "localhost:", "localhost:http", "localhost:70000", "localhost:²", ":10001"]
)
def test_a_bad_service_address_is_refused(service: str) -> None:
    with pytest.raises(NotFound, match="HOST:PORT"):
        Inverse3(service).open()
    if service:  # of a scene without one it is the service of this machine
        with pytest.raises(ValueError, match=r"^service = .* must be HOST:PORT"):
            HaplyParams(service=service)
    assert HaplyParams(service="ws://[::1]:10001/").service


def test_something_else_that_listens_there_is_no_service() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def answer() -> None:
            line, _ = listener.accept()
            line.recv(4096)
            line.sendall(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n")
            line.close()

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(ArmError, match=r"not an Inverse Service|gone"):
            Inverse3(f"127.0.0.1:{listener.getsockname()[1]}").open()
        thread.join()


def test_what_is_attached_is_told_with_what_is_wrong_with_it(rig: ServedService) -> None:
    (found,) = look(rig.address)
    assert found.usable and found.where == "Inverse3 049D"
    rig.service.faults.unpowered = True
    (found,) = look(rig.address)
    assert not found.usable and "no power" in found.note
    rig.service.faults.unplugged = True
    (found,) = look(rig.address)
    assert not found.usable and "no Inverse3" in found.note
    rig.end()
    (found,) = look(rig.address)
    assert not found.usable and "Haply Hub" in found.note
    rig.start()
    assert not rig.service.asked


@pytest.mark.parametrize("sessions", [True, False])
def test_the_session_is_named_once_and_only_where_there_are_sessions(sessions: bool) -> None:
    trace = io.StringIO()
    with (
        ServedService(VirtualService(sessions=sessions)) as rig,
        Inverse3(rig.address, trace=Trace(trace, "arm")) as arm,
    ):
        arm.read()
    sent = [json.loads(entry.data) for entry in read_trace(trace.getvalue().splitlines()) if entry.mark == ">"]
    assert ["session" in message for message in sent] == [sessions, False, False]


def test_the_wire_is_that_of_the_golden_transcript(rig: ServedService) -> None:
    """Recorded with the virtual service: opening, three exchanges, closing."""
    rig.service.finger.led = True
    stream = io.StringIO()
    with Inverse3(rig.address, trace=Trace(stream, "arm", clock=lambda: 0.0)) as arm:
        for step in range(3):
            rig.service.finger.position = (0.01 * step, -0.12, 0.15)
            arm.write((0.0, 0.25 * step, -0.5))
            arm.read()
    assert stream.getvalue() == GOLDEN.read_text(encoding="utf-8")


#: Words of the protocol, so that random messages come near it.
WORDS = ("x", "y", "z", "device_id", "state", "status", "config", "cursor_position", "buttons", "a", "basis", "error",
         "power_supply", "calibrated", "permutation")  # fmt: skip
PLAIN = {
    "device_id": "04BA",
    "state": {"cursor_position": {"x": 0.078, "y": -0.148, "z": 0.143}, "cursor_velocity": {"x": 0, "y": 0, "z": 0}},
}


def test_a_service_of_another_hand_with_less_in_its_messages() -> None:
    """A server made with the library's own, which answers as the documentation of version 3.1 says, and no more."""
    from websockets.sync.server import ServerConnection, serve

    heard: list[dict[str, Any]] = []

    def handler(line: ServerConnection) -> None:
        line.send(json.dumps({"inverse3": [{**PLAIN, "config": {"type": "inverse3"}}], "verse_grip": []}))
        for text in line:
            heard.append(json.loads(text))
            line.ping()
            line.send([json.dumps({"inverse3": [PLAIN]})[:9], json.dumps({"inverse3": [PLAIN]})[9:]])  # in two frames

    with serve(handler, "127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        arm = Inverse3(f"127.0.0.1:{server.socket.getsockname()[1]}")
        arm.open()
        arm.write((0.1, 0.2, 0.3))
        for _ in range(50):
            state = arm.read()
            assert state is not None and state.position == (0.078, -0.148, 0.143)
        arm.close()
        server.shutdown()
        thread.join()
    assert [m["inverse3"][0]["commands"]["set_cursor_force"]["values"] for m in heard[-2:]] == [
        {"x": 0.1, "y": 0.2, "z": 0.3}, {"x": 0.0, "y": 0.0, "z": 0.0},
    ]  # fmt: skip
    assert not any("session" in message for message in heard)


@pytest.mark.parametrize(
    "noise", [b"\xff", b"\x81\x05abc", b"\x81\x80\0\0\0\0", b"\x88\x02\x03\xe8", b"\x82\x02\xff\xfe", b"\0\0"]
)
def test_noise_on_the_line_ends_in_a_name_and_the_service_lives(rig: ServedService, noise: bytes) -> None:
    with pytest.raises(ArmError), Inverse3(rig.address) as arm:
        arm.read()
        rig._server._connections[0].line.send(noise)
        for _ in range(5):
            arm.read()
    with Inverse3(rig.address) as arm:
        assert arm.read() is not None


def test_a_host_that_leaves_before_its_answer_or_talks_nonsense_does_not_end_the_service(rig: ServedService) -> None:
    rig.service.faults.late = 0.05
    line = Line(rig.address)
    line.receive(1.0)
    line.send("no JSON")
    line.close()
    with socket.create_connection(("127.0.0.1", rig.port)) as plain:
        plain.settimeout(300.0)
        plain.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n" + b"\xff" * 50)
        plain.recv(100)
    time.sleep(0.1)
    rig.service.faults.late = 0.0
    with Inverse3(rig.address) as arm:
        assert arm.read() is not None


VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers(-(10**400), 10**400) | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(WORDS) | st.text(max_size=4), inner, max_size=5)
    ),
    max_leaves=12,
)


@settings(max_examples=300, deadline=None)
@given(VALUES)
def test_whatever_is_said_is_a_place_or_an_error_with_a_name(value: Any) -> None:
    for message in (value, {"inverse3": value}, {"inverse3": [{"device_id": "1", "state": value}]}, {
        "inverse3": [{"device_id": "1", "state": {"cursor_position": value}, "status": value}], "verse_grip": value,
    }):  # fmt: skip
        try:
            update = messages.read(json.dumps(message))
            one = messages.chosen(update, "any")
            messages.check(one)
            state = messages.state_of(update, one, "a", None)
        except ArmError:
            continue
        assert state is None or all(abs(part) <= messages.FARTHEST for part in state.position)


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=60))
def test_whatever_comes_is_a_message_or_an_error_with_a_name(text: str) -> None:
    with contextlib.suppress(ArmError):
        assert isinstance(messages.read(text), dict)


def test_an_end_of_the_connection_after_answers_is_told_when_they_are_used_up() -> None:
    from websockets.sync.server import ServerConnection, serve

    def handler(line: ServerConnection) -> None:
        line.send(json.dumps({"inverse3": [PLAIN]}))
        line.recv()
        line.send(json.dumps({"inverse3": [PLAIN]}))
        line.send(json.dumps({"inverse3": [PLAIN]}))

    with serve(handler, "127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        with pytest.raises(Disconnected), Inverse3(f"127.0.0.1:{server.socket.getsockname()[1]}") as arm:
            for _ in range(4):
                arm.read()
        server.shutdown()
        thread.join()
