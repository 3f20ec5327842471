"""What the doctor finds."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at: ``status`` is ok, lack or note; ``advice`` says what to do about a lack."""

    name: str
    status: str
    found: str
    advice: str = ""
