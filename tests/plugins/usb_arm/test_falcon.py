"""The driver against two emulators: the package's own with physics, and a plain one that shares no code with it."""

from __future__ import annotations

import itertools
import math
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plain_falcon import PlainFalcon

from itouch.plugin import DeviceError
from itouch_usb_arm import (
    Buttons,
    Disconnected,
    Falcon,
    FalconError,
    FirmwareError,
    HomingTimeout,
    Leds,
    NotFound,
    NotHomed,
    PermissionDenied,
    ProtocolError,
    Timeout,
    boot,
    loader,
)
from itouch_usb_arm import kinematics as k
from itouch_usb_arm.virtual import VirtualBackend, VirtualFalcon, VirtualTime

IMAGE = boot.build([boot.Block(0x3F8000, tuple(range(150))), boot.Block(0x8000, (7,))], entry=0x3F8002)


def counts_at(place: tuple[float, float, float]) -> tuple[int, int, int]:
    one, two, three = (round(count) for count in k.counts_of(k.inverse(place)))
    return one, two, three


@pytest.fixture
def simple() -> PlainFalcon:
    emulator = PlainFalcon(running=True)
    emulator.encoders = counts_at((0.01, -0.02, 0.12))
    return emulator


def virtual(**options: Any) -> tuple[VirtualFalcon, Falcon]:
    time = VirtualTime()
    arm = VirtualFalcon(time=time, **options)
    return arm, Falcon(IMAGE, VirtualBackend(arm), clock=time.now)


# --- opening --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("empties", ["status", "timeout"])
@pytest.mark.parametrize("leading_zero", [True, False])
@pytest.mark.parametrize("needs_configuring", [True, False])
def test_a_cold_arm_is_reset_loaded_and_runs(
    tmp_path: Path, empties: str, leading_zero: bool, needs_configuring: bool
) -> None:
    emulator = PlainFalcon(empties=empties, needs_configuring=needs_configuring)
    emulator.size, emulator.leading_zero = len(IMAGE), leading_zero
    file = tmp_path / "firmware.bin"
    file.write_bytes(IMAGE)
    with Falcon(file, emulator) as arm:
        assert emulator.mode == "run"
        assert arm.read().homed == (False, False, False)
    assert emulator.image == IMAGE
    opening = [(0, 1), (0, 2), (9, 1), (3, 2), (0, 1), (0, 2)]
    assert emulator.requests[:6] == opening
    rest = [r for r in emulator.requests if r[0] != 0]
    reset = [(9, 16), (3, 0x4138), (4, 8), (2, 0), (1, 0x200), (1, 0x100), (1, 0x101)]
    assert rest == [(9, 1), (3, 2), *reset, (1, 0x100), (3, 0x15), (9, 1), (3, 2)]


def test_an_arm_left_in_the_midst_of_an_upload_echoes_and_is_loaded_anew() -> None:
    emulator = PlainFalcon()
    emulator.parrot, emulator.size = True, len(IMAGE)
    with Falcon(IMAGE, emulator) as arm:
        assert emulator.mode == "run"
        assert arm.home(1.0).valid


def test_an_answer_that_looks_like_an_echo_once_is_one(simple: PlainFalcon) -> None:
    simple.encoders, simple.grip = (0, 0, 0), 8  # the minus button is held, at count zero
    with Falcon(backend=simple) as arm:
        assert arm.read().buttons == Buttons.MINUS
    assert simple.image == b""


def test_a_running_arm_is_not_loaded_again(simple: PlainFalcon) -> None:
    with Falcon(backend=simple) as arm:
        arm.read()
    assert simple.image == b""
    assert all(request in (0, 3, 9) for request, _ in simple.requests)


def test_a_cold_arm_without_firmware_says_what_is_missing() -> None:
    with pytest.raises(FirmwareError, match="no firmware file was given"):
        Falcon(backend=PlainFalcon()).open()


