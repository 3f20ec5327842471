"""Arms that a person leads: in a session, without a window, and what is said when nobody leads."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import itouch
from itouch.arms import Gamepad, Keyboard, Mouse
from itouch.arms import interactive as arms_led
from itouch.arms.gamepad import Pad, PadError
from itouch.plugin import DeviceError
from itouch.servo import ServoError
from itouch.testing import DeviceTests
from itouch.world.model import led
from itouch_tools.cli import arm_input, main

SCENE = """<itouch version="1.0">
  <materials><material name="wood"><contact stiffness="0.8 N/mm"/></material></materials>
  <world><box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="wood"/></world>
  <devices><device name="arm" plugin="{plugin}"><mount pos="10 0 0 mm"/></device></devices>
  <interaction><probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>{operator}</interaction></itouch>"""
OPERATOR = """<operator probe="finger"><motion><to pos="0 0 40 mm" in="0.1 s"/><to pos="0 0 26 mm" in="0.3 s" hold="0.2 s"/>
  </motion></operator>"""


class TestMouse(DeviceTests):
    device, name = Mouse, "mouse"


class TestKeyboard(DeviceTests):
    device, name = Keyboard, "keyboard"


class TestGamepad(DeviceTests):
    device, name = Gamepad, "gamepad"


@pytest.fixture(params=["mouse", "keyboard", "gamepad"])
def plugin(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def scene(folder: Path, plugin: str, operator: str = "") -> Path:
    path = folder / f"{plugin}.xml"
    path.write_text(SCENE.format(plugin=plugin, operator=operator))
    return path


def test_a_scene_without_an_operator_has_a_hand_to_lead(tmp_path: Path, plugin: str) -> None:
    session = itouch.build(scene(tmp_path, plugin))
    np.testing.assert_allclose(session.state["finger.hand.position"], (0.01, 0.0, 0.05), atol=1e-12)
    ((probe, arm),) = led(session.model)
    assert (probe.name, arm.name, session.scripted) == ("finger", "arm", False)
    session.steer("finger", (-0.01, 0.0, -0.028))
    session.run(0.5)
    assert session.state["finger.hand.target"] == pytest.approx((0.0, 0.0, 0.022))
    assert 0.3 < session.state["arm.sent.wrench"][2] < 2.0  # the block holds the finger up
    assert session.state["finger.hip"][2] > 0.0225


def test_such_a_session_is_saved_and_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    session = itouch.build(scene(tmp_path, "mouse"))
    session.steer("finger", (0.0, 0.0, -0.03))
    session.run(0.3)
    session.save(tmp_path / "led.itouch")
    again = itouch.restore(tmp_path / "led.itouch")
    for one in (session, again):
        one.steer("finger", (0.004, 0.0, 0.0))
        one.run(0.2)
    assert session.state.tobytes() == again.state.tobytes()


def test_without_a_window_it_follows_the_operator_and_says_so(
    tmp_path: Path, plugin: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(scene(tmp_path, plugin, OPERATOR)), "--headless", "--pace", "fast"]) == 0
    shown = capsys.readouterr()
    assert "block" in shown.out
    assert "the finger follows its <operator>" in shown.err


def test_without_an_input_device_there_is_one_sentence_and_exit_code_2(
    tmp_path: Path, plugin: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("itouch.arms.gamepad.evdev.find", lambda: (None, []))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    for words in (["--headless"], ["--headless", "--for", "1s", "--pace", "fast"]):
        assert main(["run", str(scene(tmp_path, plugin)), *words]) == 2
        error = capsys.readouterr().err
        assert "nobody leads the finger on arm 'arm'" in error
        assert "<motion>" in error
        assert "Traceback" not in error


def test_interactive_arms_are_refused_as_hardware(
    tmp_path: Path, plugin: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(scene(tmp_path, plugin)), "--twin", "none"]) == 2
    assert "it is twin only" in capsys.readouterr().err
    cls = {"mouse": Mouse, "keyboard": Keyboard, "gamepad": Gamepad}[plugin]
    with pytest.raises(DeviceError, match="twin only"):
        cls(cls.Params()).open()


def test_a_gamepad_leads_without_a_window_as_fast_as_its_arm_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, said = [0.0], []

    class Handle:
        def command(self, what: str, value: object) -> None:
            said.append((what, value))

    class Sticks:
        device, name = None, "fake"
        leftx, lefty, righty = 1.0, 0.5, -1.0

        def open(self) -> None:
            pass

        def close(self) -> None:
            said.append(("closed", None))

    session = itouch.build(scene(tmp_path, "gamepad"))
    monkeypatch.setattr("itouch.arms.gamepad.find_pad", lambda: Pad(Sticks()))
    monkeypatch.setattr(arm_input.time, "monotonic", lambda: clock[0])
    gamepad = arm_input.without_window(session.model, real=True)
    assert gamepad is not None
    for _ in range(3):
        clock[0] += 0.05
        gamepad.lead(Handle())  # type: ignore[arg-type]
    clock[0] += 5.0  # nothing was asked for so long: no leap
    gamepad.lead(Handle())  # type: ignore[arg-type]
    gamepad.close()
    steps = [value["step"] for what, value in said[:-1]]  # type: ignore[index]
    np.testing.assert_allclose(steps, [(0.003, -0.0015, 0.003)] * 3 + [(0.006, -0.003, 0.006)])
    assert said[-1] == ("closed", None)


def test_a_session_that_has_ended_meanwhile_is_no_error(tmp_path: Path) -> None:
    class Ended:
        def command(self, what: str, value: object) -> None:
            raise ServoError("the session has ended")

    pad = SimpleNamespace(device=None, leftx=1.0, lefty=0.0, righty=0.0, open=lambda: None, close=lambda: None)
    arm_input.GamepadInput(Pad(pad), "finger", 0.06).lead(Ended())  # type: ignore[arg-type]


def test_what_is_attached_is_told_with_the_reason_if_it_is_of_no_use(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> Pad:
        raise PadError("none is attached")

    monkeypatch.setattr(arms_led, "find_pad", none)
    (pad,) = Gamepad.discover()
    assert (pad.usable, pad.note) == (False, "none is attached")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    for cls in (Mouse, Keyboard):
        (found,) = cls.discover()
        assert not found.usable and "no display" in found.note
    monkeypatch.setenv("DISPLAY", ":7")
    for cls in (Mouse, Keyboard):
        (found,) = cls.discover()
        assert found.usable and ":7" in found.where


@pytest.mark.parametrize("operator", ["", '<operator probe="other"/>'])
def test_all_probes_on_one_arm_follow_the_finger_that_a_person_leads(tmp_path: Path, operator: str) -> None:
    """The second got a hand of its own, which nobody led."""
    text = SCENE.format(plugin="mouse", operator=operator).replace(
        "<probe ", '<probe name="other" radius="8 mm" pose-from="arm"/><probe ', 1
    )
    (tmp_path / "scene.xml").write_text(text, encoding="utf-8")
    session = itouch.build(tmp_path / "scene.xml")
    assert [probe.name for probe, _ in led(session.model)] == ["other"]
    for _ in range(40):
        session.steer("other", (0.0, 1e-4, 0.0))
        session.tick()
    first, second = (session.state[f"{name}.hip"] for name in ("other", "finger"))
    assert np.array_equal(first, second)
    with pytest.raises(itouch.ItouchError, match="is not moved by an operator twin"):
        session.steer("finger", (0.0, 1e-4, 0.0))
