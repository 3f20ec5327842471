"""The parts of a session's page, each as markup."""

from __future__ import annotations

import base64
import math
import os
from typing import Any

from itouch_tools.report import columns
from itouch_tools.report.collect import Findings
from itouch_tools.report.columns import measured
from itouch_tools.report.limits import limit_rows
from itouch_tools.report.markup import flattened, number, table, text

#: Columns of the table of contacts, before those of the modalities: key of the report, title, form, scale.
_CONTACTS = (
    ("probe", "probe", "", 1.0), ("object", "object", "", 1.0), ("material", "material", "", 1.0),
    ("begin_s", "begin [s]", ".3f", 1.0), ("end_s", "end [s]", ".3f", 1.0),
    ("impact_speed_m_s", "impact [mm/s]", ".0f", 1e3), ("peak_force_N", "peak force felt [N]", ".2f", 1.0),
    ("plate_gap_mm", "plate gap [mm]", ".3f", 1.0), ("plate_lead_ms", "plate lead [ms]", ".0f", 1.0),
)  # fmt: skip
_TEXTS = ("probe", "object", "material")
#: What those columns are that do not say it themselves.
_MEANT = {
    "impact_speed_m_s": "speed of the finger towards the surface when the touch began",
    "peak_force_N": "greatest force on the finger, of arm and plate together",
    "plate_gap_mm": "height of the virtual surface over the plate's top when the touch began",
    "plate_lead_ms": "how long before the virtual touch the finger met the plate; below 0: after it",
}
#: Most sentences below the table of contacts.
_REMARKS = 12
#: Figures of a tick, in the order in which they are shown.
_PERCENTILES = ("p50", "p99", "p99.9", "max")


def head(findings: Findings) -> str:
    """Return the title, what it is of, and the buttons."""
    source = os.path.basename(str(findings.provenance.get("scene") or ""))
    kind = f"{findings.kind} {findings.title} of {source}" if source else findings.kind
    told = ", ".join(part for part in (kind, findings.provenance.get("begin")) if part)
    return (
        f'<header><h1>{text(source.removesuffix(".xml") or findings.title)}</h1><p class="soft">{text(told)}</p>'
        '<div class="controls"><button id="print" type="button">Print or save as PDF</button></div></header>'
    )


def answer(findings: Findings) -> str:
    """Return one sentence: what was touched, how strongly it was felt, and what went wrong."""
    touched = list(dict.fromkeys(str(contact["object"]) for contact in findings.contacts))
    if touched:
        named = ", ".join(touched[:6]) + (f" and {len(touched) - 6} more" if len(touched) > 6 else "")
        parts = [f"touched: {named}"]
    else:
        parts = ["nothing was touched"]
    said = [f"{name}: {value}" for name, value in findings.summary.items() if name == "greatest force felt"]
    wrong = f"{len(findings.faults)} faults, told below" if findings.faults else "no fault"
    lost = ["not all of it was kept"] if findings.losses else []
    twins = [device.twin for device in findings.model.devices.values()] if findings.model is not None else []
    kind = ["all devices were simulated"] if twins and all(twins) else []
    short = [(str(c["object"]), why) for c in findings.contacts if (why := columns.shortcomings(findings.model, c))]
    named = ", ".join(f"{name} ({', '.join(why)})" for name, why in short[:4]) + (", ..." if len(short) > 4 else "")
    plain = f'<p class="answer">{text("; ".join([*parts, *said, wrong, *lost, *kind]))}</p>'
    if not short:
        return plain
    count = f"{len(short)} of {len(findings.contacts)} contacts"
    return plain + f'<p class="bad">{text(f"not as it should have been in {count}: {named}")}</p>'


