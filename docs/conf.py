"""Sphinx configuration; the scene reference is written from the grammar before the pages are read."""

from __future__ import annotations

from importlib.metadata import version as installed
from pathlib import Path

project = "itouch-py"
author = "the itouch-py developers"
version = release = installed("itouch-py")
extensions = ["myst_parser"]
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = f"itouch-py {version}"
exclude_patterns = ["_build"]
suppress_warnings = ["myst.header"]


def _write_scene_reference() -> None:
    from itouch.plugin.discovery import Catalog
    from itouch.scene.grammar import reference

    page = Path(__file__).parent / "reference" / "scene.md"
    text = reference(Catalog())
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


_write_scene_reference()
