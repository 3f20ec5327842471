"""The suite finds every bad plugin by the name of its fault, and blames no good one."""

from __future__ import annotations

import io
import os
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bad_meanings
import bad_states
import misbehaving_plugins
import pytest
from bad import BAD, Blocks
from shipped import SCENES
from slider import Slider, SliderParams

from itouch.plugin import Timing, schema
from itouch.testing import DeviceHarness, DeviceTests, EmulatorTests, call_times
from itouch.testing.checks import CheckResult
from itouch.testing.engine_checks import last_error
from itouch.testing.score_card import Card
from itouch.testing.suites import DEVICE_CHECKS, EMULATOR_CHECKS

#: Checks that need the wire.
WIRE = ("twin-and-driver-agree", "disabled-is-still", "commands-arrive", "unplug")
CHECKS = {check.name: check for check in (*DEVICE_CHECKS, *EMULATOR_CHECKS)}


def port(folder: Path) -> SliderParams:
    return SliderParams(port=str(folder / "port"))


def harness(cls: type[Slider], check: str, folder: Path) -> DeviceHarness:
    emulated = check in WIRE
    params = port(folder) if emulated else None
    return DeviceHarness(cls, "slider", params, hardware=not emulated, emulated=emulated)


def of(name: str) -> type[Slider]:
    """Return the bad plugin of a name."""
    return next(cls for cls in BAD if cls.__name__ == name)


class TestSlider(DeviceTests):
    device, name, hardware = Slider, "slider", True


class TestSliderOnItsEmulator(EmulatorTests):
    device, name = Slider, "slider"

    @pytest.fixture(autouse=True)
    def _port(self, tmp_path: Path) -> None:
        type(self).params = port(tmp_path)


def test_there_are_enough_bad_plugins():
    assert len(BAD) >= 100
    assert len(set(BAD.values())) >= 35
    assert {cls.__module__ for cls in BAD} >= {misbehaving_plugins.__name__, bad_states.__name__, bad_meanings.__name__}


@pytest.mark.parametrize(("cls", "check"), BAD.items(), ids=[cls.__name__ for cls in BAD])
def test_a_bad_plugin_is_caught_by_name(cls, check, tmp_path):
    finding = CHECKS[check].examine(harness(cls, check, tmp_path))
    assert finding.outcome == "failed", f"{check} did not see it: {finding.note}"
    assert "likely cause:" in finding.note and "what to do:" in finding.note


@pytest.fixture
def talkative() -> Iterator[None]:
    """Let another thread hold the interpreter's lock for milliseconds, as a virtual device may on a busy machine."""
    over, before = threading.Event(), sys.getswitchinterval()

    def talk() -> None:
        while not over.wait(1e-3):
            sum(range(100_000))

    thread = threading.Thread(target=talk, daemon=True)
    sys.setswitchinterval(1e-5)
    thread.start()
    yield
    over.set()
    thread.join()
    sys.setswitchinterval(before)


@pytest.mark.parametrize("check", ["twin-timing", "driver-timing"])
def test_who_holds_the_interpreter_is_no_wait_of_a_plugin(check: str, talkative: None) -> None:
    finding = CHECKS[check].examine(DeviceHarness(Slider, "slider", hardware=True))
    assert finding.outcome == "passed", finding.note
    waits = {"twin-timing": of("TwinWaits"), "driver-timing": Blocks}[check]
    finding = CHECKS[check].examine(DeviceHarness(waits, "slider", hardware=True))
    assert finding.outcome == "failed" and " wait" in finding.note, finding.note


class Accepted(Slider):
    """Its far end, a thread of this process as an emulator is, closes its side a moment after the driver has given up."""

    def open(self) -> None:
        spare = os.open("/dev/null", os.O_RDONLY)
        threading.Timer(0.1, os.close, [spare]).start()
        super().open()


@dataclass(frozen=True)
class CheckedParams(SliderParams):
    """Parameters that say at once what no address is."""

    port: str = schema.text(default="", doc="HOST:PORT of the slider; empty: that of this machine")

    def __post_init__(self) -> None:
        schema.validate(self)
        if self.port:
            schema.host_port(self.port)


class Checked(Slider):
    """Raises an error of a library, and may only be asked to open at what is an address."""

    Params = CheckedParams

    def open(self) -> None:
        raise OSError(f"{self.params.port} is not there")


class SlowToOpen(Slider):
    """Takes longer to open than the dead-man's switch stays held without being held anew."""

    timing = Timing(blocking=True, watchdog=1.0)

    def open(self) -> None:
        time.sleep(0.2)
        super().open()


@pytest.mark.punctual
@pytest.mark.parametrize("check", ["lifecycle", "safe-on-exception"])
def test_a_driver_that_is_slow_to_open_is_not_blamed_for_the_switch(check: str) -> None:
    finding = CHECKS[check].examine(DeviceHarness(SlowToOpen, "slider", hardware=True))
    assert finding.outcome == "passed", finding.note


def test_what_an_emulator_closes_a_moment_later_is_not_left_open_by_the_driver() -> None:
    finding = CHECKS["errors-are-named"].examine(DeviceHarness(Accepted, "slider", hardware=True))
    assert finding.outcome == "passed", finding.note


def test_where_parameters_check_the_form_of_an_address_nowhere_has_that_form() -> None:
    finding = CHECKS["errors-are-named"].examine(DeviceHarness(Checked, "slider", hardware=True))
    assert finding.outcome == "failed" and "OSError: 127.0.0.1:1 is not there" in finding.note, finding.note


