"""One self-contained page of a session: small, needs no network, readable on a phone, on paper and in the dark."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import zlib
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from itouch.loop.timing import merged
from itouch_tools.report import sections
from itouch_tools.report.collect import Findings
from itouch_tools.report.curves import Block

if TYPE_CHECKING:
    from jinja2 import Template

#: Contacts that are drawn at once, each by itself; the others are drawn when they are chosen.
MOST_DRAWN = 12
_HISTOGRAMS = (("tick", "duration of a tick"), ("lateness", "how late ticks began"))

#: The integer that stands for NaN; numbers are -32767 to 32767.
_NOTHING, _MOST = -32768, 32767


class Packer:
    """Packs curves: 16-bit integers, as differences, deflated, all in one base64 text.

    Their samples go into one stream, and a few numbers say where each stretch lies in it.  A page is for looking: a
    step of 1/65534 of a curve's range is far below a pixel.  The recording keeps what was recorded.
    """

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self._size = 0

    def add(self, block: Block, begin: float) -> dict[str, Any]:
        """Take a stretch, its times counted from ``begin`` [s]; return what the page needs to find it again.

        Returns
        -------
        dict
            ``begin`` [s]; ``at``, its first byte in the stream; ``count``, the number of its samples; and ``rows``, the
            least value and the step of the times and of each signal.
        """
        rows = [block.times - begin, *block.values]
        return {"begin": begin, "at": self._size, "count": len(block.times), "rows": [self._row(row) for row in rows]}

    def _row(self, values: NDArray[np.floating[Any]]) -> list[float]:
        values = np.asarray(values, np.float64)
        known = np.isfinite(values)
        low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 0.0)
        step = (high - low) / (2 * _MOST) or 1.0
        with np.errstate(invalid="ignore"):
            whole = np.where(known, np.rint((values - low) / step) - _MOST, _NOTHING)
        bits = np.asarray(np.nan_to_num(whole), np.int64).astype(np.int16).view(np.uint16)
        change = np.diff(bits, prepend=np.uint16(0)).astype("<u2")  # differences wrap around, and so do their sums
        data = change.view(np.uint8).reshape(-1, 2).T.tobytes()
        self._pieces.append(data)
        self._size += len(data)
        return [low, step]

    def text(self) -> str:
        """Return the stream: for each row all low bytes, then all high bytes; deflated, as base64."""
        return base64.b64encode(zlib.compress(b"".join(self._pieces), 9)).decode()


def page(findings: Findings, *, picture: bytes | None = None) -> str:
    """Return the page as HTML; ``picture`` is a PNG of the scene.

    A browser runs no scripts but the page's own and loads nothing from elsewhere: its content security policy, with the
    scripts' digests, forbids it.  Needs Jinja2 (extra ``report``).
    """
    data = _data(findings)
    here = files("itouch_tools.report")
    style, *scripts = (here.joinpath(name).read_text("utf-8") for name in ("page.css", "charts.js", "page.js"))
    return _template().render(
        policy=_policy(scripts), title=_title(findings), style=style, scripts=scripts,
        data=json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        head=sections.head(findings), answer=sections.answer(findings), summary=findings.summary.items(),
        losses=findings.losses, notices=findings.notices,
        picture=sections.picture(picture, touching=findings.touching), faults=sections.faults(findings),
        contacts=sections.contacts(findings), curves=_curves(findings), meanings=sections.meanings(findings),
        timing=sections.timing(findings, len(data["histograms"])), marks=sections.marks(findings),
        parameters=sections.parameters(findings),
    )  # fmt: skip


def _template() -> Template:
    """Return the page's template: every text that is put into it is escaped, and a missing name is an error."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, finalize=_writable, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(files("itouch_tools.report").joinpath("page.html").read_text("utf-8"))


def _writable(value: object) -> object:
    """Return a value as text that can be written as UTF-8, with ``?`` for lone surrogates; markup stays as it is."""
    return value if hasattr(value, "__html__") else str(value).encode("utf-8", "replace").decode()


def _title(findings: Findings) -> str:
    """Return the title that a browser's tab shows: the scene, the number of contacts, then the file."""
    source = os.path.basename(str(findings.provenance.get("scene") or "")).removesuffix(".xml")
    count = len(findings.contacts)
    said = f"{count} contact" if count == 1 else f"{count} contacts"
    return f"{source}: {said} ({findings.title})" if source else f"{said} ({findings.title})"


def _policy(scripts: list[str]) -> str:
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in digests)
    return f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'"


def _curves(findings: Findings) -> dict[str, Any] | None:
    """Return the number of charts, the contacts that can be chosen, those drawn at once, and how many there are."""
    curves = findings.curves
    if curves is None:
        return None
    names = [_named(contact) for contact in findings.contacts[: len(curves.contacts)]]
    return {
        "charts": len(curves.charts),
        "contacts": names,
        "drawn": names[:MOST_DRAWN],
        "many": len(findings.contacts),
    }


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
        {"title": chart.title, "unit": chart.unit, "least": chart.least,
         "signals": [{"label": line.label, "wish": line.wish, "doc": line.doc} for line in chart.lines]}
        for chart in curves.charts
    ]  # fmt: skip
    packer = Packer()
    whole = packer.add(curves.whole, float(curves.whole.times[0]) if len(curves.whole.times) else 0.0)
    contacts = [packer.add(block, span[0]) for block, span in zip(curves.contacts, spans, strict=False)]
    return {"charts": charts, "whole": whole, "contacts": contacts, "spans": spans, "drawn": MOST_DRAWN,
            "histograms": made, "packed": packer.text()}  # fmt: skip


def merged_histograms(histograms: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the loop's histograms as they are drawn: titles, edges [us] and counts."""
    found = []
    for name, title in _HISTOGRAMS:
        bins = merged([histograms.get(name)])
        if bins:
            found.append({"title": title, "bins": bins})
    return found


def scene_picture(findings: Findings) -> bytes | None:
    """Return a picture of the State as a PNG on a light background; None without a State or without OpenGL."""
    if findings.model is None or findings.state is None:
        return None
    from itouch_tools.viewer.context import png_of
    from itouch_tools.viewer.offscreen import GraphicsError, Offscreen

    try:
        shots = Offscreen(findings.model, width=960, height=540)
    except GraphicsError:
        return None
    shots.picture.choices.curves, shots.picture.choices.light = False, True
    try:
        return png_of(shots.shoot(findings.state))
    finally:
        shots.close()
