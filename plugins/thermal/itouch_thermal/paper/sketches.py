"""Figures that are drawings: the set-up of a real touch, the layers of the contact, the steps of the simulation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_FILLS = {"finger": "#f3d4c0", "blood": "#eab8a6", "film": "#d9a441", "body": "#c9d3dc", "dark": "#8794a1"}


def _slab(axes: Any, low: float, high: float, fill: str, label: str, *, left: float = 1.0, right: float = 9.0) -> None:
    axes.fill_between((left, right), low, high, facecolor=_FILLS[fill], edgecolor="black", linewidth=0.7)
    axes.text(0.5 * (left + right), 0.5 * (low + high), label, ha="center", va="center")


def _rig(axes: Any) -> None:
    axes.set_title("Real touch: film above, force below the sample")
    _slab(axes, 6.2, 8.6, "finger", "fingertip\n(skin temperature\nby infrared before)", left=2.2, right=7.8)
    _slab(axes, 5.7, 6.2, "film", "flux and temperature film")
    _slab(axes, 2.6, 5.7, "body", "sample, 20 mm, at the room's temperature")
    _slab(axes, 1.8, 2.6, "dark", "force sensor", left=3.4, right=6.6)
    _slab(axes, 1.0, 1.8, "body", "table")


def _layers(axes: Any) -> None:
    axes.set_title("Contact system")
    for low, high, fill, label in (
        (7.6, 8.6, "blood", "core, 37 °C held"),
        (6.4, 7.6, "blood", "subcutis 4.4 mm, blood"),
        (5.4, 6.4, "blood", "dermis 1.5 mm, blood"),
        (4.6, 5.4, "finger", "epidermis 0.7 mm"),
        (3.8, 4.3, "film", "flux film 37.5 µm"),
        (1.4, 3.8, "body", "sample 20 mm"),
    ):
        _slab(axes, low, high, fill, label)
    axes.text(5.0, 4.45, "contact resistance", ha="center", va="center", style="italic")
    axes.text(5.0, 0.95, "air, 10 W/m²K", ha="center", va="center")


def _box(axes: Any, x: float, y: float, width: float, height: float, label: str) -> None:
    from matplotlib.patches import FancyBboxPatch

    axes.add_patch(
        FancyBboxPatch(
            (x - 0.5 * width, y - 0.5 * height),
            width,
            height,
            boxstyle="round,pad=0,rounding_size=0.15",
            facecolor="#eef2f7",
            edgecolor="black",
            linewidth=0.7,
        )  # fmt: skip
    )
    axes.text(x, y, label, ha="center", va="center", fontsize=7.0)


def _arrow(axes: Any, *points: tuple[float, float]) -> None:
    """Draw straight segments, the last one with an arrowhead."""
    for a, b in zip(points[:-2], points[1:-1], strict=True):
        axes.plot((a[0], b[0]), (a[1], b[1]), color="black", linewidth=0.8)
    axes.annotate(
        "", xy=points[-1], xytext=points[-2], arrowprops={"arrowstyle": "-|>", "lw": 0.8, "shrinkA": 0, "shrinkB": 0}
    )


def _loop(axes: Any) -> None:
    axes.set_title("Simulation, one iteration")
    _box(axes, 5.0, 8.2, 8.4, 1.1, "materials, sizes, object's temperature,\nskin temperature (infrared)")
    _box(axes, 2.6, 6.0, 3.6, 1.5, "problem 1\nanalytic (eqs 7, 9)\n$T_1$, $j_{contact1}$")
    _box(axes, 7.4, 6.0, 3.6, 1.5, "problem 2\ndifferences (eqs 4–6)\n$T_2$")
    _box(axes, 5.0, 3.6, 3.4, 1.0, "$T = T_1 + T_2$")
    _box(axes, 5.0, 1.5, 5.2, 1.2, "boundary flux, eq. 10\n$j_{contact2} = \\Delta T/R_{th} - j_{contact1}$")
    _arrow(axes, (2.6, 7.65), (2.6, 6.75))
    _arrow(axes, (7.4, 7.65), (7.4, 6.75))
    _arrow(axes, (2.6, 5.25), (2.6, 3.6), (3.3, 3.6))
    _arrow(axes, (7.4, 5.25), (7.4, 3.6), (6.7, 3.6))
    _arrow(axes, (5.0, 3.1), (5.0, 2.1))
    _arrow(axes, (7.6, 1.5), (9.6, 1.5), (9.6, 6.0), (9.2, 6.0))
    axes.text(9.45, 2.6, "next iteration", ha="right", va="center", fontsize=7.0)
    _arrow(axes, (3.3, 3.35), (0.5, 3.35), (0.5, 1.9))
    axes.text(0.2, 1.35, "flux out,\ntemperatures", ha="left", va="center", fontsize=7.0)


SKETCHES: dict[int, Callable[[Any], None]] = {1: _rig, 8: _layers, 10: _loop}
