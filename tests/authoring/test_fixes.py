"""Mending a scene's text: what is misspelt and can have meant one thing only; nothing that bears on safety."""

from __future__ import annotations

import os
import re
import shutil
from difflib import SequenceMatcher
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from shipped import SCENES

from itouch.plugin.discovery import Catalog
from itouch.scene.loader import read_scene
from itouch.schema import Place, Problem
from itouch.schema.diagnostics import meant
from itouch_tools.authoring.fixes import edits, mended
from itouch_tools.cli import main
from itouch_tools.cli.fixing import fixed
from itouch_tools.cli.fixing import show_and_write as put

CATALOG = Catalog()
SCENE = (SCENES / "four_materials.xml").read_text(encoding="utf-8")
#: Every name of an element or an attribute, and every value that is one word: where it stands.
WORDS = [
    (found.start(1), found.group(1))
    for found in re.finditer(r"""(?:</?|(?<=\s))([a-z][a-z-]{3,})(?=[\s=/>])|="([a-z_]{4,})\"""", SCENE)
    if found.group(1)
]


def examine(path: str) -> list[Problem]:
    return read_scene(path, CATALOG)[1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mending") / "scenes"
    shutil.copytree(SCENES, folder)
    return folder


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_misspelt_word_is_mended_to_what_it_was_or_left_as_it_is(folder: Path, data: st.DataObject) -> None:
    at, word = data.draw(st.sampled_from(WORDS))
    place = data.draw(st.integers(1, len(word) - 1))
    other = data.draw(st.sampled_from("aeiouxz"))
    wrong = data.draw(st.sampled_from([word[:place] + word[place + 1 :], word[:place] + other + word[place:]]))
    text = SCENE[:at] + wrong + SCENE[at + len(word) :]
    path = folder / "misspelt.xml"
    path.write_text(text, encoding="utf-8")
    found = fixed(str(path), examine)
    if found is not None:
        errors = sum(problem.severity == "error" for problem in examine(str(path)))
        put(str(path), found, write=True)
        assert sum(problem.severity == "error" for problem in examine(str(path))) < errors
        assert fixed(str(path), examine) is None
        safety = [re.findall(r"<safety.*?>", one, re.DOTALL) for one in (text, path.read_text(encoding="utf-8"))]
        assert safety[0] == safety[1]
    assert {one.name for one in folder.iterdir()} == {one.name for one in SCENES.iterdir()} | {"misspelt.xml"}


MISSPELT = """<itouch version="1.0">
  <!-- <wrld> is no element here -->
  <materials><material nme="oak"><contact stiffness="1 N/mm"/></material></materials>
  <wrld>
    <bx name="block" material="Oak" size="60 60 20 mm" pos="0 0 0 mm"/>
    <bx	name='plate' material = "oak" size="60 60 20 mm" pos="0 0 90 mm"></bx>
  </wrld>
  <safety frce="2 N"/>
</itouch>
"""


def test_all_that_is_plain_is_mended_also_inside_what_was_misspelt(tmp_path: Path, capsys) -> None:
    path = tmp_path / "Stück.xml"
    path.write_text(MISSPELT, encoding="utf-8")
    found = fixed(str(path), examine)
    assert found is not None
    put(str(path), found, write=False)
    assert path.read_text(encoding="utf-8") == MISSPELT
    put(str(path), found, write=True)
    said = capsys.readouterr()
    assert '-    <bx name="block" material="Oak"' in said.out and '+    <box name="block" material="oak"' in said.out
    expected = MISSPELT.replace("<wrld>\n", "<world>\n").replace("</wrld>", "</world>").replace("nme=", "name=")
    expected = expected.replace("<bx", "<box").replace("</bx>", "</box>").replace("Oak", "oak")
    assert path.read_text(encoding="utf-8") == expected
    assert [problem.code for problem in examine(str(path)) if problem.severity == "error"] == ["unknown-attribute"]


@pytest.mark.parametrize(
    "line",
    [
        '<safety frce="2 N"/>', '<safty force="2 N"/>', '<safety force="2 N" flxu="3 kW/m2"/>',
        '<devices><device name="arm" plugin="virtual-arm"><limits forc="1 N"/></device></devices>',
        '<devices><device name="arm" plugin="virtual-arm"><limts force="1 N"/></device></devices>',
        '<devices><device name="arm" plugin="usb-arm" optinal="yes"/></devices>',
        '<devices><device name="arm1" plugin="usb-arm"/></devices>'
        '<interaction><probe name="finger" radius="8 mm" pose-from="arm"/></interaction>',
    ],
)  # fmt: skip
def test_what_bears_on_safety_is_never_touched(line: str, tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    path.write_text(f'<itouch version="1.0">{line}</itouch>', encoding="utf-8")
    assert fixed(str(path), examine) is None


def test_places_count_letters_and_bytes_are_replaced() -> None:
    text = '<itouch version="1.0"><world>\n  <!-- ä 漢 --> <sphre name="ß"/></world></itouch>'
    from itouch.schema import Place

    problem = Problem("unknown-element", "", Place("s", 2, 16), mend=("sphre", "sphere"))
    data, done = mended(text.encode(), "s", [problem])
    assert data.decode() == text.replace("sphre", "sphere") and done == [problem]
    assert mended(text.encode(), "another", [problem]) == (text.encode(), [])


def test_what_may_have_meant_two_things_is_no_mending() -> None:
    assert meant("bix", ["box", "bit"]) is None
    assert meant("stifness", ["stiffness", "damping"]) == ("stifness", "stiffness")
    assert meant("Wood", ["wood", "word"]) == ("Wood", "wood")
    assert meant("zzz", ["wood"]) is None
    assert meant("block2", ["block1", "plate"]) is None and meant("block-2", ["block", "plate"]) is None


def test_the_command_shows_writes_and_says_what_is_left(tmp_path: Path, capsys) -> None:
    path = tmp_path / "s.xml"
    path.write_text(MISSPELT, encoding="utf-8")
    assert main(["check", str(path), "--diff"]) == 2
    assert path.read_text(encoding="utf-8") == MISSPELT and "nothing was written" in capsys.readouterr().err
    assert main(["check", str(path), "--fix"]) == 2
    said = capsys.readouterr()
    assert "+  <world>" in said.out and "fixed" in said.err and "<safety> has no attribute 'frce'" in said.err
    path.write_text(path.read_text(encoding="utf-8").replace("frce", "force"), encoding="utf-8")
    os.chmod(path, 0o640)
    assert main(["check", str(path), "--fix"]) == 0
    assert "fixed" not in capsys.readouterr().err and path.stat().st_mode & 0o777 == 0o640
    assert main(["check", str(path), "--fix", "--diff"]) == 2


@pytest.mark.parametrize(
    "text",
    [MISSPELT, MISSPELT.replace("<materials>", "<!-- Stück --><materials>")],
    ids=["ascii", "letters of two bytes"],
)
def test_what_is_told_to_be_replaced_is_what_is_replaced(tmp_path: Path, text: str) -> None:
    """By line and column, as an editor does it, and by bytes: the same, problem by problem."""
    path = tmp_path / "s.xml"
    path.write_text(text, encoding="utf-8")
    replaced = 0
    for problem in examine(str(path)):
        lines = text.split("\n")
        for edit in edits(text.encode(), str(path), problem)[::-1]:
            line = lines[edit.line - 1]
            lines[edit.line - 1] = line[: edit.column - 1] + edit.text + line[edit.column - 1 + edit.length :]
            replaced += 1
        assert "\n".join(lines).encode() == mended(text.encode(), str(path), [problem])[0]
    assert replaced == 7


@given(st.lists(st.text("abcde", min_size=3, max_size=8), max_size=4), st.text("abcde", min_size=3, max_size=8))
@example(["friction", "traction"], "frction")
def test_what_can_have_been_meant_is_the_name_that_is_most_alike(names: list[str], word: str) -> None:
    found = meant(word, names)
    if found is not None and found[1].lower() != word:
        alike = {name: SequenceMatcher(None, name, word).ratio() for name in names}
        assert alike[found[1]] == max(alike.values())


def test_a_warning_is_mended_though_there_are_as_many_errors_then(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text('<itouch version="1.0">\n<box colour="rde"/>\n</itouch>', encoding="utf-8")

    def examined(name: str) -> list[Problem]:
        wrong = "rde" in Path(name).read_text(encoding="utf-8")
        odd = Problem("unknown-name", "no colour 'rde'", Place(name, 2, 6, 6), severity="warning", mend=("rde", "red"))
        return [Problem("missing-attribute", "no size", Place(name, 2, 1)), *([odd] if wrong else [])]

    found = fixed(str(path), examined)
    assert found is not None
    assert found.after == '<itouch version="1.0">\n<box colour="red"/>\n</itouch>'
    assert [problem.code for problem in found.problems] == ["unknown-name"]


@pytest.mark.parametrize(
    ("attribute", "mends"), [("colour", True), ("limit", False), ("soft-limits", False), ("LIMIT-by", False)]
)
def test_the_value_of_what_limits_is_not_mended_though_only_one_word_can_be_meant(attribute: str, mends: bool) -> None:
    text = f'<itouch version="1.0">\n  <box {attribute}="slwo"/>\n</itouch>'.encode()
    problem = Problem("unknown-name", "no 'slwo'", Place("s.xml", 2, 8, len(attribute)), mend=("slwo", "slow"))
    data, done = mended(text, "s.xml", [problem])
    assert (data, done) == ((text.replace(b"slwo", b"slow"), [problem]) if mends else (text, []))