def test_a_pipe_is_no_firmware_and_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.bin")
    with pytest.raises(FirmwareError, match=r"pipe\.bin.*a pipe, a device or a socket, not a file"):
        Falcon(backend=PlainFalcon(), firmware=tmp_path / "pipe.bin").open()


@pytest.mark.parametrize("content", [b"", b"\x7fELF" + bytes(100), IMAGE[:-3]])
def test_a_bad_firmware_file_never_reaches_the_arm(tmp_path: Path, content: bytes) -> None:
    emulator, file = PlainFalcon(), tmp_path / "wrong.bin"
    file.write_bytes(content)
    with pytest.raises(FirmwareError, match=r"wrong\.bin"):
        Falcon(file, emulator).open()
    assert emulator.requests == []


def test_a_missing_firmware_file_is_named() -> None:
    with pytest.raises(FirmwareError, match=r"/no/such\.bin"):
        Falcon("/no/such.bin", PlainFalcon()).open()


@pytest.mark.parametrize("at", [0, 1, 61, 62, 200, len(IMAGE) - 1])
def test_a_wrong_echo_ends_the_upload_with_the_byte_named(at: int) -> None:
    emulator = PlainFalcon()
    emulator.size, emulator.echo_wrong_at = len(IMAGE), at
    arm = Falcon(IMAGE, emulator)
    with pytest.raises(FirmwareError, match=f"byte {at} "):
        arm.open()
    assert not arm.is_open
    assert emulator.motors == []


def test_an_echo_that_breaks_off_ends_the_upload_with_the_first_byte_that_is_missing() -> None:
    """The clock stands until nothing comes any more."""
    clock, link = itertools.count(), SimpleNamespace(send=lambda data: None, receive=lambda wait: parts.pop(0))
    parts = [b"ab", *[b""] * 1000]
    with pytest.raises(FirmwareError, match=r"byte 64 .* came back as nothing, not 0x63"):
        loader._piece(link, b"abcd", 62, lambda: 0.01 * next(clock))  # type: ignore[arg-type]


def test_a_dead_boot_loader_is_told() -> None:
    arm, falcon = virtual()
    arm.faults.deaf = True
    with pytest.raises(FirmwareError, match="is the arm powered"):
        falcon.open()


def test_a_missing_arm_and_a_missing_permission_are_told() -> None:
    emulator = PlainFalcon()
    emulator.gone = True
    with pytest.raises(NotFound, match="0403:cb48"):
        Falcon(backend=emulator).open()
    with pytest.raises(PermissionDenied, match='ATTR{idProduct}=="cb48", MODE="0660", TAG.="uaccess".*70-itouch.rules'):
        Falcon(backend=VirtualBackend(VirtualFalcon(), denied=True)).open()


def test_an_unopened_arm_and_a_closed_one_are_told(simple: PlainFalcon) -> None:
    arm = Falcon(backend=simple)
    with pytest.raises(Disconnected, match="not open"):
        arm.read()
    arm.close()
    with arm:
        assert arm.open() is arm
    arm.close()
    with pytest.raises(FalconError):
        arm.write((0, 0, 0))


def test_every_error_is_a_device_error() -> None:
    for error in (NotFound, Disconnected, Timeout, ProtocolError, FirmwareError, NotHomed, HomingTimeout):
        assert issubclass(error, DeviceError)
    assert issubclass(HomingTimeout, TimeoutError)


# --- homing and force ---------------------------------------------------------------------------------------------


def test_no_force_before_homing(simple: PlainFalcon) -> None:
    with Falcon(backend=simple) as arm:
        for _ in range(3):
            with pytest.raises(NotHomed):
                arm.write((1.0, 2.0, 3.0))
            reading = arm.read()
            assert reading.homed == (False, False, False)
            assert not reading.valid
            assert np.isnan(reading.position).all()
        assert set(simple.motors) == {(0, 0, 0)}
        assert not any(info & 1 for info in simple.infos)
        assert all(info & Leds.RED for info in simple.infos)
        assert arm.home(1.0).valid
        arm.write((0.0, 0.0, 2.0))
        arm.read()
        assert simple.motors[-1] != (0, 0, 0)
        begun = next(i for i, info in enumerate(simple.infos) if info & 1)
        assert all(info & 1 for info in simple.infos[begun:])  # from then on, in every frame
        assert simple.infos[-1] & Leds.GREEN
    assert simple.motors[-1] == (0, 0, 0)


