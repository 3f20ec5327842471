"""A State that was stored in the middle of a safe sequence: what was under way is carried out anew."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from exchange_phases import wired, wired_phases
from shipped import SCENES

import itouch
from itouch.faults import Kind
from itouch.loop import DeviceFaultError
from itouch.plugin import DeviceError
from itouch.safety import Status
from itouch.safety.actuation import BACKWARDS, HELD
from itouch.session import Session
from itouch_evidence.faults import phases, prepared
from itouch_evidence.faults.behind_wires import Pair, run
from itouch_tools.cli import main

#: Ticks of the safe sequence of a table that is wired backwards in which it is held, and in which it is driven back.
IN_A_HOLD, ON_ITS_WAY = 40, 90


def height(session: Session) -> float:
    place = next(one for one in session.runners if one.model.name == "table").true_position()
    assert place is not None
    return float(place[2])


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Save a session in which an arm fails over a table that is wired backwards, while it is stopped."""
    folder, found = tmp_path_factory.mktemp("stops"), {}
    session = prepared(SCENES / "four_materials.xml")
    session.adopt(phases(session)["contact"])
    session.inject("table", "reversed-sign", at=session.seconds + 0.02)
    session.inject("arm", "nan", at=session.seconds + 0.05)
    passed: list[int] = []

    def save(tick: int) -> None:
        if session.state["stopping"].item():
            passed.append(tick)
            if len(passed) in (IN_A_HOLD, ON_ITS_WAY):
                found[len(passed)] = folder / f"{len(passed)}.session"
                session.save(found[len(passed)])

    session.taps.append(save)
    with pytest.raises(DeviceFaultError):
        session.run(1.0)
    assert not session.state["stopping"].item()
    return found


@pytest.mark.parametrize(("when", "way"), [(IN_A_HOLD, HELD), (ON_ITS_WAY, BACKWARDS)])
def test_a_surface_is_minded_after_a_restore_as_it_was_before(stored: dict[int, Path], when: int, way: int) -> None:
    """One that was driven back went on for ever, to whichever end of its travel that led."""
    session = itouch.restore(stored[when])
    assert (session.state["table.stopped"].item(), session.state["stopping"].item()) == (way, 1)
    begin, heights = height(session), []
    session.taps.append(lambda tick: heights.append(height(session)))
    with pytest.raises(DeviceFaultError, match="device 'arm' was stopped by not-a-number"):
        session.run(0.1)
    assert session.state["stopping"].item() == 0
    assert session.state["table.stopped"].item() == HELD
    assert max(heights) <= begin + 1e-4
    session.run(0.2)  # nothing acts, and nothing moves
    assert heights[-1] == pytest.approx(heights[-150], abs=1e-4)
    assert all(one.latch.status is not Status.ENABLED for one in session.runners)


def test_what_goes_the_wrong_way_when_the_sequence_begins_anew_is_noticed(stored: dict[int, Path]) -> None:
    """The drive obeys again after the restore: what was driven back would come up to the end of its travel."""
    session = itouch.restore(stored[ON_ITS_WAY])
    session.inject("table", "freeze", at=1e6)
    begin, heights = height(session), []
    session.taps.append(lambda tick: heights.append(height(session)))
    with pytest.raises(DeviceFaultError):
        session.run(0.1)
    session.run(0.3)
    assert max(heights) < begin + 0.02
    assert heights[-1] < begin


def test_rearming_ends_what_was_under_way(stored: dict[int, Path]) -> None:
    session = itouch.restore(stored[IN_A_HOLD])
    session.inject("arm", "freeze", at=1e6)
    session.inject("table", "freeze", at=1e6)
    session.rearm()
    assert session.state["stopping"].item() == 0
    session.run(0.02)
    assert all(one.latch.status is Status.ENABLED for one in session.runners)


def test_a_restored_session_that_was_stopped_says_so_until_it_is_rearmed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It went on with safe commands, and neither `run` nor the report's notices said that it was stopped."""
    path, rearmed = tmp_path / "stopped.itouch", tmp_path / "rearmed.itouch"
    scene = tmp_path / "scene.xml"
    fault = '<fault device="arm" kind="nan" at="20 ms" for="10 ms"/></itouch>'
    scene.write_text((SCENES / "first_touch.xml").read_text(encoding="utf-8").replace("</itouch>", fault))
    session = itouch.build(scene)
    with pytest.raises(DeviceFaultError):
        session.run()
    session.run(0.05)
    session.save(path)
    assert main(["run", str(path), "--headless", "--for", "10ms"]) == 0
    assert "device 'arm' was stopped by not-a-number at 0.020 s" in capsys.readouterr().err
    session = itouch.restore(path)
    assert sum("re-armed" in one for one in session.notices) == 1
    session.rearm()
    session.save(rearmed)
    assert not any("re-armed" in one for one in itouch.restore(rearmed).notices)


def test_a_session_that_was_coming_to_rest_comes_to_rest(tmp_path: Path) -> None:
    session = prepared(SCENES / "four_materials.xml")
    session.adopt(phases(session)["contact"])
    states: list[bytes] = []
    session.taps.append(lambda tick: states.append(session.state.tobytes()))
    session.park()
    assert len(states) > 5
    session.adopt(states[2])
    session.taps.clear()
    before, ticks = height(session), session.ticks
    session.run(0.001)
    assert session.ticks > ticks + 1  # the sequence, and a tick
    assert height(session) < before - 0.003
    assert session.fault is None


