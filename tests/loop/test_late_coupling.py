"""An arm behind a wire is pushed by what it felt a while ago: it renders no stiffer than that lets a finger rest."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from third_party_plugins import install

import itouch
from itouch.loop.late_coupling import Late, allowed, ease
from itouch.safety.latch import ENABLED

NUMBERS = itertools.count()
PLUGIN = """
from dataclasses import dataclass
from itouch.plugin import Device, FingerTwin, pose, schema, wrench

@dataclass(frozen=True, slots=True)
class Grip:
    "A grip on a wire."
    resolution: float = schema.quantity("m", low=0.0, high=1e-3, default=1e-5, doc="step of its encoders")

class Stylus(Device):
    "A stylus that answers every few milliseconds."
    Params, Twin = Grip, FingerTwin
    reads, commands = (pose(),), (wrench(force=8.0),)
    max_stiffness, damping = 5000.0, 0.0
    {timing}
    def open(self):
        raise NotImplementedError
    def close(self):
        raise NotImplementedError
    def write(self, command):
        raise NotImplementedError
    def read(self, reading):
        raise NotImplementedError
"""
SCENE = """<itouch version="1.0" xmlns:{own}="urn:itouch:plugin:{own}">
  <materials><material name="steel"><contact stiffness="2000 N/m" {friction}/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 -30 mm" material="steel"/></world>
  <devices><device name="grip" plugin="{own}"/></devices>
  <interaction>
    <probe name="pen" radius="8 mm" pose-from="grip" force-to="grip"/>
    <operator probe="pen" mass="200 g" stiffness="300 N/m" damping="6 N*s/m">
      <motion><to pos="0 0 -8 mm" in="0.2 s"/><to pos="{far} 0 -17 mm" in="0.5 s" hold="3 s"/></motion>
    </operator>
  </interaction>
</itouch>
"""
SLOW = "blocking, period, delay = True, 0.004, 0.002"
Pressed = Callable[..., tuple[itouch.Session, np.ndarray]]


@pytest.fixture
def pressed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Pressed:
    """Return what lets a finger press a block through a stranger's arm, and gives the arm's force of its last 1.5 s."""

    def run(timing: str, friction: str = "", far: int = 0, pushes: str = "") -> tuple[itouch.Session, np.ndarray]:
        own = f"late{next(NUMBERS)}"
        code = PLUGIN.format(timing=timing)
        site = install(tmp_path / own, own, f"[itouch.devices]\n{own} = {own}:Stylus\n", code=code)
        monkeypatch.syspath_prepend(str(site))
        path = tmp_path / f"{own}.xml"
        text = SCENE.format(own=own, friction=friction, far=far)
        if pushes:
            text = text.replace("</devices>", f"{pushes}</devices>").replace('force-to="grip"', 'force-to="push"')
        path.write_text(text, encoding="utf-8")
        arm = "push" if pushes else "grip"
        session = itouch.build(path)
        forces: list[np.ndarray] = []
        session.taps.append(lambda tick: forces.append(session.state[f"{arm}.sent.wrench"][:3].copy()))
        session.run(3.7)
        return session, np.array(forces[-1500:])

    return run


@pytest.mark.parametrize("friction", ["", 'static-friction="0.6" dynamic-friction="0.5"'])
def test_a_finger_rests_on_what_a_slow_arm_renders(pressed: Pressed, friction: str) -> None:
    """Without regard to the delay it bounces, or whirls around the place where it sticks, by newtons."""
    session, forces = pressed(SLOW, friction, far=2 if friction else 0)
    assert np.ptp(forces, axis=0).max() < 0.05
    assert forces[:, 2].mean() > 0.5
    notices = [notice for notice in session.report()["notices"] if "late" in notice]
    assert len(notices) == 1
    assert "'block'" in notices[0]
    assert "instead of 2000" in notices[0]


def test_an_arm_that_answers_at_once_is_as_stiff_as_the_material(pressed: Pressed) -> None:
    session, forces = pressed("period = 0.0")
    depth, force = session.state["pen.penetration"].item(), session.state["pen.force"][2].item()
    assert force / depth == pytest.approx(2000.0, rel=1e-6)
    assert np.ptp(forces, axis=0).max() < 0.05
    assert not [notice for notice in session.report()["notices"] if "late" in notice]


def test_what_is_reckoned_with_is_how_late_pose_and_force_are(pressed: Pressed) -> None:
    session, _ = pressed(SLOW)
    assert 0.004 < session.state["pen.coupling.delay"].item() < 0.012  # an exchange and a hold, each 2 to 6 ms


def test_a_late_tracker_makes_an_arm_that_obeys_at_once_as_soft(pressed: Pressed) -> None:
    session, _ = pressed(
        "blocking, period, delay = True, 0.008, 0.004", pushes=' <device name="push" plugin="usb-arm"/>'
    )
    depth, force = session.state["pen.penetration"].item(), session.state["pen.force"][2].item()
    assert 0.0 < force / depth < 1200.0
    assert 0.004 < session.state["pen.coupling.delay"].item() < 0.012


@given(
    stiffness=st.floats(1.0, 1e5), damping=st.floats(0.0, 50.0), relied=st.floats(0.5, 50.0),
    late=st.floats(5e-4, 0.1), more=st.floats(0.0, 0.1),
)  # fmt: skip
def test_what_is_allowed_is_passive_and_never_grows_with_the_delay(
    stiffness: float, damping: float, relied: float, late: float, more: float
) -> None:
    spring, damper = allowed(stiffness, damping, relied, late)
    assert 0.0 <= spring <= stiffness
    assert 0.0 <= damper <= damping
    assert spring * late + damper <= relied * (1.0 + 1e-9)
    assert allowed(stiffness, damping, relied, late + more)[0] <= spring * (1.0 + 1e-9)


@pytest.mark.parametrize(("field", "value"), [("delay", -5e-4), ("delay", np.nan), ("lost", 2.0), ("lost_object", 9)])
def test_a_session_with_a_delay_that_cannot_be_is_refused(
    pressed: Pressed, tmp_path: Path, field: str, value: float
) -> None:
    session, _ = pressed(SLOW)
    session.state[f"pen.coupling.{field}"] = value
    session.save(tmp_path / "forged.itouch")
    with pytest.raises(itouch.SessionError, match=f"pen.coupling.{field}"):
        itouch.restore(tmp_path / "forged.itouch")


def test_a_reading_that_is_very_late_softens_a_touch_step_by_step() -> None:
    """A stiffness that fell at once would take the finger's force away in a tick."""
    delay, lost, lost_object = np.zeros(1), np.zeros(1), np.full(1, -1)
    coupling, stiffness, damping = np.array([[2000.0, 0.0]]), np.empty(1), np.empty(1)
    before = allowed(2000.0, 0.0, 6.0, 0.5e-3)[0]
    for _ in range(2000):
        told = (np.array([200]), np.array([100]), np.array([100]), np.array([ENABLED]))
        ease(*told, Late(delay, lost, lost_object), np.zeros(1, int), coupling, 6.0, 1e-3, stiffness, damping)
        assert stiffness[0] >= 0.979 * before
        before = stiffness[0]
    assert before == pytest.approx(6.0 / 0.1005, rel=0.01) and lost_object[0] == 0
