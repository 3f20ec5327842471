"""What the doctor finds: what was examined, its condition, and what to do."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """One thing that was examined; ``status`` is ok, lack or note, on a rig pass, fail or not possible."""

    name: str
    status: str
    found: str
    advice: str = ""
