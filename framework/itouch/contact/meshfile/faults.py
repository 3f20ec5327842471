"""What can be wrong with a mesh file: an error that refuses it, or a finding that is reported."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


class MeshError(ValueError):
    """A mesh file that cannot be used; ``code`` is stable and documented."""

    def __init__(self, code: str, sentence: str, advice: str = "") -> None:
        super().__init__(sentence)
        self.code, self.sentence, self.advice = code, sentence, advice

    def __str__(self) -> str:
        return f"{self.sentence} ({self.advice})" if self.advice else self.sentence


@dataclass(frozen=True, slots=True)
class MeshFinding:
    """What a mesh's user should know: what was repaired (a note), or what may not be as intended (a warning)."""

    code: str
    sentence: str
    advice: str = ""
    severity: Literal["note", "warning"] = "note"
