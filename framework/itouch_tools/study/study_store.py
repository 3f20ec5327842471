"""The data of a study: one SQLite file, with one transaction per trial, committed before the next trial begins.

The schema is this module's `SCHEMA`; any SQLite tool opens the file.  Trials are only ever added.  Participants'
personal data are in a table (and a file) of their own, so that they can be deleted while the trials stay as they are.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import sqlite3
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from itouch.schema import ItouchError

#: Number in ``PRAGMA user_version``: raised when the schema changes.
VERSION = 2
SCHEMA = """
CREATE TABLE study (                -- one row: what was frozen before the first participant
    id INTEGER PRIMARY KEY CHECK (id = 1),
    name TEXT NOT NULL,
    seed INTEGER NOT NULL,
    digest TEXT NOT NULL,           -- SHA-256 of study and scene files, by content
    program TEXT NOT NULL,          -- version of the program
    frozen TEXT NOT NULL            -- ISO 8601, UTC
) STRICT;
CREATE TABLE trials (               -- one row a trial that has ended, in the order in which they ended
    id INTEGER PRIMARY KEY,
    participant TEXT NOT NULL,
    place INTEGER NOT NULL,         -- in the participant's order, from 0; a repetition of a void trial has a new one
    repeats INTEGER,                -- place of the void trial that it repeats
    block TEXT NOT NULL,
    task TEXT NOT NULL,
    condition TEXT NOT NULL,        -- JSON: factor -> level
    shown TEXT NOT NULL,            -- JSON: what was presented in each interval
    staircase TEXT,                 -- its name, of an adaptive trial
    level REAL,                     -- that it asked for
    answer TEXT,                    -- NULL: none was given
    right INTEGER,                  -- 1, 0, or NULL where there is no right answer
    reaction_s REAL,                -- from the end of the contact to the answer, on the servo's clock
    void TEXT NOT NULL DEFAULT '',  -- why the trial does not count; empty: it does
    felt TEXT NOT NULL DEFAULT '{}',-- JSON: what was rendered, interval by interval
    begun_s REAL NOT NULL,          -- of the session's servo clock
    ended_s REAL NOT NULL,
    session TEXT NOT NULL,          -- the recording that holds it
    ended_at TEXT NOT NULL,         -- ISO 8601, UTC: for people; nothing is computed from it
    UNIQUE (participant, place)
) STRICT;
CREATE TABLE deviations (           -- what was changed after the study was frozen, and said why
    id INTEGER PRIMARY KEY,
    at TEXT NOT NULL,
    what TEXT NOT NULL
) STRICT;
"""
#: What format 2 adds to format 1: the State of a participant's session after the last trial.
SCHEMA_2 = """
CREATE TABLE standing (             -- one row a participant, replaced in the transaction of each trial
    participant TEXT PRIMARY KEY,
    place INTEGER NOT NULL,         -- of the last trial
    condition TEXT NOT NULL,        -- JSON: of the scene that ran at its end
    layout TEXT NOT NULL,           -- SHA-256 of the State's fields
    state BLOB NOT NULL             -- State at its end: twins go on from there
) STRICT;
"""
SCHEMA += SCHEMA_2
PERSONAL_SCHEMA = """
CREATE TABLE participants (
    code TEXT PRIMARY KEY,
    fields TEXT NOT NULL            -- JSON: consent, age band, handedness, skin baseline ...
) STRICT;
"""
_COLUMNS = (
    "participant", "place", "repeats", "block", "task", "condition", "shown", "staircase", "level", "answer", "right",
    "reaction_s", "void", "felt", "begun_s", "ended_s", "session", "ended_at",
)  # fmt: skip
#: Columns that are JSON, and what they are in Python.
_JSON: dict[str, tuple[type, ...]] = {"condition": (dict,), "shown": (list,), "felt": (list, dict, type(None))}


#: Bytes without which SQLite cannot even open a file for writing: its index of the log takes 32 KiB.
ROOM = 1 << 16


#: Beginning of the session's name in rows of simulated trials, which have no recording.
SIMULATED = "simulated"


class StoreError(ItouchError):
    """A study's data that cannot be opened, read or written; the message says why and what to do."""


