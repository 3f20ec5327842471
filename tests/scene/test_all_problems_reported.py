"""All that is wrong with a scene is told at once, whichever stage of reading it would find it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

import itouch
from itouch.monitors.default_limits import FORCE
from itouch.scene.elements.materials import Magnetic, StickSlip
from itouch.schema import Problem, SceneError
from itouch_tools.cli import main

SCENE = """<itouch version="1.0">
  <materials><material name="wood"><contact stifness="1 N/mm"/></material></materials>
  <world>
    <box name="block" size="60 60 20 mm" pos="0 0 10 mm" material="wod"/>
    <mesh name="shell" file="nowhere.stl" material="wood"/>
  </world>
  <devices>
    <device name="arm" plugin="usb-arm"><limits force="30 N"/></device>
    <device name="odd" plugin="usbarm"/>
  </devices>
  <interaction>
    <probe name="finger" radius="8 mm" pose-from="amr"/>
  </interaction>
  <safety force="100 N"/>
</itouch>"""
#: Line and what is wrong there.
WRONG = {2: "stifness", 4: "wod", 5: "nowhere.stl", 8: "30 N", 9: "usbarm", 12: "amr", 14: "100 N"}


def test_the_problems_of_every_stage_stand_in_one_list(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    with pytest.raises(SceneError) as caught:
        itouch.build(path)
    found = [(problem.place.line, problem.sentence) for problem in caught.value.problems if problem.place is not None]
    assert [line for line, _ in found] == sorted(WRONG)
    assert all(WRONG[line] in sentence for line, sentence in found)
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr()
    assert all(word in said.err + said.out for word in WRONG.values())


def test_files_of_textures_and_motions_are_read_whatever_else_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "map.png").write_bytes(b"no picture")
    (tmp_path / "way.csv").write_text("t,x,y,z\n0,0,0,0\n1,here,0,0\n")
    path = tmp_path / "scene.xml"
    path.write_text("""<itouch version="1.0">
  <materials><material name="wood"><contact stiffness="1 N/mm"/>
    <texture file="map.png"/></material></materials>
  <world>
    <box name="block" size="60 60 20 mm" pos="0 0 10 mm" colour="red" material="wood"/>
    <box name="lid" size="60 60 20 mm" material="wood">
      <motion file="way.csv"/></box>
  </world></itouch>""")
    with pytest.raises(SceneError) as caught:
        itouch.build(path)
    found = [(problem.place.line, problem.code) for problem in caught.value.problems if problem.place is not None]
    assert found == [(3, "texture"), (5, "unknown-attribute"), (7, "motion")]


EFFECTS = """<itouch version="1.0">
  <materials>
    <material name="iron"><contact stiffness="1 N/mm"/><magnetic force="1 N" range="90 mm"/></material>
    <material name="bell"><contact stiffness="1 N/mm"/>
      <vibration amplitude="0.1 N" frequency="400 Hz"/></material>
  </materials>
  <world>
    <box name="block" size="60 60 20 mm" material="iron"/>
    <box name="lid" size="60 60 20 mm" material="bell"/>
    <ORDINARY/>
  </world>
  <devices><device name="arm" plugin="usb-arm"/></devices>
  <interaction>
    <probe name="finger" pose-from="arm"/>
  </interaction>
  <record to="run.mcap" channels="finger.contct arm.pose"/>
