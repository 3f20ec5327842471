"""Two processes on one wire: the second is refused before anything is started, however the first one dies."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import itouch
from itouch.plugin import wire_claims
from itouch.plugin.wire_claims import WireClaims, WireHeldError
from itouch.servo import Handle, own_guardian
from itouch.session import Session
from itouch_tools.cli import main
from itouch_tools.study.scene_switching import succeed

PROGRAM = (sys.executable, "-m", "itouch")
SCENE = """<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal">
  <devices>
    <device name="peltier" plugin="thermal" twin="no">
      <thermal:hardware><thermal:line port="{}"/></thermal:hardware>
    </device>
  </devices>
</itouch>
"""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return the scene of a display that stands behind a serial port, which another process simulates."""
    folder = tmp_path_factory.mktemp("rig")
    scene = folder / "scene.xml"
    scene.write_text(SCENE.format(folder / "port"), "utf-8")
    words = [*PROGRAM, "virtual-rig", str(scene)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as serving:
        assert serving.stdout is not None
        for line in serving.stdout:
            if line.startswith("ready"):
                break
        yield scene
        serving.send_signal(signal.SIGINT)


@pytest.fixture
def running(rig: Path) -> Iterator[Handle]:
    """Return a session that has the display open, and waits for somebody to hold the switch."""
    with itouch.launch(rig, seconds=60.0, realtime=False) as handle:
        yield handle


def test_a_second_process_on_a_wire_is_refused(
    rig: Path, running: Handle, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "by-id").symlink_to(rig.parent / "port")
    (tmp_path / "scene.xml").write_text(SCENE.format(tmp_path / "by-id"), "utf-8")
    record, report = tmp_path / "r.mcap", tmp_path / "report.json"
    for words in (
        [str(tmp_path / "scene.xml"), "--headless", "--record", str(record), "--report", str(report)],
        ["doctor", "--rig", str(rig), "--for", "1s"],
        ["thermal", "display", str(tmp_path / "by-id"), "--seconds", "1"],
    ):
        assert main(words) == 2, words
        said = capsys.readouterr().err.strip().splitlines()
        assert f"is in use by process {os.getpid()} (" in said[-1]
        assert f"and its process {running.pid}; end that first" in said[-1]
        assert "Traceback" not in "\n".join(said)
    assert not record.exists()
    assert not report.exists()
    with itouch.build(rig) as session, pytest.raises(itouch.DeviceError, match=r"device 'peltier': .* is in use by"):
        session.hold()
        session.enable()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_the_wire_is_free_when_its_process_has_ended(rig: Path, number: int) -> None:
    with itouch.launch(rig, seconds=60.0, realtime=False) as handle:
        with pytest.raises(WireHeldError):
            WireClaims().take([str(rig.parent / "port")])
        os.kill(handle.pid, number)
        try:
            while not handle.wait(0.1):
                pass
        except itouch.ItouchError:
            pass
    with itouch.build(rig) as session:  # what was killed has sent its last, and this one is answered
        session.hold()
        session.enable()
        assert session.status("peltier").name == "ENABLED"


def test_a_copy_of_a_process_keeps_no_wire_when_that_is_killed() -> None:
    line = f"the only line of {os.getpid()}"  # claims are the machine's: another run of this test has its own
    code = (
        "import os, sys, time; from itouch.plugin.wire_claims import WireClaims\n"
        f"claims = WireClaims(); claims.take([{line!r}])\n"
        "if not os.fork(): print(os.getpid(), flush=True)\n"
        "time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-W", "ignore", "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        copy = int(process.stdout.readline())
        try:
            with pytest.raises(WireHeldError, match=f"process {process.pid} "):
                WireClaims().take([f"{line.title()} "])
            process.kill()
            process.wait()
            claims = WireClaims()
            claims.take([line])
            claims.release()
        finally:
            os.kill(copy, signal.SIGKILL)


def test_a_guardian_at_work_is_waited_for_and_then_named() -> None:
    guardian, claims = WireClaims(), WireClaims()
    guardian.guard([f"a line of {os.getpid()}"])
    begin = time.monotonic()
    with pytest.raises(
        WireHeldError, match="another session of this process, the guardian of a session that has ended"
    ):
        claims.take([f"a line of {os.getpid()}"])
    assert time.monotonic() - begin >= 1.0  # one that ends meanwhile is no reason to refuse
    with pytest.raises(WireHeldError):
        WireClaims().guard([f"a line of {os.getpid()}"])
    guardian.release()
    claims.take([f"a line of {os.getpid()}"])
    claims.release()


def test_the_guardian_of_a_running_session_has_its_wires(rig: Path, running: Handle) -> None:
    with pytest.raises(WireHeldError, match=r"servo\.guardian|and its process"):
        WireClaims().guard([str(rig.parent / "port")])


def test_a_stored_session_is_opened_by_one_process_only(rig: Path, tmp_path: Path) -> None:
    """Who prepares a session, looks at one or draws its page has nothing to say to its devices."""
    stored = tmp_path / "s.itouch"
    with itouch.build(rig) as session:
        session.hold()
        session.enable()
        session.save(stored)
    page = ["report", str(stored), "-o", str(tmp_path / "page.html")]
    assert main(page) == 0  # then all is compiled: the process below waits for a hand for two minutes, and not longer
    words = [*PROGRAM, str(stored), "--headless", "--for", "60s"]
    with subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if line.startswith("waiting:"):
                break
        else:
            pytest.fail("it has ended")
        port = os.path.realpath(rig.parent / "port")
        opened = [os.readlink(link) for link in Path(f"/proc/{process.pid}/fd").iterdir() if link.is_symlink()]
        assert port not in opened
        assert main(page) == 0
        assert "stays closed" not in (tmp_path / "page.html").read_text("utf-8")
        process.send_signal(signal.SIGINT)
        assert process.wait(300.0) == 130


def test_the_guardian_of_a_session_does_not_keep_it_from_its_own_wires(
    rig: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After `itouch.build` no real display could be enabled: its guardian was taken for that of another session."""
    monkeypatch.setattr(Session, "GUARDIAN", f"{own_guardian.__name__}:watch")
    with itouch.build(rig) as session:
        session.hold()
        session.enable()
        assert session.status("peltier").name == "ENABLED"
        session.park()
        session.reconnect("peltier")  # its wire is released and claimed again, and the guardian lives
        assert session.status("peltier").name == "OPEN"
        with itouch.build(rig) as other, pytest.raises(itouch.DeviceError, match="in use by another session of this"):
            other.enable()


def test_a_device_of_a_session_with_a_guardian_is_connected_again(rig: Path, running: Handle) -> None:
    """Its wire was refused for three seconds, in which the loop stood, and then for good."""
    running.command("reconnect", "peltier")
    obeyed = running.report()["commands"]  # it is asked for after that
    assert running.refused == []
    assert [entry["what"] for entry in obeyed] == ["reconnect"]


def test_the_wire_goes_to_the_next_scene_with_the_device(rig: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a study does it from trial to trial: the first session is closed in the middle of the second."""
    monkeypatch.setattr(Session, "GUARDIAN", f"{own_guardian.__name__}:watch")  # each session has one of its own
    first, second = itouch.build(rig), itouch.build(rig)
    first.hold()
    first.enable()
    first.park()
    succeed(second, first)
    first.close()
    with pytest.raises(WireHeldError):
        WireClaims().take([str(rig.parent / "port")])
    second.hold()
    second.enable(opens=False)
    assert second.status("peltier").name == "ENABLED"
    second.close()
    claims = WireClaims()
    claims.take([str(rig.parent / "port")])
    claims.release()


def test_two_arms_of_one_serial_number_are_refused(tmp_path: Path) -> None:
    device = '<device name="{}" plugin="usb-arm" twin="no"><arm:hardware serial="{}"/></device>'

    def said(one: str, other: str) -> str:
        devices = device.format("a", one) + device.format("b", other)
        text = f'<itouch version="1.0" xmlns:arm="urn:itouch:plugin:usb-arm"><devices>{devices}</devices></itouch>'
        (tmp_path / "scene.xml").write_text(text, "utf-8")
        try:
            itouch.build(tmp_path / "scene.xml")
        except itouch.SceneError as error:
            return str(error)
        return ""

    assert "would both write to 'the arm 7 on USB'" in said("7", "7")
    assert "would both write to 'the arm that is attached on USB'" in said("any", "any")
    assert said("7", "8") == ""


def test_a_second_virtual_rig_is_refused_and_the_first_goes_on(
    rig: Path, running: Handle, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    port = rig.parent / "port"
    leads = os.readlink(port)
    (tmp_path / "by-another-way").symlink_to(rig.parent)
    (tmp_path / "scene.xml").write_text(SCENE.format(tmp_path / "by-another-way" / "port"), "utf-8")
    for scene in (rig, tmp_path / "scene.xml"):
        assert main(["virtual-rig", str(scene), "--for", "1s"]) == 2
        said = capsys.readouterr()
        assert "port' is in use by process " in said.err and len(said.err.strip().splitlines()) == 1
        assert "ready" not in said.out
        assert os.readlink(port) == leads
    assert running.link.phase == "ready"


def test_a_virtual_rig_takes_no_link_away_but_that_of_a_virtual_port(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The name of a port may be the system's link to real hardware."""
    (tmp_path / "scene.xml").write_text(SCENE.format(tmp_path / "port"), "utf-8")
    (tmp_path / "port").symlink_to("/dev/ttyUSB0")
    words = ["virtual-rig", str(tmp_path / "scene.xml"), "--for", "0.2s"]
    assert main(words) == 2
    assert "no virtual port can be made at" in capsys.readouterr().err
    assert os.readlink(tmp_path / "port") == "/dev/ttyUSB0"
    (tmp_path / "port").unlink()
    (tmp_path / "port").symlink_to("/dev/pts/987654")  # of a rig that was killed
    # in a process of its own: it takes what punctuality needs for the whole of it
    assert subprocess.run([*PROGRAM, *words], capture_output=True, check=False).returncode == 0
    assert not (tmp_path / "port").is_symlink()


def test_a_virtual_rig_does_not_take_the_place_of_a_port_that_a_session_has_open(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "scene.xml").write_text(SCENE.format(tmp_path / "port"), "utf-8")
    (tmp_path / "port").symlink_to("/dev/pts/987654")
    claims = WireClaims()
    claims.take([str(tmp_path / "port")])
    assert main(["virtual-rig", str(tmp_path / "scene.xml"), "--for", "0.2s"]) == 2
    assert "is in use by another session of this process" in capsys.readouterr().err
    assert (tmp_path / "port").is_symlink()
    claims.release()


@pytest.mark.parametrize(
    ("text", "parent"), [("7 (a (b) c) S 42 7 7", 42), ("", 0), ("7 (a)", 0), ("7 (a) S x", 0), ("7 (a) S 1", 1)]
)
def test_of_a_process_that_ends_meanwhile_no_parent_is_known(
    text: str, parent: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wire_claims, "open", lambda *_, **__: io.StringIO(text), raising=False)
    assert wire_claims._parent(7) == parent


def test_a_process_that_has_ended_has_neither_words_nor_parent() -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    assert wire_claims._words(ended.pid) == [] and wire_claims._parent(ended.pid) == 0
