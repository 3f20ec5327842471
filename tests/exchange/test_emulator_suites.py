"""The framework's own suite on the emulators of the plugins that come with it, each over its real protocol."""

from typing import ClassVar

import pytest

from itouch.testing import EmulatorTests
from itouch_thermal.display.device import ThermalDisplay
from itouch_thermal.display.params import DisplayParams
from itouch_thermal.drivers import FluxSensor, Infrared, LabJack, Mecom
from itouch_usb_arm import UsbArm, UsbArmParams
from itouch_xyz_table.table import XyzTable, XyzTableParams

pytestmark = pytest.mark.punctual  # what is driven is a thread or a process beside the driver


class TestArm(EmulatorTests):
    device, name = UsbArm, "usb-arm"
    params: ClassVar[UsbArmParams] = UsbArmParams(grip=(0.0, 0.01, 0.03), deadman="forward")


class TestTable(EmulatorTests):
    device, name = XyzTable, "xyz-table"
    params: ClassVar[XyzTableParams] = XyzTableParams(homing="absolute", direction=(1.0, -1.0, 1.0))


class TestTableOnSteppers(EmulatorTests):
    device, name = XyzTable, "xyz-table"
    params: ClassVar[XyzTableParams] = XyzTableParams(
        tmcl="/dev/steppers", homing="absolute", direction=(1.0, -1.0, 1.0)
    )


class TestDisplay(EmulatorTests):
    device, name = ThermalDisplay, "thermal"


@pytest.mark.long  # what averaging changes is tested by itself: tests/plugins/thermal_drivers/test_t7_averaging.py
class TestDisplayThatAverages(EmulatorTests):
    device, name = ThermalDisplay, "thermal"
    params: ClassVar[DisplayParams] = DisplayParams(  # a mean is compared with a single sample: there is no noise
        flux_noise=0.0,
        mecom=Mecom(port="tec"),
        labjack=LabJack(
            host="127.0.0.1:1", averaging=20e-3, flux_sensor=FluxSensor(sensitivity=1e-6), infrared=Infrared()
        ),
    )
