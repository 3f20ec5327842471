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
from windows import asked, drive

import itouch
from itouch_evidence import viewer_servo

PREPARE = """
import sys, time, itouch, pyglet
pyglet.options.audio = ("silent",)
from pyglet.window import key
from itouch.servo import attach
from itouch_tools.viewer.offscreen import open_window
from itouch_tools.viewer.window import Window
Window.__init__.__kwdefaults__.update(width=640, height=400)  # a quarter of what software would have to draw
def begin(scene):
    global handle, window, situation
    handle = itouch.launch(scene, linger=True)
    window = open_window(handle.link, time.perf_counter, handle=handle, mute=True)
    situation = window.source.situation
FAILING, SOUND, HELD = sys.argv[2:5]
def until(condition, what, windows=()):
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end, what
        for one in (window, *windows):
            one.dispatch_events()
            one.frame()
        time.sleep(0.04)  # a frame costs a core some 50 ms where software draws it
def press(symbol):
    window.dispatch_event("on_key_press", symbol, 0)
    window.dispatch_events()
"""

SCRIPTS = {
    "a fault is told, R re-arms, Esc ends": """
        begin(FAILING)
        until(lambda: any("an injected fault" in fault["cause"] for fault in situation.faults), "fault")
        assert situation.faults[0]["device"] == "table" and handle.running
        assert situation.late_us is not None and situation.tick_us > 0 and situation.overruns is not None
        assert not situation.paused
        tick = handle.link.tick
        press(key.R)
        until(lambda: not situation.faults, "no fault any more")
        until(lambda: handle.link.tick > tick, "goes on")
        press(key.ESCAPE)
        assert window.closed and handle.wait(20)
        assert handle.report()["faults"][0]["rearmed_s"] > 1.5
        handle.close()
    """,
    "Space lets the machine move, letting go stops it, and R with Space goes on": """
        def goes(ticks):  # on a busy machine the switch may be let go in between
            if situation.faults:
                press(key.R)
            return handle.link.tick > ticks
        begin(HELD)
        handle.command("enable")
        until(lambda: situation.waiting, "waiting")
        assert handle.link.tick == 0
        window.dispatch_event("on_key_press", key.SPACE, 0)
        until(lambda: goes(50) and not situation.waiting, "moves")
        window.dispatch_event("on_key_release", key.SPACE, 0)
        until(lambda: situation.faults, "let go")
        assert situation.faults[0]["trip"] == "released"
        press(key.R)
        until(lambda: "nobody holds" in situation.message, "refused")
        tick = handle.link.tick
        window.dispatch_event("on_key_press", key.SPACE, 0)
        until(lambda: True, "a frame")
        press(key.R)
        until(lambda: goes(tick + 10), "goes on")
        time.sleep(0.6)  # the window hangs
        until(lambda: situation.faults and situation.faults[0]["tick"] > tick, "let go by itself")
        handle.request_stop()
        try:
            handle.wait(20)
        except itouch.DeviceFaultError as fault:
            assert "switch" in str(fault)
        window.source.stop()
        handle.close()
    """,
    "a fault that nobody re-arms is the end's error": """
        begin(FAILING)
        until(lambda: situation.faults, "fault")
        press(key.ESCAPE)
        try:
            handle.wait(20)
        except itouch.DeviceFaultError as fault:
            assert fault.device == "table"
        else:
            raise AssertionError("no error")
        handle.close()
    """,
    "P pauses in two windows alike; one that goes leaves the other": """
        begin(SOUND)
        link = attach(handle.name)
        other = open_window(link, time.perf_counter, mute=True)
        press(key.P)
        until(lambda: situation.paused and other.source.situation.paused, "both paused", (other,))
        tick = handle.link.tick
        other.dispatch_event("on_key_press", key.P, 0); other.dispatch_events()
        until(lambda: not situation.paused and handle.link.tick > tick, "goes on", (other,))
        other.dispatch_event("on_close"); other.dispatch_events(); other.close()
        tick = handle.link.tick
        until(lambda: handle.link.tick > tick + 20, "goes on without it")
        assert window.source.rearm() == "there is nothing to re-arm"
        handle.stop()
        until(lambda: "over" in situation.message, "is over")
        handle.close()
    """,
}


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
    return drive(PREPARE, asked(request, SCRIPTS), words, screen, folder)


@pytest.mark.parametrize("name", SCRIPTS)
def test_live_window(name: str, said):
    assert not said[name], said[name]


def view(*words: str, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "itouch_tools.cli", "view", *words], capture_output=True, text=True,
                          env=environment, timeout=60)  # fmt: skip


def test_view_says_what_is_missing(screen):
    nobody = view("there-is-no-such-session", environment=screen)
    assert nobody.returncode == 2
    assert "there is no running session" in nobody.stderr
    with itouch.launch(SCENES / "first_touch.xml", name="unseen", seconds=30.0) as handle:
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
    end = time.monotonic() + 60
    while not any(info.owner == run.pid and info.phase == "running" for info in itouch.servo.sessions()):
        assert time.monotonic() < end and run.poll() is None
        time.sleep(0.05)
    time.sleep(0.5)
    os.kill(run.pid, signal.SIGTERM)
    said, _ = run.communicate(timeout=60)
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
        until = time.monotonic() + 60.0
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
        handle.wait(30)
    for ring in rings:
        times, values = ring.curves(ring.charts[0])
        assert len(times) > 50 and (np.diff(times) > 0).all()
        assert np.median(np.diff(times)) < 0.0125  # as often as the loop is sampled, not as pictures are drawn
        assert values.shape[1] == len(times)
