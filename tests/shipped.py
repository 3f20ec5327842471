"""Where the shipped scenes are."""

from __future__ import annotations

from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
SCENES = REPOSITORY / "scenes"
STUDIES = sorted((SCENES / "studies").glob("*.xml"))
SWEEPS = [path for path in sorted((SCENES / "sweeps").glob("*.xml")) if "<sweep" in path.read_text(encoding="utf-8")]
#: Every shipped scene, rig and library of materials.
SCENE_FILES = sorted(set(SCENES.rglob("*.xml")) - set(STUDIES) - set(SWEEPS))
