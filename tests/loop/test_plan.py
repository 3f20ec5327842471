"""The plan of a tick: what its steps declare is what they do, each command has one writer, safety can't be moved."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.joining import is_newest
from itouch.loop.clock import now
from itouch.loop.plan import Plan, PlanError
from itouch.loop.tick_step import Step
from itouch.plugin import Record, TwinInputs
from itouch.session import Session
from itouch_evidence.surface.draw import Wire
from itouch_tools.cli.__main__ import main
from itouch_usb_arm.arm import UsbArmTwin


def _nothing(tick: int, ready: bool) -> None:
    """Do nothing."""


#: What a shipped scene is built with if its table is behind a wire.
WIRED = "four_materials.xml, its table behind a wire"


@pytest.fixture(
    scope="module", params=["first_touch.xml", "moving.xml", "two_fingers.xml", "four_materials.xml", WIRED]
)
def session(request: pytest.FixtureRequest) -> Iterator[Session]:
    """Return a session of a shipped scene, which nobody records: without a surface, with one, and with a late one."""
    scene, _, wired = request.param.partition(",")
    found = itouch.build(SCENES / scene, seed=4, catalog=Wire(7e-3, 4e-3).catalog() if wired else None)
    found.records = False
    yield found
    found.close()


def _seen(session: Session, ticks: int) -> dict[str, set[str]]:
    """Run some ticks step by step as the engine does; return which fields each step was seen to change."""
    seen: dict[str, set[str]] = {step.name: set() for step in session.plan.steps}
    state = session.state
    for _ in range(ticks):
        tick, ready = int(state["tick"]), bool(state["ready"])
        for step in session.plan.steps:
            before = {name: view.tobytes() for name, view in state.items()}
            step.work(tick, ready)
            seen[step.name] |= {name for name, was in before.items() if state[name].tobytes() != was}
        state["tick"] = tick + 1
    return seen


def test_steps_change_only_what_they_declare(session: Session) -> None:
    if "finger.surface.variance" in session.state:  # its sensor is a loud one: what is kept of it changes, too
        session.state["finger.surface.variance"], session.state["finger.surface.heard"] = 1e-3, 1.0
    session.run(0.1)
    found: dict[str, set[str]] = {step.name: set() for step in session.plan.steps}
    for _ in range(6):  # in several phases of the scene
        for name, fields in _seen(session, 15).items():
            found[name] |= fields
        session.run(0.4)
    for step in session.plan.steps:
        undeclared = found[step.name] - set(step.written(session.state)) - set(step.amends)
        assert not undeclared, f"'{step.name}' wrote {sorted(undeclared)}"
    moved = {name for fields in found.values() for name in fields}
    assert any(".command." in name for name in moved)  # the phases were not all idle


def test_each_command_has_one_writer_and_none_is_forgotten(session: Session) -> None:
    commands = {name for name in session.state if ".sent." in name}
    assert commands <= set(session.plan.writers)
    for name in commands:
        assert session.plan.writers[name] == f"guard {name.split('.')[0]}"


def test_safety_stands_behind_each_read_and_before_the_twins_move(session: Session) -> None:
    names = session.plan.names
    for device in session.model.devices.values():
        assert names.index(f"watch {device.name}") == names.index(f"read {device.name}") + 1
        if device.commands:
            writers = [
                names.index(who) for what, who in session.plan.writers.items() if what.startswith(f"{device.name}.c")
            ]
            assert max(writers, default=-1) < names.index(f"guard {device.name}") < names.index(f"twin {device.name}")


def test_two_writers_of_a_command_are_refused() -> None:
    steps = [Step("one", _nothing, writes=("arm.command.*",)), Step("two", _nothing, writes=("arm.command.wrench",))]
    with pytest.raises(PlanError, match="'arm.command.wrench' is written by 'one' and by 'two'"):
        Plan(steps, ["arm.command.wrench"])


def test_unmapped_values_are_hidden() -> None:
    plan = Plan([Step("one", _nothing, ("a", "b.*", "*.c", "d"), ("*",))], ["a", "x.c"])
    assert plan.steps[0].reads == ("a", "*.c")
    assert list(plan.steps[0].written(["a", "x.c"])) == ["a", "x.c"]


def test_every_step_is_timed() -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    session.run(0.1)
    session.close()
    assert session.times.parts == session.plan.names
    assert all(figures["p50"] for figures in session.times.split().values())


def test_inspect_prints_the_plan(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["inspect", str(SCENES / "first_touch.xml"), "--plan"]) == 0
    shown = capsys.readouterr().out
    for step in ("read arm", "watch arm", "contact finger", "events", "guard arm", "finger finger", "twin arm"):
        assert f"\n  {step} " in shown
    assert "a whole tick" in shown


@pytest.mark.parametrize("name", ["materials.xml", "handbook.xml"])
def test_a_plan_without_steps_is_said_in_a_sentence(capsys: pytest.CaptureFixture[str], name: str) -> None:
    assert main(["inspect", str(SCENES / name), "--plan"]) == 0
    assert "a tick has no steps, because the scene has no device and no modality" in capsys.readouterr().out


WOOD = '<materials><material name="m"><contact stiffness="1 N/mm"/></material></materials>'
LID = '<sphere name="lid" radius="5 mm" material="m"><motion><to pos="0 0 9 mm" in="1 s"/></motion></sphere>'


def test_a_tick_of_one_step_is_timed_as_this_step(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    scene = tmp_path / "lid.xml"
    scene.write_text(f'<itouch version="1.0">{WOOD}<world>{LID}</world></itouch>', encoding="utf-8")
    session = itouch.build(scene)
    session.run(1.0)
    session.close()
    assert session.times.split()["move objects"]["p50"]
    assert main(["inspect", str(scene), "--plan"]) == 0
    shown = capsys.readouterr().out
    assert "the only step of a tick" in shown
    assert " - " not in shown


def test_the_plan_of_a_scene_that_stops_is_shown_with_what_stopped_it(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    scene = tmp_path / "stops.xml"
    fault = '<fault device="arm" kind="disconnect" at="0.5 s"/>'
    scene.write_text(f'<itouch version="1.0"><include file="itouch:first_touch.xml"/>{fault}</itouch>', "utf-8")
    assert main(["inspect", str(scene), "--plan"]) == 0
    shown = capsys.readouterr()
    assert "\n  read arm " in shown.out
    assert "until the scene stopped: device 'arm' failed: disconnected (an injected fault) at tick 500" in shown.out
    assert not shown.err


def test_joined_steps_do_what_they_do_alone(session: Session) -> None:
    assert any(len(names) > 1 for names in session.plan.pieces)  # some are one call from Python
    session.run(0.05)
    start = session.state.tobytes()
    for _ in range(400):
        tick, ready = int(session.state["tick"]), bool(session.state["ready"])
        before = session.state.tobytes()
        session.plan.run(tick, ready)
        joined = session.state.tobytes()
        session.adopt(before)
        for step in session.plan.steps:
            step.work(tick, ready)
        assert session.state.tobytes() == joined
        session.state["tick"] = tick + 1
    assert session.state.tobytes() != start


def test_timed_steps_do_what_they_do_untimed(session: Session) -> None:
    stamps = np.zeros(1 + len(session.plan.steps))
    for _ in range(50):
        tick, ready = int(session.state["tick"]), bool(session.state["ready"])
        before = session.state.tobytes()
        session.plan.run(tick, ready)
        untimed = session.state.tobytes()
        session.adopt(before)
        stamps[0] = now()
        session.plan.run_timed(tick, ready, stamps)
        assert session.state.tobytes() == untimed
        assert (np.diff(stamps) >= 0.0).all() and stamps[-1] <= now()
        session.state["tick"] = tick + 1


def test_a_twin_whose_heir_has_a_step_of_its_own_runs_that() -> None:
    class Own(UsbArmTwin):
        def step(self, state: Record, command: Record, touch: TwinInputs, period: float) -> None:
            """Stand still."""

    assert is_newest(UsbArmTwin, "bound_step", "step")
    assert not is_newest(Own, "bound_step", "step")
