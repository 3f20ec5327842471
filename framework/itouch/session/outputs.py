"""The outputs of a running session besides its report: recording, periodic snapshots, streams, triggers."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from itouch.session.session_error import SessionError

if TYPE_CHECKING:
    from itouch.session.session import Session


@dataclass(frozen=True, slots=True)
class Outputs:
    """What to keep.

    Attributes
    ----------
    record
        File to record to; empty: as the scene's ``<record>`` says.
    records
        False: do not record, whatever the scene says.
    save, every
        File to save to, and how often [s]; 0: not while it runs.
    streams
        Whether to offer Lab Streaming Layer streams.
    trigger, codes
        Port on which event codes are put, empty: none; and the codes of marks by name.
    contacts
        Codes of contacts by ``begin`` and ``end``, or for one object by ``begin:OBJECT`` and ``end:OBJECT``.
    """

    record: str = ""
    records: bool = True
    save: str = ""
    every: float = 0.0
    streams: bool = False
    trigger: str = ""
    codes: Mapping[str, int] = field(default_factory=dict)
    contacts: Mapping[str, int] = field(default_factory=dict)

    def dump(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


@contextlib.contextmanager
def open_outputs(session: Session, keep: Outputs) -> Iterator[None]:
    """Keep what is asked for while the session runs in this context.

    Raises
    ------
    RecordingError, SessionError
        If a file can't be written, streams can't be offered, or a code is for an object that does not exist.
    """
    session.records = keep.records
    with contextlib.ExitStack() as stack:
        if keep.record:
            session.record(keep.record)
        if keep.every > 0.0:
            stack.enter_context(session.saving(keep.save, keep.every))
        if keep.streams:
            from itouch.session.lsl import Streams

            stack.enter_context(Streams(session))
        if keep.trigger:
            from itouch.session.trigger_ports import wire
            from itouch.session.triggers import OF, Triggers

            objects = session.model.objects
            for name in keep.contacts:
                touched = name.partition(OF)[2]
                if touched and touched not in objects:
                    raise SessionError(f"a code is for contacts with '{touched}', but the scene's objects are "
                                       f"{', '.join(objects)}")  # fmt: skip
            stack.enter_context(Triggers(session, wire(keep.trigger), keep.codes, keep.contacts))
        yield
