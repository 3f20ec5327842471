"""Paths in what is given to others: a session names its scene's file, not the folders of the machine it was made on."""

from __future__ import annotations

from pathlib import PurePath


def without_folders(source: str) -> str:
    """Return a path as it was given; of an absolute one the name only."""
    path = PurePath(source)
    return path.name if path.is_absolute() else source
