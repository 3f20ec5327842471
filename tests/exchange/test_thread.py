"""A blocking device in its thread: the newest values pass, a hung device delays nobody, threads end."""

from __future__ import annotations

import contextlib
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from itouch.exchange import EveryNth, ThreadedDevice, failed_in
from itouch.exchange.thread import CLOSE_TIME
from itouch.plugin import Device, DeviceError, Field, Record, pose, pose_target, wrench


@dataclass(frozen=True)
class _Params:
    pass


class _Slow(Device):
    """Answers after a millisecond; can hang, fail, and remembers who called what."""

    Params = _Params
    reads = (pose(),)
    commands = (wrench(force=3.0),)
    blocking: ClassVar[bool] = True

    def __init__(self) -> None:
        super().__init__(_Params())
        self.calls: list[tuple[str, int]] = []
        self.written: list[float] = []
        self.count = 0
        self.hang = threading.Event()
        self.hang.set()
        self.hangs = threading.Event()
        self.failure: Exception | None = None
        self.refusal: Exception | None = None

    def _note(self, what: str) -> None:
        self.calls.append((what, threading.get_ident()))

    def open(self) -> None:
        self._note("open")
        if self.refusal is not None:
            raise self.refusal

    def close(self) -> None:
        self._note("close")

    def read(self, reading: Record) -> bool | None:
        time.sleep(1e-3)
        if not self.hang.is_set():
            self.hangs.set()  # what was read before has been handed over
        self.hang.wait(300)
        if self.failure is not None:
            raise self.failure
        self.count += 1
        reading["pose"] = (self.count, 0, 0, 1, 0, 0, 0)
        return True

    def write(self, command: Record) -> None:
        self.written.append(float(command["wrench"][2]))


def _until(true: Callable[[], object]) -> None:
    """Wait for what another thread does: on a busy machine that may take long."""
    deadline = time.monotonic() + 300
    while not true():
        assert time.monotonic() < deadline
        time.sleep(1e-3)


def _reading() -> Record:
    return Record.of([Field("pose", "f8", 7)])


def _command(force: float) -> Record:
    record = Record.of([Field("wrench", "f8", 6)])
    record["wrench"][2] = force
    return record


@pytest.fixture
def device() -> Iterator[_Slow]:
    before = set(threading.enumerate())
    slow = _Slow()
    yield slow
    slow.hang.set()
    deadline = time.monotonic() + 300
    while set(threading.enumerate()) - before and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not set(threading.enumerate()) - before  # no thread is left, however it ended


def test_the_newest_reading_is_given_once(device: _Slow) -> None:
    threaded, reading = ThreadedDevice(device, patience=10.0), _reading()
    threaded.open()
    assert threaded.read(reading) is True
    first = reading["pose"][0]
    _until(lambda: device.count > first + 3)
    assert threaded.read(reading) is True
    assert reading["pose"][0] > first + 2  # those between are gone: the newest counts
    device.hang.clear()
    assert device.hangs.wait(300)
    threaded.read(reading)
    assert threaded.read(reading) is False
    device.hang.set()
    threaded.close()


def test_all_calls_come_from_one_other_thread(device: _Slow) -> None:
    threaded = ThreadedDevice(device, patience=10.0)
    for _ in range(2):
        threaded.open()
        threaded.close()
    assert [what for what, _ in device.calls] == ["open", "close", "open", "close"]
    assert threading.get_ident() not in {thread for _, thread in device.calls}


def test_the_last_command_is_sent_before_closing_and_none_twice(device: _Slow) -> None:
    threaded = ThreadedDevice(device, patience=10.0)
    threaded.open()
    threaded.write(_command(1.0))
    _until(lambda: device.written)
    threaded.write(_command(0.0))
    threaded.close()
    assert device.written == [1.0, 0.0]


def test_a_command_that_is_not_renewed_becomes_the_safe_one(device: _Slow) -> None:
    threaded = ThreadedDevice(device, patience=0.02)
    threaded.open()
    for force in (2.0, 1.5):  # the second time the loop lives again
        while force not in device.written:  # a thread that was held up for longer than 20 ms sends the safe one at once
            threaded.write(_command(force))
            time.sleep(1e-3)
        _until(lambda force=force: device.written[-1] != force)
        assert device.written[-2:] == [force, 0.0]
    threaded.close()


def test_a_hung_device_does_not_hold_the_caller(device: _Slow) -> None:
    threaded, reading = ThreadedDevice(device, patience=10.0), _reading()
    threaded.open()
    device.hang.clear()
    assert device.hangs.wait(300)
    begin = time.monotonic()
    for _ in range(1000):
        threaded.read(reading)
        threaded.write(_command(1.0))
    assert time.monotonic() - begin < 200  # an exchange would last 300 s
    with pytest.raises(DeviceError, match="does not answer"):
        threaded.close()
    assert ("close", threading.get_ident()) not in device.calls


