"""Another rig under a scene: no limit that the scene or the rig asks for is lost, and every change is said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import itouch
from itouch_tools.cli.__main__ import main

Write = Callable[[str, str], Path]

DEVICES = """<devices>
<device name="arm" plugin="usb-arm"><limits {arm}/></device>
<device name="table" plugin="xyz-table"><mount pos="0 0 -30 mm"/><limits {table}/></device>
<device name="pad" plugin="thermal"><mount on="table" pos="0 0 24 mm"/><limits {pad}/></device>
</devices>"""


def xml(*, arm: str = "", table: str = "", pad: str = "", more: str = "") -> str:
    return f'<itouch version="1.0">{DEVICES.format(arm=arm, table=table, pad=pad)}{more}</itouch>'


def in_force(scene: Path, rig: Path | None = None) -> dict[str, dict[str, object]]:
    model = itouch.build(scene, rig=rig).model
    return {name: device.limits.table() for name, device in model.devices.items()}


def test_limits_of_the_scene_survive_another_rig(write: Write) -> None:
    scene = write("s.xml", xml(arm='force="0.5 N"', table='speed="0.1 m/s"',
                               pad='current="1 A" temperature="25 34 degC"'))  # fmt: skip
    rig = write("rig.xml", xml(arm='force="3 N"', pad='current="6 A" temperature="20 30 degC"'))
    found = in_force(scene, rig)
    assert found["arm"]["force"] == 0.5
    assert found["table"]["speed"] == 0.1
    assert found["pad"]["current"] == 1.0
    assert found["pad"]["temperature"] == pytest.approx((298.15, 303.15))
    sources = itouch.build(scene, rig=rig).model.devices["arm"].limits.sources
    assert sources["force"] == f"<limits> at {scene}:2:1" or "s.xml:2" in sources["force"]


def test_the_safety_of_a_rig_counts(write: Write, capsys: pytest.CaptureFixture[str]) -> None:
    scene = write("s.xml", xml(more='<safety speed="0.2 m/s" dose="30 s"/>'))
    rig = write("rig.xml", xml(more='<safety force="0.3 N" dose="60 s" hold-to-run="yes"/>'))
    session = itouch.build(scene, rig=rig)
    assert session.model.devices["arm"].limits.force == 0.3
    assert session.model.devices["table"].limits.speed == 0.2
    assert session.model.devices["pad"].limits.dose == 30.0
    assert session.model.scene.safety.hold_to_run is True
    (told,) = [notice for notice in session.notices if "'arm' with this rig" in notice]
    assert told.startswith("limit of 'arm' with this rig: force 0.3 N (<safety> at ")
    assert told.endswith("it was 3 N")
    assert main(["check", str(scene), "--rig", str(rig)]) == 0
    assert "limit of 'arm' with this rig: force 0.3 N" in capsys.readouterr().out


@pytest.mark.parametrize("section", [
    "<rates servo='500 Hz'/>", "<record to='x.mcap'/>", "<fault device='arm' kind='freeze' at='1 s'/>",
    "<materials><material name='m'/></materials>", "<world temperature='30 degC'/>", "<interaction/>",
])  # fmt: skip
def test_a_section_without_effect_is_an_error(write: Write, section: str) -> None:
    scene, rig = write("s.xml", xml()), write("rig.xml", xml(more="\n" + section))
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(scene, rig=rig)
    (problem,) = caught.value.problems
    tag = section[1:].split()[0].split("/")[0].split(">")[0]
    assert problem.sentence.startswith(f"<{tag}> in the rig ")
    assert problem.place is not None
    assert problem.place.line > 1


def test_a_rig_can_not_ask_for_a_longer_contact(write: Write) -> None:
    scene, rig = write("s.xml", xml()), write("rig.xml", xml(more='<safety contact-time="50 s"/>'))
    with pytest.raises(itouch.SceneError, match="asks for 50 s, the scene for 10 s"):
        itouch.build(scene, rig=rig)


def test_a_limit_that_other_hardware_keeps_by_itself_is_left_out(scenes: Path) -> None:
    session = itouch.build(scenes / "four_materials.xml", rig=scenes / "rigs" / "temperature_display.xml")
    told = [notice for notice in session.notices if "with this rig" in notice]
    assert any("'peltier' with this rig: current none, it was 6 A" in notice for notice in told)


@pytest.mark.parametrize("safety", [False, True])
def test_a_rig_whose_band_has_nothing_in_common_with_the_scenes_is_refused(write: Write, safety: bool) -> None:
    def bands(band: str) -> str:
        return xml(more=f'<safety temperature="{band}"/>') if safety else xml(pad=f'temperature="{band}"')

    scene, rig = write("s.xml", bands("16 20 degC")), write("rig.xml", bands("25 40 degC"))
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(scene, rig=rig)
    (problem,) = caught.value.problems
    who = "<safety>" if safety else "device 'pad'"
    wanted = f"{who}: the scene allows 16 to 20 degC and the rig 25 to 40 degC, and no temperature is within both"
    assert problem.sentence == wanted
    assert problem.place is not None and problem.place.file.endswith("rig.xml")
    ((other, _),) = problem.related
    assert other.file.endswith("s.xml") and "16 20 degC" in other.text


_FORCE, _CURRENT = st.floats(0.01, 3.0), st.floats(0.1, 6.0)


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    own=st.tuples(_FORCE, _CURRENT),
    rigs=st.tuples(_FORCE, _CURRENT),
    whole=st.none() | _FORCE,
    brings=st.none() | _FORCE,
)
def test_no_swap_loosens_what_anyone_asks(
    write: Write, own: tuple[float, float], rigs: tuple[float, float], whole: float | None, brings: float | None
) -> None:
    def text(limits: tuple[float, float], force: float | None) -> str:
        safety = "" if force is None else f'<safety force="{force!r} N"/>'
        return xml(arm=f'force="{limits[0]!r} N"', pad=f'current="{limits[1]!r} A"', more=safety)

    scene, rig = itouch.load(write("s.xml", text(own, whole)), rig=write("rig.xml", text(rigs, brings))), None
    model = itouch.build(scene, rig=rig).model
    asked = [own[0], rigs[0], *(force for force in (whole, brings) if force is not None)]
    assert model.devices["arm"].limits.force == min(asked)
    assert model.devices["pad"].limits.current == min(own[1], rigs[1])


@pytest.mark.parametrize("which", ["s.xml", "rig.xml"])
@pytest.mark.parametrize(
    ("loose", "tight"), [('force="20 N"', 'force="1 N"'), ('temperature="0 44 degC"', 'temperature="20 30 degC"')]
)
def test_a_limit_beyond_the_default_is_refused_in_rig_and_scene_though_the_tighter_one_holds(
    write: Write, which: str, loose: str, tight: str
) -> None:
    files = {
        name: write(name, xml(more=f"<safety {loose if name == which else tight}/>")) for name in ("s.xml", "rig.xml")
    }
    with pytest.raises(itouch.SceneError, match="<safety") as raised:
        itouch.build(files["s.xml"], rig=files["rig.xml"])
    (problem,) = raised.value.problems
    assert problem.code == "loosened-limit" and problem.place is not None
    assert str(problem.place.file).endswith(which)


def test_what_a_script_puts_in_place_of_both_is_looked_at_too(write: Write) -> None:
    tight = xml(more='<safety force="1 N"/>')
    scene = itouch.load(write("s.xml", tight), rig=write("rig.xml", tight))
    with pytest.raises(itouch.SceneError, match="20 N is above the default of 3 N"):
        itouch.build(replace(scene, safety=replace(scene.safety, force=20.0)))


@pytest.mark.parametrize(("own", "rigs"), [("P01", ""), ("", "P01"), ("P01", "P01")])
def test_the_participant_of_a_rig_counts(write: Write, own: str, rigs: str) -> None:
    """A rig's was dropped without a word: nothing was noted of what the person had used."""
    person = '<safety participant="{}"/>'.format
    rig = write("rig.xml", xml(more=person(rigs) if rigs else ""))
    scene = itouch.load(write("s.xml", xml(more=person(own) if own else "")), rig=rig)
    assert scene.safety.participant == "P01"


