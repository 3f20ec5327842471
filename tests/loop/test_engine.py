"""What a run must hold to: determinism, order, events, exact continuation, safety."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.loop import Status
from itouch.plugin import Contact

Write = Callable[[str, str], Path]
FIRST = SCENES / "first_touch.xml"


def test_a_run_ends_with_the_motion() -> None:
    engine = itouch.build(FIRST)
    engine.run()
    assert engine.done
    assert engine.seconds == pytest.approx(2.6, abs=2e-3)
    (contact,) = engine.report()["contacts"]
    assert contact["object"] == "block"
    assert contact["plate"] is False
    assert 0.5 < contact["peak_force_N"] <= 3.0


def test_equal_seeds_give_equal_bytes_and_reports() -> None:
    runs = [itouch.build(FIRST, seed=seed) for seed in (5, 5, 6)]
    for engine in runs:
        engine.run(2.0)
    first, same, other = runs
    assert first.state.tobytes() == same.state.tobytes()
    assert first.state.tobytes() != other.state.tobytes()  # the seed itself is State
    reports = [engine.report() for engine in (first, same)]
    for report in reports:
        report.pop("wall_s")
        for key in ("tick_us", "parts_us"):
            report["servo"].pop(key)
    assert reports[0] == reports[1]


@pytest.mark.parametrize("stop", [0, 1, 333, 901, 1999])
def test_a_restored_session_goes_on_to_the_same_bytes(tmp_path: Path, stop: int) -> None:
    straight = itouch.build(FIRST, seed=3)
    straight.run(2.3)
    broken = itouch.build(FIRST, seed=3)
    broken.run(stop * broken.model.period)
    broken.save(tmp_path / "s.itouch")
    again = itouch.restore(tmp_path / "s.itouch")
    assert again.state.tobytes() == broken.state.tobytes()
    again.run(2.3 - again.seconds)
    assert again.state.tobytes() == straight.state.tobytes()
    assert again.report()["contacts"] == straight.report()["contacts"]


def test_restoring_in_a_new_process(tmp_path: Path) -> None:
    straight = itouch.build(FIRST, seed=3)
    straight.run(2.0)
    half = itouch.build(FIRST, seed=3)
    half.run(1.237)
    half.save(tmp_path / "s.itouch")
    code = (
        "import sys, itouch\n"
        f"engine = itouch.restore({str(tmp_path / 's.itouch')!r})\n"
        "engine.run(2.0 - engine.seconds)\n"
        "sys.stdout.buffer.write(engine.state.tobytes())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert done.stdout == straight.state.tobytes()


def test_a_run_that_nobody_listens_to_is_that_of_single_ticks_and_ends_with_the_same_one() -> None:
    alone, told, at_once, asked = (itouch.build(FIRST) for _ in range(4))
    ends: list[int] = []
    told.taps.append(ends.append)
    looks: list[int] = []
    told.run()
    at_once.run(each=lambda: looks.append(at_once.ticks), every=7)
    while not alone.done:
        alone.tick()
    asked.run(until=lambda: asked.done)
    assert ends == list(range(alone.ticks))
    assert looks == list(range(7, alone.ticks + 1, 7))
    assert {one.state.tobytes() for one in (alone, told, at_once, asked)} == {alone.state.tobytes()}
    again = itouch.build(FIRST)
    for seconds in (0.001, 0.013, 1.0, 0.016, 0.0):
        again.run(seconds)
    again.run((alone.ticks - 1030) * again.model.period)
    assert again.state.tobytes() == alone.state.tobytes()


def test_ticks_in_which_all_is_made_safe_between_two_of_a_run_are_none_of_its_own() -> None:
    """Whether anybody is told of each tick, or asked after it, does not decide what a run counts."""
    found: list[tuple[list[int], bytes]] = []
    for asked in (None, lambda: False):
        session, begins = itouch.build(FIRST), list[int]()

        def rest(session: itouch.Session = session, begins: list[int] = begins) -> None:
            begins.append(session.ticks)
            session.park()

        session.run(1.0, until=asked, each=rest, every=300)
        found.append((begins, session.state.tobytes()))
    assert found[0] == found[1]
    assert len(found[0][0]) == 3 and found[0][0][1] > 600  # the safe sequence has taken ticks


def test_a_run_without_listeners_that_is_asked_to_stop_ends_within_a_few_ticks() -> None:
    session = itouch.build(FIRST)
    session.run(5.0, each=session.stop, every=5)
    assert session.ticks == 5
    session.on.begin.append(session.stop)
    session.run(5.0)
    assert session.ticks == 5  # asked before the first of them
    del session.on.begin[-1]
    session.run(5.0)
    assert session.ticks == 5005


def test_events_come_in_order() -> None:
    engine = itouch.build(FIRST)
    engine.run()
    table = engine.state["events.table"][: int(engine.state["events.count"])]
    kinds = [Contact(int(kind)) for kind in table["kind"]]
    assert kinds == [Contact.NEAR, Contact.BEGIN, Contact.END]
    assert list(table["tick"]) == sorted(table["tick"])
    assert np.allclose(table["normal"][1], (0, 0, 1))


def test_near_tells_the_time_to_contact() -> None:
    engine = itouch.build(FIRST)
    predicted: list[tuple[float, float]] = []
    while int(engine.state["finger.contact.object"]) < 0:
        engine.tick()
        left = float(engine.state["finger.time_to_contact"])
        if 0.0 < left < 0.01:
            predicted.append((engine.seconds, left))
    begin = engine.seconds
    assert len(predicted) >= 5
    for time, left in predicted:
        assert time + left == pytest.approx(begin, abs=4e-3)


def test_force_is_stiffness_times_penetration_inside_the_friction_cone() -> None:
    engine = itouch.build(FIRST)
    touched = 0
    while not engine.done:
        engine.tick()
        if int(engine.state["finger.object"]) < 0:
            continue
        touched += 1
        force, normal = engine.state["finger.force"], engine.state["finger.normal"]
        along = float(force @ normal)
        assert along == pytest.approx(1200.0 * float(engine.state["finger.penetration"]), rel=1e-6, abs=1e-9)
        across = float(np.linalg.norm(force - along * normal))
        assert across <= 0.4 * along + 1e-9
    assert touched > 500


def test_the_arm_never_gets_more_than_its_limit(write: Write) -> None:
    text = FIRST.read_text().replace('plugin="usb-arm"/>', 'plugin="usb-arm"><limits force="0.4 N"/></device>')
    engine = itouch.build(write("s.xml", text))
    greatest = 0.0
    while not engine.done:
        engine.tick()
        greatest = max(greatest, float(np.linalg.norm(engine.state["arm.sent.wrench"][:3])))
    assert greatest == pytest.approx(0.4, rel=1e-9)
    assert int(engine.state["arm.clamped"]) > 100


def test_not_a_number_stops_and_latches() -> None:
    engine = itouch.build(FIRST)
    engine.run(1.0)
    engine.state["arm.twin.pose"] = np.nan
    engine._rigs[0].coupling._end[:] = np.nan  # the finger is gone, too
    engine.state["finger.hand.position"] = np.nan
    with pytest.raises(itouch.DeviceFaultError, match="arm"):
        engine.run(0.1)
    assert engine.status("arm") is Status.FAULT
    assert np.all(engine.state["arm.sent.wrench"] == 0.0)
    (fault,) = engine.report()["faults"]
    assert fault["device"] == "arm"
    assert fault["trip"] == "not-a-number"
    assert "first_touch.xml" in fault["scene"]


def test_state_is_one_packed_record_without_gaps() -> None:
    engine = itouch.build(FIRST)
    fields = engine.state.dtype.fields or {}
    assert sum(kind.itemsize for kind, _ in (entry[:2] for entry in fields.values())) == engine.state.nbytes
    assert "objects.pose" in engine.state
    assert "objects.twist" in engine.state


def test_a_session_is_run_by_one_thread_at_a_time() -> None:
    """Two that tick at once would write one State, and send devices what neither of them has checked."""
    alone, session, refused = itouch.build(FIRST), itouch.build(FIRST), list[str]()
    alone.run(0.05)

    def beside() -> None:
        for call in (session.tick, lambda: session.run(0.01)):
            try:
                call()
            except itouch.EngineError as error:
                refused.append(str(error))

    def each() -> None:
        if session.ticks == 20:
            other = threading.Thread(target=beside)
            other.start()
            other.join()

    session.run(0.05, each=each)
    assert session.state.tobytes() == alone.state.tobytes()
    assert len(refused) == 2, "a second thread ran a session that was being run"
    assert all("is running already" in sentence and "stop()" in sentence for sentence in refused)
    session.run(0.01)  # when it is over, whoever wants to may go on


def test_nothing_that_a_tick_calls_can_run_another() -> None:
    session, refused = itouch.build(FIRST), list[str]()

    def tap(tick: int) -> None:
        if tick == 5:
            with pytest.raises(itouch.EngineError, match="is running already") as caught:
                session.tick()
            refused.append(str(caught.value))

    session.taps.append(tap)
    session.run(0.01)
    assert refused and session.ticks == 10


def test_running_without_a_motion_needs_a_time(write: Write) -> None:
    engine = itouch.build(write("s.xml", '<itouch version="1.0"/>'))
    with pytest.raises(ValueError, match="for how many seconds"):
        engine.run()
    engine.run(0.01)
    assert int(engine.state["tick"]) == 10


@pytest.mark.parametrize("seconds", [-1.0, float("nan"), float("inf"), 1e300, 1e306])
def test_a_time_that_no_session_lasts_is_refused(seconds: float, tmp_path: Path) -> None:
    """Of 1e306 s there is no finite number of ticks; 1e300 s had no end."""
    engine = itouch.build(SCENES / "first_touch.xml")
    with pytest.raises(ValueError, match=r"seconds = .* must be a finite number, at least 0 s, at most 1e\+09 s"):
        engine.run(seconds)
    with pytest.raises(ValueError, match=r"seconds = .* must be a finite number"):
        itouch.launch(SCENES / "first_touch.xml", seconds=seconds)
    with engine.saving(tmp_path / "s.itouch", 1e306):  # not while it runs
        engine.run(0.1)
    assert not list(tmp_path.iterdir())


def test_stiffness_is_lowered_to_what_is_stable_and_said(write: Write) -> None:
    text = FIRST.read_text().replace('stiffness="1.2 N/mm"', 'stiffness="20 N/mm"')
    engine = itouch.build(write("s.xml", text))
    (notice,) = engine.notices
    assert "20000 N/m" in notice
    assert "rendering 3000 N/m" in notice


def test_the_layout_of_a_probe_is_that_of_the_compiled_tick() -> None:
    from itouch.loop import render
    from itouch.twin import mechanics

    state = itouch.build(FIRST).state
    figures = state.flat("finger.hip", "finger.tracking")
    assert len(figures) == render.FIGURES
    for name, index in (
        ("velocity", render.VELOCITY), ("proxy", render.PROXY), ("normal", render.NORMAL), ("point", render.POINT),
        ("penetration", render.PENETRATION), ("near_distance", render.NEAR_DISTANCE), ("tracking", render.TRACKING),
        ("contact_force", render.CONTACT_FORCE), ("plate_top", render.PLATE_TOP), ("plate_yield", render.PLATE_YIELD),
    ):  # fmt: skip
        figures[index] = 123.5 + index
        assert float(state[f"finger.{name}"].reshape(-1)[0]) == 123.5 + index
    assert len(state.flat("finger.plate_force", "finger.total_force")) == mechanics.FIGURES


def test_twins_that_were_closed_go_on_with_the_finger_s_speed() -> None:
    """Nothing has moved meanwhile: only hardware is begun anew from rest."""
    speeds = []
    for closes in (False, True):
        session = itouch.build(FIRST)
        session.run(0.35)
        if closes:
            session.close()
        session.run(session.model.period)
        speeds.append((*session.state["finger.velocity"], session.state["finger.time_to_contact"].item()))
    assert speeds[1] == speeds[0]
    assert speeds[0][2] < -0.01