def test_closing_waits_longer_for_a_device_whose_answers_are_waited_for_longer(device: _Slow) -> None:
    device.timeout_factor = 100.0
    threaded = ThreadedDevice(device, patience=10.0)
    threaded.open()
    device.hang.clear()
    assert device.hangs.wait(300)
    later = threading.Timer(2 * CLOSE_TIME, device.hang.set)
    later.start()
    threaded.close()
    assert device.calls[-1][0] == "close"
    later.join()


def test_an_error_comes_up_in_the_next_read_and_the_device_is_closed(device: _Slow) -> None:
    threaded, reading = ThreadedDevice(device, patience=10.0), _reading()
    threaded.open()
    device.failure = DeviceError("the cable is out")
    _until(lambda: len(device.calls) == 2)
    threaded.read(reading)  # what was read before is still a reading
    with pytest.raises(DeviceError, match="cable"):
        threaded.read(reading)
    assert [what for what, _ in device.calls] == ["open", "close"]
    threaded.close()


def test_what_went_wrong_first_is_what_is_told(device: _Slow, monkeypatch: pytest.MonkeyPatch) -> None:
    tried = threading.Event()

    def stuck() -> None:
        tried.set()
        raise DeviceError("and it does not close")

    threaded, reading = ThreadedDevice(device, patience=10.0), _reading()
    threaded.open()
    monkeypatch.setattr(device, "close", stuck)
    device.failure = DeviceError("the cable is out")
    assert tried.wait(300)
    threaded.read(reading)
    with pytest.raises(DeviceError, match="cable"):
        threaded.read(reading)


def test_exchanges_are_no_nearer_than_the_devices_period(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_Slow, "period", 0.02)
    threaded = ThreadedDevice(_Slow(), patience=10.0)
    threaded.open()
    _until(lambda: len(threaded._latest) > 5)
    threaded.close()
    begins = np.array([begin for begin, _ in threaded._latest])
    assert begins.size > 2 and begins[-1] - begins[0] > 0.02 * (begins.size - 1.5)


def test_figures_are_of_the_latest_exchanges() -> None:
    threaded = ThreadedDevice(_Slow(), patience=10.0)
    assert threaded.figures() is None
    threaded._latest.extend((0.01 * number, 1e-3 * (number + 1)) for number in range(200))
    threaded.exchanges, threaded.longest = 300, 0.7
    assert threaded.figures() == pytest.approx(
        {"count": 300, "rate_hz": 100.0, "p50_ms": 101.0, "p99_ms": 199.0, "max_ms": 700.0}
    )
    threaded._latest.clear()
    threaded._latest.extend(((5.0, 1e-3), (5.02, 1e-3)))  # two, within less than a second
    assert (threaded.figures() or {})["rate_hz"] == pytest.approx(50.0)
    threaded._latest.clear()
    threaded._latest.extend(((5.0, 1e-3), (5.0, 1e-3)))  # a clock that stands, or is coarse
    assert threaded.figures() == pytest.approx(
        {"count": 300, "rate_hz": 0.0, "p50_ms": 1.0, "p99_ms": 1.0, "max_ms": 700.0}
    )


def test_a_device_that_refuses_to_open_says_why(device: _Slow) -> None:
    device.refusal = DeviceError("no such port")
    threaded = ThreadedDevice(device, patience=10.0)
    with pytest.raises(DeviceError, match="no such port"):
        threaded.open()
    threaded.close()
    assert [what for what, _ in device.calls] == ["open"]
    device.refusal = None
    threaded.open()
    reading = _reading()
    assert threaded.read(reading) is True
    assert np.isfinite(reading["pose"]).all()
    threaded.close()


class _Patient(_Slow):
    """Waits for commands, and knows when it measured."""

    command_wait: ClassVar[float] = 60.0

    def read(self, reading: Record) -> bool | None:
        assert self.timestamps is not None
        self.timestamps.command_sent()
        self.timestamps.measured("pose", ago=0.05)
        return super().read(reading)


def test_a_command_wakes_a_device_that_waits_and_stamps_reach_the_loop() -> None:
    device = _Patient()
    threaded, reading = ThreadedDevice(device, patience=10.0), _reading()
    threaded.open()
    try:
        measured, out = np.zeros(1, np.int64), _command(0.0)
        assert threaded.read(reading)
        assert threaded.departed(reading, 100, out) is None  # nothing has left yet
        for force, longest in ((0.5, 300.0), (0.5, 0.3), (0.7, 300.0)):
            begin = time.monotonic()
            threaded.write(_command(force))
            while threaded.read(reading) is False and time.monotonic() - begin < longest:
                time.sleep(1e-4)
        assert device.written == [0.5, 0.7]  # the same command again wakes nobody
        threaded.measured(reading, 1000, measured)
        assert 950 - 1e3 * (time.monotonic() - begin) - 1 <= measured[0] <= 950
        deadline = time.monotonic() + 300
        while (left := threaded.departed(reading, 1000, out)) is None and time.monotonic() < deadline:
            time.sleep(1e-3)
        assert left is not None and 1000 - 1e3 * (time.monotonic() - begin) - 1 <= left <= 1000
        assert out["wrench"][2] == 0.7
        assert threaded.departed(reading, 1001, out) is None  # told once
    finally:
        threaded.close()