def test_homing_that_does_not_happen_ends_in_time(simple: PlainFalcon) -> None:
    simple.homes = False
    with Falcon(backend=simple) as arm, pytest.raises(HomingTimeout, match="axis 1, 2, 3"):
        arm.home(0.05)
    assert set(simple.motors) == {(0, 0, 0)}


def test_a_lost_homing_takes_the_force_away(simple: PlainFalcon) -> None:
    with Falcon(backend=simple) as arm:
        arm.home(1.0)
        arm.write((0.0, 1.0, 0.0))
        arm.read()
        simple.homes, simple.homed = False, 3
        assert not arm.read().valid
        count = len(simple.motors)
        with pytest.raises(NotHomed):
            arm.write((0.0, 1.0, 0.0))
        arm.read()
        assert set(simple.motors[count:]) == {(0, 0, 0)}


def test_an_old_homing_is_kept_when_asked_for() -> None:
    for resume, homed in ((False, False), (True, True)):
        emulator = PlainFalcon(running=True)
        emulator.homed, emulator.homes = 7, False
        with Falcon(backend=emulator, resume=resume) as arm:
            assert arm.read().valid is homed


def test_positions_buttons_and_one_exchange_a_read(simple: PlainFalcon) -> None:
    rng = np.random.default_rng(4)
    with Falcon(backend=simple) as arm:
        arm.home(1.0)
        for _ in range(60):
            place = (rng.uniform(-0.03, 0.03), rng.uniform(-0.03, 0.03), rng.uniform(0.09, 0.16))
            simple.encoders, simple.grip = counts_at(place), int(rng.integers(16))
            reading = arm.read()
            assert reading.encoders == simple.encoders
            assert np.abs(reading.position - place).max() < 6e-5
            assert reading.buttons == Buttons(simple.grip)
            before = len(simple.motors)
            arm.read()
            assert len(simple.motors) == before + 1
        with pytest.raises(ValueError, match="read-only"):
            reading.position[0] = 1.0


def force_on_operator(place: tuple[float, float, float], motors: tuple[int, int, int], scale: float) -> np.ndarray:
    """What motor counts do, by virtual work with a numerical derivative: nothing of the driver's own Jacobian."""
    step = 1e-6
    columns = [
        np.subtract(k.inverse(np.add(place, step * e)), k.inverse(np.subtract(place, step * e))) for e in np.eye(3)
    ]
    return (np.array(columns) / (2 * step)) @ (-np.array(motors) / scale)


def test_force_and_its_direction_when_saturated(simple: PlainFalcon) -> None:
    rng = np.random.default_rng(6)
    with Falcon(backend=simple, force_scale=10_000.0) as arm:
        arm.home(1.0)
        for size in (0.5, 3.0, 40.0, 1e6):
            for _ in range(20):
                place = (rng.uniform(-0.03, 0.03), rng.uniform(-0.03, 0.03), rng.uniform(0.09, 0.15))
                simple.encoders = counts_at(place)
                arm.read()
                direction = rng.normal(size=3)
                direction /= np.linalg.norm(direction)
                arm.write(size * direction)
                reading = arm.read()
                motors = simple.motors[-1]
                got = force_on_operator(tuple(reading.position), motors, 10_000.0)
                assert max(map(abs, motors)) <= 4095
                assert got @ direction / np.linalg.norm(got) > (0.999 if size > 1 else 0.98)
                if max(map(abs, motors)) < 4095:
                    assert np.linalg.norm(got) == pytest.approx(size, abs=0.02)
                else:
                    assert size >= 3.0
    assert simple.motors[-1] == (0, 0, 0)


