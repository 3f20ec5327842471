"""Hostile sessions: clear errors in bounded time and memory; no code is run, nothing is written elsewhere."""

from __future__ import annotations

import hashlib
import io
import json
import os
import pickle
import random
import re
import resource
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from campaign import size, tell
from shipped import SCENES

import itouch
from itouch_tools.cli import main as cli


@pytest.fixture(scope="module")
def members(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    path = tmp_path_factory.mktemp("hostile") / "s.itouch"
    session = itouch.build(SCENES / "first_touch.xml")
    session.run(0.5)
    session.save(path)
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def write(path: Path, members: dict[str, bytes], *, kind: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", kind) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def with_state(members: dict[str, bytes], array: np.ndarray) -> dict[str, bytes]:
    """Another State, with the digest that fits it: hostile, not merely damaged."""
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    manifest = json.loads(members["manifest.json"])
    if not array.dtype.hasobject:
        manifest["state"] = hashlib.sha256(array.tobytes()).hexdigest()
    return {**members, "state.npy": stream.getvalue(), "manifest.json": json.dumps(manifest).encode()}


def state_of(members: dict[str, bytes]) -> np.ndarray:
    return np.load(io.BytesIO(members["state.npy"]), allow_pickle=False)


@pytest.mark.parametrize(
    ("ledger", "said"),
    [
        ({"contacts": 5, "faults": []}, "'contacts' of its ledger is not a list of objects"),
        ({"contacts": [{"probe": "finger"}], "faults": []}, "contact 1 of its ledger has no 'object' that can be read"),
        (None, "ledger.json is not JSON from line 1, column 2 on"),
        ([], "a document of it is not a JSON object"),
    ],
    ids=str,
)
def test_a_damaged_ledger_is_told_in_plain_words_by_every_command(
    members: dict[str, bytes], ledger: object, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = b"{" if ledger is None else json.dumps(ledger).encode()
    path = str(write(tmp_path / "s.itouch", {**members, "ledger.json": data}))
    for words in (["inspect", path], ["run", path, "--headless", "--for", "0.01s"]):
        assert cli(words) == 2
        assert said.replace("ledger.json", "a document of it") in capsys.readouterr().err


def test_a_session_that_is_cut_or_damaged_is_told_in_plain_words(
    members: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = write(tmp_path / "s.itouch", members).read_bytes()
    at = whole.index(b"state.npy") + 200
    for data, said in (
        (whole[: len(whole) // 2], "the file is cut off or damaged"),
        (whole[:at] + b"\xff" * 40 + whole[at + 40 :], "damaged"),
    ):
        (tmp_path / "s.itouch").write_bytes(data)
        assert cli(["inspect", str(tmp_path / "s.itouch")]) == 2
        assert f"{said}; take an earlier copy of it, or its recording" in capsys.readouterr().err


class Evil:
    """Writes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, ...]:
        return (Path.write_text, (self.path, "run"))


Make = Callable[[dict[str, bytes], Path], dict[str, bytes]]


def header(text: bytes) -> bytes:
    return b"\x93NUMPY\x02\x00" + len(text).to_bytes(4, "little") + text


def poke(field: str, value: int) -> Make:
    def make(members: dict[str, bytes], path: Path) -> dict[str, bytes]:
        state = state_of(members).copy()
        state[field][...] = value
        return with_state(members, state)

    return make


HOSTILE: dict[str, Make] = {
    "pickle": lambda m, p: {**m, "state.npy": pickle.dumps(Evil(p / "ran"))},
    "object array": lambda m, p: with_state(m, np.array([Evil(p / "ran")], dtype=object)),
    "object field": lambda m, p: with_state(m, np.zeros(1, [("tick", "i8"), ("x", "O")])),
    "plain array": lambda m, p: with_state(m, np.zeros(10)),
    "two records": lambda m, p: with_state(m, np.concatenate([state_of(m)] * 2)),
    "wrong dtype": lambda m, p: with_state(m, np.zeros(1, [("tick", "f4"), ("seed", "u8")])),
    "huge header": lambda m, p: {**m, "state.npy": header(b"{" + b" " * (8 << 20) + b"}")},
    "deep header": lambda m, p: {**m, "state.npy": header(b"(" * 100_000)},
    "code in the header": lambda m, p: {**m, "state.npy": header(b"__import__('os').abort()")},
    "shape of 10^12": lambda m, p: {**m, "state.npy": header(
        b"{'descr': [('tick','<i8')], 'fortran_order': False, 'shape': (1000000000000,), }")},
    "an object index": poke("finger.contact.object", 10**9),
    "a status that is none": poke("arm.status", 77),
    "a tick before the first": poke("tick", -5),
    "traversal": lambda m, p: {**m, "../../evil": b"x"},
    "absolute name": lambda m, p: {**m, "/tmp/evil": b"x"},
    "asset that is no digest": lambda m, p: {**m, "assets/../../evil": b"x"},
    "unknown version": lambda m, p: {**m, "manifest.json": b'{"format": "2.0"}'},
    "version that is none": lambda m, p: {**m, "manifest.json": b'{"format": "1.x"}'},
    "manifest that is a list": lambda m, p: {**m, "manifest.json": b"[]"},
    "deep manifest": lambda m, p: {**m, "manifest.json": b"[" * 500_000},
    "deep scene": lambda m, p: {**m, "scene.xml": b"<itouch>" + b"<a>" * 100_000},
    "scene of entities": lambda m, p: {**m, "scene.xml": b'<!DOCTYPE a [<!ENTITY b "c">]><itouch>&b;</itouch>'},
    "bases that do not fit": lambda m, p: {**m, "bases.npy": m["state.npy"]},
    "bomb": lambda m, p: {**m, "state.npy": bytes(200 << 20)},
    "many members": lambda m, p: {**m, **{f"assets/{n:064x}": b"" for n in range(5000)}},
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_session_is_refused_in_bounded_memory(name: str, members: dict[str, bytes], tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    path = write(tmp_path / "here" / "h.itouch", HOSTILE[name](members, tmp_path))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(itouch.SessionError, match=r"h\.itouch|resumed|layout of State"):
        itouch.restore(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 300 << 10
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["h.itouch", "here"]


def test_a_bomb_that_lies_about_its_size(members: dict[str, bytes], tmp_path: Path) -> None:
    path = write(tmp_path / "h.itouch", {**members, "state.npy": bytes(150 << 20)})
    data = bytearray(path.read_bytes())
    size_field = (150 << 20).to_bytes(4, "little")
    assert data.count(size_field) >= 2
    path.write_bytes(bytes(data).replace(size_field, (4096).to_bytes(4, "little")))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(itouch.SessionError):
        itouch.restore(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100 << 10


@pytest.mark.parametrize(
    ("mebibytes", "match"), [(255, "not as long as it says"), (256, r"would unpack to 51[2-9] MiB")]
)
def test_all_members_together_have_a_limit(
    members: dict[str, bytes], tmp_path: Path, mebibytes: int, match: str
) -> None:
    """Two assets that claim to be that large: whether they may be is decided before anything is unpacked."""
    claimed, told = 4099, mebibytes << 20
    path = write(tmp_path / "h.itouch", {**members, **{f"assets/{n:064x}": bytes(claimed) for n in range(2)}})
    data, field = path.read_bytes(), claimed.to_bytes(4, "little")
    assert data.count(field) == 4
    path.write_bytes(data.replace(field, told.to_bytes(4, "little")))
    with pytest.raises(itouch.SessionError, match=match):
        itouch.restore(path)


@pytest.mark.campaign
def test_mutated_archives(members: dict[str, bytes], tmp_path: Path) -> None:
    """Bytes of the archive are changed, and bytes of members under checksums that fit."""
    generator, refused = random.Random(5), 0
    plain = write(tmp_path / "p.itouch", members).read_bytes()
    path = tmp_path / "m.itouch"
    for number in range(size(150, 10_000)):
        if number % 2:
            broken = bytearray(plain)
            mutate(broken, generator)
            path.write_bytes(broken)
        else:
            name = generator.choice(sorted(members))
            inner = bytearray(members[name])
            mutate(inner, generator)
            write(path, {**members, name: bytes(inner)}, kind=zipfile.ZIP_STORED)
        try:
            session = itouch.restore(path)
        except itouch.SessionError:
            refused += 1
            continue
        assert int(session.state["tick"]) == 500
    tell(f"mutated sessions: {refused} refused with a sentence, the others unharmed, no crash")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["m.itouch", "p.itouch"]


def mutate(data: bytearray, generator: random.Random) -> None:
    for _ in range(generator.randint(1, 6)):
        where = generator.randrange(len(data))
        kind = generator.randrange(4)
        if kind == 0:
            data[where] = generator.randrange(256)
        elif kind == 1:
            del data[where : where + generator.randint(1, 40)]
            data += b"x"
        elif kind == 2:
            data[where:where] = generator.randbytes(generator.randint(1, 40))
        else:
            data[where] ^= 1 << generator.randrange(8)


@pytest.mark.campaign
def test_mutated_documents(tmp_path: Path) -> None:
    session = itouch.build(SCENES / "first_touch.xml")
    session.run(0.3)
    text, generator, path = session.to_xml().encode(), random.Random(8), tmp_path / "m.xml"
    for _ in range(size(60, 3000)):
        broken = bytearray(text)
        mutate(broken, generator)
        path.write_bytes(broken)
        try:
            assert int(itouch.restore(path).state["tick"]) == 300
        except itouch.SessionError:
            continue


@pytest.mark.parametrize(
    "evil",
    [b'<!DOCTYPE itouch [<!ENTITY a "b">]><itouch version="1.0"><session format="1.1"/></itouch>',
     b'<itouch version="1.0"><session format="1.1">' + b"<a>" * 100_000, b"<itouch/>",
     b'<itouch version="1.0"><session format="1.1"><manifest>{"format":"1.1"}</manifest><ledger>{}</ledger>'
     b'<state bytes="8"><field name="tick" type="O">1</field></state></session></itouch>',
     b'<itouch version="1.0"><session format="1.1"><manifest>{"format":"1.1"}</manifest><ledger>{}</ledger>'
     b'<state bytes="8"><field name="tick" type="f8" shape="1000000000,1000000000">1</field></state></session></itouch>'],
)  # fmt: skip
def test_hostile_documents(evil: bytes, tmp_path: Path) -> None:
    path = tmp_path / "h.xml"
    path.write_bytes(evil)
    with pytest.raises(itouch.SessionError):
        itouch.restore(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "none.itouch", tmp_path, os.devnull):
        with pytest.raises(itouch.SessionError):
            itouch.restore(path)


def test_a_scene_is_no_damaged_session_and_another_document_no_scene(tmp_path: Path) -> None:
    scene = str(SCENES / "first_touch.xml")
    with pytest.raises(itouch.SessionError) as refused:
        itouch.restore(scene)
    told = str(refused.value)
    assert f"'{scene}' is a scene, not a stored session" in told
    assert f"`itouch-py {scene}` runs it" in told
    assert f"itouch.build({scene!r})" in told
    (tmp_path / "other.xml").write_text('<?xml version="1.0"?><page/>')
    with pytest.raises(itouch.SessionError, match="not a stored session: its outermost element is <page>; name a file"):
        itouch.restore(tmp_path / "other.xml")
    for kind, name in (("study", "studies/metamers.xml"), ("sweep", "sweeps/one_tuning.xml")):
        with pytest.raises(itouch.SessionError, match=f"outermost element is <{kind}>; `itouch-py {kind} run"):
            itouch.restore(SCENES / name)


def test_a_document_in_an_encoding_that_there_is_not(tmp_path: Path) -> None:
    path = tmp_path / "s.xml"
    path.write_bytes(b'<?xml version="1.0" encoding="uf-8"?>\n<itouch version="1.0"><session/></itouch>')
    with pytest.raises((itouch.SessionError, itouch.SceneError), match="encoding"):
        itouch.restore(path)


@pytest.mark.parametrize("pace", ["fast", "real"])
@pytest.mark.parametrize(
    ("field", "value"), [("tick", 1 << 55), ("arm.status", 0), ("arm.measured", 600)], ids=["old", "closed", "early"]
)
def test_a_state_that_can_be_none_is_one_sentence_for_who_starts_it(
    members: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str], field: str, value: int, pace: str
) -> None:
    state = state_of(members).copy()
    state["arm.sent.wrench"], state[field] = 0.25, value
    forged = write(tmp_path / "s.itouch", with_state(members, state))
    assert cli([str(forged), "--headless", "--for", "0.1 s", "--pace", pace]) == 2
    assert "the session can't be resumed: " in capsys.readouterr().err


def test_all_that_is_wrong_with_the_scene_of_an_edited_session_is_told_at_once(
    tmp_path: Path, members: dict[str, bytes]
) -> None:
    session, document = write(tmp_path / "s.itouch", members), tmp_path / "s.xml"
    assert cli(["export", str(session), "-o", str(document)]) == 0
    text = document.read_text(encoding="utf-8")
    plugin = re.search(r'<device name="\w+" plugin="([\w-]+)"', text)
    material = re.search(r'<box [^>]*material="(\w+)"', text)
    assert plugin and material
    for found in sorted((plugin, material), key=lambda each: -each.start(1)):
        text = f"{text[: found.start(1)]}nobodys{text[found.end(1) :]}"
    document.write_text(text, encoding="utf-8")
    with pytest.raises(itouch.SessionError) as told:
        itouch.restore(document)
    assert "no material named 'nobodys'" in str(told.value)
    assert "no device plugin named 'nobodys'" in str(told.value)
