"""The limits in force are stored with a session, and an edited or altered one can't go on under looser ones."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import zipfile
from pathlib import Path
from typing import Any

import pytest
from shipped import SCENES

import itouch

SCENE = """<itouch version="1.0">
  <devices>
    <device name="arm" plugin="usb-arm"><limits force="1 N"/></device>
    <device name="table" plugin="xyz-table"><mount pos="0 0 -30 mm"/></device>
    <device name="pad" plugin="thermal"><mount on="table" pos="0 0 24 mm"/><limits temperature="20 35 degC"/></device>
  </devices>
  <safety contact-time="5 s" dose="10 s" hold-to-run="yes"/>
</itouch>
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    (tmp_path / "scene.xml").write_text(SCENE, encoding="utf-8")
    return tmp_path / "scene.xml"


def stored(scene: Path) -> Path:
    session = itouch.build(scene)
    session.hold()
    session.run(0.05)
    session.save(scene.parent / "s.itouch")
    session.close()
    return scene.parent / "s.itouch"


def edited(path: Path, *changes: tuple[str, str], **manifest: Any) -> Path:
    """Change the scene in an archive, and what the manifest says, with every digest made to fit."""
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    for old, new in changes:
        assert old.encode() in members["scene.xml"], members["scene.xml"].decode()
        members["scene.xml"] = members["scene.xml"].replace(old.encode(), new.encode())
    said = json.loads(members["manifest.json"])
    said |= {"scene": hashlib.sha256(members["scene.xml"]).hexdigest(), **manifest}
    members["manifest.json"] = json.dumps({k: v for k, v in said.items() if v is not None}).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def limits_of(path: Path) -> dict[str, Any]:
    with zipfile.ZipFile(path) as archive:
        found: dict[str, Any] = json.loads(archive.read("manifest.json"))["limits"]
    return found


def test_a_session_says_which_limits_held_and_who_had_set_them(scene: Path) -> None:
    found = limits_of(stored(scene))
    assert found["hold-to-run"] is True
    assert found["devices"]["arm"]["force"] == [1.0, "<limits> at scene.xml:3:49"]
    assert found["devices"]["pad"]["dose"] == [10.0, "<safety> at scene.xml:7:30"]
    assert found["devices"]["table"]["speed"][1] == "the default"


def test_who_had_set_them_is_still_known_after_going_on(scene: Path) -> None:
    before = limits_of(stored(scene))
    session = itouch.restore(scene.parent / "s.itouch")
    assert session.notices == itouch.build(scene).notices
    session.save(scene.parent / "t.itouch")
    assert limits_of(scene.parent / "t.itouch") == before


@pytest.mark.parametrize(("old", "new", "told"), [
    ('force="1 N"', "", "'arm' force: 1 N \\(<limits> at scene.xml:3:49\\) when it was stored, 3 N"),
    ('temperature="20 35 degC"', 'temperature="20 40 degC"', "'pad' temperature: 20 to 35 degC .* 20 to 40 degC"),
    ('dose="10 s"', "", "'pad' dose: 0.1667 min CEM43 .* 2 min CEM43"),
    ('contact-time="5 s"', 'contact-time="59 s"', "'table' contact-time: 5 s .* 59 s"),
    ('hold-to-run="yes"', "", "hold-to-run: needed when it was stored, not here"),
])  # fmt: skip
def test_a_session_with_loosened_limits_is_refused(scene: Path, old: str, new: str, told: str) -> None:
    path = stored(scene)
    text = zipfile.ZipFile(path).read("scene.xml").decode()
    if old not in text:  # the canonical scene writes numbers in SI
        old, new = canonical(old, text), new
    with pytest.raises(itouch.SessionError, match="looser limits than it was stored with") as caught:
        itouch.restore(edited(path, (old, new)))
    assert caught.match(told)


def canonical(old: str, text: str) -> str:
    """Return how the canonical scene writes an attribute."""
    name = old.partition("=")[0]
    begin = text.index(f'{name}="', text.index("<limits") if name in ("force", "temperature") else 0)
    return text[begin : text.index('"', begin + len(name) + 2) + 1]


def test_a_document_and_a_recording_with_loosened_limits_are_refused(scene: Path) -> None:
    session = itouch.build(scene)
    text = session.to_xml()
    altered = text.replace(canonical('dose="10 s"', text), "", 1)
    assert altered != text
    (scene.parent / "s.xml").write_text(altered, encoding="utf-8")
    with pytest.raises(itouch.SessionError, match="'pad' dose"):
        itouch.restore(scene.parent / "s.xml")


def test_what_is_tighter_goes_on_and_is_named(scene: Path) -> None:
    path = stored(scene)
    said = limits_of(path)
    said["devices"]["arm"]["force"][0] = 2.0
    session = itouch.restore(edited(path, limits=said))
    (told,) = [notice for notice in session.notices if "limit of" in notice]
    assert told.startswith("limit of 'arm' force: 2 N (<limits> at scene.xml:3:49) when it was stored, 1 N (<limits> ")
    session.hold()
    session.run(0.01)


@pytest.mark.parametrize("limits", [None, 7, {"devices": {"arm": {"force": "x"}}}, {"devices": []}, {}])
def test_limits_that_are_missing_or_mean_nothing_are_refused(scene: Path, limits: Any) -> None:
    with pytest.raises(itouch.SessionError, match="limits"):
        itouch.restore(edited(stored(scene), limits=limits))


def test_an_old_session_says_that_its_limits_are_not_known(scene: Path) -> None:
    session = itouch.restore(edited(stored(scene), format="1.1", limits=None))
    assert any("did not note its limits" in notice for notice in session.notices)


def test_a_session_goes_on_under_a_tighter_force_while_its_plate_presses_harder() -> None:
    """What was left for the arm was less than none then, and its command not a number: the session stopped for that."""
    session = itouch.build(SCENES / "four_materials.xml")
    session.enable()
    session.run(15.0, until=lambda: session.state["finger.felt_force"].item() > 0.8)
    stored = session.snapshot()
    assert stored.state["finger.felt_force"].item() > 0.8
    scene = itouch.load(SCENES / "four_materials.xml")
    tight = dataclasses.replace(scene, safety=dataclasses.replace(scene.safety, force=0.5))
    restored = itouch.build(tight)
    restored.take_up(stored)
    restored.run(0.5)
    assert 0.0 < restored.state["finger.felt_force"].item() < 0.5


@pytest.mark.parametrize("other", ["", ' participant="P08"'])
def test_a_session_of_a_participant_does_not_go_on_as_anybody_else_s(
    scene: Path, other: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was used up would not count, or for another person."""
    monkeypatch.setenv("XDG_STATE_HOME", str(scene.parent / "state"))
    scene.write_text(SCENE.replace("<safety ", '<safety participant="P07" '), encoding="utf-8")
    path = stored(scene)
    with pytest.raises(itouch.SessionError, match=r"participant: 'P07' when it was stored, ('P08'|nobody) here"):
        itouch.restore(edited(path, (' participant="P07"', other)))
