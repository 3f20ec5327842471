"""A device that takes long to open: who waits for it may give it up, and then it is left to nobody half open."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from itertools import count
from typing import ClassVar

import pytest
from small_devices import ARM, PERIOD, Fake, Supervised, lost, model, state

from itouch.plugin import DeviceError
from itouch.plugin.wire_claims import WireClaims, WireHeldError
from itouch.safety import Status, Trip, connect

#: For names that belong to one process of the machine, and to one test: another may run at the same time.
NUMBER = count()


class Slow(Fake):
    """A device whose driver does not return from opening, or closing, before it is told."""

    wire: ClassVar[str] = ""

    @classmethod
    def wires(cls, params: object) -> tuple[str, ...]:
        """Return its only wire."""
        return (cls.wire,)

    def __init__(self) -> None:
        super().__init__()
        self.lets, self.closes, self.closed = threading.Event(), threading.Event(), threading.Event()
        self.opens_not: Exception | None = None
        self.closes.set()

    def open(self) -> None:
        super().open()
        self.lets.wait()
        if self.opens_not:
            raise self.opens_not

    def close(self) -> None:
        self.closes.wait()
        self.closed.set()
        super().close()


@pytest.fixture
def slow() -> Iterator[Supervised]:
    one = model(ARM, name="one", cls=Slow)
    device = Slow()
    Slow.wire = f"wire {next(NUMBER)} of a slow device of process {os.getpid()}"
    yield Supervised(one, state(one), PERIOD, device=device)
    device.lets.set()
    device.closes.set()


def driver(one: Supervised) -> Slow:
    assert isinstance(one.gate.device, Slow)
    return one.gate.device


def held() -> bool:
    """Tell whether somebody has the wire."""
    try:
        WireClaims().take([Slow.wire])
    except WireHeldError:
        return True
    return False


def until_idle(one: Supervised) -> None:
    for _ in range(6000):
        if not one.lifecycle.busy:
            return
        threading.Event().wait(0.01)
    pytest.fail("its thread has not ended")


def test_what_is_opened_too_late_is_closed_again_and_never_open(slow: Supervised) -> None:
    """The late thread set it OPEN, after all had been told that it is not there, and its wire was free."""
    beats: list[int] = []
    said = connect([slow.lifecycle], 0, patience=0.05, meanwhile=lambda: beats.append(0))
    assert said == {"one": "did not open within 0.05 s"}
    assert beats
    slow.lifecycle.free_wires()
    assert held()
    again = "is still being opened, although nobody waits for that any longer: wait, or switch it off"
    assert connect([slow.lifecycle], 0) == {"one": again}
    for act in (slow.lifecycle.reconnect, slow.lifecycle.open):
        with pytest.raises(DeviceError, match="is still being opened"):
            act()
    driver(slow).lets.set()
    until_idle(slow)
    assert slow.latch.status is Status.CLOSED
    assert driver(slow).calls == ["open", "close"]
    assert not held()
    assert connect([slow.lifecycle], 0) == {}


def test_a_device_is_closed_whose_opening_nobody_waits_for_any_more(slow: Supervised) -> None:
    slow.lifecycle.begin_opening()
    assert (slow.lifecycle.awaited, slow.lifecycle.settled) == (True, False)
    with pytest.raises(DeviceError, match="is being opened: wait until that is done"):
        slow.lifecycle.begin_reconnect()
    driver(slow).lets.set()
    until_idle(slow)
    assert slow.lifecycle.settled
    slow.lifecycle.close()
    assert driver(slow).calls == ["open", "close"]
    assert not held()
    assert slow.lifecycle.finish_opening() == "is no longer being opened"
    assert slow.latch.status is Status.CLOSED


def test_what_is_given_up_and_can_not_be_closed_keeps_its_wire(
    slow: Supervised, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("itouch.safety.lifecycle.CLOSE_TIME", 0.05)
    driver(slow).closes.clear()
    driver(slow).lets.set()
    assert connect([slow.lifecycle], 0) == {}
    slow.lifecycle.put_down()
    assert slow.latch.status is Status.CLOSED
    slow.lifecycle.close()  # while it does not return
    assert slow.lifecycle.finish_opening() == "is no longer being opened"
    assert held()
    driver(slow).close_fails = OSError("it hangs")
    driver(slow).closes.set()
    until_idle(slow)
    assert held()


def test_what_fails_too_late_is_not_closed(slow: Supervised) -> None:
    driver(slow).opens_not = DeviceError("not there")
    assert connect([slow.lifecycle], 0, patience=0.05) == {"one": "did not open within 0.05 s"}
    driver(slow).lets.set()
    until_idle(slow)
    assert driver(slow).calls == ["open"]
    assert not held()


def test_a_device_is_not_opened_any_more_that_was_given_up_while_it_closed(slow: Supervised) -> None:
    driver(slow).lets.set()
    assert connect([slow.lifecycle], 0) == {}
    driver(slow).closes.clear()
    slow.lifecycle.begin_reconnect()
    threading.Timer(0.2, driver(slow).closes.set).start()
    slow.lifecycle.close()
    until_idle(slow)
    assert driver(slow).calls == ["open", "close"]
    assert not held()


def test_nothing_is_begun_while_the_driver_has_not_returned_from_closing(
    slow: Supervised, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("itouch.safety.lifecycle.CLOSE_TIME", 0.01)
    driver(slow).lets.set()
    assert connect([slow.lifecycle], 0) == {}
    driver(slow).closes.clear()
    with pytest.raises(DeviceError, match="did not return from closing"):
        slow.lifecycle.close()
    with pytest.raises(DeviceError, match="has not returned from its driver.s `close` yet"):
        slow.lifecycle.begin_reconnect()
    assert held()


def test_a_twin_is_put_down_at_once() -> None:
    one = model(ARM, name="one", twin=True)
    it = Supervised(one, state(one), PERIOD, device=None)
    it.lifecycle.open()
    it.lifecycle.put_down()
    assert it.latch.status is Status.CLOSED
    it.lifecycle.reconnect()
    assert it.latch.status is Status.OPEN


def test_ctrl_c_ends_the_waiting_and_closes_what_opens_after_that(slow: Supervised) -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        connect([slow.lifecycle], 0, meanwhile=interrupt)
    driver(slow).lets.set()
    until_idle(slow)
    assert driver(slow).calls == ["open", "close"]


def test_a_device_that_is_being_opened_is_told_nothing_when_all_is_stopped(slow: Supervised) -> None:
    """A fault of the loop itself is put down to the first device: its driver was called while it opened."""
    slow.lifecycle.begin_opening()
    slow.gate.fault(Trip.OVERRUN, 3)
    assert slow.latch.status is Status.CLOSED
    driver(slow).lets.set()
    assert slow.lifecycle.finish_opening() == ""
    assert (slow.latch.status, slow.latch.trip) == (Status.FAULT, Trip.OVERRUN)
    assert driver(slow).written == []


def test_a_device_that_fails_when_it_is_made_safe_is_reconnected_all_the_same() -> None:
    one = model(ARM, name="one", cls=Fake)
    it = Supervised(one, state(one), PERIOD, device=Fake())
    it.lifecycle.open()
    assert isinstance(it.gate.device, Fake)
    it.gate.device.write_fails = OSError("gone")
    it.gate.device.says = lost
    it.lifecycle.reconnect()
    assert it.latch.status is Status.OPEN
