"""The sections of a session's page: answer, contacts, faults, timing, marks, limits, parameters."""

from __future__ import annotations

import base64
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from itouch.schema.terminal import number_of
from itouch_tools.report import columns
from itouch_tools.report.collect import Findings
from itouch_tools.report.columns import measured
from itouch_tools.report.limits_in_words import limit_rows
from itouch_tools.report.markup import flattened, number

#: Columns of the table of contacts, before those of the modalities: key in the report, title, number format, scale.
_CONTACTS = (
    ("probe", "probe", "", 1.0), ("object", "object", "", 1.0), ("material", "material", "", 1.0),
    ("begin_s", "begin [s]", ".3f", 1.0), ("end_s", "end [s]", ".3f", 1.0),
    ("impact_speed_m_s", "impact [mm/s]", ".0f", 1e3), ("peak_force_N", "peak force felt [N]", ".2f", 1.0),
    ("plate_gap_mm", "plate gap [mm]", ".3f", 1.0), ("plate_lead_ms", "plate lead [ms]", ".0f", 1.0),
)  # fmt: skip
_TEXTS = ("probe", "object", "material")
#: The meaning of those columns whose title does not say it.
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


@dataclass(frozen=True, slots=True)
class Table:
    """A table: heads, rows of as many cells, which columns hold text, and whether rows can be chosen."""

    heads: Sequence[str]
    rows: Sequence[Sequence[object]]
    words: Sequence[int] = ()
    choices: bool = False


def head(findings: Findings) -> dict[str, str]:
    """Return the page's title, ``name``, and below it what the page is about and when that began, ``told``."""
    source = os.path.basename(str(findings.provenance.get("scene") or ""))
    kind = f"{findings.kind} {findings.title} of {source}" if source else findings.kind
    told = ", ".join(part for part in (kind, findings.provenance.get("begin")) if part)
    return {"name": source.removesuffix(".xml") or findings.title, "told": told}


def answer(findings: Findings) -> dict[str, str]:
    """Return what was touched, the greatest force and what went wrong (``said``), and which contacts fell ``short``."""
    touched = list(dict.fromkeys(str(contact["object"]) for contact in findings.contacts))
    if touched:
        named = ", ".join(touched[:6]) + (f" and {len(touched) - 6} more" if len(touched) > 6 else "")
        parts = [f"touched: {named}"]
    else:
        parts = ["nothing was touched"]
    said = [f"{name}: {value}" for name, value in findings.summary.items() if name == "greatest force felt"]
    wrong = f"{number_of(len(findings.faults), 'fault')}, listed below" if findings.faults else "no fault"
    lost = ["not all of it was kept"] if findings.losses else []
    twins = [device.twin for device in findings.model.devices.values()] if findings.model is not None else []
    kind = ["all devices were simulated"] if twins and all(twins) else []
    short = [(str(c["object"]), why) for c in findings.contacts if (why := columns.shortcomings(findings.model, c))]
    named = ", ".join(f"{name} ({', '.join(why)})" for name, why in short[:4]) + (", ..." if len(short) > 4 else "")
    said_all = "; ".join([*parts, *said, wrong, *lost, *kind])
    count = f"{len(short)} of {len(findings.contacts)} contacts"
    return {"said": said_all, "short": f"not as it should have been in {count}: {named}" if short else ""}


def meanings(findings: Findings) -> list[tuple[str, Table]]:
    """Return the meaning of each curve, with its unit, and of each column of the table of contacts: titles, tables."""
    made = []
    if findings.curves is not None:
        rows = [[line.label, chart.unit, line.doc] for chart in findings.curves.charts for line in chart.lines]
        made.append(("What the curves are", Table(["curve", "unit", "meaning"], rows, (0, 1, 2))))
    if findings.contacts:
        felt = [one for one in measured(findings.model, findings.contacts) if one.show != "no"]
        known = [(title, _MEANT[key]) for key, title, *_ in _CONTACTS if key in _MEANT]
        pairs = [[*pair] for pair in (*known, *((one.page_head, one.doc) for one in felt))]
        made.append(("What the columns of contacts are", Table(["column", "meaning"], pairs, (0, 1))))
    return made


