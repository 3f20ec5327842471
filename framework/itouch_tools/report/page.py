"""One self-contained page of a session: small, no network, readable on a phone, on paper and in the dark."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import tempfile
from importlib.resources import files
from typing import Any

from itouch.loop.timing import merged
from itouch_tools.report import sections
from itouch_tools.report.collect import Findings
from itouch_tools.report.markup import text
from itouch_tools.report.packing import Packer

#: Contacts that are drawn one by one; more of them are reached by choosing them.
MOST_DRAWN = 12
_HISTOGRAMS = (("tick", "duration of a tick"), ("lateness", "how late ticks began"))


def page(findings: Findings, *, picture: bytes | None = None) -> str:
    """Return the page as HTML; ``picture`` is a PNG of the scene.

    Its own scripts are the only ones that a browser runs, and it may ask for nothing: its policy says so, with their
    digests.
    """
    data = _data(findings)
    parts = [
        sections.head(findings), sections.answer(findings), sections.summary(findings),
        sections.picture(picture, touching=findings.touching),
        sections.faults(findings), sections.contacts(findings), _curves(findings), sections.meanings(findings),
        sections.timing(findings, len(data["histograms"])),
        sections.marks(findings), sections.parameters(findings),
    ]  # fmt: skip
    here = files("itouch_tools.report")
    style, *scripts = (here.joinpath(name).read_text("utf-8") for name in ("page.css", "charts.js", "page.js"))
    packed = json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_policy(scripts)}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<link rel="icon" href="data:,">\n'
        f"<title>{text(_title(findings))}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(part for part in parts if part)
        + f'\n</main>\n<script id="data" type="application/json">{packed}</script>\n'
        + "\n".join(f"<script>{script}</script>" for script in scripts)
        + "\n</body>\n</html>\n"
    )


def _title(findings: Findings) -> str:
    """Return what a tab of a browser shows: what it is of, then the file."""
    source = os.path.basename(str(findings.provenance.get("scene") or "")).removesuffix(".xml")
    count = len(findings.contacts)
    said = f"{count} contact" if count == 1 else f"{count} contacts"
    return f"{source}: {said} ({findings.title})" if source else f"{said} ({findings.title})"


def _policy(scripts: list[str]) -> str:
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in digests)
    return f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'"


def _curves(findings: Findings) -> str:
    curves = findings.curves
    if curves is None:
        return '<h2>Curves</h2>\n<p class="soft">a snapshot holds one moment; a recording holds the curves</p>'
    options = '<option value="-1">the whole session</option>' + "".join(
        f'<option value="{index}">{text(_named(contact))}</option>'
        for index, contact in enumerate(findings.contacts[: len(curves.contacts)])
    )
    plots = "".join(f'<div class="plot" id="chart{index}"></div>' for index in range(len(curves.charts)))
    made = (
        '<h2>Curves</h2>\n<div class="controls"><span class="steps">'
        '<button id="before" type="button" aria-label="the contact before">◀</button>'
        f'<label>show <select id="which">{options}</select></label>'
        '<button id="after" type="button" aria-label="the next contact">▶</button></span>'
        '<button id="all" type="button">the whole session</button>'
        f'<label>at <input id="cursor" type="range" aria-label="time of the cursor"></label></div>\n'
        '<p class="soft">Point at a curve for its values at that time in all charts; drag to look closer, '
        f"double-click to see all again; a name takes its curve away.</p>\n{plots}"
    )
    return made + _one_by_one(findings, len(curves.charts), min(len(curves.contacts), MOST_DRAWN))


def _one_by_one(findings: Findings, charts: int, drawn: int) -> str:
    if drawn == 0:
        return ""
    count = len(findings.contacts)
    note = f'<p class="soft">the first {drawn} of {count}; choose others above</p>' if drawn < count else ""
    made = f"<h2>Contact by contact</h2>\n{note}"
    for index, contact in enumerate(findings.contacts[:drawn]):
        plots = "".join(f'<div class="small" id="contact{index}-{chart}"></div>' for chart in range(charts))
        made += f'\n<section class="contact"><h3>{text(_named(contact))}</h3><div class="grid">{plots}</div></section>'
    return made


def _named(contact: dict[str, Any]) -> str:
    end = f"{contact['end_s']:.1f} s" if contact["end_s"] is not None else "the end"
    material = f" ({contact['material']})" if contact.get("material") not in (None, contact["object"]) else ""
    return f"{contact['probe']} on {contact['object']}{material}, {contact['begin_s']:.1f} s to {end}"


def _data(findings: Findings) -> dict[str, Any]:
    curves = findings.curves
    histograms = findings.timing.get("histograms_us")
    made = merged_histograms(histograms if isinstance(histograms, dict) else {})
    spans = [[contact["begin_s"], contact["end_s"]] for contact in findings.contacts]
    if curves is None:
        return {"charts": [], "spans": spans, "histograms": made}
    charts = [
        {"title": chart.title, "unit": chart.unit,
         "signals": [{"label": line.label, "wish": line.wish, "doc": line.doc} for line in chart.lines]}
        for chart in curves.charts
    ]  # fmt: skip
    packer = Packer()
    whole = packer.add(curves.whole, float(curves.whole.times[0]) if len(curves.whole.times) else 0.0)
    contacts = [packer.add(block, span[0]) for block, span in zip(curves.contacts, spans, strict=False)]
    return {"charts": charts, "whole": whole, "contacts": contacts, "spans": spans, "drawn": MOST_DRAWN,
            "histograms": made, "packed": packer.text()}  # fmt: skip


def merged_histograms(histograms: dict[str, Any]) -> list[dict[str, Any]]:
    """Return what is drawn of the loop's histograms: titles, edges [us] and counts."""
    found = []
    for name, title in _HISTOGRAMS:
        bins = merged([histograms.get(name)])
        if bins:
            found.append({"title": title, "bins": bins})
    return found


def scene_picture(findings: Findings) -> bytes | None:
    """Return the State as a PNG on a light ground, or None where there is no OpenGL."""
    if findings.model is None or findings.state is None:
        return None
    from itouch_tools.viewer.context import write_png
    from itouch_tools.viewer.offscreen import GraphicsError, Offscreen

    try:
        shots = Offscreen(findings.model, width=960, height=540)
    except GraphicsError:
        return None
    shots.picture.choices.curves, shots.picture.choices.light = False, True
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "scene.png")
        write_png(path, shots.shoot(findings.state))
        shots.close()
        with open(path, "rb") as stream:
            return stream.read()