</itouch>"""
#: The same with the last mistakes mended.
MENDED = EFFECTS.replace("400 Hz", "40 Hz").replace("90 mm", "9 mm").replace("finger.contct", "finger.*")


def told(tmp_path: Path, text: str) -> list[Problem]:
    """Return what is told of a scene, in which there may be room for an ordinary mistake."""
    path = tmp_path / "scene.xml"
    path.write_text(text.replace("    <ORDINARY/>\n", ""))
    with pytest.raises(SceneError) as caught:
        itouch.build(path)
    return list(caught.value.problems)


def lines_and_codes(problems: list[Problem]) -> list[tuple[int, str]]:
    return [(problem.place.line, problem.code) for problem in problems if problem.place is not None]


def codes(problems: list[Problem]) -> list[str]:
    return [problem.code for problem in problems]


ORDINARY = {
    "misspelt": '<box name="more" size="1 1 1 mm" material="iron" colour="red"/>',
    "unit": '<box name="more" size="1 1 1 kg" material="iron"/>',
    "material": '<box name="more" size="1 1 1 mm" material="irn"/>',
    "mesh": '<mesh name="more" file="absent.stl" material="iron"/>',
}


@pytest.mark.parametrize("ordinary", ORDINARY)
def test_what_is_found_last_is_told_beside_an_ordinary_mistake(tmp_path: Path, ordinary: str) -> None:
    found = lines_and_codes(told(tmp_path, EFFECTS.replace("<ORDINARY/>", ORDINARY[ordinary])))
    assert [line for line, _ in found] == [3, 5, 10, 16]
    assert [code for line, code in found if line != 10] == ["out-of-range", "out-of-range", "unknown-channel"]


def test_what_a_mistake_brings_with_it_is_not_told(tmp_path: Path) -> None:
    """Neither that a probe which could not be read is missing, nor its channels, nor what its range is compared with."""
    found = told(tmp_path, EFFECTS.replace('pose-from="arm"', 'pose-from="arm" neer="100 mm"'))
    assert lines_and_codes(found) == [(5, "out-of-range"), (13, "unknown-attribute")]


def test_a_misspelt_section_is_checked_as_the_one_that_was_meant(tmp_path: Path) -> None:
    found = told(tmp_path, EFFECTS.replace("devices>", "devics>").replace("400 Hz", "40 Hz"))
    assert lines_and_codes(found) == [(3, "out-of-range"), (11, "unknown-element"), (15, "unknown-channel")]


@pytest.mark.parametrize("before", [True, False])
def test_what_stands_outside_its_section_is_checked_as_if_it_stood_there(tmp_path: Path, before: bool) -> None:
    material = '<material name="cork"><contact stiffness="1 N/mm"/><visual colour="1 0 0"/></material>'
    text = MENDED.replace('material="bell"', 'material="cork"')
    at = text.index("  <materials>") if before else text.index("</itouch>")
    found = told(tmp_path, f"{text[:at]}{material}\n{text[at:]}")
    assert codes(found) == ["unknown-element", "unknown-attribute"]
    assert len({problem.place.line for problem in found if problem.place is not None}) == 1
    assert found[0].advice == "put it into <materials>"


def test_a_layer_that_could_not_be_read_is_not_missing(tmp_path: Path) -> None:
    layer = '<softness>\n<layer thickness="1 mm" stiffnes="1 N/mm"/>\n</softness>'
    found = told(tmp_path, MENDED.replace('<magnetic force="1 N" range="9 mm"/>', layer))
    assert codes(found) == ["unknown-attribute"]


@pytest.mark.parametrize("name", ['name="2nd finger"', ""])
@pytest.mark.parametrize(("wanted", "unknown"), [("finger", 0), ("thumb", 0), ("midle-finger", 1), ("finger thumb", 2)])
def test_what_refers_to_a_name_that_could_not_be_read_is_not_told(
    tmp_path: Path, name: str, wanted: str, unknown: int
) -> None:
    """But a name much like one that is there is told, and names are of which it can only be one."""
    text = EFFECTS.replace('name="finger"', name)
    more = ['<probe name="middle-finger" pose-from="arm"/>']
    more += [
        f'<operator probe="{one}"><motion>\n<to pos="0 0 40 mm" in="1 s"/></motion></operator>'
        for one in wanted.split()
    ]
    found = told(tmp_path, text.replace("</interaction>", "\n".join([*more, "</interaction>"])))
    assert codes(found).count("unknown-name") == unknown


@pytest.mark.parametrize("moved", ["device", "probe", "material", "foo"])
def test_what_refers_to_an_element_in_a_wrong_section_is_not_told(tmp_path: Path, moved: str) -> None:
    text = MENDED.replace("finger.*", "*").replace("</interaction>", '<operator probe="finger"/>\n</interaction>')
    lines = {
        "device": '<device name="arm" plugin="usb-arm"/>',
        "probe": '<probe name="finger" pose-from="arm"/>',
        "material": '<material name="bell"><contact stiffness="1 N/mm"/>\n'
        '      <vibration amplitude="0.1 N" frequency="40 Hz"/></material>',
        "foo": '<device name="arm" plugin="usb-arm"/>',
    }
    line = lines[moved]
    assert line in text
    wrong = line.replace("<device", "<foo") if moved == "foo" else line
    text = text.replace(line, "")
    assert codes(told(tmp_path, text.replace("</world>", f"{wrong}\n</world>"))) == ["unknown-element"]


BASES = {
    "named": ('<material name="iron">', '<material name="1ron">', "bad-value"),
    "called": ('<material name="iron">', "<material>", "missing-attribute"),
    "known": ('<material name="iron">', '<materiaq name="iron">', "unknown-element"),
    "in a file": ("  <materials>", '  <include fil="more.xml"/><materials>', "unknown-attribute"),
    "there": ('<material name="iron">', '<material name="iron">', "unknown-name"),
}


@pytest.mark.parametrize("wrong", BASES)
def test_a_base_that_could_not_be_read_is_not_told_as_unknown(tmp_path: Path, wrong: str) -> None:
    text = MENDED.replace('material="iron"', 'material="steel"')
    base = "iron" if wrong not in ("in a file", "there") else "cast"
    text = text.replace("  </materials>", f'    <material name="steel" base="{base}"/>\n  </materials>')
    one, other, code = BASES[wrong]
    text = text.replace(one, other, 1)
    found = told(tmp_path, text.replace("</material>", "</materiaq>", 1) if "materiaq" in other else text)
    assert codes(found) == [code]


UNREAD = {
    "no name": '<devices><device name="2nd table" plugin="xyz-table"/>',
    "none": '<devices><device plugin="xyz-table"/>',
    "astray": '<world><device name="table" plugin="xyz-table"/></world><devices>',
}


@pytest.mark.parametrize("unread", UNREAD)
def test_what_belongs_to_a_device_whose_name_could_not_be_read_is_not_told(tmp_path: Path, unread: str) -> None:
    """Neither its channels nor its calibration are; a channel that is much like one of another device is."""
    from itouch_tools.cli.explain import examples

    records = examples()["calibration-stale"].files["scene.calibration.json"]
    assert isinstance(records, str)
    (tmp_path / "scene.calibration.json").write_text(records)
    scene = f"""<itouch version="1.0">{UNREAD[unread]}
      <device name="arm" plugin="usb-arm"/></devices>
      <record to="r.mcap" channels="table.position armm.pose"/></itouch>"""
    said = [problem.sentence for problem in told(tmp_path, scene)]
    assert len(said) == 2
    assert "armm.pose" in said[1]


def test_a_circle_of_modalities_is_told_beside_an_ordinary_mistake() -> None:
    from itouch_tools.cli.explain import examples
    from itouch_tools.cli.explain.example import play

    circle = examples()["modality-cycle"]
    scene = circle.files["scene.xml"]
    assert isinstance(scene, str)
    wrong = scene.replace("</itouch>", '<world><box name="block" size="1 1 1 mm" material="wod"/></world></itouch>')
    said = play(dataclasses.replace(circle, files={**circle.files, "scene.xml": wrong}))
    assert [said.count(code) for code in ("error[modality-cycle]", "error[unknown-name]", "error[")] == [1, 1, 2]


def test_mending_what_is_told_leaves_nothing(tmp_path: Path) -> None:
    """What is told beside other problems is wrong by itself: it is there, too, when they are mended."""
    path = tmp_path / "scene.xml"
    mended = SCENE.replace("stifness", "stiffness").replace('"wod"', '"wood"').replace("amr", "arm")
    path.write_text(mended)
    with pytest.raises(SceneError) as caught:
        itouch.build(path)
    assert [problem.place.line for problem in caught.value.problems if problem.place is not None] == [5, 8, 9, 14]


@pytest.mark.parametrize("element", [StickSlip, Magnetic])
def test_no_effect_of_a_surface_may_be_stronger_than_what_a_finger_may_feel(element: type) -> None:
    """The scene's own limit holds besides; this one is of the language, and no scene can ask for more."""
    highs = {
        field.name: field.metadata["itouch"].high for field in dataclasses.fields(element)
        if field.metadata["itouch"].unit == "N"
    }  # fmt: skip
    assert highs == {"force": FORCE}
