"""Includes, prefixes, defaults, bases and rigs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import itouch

Write = Callable[[str, str], Path]


def test_defaults_hold_in_the_file_and_for_its_users(write: Write) -> None:
    write("lib.xml", '<itouch version="1.0"><defaults><box size="1 2 3 mm"/></defaults>'
          '<materials><material name="m"><contact stiffness="100"/></material></materials></itouch>')  # fmt: skip
    path = write("s.xml", '<itouch version="1.0"><include file="lib.xml"/><defaults><box temperature="30 degC"/>'
                 '</defaults><world><box name="a" material="m"/>'
                 '<box name="b" material="m" size="4 4 4 mm"/></world></itouch>')  # fmt: skip
    a, b = itouch.load(path).objects
    assert a.size == pytest.approx((0.001, 0.002, 0.003))
    assert a.temperature == pytest.approx(303.15)
    assert b.size == pytest.approx((0.004, 0.004, 0.004))


def test_a_default_gives_way_to_what_excludes_it(write: Write) -> None:
    path = write("s.xml", '<itouch version="1.0"><defaults><box rpy="0 0 1" size="1 1 1"/></defaults>'
                 '<materials><material name="m"><contact stiffness="100"/></material></materials>'
                 '<world><box name="a" material="m" quat="1 0 0 0"/></world></itouch>')  # fmt: skip
    (a,) = itouch.load(path).objects
    assert (a.quat, a.rpy) == ((1.0, 0.0, 0.0, 0.0), None)


def test_prefix_renames_what_the_included_file_defines(write: Write) -> None:
    write("part.xml", '<itouch version="1.0"><materials><material name="m"><contact stiffness="100"/></material>'
          '</materials><world><box name="a" size="1 1 1 mm" material="m"/></world></itouch>')  # fmt: skip
    path = write("s.xml", '<itouch version="1.0"><include file="part.xml" prefix="left-"/>'
                 '<include file="part.xml" prefix="right-"/></itouch>')  # fmt: skip
    scene = itouch.load(path)
    assert [(o.name, o.material) for o in scene.objects] == [("left-a", "left-m"), ("right-a", "right-m")]


def test_a_prefix_renames_also_what_refers_to_a_files_own_includes(write: Write) -> None:
    write("inner.xml", '<itouch version="1.0"><materials><material name="m"><contact stiffness="100"/></material>'
          '</materials></itouch>')  # fmt: skip
    write("part.xml", '<itouch version="1.0"><include file="inner.xml" prefix="in-"/>'
          '<world><box name="a" size="1 1 1 mm" material="in-m"/></world></itouch>')  # fmt: skip
    path = write("s.xml", '<itouch version="1.0"><include file="part.xml" prefix="left-"/></itouch>')
    assert [(o.name, o.material) for o in itouch.load(path).objects] == [("left-a", "left-in-m")]


def test_a_whole_scene_may_be_included_under_a_prefix(scenes: Path) -> None:
    path = scenes / "s.xml"
    path.write_text('<itouch version="1.0"><include file="four_materials.xml" prefix="p-"/></itouch>')
    scene = itouch.load(path)
    (probe,) = scene.probes
    assert (probe.pose_from, probe.force_to, probe.surface_to) == ("p-arm", "p-arm", "p-table")
    heat, control = scene.modalities
    assert (heat.name, control.name, control.params.display) == ("p-heat", "p-flux-control", "p-peltier")
    assert control.params.desired_from == "p-heat"


def test_the_same_file_twice_is_told(write: Write) -> None:
    write("part.xml", '<itouch version="1.0"/>')
    path = write("s.xml", '<itouch version="1.0"><include file="part.xml"/><include file="part.xml"/></itouch>')
    with pytest.raises(itouch.SceneError, match="included twice"):
        itouch.load(path)


def test_base_is_resolved_attribute_by_attribute(write: Write) -> None:
    path = write("s.xml", '<itouch version="1.0"><materials>'
                 '<material name="soft" base="hard"><contact stiffness="10"/></material>'
                 '<material name="hard"><contact stiffness="100" damping="2"/><visual color="1 0 0"/></material>'
                 "</materials></itouch>")  # fmt: skip
    soft = itouch.load(path).material("soft")
    assert soft.contact is not None
    assert (soft.contact.stiffness, soft.contact.damping) == (10.0, 2.0)
    assert soft.visual is not None


def test_what_stands_inside_an_element_of_the_base_holds_too(write: Write) -> None:
    """A louder bell still rings; elements inside that are given anew replace all of the base's."""
    path = write("s.xml", '<itouch version="1.0"><materials>'
                 '<material name="bell"><contact stiffness="9"/>'
                 '<sound loudness="0.5"><mode frequency="1 kHz" decay="1 s"/></sound></material>'
                 '<material name="loud" base="bell"><sound loudness="1"/></material>'
                 '<material name="deep" base="loud"><sound><mode frequency="90 Hz" decay="1 s"/></sound></material>'
                 "</materials></itouch>")  # fmt: skip
    scene = itouch.load(path)
    sounds = [scene.material(name).sound for name in ("loud", "deep")]
    assert [(sound.loudness, [mode.frequency for mode in sound.modes]) for sound in sounds if sound is not None] == [
        (1.0, [1000.0]), (1.0, [90.0])
    ]  # fmt: skip


