"""One self-contained page of a session: no network, plots by Plotly, readable on a phone and on paper."""

from __future__ import annotations

import base64
import html
import json
import math
import os
import tempfile
from importlib.resources import files
from typing import Any

import numpy as np

from itouch.report.collect import Curves, Findings
from itouch.schema import ItouchError

#: Colours of curves on white, told apart with and without colour-blindness (Okabe and Ito 2008).
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
_CONTACTS = (
    ("object", "object", "", 1.0), ("material", "material", "", 1.0), ("begin_s", "begin [s]", ".3f", 1.0),
    ("end_s", "end [s]", ".3f", 1.0), ("peak_force_N", "peak force [N]", ".2f", 1.0),
    ("plate_gap_mm", "plate gap [mm]", ".3f", 1.0), ("mean_flux_W_m2", "mean flux [W/m2]", ".0f", 1.0),
    ("skin_drop_K", "skin drop [K]", ".2f", 1.0), ("flux_error_rms", "flux error rms [%]", ".1f", 100.0),
)  # fmt: skip


def page(findings: Findings, *, picture: bytes | None = None) -> str:
    """Return the page as HTML; ``picture`` is a PNG of the scene.

    Raises
    ------
    ItouchError
        If Plotly is not installed.
    """
    parts = [
        _head(findings), _cards(findings), _faults(findings), _contacts(findings), _curves(findings), _picture(picture),
        _timing(findings), _provenance(findings),
    ]  # fmt: skip
    data = json.dumps(_data(findings), allow_nan=False, separators=(",", ":")).replace("</", "<\\/")
    here = files("itouch.report")
    style, script = (here.joinpath(name).read_text("utf-8") for name in ("page.css", "page.js"))
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<link rel="icon" href="data:,">\n'
        f"<title>{html.escape(findings.title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(part for part in parts if part)
        + f'\n</main>\n<script id="data" type="application/json">{data}</script>\n'
        f"<script>{_plotly()}</script>\n<script>\n{script}</script>\n</body>\n</html>\n"
    )


def _plotly() -> str:
    try:
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise ItouchError("the page needs Plotly: pip install 'itouch-py[report]'") from None
    return str(get_plotlyjs())


def _head(findings: Findings) -> str:
    source = findings.provenance.get("scene") or ""
    return (
        f"<header><h1>{html.escape(findings.title)}</h1>"
        f'<p class="soft">{findings.kind} of {html.escape(os.path.basename(str(source)))}</p>'
        '<div class="controls"><button id="print" type="button">Print or save as PDF</button></div></header>'
    )


def _cards(findings: Findings) -> str:
    cards = "".join(
        f'<div class="card"><b>{html.escape(str(value))}</b><span>{html.escape(name)}</span></div>'
        for name, value in findings.summary.items()
    )
    notes = "".join(f'<p class="bad">{html.escape(loss)}</p>' for loss in findings.losses)
    notes += "".join(f'<p class="soft">{html.escape(notice)}</p>' for notice in findings.notices)
    return f'<section class="cards">{cards}</section>{notes}'


def _faults(findings: Findings) -> str:
    if not findings.faults:
        return '<h2>Faults</h2>\n<p class="good">none</p>'
    rows = [
        [f"{fault.get('time_s', fault.get('time', 0.0)):.3f}", fault.get("device", ""), fault.get("trip", ""),
         fault.get("cause", ""), fault.get("scene") or ""]
        for fault in findings.faults
    ]  # fmt: skip
    return "<h2>Faults</h2>\n" + _table(["time [s]", "device", "trip", "cause", "scene"], rows, words=(1, 2, 3, 4))


def _contacts(findings: Findings) -> str:
    if not findings.contacts:
        return '<h2>Contacts</h2>\n<p class="soft">none</p>'
    rows = [
        [_cell(contact.get(key), form, scale) for key, _, form, scale in _CONTACTS] for contact in findings.contacts
    ]
    return "<h2>Contacts</h2>\n" + _table([title for _, title, _, _ in _CONTACTS], rows, words=(1,), choices=True)


def _cell(value: Any, form: str, scale: float) -> str:
    if value is None:
        return "-"
    return format(value * scale, form) if form else str(value)


