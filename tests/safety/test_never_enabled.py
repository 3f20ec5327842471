"""Hardware that holds or retracts, and that a session leaves before it was enabled: nothing is known to start from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest

import itouch
from itouch.plugin import HOLD, RETRACT, Channel, Device, DeviceError, Record, pose, pose_target
from itouch.plugin.discovery import Catalog, Found, find

SCENE = """<itouch version="1.0">
  <materials><material name="wood"><contact stiffness="0.5 N/mm"/></material></materials>
  <world><box name="block" size="4 4 2 cm" pos="0 0 1 cm" material="wood"/></world>
  <devices><device name="stick" plugin="recorded"/><device name="lift" plugin="lift" twin="no"/></devices>
  <interaction><probe name="tip" radius="5 mm" pose-from="stick"/></interaction>
</itouch>
"""
STANDS = (0.01, -0.02, 0.03)
LOW, HIGH = (-0.1, -0.1, 0.0), (0.1, 0.1, 0.06)


@dataclass(frozen=True)
class Params:
    """Nothing."""


def lift(*commands: Channel, silent: bool = False) -> type[Device]:
    class Lift(Device):
        """A lift that stands somewhere, and keeps what it was told."""

        reads = (pose(),)
        second_opener: ClassVar[bool] = True
        told: ClassVar[list[list[float]]] = []

        def open(self) -> None:
            self.told.clear()

        def close(self) -> None:
            pass

        def read(self, reading: Record) -> bool | None:
            if silent:
                raise DeviceError("its cable is out")
            reading["pose"] = (*STANDS, 1.0, 0.0, 0.0, 0.0)
            return True

        def write(self, command: Record) -> None:
            self.told.append(command[type(self).commands[0].name].tolist())

    Lift.commands = commands
    Lift.Params = Params
    return Lift


class Entry:
    """What stands for an entry point."""

    def __init__(self, value: type) -> None:
        self.value, self._loaded = value.__name__, value

    def load(self) -> type:
        return self._loaded


def built(folder: Path, cls: type[Device]) -> itouch.Session:
    def finder(group: str) -> dict[str, Found]:
        found: dict[str, Any] = dict(find(group))
        if group == "itouch.devices":
            found["lift"] = Found("lift", "itouch-lift", "1.0", Entry(cls))  # type: ignore[arg-type]
        return found

    (folder / "s.xml").write_text(SCENE, encoding="utf-8")
    return itouch.build(folder / "s.xml", catalog=Catalog(finder))


@pytest.mark.parametrize("safe", [HOLD, RETRACT], ids=["held", "retracted"])
def test_a_surface_that_was_only_read_is_left_from_where_it_stands(tmp_path: Path, safe: Any) -> None:
    cls: Any = lift(pose_target(low=LOW, high=HIGH, speed=0.2, safe=safe))
    session = built(tmp_path, cls)
    session.find_hardware()
    session.close()
    (told,) = cls.told
    assert told[:2] == list(STANDS[:2]) and told[3:] == [1.0, 0.0, 0.0, 0.0]
    assert STANDS[2] - 0.2e-3 - 1e-9 <= told[2] <= STANDS[2]


def test_a_surface_that_was_not_read_is_told_nothing(tmp_path: Path) -> None:
    cls: Any = lift(pose_target(low=LOW, high=HIGH, speed=0.2, safe=RETRACT), silent=True)
    session = built(tmp_path, cls)
    with pytest.raises(DeviceError, match="its cable is out") as caught:
        session.find_hardware()
    assert not getattr(caught.value, "__notes__", [])
    session.close()
    assert cls.told == []
