"""Modalities: their order in the file does not matter, faults point at their place, what is missing is told once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import itouch

HEAT = '    <thermal:heat probe="finger" contact-resistance="0.002 m^2*K/W" arterial="37 degC"/>\n'
CONTROL = '    <thermal:flux-control display="peltier" desired-from="heat"/>\n'


def swap(folder: Path, old: str, new: str) -> Path:
    path = folder / "four_materials_hurried.xml"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def test_the_order_in_the_file_does_not_matter(scenes: Path) -> None:
    straight = itouch.build(scenes / "four_materials_hurried.xml", seed=3)
    turned = itouch.build(swap(scenes, HEAT + CONTROL, CONTROL + HEAT), seed=3)
    assert [m.name for m in turned.model.modalities if not m.default_of] == ["heat", "flux-control"]
    for engine in (straight, turned):
        engine.run(8.0)
    assert straight.state.dtype == turned.state.dtype
    assert straight.state.tobytes() == turned.state.tobytes()
    assert np.isfinite(straight.state["heat.desired"])
    assert straight.state["heat.desired"] > 1000.0


def test_a_modality_that_takes_from_itself_is_one_problem(scenes: Path) -> None:
    path = swap(scenes, 'desired-from="heat"', 'desired-from="flux-control"')
    with pytest.raises(itouch.SceneError) as fault:
        itouch.build(path)
    assert [p.code for p in fault.value.problems if p.code == "modality-cycle"] == ["modality-cycle"]
    assert fault.value.problems[0].place is not None


def test_what_a_modality_cannot_work_with_is_told_at_its_attribute_with_what_to_do(scenes: Path) -> None:
    path = swap(scenes, 'display="peltier"', 'display="table"')
    with pytest.raises(itouch.SceneError) as fault:
        itouch.build(path)
    (problem,) = (p for p in fault.value.problems if p.code == "modality")
    assert problem.place is not None and problem.place.text[problem.place.column - 1 :].startswith('display="table"')
    assert problem.advice == "name a thermal display"


def test_a_device_that_is_missing_is_told_once(scenes: Path) -> None:
    rig = scenes / "rigs" / "twin.xml"
    rig.write_text(rig.read_text().replace('name="peltier" plugin="thermal"', 'name="peltier" plugin="thermall"'))
    with pytest.raises(itouch.SceneError) as fault:
        itouch.build(scenes / "four_materials_hurried.xml")
    assert {p.code for p in fault.value.problems} <= {"unknown-plugin", "wrong-plugin"}


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("arm", "probe 'finger' is tracked by 'arm', which is missing: it can't do without"),
        ("table", "device 'peltier' is mounted on 'table', which is missing"),
    ],
)
def test_an_optional_device_that_others_need_is_told_where_they_name_it(scenes: Path, name: str, said: str) -> None:
    rig = scenes / "rigs" / "twin.xml"
    text = rig.read_text()
    absent = text.replace(f'<device name="{name}" plugin="', f'<device name="{name}" optional="yes" plugin="absent-')
    assert absent != text
    rig.write_text(absent)
    with pytest.raises(itouch.SceneError) as fault:
        itouch.build(scenes / "four_materials_hurried.xml")
    found = {one.sentence: one.place for one in fault.value.problems if one.severity == "error"}
    assert found[said] is not None
