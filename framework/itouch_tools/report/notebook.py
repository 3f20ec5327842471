"""What a notebook shows of a scene, a session or a recording: a picture, curves, the contacts, what went wrong.

Everything is plain HTML with pictures inside: it stays in the notebook's file and needs no script.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from itouch.recording import Recording
from itouch.scene import Scene
from itouch.schema.units import CELSIUS_OFFSET
from itouch.session import Session
from itouch.world import Model
from itouch_tools.report import columns
from itouch_tools.report.markup import number, table, text

#: Size of a picture [pixels].  Width and height of a curve [pixels], most points of a curve, and most curves shown.
PICTURE = (640, 360)
WIDE, HIGH, POINTS, CURVES = 640, 90, 400, 6


def scene(shown: Scene) -> str:
    """Return what a scene has: its objects, devices and modalities, and a picture if it can be drawn."""
    rows = [["object", each.name, each.material] for each in shown.objects]
    rows += [["device", each.name, each.plugin] for each in shown.devices]
    rows += [["probe", each.name, f"{each.radius * 1e3:g} mm"] for each in shown.probes]
    rows += [["modality", each.name, each.plugin] for each in shown.modalities]
    return _parts(_head(shown.source or "scene"), _compiled(shown), table(("", "name", ""), rows, words=(1, 2)))


def session(shown: Session) -> str:
    """Return the present condition of a session: its picture, the contacts so far, faults and notices."""
    report = shown.report()
    name = f"{report['scene'] or 'session'}, {report['simulated_s']:.3f} s"
    return _parts(_head(name), _picture(shown.model, shown.state), _told(shown.model, report), _list(shown.notices))


def recording(shown: Recording) -> str:
    """Return what a recording holds: its tracks, the first curves, the contacts and what is missing."""
    rows = [(name, len(track), ", ".join((track.dtype.names or ())[2:])) for name, track in shown.items()]
    head = _head(f"{Path(shown.path).name}, {shown.duration:.3f} s")
    report = shown.report or {}
    return _parts(
        head, *_curves(shown), _told(None, report), table(("track", "rows", "columns"), rows, words=(2,)),
        _list(shown.losses),
    )  # fmt: skip


def curve(times: NDArray[np.float64], values: NDArray[np.float64], title: str) -> str:
    """Return a curve as a picture: its title, its range, and the line through the extremes of each stretch.

    Parameters
    ----------
    times, values
        Both of shape (n,), times [s]; what is not finite is a gap.
    title
        What the curve is, with its unit.
    """
    good = np.isfinite(values)
    if not good.any():
        return ""
    low, high = float(values[good].min()), float(values[good].max())
    chosen = _extremes(np.where(good, values, low))
    span, reach = max(float(times[-1] - times[0]), 1e-12), max(high - low, 1e-300)
    x = (times[chosen] - times[0]) / span * (WIDE - 2) + 1
    y = (HIGH - 2) - (values[chosen] - low) / reach * (HIGH - 4)
    lines = np.split(np.arange(len(chosen)), np.flatnonzero(~good[chosen]))
    paths = "".join(
        f'<polyline fill="none" stroke="#0072b2" points="{" ".join(f"{x[k]:.1f},{y[k]:.1f}" for k in part)}"/>'
        for part in (line[good[chosen[line]]] for line in lines) if len(part)
    )  # fmt: skip
    said = f"{text(title)}: {number(low, '.4g')} to {number(high, '.4g')}"
    return (
        f'<div style="font-size:85%">{said}<br><svg role="img" aria-label="{said}" width="{WIDE}" height="{HIGH}" '
        f'style="background:#8881">{paths}</svg></div>'
    )


def _extremes(values: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the indices of the least and the greatest value of each stretch, so that no peak is lost."""
    if len(values) <= POINTS:
        return np.arange(len(values))
    parts = np.array_split(np.arange(len(values)), POINTS // 2)
    return np.unique([place for part in parts for place in (part[values[part].argmin()], part[values[part].argmax()])])


def _curves(shown: Recording) -> Iterable[str]:
    """Yield the first curves: for each unit of a track one channel; of commands what was sent, not what was requested.

    Of a position or a pose the height is shown, of any other vector its magnitude.
    """
    left = CURVES
    for name, track in shown.tracks.items():
        rows, units = shown[name], set[str]()
        for column in track.columns:
            if left == 0 or len(rows) < 2 or name == "session" or not column.unit or column.unit in units:
                continue
            if column.name.startswith("command."):
                continue
            units.add(column.unit)
            values, of = np.asarray(rows[column.name], np.float64), ""
            if values.ndim > 1 and values.shape[1] == 1:
                values = values[:, 0]
            if values.ndim > 1 and column.unit == "m" and values.shape[1] in (3, 7):
                values, of = values.reshape(len(values), -1)[:, 2], "height of "
            elif values.ndim > 1:
                values, of = np.linalg.norm(values.reshape(len(values), -1)[:, :3], axis=1), "size of "
            left -= 1
            unit = "degC" if column.unit == "K" else column.unit  # as on all screens
            values = values - CELSIUS_OFFSET if unit == "degC" else values
            yield curve(rows["time"], values, f"{of}{name}.{column.name} [{unit}]")


def _told(model: Model | None, report: dict[str, Any]) -> str:
    """Return the contacts and the faults of a report."""
    contacts, found = report.get("contacts", []), []
    if contacts and model is not None:
        heads, *rows = columns.rows(model, contacts)
        found.append(table(heads, rows, words=range(1, heads.index("material") + 1)))
    elif contacts:
        keys = ("object", "material", "begin_s", "end_s", "peak_force_N")
        found.append(table(keys, [[number(entry.get(key)) for key in keys] for entry in contacts], words=(1,)))
    found.append(_list(f"fault: {fault.get('cause', fault)}" for fault in report.get("faults", [])))
    return _parts(*found)


def _compiled(shown: Scene) -> str:
    """Return the picture of a scene as it begins; if it can't be compiled the error, if it can't be drawn nothing."""
    from itouch.plugin.discovery import Catalog
    from itouch.schema import ItouchError

    try:
        built = Session.of(shown, catalog=Catalog())
    except ItouchError as error:
        return _list([str(error)])
    try:
        return _picture(built.model, built.state)
    finally:
        built.close()


def _picture(model: Model, state: Any) -> str:
    from itouch_tools.viewer.context import png_of
    from itouch_tools.viewer.offscreen import GraphicsError, Offscreen

    try:
        shots = Offscreen(model, width=PICTURE[0], height=PICTURE[1])
    except GraphicsError:
        return ""
    shots.picture.choices.curves = False
    try:
        drawn = base64.b64encode(png_of(shots.shoot(state))).decode()
    finally:
        shots.close()
    size = f'width="{PICTURE[0]}" height="{PICTURE[1]}"'
    return f'<img alt="the scene" style="display:block" {size} src="data:image/png;base64,{drawn}">'


def _head(name: str) -> str:
    return f"<b>{text(name)}</b>"


def _list(sentences: Iterable[str]) -> str:
    items = "".join(f"<li>{text(sentence)}</li>" for sentence in sentences)
    return f"<ul>{items}</ul>" if items else ""


def _parts(*parts: str) -> str:
    shown: Sequence[str] = [part for part in parts if part]
    return f"<div>{''.join(shown)}</div>" if shown else ""
