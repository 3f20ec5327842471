"""Hold-to-run, and connecting all devices at once."""

from __future__ import annotations

import gc
import os
import threading

import pytest
from small_devices import ARM, PERIOD, TABLE, Fake, Supervised, lost, model, state

from itouch.exchange import EveryNth
from itouch.plugin import Channel, DeviceError, Record, Role
from itouch.plugin.wire_claims import WireClaims, WireHeldError
from itouch.safety import DeviceFaultError, HoldToRun, Status, Trip, connect

#: In the names of wires, which belong to one process of the machine: the same test may run in another one meanwhile.
ME = f"process {os.getpid()}"


def supervised(*kinds: tuple[str, object], twin: bool = True) -> tuple[Record, list[Supervised]]:
    models = [model(channels, name=name, twin=twin) for name, channels in kinds]  # type: ignore[arg-type]
    data = state(*models)
    return data, [Supervised(one, data, PERIOD, device=Fake()) for one in models]


def test_hardware_needs_somebody_twins_only_if_asked() -> None:
    data, twins = supervised(("arm", ARM), twin=True)
    assert not HoldToRun(data, [one.gate for one in twins], PERIOD, asked=False).required
    assert HoldToRun(data, [one.gate for one in twins], PERIOD, asked=True).required
    data, hardware = supervised(("arm", ARM), twin=False)
    assert HoldToRun(data, [one.gate for one in hardware], PERIOD, asked=False).required


def test_a_word_holds_for_eighty_milliseconds() -> None:
    data, twins = supervised(("arm", ARM))
    hold = HoldToRun(data, [one.gate for one in twins], PERIOD, asked=True)
    assert not hold.held(0)
    hold.press(5, True)
    assert hold.held(5)
    assert hold.held(84)
    assert not hold.held(85)
    hold.press(90, True)
    hold.press(95, False)
    assert not hold.held(95)
    assert data["hold"].item() == 95


def test_a_switch_of_a_device_holds() -> None:
    switch = Channel("button", 1, "1", role=Role.DEADMAN)
    data, twins = supervised(("arm", ((*ARM[0], switch), ARM[1])))
    hold = HoldToRun(data, [one.gate for one in twins], PERIOD, asked=True)
    twins[0].lifecycle.open()
    twins[0].gate.device_monitors.seen["button"][0] = 1.0
    data["arm.measured"][:] = 10**6
    assert hold.held(10**6)
    assert hold.held(10**6 + 80)
    assert not hold.held(10**6 + 81)  # nobody knows whether it is still pressed
    twins[0].gate.device_monitors.seen["button"][0] = 0.5
    assert not hold.held(10**6)


def test_letting_go_stops_what_acts() -> None:
    data, twins = supervised(("arm", ARM), ("table", TABLE))
    hold = HoldToRun(data, [one.gate for one in twins], PERIOD, asked=True)
    hold.check(0)  # nothing acts yet
    for one in twins:
        one.lifecycle.open()
        one.lifecycle.enable()
    hold.press(0, True)
    hold.check(79)
    with pytest.raises(
        DeviceFaultError, match="device 'table' was let go: nobody holds the switch at tick 80"
    ) as caught:
        hold.check(80)
    assert caught.value.trip is Trip.RELEASED
    twins[1].latch.disable()
    with pytest.raises(DeviceFaultError, match="device 'arm'"):
        hold.check(80)
    HoldToRun(data, [one.gate for one in twins], PERIOD, asked=False).check(80)


def test_all_devices_are_opened_at_once_and_read() -> None:
    data, devices = supervised(("one", ARM), ("two", ARM), ("three", ARM), twin=False)
    barrier = threading.Barrier(3, timeout=600.0)
    for one in devices:
        assert isinstance(one.gate.device, Fake)
        one.gate.device.open = barrier.wait  # type: ignore[method-assign,assignment]  # opens only if all do
    assert connect([one.lifecycle for one in devices], 0) == {}
    assert [one.latch.status for one in devices] == [Status.OPEN] * 3
    assert [data[f"{name}.sequence"].item() for name in ("one", "two", "three")] == [1, 1, 1]


