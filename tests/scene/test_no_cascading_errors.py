"""A single misspelling in a good scene is a single problem: what it brings with it is not told as well."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from shipped import SCENES

from itouch.schema import Problem
from itouch_tools.cli.check import examined

#: What stands in the scene besides, each wrong by itself: a vibration that is too fast, and two channels that are not
#: there.
LATE = {
    "</world>": '<box name="shaker" size="10 10 10 mm" pos="0 0 30 mm" material="shaking"/></world>',
    "<world": '<materials><material name="shaking"><contact stiffness="0.3 N/mm"/>\n'
    '<vibration amplitude="0.1 N" frequency="400 Hz"/></material></materials>\n<world',
    "</itouch>": '<record to="run.mcap" channels="fingr.* objects.no"/></itouch>',
}
SAID = {"400 Hz is above a quarter", "no channel is named 'fingr.*'", "no channel is named 'objects.no'"}


@dataclass(frozen=True)
class Misspelling:
    """A scene with a mistake: what it is in, and its line."""

    what: str
    text: str
    line: int


def misspellings(text: str) -> Iterator[Misspelling]:
    """Yield a scene with the name of each attribute, the unit of each value and the tag of each element misspelt."""

    def with_(what: str, begin: int, end: int, word: str) -> Misspelling:
        return Misspelling(what, text[:begin] + word + text[end:], text.count("\n", 0, begin) + 1)

    shown = re.sub(r"<!--.*?-->", lambda comment: re.sub(r"[^\n]", " ", comment.group()), text, flags=re.DOTALL)
    for tag in re.finditer(r'<([a-z:-]+)((?:\s+[\w:-]+\s*=\s*"[^"]*")*)\s*(/?)>', shown):
        if tag[1] in ("itouch", "include"):
            continue
        if tag[3]:
            yield with_(f"<{tag[1]}>", tag.start(1), tag.end(1), f"{tag[1][:-1]}q")
        for one in re.finditer(r'([\w:-]+)\s*=\s*"([^"]*)"', tag[2]):
            begin = tag.start(2) + one.start()
            if one[1].startswith("xmlns"):
                continue
            yield with_(f"<{tag[1]} {one[1]}>", begin, begin + len(one[1]), f"{one[1][:-1]}q")
            if re.search(r"\d [a-zA-Z]", one[2]):
                end = tag.start(2) + one.end(2)
                yield with_(f"<{tag[1]} {one[1]}> unit", end, end, "q")


def told(path: Path, mistake: Misspelling) -> list[Problem]:
    path.write_text(mistake.text)
    return [problem for problem in examined(str(path), None, None)[1] if problem.severity == "error"]


def strange(path: Path, mistake: Misspelling) -> str:
    """Return what is told of a mistake in other lines than its own, or that nothing is told; empty: all is right."""
    found = told(path, mistake)
    others = [one.sentence for one in found if one.place is None or one.place.line != mistake.line]
    return f"{mistake.what} in line {mistake.line}: {others or 'nothing'} told" if others or not found else ""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copytree(SCENES, tmp_path / "scenes")
    return tmp_path / "scenes"


def test_one_misspelling_is_one_problem(folder: Path) -> None:
    text = (folder / "four_materials.xml").read_text()
    every = list(misspellings(text))
    tried = [one for one in every if " name>" in one.what] + every[::8]
    assert len(tried) > 15
    assert [said for one in tried if (said := strange(folder / "wrong.xml", one))] == []


@pytest.mark.parametrize("name", ["four_materials.xml", "two_fingers.xml", "metamer.xml", "moving.xml", "texture.xml"])
def test_each_misspelling_is_one_problem(folder: Path, name: str) -> None:
    tried = list(misspellings((folder / name).read_text()))
    assert len(tried) > 15
    assert [said for one in tried if (said := strange(folder / "wrong.xml", one))] == []


def test_no_misspelling_hides_what_is_found_last(folder: Path) -> None:
    """Neither what is wrong with an effect of a material, nor a channel to record that is not there."""
    text = (folder / "four_materials.xml").read_text()
    own = list(misspellings(text))
    for word, more in LATE.items():
        text = text.replace(word, more, 1)
    tried = [one for one in misspellings(text) if "shak" not in one.text.splitlines()[one.line - 1]]
    tried = [one for one in tried if one.what in {other.what for other in own} and "<rates" not in one.what][::7]
    assert len(tried) > 12
    for one in tried:
        said = "\n".join(problem.sentence for problem in told(folder / "wrong.xml", one))
        assert [words for words in SAID if words not in said] == [], one.what
