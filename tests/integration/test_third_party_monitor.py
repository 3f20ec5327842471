"""A display of another kind brings its own monitor, as a distribution of its own: an electrode and its charge."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_third_party_plugin import run
from third_party_plugins import pip_install

SOURCE = Path(__file__).parents[1] / "outside" / "itouch-electrotactile"
SCENE = '<itouch version="1.0"><devices><device name="tip" plugin="electrotactile" twin="TWIN"/></devices></itouch>\n'


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return pip_install(tmp_path_factory.mktemp("site"), SOURCE)


RUN = """
import itouch
from itouch.plugin import DeviceError
session = itouch.build({path!r})
def pulse(tick):
    session.state["tip.command.amplitude"] = {amplitude}
    session.state["tip.command.rate"] = {rate}
session.taps.append(pulse)
session.state["tip.charge.given"] = {given}
try:
    session.run({seconds})
except itouch.DeviceFaultError as fault:
    print("fault:", fault)
    try:
        session.rearm()
    except DeviceError as refused:
        print("refused:", refused)
print("sent", session.state["tip.sent.amplitude"].item(), "share", session.state["tip.charge.share"].item())
print("given", session.state["tip.charge.given"].item())
"""


def test_check_prints_its_rules_and_hardware_is_let_through(installed: Path, tmp_path: Path) -> None:
    path = tmp_path / "tip.xml"
    for twin in ("yes", "no"):
        path.write_text(SCENE.replace("TWIN", twin), "utf-8")
        done = run(installed, "-m", "itouch_tools.cli", "check", str(path))
        assert done.returncode == 0, done.stderr
        assert "charge of a session: trips at 50 mC, never beyond 50 mC (its plugin)" in done.stdout
        assert "unmonitored" not in done.stderr


def test_it_cuts_down_and_trips_and_refuses_when_the_charge_is_spent(installed: Path, tmp_path: Path) -> None:
    path = tmp_path / "tip.xml"
    path.write_text(SCENE.replace("TWIN", "yes"), "utf-8")
    mild = run(installed, "-c", RUN.format(path=str(path), given=0.0, amplitude=0.008, rate=150.0, seconds=8.0)).stdout
    assert "fault" not in mild
    assert 0.0 < float(mild.split("share ")[1].split()[0]) < 1.0  # 240 µC/s are cut down
    assert float(mild.split("sent ")[1].split()[0]) == pytest.approx(0.005, rel=0.05)
    almost = {"given": 0.048, "amplitude": 0.0033, "rate": 150.0, "seconds": 60.0}  # after 48 of 50 mC
    strong = run(installed, "-c", RUN.format(path=str(path), **almost)).stdout
    assert "fault: device 'tip' has given 50.0 mC in this session (charge of a session: trips at 50 mC)" in strong
    assert "refused: device 'tip' has given the whole charge of a session" in strong
