"""A scene that follows another one has its hardware, and only that: each device by its name."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

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