@pytest.mark.parametrize("method", ["open", "write", "read"])
def test_the_method_that_has_failed_is_named_whichever_it_comes_up_in(
    device: _Slow, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    def fail(*rest: object) -> None:
        raise ValueError("no such register")

    threaded, reading = ThreadedDevice(device, patience=10.0), _reading()
    monkeypatch.setattr(device, method, fail)
    with contextlib.suppress(ValueError):
        threaded.open()
    threaded.write(_command(1.0))
    with pytest.raises(ValueError, match="no such register"):
        while True:
            threaded.read(reading)
    assert failed_in(threaded, "read") == method
    threaded.close()
    assert (failed_in(device, "read"), failed_in(None, "open")) == ("read", "open")


@pytest.mark.parametrize("method", ["open", "write", "read"])
def test_in_step_the_method_that_has_failed_is_named(
    device: _Slow, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    def fail(*rest: object) -> None:
        raise ValueError("no such register")

    every = EveryNth(device, 1)
    monkeypatch.setattr(device, method, fail)
    with pytest.raises(ValueError, match="no such register"):
        every.open()
        every.write(_command(1.0))
        every.read(_reading())
    assert failed_in(every, "read") == method


def test_an_error_that_comes_up_in_every_tick_does_not_grow(device: _Slow) -> None:
    """A safe sequence reads on for half a second; it took 10 s, as each time all lines of the times before were told."""
    threaded, reading = ThreadedDevice(device, patience=10.0), _reading()
    threaded.open()
    device.failure = ValueError("no such register")
    _until(lambda: len(device.calls) == 2)
    threaded.read(reading)
    lines = []
    for _ in range(5):
        with pytest.raises(ValueError, match="no such register") as caught:
            threaded.read(reading)
        lines.append(len(traceback.extract_tb(caught.value.__traceback__)))
    assert len(set(lines)) == 1
    assert traceback.extract_tb(caught.value.__traceback__)[-1].name == "read"  # where the driver has raised it
    threaded.close()


def test_a_device_that_hangs_is_not_opened_anew_and_what_comes_back_late_closes_it_once(device: _Slow) -> None:
    """Two threads called one driver: the first closed what the second had opened, and sent it a command."""
    threaded = ThreadedDevice(device, patience=10.0)
    threaded.open()
    threaded.write(_command(1.0))
    _until(lambda: device.written)
    device.hang.clear()
    assert device.hangs.wait(300)
    threaded.write(_command(0.0))
    with pytest.raises(DeviceError, match="does not answer"):
        threaded.close()
    for _ in range(2):
        with pytest.raises(
            DeviceError,
            match="has not returned from its driver's `read` yet, and nobody waits for that any longer: open",
        ):
            threaded.open()
    assert [what for what, _ in device.calls] == ["open"]
    threads = {thread for _, thread in device.calls}
    device.hang.set()
    _until(lambda: len(device.calls) == 2)
    threaded.open()  # the other thread has ended, or is about to
    assert [what for what, _ in device.calls] == ["open", "close", "open"]
    assert {thread for _, thread in device.calls[:2]} == threads
    assert device.written == [1.0, 0.0]
    _until(lambda: threaded.exchanges > 3)
    assert len(device.calls) == 3
    assert len(device.written) == 2  # what was left over belongs to the time before
    threaded.close()


def test_a_device_that_hangs_in_closing_is_not_opened_anew(device: _Slow, monkeypatch: pytest.MonkeyPatch) -> None:
    threaded, go_on = ThreadedDevice(device, patience=10.0), threading.Event()
    threaded.open()
    monkeypatch.setattr(device, "close", lambda: go_on.wait(300))
    with pytest.raises(DeviceError, match="does not answer"):
        threaded.close()
    with pytest.raises(DeviceError, match="has not returned from its driver's `close` yet"):
        threaded.open()
    assert threaded.hangs_in == "close"
    go_on.set()
    _until(lambda: not threaded.hangs_in)
    monkeypatch.undo()
    threaded.open()
    threaded.close()


class _Plate(_Slow):
    """Carries a surface."""

    commands = (pose_target(low=(-0.1, -0.1, 0.0), high=(0.1, 0.1, 0.05), speed=0.3),)

    def write(self, command: Record) -> None:
        self.written.append(float(command["pose_target"][2]))


def test_what_comes_back_late_moves_no_surface_on() -> None:
    device = _Plate()
    threaded, command = ThreadedDevice(device, patience=0.1), Record.of([Field("pose_target", "f8", 7)])
    threaded.open()
    device.hang.clear()
    assert device.hangs.wait(300)
    command["pose_target"][2] = 0.03
    threaded.write(command)
    with pytest.raises(DeviceError, match="does not answer"):
        threaded.close()
    device.hang.set()
    _until(lambda: device.calls[-1][0] == "close")
    assert device.written == [0.03]
