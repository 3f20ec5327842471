"""Sphinx configuration; what the program writes of itself is written before the pages are read."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version as installed
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from generated import drawn_by_commands
from pygments.lexers.special import TextLexer
from reference_pages import write_commands, write_pages
from sphinx.application import Sphinx

project = "itouch-py"
author = "the itouch-py developers"
version = release = installed("itouch-py")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml"]
html_math_renderer = "mathml"
html_static_path = ["static"]
html_css_files = ["site.css"]
autodoc_member_order = "groupwise"
autodoc_class_signature = "mixed"
napoleon_google_docstring = False
napoleon_use_ivar = True
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3
toc_object_entries = False  # every name has a heading of its own
html_theme = "furo"
html_title = f"itouch-py {version}"
exclude_patterns = ["_build", "explanation/reproduced"]
suppress_warnings = ["myst.header", "ref.python"]


def _reproduce_paper() -> None:
    """Recompute the paper's figures and claims with `itouch-py reproduce`; again only when the code has changed."""
    import contact_heat
    import itouch_thermal

    code = [Path(package.__file__ or "").parent for package in (contact_heat, itouch_thermal)]
    out = Path(__file__).parent / "explanation" / "reproduced"
    digest = hashlib.sha256()
    for path in sorted(path for folder in code for path in folder.rglob("*.py")):
        digest.update(path.read_bytes())
    stamp = out / "code.sha256"
    if stamp.exists() and stamp.read_text(encoding="utf-8") == digest.hexdigest():
        return
    subprocess.run([sys.executable, "-m", "itouch_tools.cli", "reproduce", "--out", str(out)], check=True)
    stamp.write_text(digest.hexdigest(), encoding="utf-8")


write_pages()
with ThreadPoolExecutor(os.cpu_count()) as beside:  # the longest first
    for job in [beside.submit(job) for job in (_reproduce_paper, *drawn_by_commands(), write_commands)]:
        job.result()


def setup(app: Sphinx) -> None:
    """Let tables of numbers be a language: they are tested apart from text."""
    app.add_lexer("csv", TextLexer)
