"""Phantom and Touch through a fake of the maker's library: frames, forces, calibration, errors; and a fake in C."""

from __future__ import annotations

import io
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from channel_records import records
from fake_hd import FakeHd
from requirements import need_program

from itouch.plugin import DeviceError, Trace, read_trace
from itouch.testing import DeviceTests
from itouch_arms.errors import ArmError, Disconnected, NotCalibrated, NotFound, ProtocolError, Refused, Timeout
from itouch_arms.openhaptics import OpenHaptics, OpenHapticsParams, Phantom, api, phantom
from itouch_tools.cli import main

NO_FORCE = (0.0, 0.0, 0.0)


@pytest.fixture
def hd(monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeHd]:
    fake = FakeHd()
    monkeypatch.setattr(api, "load", lambda library: api.declared(fake, library))
    yield fake
    fake.hdStopScheduler()


class TestOpenHaptics(DeviceTests):
    """The whole suite with the driver on the fake."""

    device, name, hardware = OpenHaptics, "openhaptics", True
    params = OpenHapticsParams(deadman="button1")
    # These two let a virtual clock run past a thread that waits for frames.
    test_lifecycle = test_safe_on_exception = None

    @pytest.fixture(autouse=True)
    def use(self, hd: FakeHd) -> Iterator[None]:
        hd.buttons = 1
        yield
        assert hd.force == NO_FORCE and not hd.open


