"""A simulation in several processes that is stopped, or whose first process is killed: the others end with it."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from itouch_tools.study.study_store import Store

SCENE = """<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal">
  <include file="itouch:materials.xml"/>
  <include file="itouch:rigs/twin.xml"/>
  <world temperature="23 degC"><box name="plate" pos="0 0 6 mm" size="60 60 12 mm" material="wood"/></world>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>
    <operator probe="finger" skin-temperature="33 degC">
      <motion>
        <to pos="0 0 44 mm" in="0.5 s" hold="0.1 s"/>
        <to pos="0 0 16 mm" in="0.5 s" hold="0.4 s"/>
        <to pos="0 0 44 mm" in="0.5 s" hold="0.1 s"/>
      </motion>
    </operator>
    <thermal:heat probe="finger" contact-resistance="0.002 m^2*K/W" arterial="37 degC"/>
    <thermal:flux-control display="peltier" desired-from="heat"/>
  </interaction>
</itouch>"""
STUDY = """<study version="1.0" scene="scene.xml" seed="5">
  <factor name="material" levels="wood pyrex" set="plate.material"/>
  <task kind="identify" factor="material"/>
  <order repetitions="1000"/>
  <contact object="plate" duration="0.2 s" flux-error="10"/>
</study>"""


def lives(process: str) -> bool:
    """Tell whether a process does anything yet."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def trials(folder: Path) -> int:
    if not (folder / "trials.sqlite").exists():
        return 0
    with Store.open(folder) as store:
        return len({row.participant for row in store.rows()})


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="needs /proc")
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGKILL, -9), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.long)]
)
def test_the_processes_of_a_simulation_end_with_it(tmp_path: Path, number: signal.Signals, code: int) -> None:
    """They went on to write trials, and the same command then found that somebody else had made its trials."""
    (tmp_path / "scene.xml").write_text(SCENE)
    (tmp_path / "study.xml").write_text(STUDY)
    words = ["simulate", str(tmp_path / "study.xml"), "-o", str(tmp_path / "rows"), "--observers", "2"]
    first = subprocess.Popen(
        [sys.executable, "-m", "itouch_tools.cli", "study", *words, "--processes", "2"], stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    try:
        end = time.monotonic() + 400.0
        while trials(tmp_path / "rows") < 2 and time.monotonic() < end and first.poll() is None:
            time.sleep(0.2)
        others = Path(f"/proc/{first.pid}/task/{first.pid}/children").read_text().split()
        assert len(others) >= 2
        first.send_signal(number)
        _, said = first.communicate(timeout=200)
        assert first.returncode == code
        assert number == signal.SIGKILL or "the same command goes on from there" in said
        assert "Traceback" not in said
        end = time.monotonic() + 60.0
        while any(map(lives, others)) and time.monotonic() < end:
            time.sleep(0.1)
        assert not [other for other in others if lives(other)]
    finally:
        first.kill()
        first.wait()