def test_a_rig_and_a_scene_do_not_name_two_participants(write: Write) -> None:
    scene = write("s.xml", xml(more='<safety participant="P01"/>'))
    rig = write("rig.xml", xml(more='<safety participant="P02"/>'))
    with pytest.raises(itouch.SceneError, match="<safety participant> of the rig is 'P02', that of the scene 'P01'"):
        itouch.load(scene, rig=rig)


@pytest.mark.parametrize(("scene", "rig"), [("0.5 N", "2 kg"), ("2 kg", "0.5 N"), ("0 N", "2 kg")])
def test_of_a_device_with_a_fault_nobody_says_that_it_is_missing(write: Write, scene: str, rig: str) -> None:
    """The first problem was right, and the second said that the rig, or the scene, had no device named 'arm'."""
    one, other = write("s.xml", xml(arm=f'force="{scene}"')), write("rig.xml", xml(arm=f'force="{rig}"'))
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(one, rig=other)
    wrong = [value for value in (scene, rig) if value != "0.5 N"]
    assert [problem.sentence.split('"')[1] for problem in caught.value.problems] == wrong


@pytest.mark.parametrize("unread", ["scene", "rig"])
def test_of_files_that_could_not_be_read_nobody_says_what_is_not_in_them(write: Write, unread: str) -> None:
    """Devices that the missing file may have were said to be missing, too."""
    hole, arm = '<include file="elsewhere.xml"/>', '<devices><device name="arm" plugin="usb-arm"/></devices>'
    short = f'<itouch version="1.0">{hole}{arm}</itouch>'
    one = write("s.xml", short if unread == "scene" else xml())
    other = write("rig.xml", short if unread == "rig" else xml())
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(one, rig=other)
    (problem,) = caught.value.problems
    assert "elsewhere.xml" in problem.sentence


