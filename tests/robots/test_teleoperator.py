"""The teleoperator against LeRobot's published base class; forces that fade."""

from __future__ import annotations

import inspect
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lerobot_without_torch import ROBOTS, found, lerobot

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def feedback() -> Any:
    """Return the room of the fading force, which needs no LeRobot."""
    import importlib.util
    import sys

    found()
    spec = importlib.util.spec_from_file_location(
        "itouch_feedback", ROBOTS / "lerobot_teleoperator_itouch" / "feedback.py"
    )
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@settings(max_examples=50)
@given(st.lists(st.floats(-50, 50), min_size=3, max_size=3), st.floats(0, 10), st.floats(0, 10))
def test_a_force_only_shrinks_with_age_and_is_gone_after_its_time(
    feedback: Any, force: list[float], age: float, later: float
) -> None:
    old, older = (feedback.faded(np.array(force), when) for when in (age, age + later))
    assert np.linalg.norm(older) <= np.linalg.norm(old) <= np.linalg.norm(force)
    assert feedback.faded(np.array(force), feedback.STANDS) == pytest.approx(force)
    assert not feedback.faded(np.array(force), feedback.STANDS + feedback.FADES).any()


def test_what_is_told_once_fades_what_is_too_great_is_shortened_what_is_not_finite_is_nothing(feedback: Any) -> None:
    sent: list[Any] = []
    holds: list[int] = []
    force = feedback.Feedback(sent.append, lambda: holds.append(1), 2.0)
    force.start()
    force.tell(np.array([0.0, 0.0, 10.0]))
    _until(lambda: sent and not sent[-1].any())
    assert max(np.linalg.norm(one) for one in sent) == pytest.approx(2.0)
    sizes = [float(np.linalg.norm(one)) for one in sent]
    assert sizes == sorted(sizes, reverse=True) and holds
    for _ in range(30):
        force.tell(np.array([1.0, 0.0, 0.0]))
        time.sleep(0.01)
    with pytest.raises(ValueError, match="finite"):
        force.tell(np.array([np.nan, 0.0, 0.0]))
    _until(lambda: not sent[-1].any())
    force.close()
    assert force.failure is None


def test_it_is_a_teleoperator_of_lerobot() -> None:
    lerobot()
    from lerobot.teleoperators.config import TeleoperatorConfig
    from lerobot.teleoperators.teleoperator import Teleoperator
    from lerobot.utils.import_utils import make_device_from_device_class
    from lerobot_teleoperator_itouch import ItouchTeleop, ItouchTeleopConfig

    assert issubclass(ItouchTeleop, Teleoperator) and not ItouchTeleop.__abstractmethods__
    for name in Teleoperator.__abstractmethods__:
        theirs, ours = getattr(Teleoperator, name), getattr(ItouchTeleop, name)
        if callable(theirs):
            assert list(inspect.signature(ours).parameters) == list(inspect.signature(theirs).parameters), name
        else:
            assert isinstance(ours, property), name
    assert TeleoperatorConfig.get_choice_class("itouch") is ItouchTeleopConfig
    made = make_device_from_device_class(ItouchTeleopConfig(simulated=True))
    assert isinstance(made, ItouchTeleop) and not made.is_connected


def test_a_simulated_arm_is_read_and_pushed(tmp_path: Any) -> None:
    lerobot()
    from lerobot.utils.errors import DeviceNotConnectedError
    from lerobot_teleoperator_itouch import ItouchTeleop, ItouchTeleopConfig

    arm = ItouchTeleop(ItouchTeleopConfig(simulated=True, force=2.0, calibration_dir=tmp_path))
    with pytest.raises(DeviceNotConnectedError):
        arm.get_action()
    assert arm.feedback_features == dict.fromkeys(("force.x", "force.y", "force.z"), float)
    with arm:
        action = arm.get_action()
        assert action.keys() == arm.action_features.keys() and all(map(np.isfinite, action.values()))
        state, sent = arm._handle.link.state, "arm.sent.wrench"
        greatest, end = 0.0, time.monotonic() + 300
        while greatest < 1.9 and time.monotonic() < end:
            arm.send_feedback({"force.x": 0.0, "force.y": 0.0, "force.z": 30.0})
            time.sleep(0.02)
            arm._handle.link.refresh(state)
            size = float(np.linalg.norm(state[sent][:3]))
            assert size <= 2.0 + 1e-9
            greatest = max(greatest, size)
        assert greatest >= 1.9

        def gone() -> bool:
            arm._handle.link.refresh(state)
            return not state[sent].any()

        _until(gone)
        assert arm.is_connected
    assert not arm.is_connected


def _until(true: Any) -> None:
    end = time.monotonic() + 300
    while not true():
        assert time.monotonic() < end
        time.sleep(0.01)
