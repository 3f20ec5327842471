"""A plugin that is a distribution of its own is found, checked and run like the bundled ones."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from third_party_plugins import install, pip_install

SOURCE = Path(__file__).parents[1] / "outside" / "itouch-lever"

SCENE = """<itouch version="1.0" xmlns:lever="urn:itouch:plugin:lever">
  <materials><material name="m"><contact stiffness="300 N/m"/></material></materials>
  <world><box name="floor" size="100 100 20 mm" pos="0 0 10 mm" material="m"/></world>
  <devices><device name="stick" plugin="lever" twin="TWIN"><lever:hardware travel="WAY"/></device></devices>
  <interaction><probe name="tip" radius="0" pose-from="stick" force-to="stick"/></interaction>
</itouch>
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the outside plugin into a folder."""
    return pip_install(tmp_path_factory.mktemp("site"), SOURCE)


def run(site: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, check=False, timeout=600,
        env={**os.environ, "PYTHONPATH": str(site)},
    )  # fmt: skip


def scene(folder: Path, *, twin: str = "yes", way: str = "50 mm") -> str:
    path = folder / "lever.xml"
    path.write_text(SCENE.replace("TWIN", twin).replace("WAY", way))
    return str(path)


def test_the_devices_command_lists_the_plugin(site: Path) -> None:
    done = run(site, "-m", "itouch_tools.cli", "devices")
    assert "lever  (itouch-lever 0.3.0)" in done.stdout
    assert "A one-axis" not in done.stdout
    assert "locked: x y rx ry rz" in done.stdout


def test_its_parameters_are_checked_by_its_own_class(site: Path, tmp_path: Path) -> None:
    done = run(site, "-m", "itouch_tools.cli", "check", scene(tmp_path, way="5 m"))
    assert done.returncode == 2
    assert "lever.xml:4:73: " not in done.stderr
    assert 'error[out-of-range]: <lever:hardware travel="5 m">: 5 m is out of range' in done.stderr
    assert "0.001 to 0.2 m" in done.stderr


def test_its_ideal_twin_runs(site: Path, tmp_path: Path) -> None:
    done = run(site, "-m", "itouch_tools.cli", scene(tmp_path), "--for", "0.5 s")
    assert done.returncode == 0, done.stderr


def test_its_hardware_needs_enabling_and_then_gets_the_limited_force(site: Path, tmp_path: Path) -> None:
    code = f"""
import itouch
engine = itouch.build({scene(tmp_path, twin="no")!r})
try:
    engine.run(0.1)
except itouch.EngineError as error:
    print("refused:", error)
engine.hold()
engine.enable()
for _ in range(1200):
    engine.hold()
    engine.tick()
    assert abs(float(engine.state["stick.sent.wrench"][2])) <= 3.0
device = engine._runners["stick"].gate.device
print("sent", max(device.sent), "status", engine.status("stick").name)
engine.close()
print("closed", engine.status("stick").name, device.sent[-1])
"""
    done = run(site, "-c", code)
    assert done.returncode == 0, done.stderr
    assert "refused: call engine.enable() first: 'stick' will move or heat for real" in done.stdout
    assert "status ENABLED" in done.stdout
    assert "closed CLOSED 0" in done.stdout


def test_a_scene_that_can_only_command_locked_axes_fails(site: Path, tmp_path: Path) -> None:
    code = (
        "import itouch_lever\nfrom itouch.plugin import wrench\n"
        "class Locked(itouch_lever.Lever):\n    commands = (wrench(force=1.0, locked=(0, 1, 2, 3, 4, 5)),)\n"
    )
    install(site, "locked-lever", "[itouch.devices]\nlocked = locked_lever:Locked\n", code=code)
    path = tmp_path / "s.xml"
    path.write_text(
        '<itouch version="1.0"><devices><device name="d" plugin="locked"/></devices>\n'
        '<interaction><probe name="p" pose-from="d" force-to="d"/></interaction></itouch>'
    )
    done = run(site, "-m", "itouch_tools.cli", "check", str(path))
    assert done.returncode == 2
    assert "error[locked-dof]" in done.stderr
    line = path.read_text().splitlines()[1]
    assert f"s.xml:2:{line.index('force-to') + 1}\n" in done.stderr