@pytest.mark.parametrize("base", ["", ' base="wood"'])
def test_an_element_given_twice_is_told_with_a_base_as_without(base: str, write: Write) -> None:
    path = write("s.xml", '<itouch version="1.0"><materials><material name="wood"><contact stiffness="9"/></material>\n'
                 f'<material name="m"{base}><contact stiffness="1"/><contact stiffness="2"/></material>'
                 "</materials></itouch>")  # fmt: skip
    with pytest.raises(itouch.SceneError) as caught:
        itouch.load(path)
    (problem,) = caught.value.problems
    assert problem.code == "duplicate-element" and problem.advice == "remove one of them"
    assert problem.place is not None and (problem.place.line, problem.place.column) == (2, 44 + len(base))


@pytest.mark.parametrize(
    ("contact", "spot", "advice"),
    [
        ('<contact stifness="9" damping="1"/>', "stifness", "did you mean 'stiffness'?"),
        ('<contact stiffness="9" static-friction="0.2" dynamic-friction="0.3"/>', "dynamic-friction", "swap"),
    ],
)
def test_what_is_wrong_in_a_base_is_told_once_and_where_it_stands(
    contact: str, spot: str, advice: str, write: Write
) -> None:
    path = write("s.xml", f'<itouch version="1.0"><materials><material name="a">{contact}</material>'
                 '<material name="b" base="a"><contact stiffness="5"/></material>'
                 '<material name="c" base="b"/></materials></itouch>')  # fmt: skip
    with pytest.raises(itouch.SceneError) as caught:
        itouch.load(path)
    (problem,) = caught.value.problems
    assert problem.place is not None and problem.place.text[problem.place.column - 1 :].startswith(spot)
    assert advice in problem.advice


def test_a_cycle_of_bases_is_refused(write: Write) -> None:
    path = write("s.xml", '<itouch version="1.0"><materials><material name="a" base="b"/>'
                 '<material name="b" base="a"/></materials></itouch>')  # fmt: skip
    with pytest.raises(itouch.SceneError, match="its own base"):
        itouch.load(path)


def test_rig_replaces_devices_of_the_same_names(scenes: Path) -> None:
    rig = scenes / "rigs" / "other.xml"
    rig.write_text((scenes / "rigs" / "twin.xml").read_text().replace("2 -1.5 3 mm", "0 0 -1 mm"))
    scene = itouch.load(scenes / "four_materials.xml", rig=rig)
    assert scene.device("table").mount.mount_error == pytest.approx((0, 0, -0.001))


def test_rig_with_other_names_is_refused(scenes: Path) -> None:
    rig = scenes / "rigs" / "other.xml"
    rig.write_text((scenes / "rigs" / "twin.xml").read_text().replace('name="arm"', 'name="omni"'))
    with pytest.raises(itouch.SceneError) as caught:
        itouch.load(scenes / "four_materials.xml", rig=rig)
    assert any("has no device named 'arm'" in problem.sentence for problem in caught.value.problems)


def test_paths_are_relative_to_the_file_that_names_them(write: Write) -> None:
    write("lib/deep/m.xml", '<itouch version="1.0"><materials><material name="m"/></materials></itouch>')
    write("lib/a.xml", '<itouch version="1.0"><include file="deep/m.xml"/></itouch>')
    path = write("s.xml", '<itouch version="1.0"><include file="lib/a.xml"/></itouch>')
    assert itouch.load(path).material("m").name == "m"


def test_an_optional_device_without_its_plugin_is_a_warning(write: Write) -> None:
    path = write("s.xml", '<itouch version="1.0"><devices><device name="x" plugin="nope" optional="yes"/>'
                 "</devices></itouch>")  # fmt: skip
    engine = itouch.build(path)
    assert list(engine.model.devices) == []