@dataclass(frozen=True, slots=True)
class Row:
    """A trial as it is kept, see `SCHEMA` for each field; times are in seconds of the servo's clock."""

    participant: str
    place: int
    block: str
    task: str
    condition: Mapping[str, Any]
    shown: Any
    begun_s: float
    ended_s: float
    session: str
    ended_at: str
    repeats: int | None = None
    staircase: str | None = None
    level: float | None = None
    answer: str | None = None
    right: int | None = None
    reaction_s: float | None = None
    void: str = ""
    felt: Any = None


@dataclass(frozen=True, slots=True)
class StoredSession:
    """Scene and State of a participant's session at the end of the last trial, to continue from; see `SCHEMA_2`."""

    place: int
    condition: Mapping[str, str]
    layout: str
    state: bytes


class Store:
    """A study's folder: ``trials.sqlite`` and, separate from it, ``participants.sqlite``."""

    def __init__(self, folder: Path, connection: sqlite3.Connection) -> None:
        self.folder, self._trials = folder, connection
        self._opened = _files(folder / "trials.sqlite")

    @classmethod
    @contextlib.contextmanager
    def open(cls, folder: Path, *, create: bool = False) -> Iterator[Store]:
        """Open a study's data, and close it again.

        Parameters
        ----------
        folder
            The study's folder.
        create
            Create the file, without trials, if there is none yet.  Without it, data that cannot be written, as in an
            archive, are read.

        Raises
        ------
        StoreError
            If there are no data, or if they cannot be written though ``create`` is given, are damaged, or were written
            by a newer program.
        """
        path = folder / "trials.sqlite"
        if not create and not path.exists():
            raise StoreError(f"'{folder}' holds no study: there is no trials.sqlite in it")
        with _sentences(path):
            connection = _connect(path, SCHEMA, write=create)
        try:
            yield cls(folder, connection)
        finally:
            connection.close()

    def freeze(
        self, *, name: str, seed: int, digest: str, program: str, frozen: str, deviation: str = "", earlier: str = ""
    ) -> None:  # fmt: skip
        """Note which study this is, once; later check that it is the same.

        Parameters
        ----------
        deviation
            Why a study that differs from the frozen one may go on here: noted with both digests, and shown in the
            report.
        earlier
            The digest as an earlier version of the program made it.

        Raises
        ------
        StoreError
            If a different study was frozen here and no ``deviation`` is given, or its seed differs, or the data cannot
            be written.
        """
        there = self.frozen()
        if there is None:
            values = (name, seed, digest, program, frozen)
            with _sentences(self.folder / "trials.sqlite"), self._trials:
                self._trials.execute("INSERT INTO study VALUES (1, ?, ?, ?, ?, ?)", values)
            return
        if not self.check(seed=seed, digest=digest, deviation=deviation, earlier=earlier):
            self.deviate(f"{deviation} (study {there['digest'][:12]} became {digest})", frozen)

    def check(self, *, seed: int, digest: str, deviation: str = "", earlier: str = "") -> bool:
        """Tell whether a study is the one that was frozen here, or one whose deviation is noted already.

        Raises
        ------
        StoreError
            If a different study was frozen here and no ``deviation`` is given, or its seed differs.
        """
        there = self.frozen()
        if there is None:
            return False
        if there["seed"] != seed:
            raise StoreError(
                f"'{self.folder}' holds the data of study '{there['name']}' with seed {there['seed']}, and this one "
                f"differs: it has seed {seed}; other orders need another folder"
            )
        noted = [what for _, what in self.deviations()]
        if any(one == there["digest"] or any(one in what for what in noted) for one in (digest, earlier) if one):
            return True
        if not deviation:
            raise StoreError(
                f"'{self.folder}' holds the data of study '{there['name']}' as frozen {there['frozen']}, and this "
                f"one differs; change the files back (frozen/{there['digest'][:12]}.zip there has them), note the "
                f"deviation with --deviation WORDS in `study run`, or start in another folder"
            )
        return False

    def frozen(self) -> dict[str, Any] | None:
        """Return what was frozen, or None."""
        with _sentences(self.folder / "trials.sqlite"):
            row = self._trials.execute("SELECT name, seed, digest, program, frozen FROM study").fetchone()
        return None if row is None else dict(zip(("name", "seed", "digest", "program", "frozen"), row, strict=True))

    def deviate(self, what: str, at: str) -> None:
        """Note a change after freezing."""
        with _sentences(self.folder / "trials.sqlite"), self._trials:
            self._trials.execute("INSERT INTO deviations (at, what) VALUES (?, ?)", (at, what))

    def deviations(self) -> list[tuple[str, str]]:
        """Return the changes after freezing, as pairs (when, what)."""
        with _sentences(self.folder / "trials.sqlite"):
            return list(self._trials.execute("SELECT at, what FROM deviations ORDER BY id"))

    def add(self, row: Row, standing: StoredSession | None = None) -> None:
        """Add a trial, and the session's State after it, in one transaction; when this returns they are on disk.

        Raises
        ------
        StoreError
            If they cannot be written, or the participant has a trial at this place already; nothing is added then.  If
            the file is not where it was opened any more: what it held is kept in a copy, with this trial.
        """
        values = [
            json.dumps(getattr(row, name), sort_keys=True) if name in _JSON else getattr(row, name) for name in _COLUMNS
        ]
        marks = ", ".join("?" * len(_COLUMNS))
        names = ", ".join(f'"{name}"' for name in _COLUMNS)
        with _sentences(self.folder / "trials.sqlite"), self._trials:
            self._trials.execute(f"INSERT INTO trials ({names}) VALUES ({marks})", values)
            if standing is not None:
                self._put(row.participant, standing)
        self._check_place(", this one too")

    def stand(self, participant: str, standing: StoredSession) -> None:
        """Keep the State of a session that a fault has ended: what the broken trial used of a budget stays used.

        Raises
        ------
        StoreError
            If it cannot be written, or the file is not where it was opened any more: what it held is kept in a copy.
        """
        with _sentences(self.folder / "trials.sqlite"), self._trials:
            self._put(participant, standing)
        self._check_place()

    def _check_place(self, more: str = "") -> None:
        """Check that what was committed is in the file that others will open, and not in one without a name.

        If it is not, everything is copied beside it, and that is told; ``more``: what else to say of the copy.

        Programs that synchronise or tidy folders remove and replace files; SQLite goes on writing into what it opened.
        """
        path = self.folder / "trials.sqlite"
        if all(now == then for now, then in zip(_files(path), self._opened, strict=True) if then is not None):
            return
        where = self.folder if self.folder.is_dir() else self.folder.parent
        number = 1
        while (copy := where / f"{self.folder.name}-rescued-{number}.sqlite").exists():
            number += 1
        gone = f"'{path}' or its -wal was removed, moved or replaced while it was open: it keeps nothing any more"
        try:
            with contextlib.closing(sqlite3.connect(copy)) as target:
                self._trials.backup(target)
        except sqlite3.Error as error:
            raise StoreError(f"{gone}, and what it held could not be copied to '{copy}': {error}") from error
        raise StoreError(
            f"{gone}; all trials that it held are in '{copy}'{more}: move that to '{path}', and the same "
            "command goes on from there"
        )

    def _put(self, participant: str, standing: StoredSession) -> None:
        condition = json.dumps(dict(standing.condition), sort_keys=True)
        stood = (participant, standing.place, condition, standing.layout, standing.state)
        self._trials.execute("INSERT OR REPLACE INTO standing VALUES (?, ?, ?, ?, ?)", stood)

    def standing(self, participant: str) -> StoredSession | None:
        """Return scene and State of a participant's session at the end of the last trial; None if none were kept."""
        query = "SELECT place, condition, layout, state FROM standing WHERE participant = ?"
        with _sentences(self.folder / "trials.sqlite"):
            row = self._trials.execute(query, (participant,)).fetchone()
        if row is None:
            return None
        try:
            return StoredSession(row[0], json.loads(row[1]), row[2], row[3])
        except ValueError as error:
            raise StoreError(
                f"'{self.folder / 'trials.sqlite'}': the State after trial {row[0] + 1} of {participant} cannot be "
                f"read ({error}); take the file as a backup has it"
            ) from error

    def rows(self, participant: str | None = None) -> list[Row]:
        """Return the trials of one participant or of all, by code and by place, which is the order of their ends."""
        names = ", ".join(f'"{name}"' for name in _COLUMNS)
        query = f"SELECT {names} FROM trials"
        with _sentences(self.folder / "trials.sqlite"):
            found = (
                self._trials.execute(f"{query} ORDER BY participant, place")
                if participant is None
                else self._trials.execute(f"{query} WHERE participant = ? ORDER BY place", (participant,))
            ).fetchall()
        return [_row(self.folder / "trials.sqlite", values) for values in found]

    def participants(self) -> list[str]:
        """Return the codes of all participants who have trials, sorted."""
        with _sentences(self.folder / "trials.sqlite"):
            return [code for (code,) in self._trials.execute("SELECT DISTINCT participant FROM trials ORDER BY 1")]

    def sessions(self) -> list[str]:
        """Return the names of all sessions that have trials, sorted."""
        with _sentences(self.folder / "trials.sqlite"):
            return [name for (name,) in self._trials.execute("SELECT DISTINCT session FROM trials ORDER BY 1")]

    def refuse_simulated(self) -> None:
        """Keep what people answer apart from what simulated observers have answered.

        Raises
        ------
        StoreError
            If the study's data has trials of simulated observers.
        """
        query = (  # a person's session begins with the person's code, which may be any word
            "SELECT participant, session FROM trials WHERE substr(session, 1, ?) = ? "
            "AND substr(session, 1, length(participant) + 1) <> participant || '-' ORDER BY 1 LIMIT 1"
        )
        with _sentences(self.folder / "trials.sqlite"):
            found = self._trials.execute(query, (len(SIMULATED) + 1, f"{SIMULATED}-")).fetchone()
        if found is not None:
            code, session = found
            raise StoreError(
                f"{self.folder} holds trials of {code}, a simulated observer ({session}), which every analysis would "
                "take for a person: give people's data another folder (-o)"
            )

    def known(self) -> list[str]:
        """Return the codes of all participants who have trials or personal data, sorted."""
        path = self.folder / "participants.sqlite"
        if not path.exists():
            return self.participants()
        with _sentences(path), contextlib.closing(_connect(path, PERSONAL_SCHEMA)) as personal:
            described = {code for (code,) in personal.execute("SELECT code FROM participants")}
        return sorted(described.union(self.participants()))

    def describe(self, participant: str, fields: Mapping[str, Any]) -> None:
        """Keep a participant's personal data, separate from the trials."""
        path = self.folder / "participants.sqlite"
        with _sentences(path), contextlib.closing(_connect(path, PERSONAL_SCHEMA)) as personal, personal:
            personal.execute(
                "INSERT INTO participants VALUES (?, ?) ON CONFLICT (code) DO UPDATE SET fields = excluded.fields",
                (participant, json.dumps(dict(fields), sort_keys=True)),
            )

    def described(self, participant: str) -> dict[str, Any]:
        """Return a participant's personal data; empty if there are none."""
        path = self.folder / "participants.sqlite"
        if not path.exists():
            return {}
        with _sentences(path), contextlib.closing(_connect(path, PERSONAL_SCHEMA)) as personal:
            row = personal.execute("SELECT fields FROM participants WHERE code = ?", (participant,)).fetchone()
        return {} if row is None else dict(json.loads(row[0]))

    def forget(self, participant: str) -> bool:
        """Delete a participant's personal data for good; the trials stay.  Tell whether there were any."""
        path = self.folder / "participants.sqlite"
        if not path.exists():
            return False
        with _sentences(path), contextlib.closing(_connect(path, PERSONAL_SCHEMA)) as personal:
            with personal:
                gone = personal.execute("DELETE FROM participants WHERE code = ?", (participant,)).rowcount
            personal.execute("VACUUM")  # otherwise the bytes would stay in the file's free pages
            personal.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        return gone > 0

    def recordings(self, participant: str) -> list[Path]:
        """Return the recordings of a participant's sessions, which hold under the code what was felt and done.

        Further files of a session are ``CODE-SESSION.NUMBER.mcap``.
        """
        named = re.compile(re.escape(participant) + r"-\d+(?:\.\d+)?\.mcap")
        folder = self.folder / "recordings"
        return sorted(path for path in folder.iterdir() if named.fullmatch(path.name)) if folder.is_dir() else []


