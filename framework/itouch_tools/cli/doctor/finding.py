"""One finding of the doctor: what was looked at, how it is, and what to do."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at: ``status`` is ok, lack or note; ``advice`` says what to do about a lack."""

    name: str
    status: str
    found: str
    advice: str = ""
