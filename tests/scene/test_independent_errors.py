"""Two mistakes that have nothing to do with each other are both told in one run, and nothing else is.

The mistakes are the examples of the codes (`itouch-py explain`): one is the scene, the other a file that it includes.
"""

from __future__ import annotations

import re
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from itouch.schema import Problem
from itouch_tools.authoring.codes import HEADINGS, RUNNING
from itouch_tools.cli.check import examined
from itouch_tools.cli.explain import examples
from itouch_tools.cli.explain.example import Example, _inside

EXAMPLES = examples()
FILES = [code.name for codes in HEADINGS.values() if codes is not RUNNING for code in codes]
#: Where these are, the file is not read further; included by another one, they hide nothing of that.
ENDS = {
    "not-well-formed", "doctype", "too-large", "not-utf-8", "too-deep", "too-many-attributes", "too-many-elements",
    "wrong-root", "bad-version", "newer-version", "not-a-scene", "unknown-prefix",
}  # fmt: skip
#: Where a file could not be read, a name that the others lack may be defined in it.
UNREAD = ENDS | {"no-such-file", "outside-folder", "too-many-includes"}
#: These are about the folder of the scene, or the file beside it: they are no mistakes of an included file.
OF_THE_SCENE = {"outside-folder", "calibration-stale"}
#: These need words of the command that hold for all devices: they change what is wrong with the others.
OF_THE_COMMAND = {"rig", "fault-on-hardware"}
#: Mistakes with each of which all others are tried in the short form: one that is found while the scene is read, and
#: one that is found while it is compiled.
ORDINARY = ("unknown-attribute", "missing-channel")


@dataclass(frozen=True)
class Pair:
    """One example in the scene, another one in a file that it includes."""

    scene: str
    included: str

    def made(self) -> Example | None:
        """Return both as one example; None: both bring a plugin of the same name."""
        first, second = EXAMPLES[self.scene], EXAMPLES[self.included]
        files: dict[str, str | bytes] = dict(first.files)
        for name, content in second.files.items():
            place = name if second.plugin and not name.endswith(".xml") else f"b/{name}"
            if files.setdefault(place, content) != content:
                return None
        text = first.files["scene.xml"]
        assert isinstance(text, str)
        text = re.sub(r"(<itouch[^>]*?)/>", r"\1></itouch>", text, count=1)
        files["scene.xml"] = re.sub(r"(<itouch[^>]*>)", r'\1<include file="b/scene.xml" prefix="b-"/>', text, count=1)
        return Example(files, absent=first.absent or second.absent, plugin=first.plugin or second.plugin)


def told(example: Example) -> list[Problem]:
    """Return the errors that a check finds."""
    with tempfile.TemporaryDirectory() as folder, _inside(Path(folder), example):
        return [problem for problem in examined("scene.xml", None, None)[1] if problem.severity == "error"]


@cache
def codes_of(code: str) -> frozenset[str]:
    """Return the codes of the errors in an example; empty: it has only warnings."""
    return frozenset(problem.code for problem in told(EXAMPLES[code]))


def wrong_with(pair: Pair) -> str:
    """Return what is not as it must be of what is told about a pair; empty: nothing."""
    made, wanted = pair.made(), set(codes_of(pair.scene) | codes_of(pair.included))
    if made is None:
        return ""
    if UNREAD & wanted:
        wanted.discard("unknown-name")
    if made.absent:
        wanted.discard("dynamics")  # needs the package that is absent
    found = told(made)
    missing = wanted - {problem.code for problem in found}
    more = [
        problem.sentence for problem in found if problem.code not in wanted | {"unknown-name"} & codes_of(pair.scene)
    ]
    return f"{pair}: not told {sorted(missing)}, told besides {more}" if missing or more else ""


def pairs(scenes: tuple[str, ...], included: tuple[str, ...]) -> list[Pair]:
    """Return all pairs of these that can be."""
    return [
        Pair(one, other)
        for one in scenes if one not in ENDS | OF_THE_COMMAND and codes_of(one)
        for other in included
        if other not in OF_THE_SCENE | OF_THE_COMMAND and (other in ENDS or codes_of(other))
    ]  # fmt: skip


@pytest.mark.parametrize("ordinary", ORDINARY)
def test_an_ordinary_mistake_hides_no_other(ordinary: str) -> None:
    tried = pairs(tuple(FILES), (ordinary,))
    assert len(tried) > 40
    assert [said for pair in tried if (said := wrong_with(pair))] == []


@pytest.mark.parametrize("code", FILES)
def test_no_mistake_hides_another(code: str) -> None:
    later = tuple(other for other in FILES[FILES.index(code) + 1 :] if other not in ENDS)
    earlier = tuple(other for other in FILES[: FILES.index(code)] if other in ENDS)
    assert [said for pair in pairs((code,), earlier + later) if (said := wrong_with(pair))] == []
