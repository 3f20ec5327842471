"""No output of a command is one of its inputs or another output, and none replaces a file of another kind."""

from __future__ import annotations

import argparse
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from program import program
from shipped import SCENES

import itouch
from itouch.plugin import commands
from itouch.schema import ItouchError
from itouch_tools.cli import COMMANDS, listed, main
from itouch_tools.cli.arguments import Parser
from itouch_tools.cli.completion import _parser_of
from itouch_tools.cli.output_files import Output, output_folder

SCENE = """<itouch version="1.0">
  <include file="world.xml"/>
  <devices><device name="arm" twin="yes"><recorded file="path.csv"/></device></devices>
  <interaction><probe name="finger" device="arm"/></interaction>
</itouch>
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene with what it includes and names, a session and a recording."""
    folder = tmp_path_factory.mktemp("files")
    shutil.copy(SCENES / "first_touch.xml", folder / "a.xml")
    (folder / "named.xml").write_text(SCENE)
    (folder / "world.xml").write_text('<itouch version="1.0"><world><box name="b" size="9 9 9 mm"/></world></itouch>')
    (folder / "path.csv").write_text("t,x,y,z\n0,0,0,0.1\n1,0,0,0.1\n")
    (folder / "a.calibration.json").write_text("[]")
    (folder / "mesh.xml").write_text(
        '<itouch version="1.0"><world><mesh name="m" file="m.gltf"/></world><devices/><interaction/></itouch>'
    )
    (folder / "m.gltf").write_text(
        json.dumps({"buffers": [{"uri": "a%2Db.bin"}], "images": [{"uri": "skin\u00e9.png"}, {"uri": "data:,x"}]})
    )
    (folder / "a-b.bin").write_bytes(b"0" * 9)
    (folder / "skin\u00e9.png").write_bytes(b"\x89PNG")
    (folder / "asks.xml").write_text(SCENE.replace("<devices>", '<record to="out.mcap" rate="1 kHz"/><devices>'))
    (folder / "asks-more.xml").write_text('<itouch version="1.0"><include file="asks.xml"/></itouch>')
    (folder / "case.csv").write_text("{}")
    (folder / "study.xml").write_text('<study version="1.0" scene="a.xml"/>')
    session = itouch.build(SCENES / "first_touch.xml")
    session.record(folder / "r.mcap")
    session.run(0.01)
    session.save(folder / "s.itouch")
    session.close()
    asks = (SCENES / "first_touch.xml").read_text().replace("<world", '<record to="out.mcap"/><world', 1)
    (folder / "asking.xml").write_text(asks)
    session = itouch.build(folder / "asking.xml")
    session.record(folder / "asks.mcap")
    session.run(0.01)
    session.save(folder / "asks.itouch")
    session.close()
    os.symlink("a.xml", folder / "link.json")
    os.symlink("r.mcap", folder / "r-link.mcap")
    os.link(folder / "a.xml", folder / "hard.json")
    return folder