def summary(findings: Findings) -> str:
    """Return the figures at a glance, and what is missing or rendered otherwise."""
    cards = "".join(
        f'<div class="card{" alarm" if name == "faults" and value != "0" else ""}">'
        f"<b>{text(value)}</b><span>{text(name)}</span></div>"
        for name, value in findings.summary.items()
    )
    notes = "".join(f'<p class="bad">{text(loss)}</p>' for loss in findings.losses)
    notes += "".join(f'<p class="soft">{text(notice)}</p>' for notice in findings.notices)
    return f'<section class="cards">{cards}</section>{notes}'


def meanings(findings: Findings) -> str:
    """Return what each curve is, with its unit, and each column of the table of contacts."""
    made = ""
    if findings.curves is not None:
        rows = [[line.label, chart.unit, line.doc] for chart in findings.curves.charts for line in chart.lines]
        made += "<h2>What the curves are</h2>\n" + table(["curve", "unit", "meaning"], rows, words=(0, 1, 2))
    if findings.contacts:
        felt = [one for one in measured(findings.model) if one.show != "no"]
        known = [(title, _MEANT[key]) for key, title, *_ in _CONTACTS if key in _MEANT]
        rows = [[*pair] for pair in (*known, *((one.page_head, one.doc) for one in felt))]
        made += "<h2>What the columns of contacts are</h2>\n" + table(["column", "meaning"], rows, words=(0, 1))
    return made


def faults(findings: Findings) -> str:
    """Return the table of faults."""
    if not findings.faults:
        return '<h2>Faults</h2>\n<p class="good">none</p>'
    rows = [
        [number(fault.get("time_s", fault.get("time")), ".3f"), fault.get("device", ""), _trip(fault),
         fault.get("cause") or "", _safe(fault), fault.get("scene") or ""]
        for fault in findings.faults
    ]  # fmt: skip
    heads = ["time [s]", "device", "trip", "cause", "safe after [s]", "scene"]
    return "<h2>Faults</h2>\n" + table(heads, rows, words=(1, 2, 3, 5))


def _trip(fault: dict[str, Any]) -> str:
    return str(fault.get("trip") or f"injected: {fault.get('kind', '?')}")


def _safe(fault: dict[str, Any]) -> str:
    safe = fault.get("safe")
    if not isinstance(safe, dict):
        return "-"
    return number(safe.get("after_s"), ".3f") if safe.get("reached") else "not reached"


def contacts(findings: Findings) -> str:
    """Return the table of contacts; columns that nothing is known of are left out."""
    found = findings.contacts
    if not found:
        return '<h2>Contacts</h2>\n<p class="soft">none</p>'
    several = findings.model is None or len(findings.model.probes) > 1
    felt = [one for one in measured(findings.model) if one.show != "no"]
    shown = [
        column for column in (*_CONTACTS, *((one.key, one.page_head, f".{one.digits}f", one.scale) for one in felt))
        if any(entry.get(column[0]) is not None for entry in found) and (several or column[0] != "probe")
    ]  # fmt: skip
    rows = [[number(entry.get(key), form, scale) for key, _, form, scale in shown] for entry in found]
    words = [index for index, column in enumerate(shown) if column[0] in _TEXTS]
    choices, heads = findings.curves is not None, [column[1] for column in shown]
    short = [columns.shortcomings(findings.model, entry) for entry in found]
    if any(short):
        heads, words = [*heads, "not as it should be"], [*words, len(heads)]
        rows = [[*row, ", ".join(why)] for row, why in zip(rows, short, strict=True)]
    made = "<h2>Contacts</h2>\n" + table(heads, rows, words=words, choices=choices)
    said = [line for entry in found for line in columns.remarks(findings.model, entry)] if findings.model else []
    told = "".join(f'<p class="soft">{text(line)}</p>' for line in said[:_REMARKS])
    return made + told + (f'<p class="soft">and {len(said) - _REMARKS} more</p>' if len(said) > _REMARKS else "")


def picture(png: bytes | None, *, touching: bool = False) -> str:
    """Return the picture of the scene, if there is one: of its first touch, or of its end."""
    if png is None:
        return ""
    image = base64.b64encode(png).decode()
    when = "in its first touch" if touching else "at the end of the session"
    return f'<h2>Scene {when}</h2>\n<img alt="the scene {when}" src="data:image/png;base64,{image}">'