def faults(findings: Findings) -> Table | None:
    """Return the table of faults, if there are any."""
    if not findings.faults:
        return None
    rows = [
        [number(fault.get("time_s", fault.get("time")), ".3f"), fault.get("device", ""), _trip(fault),
         fault.get("cause") or "", _safe(fault), fault.get("scene") or ""]
        for fault in findings.faults
    ]  # fmt: skip
    return Table(["time [s]", "device", "trip", "cause", "safe after [s]", "scene"], rows, (1, 2, 3, 5))


def _trip(fault: dict[str, Any]) -> str:
    return str(fault.get("trip") or f"injected: {fault.get('kind', '?')}")


def _safe(fault: dict[str, Any]) -> str:
    safe = fault.get("safe")
    if not isinstance(safe, dict):
        return "-"
    return number(safe.get("after_s"), ".3f") if safe.get("reached") else "not reached"


@dataclass(frozen=True, slots=True)
class Contacts:
    """The table of contacts, the remarks shown below it, and how many more there are."""

    table: Table
    remarks: Sequence[str]
    more: int


def contacts(findings: Findings) -> Contacts | None:
    """Return the contacts, if there are any; columns without any value are left out."""
    found = findings.contacts
    if not found:
        return None
    several = findings.model is None or len(findings.model.probes) > 1
    felt = [one for one in measured(findings.model, findings.contacts) if one.show != "no"]
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
    said = (
        [line for entry in found for line in columns.contact_warnings(findings.model, entry)] if findings.model else []
    )
    return Contacts(Table(heads, rows, words, choices), said[:_REMARKS], max(0, len(said) - _REMARKS))


def picture(png: bytes | None, *, touching: bool = False) -> dict[str, str] | None:
    """Return the picture of the scene in base64, if any, and when it was taken: in the first touch or at the end."""
    if png is None:
        return None
    when = "in its first touch" if touching else "at the end of the session"
    return {"when": when, "data": base64.b64encode(png).decode()}


def timing(findings: Findings, histograms: int) -> dict[str, Any]:
    """Return how the loop kept time: a tick's period [us], tables of figures, and how many histograms there are."""
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
    tables = [
        Table(["duration [µs]", *_PERCENTILES], rows), Table(["count", "value"], facts),
        Table(["tick that ended latest", "at [s]", "after the next was due [µs]", "made by"], worst),
    ]  # fmt: skip
    period = f"{1e6 / rate:.0f}" if isinstance(rate, float | int) and rate > 0 else ""
    return {"period": period, "tables": [table for table in tables if table.rows], "histograms": histograms}


_FACTS = {"ticks": "ticks", "overruns": "overruns", "skipped": "periods given up", "lost": "samples not recorded"}


def _measured(found: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    parts = found.get("parts_us")
    named = [("tick", found.get("tick_us")), ("lateness", found.get("lateness_us"))]
    named += list(parts.items()) if isinstance(parts, dict) else []
    return [(name, figures) for name, figures in named if isinstance(figures, dict) and figures]


def marks(findings: Findings) -> Table | None:
    """Return the table of marks, if there are any."""
    if not findings.marks:
        return None
    rows = [[number(m.get("time"), ".3f"), m.get("name", ""), m.get("payload", "")] for m in findings.marks]
    return Table(["time [s]", "mark", "payload"], rows, (1, 2))


def parameters(findings: Findings) -> dict[str, Any]:
    """Return tables of devices and limits, of the modalities' reports and of the provenance, and the scene's XML."""
    devices, model = findings.report.get("devices", {}), findings.model
    shown = []
    if model is not None and model.devices:
        rows = [
            [name, device.plugin, "twin" if device.twin else "hardware",
             *(number(devices.get(name, {}).get(key)) for key in ("status", "limited", "locked_dropped"))]
            for name, device in model.devices.items()
        ]  # fmt: skip
        shown.append(Table(["device", "plugin", "kind", "status", "limited ticks", "dropped"], rows, (1, 2, 3)))
        limits = [row for device in model.devices.values() for row in limit_rows(device)]
        shown.append(Table(["device", "limit", "value", "set by"], limits, (1, 2, 3)))
    said = [row for name, found in findings.report.get("modalities", {}).items() for row in flattened(name, found)]
    return {
        "devices": shown,
        "modalities": Table(["modality", "value"], said, (1,)) if said else None,
        "provenance": Table(["what", "value"], list(findings.provenance.items()), (1,)),
        "scene": findings.scene_xml,
    }
