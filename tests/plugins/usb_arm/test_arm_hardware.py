"""The arm as a device: through its lifecycle on the virtual arm, and over golden transcripts of its wire."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from channel_records import records
from trace_playback import PlayedFalcon

from itouch.plugin import Attached, DeviceError, Trace, read_trace
from itouch_usb_arm import Buttons, Disconnected, Falcon, HomingTimeout, NotHomed, UsbArm, UsbArmParams, boot
from itouch_usb_arm.arm import look
from itouch_usb_arm.link import Remote
from itouch_usb_arm.virtual import VirtualBackend, VirtualFalcon, VirtualTime

IMAGE = boot.build([boot.Block(0x3F8000, (1, 2, 3)), boot.Block(0x3F8010, tuple(range(40)))], entry=0x3F8002)
GOLDEN = Path(__file__).parent / "falcon.trace"


def rigged(tmp_path: Path, **params: Any) -> tuple[UsbArm, VirtualFalcon, VirtualTime]:
    time = VirtualTime()
    virtual = VirtualFalcon(time=time)
    file = tmp_path / "firmware.bin"
    file.write_bytes(IMAGE)
    arm = UsbArm(UsbArmParams(firmware=str(file), **params))
    arm.backend = VirtualBackend(virtual)
    made = arm.make_driver
    arm.make_driver = lambda *, safe=False: on_clock(made(safe=safe), time)  # type: ignore[method-assign]
    return arm, virtual, time


def on_clock(falcon: Falcon, time: VirtualTime) -> Falcon:
    falcon._clock = time.now
    return falcon


def test_the_whole_life_of_the_device(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    arm, virtual, _ = rigged(tmp_path, grip=(0.0, 0.0, 0.03), deadman="centre")
    reading, command = records(arm)
    arm.open()
    assert "pull its grip fully out" in caplog.text
    command["wrench"] = (0.0, 0.6, 1.5, 0, 0, 0)
    for _ in range(700):
        arm.write(command)
        assert arm.read(reading)
    truth = np.add(virtual.mechanics.position, (0.0, 0.0, 0.03))
    assert reading["pose"][:3] == pytest.approx(truth, abs=6e-5)
    assert list(reading["pose"][3:]) == [1.0, 0.0, 0.0, 0.0]
    assert virtual.mechanics.motor_force() == pytest.approx((0.0, 0.6 * 0.88, 1.5 * 0.88), abs=0.01)
    assert reading["deadman"].item() == 0.0
    virtual.buttons = Buttons.CENTRE | Buttons.PLUS
    arm.read(reading)
    assert reading["deadman"].item() == 1.0
    arm.close()
    arm.close()
    assert virtual.mechanics.motors == (0, 0, 0)
    with pytest.raises(DeviceError, match="not open"):
        arm.read(reading)


def test_a_torque_is_refused_by_the_drivers_own_interface(tmp_path: Path) -> None:
    arm, virtual, _ = rigged(tmp_path)
    _, command = records(arm)
    arm.open()
    command["wrench"] = (0, 0, 1.0, 0, 0.1, 0)
    with pytest.raises(ValueError, match="locked"):
        arm.write(command)
    arm.close()
    assert all(numbers.values == (0, 0, 0) for numbers in virtual.commands)


def test_not_homed_in_time_is_an_error_and_the_arm_is_let_go(tmp_path: Path) -> None:
    arm, virtual, _ = rigged(tmp_path, homing_time=1.0)
    virtual.faults.unhomed = True
    with pytest.raises(HomingTimeout):
        arm.open()
    assert arm.driver is None
    assert virtual.mechanics.motors == (0, 0, 0)


def test_unplugged_in_the_midst_of_a_frame_is_told_within_20_ms(tmp_path: Path) -> None:
    arm, virtual, time = rigged(tmp_path)
    reading, command = records(arm)
    command["wrench"][2] = 2.0
    for after in range(16):
        arm.open()
        for _ in range(20):
            arm.write(command)
            arm.read(reading)
        before = reading.tobytes()
        virtual.faults.unplug_after = after
        begin = time.now()
        with pytest.raises(Disconnected):
            while True:
                arm.read(reading)
        assert time.now() - begin < 0.020
        assert after == 0 or reading.tobytes() == before or np.isfinite(reading["pose"]).all()
        arm.close()
        virtual.plug(running=bool(after % 2))
    arm.open()
    assert arm.read(reading)
    arm.close()


def test_lost_homing_is_an_error(tmp_path: Path) -> None:
    arm, virtual, _ = rigged(tmp_path)
    reading, _ = records(arm)
    arm.open()
    virtual.faults.unhomed = True
    virtual._homed = [True, False, True]
    with pytest.raises(NotHomed):
        arm.read(reading)
    arm.close()


def test_a_second_process_takes_the_force_away(tmp_path: Path) -> None:
    """The first one died without closing: its last force stands until another one opens the arm."""
    arm, virtual, time = rigged(tmp_path)
    reading, command = records(arm)
    arm.open()
    command["wrench"][2] = 2.0
    arm.write(command)
    arm.read(reading)
    assert virtual.mechanics.motors != (0, 0, 0)
    other = UsbArm(UsbArmParams())
    other.backend = arm.backend
    made = other.make_driver
    other.make_driver = lambda *, safe=False: on_clock(made(safe=safe), time)  # type: ignore[method-assign]
    other.make_safe(command)
    assert virtual.mechanics.motors == (0, 0, 0)
    assert virtual.homed == (True, True, True)


@pytest.mark.parametrize("address", ["nowhere", "host:", "host:99999", ":80", "host:²"])
def test_a_bad_usbip_address_is_told_before_anything_is_opened(address: str) -> None:
    with pytest.raises(ValueError, match=r"^usbip = '.*' must be HOST:PORT.* for example 127"):
        UsbArmParams(usbip=address)
    with pytest.raises(DeviceError, match="must be HOST:PORT"):
        Remote(address)


def test_what_is_attached_and_why_it_cannot_be_used() -> None:
    def look_at(**options: Any) -> tuple[Attached, ...]:
        denied = options.pop("denied", False)
        return look(VirtualBackend(VirtualFalcon(**options), denied=denied))

    (running,) = look_at(running=True, homed=True)
    assert running.usable
    assert "exchanges/s" in running.note
    assert running.note.endswith("homed")
    (cold,) = look_at()
    assert cold.usable
    assert 'firmware="FILE"' in cold.note
    (denied,) = look_at(denied=True)
    assert not denied.usable
    assert "70-itouch.rules" in denied.note
    gone = VirtualFalcon()
    gone.attached = False
    assert look(VirtualBackend(gone)) == ()


# --- transcripts ------------------------------------------------------------------------------------------------------


def session(falcon: Falcon) -> list[tuple[int, ...]]:
    """What the golden transcript is of: a cold start, a refused force, homing, a force, and the end."""
    seen = []
    with falcon:
        with pytest.raises(NotHomed):
            falcon.write((0.0, 0.0, 1.0))
        seen.append(falcon.home(5.0).encoders)
        for place in range(5):
            falcon.write((0.2 * place, 0.1, -0.5))
            seen.append(falcon.read().encoders)
    return seen


def recorded() -> str:
    time, stream = VirtualTime(), io.StringIO()
    backend = VirtualBackend(VirtualFalcon(time=time, seed=3))
    trace = Trace(stream, "arm", clock=time.now)
    session(Falcon(IMAGE, backend, clock=time.now, trace=trace))
    return stream.getvalue()


def test_the_wire_is_that_of_the_golden_transcript() -> None:
    """Made by `python test_arm_hardware.py`, read and checked by eye against the protocol; times may differ."""
    now, golden = read_trace(recorded().splitlines()), read_trace(GOLDEN.read_text().splitlines())
    assert [(entry.mark, entry.data) for entry in now] == [(entry.mark, entry.data) for entry in golden]


def test_the_driver_plays_against_the_golden_transcript() -> None:
    time = VirtualTime()
    time.LOOK = 1e-4  # type: ignore[misc]
    backend = PlayedFalcon(read_trace(GOLDEN.read_text().splitlines()), time)
    seen = session(Falcon(IMAGE, backend, clock=time.now))
    assert backend.left == []
    assert backend.controls == []
    assert len(set(seen)) > 2
    assert all(math.isfinite(count) for triple in seen for count in triple)


def test_a_trace_is_readable_text() -> None:
    stream = io.StringIO()
    trace = Trace(stream, "dev", clock=lambda: 1.0)
    sent = [b"#0200\r", b'say "\\n"\r\n', bytes(range(256)), b"", b"\n"]
    for data in sent:
        trace.sent(data)
        trace.received(data)
    trace.remark("two\nlines")
    entries = read_trace(stream.getvalue().splitlines())
    assert [entry.data for entry in entries[:-1]] == [data for data in sent for _ in range(2)]
    assert entries[-1] == (0.0, "dev", "#", b"two lines")
    assert '0.000000 dev > "#0200\\r"' in stream.getvalue()
    with pytest.raises(ValueError, match="line 1 is none"):
        read_trace(["0.1 dev ! 00"])


if __name__ == "__main__":
    GOLDEN.write_text(recorded())
