"""What something writes over a device's status in State: the framework goes by its own, and compiled code is not misled."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from shipped import SCENES
from test_hardware import SCENE, catalog, stick

import itouch
from itouch.plugin import DeviceError, Record

CLOSED, OPEN, ENABLED, FAULT = range(4)


@pytest.fixture
def faulty(tmp_path: Path) -> Any:
    """Return a session whose device was stopped in a touch, and is read again; and what it is given."""
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    cls, given = stick(), []

    def write(self: Any, command: Record) -> None:
        given.append(float(abs(command["wrench"]).max()))

    def read(self: Any, reading: Record) -> bool:
        self.count += 1
        if self.count == 300:
            raise DeviceError("the cable was out for a moment")
        reading["deadman"] = 1.0
        reading["pose"] = (0.0, 0.0, 0.022 + 1e-6 * (self.count % 7), 1.0, 0.0, 0.0, 0.0)
        return True

    cls.write, cls.read = write, read  # type: ignore[method-assign]
    session = itouch.build(tmp_path / "scene.xml", catalog=catalog(cls))
    session.enable()
    with pytest.raises(itouch.DeviceFaultError, match="the cable was out"):
        session.run(1.0)
    assert max(given) > 0.2 and given[-1] == 0.0
    given.clear()
    yield session, given
    session.close()


@pytest.mark.parametrize("forged", [CLOSED, OPEN, ENABLED, 99])
def test_a_device_whose_trip_is_latched_is_given_nothing_whatever_state_says(faulty: Any, forged: int) -> None:
    """Compiled code took the word of State, and let commands through to a device that was stopped."""
    session, given = faulty
    for _ in range(50):
        session.state["stick.status"] = forged
        session.tick()
    assert given and max(given) == 0.0
    assert session.status("stick").name == "FAULT"
    assert int(session.state["stick.status"]) == FAULT


@pytest.mark.parametrize("forged", [CLOSED, OPEN, FAULT, 99])
def test_a_twin_over_whose_status_something_has_written_is_stopped(tmp_path: Path, forged: int) -> None:
    """It was believed: the session was stored so, and a command that was not limited stood."""
    session = itouch.build(SCENES / "first_touch.xml")
    session.run(0.1)
    name = next(iter(session.model.devices))
    session.state[f"{name}.status"] = forged
    with pytest.raises(
        itouch.DeviceFaultError, match=f"device '{name}' was stopped: something has written {forged} over"
    ):
        session.run(0.05)
    assert session.status(name).name == "FAULT"
