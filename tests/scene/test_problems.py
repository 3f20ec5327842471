"""Each wrong scene gives its message at its line and column, all problems at once, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import itouch
from itouch.plugin.discovery import Catalog
from itouch.scene import binding
from itouch.scene.elements.rates import Rates
from itouch.scene.loader import in_file_order, read_scene
from itouch.scene.source import SourceError, read_root
from itouch.scene.values import ValueProblemError, parse_value
from itouch.schema import Problem
from itouch.schema.fields import Spec
from itouch.world import compile_scene
from itouch_tools.cli import main as cli

Write = Callable[[str, str], Path]

HEAD = """<itouch version="1.0" xmlns:thermal="urn:itouch:plugin:thermal" xmlns:xyz-table="urn:itouch:plugin:xyz-table">
<materials><material name="wood"><contact stiffness="1 N/mm"/></material></materials>
<devices><device name="arm" plugin="usb-arm"/></devices>
"""
TAIL = "\n</itouch>"


ABSENT = """<itouch version="1.0" xmlns:odd-x="urn:itouch:plugin:odd-x">
<devices><device name="a" plugin="usb-arm"><odd-x:hardware/></device></devices>
</itouch>"""


def problems_of(path: Path) -> list[Problem]:
    catalog = Catalog()
    scene, problems = read_scene(path, catalog)
    if not any(problem.severity == "error" for problem in problems):
        problems += compile_scene(scene, catalog)[1]
    return in_file_order(problems)


#: (body on line 4 of the file, code, column, a part of the sentence or advice)
ONE_LINE = [
    ('<world><box name="b" size="1 1 1 mm" material="wod"/></world>', "unknown-name", 38, "did you mean 'wood'"),
    ('<world><box name="b" size="1 1 mm" material="wood"/></world>', "bad-value", 22, "expected 3 numbers"),
    ('<world><box name="b" size="1 1 nan mm" material="wood"/></world>', "bad-value", 22, "'nan' is not a number"),
    ('<world><box name="b" size="1_0 1 1 mm" material="wood"/></world>', "bad-value", 22, "'1_0' is not a number"),
    ('<world><box name="b" size="1 1 1 kg" material="wood"/></world>', "bad-value", 22, "'kg' is not a unit of m"),
    ('<world><box name="b" size="0 1 1 mm" material="wood"/></world>', "out-of-range", 22, "out of range"),
    ('<world><box name="b" size="1 1 1 mm"/></world>', "missing-attribute", 8, "'material'"),
    ('<world><box name="b" size="1 1 1 mm" materiel="wood"/></world>', "unknown-attribute", 38, "did you mean 'material'"),
    ('<world><bux name="b"/></world>', "unknown-element", 8, "did you mean 'box'"),
    ('<world><box name="2b" size="1 1 1 mm" material="wood"/></world>', "bad-value", 13, "is not a name"),
    ('<world><box name="größe" size="1 1 1 mm" material="wood"/></world>', "bad-value", 13, "from a to z and A to Z"),
    ('<world><box name="arm" size="1 1 1 mm" material="wood"/></world>', "duplicate-name", 13, "arm"),
    ('<world><box name="b" size="1 1 1 mm" material="wood" temperature="22"/></world>', "out-of-range", 54, "22 degC"),
    ('<world><box name="b" size="1 1 1 mm" material="wood" rpy="0 0 1" quat="1 0 0 0"/></world>', "exclusive", 66, "only one"),
    ('<world><box name="b" size="1 1 1 mm" material="wood" quat="0 0 0 0"/></world>', "bad-value", 54, "not a rotation"),
    ('<world><box name="b" size="1 1 1 mm" material="wood">hello</box></world>', "unexpected-text", 8, "hello"),
    ('<wrld/>', "unknown-element", 1, "did you mean 'world'"),
    ('<viewer/>', "unknown-element", 1, "viewer"),
    ('<recording to="x"/>', "unknown-element", 1, "record"),
    ('<rates servo="9 kHz"/>', "out-of-range", 8, "9 kHz is out of range"),
    ('<interaction><probe name="f" pose-from="arm" plate-angle="95 deg"/></interaction>', "out-of-range", 46,
     "which is 0 to 57.2958 deg"),
    ('<world/><world/>', "duplicate-element", 9, "only once"),
    ('<interaction><probe name="f" pose-from="arn"/></interaction>', "unknown-name", 30, "did you mean 'arm'"),
    ('<interaction><probe name="f" pose-from="arm" surface-to="arm"/></interaction>', "missing-channel", 46, "surface pose"),
    ('<interaction><probe name="f" pose-from="arm"/><probe name="g" pose-from="arm"/><operator probe="f"/><operator probe="g"/>'
     '</interaction>', "exclusive", 111, "would both move 'arm'"),
    ('<interaction><probe name="f" pose-from="arm"/><thermal:heat probe="f"/><thermal:heat probe="f"/></interaction>',
     "duplicate-name", 72, "modality 'heat' is defined twice"),
    ('<interaction><thermal:het probe="f"/></interaction>', "unknown-element", 14, "thermal:heat"),
    ('<interaction xmlns:q="urn:itouch:plugin:quux"><q:x/></interaction>', "unknown-plugin", 47, "quux"),
    ('<interaction><nope:x probe="f"/></interaction>', "unknown-prefix", 14, "urn:itouch:plugin:nope"),
    ('<safety force="9 N"/>', "loosened-limit", 9, "default of 3 N"),
    ('<safety temperature="10 40 degC"/>', "loosened-limit", 9, "15 to 40 degC"),
    ('<safety servo-overrun="ignore"/>', "bad-value", 9, "'stop'"),
    ('<rates servo="1 kHz" hot="10 Hz"/>', "unknown-name", 22, "hot"),
    ('<rates servo="10 Hz"/>', "out-of-range", 8, "100 to 4000"),
    ('<include fil="x.xml"/>', "unknown-attribute", 10, "did you mean 'file'"),
    ('<include file="absent.xml"/>', "no-such-file", 10, "absent.xml"),
    ('<include file="../absent.xml"/>', "outside-folder", 10, "outside the scene's folder"),
    ('<include file="/etc/passwd"/>', "outside-folder", 10, "outside the scene's folder"),
    ('<defaults><box colour="red"/></defaults>', "unknown-attribute", 16, "colour"),
    ('<interaction><operator probe="f"/></interaction>', "unknown-name", 24, "define a probe"),
    ('<world><box name="b" size="1 1 1 mm" material="wood"></world>', "not-well-formed", 56, "mismatched tag"),
]  # fmt: skip


@pytest.mark.parametrize(("body", "code", "column", "says"), ONE_LINE)
def test_a_wrong_line_gives_its_message_at_its_column(
    write: Write, body: str, code: str, column: int, says: str
) -> None:
    path = write("scene.xml", HEAD + body + TAIL)
    found = [problem for problem in problems_of(path) if problem.severity == "error"]
    assert [problem.code for problem in found] == [code]
    (problem,) = found
    assert problem.place is not None
    assert (problem.place.line, problem.place.column) == (4, column)
    assert says in problem.render()
    assert problem.render().startswith(f"error[{code}]: ")


#: (a devices section, code, what the place points at, a part of the message)
DEVICES = [
    ('<device name="a" plugin="usb-amr"/>', "unknown-plugin", 'plugin="usb-amr"', "did you mean 'usb-arm'"),
    ('<device name="a" plugin="usb-arm"><limits force="5 N"/></device>', "loosened-limit", "force", "default of 3 N"),
    ('<device name="a" plugin="usb-arm"><limits current="1 A"/></device>', "limit-without-channel", "current", "no current"),
    ('<device name="a" plugin="usb-arm"><limits froce="1 N"/></device>', "unknown-attribute", "froce", "did you mean 'force'"),
    ('<device name="a" plugin="usb-arm"><limits force="-1 N"/></device>', "out-of-range", "force", "more than 0"),
    ('<device name="a" plugin="usb-arm" twin="perhaps"/>', "bad-value", "twin", "yes or no"),
    ('<device name="a" plugin="usb-arm"><mount on="a"/></device>', "mount-cycle", 'on="a"', "mounted on itself"),
    ('<device name="a" plugin="usb-arm"><mount pos="0 0 0" pos="1 1 1"/></device>', "not-well-formed", "pos=\"1", "duplicate"),
]  # fmt: skip


@pytest.mark.parametrize(("body", "code", "marker", "says"), DEVICES)
def test_a_wrong_device_gives_its_message_at_its_column(
    write: Write, body: str, code: str, marker: str, says: str
) -> None:
    line = f"<devices>{body}</devices>"
    path = write("scene.xml", f'<itouch version="1.0">\n{line}\n</itouch>')
    found = [problem for problem in problems_of(path) if problem.severity == "error"]
    assert [problem.code for problem in found] == [code]
    assert found[0].place is not None
    assert (found[0].place.line, found[0].place.column) == (2, line.index(marker) + 1)
    assert says in found[0].render()


def test_all_problems_at_once_in_file_order_and_one_per_cause(write: Write) -> None:
    path = write(
        "broken.xml",
        """<itouch version="1.0">
  <materials>
    <material name="aluminium"><contact stifness="2.0 N/mm"/></material>
    <material name="wood"><contact stiffness="1.2 N/mm" damping="3 kg"/></material>
  </materials>
  <world>
    <box name="bar"
         size="60 60 20 mm"
         material="aluminum"/>
    <box name="bar" size="60 60 20 mm" material="wood" temperature="22"/>
  </world>
