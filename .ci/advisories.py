"""Look the pinned versions up in a clone of the Python Packaging Advisory Database, without pip-audit's service.

``python .ci/advisories.py FOLDER [constraints.txt]`` prints every known weakness of a pinned version and ends with 1 if
there is one, with 2 if the folder is no such database.  ``FOLDER`` is a clone of
github.com/pypa/advisory-database; what was found after its newest entry is not in it, so that date is printed.
Source of the format: the OSV schema, 1.6.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml
from packaging.utils import canonicalize_name
from packaging.version import Version


def pinned(text: str) -> dict[str, Version]:
    """Return name -> version of a file of constraints with hashes."""
    found = re.findall(r"^([A-Za-z0-9._-]+)==([^\s;\\]+)", text, re.MULTILINE)
    return {canonicalize_name(name): Version(version) for name, version in found}


def hit(version: Version, affected: Mapping[str, Any]) -> bool:
    """Tell whether a version is among those that an entry says are affected: listed, or within one of its ranges."""
    if str(version) in affected.get("versions", ()):
        return True
    for span in affected.get("ranges", ()):
        if span.get("type") != "ECOSYSTEM":
            continue
        inside = False
        events = [(kind, str(at)) for event in span["events"] for kind, at in event.items()]
        for kind, at in sorted(events, key=lambda event: Version(event[1])):
            limit = Version(at)
            if kind == "introduced" and version >= limit:
                inside = True
            elif (kind == "fixed" and version >= limit) or (kind == "last_affected" and version > limit):
                inside = False
        if inside:
            return True
    return False


def weaknesses(pins: Mapping[str, Version], folder: Path) -> Iterator[tuple[str, str]]:
    """Yield name and version, and what is known of them, of every pinned version that an entry names."""
    for name, version in pins.items():
        for path in sorted((folder / "vulns" / name).glob("*.yaml")):
            entry = yaml.safe_load(path.read_text(encoding="utf-8"))
            if "withdrawn" in entry:
                continue
            for affected in entry.get("affected", ()):
                if canonicalize_name(affected["package"]["name"]) == name and hit(version, affected):
                    yield f"{name} {version}", f"{entry['id']}: {' '.join(entry.get('details', '').split())[:160]}"
                    break


def newest(folder: Path) -> str:
    """Return the date of the newest entry of the database; empty if the folder holds none."""
    lines = (re.search(r"^published: '?\"?([\dT:.-]+)", path.read_text(encoding="utf-8"), re.MULTILINE)
             for path in (folder / "vulns").rglob("*.yaml"))  # fmt: skip
    return max((line.group(1) for line in lines if line), default="")


def main(arguments: list[str]) -> int:
    """Print what is known; return the exit code."""
    if len(arguments) not in (1, 2):
        print("python .ci/advisories.py FOLDER [constraints.txt]", file=sys.stderr)
        return 2
    folder = Path(arguments[0])
    until = newest(folder)
    if not until:
        print(f"{folder} is no clone of github.com/pypa/advisory-database: no entries in vulns/", file=sys.stderr)
        return 2
    pins = pinned(Path(arguments[1] if len(arguments) == 2 else "constraints.txt").read_text(encoding="utf-8"))
    found = list(weaknesses(pins, folder))
    for package, told in found:
        print(f"{package}: {told}")
    print(f"{len(pins)} pinned versions, {len(found)} known weaknesses, by entries until {until[:10]}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
