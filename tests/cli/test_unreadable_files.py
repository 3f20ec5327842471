"""Of a file that is damaged or cannot be read, the message says so, where it is named, and what to do about it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from program import program
from shipped import SCENES

import itouch


@pytest.fixture(scope="module")
def damaged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording whose first chunk of samples is damaged, and one that was cut after some."""
    folder = tmp_path_factory.mktemp("damaged")
    with itouch.build(SCENES / "first_touch.xml") as session:
        session.record(folder / "whole.mcap")
        session.run(1.0)
    data = bytearray((folder / "whole.mcap").read_bytes())
    (folder / "cut.mcap").write_bytes(data[: 2 * len(data) // 3])
    at = _second_chunk(bytes(data))
    data[at + 200] ^= 0xFF
    (folder / "flip.mcap").write_bytes(data)
    found = itouch.read(folder / "flip.mcap")
    assert found.states and not len(found.ticks)
    return folder


def _second_chunk(data: bytes) -> int:
    """Return where the first chunk with samples begins: the one before it holds the State at the start."""
    at, chunks = 8, []
    while at + 9 <= len(data):
        if data[at] == 6:
            chunks.append(at)
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return chunks[1] if len(chunks) > 1 else chunks[0]


@pytest.mark.parametrize("pace", ["fast", "real"])
def test_going_on_from_a_damaged_recording_says_that_and_from_when(damaged: Path, pace: str) -> None:
    words = ["flip.mcap", "--headless", "--pace", pace, "--for", "10ms"]
    done = program(*words, cwd=damaged)
    assert done.returncode == 0, done.stderr
    assert "'flip.mcap' is damaged or was cut: " in done.stderr
    assert "the last whole State before that, which is of 0 s" in done.stderr


def test_a_whole_recording_is_not_called_damaged(damaged: Path) -> None:
    assert not [notice for notice in itouch.restore(damaged / "whole.mcap").notices if "damaged" in notice]


def test_a_replay_of_nothing_says_why(damaged: Path) -> None:
    done = program("replay", "flip.mcap", cwd=damaged)
    assert done.returncode == 1
    assert "nothing was compared: 'flip.mcap' is damaged or was cut" in done.stderr


@pytest.mark.parametrize(
    "scene",
    ['<operator probe="finger"><motion file="flip.mcap" recorded-probe="finger"/></operator>',
     '<operator probe="finger"><motion file="flip.mcap"/></operator>'],
)  # fmt: skip
def test_a_damaged_recording_in_a_scene_is_told_as_such(damaged: Path, scene: str) -> None:
    text = (SCENES / "first_touch.xml").read_text()
    begin, end = text.index("<operator"), text.index("</operator>") + len("</operator>")
    (damaged / "scene.xml").write_text(text[:begin] + scene + text[end:])
    done = program("check", "scene.xml", cwd=damaged)
    assert done.returncode == 2
    assert "'flip.mcap' is damaged or was cut, and no place of a probe 'finger' can be read of it" in done.stderr
    assert "`itouch-py recover flip.mcap`" in done.stderr and "did you mean" not in done.stderr


@pytest.mark.parametrize("track", ["", 'track="arm"'])
def test_a_damaged_recording_as_an_arm_is_told_as_such(damaged: Path, track: str) -> None:
    text = (SCENES / "first_touch.xml").read_text()
    begin, end = text.index("<operator"), text.index("</operator>") + len("</operator>")
    arm = (
        '<device name="arm" plugin="recorded">'
        f'<r:hardware xmlns:r="urn:itouch:plugin:recorded" file="flip.mcap" {track}/></device>'
    )
    text = (text[:begin] + text[end:]).replace('<device name="arm" plugin="usb-arm"/>', arm)
    (damaged / "arm.xml").write_text(text)
    done = program("check", "arm.xml", cwd=damaged)
    assert done.returncode == 2
    assert "is damaged or was cut, and no pose" in done.stderr and "recover flip.mcap" in done.stderr


def test_a_file_that_may_not_be_read_gets_advice_for_that(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(SCENES / "first_touch.xml", tmp_path / "a.xml")
    (tmp_path / "b.xml").write_text('<itouch version="1.0"><include file="a.xml"/></itouch>')

    def refused(path: object) -> object:
        if str(path).endswith("a.xml"):
            raise PermissionError(13, "Permission denied", str(path))
        return itouch.schema.regular_files.open_regular(path)  # type: ignore[arg-type]

    monkeypatch.setattr("itouch.scene.source.open_regular", refused)
    for name in ("a.xml", "b.xml"):
        said = program("check", name, cwd=tmp_path).stderr
        assert "Permission denied" in said and "change its permissions" in said, said
        assert "check the path" not in said and "paths are relative" not in said
    assert "help: check the path" in program("check", "none.xml", cwd=tmp_path).stderr


STUDY = """<study version="1.0" seed="5"
 scene="no.xml"><factor name="m" levels="wood cork" set="block.material"/><task kind="identify" factor="m"/>
 <contact object="block" duration="0.1 s"/></study>"""
SWEEP = """<sweep version="1.0" seed="5"
 scene="no.xml"><grid name="m" set="block.material" values="wood cork"/><collect><report name="s" key="simulated_s"/></collect></sweep>"""


@pytest.mark.parametrize(("command", "text"), [("study", STUDY), ("sweep", SWEEP)])
def test_a_missing_scene_is_told_where_it_is_named(command: str, text: str, tmp_path: Path) -> None:
    (tmp_path / "it.xml").write_text(text)
    said = program(command, "check", "it.xml", cwd=tmp_path).stderr
    assert "--> it.xml:2:2" in said and "no.xml:1:1" not in said, said
    assert "paths are relative to the file that names them" in said


def test_a_folder_is_told_with_what_to_name(tmp_path: Path) -> None:
    (tmp_path / "scenes").mkdir()
    shutil.copy(SCENES / "first_touch.xml", tmp_path / "scenes" / "a.xml")
    for words in (("scenes",), ("scenes/",), ("run", "scenes"), ("check", "scenes")):
        done = program(*words, cwd=tmp_path)
        assert done.returncode == 2
        assert "is a folder, not a scene file" in done.stderr and "such as scenes/a.xml" in done.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [("run a.xml --for -3s", "argument --for: '-3s' is negative; write for example 30s"),
     ("run a.xml --for -.5", "'-.5' is negative"),
     ("run a.xml --for 1e306s", "argument --for: '1e306s' is too long: at most 1e+09 s, which is 31 years"),
     ("run a.xml --save-every 1e306s", "'1e306s' is too long"),
     ("run a.xml --at 1e306s", "'1e306s' is too long"), ("a.xml --seed x", "argument --seed: 'x' is not a whole number"),
     ("study simulate s.xml -o d --observers many", "--observers: 'many' is not a whole number"),
     ("sync --limit 1ms", "argument --limit: '1ms' is not a number; write for example 2.5")],
)  # fmt: skip
def test_a_number_that_is_none_gets_a_sentence(words: str, said: str, tmp_path: Path) -> None:
    done = program(*words.split(), cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "") and said in done.stderr