</itouch>
""",
    )
    found = problems_of(path)
    assert [(p.code, p.place.line, p.place.column) for p in found if p.place] == [
        ("unknown-attribute", 3, 41),
        ("bad-value", 4, 57),
        ("unknown-name", 9, 10),
        ("duplicate-name", 10, 10),
        ("out-of-range", 10, 56),
    ]
    assert "did you mean 'stiffness'?" in found[0].render()
    assert "did you mean 'aluminium'?" in found[2].render()
    assert "first defined here" in found[3].render()


@pytest.mark.parametrize(
    ("installed", "says"),
    [
        (["odd-y"], "did you mean 'odd-y'? If not, install the distribution"),
        (["quux"], "installed plugins are: 'quux'; else install the distribution"),
        ([], "install the distribution"),
    ],
)
def test_the_advice_on_an_absent_plugin_is_made_of_whole_sentences(
    write: Write, monkeypatch: pytest.MonkeyPatch, installed: list[str], says: str
) -> None:
    monkeypatch.setattr(Catalog, "plugin_names", installed)
    (problem,) = [one for one in problems_of(write("scene.xml", ABSENT)) if one.code == "unknown-plugin"]
    assert problem.advice == f"{says} that offers it, for example `pip install itouch-odd-x`"


def test_a_wrong_root_or_version_is_refused(write: Write) -> None:
    for text, code in (
        ("<itouch/>", "missing-attribute"),
        ('<itouch version="1.7"/>', "newer-version"),
        ('<itouch version="one"/>', "bad-version"),
        ('<scene version="1.0"/>', "wrong-root"),
    ):
        (problem,) = problems_of(write("v.xml", text))
        assert problem.code == code


def test_a_file_of_another_kind_is_told_how_it_is_run(write: Write) -> None:
    for kind in ("study", "sweep"):
        path = write(f"{kind}.xml", f'<{kind} version="1.0"/>')
        (problem,) = problems_of(path)
        assert problem.render().strip().endswith(f"; `itouch-py {kind} run {path}` runs this one")
    (problem,) = problems_of(write("other.xml", '<study xmlns="urn:somebody"/>'))
    assert problem.render().strip().endswith('help: a scene begins with <itouch version="1.0">')
    scene = write("scene.xml", '<itouch version="1.0"/>')
    with pytest.raises(SourceError) as refused:
        read_root(str(scene), "study", "<study>")
    assert refused.value.problem.advice == f"a study begins with <study>; `itouch-py {scene}` runs this one"


def test_hostile_files(write: Write, tmp_path: Path) -> None:
    bomb = '<!DOCTYPE x [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><itouch version="1.0">&b;</itouch>'
    external = '<!DOCTYPE x SYSTEM "file:///etc/passwd"><itouch version="1.0"/>'
    deep = '<itouch version="1.0">' + "<a>" * 100_000 + "</a>" * 100_000 + "</itouch>"
    wide = '<itouch version="1.0" ' + " ".join(f'a{i}="1"' for i in range(5000)) + "/>"
    many = '<itouch version="1.0">' + "<world/>" * 150_000 + "</itouch>"
    for text, code in (
        (bomb, "doctype"),
        (external, "doctype"),
        (deep, "too-deep"),
        (wide, "too-many-attributes"),
        (many, "too-many-elements"),
        ("", "not-well-formed"),
        ("<itouch", "not-well-formed"),
        ("\0", "not-well-formed"),
    ):
        (problem,) = problems_of(write("h.xml", text))
        assert problem.code == code
    huge = tmp_path / "huge.xml"
    huge.write_bytes(b"<itouch>" + b" " * (9 << 20))
    assert [p.code for p in problems_of(huge)] == ["too-large"]
    latin = tmp_path / "latin.xml"
    latin.write_bytes('<itouch version="1.0"><!-- é --></itouch>'.encode("latin-1"))
    assert [p.code for p in problems_of(latin)] == ["not-utf-8"]
    assert [p.code for p in problems_of(tmp_path / "absent.xml")] == ["no-such-file"]
    assert [p.code for p in problems_of(tmp_path)] == ["no-such-file"]


def test_for_a_file_that_is_not_there_one_like_it_is_proposed(
    write: Write, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    meant = "did you mean 'aluminium.xml', in the same folder?"
    write("aluminium.xml", HEAD + TAIL)
    (problem,) = problems_of(tmp_path / "aluminum.xml")
    assert problem.advice == meant
    (problem,) = problems_of(write("a.xml", '<itouch version="1.0">\n<include file="aluminum.xml"/></itouch>'))
    assert (problem.advice, problem.place.line if problem.place else 0) == (meant, 2)
    (tmp_path / "aluminium.stl").touch()  # of another kind
    (problem,) = problems_of(tmp_path / "aluminium")
    assert problem.advice in (meant, meant.replace("xml", "stl"))
    (problem,) = problems_of(tmp_path / "aluminum.xml")
    assert problem.advice == meant
    for name in ("ice.xml", "b.xml", "absent.xml"):  # they are like none, but for their endings
        (problem,) = problems_of(tmp_path / name)
        assert "mean" not in problem.advice, name
    for command in ("replay", "run", "inspect"):  # of sessions and recordings, too
        assert cli([command, str(tmp_path / "aluminum.xml")]) == 2, command
        assert meant in capsys.readouterr().err, command


def test_include_cycle_shows_the_chain(write: Write) -> None:
    write("b.xml", '<itouch version="1.0"><include file="a.xml"/></itouch>')
    path = write("a.xml", '<itouch version="1.0">\n <include file="b.xml"/>\n</itouch>')
    (problem,) = problems_of(path)
    assert problem.code == "include-cycle"
    assert "included from here" in problem.render()


def test_a_fault_inside_an_include_names_that_file(write: Write) -> None:
    write("m.xml", '<itouch version="1.0">\n<materials><material/></materials></itouch>')
    path = write("a.xml", '<itouch version="1.0"><include file="m.xml"/></itouch>')
    (problem,) = problems_of(path)
    assert problem.place is not None
    assert problem.place.file.endswith("m.xml")
    assert (problem.place.line, problem.place.column) == (2, 12)


def test_two_writers_of_one_command(write: Write) -> None:
    body = (
        '<interaction><probe name="f" pose-from="arm" force-to="arm"/>\n'
        '<probe name="g" pose-from="arm" force-to="arm"/></interaction>'
    )
    (problem,) = problems_of(write("scene.xml", HEAD + body + TAIL))
    assert problem.code == "two-writers"
    assert (problem.place.line, problem.place.column) == (5, 33)  # type: ignore[union-attr]


def test_a_rate_that_does_not_divide_gives_the_nearest(scenes: Path) -> None:
    path = scenes / "four_materials.xml"
    path.write_text(path.read_text().replace('servo="1 kHz"', 'servo="1 kHz" heat="60 Hz"'))
    (problem,) = problems_of(path)
    assert problem.code == "rate"
    assert problem.advice == "the nearest that does is 58.8235294 Hz"


@pytest.mark.parametrize("rate", ["333.333 Hz", "333.333333 Hz", "58.8235294 Hz"])
def test_a_rate_as_the_message_gives_it_is_taken(scenes: Path, rate: str) -> None:
    """People write six or nine digits of a rate that has no end."""
    path = scenes / "four_materials.xml"
    path.write_text(path.read_text().replace('servo="1 kHz"', f'servo="1 kHz" heat="{rate}"'))
    assert problems_of(path) == []


def test_each_rate_and_pattern_of_a_record_is_told_at_its_attribute(
    write: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    body = (
        '<devices><device name="arm" plugin="usb-arm"/></devices>\n'
        '<record to="a.mcap" channels="arm.* amr.*"\n  rate="7 Hz"><channels of="amr.pose"\n rate="142.857 Hz"/></record>'
    )
    path = write("scene.xml", f'<itouch version="1.0">\n{body}\n</itouch>\n')
    assert cli(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert (
        f"<record>: the rate 7 Hz does not divide the servo rate; the nearest that does is 6.99300699 Hz\n  --> {path}:4:3"
        in said
    )
    assert f"<record>: no channel is named 'amr.*'\n  --> {path}:3:21" in said
    assert f"<channels>: no channel is named 'amr.pose'\n  --> {path}:4:25" in said
    path.write_text(path.read_text().replace("amr", "arm").replace('"7 Hz"', '"6.99301 Hz"'))
    assert cli(["check", str(path)]) == 0


def test_a_magnet_that_reaches_too_far_is_told_with_both_names(write: Write) -> None:
    body = (
        '<materials><material name="iron"><contact stiffness="1 N/mm"/><magnetic force="1 N" range="100 mm"/></material>'
        '</materials><world><box name="b" size="1 1 1 cm" material="iron"/></world>'
        '<devices><device name="arm" plugin="usb-arm"/></devices>'
        '<interaction><probe name="f" pose-from="arm" force-to="arm"/></interaction>'
    )
    (problem,) = problems_of(write("scene.xml", f'<itouch version="1.0">{body}</itouch>'))
    assert (
        "the magnet of material 'iron' reaches 100 mm far, and probe 'f' looks for objects only up to"
        in problem.sentence
    )
    assert problem.advice.startswith('write near="100 mm" in <probe name="f">')


def test_a_device_without_a_driver_is_twin_only(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    from itouch_usb_arm import UsbArm

    monkeypatch.setattr(UsbArm, "twin_only", True)
    path = write(
        "scene.xml", '<itouch version="1.0"><devices><device name="a" plugin="usb-arm" twin="no"/></devices></itouch>'
    )
    (problem,) = [problem for problem in problems_of(path) if problem.severity == "error"]
    assert problem.code == "twin-only"
    assert "twin only" in str(problem.sentence)


@pytest.mark.parametrize(
    ("text", "means"), [("true", True), ("yes", True), ("1", True), ("false", False), ("no", False), ("0", False)]
)
def test_a_flag_is_a_word_or_a_digit(text: str, means: bool) -> None:
    assert parse_value(Spec("flag", ""), text) is means


@pytest.mark.parametrize(
    ("names", "text"),
    [
        (("a",), "'a'"),
        (("a", "b"), "'a' and 'b'"),
        (("a", "b", "c"), "'a', 'b' and 'c'"),
        (tuple("abcd"), "'a', 'b', 'c' and 'd'"),
    ],
)
def test_names_are_listed_each_once_and_in_order(names: tuple[str, ...], text: str) -> None:
    assert binding._listed(names) == text


@pytest.mark.parametrize(
    ("rate", "says"), [("4 kHz", ""), ("0.001 Hz", ""), ("4.001 kHz", "out of range"), ("0.0009 Hz", "out of range")]
)
def test_a_modality_may_be_as_fast_as_the_fastest_loop(rate: str, says: str) -> None:
    """Whatever its name is: the rates of modalities are not listed."""
    if says:
        with pytest.raises(ValueProblemError, match=says):
            parse_value(Rates.OPEN_SPEC, rate)
    else:
        assert parse_value(Rates.OPEN_SPEC, rate) == pytest.approx(4000.0 if "k" in rate else 1e-3)


@pytest.mark.parametrize(("room", "thing"), [("-20", "-100"), ("50", "400")])
def test_the_ends_of_a_range_of_temperatures_are_allowed_as_the_message_names_them(
    tmp_path: Path, room: str, thing: str
) -> None:
    path = tmp_path / "cold.xml"

    def write(warmth: str, own: str) -> Path:
        path.write_text(
            f'<itouch version="1.0"><materials><material name="m"><contact stiffness="1 N/mm"/></material></materials>'
            f'<world temperature="{warmth} degC"><box name="b" size="1 1 1 cm" material="m" temperature="{own} degC"/>'
            "</world></itouch>",
            encoding="utf-8",
        )
        return path

    world = itouch.load(write(room, thing)).world
    assert world.temperature == pytest.approx(float(room) + 273.15, abs=1e-9)
    beyond = 1e-6 if float(thing) > 0 else -1e-6
    with pytest.raises(itouch.SceneError, match="out of range"):
        itouch.load(write(room, f"{float(thing) + beyond:.6f}"))


def test_the_device_that_brings_the_surface_does_not_say_where_the_finger_is(write: Write) -> None:
    probe = '<interaction><probe name="f" pose-from="table" surface-to="table"/></interaction>'
    devices = '<device name="arm" plugin="usb-arm"/>'
    head = HEAD.replace(devices, f'{devices}<device name="table" plugin="xyz-table"/>')
    (found,) = (
        problem for problem in problems_of(write("scene.xml", head + probe + TAIL)) if problem.severity == "error"
    )
    assert (found.code, found.place.column if found.place else None) == ("exclusive", 48)
    assert "the finger would be wherever the surface is" in found.sentence


def test_what_is_wrong_after_an_unknown_default_is_told_too(write: Write) -> None:
    path = write("scene.xml", HEAD + '<defaults><bax size="1 1 1 mm"/><box colour="red"/></defaults>' + TAIL)
    found = [(problem.code, problem.place.column) for problem in problems_of(path) if problem.place is not None]
    assert found == [("unknown-element", 11), ("unknown-attribute", 38)]


def test_a_misspelt_rate_of_the_loop_is_advised_though_modalities_have_rates_there_too(write: Write) -> None:
    path = write("scene.xml", HEAD + '<rates servoo="1 kHz"/>' + TAIL)
    (problem,) = problems_of(path)
    assert (problem.code, problem.advice) == ("unknown-name", "did you mean 'servo'?")
