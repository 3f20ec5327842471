"""What acts on one finger is limited together: arms, plates, doses, time in contact."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from small_devices import ARM, LIMITS, PERIOD, PLATE, TABLE, Channels, Fake, Supervised, model, state

from itouch.monitors import DeviceFaultError, Trip
from itouch.monitors.surface_kernels import FingerAbove
from itouch.plugin import Channel, DeviceError, Record, Role, measured_wrench, plate_temperature, temperature_target
from itouch.safety import Finger, Gate
from itouch.world.limits import DeviceLimits

Parts = dict[str, Channels]
#: A cuff of air.
PAD: Channels = (
    (measured_wrench(force=50.0),), (Channel("air", 1, "Pa", (0.0,), (5e4,), safe=(0.0,), role=Role.PRESSURE),),
)  # fmt: skip
#: A pad that holds a temperature by its own control; 0 K: it holds none.
HOLDER: Channels = ((plate_temperature(),), (temperature_target("goal", low=0.0, high=330.0, safe=0.0),))


def hand(parts: Parts, limits: DeviceLimits = LIMITS, on: str = "") -> tuple[Record, list[Supervised], Finger]:
    models = [
        model(channels, name=name, limits=limits, carrier=on if channels is PLATE else "")
        for name, channels in parts.items()
    ]
    data = state(*models)
    devices = [Supervised(one, data, PERIOD, device=Fake()) for one in models]
    for device in devices:
        device.lifecycle.reset()
        device.lifecycle.open()
        for name, view in device.reading.items():
            view[...] = 300.0 if name.endswith("temperature") else 0.0
        device.gate.read(0)
        device.lifecycle.enable()
    finger = Finger("tip", [one.gate for one in devices])
    for arm in finger.arms:
        arm.actuation.leave_room = lambda arm=arm: finger.reduce(arm)  # type: ignore[misc]
    return data, devices, finger


def press(table: Supervised, force: float, tick: int = 1) -> None:
    table.reading["wrench"][2] = -force
    table.gate.read(tick)


def push(arm: Supervised, force: float, ticks: int = 10) -> float:
    for tick in range(ticks):
        arm.command["wrench"][0] = force
        arm.gate.write(tick)
    return float(arm.sent["wrench"][0])


@pytest.mark.parametrize(("pressed", "left"), [(0.0, 3.0), (0.02, 3.0), (1.0, 2.0), (2.5, 0.5), (3.5, 0.0)])
def test_an_arm_leaves_to_a_plate_what_it_presses_with(pressed: float, left: float) -> None:
    _, (arm, table), finger = hand({"arm": ARM, "table": TABLE})
    press(table, pressed)
    finger.check(1)
    assert push(arm, 3.0) == pytest.approx(left)


@pytest.mark.parametrize(("pressed", "left"), [(0.0, 3.0), (0.02, 3.0), (1.0, 2.0), (3.5, 0.0)])
def test_an_arm_leaves_to_a_cuff_what_it_presses_with(pressed: float, left: float) -> None:
    _, (arm, cuff), finger = hand({"arm": ARM, "cuff": PAD})
    press(cuff, pressed)
    finger.check(1)
    assert push(arm, 3.0) == pytest.approx(left)
    assert not finger.alone
    assert not finger.simple


def test_a_cuff_and_a_surface_trip_together_and_the_stronger_is_named() -> None:
    """Three newton each; five is the trip of each, and of both."""
    for names in (("cuff", "table"), ("one", "cuff")):
        parts = {name: PAD if name == "cuff" else TABLE for name in names}
        _, devices, finger = hand(parts)
        for device, force in zip(devices, (2.4, 2.5), strict=True):
            press(device, force)
        finger.check(1)
        press(devices[1], 2.7, 2)
        with pytest.raises(DeviceFaultError, match="presses with others on the finger of 'tip' with 5.1 N") as caught:
            finger.check(2)
        assert caught.value.device == names[1]
        assert caught.value.trip is Trip.FINGER_FORCE


def test_an_arm_leaves_what_surfaces_may_press_with_next() -> None:
    _, devices, _ = hand({"arm": ARM, "one": TABLE, "two": TABLE})
    down, over = np.array([0.0, 0.0, -0.1]), np.array([0.0, 0.0, 0.1])
    near = FingerAbove(over, down, np.array([0.092]), np.zeros(1), np.array([0.008, 1000.0, 2.0, PERIOD]))
    finger = Finger("tip", [one.gate for one in devices], {"one": near})
    assert finger.taken() == pytest.approx(0.06 + 0.2 + 0.2)
    press(devices[1], 0.5)
    press(devices[2], 0.4)  # of this one it is not known where the finger is
    assert finger.taken() == pytest.approx(0.9 + 0.06 + 0.2)
    finger.check(1)
    assert push(devices[0], 3.0) == pytest.approx(3.0 - 1.16)


def test_an_arm_leaves_no_room_for_the_noise_of_a_loud_sensor() -> None:
    _, devices, _ = hand({"arm": ARM, "one": TABLE})
    far = FingerAbove(
        np.array([0.0, 0.0, 0.1]), np.zeros(3), np.zeros(1), np.zeros(1), np.array([0.008, 1000.0, 2.0, PERIOD]),
        estimated=np.array([0.04, 0.0, 0.04]),
    )  # fmt: skip
    finger = Finger("tip", [one.gate for one in devices], {"one": far})
    press(devices[1], 0.1)
    assert finger.pressed() == pytest.approx(0.1)  # by which two surfaces together trip
    assert finger.taken() == 0.0


def test_the_scenes_force_is_that_of_all_together() -> None:
    limits = dataclasses.replace(LIMITS, finger_force=1.0)
    _, (arm, table), finger = hand({"arm": ARM, "table": TABLE}, limits)
    press(table, 0.6)
    finger.check(1)
    assert push(arm, 3.0) == pytest.approx(0.4)


def test_two_arms_on_one_finger_share_its_force() -> None:
    _, (one, two), finger = hand({"one": ARM, "two": ARM})
    finger.check(1)
    assert push(one, 2.0) == pytest.approx(2.0)
    assert push(two, 3.0) == pytest.approx(1.0)
    assert push(one, 3.0) == pytest.approx(2.0)
    push(two, 0.0)
    assert push(one, 3.0) == pytest.approx(3.0)


def test_two_plates_that_press_together_trip() -> None:
    _, (one, two), finger = hand({"one": TABLE, "two": TABLE})
    press(one, 2.4)
    press(two, 2.7)
    with pytest.raises(DeviceFaultError, match="presses with others on the finger of 'tip' with 5.1 N") as caught:
        finger.check(1)
    assert (caught.value.device, caught.value.trip) == ("two", Trip.FINGER_FORCE)


def test_touching_one_plate_and_then_another_is_one_contact() -> None:
    data, tables, finger = hand({"one": TABLE, "two": TABLE})
    for tick in range(1, 12001):
        tables[0].gate.device_monitors.touch(tick // 500 % 2 == 0, 1.0)
        tables[1].gate.device_monitors.touch(tick // 500 % 2 == 1, 1.0)
        finger.check(tick)
    for name in ("one", "two"):
        assert data[f"{name}.surface.contact_time"].item() == pytest.approx(12.0, abs=0.03)
        assert data[f"{name}.surface.withdrawn"].item() == 1


def test_what_the_compiled_clock_has_found_is_told_of_the_plate_it_found_it_of() -> None:
    data, (one, two), finger = hand({"one": TABLE, "two": TABLE})
    finger.check(1)
    finger.told(2)  # nothing was found
    surface = two.gate.device_monitors.surface
    assert surface is not None
    surface.said[0] = -float(Trip.CONTACT_TIME)
    data["two.surface.contact_time"] = 60.0
    with pytest.raises(DeviceFaultError, match="has been touched for") as caught:
        finger.told(3)
    assert (caught.value.device, caught.value.trip) == ("two", Trip.CONTACT_TIME)


def test_a_hand_without_surfaces_has_nothing_to_tell_of_them() -> None:
    _, (one,), finger = hand({"one": PLATE})
    finger.told(1)
    one.gate.device_monitors.told_of_contact(1)


def test_a_plate_that_is_touched_for_too_long_trips_whichever_it_is() -> None:
    data, _, finger = hand({"one": TABLE, "two": TABLE})
    finger.check(1)
    data["one.surface.contact_time"] = 59.999
    data["one.touched"] = 1
    with pytest.raises(DeviceFaultError, match=r"has been touched for 60\.0 s \(T4 time in contact"):
        finger.check(11)


@pytest.mark.parametrize(("what", "words"), [("dose", "a thermal dose of 2.03 CEM43"), ("cold_time", "for 122.0 s")])
def test_two_plates_share_dose_and_cold(what: str, words: str) -> None:
    data, (one, _), finger = hand({"one": PLATE, "two": PLATE})
    data[f"one.heat.{what}"], data[f"two.heat.{what}"] = 80.0, 39.0
    finger.check(1)
    assert finger.spent() == ""
    data[f"two.heat.{what}"] = 42.0
    with pytest.raises(DeviceFaultError, match=words) as caught:
        finger.check(2)
    assert caught.value.device == "one"
    one.latch.disable()
    with pytest.raises(DeviceError, match="with others on the same finger"):
        one.lifecycle.enable()


def worn(data: Record, finger: Finger, current: float, ticks: range) -> float:
    """Return the clock of T4 after a display on the finger was driven so."""
    data["plate.sent.current"] = current
    for tick in ticks:
        finger.check(tick)
    return float(data["table.surface.contact_time"])


def test_a_worn_display_is_in_contact_while_it_is_driven() -> None:
    data, (table, _), finger = hand({"table": TABLE, "plate": PLATE})
    table.gate.device_monitors.touch(False, 0.0)
    assert worn(data, finger, 1.5, range(1, 5001)) == pytest.approx(5.0, abs=0.03)
    assert worn(data, finger, 0.0, range(5001, 7001)) == pytest.approx(3.0, abs=0.03)
    assert worn(data, finger, -1.5, range(7001, 8001)) == pytest.approx(4.0, abs=0.03)


def test_a_worn_display_lets_go_when_the_surface_withdraws() -> None:
    data, (table, plate), finger = hand({"table": TABLE, "plate": PLATE})
    table.gate.device_monitors.touch(False, 0.0)
    other = Finger("other", [plate.gate])
    assert worn(data, finger, 1.5, range(1, 10051)) > 10.0
    assert data["table.surface.withdrawn"].item() == 1
    other.check(10051)
    assert plate.gate.device_monitors.share == 0.0
    plate.command["current"][...] = 1.5
    plate.gate.write(10051)
    assert plate.sent["current"].item() == 0.0
    data["table.surface.withdrawn"], data["table.surface.contact_time"] = 0, 4.9
    finger.check(10060)
    assert plate.gate.device_monitors.share == 1.0


def test_a_display_that_the_surface_brings_is_not_worn() -> None:
    data, (table, _), finger = hand({"table": TABLE, "plate": PLATE}, on="table")
    table.gate.device_monitors.touch(False, 0.0)
    assert finger.worn == []
    assert worn(data, finger, 1.5, range(1, 1001)) == 0.0


def holding(data: Record, finger: Finger, goal: float, ticks: range) -> float:
    """Return the clock of T4 after a display on the finger, which is where it shall be, was told to hold this."""
    data["pad.sent.goal"] = goal
    for tick in ticks:
        finger.check(tick)
    return float(data["table.surface.contact_time"])


def test_a_worn_display_is_in_contact_while_it_only_holds_a_temperature() -> None:
    data, (table, _), finger = hand({"table": TABLE, "pad": HOLDER})
    table.gate.device_monitors.touch(False, 0.0)
    assert holding(data, finger, 300.0, range(1, 3001)) == pytest.approx(3.0, abs=0.03)
    assert holding(data, finger, 0.0, range(3001, 4001)) == pytest.approx(2.0, abs=0.03)
    assert holding(data, finger, 200.0, range(4001, 5001)) == pytest.approx(3.0, abs=0.03)


def test_what_the_safe_target_of_a_withdrawn_display_is_does_not_count() -> None:
    """A pad without an off is told to hold the middle of its limits: T4 must not trip on that."""
    data, (table, pad), finger = hand({"table": TABLE, "pad": HOLDER})
    table.gate.device_monitors.touch(False, 0.0)
    data["table.surface.contact_time"] = 9.99
    assert holding(data, finger, 300.0, range(1, 41)) == pytest.approx(10.0, abs=0.03)
    assert pad.gate.device_monitors.share == 0.0
    before = holding(data, finger, 300.65, range(41, 1041))
    assert before == pytest.approx(9.0, abs=0.04)
    pad.command["goal"][...] = 312.0
    pad.gate.write(1041)
    assert pad.sent["goal"].item() == 0.0


def test_a_display_on_a_bracket_that_the_surface_brings_is_not_worn() -> None:
    bracket = model(ARM, name="bracket", carrier="table")
    models = [model(TABLE, name="table"), bracket, model(PLATE, name="plate", carrier="bracket")]
    data = state(*models)
    finger = Finger("tip", [Gate(one, data, PERIOD, device=Fake()) for one in models])
    assert finger.worn == []
    elsewhere = Finger("tip", [Gate(one, data, PERIOD, device=Fake()) for one in (models[0], models[2])])
    assert [one.model.name for one, _ in elsewhere.worn] == ["plate"]  # what carries it is not known to be the table


def test_one_plate_alone_has_nothing_to_share() -> None:
    _, (plate,), finger = hand({"plate": PLATE})
    assert finger.alone
    assert plate.gate.shared == []
    assert not hand({"table": TABLE})[2].alone
    assert not hand({"one": ARM, "two": ARM})[2].alone
    _, both, two = hand({"one": PLATE, "two": PLATE})
    assert not two.alone
    assert two.plates == [post for one in both for post, _ in one.gate.device_monitors.heats]


def test_a_load_of_the_touch_force_itself_is_none_yet() -> None:
    _, (table,), finger = hand({"table": TABLE})
    for load, pressed in ((0.03, 0.0), (0.0301, 0.0301)):
        table.gate.device_monitors.seen["wrench"] = (0.0, 0.0, -load, 0.0, 0.0, 0.0)
        assert finger.pressed() == pytest.approx(pressed)


def test_what_one_plate_alone_has_given_is_said_by_its_own_monitor() -> None:
    data, _, finger = hand({"table": TABLE, "plate": PLATE})
    data["plate.heat.dose"] = 1e6
    finger.check(1)  # "with others on the same finger" would not be true


def test_the_clock_of_contact_goes_on_in_periods_that_a_late_loop_has_left_out() -> None:
    data, (_, table), finger = hand({"arm": ARM, "table": TABLE})
    table.gate.device_monitors.touch(True, 1.0)
    finger.check(1)
    table.gate.device_monitors.leave_out(500)
    finger.check(2)
    assert float(data["table.surface.contact_time"]) == pytest.approx(0.501, abs=1e-6)
