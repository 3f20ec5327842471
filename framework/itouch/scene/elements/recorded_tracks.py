"""Element `<record>`: what is recorded, how often, and where to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from itouch.schema.fields import children, choice, quantity, text

#: Placeholders that may be used in the name of a recording.
PLACEHOLDERS = ("{scene}", "{time}", "{seed}")


@dataclass(frozen=True, slots=True)
class RecordChannels:
    """More fields of State to record, at a rate of their own."""

    TAG: ClassVar[str] = "channels"
    of: str = text(doc="names of State fields separated by spaces; * stands for anything: finger.* heat.desired")
    rate: float | None = quantity(
        "Hz", low=1e-2, high=4000, default=None, doc="must divide the servo rate; default: the servo rate"
    )


@dataclass(frozen=True, slots=True)
class RecordElement:
    """Records the session as MCAP: everything that a replay needs, and the channels that are chosen here."""

    TAG: ClassVar[str] = "record"
    #: What is taken for a name that can't be read, so that the channels are checked all the same.
    STANDS_IN: ClassVar[Mapping[str, str]] = {"to": "unread.mcap"}
    to: str = text(doc="file below the working folder, ending in .mcap; {scene}, {time} and {seed} are filled in")
    channels: str = text(default="", doc="names of State fields, separated by spaces; * stands for any characters")
    rate: float | None = quantity(
        "Hz",
        low=1e-2,
        high=4000,
        default=None,
        doc="rate of `channels`; must divide the servo rate, which is the default",
    )
    on_failure: str = choice(
        "go-on", "stop", default="go-on", doc="whether the session goes on or stops when recording fails"
    )
    more: tuple[RecordChannels, ...] = children(RecordChannels)

    def __post_init__(self) -> None:
        bare = self.to
        for placeholder in PLACEHOLDERS:
            bare = bare.replace(placeholder, "x")
        if not bare.endswith(".mcap") or "{" in bare or "}" in bare:
            raise ValueError(f"'{self.to}' must end in .mcap and may hold {', '.join(PLACEHOLDERS)}")
        if bare.startswith("/") or ".." in bare.split("/") or "\\" in bare or "\0" in bare:
            raise ValueError(f"'{self.to}' must lie below the working folder; --record takes any path")
