"""Marks in State: the operator's notes and the beginnings of trials; the last ones with their payloads."""

from __future__ import annotations

from itouch.plugin import Field

#: How many marks State remembers (a recording has them all); greatest size of a name and of a payload [bytes].
MARKS, NAME, PAYLOAD = 8, 32, 512
#: One remembered mark: the tick before which it was set, its name and payload in UTF-8.
MARK_DTYPE = [("tick", "i8"), ("name", f"S{NAME}"), ("payload", f"S{PAYLOAD}")]

FIELDS = (
    Field("marks.count", "i8", unit="1", doc="marks so far"),
    Field("marks.table", MARK_DTYPE, MARKS, unit="mixed", doc="the last ones: tick, name, payload"),
)
