"""Golden files: sessions and recordings of every released format version stay readable, with the same numbers."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

import itouch
from itouch.plugin.discovery import Catalog
from itouch.session.manifest import FORMAT
from itouch.session.open import read_session

GOLDEN = Path(__file__).parent / "golden"
#: File -> digest of its State, its tick, the fields to look at.
SESSIONS = {
    path.name: path for path in sorted(GOLDEN.iterdir()) if path.suffix in (".itouch", ".xml")
}  # fmt: skip
DIGESTS = dict(line.split()[::-1] for line in (GOLDEN / "digests.txt").read_text(encoding="ascii").splitlines())


@pytest.mark.parametrize("name", SESSIONS)
def test_a_session_is_read_with_the_same_numbers(name: str) -> None:
    snapshot = read_session(SESSIONS[name], Catalog())
    assert hashlib.sha256(snapshot.state.tobytes()).hexdigest() == DIGESTS[name]
    assert snapshot.manifest["format"] in name
    assert snapshot.scene.devices


def test_every_format_of_sessions_has_a_golden_file() -> None:
    major, minor = (int(part) for part in FORMAT.split("."))
    for version in (f"{major}.{number}" for number in range(minor + 1)):
        assert any(version in name for name in SESSIONS), version


@pytest.mark.parametrize(
    ("name", "device", "limit", "value"),
    [
        ("plain-1.2.itouch", "table", "speed", 0.1),
        ("first_touch-1.2.itouch", "arm", "force", 1.5),
        ("first_touch-1.2.xml", "arm", "force", 1.5),
    ],
)
def test_the_limits_that_were_in_force_are_read_with_who_has_set_them(
    name: str, device: str, limit: str, value: float
) -> None:
    stored = read_session(SESSIONS[name], Catalog()).manifest["limits"]["devices"][device][limit]
    assert stored[0] == value
    assert stored[1] != "the default" and ".xml:" in stored[1]


@pytest.mark.parametrize("name", SESSIONS)
def test_a_session_goes_on_or_says_field_by_field_why_not(name: str) -> None:
    """The layout belongs to the plugins and may change; that of the plain scene may only grow."""
    try:
        session = itouch.restore(SESSIONS[name])
    except itouch.SessionError as error:
        assert "plain" not in name, error
        assert "  - " in str(error) or "  ! " in str(error)
        return
    before = int(session.state["tick"])
    session.run(0.1)
    assert int(session.state["tick"]) == before + 100


def test_a_recording_is_read_with_the_same_numbers() -> None:
    for path in sorted(GOLDEN.glob("*.mcap")):
        recording = itouch.read(path)
        assert recording.whole
        digest = hashlib.sha256()
        for name in sorted(recording):
            digest.update(np.ascontiguousarray(recording[name]).tobytes())
        assert digest.hexdigest() == DIGESTS[path.name]


def test_no_stored_session_names_a_folder_of_the_machine_that_wrote_it() -> None:
    for path in SESSIONS.values():
        assert not read_session(path, Catalog()).manifest["source"].startswith("/"), path.name
    for path in sorted(GOLDEN.glob("*.mcap")):
        assert not itouch.read(path).session["manifest"]["source"].startswith("/"), path.name


def test_a_session_keeps_of_an_absolute_path_only_the_name(tmp_path: Path) -> None:
    scene = tmp_path / "mine.xml"
    scene.write_text(
        (GOLDEN / "first_touch-1.1.xml").read_text(encoding="utf-8").split("  <session", 1)[0] + "</itouch>"
    )
    session = itouch.build(scene)
    assert session.snapshot().manifest["source"] == "mine.xml"
    assert str(tmp_path) not in session.to_xml()
