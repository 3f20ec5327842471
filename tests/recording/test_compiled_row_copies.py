"""Rows that compiled code copies: what they hold, however the recorder hears of a tick, and what it leaves to Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.compiling import kernel
from itouch.joining import can_join
from itouch.loop.compiled_listener import CompiledListener
from itouch.plugin import Bound, Field, Record
from itouch.recording.tracks import KINDS, Column, Track
from itouch.safety import Trip
from itouch.session.row_layout import FULL, LOOK, Rows, copy_row, count_row


def _run(path: Path, scene: str, seconds: float, way: str) -> tuple[itouch.Session, int]:
    """Record a run with a stop in its midst, heard of in one of four ways; return how often Python ran ticks."""
    session = itouch.build(SCENES / f"{scene}.xml", seed=3)
    session.record(path)
    calls, tick = [0], session.tick

    def counted() -> None:
        calls[0] += 1
        tick()

    session.tick = counted  # type: ignore[method-assign]
    if way == "python":
        session.taps[0] = session.taps[0].__call__  # no compiled listener any more
    if way == "beside another":
        session.taps.append(lambda tick: None)
    if way == "real":
        session.clock = itouch.WallClock()
    if way == "real":  # without its pace
        while session.seconds < seconds:
            session.tick()
    else:
        session.run(seconds)
    session.clock = itouch.VirtualClock()
    session.make_safe(itouch.DeviceFaultError("arm", session.ticks, Trip.MODALITY_ERROR, "was stopped"))
    session.rearm()
    session.mark("after")
    session.run(0.05)
    session.close()
    return session, calls[0]


@pytest.mark.parametrize(
    ("scene", "seconds"), [("first_touch", 1.0), ("four_materials_hurried", 12.0), ("mesh", 1.5), ("texture", 1.0)]
)
def test_a_recording_is_the_same_however_its_recorder_hears_of_ticks(
    tmp_path: Path, scene: str, seconds: float
) -> None:
    read = {}
    for way in ("joined", "python", "beside another", "real"):
        session, calls = _run(tmp_path / f"{way}.mcap", scene, seconds, way)
        ticks = session.ticks
        joined = way == "joined" and can_join()
        assert calls < ticks / 2 if joined else calls > 0.9 * seconds / session.model.period
        read[way] = itouch.read(tmp_path / f"{way}.mcap")
    first, *others = read.values()
    assert first.whole and first.losses == () and first.faults and first.events
    assert np.array_equal(first.ticks, np.arange(ticks))
    for other in others:
        for name in ("session", *session.model.devices, *(probe.name for probe in session.model.probes)):
            assert first[name].tobytes() == other[name].tobytes(), name
        assert first.events == other.events and first.marks == other.marks
        assert [(s["tick"], s["reason"]) for s in first.states] == [(s["tick"], s["reason"]) for s in other.states]


@pytest.mark.parametrize("seed", range(20))
def test_a_row_holds_the_bytes_of_its_fields_wherever_they_stand(seed: int) -> None:
    """Fields of a stranger may have any size, so that those after them stand anywhere."""
    draw = np.random.default_rng(seed)
    kinds = [*KINDS, "i1", "f4", "u2"]  # of the others there are no tracks
    fields = [
        Field(f"p.f{i}", str(draw.choice(kinds)), int(draw.choice([0, 1, 2, 3, 7, 40]))) for i in range(draw.integers(1, 30))
    ]  # fmt: skip
    state = Record.of([Field("tick", "i8"), Field("count", "i8"), *fields])
    state.raw[:] = draw.integers(0, 256, state.nbytes)
    able = [field.name for field in fields if field.dtype in KINDS]
    chosen = [name for name in able if draw.random() < 0.5] or ["count"]
    columns = tuple(Column(name, name, state[name].dtype.str[1:], 0, "") for name in chosen)
    rows = Rows(state, [Track("p", 1, True, columns)])
    assert rows.size % 8 == 0 and rows.size <= sum(state[name].nbytes for name in chosen) + 16 * len(chosen)
    ring, ticks = np.full((4, rows.size // 8), -1), np.zeros(4, np.int64)
    counters, seen = np.zeros(8, np.int64), np.array([5])
    counters[:2] = 6, 4  # two rows wait, two may come
    state["tick"], state["count"] = 130, 5
    assert copy_row(counters, state.words, rows.pieces, ring) == 0
    assert count_row(counters, ticks, state["tick"].reshape(1), state["count"].reshape(1), seen, 64) == 0
    row = ring.view(np.uint8)[2]
    for name in chosen:
        at = rows.places[name]
        assert row[at : at + state[name].nbytes].tobytes() == state[name].tobytes(), name
    assert ticks.tolist() == [0, 0, 129, 0] and counters[:2].tolist() == [7, 4]
    assert (ring[[0, 1, 3]] == -1).all()


def test_what_is_left_to_python() -> None:
    state = Record.of([Field("tick", "i8"), Field("count", "i8")])
    rows = Rows(state, [Track("p", 1, True, (Column("tick", "tick_", "i8", 0, ""),))])
    ring, ticks, counters = np.zeros((4, 1), np.int64), np.zeros(4, np.int64), np.zeros(8, np.int64)
    seen, tick, count = np.zeros(1, np.int64), state["tick"].reshape(1), state["count"].reshape(1)

    def told(number: int, events: int) -> int:
        tick[0], count[0] = number + 1, events
        return count_row(counters, ticks, tick, count, seen, 64)

    assert (told(63, 0), told(64, 0), told(65, 0), told(66, 1)) == (0, LOOK, 0, LOOK)
    assert copy_row(counters, state.words, rows.pieces, ring) == FULL
    counters[1] = 1
    assert copy_row(counters, state.words, rows.pieces, ring) == 0


@kernel
def _every_seventh(tick: Any, heard: Any) -> int:
    heard[tick[0] - 1] += 1
    return 9 if tick[0] % 7 == 0 else 0


@pytest.mark.parametrize("real", [False, True])
def test_what_a_compiled_listener_leaves_to_python_is_answered_before_the_next_tick(real: bool) -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    heard, answered, at = np.zeros(4000, np.int64), [], []

    def answer(code: int, tick: int) -> None:
        answered.append((code, tick))
        at.append(session.ticks)
        if tick > 1000:
            raise OSError("the disk is full")

    session.taps.append(CompiledListener([Bound(_every_seventh, session.state["tick"], heard)], answer))
    if real:
        session.clock = itouch.WallClock()
        for _ in range(400):
            session.tick()
        session.clock = itouch.VirtualClock()
    with pytest.raises(OSError, match="disk"):
        session.run(2.0)
    assert answered == [(9, tick) for tick in range(6, 1008, 7)]
    assert at == [tick + 1 for _, tick in answered]
    assert (heard[:1008] == 1).all() and not heard[1008:].any()
