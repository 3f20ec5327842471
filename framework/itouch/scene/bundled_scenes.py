"""The scenes that come with the program: an include names one of their files as in ``itouch:rigs/twin.xml``."""

from __future__ import annotations

from pathlib import Path

#: Prefix of an include that names a file of the program.
SCHEME = "itouch:"


def folder() -> Path | None:
    """Return the folder of the shipped scenes, in a wheel or in a checkout; None if they are not there."""
    package = Path(__file__).parents[1]
    for found in (package / "scenes", package.parents[1] / "scenes"):
        if (found / "four_materials.xml").is_file():
            return found.resolve()
    return None


def names() -> list[str]:
    """Return the paths that may follow ``itouch:``, sorted."""
    found = folder()
    return sorted(path.relative_to(found).as_posix() for path in found.rglob("*.xml")) if found else []
