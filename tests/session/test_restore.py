"""A session that was stopped anywhere goes on as if it had not stopped, byte for byte."""

from __future__ import annotations

import os
import random
import re
from pathlib import Path

import pytest
from campaign import size, tell
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from running import RUNNABLE, advance, digest, in_a_new_process
from shipped import SCENES

import itouch
from itouch.session.session_error import SessionError

#: The run of the promise: its ticks, and where it is stopped.
TICKS, STOP = size(3111, 7777), size(1571, 3141)


@pytest.fixture(scope="module")
def went_on(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, tuple[str, str, str]]:
    """Return digests by scene: of a run without a stop, stopped and gone on in a new process, and through XML."""
    asked = {
        item.callspec.params.get("scene")
        for item in request.session.items
        if item.path == request.path and hasattr(item, "callspec")
    }
    scenes = [scene for scene in RUNNABLE if scene in asked]
    folder = tmp_path_factory.mktemp("saved")
    straight, through_xml = {}, {}
    for scene in scenes:
        session = itouch.build(SCENES / f"{scene}.xml", seed=5)
        advance(session, STOP)
        session.save(folder / f"{scene}.itouch")
        (folder / f"{scene}.xml").write_text(session.to_xml(), encoding="utf-8")
        advance(session, TICKS)
        straight[scene] = digest(session)
        again = itouch.restore(folder / f"{scene}.xml")
        advance(again, TICKS)
        through_xml[scene] = digest(again)
    anew = in_a_new_process([folder / f"{scene}.itouch" for scene in scenes], TICKS)
    return {scene: (straight[scene], there, through_xml[scene]) for scene, there in zip(scenes, anew, strict=True)}


@pytest.mark.campaign
@pytest.mark.parametrize("scene", RUNNABLE)
def test_a_new_process_goes_on_byte_for_byte(scene: str, went_on: dict[str, tuple[str, str, str]]) -> None:
    straight, anew, through_xml = went_on[scene]
    assert anew == straight
    assert through_xml == straight
    tell(f"{scene}: {TICKS} ticks, stopped at {STOP}, through a new process and through XML: equal bytes")


@pytest.mark.parametrize("scene", ["first_touch", "mesh"])
def test_xml_gives_the_same_snapshot(scene: str, tmp_path: Path) -> None:
    session = itouch.build(SCENES / f"{scene}.xml", seed=2)
    advance(session, 700)
    (tmp_path / "s.xml").write_text(session.to_xml(), encoding="utf-8")
    again = itouch.restore(tmp_path / "s.xml")
    assert again.state.tobytes() == session.state.tobytes()
    assert again.scene == session.scene
    assert again.to_xml() == session.to_xml()
    assert again.snapshot().manifest == session.snapshot().manifest


STRAIGHT: dict[tuple[str, int], str] = {}


def straight_digest(scene: str, ticks: int) -> str:
    if (scene, ticks) not in STRAIGHT:
        session = itouch.build(SCENES / f"{scene}.xml", seed=9)
        advance(session, ticks)
        STRAIGHT[scene, ticks] = digest(session)
    return STRAIGHT[scene, ticks]


@pytest.mark.campaign
@settings(
    max_examples=size(6, 80), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture],
    derandomize=True,
)  # fmt: skip
@given(
    scene=st.sampled_from(RUNNABLE),
    stops=st.lists(st.integers(0, 2500), min_size=1, max_size=4).map(sorted),
    xml=st.lists(st.booleans(), min_size=4, max_size=4),
)
def test_stops_at_random_ticks_in_both_formats_change_no_bit(
    scene: str, stops: list[int], xml: list[bool], tmp_path: Path
) -> None:
    session = itouch.build(SCENES / f"{scene}.xml", seed=9)
    for stop, as_xml in zip(stops, xml, strict=False):
        advance(session, stop)
        path = tmp_path / ("s.xml" if as_xml else "s.itouch")
        if as_xml:
            path.write_text(session.to_xml(), encoding="utf-8")
        else:
            session.save(path)
        session = itouch.restore(path)
    advance(session, 2500)
    assert digest(session) == straight_digest(scene, 2500)


FAULTS = [
    ("peltier", "nan", "plate_temperature"), ("table", "disconnect", ""), ("arm", "spike", "pose"),
    ("peltier", "drift", "heat_flux"), ("table", "delay", ""), ("peltier", "reversed-sign", ""),
    ("arm", "freeze", "pose"), ("peltier", "garbage", ""), ("table", "bias", "wrench"), ("peltier", "drop", ""),
]  # fmt: skip


@pytest.mark.campaign
@pytest.mark.parametrize("number", range(size(3, 30)))
def test_stops_around_an_injected_fault_change_no_bit(number: int, scenes: Path) -> None:
    """Stop before, in and after the safe sequence of an injected fault, several times."""
    generator = random.Random(number)
    device, kind, channel = FAULTS[number % len(FAULTS)]
    at = generator.randrange(300, 2400)
    said = f'<fault device="{device}" kind="{kind}" at="{at} ms"' + (f' channel="{channel}"' if channel else "") + "/>"
    path = scenes / "four_materials.xml"
    path.write_text(path.read_text(encoding="utf-8").replace("</itouch>", f"  {said}\n</itouch>"), encoding="utf-8")
    straight = itouch.build(path, seed=number)
    advance(straight, 3200)
    session = itouch.build(path, seed=number)
    stops = sorted({at + 1, at + generator.randrange(2, 12), *(generator.randrange(1, 3200) for _ in range(2))})
    for stop in stops:
        advance(session, stop)
        session.save(scenes / "s.itouch")
        session = itouch.restore(scenes / "s.itouch")
    advance(session, 3200)
    wrong = [name for name in straight.state if straight.state[name].tobytes() != session.state[name].tobytes()]
    assert wrong == []
    assert _without_places(session) == _without_places(straight)


