"""A recording moves the hand in another scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from running import advance

import itouch

SCENE = """<itouch version="1.0">
  <materials><material name="foam"><contact stiffness="0.3 N/mm" damping="1 N*s/m"/></material></materials>
  <world><box name="pad" size="80 80 20 mm" pos="0 0 10 mm" material="foam"/></world>
  <devices><device name="other-arm" plugin="usb-arm"/></devices>
  <interaction>
    <probe name="thumb" radius="8 mm" pose-from="other-arm" force-to="other-arm"/>
    <operator probe="thumb"><motion file="{file}" recorded-probe="{probe}"/></operator>
  </interaction>
</itouch>
"""


@pytest.fixture
def recorded(scenes: Path) -> Path:
    session = itouch.build(scenes / "first_touch.xml")
    session.record(scenes / "r.mcap")
    session.run()
    session.close()
    return scenes


def test_the_hand_goes_where_the_finger_was(recorded: Path) -> None:
    (recorded / "other.xml").write_text(SCENE.format(file="r.mcap", probe="finger"), encoding="utf-8")
    session = itouch.build(recorded / "other.xml")
    assert session.scripted
    there = itouch.read(recorded / "r.mcap")["finger.hip"]
    seen = []
    session.taps.append(lambda tick: seen.append(session.state["thumb.hand.target"].copy()))
    session.run()
    assert len(seen) == len(there)  # the first tick finds out that all is ready
    assert np.allclose(np.array(seen), there, atol=1e-12)
    assert np.abs(session.state["thumb.hip"] - there[-1]).max() < 0.02
    assert session.report()["contacts"][0]["object"] == "pad"


def test_a_saved_session_holds_the_motion_of_its_file(recorded: Path) -> None:
    (recorded / "other.xml").write_text(SCENE.format(file="r.mcap", probe="finger"), encoding="utf-8")
    straight = itouch.build(recorded / "other.xml")
    advance(straight, 700)
    straight.save(recorded / "s.itouch")
    (recorded / "s.xml").write_text(straight.to_xml(), encoding="utf-8")
    (recorded / "r.mcap").unlink()
    advance(straight, 1500)
    for name in ("s.itouch", "s.xml"):
        again = itouch.restore(recorded / name)
        advance(again, 1500)
        assert again.state == straight.state


@pytest.mark.parametrize(
    ("file", "probe", "code"),
    [("none.mcap", "finger", "bad-recording"), ("first_touch.xml", "finger", "bad-recording"),
     ("r.mcap", "fingre", "bad-recording"), ("../r.mcap", "finger", "outside-folder")],
)  # fmt: skip
def test_a_file_that_cannot_move_a_hand_is_refused(recorded: Path, file: str, probe: str, code: str) -> None:
    (recorded / "other.xml").write_text(SCENE.format(file=file, probe=probe), encoding="utf-8")
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(recorded / "other.xml")
    assert code in [problem.code for problem in caught.value.problems]
