"""Time that a late loop leaves out: a real finger has gone on touching, and a real display heating, meanwhile."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.loop import DeviceFaultError
from itouch.loop.device_runner import Status
from itouch.plugin import Device, Modality, Record, World, deadman, pose, wrench
from itouch.plugin.discovery import Catalog, Found, find
from itouch_thermal.heat import LEFT_OUT

SCENE = """<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal" xmlns:asked="urn:itouch:plugin:asked">
  <materials><material name="wood"><contact stiffness="0.5 N/mm"/>
    <thermal:material conductivity="0.12 W/(m*K)" specific-heat="2400 J/(kg*K)" density="600 kg/m^3"/></material></materials>
  <world><box name="block" size="4 4 2 cm" pos="0 0 1 cm" material="wood"/></world>
  <devices><device name="stick" plugin="stick" twin="no"/></devices>
  <interaction>
    <probe name="finger" radius="5 mm" pose-from="stick" force-to="stick"/>
    <thermal:heat probe="finger"/>{more}
  </interaction>
</itouch>
"""


@dataclass(frozen=True)
class Nothing:
    """No parameters."""


class Stick(Device):
    """A stick that stands where it was put."""

    Params = Nothing
    reads = (pose(), deadman())
    commands = (wrench(force=3.0),)
    second_opener = True
    height = 0.03

    def open(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""

    def read(self, reading: Record) -> bool:
        reading["deadman"] = 1.0
        reading["pose"] = (0.0, 0.0, Stick.height, 1.0, 0.0, 0.0, 0.0)
        return True


class Asked(Modality):
    """Keeps for how long it was told that nobody looked."""

    Params = Nothing
    heard: list[float]
    fails = False

    def compile(self, name: str, params: Any, world: World) -> str:
        Asked.heard = []
        return name

    def reset(self, model: str, state: Record) -> None:
        """Nothing."""

    def update(self, model: str, state: Record, period: float) -> None:
        """Nothing."""

    def on_skipped_time(self, model: str, state: Record, seconds: float) -> None:
        self.heard.append(seconds)
        if self.fails:
            raise RuntimeError("there is no time")


class Entry:
    """What stands for an entry point."""

    def __init__(self, value: type) -> None:
        self.value, self._loaded = value.__name__, value

    def load(self) -> type:
        return self._loaded


def catalog() -> Catalog:
    def finder(group: str) -> dict[str, Found]:
        found: dict[str, Any] = dict(find(group))
        for name, cls, own in (("stick", Stick, "itouch.devices"), ("asked.told", Asked, "itouch.modalities")):
            if group == own:
                found[name] = Found(name, f"itouch-{name.partition('.')[0]}", "1.0", Entry(cls))  # type: ignore[arg-type]
        return found

    return Catalog(finder)


@pytest.fixture
def sessions(tmp_path: Path) -> Any:
    """Return what builds a session on a stick that stands for hardware, and begins it."""
    Stick.height, Asked.fails = 0.03, False
    begun = []

    def begin(more: str = "") -> Any:
        path = tmp_path / "scene.xml"
        path.write_text(SCENE.format(more=more))
        session = itouch.build(path, catalog=catalog())
        session.enable()
        begun.append(session)
        return session

    yield begin
    for session in begun:
        session.close()


def lower(session: Any, height: float) -> None:
    """Lower the stick within 20 ms."""
    for place in np.linspace(Stick.height, height, 20):
        Stick.height = float(place)
        session.run(0.001)


@pytest.mark.parametrize("height", [0.03, 0.0235])
def test_the_model_finger_is_as_if_the_ticks_had_been_run(sessions: Any, height: float) -> None:
    """In air, and on wood."""
    two = []
    for left in (False, True):
        session = sessions()
        session.run(0.05)
        lower(session, height)
        session.run(0.1)
        if left:
            session.leave_out(0.2, running=True)
        else:
            session.run(0.2)
        two.append([session.state[f"heat.{field}"].copy() for field in ("finger", "objects", "since", "desired")])
        Stick.height = 0.03
    assert (float(two[0][3]) > 10.0) is (height < 0.025)
    for run, left in zip(*two, strict=True):
        np.testing.assert_array_equal(run, left)


def test_the_velocity_is_not_that_of_a_tick(sessions: Any) -> None:
    """A finger that has moved by 1 mm in 0.2 s has not moved so in a millisecond."""
    session = sessions()
    session.run(0.05)
    Stick.height -= 1e-3
    session.leave_out(0.2, running=True)
    session.run(0.002)
    assert float(abs(session.state["finger.velocity"]).max()) < 0.01


def test_after_a_moment_the_finger_is_thought_to_move_on(sessions: Any) -> None:
    """It went down at 0.1 m/s, and does so still: neither faster for the places in between, nor not at all."""
    session = sessions()
    session.run(0.05)
    for _ in range(50):
        Stick.height -= 1e-4
        session.run(0.001)
    Stick.height -= 31e-4
    session.leave_out(0.030, running=True)
    for _ in range(2):
        session.run(0.001)
        assert float(session.state["finger.velocity"][2]) == pytest.approx(-0.1, rel=0.2)
        Stick.height -= 1e-4


def test_what_is_made_up_for_is_bounded(sessions: Any) -> None:
    """A pause of an hour may not keep a loop from its first tick: its guardian would take it for one that hangs."""
    fingers = []
    for pause in (LEFT_OUT, 3600.0):
        session = sessions()
        session.run(0.05)
        session.leave_out(pause)
        fingers.append(session.state["heat.finger"].copy())
        assert int(session.state["stick.missed"]) == round(pause * 1e3)
    np.testing.assert_array_equal(*fingers)


def test_a_modality_is_told_once_for_how_long(sessions: Any) -> None:
    session = sessions("<asked:told/>")
    session.run(0.01)
    session.leave_out(0.0004, running=True)  # less than a tick
    assert Asked.heard == []
    session.leave_out(0.0301, running=True)
    session.leave_out(2.0)
    assert Asked.heard == pytest.approx([0.03, 2.0])


def test_an_error_of_a_modality_told_of_skipped_ticks_is_a_fault(sessions: Any) -> None:
    session = sessions("<asked:told/>")
    session.run(0.01)
    Asked.fails = True
    with pytest.raises(DeviceFaultError, match=r"on_skipped_time.*there is no time"):
        session.leave_out(0.03, running=True)
    assert session.status("stick") is not Status.ENABLED
    (fault,) = session.report()["faults"]
    assert fault["safe"]["reached"]


def test_a_loop_that_was_late_says_so(sessions: Any) -> None:
    """Through the pacing of a run in real time, whose third tick comes 50 ms late."""
    session = sessions("<asked:told/>")
    ticks = iter([0.0, 0.0, 0.05])
    session.clock = _Late(ticks)
    session.run(0.006)
    assert Asked.heard == pytest.approx([0.05])


class _Late:
    """A clock in real time that is late as it is told to be."""

    pace = "real"

    def __init__(self, lateness: Any) -> None:
        self._lateness = lateness

    def start(self, period: float) -> None:
        """Nothing."""

    def wait(self) -> float:
        return float(next(self._lateness, 0.0))


def test_a_recording_replays_with_it(sessions: Any, tmp_path: Path) -> None:
    session = sessions()
    session.record(tmp_path / "late.mcap")
    session.run(0.05)
    lower(session, 0.0235)
    session.run(0.1)
    session.leave_out(0.25, running=True)
    session.run(0.1)
    finger = session.state["heat.finger"].copy()
    session.close()
    recording = itouch.read(tmp_path / "late.mcap")
    assert [(one["tick"], one["seconds"]) for one in recording.left_out] == [(170, 0.25)]
    seen: dict[str, np.ndarray] = {}

    def keep(replay: Any) -> None:
        seen["finger"] = replay.session.state["heat.finger"].copy()
        seen["missed"] = replay.session.state["stick.missed"].copy()

    outcome = itouch.replay(tmp_path / "late.mcap", catalog=catalog(), each=keep)
    assert outcome.ticks >= 270
    assert outcome.mismatches == 0
    np.testing.assert_array_equal(seen["finger"], finger)
    assert int(seen["missed"]) == 250


def test_twins_have_stood_still() -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    session.run(0.01)
    before = {name: view.tobytes() for name, view in session.state.items() if not name.endswith(".missed")}
    session.leave_out(0.2, running=True)
    assert {name: view.tobytes() for name, view in session.state.items() if not name.endswith(".missed")} == before
    session.close()
