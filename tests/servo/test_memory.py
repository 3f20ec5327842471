"""Shared memory: whole copies only, across processes; drops are counted; commands arrive; nothing stays behind."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import threading
import time
import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from itouch.loop.timing import Timing
from itouch.plugin import Field, Record
from itouch.servo import ServoError, control_block, sessions
from itouch.servo.command_queue import Inbox, put
from itouch.servo.publish import Publisher, slots_for
from itouch.servo.published_state import Follower, Ring, copy_timing
from itouch.servo.shared_memory import SharedMemory

#: A State whose content is proved by a sum of it.
FIELDS = (Field("tick", "i8"), Field("sum", "u4"), Field("noise", "u8", 1500))


def _session(slots: int, summed: bool = False) -> tuple[SharedMemory, Record, Timing]:
    segment, state, timing = SharedMemory.create("test"), Record.of(FIELDS), Timing(["work"])
    segment.grow({"name": "x"}, state.nbytes, timing.record.nbytes, slots, summed)
    return segment, state, timing


def _fill(state: Record, tick: int, rng: np.random.Generator) -> None:
    state["tick"] = tick
    state["noise"] = rng.integers(0, 2**63, 1500, np.uint64)
    state["sum"] = zlib.crc32(state["noise"].tobytes())


def _whole(data: bytes) -> bool:
    record = Record(Record.of(FIELDS).dtype, np.frombuffer(bytearray(data), np.uint8))
    return zlib.crc32(record["noise"].tobytes()) == int(record["sum"])


_READER = """
import sys, time, zlib, numpy as np
sys.path.insert(0, {tests!r})
from servo.test_memory import FIELDS, _whole
from itouch.servo.shared_memory import SharedMemory
from itouch.servo.published_state import Ring
segment = SharedMemory(int(sys.argv[1]), "test")
ring, buffer = Ring(segment), np.zeros(int(segment.words[10]), np.uint8)
print("reading", flush=True)
seen, torn, newest = 0, 0, 0
while not segment.words[24]:
    told = ring.newest(buffer)
    if told is None:
        continue
    assert told[0] >= newest
    newest = told[0]
    seen += 1
    torn += not _whole(buffer.tobytes())
    if seen == 101:
        print("enough", flush=True)
