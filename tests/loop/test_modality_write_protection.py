"""A modality writes what it has declared and nothing else: by its views, and by a copy where it goes past them."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_plugin_fault_isolation import Hum, engine

import itouch
from itouch.loop.write_access import WriteGuard, WriteGuards, mended
from itouch.plugin import Field, Record
from itouch.plugin.write_protection import WriteProtectedRecord

#: Fields that a check, a limit or another writer depends on.
OTHERS = ("arm.pose", "arm.status", "arm.trip", "arm.sent.wrench", "hold", "arm.calibration", "finger.hip", "tick")


def poked(state: Record, field: str) -> None:
    """Write by address, as compiled code may."""
    view = state[field]
    ctypes.memset(view.ctypes.data, 0x11, view.itemsize)


def unlocked(state: Record, field: str) -> None:
    """Write through a view that was made writable again."""
    view = state[field]
    while view.base is not None and not view.flags.writeable:
        try:
            view.flags.writeable = True
        except ValueError:
            view = view.base
    np.asarray(view).reshape(-1)[:1] = 7


def evil(write: Callable[[Record], None], *, when: str = "update", at: int = 50) -> type[Hum]:
    class Evil(Hum):
        """Does wrong in one tick."""

        def update(self, model: Any, state: Record, period: float) -> None:
            if when == "update" and int(state["tick"]) == at:
                write(state)

        def on_contact(self, event: Any, model: Any, state: Record) -> None:
            if when == "on_contact" and int(state["tick"]) > 0:
                write(state)

    return Evil


@pytest.mark.parametrize("field", OTHERS)
@pytest.mark.parametrize("how", [poked, unlocked])
def test_what_is_not_its_own_is_put_back_and_told(
    tmp_path: Path, field: str, how: Callable[[Record, str], None]
) -> None:
    session = engine(tmp_path, evil(lambda state: how(state, field)))
    session.run(0.05)
    before = session.state[field].tobytes()
    with pytest.raises(itouch.DeviceFaultError, match=f"lost its modality 'hum', .*{field}|not writable|read-only"):
        session.tick()
    assert session.status("arm").name == "FAULT"
    if field in ("hold", "arm.calibration"):
        assert session.state[field].tobytes() == before


@pytest.mark.parametrize("write", [
    lambda state: state.__setitem__("arm.pose", 0.0),
    lambda state: state["arm.pose"].fill(0.0),
    lambda state: state["finger.hip"].__setitem__(2, 1.0),
    lambda state: state.part("arm.sent.").__setitem__("wrench", 1.0),
    lambda state: state.raw.__setitem__(slice(None), 0),
    lambda state: np.asarray(state)["hold"].__setitem__(..., 1 << 62),
])  # fmt: skip
@pytest.mark.parametrize("when", ["update", "on_contact"])
def test_views_of_what_is_not_its_own_can_not_be_written(tmp_path: Path, write: Any, when: str) -> None:
    session = None
    with pytest.raises((itouch.DeviceFaultError, itouch.SceneError), match="failed in (update|on_contact): .*Error"):
        session = engine(tmp_path, evil(write, when=when))
        session.run(0.4)
    assert session is None or session.status("arm").name == "FAULT"


def test_its_own_fields_and_commands_can_be_written(tmp_path: Path) -> None:
    class Good(Hum):
        """Writes all that is its own, in every way."""

        def fields(self, model: Any) -> tuple[Field, ...]:
            return (Field("count", "i8"), Field("a", "f8", 3), Field("b", "f8", 2))

        def update(self, model: Any, state: Record, period: float) -> None:
            state["hum.count"] += 1
            state.part("hum.")["count"] += 1
            state.flat("hum.a", "hum.b")[:] = 1.0
            state["arm.command.wrench"] = (0.1, 0, 0, 0, 0, 0)
            assert not state.copy()["hold"].any()

    session = engine(tmp_path, Good)
    session.run(0.1)
    assert session.state["hum.count"] == 200
    assert session.state["hum.b"].tolist() == [1.0, 1.0]
    assert session.state["arm.sent.wrench"][0] == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("name", "field"),
    [
        ("arm.readings", "arm.readings.believed"),
        ("finger.surface", "finger.surface.missed"),
    ],
)
@pytest.mark.parametrize("how", [lambda state, field: state[field].fill(1.0), poked], ids=["plainly", "by address"])
def test_a_name_that_others_fields_begin_with_makes_them_no_modalitys_own(
    tmp_path: Path, name: str, field: str, how: Callable[[Record, str], None]
) -> None:
    """What is its own goes by what it declares: the scene may call it as it likes."""
    bad = type("Bad", (evil(lambda state: how(state, field)),), {"reset": lambda *_: None})
    session = engine(tmp_path, bad, name=name)
    session.run(0.05)
    assert f"{name}.count" in session.state
    with pytest.raises(itouch.DeviceFaultError, match=f"lost its modality '{name}'"):
        session.tick()


def test_a_fenced_record_is_the_same_memory() -> None:
    whole = Record.of([Field("a", "f8", 2), Field("b"), Field("c", "i8")])
    fenced = WriteProtectedRecord(whole, ["b"])
    whole["a"] = 3.0
    fenced["b"] = 2.0
    assert (fenced["a"].tolist(), whole["b"].item()) == ([3.0, 3.0], 2.0)
    with pytest.raises(ValueError, match="'c' is not its own"):
        fenced["c"] = 1
    with pytest.raises(KeyError):
        fenced["x"] = 1
    with pytest.raises(ValueError, match="read-only"):
        fenced.flat("a", "b")[:] = 0.0
    assert fenced.flat("b", "b").flags.writeable
    assert fenced.copy().flat("a", "b").flags.writeable


@pytest.mark.parametrize("odd", [False, True], ids=["words", "bytes"])
def test_a_fence_sees_each_byte_that_is_not_a_modalitys_own(odd: bool) -> None:
    """It looks at the whole of State, for compiled code may write anywhere; and it leaves alone what is its own."""
    fields = [Field("a", "f8", 5), Field("hum.x"), Field("b", "i8", 7), Field("c"), Field("hum.y", "f8", 2), Field("d")]
    state = Record.of([*fields, *([Field("e", "u1", 3)] if odd else [])])
    around = WriteGuard([SimpleNamespace(name="hum", commands=(), fields=("x", "y"))], state)
    own = [(state.dtype.fields[name][1], state[name].nbytes) for name in ("hum.x", "hum.y")]
    state.raw.view(np.uint8)[:] = np.random.default_rng(3).integers(0, 256, state.nbytes)
    around.take()
    whole = state.tobytes()
    for at in range(state.nbytes):
        state.raw.view(np.uint8)[at] ^= 1 << (at % 8)
        name = next(name for name, (kind, begin) in state.dtype.fields.items() if begin <= at < begin + kind.itemsize)
        if any(begin <= at < begin + size for begin, size in own):
            assert around.mend() == ""
            state.raw.view(np.uint8)[at] ^= 1 << (at % 8)
        else:
            assert around.mend() == name
        assert state.tobytes() == whole


NAMES = ("a", "lift.x", "b", "table.command.pose", "c", "hum.y", "plate.command.current", "d")


def fenced() -> tuple[Record, WriteGuards]:
    """Return a State with the fence round a carrier and a modality, between which the framework writes two fields."""
    state = Record.of([Field(name, "i8", 200 if name == "c" else 2) for name in NAMES])
    state.raw.view(np.uint8)[:] = np.random.default_rng(3).integers(0, 256, state.nbytes)
    lift = SimpleNamespace(name="lift", commands=("table.pose",), fields=("x",))
    hum = SimpleNamespace(name="hum", commands=("plate.current",), fields=("y",))
    return state, WriteGuards([lift], [hum], ["b", "table.command.pose"], state)


@pytest.mark.parametrize("name", NAMES)
def test_what_a_carrier_writes_of_others_is_seen_behind_it_or_before_anything_is_sent(name: str) -> None:
    """What is short is seen at once; no modality is kept from another one's fields."""
    state, fences = fenced()
    fences.rest.take()
    fences.near.take()
    before = state[name].copy()
    state[name][1] ^= 1
    assert mended([fences.near]) == (name if name in ("a", "b", "plate.command.current", "d") else "")
    fences.later.take()
    state["plate.command.current"][0] ^= 1
    assert mended([fences.later, fences.rest]) == (name if name == "c" else "")
    own = name in ("lift.x", "table.command.pose", "hum.y")
    assert bool(state[name][1] == before[1]) == (not own)