def state(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


READ = [
    "run a.xml --headless --save a.xml", "run a.xml --headless --report a.xml", "run a.xml --headless --trace a.xml",
    "a.xml --headless --report ./a.xml", "a.xml --headless --report link.json", "a.xml --headless --trace hard.json",
    "named.xml --headless --report world.xml", "named.xml --headless --trace path.csv",
    "a.xml --headless --report a.calibration.json", "first.xml --rig a.xml --headless --report a.xml",
    "r.mcap --headless --for 0.5s --record r.mcap", "r.mcap --headless --save r.mcap",
    "r.mcap --headless --record r-link.mcap", "s.itouch --headless --report s.itouch",
    "recover r.mcap -o r.mcap", "recover r.mcap -o r-link.mcap", "check a.xml -o a.xml", "check a.xml --json -o a.xml",
    "check study.xml named.xml -o path.csv", "safety-report a.xml -o a.xml", "export r.mcap --layout r.mcap",
    "export s.itouch --xml s.itouch", "export s.itouch --itouch s.itouch", "export s.itouch -o s.itouch",
    "report r.mcap -o r.mcap", "report s.itouch -o s.itouch", "study report study.xml data -o a.xml",
    "virtual-rig a.xml --run --report a.xml", "study power study.xml --json study.xml",
    "study serve study.xml --key a.xml",
    "mesh.xml --headless --trace m.gltf", "mesh.xml --headless --trace a-b.bin", "mesh.xml --headless --screenshot skin\u00e9.png",
    "thermal solve case.csv --at 1s -o case.csv", "thermal solve x.json --times case.csv -o case.csv",
    "thermal record-flux named.xml -o path.csv", "thermal switching a.xml --json a.xml", "measure touch a.xml -o a.xml",
    "identify a.xml --heat a.xml", "bench display --plant a.xml --json a.xml",
    "bench contact --mesh m.gltf --json m.gltf", "bench sessions --scene a.xml --json a.xml", "bench start a.xml --json a.xml",
    "bench thermal --case case.csv --json case.csv", "bench wire a.xml --json a.xml", "study report study.xml data -o study.xml",
]  # fmt: skip
TWICE = [
    "a.xml --headless --record z.mcap --save z.mcap", "a.xml --headless --record z.mcap --report ./z.mcap",
    "a.xml --headless --report z --save z", "export r.mcap --csv t.csv --layout t.columns.csv",
    "virtual-rig a.xml --run --report z --trace z", "asks.xml --headless --save out.mcap",
    "asks-more.xml --headless --report ./out.mcap", "virtual-rig asks.xml --run --report out.mcap",
    "asks.itouch --headless --save out.mcap", "asks.mcap --headless --report out.mcap",
]  # fmt: skip
KINDS = [
    ("study export data --tsv study.txt", "a scene, a study or a sweep"), ("a.xml --headless --report r.mcap", "a recording"),
    ("a.xml --headless --save r.mcap", "a recording"), ("a.xml --headless --report s.itouch", "a saved session"),
    ("a.xml --headless --report study.xml", "a scene, a study or a sweep"),
    ("export r.mcap --layout a.xml", "a scene, a study or a sweep"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("words", "said"),
    [(words, "is read") for words in READ] + [(words, "name two files") for words in TWICE] + [
        (words, f"is {kind}, which would be lost; name another file") for words, kind in KINDS],
)  # fmt: skip
def test_what_would_be_destroyed_is_told_before_anything_is_written(
    words: str, said: str, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("itouch.loop.Engine.tick", lambda self: pytest.fail("the work has begun"))
    if "study.txt" in words:
        shutil.copy(files / "study.xml", files / "study.txt")
    before = state(files)
    done = program(*words.split(), cwd=files)
    assert state(files) == before
    assert (done.returncode, done.stdout) == (2, "") and said in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_session_may_be_saved_where_it_came_from(files: Path, tmp_path: Path) -> None:
    shutil.copy(files / "s.itouch", tmp_path)
    done = program("s.itouch", "--headless", "--for", "10ms", "--save", "s.itouch", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert int(itouch.restore(tmp_path / "s.itouch").state["tick"]) == 20


def test_a_recording_that_an_option_replaces_is_no_output(files: Path, tmp_path: Path) -> None:
    words = [str(files / "asking.xml"), "--headless", "--for", "10ms", "--report", "out.mcap"]
    for more in (["--no-record"], ["--record", "z.mcap"]):
        assert program(*words, *more, cwd=tmp_path).returncode == 0
        (tmp_path / "out.mcap").unlink()
    assert [path.name for path in tmp_path.iterdir()] == ["z.mcap"]


def test_outputs_of_one_kind_are_replaced_and_streams_take_several(files: Path, tmp_path: Path) -> None:
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    (tmp_path / "a.calibration.json").unlink()
    words = ["a.xml", "--headless", "--for", "10ms", "--record", "r.mcap", "--save", "s.itouch"]
    assert program(*words, "--report", "/dev/null", "--trace", "/dev/null", cwd=tmp_path).returncode == 0
    assert program("export", "s.itouch", "--xml", "x.xml", cwd=tmp_path).returncode == 0
    assert program("export", "s.itouch", "--xml", "x.xml", cwd=tmp_path).returncode == 0


@pytest.mark.parametrize(
    "words",
    ["a.xml --record foo.txt", "a.xml --wav t.mp3", "a.xml --film t.avi", "a.xml --screenshot t.jpg",
     "recover r.mcap -o r.txt", "study export data --tsv t.xml", "study export data --parquet t.tsv"],
)  # fmt: skip
def test_the_ending_of_an_output_is_told_before_the_work(words: str, files: Path) -> None:
    before = state(files)
    done = program(*words.split(), cwd=files)
    assert state(files) == before
    assert done.returncode == 2 and "name ends in ." in done.stderr


#: The arguments that name what is read: a file that a new one names is in this list, or its type is an `Output`.
INPUTS = {
    "calibrate scene", "calibrate --samples", "check scenes", "check --rig", "doctor --rig", "doctor --rates",
    "export file", "inspect file", "recover recording", "replay recording", "report session", "run scene", "run --rig",
    "safety-report scene", "safety-report --rig", "study audit study", "study check study", "study export folder",
    "study forget folder", "study freeze study", "study power study", "study report folder",
    "study report study", "study run --answers", "study run study", "study serve study", "study simulate study",
    "measure touch --rig", "measure touch scene", "reproduce --measured", "sweep sweep", "sync scene", "test-plugin --scene",
    "thermal materials documents", "thermal record-flux --rig", "thermal record-flux scene", "thermal solve --times",
    "thermal switching --rig", "thermal switching scene", "view session", "virtual-rig scene", "virtual-rig --rig", "watch scene",
    "watch --rig",
}  # fmt: skip
#: What a metavar holds that names a file or a folder.
_NAMES = ("FILE", "FOLDER", "DIR", "SCENE", "SESSION", "STUDY", "SWEEP")


def taken() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yield every parser of the command line with the words that lead to it."""
    for name in listed():
        parser = _parser_of(name, COMMANDS)
        if isinstance(parser, Parser):
            yield from _inner(name, parser)


def _inner(name: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    yield name, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word, inner in action.choices.items():
                yield from _inner(f"{name} {word}", inner)


@pytest.mark.parametrize(
    "words",
    [
        ["a.xml", "--headless", "--report", ""], ["a.xml", "--headless", "--save", ""],
        ["a.xml", "--headless", "--trace", ""], ["a.xml", "--headless", "--trigger", ""],
        ["check", "a.xml", "-o", ""], ["new-scene", "more", "-o", ""], ["export", "r.mcap", "--bids", ""],
    ],
)  # fmt: skip
def test_an_empty_name_is_refused(
    words: list[str], files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A script whose variable is not set lost its report or its session, and was told that all went well."""
    monkeypatch.chdir(files)
    before = sorted(os.listdir(files))
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert words[-2] in (said := capsys.readouterr().err)
    assert "the name is empty; name " in said
    assert sorted(os.listdir(files)) == before


def test_every_argument_that_names_a_file_is_an_output_or_known_to_be_read() -> None:
    found = {
        f"{name} {max(action.option_strings, key=len, default=action.dest)}"
        for name, parser in taken()
        for action in parser._actions
        if any(part in str(action.metavar) for part in _NAMES)
        and not isinstance(action.type, Output)
        and action.type not in (output_folder, commands.output_folder)
    }
    assert found == INPUTS


def test_no_output_of_any_command_may_be_its_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    tried = 0
    for name, parser in taken():
        needed: list[str] = []
        for action in parser._actions:
            if action.required and not isinstance(action, argparse._SubParsersAction):
                needed += [*action.option_strings[-1:], "" if isinstance(action.type, Output) else "{in}"]
        positional = any(not action.option_strings and action.nargs != 0 for action in parser._actions)
        for action in parser._actions:
            if not isinstance(action.type, Output) or not positional:
                continue
            given = Path(f"in{action.type.endings[0] if action.type.endings else ''}")
            given.write_text("what a person has made\n")
            words = [word.replace("{in}", given.name) for word in needed if action.option_strings[-1:] != [word]]
            with pytest.raises(ItouchError, match="is read"):
                parser.parse_args([*(word for word in words if word), action.option_strings[-1], given.name])
            assert given.read_text() == "what a person has made\n", name
            tried += 1
    assert tried > 20