def timing(findings: Findings, histograms: int) -> str:
    """Return how the loop kept time: figures, and room for so many histograms."""
    found = findings.timing
    rows = [[name, *(number(figures.get(p), ".1f") for p in _PERCENTILES)] for name, figures in _measured(found)]
    facts = [row for key in ("ticks", "overruns", "skipped", "lost") for row in flattened(_FACTS[key], found.get(key))]
    facts += flattened("overruns by", found.get("culprits") or {})
    rate, late = found.get("rate_hz"), found.get("worst")
    scale = 1.0 / rate if isinstance(rate, float | int) and rate > 0 else math.nan
    worst = [
        [number(one.get("tick"), ".0f"), number(one.get("tick"), ".3f", scale), number(one.get("us"), ".0f"),
         str(one.get("culprit", ""))]
        for one in (late if isinstance(late, list) else ()) if isinstance(one, dict)
    ]  # fmt: skip
    made = "<h2>Timing of the servo loop</h2>\n"
    if isinstance(rate, float | int) and rate > 0:
        made += (
            f'<p class="soft">A tick is due every {1e6 / rate:.0f} µs. Lateness is how long after that it began; an '
            "overrun is a tick that ended after the next one was due; a period that was given up had no tick.</p>\n"
        )
    if rows:
        made += table(["duration [µs]", *_PERCENTILES], rows)
    if facts:
        made += table(["count", "value"], facts)
    if worst:
        made += table(["tick that ended latest", "at [s]", "after the next was due [µs]", "made by"], worst)
    plots = "".join(f'<div class="plot" id="histogram{index}"></div>' for index in range(histograms))
    return made + f'<div class="grid">{plots}</div>' if rows or facts or plots else ""


_FACTS = {"ticks": "ticks", "overruns": "overruns", "skipped": "periods given up", "lost": "samples not recorded"}


def _measured(found: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    parts = found.get("parts_us")
    named = [("tick", found.get("tick_us")), ("lateness", found.get("lateness_us"))]
    named += list(parts.items()) if isinstance(parts, dict) else []
    return [(name, figures) for name, figures in named if isinstance(figures, dict) and figures]


def marks(findings: Findings) -> str:
    """Return the table of marks, if there are any."""
    if not findings.marks:
        return ""
    rows = [[number(m.get("time"), ".3f"), m.get("name", ""), m.get("payload", "")] for m in findings.marks]
    return "<h2>Marks</h2>\n" + table(["time [s]", "mark", "payload"], rows, words=(1, 2))


def parameters(findings: Findings) -> str:
    """Return devices, limits, what the modalities say, provenance, and the scene."""
    made = "<h2>Parameters</h2>\n"
    devices, model = findings.report.get("devices", {}), findings.model
    if model is not None and model.devices:
        rows = [
            [name, device.plugin, "twin" if device.twin else "hardware",
             *(number(devices.get(name, {}).get(key)) for key in ("status", "limited", "locked_dropped"))]
            for name, device in model.devices.items()
        ]  # fmt: skip
        made += table(["device", "plugin", "kind", "status", "limited ticks", "dropped"], rows, words=(1, 2, 3))
        limits = [row for device in model.devices.values() for row in limit_rows(device)]
        made += table(["device", "limit", "value", "set by"], limits, words=(1, 2, 3))
    said = [row for name, found in findings.report.get("modalities", {}).items() for row in flattened(name, found)]
    if said:
        made += _folded("What the modalities say", table(["modality", "value"], said, words=(1,)))
    made += "<h2>Provenance</h2>\n" + table(["what", "value"], list(findings.provenance.items()), words=(1,))
    return made + _folded("The scene that ran", f"<pre>{text(findings.scene_xml)}</pre>")


def _folded(title: str, content: str) -> str:
    return f"<details><summary>{text(title)}</summary>{content}</details>"