def _row(path: Path, values: tuple[Any, ...]) -> Row:
    named = dict(zip(_COLUMNS, values, strict=True))
    for name in _JSON:
        try:
            named[name] = json.loads(named[name])
            if not isinstance(named[name], _JSON[name]):
                raise ValueError(f"it holds {named[name]!r}")
        except ValueError as error:
            raise StoreError(
                f"'{path}': trial {named['place'] + 1} of {named['participant']} cannot be read, its '{name}' was "
                f"changed ({error}); take the file as a backup has it"
            ) from error
    return Row(**named)


def _connect(path: Path, schema: str, *, write: bool = False) -> sqlite3.Connection:
    refused = _refused(path) if path.exists() else ""
    archived = bool(refused)
    if archived and write:
        raise StoreError(f"'{path}' {refused}")
    opened = str(path)
    if archived:  # SQLite wants to make files beside it, unless it is told that no log adds to the file
        log = _size(f"{path}-wal")
        opened = f"{path.resolve().as_uri()}?mode=ro{'' if log else '&immutable=1'}"
    # one thread at a time uses the connection, but not always the same one: see ``SceneSwitcher.beside``
    connection = sqlite3.connect(
        opened, isolation_level="IMMEDIATE", timeout=60.0, check_same_thread=False, uri=archived
    )  # fmt: skip
    try:
        if not archived:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")
            connection.execute("PRAGMA secure_delete = ON")
        version = connection.execute("PRAGMA user_version").fetchone()[0]
        if version > VERSION:
            raise StoreError(f"'{path}' was written by a newer program (format {version}, this one reads {VERSION})")
        if version < VERSION and not archived:
            more = schema if version == 0 else SCHEMA_2 if schema is SCHEMA else ""
            more = more.replace("CREATE TABLE", "CREATE TABLE IF NOT EXISTS")  # another process may be doing the same
            connection.executescript(f"BEGIN IMMEDIATE;{more}PRAGMA user_version = {VERSION};COMMIT;")
        problem = connection.execute("PRAGMA quick_check").fetchone()[0]
        if problem != "ok":
            raise sqlite3.DatabaseError(problem)
    except BaseException:
        connection.close()
        raise
    return connection