def test_what_one_attempt_leaves_running_excuses_nothing_in_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    found = iter([0.0])  # before the first attempt; from then on nothing runs undisturbed
    monkeypatch.setattr(call_times, "_held_up", lambda: next(found, 1e6))
    finding = CHECKS["twin-timing"].examine(DeviceHarness(of("WaitsNowAndThen"), "slider"))
    assert finding.outcome == "failed" and "calls of the twin wait" in finding.note, finding.note


@pytest.mark.parametrize(
    "cls", [Slider, bad_meanings.FollowsItsPlate, bad_meanings.HeatsItsPlate, bad_meanings.HasASwitch]
)
@pytest.mark.parametrize("check", ["meaning", "roles"])
def test_a_plugin_that_means_what_it_says_is_not_blamed(cls, check):
    finding = CHECKS[check].examine(DeviceHarness(cls, "slider"))
    assert finding.outcome == "passed", finding.note


def test_a_plugin_that_looks_for_hardware_at_import_is_caught(tmp_path, monkeypatch):
    (tmp_path / "eager.py").write_text(
        '"""Eager."""\nfrom slider import Slider\nopen("/dev/zero", "rb").close()\n\n\nclass Eager(Slider):\n    """Eager."""\n'
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    import eager

    finding = CHECKS["import"].examine(DeviceHarness(eager.Eager, "eager"))
    assert finding.outcome == "failed" and "/dev/zero" in finding.note


def test_a_changed_protocol_is_seen_in_the_golden_transcript(tmp_path):
    class Talking(Slider):
        word = b"F 0\n"

        def open(self) -> None:
            super().open()
            if self.trace is not None:
                self.trace.sent(self.word)

    golden = tmp_path / "golden.txt"
    golden.write_text('0.000000 unit > "F 0\\n"\n')
    same = DeviceHarness(Talking, "slider", hardware=True, transcript=golden)
    assert CHECKS["transcript"].examine(same).outcome == "passed"
    Talking.word = b"F 1\n"
    finding = CHECKS["transcript"].examine(same)
    assert finding.outcome == "failed" and "46 20 31" in finding.note


def test_the_command_prints_a_score_card(capsys):
    from itouch_tools.cli import main

    assert main(["test-plugin", "xyz-table"]) == 0
    text = capsys.readouterr().out
    assert "device 'xyz-table'" in text and " 0 failed" in text and "state-declared" in text
    assert main(["test-plugin", "xyz-tabel"]) == 2
    assert "did you mean 'xyz-table'?" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["thermal", "thermal.heat", "xyz-table"])
def test_a_scene_that_does_not_use_the_plugin_is_refused(name, capsys):
    from itouch_tools.cli import main

    assert main(["test-plugin", name, "--scene", str(SCENES / "first_touch.xml")]) == 2
    said = capsys.readouterr()
    assert f"does not use '{name}'" in said.err and "it uses " in said.err and "usb-arm" in said.err
    assert not said.out


def test_a_modality_that_the_scene_does_not_use_is_not_examined_and_that_is_said(monkeypatch, capsys):
    """A plugin may have several modalities, and a scene one of them: the others are no fault of it."""
    from itouch.testing import suites
    from itouch_tools.cli import main

    for checks in ("DEVICE_CHECKS", "MODALITY_CHECKS"):
        monkeypatch.setattr(suites, checks, [one for one in getattr(suites, checks) if one.name == "parameters"])
    assert main(["test-plugin", "thermal", "--scene", str(SCENES / "handbook_touch.xml")]) == 0
    said = capsys.readouterr()
    assert "device 'thermal'" in said.out and "modality 'thermal.heat'" in said.out and "flux-control" not in said.out
    assert "'thermal.flux-control' was not examined" in said.err and "handbook_touch.xml' does not use it" in said.err


def test_of_another_process_its_last_error_is_told_whole():
    frames = 'Traceback (most recent call last):\n  File "a.py", line 3, in f\n    raise error\n'
    told = f"{frames}KeyError: 1\n\nDuring handling of it:\n\n{frames}ModuleNotFoundError: {'x' * 400}\n"
    assert last_error(told) == f"ModuleNotFoundError: {'x' * 400}"
    assert last_error("one\ntwo\n") == "two"
    assert last_error("") == "it says nothing"


def test_a_suite_in_a_strangers_tests(tmp_path):
    """What the docs say: inherit, run pytest."""
    import subprocess

    (tmp_path / "test_it.py").write_text(
        textwrap.dedent("""
        from bad import LeavesTheQuaternionZero
        from slider import Slider
        from itouch.testing import DeviceTests

        class TestBad(DeviceTests):
            device, name = type("Bad", (Slider,), {"Twin": LeavesTheQuaternionZero}), "slider"
        """)
    )
    here = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    done = subprocess.run([sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "twin_pose or twin_fills"],
                          cwd=tmp_path, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": here})  # fmt: skip
    assert "1 failed, 1 passed" in done.stdout
    assert "w x y z with unit length" in done.stdout


def test_a_long_name_on_a_score_card_is_apart_from_what_it_means():
    written = io.StringIO()
    longest = max(EMULATOR_CHECKS, key=lambda one: len(one.name))
    Card("emulator", written).write([CheckResult(longest, "passed", "", 0.0)])
    assert f"{longest.name} {longest.title[:10]}" in written.getvalue()
