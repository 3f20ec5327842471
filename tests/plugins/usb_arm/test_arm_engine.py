"""The arm under the engine on the virtual clock: unplugged in the midst of a frame, replugged, on again."""

from __future__ import annotations

from pathlib import Path

import pytest

from itouch.exchange import EveryNth
from itouch.loop import DeviceFaultError
from itouch.session import Session, build, load_scene
from itouch_usb_arm import Falcon, UsbArm, UsbArmParams, boot
from itouch_usb_arm.virtual import Hand, VirtualBackend, VirtualFalcon, VirtualTime
from itouch_usb_arm.wire import Buttons

IMAGE = boot.build([boot.Block(0x3F8000, (1, 2, 3))], entry=0x3F8002)
SCENE = """<itouch version="1.0" xmlns:usb-arm="urn:itouch:plugin:usb-arm">
  <materials><material name="wood"><contact stiffness="0.8 N/mm"/></material></materials>
  <world><box name="floor" size="200 200 20 mm" pos="0 0 105 mm" material="wood"/></world>
  <devices><device name="arm" plugin="usb-arm" twin="no">
    <usb-arm:hardware firmware="FIRMWARE" deadman="centre"/></device></devices>
  <interaction><probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/></interaction>
</itouch>"""


@pytest.fixture
def rig(tmp_path: Path) -> tuple[Session, VirtualFalcon]:
    (tmp_path / "firmware.bin").write_bytes(IMAGE)
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.replace("FIRMWARE", str(tmp_path / "firmware.bin")))
    session = build(load_scene(path))
    virtual = VirtualFalcon(time=VirtualTime(), hand=Hand(path=lambda now: (0.0, 0.0, 0.121)))
    virtual.buttons = Buttons.CENTRE
    params = session.model.devices["arm"].params
    assert isinstance(params, UsbArmParams)
    device = UsbArm(params)
    device.backend = VirtualBackend(virtual)
    make = device.make_driver

    def on_virtual_time(*, safe: bool = False) -> Falcon:
        driver = make(safe=safe)
        driver._clock = virtual.time.now
        return driver

    device.make_driver = on_virtual_time  # type: ignore[method-assign]
    session.runners[0].gate.device = EveryNth(device, 1)
    return session, virtual


def test_the_arm_is_felt_unplugged_and_replugged(rig: tuple[Session, VirtualFalcon]) -> None:
    session, virtual = rig
    session.enable()
    session.run(1.5)  # the force ramps in over a second on hardware
    # The hand rests 2 mm under where the finger touches the floor's top (115 + 8 mm): it is held up.
    assert virtual.mechanics.position[2] > 0.1215
    assert virtual.mechanics.motor_force()[2] > 0.2
    for after in (3, 7):
        virtual.faults.unplug_after = after
        begin = session.ticks
        with pytest.raises(DeviceFaultError, match="arm.*gone"):
            session.run(1.0)
        assert session.fault is not None
        assert session.fault.tick - begin <= 20  # 20 ms
        assert session.status("arm").name == "FAULT"
        assert virtual.mechanics.motors == (0, 0, 0)
        virtual.plug(running=after == 3)
        commands = len(virtual.commands)
        session.reconnect("arm")
        assert all(numbers.values == (0, 0, 0) for numbers in list(virtual.commands)[commands:])
        session.rearm()
        session.run(1.5)
        assert session.status("arm").name == "ENABLED"
        assert virtual.mechanics.motor_force()[2] > 0.2
    session.close()
    assert virtual.mechanics.motors == (0, 0, 0)


def test_letting_go_of_the_button_takes_the_force_away(rig: tuple[Session, VirtualFalcon]) -> None:
    session, virtual = rig
    session.enable()
    session.run(1.2)
    assert virtual.mechanics.motors != (0, 0, 0)
    virtual.buttons = Buttons.NONE
    with pytest.raises(DeviceFaultError, match="let go"):
        session.run(1.0)
    session.close()
    assert virtual.mechanics.motors == (0, 0, 0)
