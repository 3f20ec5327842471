"""The command line as a person uses it: exit codes, messages, reports; never a traceback."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import campaign
import pytest
from program import program as run
from shipped import SCENES
from third_party_plugins import install

FIRST = str(SCENES / "first_touch.xml")


def process(*words: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Call the program as a process of its own, as a shell does."""
    return subprocess.run(
        [sys.executable, "-m", "itouch_tools.cli", *words],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=600,
        check=False,
    )


def test_help_and_version_are_printed_and_no_command_is_an_error() -> None:
    assert run("--help").returncode == 0
    assert "run a scene" in run("--help").stdout
    assert run("--version").stdout.startswith("itouch-py ")
    assert run().returncode == 2


def test_as_a_process_of_its_own_it_says_the_same(tmp_path: Path) -> None:
    for words in (("--version",), ("chek", FIRST), ("check", FIRST)):
        one, other = process(*words, cwd=tmp_path), run(*words, cwd=tmp_path)
        assert (one.returncode, one.stdout, one.stderr) == (other.returncode, other.stdout, other.stderr)


def test_help_imports_neither_numpy_nor_numba() -> None:
    code = "import sys, itouch_tools.cli; itouch_tools.cli.main(['--help']); sys.exit(bool({'numpy', 'numba'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0


def test_run_writes_report_and_session_and_a_table(tmp_path: Path) -> None:
    done = process(FIRST, "--headless", "--report", str(tmp_path / "r.json"), "--save", str(tmp_path / "s.itouch"))
    assert done.returncode == 0, done.stderr
    assert "block" in done.stdout
    report = json.loads((tmp_path / "r.json").read_text())
    assert set(report) >= {
        "scene",
        "simulated_s",
        "ran_s",
        "wall_s",
        "pace",
        "seed",
        "twins",
        "servo",
        "table",
        "contacts",
        "faults",
    }
    assert report["pace"] == "fast"
    assert report["servo"]["overruns"] is None
    again = run(str(tmp_path / "s.itouch"), "--for", "0.2s", "--report", str(tmp_path / "r2.json"))
    assert again.returncode == 0, again.stderr
    restored = json.loads((tmp_path / "r2.json").read_text())
    assert restored["simulated_s"] == pytest.approx(2.8, abs=0.01)
    assert restored["ran_s"] == pytest.approx(0.2)  # its speed beside real time was that of the whole session
    assert (
        f", 0.200 s of them in {restored['wall_s']:.1f} s ({0.2 / restored['wall_s']:.1f} x real time)" in again.stdout
    )


def test_real_pace_counts_overruns(tmp_path: Path) -> None:
    done = run(FIRST, "--pace", "real", "--for", "0.3 s", "--report", str(tmp_path / "r.json"))
    assert done.returncode == 0, done.stderr
    report = json.loads((tmp_path / "r.json").read_text())
    assert report["pace"] == "real"
    assert isinstance(report["servo"]["overruns"], int)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("absent.xml",), "cannot read 'absent.xml'"),
        (("absent.itouch",), "cannot read 'absent.itouch'"),
        (("chek", FIRST), "did you mean 'check'"),
        ((FIRST, "--for", "yesterday"), "is not a"),
        ((FIRST, "--for=-1s"), "negative"),
        ((FIRST, "--report", "/nowhere/at/all.json"), "there is no folder"),
        ((FIRST, "--twin", "amr"), "did you mean 'arm'"),
        ((FIRST, "--seed", "-3"), "out of range"),
        ((FIRST, "--rig", "absent.xml"), "cannot read 'absent.xml'"),
        (("bench", "nothing"), "no bench named"),
        ((FIRST, "--screenshot", "picture.txt"), "ends in .png"),
        (("inspect", FIRST, "--picture", "picture.jpg"), "ends in .png"),
        ((FIRST, "--film", "film.avi"), "ends in .mp4 or .gif"),
    ],
)
def test_wrong_input_is_one_message_and_exit_2(words: tuple[str, ...], says: str, tmp_path: Path) -> None:
    done = run(*words, cwd=tmp_path)
    assert done.returncode == 2, done.stdout + done.stderr
    assert says in done.stderr
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_check_prints_every_problem_and_exits_2(tmp_path: Path) -> None:
    (tmp_path / "bad.xml").write_text('<itouch version="1.0">\n<wrld/>\n<safety force="99 N"/>\n</itouch>')
    done = run("check", "bad.xml", FIRST, cwd=tmp_path)
    assert done.returncode == 2
    assert "bad.xml:2:1" in done.stderr
    assert "2 problems; nothing was started." not in done.stdout
    assert "ok" in done.stdout
    assert run("check", FIRST).returncode == 0


def test_devices_lists_what_is_installed_and_names_what_failed(tmp_path: Path) -> None:
    package = install(tmp_path / "site", "broken-thing", "[itouch.devices]\nbroken = no_such_module:Thing\n")
    done = subprocess.run(
        [sys.executable, "-m", "itouch_tools.cli", "devices"], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(package)},
    )  # fmt: skip
    assert done.returncode == 0
    assert "broken  (broken-thing 1.0)  FAILED TO LOAD" in done.stdout
    assert "No module named 'no_such_module'" in done.stdout
    assert "xyz-table" in done.stdout


