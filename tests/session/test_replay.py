"""Replay: readings in, every command must come out the same; a difference is found and named."""

from __future__ import annotations

import contextlib
import random
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from campaign import size, tell
from running import RUNNABLE
from shipped import SCENES

import itouch
from itouch import joining
from itouch.plugin import Field, Record
from itouch.recording import Recording
from itouch.session.manifest import host_facts
from itouch.session.playback import Feed
from itouch.session.replaying import Mismatch, Replay
from itouch_tools.cli import main


def record(path: Path, scene: str | Path, seconds: float, *, seed: int = 1) -> itouch.Session:
    session = itouch.build(scene if isinstance(scene, Path) else SCENES / f"{scene}.xml", seed=seed)
    session.record(path)
    with contextlib.suppress(itouch.DeviceFaultError):
        session.run(seconds)
    session.close()
    return session


@pytest.mark.campaign
@pytest.mark.parametrize("scene", RUNNABLE)
def test_every_command_comes_out_the_same(scene: str, tmp_path: Path) -> None:
    for seed in range(size(1, 6)):
        seconds = 1.1 if size(1, 2) == 1 else 2.0 + 0.5 * seed
        session = record(tmp_path / "r.mcap", scene, seconds, seed=seed)
        outcome = itouch.replay(tmp_path / "r.mcap")
        assert (outcome.mismatches, outcome.first, outcome.skipped) == (0, None, 0)
        assert outcome.ticks == int(session.state["tick"])
        assert outcome.compared > 0
    tell(f"{scene}: {size(1, 6)} recordings replayed, 0 mismatches")


def test_a_changed_reading_gives_a_mismatch_that_is_named(tmp_path: Path) -> None:
    record(tmp_path / "r.mcap", "first_touch", 1.2)
    recording = itouch.read(tmp_path / "r.mcap")
    recording["arm"]["pose"][1000, 2] -= 2e-4
    outcome = itouch.replay(recording)
    assert outcome.mismatches > 0
    assert outcome.first is not None
    assert (outcome.first.tick, outcome.first.channel.split(".")[0]) == (1000, "arm")
    assert "recorded" in str(outcome.first)


def test_the_largest_difference_is_named_beside_the_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record(tmp_path / "r.mcap", "four_materials", 1.5)
    recording = itouch.read(tmp_path / "r.mcap")
    sent = recording["peltier"]["sent.current"]
    sent[700, 0] = np.nextafter(sent[700, 0], 9.0)
    sent[1300, 0] *= 0.75
    recording["arm"]["sent.wrench"][900, 1] += 1e-9  # all of the wrench is 0 there
    outcome = itouch.replay(recording)
    assert (outcome.mismatches, outcome.first.tick) == (3, 700)
    assert (outcome.largest.tick, outcome.largest.channel) == (900, "arm.sent.wrench")
    assert outcome.largest.share == pytest.approx(1.0)
    recording["arm"]["sent.wrench"][900, 1] = 0.0
    outcome = itouch.replay(recording)
    assert (outcome.largest.tick, outcome.largest.share) == (1300, pytest.approx(0.25))


@pytest.mark.parametrize(
    "recorded, replayed, share",
    [
        ([2.0, 0.0], [2.0, 0.0], 0.0), ([2.0, 1.0], [2.0, 1.5], 0.25), ([0.0, 0.0], [0.0, 1e-300], 1.0),
        ([np.nan, 1.0], [np.nan, 1.0], 0.0), ([np.nan, 1.0], [0.0, 1.0], np.inf), ([np.inf, 1.0], [np.inf, 1.0], 0.0),
        ([np.inf, 1.0], [-np.inf, 1.0], np.inf), (True, False, 1.0), (3, 4, 0.25), ([np.inf, 1.0], [np.inf, 1.5], 1 / 3),
    ],
)  # fmt: skip
def test_a_difference_is_told_as_a_share_of_the_value(recorded: object, replayed: object, share: float) -> None:
    assert Mismatch(0, "a", recorded, replayed).share == pytest.approx(share)


