"""Paths in what is passed on to others: a session names its scene's file, not the folders of the machine it ran on."""

from __future__ import annotations

from pathlib import PurePath


def without_folders(source: str) -> str:
    """Return a path as it was given; of an absolute one only the file's name."""
    path = PurePath(source)
    return path.name if path.is_absolute() else source