def _without_places(session: itouch.Session) -> list[dict[str, object]]:
    """The faults but for where the scene stands in a file: a session's scene is its own."""
    places = ("scene", "injected")
    return [{key: value for key, value in fault.items() if key not in places} for fault in session.report()["faults"]]


def test_a_restored_session_needs_no_further_call(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "four_materials.xml")
    advance(session, 900)
    session.save(tmp_path / "s.itouch")
    again = itouch.restore(tmp_path / "s.itouch")
    assert [again.status(name) for name in ("arm", "table", "peltier")] == [
        session.status(name) for name in ("arm", "table", "peltier")
    ]
    again.tick()
    session.tick()
    assert again.state == session.state


def test_a_probe_without_an_object_to_touch_is_restored(tmp_path: Path) -> None:
    """Places in its memory that are not in use were taken for an object that there is not."""
    (tmp_path / "scene.xml").write_text(
        '<itouch version="1.0"><devices><device name="arm" plugin="usb-arm"/></devices><interaction>'
        '<probe name="finger" pose-from="arm" force-to="arm"/></interaction></itouch>', encoding="utf-8"
    )  # fmt: skip
    session = itouch.build(tmp_path / "scene.xml")
    advance(session, 5)
    session.save(tmp_path / "s.itouch")
    assert itouch.restore(tmp_path / "s.itouch").state == session.state


def test_stored_bases_are_used_and_not_solved_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from contact_heat import modes

    session = itouch.build(SCENES / "four_materials.xml")
    session.save(tmp_path / "s.itouch")

    def solve(*_: object) -> None:
        raise AssertionError("a basis was solved again")

    monkeypatch.setattr(modes, "solved_modes", solve)
    again = itouch.restore(tmp_path / "s.itouch")
    advance(again, 50)
    assert again.notices == session.notices


def test_other_bases_give_another_run(tmp_path: Path) -> None:
    """The stored numbers are what runs: with others in their place the flux comes out otherwise."""
    from itouch.plugin.bases import Bases, keeping
    from itouch.plugin.discovery import Catalog
    from itouch.world import Model

    session = itouch.build(SCENES / "four_materials.xml")
    stored = session.snapshot().bases
    changed = {key: tuple(array * (1 + 1e-9) for array in arrays) for key, arrays in stored.items()}
    catalog, bases = Catalog(), Bases(changed)
    with keeping(bases):
        other = itouch.Session(Model.of(session.scene, catalog), catalog=catalog, bases=bases)
    advance(session, 2500)
    advance(other, 2500)
    assert session.state.tobytes() != other.state.tobytes()


def test_meshes_travel_with_the_session(tmp_path: Path, scenes: Path) -> None:
    session = itouch.build(scenes / "mesh.xml")
    advance(session, 100)
    session.save(tmp_path / "s.itouch")
    (tmp_path / "s.xml").write_text(session.to_xml(), encoding="utf-8")
    for path in (scenes / "meshes").iterdir():
        os.unlink(path)
    for name in ("s.itouch", "s.xml"):
        again = itouch.restore(tmp_path / name)
        advance(again, 400)
        advance(session, 400)
        assert again.state == session.state
        session = itouch.restore(tmp_path / "s.itouch")


def test_an_edited_scene_is_told_when_its_session_is_restored(tmp_path: Path) -> None:
    """Of a document that people can edit, and of a snapshot whose scene compiles to another contact here."""
    session = itouch.build(SCENES / "first_touch.xml")
    advance(session, 10)
    text, path = session.to_xml(), tmp_path / "s.xml"
    told = "the scene compiles to other numbers here"
    assert 'stiffness="1200 N/m"' in text
    for written, edited in (
        (text, False),
        (text.replace('stiffness="1200 N/m"', 'stiffness="900 N/m"'), True),
        (text.replace("<world>", "<!-- mine -->\n  <world>"), False),
        (text.replace('static-friction="0.4"', 'static-friction="0.5"'), True),
    ):
        path.write_text(written, encoding="utf-8")
        notices = itouch.restore(path).notices
        assert any(told in notice for notice in notices) is edited, (written[:300], notices)


def test_a_document_that_contradicts_itself_is_refused(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    text, path = session.to_xml(), tmp_path / "s.xml"
    size = session.state.raw.nbytes
    for old, new, said in (
        ('<session format="1.2">', '<session format="x">', '<session format="x"> and the format of its manifest, 1.2'),
        (
            f'<state bytes="{size}">',
            '<state bytes="-1">',
            f'<state bytes="-1"> and its fields, which have {size} bytes',
        ),
    ):
        assert old in text
        path.write_text(text.replace(old, new), encoding="utf-8")
        with pytest.raises(SessionError, match=re.escape(said)):
            itouch.restore(path)
