"""Tracks: the columns of State that are recorded together, at one rate, under one topic."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from itouch.schema.roles import Role

#: Reason of a State with which another scene goes on in the same recording.
SCENE = "scene"
#: Types of number that a column may have.
KINDS = ("f8", "i8", "u8")
#: Names of components, by their number: vectors; force and torque, or velocities; position and quaternion.
PARTS = {
    3: ("x", "y", "z"),
    6: ("x", "y", "z", "rx", "ry", "rz"),
    7: ("x", "y", "z", "qw", "qx", "qy", "qz"),
}
_MOST_COLUMNS, _MOST_NUMBERS = 4096, 1 << 16
#: Roles by column name in recordings of versions that did not write roles.
OLD_ROLES = {"pose": Role.TRACKED_POSE.value}
#: How much of a column's ``doc`` is kept [characters].
MOST_DOC = 1000


@dataclass(frozen=True, slots=True)
class Column:
    """A field of State in a track: ``size`` numbers (0: a scalar), their unit, what they are and what they are for."""

    field: str
    name: str
    kind: str
    size: int
    unit: str
    doc: str = ""
    role: Role = Role.SIGNAL

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of its components; empty if they have none."""
        return PARTS.get(self.size, ()) if self.kind == "f8" else ()

    @property
    def dtype(self) -> tuple[Any, ...]:
        """Entry of a NumPy dtype list."""
        return (self.name, "<" + self.kind) if self.size == 0 else (self.name, "<" + self.kind, (self.size,))

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of its numbers in flat tables."""
        if self.size <= 1:
            return (self.name,)
        return tuple(f"{self.name}.{part}" for part in self.parts or map(str, range(self.size)))

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each of its numbers: orientations and torques have another one than the three numbers before them."""
        count = max(1, self.size)
        turned = {(7, "m"): "", (6, "N"): "N*m", (6, "m/s"): "rad/s"}.get((self.size, self.unit), self.unit)
        return (self.unit,) * min(3, count) + (turned,) * (count - 3)


@dataclass(frozen=True, slots=True)
class Track:
    """Columns that are recorded together in every ``every``-th tick; ``replay``: a replay needs or compares them."""

    name: str
    every: int
    replay: bool
    columns: tuple[Column, ...]

    @property
    def topic(self) -> str:
        """Name of its channel in the file."""
        return "/" + self.name

    @property
    def dtype(self) -> np.dtype[Any]:
        """The dtype of a row as it is read: tick, time [s], and the columns."""
        return np.dtype([("tick", "<i8"), ("time", "<f8"), *(column.dtype for column in self.columns)])

    def dump(self) -> dict[str, Any]:
        """Return it as plain data."""
        columns = [[c.field, c.name, c.kind, c.size, c.unit] for c in self.columns]
        docs = {c.name: c.doc for c in self.columns if c.doc}
        roles = {c.name: c.role.value for c in self.columns if c.role is not Role.SIGNAL}
        told = {"columns": columns, "docs": docs, "roles": roles}
        return {"name": self.name, "every": self.every, "replay": self.replay, **told}


def load_track(data: Mapping[str, Any]) -> Track:
    """Return a track from plain data, which may come from a damaged or hostile file.

    Raises
    ------
    ValueError
        If it cannot be a track.
    """
    docs, roles = dict(data.get("docs", {})), dict(data.get("roles", OLD_ROLES))
    columns = tuple(
        Column(str(f), str(n), str(k), int(s), str(u), str(docs.get(n, ""))[:MOST_DOC], _role(roles.get(n)))
        for f, n, k, s, u in data["columns"]
    )
    track = Track(str(data["name"]), int(data["every"]), bool(data["replay"]), columns)
    numbers = sum(max(1, column.size) for column in columns)
    names = [column.name for column in columns]
    if len(columns) > _MOST_COLUMNS or numbers > _MOST_NUMBERS or track.every < 1:
        raise ValueError(f"track '{track.name[:40]}' has {len(columns)} columns of {numbers} numbers")
    if any(c.kind not in KINDS or c.size < 0 for c in columns) or len(set(names)) < len(names):
        raise ValueError(f"track '{track.name[:40]}' has an impossible column")
    if {"tick", "time"} & set(names):
        raise ValueError(f"track '{track.name[:40]}' has a column of its own named tick or time")
    return track


def _role(word: object) -> Role:
    return next((role for role in Role if role.value == word), Role.SIGNAL)


def identifier(text: str) -> str:
    """Return a name turned into one that message schemas allow."""
    word = re.sub(r"\W", "_", text, flags=re.ASCII)
    return "_" + word if not word or word[0].isdigit() else word


def identifiers(names: Iterable[str]) -> list[str]:
    """Return names turned into ones that message schemas allow, all different."""
    found: list[str] = []
    for name in names:
        word = identifier(name)
        while word in found:
            word += "_"
        found.append(word)
    return found