@pytest.mark.parametrize("name", NAMES)
def test_what_a_modality_writes_of_others_is_seen_though_the_framework_wrote_since_the_carriers(name: str) -> None:
    state, fences = fenced()
    fences.rest.take()
    fences.near.take()
    assert mended([fences.near]) == ""
    for written in ("b", "table.command.pose"):
        state[written] ^= 1
    before = state[name].copy()
    fences.later.take()
    state[name][1] ^= 1
    own = name in ("hum.y", "plate.command.current")
    assert mended([fences.later, fences.rest]) == ("" if own else name)
    assert bool((state[name] == before).all()) == (not own)


class MuteError(Exception):
    """Fails when it is asked what it says."""

    def __str__(self) -> str:
        raise SystemExit(3)

    __repr__ = __str__


class MuteExit(BaseException):
    """The same, and no ``Exception``."""

    __str__ = __repr__ = MuteError.__str__


class EndlessError(ValueError):
    """Says more than anybody reads."""

    def __str__(self) -> str:
        return "x" * 10**7


@pytest.mark.parametrize("ends", [SystemExit, KeyboardInterrupt, GeneratorExit, MuteError, MuteExit, EndlessError])
@pytest.mark.parametrize("when", ["update", "on_contact"])
def test_whatever_a_modality_raises_the_devices_are_made_safe(
    tmp_path: Path, ends: type[BaseException], when: str
) -> None:
    def leave(state: Record) -> None:
        if int(state["tick"]) > 10:  # not while it is rehearsed
            raise ends

    session = engine(tmp_path, evil(leave, when=when))
    told = KeyboardInterrupt if ends is KeyboardInterrupt else itouch.DeviceFaultError
    with pytest.raises(told):
        session.run(0.4)
    assert session.status("arm").name == "FAULT"
    assert not session.state["arm.sent.wrench"].any()
    (fault,) = session.report()["faults"][-1:]
    assert fault["safe"]["reached"] is True
    assert len(fault["cause"]) < 2000
