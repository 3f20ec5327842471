"""Before the first tick all that checks and limits a device is gone through once, on scratch State."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Iterable
from typing import ClassVar

import pytest
from small_devices import ARM, PERIOD, PLATE, TABLE, Channels, Fake, model, state

from itouch.plugin import Field, Moment, Monitor, Record, Rule, Watched
from itouch.safety import Gate
from itouch.safety.acquisition import Acquisition
from itouch.safety.actuation import Actuation
from itouch.safety.check_warm_up import warm_up

ENTRANCES: dict[str, type] = {
    "look": Acquisition, "watch_placed": Acquisition, "guard": Actuation, "verify": Gate, "fault": Gate,
}  # fmt: skip


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
        kept = getattr(ENTRANCES[name], name)

        def through(*words: object) -> object:
            called[name] += 1
            return kept(*words)

        return through

    for name, where in ENTRANCES.items():
        monkeypatch.setattr(where, name, counted(name))
    one = model(channels, cls=Watched)
    scratch = state(one)
    before = [dict(vars(monitor)) for monitor in one.monitors]
    warm_up(one, scratch, PERIOD)
    assert not made
    for monitor, was in zip(one.monitors, before, strict=True):  # they are those of the run
        more = set(vars(monitor)) - set(was)  # constants that are put together once
        assert all(isinstance(inspect.getattr_static(type(monitor), name), functools.cached_property) for name in more)
        assert {name: vars(monitor)[name] for name in was} == was
    assert min(called.values()) >= 1 and called["look"] >= 2 and called["guard"] >= 2  # out of touch and in touch


class Asked(Monitor):
    """Notes what it is asked about."""

    name: ClassVar[str] = "asked"
    trips: ClassVar[dict[int, str]] = {}
    needs_finger_position: ClassVar[bool] = True
    seen: ClassVar[list[tuple[float, bool, bool, float]]] = []

    @classmethod
    def of(cls, device: Watched) -> Iterable[Monitor]:
        return (cls(device),)

    def fields(self) -> tuple[Field, ...]:
        return ()

    def check(self, state: Record, reading: Record, sent: Record, moment: Moment) -> float:
        self.seen.append((moment.gap, moment.calibrated, moment.touched, reading["plate_temperature"].item()))
        return 1.0

    def rules(self) -> tuple[Rule, ...]:
        return ()


def test_what_is_rehearsed_is_a_touch_and_none_at_room_temperature() -> None:
    """A monitor that goes another way in touch, or at zero kelvin, has gone it before a finger is there."""
    one = model(PLATE, offered=(Asked,))
    Asked.seen.clear()
    warm_up(one, state(one), PERIOD)
    away, pressed = Asked.seen
    assert away[0] > 0.0 and not away[1]
    assert pressed[0] < 0.0 and pressed[1] and pressed[2]
    assert {kelvin for *_, kelvin in Asked.seen} == {one.ambient}
