"""A study's data survive what happens to programs, disks and people."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from itouch_tools.study.study_store import Row, Store, StoredSession, StoreError

ROW = Row("P01", 0, "main", "identify", {"material": "wood"}, ["wood"], 1.0, 2.0, "s1.mcap", "2026-01-01T00:00:00Z",
          answer="wood", right=1, reaction_s=0.8, felt=[{"mean_flux_W_m2": 830.0}])  # fmt: skip


def test_rows_come_back_as_they_were(tmp_path: Path) -> None:
    rows = [replace(ROW, place=place, void="released early" if place == 1 else "") for place in range(3)]
    with Store.open(tmp_path, create=True) as store:
        for row in rows:
            store.add(row)
    with Store.open(tmp_path) as store:
        assert store.rows("P01") == store.rows() == rows
        assert store.rows("P02") == []
        assert store.participants() == ["P01"]


def test_a_trial_that_is_stored_already_is_refused(tmp_path: Path) -> None:
    with Store.open(tmp_path, create=True) as store:
        store.add(ROW)
        with pytest.raises(StoreError, match="holds this trial already .* let it end"):
            store.add(replace(ROW, answer="cork"))
        assert store.rows() == [ROW]


def test_a_frozen_study_stays_that_study(tmp_path: Path) -> None:
    stamp = {"name": "s", "seed": 3, "digest": "ab", "program": "0.2", "frozen": "2026-01-01"}
    with Store.open(tmp_path, create=True) as store:
        store.freeze(**stamp)  # type: ignore[arg-type]
        store.freeze(**{**stamp, "frozen": "later"})  # type: ignore[arg-type]  the same study again
        with pytest.raises(StoreError, match="this one differs"):
            store.freeze(**{**stamp, "digest": "cd"})  # type: ignore[arg-type]
        assert store.frozen() == stamp
        store.deviate("room was 26 degC", "2026-01-02")
        assert store.deviations() == [("2026-01-02", "room was 26 degC")]


def test_a_person_is_forgotten_and_the_trials_stay(tmp_path: Path) -> None:
    with Store.open(tmp_path, create=True) as store:
        store.add(ROW)
        store.describe("P01", {"consent": True, "remark": "unmistakable-words"})
        assert store.described("P01")["consent"] is True
        assert store.forget("P01")
        assert not store.forget("P01")
        assert store.described("P01") == {}
        assert store.rows() == [ROW]
    for path in tmp_path.iterdir():
        assert b"unmistakable-words" not in path.read_bytes()


_WRITER = """
import sys
from pathlib import Path
from dataclasses import replace
sys.path.insert(0, sys.argv[2])
from test_store import ROW, Store
with Store.open(Path(sys.argv[1]), create=True) as store:
    first = len(store.rows())
    print("from", first, flush=True)
    for place in range(first, 100000):
        store.add(replace(ROW, place=place))
        print(place, flush=True)
