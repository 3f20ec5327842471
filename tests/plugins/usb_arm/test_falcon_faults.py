"""Every fault of the virtual arm, in every state: no hang, no wrong position, no force after an error, a named error."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from campaign import seeds, some
from plain_falcon import PlainFalcon

from itouch_usb_arm import Disconnected, Falcon, FalconError, Timeout, boot
from itouch_usb_arm.kinematics import angles_of, forward
from itouch_usb_arm.virtual import VirtualBackend, VirtualFalcon, VirtualTime

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver

IMAGE = boot.build([boot.Block(0x3F8000, tuple(range(100)))], entry=0x3F8002)
FAULTS = {
    "drop": 1, "bad": 1, "wrong": 1, "stray": 1, "refuse": 1, "mute": 1, "late": 0.03, "unplug_after": 5, "boot_echo": 20,
    "unhomed": True, "deaf": True,
}  # fmt: skip
#: Longest time [s] that a call may take on the virtual clock, beside the homing's own.
PATIENCE = {"opening": 8.0, "read": 1.0, "homing": 3.0}


def rig(*, running: bool, seed: int = 0) -> tuple[VirtualFalcon, Falcon, VirtualTime]:
    time = VirtualTime()
    arm = VirtualFalcon(time=time, running=running, seed=seed)
    return arm, Falcon(IMAGE, VirtualBackend(arm), clock=time.now), time


def check(arm: VirtualFalcon, falcon: Falcon) -> bool:
    """Read once: what comes must be the truth."""
    reading = falcon.read()
    if reading.valid:
        assert np.abs(reading.position - arm.mechanics.position).max() < 1e-3
    return reading.valid


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("running", [True, False])
def test_a_fault_while_opening_is_a_named_error(fault: str, running: bool) -> None:
    arm, falcon, time = rig(running=running)
    setattr(arm.faults, fault, FAULTS[fault])
    begin = time.now()
    try:
        falcon.open()
        check(arm, falcon)
    except FalconError as error:
        assert type(error) is not FalconError, "the error has no name of its own"
    assert time.now() - begin < PATIENCE["opening"]
    falcon.close()
    assert all(numbers.values == (0, 0, 0) for numbers in arm.commands)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_while_homing(fault: str) -> None:
    arm, falcon, time = rig(running=True)
    falcon.open()
    setattr(arm.faults, fault, FAULTS[fault])
    begin = time.now()
    try:
        assert falcon.home(2.0).valid
    except FalconError as error:
        assert type(error) is not FalconError
    assert time.now() - begin < PATIENCE["homing"]
    falcon.close()
    assert all(numbers.values == (0, 0, 0) for numbers in arm.commands)


#: Wrong letters in every frame cannot be told from an arm that is elsewhere: there is no checksum.
TIMES = [case for case in itertools.product(FAULTS, [1, 3, 30]) if case != ("wrong", 30)]


@pytest.mark.parametrize(("fault", "times"), TIMES)
def test_a_fault_while_a_force_is_given(fault: str, times: int) -> None:
    arm, falcon, time = rig(running=True, seed=times)
    falcon.open()
    falcon.home(2.0)
    falcon.write((0.0, 0.0, 2.0))
    for _ in range(50):
        check(arm, falcon)
    worth = FAULTS[fault]
    setattr(arm.faults, fault, worth * times if fault != "late" and worth is not True else worth)
    failed = False
    for _ in range(60):
        begin, sent = time.now(), len(arm.commands)
        try:
            check(arm, falcon)
        except FalconError as error:
            failed = True
            assert type(error) is not FalconError
            assert arm.mechanics.motors == (0, 0, 0) or not falcon.is_open or arm.faults.refuse
            if isinstance(error, Disconnected):
                break
        assert time.now() - begin < PATIENCE["read"]
        if failed:  # whatever was sent after an error was sent without force
            assert all(numbers.values == (0, 0, 0) for numbers in list(arm.commands)[sent + 1 :])
    falcon.close()
    assert arm.mechanics.motors == (0, 0, 0)


def test_a_single_damaged_answer_is_asked_for_again() -> None:
    arm, falcon, _ = rig(running=True)
    with falcon:
        falcon.home(2.0)
        for fault in ("drop", "bad", "stray"):
            setattr(arm.faults, fault, 1)
            assert check(arm, falcon)
            assert check(arm, falcon)


@pytest.mark.parametrize("late", [0.02, 0.09, 0.105, 0.15, 0.22, 0.4, 1.0])
def test_a_late_answer_is_never_taken_for_a_new_one(late: float) -> None:
    """The grip moves fast meanwhile: an answer one exchange old would be seen."""
    arm, falcon, time = rig(running=True)
    speed = 0.05
    with falcon:
        falcon.home(2.0)
        arm.hand.stiffness, arm.hand.damping = 5000.0, 30.0
        arm.hand.path = lambda now: (0.02 * np.sin(now * speed / 0.02), 0.0, 0.12)
        for _ in range(300):
            falcon.read()
        arm.faults.late = late
        wrong = 0
        for _ in range(300):
            try:
                reading = falcon.read()
            except Timeout:
                continue
            time.sleep(0.004)
            wrong += np.abs(reading.position - arm.mechanics.position).max() > speed * 0.003 + 1e-4
        assert wrong <= 2  # at most the one that arrived between two frames


def test_encoders_that_jump_are_believed_only_twice_over() -> None:
    emulator = PlainFalcon(running=True)
    emulator.encoders = (-200, -200, -200)
    with Falcon(backend=emulator) as falcon:
        falcon.home(1.0)
        falcon.read()
        emulator.spoil.append(lambda frame: b"<AAAE" + frame[5:])  # one bad number in a frame that looks well
        assert falcon.read().encoders == (-200, -200, -200)
        emulator.encoders = (400, 300, 500)  # really there: both frames say so
        assert falcon.read().encoders == (400, 300, 500)


@pytest.mark.parametrize("leg", range(3))
@pytest.mark.parametrize("way", [-1, 1])
def test_after_a_speed_that_no_arm_has_each_leg_is_expected_where_it_is(leg: int, way: int) -> None:
    """As far to either side: what is further away is asked for again."""
    now, emulator = [0.0], PlainFalcon(running=True)

    def asked(by: int, after: float, legs: Sequence[int] = (0, 1, 2)) -> int:
        now[0] += after
        emulator.encoders = tuple(place + by * (axis in legs) for axis, place in enumerate(emulator.encoders))
        before = len(emulator.motors)
        assert falcon.read().encoders == emulator.encoders
        return len(emulator.motors) - before

    emulator.encoders = (-900, -1000, -800)
    with Falcon(backend=emulator, clock=lambda: now[0]) as falcon:
        falcon.home(1.0)
        # a leg that rests is within 12 counts, and those to which 300 m/s2 take it: 2.9995
        after = math.sqrt(2.9995 / 3.25e6)
        for by, frames in ((14, 1), (15, 2)):
            assert [asked(0, 1e-3) for _ in range(3)] == [1] * 3
            assert [asked(50, 1e-3) for _ in range(2)] == [2] * 2  # 50 000 counts/s
            assert asked(way * by, after, (leg,)) == frames
            asked(-100, 0.1)


#: How far [m] a wrong letter that stays a letter may move the arm, at rest and at 0.2 m/s.
BELIEVED = 7e-4, 1.3e-3


@pytest.mark.parametrize("moving", [0, 1])
def test_a_wrong_letter_is_not_believed(moving: int) -> None:
    """Every letter of the counts, and the info byte, put to every other value."""
    time, emulator = VirtualTime(), PlainFalcon(running=True)
    wrong: list[float] = []

    def goes() -> None:
        time.sleep(1e-3)
        there = moving * 500.0 * np.sin(8.8 * time.now())
        emulator.encoders = tuple(round(place + there) for place in (-900, -1000, -800))

    with Falcon(backend=emulator, clock=time.now) as falcon:
        falcon.home(1.0)
        for _ in range(5):
            goes()
            falcon.read()
        falcon.write((0.0, 0.0, 0.4))
        for place, letter in itertools.product(range(1, 14), range(0x41, 0x51)):
            goes()
            truth, frames = emulator.encoders, len(emulator.motors)
            emulator.spoil.append(lambda frame, p=place, to=letter: frame[:p] + bytes((to,)) + frame[p + 1 :])
            reading = falcon.read()
            assert reading.homed == (True, True, True)
            assert not reading.buttons
            believed, true = (forward(angles_of(counts)) for counts in (reading.encoders, truth))
            wrong.append(float(np.abs(np.subtract(believed, true)).max()))
            assert len(emulator.motors) - frames <= 2  # asked again once
            assert any(emulator.motors[-1])  # the force goes on
            goes()
            falcon.read()
    assert max(wrong) < BELIEVED[moving]


@pytest.mark.parametrize("seed", some(range(20), lambda seed: seed < 3 or seed in (12, 14)))  # two in a row
def test_one_wrong_letter_in_ten_ends_nothing(seed: int) -> None:
    arm, falcon, time = rig(running=True, seed=seed)
    rng = np.random.default_rng(seed)
    with falcon:
        falcon.home(2.0)
        falcon.write((0.0, 0.0, 0.5))
        for _ in range(300):
            arm.faults.wrong = int(rng.random() < 0.1)
            reading = falcon.read()
            assert reading.valid
            # nobody holds the arm at first, and it moves at up to 1 m/s: what is believed grows with its speed as above
            speed = float(np.linalg.norm(arm.mechanics.velocity))
            most = BELIEVED[0] + (BELIEVED[1] - BELIEVED[0]) * speed / 0.2
            assert np.abs(reading.position - arm.mechanics.position).max() < most


def test_a_frame_that_came_late_is_no_measure_of_the_next() -> None:
    """It told of a time long ago, because this machine was held up: the arm has moved on since."""
    time, emulator = VirtualTime(), PlainFalcon(running=True)
    emulator.encoders = (-200, -200, -200)

    def late(frame: bytes) -> bytes:
        time.sleep(0.06)
        return frame

    def moves(frame: bytes) -> bytes:
        emulator.encoders = tuple(count + 100 for count in emulator.encoders)
        return frame

    with Falcon(backend=emulator, clock=time.now) as falcon:
        falcon.home(1.0)
        falcon.read()
        emulator.spoil.append(late)
        assert falcon.read().encoders == (-200, -200, -200)
        emulator.encoders = (700, 700, 700)  # 15 000 counts a second
        emulator.spoil.extend([moves] * 3)
        assert falcon.read().encoders == (700, 700, 700)


def test_impossible_encoders_are_no_position() -> None:
    emulator = PlainFalcon(running=True)
    with Falcon(backend=emulator) as falcon:
        falcon.home(1.0)
        falcon.write((0, 0, 1))
        falcon.read()
        emulator.encoders = (9000, -9000, 0)
        with pytest.raises(FalconError, match="not a position of the arm"):
            falcon.read()
        assert emulator.motors[-1] == (0, 0, 0)
        emulator.encoders = (0, 0, 0)
        falcon.read()
        assert emulator.motors[-1] == (0, 0, 0)


def test_a_silent_arm_times_out_and_does_not_hang() -> None:
    arm, falcon, time = rig(running=True)
    falcon.open()
    falcon.home(2.0)
    arm.faults.mute = 1000
    begin = time.now()
    for _ in range(3):
        with pytest.raises(Timeout, match="100 ms"):
            falcon.read()
    assert time.now() - begin < 1.0
    falcon.close()
    assert time.now() - begin < 1.5


@pytest.mark.parametrize("seed", seeds(4, 12))
def test_any_faults_in_any_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arm, falcon, time = rig(running=bool(seed % 2), seed=seed)
    for _ in range(120):
        if rng.random() < 0.15:
            fault = str(rng.choice(["drop", "bad", "stray", "refuse", "mute", "late", "unplug_after"]))
            setattr(arm.faults, fault, 0.2 * rng.random() if fault == "late" else int(rng.integers(1, 6)))
        begin = time.now()
        try:
            if not arm.attached:
                arm.plug(running=bool(rng.integers(2)))
            if not falcon.is_open:
                falcon.open()
            if not falcon.homed:
                falcon.home(2.0)
            if rng.random() < 0.5:
                falcon.write(rng.normal(size=3))
            check(arm, falcon)
        except FalconError:
            assert arm.mechanics.motors == (0, 0, 0) or arm.faults.refuse > 0
        assert time.now() - begin < 12.0
    arm.faults.refuse = 0
    falcon.close()
    assert arm.mechanics.motors == (0, 0, 0)
