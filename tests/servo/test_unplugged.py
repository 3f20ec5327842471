"""A device that is not plugged in is told at once, not after somebody has held the switch."""

from __future__ import annotations

from pathlib import Path

import pytest

import itouch

SCENE = """<itouch version="1.0">
  <devices><device name="arm" plugin="usb-arm" twin="no"/></devices>
</itouch>
"""


def test_what_is_not_there_is_told_before_anybody_holds_the_switch(tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    path.write_text(SCENE, encoding="utf-8")
    with (
        pytest.raises(itouch.DeviceError, match="device 'arm': "),
        itouch.launch(path, seconds=1.0, realtime=False) as handle,  # nobody enables it, nobody holds a switch
    ):
        handle.wait(300.0)
