"""Snapshots: whole or refused, with a clear sentence, in bounded time and memory."""

from __future__ import annotations

import io
import json
import random
import zipfile
from pathlib import Path

import numpy as np
import pytest
from shipped import SCENES

import itouch
from itouch.session import archive
from itouch.session import snapshot as snapshots


@pytest.fixture
def snapshot(tmp_path: Path) -> Path:
    engine = itouch.build(SCENES / "first_touch.xml")
    engine.run(0.5)
    engine.save(tmp_path / "s.itouch")
    return tmp_path / "s.itouch"


def rewrite(path: Path, **members: bytes) -> None:
    """Put other members into an archive."""
    with zipfile.ZipFile(path) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    content |= {name.replace("_", "."): data for name, data in members.items()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)


def test_members_and_no_pickle(snapshot: Path) -> None:
    with zipfile.ZipFile(snapshot) as archive:
        assert set(archive.namelist()) == {"scene.xml", "state.npy", "manifest.json", "ledger.json"}
        state = np.load(io.BytesIO(archive.read("state.npy")), allow_pickle=False)
        manifest = json.loads(archive.read("manifest.json"))
    assert int(state["tick"][0]) == 500
    assert manifest["tick"] == 500
    assert manifest["plugins"] == {"usb-arm": itouch_version()}


def itouch_version() -> str:
    from importlib.metadata import version

    return version("itouch-py")


def test_a_snapshot_stays_what_it_was_while_the_session_goes_on() -> None:
    engine = itouch.build(SCENES / "first_touch.xml")
    engine.run(0.1)
    kept = engine.snapshot()
    before = kept.state.tobytes()
    engine.run(0.1)
    assert kept.state.tobytes() == before != engine.snapshot().state.tobytes()


def test_saving_over_a_snapshot_leaves_no_other_file(snapshot: Path) -> None:
    engine = itouch.restore(snapshot)
    engine.run(0.1)
    engine.save(snapshot)
    assert [path.name for path in snapshot.parent.iterdir()] == ["s.itouch"]
    assert int(itouch.restore(snapshot).state["tick"]) == 600


def test_saving_where_it_cannot_be_written(snapshot: Path) -> None:
    engine = itouch.restore(snapshot)
    (snapshot.parent / "file").write_text("")
    with pytest.raises(itouch.SessionError, match="cannot save"):
        engine.save(snapshot.parent / "file" / "x.itouch")


@pytest.mark.parametrize("member", ["scene_xml", "state_npy", "manifest_json", "ledger_json"])
def test_a_damaged_member_is_refused(snapshot: Path, member: str) -> None:
    rewrite(snapshot, **{member: b"\x00garbage"})
    with pytest.raises(itouch.SessionError):
        itouch.restore(snapshot)


def test_object_arrays_other_dtypes_and_newer_formats_are_refused(snapshot: Path) -> None:
    original = snapshot.read_bytes()
    evil = io.BytesIO()
    np.save(evil, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    rewrite(snapshot, state_npy=evil.getvalue())
    with pytest.raises(itouch.SessionError):
        itouch.restore(snapshot)
    snapshot.write_bytes(original)
    plain = io.BytesIO()
    np.save(plain, np.zeros(10))
    rewrite(snapshot, state_npy=plain.getvalue())
    with pytest.raises(itouch.SessionError):
        itouch.restore(snapshot)
    snapshot.write_bytes(original)
    rewrite(snapshot, manifest_json=b'{"format": "9.0"}')
    with pytest.raises(itouch.SessionError, match="reads up to"):
        itouch.restore(snapshot)


def test_another_scene_is_refused(snapshot: Path) -> None:
    with zipfile.ZipFile(snapshot) as archive:
        xml = archive.read("scene.xml")
    changed = xml.replace(b"<interaction>", b'<interaction><probe name="thumb" pose-from="arm"/>')
    assert changed != xml
    rewrite(snapshot, scene_xml=changed)
    with pytest.raises(itouch.SessionError, match="altered: the digest of its scene"):
        itouch.restore(snapshot)


def test_cut_and_flipped_archives_never_crash(snapshot: Path) -> None:
    data = snapshot.read_bytes()
    generator = random.Random(3)
    for _ in range(150):
        broken = bytearray(data)
        if generator.random() < 0.3:
            broken = broken[: generator.randrange(len(broken))]
        else:
            broken[generator.randrange(len(broken))] ^= 1 << generator.randrange(8)
        snapshot.write_bytes(broken)
        try:
            engine = itouch.restore(snapshot)
        except itouch.SessionError:
            continue
        assert int(engine.state["tick"]) == 500  # the flipped bit did not matter


def test_what_ran_is_in_the_session(tmp_path: Path, scenes: Path) -> None:
    engine = itouch.build(scenes / "first_touch.xml", twin="all", seed=11)
    engine.run(0.05)
    engine.save(tmp_path / "s.itouch")
    again = itouch.restore(tmp_path / "s.itouch")
    assert all(device.twin for device in again.scene.devices)
    assert again.report()["seed"] == 11
    assert again.scene == engine.scene


def touched(times: int) -> itouch.Session:
    """Return a session that has touched the block so often, as one of many hours has."""
    session = itouch.build(SCENES / "first_touch.xml")
    session.run(2.5)
    entries = session.statistics.contacts
    entries[:] = [{**entries[0], "begin_s": float(number)} for number in range(times)]
    return session


def test_a_session_with_more_contacts_than_a_snapshot_holds_is_saved_with_the_latest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 64 MiB, which some hundred thousand contacts reach, what had been saved could not be read any more."""
    for module in (archive, snapshots):
        monkeypatch.setattr(module, "MAX_MEMBER", 1 << 16)
    session = touched(500)
    session.save(tmp_path / "s.itouch")
    again = itouch.restore(tmp_path / "s.itouch")
    assert again.state.tobytes() == session.state.tobytes()
    kept = [contact["begin_s"] for contact in again.report()["contacts"]]
    assert kept == [float(number) for number in range(500 - len(kept), 500)]
    assert (1 << 16) / 800 < len(kept) < 500
    said = f"the first {500 - len(kept)} contacts of the session are missing"
    for told in (again.notices, again.report()["notices"]):
        assert [said in notice for notice in told] == [True]
    again.statistics.contacts.extend(again.statistics.contacts[-50:])
    again.save(tmp_path / "t.itouch")
    last = itouch.restore(tmp_path / "t.itouch")
    assert last.statistics.left_out + len(last.statistics.contacts) == 550


def test_a_ledger_is_put_together_in_pieces_that_do_not_grow_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A single call would keep the loop from running, where a session is saved while it runs in real time."""
    dumps, longest = json.dumps, list[int]()

    def noted(what: object) -> str:
        text = dumps(what)
        longest[-1] = max(longest[-1], len(text))
        return text

    for times in (10, 1000):
        session = touched(times)
        whole = dumps(session.statistics.dump()).encode()
        longest.append(0)
        monkeypatch.setattr(json, "dumps", noted)
        packed = session.pack()
        monkeypatch.setattr(json, "dumps", dumps)
        with zipfile.ZipFile(io.BytesIO(packed)) as members:
            assert members.read("ledger.json") == whole
    assert longest[1] < 2 * longest[0], "a hundred times as many contacts, pieces of the same size but for some digits"
