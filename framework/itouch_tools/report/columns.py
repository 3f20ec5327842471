"""Columns of the tables of contacts, on page and terminal: the framework's own, and what modalities measure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from itouch.loop import contact_report
from itouch.loop.contact_report import figures_of
from itouch.plugin import Measured
from itouch.world import Model

#: The framework's own columns of a terminal's table: those before what modalities measured, and those after it.
_WHEN = (
    Measured("begin_s", "s", "when it began", short_title="begin s", digits=3),
    Measured("end_s", "s", "when it ended", short_title="end s", digits=3),
)
_HOW = (
    Measured("peak_force_N", "N", "greatest force", short_title="peak N"),
    Measured("plate_gap_mm", "mm", "virtual surface minus plate top", short_title="gap mm", digits=3),
)


def measured(model: Model | None, contacts: Iterable[Mapping[str, Any]]) -> tuple[Measured, ...]:
    """Return what the modalities of a scene measure of a contact; a figure that several give comes once for each."""
    return figures_of(model, contacts) if model is not None else ()


def rows(model: Model, contacts: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Return a terminal's table: the heads, then a row for each contact; with several probes it names the probe."""
    felt = [one for one in measured(model, contacts) if one.show == ""]
    shown = (*_WHEN, *(one for one in felt if not one.percent), *_HOW, *(one for one in felt if one.percent))
    what = ("probe", "object", "material") if len(model.probes) > 1 else ("object", "material")
    heads = [*what, *(one.short_head for one in shown)]
    return [heads, *(_row(entry, what, shown) for entry in contacts)]


def _row(entry: Mapping[str, Any], what: Iterable[str], shown: Iterable[Measured]) -> list[str]:
    return [*(str(entry[key]) for key in what), *(one.formatted(entry.get(one.key)) for one in shown)]


def contact_summaries(model: Model, entry: Mapping[str, Any]) -> list[str]:
    """Return what the modalities say of a contact that has ended."""
    found = (contact_report.contact_summary(one, entry) for one in model.modalities)
    return [words for words in found if words]


def shortcomings(model: Model | None, entry: Mapping[str, Any]) -> list[str]:
    """Return in what a contact was not as it should have been, in the words of the modality that measures it."""
    found = ["the plate was missed"] if entry.get("plate_missed") else []
    found += ["the plate was withdrawn (T4)"] if entry.get("plate_withdrawn") else []
    for one in measured(model, [entry]):
        if one.required_value is not None and entry.get(one.key) is not None and entry[one.key] != one.required_value:
            found.append(one.failure_reason)
    return found


def contact_warnings(model: Model, entry: Mapping[str, Any]) -> list[str]:
    """Return the remarks on a contact that stand below the table: what was not as it should have been."""
    found: list[str] = []
    if entry.get("plate_missed"):
        where = f"{entry['object']} at {entry['begin_s']:.3f} s"
        found.append(f"{where}: the plate was not felt where it should have been; the arm gave its force")
    if entry.get("plate_withdrawn"):
        lasted = f" after {entry['plate_s']:.1f} s" if entry.get("plate_s") is not None else ""
        found.append(
            f"{entry['object']} at {entry['begin_s']:.3f} s: the plate was withdrawn{lasted}, for the finger had been "
            "on it as long as it may (T4, contact-time); the arm gave its force"
        )
    for one in model.modalities:
        found += contact_report.contact_warnings(one, entry)
    return found
