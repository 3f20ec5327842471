"""Simulated devices behind TCP are for this machine only: whoever reaches one can command it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from itouch.plugin import DeviceError, Emulator
from itouch_arms.haply.server import Server
from itouch_thermal.drivers.emulator import ModbusServer
from itouch_usb_arm.arm import UsbArmParams
from itouch_usb_arm.emulator import ArmEmulator

_ANY: Any = None
_SERVERS: dict[str, Callable[[str], object]] = {
    "USB/IP": lambda host: _arm(f"{host}:3240").open(),
    "Modbus": lambda host: ModbusServer(host, 0, _ANY),
    "Inverse Service": lambda host: Server(_ANY, (host, 0)),
}


def _arm(where: str) -> Emulator:
    return ArmEmulator(UsbArmParams(usbip=where))


@pytest.mark.parametrize("protocol", _SERVERS)
@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1"])
def test_an_address_that_others_reach_is_refused(protocol: str, host: str) -> None:
    if protocol == "Inverse Service":
        pytest.importorskip("websockets")
    with pytest.raises(DeviceError, match="from this machine only: write 127.0.0.1"):
        _SERVERS[protocol](host)


def test_an_empty_address_is_refused_as_it_means_all() -> None:
    with pytest.raises(OSError, match="write 127.0.0.1"):
        Emulator.listener(("", 0))


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2", "localhost"])
def test_an_address_of_this_machine_alone_is_taken(host: str) -> None:
    with Emulator.listener((host, 0)) as listener:
        assert listener.getsockname()[0].startswith("127.")
