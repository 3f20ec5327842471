"""A servo process that lives and does nothing: the guardian makes its devices safe and ends it."""

from __future__ import annotations

import os
import re
import signal
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

import itouch
from itouch.servo import control_block as at
from itouch.servo import guardian as guardian_of
from itouch.servo.error_transport import let_go
from itouch.servo.guardian import COMES_TO, ORPHAN_TIME, SILENCE, SILENCE_ALONE, GracePeriod, Guardian, Process
from itouch.servo.shared_memory import monotonic
from itouch_evidence.deaths.observer import Observer
from itouch_tools.cli.doctor.touch_scene import scene

_CUSTOM = """
import signal

def hang(number, frame):
    while True:
        pass

signal.signal(signal.SIGUSR1, hang)
"""


def silence(said: str) -> int:
    """Return for how long [ms] a servo process gave no sign of life, by what is said of its end."""
    found = re.search(r"\(no beat for (\d+) ms\)", said)
    assert found is not None
    return int(found[1])


@pytest.mark.punctual
def test_a_loop_that_hangs_is_ended_and_the_devices_are_safe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitecustomize.py").write_text(_CUSTOM, encoding="utf-8")
    path = tmp_path / "hang.xml"
    path.write_text(scene(hold=False), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    assert str(tmp_path) in sys.path
    with itouch.launch(path) as handle:
        observer = Observer(handle.name, ("arm", "table", "peltier"))
        while handle.link.tick < 50:  # before, nothing obeys and nothing need be made safe
            time.sleep(0.02)
        os.kill(handle.pid, signal.SIGUSR1)
        with pytest.raises(
            itouch.ServoError,
            match=r"killed by SIGKILL; the servo process hung \(no beat for \d+ ms\); arm, table, peltier made",
        ) as caught:
            handle.wait(300)
        assert silence(str(caught.value)) >= SILENCE * 1e3
        assert observer.wait(300)
        assert all(time is not None for time in observer.safe_after(0).values())


_STARVED = """
import signal, time

def starve(number, frame):
    held = bytearray(1 << 20)
    while time.process_time() < starve.end:
        pass
    raise MemoryError

def begin(number, frame):
    starve.end = time.process_time() + 0.3
    starve(number, frame)

signal.signal(signal.SIGUSR1, begin)
"""


@pytest.mark.punctual
def test_a_loop_that_comes_to_itself_after_its_devices_were_made_safe_tells_the_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """0.3 s of work without a beat, as when memory runs out: longer than the guardian's patience."""
    (tmp_path / "sitecustomize.py").write_text(_STARVED, encoding="utf-8")
    path = tmp_path / "starved.xml"
    path.write_text(scene(hold=False), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with itouch.launch(path) as handle:
        observer = Observer(handle.name, ("arm", "table", "peltier"))
        while handle.link.tick < 50:
            time.sleep(0.02)
        os.kill(handle.pid, signal.SIGUSR1)
        with pytest.raises(itouch.ServoError) as caught:
            handle.wait(300)
        said = str(caught.value)
        assert said.startswith("the servo process hung (no beat for ")
        assert silence(said) >= SILENCE * 1e3
        assert " ms); arm, table, peltier made safe by the guardian within" in said
        assert "; then the servo process ended in order: " in said and "MemoryError" in said
        assert said.startswith(f"{handle.report()['ended_by']}; then")
        assert "SIGKILL" not in said
        assert observer.wait(300)
        assert all(time is not None for time in observer.safe_after(0).values())


def _stat(letter: str, used: float, flags: int = 0) -> str:
    ticks = round(used * os.sysconf("SC_CLK_TCK"))
    return f"12 (a (b) c) {letter} 1 2 3 4 5 {flags} 7 8 9 10 {ticks} 0 13"


def test_a_silent_process_has_its_time_by_what_it_gets_of_a_processor() -> None:
    now = [0.0]

    def over(grace: GracePeriod, letter: str, used: float, at: float, flags: int = 0) -> bool:
        now[0] = at
        return grace.over(Process.of(_stat(letter, used, flags)))

    slow = GracePeriod(lambda: now[0])
    assert [over(slow, "R", 3.0 + 0.1 * at, at) for at in (0.0, 4.0, 9.9)] == [False, False, False]
    assert over(slow, "R", 4.0, 10.1)  # the most that anybody gets
    now[0] = 0.0
    busy = GracePeriod(lambda: now[0])
    assert not over(busy, "R", 3.0, 0.0) and not over(busy, "R", 3.9, 0.9)
    assert over(busy, "R", 4.1, 1.1)
    now[0] = 0.0
    waiting = GracePeriod(lambda: now[0])
    assert not over(waiting, "S", 3.0, 0.0) and not over(waiting, "S", 3.0, 0.4)
    assert over(waiting, "S", 3.0, 0.6)
    now[0] = 0.0
    for letter, flags in (("T", 0), ("Z", 0), ("R", 0x4)):
        assert over(GracePeriod(lambda: now[0]), letter, 3.0, 0.0, flags)


def test_an_error_without_memory_gives_back_what_its_frames_hold() -> None:
    def eat() -> None:
        held = Held()
        try:
            raise KeyError(held.name)
        except KeyError as error:
            raise MemoryError from error

    class Held:
        name = "held"

        def __del__(self) -> None:
            freed.append(self.name)

    freed: list[str] = []
    with pytest.raises(MemoryError) as caught:
        eat()
    assert not freed
    let_go(caught.value)
    assert freed == ["held"]
    with pytest.raises(KeyError) as other:
        {}["nothing"]
    let_go(other.value)


class Words:
    """The control words, of which some change when the guardian has looked at them."""

    def __init__(self, now: dict[int, int], then: dict[int, int]) -> None:
        self._now, self._then = now, then

    def __getitem__(self, word: int) -> int:
        value = self._now[word]
        self._now[word] = self._then.get(word, value)
        return value


@pytest.mark.parametrize(
    ("phase", "armed", "hangs"),
    [(at.ENDING, 0, False), (at.ENDING, 1, True), (at.RUNNING, 0, True)],
    ids=["it writes its files", "it is not safe yet", "it goes on"],
)
def test_a_process_whose_launcher_has_died_is_ended_but_not_while_it_writes_its_files(
    phase: int, armed: int, hangs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A last save or the end of a recording would be cut short."""
    guardian = Guardian.__new__(Guardian)
    words = Words({at.ARMED: armed, at.BEAT: monotonic() - 5_000_000}, {})
    monkeypatch.setattr(guardian, "_words", words, raising=False)
    monkeypatch.setattr(guardian, "_segment", SimpleNamespace(phase=phase), raising=False)
    monkeypatch.setattr(guardian, "_orphaned", time.monotonic() - ORPHAN_TIME - 1.0, raising=False)
    monkeypatch.setattr(guardian, "_was_armed", bool(armed), raising=False)
    assert guardian._hangs() == hangs


@pytest.mark.parametrize(
    ("after", "hangs"),
    [({}, True), ({at.ARMED: 0}, False), ({at.BEAT: 1 << 62}, False)],
    ids=["silent", "its devices rest", "it has spoken"],
)
def test_a_guardian_that_waited_for_a_processor_itself_calls_nobody_hung_for_it(
    after: dict[int, int], hangs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It sees a process that is armed, and is held up before it sees how long that has been silent."""
    guardian = Guardian.__new__(Guardian)
    words = Words({at.ARMED: 1, at.BEAT: monotonic() - 300_000_000}, after)
    monkeypatch.setattr(guardian, "_words", words, raising=False)
    monkeypatch.setattr(guardian, "_segment", SimpleNamespace(phase=at.RUNNING), raising=False)
    monkeypatch.setattr(guardian, "_orphaned", None, raising=False)
    monkeypatch.setattr(guardian, "_gone", lambda: False)
    monkeypatch.setattr(guardian, "_was_armed", bool(words[at.ARMED]), raising=False)
    assert guardian._hangs() == hangs


@pytest.mark.parametrize(
    ("armed", "since", "hangs"),
    [(1, 0.5 * COMES_TO, False), (1, 2.0 * COMES_TO, True), (0, 0.5 * SILENCE_ALONE, False), (0, 6.0, True)],
    ids=["armed, just back", "armed", "alone, just back", "alone"],
)
def test_a_guardian_that_was_suspended_itself_counts_no_silence_of_that_time(
    armed: int, since: float, hangs: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A session of twins that was frozen for 7 s, its guardian with it, was killed as it went on."""
    now = [monotonic()]
    monkeypatch.setattr(guardian_of, "monotonic", lambda: now[0])
    guardian = Guardian.__new__(Guardian)
    monkeypatch.setattr(guardian, "_words", Words({at.ARMED: armed, at.BEAT: now[0]}, {}), raising=False)
    monkeypatch.setattr(guardian, "_segment", SimpleNamespace(phase=at.RUNNING), raising=False)
    monkeypatch.setattr(guardian, "_orphaned", None, raising=False)
    monkeypatch.setattr(guardian, "_gone", lambda: False)
    monkeypatch.setattr(guardian, "_was_armed", bool(armed), raising=False)
    monkeypatch.setattr(guardian, "_looked", now[0], raising=False)
    now[0] += 20 * 10**9
    guardian._note_absence()
    assert guardian._back == now[0]
    now[0] += round(since * 1e9)
    assert guardian._hangs() == hangs