@pytest.mark.parametrize("number", campaign.some([signal.SIGTERM, signal.SIGINT], 1))
def test_a_signal_ends_safely_with_the_report(tmp_path: Path, number: signal.Signals) -> None:
    report, recording = tmp_path / "r.json", tmp_path / "r.mcap"
    words = [FIRST, "--pace", "real", "--for", "600 s", "--report", str(report), "--record", str(recording)]
    process = subprocess.Popen(
        [sys.executable, "-m", "itouch_tools.cli", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    until = time.monotonic() + 300.0
    while time.monotonic() < until and not (recording.exists() and recording.stat().st_size > 50_000):
        time.sleep(0.05)
    process.send_signal(number)
    _, err = process.communicate(timeout=600)
    assert process.returncode == 128 + number, err
    assert "the devices are safe" in err
    assert 0 < json.loads(report.read_text())["simulated_s"] < 600


@pytest.mark.parametrize("before", ["", "an earlier report"])
def test_a_session_that_leaves_no_report_leaves_no_empty_file(tmp_path: Path, before: str) -> None:
    report = tmp_path / "r.json"
    if before:
        report.write_text(before)
    words = [FIRST, "--pace", "real", "--for", "600 s", "--report", str(report)]
    with subprocess.Popen([sys.executable, "-m", "itouch_tools.cli", *words], stderr=subprocess.PIPE) as process:
        servo: list[int] = []
        until = time.monotonic() + 300.0
        while not servo and time.monotonic() < until:
            time.sleep(0.1)
            for child in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split():
                if b"itouch.servo.process" in Path(f"/proc/{child}/cmdline").read_bytes():
                    servo.append(int(child))
        time.sleep(3.0)
        os.kill(servo[0], signal.SIGKILL)
        _, err = process.communicate(timeout=600)
    assert process.returncode in (1, 2), err
    assert b"SIGKILL" in err and b"Traceback" not in err
    assert (report.read_text() if report.exists() else "") == before
    assert report.exists() is bool(before)


def test_hardware_is_not_driven_faster_than_real_time() -> None:
    done = run(str(SCENES / "four_materials_wire.xml"), "--headless", "--pace", "fast", "--for", "1s")
    assert done.returncode == 2
    assert "--pace fast is for simulated twins, not for 'arm', 'table', 'peltier'" in done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("pace", ["fast", "real"])
def test_a_signal_during_the_start_is_said_and_reported(
    tmp_path: Path, number: signal.Signals, pace: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While the engine is built, or the servo process builds it, nothing is enabled; it ends at once."""

    def slow(*_: object, **__: object) -> None:
        os.kill(os.getpid(), number)
        time.sleep(20.0)

    place = "itouch.servo.handle.Handle.await_ready" if pace == "real" else "itouch.servo.prepare.prepare"
    monkeypatch.setattr(place, slow)
    report = tmp_path / "r.json"
    done = run(FIRST, "--headless", "--pace", pace, "--seed", "3", "--report", str(report))
    assert done.returncode == 128 + number
    assert done.stderr == f"stopped by {number.name} during the start; nothing was enabled\n"
    content = json.loads(report.read_text())
    assert (content["stopped_by"], content["simulated_s"], content["seed"]) == (number.name, 0.0, 3)
    assert content["contacts"] == content["faults"] == []


def test_a_signal_as_soon_as_something_runs_ends_it_safely(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from itouch.session import Session

    enable = Session.enable

    def signalled(session: Session) -> None:
        enable(session)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(Session, "enable", signalled)
    done = run(FIRST, "--headless", "--report", str(tmp_path / "r.json"))
    assert done.returncode == 130
    assert "stopped by SIGINT; the devices are safe" in done.stderr
    assert json.loads((tmp_path / "r.json").read_text())["simulated_s"] < 0.1


def test_a_fault_counts_more_than_a_failure_to_let_go_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from itouch.plugin import DeviceError
    from itouch.session import Session
    from itouch_tools.cli import main

    (tmp_path / "scene.xml").write_text(
        '<itouch version="1.0"><devices><device name="arm" plugin="usb-arm"/></devices>'
        '<fault device="arm" kind="nan" at="10 ms"/></itouch>', encoding="utf-8"
    )  # fmt: skip
    close = Session.close

    def failing(self: Session) -> None:
        close(self)
        raise DeviceError("device 'arm' could not be released")

    monkeypatch.setattr(Session, "close", failing)
    words = [str(tmp_path / "scene.xml"), "--headless", "--pace", "fast", "--for", "50ms"]
    assert main([*words, "--report", str(tmp_path / "r.json")]) == 1
    told = capsys.readouterr().err
    assert "then: device 'arm' could not be released" in told and "NaN" in told
    assert json.loads((tmp_path / "r.json").read_text("utf-8"))["faults"][0]["trip"] == "not-a-number"


def test_the_list_of_benches_says_what_each_measures() -> None:
    done = run("bench", "--help")
    assert all(len(line) <= 80 for line in done.stdout.splitlines())
    entries = re.split(r"\n  (?=\w)", done.stdout.partition("benches (each has --help):")[2].rstrip())[1:]
    told = {name: " ".join(words) for name, *words in map(str.split, entries)}
    assert "what a tick in contact costs" in told["tick"]
    assert all(len(words.split()) > 5 and "itouch-py" not in words for words in told.values()), told