"""


def test_killed_at_any_instant_nothing_is_lost_or_doubled(tmp_path: Path) -> None:
    told = -1
    for _ in range(4):
        process = subprocess.Popen(
            [sys.executable, "-c", _WRITER, str(tmp_path), str(Path(__file__).parent)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None
        assert process.stdout.readline().strip() == f"from {told + 1}" or told >= 0
        for line in process.stdout:
            told = int(line)
            if told % 7 == 5:
                os.kill(process.pid, signal.SIGKILL)
                break
        for line in process.stdout:  # what it had committed before it died
            told = int(line)
        process.wait()
        process.stdout.close()
        with Store.open(tmp_path) as store:
            places = [row.place for row in store.rows()]
        assert places == list(range(len(places)))
        assert len(places) >= told + 1
        told = len(places) - 1


def test_what_cannot_be_used_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no trials.sqlite"), Store.open(tmp_path):
        pass
    with Store.open(tmp_path, create=True) as store:
        for place in range(200):
            store.add(replace(ROW, place=place))
    path = tmp_path / "trials.sqlite"
    whole = path.read_bytes()
    path.write_bytes(b"nonsense" * 1000)
    with pytest.raises(StoreError, match="is damaged"), Store.open(tmp_path):
        pass
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(StoreError, match="is damaged"), Store.open(tmp_path):
        pass
    path.write_bytes(whole)
    with sqlite3.connect(path) as connection:
        connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(StoreError, match="newer program"), Store.open(tmp_path):
        pass


def test_a_full_disk_keeps_what_was_committed(tmp_path: Path) -> None:
    with Store.open(tmp_path, create=True) as store:
        store.add(ROW)
        pages = store._trials.execute("PRAGMA page_count").fetchone()[0]
        store._trials.execute(f"PRAGMA max_page_count = {pages}")  # a disk without room for another page
        with pytest.raises(StoreError, match="full; what was committed before is in it"):
            for place in range(1, 500):
                store.add(replace(ROW, place=place, answer="x" * 500))
        assert store.rows()[0] == ROW


@pytest.mark.parametrize("what", ["the file", "its log", "the folder", "moved", "replaced"])
def test_a_trial_is_kept_where_it_will_be_found_or_it_is_told(tmp_path: Path, what: str) -> None:
    """Of a file without a name each further trial was called kept, and all were gone at the end."""
    folder = tmp_path / "data"
    folder.mkdir()
    path = folder / "trials.sqlite"
    with (
        pytest.raises(StoreError, match="removed, moved or replaced") as told,
        Store.open(folder, create=True) as store,
    ):
        store.add(ROW)
        if what == "the folder":
            shutil.rmtree(folder)
        elif what == "moved":
            folder.rename(tmp_path / "elsewhere")
        elif what == "replaced":
            shutil.copy(path, tmp_path / "earlier")
            (tmp_path / "earlier").rename(path)
        else:
            (path if what == "the file" else folder / "trials.sqlite-wal").unlink()
        store.add(replace(ROW, place=1))
    copy = re.search(f"are in '(.*)', this one too: move that to '{path}'", str(told.value))
    assert copy
    folder.mkdir(exist_ok=True)
    Path(copy[1]).rename(path)
    with Store.open(folder) as store:
        assert store.rows() == [ROW, replace(ROW, place=1)]
        store.add(replace(ROW, place=2))


def test_data_that_cannot_be_written_can_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No archive, as a read-only share or disk, could be exported or reported: SQLite wanted to write beside the data."""
    with Store.open(tmp_path, create=True) as store:
        store.add(ROW)
        store.describe("P01", {"consent": True})
        crashed = tmp_path / "crashed"  # its log holds all
        shutil.copytree(tmp_path, crashed, ignore=lambda *_: ["crashed"])
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.W_OK)  # the superuser may write everywhere
    for folder in (tmp_path, crashed):
        for path in (*folder.glob("*.sqlite*"), folder):
            os.utime(path, (0, 0))
            path.chmod(0o555)
        with Store.open(folder) as store:
            assert store.rows() == [ROW]
            assert store.described("P01") == {"consent": True}
            with pytest.raises(StoreError, match="readonly"):
                store.add(replace(ROW, place=1))
        with pytest.raises(StoreError, match="copy the folder to where it can"), Store.open(folder, create=True):
            pass
        assert folder.stat().st_mtime == 0.0, "a file was made in the folder"
        folder.chmod(0o755)


def test_what_another_program_has_changed_is_a_sentence(tmp_path: Path) -> None:
    with Store.open(tmp_path, create=True) as store:
        for place in range(3):
            store.add(replace(ROW, place=place), StoredSession(place, {"material": "wood"}, "", b""))
    changed = {
        "trial 2 of P01 cannot be read, its 'condition' was changed": "UPDATE trials SET condition = '{' WHERE place = 1",
        "trial 3 of P01 cannot be read, its 'shown' was changed": "UPDATE trials SET shown = '{}' WHERE place = 2",
        "State after trial 3 of P01 cannot be read": "UPDATE standing SET condition = '{'",
    }
    whole = (tmp_path / "trials.sqlite").read_bytes()
    for words, change in changed.items():
        (tmp_path / "trials.sqlite").write_bytes(whole)
        with contextlib.closing(sqlite3.connect(tmp_path / "trials.sqlite")) as connection, connection:
            connection.execute(change)
        with pytest.raises(StoreError, match=f"{words}.*backup"), Store.open(tmp_path) as store:
            store.standing("P01")
            store.rows()


def test_two_programs_that_begin_together_make_one_file(tmp_path: Path) -> None:
    """Both found no tables yet; the second then said that the table of studies exists already."""
    real, met = sqlite3.connect, []

    class Slow(sqlite3.Connection):
        def executescript(self, script: str) -> sqlite3.Cursor:
            if not met:  # another program was quicker
                met.append(True)
                with Store.open(tmp_path, create=True) as other:
                    other.add(ROW)
            return super().executescript(script)

    sqlite3.connect = lambda *words, **named: real(*words, factory=Slow, **named)  # type: ignore[assignment]
    try:
        with Store.open(tmp_path, create=True) as store:
            assert store.rows() == [ROW]
    finally:
        sqlite3.connect = real
    assert met
