"""Waits on a terminal: what their line shows while work goes on, prints, measures or waits in turn, and what it took."""

from __future__ import annotations

import io
import math
import os
import pty
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from program import program
from shipped import SCENES
from test_command_options import Terminal, lines_on_screen

import itouch
import itouch_thermal.cli
import itouch_tools.cli.check
import itouch_tools.cli.explain
import itouch_tools.cli.inspect
import itouch_tools.cli.recover
import itouch_tools.cli.replay
import itouch_tools.cli.study
from itouch import compiling
from itouch.schema.wait_notices import shown_by
from itouch.servo import compile_ahead, prepare
from itouch_tools.cli import progress

BEGIN = """
import sys, time, threading
from itouch.schema.terminal import escaped
from itouch.schema.wait_notices import shown_by, waiting
from itouch_tools.cli import progress
from itouch_tools.cli.progress import measured, shown
"""


def on_terminal(folder: Path, code: str) -> list[tuple[float, str]]:
    """Run a program on a terminal; return what it wrote and when [s]."""
    told = folder / "wait.py"
    told.write_text(BEGIN + code)
    ours, theirs = pty.openpty()
    process = subprocess.Popen([sys.executable, str(told)], stdin=theirs, stdout=theirs, stderr=theirs)
    os.close(theirs)
    found = list[tuple[float, str]]()
    while True:
        try:
            block = os.read(ours, 65536)
        except OSError:
            break
        found.append((time.monotonic(), block.decode()))
    os.close(ours)
    assert process.wait(300) == 0, found
    return found


def lines(found: list[tuple[float, str]]) -> list[str]:
    return list(lines_on_screen("".join(text for _, text in found)))


def in_pipes(folder: Path) -> tuple[str, str]:
    """Run the same program with pipes; return what it wrote to both."""
    done = subprocess.run([sys.executable, str(folder / "wait.py")], capture_output=True, text=True, check=True)
    return done.stdout, done.stderr


@contextmanager
def listening(events: list[Any]) -> Iterator[None]:
    """Note waits in place of showing them: their begin, what they report, their end."""

    class Noted:
        def part(self, done: float | None, words: str = "") -> None:
            events.append((done, words))

    @contextmanager
    def shower(what: str) -> Iterator[Noted]:
        events.append(what)
        yield Noted()
        events.append("end")

    with shown_by(shower):
        yield


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("progress") / "r.mcap"
    session = itouch.build(SCENES / "first_touch.xml")
    session.record(path)
    session.run(1.2)
    session.close()
    return path


@pytest.mark.punctual  # what is drawn in a second
def test_a_bar_goes_when_nobody_knows_any_more_how_far_it_is(tmp_path: Path) -> None:
    found = on_terminal(tmp_path, """
with shown("reading") as wait:
    time.sleep(1.3); wait.part(0.7); time.sleep(1.2)
    wait.part(None, "drawing the page"); time.sleep(1.2)
    wait.part(0.9); time.sleep(1.2)
""")  # fmt: skip
    seen = lines(found)
    assert any("reading" in line and "70%" in line for line in seen), seen
    drawing = [line for line in seen if "drawing the page" in line and "90%" not in line]
    assert drawing and not any("%" in line or "━" in line for line in drawing), drawing
    assert any("90%" in line for line in seen)


@pytest.mark.punctual
def test_words_have_the_room_of_a_bar_that_would_cut_them(tmp_path: Path) -> None:
    words = "1234 of 99999 runs, 12.34 a second, 12.3 h left"
    found = on_terminal(tmp_path, f"""
with shown("sweep") as wait:
    wait.part(0.3, "{words}"); time.sleep(2.0)
    wait.part(0.3, "few"); time.sleep(1.0)
""")  # fmt: skip
    seen = lines(found)
    assert any(f"sweep: {words}" in line and "30%" in line and "━" not in line for line in seen), seen
    assert any("sweep: few" in line and "━" in line for line in seen)
    assert all(len(line) <= 80 for line in seen)


