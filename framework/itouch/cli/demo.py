"""``itouch-py demo``: the four-material scene, from anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import itouch
from itouch.schema import ItouchError


def scenes_folder() -> Path:
    """Return the folder of the shipped scenes, in a wheel or in a checkout.

    Raises
    ------
    ItouchError
        If they are not there.
    """
    package = Path(itouch.__file__).parent
    for folder in (package / "scenes", package.parents[1] / "scenes"):
        if (folder / "four_materials.xml").is_file():
            return folder
    raise ItouchError("the shipped scenes are missing from this installation; install itouch-py again")


def main(argv: Sequence[str]) -> int:
    """Run the four-material scene that comes with the program; takes the options of `itouch-py run`."""
    from itouch.cli.run import main as run

    return run([str(scenes_folder() / "four_materials.xml"), *argv])
