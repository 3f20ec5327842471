"""Puts built documentation beside that of earlier versions: ``python .ci/site.py BUILT SITE``.

``sphinx-build -W -b html docs BUILT`` builds it.  It goes to ``SITE/VERSION``; ``SITE/index.html`` leads to the newest
version that is released, and lists all; ``SITE/versions.json`` says the same to programs.
"""

from __future__ import annotations

import html
import json
import re
import shutil
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def put(built: Path, site: Path, version: str) -> list[str]:
    """Copy a built documentation to its version's folder, and write the index; return all versions, newest first."""
    if not (built / "index.html").is_file():
        raise SystemExit(f"'{built}' holds no built documentation: there is no index.html")
    shutil.rmtree(site / version, ignore_errors=True)
    shutil.copytree(built, site / version, ignore=shutil.ignore_patterns(".doctrees", ".buildinfo"))
    there = [path.parent.name for path in site.glob("*/index.html")]
    versions = sorted((name for name in there if re.match(r"\d", name)), key=_order, reverse=True)
    newest = next((name for name in versions if _order(name)[1]), versions[0])
    (site / "versions.json").write_text(json.dumps({"newest": newest, "versions": versions}, indent=1) + "\n")
    links = "".join(f'<li><a href="{html.escape(name)}/">{html.escape(name)}</a></li>' for name in versions)
    (site / "index.html").write_text(
        f'<!doctype html><meta charset="utf-8"><title>itouch-py</title>'
        f'<meta http-equiv="refresh" content="0; url={html.escape(newest)}/"><ul>{links}</ul>\n'
    )
    return versions


def _order(version: str) -> tuple[tuple[int, ...], bool, str]:
    """Return what versions are sorted by: numbers; a release comes after what was tried before it (1.0rc1)."""
    numbers, rest = re.match(r"([\d.]*)(.*)", version).groups()  # type: ignore[union-attr]
    return tuple(int(part) for part in numbers.split(".") if part), not rest, rest


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    print(" ".join(put(Path(sys.argv[1]), Path(sys.argv[2]), project["version"])))