def test_all_that_fail_are_told_together() -> None:
    _, devices = supervised(("one", ARM), ("two", ARM), ("three", ARM), ("four", ARM), twin=False)
    one, two, three, four = devices
    assert isinstance(one.gate.device, Fake)
    assert isinstance(two.gate.device, Fake)
    assert isinstance(three.gate.device, Fake)
    one.gate.device.open_fails = DeviceError("no power")
    two.gate.device.open_fails = OSError()

    def nonsense(reading: Record) -> bool:
        reading["pose"][0] = float("nan")
        return True

    three.gate.device.says = nonsense
    found = connect([one.lifecycle for one in devices], 0)
    assert found.pop("three").startswith("reads NaN (pose) (T8 plausibility of its readings: trips at not a number,")
    assert found == {"one": "no power", "two": "OSError"}
    assert four.latch.status is Status.OPEN


@pytest.mark.parametrize("error", [KeyError("x"), AssertionError()], ids=repr)
def test_an_error_that_does_not_explain_itself_is_told_with_its_kind_and_line(error: Exception) -> None:
    _, devices = supervised(("one", ARM), twin=False)
    assert isinstance(devices[0].gate.device, Fake)

    def stumble() -> None:
        raise error

    devices[0].gate.device.open = stumble  # type: ignore[method-assign]
    told = connect([one.lifecycle for one in devices], 0)["one"]
    assert told.startswith(f"failed in open: {type(error).__name__}")
    assert "(test_hold_connect.py, line " in told


def test_a_driver_that_tries_to_end_the_program_is_told_as_one_that_did_not_open() -> None:
    _, devices = supervised(("one", ARM), twin=False)
    assert isinstance(devices[0].gate.device, Fake)

    def leave() -> None:
        raise SystemExit(3)

    devices[0].gate.device.open = leave  # type: ignore[method-assign]
    assert connect([one.lifecycle for one in devices], 0) == {"one": "has tried to end the program: SystemExit: 3"}


def test_a_device_that_never_opens_is_told() -> None:
    _, devices = supervised(("one", ARM), ("two", ARM), twin=False)
    done = threading.Event()
    assert isinstance(devices[0].gate.device, Fake)
    devices[0].gate.device.open = done.wait  # type: ignore[method-assign,assignment]
    failures = connect([one.lifecycle for one in devices], 0, patience=0.5)
    done.set()
    assert failures == {"one": "did not open within 0.5 s"}


def test_what_is_open_is_not_opened_again() -> None:
    _, devices = supervised(("one", ARM), twin=False)
    devices[0].lifecycle.open()
    assert connect([one.lifecycle for one in devices], 0) == {}
    assert isinstance(devices[0].gate.device, Fake)
    assert devices[0].gate.device.calls == ["open"]


def test_the_loss_of_an_optional_device_while_it_connects_is_told_by_connect() -> None:
    _, devices = supervised(("one", ARM), twin=False)
    told: list[DeviceFaultError] = []
    devices[0].gate.on_loss = told.append
    assert isinstance(devices[0].gate.device, Fake)
    devices[0].gate.device.says = lost
    assert connect([one.lifecycle for one in devices], 0) == {"one": "failed: the plug is out"}
    assert told == []
    assert devices[0].gate.on_loss is not None


