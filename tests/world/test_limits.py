"""Deleting, misspelling or loosening a limit never makes the limits in force looser than the defaults."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

import itouch
from itouch.plugin import wrench
from itouch.world import limits as default
from itouch.world.limits import ceilings

LIMITS = re.compile(r"<(limits|safety)\b([^>]*)/>")


def in_force(path: Path) -> dict[str, dict[str, object]]:
    return {name: dict(device.limits.table()) for name, device in itouch.build(path).model.devices.items()}


def test_defaults_hold_without_any_limit_in_the_scene(scenes: Path) -> None:
    for path in (scenes / "rigs" / "twin.xml", scenes / "four_materials.xml"):
        path.write_text(LIMITS.sub("", path.read_text()))
    limits = in_force(scenes / "four_materials.xml")
    assert limits["arm"]["force"] == default.FORCE
    assert limits["table"]["speed"] == default.SPEED
    assert limits["peltier"]["temperature"] == default.PLATE_TEMPERATURE
    assert limits["peltier"]["current"] == pytest.approx(6.4)


def test_a_scene_tightens(scenes: Path) -> None:
    path = scenes / "four_materials.xml"
    path.write_text(path.read_text().replace('<safety force="3 N"/>', '<safety force="1 N" speed="0.1 m/s" '
                                             'temperature="18 38 degC" watchdog="10 ms"/>'))  # fmt: skip
    limits = in_force(path)
    assert limits["arm"]["force"] == 1.0
    assert limits["table"]["speed"] == pytest.approx(0.1)
    assert limits["peltier"]["temperature"] == pytest.approx((291.15, 311.15))
    assert all(entry["watchdog"] == pytest.approx(0.01) for entry in limits.values())


MUTATIONS = [
    ('force="3 N"', 'force="30 N"'), ('force="3 N"', 'force="nan N"'), ('force="3 N"', 'force="inf"'),
    ('force="3 N"', 'force="-3 N"'), ('force="3 N"', 'force="0 N"'), ('force="3 N"', 'forse="3 N"'),
    ('speed="0.25 m/s"', 'speed="25 m/s"'), ('speed="0.25 m/s"', 'velocity="0.25 m/s"'),
    ('current="6 A"', 'current="60 A"'), ('temperature="15 40 degC"', 'temperature="5 40 degC"'),
    ('temperature="15 40 degC"', 'temperature="15 60 degC"'), ('temperature="15 40 degC"', 'temperature="40 15 degC"'),
    ('temperature="15 40 degC"', 'temperature="15 40"'),
]  # fmt: skip


@pytest.mark.parametrize(("before", "after"), MUTATIONS)
def test_a_loosened_or_broken_limit_is_refused(scenes: Path, before: str, after: str) -> None:
    rig = scenes / "rigs" / "twin.xml"
    assert before in rig.read_text()
    rig.write_text(rig.read_text().replace(before, after, 1))
    with pytest.raises(itouch.SceneError):
        itouch.build(scenes / "four_materials.xml")


def test_only_axes_that_turn_and_that_there_are_have_a_torque() -> None:
    strong = wrench(force=8.0, torque=0.03)
    one = replace(strong, low=(*strong.low[:3], -0.05, -0.03, -0.03), high=(*strong.high[:3], 0.05, 0.03, 0.03))
    assert ceilings((), (one,))["torque"][0] == 0.05
    assert ceilings((), (replace(one, locked=(3,)),))["torque"][0] == 0.03
    assert "torque" not in ceilings((), (replace(one, locked=(3, 4, 5)),))


def test_bands_of_scene_and_device_that_allow_no_temperature_together_are_refused(scenes: Path) -> None:
    rig, path = scenes / "rigs" / "twin.xml", scenes / "four_materials.xml"
    rig.write_text(rig.read_text().replace('temperature="15 40 degC"', 'temperature="25 40 degC"'))
    path.write_text(path.read_text().replace('<safety force="3 N"/>', '<safety temperature="16 20 degC"/>'))
    with pytest.raises(itouch.SceneError) as refused:
        itouch.build(path)
    (problem,) = refused.value.problems
    assert problem.code == "bad-value" and problem.place is not None and problem.place.file.endswith("twin.xml")
    assert "25 to 40 degC (<limits>) and 16 to 20 degC (<safety>)" in problem.sentence
    ((other, _),) = problem.related
    assert other.file.endswith("four_materials.xml") and other.text.strip() == '<safety temperature="16 20 degC"/>'
    path.write_text(path.read_text().replace("16 20 degC", "16 30 degC"))
    assert in_force(path)["peltier"]["temperature"] == pytest.approx((298.15, 303.15))


@pytest.mark.parametrize(("most", "told"), [("2 min", "1"), ("30 s", "0.25")])
def test_a_dose_is_told_before_it_trips(scenes: Path, most: str, told: str) -> None:
    path = scenes / "four_materials.xml"
    path.write_text(path.read_text().replace('<safety force="3 N"/>', f'<safety dose="{most}"/>'))
    engine = itouch.build(path)
    (rule,) = (rule for one in engine.model.devices["peltier"].monitors for rule in one.rules() if rule.number == "T3")
    assert rule.limit == f"told at {told} CEM43"