def _table(heads: list[str], rows: list[list[str]], *, words: tuple[int, ...] = (), choices: bool = False) -> str:
    mark = [' class="words"' if index in words else "" for index in range(len(heads))]
    head = "".join(f"<th{m}>{html.escape(text)}</th>" for m, text in zip(mark, heads, strict=True))
    row_tag = '<tr class="choice" tabindex="0">' if choices else "<tr>"
    body = "".join(
        row_tag + "".join(f"<td{m}>{html.escape(str(cell))}</td>" for m, cell in zip(mark, row, strict=True)) + "</tr>"
        for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _curves(findings: Findings) -> str:
    curves = findings.curves
    if curves is None:
        return '<h2>Curves</h2>\n<p class="soft">a snapshot holds one moment; a recording holds the curves</p>'
    options = '<option value="-1">the whole session</option>' + "".join(
        f'<option value="{index}">{html.escape(contact["object"])}, {contact["begin_s"]:.1f} s</option>'
        for index, contact in enumerate(findings.contacts)
    )
    plots = "".join(f'<div class="plot" id="chart{index}"></div>' for index in range(len(curves.charts)))
    controls = (
        f'<div class="controls"><label>show <select id="which">{options}</select></label>'
        '<button id="all" type="button">the whole session</button></div>'
    )
    return f"<h2>Curves</h2>\n{controls}\n{plots}"


def _picture(picture: bytes | None) -> str:
    if picture is None:
        return ""
    image = base64.b64encode(picture).decode()
    return f'<h2>Scene</h2>\n<img alt="the scene at the end of the session" src="data:image/png;base64,{image}">'


def _timing(findings: Findings) -> str:
    plain = {name: value for name, value in findings.timing.items() if isinstance(value, (int, float, str))}
    nested = {f"{name} {key}": value for name, inner in findings.timing.items() if isinstance(inner, dict)
              for key, value in inner.items() if isinstance(value, (int, float))}  # fmt: skip
    rows = [[name.replace("_", " "), _number(value)] for name, value in (plain | nested).items()]
    plots = "".join(f'<div class="plot" id="histogram{index}"></div>' for index in range(len(_histograms(findings))))
    return "<h2>Timing</h2>\n" + (_table(["figure", "value"], rows) if rows else "") + plots


def _number(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _provenance(findings: Findings) -> str:
    rows = [[name, str(value)] for name, value in findings.provenance.items()]
    marks = ""
    if findings.marks:
        told = [[f"{mark.get('time', 0.0):.3f}", str(mark.get("name", "")), str(mark.get("payload", ""))]
                for mark in findings.marks]  # fmt: skip
        marks = "<h2>Marks</h2>\n" + _table(["time [s]", "mark", "payload"], told, words=(1, 2))
    return (
        marks + "<h2>Parameters and provenance</h2>\n" + _table(["what", "value"], rows, words=(1,))
        + f"<details><summary>The scene that ran</summary><pre>{html.escape(findings.scene_xml)}</pre></details>"
    )  # fmt: skip


def _histograms(findings: Findings) -> list[dict[str, Any]]:
    found = []
    for name, value in findings.timing.items():
        if isinstance(value, dict) and {"edges", "counts"} <= value.keys():
            found.append({"title": name.replace("_", " "), "unit": "us", **value})
    return found


def _data(findings: Findings) -> dict[str, Any]:
    curves = findings.curves
    spans = [[c["begin_s"], c["end_s"] if c["end_s"] is not None else c["begin_s"] + 1.0] for c in findings.contacts]
    if curves is None:
        return {"times": [], "charts": [], "spans": spans, "histograms": _histograms(findings)}
    return {
        "times": _rounded(curves.times, 7), "charts": _charts(curves), "spans": spans,
        "histograms": _histograms(findings),
    }  # fmt: skip


def _charts(curves: Curves) -> list[dict[str, Any]]:
    made, row = [], 0
    for chart in curves.charts:
        signals = []
        for index, signal in enumerate(chart.signals):
            values = _rounded(curves.values[row], 6)
            signals.append({"label": signal.label, "colour": _COLOURS[index % len(_COLOURS)], "values": values})
            row += 1
        made.append({"title": chart.title, "unit": chart.unit, "signals": signals})
    return made


def _rounded(values: np.ndarray[Any, np.dtype[np.float64]], digits: int) -> list[float | None]:
    return [float(f"{value:.{digits}g}") if math.isfinite(value) else None for value in values]


def scene_picture(findings: Findings) -> bytes | None:
    """Return a PNG of the last State, or None where there is no OpenGL."""
    if findings.model is None or findings.state is None:
        return None
    from itouch.viewer.offscreen import GraphicsError, Offscreen, write_png

    try:
        shots = Offscreen(findings.model, width=960, height=540)
    except GraphicsError:
        return None
    shots.picture.choices.curves = False
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "scene.png")
        write_png(path, shots.shoot(findings.state))
        shots.close()
        with open(path, "rb") as stream:
            return stream.read()