def test_the_default_scale_is_the_low_one(simple: PlainFalcon) -> None:
    simple.encoders = counts_at((0.0, 0.0, 0.12))
    with Falcon(backend=simple) as arm:
        arm.home(1.0)
        arm.write((0.0, 0.0, 8.0))
        arm.read()
    assert 0 < max(map(abs, simple.motors[-2])) < 1500


@pytest.mark.parametrize("force", [(math.nan, 0, 0), (0, math.inf, 0), (1, 2), (1, 2, 3, 4)])
def test_a_force_that_is_none_is_refused_and_zero_is_sent(simple: PlainFalcon, force: tuple[float, ...]) -> None:
    with Falcon(backend=simple) as arm:
        arm.home(1.0)
        arm.write((0, 0, 1))
        with pytest.raises(ValueError, match="three finite numbers"):
            arm.write(force)
        arm.read()
        assert simple.motors[-1] == (0, 0, 0)


def test_the_led_colour_is_sent(simple: PlainFalcon) -> None:
    with Falcon(backend=simple) as arm:
        arm.home(1.0)
        arm.leds = Leds.BLUE
        arm.read()
        assert simple.infos[-1] & 0x0E == 4


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_zero_force_on_every_exit(simple: PlainFalcon, error: type[BaseException]) -> None:
    with pytest.raises(error), Falcon(backend=simple) as arm:
        arm.home(1.0)
        arm.write((0, 0, 3))
        arm.read()
        assert simple.motors[-1] != (0, 0, 0)
        raise error
    assert simple.motors[-1] == (0, 0, 0)


def test_the_virtual_hand_feels_the_true_force() -> None:
    arm, falcon = virtual(running=True)
    with falcon:
        falcon.home(5.0)
        falcon.write((1.0, -0.5, 2.0))
        for _ in range(800):
            reading = falcon.read()
        # a spring of 300 N/m yields to the force; the true scale of the virtual arm is 2500 against the assumed 2200
        shift = np.subtract(arm.position, k.CENTRE) * 300.0
        assert shift == pytest.approx(np.array((1.0, -0.5, 2.0)) * 2200 / 2500, abs=0.01)
        assert reading.position == pytest.approx(np.array(arm.position), abs=6e-5)


# --- unplugging ---------------------------------------------------------------------------------------------------


def test_unplug_and_replug_at_any_moment() -> None:
    arm, falcon = virtual()
    for after in range(0, 40, 3):
        falcon.open()
        falcon.home(5.0)
        falcon.write((0, 0, 1.0))
        arm.faults.unplug_after = after
        with pytest.raises(Disconnected):
            for _ in range(10):
                falcon.read()
        assert not falcon.is_open
        with pytest.raises(Disconnected):
            falcon.read()
        with pytest.raises(NotFound):
            falcon.open()
        arm.plug(running=after % 2 == 0)
        begin = len(arm.commands)
        falcon.open()
        assert not falcon.read().valid
        assert all(numbers.values == (0, 0, 0) for numbers in list(arm.commands)[begin:])
        falcon.close()


def test_unplugged_during_the_upload() -> None:
    for byte in (0, 3, 5, 60, 300):
        arm, falcon = virtual()
        arm.faults.unplug_after = byte
        with pytest.raises(Disconnected):
            falcon.open()
        arm.plug()
        with falcon:
            assert falcon.home(5.0).valid


def test_exchanges_take_no_longer_than_there_was_time_for_them() -> None:
    time = VirtualTime()
    falcon = Falcon(IMAGE, VirtualBackend(VirtualFalcon(time=time)), clock=time.now)
    with falcon as arm:
        begin, before = time.now(), arm.timing.count
        for _ in range(50):
            arm.read()
        took = time.now() - begin
    assert falcon.timing.count == before + 50
    assert 0.0 < falcon.timing.latency(50) <= falcon.timing.latency(100)
    assert 25 * falcon.timing.latency(50) <= took, "one after the other"