def until(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 300.0
    while not true():
        assert time.monotonic() < deadline, "it never came"
        time.sleep(1e-3)


def test_frames_and_forces_in_our_frame_and_units(hd: FakeHd) -> None:
    hd.place = [10.0, 20.0, -30.0]  # right, up, away from the operator
    with Phantom() as arm:
        assert arm.model == "PHANTOM Omni"
        assert arm.read().position == pytest.approx((0.010, 0.030, 0.020))
        arm.write((0.1, 0.2, 0.3))
        until(lambda: hd.force == pytest.approx((0.1, 0.3, -0.2)))
        hd.buttons = 2
        until(lambda: arm.read().buttons == 2)
    assert hd.forces[-2:] == [NO_FORCE, (0.0, 0.0, -0.0)]
    assert hd.calls[-3:] == ["stop", "unschedule", "disable"]


def test_each_reading_is_a_new_frame(hd: FakeHd) -> None:
    with Phantom() as arm:
        numbers = [arm.read().number for _ in range(20)]
    assert sorted(set(numbers)) == numbers


def test_no_force_before_it_is_asked_for_and_none_that_is_old(hd: FakeHd, monkeypatch: pytest.MonkeyPatch) -> None:
    with Phantom() as arm:
        for _ in range(10):
            arm.read()
        assert not any(any(force) for force in hd.forces)
        arm.write((0.0, 0.0, 1.0))
        until(lambda: hd.force == (0.0, 1.0, 0.0))
        until(lambda: hd.force == NO_FORCE)  # nobody writes any more
        assert len([force for force in hd.forces if any(force)]) * 5e-4 < 10 * phantom.STALE


def test_too_much_is_cut_to_what_the_arm_can_give_with_its_direction(hd: FakeHd) -> None:
    hd.most = 2.0
    with Phantom() as arm:
        arm.write((3.0, 0.0, 4.0))
        until(lambda: hd.force == pytest.approx((1.2, 1.6, 0.0)))


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_zero_force_on_every_exit(hd: FakeHd, error: type[BaseException]) -> None:
    with pytest.raises(error), Phantom() as arm:
        arm.write((0.0, 0.0, 1.0))
        until(lambda: any(hd.force))
        raise error
    assert hd.force == NO_FORCE
    assert not hd.open and api.FORCE_OUTPUT not in hd.enabled


@pytest.mark.parametrize(
    ("number", "error", "words"),
    [
        (api.COMM_ERROR, Disconnected, "gone"),
        (api.WARM_MOTORS, Refused, "too warm"),
        (0x0201, Refused, "greatest force"),
        (0x0203, Refused, "greatest velocity"),
        (api.DEVICE_FAULT, ArmError, "device fault"),
        (0x0304, ArmError, "timer error"),
        (0x0999, ArmError, "0x0999"),
    ],
)
def test_each_error_of_the_library_has_a_name_and_ends_the_force(
    hd: FakeHd, number: int, error: type[ArmError], words: str
) -> None:
    arm = OpenHaptics(OpenHapticsParams())
    reading, command = records(arm)
    arm.open()
    command["wrench"][2] = 1.0
    arm.write(command)
    until(lambda: any(hd.force))
    hd.errors = [number]
    with pytest.raises(error, match=words):
        while True:
            arm.write(command)
            arm.read(reading)
    until(lambda: hd.force == NO_FORCE or number == api.COMM_ERROR)
    arm.close()
    assert not hd.open and api.FORCE_OUTPUT not in hd.enabled
    hd.force = NO_FORCE
    arm.open()  # plugged in again, or cooled down
    assert arm.read(reading)
    assert hd.force == NO_FORCE
    arm.close()


def test_a_scheduler_that_stops_is_told(hd: FakeHd, monkeypatch: pytest.MonkeyPatch) -> None:
    with Phantom() as arm:
        arm.read()
        hd.mute = True
        with pytest.raises(Timeout, match="frames have stopped"):
            for _ in range(3):
                arm.read()
    assert not hd.open


def test_an_impossible_position_is_an_error_and_ends_the_force(hd: FakeHd) -> None:
    with Phantom() as arm:
        arm.write((0.0, 0.0, 1.0))
        for wrong in (float("nan"), 9e9):
            hd.place = [0.0, wrong, 0.0]
            with pytest.raises(ProtocolError, match="its end is at"):
                for _ in range(5):
                    arm.read()
        until(lambda: hd.force == NO_FORCE)


@pytest.mark.parametrize(("style", "advice"), [(api.INKWELL, "inkwell"), (api.AUTOMATIC, "whole reach")])
def test_an_arm_is_calibrated_by_itself_when_its_operator_has_done_his_part(
    hd: FakeHd, style: int, advice: str, caplog: pytest.LogCaptureFixture
) -> None:
    hd.style, hd.calibration = style, api.NEEDS_HAND
    with pytest.raises(NotCalibrated, match=advice):
        Phantom(calibration_time=0.02).open()
    assert not any(any(force) for force in hd.forces)
    assert api.FORCE_OUTPUT not in hd.enabled and not hd.open
    assert advice in caplog.text
    hd.calibration = api.NEEDS_UPDATE
    with Phantom(calibration_time=5.0) as arm:
        assert f"calibrate {style}" in hd.calls
        arm.read()


def test_a_reset_of_the_encoders_is_never_done_by_itself(hd: FakeHd) -> None:
    hd.style, hd.calibration = api.ENCODER_RESET, api.NEEDS_UPDATE
    with pytest.raises(NotCalibrated, match="maker's program"):
        Phantom(calibration_time=0.01).open()
    assert not any(call.startswith("calibrate") for call in hd.calls)


@pytest.mark.parametrize(
    ("knob", "number", "error", "words"),
    [
        ("missing", api.COMM_ERROR, NotFound, "cannot open the default arm .communication error.*plugged in"),
        ("missing", 0x0104, NotFound, "bad handle"),
        ("missing", api.LICENSE, Refused, "licence"),
        ("refused", 0x0501, ArmError, "scheduler full"),
    ],
)
def test_each_failure_to_open_is_told(hd: FakeHd, knob: str, number: int, error: type[ArmError], words: str) -> None:
    setattr(hd, knob, number)
    arm = OpenHaptics(OpenHapticsParams())
    with pytest.raises(error, match=words):
        arm.open()
    assert not hd.open
    (found,) = OpenHaptics.discover()
    assert not found.usable
    setattr(hd, knob, 0)
    (found,) = OpenHaptics.discover()
    assert found.usable and found.where == "PHANTOM Omni" and "3.3 N" in found.note
    assert not any(any(force) for force in hd.forces)


def test_a_second_process_takes_the_force_away_calibrated_or_not(hd: FakeHd) -> None:
    hd.force, hd.enabled = (0.0, 1.0, 0.0), {api.FORCE_OUTPUT}  # what a process that died has left
    arm = OpenHaptics(OpenHapticsParams())
    _, command = records(arm)
    for calibration in (api.OK, api.NEEDS_HAND):
        hd.calibration = calibration
        arm.make_safe(command)
        assert hd.force == NO_FORCE and not hd.open


def test_a_torque_is_refused_and_so_is_what_is_no_force(hd: FakeHd) -> None:
    arm = OpenHaptics(OpenHapticsParams(grip=(0.0, 0.01, 0.0)))
    reading, command = records(arm)
    with pytest.raises(DeviceError, match="not open"):
        arm.read(reading)
    arm.open()
    command["wrench"] = (0, 0, 1.0, 0, 0.1, 0)
    with pytest.raises(ValueError, match="locked"):
        arm.write(command)
    command["wrench"] = (0, float("inf"), 0, 0, 0, 0)
    with pytest.raises(ValueError, match="finite"):
        arm.write(command)
    arm.read(reading)
    assert list(reading["pose"]) == pytest.approx([0.0, 0.04, 0.02, 1, 0, 0, 0])
    arm.close()


def test_what_is_asked_and_answered_is_in_the_trace(hd: FakeHd) -> None:
    stream = io.StringIO()
    with Phantom(trace=Trace(stream, "arm")) as arm:
        arm.write((0.0, 0.25, 0.5))
        arm.read()
    marks = [(entry.mark, entry.data) for entry in read_trace(stream.getvalue().splitlines())]
    assert marks[0][1].startswith(b"opened PHANTOM Omni")
    assert (">", b"force 0.0000 0.2500 0.5000") in marks
    assert ("<", b"position 0.000000 0.030000 0.020000 buttons 0") in marks


SCENE = """<itouch version="1.0" xmlns:openhaptics="urn:itouch:plugin:openhaptics">
  <devices><device name="arm" plugin="openhaptics" twin="TWIN">
    <openhaptics:hardware library="LIBRARY" deadman="button1"/></device></devices>
  <interaction><probe name="finger" pose-from="arm" force-to="arm"/></interaction></itouch>"""


def test_where_the_library_is_not_one_clear_message(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = tmp_path / "scene.xml"
    scene.write_text(SCENE.replace("LIBRARY", "/nowhere/libHD.so").replace("TWIN", "no"))
    assert main(["run", str(scene), "--headless", "--for", "1s"]) == 2
    error = capsys.readouterr().err
    assert "OpenHaptics is not installed" in error and "/nowhere/libHD.so" in error
    assert "Traceback" not in error
    scene.write_text(SCENE.replace("TWIN", "yes"))
    assert main(["run", str(scene), "--headless", "--for", "50ms"]) == 0
    with pytest.raises(NotFound, match="hdInitDevice"):
        api.declared(object(), "libHD.so")


FAKE_IN_C = r"""
#include <pthread.h>
#include <string.h>
#include <unistd.h>
typedef struct { unsigned code; int internal; unsigned handle; } Error;
static double force[3], shown[3]; static unsigned (*call)(void *); static void *data; static unsigned error;
static volatile int running; static pthread_t thread;
unsigned hdInitDevice(const char *name) { return name && !strcmp(name, "gone") ? (error = 0x302, 0xFFFFFFFFu) : 0xFFFFFFF0u; }
void hdDisableDevice(unsigned h) {}  void hdMakeCurrentDevice(unsigned h) {}
void hdBeginFrame(unsigned h) {}     void hdEndFrame(unsigned h) { memcpy(shown, force, sizeof shown); }
void hdEnable(unsigned c) {}         void hdDisable(unsigned c) {}
void hdGetDoublev(unsigned p, double *v) {
    if (p == 0x2603) v[0] = 3.3;
    if (p == 0x2050) { v[0] = 1e3 * shown[0]; v[1] = 1e3 * shown[1]; v[2] = 1e3 * shown[2]; } }
void hdSetDoublev(unsigned p, const double *v) { if (p == 0x2700) memcpy(force, v, sizeof force); }
void hdGetIntegerv(unsigned p, int *v) { *v = p == 0x2000 ? 1 : 2; }
const char *hdGetString(unsigned p) { return "in C"; }
Error hdGetError(void) { Error found = { error, -5, 9 }; error = 0; return found; }
unsigned hdCheckCalibration(void) { return 0x5000; }  void hdUpdateCalibration(unsigned s) {}
unsigned long hdScheduleAsynchronous(unsigned (*c)(void *), void *d, unsigned short p) { call = c; data = d; return 1ul << 40; }
void hdUnschedule(unsigned long h) { if (h == 1ul << 40) call = 0; }
static void *run(void *x) { while (running && call(data) == 1) usleep(500); return 0; }
void hdStartScheduler(void) { running = 1; pthread_create(&thread, 0, run, 0); }
void hdStopScheduler(void) { running = 0; pthread_join(thread, 0); }
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library with the real signatures, whose arm is one metre away in the direction of each newton."""
    compiler = need_program("cc", package="gcc")
    folder = tmp_path_factory.mktemp("hd")
    (folder / "hd.c").write_text(FAKE_IN_C)
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-pthread", "-w", "-o", folder / "libHD.so", folder / "hd.c"], check=True
    )
    return folder / "libHD.so"


def test_the_calls_are_those_of_the_real_librarys_header(library: Path) -> None:
    with Phantom(library=str(library)) as arm:
        assert arm.model == "in C" and arm.max_force == 3.3

        def follows() -> bool:
            arm.write((0.25, -0.5, 0.125))
            return arm.read().position == pytest.approx((0.25, -0.5, 0.125))

        until(follows)
        assert arm.read().buttons == 1
    with pytest.raises(NotFound, match="communication error"):
        Phantom("gone", str(library)).open()
