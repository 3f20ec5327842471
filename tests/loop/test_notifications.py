"""An engine tells who listens, each at its moment and in order, also without a session around it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from shipped import SCENES

from itouch.loop import DeviceFaultError, Engine
from itouch.plugin.discovery import Catalog
from itouch.safety import Trip
from itouch.scene import load
from itouch.session import Session
from itouch.world import Model

Heard = list[tuple[str, object]]


def listened(engine: Engine) -> Heard:
    """Let all that an engine tells be noted: the name of the list, and what its listeners were given."""
    heard: Heard = []

    def note(name: str, *given: object) -> None:
        heard.append((name, given[0] if given else None))

    for name in ("begin", "act", "outside", "left_out", "fault", "safe", "closed"):
        getattr(engine.on, name).append(partial(note, name))
    return heard


@pytest.fixture
def engine() -> Engine:
    catalog = Catalog()
    return Engine(Model.of(load(SCENES / "first_touch.xml", catalog), catalog))


def test_each_moment_is_told_once_and_in_order(engine: Engine) -> None:
    heard = listened(engine)
    ticks: list[int] = []
    engine.on.tick.append(ticks.append)
    engine.run(0.02)
    assert heard == [("begin", None), ("act", None), ("outside", "enable")]
    assert ticks == list(range(20))
    heard.clear()
    engine.enable()
    assert not heard, "twins that are enabled already are left alone"
    engine.leave_out(0.5)
    engine.park()
    engine.close()
    assert heard == [("left_out", 0.5), ("outside", "park"), ("safe", None), ("closed", None)]
    heard.clear()
    engine.release()
    assert not heard, "giving devices back is no end"


def test_a_fault_is_told_before_anything_is_safe_and_what_a_listener_raises_is_held_back(engine: Engine) -> None:
    engine.run(0.01)
    heard = listened(engine)
    speed: list[bool] = []

    def fails(fault: DeviceFaultError) -> None:
        speed.append(engine.runners[0].latch.enabled)
        raise OSError("no space left")

    engine.on.fault.insert(0, fails)
    fault = DeviceFaultError("arm", engine.ticks, Trip.DEVICE_ERROR, "was unplugged")
    engine.make_safe(fault)
    assert speed == [True] and not engine.runners[0].latch.enabled
    assert heard == [("fault", fault), ("safe", None)]
    assert "while it was reported: OSError: no space left" in fault.__notes__


def test_a_session_overrides_nothing_of_the_engine_but_the_line_of_progress() -> None:
    own = {name for name in vars(Session) if not name.startswith("__") and name in vars(Engine)}
    assert own == {"run"}


def test_who_listens_may_leave_while_it_is_told(engine: Engine, tmp_path: Path) -> None:
    heard: list[str] = []

    def once() -> None:
        heard.append("once")
        engine.on.begin.remove(once)

    always: Callable[[], None] = lambda: heard.append("always")  # noqa: E731
    engine.on.begin.extend((once, always))
    engine.run(0.002)
    engine.run(0.002)
    assert heard == ["once", "always", "always"]