@pytest.mark.parametrize("optional", [False, True])
def test_a_wire_that_is_in_use_keeps_all_that_is_needed_closed(optional: bool) -> None:
    def wired(wire: str) -> type[Fake]:
        return type("Wired", (Fake,), {"wires": classmethod(lambda cls, params: (wire,))})

    kinds = [("one", f"wire a of {ME}", False), ("two", f"wire b of {ME}", optional)]
    models = [model(ARM, name=name, cls=wired(wire), optional=needed) for name, wire, needed in kinds]
    data = state(*models)
    devices = [Supervised(one, data, PERIOD, device=one.cls()) for one in models]
    elsewhere = WireClaims()
    elsewhere.take([f"WIRE B of {ME}"])
    found = connect([one.lifecycle for one in devices], 0)
    assert set(found) == {"two"} and f"'wire b of {ME}' is in use by another session of this process" in found["two"]
    assert devices[0].latch.status is (Status.OPEN if optional else Status.CLOSED)
    assert devices[1].latch.status is Status.CLOSED
    if not optional:  # nor is the wire kept of what could have been opened
        free = WireClaims()
        free.take([f"wire a of {ME}"])
        free.release()
    elsewhere.release()
    assert connect([one.lifecycle for one in devices], 0) == {}
    for one in devices:
        one.lifecycle.close()
    for one in devices:
        one.lifecycle.claim_wires()
        one.lifecycle.close()  # was never opened again, and lets go of its wire all the same
    elsewhere.take([f"wire a of {ME}", f"wire b of {ME}"])
    elsewhere.release()


def test_a_device_that_cannot_be_closed_keeps_its_wire() -> None:
    cls = type("Wired", (Fake,), {"wires": classmethod(lambda cls, params: (f"wire c of {ME}",))})
    one = model(ARM, cls=cls)
    it = Supervised(one, state(one), PERIOD, device=cls())
    it.lifecycle.open()

    def hangs() -> None:
        raise DeviceError("does not answer")

    it.gate.device.close = hangs  # type: ignore[union-attr,method-assign]
    with pytest.raises(DeviceError, match="does not answer"):
        it.lifecycle.close()
    with pytest.raises(WireHeldError):
        WireClaims().take([f"wire c of {ME}"])
    del it
    gc.collect()
    WireClaims().take([f"wire c of {ME}"])


def test_the_wire_of_a_device_behind_an_exchange_is_its_own() -> None:
    cls = type("Wired", (Fake,), {"wires": classmethod(lambda cls, params: (f"wire d of {ME}",))})
    one = model(ARM, cls=cls)
    it = Supervised(one, state(one), PERIOD, device=EveryNth(cls(), 2, 0, PERIOD))
    it.lifecycle.claim_wires()
    with pytest.raises(WireHeldError):
        WireClaims().take([f"wire d of {ME}"])
    it.lifecycle.free_wires()
    stands_in = Supervised(one, state(one), PERIOD, device=Fake())  # on no wire, whatever the scene names
    stands_in.lifecycle.claim_wires()
    WireClaims().take([f"wire d of {ME}"])


def test_hardware_is_not_opened_where_no_guardian_can_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("itouch.platforms.SERVO_PROCESS", False)
    _, devices = supervised(("one", ARM), ("two", ARM), twin=False)
    found = connect([one.lifecycle for one in devices], 0)
    assert set(found) == {"one", "two"} and "hardware needs Linux" in found["one"]
    assert isinstance(devices[0].gate.device, Fake)
    assert devices[0].gate.device.calls == []


def test_a_switch_of_hardware_is_asked_anew_and_who_lets_one_go_stops_all() -> None:
    switches = tuple(Channel(name, 1, "1", role=Role.DEADMAN) for name in ("one", "other"))
    device, now = Fake(), {"one": 1.0, "other": 1.0}

    def says(reading: Record) -> bool:
        for name, value in now.items():
            reading[name] = value
        return True

    device.says = says
    model_ = model((switches, ARM[1]))
    data = state(model_)
    pedal = Supervised(model_, data, PERIOD, device=device)
    pedal.lifecycle.reset()
    hold = HoldToRun(data, [pedal.gate], PERIOD, asked=False)
    assert not hold.held(0)
    pedal.lifecycle.open()
    hold.ask(0)
    assert hold.held(0)
    pedal.lifecycle.enable()
    hold.check(0)
    now["one"] = 0.0
    hold.ask(1)  # let go before it counted
    hold.check(1)
    now["other"], now["one"] = 0.0, 1.0
    pedal.gate.read(2)
    with pytest.raises(DeviceFaultError, match="one of those who held the switch let it go"):
        hold.check(2)
