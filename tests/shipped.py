"""Where the shipped scenes are."""

from __future__ import annotations

from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
SCENES = REPOSITORY / "scenes"
