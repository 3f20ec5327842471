"""Plugins of third parties, laid out as pip lays them out."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def pip_install(site: Path, source: Path) -> Path:
    """Install a distribution into a folder as a user does, but from its source and without a network; return it."""
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--no-index",
               "--disable-pip-version-check", "--target", str(site), str(source)]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return site


def install(
    site: Path, name: str, entry_points: str, *, module: str = "", code: str = "", version: str = "1.0"
) -> Path:
    """Write a distribution into a folder: what it lists, and its module if there is code; return the folder.

    Parameters
    ----------
    entry_points
        As it stands in ``entry_points.txt``: groups and lines ``name = module:object``.
    module
        The module's name; that of the distribution if it is not given.
    """
    plain = name.replace("-", "_")
    info = site / f"{plain}-{version}.dist-info"
    info.mkdir(parents=True, exist_ok=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(entry_points, encoding="utf-8")
    if code:
        (site / f"{module or plain}.py").write_text(code, encoding="utf-8")
    return site