@pytest.mark.punctual
def test_a_wait_inside_another_is_told_in_its_line(tmp_path: Path) -> None:
    found = on_terminal(tmp_path, """
with shown_by(shown), waiting("outer") as wait:
    wait.part(None, "first"); time.sleep(1.3)
    with waiting("inner") as inside:
        inside.part(0.25, "a quarter"); time.sleep(1.2)
    time.sleep(1.2)
""")  # fmt: skip
    seen = lines(found)
    assert any("outer: inner: a quarter" in line and "25%" in line for line in seen), seen
    assert "outer: first" in seen[-2] and "%" not in seen[-2], seen
    assert re.fullmatch(r"outer: \d+\.\d s", seen[-1])


@pytest.mark.punctual
def test_nothing_is_done_beside_work_that_measures(tmp_path: Path) -> None:
    """Its line stands before the work begins, comes back below what it prints, and is never drawn by anybody else."""
    found = on_terminal(tmp_path, """
with escaped(), measured("bench x") as wait:
    assert threading.active_count() == 1
    time.sleep(2.0)
    print("a row"); print("half", end="", flush=True); time.sleep(0.5); print(" and half")
    time.sleep(1.5)
    print("note", file=sys.stderr)
    wait.part(0.5, "half of it"); time.sleep(0.3); wait.part(0.75, "more")
""")  # fmt: skip
    times = [when for when, text in found if text.strip()]
    gaps = sorted((after - before for before, after in zip(times, times[1:], strict=False)), reverse=True)
    assert gaps[0] > 1.6 and gaps[1] > 1.1, gaps  # silence while it works
    seen = lines(found)
    assert re.fullmatch(r"bench x, since \d\d:\d\d:\d\d", seen[0])
    assert seen.count(seen[0]) >= 3 and "a row" in seen and "half and half" in seen and "note" in seen
    assert seen[seen.index("half and half") + 1] == seen[0]
    assert any("more" in line and "75%" in line for line in seen)
    assert re.fullmatch(r"bench x: \d+\.\d s", seen[-1])
    assert in_pipes(tmp_path) == ("a row\nhalf and half\n", "note\n")


def test_a_bench_says_at_once_that_it_measures_and_at_its_end_what_it_took() -> None:
    words = ("bench", "identify", "--fingers", "3", "--sample", "wood")
    terminal = Terminal(*words)
    assert terminal.end() in (0, 1), terminal.text
    seen = list(lines_on_screen(terminal.text))
    assert re.fullmatch(r"bench identify, since [\d:]{8}", seen[0]), seen
    assert any("estimating: 1 of 3 fingers" in line and "33%" in line for line in seen)
    rows = [line for line in seen if line.startswith(("value ", "lag ", "3 fingers"))]
    assert len(rows) == 3 and (seen[-1] == seen[0] or re.fullmatch(r"bench identify: \d+\.\d s", seen[-1]))
    plain = program(*words)
    assert plain.stderr == "" and [line for line in plain.stdout.splitlines() if line in rows] == rows


def test_help_of_a_bench_is_nothing_but_help() -> None:
    terminal = Terminal("bench", "identify", "--help")
    assert terminal.end() == 0 and "since" not in terminal.text and "--fingers" in terminal.text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("inspect", str(SCENES / "first_touch.xml"), "--plan"), "measuring "),
        (("doctor", "--rates", str(SCENES / "first_touch.xml"), "--measure", "0.3s"), "doctor, since "),
    ],
)
def test_other_commands_that_measure_say_so_at_once(words: tuple[str, ...], said: str) -> None:
    terminal = Terminal(*words)
    assert terminal.end() == 0, terminal.text
    assert next(lines_on_screen(terminal.text)).startswith(said), terminal.text


