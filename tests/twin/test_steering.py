"""A hand that is led by mouse or keys, and gives itself back to its script."""

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.loop.engine import EngineError

SCENE = SCENES / "first_touch.xml"


def test_a_steered_hand_goes_where_it_is_led_and_its_script_waits():
    session = itouch.build(SCENE)
    session.run(0.5)
    ticks = int(session.state["finger.hand.ticks"])
    before = session.state["finger.hand.target"].copy()
    session.steer("finger", (0.02, -0.01, 0.005))
    session.run(0.3)
    moved = session.state["finger.hand.target"] - before
    np.testing.assert_allclose(moved, (0.02, -0.01, 0.005), atol=1e-12)
    assert int(session.state["finger.hand.ticks"]) == ticks
    session.steer("finger", None)
    session.run(0.3)
    assert not session.state["finger.hand.offset"].any()
    assert int(session.state["finger.hand.ticks"]) > ticks


def test_a_hand_that_is_taken_waits_where_it_is_until_it_is_given_back():
    session = itouch.build(SCENE)
    session.run(0.5)
    before, ticks = session.state["finger.hand.target"].copy(), int(session.state["finger.hand.ticks"])
    session.steer("finger", (0.0, 0.0, 0.0))
    session.run(0.2)
    session.steer("finger", (0.002, 0.0, 0.0))
    session.steer("finger", (-0.002, 0.0, 0.0))
    session.run(0.2)
    np.testing.assert_allclose(session.state["finger.hand.target"], before, atol=1e-3)
    assert int(session.state["finger.hand.ticks"]) == ticks
    session.steer("finger", None)
    session.run(0.2)
    assert int(session.state["finger.hand.ticks"]) == ticks + 200


def test_a_steered_hand_never_jumps():
    session = itouch.build(SCENE)
    session.run(0.2)
    session.steer("finger", (1.0, 0.0, 0.0))
    last = session.state["finger.hand.target"].copy()
    for _ in range(50):
        session.tick()
        assert np.linalg.norm(session.state["finger.hand.target"] - last) <= 0.3e-3 * (1 + 1e-9)
        last = session.state["finger.hand.target"].copy()


@pytest.mark.parametrize("step", [(float("nan"), 0.0, 0.0), (float("inf"), 0.0, 0.0)])
def test_what_is_no_number_does_not_steer(step):
    session = itouch.build(SCENE)
    with pytest.raises(ValueError, match="finite"):
        session.steer("finger", step)


def test_an_unknown_probe_is_named():
    session = itouch.build(SCENE)
    with pytest.raises(EngineError, match="thumb"):
        session.steer("thumb", (0.0, 0.0, 0.0))


def test_a_scene_without_objects_runs():
    text = """<itouch version="1.0"><devices><device name="arm" plugin="usb-arm"/></devices>
      <interaction><probe name="finger" pose-from="arm" force-to="arm"/></interaction></itouch>"""
    from itouch.plugin.discovery import Catalog
    from itouch.scene import loads

    session = itouch.build(loads(text.encode(), Catalog()))
    session.run(0.05)
    assert session.ticks == 50
