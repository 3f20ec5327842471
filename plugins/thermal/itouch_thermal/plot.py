"""Plots of solved contacts; needs matplotlib, an optional extra."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from contact_heat.table import Table
from itouch_thermal.atomic_write import write_whole


def plot_table(table: Table, path: Path, title: str) -> None:
    """Draw flux and temperatures over time into a PNG file.

    Raises
    ------
    ImportError
        If matplotlib is missing; the message says what to install.
    OSError
        If the file cannot be written; an earlier one stays as it was.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise ImportError("plots need matplotlib: pip install 'itouch-py[plot]'") from None
    figure = Figure(figsize=(7.2, 7.2), layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1, sharex=True)
    times = table.columns["t"]
    fluxes = {name: values for name, values in table.columns.items() if name in table.fluxes}
    _draw_fluxes(upper, times, fluxes)
    for name, values in table.columns.items():
        if name not in (*fluxes, "t", "Q"):
            lower.plot(times, values, label=name)
    upper.set(title=title, ylabel="flux [W/m²]", xscale="log", yscale="log")
    lower.set(xlabel="time since the touch [s]", ylabel="temperature [°C]", xscale="log")
    for axes in (upper, lower):
        axes.grid(visible=True, which="major", alpha=0.4)
        axes.legend(fontsize="small")
    drawn = BytesIO()
    figure.savefig(drawn, format="png", dpi=150)
    write_whole(path, drawn.getvalue())


def _draw_fluxes(axes: Any, times: Any, fluxes: dict[str, Any]) -> None:
    """Draw magnitudes; the line is dashed where heat enters the finger."""
    floor = max(max(float(np.abs(values).max()) for values in fluxes.values()) * 1e-6, 1e-3)
    for name, values in fluxes.items():
        size = np.where(np.abs(values) >= floor, np.abs(values), np.nan)
        (line,) = axes.plot(times, np.where(values >= 0.0, size, np.nan), label=name)
        if np.any(values <= -floor):
            axes.plot(times, np.where(values < 0.0, size, np.nan), "--", color=line.get_color(), label=f"{name} < 0")