def test_other_commands_that_take_long_say_what_they_do(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenes = [str(SCENES / "first_touch.xml"), str(SCENES / "two_fingers.xml")]
    events: list[Any] = []
    with listening(events):
        assert itouch_tools.cli.check.main(scenes) == 0
        assert itouch_tools.cli.inspect.main([scenes[0]]) == 0
        assert itouch_tools.cli.recover.main([str(recorded), "-o", str(tmp_path / "again.mcap")]) == 0
    assert events == [
        "checking 2 scenes", (0.0, scenes[0]), (0.5, scenes[1]), "end", f"reading {scenes[0]}", "end",
        f"recovering {recorded}", "end",
    ]  # fmt: skip


def test_what_a_scene_needs_before_its_numbers_are_printed_is_told(tmp_path: Path) -> None:
    """Nearly all of both commands is building the session: they printed nothing for two seconds."""
    scene = str(SCENES / "four_materials_hurried.xml")
    events: list[Any] = []
    with listening(events):
        assert itouch_thermal.cli.main(["switching", scene]) == 0
        assert itouch_thermal.cli.main(["record-flux", scene, "-o", str(tmp_path / "flux.csv"), "--every", "10ms"]) == 0
    said = [event for event in events if isinstance(event, str)]
    assert said == [
        f"preparing {scene}", "end", "computing the times of switches", "end",
        f"preparing {scene}", "end", f"running {scene}", "end",
    ]  # fmt: skip
    told = [event for event in events if isinstance(event, tuple)]
    shares = [share for share, _ in told]
    assert len(told) > 10 and shares == sorted(shares) and 0.0 < shares[0] < shares[-1] <= 1.0
    assert told[0][1] == "0.1 s simulated"


def test_an_explanation_says_that_its_example_runs_and_what_it_prints_is_the_same(
    capsys: pytest.CaptureFixture[str],
) -> None:
    events: list[Any] = []
    with listening(events):
        assert itouch_tools.cli.explain.main(["plate-temperature"]) == 0
    assert (events[0], events[-1]) == ("running the example of plate-temperature", "end")
    printed = capsys.readouterr()
    assert "fault[plate-temperature]" in printed.out and printed.err == ""


def test_the_trials_of_an_audit_are_told_as_waits_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def observed(file: Any, catalog: Any, trials: int, *, seed: int, told: Any) -> tuple[list[str], Any]:
        for count in range(1, trials + 1):
            told(count)
        return ["a", "b"] * (trials // 2), np.zeros((trials, 9))

    monkeypatch.setattr("itouch_tools.study.audit.observe", observed)
    events: list[Any] = []
    with listening(events):
        study = str(SCENES / "studies" / "real_and_rendered.xml")
        itouch_tools.cli.study.main(["audit", study, "--trials", "100"])
    assert events[:3] == ["auditing", (0.01, "1 of 100 trials"), (0.02, "2 of 100 trials")]
    assert events[100:] == [(1.0, "100 of 100 trials"), (None, "guessing the conditions"), "end"]


def test_a_replay_is_told_from_the_reading_of_the_file_to_its_end(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nearly all of a replay's first start is compiling, when its session is built."""
    events: list[Any] = []
    built, read = prepare.prepare_replay, itouch.recording.read
    monkeypatch.setattr(prepare, "prepare_replay", lambda recording: (events.append("built"), built(recording))[1])
    monkeypatch.setattr(itouch.recording, "read", lambda path: (events.append("read"), read(path))[1])
    with listening(events):
        assert itouch_tools.cli.replay.main([str(recorded)]) == 0
    assert events[:3] == [f"replaying {recorded}", "read", "built"] and events[-1] == "end"
    shares = [share for share, _ in events[3:-1] if share is not None]
    assert shares == sorted(shares) and len(shares) >= 2


def test_kernels_of_a_replay_are_compiled_on_several_processors(
    recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those who help build the same engine: from a recording and a session, too, and not only from a scene."""
    helped: list[list[str]] = []
    monkeypatch.setattr(prepare._Companion, "__init__", lambda self, words: helped.append(words))
    monkeypatch.setattr(prepare._Companion, "__enter__", lambda self: self)
    monkeypatch.setattr(prepare._Companion, "__exit__", lambda self, *_: None)
    prepare.prepare_replay(itouch.read(recorded))
    assert helped == [[str(recorded)]]
    saved = tmp_path / "s.itouch"
    itouch.build(SCENES / "first_touch.xml").save(saved)
    monkeypatch.setattr(compile_ahead, "end_with", lambda parent: None)
    for file in (recorded, saved):
        assert compile_ahead.main([str(file), "--parent", "1"]) == 0


def test_a_first_start_tells_how_many_kernels_of_those_that_it_needs_are_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By this process and by those that help it; how many it needs is known when one of them has listed its steps."""
    monkeypatch.setattr(prepare, "_PATIENCE", 0.0)
    monkeypatch.setattr(prepare, "_LOOK", 0.02)
    monkeypatch.setattr(prepare._Companion, "_start", lambda self: compiling.compile_together(tmp_path))
    monkeypatch.setattr(compiling.KernelCache, "missed", compiling.KernelCache.missed)
    monkeypatch.setattr(compiling.KernelCache, "begun", {"a.first"})
    events: list[Any] = []

    def told(share: float | None, words: str) -> None:
        until = time.monotonic() + 300.0
        while not any(event[:1] == (share,) and words in event[1] for event in events if isinstance(event, tuple)):
            assert time.monotonic() < until, events
            time.sleep(0.01)

    try:
        with listening(events), prepare._Companion(["x.xml"]):
            compiling.KernelCache.missed += 1
            told(None, "1 so far")
            (tmp_path / "0123").write_text("b.second")
            (tmp_path / "4567").write_text("b.second")  # for arguments of another kind
            told(None, "2 so far")
            (tmp_path / "needed").write_text("a.first\nb.second\nc.third\nc.fourth")
            told(0.5, "2 of 4 kernels, ")
            (tmp_path / "89ab").write_text("d.of_no_step")
            told(0.6, "3 of 5 kernels, ")
    finally:
        compiling.compile_together(None)
    assert events[0] == "compiling" and events[-1] == "end"


def test_where_there_is_no_room_for_both_the_bar_stands_behind_what_is_being_done_now(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    line = progress._Moving("preparing " + "x" * 50, io.StringIO())
    line.part(0.5, "half of it")
    short = line._text()
    line.part(0.5, "half of it" * 6)
    assert "half of it" in short and "━" in short and "x" not in short
    assert line._text().count("x") > 40 and "━" not in line._text()


@compiling.kernel
def _called(x: float) -> float:
    return 2.0 * x


@compiling.part_of_its_caller
@compiling.kernel
def _written_into(x: float) -> float:
    return _called(x)


@compiling.kernel
def _entry(x: float) -> float:
    return _written_into(x) + math.sqrt(x)


def test_what_a_start_needs_is_what_its_entries_call_and_is_compiled_by_itself(tmp_path: Path) -> None:
    compiling.compile_together(tmp_path)
    try:
        compiling.tell_needed([_entry, _called])
    finally:
        compiling.compile_together(None)
    assert (tmp_path / "needed").read_text(encoding="utf-8").split() == [
        "test_progress._called",
        "test_progress._entry",
    ]


def test_a_sweep_says_nothing_in_a_pipe_and_how_far_it_is_on_a_terminal(tmp_path: Path) -> None:
    sweep = tmp_path / "s.xml"
    (tmp_path / "touch.xml").write_text((SCENES / "first_touch.xml").read_text(encoding="utf-8"), encoding="utf-8")
    sweep.write_text(
        '<sweep version="1.0" name="small" scene="touch.xml" seed="1"><seeds count="4"/>'
        '<collect><field name="f" of="finger.force" reduce="max"/></collect></sweep>'
    )
    terminal = Terminal("sweep", str(sweep), "-o", str(tmp_path / "a"), "--workers", "1")
    assert terminal.end() == 0, terminal.text
    seen = list(lines_on_screen(terminal.text))
    assert any(re.search(r"sweep: \d of 4 runs, .* a second", line) for line in seen), seen
    assert re.fullmatch(r"sweep: \d+\.\d s", seen[-2]) and seen[-1].startswith("4 of 4 runs")
    plain = program("sweep", str(sweep), "-o", str(tmp_path / "b"), "--workers", "1")
    assert (plain.returncode, plain.stderr) == (0, "") and plain.stdout.startswith("4 of 4 runs")