def _refused(path: Path) -> str:
    """Return why nothing can be added to a file, and what to do; empty: it can."""
    if not (os.access(path, os.W_OK) and os.access(path.parent, os.W_OK)):
        return "cannot be written, or its folder: copy the folder to where it can"
    if shutil.disk_usage(path.parent).free < ROOM:
        return "cannot be written: the disk is full"
    return ""


def _size(path: str) -> int:
    try:
        return os.path.getsize(path)
    except OSError:
        return 0


def _files(path: Path) -> list[tuple[int, int] | None]:
    """Return which files a database and its log are now: device and number, None where there is none."""
    found: list[tuple[int, int] | None] = []
    for one in (path, f"{path}-wal"):
        try:
            about = os.stat(one)
        except OSError:
            found.append(None)
        else:
            found.append((about.st_dev, about.st_ino))
    return found


@contextlib.contextmanager
def _sentences(path: Path) -> Iterator[None]:
    """Turn SQLite's errors into ones on which a person can act."""
    try:
        yield
    except sqlite3.IntegrityError as error:
        raise StoreError(
            f"'{path}' holds this trial already ({error}): another command adds trials of the same participant at the "
            "same time; let it end, then the same command goes on from there"
        ) from error
    except sqlite3.OperationalError as error:
        raise StoreError(f"cannot use '{path}': {error}; what was committed before is in it") from error
    except sqlite3.DatabaseError as error:
        raise StoreError(
            f"'{path}' is damaged ({error}); keep a copy of it with its -wal file, and recover what is readable with "
            f"'sqlite3 {path.name} .recover'"
        ) from error
    except OSError as error:
        raise StoreError(f"cannot use '{path}': {error.strerror}") from error
