"""A plate that safety withdraws (T4) is not there any more: in State, in the report, for heat and in what is told."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from program import program
from shipped import SCENES

import itouch

SCENE = """<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal">
  <include file="materials.xml"/>
  <include file="rigs/twin.xml"/>
  <world temperature="23 degC"><box name="sample" pos="0 0 6 mm" size="60 60 12 mm" material="pyrex"/></world>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="arm" force-to="arm" surface-to="table"/>
    <operator probe="finger" mass="80 g" stiffness="300 N/m" damping="6 N*s/m" skin-temperature="33 degC">
      <motion>
        <to pos="0 0 44 mm" in="0.5 s" hold="3 s"/>
        <to pos="0 0 16 mm" in="0.7 s" hold="4 s"/>
        <to pos="0 0 44 mm" in="0.5 s" hold="3 s"/>
        <to pos="0 0 16 mm" in="0.7 s" hold="0.5 s"/>
        <to pos="0 0 44 mm" in="0.5 s" hold="0.2 s"/>
      </motion>
    </operator>
    {heat}
  </interaction>
  <rates servo="1 kHz"/>
  <safety force="3 N" contact-time="1.5 s"/>
</itouch>"""
HEAT = """<thermal:heat probe="finger" contact-resistance="0.002 m^2*K/W" arterial="37 degC"/>
    <thermal:flux-control display="peltier" desired-from="heat"/>"""


@pytest.fixture(scope="module", params=[HEAT, ""], ids=["heat", "force alone"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("withdrawn") / "scenes"
    shutil.copytree(SCENES, folder)
    path = folder / "long.xml"
    path.write_text(SCENE.format(heat=request.param))
    session = itouch.build(path)
    state, fields = session.state, ["finger.plate", "finger.surface.present", "table.surface.withdrawn",
                                    "finger.plate_force", "finger.total_force", "finger.plate_distance"]  # fmt: skip
    fields += ["flux-control.touching"] if request.param else []
    rows: list[list[float]] = []
    session.taps.append(lambda tick: rows.append([float(np.ravel(state[name])[0]) for name in fields]))
    session.run()
    columns = dict(zip(fields, np.array(rows).T, strict=True))
    return {"path": path, "report": session.report(), "columns": columns, "heat": bool(request.param)}


def test_a_plate_that_is_away_is_not_called_present(run: Mapping[str, Any]) -> None:
    columns = run["columns"]
    away = (columns["table.surface.withdrawn"] > 0.0) & (columns["finger.plate_distance"] > 1e-3)
    assert away.sum() > 1000
    for name in ("finger.plate", "finger.surface.present", *(["flux-control.touching"] if run["heat"] else [])):
        assert not columns[name][away].any(), name
    assert (columns["finger.total_force"][away][200:] > 0.5).any()  # the arm gives the rest of the contact


def test_the_force_goes_over_without_a_step(run: Mapping[str, Any]) -> None:
    begin = int(np.flatnonzero(run["columns"]["table.surface.withdrawn"])[0])
    force = run["columns"]["finger.total_force"][begin - 5 : begin + 300]
    assert np.abs(np.diff(force)).max() < 0.1
    assert force.max() < 3.0


def test_the_report_tells_it(run: Mapping[str, Any]) -> None:
    long, short = run["report"]["contacts"]
    assert long["plate_withdrawn"] is True
    assert not long["plate_missed"]
    assert long["plate_s"] == pytest.approx(1.5, abs=0.05)
    assert long["end_s"] - long["begin_s"] > 3.5
    assert short["plate_withdrawn"] is False
    assert short["plate"]
    assert run["report"]["table"]["height_error_mm_max"] < 1.0
    if run["heat"]:
        assert long["flux_error_rms"] < 0.05  # of what the plate rendered, not of the time without it


def test_the_program_says_it(run: Mapping[str, Any]) -> None:
    ended = program("run", run["path"], "--pace", "fast", "--no-record")
    assert ended.stdout.count("the plate was withdrawn after 1.5 s") == 1
