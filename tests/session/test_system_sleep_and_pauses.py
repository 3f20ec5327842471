"""Time that no tick and no clock of the loop has counted: the machine slept, or a script paused with the switch held."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from test_hardware import SCENE, catalog, stick

import itouch
from itouch.loop import clock, pacing
from itouch.plugin import Record


@pytest.fixture
def session(tmp_path: Path) -> Any:
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    cls = stick()

    def write(self: Any, command: Record) -> None:
        self.sent.append(float(abs(command["wrench"]).max()))

    cls.sent, cls.write = [], write  # type: ignore[attr-defined,method-assign]
    built = itouch.build(tmp_path / "scene.xml", catalog=catalog(cls), clock=itouch.WallClock())
    built.enable()
    yield built
    built.close()


@pytest.mark.punctual
def test_hardware_is_stopped_in_the_first_tick_after_the_machine_has_slept(
    session: itouch.Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Readings were fresh and nothing was late, for the clock had stood still, too."""
    session.run(0.02)
    begin, ticks = clock.asleep(), []
    monkeypatch.setattr(pacing, "asleep", lambda: begin + (3600.0 if len(ticks) > 10 else 0.0))
    session.taps.append(ticks.append)
    with pytest.raises(
        itouch.DeviceFaultError, match="'stick' was stopped: this machine has slept for 3600 s"
    ) as caught:
        session.run(0.1)
    assert caught.value.tick == ticks[10] + 1
    assert session.status("stick").name == "FAULT"
    session.rearm()
    session.run(0.02)


@pytest.mark.punctual
def test_hardware_is_stopped_in_the_first_tick_after_the_loop_stood_still(session: itouch.Session) -> None:
    """Its last force stood for as long as that, and then the session went on as if nothing had been."""
    session.run(0.02)
    with pytest.raises(
        itouch.DeviceFaultError, match=r"'stick' was stopped: the loop stood still for 0\.3 s"
    ) as caught:
        session.run(0.1, each=lambda: time.sleep(0.3), every=5)
    assert caught.value.tick == 25
    assert session.status("stick").name == "FAULT"
    session.rearm()
    session.run(0.02)


def test_what_a_machine_has_slept_is_told_by_its_clocks() -> None:
    found = [clock.asleep() for _ in range(50)]  # two clocks, read one after the other
    assert max(found) - min(found) < 0.1
    assert min(found) > -0.1


@pytest.mark.punctual
def test_a_switch_that_was_held_before_a_pause_of_the_script_is_not_held_after_it(tmp_path: Path) -> None:
    """It was for what was left of 80 ms of ticks, however long nobody had said so."""
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    cls = stick()
    read = cls.read

    def unheld(self: Any, reading: Record) -> bool | None:
        new = read(self, reading)
        reading["deadman"] = 0.0
        return new

    cls.read = unheld  # type: ignore[method-assign]
    with itouch.build(tmp_path / "scene.xml", catalog=catalog(cls), clock=itouch.WallClock()) as session:
        session.hold()
        session.enable()
        session.run(0.01)
        session.hold()
        session.run(0.01)
        time.sleep(0.15)
        with pytest.raises(itouch.DeviceFaultError, match="nobody holds the switch"):
            session.run(0.01)
