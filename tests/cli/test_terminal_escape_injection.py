"""What comes from files never acts on the terminal, and nothing but a regular file is waited for."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import itouch
from itouch.plugin.discovery import Catalog
from itouch.scene.loader import read_scene
from itouch.schema.terminal import plain
from itouch_tools.cli import main

#: Title, colours, bell, CSI of eight bits, right-to-left override, delete.
EVIL = "\x1b]0;owned\x07\x1b[31mred\x9b2J\u202egnp.exe\x7f"
_ACTS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
FIRST = '<itouch version="1.0"><devices><device name="arm" plugin="usb-arm"/></devices></itouch>'


@given(st.text())
def test_no_text_acts_on_the_terminal(text: str) -> None:
    shown = plain(text)
    assert not _ACTS.search(shown)
    assert plain(shown) == shown
    assert [part for part in text.split("\n") if part.isascii() and part.isprintable()] == [
        part for part in shown.split("\n") if part in text.split("\n") and part.isascii() and part.isprintable()
    ]


@pytest.fixture(scope="module")
def evil(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a session whose manifest and ledger hold what acts on terminals."""
    folder = tmp_path_factory.mktemp("evil")
    (folder / "s.xml").write_text(FIRST, encoding="utf-8")
    session = itouch.build(folder / "s.xml")
    session.run(0.01)
    session.save(folder / "s.itouch")
    with zipfile.ZipFile(folder / "s.itouch") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    manifest, ledger = json.loads(members["manifest.json"]), json.loads(members["ledger.json"])
    manifest |= {"source": EVIL, "git": EVIL, "host": {"system": EVIL}, "plugins": {EVIL: EVIL}}
    ledger["faults"] = [{"device": EVIL, "tick": 1, "time_s": 0.1, "trip": EVIL, "cause": EVIL, "scene": EVIL}]
    members |= {"manifest.json": json.dumps(manifest).encode(), "ledger.json": json.dumps(ledger).encode()}
    with zipfile.ZipFile(folder / "e.itouch", "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return folder / "e.itouch"


@pytest.mark.parametrize("words", [["inspect"], ["run", "--headless", "--pace", "fast", "--for", "10ms"]])
def test_a_received_session_does_not_act_on_the_terminal(
    evil: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    main([words[0], str(evil), *words[1:]])
    out, err = capsys.readouterr()
    assert not _ACTS.search(out + err)
    assert "owned" in out + err
    assert "\\x1b]0;owned\\x07" in out + err


def test_a_scene_and_the_command_line_do_not_act_on_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.xml"
    path.write_text('<itouch version="1.0">\n<wor\u202eld a="\x7f\x85\u202e"/></itouch>', encoding="utf-8")
    assert main(["check", str(path)]) == 2
    assert main(["check", f"{tmp_path}/\x1b[2J.xml"]) == 2
    out, err = capsys.readouterr()
    assert not _ACTS.search(out + err)
    assert "\\x1b[2J.xml" in err


@pytest.mark.parametrize("words", [
    ["check", "p.xml"], ["check", "i.xml"], ["run", "p.itouch", "--headless"], ["inspect", "p.mcap"],
    ["inspect", "p.xml"], ["replay", "p.mcap"], ["check", "s.xml", "--rig", "p.xml"],
    ["identify", "p.csv"], ["thermal", "solve", "p.json"],
])  # fmt: skip
def test_a_pipe_is_refused_at_once(tmp_path: Path, words: list[str]) -> None:
    for name in ("p.xml", "p.itouch", "p.mcap", "p.csv", "p.json"):
        os.mkfifo(tmp_path / name)
    (tmp_path / "s.xml").write_text(FIRST, encoding="utf-8")
    (tmp_path / "i.xml").write_text('<itouch version="1.0"><include file="p.xml"/></itouch>', encoding="utf-8")
    code = f"import sys; from itouch_tools.cli import main; sys.exit(main({words!r}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=600,
                          check=False)  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert "a pipe, a device or a socket, not a file" in done.stderr


Text = Callable[[int], str]


def _boxes(count: int) -> str:
    boxes = "\n".join(f'<box name="b{i}" size="1 1 1 cm" pos="{i} 0 0 cm" material="m"/>' for i in range(count))
    return f'<materials><material name="m"/></materials><world>{boxes}</world>'


def _motion(count: int) -> str:
    steps = '<to pos="0 0 5 cm" in="1 s"/>\n' * count
    return (
        '<devices><device name="arm" plugin="usb-arm"/></devices><interaction><probe name="f" pose-from="arm"/>'
        f'<operator probe="f"><motion>{steps}</motion></operator></interaction>'
    )


def _wrong(count: int) -> str:
    return "<world>" + "".join(f'<bx name="b{i}"/>' for i in range(count)) + "</world>"


@pytest.mark.parametrize("text", [_boxes, _motion, _wrong])
def test_reading_a_scene_takes_a_time_that_grows_as_the_scene(tmp_path: Path, text: Text) -> None:
    def seconds(count: int) -> float:
        path = tmp_path / "s.xml"
        path.write_text(f'<itouch version="1.0">{text(count)}</itouch>', encoding="utf-8")
        catalog, best = Catalog(), float("inf")
        for _ in range(2):
            begin = time.process_time()
            read_scene(path, catalog)
            best = min(best, time.process_time() - begin)
        return best / count

    seconds(100)  # what is loaded once
    assert seconds(8000) < 2.0 * max(seconds(1000), 2e-5)
