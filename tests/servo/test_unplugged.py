"""A device that is not plugged in is told at once, not after somebody has held the switch."""

from __future__ import annotations

from pathlib import Path

import pytest

import itouch

SCENE = """<itouch version="1.0">
  <devices><device name="arm" plugin="usb-arm" twin="no">%s</device></devices>
</itouch>
"""
#: Nothing listens at port 1.
BEHIND_A_SERVER = '<usb-arm:hardware xmlns:usb-arm="urn:itouch:plugin:usb-arm" usbip="127.0.0.1:1"/>'


@pytest.mark.parametrize(
    ("hardware", "said"), [("", "device 'arm': "), (BEHIND_A_SERVER, "device 'arm': USB/IP server 127.0.0.1:1: ")],
    ids=["on the bus", "behind a server"],
)  # fmt: skip
def test_a_missing_device_is_told_before_the_switch_is_held(tmp_path: Path, hardware: str, said: str) -> None:
    path = tmp_path / "s.xml"
    path.write_text(SCENE % hardware, encoding="utf-8")
    with (
        pytest.raises(itouch.DeviceError, match=said),
        itouch.launch(path, seconds=1.0, realtime=False) as handle,  # nobody enables it, nobody holds a switch
    ):
        handle.wait(300.0)