def test_hardware_starts_open_and_is_not_in_a_stop() -> None:
    pair = Pair(SCENES / "four_materials.xml", 20, threads=False)
    pair.host.state["stopping"][...] = 1
    pair.host.adopt(pair.host.state.tobytes())
    assert pair.host.state["stopping"].item() == 0
    pair.close()


def test_hardware_that_is_restored_in_the_middle_of_a_blind_retreat_stays_stopped(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Reversed and lying, behind exchanges: stored as it is led by legs, the trip stays, and nothing moves or presses."""
    pair, phases = wired(), wired_phases(tmp_path_factory)
    table = next(one for one in pair.host.runners if one.model.name == "table")
    kept: list[tuple[bytes, bytes]] = []
    ticks: list[int] = []

    def keep(tick: int) -> None:
        if pair.host.state["stopping"].item() and table.latch.trip:
            ticks.append(tick)
            if len(ticks) % 120 == 30:
                kept.append((pair.world.state.tobytes(), pair.host.state.tobytes()))

    pair.host.taps.append(keep)
    run(pair, "contact", phases["contact"], [("table", Kind.SPIKE, 0), ("table", Kind.REVERSED_SIGN, 1)])
    pair.host.taps.remove(keep)
    assert len(kept) >= 3
    place = next(one.true_position() for one in pair.world.runners if one.model.name == "table")
    assert place is not None
    for states in kept:
        pair.adopt(states)
        assert {one.latch.status for one in pair.host.runners} == {Status.CLOSED}
        begin, pressed = float(place[2]), pair.world.state["finger.plate_force"].item()
        for _ in range(500):
            pair._exchange()
        assert float(place[2]) < begin + 0.001  # what it was about to do when it was let go of
        assert pair.world.state["finger.plate_force"].item() < pressed + 0.5
        with pytest.raises(DeviceError, match="device 'table' was stopped by sensor-jump"):
            pair.enable()
        assert Status.ENABLED not in {one.latch.status for one in pair.host.runners}
    pair.close()


#: What a new process finds, with the threads that real devices have, of each stop that was stored: one line of JSON each.
_IN_THREADS = """
import contextlib, json, sys, time
from pathlib import Path
from itouch import EngineError
from itouch.plugin import DeviceError
from itouch_evidence.faults.behind_wires import Pair

scene, *stops = sys.argv[1:]
for stop in stops:
    world = Path(stop).with_suffix(".world").read_bytes()
    pair = Pair(scene, 20, threads=True, slots=2, stored=(world, Path(stop)))
    table = next(one for one in pair.host.runners if one.model.name == "table")
    place = next(one.true_position() for one in pair.world.runners if one.model.name == "table")
    before, pressed, said = float(place[2]), pair.world.state["finger.plate_force"].item(), []
    statuses, highest = {one.latch.status.name for one in pair.host.runners}, 0.0
    for act in (pair.host.tick, pair.enable, pair.host.rearm, pair.enable, pair.host.tick):
        try:
            act()
            said.append("")
        except (DeviceError, EngineError) as error:
            said.append(str(error))
        for _ in range(100):
            pair._exchange()
            time.sleep(1e-3)
            highest = max(highest, float(place[2]))
        statuses |= {one.latch.status.name for one in pair.host.runners}
    found = dict(rose=highest - before, harder=pair.truth.plate_force - pressed, said=said, statuses=sorted(statuses),
                 trip=table.latch.trip.label, threads=[type(one.gate.device).__name__ for one in pair.host.runners])
    print(json.dumps(found), flush=True)
    with contextlib.suppress(DeviceError):
        pair.close()
"""


def test_hardware_behind_threads_that_is_restored_in_the_middle_of_a_blind_retreat_stays_stopped(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The same in a new process: nothing asks for less than that a table that lies is neither enabled nor driven."""
    pair, phases = wired(), wired_phases(tmp_path_factory)
    table = next(one for one in pair.host.runners if one.model.name == "table")
    stops: list[Path] = []
    ticks: list[int] = []

    def keep(tick: int) -> None:
        if pair.host.state["stopping"].item() and table.latch.trip:
            ticks.append(tick)
            if len(ticks) % 120 == 30:
                stops.append(tmp_path / f"{tick}.session")
                pair.host.save(stops[-1])
                stops[-1].with_suffix(".world").write_bytes(pair.world.state.tobytes())

    pair.host.taps.append(keep)
    run(pair, "contact", phases["contact"], [("table", Kind.NAN, 0), ("table", Kind.REVERSED_SIGN, 1)])
    pair.close()
    assert len(stops) >= 3
    words = [sys.executable, "-c", _IN_THREADS, str(SCENES / "four_materials.xml"), *map(str, stops)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(found) == len(stops)
    for one in found:
        assert one["threads"] == ["ThreadedDevice"] * 3
        assert (one["trip"], one["statuses"]) == ("not-a-number", ["FAULT", "OPEN"])
        ticked, enabled, rearmed, again, at_last = one["said"]
        assert ticked == at_last and ticked.startswith("call engine.enable() first: ")
        assert enabled == again and enabled.startswith("device 'table' was stopped by not-a-number at tick ")
        assert rearmed.startswith("device 'table' can't be re-armed: it reads NaN (pose) ")
        assert one["rose"] < 0.001  # what it was about to do when it was let go of
        assert one["harder"] < 0.5
