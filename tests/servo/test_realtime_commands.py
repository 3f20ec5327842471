"""The command line in real time: exit codes, signals, the doctor, the bench; no figure is asserted."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import campaign
import pytest
from program import program as run
from shipped import SCENES

from itouch_evidence.bench_loop import PROCESS, PYTHON, THREAD, Row, measure
from itouch_tools.cli.doctor.diagnosis import Diagnosis
from itouch_tools.cli.doctor.verdict import Measured, judge

FIRST = str(SCENES / "first_touch.xml")


def test_real_pace_writes_the_report_and_the_session(tmp_path: Path) -> None:
    report, session = tmp_path / "r.json", tmp_path / "s.itouch"
    done = run(FIRST, "--headless", "--pace", "real", "--for", "0.9s", "--report", str(report), "--save", str(session))
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    content = json.loads(report.read_text())
    assert content["pace"] == "real"
    assert content["simulated_s"] == pytest.approx(0.9, abs=2e-3)
    assert content["servo"]["overruns"] is not None
    assert content["contacts"][0]["object"] == "block"
    assert session.exists()
    assert f"saved {session}" in done.stdout


@pytest.mark.parametrize("number", campaign.some([signal.SIGHUP, signal.SIGINT], 1))
def test_signals_end_a_session_in_real_time_with_a_report(tmp_path: Path, number: signal.Signals) -> None:
    report = tmp_path / "r.json"
    words = [FIRST, "--headless", "--pace", "real", "--for", "60s", "--report", str(report)]
    process = subprocess.Popen(
        [sys.executable, "-m", "itouch_tools.cli", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 300
    while process.poll() is None and not _running(process.pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(number)
    _, said = process.communicate(timeout=600)
    assert process.returncode == 128 + number, said
    assert f"stopped by {number.name}; the devices are safe" in said
    assert json.loads(report.read_text())["servo"]["ticks"] > 0


def test_a_servo_process_that_is_killed_is_told_and_exits_with_1() -> None:
    from itouch.servo import sessions

    words = [FIRST, "--headless", "--pace", "real", "--for", "60s"]
    process = subprocess.Popen(
        [sys.executable, "-m", "itouch_tools.cli", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 300
    while process.poll() is None and not _running(process.pid) and time.monotonic() < deadline:
        time.sleep(0.02)
    (servo,) = [info.pid for info in sessions() if info.owner == process.pid]
    os.kill(servo, signal.SIGKILL)
    _, said = process.communicate(timeout=600)
    assert process.returncode == 1, said
    assert "the servo process was killed by SIGKILL" in said
    assert "Traceback" not in said


def _running(owner: int) -> bool:
    """Tell whether the session of a launcher runs, long enough for its launcher to listen to signals."""
    from itouch.servo import attach, sessions

    names = [info.name for info in sessions() if info.owner == owner and info.phase == "running"]
    if not names:
        return False
    with attach(names[0]) as link:
        return link.tick > 300


def test_a_scene_that_is_wrong_exits_with_2(tmp_path: Path) -> None:
    path = tmp_path / "wrong.xml"
    path.write_text(Path(FIRST).read_text().replace("stiffness", "stifness"), encoding="utf-8")
    done = run(str(path), "--headless", "--pace", "real")
    assert done.returncode == 2
    assert "did you mean 'stiffness'" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_fault_exits_with_1_and_names_the_line(tmp_path: Path) -> None:
    path = tmp_path / "fault.xml"
    fault = '<fault device="arm" kind="nan" at="0.1 s"/></itouch>'
    path.write_text(Path(FIRST).read_text().replace("</itouch>", fault), encoding="utf-8")
    done = run(str(path), "--headless", "--pace", "real")
    assert done.returncode == 1
    assert "fault[not-a-number]: device 'arm'" in done.stdout
    assert f"{path}:" in done.stdout
    assert "Traceback" not in done.stderr


def test_the_doctor_says_what_is_there_and_what_to_do() -> None:
    done = run("doctor", "--json")
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    names = {check["name"] for check in content["checks"]}
    assert names >= {"timer", "priority", "display", "graphics", "sound", "usb", "compile cache", "memory lock"}
    assert {check["status"] for check in content["checks"]} <= {"ok", "lack", "note"}
    assert all(check["advice"] for check in content["checks"] if check["status"] == "lack")
    assert content["measured"] is None
    assert content["finger"] in (None, False)


def test_the_doctor_measures_the_loop_idle_and_busy() -> None:
    done = run("doctor", "--measure", "0.2s", "--json")
    assert done.returncode == 0, done.stderr
    content = json.loads(done.stdout)
    assert [row["load"] for row in content["measured"]] == ["idle", "busy"]
    assert all(row["ticks"] > 0 for row in content["measured"])
    assert content["finger"] in (True, False)
    assert "finger" in content["verdict"]


def _measured(late: float, overruns: int) -> Measured:
    return Measured("busy", 10_000, 5.0, 20.0, late, 100.0, overruns, {"wake-up": overruns} if overruns else {})


@pytest.mark.parametrize(
    ("priority", "late", "overruns", "finger"),
    [("ok", 200.0, 0, True), ("ok", 200.0, 11, False), ("ok", 6000.0, 1, False), ("lack", 200.0, 0, False)],
)
def test_the_doctors_verdict_follows_priority_lateness_and_overruns(
    priority: str, late: float, overruns: int, finger: bool
) -> None:
    verdict = judge([Diagnosis("priority", priority, "")], [_measured(late, overruns)])
    assert verdict.finger is finger
    assert ("NOT" in verdict.sentence) is not finger


@pytest.mark.long
def test_the_bench_puts_the_loops_side_by_side() -> None:
    told: list[Row] = []
    rows = measure(0.3, loads_wanted=[PYTHON], architectures=[THREAD, PROCESS], tell=told.append)
    assert rows == told
    assert [(row.architecture, row.load) for row in rows] == [(THREAD, PYTHON), (PROCESS, PYTHON)]
    assert all(row.ticks > 0 for row in rows)
    assert run("bench", "loop", "--seconds", "-1").returncode == 2


def test_nothing_is_left_in_shared_memory() -> None:
    assert not [name for name in os.listdir("/dev/shm") if "itouch" in name]
