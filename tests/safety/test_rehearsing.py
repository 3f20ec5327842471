"""Before the first tick all that checks and limits a device is gone through once, on scratch State."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable

import pytest
from parts import ARM, PERIOD, PLATE, TABLE, Channels, Fake, model, state

from itouch.safety import Supervisor
from itouch.safety.rehearsing import rehearse

ENTRANCES = ("look", "watch_placed", "guard", "glance", "fault")


@pytest.mark.parametrize("channels", [ARM, TABLE, PLATE], ids=["arm", "table", "plate"])
def test_every_entrance_is_gone_through_and_no_device_is_made(
    channels: Channels, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, called = [], dict.fromkeys(ENTRANCES, 0)

    class Watched(Fake):
        def __init__(self, *args: object, **more: object) -> None:
            made.append(self)
            super().__init__(*args, **more)

    def counted(name: str) -> Callable[..., object]:
        kept = getattr(Supervisor, name)

        def through(*words: object) -> object:
            called[name] += 1
            return kept(*words)

        return through

    for name in ENTRANCES:
        monkeypatch.setattr(Supervisor, name, counted(name))
    one = model(channels, cls=Watched)
    scratch = state(one)
    before = [dict(vars(monitor)) for monitor in one.monitors]
    rehearse(one, scratch, PERIOD)
    assert not made
    for monitor, was in zip(one.monitors, before, strict=True):  # they are those of the run
        more = set(vars(monitor)) - set(was)  # constants that are put together once
        assert all(isinstance(inspect.getattr_static(type(monitor), name), functools.cached_property) for name in more)
        assert {name: vars(monitor)[name] for name in was} == was
    assert min(called.values()) >= 1 and called["look"] >= 2 and called["guard"] >= 2  # out of touch and in touch
