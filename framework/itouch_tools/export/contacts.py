"""Contacts of a recording, from its events."""

from __future__ import annotations

from typing import NamedTuple

from itouch.recording.recording import Recording


class ContactSpan(NamedTuple):
    """One contact of a probe and an object; times in [s], ``end`` is None if the contact was still open."""

    probe: str
    object: str
    begin: float
    end: float | None


def contacts_of(recording: Recording) -> list[ContactSpan]:
    """Return the contacts in the order in which they began."""
    found: list[ContactSpan] = []
    running: dict[str, int] = {}
    for event in recording.events:
        probe = str(event["probe"])
        if event["kind"] == "BEGIN":
            running[probe] = len(found)
            found.append(ContactSpan(probe, str(event["object"]), float(event["time"]), None))
        elif event["kind"] == "END" and probe in running:
            index = running.pop(probe)
            found[index] = found[index]._replace(end=float(event["time"]))
    return found
