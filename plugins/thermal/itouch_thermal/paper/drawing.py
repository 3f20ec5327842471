"""Figures as pictures and tables: legible at the width of a column, with nothing over the curves."""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path
from typing import Any

from itouch_thermal.atomic_write import write_whole
from itouch_thermal.paper.figures import CURRENT, Figure, Line, Panel
from itouch_thermal.paper.sketches import SKETCHES

#: Width of a column and height of a panel [inch], dots per inch.
WIDTH, HEIGHT, DPI = 3.5, 2.55, 220
_STYLE: dict[Any, Any] = {
    "font.size": 8.0, "axes.titlesize": 8.5, "axes.labelsize": 8.0, "xtick.labelsize": 7.5, "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5, "axes.linewidth": 0.7, "svg.hashsalt": "itouch-py",
}  # fmt: skip


def draw(figure: Figure, out: Path, seconds: float) -> None:
    """Draw a figure as SVG and PNG into a folder, with curves up to ``seconds``."""
    try:
        import matplotlib
    except ImportError as missing:
        raise ValueError("figures need matplotlib: pip install 'itouch-py[plot]'") from missing
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context(_STYLE):
        picture = _panels(plt, figure, seconds) if figure.panels else _sketch(plt, figure)
        for ending in ("svg", "png"):
            still: dict[str, Any] = {"Date": None} if ending == "svg" else {"Software": None}
            drawn = BytesIO()
            picture.savefig(drawn, format=ending, dpi=DPI, metadata=still)
            write_whole(out / f"{figure.stem}.{ending}", drawn.getvalue())
        plt.close(picture)


def _panels(plt: Any, figure: Figure, seconds: float) -> Any:
    count = len(figure.panels)
    picture, found = plt.subplots(count, 1, figsize=(WIDTH, HEIGHT * count), layout="constrained", squeeze=False)
    for axes, panel in zip(found[:, 0], figure.panels, strict=True):
        _panel(axes, panel, seconds)
    return picture


def _panel(axes: Any, panel: Panel, seconds: float) -> None:
    axes.set_xlabel("time [s]")
    axes.set_ylabel(panel.left)
    axes.grid(alpha=0.35, linewidth=0.5)
    if panel.logarithmic:
        axes.set_xscale("log")
    drawn = []
    if any(line.right for line in panel.lines):
        other = axes.twinx()
        other.set_ylabel(CURRENT)
        axes.set_zorder(other.get_zorder() + 1)  # the flux is drawn over the current
        axes.patch.set_visible(False)
    for line in panel.lines:
        where = other if line.right else axes
        drawn += where.plot(
            line.times, line.values, color=line.color, ls=line.style, lw=line.width, label=line.name,
            alpha=0.75 if line.right else 1.0,
        )  # fmt: skip
    last = max(float(line.times[-1]) for line in panel.lines)
    axes.set_xlim(float(panel.lines[0].times[0]) if panel.logarithmic else 0.0, min(last, _shown(panel, seconds)))
    if any(line.right for line in panel.lines):
        largest = max(float(abs(line.values).max()) for line in panel.lines if line.right)
        other.set_ylim(-1.15 * largest, 1.15 * largest)
    axes.set_title(panel.title)
    if len(drawn) > 1:
        widest = max(len(line.get_label()) for line in drawn)
        columns = min(len(drawn), 4 if widest <= 6 else 3 if widest <= 12 else 2)
        rows = -(-len(drawn) // columns)
        axes.set_title(panel.title, pad=8.0 + 12.0 * rows)
        axes.legend(
            drawn, [line.get_label() for line in drawn], loc="lower center", bbox_to_anchor=(0.5, 1.0),
            ncol=columns, frameon=False, columnspacing=1.0, handlelength=1.9, handletextpad=0.5,
            borderaxespad=0.2,
        )  # fmt: skip


def _shown(panel: Panel, seconds: float) -> float:
    """Return the end of a panel's time axis [s]: a touch that begins at 1 s is shown for as long as the others."""
    first = panel.lines[0].times
    return seconds + (1.0 if first[0] == 0.0 and len(first) > 1 and first[1] == 1.0 else 0.0)


def _sketch(plt: Any, figure: Figure) -> Any:
    picture, axes = plt.subplots(figsize=(WIDTH, HEIGHT * 1.25), layout="constrained")
    axes.set_axis_off()
    axes.set_xlim(0.0, 10.0)
    axes.set_ylim(0.0, 9.0)
    SKETCHES[figure.number](axes)
    return picture


def write_curves(figure: Figure, folder: Path) -> int:
    """Write every curve of a figure as a CSV file with a header; return the number of files."""
    count = 0
    for k, panel in enumerate(figure.panels):
        for line in panel.lines:
            stem = f"{figure.stem}{chr(97 + k) if len(figure.panels) > 1 else ''}-{_slug(line.name)}"
            write_whole(folder / f"{stem}.csv", _rows(figure, panel, line))
            count += 1
    return count


def _slug(name: str) -> str:
    """Return a name as a part of a file name; a leading sign stays, so that -8 K differs from 8 K."""
    return re.sub(r"[^a-z0-9+-]+", " ", name.lower()).strip().replace(" ", "-")


def _rows(figure: Figure, panel: Panel, line: Line) -> str:
    head = [f"# figure {figure.number}: {figure.caption}", f"# {panel.title}: {line.name}"]
    head += [f"# {told}" for told in figure.differences]
    rows = [f"{t:.9g},{v:.9g}" for t, v in zip(line.times.tolist(), line.values.tolist(), strict=True)]
    return "\n".join([*head, f"t [s],{line.column}", *rows, ""])
