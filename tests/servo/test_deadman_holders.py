"""The dead-man's switch over several processes: no word holds for long, and nobody's hold covers another's release."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import itouch
from itouch.servo import control_block as at
from itouch.servo.deadman_holders import HOLD_NS, Holder, Switch
from itouch.servo.link import attach
from itouch.servo.shared_memory import ServoError, SharedMemory, monotonic

SCENE = """<itouch version="1.0">
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <safety hold-to-run="yes"/>
</itouch>
"""


@pytest.fixture
def segment() -> Iterator[SharedMemory]:
    found = SharedMemory.create("holders")
    yield found
    found.close()


@example(value=(1 << 63) - 1, place=at.MOST_HOLDERS)
@given(value=st.integers(min_value=-(1 << 62), max_value=(1 << 63) - 1), place=st.integers(0, at.MOST_HOLDERS))
@settings(max_examples=25, deadline=None)
def test_whatever_is_written_holds_for_80_ms_at_most(value: int, place: int) -> None:
    segment = SharedMemory.create("any")
    switch, now = Switch(segment.words), monotonic()
    segment.words[at.HELD_UNTIL if place == at.MOST_HOLDERS else at.HOLDERS + 2 * place + 1] = value
    held, _ = switch.look()
    assert held == (value > now) or abs(value - now) < HOLD_NS
    time.sleep(0.085)
    assert switch.look()[0] is False
    segment.close()


def test_who_lets_go_is_not_covered_by_another(segment: SharedMemory, monkeypatch: pytest.MonkeyPatch) -> None:
    now = monotonic()
    monkeypatch.setattr("itouch.servo.deadman_holders.monotonic", lambda: now)  # a machine may hold a test up for 80 ms
    switch, first, second = Switch(segment.words), Holder(segment), Holder(segment)
    first.say(True)
    second.say(True)
    assert switch.look() == (True, False)
    first.say(False)
    assert switch.look() == (True, True)  # the second holds, the first has let go
    second.say(True)
    assert switch.look() == (True, False)


def test_who_falls_silent_is_not_covered_by_another(segment: SharedMemory, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [monotonic()]
    monkeypatch.setattr("itouch.servo.deadman_holders.monotonic", lambda: clock[0])
    switch, first, second = Switch(segment.words), Holder(segment), Holder(segment)
    first.say(True)
    second.say(True)
    assert switch.look() == (True, False)
    found = []
    for _ in range(10):
        clock[0] += 10_000_000
        second.say(True)
        found.append(switch.look())
    assert found == [(True, n == 7) for n in range(10)]


def test_a_word_of_ones_own_is_given_back_and_those_of_the_dead_are_taken(segment: SharedMemory) -> None:
    holders = [Holder(segment) for _ in range(at.MOST_HOLDERS)]
    for holder in holders:
        holder.say(True)
    extra = Holder(segment)
    extra.say(False)  # lets go of nothing
    with pytest.raises(ServoError, match="16 others hold"):
        extra.say(True)
    holders[3].release()
    extra.say(True)
    segment.words[at.HOLDERS + 10] = (1 << 22) - 1 << 40  # a process that there is not
    Holder(segment).say(True)
    assert len({int(segment.words[at.HOLDERS + 2 * n]) for n in range(at.MOST_HOLDERS)}) == at.MOST_HOLDERS


def _until(true: Callable[[], bool], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.005)
    return true()


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "hold.xml").write_text(SCENE, encoding="utf-8")
    return tmp_path / "hold.xml"


def test_a_hold_far_in_the_future_holds_no_session(scene: Path) -> None:
    with itouch.launch(scene, seconds=30.0, realtime=False) as handle:
        handle.link._segment.words[at.HELD_UNTIL] = 1 << 62  # as any process of the same user could
        with pytest.raises(itouch.DeviceFaultError, match="was let go: nobody holds the switch"):
            handle.wait(300.0)


@pytest.mark.punctual  # a word holds for 80 ms
def test_a_viewer_that_lets_go_stops_a_session_that_another_holds(scene: Path) -> None:
    with itouch.launch(scene, seconds=60.0, realtime=False) as handle, attach(handle.name) as other:

        def both() -> bool:
            handle.hold()
            other.hold()
            return handle.link.tick > 50

        assert _until(both, 300.0)
        other.hold(False)
        with pytest.raises(itouch.DeviceFaultError, match="one of those who held the switch let it go"):
            assert _until(lambda: (handle.hold(), handle.wait(0.0))[1], 300.0)


def test_a_stored_state_holds_nothing(scene: Path, tmp_path: Path) -> None:
    session = itouch.build(scene)
    session.state["hold"] = 1 << 61
    session.save(tmp_path / "s.itouch")
    with pytest.raises(itouch.DeviceError, match="nobody holds"):
        itouch.restore(tmp_path / "s.itouch").run(0.1)