@pytest.mark.parametrize("unread", ["s.xml", "rig.xml"])
@pytest.mark.parametrize("name", ['name="2nd"', ""])
def test_of_a_device_whose_name_could_not_be_read_nobody_says_that_it_is_missing(
    write: Write, unread: str, name: str
) -> None:
    broken = xml().replace('name="arm"', name)
    scene, rig = (write(file, broken if file == unread else xml()) for file in ("s.xml", "rig.xml"))
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(scene, rig=rig)
    assert [problem.code for problem in caught.value.problems] == ["bad-value" if name else "missing-attribute"]


def test_a_whole_scene_as_a_rig_is_not_said_to_define_the_scenes_things_twice(write: Write) -> None:
    more = '<materials><material name="m"><contact stiffness="1 N/mm"/></material></materials>'
    more += '<world><sphere name="b" radius="9 mm" material="m"/></world>'
    scene = write("s.xml", xml(more=more))
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(scene, rig=scene)
    assert {problem.code for problem in caught.value.problems} == {"rig"}
    assert len(caught.value.problems) == 2  # <materials> and <world> have no effect in a rig


@pytest.mark.parametrize("text", ["", "<devices/>", '<defaults><mount pos="0 0 1 mm"/></defaults>'])
def test_a_rig_that_brings_nothing_is_refused(write: Write, text: str) -> None:
    """It was accepted without a word, and the scene ran with its own devices."""
    scene, rig = write("s.xml", xml()), write("rig.xml", f'<itouch version="1.0">{text}</itouch>')
    with pytest.raises(itouch.SceneError, match="has no effect: it brings neither a device nor <safety>"):
        itouch.build(scene, rig=rig)
