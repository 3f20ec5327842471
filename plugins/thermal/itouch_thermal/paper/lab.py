"""A lab's own curves, to be drawn over the figures."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from itouch_thermal.flux.curve import LARGEST_FILE, Curve, decode_curve
from itouch_thermal.paper.setup import MATERIALS

#: The figures over which such curves are drawn.
SHOWN = frozenset((2, 5, 6, 7, 11))


def left_out(folder: Path, figures: Iterable[int]) -> list[str]:
    """Return messages on what is not shown: files of other names, or everything if none of the figures shows curves."""
    others = sorted(path.name for path in folder.glob("*.csv") if path.stem not in MATERIALS)
    said = [f"--measured: the paper has no {', '.join(others)}; shown are {', '.join(MATERIALS)}"] if others else []
    if not SHOWN.intersection(figures):
        said.append(f"--measured: curves are laid over figures {', '.join(map(str, sorted(SHOWN)))} only")
    return said


def read_curves(folder: Path) -> dict[str, Curve]:
    """Return the curves in a folder whose files are named after a material, such as ``wood.csv``.

    Raises
    ------
    ValueError
        If there is no such folder or file (the message names those expected), or a file is not a curve (with its line).
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