print(seen, torn)
"""


@pytest.mark.parametrize(("slots", "summed"), [(2, False), (2, True)])
def test_no_reader_in_another_process_gets_a_torn_state(slots: int, summed: bool) -> None:
    segment, state, timing = _session(slots, summed)
    publisher, rng = Publisher(segment, state, timing), np.random.default_rng(1)
    code = _READER.format(tests=str(Path(__file__).parents[1]))
    readers = [
        subprocess.Popen([sys.executable, "-c", code, str(segment.handle)], pass_fds=(segment.handle,),
                         stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]  # fmt: skip
    waiting, deadline = [], time.monotonic() + 300.0
    for reader in readers:
        assert reader.stdout is not None
        reader.stdout.readline()
        waiting.append(threading.Thread(target=reader.stdout.readline, daemon=True))
        waiting[-1].start()
    for tick in itertools.count():  # a busy machine may give a reader no processor for a while
        if tick >= 8_000 and (time.monotonic() > deadline or not any(thread.is_alive() for thread in waiting)):
            break
        if tick % 8 == 0:
            _fill(state, tick, rng)
        state["tick"] = tick
        publisher.publish(tick)
    segment.words[control_block.STOP] = 1
    for thread in waiting:
        thread.join(300.0)
    for reader in readers:
        seen, torn = reader.communicate(timeout=600)[0].split()
        assert int(seen) > 100
        assert int(torn) == 0
    segment.close()


def test_a_copy_that_is_overwritten_meanwhile_is_refused() -> None:
    segment, state, timing = _session(4)
    publisher, ring = Publisher(segment, state, timing), Ring(segment)
    for tick in range(10):
        state["tick"] = tick
        publisher.publish(tick, 1e-4, 2e-4)
    into = np.zeros(state.nbytes, np.uint8)
    assert ring.copy(6, into) is None  # its slot holds the 10th
    assert ring.copy(11, into) is None  # not written yet
    told = ring.copy(10, into)
    assert told is not None
    assert told[0] == 9
    assert told[2:] == (100_000, 200_000)
    marks = ring._ring[10 % 4][:16].view(np.int64)
    marks[0] = 14  # the writer has begun with the next round
    assert ring.copy(10, into) is None


def test_a_sum_finds_a_mixed_copy() -> None:
    segment, state, timing = _session(4, summed=True)
    publisher, ring, rng = Publisher(segment, state, timing), Ring(segment), np.random.default_rng(2)
    _fill(state, 1, rng)
    publisher.publish(1)
    into = np.zeros(state.nbytes, np.uint8)
    assert ring.copy(1, into) is not None
    ring._ring[1][64 + 500 : 64 + 600] ^= 0x5A
    assert ring.copy(1, into) is None


def test_a_follower_takes_all_in_order_and_counts_what_it_was_too_slow_for() -> None:
    segment, state, timing = _session(64)
    publisher, follower = Publisher(segment, state, timing), Follower(Ring(segment))
    ticks = []
    for tick in range(200):
        state["tick"] = tick
        publisher.publish(tick)
        if tick % 20 == 19:
            ticks += [entry.tick for entry in follower.take()]
    assert ticks == list(range(200))
    assert follower.dropped == 0
    for tick in range(200, 500):
        publisher.publish(tick)
    late = [entry.tick for entry in follower.take()]
    assert late[-1] == 499
    assert late == list(range(late[0], 500))
    assert follower.dropped + len(late) == 300
    assert follower.dropped > 200


def test_commands_of_several_writers_all_arrive_once() -> None:
    segment, _, _ = _session(64)
    inbox, found = Inbox(segment), []

    def write(who: int) -> None:
        for number in range(40):
            put(segment, {"what": "x", "value": [who, number]})

    writers = [threading.Thread(target=write, args=(who,)) for who in range(3)]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers) or len(found) < 120:
        found += [tuple(message["value"]) for message in inbox.take()]
    assert sorted(found) == [(who, number) for who in range(3) for number in range(40)]
    for who in range(3):
        assert [n for w, n in found if w == who] == list(range(40))


def test_a_box_that_nobody_empties_is_told_and_nonsense_is_left_out() -> None:
    segment, _, _ = _session(64)
    for _ in range(control_block.BOX_SLOTS):
        put(segment, {"what": "x"})
    with pytest.raises(ServoError, match="does not take commands"):
        put(segment, {"what": "x"})
    with pytest.raises(ValueError, match="too long"):
        put(segment, {"what": "x" * 2000})
    at = control_block.BOX_AT + 3 * control_block.BOX_SLOT_SIZE
    segment.bytes[at : at + 100] = 0xFF
    assert len(Inbox(segment).take()) == control_block.BOX_SLOTS - 1


def test_a_box_of_nonsense_alone_is_emptied_too() -> None:
    segment, _, _ = _session(64)
    inbox = Inbox(segment)
    for _ in range(2):
        for _ in range(control_block.BOX_SLOTS):
            put(segment, {"what": "x"})
        segment.bytes[
            control_block.BOX_AT : control_block.BOX_AT + control_block.BOX_SLOTS * control_block.BOX_SLOT_SIZE
        ] = 0xFF
        assert inbox.take() == []
    put(segment, {"what": "y"})
    assert inbox.take() == [{"what": "y"}]


def test_timing_is_copied_whole_or_not_at_all() -> None:
    segment, state, timing = _session(64)
    publisher = Publisher(segment, state, timing)
    timing.add([0.0, 1e-4])
    publisher.publish_timing()
    into = np.zeros(timing.record.nbytes, np.uint8)
    assert copy_timing(segment, into)
    assert into.tobytes() == timing.record.tobytes()
    segment.words[control_block.TIMING_BEGIN] += 1  # the writer died in the middle
    assert not copy_timing(segment, into)


def test_the_memory_has_no_name_that_could_stay() -> None:
    before = [name for name in sorted(os.listdir("/dev/shm")) if "itouch" in name]
    segment, _, _ = _session(64)
    assert [name for name in sorted(os.listdir("/dev/shm")) if "itouch" in name] == before
    segment.close()


def test_the_ring_reaches_back_two_seconds_within_bounds() -> None:
    assert slots_for(20_000, 1e-3) == 2000
    assert slots_for(1 << 20, 1e-3) == 64
    assert slots_for(100, 0.1) == 64


def test_a_state_that_is_written_over_while_it_is_taken_is_counted_as_dropped() -> None:
    ring: Any = SimpleNamespace(head=0, slots=64, state_size=8)
    ring.copy = lambda number, into: None if number in (3, 4, 9) else (100 * number, 5.0, 1000, 2000)
    follower = Follower(ring)
    ring.head = 10
    taken = list(follower.take())
    assert [entry.tick for entry in taken] == [100, 200, 500, 600, 700, 800, 1000]
    assert follower.dropped == 3


def test_who_opened_a_session_as_it_was_being_built_is_told_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the opening of the memory and the reading of its description the session may have been built."""
    segment = SharedMemory.create("test")
    early = SharedMemory(os.dup(segment.handle), "test")
    monkeypatch.setattr("itouch.servo.link._segments", lambda: iter([early]))
    segment.grow({"source": "scene.xml"}, 8, 8, slots=2, summed=False)
    assert [info.scene for info in sessions()] == ["scene.xml"]
