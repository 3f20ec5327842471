"""Windows on sessions that run in real time in a servo process: faults, commands, several windows, their ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES
from test_pictures import without_display
from windows import asked, drive, scripts_of

import itouch
from itouch_evidence import viewer_servo

SCRIPTS = scripts_of("live_window")


@pytest.fixture(scope="module")
def said(request, screen, tmp_path_factory):
    folder = tmp_path_factory.mktemp("live")
    text = (SCENES / "four_materials_hurried.xml").read_text(encoding="utf-8")
    for path in SCENES.rglob("*.xml"):
        target = folder / path.relative_to(SCENES)
        target.parent.mkdir(exist_ok=True)
        target.write_text(path.read_text(encoding="utf-8"), encoding="utf-8")
    fault = '<fault device="table" kind="disconnect" at="1500 ms" for="100 ms"/></itouch>'
    scene = folder / "failing.xml"
    scene.write_text(text.replace("</itouch>", fault), encoding="utf-8")
    held = folder / "held.xml"
    held.write_text(text.replace('<safety force="3 N"/>', '<safety force="3 N" hold-to-run="yes"/>'), encoding="utf-8")
    words = [str(scene), str(SCENES / "four_materials_hurried.xml"), str(held)]
    return drive(asked(request, SCRIPTS), words, screen, folder)


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_of_live_window_events_runs_without_an_error(name: str, said):
    assert not said[name], said[name]


def view(*words: str, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "itouch_tools.cli", "view", *words], capture_output=True, text=True,
                          env=environment, timeout=600)  # fmt: skip


def test_view_says_what_is_missing(screen):
    nobody = view("there-is-no-such-session", environment=screen)
    assert nobody.returncode == 2
    assert "there is no running session" in nobody.stderr
    with itouch.launch(SCENES / "first_touch.xml", name="unseen", seconds=3600.0) as handle:
        for environment, says in ((without_display(), "no display"), (screen | {"DISPLAY": ":990"}, "no display")):
            blind = view("unseen", environment=environment)
            assert blind.returncode == 2
            assert says in blind.stderr and "Traceback" not in blind.stderr, blind.stderr
        assert handle.running


@pytest.mark.long
def test_a_killed_or_frozen_viewer_is_not_waited_for(screen, monkeypatch):
    monkeypatch.setenv("DISPLAY", screen["DISPLAY"])
    rows = viewer_servo.measure(0.3, 1, 4000)
    assert [(row.situation, row.triangles) for row in rows] == [
        (viewer_servo.NONE, 0), (viewer_servo.THERE, 0), (viewer_servo.KILLED, 0), (viewer_servo.FROZEN, 0),
        (viewer_servo.NONE, 4000), (viewer_servo.THERE, 4000),
    ]  # fmt: skip
    for row in rows:
        assert row.ticks > 0 and row.late.sum() == row.ticks, row.situation
    assert rows[2].reopened >= 1
    lines = viewer_servo.table(rows).splitlines()
    assert len(lines) == 7 and all(line.startswith(row.situation) for line, row in zip(lines[1:], rows, strict=True))


def test_run_opens_a_window_that_sigterm_ends_safely(screen, tmp_path: Path):
    report = tmp_path / "r.json"
    words = [sys.executable, "-m", "itouch_tools.cli", "run", str(SCENES / "four_materials_hurried.xml"), "--mute", "--report",
             str(report), "--for", "60s"]  # fmt: skip
    run = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=screen)
    end = time.monotonic() + 300
    while not any(info.owner == run.pid and info.phase == "running" for info in itouch.servo.sessions()):
        assert time.monotonic() < end and run.poll() is None
        time.sleep(0.05)
    time.sleep(0.5)
    os.kill(run.pid, signal.SIGTERM)
    said, _ = run.communicate(timeout=600)
    assert run.returncode == 128 + signal.SIGTERM, said
    assert "stopped by SIGTERM" in said and "Traceback" not in said
    assert report.exists()


def test_curves_are_those_of_the_loop_at_any_rate_of_pictures() -> None:
    """One picture in a second shows the samples that sixty show: those of the loop, none twice, none out of order."""
    from itouch.servo import launch
    from itouch_tools.viewer.servo_source import Attached
    from itouch_tools.viewer.signals import Ring

    with launch(SCENES / "first_touch.xml", twin="all", seconds=600.0) as handle:
        slow, quick = Attached(handle.link), Attached(handle.link)
        rings = Ring(slow.model), Ring(slow.model)
        until = time.monotonic() + 300.0
        begin = last = handle.link.seconds
        while handle.link.seconds < begin + 2.4 and time.monotonic() < until:
            quick.advance(0.02, rings[1])
            if handle.link.seconds - last > 0.8:
                slow.advance(0.8, rings[0])
                last = handle.link.seconds
            time.sleep(0.01)
        slow.advance(0.8, rings[0])
        quick.advance(0.02, rings[1])
        handle.request_stop()
        handle.wait(300)
    for ring in rings:
        times, values = ring.curves(ring.charts[0])
        assert len(times) > 50 and (np.diff(times) > 0).all()
        assert np.median(np.diff(times)) < 0.0125  # as often as the loop is sampled, not as pictures are drawn
        assert values.shape[1] == len(times)
