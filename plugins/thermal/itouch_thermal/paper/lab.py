"""A lab's own curves, to be laid over the figures."""

from __future__ import annotations

from pathlib import Path

from itouch_thermal.flux.curve import LARGEST_FILE, Curve, decode_curve
from itouch_thermal.paper.setup import MATERIALS


def read_curves(folder: Path) -> dict[str, Curve]:
    """Return the curves of a folder that are named after a material, such as ``wood.csv``.

    Raises
    ------
    ValueError
        If there is no such folder or file, naming what is looked for; or a file is no curve, with its line.
    """
    wanted = ", ".join(f"{name}.csv" for name in MATERIALS)
    if not folder.is_dir():
        raise ValueError(f"--measured '{folder}' is no folder; it should hold one or more of {wanted}")
    found: dict[str, Curve] = {}
    for name in MATERIALS:
        path = folder / f"{name}.csv"
        if path.is_file():
            with path.open("rb") as stream:
                data = stream.read(LARGEST_FILE + 1)
            if len(data) > LARGEST_FILE:
                raise ValueError(f"'{path}' is larger than {LARGEST_FILE >> 20} MiB")
            found[name] = decode_curve(data, str(path))
    if not found:
        raise ValueError(f"--measured '{folder}' holds none of {wanted}")
    return found
