"""Contacts of a recording, from its events, and from its report where they began before it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from itouch.recording.recording import Recording


class ContactSpan(NamedTuple):
    """One contact of a probe and an object; times in [s], ``end`` is None if the contact was still open."""

    probe: str
    object: str
    begin: float
    end: float | None


def contacts_of(recording: Recording) -> list[ContactSpan]:
    """Return the contacts in the order in which they began.

    Those that were open when the recording began, as that of a session that goes on from a snapshot, are among them:
    their begin is the report's, or where there is none the first tick of the recording.
    """
    found: list[ContactSpan] = []
    running: dict[str, int] = {}
    open_before = _open_before(recording)
    found.extend(open_before)
    running |= {contact.probe: place for place, contact in enumerate(open_before)}
    for event in recording.events:
        probe = str(event["probe"])
        if event["kind"] == "BEGIN":
            running[probe] = len(found)
            found.append(ContactSpan(probe, str(event["object"]), float(event["time"]), None))
        elif event["kind"] == "END" and probe in running:
            index = running.pop(probe)
            found[index] = found[index]._replace(end=float(event["time"]))
    return found


def _open_before(recording: Recording) -> list[ContactSpan]:
    """Return the contacts that were open when the recording began, without their ends."""
    if not len(recording.ticks) or not recording.ticks[0]:
        return []
    first = float(recording.ticks[0]) * recording.period
    # a contact lasts until its END: a probe whose first event is one was in contact from the first tick on
    earliest: dict[str, Mapping[str, Any]] = {}
    for event in recording.events:
        earliest.setdefault(str(event["probe"]), event)
    objects = {probe: str(event["object"]) for probe, event in earliest.items() if event["kind"] == "END"}
    begins = dict.fromkeys(objects, first)
    listed = (recording.report or {}).get("contacts")
    for entry in listed if isinstance(listed, list) else ():
        match entry:
            case {"probe": str(probe), "object": str(touched), "begin_s": int() | float() as begin, "end_s": end}:
                lasts = end is None or (isinstance(end, int | float) and end >= first)
                if begin < first and lasts and objects.setdefault(probe, touched) == touched:
                    begins[probe] = float(begin)
            case _:  # a report of a file may be anything
                pass
    return sorted((ContactSpan(probe, objects[probe], begins[probe], None) for probe in begins),
                  key=lambda contact: contact.begin)  # fmt: skip
