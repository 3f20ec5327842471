"""One scene serves twin and lab: what only a twin knows is recorded on twins, and left away, said, where a device is real."""

from __future__ import annotations

from pathlib import Path

import pytest
from shipped import SCENES

from itouch.recording import read
from itouch_tools.cli.check import examined

SCENE = """<itouch version="1.0">
  <include file="itouch:materials.xml"/>
  <include file="itouch:rigs/twin.xml"/>
  <world><box name="block" material="wood" size="60 60 20 mm" pos="0 0 0 mm"/></world>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm"/>
    <operator probe="finger"><motion><to pos="0 0 60 mm" in="0.2 s" hold="0.2 s"/></motion></operator>
  </interaction>
  <record to="x.mcap" channels="{channels}"/>
</itouch>
"""


def write(folder: Path, channels: str) -> str:
    path = folder / "scene.xml"
    path.write_text(SCENE.format(channels=channels), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize("channels", ["peltier.twin.true_flux", "*.twin.true_*", "peltier.twin.true_skin arm.pose"])
def test_what_only_a_twin_knows_is_left_away_where_the_device_is_real(channels: str, tmp_path: Path) -> None:
    path, rig = write(tmp_path, channels), str(SCENES / "rigs" / "wire.xml")
    model, problems = examined(path, rig, None)
    assert model is not None and {problem.severity for problem in problems} <= {"note"}
    notes = [notice for notice in model.notices if "is a twin: here it is real" in notice]
    assert len(notes) == 1 and "peltier" in notes[0]
    model, problems = examined(path, rig, "all")
    assert model is not None and not [notice for notice in model.notices if "here it is real" in notice]


@pytest.mark.parametrize("channels", ["peltier.twin.true_flx", "pelteer.twin.true_flux", "arm.twin.true_flux"])
@pytest.mark.parametrize("rig", ["twin.xml", "wire.xml"])
def test_what_no_twin_has_is_no_channel(channels: str, rig: str, tmp_path: Path) -> None:
    model, problems = examined(write(tmp_path, channels), str(SCENES / "rigs" / rig), None)
    assert model is None and [problem.code for problem in problems] == ["unknown-channel"]


def test_on_twins_it_is_recorded(tmp_path: Path) -> None:
    import itouch

    session = itouch.build(write(tmp_path, "peltier.twin.true_flux"))
    session.record(tmp_path / "x.mcap")
    session.run(0.3)
    session.close()
    recording = read(str(tmp_path / "x.mcap"))
    assert any("true_flux" in column.field for track in recording.tracks.values() for column in track.columns)
