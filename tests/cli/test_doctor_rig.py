"""The harmless half of a laboratory's checklist, over twins and over the devices' real protocols."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from program import program
from shipped import SCENES

from itouch.session import Session, build
from itouch_tools.cli.doctor import rig_checks
from itouch_tools.cli.doctor.diagnosis import Diagnosis
from itouch_tools.cli.lockstep import Lockstep


def _scene(tmp_path: Path, more: str) -> str:
    path = tmp_path / "rig.xml"
    path.write_text(f'<itouch version="1.0"><include file="itouch:rigs/twin.xml"/>{more}</itouch>', encoding="utf-8")
    return str(path)


def _found(session: Session, seconds: float = 0.3) -> dict[str, Diagnosis]:
    found = {finding.name: finding for finding in rig_checks.examine_rig(session, seconds)}
    assert not any(runner.latch.enabled and not runner.model.twin for runner in session.runners)
    return found


@pytest.fixture
def examined(tmp_path: Path) -> Callable[[str], dict[str, Diagnosis]]:
    """Return what looks at the shipped twins, with more in their scene."""
    return lambda more: _found(build(_scene(tmp_path, more)))


def test_a_rig_without_faults_passes(tmp_path: Path) -> None:
    done = program("doctor", "--rig", _scene(tmp_path, ""), "--for", "0.2s", "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    found = {line["name"]: line["status"] for line in told["rig"]}
    assert found["W1 table"] == found["K4 table"] == found["T1 peltier"] == found["W2"] == "pass"
    assert found["W2 arm"] == found["W3"] == "not possible"  # simulated: that proves nothing of a device
    assert all(line["advice"] for line in told["rig"] if line["status"] != "pass")
    assert told["verdict"].startswith("nothing fails")


@pytest.mark.parametrize(
    ("fault", "line", "said"),
    [
        ('device="table" kind="bias" channel="wrench" at="0 s" amount="1 N"', "K4 table", "N in the air"),
        ('device="arm" kind="disconnect" at="0.1 s"', "T8 arm", "disconnected"),
        ('device="peltier" kind="disconnect" at="0 s"', "W1 peltier", "does not answer"),
        ('device="table" kind="nan" at="0.1 s"', "T8 table", "NaN"),
    ],
)
def test_what_is_wrong_is_told_with_its_rule_and_what_to_do(
    tmp_path: Path, fault: str, line: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    done = program("doctor", "--rig", _scene(tmp_path, f"<fault {fault}/>"), "--for", "0.3s")
    assert done.returncode == 1
    told = next(text for text in done.stdout.splitlines() if text.startswith("fail") and line in text)
    assert said in told
    assert "->" in done.stdout.splitlines()[done.stdout.splitlines().index(told) + 1]


def test_a_switch_that_nobody_holds_keeps_everything_off(examined: Callable[[str], dict[str, Diagnosis]]) -> None:
    found = examined('<safety hold-to-run="yes"/>')
    assert found["W3"].status == "pass"
    assert "nobody holds" in found["W3"].found


def test_a_switch_that_is_stuck_fails(tmp_path: Path) -> None:
    session = build(_scene(tmp_path, '<safety hold-to-run="yes"/>'))
    session.taps.append(lambda tick: session.hold())
    assert _found(session)["W3"].status == "fail"


def test_a_scene_that_is_wrong_ends_with_two(tmp_path: Path) -> None:
    assert program("doctor", "--rig", _scene(tmp_path, "<devices><device/></devices>")).returncode == 2


@pytest.mark.long
def test_devices_behind_their_wires_are_looked_at_by_the_same_entrance() -> None:
    both = Lockstep(str(SCENES / "four_materials_wire.xml"))
    with both.serving():
        found = _found(both.host, 2.0)
    both.world.close()
    failed = {name: one.found for name, one in found.items() if one.status == "fail"}
    assert list(failed) == ["W3"] and "reads as held" in failed["W3"]  # the simulated operator never lets go
    assert found["W2 table"].status == "pass" and found["W2 arm"].status == "not possible"
    assert found["W1 table"].status == found["K6 table"].status == found["W2"].status == "pass"
    assert not any(runner.latch.enabled for runner in both.world.runners if not runner.model.twin)