def test_other_versions_are_named_where_commands_differ(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    record(tmp_path / "r.mcap", "first_touch", 0.2)
    facts = host_facts()
    monkeypatch.setattr("itouch.session.replaying.host_facts", lambda: {**facts, "numpy": "9.9.9", "cores": 96})
    outcome = itouch.replay(tmp_path / "r.mcap")
    assert outcome.elsewhere == (f"numpy {np.__version__} (9.9.9 here)",)
    assert main(["replay", str(tmp_path / "r.mcap")]) == 0  # equal: then nothing is to be said of versions
    assert "9.9.9" not in "".join(capsys.readouterr())
    reading = itouch.read
    monkeypatch.setattr("itouch.recording.read", lambda path: _one_command_off(reading(path)))
    assert main(["replay", str(tmp_path / "r.mcap")]) == 1
    said = capsys.readouterr()
    assert "largest difference: 1 of the value; tick 100, arm.sent.wrench" in said.out
    assert f"was made with numpy {np.__version__} (9.9.9 here)" in said.err


def _one_command_off(recording: Recording) -> Recording:
    recording["arm"]["sent.wrench"][100, 0] += 1e-9
    return recording


def test_a_changed_command_is_found(tmp_path: Path) -> None:
    record(tmp_path / "r.mcap", "four_materials", 1.0)
    recording = itouch.read(tmp_path / "r.mcap")
    recording["peltier"]["sent.current"][700, 0] = np.nextafter(recording["peltier"]["sent.current"][700, 0], 9.0)
    outcome = itouch.replay(recording)
    assert (outcome.mismatches, outcome.first.tick, outcome.first.channel) == (1, 700, "peltier.sent.current")


def test_starting_in_the_middle_with_marks_and_a_second_enable(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "four_materials.xml", seed=3)
    session.run(0.9)
    session.save(tmp_path / "s.itouch")
    session = itouch.restore(tmp_path / "s.itouch")
    session.record(tmp_path / "r.mcap")
    session.run(0.3)
    session.mark("trial", 1)
    session.run(0.4)
    session.close()
    outcome = itouch.replay(tmp_path / "r.mcap")
    assert (outcome.ticks, outcome.mismatches, outcome.skipped) == (700, 0, 0)


@pytest.mark.campaign
@pytest.mark.parametrize("number", range(size(2, 20)))
def test_faults_are_replayed_through_the_safe_sequence(number: int, scenes: Path) -> None:
    generator = random.Random(number)
    device, kind = [("peltier", "nan"), ("table", "disconnect"), ("table", "bias"), ("peltier", "drift")][number % 4]
    path = scenes / "four_materials.xml"
    fault = f'<fault device="{device}" kind="{kind}" at="{generator.randrange(300, 1200)} ms"/>'
    path.write_text(path.read_text(encoding="utf-8").replace("</itouch>", fault + "</itouch>"), encoding="utf-8")
    session = record(scenes / "r.mcap", path, 3.0, seed=number)
    recording = itouch.read(scenes / "r.mcap")
    assert len(recording.faults) == len(session.statistics.faults)
    outcome = itouch.replay(recording)
    assert (outcome.mismatches, outcome.first) == (0, None)
    assert outcome.ticks == int(session.state["tick"])


def test_a_cut_recording_is_replayed_as_far_as_it_goes(tmp_path: Path) -> None:
    record(tmp_path / "r.mcap", "first_touch", 20.0)
    data = (tmp_path / "r.mcap").read_bytes()
    for percent in range(70, 30, -1):  # where the rows lie depends on how well they pack
        (tmp_path / "c.mcap").write_bytes(data[: len(data) * percent // 100])
        outcome = itouch.replay(tmp_path / "c.mcap")
        if outcome.ticks < 20000:
            break
    assert outcome.losses
    assert outcome.mismatches == 0
    assert 0 < outcome.ticks < 20000


def test_after_a_gap_the_replay_goes_on_from_the_next_state(tmp_path: Path) -> None:
    record(tmp_path / "r.mcap", "first_touch", 22.0)
    recording = itouch.read(tmp_path / "r.mcap")
    rows = recording._content.rows
    for name in rows:
        rows[name] = np.delete(rows[name], slice(4000, 4100))
    assert recording.lost == 100
    outcome = itouch.replay(recording)
    assert outcome.mismatches == 0
    state = next(s["tick"] for s in recording.states if s["tick"] > 4100)
    assert outcome.ticks == 4000 + 22_000 - state
    assert outcome.skipped == state - 4100


def test_step_by_step_for_a_window(tmp_path: Path) -> None:
    record(tmp_path / "r.mcap", "first_touch", 0.2)
    work = Replay(itouch.read(tmp_path / "r.mcap"))
    seen = []
    while work.step():
        seen.append(int(work.session.state["tick"]))
    assert seen == list(range(1, 201))


def test_the_compiled_calls_of_twins_are_bound_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Binding takes ten times as long as the call: a replay that bound in each tick took as long as the recording."""
    record(tmp_path / "r.mcap", "first_touch", 0.2)
    work = Replay(itouch.read(tmp_path / "r.mcap"))
    for _ in range(20):
        work.step()
    joined = list[object]()
    caller = joining.caller
    monkeypatch.setattr(joining, "caller", lambda bound: joined.append(bound) or caller(bound))
    while work.step():
        pass
    assert int(work.session.state["tick"]) == 200
    assert joined == []


def test_the_replay_command_tells_ticks_and_mismatches(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record(tmp_path / "r.mcap", "first_touch", 0.5)
    assert main(["replay", str(tmp_path / "r.mcap")]) == 0
    assert "500 ticks (0.500 s) replayed" in (said := capsys.readouterr().out)
    assert "0 mismatches" in said
    (tmp_path / "n.mcap").write_bytes(b"no")
    assert main(["replay", str(tmp_path / "n.mcap")]) == 2
    assert "not a recording" in capsys.readouterr().err


class _Recorded(dict[str, np.ndarray]):
    """A recording of readings, row by row: what a replay is fed with."""

    def __init__(self, tables: dict[str, np.ndarray]) -> None:
        super().__init__(tables)
        self.tracks = {name: SimpleNamespace(replay=True) for name in tables}
        self.ticks, self.faults = np.arange(2) + 7, list[dict[str, object]]()


def test_beyond_the_rows_that_were_recorded_there_is_no_reading_and_nothing_is_asked_of_it() -> None:
    """A recording may be cut, and a device may have left nothing in it."""
    rows = np.array(
        [(3, 1, 0.5, 40, 38, 2.0), (3, 2, 0.5, 41, 39, 2.5)],
        [("sequence", "i8"), ("age", "i8"), ("force", "f8"), ("measured", "i8"), ("left", "i8"), ("out.pose", "f8")],
    )
    named = {"arm": SimpleNamespace(reads=[SimpleNamespace(name="force")]), "other": SimpleNamespace(reads=[])}
    state = {"arm.sequence": np.array(3), "arm.age": np.array(2), "arm.trip": np.array(0)}
    session = SimpleNamespace(model=SimpleNamespace(devices=named), state=state)
    feed: Any = Feed(_Recorded({"arm": rows}), session)  # type: ignore[arg-type]
    reading, command, ticks = (Record.of([Field(name)]) for name in ("force", "pose", "ticks"))
    reading["force"] = 0.5
    found = []
    for feed.at in range(3):
        feed.measured("arm", 9, ticks["ticks"])
        found.append(
            (feed.uncounted("arm"), feed.give("arm", reading), ticks["ticks"].item(), feed.departed("arm", command))
        )
        feed.measured("other", 9, ticks["ticks"])
        of_the_other = feed.uncounted("other"), feed.give("other", reading), feed.departed("other", command)
        assert (*of_the_other, ticks["ticks"].item()) == (False, False, None, 9)
    assert found == [(False, False, 40, 38), (True, False, 41, 39), (False, False, 9, None)]
    assert (reading["force"].item(), command["pose"].item()) == (0.5, 2.5)
