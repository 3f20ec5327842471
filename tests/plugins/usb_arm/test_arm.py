"""The arm's twin reads the finger's pose through encoders."""

from __future__ import annotations

import numpy as np
import pytest

from itouch.plugin import Field, Record, TwinInputs
from itouch_usb_arm import UsbArm, UsbArmParams, UsbArmTwin


@pytest.mark.parametrize("rotations", ["locked", "sensed"])
def test_position_in_steps_and_rotations_as_the_parameters_say(rotations: str) -> None:
    twin = UsbArmTwin(UsbArmParams(rotations=rotations, resolution=1e-4))
    state, reading = Record.of(twin.fields()), Record.of([Field("pose", "f8", 7)])
    twin.reset(state, np.random.default_rng(0))
    touch = TwinInputs(finger_attached=True)
    touch.finger_pose[:] = (0.01234, -0.00004, 0.02006, 0.6, 0.8, 0.0, 0.0)
    twin.step(state, Record.of([]), touch, 1e-3)
    twin.read(state, reading)
    assert reading["pose"][:3] == pytest.approx([0.0123, 0.0, 0.0201], abs=1e-12)
    turned = [0.6, 0.8, 0.0, 0.0] if rotations == "sensed" else [1.0, 0.0, 0.0, 0.0]
    assert list(reading["pose"][3:]) == turned
    (channel,), _ = UsbArm.channels(twin.params)
    assert channel.locked == (() if rotations == "sensed" else (3, 4, 5))


def test_the_ceiling_is_the_devices_own() -> None:
    (command,) = UsbArm.commands
    assert command.magnitude == 8.0
    assert command.safe == (0.0,) * 6
