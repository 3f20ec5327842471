"""A scene that follows another one has its hardware, and only that; a trial begins when that gives its full force."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch.plugin import Field, Record
from itouch_tools.study import scene_switching


def test_each_device_that_is_real_is_handed_to_the_next_session_when_all_else_has_been(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(scene_switching, "_same_hardware", lambda session, before: None)
    done = list[object]()

    def session(*names: str) -> Any:
        runners = [
            SimpleNamespace(
                model=SimpleNamespace(name=name, twin=name == "virtual"),
                lifecycle=SimpleNamespace(name=name, take_over=lambda other, name=name: done.append((name, other))),
            )
            for name in names
        ]
        model = SimpleNamespace(devices=dict.fromkeys(names), modalities=[], probes=[])
        return SimpleNamespace(
            state=Record.of([Field("tick", "i8"), Field("arm.status", "i8")]), model=model, runners=runners, guarded=(),
            adopt=lambda data: done.append("state"), settle=lambda always: done.append("settled"),
        )  # fmt: skip

    before, after = session("arm", "table", "virtual"), session("table", "virtual", "arm")
    before.guarded = ("arm", "table")
    scene_switching.succeed(after, before)
    lifecycles = {runner.model.name: runner.lifecycle for runner in before.runners}
    assert done == ["state", "settled", ("table", lifecycles["table"]), ("arm", lifecycles["arm"])]
    assert after.guarded == ("arm", "table")


@pytest.mark.parametrize("ready", [False, True])
def test_a_trial_begins_when_hardware_that_is_driven_gives_its_full_force(ready: bool) -> None:
    """Nobody waits for a twin, for a device that takes no commands, or for one that is off."""
    done = list[str]()
    state = {"ready": np.array(ready)} | {
        f"{name}.ramp": np.array(share) for name, share in (("arm", 0.4), ("virtual", 0.0), ("eye", 0.0), ("off", 0.0))
    }
    runners = [
        SimpleNamespace(
            model=SimpleNamespace(name=name, twin=name == "virtual", commands=() if name == "eye" else ("wrench",)),
            latch=SimpleNamespace(enabled=name != "off"),
        )
        for name in ("arm", "virtual", "eye", "off")
    ]

    def run(until: Callable[[], bool]) -> None:
        for _ in range(10):
            if until():
                return
            done.append("tick")
            state["ready"][...] = True
            state["arm.ramp"] += 0.2
        raise AssertionError("it would wait for ever")

    rig: Any = SimpleNamespace(
        session=SimpleNamespace(state=state, runners=runners), run=run, hold=lambda: done.append("held")
    )
    scene_switching.SceneSwitcher.begin(rig)
    assert done == ["tick"] * 3 + ["held"]
